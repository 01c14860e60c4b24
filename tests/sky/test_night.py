"""The night floor: closed forms of its geometry, limits of the air, brightness against measured nights."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from montecarlo_media import hazy_earth, slab
from stability_media import EXTREMES, medium_of
from toy_sky import glow_sky, texture_grid

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config import load
from twilight.io.netcdf import read_sky, write_sky
from twilight.scene import resolve
from twilight.sky.moments import ECLIPTIC_TILT_DEG, Moments, unit_vector
from twilight.sky.night import NightLevels, Place, light, night_radiance
from twilight.sky.night.glows import ecliptic_from_sun
from twilight.sky.night.world import veil
from twilight.sky.sky import Sky

NM = np.arange(380.0, 721.0, 20.0)
NONE = NightLevels(0.0, 0.0, 0.0)
NATURAL = ("airglow", "starlight", "zodiacal_light")


def as_sky(night, nm=NM, elevation=(90.0,)):
    elevation = np.asarray(elevation, float)
    azimuth = np.arange(night.shape[1]) * (360.0 / night.shape[1])
    return Sky(nm, elevation, azimuth, np.zeros_like(night), -30.0, night_radiance=night)


def zenith_magnitude(**levels):
    night = night_radiance(hazy_earth(wavelength_nm=NM), np.array([90.0]), np.array([0.0]), NightLevels(**levels))
    return float(-2.5 * np.log10(as_sky(night).luminance()[0, 0] / 10.8e4))  # V mag arcsec^-2 of cd m^-2


def test_van_rhijn_closed_form_and_observers():
    """The airglow would brighten wrongly towards the horizon, or be there from above it."""
    horizon = 1.0 / np.sqrt(1.0 - (6371.0 / 6461.0) ** 2)
    assert light.van_rhijn(np.array([90.0, 0.0]), 90.0) == pytest.approx([1.0, horizon])
    # over a flat Earth the path would be 1/sin(e): the curved one is shorter
    assert 2.0 > light.van_rhijn(np.array([30.0]), 90.0)[0] > 1.9
    above = light.van_rhijn(np.array([90.0, 0.0, -10.0, -80.0]), 90.0, observer_km=400.0)
    assert above[:2] == pytest.approx([0.0, 0.0])
    # the limb at -10 deg is crossed twice unless the ground is in the way; at -80 deg once
    assert above[3] == pytest.approx(1.0 / np.sqrt(1 - (6771 * np.cos(np.radians(80)) / 6461) ** 2))
    assert light.van_rhijn(np.array([-5.0]), 90.0, observer_km=10.0) == pytest.approx([0.0])


def test_stars_stand_where_astropy_says():
    """Milky Way and zodiacal light would stand elsewhere."""
    coordinates = pytest.importorskip("astropy.coordinates")
    from astropy import units
    from astropy.time import Time
    from astropy.utils import iers

    moment = datetime(2026, 3, 14, 19, 30, tzinfo=UTC)
    place = Place(52.5, 13.4, moment)
    with iers.conf.set_temp("auto_download", False):
        frame = coordinates.AltAz(
            obstime=Time(moment), location=coordinates.EarthLocation(lat=52.5 * units.deg, lon=13.4 * units.deg)
        )
        sun = coordinates.get_body("sun", Time(moment)).transform_to(frame)
        elevation, azimuth = np.array([90.0, 20.0, 55.0]), np.array([0.0, 100.0, 250.0])
        sky = coordinates.SkyCoord(alt=elevation * units.deg, az=azimuth * units.deg, frame=frame)
        galactic = np.abs(sky.galactic.b.deg)
        ecliptic = sky.transform_to(coordinates.BarycentricTrueEcliptic(equinox=Time(moment)))
        sun_longitude = sun.transform_to(coordinates.GeocentricTrueEcliptic(equinox=Time(moment))).lon.deg
    relative = azimuth - sun.az.deg
    moment = Moments.of_sun(sun.alt.deg, sun.az.deg, place)
    sine = unit_vector(elevation, relative) @ moment.poles()[0][0]
    assert np.abs(np.degrees(np.arcsin(sine))) == pytest.approx(galactic, abs=0.5)
    longitude, latitude = (np.abs(angle[0]) for angle in ecliptic_from_sun(moment, elevation[None], relative[None]))
    assert latitude == pytest.approx(np.abs(ecliptic.lat.deg), abs=0.5)
    apart = np.abs((ecliptic.lon.deg - sun_longitude + 180.0) % 360.0 - 180.0)
    assert longitude == pytest.approx(apart, abs=0.5)


def test_without_a_place_the_ecliptic_rises_from_the_sun_at_its_tilt():
    """Without a place the zodiacal light would lie elsewhere."""

    def seen(elevation, azimuth, sun):
        return np.abs(ecliptic_from_sun(Moments.of_sun(sun), np.array([elevation]), np.array([azimuth])))[:, 0]

    assert seen([-18.0], [0.0], -18.0)[:, 0] == pytest.approx([0.0, 0.0], abs=1e-6)
    # with the sun on the horizon the horizon's point 90 deg away is as far from the ecliptic as the tilt says
    assert seen([0.0, 0.0], [90.0, 270.0], 0.0)[1] == pytest.approx([ECLIPTIC_TILT_DEG] * 2)
    assert seen([90.0], [0.0], 0.0)[1] == pytest.approx(90.0 - ECLIPTIC_TILT_DEG)


def test_airglow_bins_keep_every_line():
    """The green line would fall between wavelengths."""
    fine = np.arange(381.0, 721.0, 1.0)
    for edges in (np.arange(380.5, 720.6, 20.0), np.linspace(380.5, 719.5, 6)):
        coarse = np.stack([edges[:-1], edges[1:]], axis=1)
        total = (light.airglow_zenith(coarse) * np.diff(coarse, axis=1)[:, 0]).sum()
        exact = light.airglow_zenith(np.stack([fine - 0.5, fine + 0.5], axis=1))
        inside = (fine >= edges[0]) & (fine <= edges[-1])
        assert total == pytest.approx(exact[:, inside].sum(), rel=1e-4)
    line = light.airglow_zenith(np.array([[557.0, 558.4]])) - light.airglow_zenith(np.array([[556.0, 557.1]]))
    rayleigh = line.sum() * 1.4 / (light.RAYLEIGH_PHOTONS * light.photon_energy_j(np.array([557.7]))[0])
    assert rayleigh == pytest.approx(320.0 / light.SOLAR_MAXIMUM, rel=0.02)


def test_starlight_from_pole_to_plane():
    """Milky Way or zodiacal light would not be those of the published tables."""
    s10 = light.starlight_s10(np.array([90.0, 30.0, 10.0, 0.0])) * (1.0 - light.GALACTIC_LIGHT_FRACTION)
    assert s10[[0, 3]] == pytest.approx([30.0, 250.0])
    assert (np.diff(s10) > 0).all()
    b = np.degrees(np.arcsin((np.arange(4000) + 0.5) / 4000))
    assert float(light.starlight_s10(None)) == pytest.approx(light.starlight_s10(b).mean(), rel=1e-3)
    got = light.zodiacal_500nm(np.array([30.0, 180.0, -90.0, 0.0]), np.array([0.0, 0.0, 10.0, -90.0]))
    assert got == pytest.approx(np.array([2480, 230, 225, 77]) * 1e-11)
    # the gegenschein is brighter than the ecliptic 30 deg from it
    assert light.zodiacal_500nm(180.0, 0.0) > light.zodiacal_500nm(150.0, 0.0)
    # 1 S10 is 1.28e-11 W m^-2 nm^-1 sr^-1 by Leinert et al. 1998, from another magnitude scale
    assert light.S10_550NM == pytest.approx(1.28e-11, rel=0.08)


def test_vacuum_and_pure_absorber_are_exact():
    """Air would dim the night by another law."""
    elevation = np.array([90.0, 30.0, 5.0])
    above = np.ones((3, 1))
    empty = veil(slab(0.0, 1.0), elevation)
    assert empty.behind(above, np.ones(1)) == pytest.approx(above)
    absorber = veil(slab(0.7, 0.0), elevation)
    expected = np.exp(-0.7 / np.sin(np.radians(elevation)))
    assert absorber.behind(above, np.ones(1))[:, 0] == pytest.approx(expected, rel=1e-3)


def test_air_keeps_the_night_within_what_noll_found():
    """Effective extinction of Noll et al. 2012 eq. 24 (Rayleigh) for airglow, to 60 deg from the zenith."""
    elevation = np.array([90.0, 60.0, 30.0])
    x = light.van_rhijn(elevation, 90.0)
    rows = (np.arange(200) + 0.5) * 0.45
    weight = np.sin(2 * np.radians(rows))
    mean = np.array([(weight * light.van_rhijn(rows, 90.0)).sum() / weight.sum()])
    for depth in (0.05, 0.1, 0.2):
        air = veil(slab(depth, 1.0, radius_km=6371.0), elevation)
        here = air.behind(x[:, None], mean)[:, 0] / x
        noll = air.transmittance[:, 0] ** (1.669 * np.log10(x) - 0.146)
        assert here == pytest.approx(noll, rel=0.08)


def test_extreme_air_stays_between_nothing_and_the_brightest_light_above():
    """Extreme air would make the night negative or brighter than above it."""
    medium = medium_of(*EXTREMES.values())
    elevation = np.array([0.0, 1.0, 10.0, 90.0])
    air = veil(medium, elevation)
    night = air.behind(np.ones((4, medium.n_wavelengths)), np.ones(medium.n_wavelengths))
    assert np.isfinite(night).all() and (night >= 0).all() and (night <= 1.0 + 1e-12).all()
    fog = list(EXTREMES).index("aerosol optical depth 20")
    assert night[-1, fog] < 0.3
    # from above the air nothing is lost; lines of sight to the ground are dark
    over = veil(medium, np.array([-5.0, 0.0, 90.0]), observer_km=200.0)
    assert over.transmittance[1:] == pytest.approx(1.0)
    assert (veil(medium, np.array([-40.0]), observer_km=200.0).transmittance == 0).all()


def test_zenith_at_solar_maximum_is_that_of_paranal():
    """Paranal's V 21.61 (Patat 2003) or the darkest 22.07 to 22.13 (Grauer & Grauer 2021) would be missed."""
    got = zenith_magnitude(airglow=light.SOLAR_MAXIMUM, starlight=0.2, zodiacal_light=1.0)
    assert got == pytest.approx(21.61, abs=0.25)
    darkest = zenith_magnitude(airglow=0.6, starlight=0.4, zodiacal_light=0.8)
    assert darkest == pytest.approx(22.1, abs=0.25)
    usual = zenith_magnitude()
    assert 21.2 < usual < 21.7


def test_the_night_is_that_of_observers_it_was_not_derived_from():
    """Zenith (Koomen et al. 1952, Fig. 1) and ground (AMS Glossary) within a factor of 1.5."""
    dark = NightLevels(0.6, 0.4, 0.8)
    square_feet_per_square_metre = 10.7639
    medium = hazy_earth(wavelength_nm=NM)
    zenith = as_sky(night_radiance(medium, np.array([90.0]), np.array([0.0]), dark)).luminance()[0, 0]
    assert 1.3e-5 / 1.5 < zenith / square_feet_per_square_metre < 1.5e-5 * 1.5
    elevation, azimuth = texture_grid(6.0)
    whole = night_radiance(medium, elevation, azimuth, dark)
    ground = Sky(NM, elevation, azimuth, np.zeros_like(whole), -30.0, night_radiance=whole).illuminance_lux()
    assert 6e-4 / 1.5 < ground < 6e-4 * 1.5


def test_few_wavelengths_see_the_same_night():
    """Bin means: 8 wavelengths give the luminance of 35 although the green line is 1 nm wide."""
    brightness = []
    for nm in (np.linspace(380, 720, 8), np.linspace(380, 720, 35), np.array([400.0, 424, 520, 580, 640, 720])):
        night = night_radiance(hazy_earth(wavelength_nm=nm), np.array([90.0]), np.array([0.0]))
        brightness.append(as_sky(night, nm).luminance()[0, 0])
    assert brightness == pytest.approx([brightness[1]] * 3, rel=0.12)


def test_levels_scale_and_add():
    """A level would scale another source."""
    medium = hazy_earth(wavelength_nm=NM)
    where = (np.array([5.0, 45.0]), np.arange(4) * 90.0)
    whole = night_radiance(medium, *where)
    parts = [night_radiance(medium, *where, replace(NONE, **{name: 1.0})) for name in NATURAL]
    assert sum(parts) == pytest.approx(whole, rel=1e-12)
    assert all((part > 0).all() for part in parts)
    assert (night_radiance(medium, *where, NONE) == 0).all()
    doubled = night_radiance(medium, *where, replace(NONE, airglow=2.0))
    assert doubled == pytest.approx(2.0 * parts[0])
    with pytest.raises(TwilightError, match=r"night\.airglow"):
        NightLevels(airglow=-1.0)


def test_a_sky_without_night_is_unchanged_and_with_it_is_the_sum(tmp_path):
    """The night would change the sunlit sky, or be lost in the file."""
    bare = glow_sky(step_deg=15.0, sun_elevation_deg=-12.0)
    elevation, azimuth = texture_grid(15.0)
    medium = hazy_earth(wavelength_nm=bare.wavelength_nm)
    night = night_radiance(medium, elevation, azimuth)
    both = replace(bare, night_radiance=night)
    assert bare.normalised_radiance is bare.sun_normalised_radiance
    assert np.array_equal(both.sun_normalised_radiance, bare.sun_normalised_radiance)
    assert both.radiance == pytest.approx(bare.radiance + night)
    only = replace(bare, sun_normalised_radiance=np.zeros_like(night), night_radiance=night)
    assert both.irradiance() == pytest.approx(bare.irradiance() + only.irradiance())
    assert (both.luminance() > bare.luminance()).all()
    again = read_sky(write_sky(both, tmp_path / "sky.h5"))
    assert np.array_equal(again.night_radiance, night) and np.array_equal(again.radiance, both.radiance)
    assert read_sky(write_sky(bare, tmp_path / "bare.h5")).night_radiance is None
    middle = both.resample(elevation, azimuth)
    assert middle.night_radiance == pytest.approx(night)
    with pytest.raises(TwilightError, match="night_radiance"):
        replace(bare, night_radiance=-night)


def test_a_render_at_a_place_and_time_has_its_own_night():
    """Preetham's formula is quick; the night is added to whatever a solver gives."""
    from twilight.engine import frames

    def at(moment, **more):
        sun = {"at": moment, "latitude_deg": 0.0, "longitude_deg": 0.0, "time_zone": "UTC"}
        settings = {"sun": sun, "solver.name": "preetham", "texture.resolution_deg": 15.0, "omit_negligible": False}
        return next(iter(frames(resolve(load("pure-air", settings | {"aerosol.type": "continental_average"} | more)))))

    bare, lit = at("2026-03-20T15:00"), at("2026-03-20T15:00", night={})
    assert bare.sky.night_radiance is None
    assert np.array_equal(bare.sky.sun_normalised_radiance, lit.sky.sun_normalised_radiance)
    assert lit.sky.night_radiance.shape == lit.sky.sun_normalised_radiance.shape
    assert lit.sky.provenance["configuration"]["night"] == {"airglow": 1.0, "starlight": 1.0, "zodiacal_light": 1.0}
    assert lit.sky.provenance["hash"] != bare.sky.provenance["hash"]
    # the Milky Way has moved on by the next season's afternoon
    later = at("2026-06-20T15:00", night={"airglow": 0.0, "zodiacal_light": 0.0}).sky.night_radiance
    now = at("2026-03-20T15:00", night={"airglow": 0.0, "zodiacal_light": 0.0}).sky.night_radiance
    assert np.abs(np.log(later[-1].mean() / now[-1].mean())) > 0.1


def test_a_sky_is_the_sum_of_its_lights():
    """A light would be lost, count twice, or take another's beam with it."""
    from twilight.engine import frames

    sun, moon = {"elevation_deg": -12.0}, {"elevation_deg": 30.0, "azimuth_deg": 100.0}
    settings = {"sun": sun, "moon": moon, "night": {"light_pollution": {"bortle_class": 5}}, "solver.name": "compact"}
    sky = next(iter(frames(resolve(load("pure-air", {**settings, "texture.resolution_deg": 15.0}))))).sky
    names = ["airglow", "stars", "zodiacal_light", "light_pollution", "moon"]
    assert list(sky.lights) == names
    assert sum(sky.lights.values()) == pytest.approx(sky.night_radiance, rel=1e-12)
    assert sum(sky[name].radiance for name in ("sun", *names)) == pytest.approx(sky.radiance, rel=1e-12)
    without = sky - "moon"
    assert without.moon is None and sky["moon"].moon is sky.moon and not sky["moon"].direct_irradiance.any()
    assert without.radiance + sky["moon"].radiance == pytest.approx(sky.radiance, rel=1e-12)
    assert (sky - "sun").sun_normalised_radiance.max() == 0.0
    assert sky.only("sun", "moon").radiance == pytest.approx(sky["sun"].radiance + sky["moon"].radiance)
    coarse = sky.resample(np.array([10.0, 60.0]), np.array([0.0, 90.0, 180.0, 270.0]))
    assert sum(coarse.lights.values()) == pytest.approx(coarse.night_radiance, rel=1e-12)
    with pytest.raises(TwilightError, match="has no light 'lamp'; it has sun, airglow"):
        sky - "lamp"
    with pytest.raises(TwilightError, match="lights must add up"):
        replace(sky, night_radiance=2.0 * sky.night_radiance)


def test_what_is_too_weak_is_left_out_with_a_word():
    """Glows would be computed by day, or be missing at dusk; a moon that is down would be silent."""
    from twilight.engine import frames

    def at(sun_deg, **more):
        settings = {"sun": {"elevation_deg": sun_deg}, "night": {}, "solver.name": "compact"}
        made = resolve(load("pure-air", {**settings, "texture.resolution_deg": 15.0, **more}))
        return made, next(iter(frames(made))).sky

    glows = ["airglow", "stars", "zodiacal_light"]
    made, day = at(20.0)
    assert day.night_radiance is None and [part.split(":")[0] for part in day.provenance["left_out"][-3:]] == glows
    _, whole = at(20.0, omit_negligible=False)
    assert list(whole.lights) == glows and (whole.night_radiance < 3e-4 * day.radiance).all()
    assert list(at(-12.0)[1].lights) == glows
    with pytest.warns(TwilightWarning, match="the moon stands at -25.0 deg"):
        made, night = at(-12.0, moon={"elevation_deg": -25.0})
    assert [item.part for item in made.lights(made.suns[0]).left_out] == ["moon"]
    assert any(part.startswith("moon:") for part in night.provenance["left_out"]) and night.moon.disc is None
