"""The shadow of the Earth: geometry, refraction by a closed form, almanacs, and the light of eclipses."""

from __future__ import annotations

import csv
import datetime as dt
from dataclasses import replace

import numpy as np
import pytest
from airs import pure_air
from scipy.special import kve
from typer.testing import CliRunner

import twilight
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.studies.eclipse import danjon
from twilight.studies.eclipse import shadow as shadow_module
from twilight.studies.eclipse.circumstances import find_eclipse
from twilight.studies.eclipse.light import magnitudes, satellite, shadow_light
from twilight.studies.eclipse.scattered import EDGES_KM, SinglyScatteredLight, above
from twilight.studies.eclipse.shadow import SUN_RADIUS_DEG, Shadow, without_air

MOON_KM = 384_400.0
SUN_RAD = float(np.radians(SUN_RADIUS_DEG))
WAVELENGTHS = [450.0, 550.0, 680.0]


@pytest.fixture(scope="module")
def clear():
    return Shadow(twilight.medium("pure-air", WAVELENGTHS))


def test_without_air_it_is_the_shadow_of_geometry(clear):
    """Dark in the umbra's cone, a half on the edge of a straight limb, all beyond the penumbra."""
    bare = Shadow(without_air(clear.medium))
    earth = np.arcsin(clear.medium.earth_radius_km / MOON_KM)
    light = bare.irradiance(
        np.array([0.0, earth - 1.01 * SUN_RAD, earth, earth + 1.01 * SUN_RAD, 3.0 * earth]), MOON_KM
    )
    assert np.all(light[:2] == 0.0)
    # the Earth's limb bulges into the sun's disc
    assert np.all((light[2] > 0.5) & (light[2] < 0.65))
    np.testing.assert_allclose(light[3:], 1.0, rtol=5e-4)


def test_refraction_spreads_light_as_the_closed_form_says(monkeypatch):
    """A small sun behind exponential, transparent air: light falls to 1 / (1 + L b / H) with L the distance from the
    limb, b the bending of a ray and H the scale height (Baum and Code 1953), times what the ring is wider than a
    straight limb."""
    monkeypatch.setattr(shadow_module, "LINES", 12_000)
    scale_km = 8.0
    levels = np.arange(0.0, 160.1, 1.0)
    medium = pure_air(levels, refractivity=3e-5, scale_km=scale_km, scattering=0.0, wavelengths=(550.0,))
    shadow = Shadow(medium)
    radius = medium.earth_radius_km
    distance = radius + 60_000.0
    small = 1.5e-5
    height = np.array([40.0, 60.0, 80.0])
    index = 3e-5 * np.exp(-height / scale_km)
    bending = index * np.sqrt(2.0 * np.pi * radius / scale_km)
    along = np.sqrt(distance**2 - (radius + height) ** 2)
    phi = 1.0 / (1.0 + along * bending / scale_km)
    # where the ray arrives whose lowest point is at the height
    offset = np.arcsin((radius + height) / distance) - bending
    light = shadow.irradiance(offset, distance, small)[:, 0]
    curved = (radius + height) / (distance * np.sin(offset))
    np.testing.assert_allclose(light, phi * curved, rtol=0.02)


def test_the_light_of_the_umbra(clear):
    """Red in the middle, blue by ozone at the edge; a thousandth to a millionth of sunlight; clouds take most of it."""
    earth = np.arcsin(clear.medium.earth_radius_km / MOON_KM)
    middle, rim = clear.irradiance(np.array([0.0, 0.62]) * earth, MOON_KM)
    assert middle[0] < 1e-2 * middle[1] < 1e-3 * middle[2]
    assert rim[0] > 0.6 * rim[1] and 1e-4 < rim[1] < 1e-3
    cloudy = Shadow(clear.medium, top_km=8.0).irradiance(np.zeros(1), MOON_KM)[0]
    assert np.all(cloudy < 0.6 * middle) and cloudy[2] < 0.1 * middle[2]
    with pytest.raises(TwilightError, match=r"cloud top is 500 km; allowed is 0 km \(the ground\) to"):
        Shadow(clear.medium, top_km=500.0)
    with pytest.raises(TwilightError, match="distance_km is 6400; allowed is more than"):
        clear.irradiance(np.zeros(1), 6400.0)


def test_thin_air_scatters_into_the_far_shadow_as_the_closed_form_says():
    """From far behind, all air outside a cylinder about the Earth is lit and seen: its volume integral of
    beta = b exp(-(r - R) / H) is 4 pi b R^2 H K2(R / H) exp(R / H)."""
    medium = pure_air(np.arange(0.0, 160.1, 1.0), refractivity=0.0, scattering=1e-9, wavelengths=(550.0,))
    radius, distance = medium.earth_radius_km, 1e9
    volume = 4.0 * np.pi * 1e-9 * radius**2 * 8.0 * kve(2, radius / 8.0)
    forward = 3.0 / (8.0 * np.pi)
    found = SinglyScatteredLight(medium, distance).irradiance(np.zeros(1))[0, 0]
    assert found * distance**2 == pytest.approx(volume * forward, rel=0.005)


def test_scattered_light_is_even_and_blue_and_clouds_take_some(clear):
    """In the middle more than refraction brings at 450 nm, by far less at 680; the same over the umbra within 5 %."""
    earth = np.arcsin(clear.medium.earth_radius_km / MOON_KM)
    offset = np.array([0.0, 0.62]) * earth
    middle, rim = SinglyScatteredLight(clear.medium, MOON_KM).irradiance(offset)
    refracted = clear.irradiance(offset, MOON_KM)
    assert middle[0] > refracted[0, 0] and middle[2] < 1e-3 * refracted[0, 2]
    assert np.all(middle < 1e-2 * refracted[1])
    np.testing.assert_allclose(rim, middle, rtol=0.05)
    cut = above(clear.medium, 8.0)
    assert cut.bottom_km == 8.0
    altitude = np.array([8.0, 8.3, 20.0])
    np.testing.assert_allclose(cut.at(altitude).extinction, clear.medium.at(altitude).extinction, rtol=1e-3)
    cloudy = SinglyScatteredLight(cut, MOON_KM).irradiance(np.zeros(1))[0]
    assert np.all((cloudy > 0.3 * middle) & (cloudy < middle))


@pytest.mark.slow
def test_zones_scatters_as_much_into_the_shadow():
    """Light of the first order of `zones`, over the same lines of sight, within 2 %; all orders add 3 to 12 %."""
    medium = twilight.medium("pure-air", [440.0, 560.0])
    offset_deg = 0.4
    expected = SinglyScatteredLight(medium, MOON_KM).irradiance(np.radians([offset_deg]))[0]
    edges = np.array([*EDGES_KM, medium.top_km])
    x, w = np.polynomial.legendre.leggauss(3)
    half = 0.5 * np.diff(edges)[:, None]
    invariant = medium.earth_radius_km + (edges[:-1, None] + half * (1.0 + x)).ravel()
    psi = np.arcsin(invariant / MOON_KM)
    weight = (half * w).ravel() * invariant / (MOON_KM**2 * np.cos(psi))
    elevation, azimuth = np.degrees(psi)[:, None] - 90.0, np.array([30.0, 90.0, 150.0])
    found = []
    for settings in ({"solver.max_orders": 1}, {}):
        field = twilight.solve("pure-air", wavelength_nm=[440.0, 560.0], quality="draft",
                               settings={"ground.albedo": 0.0, "solver.polarisation": False, **settings})  # fmt: skip
        seen = field.radiance(offset_deg - 90.0, elevation, azimuth, MOON_KM - medium.earth_radius_km)
        found.append(2.0 * np.pi * np.einsum("l,lw->w", weight, np.asarray(seen).mean(axis=1)))
    np.testing.assert_allclose(found[0], expected, rtol=0.02)
    assert np.all((found[1] > 1.03 * expected) & (found[1] < 1.12 * expected))


def test_danjon_s_number_of_the_moon_s_luminance():
    """The full moon is as bright as a disc of 13.5 % reflectance in 133,000 lx (Hernitschek et al. 2008), 15 %."""
    assert danjon.luminance(-12.73, MOON_KM) == pytest.approx(0.135 * 133_000.0 / np.pi, rel=0.15)
    assert [danjon.danjon_number(v) for v in (1e-9, 0.005, 5.0, 1e9)] == [0.0, 0.0, 4.0, 4.0]
    assert danjon.danjon_number(0.005 * np.sqrt(1000.0)) == pytest.approx(2.0)
    assert danjon.description(2.2) == "deep red"


ALMANAC = {
    "2018-07-27": (
        {"U1": "18:24:27", "U2": "19:30:15", "greatest": "20:21:44", "U3": "21:13:12", "U4": "22:19:00"},
        1.609,
    ),
    "2000-07-16": ({"U2": "13:02", "greatest": "13:55:35", "U3": "14:49"}, 1.768),
    "2020-06-05": ({"P1": "17:46", "greatest": "19:25", "P4": "21:04"}, -0.405),
}
"""Times (UT) and umbral magnitude of NASA's Five Millennium Catalog of Lunar Eclipses (Espenak and Meeus 2009) and its
pages of single eclipses."""


@pytest.mark.parametrize("date", ALMANAC)
def test_contacts_are_those_of_almanacs(date):
    contacts, magnitude = ALMANAC[date]
    found = find_eclipse(dt.date.fromisoformat(date))
    assert found.umbral_magnitude == pytest.approx(magnitude, abs=0.003)
    for name, text in contacts.items():
        wanted = dt.datetime.fromisoformat(f"{date}T{text}+00:00")
        tolerance = 15.0 if text.count(":") == 2 else 45.0
        assert abs((found.contacts[name] - wanted).total_seconds()) < tolerance, name
    assert ("U1" in found.contacts) == (magnitude > 0.0)


def test_a_date_without_an_eclipse_is_one_sentence():
    with pytest.raises(TwilightError, match="2018-07-10: there is no eclipse of the moon within a day"):
        find_eclipse(dt.date(2018, 7, 10))


def test_light_curves(clear):
    """Eleven magnitudes deep in clear air, as eclipses without volcanic dust are; symmetric to the minute."""
    event = find_eclipse(dt.date(2018, 7, 27))
    light = shadow_light(Shadow(clear.medium.select(slice(1, 2))), event)
    curve = magnitudes(light, event.moon)
    assert curve.min() == pytest.approx(-12.6, abs=0.25)
    assert -3.5 < curve.max() < -1.5
    middle = int(np.argmin(event.moon.offset_rad))
    assert abs(int(np.argmax(curve)) - middle) <= 2
    assert np.all(np.diff(light.visual) > -1e-6)


def test_a_satellite_enters_the_shadow(clear):
    """On the edge of the bare Earth air takes most of the half disc; later light comes by refraction, red last."""
    offset, light = satellite(clear, 550.0, np.array([-60.0, 0.0, 12.0, 25.0]))
    assert np.all(np.diff(offset) < 0.0)
    np.testing.assert_allclose(light[0], 1.0, rtol=1e-3)
    assert 0.01 < light[1, 1] < 0.2 and light[2, 2] > 10.0 * light[2, 0]
    _, dark = satellite(Shadow(without_air(clear.medium)), 550.0, np.array([12.0]))
    assert dark[0, 1] == 0.0 < light[2, 1]


def test_the_command(tmp_path):
    runner = CliRunner()
    where = str(tmp_path / "new")
    result = runner.invoke(app, ["eclipse", "pure-air", "--date", "2018-07-27", "--output", where])
    assert result.exit_code == 0, result.output
    assert "umbral magnitude 1.609" in result.output
    with open(tmp_path / "new" / "shadow.csv", newline="") as file:
        table = list(csv.DictReader(line for line in file if not line.startswith("#")))
    assert 0.0 < float(table[0]["scattered_440_nm"]) < float(table[0]["irradiance_440_nm"])
    assert "Danjon's number, estimated" in result.output and "brick-red" in result.output
    with open(tmp_path / "new" / "light-curve.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[len(rows) // 2]["visual_magnitude_pure-air"]) > -4.0
    assert (tmp_path / "new" / "eclipse.png").stat().st_size > 50_000
    flown = runner.invoke(app, ["eclipse", "pure-air", "--satellite-altitude-km", "550", "--output", where])
    assert flown.exit_code == 0 and (tmp_path / "new" / "satellite.csv").is_file()
    for words, sentence in (
        ([], "takes either --date or --satellite-altitude-km"),
        (["--date", "2018-07-xx"], "is not a date such as 2018-07-27"),
        (["--satellite-altitude-km", "50"], "must be from 200 to 400000"),
    ):
        bad = runner.invoke(app, ["eclipse", "pure-air", *words])
        assert bad.exit_code == 2 and sentence in bad.stderr, bad.stderr


def test_the_scale_height_of_the_light_follows_the_air(clear):
    """Half as much air lets more blue light into the middle."""
    thin = replace(clear.medium, grid_medium=None, air_scattering_per_km=0.5 * clear.medium.air_scattering_per_km)
    assert Shadow(thin).irradiance(np.zeros(1), MOON_KM)[0, 0] > 10.0 * clear.irradiance(np.zeros(1), MOON_KM)[0, 0]
