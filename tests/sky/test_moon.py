"""The moon: place, brightness, disc, and the sky that it lights."""

import datetime as dt
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.shipped_data import data_numbers
from twilight.config import load
from twilight.engine import frames, solve
from twilight.engine.sunbeam import make_disc
from twilight.io.environment import environment_directions, ground_factor, pixel_solid_angle
from twilight.io.exr import read_latlong_exr, write_rgb_exr
from twilight.io.folder import write_outputs
from twilight.io.lamps import moon_facts
from twilight.numerics import spectrum
from twilight.scene.lights import warn_of_the_moon
from twilight.scene.scene import resolve
from twilight.sky import colour
from twilight.sky.ephemeris import Sites
from twilight.sky.moon import (
    Moon,
    MoonDisc,
    allen_mag,
    band_reflectance,
    disc_integral,
    disc_reflectance,
    moon_illuminance_lux,
    moon_over,
    surface,
)

coarse = pytest.mark.usefixtures("coarse_draft")

SMALL = {
    "wavelengths.list_nm": [430.0, 490.0, 550.0, 610.0, 670.0],
    "texture": {"resolution_deg": 15.0},
    "solver.quality": "draft",
}


def scene(sun, moon, **more):
    return resolve(load("pure-air", {**SMALL, "sun": sun, "moon": moon, **more}))


def test_table_is_the_published_one():
    """A slip of a digit in the shipped table; rows of a second transcription of Table 4, and its 32 bands."""
    names, table = data_numbers("moon/rolo_kieffer_stone_2005.csv")
    assert table.shape == (32, 11)
    assert names == ("wavelength_nm", "a0", "a1", "a2", "a3", "b1", "b2", "b3", "d1", "d2", "d3")
    by_nm = {row[0]: row[1:] for row in table}
    assert by_nm[553.8].tolist() == [-2.12504, -1.6597, 0.38409, -0.20655, 0.04052, 0.01009, -0.00388, 0.37206,
                                     -0.10745, 0.00347]  # fmt: skip
    assert by_nm[942.1].tolist() == [-1.66473, -1.61875, 0.1463, -0.09216, 0.04533, 0.0301, -0.01166, 0.57275,
                                     -0.38204, 0.04902]  # fmt: skip
    # sums of the columns of that transcription
    sums = [-60.14262, -51.90062, 11.9679, -6.5176, 1.3592, 0.42874, -0.16492, 12.78409, -5.69422, 0.21463]
    assert_allclose(table[:, 1:].sum(axis=0), sums, atol=1e-9)


@pytest.mark.parametrize(("phase", "lux"), [(1.6, 0.371), (7.0, 0.275), (30.0, 0.152), (60.0, 0.074), (90.0, 0.031)])
def test_illuminance_above_the_air(phase, lux):
    """Brightness and phase curve, of the waxing moon, to 2 %: figures of ROLO at the mean distances."""
    assert moon_illuminance_lux(Moon(40.0, 0.0, phase, waxing=True)) == pytest.approx(lux, rel=0.02)


def test_opposition_surge_and_waxing():
    """Full moons would lack the surge (Allen: 15 %), quarters differ (Russell 1916), or bands move by 10 %."""
    surge = moon_illuminance_lux(Moon(40, 0, 1.55)) / moon_illuminance_lux(Moon(40, 0, 7.0))
    assert 1.25 < surge < 1.45 and 10.0 ** (0.4 * (allen_mag(7.0) - allen_mag(1.55))) < 1.16
    half = [moon_illuminance_lux(Moon(40, 0, 90.0, waxing=w)) for w in (True, False)]
    assert 1.05 < half[0] / half[1] < 1.25
    nm = np.linspace(380.0, 720.0, 20)
    near, far = Moon(40, 0, 30.0, 384400.0, 1.0), Moon(40, 0, 30.0, 384400.0 * 1.1, 0.98)
    assert_allclose(far.irradiance_factor(nm), near.irradiance_factor(nm) / 1.1**2 / 0.98**2)
    for phase in (2.0, 30.0, 90.0):
        nm, bands = band_reflectance(phase)
        ratio = disc_reflectance(nm, phase) / bands
        assert np.std(np.log(ratio)) < 0.045 and np.abs(ratio - 1.0).max() < 0.10
        assert (np.diff(disc_reflectance(np.arange(300.0, 1001.0, 10.0), phase)) > 0.0).all()  # the moon is reddish


def test_phase_is_continued_without_a_jump():
    """Beyond 97 deg the level goes on, and the slope with it: the model's own there is Allen's to 2 %."""
    nm = np.array([550.0])
    assert_allclose(disc_reflectance(nm, 97.0001), disc_reflectance(nm, 97.0), rtol=1e-5)
    slope = -2.5 * np.log10(disc_reflectance(nm, 97.0) / disc_reflectance(nm, 95.0))[0] / 2.0
    assert slope == pytest.approx((allen_mag(97.0) - allen_mag(95.0)) / 2.0, rel=0.02)
    assert_allclose(disc_reflectance(nm, 0.0), disc_reflectance(nm, 1.55))
    with pytest.raises(TwilightError, match="from 0 to 180 deg"):
        disc_reflectance(nm, 181.0)


def test_meeus_example():
    """Meeus 1998, example 47.a: 1992 April 12, 0 h TD: 134.688470, +13.768368 deg (apparent), 368409.7 km."""
    import erfa

    found = erfa.moon98(2448724.5, 0.0)["p"]
    x, y, z = erfa.pnm06a(2448724.5, 0.0) @ found
    assert np.degrees(np.arctan2(y, x)) == pytest.approx(134.688470, abs=10.0 / 3600.0)
    assert np.degrees(np.arctan2(z, np.hypot(x, y))) == pytest.approx(13.768368, abs=10.0 / 3600.0)
    assert np.linalg.norm(found) * 1.495978707e8 == pytest.approx(368409.7, abs=5.0)


def test_total_eclipse_of_2024():
    """Dallas, 8 April 2024, 18:42 UTC: the sun is totally eclipsed, so the moon covers it (NASA's circumstances)."""
    site = Sites([dt.datetime(2024, 4, 8, 18, 42, 40, tzinfo=dt.UTC)], 32.7767, -96.7970)
    moon, sun = site.moon(), site.sun()
    apart = np.degrees(np.arccos(np.clip((moon.towards * sun.towards).sum(), -1, 1)))
    assert apart < 0.012
    assert 0.27 < Moon(0, 0, 180.0, float(moon.distance_au[0] * 1.495978707e8)).radius_deg < 0.285


def test_places_are_those_of_astropy():
    """Sun and moon over a place: astropy's get_body with its built-in ephemeris, to 4 arcsec."""
    coordinates = pytest.importorskip("astropy.coordinates")
    from astropy import units
    from astropy.time import Time
    from astropy.utils import iers

    moment = dt.datetime(2025, 9, 20, 3, 0, tzinfo=dt.UTC)
    site = Sites([moment], 48.0, 11.0, 0.5)
    level = iers.IERS({"MJD": [0.0, 1e5] * units.d, "UT1_UTC": [0.0, 0.0] * units.s,
                       "PM_x": [0.0, 0.0] * units.arcsec, "PM_y": [0.0, 0.0] * units.arcsec})  # fmt: skip
    with iers.conf.set_temp("auto_download", False), iers.earth_orientation_table.set(level):
        where = coordinates.EarthLocation(lat=48.0 * units.deg, lon=11.0 * units.deg, height=0.5 * units.km)
        time = Time(moment.replace(tzinfo=None), scale="utc")
        local = coordinates.AltAz(obstime=time, location=where, pressure=0.0 * units.hPa)
        for name, ours in (("moon", site.moon()), ("sun", site.sun())):
            theirs = coordinates.get_body(name, time, where, ephemeris="builtin").transform_to(local)
            assert ours.elevation_deg[0] == pytest.approx(theirs.alt.deg, abs=4.0 / 3600.0)
            assert ours.azimuth_deg[0] == pytest.approx(theirs.az.deg, abs=8.0 / 3600.0)


def test_moon_over_a_place():
    """Waxing and lit as the almanac has it: first quarter on 2026-05-23, 11:11 UTC; full moon on 2026-05-31, 8:45."""
    quarter = moon_over(dt.datetime(2026, 5, 23, 11, 11, tzinfo=dt.UTC), 0.0, 90.0, 0.0)
    assert quarter.waxing and quarter.illuminated_fraction == pytest.approx(0.5, abs=0.02)
    full = moon_over(dt.datetime(2026, 5, 31, 8, 45, tzinfo=dt.UTC), 0.0, -170.0, 0.0)
    assert full.illuminated_fraction > 0.995
    assert not moon_over(dt.datetime(2026, 6, 8, tzinfo=dt.UTC), 0.0, 0.0, 0.0).waxing
    with pytest.raises(TwilightError, match="outside the years"):
        moon_over(dt.datetime(500, 1, 1, tzinfo=dt.UTC), 0.0, 0.0, 0.0)


@pytest.mark.parametrize("phase", [0.0, 40.0, 90.0, 150.0, 165.0])
def test_surface_integrates_to_the_closed_form(phase):
    """The disc's light is its irradiance: the integral of Lommel and Seeliger's law, by a fine grid."""
    n = 1200
    x, y = np.meshgrid(*(2 * [(np.arange(n) + 0.5) / n * 2.0 - 1.0]))
    whole = surface(x, y, (0.6, 0.8), phase).sum() * (2.0 / n) ** 2
    assert whole == pytest.approx(disc_integral(phase), rel=6e-3)
    assert disc_integral(0.0) == pytest.approx(np.pi / 2)  # a full moon is evenly bright


def test_disc_holds_the_light_and_points_to_the_sun():
    """Seen from above the air the disc's radiance sums to the irradiance, and the lit limb is towards the sun."""
    medium = scene({"elevation_deg": -10.0}, {"elevation_deg": 20.0}).medium
    moon = Moon(60.0, 10.0, 120.0)
    disc = MoonDisc.of(make_disc(medium, moon, 0.0), moon, -10.0)
    low, high = disc.edges_deg()
    e, a = np.linspace(low - 0.01, high + 0.01, 260), np.linspace(-0.6, 0.6, 260)
    light = disc.radiance(e[:, None], a[None, :])
    cell = np.radians(e[1] - e[0]) * np.radians(a[1] - a[0]) * np.cos(np.radians(e))[:, None, None]
    through = disc.transmittance.mean(axis=0)
    assert_allclose((light * cell).sum(axis=(0, 1)), moon.irradiance_factor(disc.wavelength_nm) * through, rtol=5e-3)
    weight = light[..., 1] / light[..., 1].sum()
    below = (weight * e[:, None]).sum() - 0.5 * (low + high)
    left = (weight * a[None, :]).sum() * np.cos(np.radians(60.0))
    assert below < -0.05 and left < -0.02  # the sun is below it and to the left
    assert disc.bright_limb_deg == pytest.approx(np.degrees(np.arctan2(left, below)) % 360.0, abs=3.0)


def test_moonlit_sky_is_the_suns_looked_up_again():
    """The moon's sky is the sun's for its own place, times its irradiance over the sun's."""
    made = scene({"elevation_deg": -30.0}, {"elevation_deg": 40.0, "azimuth_deg": 150.0, "phase_angle_deg": 20.0})
    sky = next(iter(frames(made, cached=False))).sky
    assert sky.sun_normalised_radiance.max() < 1e-13 < 1e-10 < sky.normalised_radiance.min()
    e, a = np.meshgrid(sky.elevation_deg, sky.azimuth_deg, indexing="ij")
    alone = solve(made, cached=False).radiance(40.0, e, np.mod(a - 150.0, 360.0))
    moonlight = sky.moon.moon.irradiance_factor(sky.wavelength_nm) * spectrum.solar_irradiance(sky.wavelength_nm)
    assert_allclose(sky.night_radiance, alone * moonlight, rtol=2e-3)
    depth = 0.0973 + 0.030  # at 550 nm of air (Bodhaine et al. 1999) and of 334 DU of ozone (3.3e-21 cm^2)
    beam = moonlight[2] * np.exp(-depth / np.sin(np.radians(40.0)))
    assert sky.moon.direct_irradiance[2] == pytest.approx(beam, rel=0.01)
    assert 17.5 < sky.magnitude() < 20.5


@coarse
def test_moon_of_a_view_stands_where_it_is():
    """In a picture the moon's disc is at its azimuth from the sun, right of it for a larger one, with its own light."""
    view = {"kind": "perspective", "width": 60, "height": 40, "field_of_view_deg": 12.0, "azimuth_deg": 100.0,
            "elevation_deg": 30.0}  # fmt: skip
    made = scene({"elevation_deg": -25.0}, {"elevation_deg": 31.0, "azimuth_deg": 102.0}, **{"observer.view": view})
    frame = next(iter(frames(made, cached=False)))
    seen = frame.view.rows(0, 40)
    row, column = np.unravel_index(np.nanargmax(seen.radiance[..., 1]), seen.shape)
    assert 36 < column < 42 and 12 < row < 19
    covered = seen.sun > 0.0
    assert covered[row, column] and 4 <= covered.sum() <= 25
    disc = np.where(covered[..., None], seen.radiance, 0.0).sum(axis=(0, 1)) * np.radians(seen.pitch_deg) ** 2
    beam = frame.sky.moon.direct_irradiance / frame.sky.solar_irradiance
    assert_allclose(disc, beam, rtol=0.12)  # pixels' solid angles differ by some per cent over the picture


@coarse
def test_moon_below_the_horizon(tmp_path):
    """It lights nothing, the render says so, and moon.json too."""
    made = scene({"elevation_deg": -30.0}, {"elevation_deg": -25.0}, **{"night": {}})
    with pytest.warns(TwilightWarning, match=r"moon stands at -25\.0 deg, below the horizon"):
        sky = next(iter(frames(made, cached=False))).sky
    assert sky.moon.disc is None and not sky.moon.direct_irradiance.any()
    [path] = write_outputs(sky, tmp_path, files=["moon"])
    facts = json.loads(path.read_text())
    assert facts["above_horizon"] is False and facts["illuminance_lux"] == 0.0
    assert facts["illuminance_above_the_air_lux"] > 0.0


def test_eclipses_are_not_computed():
    """A moon in the Earth's shadow is told."""
    made = scene({"elevation_deg": -30.0}, {"elevation_deg": 29.9})
    lights = made.lights(made.suns[0])
    assert lights.moon.phase_angle_deg < 1.55
    with pytest.warns(TwilightWarning, match="eclipses are not computed"):
        warn_of_the_moon(made.configuration, lights)


@coarse
def test_zenith_of_moonlit_nights():
    """A dark site's zenith under the moon within 0.2 mag.

    Seven years at Cosmic Campground, 1634 m, the clear quarter (Dark Sky Network, soazcomms.github.io), its moonless
    21.92 added; benchmarks/results/moonlight.csv has all of them.
    """
    settings = {"ground.altitude_km": 1.634, "gases.ozone.column_du": 285.0, "solver.quality": "draft"}
    solved = solve(resolve(load("continental-average", settings)), cached=False)
    nm = solved.medium.wavelength_nm
    visible = spectrum.colour_matching_functions("cie1931_2deg")[:, 1] * spectrum.solar_at_visible()
    for phase, altitude, measured in (
        (15.0, 10.0, 19.61), (15.0, 20.0, 19.15), (15.0, 30.0, 18.71), (25.0, 20.0, 19.41), (37.5, 10.0, 20.17),
        (37.5, 30.0, 19.26), (52.5, 20.0, 20.01), (52.5, 30.0, 19.69), (67.5, 10.0, 20.75), (67.5, 30.0, 20.02),
        (82.5, 20.0, 20.69), (82.5, 30.0, 20.43),
    ):  # fmt: skip
        factor = solved.radiance(altitude, [90.0], [0.0])[0] * Moon(altitude, 180.0, phase).irradiance_factor(nm)
        luminance = spectrum.LUMINOUS_EFFICACY_LM_PER_W * float(spectrum.integrate(factor, nm, visible))
        zenith = -2.5 * np.log10(luminance / 10.8e4 + 10.0 ** (-0.4 * 21.92))
        assert zenith == pytest.approx(measured, abs=0.2), (phase, altitude)


@pytest.mark.slow
def test_moonlit_terrain_is_sunlit_terrain_in_its_place():
    """Mountains under the moon: the picture with the sun in its place, seen and laid from there, times its light."""
    view = {"kind": "perspective", "width": 36, "height": 24, "field_of_view_deg": 60.0, "elevation_deg": 4.0}
    land = {"heights": "ridges", "height_km": 1.5, "size_km": 40.0, "count": 64}
    two = {"observer.altitude_km": 0.5, "wavelengths.list_nm": [450.0, 650.0], "solver.polarisation": False}

    def picture(sun_deg, moon, azimuth_deg):
        places = {
            "observer.view": {**view, "azimuth_deg": azimuth_deg},
            "terrain": {**land, "azimuth_deg": azimuth_deg},
        }
        frame = next(iter(frames(scene({"elevation_deg": sun_deg}, moon, **two, **places))))
        return frame, frame.view.rows(0, 24)

    frame, by_moon = picture(-30.0, {"elevation_deg": 12.0, "azimuth_deg": 100.0, "phase_angle_deg": 30.0}, 60.0)
    _, by_sun = picture(12.0, None, -40.0)
    over_sun = frame.sky.moon.moon.irradiance_factor(frame.sky.wavelength_nm)
    np.testing.assert_array_equal(by_moon.hidden, by_sun.hidden)
    assert 0.2 < by_moon.hidden.mean() < 0.8
    assert_allclose(by_moon.radiance, by_sun.radiance * over_sun, rtol=2e-3)


@pytest.fixture(scope="module")
def low_moon():
    """A half moon on the horizon, its lower edge cut off, in the north-east."""
    moon = {"elevation_deg": -0.5, "azimuth_deg": 150.0, "phase_angle_deg": 80.0, "distance_km": 370000.0}
    made = scene({"elevation_deg": -30.0}, moon, night={}, **{"ground.albedo": 0.3})
    return next(iter(frames(made, cached=False))).sky


@pytest.mark.parametrize("renderer", ["openexr", "pbrt"])
def test_a_map_keeps_the_light_of_the_moon(low_moon, renderer, tmp_path):
    """The disc in an environment map has the light of all of its surface, in the pixels where the moon stands."""
    maps = [
        read_latlong_exr(write_rgb_exr(low_moon, tmp_path / f"{disc}.exr", renderer=renderer, width=512, disc=disc))
        for disc in (False, True)
    ]
    assert [one.attributes["twilightMoonDisc"] for one in maps] == ["not in the map", "in the map"]
    added = (maps[1].rgb - maps[0].rgb).astype(float) * pixel_solid_angle(renderer, 512)[..., None]
    lux = added.sum(axis=(0, 1)) @ colour.REC709_LUMINANCE * maps[1].attributes["whiteLuminance"]
    facts = moon_facts(low_moon, in_map=True)
    assert lux == pytest.approx(facts["illuminance_lux"], rel=0.03)  # five wavelengths; between them the map has more
    row, column = np.nonzero(added.sum(axis=-1) > 1e-3 * added.sum())
    elevation, azimuth = (
        np.broadcast_to(x, added.shape[:2])[row, column] for x in environment_directions(renderer, 512)
    )
    assert np.abs(elevation).max() < 1.5 and np.abs(azimuth - 150.0).max() < 1.5
    assert facts["in_environment_map"]
    assert facts["mitsuba"]["direction"][2] > 0.8  # light travels away from the moon's azimuth, 150 deg from north


def test_what_is_seen_of_a_low_disc(low_moon):
    """The illuminance is that of the half above the horizon; its lit side, towards the sun, is the one below."""
    disc, step = low_moon.moon.disc, 0.002
    e, a = np.arange(0.5 * step, 0.4, step), np.arange(-0.4, 0.4, step)
    light = disc.radiance(e[:, None], a[None, :]).sum(axis=(0, 1)) * np.radians(step) ** 2
    assert_allclose(light * low_moon.solar_irradiance, low_moon.moon.direct_irradiance, rtol=0.02)
    whole = solve(scene({"elevation_deg": -30.0}, None), cached=False).direct(-0.5).irradiance
    assert (light < 0.5 * whole * low_moon.moon.moon.irradiance_factor(low_moon.wavelength_nm)).all()


@coarse
def test_the_moon_lights_the_ground_of_a_map():
    """A white plain in an environment map is lit by the moon's beam and by the moonlit sky."""
    made = scene({"elevation_deg": -30.0}, {"elevation_deg": 50.0}, **{"ground.albedo": 0.5})
    sky = next(iter(frames(made, cached=False))).sky
    beam = sky.moon.direct_irradiance * np.sin(np.radians(sky.moon.apparent_elevation_deg))
    expected = 0.5 / np.pi * (beam + sky.irradiance())
    assert_allclose(ground_factor(sky) * sky.solar_irradiance, expected)
    assert (beam > sky.irradiance()).all()
