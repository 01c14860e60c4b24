"""The limb from space: geometry, thin air in closed form, Monte-Carlo beside zones, and the sun behind it."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from airs import pure_air
from scipy.integrate import quad
from scipy.special import kve
from typer.testing import CliRunner

import twilight
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config.scene import Observer
from twilight.engine import Problem
from twilight.numerics.phase import rayleigh_phase
from twilight.scene import Scene
from twilight.solvers import montecarlo, zones
from twilight.studies.limb.geometry import field_of_view, limb_geometry
from twilight.studies.limb.limb import limb_of
from twilight.studies.limb.occultation import occultation

WAVELENGTHS = [470.0, 675.0]
SCALE_KM = 8.0
OBSERVER_KM = 600.0


@pytest.fixture(scope="module")
def field():
    return twilight.solve("pure-air", wavelength_nm=WAVELENGTHS, quality="draft")


@pytest.fixture(scope="module")
def once():
    """Light scattered once."""
    return twilight.solve(
        "pure-air", wavelength_nm=WAVELENGTHS, quality="draft", settings={"solver.max_orders": 1, "ground.albedo": 0.0}
    )


@pytest.fixture(scope="module")
def exponential():
    return pure_air(np.arange(0.0, 160.1, 1.0), refractivity=3e-5, wavelengths=(550.0,))


@pytest.mark.parametrize("sun, azimuth", [(30.0, 0.0), (-4.0, 60.0), (50.0, 135.0), (10.0, 180.0)])
def test_the_sun_of_the_observer_is_that_of_the_tangent_point(exponential, sun, azimuth):
    """By vectors in space: the angles between sun, vertical and line of sight, at both ends."""
    found = limb_geometry(exponential, np.array([25.0]), OBSERVER_KM, sun, azimuth)
    low, high = exponential.earth_radius_km + np.array([25.0, OBSERVER_KM])
    s, a = np.radians(sun), np.radians(azimuth)
    to_sun = np.array([np.cos(s) * np.cos(a), np.cos(s) * np.sin(a), np.sin(s)])
    sight = np.array([1.0, 0.0, 0.0])
    place = np.array([-np.sqrt(high**2 - low**2), 0.0, low])
    up = place / high
    assert found.elevation_deg[0] == pytest.approx(np.degrees(np.arcsin(up @ sight)))
    assert found.sun_elevation_deg[0] == pytest.approx(np.degrees(np.arcsin(up @ to_sun)))
    level = [v - (v @ up) * up for v in (sight, to_sun)]
    cosine = level[0] @ level[1] / np.linalg.norm(level[0]) / np.linalg.norm(level[1])
    assert found.azimuth_deg[0] == pytest.approx(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))), abs=1e-5)
    assert found.scattering_angle_deg[0] == pytest.approx(np.degrees(np.arccos(sight @ to_sun)))


def test_thin_air_scatters_once_along_a_straight_line(field, once):
    """High in the air: column along the line, sunlight dimmed by nothing, phase function; light from below comes to it,
    which a field of one order has not."""
    medium = field.medium
    tangent, sun, azimuth = np.array([60.0, 70.0, 80.0]), 30.0, 90.0
    found = once.limb(tangent, sun, azimuth)["sun_normalised_radiance"].values
    cosine = np.cos(np.radians(sun)) * np.cos(np.radians(azimuth))
    half = np.sqrt((medium.earth_radius_km + medium.top_km) ** 2 - (medium.earth_radius_km + tangent) ** 2)
    for k, z in enumerate(tangent):
        s = np.linspace(-half[k], half[k], 20_001)
        altitude = np.hypot(medium.earth_radius_km + z, s) - medium.earth_radius_km
        column = np.trapezoid(medium.at(altitude).air_scattering, s, axis=0)
        np.testing.assert_allclose(found[k], column * rayleigh_phase(cosine, medium.depolarisation), rtol=0.01)
    assert np.all(field.limb(tangent, sun, azimuth)["sun_normalised_radiance"].values > found)


def test_exponential_thin_air_falls_by_its_scale_height(exponential):
    """Where the air is thin the radiance is beta K1(x) exp(x) phase function, x = (R + z) / H: Chapman's column."""
    thin = replace(exponential, air_scattering_per_km=1e-3 * exponential.air_scattering_per_km)
    settings = replace(zones.QUALITIES["draft"], max_orders=1)
    scene = Scene(thin, None, zones, settings, (), Observer(altitude_km=OBSERVER_KM), "thin")
    tangent = np.array([30.0, 38.0, 46.0])
    light = limb_of(Problem(scene).solve(), tangent, 40.0, 60.0)["sun_normalised_radiance"].values[:, 0]
    radius = thin.earth_radius_km + tangent
    column = 1.15e-5 * np.exp(-tangent / SCALE_KM) * 2.0 * radius * kve(1, radius / SCALE_KM)
    cosine = np.cos(np.radians(40.0)) * np.cos(np.radians(60.0))
    np.testing.assert_allclose(light, column * rayleigh_phase(cosine, 0.0), rtol=0.01)
    np.testing.assert_allclose(8.0 / np.log(light[:-1] / light[1:]), SCALE_KM, rtol=0.002)


def test_random_paths_see_the_same_limb(field):
    settings = montecarlo.MonteCarloSettings(target_stderr=None, samples=400)
    line = limb_geometry(field.medium, np.array([20.0]), OBSERVER_KM, 20.0, 60.0)
    walk = montecarlo.prepare(field.medium.select(slice(0, 1)), settings, observer_altitude_km=OBSERVER_KM)
    question = [a.item() for a in (line.sun_elevation_deg, line.elevation_deg, line.azimuth_deg)]
    found = walk.radiance_with_error(*question)
    light, error = found.radiance[0], found.standard_error[0]
    ours = field.limb(20.0, 20.0, 60.0)["sun_normalised_radiance"].values[0, 0]
    assert error < 0.01 * light
    assert abs(ours - light) < 4.0 * error + 0.005 * light


def test_fields_of_view_are_means(field):
    """An exponential has the means sinh(w / 2 H) / (w / 2 H) and exp(sigma^2 / 2 H^2) times its middle."""
    width, scale = 6.0, 7.0
    sigma = width / (2.0 * np.sqrt(2.0 * np.log(2.0)))
    half = 0.5 * width / scale
    for shape, expected in (("box", np.sinh(half) / half), ("gaussian", np.exp(0.5 * (sigma / scale) ** 2))):
        offset, weight = field_of_view(width, shape)
        assert weight @ np.exp(-offset / scale) == pytest.approx(expected, rel=1e-6)
    line, mean = (field.limb(70.0, 30.0, field_of_view_km=w)["radiance"].values[0] for w in (None, width))
    assert np.all((mean > 1.01 * line) & (mean < 1.2 * line))


def test_the_limb_by_layers(once):
    """Absorption counts along the line of sight: most in the layer of its tangent point."""
    edges = [0.0, 20.0, 30.0, 34.0, 50.0]
    found = once.limb([32.0], 40.0, air_mass=True, edges_km=edges)["box_air_mass_factor"].values[0]
    assert np.argmax(found[:, 1]) == 2
    radius = once.medium.earth_radius_km
    ways = 2.0 * np.sqrt((radius + np.array([34.0, 50.0])) ** 2 - (radius + 32.0) ** 2)
    ways[1] -= ways[0]
    # half of the line's way above the layer of the tangent point, and that of sunlight
    expected = 0.5 * ways[1] / 16.0 + 1.0 / np.sin(np.radians(40.0))
    assert found[3, 1] == pytest.approx(expected, rel=0.1)


def test_occultation_without_refraction_is_chapman_s(exponential):
    straight = replace(exponential, refractivity=0.0 * exponential.refractivity)
    tangent = np.array([8.0, 20.0, 40.0])
    found = occultation(straight, tangent)
    radius = straight.earth_radius_km + tangent
    depth = 0.0115 * np.exp(-tangent / SCALE_KM) * 2.0 * radius * kve(1, radius / SCALE_KM)
    np.testing.assert_allclose(-np.log(found["transmittance"].values[:, 0]), depth, rtol=1e-4)
    np.testing.assert_allclose(found["beam_spreading"].values, 1.0, rtol=1e-6)
    np.testing.assert_allclose(found["tangent_altitude"].values[:, 0], tangent, atol=1e-6)


@pytest.mark.parametrize("apparent", [8.0, 16.0])
def test_occultation_follows_the_bent_ray(exponential, apparent):
    """Depth and bending by quadrature along n r sin i = p, from the lowest point out, in x with r^2 = r0^2 + x^2."""
    dense = replace(exponential, refractivity=8.0 * exponential.refractivity)
    found = occultation(dense, apparent).isel(apparent_tangent_altitude=0, wavelength=0)
    radius, p = dense.earth_radius_km, dense.earth_radius_km + apparent
    n0 = float(dense.refractivity[0, 0])
    lowest = radius + float(found["tangent_altitude"])
    assert lowest * (1.0 + n0 * np.exp(-(lowest - radius) / SCALE_KM)) == pytest.approx(p, abs=1e-3)

    def way(x):
        r = np.hypot(lowest, x)
        index = 1.0 + n0 * np.exp(-(r - radius) / SCALE_KM)
        root = np.sqrt((index * r) ** 2 - (lowest * (1.0 + n0 * np.exp(-(lowest - radius) / SCALE_KM))) ** 2)
        return x / r, r, index, root

    def depth(x):
        slope, r, index, root = way(x)
        return 2.0 * 0.0115 * np.exp(-(r - radius) / SCALE_KM) * index * r / root * slope

    def bending(x):
        slope, _, index, root = way(x)
        return 2.0 * p * (index - 1.0) / SCALE_KM / index / root * slope

    farthest = np.sqrt((radius + 160.0) ** 2 - lowest**2)
    expected = quad(depth, 1e-3, farthest, limit=500, points=[10.0, 100.0, 500.0])[0]
    assert -np.log(float(found["transmittance"])) == pytest.approx(expected, rel=1e-3)
    bent = quad(bending, 1e-3, farthest, limit=500, points=[10.0, 100.0, 500.0])[0]
    assert np.radians(float(found["bending"])) == pytest.approx(bent, rel=1e-3)


def test_refraction_spreads_sunlight_as_the_closed_form_says(exponential):
    """1 / (1 + L b / H), L the distance to the limb, b the bending (Baum and Code 1953), and the shorter circle."""
    tangent = np.array([30.0, 45.0, 60.0])
    found = occultation(exponential, tangent, observer_altitude_km=3000.0)
    radius = exponential.earth_radius_km
    bending = 3e-5 * np.exp(-tangent / SCALE_KM) * np.sqrt(2.0 * np.pi * radius / SCALE_KM)
    np.testing.assert_allclose(np.radians(found["bending"].values[:, 0]), bending, rtol=0.01)
    distance = radius + 3000.0
    along = np.sqrt(distance**2 - (radius + tangent) ** 2)
    seen = np.arcsin((radius + tangent) / distance)
    expected = np.sin(seen) / np.sin(seen - bending) / (1.0 + along * bending / SCALE_KM)
    np.testing.assert_allclose(found["beam_spreading"].values[:, 0], expected, rtol=0.003)
    assert np.all(np.diff(found["beam_spreading"].values[:, 0]) > 0.0)


def test_rays_that_meet_the_ground_bring_no_light():
    medium = twilight.medium("pure-air", WAVELENGTHS)
    found = occultation(medium, [0.5, 6.0], field_of_view_km=1.0)
    assert np.all(found["transmittance"].values[0] == 0.0) and np.all(np.isnan(found["tangent_altitude"].values[0]))
    assert np.all(np.isnan(found["irradiance"].values[0])) and np.all(found["transmittance"].values[1] > 0.0)


def test_what_is_refused(field):
    for call, why in (
        (lambda: field.limb(20.0, 30.0, observer_altitude_km=20.0), "allowed is more than .* above the air"),
        (lambda: field.limb([20.0, -1.0], 30.0), r"each from 0 \(the ground\) to"),
        (lambda: field.limb(20.0, 95.0), "sun_elevation_deg is 95; allowed is -90 to 90"),
        (lambda: field.limb(20.0, 30.0, field_of_view_km=0.0), "field_of_view_km is 0; allowed is more than 0"),
        (lambda: field.limb(20.0, 30.0, field_of_view_shape="round"), "must be box or gaussian"),
    ):
        with pytest.raises(TwilightError, match=why):
            call()
    upwards = twilight.solve("continental-average", solver="compact", wavelength_nm=[470.0])
    with pytest.raises(TwilightError, match="compact does not look below the horizontal; zones and montecarlo do"):
        upwards.limb(20.0, 30.0)


def test_the_command(tmp_path):
    xarray = pytest.importorskip("xarray")
    runner, where = CliRunner(), tmp_path / "made"
    words = ["limb", "pure-air", "--wavelength", "470,675", "--tangent-km", "20:60:20", "--output", str(where)]
    made = runner.invoke(app, [*words, "--sun-zenith", "60", "--quality", "draft", "--field-of-view-km", "2"])
    assert made.exit_code == 0, made.output
    with open(where / "limb.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6 and float(rows[0]["tangent_altitude_km"]) < 20.0
    with xarray.open_dataset(where / "limb.nc", engine="h5netcdf") as found:
        assert found["radiance"].dims == ("apparent_tangent_altitude", "wavelength")
        assert found.attrs["field_of_view_km"] == 2.0
    assert (where / "limb.png").stat().st_size > 20_000
    seen = runner.invoke(app, [*words, "--occultation"])
    assert seen.exit_code == 0 and (where / "occultation.nc").is_file(), seen.output
    for more, sentence in (
        ([], "takes either --sun-zenith or --sun-elevation, or --occultation"),
        (["--sun-zenith", "60", "--sun-elevation", "30"], "takes either"),
        (["--occultation", "--azimuth", "20"], "--azimuth: is not for --occultation"),
        (["--occultation", "--solver", "montecarlo"], "--solver: is not for --occultation"),
        (["--occultation", "--quality", "draft"], "--quality: is not for --occultation"),
        (["--sun-zenith", "60", "--azimuth", "nan"], "--azimuth: nan is not allowed"),
        (["--sun-zenith", "60", "--field-of-view-shape", "gaussian"], "goes with --field-of-view-km"),
        (["--sun-zenith", "60", "--layers", "0,10"], "--layers: is for --air-mass alone"),
        (["--sun-zenith", "60", "--altitude-km", "60"], "above the air"),
        (["--sun-zenith", "60", "--tangent-km", "80:10:2"], "must go up by a step above 0"),
    ):
        bad = runner.invoke(app, [*words, *more])
        assert bad.exit_code == 2 and sentence in bad.stderr, bad.stderr
