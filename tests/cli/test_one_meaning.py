"""One input has one meaning, and an option that is accepted does something: times, years, the horizon, commas."""

import ast
import datetime as dt
import inspect
import re
import textwrap
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import twilight
from twilight.atmosphere.csv_columns import read_columns
from twilight.base.conventions import YEARS
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.cli.options import Sets
from twilight.config import load
from twilight.scene.suns import suns_of
from twilight.sky.ephemeris import Sites, sun_position
from twilight.sky.quantities.responses import response
from twilight.sky.twilight_times import time_of, twilight_times
from twilight.studies.camera.response import read_response
from twilight.studies.compare.reference_solution import read_references
from twilight.studies.validate.measured.spectra import read_spectra

CLI = Path(inspect.getfile(Sets)).parent
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
    """An option would be accepted and dropped."""
    function = inspect.unwrap(command.callback)
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    read = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
    assert not set(inspect.signature(function).parameters) - read
    for kind in filter(is_dataclass, get_type_hints(function, include_extras=True).values()):
        home = Path(inspect.getfile(kind)).parent
        text = "".join(path.read_text(encoding="utf-8") for path in home.glob("*.py"))
        hints = get_type_hints(kind, include_extras=True) if home == CLI else {}
        for one in fields(kind):
            sets = any(isinstance(part, Sets) for part in getattr(hints.get(one.name), "__metadata__", ()))
            assert sets or re.search(rf"\.{one.name}\b", text), one.name


def test_the_horizon_dips():
    """Mauna Kea, 4.2 km: arccos(R / (R + h)) = 2.08 deg, 9.8 minutes in June; the dusks stay."""
    day = dt.date(2026, 6, 21)
    low, high = ({e.event: e for e in twilight_times(day, 19.8, -155.5, None, h)} for h in (0.0, 4.2))
    later = (high["sunset"].time - low["sunset"].time).total_seconds() / 60.0
    assert later == pytest.approx(9.8, abs=0.2)
    assert high["sunset"].elevation_deg == pytest.approx(-0.8333 - 2.080, abs=0.01)
    assert abs((high["civil dusk"].time - low["civil dusk"].time).total_seconds()) <= 1.0
    assert (low["sunrise"].time - high["sunrise"].time).total_seconds() / 60.0 == pytest.approx(later, abs=0.3)


def test_options_of_a_command_reach_what_it_calls(monkeypatch):
    """The sunset of `light` from a mountain would be that of the sea: the altitude sets more than a key."""
    given = {}

    def asked(*args, **kwargs):
        given.update(kwargs)
        raise TwilightError("asked")

    monkeypatch.setattr("twilight.api.light.light", asked)
    words = "light urban --at sunset --latitude 48 --longitude 371.5 --altitude-km 3 --quality draft"
    assert "asked" in CliRunner().invoke(app, [*words.split(), "--set", "ground.albedo=0.5"]).stderr
    assert (given["altitude_km"], given["quality"], given["settings"]) == (3.0, "draft", {"ground.albedo": 0.5})


def test_sunset_is_one_moment_everywhere():
    """In a scene, in `light`'s times and in the table of times, for one observer."""
    expected = time_of("2026-06-21 sunset", *PLACE, "Europe/Berlin", 3.0)
    sun = {"at": "2026-06-21 sunset", "latitude_deg": PLACE[0], "longitude_deg": PLACE[1], "time_zone": "Europe/Berlin"}
    config = load({"version": 1, "climate": "pure-air", "sun": sun, "observer": {"altitude_km": 3.0}})
    assert next(suns_of(config)).time == expected
    assert load({"version": 1, "climate": "pure-air", "sun": sun}).sun.at < expected
    from twilight.api.arguments import places_of
    from twilight.api.light import _times

    assert _times("2026-06-21 sunset", places_of(PLACE, "Europe/Berlin")[1], 3.0)[1] == [[expected]]


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
    """One way in would take local time for UTC."""
    with pytest.raises(TwilightError, match=r"time.?zone"):
        ask()


@pytest.mark.parametrize("year", [YEARS[0] - 1, YEARS[1] + 1])
def test_the_same_years_everywhere(year):
    """One way in would compute suns of years in which the ephemeris is wrong."""
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
    """0,25 would be read as two numbers."""
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


LEVELS = """altitude_km,pressure_hpa,temperature_k,water_vapour_ppm,ozone_ppm
0.0,1013.2,288.1,7000.0,0.03\n10.0,265.0,223.3,50.0,0.1\n50.0,0.8,270.7,4.0,3.0\n100.0,0.0003,195.1,1.0,0.5
"""
SPECTRA = "sun_elevation_deg,450.0,550.5,650.0\n-1.0,0.1,0.2,0.3\n-2.5,0.05,0.1,0.15\n"
STORED = "sun_elevation_deg,elevation_deg,azimuth_deg,wavelength_nm,radiance_per_sr,standard_error_per_sr\n"
STORED += "5.0,10.0,0.5,550.0,0.05,0.001\n5.0,10.0,0.5,450.5,0.04,0.001\n"
TABLES = {
    "levels": (LEVELS, lambda path: load({"version": 1, "climate": "pure-air"}, {
        "climate.atmosphere.levels": {"file": str(path)}}).climate.atmosphere.levels.pressure_hpa),
    "response": ("sample,exposure\n0.0,0.0\n0.5,0.2\n1.0,1.0\n", lambda path: read_response(path).exposure),
    "spectra": (SPECTRA, lambda path: np.hstack([read_spectra(path).wavelength_nm, *read_spectra(path).irradiance])),
    "reference": (STORED, lambda path: [one.radiance for one in read_references(path).values()]),
    "skyline": ("azimuth_deg,elevation_deg\n0.0,1.5\n180.0,2.5\n", lambda path: read_columns(path, {
        "azimuth_deg": (-360.0, 360.0, ""), "elevation_deg": (-90.0, 90.0, "")})[1]),
}  # fmt: skip
DRESSES = {
    "BOM": lambda text: b"\xef\xbb\xbf" + text.encode(),
    "CRLF": lambda text: text.replace("\n", "\r\n").encode(),
    "CR": lambda text: text.replace("\n", "\r").encode(),
    "tabulators": lambda text: text.replace(",", "\t").encode(),
    "decimal commas": lambda text: text.replace(",", ";").replace(".", ",").encode(),
    "tabulators and commas": lambda text: text.replace(",", "\t").replace(".", ",").encode(),
    "UTF-16": lambda text: text.replace(",", "\t").encode("utf-16"),
    "quotes": lambda text: re.sub(r"[^,\n]+", r'"\g<0>"', text).encode(),
    "spaces and notes": lambda text: ("# a note\n\n" + text.replace(",", " , ") + "\n\n").encode(),
}


@pytest.mark.parametrize("dress", DRESSES)
@pytest.mark.parametrize("name", TABLES)
def test_one_table_in_every_dress(name, dress, tmp_path):
    """Spreadsheets of several countries and systems write the same numbers in other bytes."""
    text, read = TABLES[name]
    plain, dressed = tmp_path / "plain.csv", tmp_path / "dressed.csv"
    plain.write_text(text)
    dressed.write_bytes(DRESSES[dress](text))
    np.testing.assert_array_equal(np.asarray(read(dressed)), np.asarray(read(plain)))
