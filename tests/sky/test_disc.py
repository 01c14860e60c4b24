"""The sun's disc: limb darkening, the shape and light that refraction and extinction leave, pictures and lamps."""

import json
from dataclasses import replace

import numpy as np
import pytest
from airs import on_levels
from toy_sky import glow_sky

from twilight.config import load, load_climate
from twilight.engine.sunbeam import Sunbeam, make_disc
from twilight.io import read_latlong_exr, read_sky, write_rgb_exr, write_sky
from twilight.io.environment import environment_directions, pixel_of, pixel_solid_angle
from twilight.io.lamps import sun_facts
from twilight.scene.medium import climate_medium
from twilight.sky import colour
from twilight.sky.disc import SOLAR_RADIUS_DEG, Disc, limb_coefficients, limb_darkening, mean_limb_darkening
from twilight.sky.lights import Sun

NM = [400.0, 480.0, 550.0, 620.0, 700.0]


@pytest.fixture(scope="module")
def air():
    return climate_medium(load_climate("pure-air"), NM)


def test_limb_darkening_is_one_in_the_middle_and_that_of_the_tables_elsewhere():
    """The disc would be as bright at its rim as in the middle."""
    nm = np.array([310.0, 372.9, 373.1, 400.0, 422.5, 423.0, 550.0, 1000.0])
    assert np.allclose(limb_coefficients(nm).sum(axis=0), 1.0, atol=2e-5)
    # Pierce and Slaughter 1977 and Cox 2000 (Allen's Astrophysical Quantities) at 550 nm: 0.70 to 0.72 at mu = 0.5
    assert 0.70 < limb_darkening(np.array([0.5]), [550.0])[0] < 0.72
    mu = np.linspace(0.05, 1.0, 20)[:, None]
    assert (np.diff(limb_darkening(mu, [400.0, 550.0, 900.0]), axis=0) > 0).all()
    assert (np.diff(limb_darkening(np.array([0.3]), [450.0, 550.0, 700.0, 900.0])) > 0).all()  # less in the red
    node, weight = np.polynomial.legendre.leggauss(20)
    node, weight = 0.5 * (node[:, None] + 1.0), 0.5 * weight[:, None]
    assert np.allclose((2 * weight * node * limb_darkening(node, nm)).sum(axis=0), mean_limb_darkening(nm), rtol=1e-12)
    assert (limb_coefficients([280.0]) == limb_coefficients([300.0])).all()  # skies begin at 280 nm, the fits at 300


def test_without_air_the_disc_is_round_and_brings_the_solar_irradiance():
    """The disc would have another size or light than the sun."""
    rows = np.arange(9.5, 10.5, 1 / 1200)
    ones = np.ones((rows.size, 2))
    disc = Disc(np.array([450.0, 650.0]), rows, rows[:, None] * ones, ones, 10.0, SOLAR_RADIUS_DEG)
    assert np.allclose(disc.irradiance_factor(), 1.0, rtol=2e-5)
    lower, upper = disc.edges_deg()
    assert upper - lower == pytest.approx(2 * SOLAR_RADIUS_DEG, abs=2e-3)
    assert disc.centroid_deg() == pytest.approx(10.0, abs=1e-4)
    half = np.degrees(np.arccos(np.cos(np.radians(SOLAR_RADIUS_DEG)))) / np.cos(np.radians(10.0))
    assert disc.half_width_deg().max() == pytest.approx(half, rel=1e-3)
    centre, area = disc.radiance(10.0, 0.0), np.pi * np.sin(np.radians(SOLAR_RADIUS_DEG)) ** 2
    assert np.allclose(centre, 1 / (mean_limb_darkening([450.0, 650.0]) * area))
    assert not disc.radiance(10.0, 1.0).any() and not disc.radiance(11.0, 0.0).any()


@pytest.mark.parametrize("sun, tolerance", ((40.0, 1e-4), (10.0, 5e-4), (3.0, 0.011)))
def test_its_light_is_that_of_the_beam_while_air_changes_little_over_it(air, sun, tolerance):
    """Disc and sunbeam would differ."""
    found = make_disc(air, Sun(sun), 0.0).irradiance_factor()
    assert np.allclose(found, Sunbeam(air).at(sun, 0.0).irradiance, rtol=tolerance)


@pytest.mark.parametrize(
    "profile, sun, high",
    (("us_standard", -0.283, 27.1), ("midlatitude_winter", -0.366, 25.9), ("subarctic_winter", -0.481, 23.9)),
)
def test_a_sun_that_stands_on_the_horizon_is_flattened_by_five_to_eight_minutes_of_arc(profile, sun, high):
    """The Nautical Almanac's 34.5' and 28.9' for the limbs at 10 C make it 26.4' high, 32.0' wide."""
    disc = make_disc(climate_medium(load("pure-air", {"atmosphere.profile": profile}).climate, [550.0]), Sun(sun), 0.0)
    lower, upper = disc.edges_deg()
    assert 60 * (upper - lower) == pytest.approx(high, abs=0.1) and lower < 0.004
    assert 2 * 60 * disc.half_width_deg().max() == pytest.approx(32.0, abs=0.05)


def test_its_edges_are_dispersed_and_its_upper_rim_is_green(air):
    """There would be no green rim."""
    disc = make_disc(air, Sun(0.5), 0.0)
    tops = [disc.elevation_deg[disc.half_width_deg()[:, w] > 0][-1] for w in range(len(NM))]
    assert (np.diff(tops) < 0).all() and 10 < 3600 * (tops[0] - tops[-1]) < 60  # violet over red, tens of arc seconds
    # the last rim of a setting sun has green in it where red is gone
    rim = make_disc(air, Sun(-0.7), 0.0).at_wavelengths([530.0, 680.0])
    assert rim.is_seen
    top = rim.radiance(rim.edges_deg()[1] - 1e-3, 0.0)
    assert top[0] > 0.0 and top[1] == 0.0


def test_below_the_horizon_nothing_is_seen_and_from_a_mountain_it_still_is(air):
    """A sun that has set would be drawn."""
    assert not make_disc(air, Sun(-1.5), 0.0).is_seen
    assert not make_disc(air, Sun(-1.5), 0.0).irradiance_factor().any()
    high = make_disc(air, Sun(-1.5), 3.0)
    assert high.is_seen and high.edges_deg()[0] < 0.0
    hill = make_disc(air, Sun(-0.85), 0.3)  # which the sun does not touch yet: no line of light on the horizon
    assert not hill.radiance(np.linspace(-0.6, hill.edges_deg()[0] - 2e-3, 400), 0.0).any()
    cut = make_disc(air, Sun(-0.55), 0.0)
    assert cut.edges_deg()[0] == pytest.approx(0.0, abs=2e-3) and cut.edges_deg()[1] < 0.3


def test_layers_of_an_inversion_cut_it_into_slices(air):
    """Lines of sight below a layer where the index falls steeply come from elsewhere: a waist."""

    def waist(medium):
        disc = make_disc(medium, Sun(-0.6), 0.02)
        width = (disc.half_width_deg() * (disc.transmittance > 0.0))[:, 2]
        return int((np.diff(np.sign(np.diff(width[width > 0]))) != 0).sum())

    z = np.unique(np.concatenate([air.altitude_km, np.linspace(0.0, 0.1, 41)]))
    step = 3e-6 * (1.0 / (1.0 + np.exp(np.clip((z - 0.035) / 0.002, -50, 50))))[:, None]
    layered = on_levels(air, z, refractivity=air.at(z).refractivity + step)
    assert waist(air) == 1 and waist(layered) > 1


@pytest.fixture(scope="module")
def low_sun(air):
    """A glow with the disc of a sun at 0.6 deg over pure air."""
    sky = glow_sky(step_deg=15.0)
    medium = climate_medium(load_climate("pure-air"), sky.wavelength_nm)
    disc = make_disc(medium, Sun(0.6), 0.0)
    return replace(sky, sun_elevation_deg=0.6, apparent_sun_elevation_deg=1.0, disc=disc, sun_azimuth_deg=247.0)


@pytest.mark.parametrize("renderer", ("openexr", "mitsuba", "blender", "radiance", "pbrt"))
def test_a_direction_falls_into_the_pixel_that_looks_there(renderer):
    """The disc would be drawn into another pixel."""
    elevation, azimuth = np.broadcast_arrays(*environment_directions(renderer, 64))
    row, column = pixel_of(renderer, 64, elevation, azimuth)
    here = np.indices(elevation.shape)
    assert (row == here[0]).all() and (column == here[1]).all()
    assert pixel_solid_angle(renderer, 64).sum() == pytest.approx(4 * np.pi)


@pytest.mark.parametrize("renderer", ("openexr", "blender", "pbrt"))
@pytest.mark.parametrize("width", (64, 1024))
def test_a_map_keeps_the_light_of_the_disc(low_sun, renderer, width, tmp_path):
    """A renderer would be lit too brightly by the sun in a coarse map."""
    without = read_latlong_exr(write_rgb_exr(low_sun, tmp_path / "a.exr", renderer=renderer, width=width))
    with_disc = read_latlong_exr(write_rgb_exr(low_sun, tmp_path / "b.exr", renderer=renderer, width=width, disc=True))
    added = (with_disc.rgb - without.rgb).astype(float) * pixel_solid_angle(renderer, width)[..., None]
    luminous = added.sum(axis=(0, 1)) @ colour.REC709_LUMINANCE * with_disc.attributes["whiteLuminance"]
    assert luminous == pytest.approx(sun_facts(low_sun)["illuminance_lux"], rel=0.02)
    assert with_disc.attributes["twilightSunDisc"] == "in the map"
    assert 1 <= (added[..., 0] > 1e-9).sum() <= (1 if width == 64 else 30) * 2


def test_a_file_keeps_the_disc_and_the_sky_does_not_contain_it(low_sun, tmp_path):
    """The sun's light would count twice, or be lost in the file."""
    again = read_sky(write_sky(low_sun, tmp_path / "sky.h5"))
    assert np.array_equal(again.disc.transmittance, low_sun.disc.transmittance)
    assert np.array_equal(again.disc.irradiance_factor(), low_sun.disc.irradiance_factor())
    assert np.array_equal(again.radiance, replace(low_sun, disc=None).radiance)
    half = replace(low_sun, polarisation=np.zeros((*low_sun.radiance.shape[:2], 2, low_sun.wavelength_nm.size)))
    assert np.allclose(half.through_polariser(0).disc.irradiance_factor(), 0.5 * low_sun.disc.irradiance_factor())


def test_lamps_point_at_the_sun_and_have_its_light(low_sun):
    """A renderer's lamp would shine from elsewhere, or with another light."""
    facts = sun_facts(low_sun)
    assert json.loads(json.dumps(facts)) == facts
    e, a = np.radians([facts["apparent_elevation_deg"], 247.0])
    east, north, up = np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)
    assert np.allclose(facts["mitsuba"]["direction"], [east, -up, -north])  # -X is east, light travels away from it
    tilt, _, turn = facts["blender"]["rotation_euler_rad"]
    x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    z = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    assert np.allclose(z @ x @ [0, 0, 1], [east, north, up])  # a sun lamp shines along its -Z
    lamp = facts["blender"]
    assert np.allclose(np.array(lamp["color"]) * lamp["energy"], facts["irradiance_rgb_W_per_m2"])
    lux = 683.002 * np.dot(facts["irradiance_rgb_W_per_m2"], colour.REC709_LUMINANCE)
    assert lux == pytest.approx(facts["illuminance_lux"], rel=1e-3)
    assert np.allclose(
        facts["irradiance_W_per_m2_nm"], low_sun.disc.irradiance_factor() * low_sun.solar_irradiance, rtol=1e-12
    )
    assert facts["apparent_elevation_deg"] == pytest.approx(low_sun.disc.centroid_deg())
    unknown = sun_facts(replace(low_sun, disc=None, direct_irradiance=None))
    assert unknown["illuminance_lux"] is None and unknown["blender"]["energy"] == 0.0
