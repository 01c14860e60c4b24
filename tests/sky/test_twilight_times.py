"""Times of twilight: against another program, on days without them, and as configurations and commands take them."""

import datetime as dt
import itertools

import pytest
from typer.testing import CliRunner

from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config import load
from twilight.scene.suns import suns_of
from twilight.sky.ephemeris import Sites, sun_position
from twilight.sky.twilight_times import EVENTS, SUNRISE_DEG, moon_times, time_of, twilight_times

OF_NREL = [
    (51.48, 0.0, "05:13:13", "12:01:00", "18:49:53"),
    (28.3, -16.5, "06:45:06", "13:06:59", "19:29:18"),
    (-33.9, 18.4, "05:05:57", "10:47:25", "16:28:24"),
    (64.1, -21.9, "06:10:18", "13:28:35", "20:48:52"),
]
"""Latitude, longitude; sunrise, transit and sunset (UTC) on 2026-04-11 by NREL's own search for them (Reda & Andreas
2008, NREL/TP-560-34302, section A.2; by `sun_rise_set_transit_spa` of pvlib 0.16.1)."""
BERLIN = {"latitude_deg": 52.5, "longitude_deg": 13.4, "time_zone": "Europe/Berlin"}


@pytest.mark.parametrize("row", OF_NREL)
def test_sunrise_noon_and_sunset_are_those_of_nrel(row):
    """Sunrise would be off NREL's by more than 3 s."""
    latitude, longitude, *clocks = row
    found = {one.event: one.time for one in twilight_times(dt.date(2026, 4, 11), latitude, longitude)}
    # the sun stands highest up to half a minute from the meridian, while its declination changes
    for name, clock, seconds in zip(("sunrise", "solar noon", "sunset"), clocks, (3.0, 40.0, 3.0), strict=True):
        theirs = dt.datetime.fromisoformat(f"2026-04-11T{clock}Z")
        assert abs((found[name] - theirs).total_seconds()) < seconds, name


def test_events_stand_in_the_order_of_a_day_and_at_their_elevations():
    """A dusk would be at another sun than its name says."""
    rows = twilight_times(dt.date(2026, 3, 1), 52.5, 13.4, "Europe/Berlin")
    assert [row.event for row in rows] == list(EVENTS)
    times = [row.time for row in rows]
    assert all(a is not None and b is not None and a < b for a, b in itertools.pairwise(times))
    for row in rows:
        assert row.time is not None and row.time.date() == dt.date(2026, 3, 1)
        wanted = EVENTS[row.event][1]
        assert wanted is None or sun_position(row.time, 52.5, 13.4).elevation_deg == pytest.approx(wanted, abs=3e-3)


@pytest.mark.parametrize(
    ("latitude", "date", "missing"),
    [
        (52.5, "2026-06-21", {"astronomical dawn", "astronomical dusk"}),
        (69.6, "2026-12-21", {"sunrise", "sunset"}),
        (78.2, "2026-06-21", set(EVENTS) - {"solar noon"}),
        (90.0, "2026-12-21", set(EVENTS) - {"solar noon"}),
    ],
)
def test_what_a_day_does_not_have(latitude, date, missing):
    """A summer night in the north would have an astronomical dusk."""
    rows = twilight_times(dt.date.fromisoformat(date), latitude, 18.9, "Europe/Oslo")
    assert {row.event for row in rows if row.time is None} == missing
    with pytest.raises(TwilightError, match=rf"there is no {sorted(missing)[0]} on {date}"):
        time_of(f"{date} {sorted(missing)[0]}", latitude, 18.9, "Europe/Oslo")


def test_a_date_is_that_of_the_clocks_of_the_place():
    """East of the date line and west of it, and where clocks are far from the sun."""
    for zone, longitude in (("Pacific/Kiritimati", -157.4), ("Pacific/Niue", -169.9), ("Asia/Shanghai", 87.6)):
        for event in ("sunrise", "sunset"):
            assert time_of(f"2026-09-20 {event}", 10.0, longitude, zone).date() == dt.date(2026, 9, 20)


@pytest.mark.parametrize(
    ("at", "expected"),
    [
        ("2026-06-21 civil dusk", -6.0), ("2026-06-21 Sunset", -0.8333), ("2026-06-21 dusk -4", -4.0),
        ("2026-06-21 dawn 3.5 deg", 3.5), ("civil dawn", -6.0),
    ],
)  # fmt: skip
def test_a_configuration_takes_a_twilight_for_a_time(at, expected):
    """`at: civil dusk` would be another sun."""
    (sun,) = suns_of(load("pure-air", {"sun": {"at": at, **BERLIN}}))
    assert sun.elevation_deg == pytest.approx(expected, abs=3e-3)
    assert sun.azimuth_deg is not None and (sun.azimuth_deg < 180.0) == ("dawn" in at)


@pytest.mark.parametrize(
    ("at", "utc"),
    [
        ("2016-12-31T23:59:60Z", "2017-01-01T00:00:00"),
        ("2026-06-21T24:00", "2026-06-21T22:00:00"),
        ("2026-06-21T24:00:00+03:00", "2026-06-21T21:00:00"),
    ],
)
def test_the_end_of_a_day_and_a_leap_second_are_understood(at, utc):
    """24:00 or a leap second would be refused, or be another day."""
    (sun,) = suns_of(load("pure-air", {"sun": {"at": at, **BERLIN}}))
    assert sun.time.astimezone(dt.UTC).replace(tzinfo=None) == dt.datetime.fromisoformat(utc)


def test_the_command_lists_them():
    """The table would miss an event."""
    words = "times --date 2026-06-21 --latitude 52.52 --longitude 13.41 --time-zone Europe/Berlin"
    made = CliRunner().invoke(app, words.split())
    assert made.exit_code == 0
    lines = made.output.splitlines()
    assert len(lines) == 1 + len(EVENTS) + 2 and {line.split("\t")[0] for line in lines[-2:]} == {"moonrise", "moonset"}
    assert lines[4].split("\t")[:4] == ["sunrise", "2026-06-21 04:43:05+02:00", "-0.83", "47.7"]
    assert "the sun does not get there" in lines[1]


def test_render_plans_a_date_and_an_elevation():
    """A date with an elevation would be another sun."""
    place = ["--latitude", "52.5", "--longitude", "13.4", "--time-zone", "Europe/Berlin", "--plan"]
    made = CliRunner().invoke(app, ["render", "pure-air", "--at", "2026-06-21", "--sun-elevation", "-6", *place])
    assert made.exit_code == 0, made.output
    made = CliRunner().invoke(app, ["render", "pure-air", "--at", "2026-06-21T20:00", "--sun-elevation", "-6", *place])
    assert made.exit_code == 2 and "on a date" in made.output


def test_moonrise_and_moonset_are_where_its_limb_is_on_the_horizon():
    """The moon would rise at another time; days without a rise or a set, and poles, would fail."""
    found = {one.event: one.time for one in moon_times(dt.date(2026, 6, 21), 52.5, 13.4, "UTC")}
    for event, moment in found.items():
        site = Sites([moment], 52.5, 13.4)
        assert float(site.moon().elevation_deg[0]) == pytest.approx(SUNRISE_DEG, abs=0.02), event
        later = Sites([moment + dt.timedelta(minutes=10)], 52.5, 13.4).moon().elevation_deg[0]
        assert (later > SUNRISE_DEG) == (event == "moonrise")
    counts = [
        len([one for one in moon_times(dt.date(2026, 6, day), 52.5, 13.4) if one.event == "moonrise"])
        for day in range(1, 31)
    ]
    assert set(counts) == {0, 1} and counts.count(0) <= 2
    assert sum(len(moon_times(dt.date(2026, 6, day), 90.0, 0.0)) for day in range(1, 29)) in (1, 2)  # once a month
