"""The moon on the page of `twilight view`: place, brightness, disc and moonlight beside numpy's."""

import datetime as dt

import numpy as np
import pytest
from browser import light_of, open_page
from closed_sky import ALL_SKY, COARSE, solved
from closed_sky import EIGHT_NM as NM

from twilight.numerics.directions import azimuth_elevation
from twilight.numerics.projections import view_directions
from twilight.show.skies import view_fields
from twilight.show.tones import Channels
from twilight.sky.ephemeris import Sites
from twilight.sky.moon import Moon, moon_over

BARE = {"disc": False, "night": False, "stars": False, "path": False, "moon": True}


@pytest.fixture(scope="module")
def field():
    """A factor of e darker a degree."""
    return solved(lambda height_deg: np.exp(min(height_deg, 0.0)))


@pytest.fixture(scope="module")
def page(field, tmp_path_factory):
    path = tmp_path_factory.mktemp("moon") / "one.html"
    with open_page(
        view_fields([field], nodes=COARSE, names=["closed"], scenes=["pure-air"]).save(path), 64, 64
    ) as opened:
        yield opened


def test_pixels_are_those_of_both(page, field):
    """Light under a sun far down and a moon is the sum of two lookups, the second in moonlight."""
    shown, errors = page
    elevation, azimuth = view_directions("fisheye", 64)
    keep = np.isfinite(elevation) & (elevation > 4.0)
    channels = Channels(NM)
    for height, away, low in ((40.0, 150.0, -17.9), (3.0, -60.0, -17.9), (-4.0, 20.0, -15.0)):
        state = {**BARE, **ALL_SKY, "sun": low, "moonElevation": height, "moonAzimuth": away}
        found = light_of(shown, state)[::-1][keep]
        made = shown.evaluate("twilight.theMoon()")
        moon = Moon(height, away, made["phase"])
        assert made["elevation"] == pytest.approx(height) and made["level"] == pytest.approx(
            moon.irradiance_factor(np.array([550.0]))[0], rel=0.01
        )
        exact = field.radiance(low, elevation[keep], azimuth[keep])
        lit = field.radiance(height, elevation[keep], azimuth[keep] - away) * moon.irradiance_factor(NM)
        off = found / channels.of(exact + lit) - 1.0
        apart = np.abs(elevation[keep] - height) > 4.0  # from the moon's own disc, which is drawn too
        assert np.percentile(np.abs(off[apart]), 95) < 0.015
    spectrum = shown.evaluate("twilight.at(60, 100)")
    exact = field.radiance(-15.0, 60.0, spectrum["azimuth"])
    lit = field.radiance(-4.0, 60.0, spectrum["azimuth"] - 20.0) * moon.irradiance_factor(NM)
    assert spectrum["spectrum"] == pytest.approx((exact + lit) * channels.solar_irradiance, rel=0.05)
    assert errors == []


@pytest.mark.parametrize(("fov", "size"), [(4.0, 160), (40.0, 160)])
def test_the_disc_has_the_moons_light(page, field, fov, size):
    """What the disc adds to the picture is the direct irradiance; its lit side is the one towards the sun."""
    shown, errors = page
    shown.set_viewport_size({"width": size, "height": size})
    view = {"projection": "perspective", "fov": fov, "elevation": 30.0, "azimuth": 100.0}
    state = {**BARE, **view, "sun": -17.0, "moonElevation": 30.0, "moonAzimuth": 100.0}
    with_disc = light_of(shown, state).astype(float)
    moon = Moon(30.0, 100.0, shown.evaluate("twilight.theMoon()")["phase"])
    place = (np.arange(size) + 0.5) / size * 2.0 - 1.0
    flat = np.tan(np.radians(fov) / 2.0)
    x, y = np.meshgrid(place * flat, place * flat)
    solid = (2.0 * flat / size) ** 2 / (1.0 + x**2 + y**2) ** 1.5
    away = np.degrees(np.hypot(x, y))
    ring = (away > 1.0) & (away < 2.5)  # of even sky
    light = np.where(away < 1.0, with_disc[..., 1] - with_disc[ring][:, 1].mean(), 0.0)
    beam = field.direct(30.0).irradiance * moon.irradiance_factor(NM)
    assert (light * solid).sum() == pytest.approx(Channels(NM).of(beam)[1], rel=0.03)
    if fov < 10:
        assert (light * x).sum() < 0.0 and (light * y).sum() < 0.0  # the sun is 100 deg to the left, and down
    shown.set_viewport_size({"width": 64, "height": 64})
    assert errors == []


def test_the_moons_place_is_that_of_twilight(page):
    """Meeus' larger terms beside ERFA's moon98, topocentric, from 1955 to 2095; phase, distance and waxing."""
    shown, _ = page
    for when, latitude, longitude in (("1955-03-07T21:10", 48.0, 11.0), ("2026-05-23T19:00", -33.0, 151.0),
                                      ("2041-12-01T03:30", 65.0, -20.0), ("2095-08-15T12:00", 0.0, 100.0)):  # fmt: skip
        moment = dt.datetime.fromisoformat(when).replace(tzinfo=dt.UTC)
        state = {"mode": "clock", "date": when[:10], "hours": moment.hour + moment.minute / 60.0, "zone": 0}
        shown.evaluate("s => twilight.set(s)", {**BARE, **state, "latitude": latitude, "longitude": longitude})
        found = shown.evaluate("twilight.theMoon()")
        place = Sites([moment], latitude, longitude).moon()
        azimuth, elevation = azimuth_elevation(np.array(found["direction"]))
        turn = (azimuth - place.azimuth_deg[0] + 180.0) % 360.0 - 180.0
        exact = moon_over(moment, latitude, longitude, 0.0)
        assert elevation == pytest.approx(exact.elevation_deg, abs=0.02)
        assert abs(turn) * np.cos(np.radians(exact.elevation_deg)) < 0.02
        assert found["phase"] == pytest.approx(exact.phase_angle_deg, abs=0.03)
        assert found["distance"] == pytest.approx(exact.distance_km, rel=3e-4)
        assert found["waxing"] is exact.waxing
        assert found["radius"] == pytest.approx(np.radians(exact.radius_deg), rel=1e-3)
    assert "moon" in shown.inner_text("#status")
    command = shown.evaluate("twilight.command()")
    assert "--set moon={}" in command and "2095-08-15" in command
