"""Pictures from any place: their pixels against the function itself, the sun's disc, configurations."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from airs import pure_air, scene_of_field

from twilight.config.pictures import View
from twilight.config.scene import Observer
from twilight.engine import solve
from twilight.engine.sunbeam import make_disc
from twilight.engine.view import ViewOfLights, ViewRadiance, view_radiance, with_disc
from twilight.io.rendered import ViewPixels
from twilight.numerics.directions import azimuth_elevation
from twilight.numerics.projections import view_rays
from twilight.sky.disc import SOLAR_RADIUS_DEG
from twilight.sky.lights import Sun
from twilight.sky.table import SkyTable
from twilight.solvers.base import BareField

AIR = pure_air(np.linspace(0.0, 60.0, 31), refractivity=0.0, wavelengths=(450.0, 650.0))
"""Air whose rays are straight, so that the horizon is where geometry has it."""


@dataclass
class ClosedView(BareField):
    """Light that falls by e in 8 deg from the horizon and away from the sun's azimuth, and jumps there in the red."""

    medium: Any

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg, *, observer_altitude_km=0.0):
        elevation, azimuth = np.broadcast_arrays(elevation_deg, azimuth_deg)
        dip = np.degrees(np.arccos(6371.0 / (6371.0 + observer_altitude_km)))
        value = np.exp(-np.abs(elevation + dip) / 8.0 + 1.5 * np.cos(np.radians(azimuth)))
        return np.stack([value, np.where(elevation < -dip, 0.2, 1.0) * value], axis=-1)


def field_at(altitude_km):
    """The field as the engine's, with an observer."""
    made = scene_of_field(ClosedView(AIR))
    return solve(replace(made, observer=Observer(altitude_km=altitude_km)), cached=False)


@pytest.mark.parametrize(
    ("altitude", "view"),
    [
        (400.0, {"kind": "perspective", "width": 160, "height": 90, "elevation_deg": -20.0, "roll_deg": 20.0}),
        (11.0, {"kind": "perspective", "width": 160, "height": 90, "azimuth_deg": 100.0}),
        (35786.0, {"kind": "perspective", "width": 100, "height": 100, "field_of_view_deg": 20.0,
                   "elevation_deg": -90.0}),
        (400.0, {"kind": "latlong", "width": 128}),
        (400.0, {"kind": "limb", "width": 60, "height": 40, "band_deg": [-21.0, -17.0]}),
    ],
)  # fmt: skip
def test_a_view_shows_what_is_there(altitude, view):
    """Pixels would be off the function that they show."""
    solved = field_at(altitude)
    made = View.model_validate(view)
    seen = view_radiance(solved, made, Sun(-19.0)).whole()
    assert seen.radiance.shape == (*made.shape, 2)
    azimuth, elevation = azimuth_elevation(made.rays())
    exact = solved.radiance(-19.0, elevation, azimuth, altitude)
    inside = np.isfinite(seen.radiance[..., 0])
    assert inside.all()
    off = np.abs(seen.radiance / exact - 1.0)
    # the light bends and jumps at the horizon: within two pixels of it
    dip = np.degrees(np.arccos(6371.0 / (6371.0 + altitude)))
    away = np.abs(elevation + dip) > 2.0 * seen.pitch_deg
    assert off[away].max() < 0.01


def test_rows_are_half_a_pixel_apart_where_light_needs_them_and_no_nearer():
    """Light has a kink 0.5 deg above the horizon that no break knows of: rows go down to half a pixel there."""

    @dataclass
    class Kinked(ClosedView):
        def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg, *, observer_altitude_km=0.0):
            known = super().radiance(0.0, elevation_deg, azimuth_deg, observer_altitude_km=observer_altitude_km)
            return known * np.exp(-5.0 * np.abs(np.asarray(elevation_deg) - 0.5))[..., None]

    view = View.model_validate({"kind": "perspective", "width": 600, "height": 200, "field_of_view_deg": 24.0})
    made = view_radiance(solve(scene_of_field(Kinked(AIR)), cached=False), view, Sun(10.0))
    assert made.pitch_deg == pytest.approx(0.04, rel=0.03)
    rows = made.table.elevation_deg
    step = np.diff(rows)
    near = np.abs(0.5 * (rows[1:] + rows[:-1]) - 0.5) < 0.02
    assert near.any() and step[near].max() < 0.06 and step[step > 0.0].min() > 0.009
    assert rows.size < 140


BENDING = pure_air(np.linspace(0.0, 60.0, 31), wavelengths=(450.0, 650.0))


@pytest.mark.parametrize("sun", [10.0, -0.75])
def test_the_disc_of_a_view_is_the_suns_own(sun):
    """The sun in a view would have other light, shine through land, or stand round before the ground as it sets."""
    disc = make_disc(BENDING, Sun(sun), 0.0)
    lower, upper = disc.edges_deg()
    rays = view_rays("perspective", 200, 200, field_of_view_deg=1.0, elevation_deg=0.5 * (lower + upper))
    black = ViewPixels("perspective", rays, np.zeros((200, 200, BENDING.n_wavelengths), np.float32), 0.005)
    seen = with_disc(black, disc, 0.0, 1.0)
    light = seen.radiance.sum(axis=(0, 1)) * np.radians(1.0 / 200) ** 2
    assert light == pytest.approx(disc.irradiance_factor(), rel=0.01)
    rows, columns = np.nonzero(seen.sun)
    assert np.ptp(rows) / np.ptp(columns) == pytest.approx(
        (upper - lower) / (2.0 * disc.half_width_deg().max()), rel=0.05
    )
    assert (upper - lower) < 0.9 * 2.0 * SOLAR_RADIUS_DEG or sun > 5.0
    hidden = replace(black, hidden=np.ones((200, 200), bool))
    assert not with_disc(hidden, disc, 0.0, 1.0).radiance.any() and not with_disc(hidden, disc, 0.0, 1.0).sun.any()
    night = with_disc(black, make_disc(BENDING, Sun(-20.0), 0.0), 0.0, 1.0)
    assert not night.radiance.any() and not night.sun.any()


def test_the_night_of_a_view_is_behind_the_sky_and_on_the_ground():
    """The night would shine through land, or not light it."""
    elevation, azimuth = np.append([-90.0, -2.0], np.linspace(-2.0, 90.0, 40)), np.arange(0.0, 360.0, 5.0)
    shape = 1.0 + np.sin(np.radians(elevation))[:, None] + 0.1 * np.cos(np.radians(azimuth - 70.0))
    light = np.stack([shape, 2.0 * shape], axis=-1)
    light[:2] = [0.3, 0.4]  # of the ground
    table = SkyTable(np.zeros(1), np.zeros(1), elevation, azimuth, light[None], mirrored=False, logarithmic=False)
    solved, view = field_at(0.0), View.model_validate({"kind": "latlong", "width": 64})
    plain = view_radiance(solved, view, Sun(10.0))
    glow = ViewRadiance(view, table, plain.pitch_deg)
    off = ViewOfLights(((plain, 1.0),), glow).whole().radiance - plain.whole().radiance
    a, e = azimuth_elevation(view.rays())
    exact = 1.0 + np.sin(np.radians(e)) + 0.1 * np.cos(np.radians(a - 70.0))
    up = e > -2.0
    assert off[up] == pytest.approx(np.stack([exact, 2.0 * exact], axis=-1)[up], rel=3e-3)
    assert off[~up] == pytest.approx(np.broadcast_to([0.3, 0.4], off[~up].shape), rel=1e-4)
    hidden = replace(plain.whole(), hidden=np.ones(view.shape, bool))
    lit = ViewOfLights(((hidden, 1.0),), glow).whole().radiance - hidden.radiance
    assert lit == pytest.approx(np.broadcast_to([0.3, 0.4], lit.shape), rel=1e-4)


@pytest.mark.slow
def test_pixels_of_a_climate_are_its_field():
    """A picture is within 0.2 % of the field at 95 % of the pixels; those on the horizon are left out."""
    import twilight

    solved = twilight.solve("continental-average", quality="draft")
    for sun, view in (
        (6.0, {"kind": "perspective", "width": 64, "height": 36, "elevation_deg": 10.0}),
        (0.5, {"kind": "perspective", "width": 64, "height": 36, "elevation_deg": 10.0, "azimuth_deg": 150.0}),
        (-5.0, {"kind": "fisheye", "width": 64}),
    ):
        made = View.model_validate(view)
        seen = view_radiance(solved, made, Sun(sun)).whole()
        azimuth, elevation = azimuth_elevation(made.rays())
        inside = np.isfinite(elevation)
        inside[inside] = np.abs(elevation[inside]) > seen.pitch_deg
        exact = solved.radiance(sun, elevation[inside], azimuth[inside])
        off = np.percentile(np.abs(seen.radiance[inside] / exact - 1.0), 95)
        print(f"{made.kind}, sun {sun:g}: {100 * off:.3f} %", flush=True)
        assert off < 0.002
