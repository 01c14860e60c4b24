"""One input has one meaning, and an option that is accepted does something: times, years, the horizon, commas."""

import ast
import datetime as dt
import inspect
import textwrap
from pathlib import Path

import numpy as np
import pytest
import typer
from click.testing import CliRunner

import twilight
from twilight.base.conventions import YEARS
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config import load
from twilight.config.sun import SunAt
from twilight.scene.suns import suns_of
from twilight.sky.ephemeris import Sites, sun_position
from twilight.sky.quantities.responses import response
from twilight.sky.twilight_times import time_of, twilight_times
from twilight.studies.camera.response import read_response

AS_MET = Path("../shared/data/files_as_met")
PLACE = (48.1, 11.5)
COMMANDS = typer.main.get_command(app)


def commands(group=COMMANDS, before=()):
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*before, name))
        else:
            yield pytest.param(command, id=" ".join((*before, name)))


@pytest.mark.parametrize("command", commands())
def test_every_option_is_used(command):
    """Each parameter of a command's function is read in its body: none is accepted and dropped."""
    function = inspect.unwrap(command.callback)
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    read = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
    assert not set(inspect.signature(function).parameters) - read


def printed(*arguments):
    result = CliRunner().invoke(COMMANDS, [str(one) for one in arguments])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_every_option_of_times_changes_what_it_prints():
    base = {"--latitude": 19.8, "--longitude": -155.5, "--date": "2026-06-21", "--time-zone": "UTC", "--altitude-km": 0}
    other = {"--latitude": 25, "--longitude": 11, "--date": "2026-07-21", "--time-zone": "Pacific/Honolulu",
             "--altitude-km": 4.2}  # fmt: skip
    known = {name for one in COMMANDS.commands["times"].params for name in one.opts} - {"--help"}
    assert known == set(base)

    def table(options):
        return printed("times", *(text for pair in options.items() for text in pair))

    for name, value in other.items():
        assert table(base | {name: value}) != table(base), name


def test_the_horizon_dips():
    """Mauna Kea, 4.2 km: arccos(R / (R + h)) = 2.08 deg, 9.8 minutes in June; the dusks are the elevation's alone."""
    day = dt.date(2026, 6, 21)
    low, high = ({e.event: e for e in twilight_times(day, 19.8, -155.5, None, h)} for h in (0.0, 4.2))
    later = (high["sunset"].time - low["sunset"].time).total_seconds() / 60.0
    assert later == pytest.approx(9.8, abs=0.2)
    assert high["sunset"].elevation_deg == pytest.approx(-0.8333 - 2.080, abs=0.01)
    assert abs((high["civil dusk"].time - low["civil dusk"].time).total_seconds()) <= 1.0
    assert (low["sunrise"].time - high["sunrise"].time).total_seconds() / 60.0 == pytest.approx(later, abs=0.3)


def test_sunset_is_one_moment_everywhere():
    """In a scene, in `light`'s times and in the table of times, for one observer."""
    expected = time_of("2026-06-21 sunset", *PLACE, "Europe/Berlin", 3.0)
    sun = {"at": "2026-06-21 sunset", "latitude_deg": PLACE[0], "longitude_deg": PLACE[1], "time_zone": "Europe/Berlin"}
    config = load({"version": 1, "climate": "pure-air", "sun": sun, "observer": {"altitude_km": 3.0}})
    assert next(suns_of(config)).time == expected
    assert load({"version": 1, "climate": "pure-air", "sun": sun}).sun.at < expected
    from twilight.api.light import _Places, _times

    assert _times("2026-06-21 sunset", _Places.of(PLACE, "Europe/Berlin"), 3.0)[1] == [expected]


NO_ZONE = "2026-06-21T21:00"


@pytest.mark.parametrize(
    "ask",
    [
        lambda: load({"version": 1, "climate": "pure-air",
                      "sun": {"at": NO_ZONE, "latitude_deg": PLACE[0], "longitude_deg": PLACE[1]}}),
        lambda: twilight.render("pure-air", at=NO_ZONE, place=PLACE),
        lambda: twilight.light(PLACE, NO_ZONE, climate="pure-air"),
        lambda: twilight.light(PLACE, dt.datetime(2026, 6, 21, 21), climate="pure-air"),
        lambda: twilight.light(PLACE, np.datetime64(NO_ZONE), climate="pure-air"),
        lambda: sun_position(NO_ZONE, *PLACE),
    ],
)  # fmt: skip
def test_a_time_without_a_zone_is_refused_everywhere(ask):
    with pytest.raises(TwilightError, match=r"time.?zone"):
        ask()


@pytest.mark.parametrize("command", [["light"], ["timeline", "--start"], ["render"], ["climate", "from", "x.txt"]])
def test_commands_refuse_a_time_without_a_zone(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    place = ["--latitude", "48.1", "--longitude", "11.5"]
    words = {
        "light": ["light", "pure-air", "--at", NO_ZONE, *place],
        "timeline": ["timeline", "pure-air", "--at", "2026-06-21", "--start", NO_ZONE, *place],
        "render": ["render", "pure-air", "--at", NO_ZONE, *place],
        "climate": ["climate", "from", "x.txt", "--at", NO_ZONE, *place],
    }[command[0]]
    result = CliRunner().invoke(COMMANDS, words)
    assert result.exit_code == 2 and "zone" in result.stderr and not list(tmp_path.iterdir())


@pytest.mark.parametrize("year", [YEARS[0] - 1, YEARS[1] + 1])
def test_the_same_years_everywhere(year):
    text = f"{year:04d}-06-21T12:00+00:00"
    moment = dt.datetime.fromisoformat(text)
    years = rf"outside the years {YEARS[0]} to {YEARS[1]}"
    for ask in (
        lambda: sun_position(text, *PLACE),
        lambda: Sites([moment], *PLACE),
        lambda: twilight_times(moment.date(), *PLACE),
        lambda: twilight.light(PLACE, text, climate="pure-air"),
        lambda: load({"version": 1, "climate": "pure-air",
                      "sun": {"at": text, "latitude_deg": PLACE[0], "longitude_deg": PLACE[1]}}),
    ):  # fmt: skip
        with pytest.raises(TwilightError, match=years):
            ask()
    last = min(max(year, YEARS[0]), YEARS[1])
    for date in (dt.date(last, 1, 1), dt.date(last, 12, 31)):
        assert all(event.time is not None for event in twilight_times(date, 20.0, 0.0))


# Decimal commas


def test_tables_with_semicolons_and_decimal_commas(tmp_path):
    path = tmp_path / "mine.csv"
    for text in ("wavelength_nm;response\n500;0,25\n550,5;1\n", "500\t0,25\n550,5\t1,0\n", "500,0.25\n550.5,1\n"):
        path.write_text(text)
        response.__globals__["_named"].cache_clear()
        found = response(str(path))
        np.testing.assert_allclose(found.wavelength_nm, [500.0, 550.5])
        np.testing.assert_allclose(found.value, [0.25, 1.0])
    path.write_text("sample;exposure\n0;0\n0,5;0,2\n1;1\n")
    np.testing.assert_allclose(read_response(path).exposure[:, 0], [0.0, 0.2, 1.0])
    path.write_text("sample,exposure\n0,0\n0,5,0,2\n1,1\n")  # which comma is which?
    with pytest.raises(TwilightError, match=r"line 3 has 4 values, expected 2; .*semicolons separate"):
        read_response(path)
    path.write_text("500,0,25\n550,1,0\n")
    response.__globals__["_named"].cache_clear()
    with pytest.raises(TwilightError, match=r"needs two columns of numbers|line 2: needs two numbers"):
        response(str(path))


def test_the_response_as_met():
    if not AS_MET.is_dir():
        pytest.skip(f"{AS_MET} is not here")
    found = response(str(AS_MET / "resp-de.csv"))
    assert found.wavelength_nm[[0, -1]].tolist() == [400.0, 700.0] and found.value.max() == pytest.approx(0.9931)


def test_sun_at_names_the_years():
    with pytest.raises(ValueError, match="outside the years 1000 to 3000"):
        SunAt(at="0999-06-21T12:00+00:00", latitude_deg=0, longitude_deg=0)
