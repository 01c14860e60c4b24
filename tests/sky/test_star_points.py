"""The brighter stars as points: where they stand, what of their light arrives, and that pictures keep it."""

from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest
from airs import turbid
from filming import film, scene
from scipy.spatial import cKDTree

from twilight.config import load_climate
from twilight.config.pictures import View
from twilight.engine.view import ViewOfLights, ViewRadiance
from twilight.numerics.directions import azimuth_elevation, direction
from twilight.numerics.projections import PROJECTIONS
from twilight.scene.medium import climate_medium
from twilight.sky.moments import Moments, Place
from twilight.sky.night import NightLevels
from twilight.sky.night.glows import glow_table, glows_of
from twilight.sky.night.points import (
    Raster,
    StarPoints,
    StarSky,
    bright_stars,
    irradiance_above_air,
    precession,
    resolved_starlight_fraction,
    temperature_k,
    with_points,
)
from twilight.sky.table import SkyTable

NM = np.array([440.0, 550.0, 680.0])
PLACE = Place(47.0, 11.0, datetime.fromisoformat("2026-08-12T23:40+02:00"))


def solid_angles(rays: np.ndarray) -> np.ndarray:
    """Of pixels (H, W) by the products of differences of their directions; the edges have their neighbours'."""
    down, across = np.gradient(rays, axis=0), np.gradient(rays, axis=1)
    return np.linalg.norm(np.cross(down, across), axis=-1)


@pytest.mark.parametrize("kind", sorted(PROJECTIONS))
def test_every_projection_keeps_a_stars_light_and_place(kind):
    """A star would be brighter where pixels are small."""
    more = {"perspective": {"elevation_deg": 30.0}, "limb": {"band_deg": (0.0, 40.0)}}
    view = View(kind=kind, width=240, **more.get(kind, {}))
    rays = view.rays((0, view.shape[0])).astype(float)
    raster, area = Raster(rays, 1.0), solid_angles(rays)
    height, width = view.shape
    random = np.random.default_rng(3)
    seen = 0
    for _ in range(400):
        row, column = random.integers(12, height - 12), random.integers(12, width - 12)
        around = rays[row - 8 : row + 9, column - 8 : column + 9]
        step = np.linalg.norm(np.diff(around, axis=1), axis=-1)
        if not np.isfinite(around).all() or step.max() > 1.5 * step.min() or step.max() < 1e-4:
            continue  # outside, on an edge of a cube, or so near a pole that differences are no solid angles
        seen += 1
        towards = around[8, 8] + random.uniform(-0.5, 0.5) * (around[8, 9] - around[8, 8])
        towards /= np.linalg.norm(towards)
        picture = np.zeros((height, width, 1))
        raster.add(picture, towards[None], np.array([[3.0]]))
        light = picture[..., 0] * area
        assert np.nansum(light) == pytest.approx(3.0, rel=0.02)
        middle = np.nansum(light[..., None] * rays, axis=(0, 1)) / np.nansum(light)
        assert np.linalg.norm(middle / np.linalg.norm(middle) - towards) < 0.1 * step.max()
    assert seen > 20


def test_rows_drawn_apart_are_those_of_the_whole():
    """A picture drawn by rows would have seams."""
    view = View(kind="perspective", width=120, elevation_deg=30.0)
    rays = view.rays((0, view.shape[0])).astype(float)
    towards = direction(np.linspace(-20.0, 20.0, 60), 30.0 + 12.0 * np.sin(np.arange(60.0)))
    light = np.ones((60, 1))
    whole = np.zeros((*view.shape, 1))
    Raster(rays, 1.0).add(whole, towards, light)
    parts = np.zeros_like(whole)
    for first in range(0, view.shape[0], 16):
        rows = slice(first, first + 16)
        Raster(rays[rows], 1.0).add(parts[rows], towards, light)
    assert whole.max() > 0.0
    np.testing.assert_allclose(parts, whole, atol=0.02 * whole.max())


def test_a_hill_hides_stars():
    """Stars would shine through mountains."""
    rays = View(kind="perspective", width=60).rays((0, 30)).astype(float)
    hidden = np.zeros((30, 60), bool)
    hidden[:, :30] = True
    picture = np.zeros((30, 60, 1))
    raster = Raster(rays, 1.0)
    raster.add(picture, rays[15, [15, 45]], np.ones((2, 1)), hidden)
    assert (picture[:, :30] == 0.0).all() and picture[:, 30:].max() > 0.0


@pytest.fixture(scope="module")
def air():
    return climate_medium(load_climate("pure-air"), NM)


def test_stars_stand_where_astropy_has_them(air):
    """Stars would stand beside their places."""
    pytest.importorskip("astropy")
    from twilight.studies.validate.stars import coordinates

    sky = StarSky.of(air, 0.0)
    points = sky.over(PLACE)
    found = direction(points.azimuth_deg, points.elevation_deg)
    exact = coordinates.horizontal(coordinates.StarSite(47.0, 11.0), PLACE.time, 1013.25, 15.0)
    exact = exact.take((exact.hip > 0) & (exact.directions[:, 2] > np.sin(np.radians(10.0))))
    off = [np.linalg.norm(found - one, axis=-1).min() for one in exact.directions[:300]]
    # aberration, nutation and the mean sidereal time: 40 arcsec together
    assert np.degrees(max(off)) < 0.015
    np.testing.assert_allclose(precession(0.0), np.eye(3), atol=1e-15)


def test_light_of_the_stars():
    """Vega's at 550 nm, the colours of three stars, extinction by the air, and the fraction of all starlight."""
    assert irradiance_above_air(np.array([0.0]), np.array([0.0]), np.array([550.0]))[0, 0] == pytest.approx(3.631e-11)
    np.testing.assert_allclose(temperature_k(np.array([0.0, 0.65, 1.85])), [10100, 5800, 3300], rtol=0.03)
    blue, red = irradiance_above_air(np.zeros(2), np.array([-0.2, 1.8]), NM)
    assert blue[0] > 2.0 * blue[2] and red[2] > 2.0 * red[0]
    medium = turbid(3.0, wavelength_nm=NM)
    points = StarSky.of(medium, 0.0).over(PLACE)
    stars = bright_stars(2026.6)
    vega = int(np.flatnonzero(stars.names == "Vega")[0])
    high = np.argmax(points.irradiance[:, 1] * (points.elevation_deg > 60.0))
    z = np.linspace(0.0, medium.top_km, 20001)
    depth = np.trapezoid(medium.at(z).extinction[:, 1], z) / np.sin(np.radians(points.elevation_deg[high]))
    expected = 3.631e-11 * 10.0 ** (-0.4 * stars.magnitude[vega]) * np.exp(-depth)
    assert points.irradiance[high, 1] == pytest.approx(expected, rel=0.01)
    assert 0.1 < resolved_starlight_fraction() < 0.3


NIGHT = {"night.airglow": 0.0, "night.zodiacal_light": 0.0, "night.starlight": 1.0}
HERE = {"sun.latitude_deg": 47.0, "sun.longitude_deg": 11.0}


def test_a_view_has_the_stars_before_the_glow_of_the_others(air):
    """A dark sky as a view sees it by rows: the sum of the points in it, each in its own colour."""
    view = View(kind="fisheye", width=240, elevation_deg=90.0)
    glows, moment = glows_of(NightLevels(0.0, 1.0, 0.0), air, 0.0), Moments.of_sun(-24.0, 333.0, PLACE)
    rest, sky = with_points(glows)
    points = sky.over(PLACE)
    whole, glow = (glow_table(some, moment, air, 0.0) for some in (rest, glows))
    np.testing.assert_allclose(whole.smooth, (1.0 - resolved_starlight_fraction()) * glow.smooth, rtol=1e-6)
    stars = StarPoints(points.azimuth_deg - 333.0, points.elevation_deg, points.irradiance)
    e, a = np.array([-1.0, 90.0]), np.array([0.0, 180.0])
    dark = SkyTable(np.zeros(1), np.zeros(1), e, a, np.zeros((1, 2, 2, 3), np.float32), logarithmic=False)
    look = ViewOfLights(((ViewRadiance(view, dark, 0.75), 1.0),), ViewRadiance(view, whole, 0.75), stars)
    rays = view.rays((0, view.shape[0])).astype(float)
    area = solid_angles(rays)
    azimuth, elevation = azimuth_elevation(rays)
    smooth = whole.light(np.nan_to_num(elevation), np.nan_to_num(azimuth))
    for rows in (slice(0, 240), slice(60, 150)):
        seen = look.rows(rows.start, rows.stop)
        light = np.nansum((seen.radiance - smooth[rows]) * area[rows][..., None], axis=(0, 1))
        towards = direction(points.azimuth_deg - 333.0, points.elevation_deg)
        place = cKDTree(np.nan_to_num(rays).reshape(-1, 3)).query(towards)[1] // 240
        there = (points.elevation_deg > 1.0) & (place >= rows.start) & (place < rows.stop)
        np.testing.assert_allclose(light, points.irradiance[there].sum(axis=0), rtol=0.05)


def test_stars_move_through_a_film(tmp_path):
    """A frame with points less the fainter glow: the light of the stars in it, Vega where it stands."""
    from twilight.io.exr import read_latlong_exr

    span = {"sun.start": "2026-08-12T21:30+02:00", "sun.stop": "2026-08-12T22:00+02:00", **HERE}
    look = {"observer.view.kind": "fisheye", "observer.view.width": 200, "observer.view.height": 200}
    look |= {"observer.view.elevation_deg": 90.0}
    times = {"from_deg": None, "to_deg": None, "speed": 1800.0}
    made = {}
    for stars in ("dark", True, False):
        folder = tmp_path / str(stars)
        night = {} if stars == "dark" else {**NIGHT, "night.stars": stars}
        one = film(folder, scene(**span, **look, **night), **times)
        one.make()
        made[stars] = [read_latlong_exr(f).rgb @ [0.2126, 0.7152, 0.0722] * 683.0 for f in sorted(folder.iterdir())]
    elevation, azimuth = one._directions(one.view)
    rays = direction(azimuth, elevation)
    area = solid_angles(rays)
    places = []
    begin = datetime.fromisoformat("2026-08-12T21:30+02:00")
    for i, (points, smooth, dark) in enumerate(zip(made[True], made[False], made["dark"], strict=True)):
        light = np.where(elevation > 1.0, points - smooth + resolved_starlight_fraction() * (smooth - dark), 0.0)
        when = replace(PLACE, time=begin + timedelta(seconds=1800.0 * i))
        stars = StarSky.of(one.scene.medium, 0.0).over(when)
        up = stars.elevation_deg > 1.0
        # a star of V = 0 is 3.631e-11 W m^-2 nm^-1 at 550 nm and 2.54e-6 lx (Allen)
        green = np.interp(550.0, one.scene.medium.wavelength_nm, stars.irradiance[up].sum(axis=0))
        lux = 2.54e-6 / 3.631e-11 * green
        assert np.nansum(light * area) == pytest.approx(lux, rel=0.1)
        brightest = np.argmax(stars.irradiance.sum(axis=-1))
        towards = direction(stars.azimuth_deg[brightest], stars.elevation_deg[brightest])
        near = np.nan_to_num(light * area * (np.linalg.norm(rays - towards, axis=-1) < np.radians(4.0)))
        middle = np.nansum(near[..., None] * rays, axis=(0, 1)) / near.sum()
        assert np.degrees(np.linalg.norm(middle / np.linalg.norm(middle) - towards)) < 0.3
        places.append(azimuth_elevation(towards))
    assert np.ptp([float(a) for a, _ in places]) > 1.0
