"""The moon in films: its light in the air beside the field's own spectra, its disc, and how it sets."""

import numpy as np
import pytest
from airs import scene_of_field, turbid
from closed_sky import FIVE_NM as NM
from closed_sky import ClosedSky
from filming import paced

from twilight.config import load
from twilight.engine import solve
from twilight.io.exr import read_latlong_exr
from twilight.scene import resolve
from twilight.show.film import Animation
from twilight.show.lights import DiscPainter, MoonColours, sky_elevations
from twilight.show.tones import Channels
from twilight.sky.colour import REC709_LUMINANCE
from twilight.sky.moon import Moon

MEDIUM = turbid(wavelength_nm=NM)
SKY = ClosedSky(
    MEDIUM, lambda height_deg: 10.0 ** (min(height_deg, 8.0) / 4.0) * 0.01, lambda e, a: -2.0 + np.cos(e) * np.cos(a)
)
"""Brighter and redder towards the light, a factor of 10 darker for every 4 deg it falls."""


def film(path, settings, **options):
    view = {"kind": "perspective", "width": 48, "height": 32, "elevation_deg": 20.0, "field_of_view_deg": 70.0}
    config = load("pure-air", {"observer.view": view, **settings})
    pace, rest = paced(options)
    return Animation(config, path, pace, scene=scene_of_field(SKY), nodes=(17, 13), **rest)


def luminances(folder):
    return [read_latlong_exr(p).rgb @ REC709_LUMINANCE * 683.002 for p in sorted(folder.iterdir())]


def test_sunlit_channels_become_moonlit_ones():
    """One matrix for a whole sky, from noon to the last twilight, against the spectra in moonlight."""
    solved = solve(resolve(load("continental-average", {"solver.name": "compact"})), cached=False)
    channels = Channels(solved.medium.wavelength_nm)
    where = np.meshgrid([0.5, 3.0, 10.0, 30.0, 90.0], [0.0, 10.0, 60.0, 180.0], indexing="ij")
    spectra = np.concatenate(
        [solved.radiance(s, *where).reshape(20, -1) for s in (40.0, 5.0, 0.0, -3.0, -6.0, -12.0, -17.0)]
    )
    colours = MoonColours.of(spectra, channels)
    for phase in (2.0, 70.0, 97.0):
        moon = Moon(30.0, 0.0, phase)
        exact = channels.of(spectra * moon.irradiance_factor(channels.wavelength_nm))
        off = np.abs(colours.moonlit(channels.of(spectra), moon) / exact - 1.0)
        assert off.max() < 0.015 and off[:, 1].max() < 0.005
        assert (np.percentile(off, 95, axis=0) < [0.008, 0.002, 0.008, 0.005]).all()


def test_a_film_holds_the_light_of_both(tmp_path):
    """Pixels are the sun's sky and the moon's, each looked up in its own place; the moon's azimuth is from the sun."""
    moon = {"elevation_deg": 30.0, "azimuth_deg": 60.0, "phase_angle_deg": 20.0}
    made = film(tmp_path / "f", {"moon": moon, "observer.view.elevation_deg": 55.0, "observer.view.azimuth_deg": -60.0},
                from_deg=-20.0, to_deg=-30.0, speed=2400.0, frames_per_second=1.0)  # fmt: skip
    made.make()
    elevation, azimuth = made._directions(made.view)
    channels, field = Channels(NM), SKY
    factor = Moon(30.0, 60.0, 20.0).irradiance_factor(NM)
    assert factor[2] > 1.5 * 0.01 * 10.0**-5  # what is tested is moonlight
    for i, found in enumerate(luminances(tmp_path / "f")):
        sun = float(made.line.elevation_deg[i])
        exact = field.radiance(30.0, elevation, azimuth - 60.0) * factor
        if i == 0:
            exact = exact + field.radiance(sun, elevation, azimuth)
        assert found == pytest.approx(channels.of(exact)[..., 1], rel=0.012), i


def test_the_moon_sets_without_a_jump(tmp_path):
    """Munich after midnight, the sun far below the horizon: a half moon from 5 deg above it to 5 below."""
    night = {"sun.start": "2026-01-27T01:52+01:00", "sun.stop": "2026-01-27T03:04+01:00", "moon": {}}
    night |= {"sun.latitude_deg": 48.0, "sun.longitude_deg": 11.0}
    made = film(tmp_path / "f", night, speed=240.0, frames_per_second=1.0)
    made.make()
    height = np.array([moon.elevation_deg for moon in made.moons])
    assert height[0] > 4.5 and height[-1] < -4.0 and len(height) == 19
    level = np.log10([picture.mean() for picture in luminances(tmp_path / "f")])
    slope = np.diff(level) / np.diff(height)  # of this air: a factor of 10 for 4 deg
    assert np.abs(slope - 0.25).max() < 0.04


@pytest.mark.parametrize(("step", "phase"), [(0.01, 0.0), (0.01, 100.0), (0.2, 60.0), (0.8, 60.0)])
def test_the_disc_of_a_film_has_the_moons_light(step, phase):
    """Fine or coarse pixels: what the disc gives is the beam in moonlight; its lit side is towards the sun."""
    nodes = sky_elevations(0.0)
    beam = np.full((nodes.size, 4), 1000.0)
    painter = DiscPainter(0.0 * nodes, beam, 0.0, MoonColours(np.stack([np.eye(4)] * 4)))
    moon = Moon(20.0, 30.0, phase)
    e, a = np.meshgrid(
        np.arange(18.0 + 0.37 * step, 22.0, step), np.arange(28.0, 32.0, step / np.cos(np.radians(20.0))), indexing="ij"
    )
    light = painter.light(e, a, step, moon, -10.0)[..., 1] * np.cos(np.radians(e))
    cell = np.radians(step) ** 2 / np.cos(np.radians(20.0))
    expected = 1000.0 * moon.irradiance_factor(np.array([550.0]))[0]
    assert light.sum() * cell == pytest.approx(expected, rel=0.02 if step < 0.1 else 0.06)
    if phase == 100.0:
        below, left = (light * (e - 20.0)).sum() / light.sum(), (light * (a - 30.0)).sum() / light.sum()
        assert below < -0.03 and left < -0.03
