"""Stars and planets: positions against known values, refraction, blending."""

from __future__ import annotations

import sys
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from twilight.base.errors import TwilightError
from twilight.numerics.directions import azimuth_elevation, direction
from twilight.sky.night.points import Stars, blended, bright_stars
from twilight.studies.validate.stars.coordinates import (
    StarSite,
    _astropy,
    equatorial,
    horizontal,
    lifted,
    planet_tracks,
    precession,
    refraction_rad,
)

ARCSEC = np.pi / 180.0 / 3600.0


def unit(ra_deg, dec_deg):
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    return np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)


def angle(a, b):
    return 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(np.asarray(a) - b, axis=-1), 0.0, 1.0))


# ICRS at the epoch J2000.0 as SIMBAD has them: fast stars, whose motion since J1991.25 is 2" to 32"
J2000 = {
    "Sirius": (101.28715533, -16.71611586),
    "Arcturus": (213.91530029, 19.18240916),
    "Vega": (279.23473479, 38.78368896),
    "Fomalhaut": (344.41269272, -29.62223703),
    "Procyon": (114.82549791, 5.22498756),
}


@pytest.mark.parametrize("name", J2000)
def test_proper_motion_brings_stars_to_j2000(name):
    """Fast stars would lie where they were in 1991."""
    stars = bright_stars(2000.0)
    i = list(stars.names).index(name)
    assert angle(stars.directions[i], unit(*J2000[name])) < 0.5 * ARCSEC


def test_catalogue_is_whole():
    """Stars would be missing, out of order or without a name."""
    stars = bright_stars(2000.0)
    assert len(stars) == 8948
    assert np.all(np.diff(stars.magnitude) >= 0)
    assert stars.label(0) == "Sirius" and stars.label(3000).startswith("HIP ")
    assert len(bright_stars(2000.0, 3.0)) == int((stars.magnitude <= 3.0).sum())
    np.testing.assert_allclose(np.linalg.norm(stars.directions, axis=1), 1.0)


def test_blended_stars_add_their_light_at_its_centre():
    """Double stars would be matched to their brighter half."""
    directions = unit([10.0, 10.1, 50.0], [0.0, 0.0, 20.0])
    stars = Stars(directions, np.array([2.0, 2.0, 1.0]), np.array([1, 2, 3]), np.array(["", "", "x"]))
    made = blended(stars, np.radians(0.2))
    assert list(made.hip) == [3, 1]
    assert made.magnitude[1] == pytest.approx(2.0 - 2.5 * np.log10(2.0))
    assert angle(made.directions[1], unit(10.05, 0.0)) < 1e-9
    assert len(blended(stars, np.radians(0.05))) == 3


def test_local_position_is_that_of_spherical_trigonometry():
    """Stars would stand in the wrong place above the horizon."""
    # Meeus 1998: mean sidereal time (12.4), precession (20.3); aberration and nutation left out
    place, moment = StarSite(48.2, 16.4), datetime(2021, 8, 10, 23, 30, tzinfo=UTC)
    days = (moment - datetime(2000, 1, 1, 12, tzinfo=UTC)) / timedelta(days=1)
    sidereal = np.radians(280.46061837 + 360.98564736629 * days + place.longitude_deg)
    t = days / 36525.0
    zeta, z = (np.radians((2306.2181 * t + c * t**2) / 3600.0) for c in (0.30188, 1.09468))
    theta = np.radians((2004.3109 * t - 0.42665 * t**2) / 3600.0)

    def about(axis, angle_rad):
        c, s = np.cos(angle_rad), np.sin(angle_rad)
        return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]] if axis == "z" else [[c, 0, -s], [0, 1, 0], [s, 0, c]])

    latitude = np.radians(place.latitude_deg)
    # hour-angle axes: x south on the meridian's equator
    to_local = np.array([[0, 1, 0], [-np.sin(latitude), 0, np.cos(latitude)], [np.cos(latitude), 0, np.sin(latitude)]])
    matrix = to_local @ about("z", sidereal) @ about("z", -z) @ about("y", theta) @ about("z", -zeta)
    stars = bright_stars(2021.6)
    expected = stars.directions @ matrix.T
    got = horizontal(place, moment, 0.0, 10.0)
    for name in ("Vega", "Altair", "Deneb", "Capella", "Polaris", "Fomalhaut"):
        i, j = list(stars.names).index(name), list(got.names).index(name)
        assert angle(expected[i], got.directions[j]) < 45 * ARCSEC, name  # aberration 20.5" and nutation 17"


def test_jupiter_and_saturn_at_their_great_conjunction():
    """Planets would be missing, misplaced or of another brightness."""
    # 2020-12-21: 6.1' apart; both in the evening sky over South Africa, Jupiter the brighter
    stars = horizontal(StarSite(-26.0, 28.0), datetime(2020, 12, 21, 18, 0, tzinfo=UTC), 850.0, 20.0)
    i, j = (list(stars.names).index(n) for n in ("Jupiter", "Saturn"))
    assert np.degrees(angle(stars.directions[i], stars.directions[j])) * 60 == pytest.approx(6.2, abs=1.0)
    assert stars.magnitude[i] == pytest.approx(-2.0, abs=0.5) and stars.magnitude[j] == pytest.approx(0.6, abs=0.5)
    years, tracks = planet_tracks(2020.9, 2021.05, 1.0)
    apart = np.degrees(angle(tracks[:, 3], tracks[:, 4])) * 60
    assert years[apart.argmin()] == pytest.approx(2020.97, abs=0.01)
    assert np.all(stars.directions[:, 2] > np.sin(np.radians(2.0)))


def test_precession_turns_the_pole_by_20_arcsec_a_year():
    """Positions of other years would be those of 2000."""
    matrix = precession(2050.0)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-9)
    pole = matrix @ [0.0, 0.0, 1.0]
    assert angle(pole, np.array([0.0, 0.0, 1.0])) / ARCSEC / 50.0 == pytest.approx(20.04, abs=0.05)
    polaris = list(equatorial(2100.0).names).index("Polaris")  # nearest to the pole about then: 27.5'
    z = equatorial(2100.0).directions[polaris, 2]
    assert np.degrees(np.arccos(z)) * 60 == pytest.approx(27.5, abs=0.5)


# apparent elevation [deg], refraction ['] at 1010 hPa and 10 C: Nautical Almanac's table of altitude corrections
ALMANAC = {90.0: 0.0, 45.0: 1.0, 30.0: 1.7, 20.0: 2.6, 10.0: 5.3, 5.0: 9.8, 2.0: 18.2, 0.0: 34.0}
LAST_DIGIT = 0.06
AT_THE_HORIZON = 0.6  # where the almanac and Bennett differ by more


@pytest.mark.parametrize("apparent", ALMANAC)
def test_refraction_of_the_nautical_almanac(apparent):
    """Stars near the horizon would stand too low."""
    true = np.radians(apparent - ALMANAC[apparent] / 60.0)
    tolerance = AT_THE_HORIZON if apparent < 5 else LAST_DIGIT + 0.02
    assert np.degrees(refraction_rad(true, 1010.0, 10.0)) * 60 == pytest.approx(ALMANAC[apparent], abs=tolerance)


def test_refraction_grows_with_the_density_of_air():
    """Mountain air would lift stars as air at the sea does."""
    here = refraction_rad(np.radians(30.0), 1010.0, 10.0)
    assert refraction_rad(np.radians(30.0), 505.0, 10.0) / here == pytest.approx(0.5, abs=1e-3)
    assert refraction_rad(np.radians(30.0), 1010.0, 293.15) / here == pytest.approx(0.5, abs=1e-3)
    assert refraction_rad(np.radians(30.0), 0.0, 10.0) == 0.0


def test_refraction_is_that_of_astropy():
    """Apparent places would differ from astropy's by more than two arc seconds."""
    true = np.array([15.0, 25.0, 40.0, 60.0, 80.0])
    with _astropy() as (coordinates, units, Time):
        site = coordinates.EarthLocation(lat=10 * units.deg, lon=0 * units.deg)
        here = {"obstime": Time("2020-01-01"), "location": site}
        vacuum = coordinates.AltAz(**here)
        air = coordinates.AltAz(**here, pressure=900 * units.hPa, temperature=15 * units.deg_C, obswl=0.55 * units.um)
        stars = coordinates.SkyCoord(alt=true * units.deg, az=0 * units.deg, frame=vacuum).transform_to("icrs")
        apparent = stars.transform_to(air).alt.deg
    ours = true + np.degrees(refraction_rad(np.radians(true), 900.0, 15.0))
    np.testing.assert_allclose(ours, apparent, atol=2.0 / 3600.0)


def test_lifted_keeps_azimuth_and_the_zenith():
    """Refraction would turn stars sideways."""
    at = direction([0.0, 120.0, 270.0], [5.0, 40.0, 80.0])
    azimuth, elevation = azimuth_elevation(lifted(at, np.array([0.0, 0.0, 1.0]), 1010.0, 10.0))
    np.testing.assert_allclose(azimuth, [0.0, 120.0, 270.0], atol=1e-9)
    lift = np.degrees(refraction_rad(np.radians([5.0, 40.0, 80.0]), 1010.0, 10.0))
    np.testing.assert_allclose(elevation, [5.0 + lift[0], 40.0 + lift[1], 80.0 + lift[2]], atol=1e-9)
    tilted = np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(lifted(tilted[None], tilted, 1010.0, 10.0)[0], tilted, atol=1e-12)
    np.testing.assert_array_equal(lifted(at, tilted, 0.0, 10.0).round(12), at.round(12))


def test_years_and_the_extra_are_asked_for(monkeypatch):
    """Positions would be extrapolated past the theory, or a missing astropy be a traceback."""
    with pytest.raises(TwilightError, match="the year 1700 must be from 1900 to 2100"):
        equatorial(1700.0)
    monkeypatch.setitem(sys.modules, "astropy", None)
    with pytest.raises(TwilightError, match=r"install 'astropy>=6.1,<9'"):
        equatorial(2020.0)
