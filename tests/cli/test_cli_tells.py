"""The command line: what it tells without computing a sky."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from rendering import TABLE_NM, call
from typer.testing import CliRunner

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.sections import option_fields
from twilight.cli.app import app
from twilight.cli.options import settings_of
from twilight.config import load


def test_an_option_counts_within_a_section_that_set_replaces():
    """`--disc` beside `--set sun={...}` would be forgotten without a word."""
    given = {
        "sun.disc": (True, "--disc"),
        "output.disc": (None, "--disc"),
        "texture.resolution_deg": (3.0, "--resolution"),
    }
    chosen, names = settings_of(["sun={elevation_deg: 2}", "texture.resolution_deg=5"], given)
    assert load("pure-air", chosen).sun.disc and load("pure-air", chosen).sun.elevation_deg == 2
    assert chosen["texture.resolution_deg"] == 5 and names["sun.disc"] == "--disc"


def test_the_plan_says_how_large_a_scene_is():
    """`--plan` would promise other sizes and times than the scene takes."""
    words = ("--sun-elevation=-4,-5", "--set", "wavelengths={count: 1000}", "--projection", "latlong")
    words += ("--quality", "standard", "--set", "texture.resolution_deg=3", "--size", "2048x1024")
    result = CliRunner().invoke(app, ["render", "pure-air", "--plan", *words])
    assert result.exit_code == 0, result.stderr
    row = result.stdout.splitlines()[-1].split("\t")
    assert row[1:3] == ["2", "1000"]
    blocks, of = (int(number) for number in row[3].split(" of "))
    # wavelengths that the solver treats differently share no block
    assert of <= 128 and 1000 / of <= blocks < 2 * 1000 / of
    assert 0.1 < float(row[7]) <= 1.0 and float(row[7]) + float(row[5]) < float(row[8]) < 2.0
    assert row[4] == "-" and row[9].endswith((" min", " h"))
    # a texture of I, Q and U at 1000 wavelengths is 86 MB; four channels of four bytes, and 8 bits twice, of a pixel
    assert 0.34 < float(row[5]) < 1.0 and float(row[6]) == pytest.approx(24 * 2048 * 1024 / 1e9, rel=0.01)
    small = call("render", "pure-air", "--plan", "--solver", "preetham", "--sun-elevation", "5")
    row = small.stdout.splitlines()[-1].split("\t")
    assert row[1:4] == ["1", "8", "1 of 8"] and row[7:] == ["-", "-", "-"]  # of a formula there is no field


def test_the_plan_of_a_table_says_what_is_left_out(plain, table, tmp_path):
    """A plan would compute, write, or hide what is left out."""
    result = call("render", table, "--plan", "--output", tmp_path / "sky")
    assert result.exit_code == 0 and not (tmp_path / "sky").exists()
    assert "refraction" in result.stdout and "aerosol" not in result.stdout
    assert not plain.calls


def test_the_plan_says_what_is_missing_though_it_matters():
    """A scalar sky, or one without bands, would be taken for a whole one."""

    def rows(*words):
        result = call("render", "pure-air", "--plan", "--sun-elevation", "5", *words)
        assert result.exit_code == 0, result.stderr
        return {
            cells[1]: cells[2:]
            for cells in (line.split("\t") for line in result.stdout.splitlines()[1:] if "\t" in line)
        }

    clean = rows("--solver", "zones", "--set", "wavelengths={list_nm: [450, 550, 670]}")
    assert not {"polarisation", "oxygen at 629 nm"} & clean.keys()
    assert clean["bands of oxygen"][0].startswith("no wavelength of this scene lies in them")
    words = "--solver zones --quality draft --set solver.polarisation=false --set".split()
    scalar = rows(*words, "wavelengths={list_nm: [550, 629, 762, 940]}")
    assert "scalar theory" in scalar["polarisation"][1] and "solver.polarisation: false" in scalar["polarisation"][0]
    assert scalar["oxygen at 629 nm"][0].endswith("holds 629 nm")
    assert not {"bands of oxygen", "bands of water vapour"} & scalar.keys()
    assert rows("--solver", "preetham")["polarisation"] == ["preetham computes radiance alone", "no Q, no U"]


def test_the_scalar_error_of_the_plan_is_that_of_the_table():
    """The plan would quote an error that nobody measured."""
    from twilight.scene.plan import SCALAR_ERROR

    table = Path(__file__).resolve().parents[2] / "benchmarks" / "results" / "polarisation.csv"
    lines = [line for line in table.read_text().splitlines() if not line.startswith("#")]
    rows = [
        row for row in csv.DictReader(lines) if row["quantity"] == "440 nm" and float(row["sun_elevation_deg"]) <= 30
    ]
    medians, largest = ([float(row[key]) for row in rows] for key in ("median", "largest"))
    low, high, most = (
        float(n) for n in re.match(r".*: (\d+) to (\d+) % at 440 nm, up to (\d+) %", SCALAR_ERROR).groups()
    )
    assert (low, high, most) == (round(min(medians)), round(max(medians)), round(max(largest)))


def test_lists_and_descriptions():
    """A list would miss what ships, or an editor's schema take any key."""
    result = call("show", "configs")
    assert result.exit_code == 0
    assert "saarbruecken-2003-12-08\t31\t" in result.stdout
    assert "humidity\t3\t" in result.stdout and "three-climates\t3\t" in result.stdout
    for document in ("climate", "configuration"):
        assert json.loads(call("show", "schema", document).stdout)["additionalProperties"] is False
    assert call("show", "schema", "sky").exit_code == 2


def test_solvers_are_listed_with_their_options(plain):
    """An option would not be found."""
    result = call("show", "solvers")
    assert "plain\tbrightness\t0.01" in result.stdout and "plain (default)\tquality\tstandard, bright" in result.stdout
    assert "cells\tazimuth_cells\t" in result.stdout


def test_every_option_of_every_solver_is_explained(plain):
    """An option would stand without a word of what it is."""
    for name in solvers.SOLVERS:
        options = option_fields(solvers.load(name).QUALITIES["standard"])
        assert all(len(one.description) > 5 for one in options.values()), name
    lines = call("show", "solvers", "zones").stdout.splitlines()
    assert lines[0] == "option\tdraft\tstandard\treference\twhat it is"
    expert = lines.index("solver.expert\tdraft\tstandard\treference\twhat it is")
    assert expert <= 7 and not any(line.startswith("polar_directions") for line in lines[:expert])
    polar = next(line for line in lines if line.startswith("polar_directions"))
    assert "polar_directions\t14\t14\t20\t" in polar and polar.endswith("\tdirections per hemisphere")
    tuned = lines.index("tuned number\tvalue\tunit\tfor air\ttest\twhat it does")
    assert any(line.startswith("RIM_KM\t4.0\tkm\ttop of dust\t") for line in lines[tuned:])
    assert "brightness\t0.01\t0.1\tof the sky above the horizon" in call("show", "solvers", "plain").stdout
    assert "did you mean zones?" in call("show", "solvers", "zons").stderr


def test_show_takes_settings_and_the_shell_completes_names(tmp_path):
    """`show` would ignore `--set`, or the shell know no names."""
    shown = [
        call("show", "pure-air", "--output", tmp_path / "p.png", *more).stdout
        for more in ((), ("--set", "gases.ozone.column_du=150"))
    ]
    ozone = [next(line.split("\t") for line in text.splitlines() if line.startswith("ozone\t")) for text in shown]
    columns = shown[0].splitlines()[1].split("\t")
    at = columns.index("550 nm")
    assert columns[1] == "300 nm" and columns[-1] == "1000 nm"
    assert float(ozone[1][at]) < 0.6 * float(ozone[0][at])
    wrong = call("show", "pure-air", "--set", "gases.ozne=3")
    assert wrong.exit_code == 2 and "did you mean ozone?" in wrong.stderr
    from twilight.cli.options import climate_names, scene_names, solver_names

    assert climate_names("urb") == ["urban"] and "sweep-haze" in scene_names("sw") and solver_names("zo") == ["zones"]
    assert "--show-completion" in call("--help").stdout


def test_show_prints_depths_and_draws_the_profile(table, tmp_path):
    """Printed optical depths would not be those of the medium."""
    result = call("show", table, "--output", tmp_path / "profile.png")
    assert result.exit_code == 0, result.stderr
    lines = dict(line.split("\t", 1) for line in result.stdout.splitlines() if "\t" in line)
    depth = 1e-2 * 60 * (1 - 1e-3) / np.log(1e3)
    assert float(lines["air"].split("\t")[1]) == pytest.approx(depth * (500 / TABLE_NM[1]) ** 4, abs=6e-5)
    assert float(lines["aerosol"].split("\t")[1]) == pytest.approx(5 * depth, abs=6e-5)
    assert lines["scale height of the air"] == f"{60 / np.log(1e3) * (1 - 1e-3):.2f} km"
    assert (tmp_path / "profile.png").read_bytes().startswith(b"\x89PNG")
    assert list(tmp_path.glob(".*")) == []


def test_an_altitude_in_metres_is_said_before_anything_is_computed(monkeypatch):
    """Hours would be computed for an observer above the air, for 2400 m."""
    from twilight.api import light

    def computes(*_):
        raise TwilightError("computes now")

    monkeypatch.setattr(light, "field_for", computes)
    place = ["--latitude", "48", "--longitude", "11", "--altitude-km", "2400"]
    for words, says in (
        (["light", "pure-air", "--at", "2026-06-21T21:00Z"], "is 2400 km, above the air; 2400 m are 2.4 km"),
        (["timeline", "pure-air", "--at", "2026-06-21"], "altitude_km: 2400"),
        (["times", "--date", "2026-06-21"], "altitude_km: 2400"),
    ):
        refused = call(*words, *place)
        assert refused.exit_code == 2 and says in refused.stderr
