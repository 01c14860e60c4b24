"""The sun's position against the SPA report's example, Meeus, and what every calendar knows."""

import datetime as dt

import numpy as np
import pytest

from twilight.base.errors import TwilightError
from twilight.sky.ephemeris import parse_time, sun_position


def test_example_of_the_spa_report():
    # Reda & Andreas 2008, NREL/TP-560-34302, table A5.1: 39.742476 N, 105.1786 W, 1830.14 m
    """The sun's place would be off the report's example (Reda & Andreas 2008)."""
    p = sun_position("2003-10-17T12:30:30-07:00", 39.742476, -105.1786, 1.83014)
    assert p.elevation_deg == pytest.approx(39.872046, abs=1e-4)
    assert p.azimuth_deg == pytest.approx(194.340241, abs=1e-4)
    assert p.distance_au == pytest.approx(0.9965422974, abs=3e-6)


def test_example_of_meeus():
    """Meeus, Astronomical Algorithms, example 25.b: 1992 October 13, 0 h TD: -7 47 01.74, 0.99760775 au."""
    tt = dt.datetime(1992, 10, 13, tzinfo=dt.UTC) - dt.timedelta(seconds=58.7)
    # at the pole the elevation is the declination less the parallax of 8.8 arcsec
    p = sun_position(tt, 90.0, 0.0)
    declination = -(7.0 + 47.0 / 60.0 + 1.74 / 3600.0)
    assert p.elevation_deg == pytest.approx(declination - 8.79 / 3600.0, abs=1e-4)
    assert p.distance_au == pytest.approx(0.99760775, abs=1e-6)


def test_calendar_facts():
    # equinox of March 2024: 20 March 03:06 UTC; solstice of June 2024: 20 June 20:51 UTC;
    # the pole sees the declination: mean obliquity 23.4361 + nutation 0.0025, less the parallax 0.0022
    """Equinox, solstice, perihelion or a sunset would be at another time."""
    assert sun_position("2024-03-20T03:06Z", 90.0, 0.0).elevation_deg == pytest.approx(0.0, abs=0.004)
    assert sun_position("2024-06-20T20:51Z", 90.0, 0.0).elevation_deg == pytest.approx(23.4364, abs=0.001)
    # perihelion of 3 January 2024: 0.983307 au
    assert sun_position("2024-01-03T00:39Z", 0.0, 0.0).distance_au == pytest.approx(0.983307, abs=2e-6)
    # sunset at Greenwich on 21 June 2024 is at 21:21 BST: upper limb with 34' of refraction, -0.833 deg
    sunset = sun_position("2024-06-21T21:21:30", 51.4779, 0.0, time_zone="Europe/London")
    assert sunset.elevation_deg == pytest.approx(-0.833, abs=0.12)
    assert 305.0 < sunset.azimuth_deg < 315.0


def test_time_zones_agree():
    """One moment would have two suns."""
    a = sun_position("2003-12-08T16:30", 49.23, 7.0, time_zone="Europe/Berlin")
    b = sun_position("2003-12-08T16:30+01:00", 49.23, 7.0)
    c = sun_position(dt.datetime(2003, 12, 8, 15, 30, tzinfo=dt.UTC), 49.23, 367.0 - 360.0)
    d = sun_position("2003-12-08T15:30:00Z", 49.23, 7.0, time_zone="America/New_York")
    assert a == b == c == d
    summer = parse_time("2003-07-08T16:30", "Europe/Berlin")
    assert summer == dt.datetime(2003, 7, 8, 14, 30, tzinfo=dt.UTC)


def test_sequence_equals_single_times():
    """A film's suns would differ from single ones."""
    times = [f"2003-12-08T{h:02d}:00Z" for h in range(24)]
    many = sun_position(times, 49.23, 7.0)
    assert many.elevation_deg.shape == (24,)
    single = [sun_position(t, 49.23, 7.0) for t in times]
    assert np.array_equal(many.elevation_deg, [s.elevation_deg for s in single])
    assert np.array_equal(many.azimuth_deg, [s.azimuth_deg for s in single])
    # noon declination of 8 December: 90 - 49.23 - 22.7
    assert many.elevation_deg.max() == pytest.approx(90.0 - 49.23 - 22.72, abs=0.25)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("2003-12-08T16:30", 0.0, 0.0), "time zone"),
        (("soon", 0.0, 0.0), "soon"),
        (("2003-12-08T16:30Z", 91.0, 0.0), "latitude_deg"),
        (("2003-12-08T16:30Z", 0.0, 400.0), "longitude_deg"),
        (("2003-12-08T16:30Z", float("nan"), 0.0), "latitude_deg"),
        (("2003-12-08T16:30Z", 0.0, 0.0, 500.0), "altitude_km"),
        (("7000-12-08T16:30Z", 0.0, 0.0), "1000 to 3000"),
        ((5, 0.0, 0.0), "time"),
    ],
)
def test_bad_input_is_one_sentence(arguments, word):
    """A wrong time or place would be a traceback."""
    with pytest.raises(TwilightError, match=word) as caught:
        sun_position(*arguments)
    assert "\n" not in str(caught.value)
