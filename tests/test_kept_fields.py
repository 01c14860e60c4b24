"""Solved fields kept on disk: the same sky without solving, within a limit, and never a wrong one."""

import os

import numpy as np
import pytest
from typer.testing import CliRunner

import twilight
from twilight.cli.app import app
from twilight.engine.kept import fields_folder, kept_fields
from twilight.errors import TwilightError
from twilight.solvers.zones.field import Field

SCENE = {
    "sun_elevation_deg": -3.0,
    "wavelength_nm": [550.0],
    "quality": "draft",
    "settings": {"texture.resolution_deg": 30.0},
}


@pytest.fixture
def kept(tmp_path, monkeypatch, coarse_draft):
    """An empty folder of kept fields, and how many fields were solved since."""
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("TWILIGHT_CACHE_GB", "1")
    solved = []
    solve = Field._solve

    def counted(self, *args, **kwargs):
        solved.append(self)
        return solve(self, *args, **kwargs)

    monkeypatch.setattr(Field, "_solve", counted)
    return solved


def files():
    return sorted(fields_folder().glob("*"))


def test_the_second_render_reads_what_the_first_has_solved(kept):
    first = twilight.render("pure-air", **SCENE)
    again = twilight.render("pure-air", **SCENE)
    assert len(kept) == 1 and len(files()) == 1
    np.testing.assert_array_equal(again.sun_normalised_radiance, first.sun_normalised_radiance)
    np.testing.assert_array_equal(again.direct_irradiance, first.direct_irradiance)
    assert again.provenance["field_from_disk"] and "field_from_disk" not in first.provenance
    assert again.provenance["convergence"] == first.provenance["convergence"]


def test_whatever_enters_makes_another_field(kept):
    twilight.render("pure-air", **SCENE)
    changes = [
        {"sun_elevation_deg": -3.001},
        {"wavelength_nm": [550.001]},
        {"altitude_km": 0.001},
        {"settings": {"ground.albedo": 0.1501}},
        {"settings": {"gases.ozone.column_du": 334.0}},
        {"settings": {"solver.max_events": 7}},
    ]
    for number, change in enumerate(changes, start=2):
        settings = SCENE["settings"] | change.get("settings", {})
        twilight.render("pure-air", **(SCENE | change | {"settings": settings}))
        assert len(kept) == number and len(files()) == number, change


def test_a_damaged_field_is_solved_again(kept):
    first = twilight.render("pure-air", **SCENE)
    (path,) = files()
    whole = bytearray(path.read_bytes())
    for damaged in (whole[:1000], whole[: len(whole) // 2] + bytes(2000) + whole[len(whole) // 2 + 2000 :], b""):
        path.write_bytes(damaged)
        again = twilight.render("pure-air", **SCENE)
        np.testing.assert_array_equal(again.sun_normalised_radiance, first.sun_normalised_radiance)
    assert len(kept) == 4
    twilight.render("pure-air", **SCENE)
    assert len(kept) == 4


def test_the_field_used_longest_ago_goes_first(kept, monkeypatch):
    for index, sun in enumerate((-1.0, -2.0)):
        twilight.render("pure-air", **(SCENE | {"sun_elevation_deg": sun}))
        for path in files():
            os.utime(path, (1e9 + index, path.stat().st_mtime if index else 1e9))
    twilight.render("pure-air", **(SCENE | {"sun_elevation_deg": -1.0}))  # read: now the latest
    assert len(kept) == 2
    monkeypatch.setenv("TWILIGHT_CACHE_GB", str(2.5e-9 * files()[0].stat().st_size))
    twilight.render("pure-air", **SCENE)
    assert len(files()) == 2
    twilight.render("pure-air", **(SCENE | {"sun_elevation_deg": -1.0}))
    assert len(kept) == 3


def test_a_folder_that_cannot_be_written_costs_nothing_but_time(kept, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path / "file"))
    twilight.render("pure-air", **SCENE)
    twilight.render("pure-air", **SCENE)
    assert len(kept) == 2


def test_none_are_kept_where_the_limit_is_0(kept, monkeypatch):
    monkeypatch.setenv("TWILIGHT_CACHE_GB", "0")
    assert kept_fields() is None
    twilight.render("pure-air", **SCENE)
    assert not files()


@pytest.mark.parametrize("text", ["much", "-1", "inf", "nan"])
def test_a_limit_must_be_a_number(monkeypatch, text):
    monkeypatch.setenv("TWILIGHT_CACHE_GB", text)
    with pytest.raises(TwilightError, match=r"TWILIGHT_CACHE_GB: is .* allowed is a number of gigabytes"):
        kept_fields()


def test_the_command_shows_and_clears(kept):
    twilight.render("pure-air", **SCENE)
    shown = CliRunner().invoke(app, ["cache"])
    assert shown.exit_code == 0 and shown.output.startswith("1 field of ") and "the limit is 1 GB" in shown.output
    cleared = CliRunner().invoke(app, ["cache", "--clear"])
    assert cleared.exit_code == 0 and cleared.output.startswith("removed 1 field of ") and not files()
