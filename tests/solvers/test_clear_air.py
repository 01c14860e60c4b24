"""The model of all clear air: its closed forms beside quadrature, its skies beside `zones`, what it refuses."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import twilight
from twilight import clear_air, solvers
from twilight.base.conventions import EARTH_RADIUS_KM
from twilight.base.errors import TwilightError
from twilight.clear_air import Skies, lanes, skies
from twilight.clear_air.diffuse import LEAST_PART, _positive, diffuse_light
from twilight.clear_air.entry import SHIPPED, load_model
from twilight.clear_air.model import AZIMUTH_DEG, ELEVATION_DEG, splines
from twilight.clear_air.of_medium import air_of, side_by_side, slope
from twilight.clear_air.rays import (
    BELOW,
    DIFFUSE,
    LAYERS,
    RAYS,
    SUNLIT,
    at_fine_zeniths,
    into_azimuths,
    rays,
    segments,
    turned,
)
from twilight.clear_air.shells import ALTITUDE_KM, DARK, Shells, sublayers
from twilight.clear_air.sky import azimuth_splines
from twilight.config import load
from twilight.config.load import load_climate
from twilight.engine import solve
from twilight.scene import resolve
from twilight.scene.medium import climate_medium
from twilight.show.sliders import model_text
from twilight.solvers.zones.air_needs import degree_needed
from twilight.solvers.zones.settings import QUALITIES

WAVELENGTH_NM = [380.0, 450.0, 550.0, 650.0]
SUNS_DEG = (50.0, 10.0, 0.0, -4.0, -8.0, -14.0)
DRAFT_ERROR = 0.03
"""Of the skies of `zones` that the model is compared with."""
E = np.array([0.5, 10.0, 45.0, 89.0])
A = np.array([0.0, 35.0, 120.0, 180.0])


def scene(solver="compact", climate="urban", **settings):
    document = {"version": 1, "climate": climate, "wavelengths": {"list_nm": WAVELENGTH_NM}, "solver": {"name": solver}}
    document["horizon"] = "clean"
    return load(document, {key.replace("__", "."): value for key, value in settings.items()})


@functools.lru_cache(maxsize=2)
def solved(solver, climate, quality="draft", **settings):
    """By the model, or by `zones` at a quality."""
    more = {"solver__quality": quality} if solver == "zones" else {}
    return solve(resolve(scene(solver, climate, **settings, **more)))


@pytest.fixture(scope="module")
def urban():
    return solve(resolve(scene()))


def exponential_shells(depth=1e-6, refractivity=0.0):
    """Shells of air of a scale height of 8 km and a vertical optical depth of scattering alone."""
    per_km = -np.diff(np.exp(-ALTITUDE_KM / 8.0))[:, None] * depth / np.diff(ALTITUDE_KM)[:, None]
    n = refractivity * np.exp(-sublayers(ALTITUDE_KM) / 8.0)
    return Shells(ALTITUDE_KM, per_km, per_km[None], np.zeros_like(per_km), n)


@pytest.mark.parametrize("elevation", [90.0, 30.0, 5.0, 0.0])
def test_a_line_of_sight_through_thin_air_has_its_column(elevation):
    """Ways through layers would not add up to the column of exponential air along a straight line."""
    shells = exponential_shells()
    (found,) = shells.scattered_once(90.0, np.array([elevation]), np.array([0.0])).ravel()
    way = np.linspace(0.0, 2500.0, 200001)
    height = np.sqrt(EARTH_RADIUS_KM**2 + way**2 + 2 * EARTH_RADIUS_KM * way * np.sin(np.radians(elevation)))
    density = np.exp(-(height - EARTH_RADIUS_KM) / 8.0) / 8.0 * 1e-6
    within = height - EARTH_RADIUS_KM < ALTITUDE_KM[-1]
    assert found == pytest.approx(np.trapezoid(density * within, way), rel=0.004)


def test_light_scattered_once_in_absorbing_air_beside_quadrature():
    """Transmittance of the beam or of the line of sight would be wrong: the sun 20 deg up, no refraction."""
    depth = 0.5
    shells = exponential_shells(depth=depth)
    elevation = 40.0
    (found,) = shells.scattered_once(20.0, np.array([elevation]), np.array([60.0])).ravel()

    def column(radius, cosine):
        way = np.linspace(0.0, 900.0, 9001)
        height = np.sqrt(radius**2 + way**2 + 2 * radius * way * cosine) - EARTH_RADIUS_KM
        return np.trapezoid(np.exp(-height / 8.0) / 8.0 * depth, way)

    sun = np.array([np.cos(np.radians(20.0)), 0.0, np.sin(np.radians(20.0))])
    e, a = np.radians(elevation), np.radians(60.0)
    line = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    way = np.linspace(0.0, 140.0, 701)
    point = np.array([0.0, 0.0, EARTH_RADIUS_KM]) + way[:, None] * line
    radius = np.linalg.norm(point, axis=1)
    scattering = np.exp(-(radius - EARTH_RADIUS_KM) / 8.0) / 8.0 * depth
    beam = np.array([column(r, p @ sun / r) for r, p in zip(radius, point, strict=True)])
    passed = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(way) * (scattering[1:] + scattering[:-1]))])
    exact = np.trapezoid(scattering * np.exp(-beam - passed), way)
    assert found == pytest.approx(exact, rel=0.003)


@pytest.mark.parametrize("k", [0, 10, 25, 40])
def test_the_refracted_beam_carries_the_flux_of_its_sphere(k):
    """Spreading of the beam would lose or make light: through a sphere of radius r it carries F0 pi (n r)^2."""
    shells = exponential_shells(depth=0.0, refractivity=2.8e-4)
    zenith = np.linspace(0.0, np.radians(95.0), 20001)
    beam = np.exp(shells.log_sunbeam(k, zenith)[0][:, 0])
    beams = shells.beams
    some = slice(*beams.start[k : k + 2])
    down = np.maximum(np.cos(np.interp(zenith, beams.zenith_rad[some], beams.apparent_rad[some])), 0.0)
    n = 1.0 + 2.8e-4 * np.exp(-ALTITUDE_KM[k] / 8.0)
    assert 2.0 * np.trapezoid(beam * down * np.sin(zenith), zenith) == pytest.approx(n**2, rel=1e-3)


def test_the_sun_is_lifted_as_by_the_sunbeam_of_other_solvers(urban):
    """The aureole would stand beside the sun."""
    seen = urban.blocks[0].field.air._seen_from(0.0)
    for sun in (0.0, 2.0, 20.0):
        assert seen.shells.apparent_elevation_deg(sun) - sun == pytest.approx(urban.direct(sun).bending_deg, abs=0.02)


@pytest.mark.parametrize("grid", [SUNLIT, DIFFUSE])
def test_rays_between_scatterings_see_all_directions_and_end_on_the_ground_below_its_horizon(grid):
    """Weights of rays would not be a mean over the sphere, a way be negative, or a ray pass through the Earth."""
    ray, layer, length, _, cosine, weight = segments(grid).T
    below = len(grid.boundary_km) - 1
    first = np.flatnonzero(np.diff(ray, prepend=-1))
    start, last = ray[first] // RAYS, np.append(first[1:], ray.size) - 1
    for k in range(LAYERS):
        some, ground = start == k, k == LAYERS - 1
        assert weight[first][some].sum() == pytest.approx(1.0, abs=1e-9)
        assert (weight * cosine)[first][some].sum() == pytest.approx(2 / 3 if ground else 0.0, abs=1e-9)
        hits = np.arange(RAYS) < (0 if ground else BELOW)
        np.testing.assert_array_equal(layer[last][some] == below, hits)
    assert length.min() >= 0.0 and length[layer < below].min() > 0.0


@pytest.mark.parametrize("grid", [SUNLIT, DIFFUSE])
def test_even_light_stays_even_when_it_is_scattered(grid):
    """Few azimuths would make or lose light: waves of phase functions that they cannot have would look like others."""
    weights = np.einsum("bam,lmord->lboard", into_azimuths(grid), turned())
    assert weights[..., 0].sum(axis=(3, 4)) == pytest.approx(1.0, abs=1e-6)
    forward = (2.0 * np.arange(weights.shape[-1]) + 1.0) * 0.6 ** np.arange(weights.shape[-1])
    assert (weights @ forward).sum(axis=(3, 4)) == pytest.approx(1.0, abs=0.1)
    means = rays(grid).moments[:, 0].sum(axis=1)
    assert means == pytest.approx(1.0, abs=1e-6)
    assert at_fine_zeniths().min() >= 0.0


def test_behind_peaks_that_let_nothing_pass_light_is_a_number():
    made = Skies(None, air_of(solve(resolve(scene(climate="desert"))).medium), 0.0)
    made._passed_peaks = made._passed_peaks + np.float32(2000.0)
    assert np.isfinite(made.single_scattering(5.0)).all()


def test_what_further_moments_take_off_is_taken_off_in_full():
    """Light towards the sides of haze would be up to a quarter too bright, or below nothing."""
    first, further = np.full(5, 2.0), 2.0 * np.array([0.7, 0.0, -0.5, -0.89, -3.0])
    sums = _positive(first, further)
    np.testing.assert_allclose(sums[:4], (first + further)[:4], rtol=1e-12)
    assert 0.0 < sums[4] < 0.01 * LEAST_PART


def test_light_scattered_once_under_a_thick_layer_aloft_beside_zones():
    """Layers as thick as a volcano's cloud is steep would make its light 5 to 10 % too dark; no fit mends that."""
    medium = climate_medium(load_climate("volcanic-extreme"), np.array([550.0, 850.0]))
    settings = replace(QUALITIES["draft"], max_orders=1, beam_density=2.0)
    exact = solvers.zones.prepare(medium, settings, observer_altitude_km=medium.bottom_km)
    degree = np.full(medium.n_wavelengths, float(degree_needed(settings, medium)))
    mine = Skies(None, air_of(medium)._replace(degree=degree), 0.0)
    e, a = np.meshgrid(ELEVATION_DEG[6:], AZIMUTH_DEG, indexing="ij")
    for sun in (5.0, 0.0, -2.0, -4.0, -6.0, -9.0):
        once = exact.stokes(sun, e, a, observer_altitude_km=medium.bottom_km)[:, :, 0]
        lit = once > 1e-3 * once.max(axis=(0, 1))
        off = mine.single_scattering(sun)[6:, :, 0][lit] / once[lit] - 1.0
        assert abs(np.median(off)) < 0.025, (sun, np.median(off))
        assert np.percentile(np.abs(off), 95) < 0.04, (sun, np.percentile(np.abs(off), 95))


@pytest.mark.parametrize(
    ("climate", "quality"), [("urban", "draft"), pytest.param("desert", "standard", marks=pytest.mark.slow)]
)
def test_all_but_the_network_is_already_near_zones(climate, quality):
    """The network would have to mend what closed forms and few rays get wrong, or peaks would count twice."""
    field, exact = (solved(solver, climate, quality).blocks[0].field for solver in ("compact", "zones"))
    seen = field.air._seen_from(0.0)
    rows, columns = np.meshgrid(ELEVATION_DEG, AZIMUTH_DEG, indexing="ij")
    for sun in (30.0, -4.0):
        light = seen.base(np.array([sun]))[0] + seen.single_scattering(sun)[:, :, 0]
        off = np.abs(light / exact.radiance(sun, rows, columns) - 1.0)
        assert np.percentile(off, 95) < 0.055, (sun, np.percentile(off, 95))
        assert np.percentile(off[0], 95) < 0.065, (sun, np.percentile(off[0], 95))  # along the horizon


@pytest.mark.parametrize(
    ("climate", "settings"),
    [
        ("urban", {}),
        pytest.param("desert", {"climate__ground__albedo": 0.4}, marks=pytest.mark.slow),
        pytest.param("pure-air", {"climate__gases__ozone__column_du": 250.0}, marks=pytest.mark.slow),
        pytest.param("maritime-clean", {"observer__altitude_km": 9.0}, marks=pytest.mark.slow),
        pytest.param("volcanic-stratosphere", {}, marks=pytest.mark.slow),
        pytest.param("continental-clean", {"horizon": "typical"}, marks=pytest.mark.slow),
    ],
)
def test_its_skies_are_as_near_to_zones_as_it_says(climate, settings):
    """The model would be worse than it says, in radiance or polarisation, in air that the fit has not seen as such."""
    model, exact = (solved(solver, climate, "draft", **settings) for solver in ("compact", "zones"))
    e, a = np.meshgrid(np.linspace(1.0, 89.0, 9), np.linspace(0.0, 180.0, 9), indexing="ij")
    for sun in SUNS_DEG:
        mine, theirs = model.stokes(sun, e, a), exact.stokes(sun, e, a)
        estimated = model.blocks[0].field.convergence.error
        assert np.percentile(np.abs(mine[..., 0, :] / theirs[..., 0, :] - 1.0), 95) < 1.5 * estimated + DRAFT_ERROR, sun
        degree = [np.hypot(one[..., 1, :], one[..., 2, :]) / one[..., 0, :] for one in (mine, theirs)]
        assert np.percentile(np.abs(degree[0] - degree[1]), 95) < 0.03, sun


def test_a_screen_beyond_the_horizon_takes_red_light_of_dusk_and_none_of_a_sun_above_3_deg(urban):
    """`horizon: typical` would be ignored, grey, or move the day; how much it takes is beside `zones` above."""
    screened = solve(resolve(scene(horizon="typical")))
    for sun, spared in ((3.0, True), (-4.0, False)):
        blue, _, _, red = np.log(urban.radiance(sun, E, A) / screened.radiance(sun, E, A)).T
        assert (np.array([blue, red]) == 0.0).all() if spared else (red > 0.1).all() and (np.abs(blue) < 0.01).all()


def test_a_grid_gives_what_its_directions_give_and_the_sky_is_its_own_mirror_image(urban):
    """The fast path for grids would give another sky, or U the same sign on both sides of the sun."""
    field = urban.blocks[0].field
    e, a = np.meshgrid(E, A, indexing="ij")
    for sun in (30.0, -4.0):
        grid = field.stokes(sun, e, a)
        assert grid.reshape(-1, *grid.shape[2:]) == pytest.approx(field.stokes(sun, e.ravel(), a.ravel()), rel=1e-9)
        assert field.radiance(sun, e, a) == pytest.approx(grid[..., 0, :], rel=1e-12)
        other = field.stokes(sun, e, -a)
        sign = np.array([1.0, 1.0, -1.0])[:, None]
        inside = (a > 0.0) & (a < 180.0)
        assert other[inside] == pytest.approx((grid * sign)[inside], rel=1e-9)
        assert np.abs(grid[~inside][:, 2] / grid[~inside][:, 0]).max() < 0.01


@pytest.mark.parametrize("climate", ["pure-air", "maritime-tropical"])
@pytest.mark.parametrize("sun", [4.0, -2.0, -9.0])
def test_light_between_elevations_and_azimuths_is_that_of_closer_ones(monkeypatch, climate, sun):
    """The edge of the Earth's shadow would ring through the sky of twilight."""
    field = solve(resolve(scene(climate=climate))).blocks[0].field
    e, a = np.random.default_rng(1).uniform([[0.2], [0.0]], [[60.0], [180.0]], (2, 400))
    near = field.radiance(sun, e, a)
    for name in ("FINER_ELEVATION_DEG", "FINER_AZIMUTH_DEG"):
        closer = {key: skies._halved(nodes, 180.0) for key, nodes in getattr(skies, name).items()}
        monkeypatch.setattr(skies, name, closer)
    field.air._skies.clear()
    off = np.abs(near / field.radiance(sun, e, a) - 1.0)
    assert np.percentile(off, 95) < 0.005 and off.max() < 0.03


def test_splines_meet_their_nodes():
    """Interpolation over the sky would not go through what was computed."""
    even, odd = azimuth_splines(AZIMUTH_DEG, AZIMUTH_DEG)
    assert even == pytest.approx(np.eye(AZIMUTH_DEG.size), abs=1e-9)
    assert odd[1:-1] == pytest.approx(np.eye(AZIMUTH_DEG.size)[1:-1], abs=1e-9)


def test_airs_side_by_side_are_each_as_alone(urban):
    """A batch would mix its airs, or one of fewer aerosols get another's."""
    model = load_model(SHIPPED)
    mediums = [urban.medium, solve(resolve(scene(climate="pure-air"))).medium]
    first, second = (air_of(medium) for medium in mediums)
    alone = [first, second._replace(refractivity=first.refractivity, radius_km=first.radius_km)]
    both = Skies(model, side_by_side(alone)).sky(-4.0).light(E, A, 3)
    for n, air in enumerate(alone):
        some = slice(4 * n, 4 * n + 4)
        assert both[..., some] == pytest.approx(Skies(model, air).sky(-4.0).light(E, A, 3), rel=1e-4, abs=1e-9)


def test_kernels_give_the_diffuse_light_of_numpy(urban):
    """Of more than eight wavelengths light would be another one: all moments, of two airs and of no aerosol, and where
    the number of wavelengths fills no whole block."""
    bare = solve(resolve(scene(climate="pure-air", wavelengths__list_nm=[*np.linspace(330.0, 990.0, 11)])))
    first = air_of(urban.medium)
    hazy = side_by_side([first, first._replace(depth=3.0 * first.depth, aerosol_depth=3.0 * first.aerosol_depth)])
    for air, some in ((air_of(bare.medium), slice(None)), (hazy, slice(2, 7))):
        shells = Skies(None, air).shells
        light, expected = lanes.diffuse_light(air, shells), diffuse_light(air, shells)
        assert light.shape == expected.shape
        scale = np.abs(expected).max(axis=2, keepdims=True) + DARK
        np.testing.assert_allclose((light / scale)[:, some], (expected / scale)[:, some], rtol=0.0, atol=1e-5)


def test_derivatives_are_those_of_differences():
    """A fit would walk the wrong way: by optical depth, ozone and ground, in twilight."""
    keys = {
        "climate__aerosol__optical_depth_550nm": (0.2, 0.01),
        "climate__gases__ozone__column_du": (300.0, 5.0),
        "climate__ground__albedo": (0.3, 0.01),
    }

    def solved(**changes):
        values = {key: value for key, (value, _) in keys.items()} | changes
        return solve(resolve(scene(climate="maritime-clean", **values))).blocks[0].field

    field, e, a = solved(), np.array([5.0, 30.0, 80.0]), np.array([20.0, 100.0, 0.0])
    either = [[solved(**{key: value + sign * step}) for sign in (-1, 1)] for key, (value, step) in keys.items()]
    steps = [2.0 * step for _, step in keys.values()]
    directions = [slope(low.medium, high.medium, step) for (low, high), step in zip(either, steps, strict=True)]
    found = field.air.slopes(directions, -4.0, e, a, field.medium.bottom_km)[:, :, 0]
    light = field.radiance(-4.0, e, a)
    for (low, high), step, one in zip(either, steps, found, strict=True):
        difference = high.radiance(-4.0, e, a) - low.radiance(-4.0, e, a)
        assert one * step / light == pytest.approx(difference / light, rel=0.01, abs=2e-5)


def test_its_folder_alone_gives_the_same_light_by_numpy_alone(tmp_path):
    """Whoever copies the folder and the file would need the program too."""
    air = air_of(solve(resolve(scene())).medium)
    np.savez(tmp_path / "air.npz", **air._asdict())
    shutil.copytree(Path(clear_air.__file__).parent, tmp_path / "clear_air")
    shutil.copy(SHIPPED, tmp_path)
    script = """
import sys, numpy
from clear_air import Air, Model, Skies
skies = Skies(Model.load("clear-air.npz"), Air(**numpy.load("air.npz")), observer_km=0.5)
numpy.save("light.npy", skies.sky(-4.0).light(numpy.array([2.0, 40.0]), numpy.array([0.0, 90.0]), 3))
print(*sorted({name.split(".")[0] for name in sys.modules} - set(sys.stdlib_module_names)))
"""
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert not {"twilight", "scipy", "numba"} & set(done.stdout.split())
    light = Skies(load_model(SHIPPED), air, 0.5).sky(-4.0).light(np.array([2.0, 40.0]), np.array([0.0, 90.0]), 3)
    np.testing.assert_allclose(np.load(tmp_path / "light.npy"), light, rtol=1e-6)


@pytest.mark.parametrize("n", [4, 5, 9])
def test_the_spline_between_nodes_is_not_a_knot(n):
    """The model would interpolate by another spline than the one that it was fitted with."""
    nodes = np.cumsum(np.random.default_rng(n).uniform(0.5, 2.0, n))
    values = np.random.default_rng(0).normal(size=n)
    x = np.linspace(nodes[0], nodes[-1], 40)
    got = splines(nodes, x) @ values
    expected = CubicSpline(nodes, values)(x)
    assert got == pytest.approx(expected, abs=1e-9)


@pytest.mark.slow
def test_light_changes_smoothly_with_the_sun_the_air_and_the_observer():
    """A kink would be a jump in films or fits (at 2 km, where this haze ends, light along the horizon jumps)."""
    field = solve(resolve(scene())).blocks[0].field
    e, a = np.meshgrid(E, A, indexing="ij")
    suns = np.arange(-6.0, 3.0, 0.05)
    light = np.log([field.radiance(sun, e, a) for sun in suns])
    assert np.abs(np.diff(light, 2, axis=0)).max() < 0.03
    depths = np.linspace(0.4, 0.42, 9)
    by_air = [solve(resolve(scene(climate__aerosol__optical_depth_550nm=d))).radiance(-4.0, e, a) for d in depths]
    assert np.abs(np.diff(np.log(by_air), 2, axis=0)).max() < 3e-3
    by_height = [field.radiance(-4.0, e, a, observer_altitude_km=z) for z in np.linspace(4.9, 5.1, 9)]
    assert np.abs(np.diff(np.log(by_height), 2, axis=0)).max() < 0.02


REFUSED = [
    ({"climate": "overcast-stratus"}, "air without clouds, and this has stratus cloud"),
    ({"climate": "noctilucent"}, "air without clouds, and this has noctilucent cloud"),
    ({"climate": "bruneton2008", "wavelengths__list_nm": [450.0, 550.0]}, "air of 95 to 100.5 km, and this has 60"),
    ({"climate__atmosphere__top_km": 85.0}, "air of 95 to 100.5 km, and this has 85"),
    ({"climate__aerosol__optical_depth_550nm": 4.0}, "the optical depth of aerosol is 0 to"),
    ({"climate__ground__altitude_km": 5.5, "observer__altitude_km": 5.5}, "the compact model of clear air"),
    ({"observer__altitude_km": 20.0}, r"observer\.altitude_km is 20, allowed is 0 to 15"),
    ({"wavelengths__list_nm": [300.0, 550.0]}, "wavelengths from 320 to 1000 nm, and 300 nm is asked for"),
]


@pytest.mark.parametrize(("keys", "words"), REFUSED, ids=[" ".join(map(str, keys.items())) for keys, _ in REFUSED])
def test_what_it_was_not_fitted_for_is_one_sentence(keys, words):
    """The model would answer for air that it was not fitted to."""
    with pytest.raises(TwilightError, match=words) as caught:
        solve(resolve(scene(**{"climate": "urban", **keys})))
    assert "\n" not in str(caught.value)


def test_suns_and_directions_that_it_has_not(urban):
    """It would extrapolate below its suns or below the horizon."""
    with pytest.raises(TwilightError, match=r"sun\.elevation_deg is -19; the compact solver allows -18 to 90"):
        urban.radiance(-19.0, [10.0], [0.0])
    with pytest.raises(TwilightError, match="above the horizon only"):
        urban.radiance(5.0, [-1.0], [0.0])
    unpolarised = solve(resolve(scene(solver__polarisation=False))).blocks[0].field
    assert not unpolarised.polarised
    with pytest.raises(TwilightError, match="this field has no Stokes parameters"):
        unpolarised.stokes(5.0, 10.0, 0.0)


def test_its_file_is_small_and_a_damaged_one_is_one_sentence(tmp_path):
    """The wheel would grow, or a broken file end in a traceback."""
    assert SHIPPED.stat().st_size < 12e6
    model = load_model(SHIPPED)
    (tmp_path / "half.npz").write_bytes(SHIPPED.read_bytes()[:100000])
    with pytest.raises(TwilightError, match=r"half\.npz: is not a model of clear air"):
        load_model(tmp_path / "half.npz")
    np.savez(tmp_path / "other.npz", format="another")
    with pytest.raises(TwilightError, match="of this version"):
        load_model(tmp_path / "other.npz")
    air = np.full((2, model.input_mean.size - model.base_vectors.shape[0]), 0.1)
    base = np.full((2, model.base_mean.size), -9.0)
    assert replace(model, members=model.members[:1]).at_nodes(air, base)[3].max() == 0.0


def test_a_sky_says_how_wrong_it_is_and_bands_of_gases_have_a_sky(coarse_draft):
    """The error would not reach the record, or the model stop at 720 nm where water vapour absorbs."""
    sky = twilight.render("desert", sun_elevation_deg=-6, solver="compact", wavelength_nm=[550.0, 720.0, 760.0])
    assert 0.002 < sky.provenance["convergence"]["error"] < 0.3
    assert sky.normalised_radiance.min() > 0.0
    exact = twilight.render("desert", sun_elevation_deg=-6, quality="draft", wavelength_nm=[550.0, 720.0, 760.0])
    off = np.abs(sky.normalised_radiance / exact.sample(sky.elevation_deg[:, None], sky.azimuth_deg) - 1.0)
    assert np.median(off, axis=(0, 1)).max() < 0.08


def test_the_disc_is_lit_and_lifted_as_in_its_air(urban):
    """Its sky would have a sun that its air neither dims nor lifts."""
    solved = urban
    noon, set_ = solved.direct(90.0), solved.direct(-1.0)
    depth = solved.medium.optical_depth()
    assert noon.irradiance == pytest.approx(np.exp(-depth), rel=1e-3)
    assert not set_.irradiance.any()
    assert 0.4 < solved.direct(0.0).bending_deg < 0.7


def test_nothing_is_compiled_for_a_picture(tmp_path):
    """The command, in a process whose folder of machine code is empty."""
    cache = tmp_path / "machine-code"
    done = subprocess.run(
        [sys.executable, "-m", "twilight", "render", "continental-average", "--sun-elevation", "3",
         "--solver", "compact", "--output", str(tmp_path / "sky")],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(Path(solvers.__file__).parents[2])},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "compiles" not in done.stderr
    assert (tmp_path / "sky" / "sky.png").stat().st_size > 10_000
    assert not list(cache.rglob("*.nb[ci]"))


PIXELS = {
    "continental-average": (0.215857, 0.00929699, 0.00154637, 0.000125282, 4.21535e-07, 1.71555e-08),
    "desert": (0.201649, 0.0115027, 0.00142214, 0.000143377, 3.62163e-07, 2.38344e-08),
    "volcanic-stratosphere": (0.18913, 0.00875053, 0.0014296, 5.69319e-05, 5.73202e-07, 9.87999e-09),
}
"""Radiance of model 1 at 550 nm under suns of 20, -3 and -11 deg in two directions [sr^-1]."""


@pytest.mark.parametrize("climate", PIXELS)
def test_what_moves_a_pixel_raises_the_number_of_the_model(climate):
    """Files of one number would hold other skies: raise `NUMBER`, here and in clear_air.js, and renew PIXELS."""
    field = solve(resolve(scene(climate=climate)))
    found = np.array([field.radiance(sun, [8.0, 70.0], [20.0, 150.0])[:, 2] for sun in (20.0, -3.0, -11.0)])
    assert clear_air.model.NUMBER == 1 and "MODEL_NUMBER = 1;" in model_text()
    assert found.ravel() == pytest.approx(np.array(PIXELS[climate]), rel=2e-4)
    assert field.blocks[0].field.facts == {"clear_air_model": 1}
