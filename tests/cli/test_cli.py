"""The command line from end to end: what a render of one sky writes, and where."""

import json

import numpy as np
import pytest
from rendering import FILES, TABLE_NM, call
from typer.testing import CliRunner

from twilight.cli.app import app
from twilight.io.netcdf import read_sky


def test_a_render_writes_all_files_and_says_where(plain, table, tmp_path):
    """A file of a render would be missing, or its folder not be told."""
    out = tmp_path / "sky"
    result = call("render", table, "--sun-elevation", -4, "--output", out, "--set", "texture={}")
    assert result.exit_code == 0, result.stderr
    assert {p.name for p in out.iterdir()} == FILES | {"skies.jsonl"}
    assert str(out) in result.stdout and "cd m^-2" in result.stdout and "lx" in result.stdout
    sky = read_sky(out / "sky.h5")
    assert sky.wavelength_nm.tolist() == list(TABLE_NM)
    assert sky.sun_elevation_deg == -4
    assert sky.sun_normalised_radiance.shape[2] == 4


def test_the_radiance_lies_where_the_solver_was_asked_for_it(plain, table, tmp_path):
    """Rows and columns of sky.h5 would be of other directions than the solver was asked for."""
    call("render", table, "--sun-elevation", 5, "--output", tmp_path)
    sky = read_sky(tmp_path / "sky.h5")
    assert sky.elevation_deg.tolist() == list(range(5, 90, 10))
    assert sky.azimuth_deg.tolist() == list(range(0, 360, 10))
    e, a = np.meshgrid(sky.elevation_deg, sky.azimuth_deg, indexing="ij")
    level = 0.01 * 10**0.5 * 1e-2 * (500 / sky.wavelength_nm) ** 4
    expected = ((2 + np.cos(np.radians(a))) * (1 + np.cos(np.radians(e))))[..., None] * level
    assert sky.sun_normalised_radiance == pytest.approx(expected, rel=1e-6)


def test_every_file_holds_a_configuration_that_renders_the_same_again(plain, table, tmp_path):
    """A file's record would render another sky, or another table be taken for it."""
    first, second = tmp_path / "first", tmp_path / "second"
    assert call("render", table, "--sun-elevation", -4, "--altitude-km", 2, "--output", first).exit_code == 0
    record = read_sky(first / "sky.h5").provenance
    again = tmp_path / "again.yaml"
    again.write_text(json.dumps(record["configuration"]))
    result = call("render", again, "--output", second)
    assert result.exit_code == 0, result.stderr
    other = read_sky(second / "sky.h5")
    assert other.provenance["hash"] == record["hash"]
    assert other.provenance["configuration"] == record["configuration"]
    assert np.array_equal(other.sun_normalised_radiance, read_sky(first / "sky.h5").sun_normalised_radiance)
    assert record["version"] and record["run_time_s"] > 0 and record["solver"] == "plain"
    text = (tmp_path / "t1.csv").read_text().replace("0.9", "0.8")
    (tmp_path / "t1.csv").write_text(text)
    changed = call("render", again, "--output", second)
    assert changed.exit_code == 2 and "sha256" in changed.stderr
    command = ("render", table, "--sun-elevation", -4, "--altitude-km", 2, "--output", second)
    refused = call(*command)
    assert refused.exit_code == 2 and "medium.sha256 is" in refused.stderr and "--overwrite" in refused.stderr
    assert call(*command, "--overwrite").exit_code == 0
    assert read_sky(second / "sky.h5").provenance["hash"] != record["hash"]


def test_a_black_sky_says_why(plain, table, tmp_path):
    """A black picture would look like a fault of the program."""
    black = ("render", table, "--sun-elevation", "-40", "--output", tmp_path / "out", "--set", "solver.brightness=0")
    result = call(*black)
    assert result.exit_code == 0, result.output
    assert result.stderr.splitlines() == [
        "twilight: the sky is black in every direction: no sunlight reaches it with the sun at -40 deg; add the night "
        "sky with night.airglow=1"
    ]
    faint = call(*black[:-1], "solver.brightness=1e-12", "--overwrite")
    assert faint.exit_code == 0 and "the sky is darker than a thousandth of any night: no sunlight" in faint.stderr
    lit = call(*black[:-1], "solver.brightness=0.01", "--overwrite")
    assert lit.exit_code == 0 and not lit.stderr


def test_a_sun_that_is_not_given_is_announced(plain, table, tmp_path):
    """A sky of 10 deg would be taken for one that was asked for."""
    assert "no sun is given: it stands at +10 deg" in call("render", table, "--output", tmp_path / "a").stderr
    assert not call("render", table, "--output", tmp_path / "b", "--sun-elevation", "10").stderr


def test_only_the_files_asked_for_are_written(plain, table, tmp_path):
    """`--only` would be ignored."""
    result = call("render", table, "--only", "png, h5", "--output", tmp_path / "two")
    assert result.exit_code == 0, result.stderr
    assert {p.name for p in (tmp_path / "two").iterdir()} == {"sky.png", "sky.h5", "skies.jsonl"}
    assert "wrote sky.h5, sky.png to" in result.stdout
    call("render", table, "--set", "output.files=[h5]", "--output", tmp_path / "one")
    assert {p.name for p in (tmp_path / "one").iterdir()} == {"sky.h5", "skies.jsonl"}


def test_options_take_the_place_of_keys(plain, table, tmp_path):
    """An option would not reach the key that it stands for."""
    options = ["--quality", "bright", "--solver", "plain", "--altitude-km", "1.5", "--renderer", "blender"]
    result = call("render", table, *options, "--set", "solver.brightness=0.2", "--output", tmp_path)
    assert result.exit_code == 0, result.stderr
    configuration = read_sky(tmp_path / "sky.h5").provenance["configuration"]
    assert configuration["solver"] == {"name": "plain", "quality": "bright", "brightness": 0.2, "fail_at_deg": 99.0}
    assert configuration["observer"]["altitude_km"] == 1.5 and configuration["output"]["renderer"] == "blender"
    assert plain.calls[0][1] == 1.5


def test_without_an_output_the_files_go_to_a_folder_named_after_scene_and_sun(plain, table, tmp_path, monkeypatch):
    """Two scenes would overwrite each other's files."""
    monkeypatch.chdir(tmp_path)
    for more, folder in ((), "T1_sun-04.00"), (("--set", "ground.albedo=0.5"), "T1_sun-04.00_albedo=0.5"):
        result = CliRunner().invoke(app, ["render", "T1.yaml", "--sun-elevation", "-4", *more])
        assert result.exit_code == 0, result.stderr
        assert (tmp_path / "out" / folder / "sky.h5").is_file()
        assert f"to out/{folder}/\n" in result.stdout
