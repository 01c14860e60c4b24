"""The command line from end to end, with a solver that is cheap enough to run often."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import types
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from twilight import solvers
from twilight.cli.app import app
from twilight.errors import TwilightError
from twilight.io.netcdf import read_sky
from twilight.solvers.base import BareField, Capabilities

SHEETS = {"contact-sheet.png", "series.csv", "series.nc", "skies.jsonl"}
FILES = {"sky.png", "sky.rgb.exr", "sky.spectral.exr", "sky.h5"}
TABLE = "altitude_km,wavelength_nm,air_scattering_per_km,aerosol_extinction_per_km,aerosol_single_scattering_albedo,"
TABLE += "aerosol_asymmetry,absorption_per_km,refractivity\n"
TABLE_NM = (420, 500, 580, 660)


@dataclass(frozen=True)
class PlainSettings:
    """brightness: of the sky above the horizon towards the sun [sr^-1]
    fail_at_deg: a sun that cannot be computed
    """

    brightness: float = 0.01
    fail_at_deg: float = 99.0


class PlainField(BareField):
    """A sky that falls off with the angle from the sun's azimuth; its level is the medium's air at the ground."""

    def __init__(self, medium, settings, altitude_km):
        self.medium, self.settings, self.altitude_km = medium, settings, altitude_km

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        if sun_elevation_deg == self.settings.fail_at_deg:
            raise TwilightError(f"plain: a sun at {sun_elevation_deg} deg cannot be computed")
        level = self.settings.brightness * 10 ** (sun_elevation_deg / 10.0) * self.medium.air_scattering_per_km[0]
        shape = (2.0 + np.cos(np.radians(azimuth_deg))) * (1.0 + np.cos(np.radians(elevation_deg)))
        return shape[..., None] * level


@pytest.fixture
def plain(monkeypatch):
    """A registered solver `plain`; `calls` lists what `prepare` was asked for."""
    module = types.ModuleType("plain_solver")
    module.calls = []

    def prepare(medium, settings, *, observer_altitude_km=0.0, progress=None):
        module.calls.append((medium.wavelength_nm.tolist(), observer_altitude_km))
        if progress is not None:
            progress("half", 0.5)
        return PlainField(medium, settings, observer_altitude_km)

    module.prepare = prepare
    module.CAPABILITIES = Capabilities()
    module.QUALITIES = {"standard": PlainSettings(), "bright": PlainSettings(brightness=0.1)}
    monkeypatch.setitem(sys.modules, "plain_solver", module)
    monkeypatch.setitem(solvers.SOLVERS, "plain", "plain_solver")
    monkeypatch.setattr(solvers, "DEFAULT", "plain")
    return module


@pytest.fixture
def table(tmp_path):
    """The tabulated climate of the interface between programs, two levels."""
    rows = [
        f"{z},{w},{1e-2 * s * (500 / w) ** 4},{5e-2 * s},0.9,0.7,0,0\n"
        for z, s in ((0, 1), (60, 1e-3))
        for w in TABLE_NM
    ]
    (tmp_path / "t1.csv").write_text(TABLE + "".join(rows))
    path = tmp_path / "T1.yaml"
    path.write_text("version: 1\nname: T1\nmedium: {table: t1.csv}\nground: {albedo: 0.0}\n")
    return path


SMALL = ["texture={azimuth_count: 36, elevation_count: 9}", "output.width=64", "output.spectral_width=32"]


def call(command, *arguments):
    """Run a command; renders are small unless a test says otherwise."""
    small = (
        [word for key in SMALL for word in ("--set", key)]
        if command == "render" and "texture={}" not in arguments
        else []
    )
    result = CliRunner().invoke(app, [command, *(str(a) for a in arguments), *small])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def test_a_render_writes_all_files_and_says_where(plain, table, tmp_path):
    out = tmp_path / "sky"
    result = call("render", table, "--sun-elevation", -4, "--output", out, "--set", "texture={}")
    assert result.exit_code == 0, result.stderr
    assert {p.name for p in out.iterdir()} == FILES | {"skies.jsonl"}
    assert str(out) in result.stdout and "cd m^-2" in result.stdout and "lx" in result.stdout
    sky = read_sky(out / "sky.h5")
    assert sky.wavelength_nm.tolist() == list(TABLE_NM)
    assert sky.sun_elevation_deg == -4
    assert sky.sun_normalised_radiance.shape == (30, 120, 4)


def test_the_radiance_lies_where_the_solver_was_asked_for_it(plain, table, tmp_path):
    call("render", table, "--sun-elevation", 5, "--output", tmp_path)
    sky = read_sky(tmp_path / "sky.h5")
    assert sky.elevation_deg.tolist() == list(range(5, 90, 10))
    assert sky.azimuth_deg.tolist() == list(range(0, 360, 10))
    e, a = np.meshgrid(sky.elevation_deg, sky.azimuth_deg, indexing="ij")
    level = 0.01 * 10**0.5 * 1e-2 * (500 / sky.wavelength_nm) ** 4
    expected = ((2 + np.cos(np.radians(a))) * (1 + np.cos(np.radians(e))))[..., None] * level
    assert sky.sun_normalised_radiance == pytest.approx(expected, rel=1e-6)


def test_every_file_holds_a_configuration_that_renders_the_same_again(plain, table, tmp_path):
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


def test_many_suns_prepare_once_and_each_frame_has_its_folder(plain, table, tmp_path):
    out = tmp_path / "evening"
    suns = "sun={elevations_deg: [5, 0, -5]}"
    result = call("render", table, "--set", suns, "--output", out)
    assert result.exit_code == 0, result.stderr
    assert len(plain.calls) == 1
    folders = {p.name for p in out.iterdir()}
    assert folders == {"sun+05.00", "sun+00.00", "sun-05.00", "frames", *SHEETS}
    assert all({p.name for p in (out / f).iterdir()} == FILES for f in folders if f.startswith("sun"))
    means = [
        read_sky(out / f / "sky.h5").sun_normalised_radiance.mean() for f in ("sun+05.00", "sun+00.00", "sun-05.00")
    ]
    assert means[1] / means[0] == pytest.approx(10**-0.5, rel=1e-5) == means[2] / means[1]
    assert read_sky(out / "sun-05.00" / "sky.h5").provenance["configuration"]["sun"]["elevation_deg"] == -5


def test_a_series_is_a_table_a_dataset_and_numbered_files(plain, table, tmp_path):
    import csv

    import xarray

    import twilight.accessor  # noqa: F401 - registers .sky

    out = tmp_path / "evening"
    result = call("render", table, "--sun-elevation=5,0,-5", "--output", out)
    assert result.exit_code == 0, result.stderr
    rows = list(csv.DictReader(open(out / "series.csv")))
    skies = [read_sky(out / f / "sky.h5") for f in ("sun+05.00", "sun+00.00", "sun-05.00")]
    assert [float(r["sun_elevation_deg"]) for r in rows] == [5, 0, -5]
    for row, sky in zip(rows, skies, strict=True):
        assert float(row["zenith_luminance_cd_per_m2"]) == pytest.approx(sky.luminance_at(90.0))
        assert float(row["zenith_magnitude_v_per_arcsec2"]) == pytest.approx(sky.magnitude())
        assert float(row["sky_illuminance_lux"]) == pytest.approx(sky.illuminance_lux())
    with xarray.open_dataset(out / "series.nc", engine="h5netcdf") as data:
        assert np.array_equal(data.sun_normalised_radiance[1], skies[1].sun_normalised_radiance)
        assert data.solar_elevation_angle.values.tolist() == [5, 0, -5]
        assert np.allclose(data.sky.illuminance_lux(), [s.illuminance_lux() for s in skies])
    frames = {p.name: p.read_bytes() for p in (out / "frames").iterdir()}
    assert sorted(frames) == [f"sky.{i:04d}.png" for i in (1, 2, 3)] + [f"sky.rgb.{i:04d}.exr" for i in (1, 2, 3)]
    assert frames["sky.rgb.0003.exr"] == (out / "sun-05.00" / "sky.rgb.exr").read_bytes()
    head, first, *_ = result.stdout.splitlines()
    assert head.split("\t")[1:3] == ["sun [deg]", "zenith [cd m^-2]"]
    assert all(np.isfinite(float(cell)) for cell in first.split("\t")[1:])


def test_an_interrupted_series_goes_on_and_says_what_was_there(plain, table, tmp_path, monkeypatch):
    looked = []
    real = PlainField.radiance

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        looked.append(sun_elevation_deg)
        if looked == [5, 0, -5]:
            raise KeyboardInterrupt
        return real(self, sun_elevation_deg, elevation_deg, azimuth_deg)

    monkeypatch.setattr(PlainField, "radiance", radiance)
    command = ("render", table, "--sun-elevation=5,0,-5", "--output", tmp_path / "out")
    assert call(*command).exit_code == 130 and looked == [5, 0, -5]
    again = call(*command)
    assert again.exit_code == 0 and looked == [5, 0, -5, -5]
    assert "2 of 3 were there already" in again.stderr and len(again.stdout.splitlines()) == 5
    assert call(*command).stdout == again.stdout and looked == [5, 0, -5, -5]
    refused = call(*command, "--set", "ground.albedo=0.5")
    assert refused.exit_code == 2 and "(ground.albedo is 0.0, asked is 0.5)" in refused.stderr
    fewer = call("render", table, "--sun-elevation=5,0", "--output", tmp_path / "out")
    assert fewer.exit_code == 2 and "sun-05.00: holds a sky that is not part of this render" in fewer.stderr
    assert call("render", table, "--sun-elevation=5,0", "--output", tmp_path / "out", "--overwrite").exit_code == 0
    assert not (tmp_path / "out" / "sun-05.00").exists() and len(list((tmp_path / "out" / "frames").iterdir())) == 4


def test_one_exposure_for_a_series_keeps_the_night_dark(plain, table, tmp_path):
    from PIL import Image

    def means(*more):
        out = tmp_path / f"out{len(more)}{more[-1] if more else ''}"
        result = call("render", table, "--sun-elevation=5,-10", "--output", out, *more)
        assert result.exit_code == 0, result.stderr
        assert call("render", table, "--sun-elevation=5,-10", "--output", out, *more).stderr.count("2 of 2 were there")
        return [np.asarray(Image.open(out / f / "sky.png"))[:40].mean() for f in ("sun+05.00", "sun-10.00")]

    each, series, fixed = means(), means("--exposure", "series"), means("--exposure", "12")
    assert abs(each[0] - each[1]) < 3
    assert series[0] == pytest.approx(each[0], abs=3) and series[1] < 0.6 * series[0]
    assert fixed[1] < fixed[0]
    wrong = call("render", table, "--exposure", "bright")
    assert wrong.exit_code == 2 and "--exposure: bright must be" in wrong.stderr


def test_a_black_sky_says_why(plain, table, tmp_path):
    black = ("render", table, "--sun-elevation", "-40", "--output", tmp_path / "out", "--set", "solver.brightness=0")
    result = call(*black)
    assert result.exit_code == 0, result.output
    assert result.stderr.splitlines() == [
        "twilight: the sky is black in every direction: no sunlight reaches it with the sun at -40 deg; add the night "
        "sky with night.airglow=1"
    ]


def test_a_sun_that_is_not_given_is_announced(plain, table, tmp_path):
    assert "no sun is given: it stands at +10 deg" in call("render", table, "--output", tmp_path / "a").stderr
    assert not call("render", table, "--output", tmp_path / "b", "--sun-elevation", "10").stderr


def test_what_is_finished_stays_when_a_later_frame_fails(plain, table, tmp_path):
    out = tmp_path / "evening"
    settings = ["--set", "sun={elevations_deg: [5, 0, -5]}", "--set", "solver.fail_at_deg=0"]
    result = call("render", table, *settings, "--output", out)
    assert result.exit_code == 2
    assert result.stderr.startswith("twilight: plain: a sun at 0")
    assert {p.name for p in out.iterdir()} == {"sun+05.00", "skies.jsonl"}
    assert {p.name for p in (out / "sun+05.00").iterdir()} == FILES


def test_a_series_of_a_key_has_one_folder_for_each_value(plain, table, tmp_path):
    out = tmp_path / "series"
    result = call("render", table, "--sun-elevation", 3, "--set", "vary={ground.albedo: [0, 0.5]}", "--output", out)
    assert result.exit_code == 0, result.stderr
    assert {p.name for p in out.iterdir()} == {"albedo=0", "albedo=0.5", "frames", *SHEETS}
    assert read_sky(out / "albedo=0.5" / "sky.h5").ground_albedo.tolist() == [0.5] * 4


def test_many_wavelengths_go_in_blocks_and_give_the_same(plain, table, tmp_path, monkeypatch):
    call("render", table, "--output", tmp_path / "whole")
    monkeypatch.setattr(plain, "CAPABILITIES", Capabilities(wavelengths_at_once=3))
    call("render", table, "--output", tmp_path / "blocks")
    assert [len(w) for w, _ in plain.calls] == [4, 3, 1]
    whole, blocks = (read_sky(tmp_path / name / "sky.h5") for name in ("whole", "blocks"))
    assert np.array_equal(whole.sun_normalised_radiance, blocks.sun_normalised_radiance)
    assert np.array_equal(whole.direct_irradiance, blocks.direct_irradiance)


def test_only_the_files_asked_for_are_written(plain, table, tmp_path):
    result = call("render", table, "--only", "png, h5", "--output", tmp_path / "two")
    assert result.exit_code == 0, result.stderr
    assert {p.name for p in (tmp_path / "two").iterdir()} == {"sky.png", "sky.h5", "skies.jsonl"}
    assert "wrote sky.h5, sky.png to" in result.stdout
    call("render", table, "--set", "output.files=[h5]", "--output", tmp_path / "one")
    assert {p.name for p in (tmp_path / "one").iterdir()} == {"sky.h5", "skies.jsonl"}


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            ["--only", "png,jpg"],
            "--only: output.files holds 'jpg', which is not a file of a render; allowed are png, rgb",
        ),
        (["--only", "png,png"], "lists the same file twice"),
        (
            ["--only", "polarisation"],
            "output.files: polarisation needs polarised light, and plain (standard) computes none",
        ),
        (["--polariser", "30"], "output.polariser_deg needs polarised light"),
        (["--polariser", "300"], "--polariser: output.polariser_deg must be a number from -180"),
    ],
)
def test_files_that_cannot_be_are_refused_before_anything_is_computed(plain, table, tmp_path, options, says):
    result = call("render", table, *options, "--output", tmp_path / "out")
    assert result.exit_code == 2 and says in result.stderr, result.stderr
    assert not plain.calls and not (tmp_path / "out").exists()


def test_a_latitude_longitude_width_is_computed_direction_by_direction(plain, table):
    from twilight.config import load
    from twilight.engine import frames

    frame = next(iter(frames(load(table, {"texture.latlong_width": 16, "sun.elevation_deg": 5}))))
    assert frame.panorama is not None
    assert frame.panorama.sun_normalised_radiance.shape == (4, 16, 4)
    assert frame.panorama.elevation_deg.tolist() == [11.25, 33.75, 56.25, 78.75]
    e, a = np.meshgrid(frame.panorama.elevation_deg, frame.panorama.azimuth_deg, indexing="ij")
    expected = (2 + np.cos(np.radians(a))) * (1 + np.cos(np.radians(e)))
    ratio = frame.panorama.sun_normalised_radiance[..., 0] / expected
    assert ratio == pytest.approx(np.full_like(ratio, ratio[0, 0]))


def test_options_take_the_place_of_keys(plain, table, tmp_path):
    options = ["--quality", "bright", "--solver", "plain", "--altitude-km", "1.5", "--target", "blender"]
    result = call("render", table, *options, "--set", "solver.brightness=0.2", "--output", tmp_path)
    assert result.exit_code == 0, result.stderr
    configuration = read_sky(tmp_path / "sky.h5").provenance["configuration"]
    assert configuration["solver"] == {"name": "plain", "quality": "bright", "brightness": 0.2, "fail_at_deg": 99.0}
    assert configuration["observer"]["altitude_km"] == 1.5 and configuration["output"]["target"] == "blender"
    assert plain.calls[0][1] == 1.5


def test_without_an_output_the_files_go_to_a_folder_named_after_scene_and_sun(plain, table, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for more, folder in ((), "T1_sun-04.00"), (("--set", "ground.albedo=0.5"), "T1_sun-04.00_albedo=0.5"):
        result = CliRunner().invoke(app, ["render", "T1.yaml", "--sun-elevation", "-4", *more])
        assert result.exit_code == 0, result.stderr
        assert (tmp_path / "out" / folder / "sky.h5").is_file()
        assert f"to out/{folder}/\n" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["nowhere.yaml"], ["nowhere.yaml", "no such file"]),
        (["continetal-average"], ["did you mean continental-average?"]),
        (["{table}", "--sun-elevation", "95"], ["--sun-elevation", "-90 to 90", "95"]),
        (["{table}", "--sun-elevation", "nan"], ["--sun-elevation", "nan"]),
        (["{table}", "--at", "2003-12-08T16:00"], ["--at", "--latitude", "--longitude"]),
        (["{table}", "--latitude", "3"], ["--at"]),
        (["{table}", "--sun-elevation", "3", "--at", "2003-12-08T16:00"], ["--sun-elevation", "--at"]),
        (["{table}", "--at", "16:00", "--latitude", "3", "--longitude", "4"], ["--at", "sun.at", "2003-12-08T16:00"]),
        (["{table}", "--altitude-km", "-1"], ["--altitude-km", "observer.altitude_km", "0 to 40000"]),
        (["{table}", "--solver", "cels"], ["--solver", "cells"]),
        (["{table}", "--quality", "brigt"], ["--quality", "did you mean bright?"]),
        (["{table}", "--target", "maya"], ["--target", "output.target", "mitsuba"]),
        (
            ["{table}", "--target-stderr", "0.1", "--solver", "cells"],
            ["--target-stderr: cells", "add --solver montecarlo"],
        ),
        (["{table}", "--target-error", "0.1", "--solver", "plain"], ["--target-error: plain", "add --solver zones"]),
        (["{table}", "--set", "albedo"], ["--set albedo", "key=value"]),
        (["{table}", "--set", "solver.name=[plain]"], ["--set solver.name", "not a solver"]),
        (["{table}", "--set", "solver.quality={}"], ["--set solver.quality", "bright"]),
        (["{table}", "--set", "solver=plain"], ["--set solver", "a mapping"]),
        (["{table}", "--set", "sun.elevations_deg=[]"], ["sun.elevations_deg must hold at least 1 value, got 0"]),
        (["{table}", "--set", "sun={elevation_deg: 3, at: 2003-12-08T16:00}"], ["only one of at, elevation_deg"]),
        (["{table}", "--set", "climate=null"], ["--set climate", "the name of a climate"]),
        (["{table}", "--set", "climate=urbna"], ["--set climate", "did you mean urban?"]),
        (["{table}", "--set", "ground.albedo.x=1"], ["--set ground.albedo.x: ground.albedo holds no keys"]),
        (["{table}", "--set", "medium.table=t2.csv"], ["--set medium.table", "no file t2.csv"]),
        (["{table}", "--set", "ground.albdo=1"], ["--set ground.albdo", "did you mean albedo?"]),
        (["{table}", "--set", "solver.brightness=much"], ["--set solver.brightness", "a number", "'much'"]),
        (["{table}", "--sun-elevation", "3", "--set", "wavelengths={list_nm: [300, 400]}"], ["t1.csv", "420"]),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(plain, table, tmp_path, arguments, parts):
    out = tmp_path / "sky"
    result = call("render", *(str(table) if a == "{table}" else a for a in arguments), "--output", out)
    assert result.exit_code == 2
    assert result.stderr.startswith("twilight: ") and len(result.stderr.strip().splitlines()) == 1
    for part in parts:
        assert part in result.stderr
    assert not out.exists()


def test_a_table_that_is_missing_or_broken_is_named(plain, table, tmp_path):
    (tmp_path / "t1.csv").write_text("altitude_km,wavelength_nm\n0,500\n")
    result = call("render", table, "--output", tmp_path / "sky")
    assert result.exit_code == 2 and "t1.csv" in result.stderr
    (tmp_path / "t1.csv").unlink()
    result = call("render", table, "--output", tmp_path / "sky")
    assert result.exit_code == 2 and "T1.yaml: medium.table: there is no file" in result.stderr


def test_an_output_that_cannot_be_a_folder_is_named(plain, table, tmp_path):
    (tmp_path / "file").write_text("")
    result = call("render", table, "--output", tmp_path / "file")
    assert result.exit_code == 2 and str(tmp_path / "file") in result.stderr


def test_an_output_that_cannot_be_written_is_refused_before_anything_is_computed(plain, table, tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "sub"):
        result = call("render", table, "--output", folder)
        assert result.exit_code == 2 and str(folder) in result.stderr and "not a folder" in result.stderr
    for name in ("file/profile.png", "profile.svg"):
        result = call("describe", table, "--output", tmp_path / name)
        assert result.exit_code == 2 and len(result.stderr.strip().splitlines()) == 1
    assert not plain.calls
    assert {p.name for p in tmp_path.iterdir()} == {"file", "t1.csv", "T1.yaml"}


def test_a_sky_larger_than_the_memory_is_refused(plain, tmp_path):
    huge = ["--set", "texture={azimuth_count: 7200, elevation_count: 1800}", "--set", "wavelengths.count=2000"]
    result = CliRunner().invoke(app, ["render", "pure-air", *huge, "--output", str(tmp_path / "sky")])
    assert result.exit_code == 2, result.output
    assert "2000 wavelengths" in result.stderr and "GB" in result.stderr and "texture.resolution_deg" in result.stderr
    assert not plain.calls and not (tmp_path / "sky").exists()


def test_null_is_a_value_of_set(plain):
    result = call("render", "urban", "--plan", "--set", "aerosol=null")
    assert result.exit_code == 0 and "the climate has none" in result.stdout
    result = call("render", "urban", "--plan", "--set", "sun.elevation_deg=null")
    assert result.exit_code == 2 and "got null" in result.stderr


def test_time_left_is_at_the_mean_speed():
    from twilight.cli.terminal import time_left

    assert time_left(0.25, 1200.0) == "1:00:00 left"
    assert time_left(0.5, 65.0) == "0:01:05 left"
    assert time_left(0.09, 5.0) == "-:--:-- left"


def test_an_interrupt_during_imports_gives_no_traceback(tmp_path):
    (tmp_path / "typer.py").write_text("raise KeyboardInterrupt\n")
    program = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from twilight.cli import main; main()"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 130 and result.stderr == "twilight: interrupted\n"


def test_an_interrupt_leaves_with_130_and_no_half_files(plain, table, tmp_path, monkeypatch):
    def interrupted(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        raise KeyboardInterrupt

    monkeypatch.setattr(PlainField, "radiance", interrupted)
    result = call("render", table, "--output", tmp_path / "sky")
    assert result.exit_code == 130 and "Traceback" not in result.stderr
    assert not (tmp_path / "sky").exists()


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signals_end_a_render_cleanly(table, tmp_path, number, code):
    program = (
        "import os, signal, sys\n"
        "import types\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell's background job ignores\n"
        "from twilight import engine, solvers\n"
        "from twilight.solvers.base import Capabilities\n"
        "from twilight.cli.app import app\n"
        "from dataclasses import make_dataclass\n"
        "qualities = {'standard': make_dataclass('Settings', [])()}\n"
        "plain = types.SimpleNamespace(CAPABILITIES=Capabilities(), QUALITIES=qualities)\n"
        "solvers.load = lambda name: plain\n"
        "def frames(config, progress=None, wanted=None):\n"
        f"    os.kill(os.getpid(), {int(number)})\n"
        "    for _ in range(10**9): pass\n"
        "    yield\n"
        "engine.frames = frames\n"
        "app(['render', *sys.argv[1:]])\n"
    )
    command = [sys.executable, "-c", program, str(table), "--output", str(tmp_path / "sky")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert result.returncode == code
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "sky").exists()


def test_the_plan_of_a_table_says_what_is_left_out(plain, table, tmp_path):
    result = call("render", table, "--plan", "--output", tmp_path / "sky")
    assert result.exit_code == 0 and not (tmp_path / "sky").exists()
    assert "refraction" in result.stdout and "aerosol" not in result.stdout
    assert not plain.calls


def test_the_plan_says_what_is_missing_though_it_matters():
    def rows(*words):
        result = call("render", "pure-air", "--plan", "--sun-elevation", "5", *words)
        assert result.exit_code == 0, result.stderr
        return {cells[1]: cells[2:] for cells in (line.split("\t") for line in result.stdout.splitlines()[1:])}

    clean = rows("--solver", "zones", "--set", "wavelengths={list_nm: [450, 550, 670]}")
    assert not {"polarisation", "oxygen at 629 nm"} & clean.keys()
    assert clean["bands of oxygen"][0].startswith("no wavelength of this scene lies in them")
    scalar = rows("--solver", "zones", "--quality", "draft", "--set", "wavelengths={list_nm: [550, 629, 762, 940]}")
    assert "scalar theory" in scalar["polarisation"][1] and "solver.polarisation: false" in scalar["polarisation"][0]
    assert scalar["oxygen at 629 nm"][0].endswith("holds 629 nm")
    assert not {"bands of oxygen", "bands of water vapour"} & scalar.keys()
    assert rows("--solver", "preetham")["polarisation"] == ["preetham computes radiance alone", "no Q, no U"]


def test_the_scalar_error_of_the_plan_is_that_of_the_table():
    import csv
    import re

    from twilight.scene.plan import SCALAR_ERROR

    table = Path(__file__).resolve().parents[1] / "benchmarks" / "polarisation.csv"
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
    result = call("configs")
    assert result.exit_code == 0
    assert "saarbruecken-2003-12-08\t31\t" in result.stdout
    assert "humidity\t3\t" in result.stdout and "three-climates\t3\t" in result.stdout
    for document in ("climate", "configuration"):
        assert json.loads(call("schema", document).stdout)["additionalProperties"] is False
    assert call("schema", "sky").exit_code == 2


def test_solvers_are_listed_with_their_options(plain):
    result = call("solvers")
    assert "plain\tbrightness\t0.01" in result.stdout and "plain (default)\tquality\tstandard, bright" in result.stdout
    assert "cells\tazimuth_cells\t" in result.stdout


def test_every_option_of_every_solver_is_explained(plain):
    from dataclasses import fields

    from twilight.config.solver import explain_options

    for name in [name for name in solvers.SOLVERS if name != "plain"]:
        settings = type(solvers.load(name).QUALITIES["standard"])
        why = explain_options(settings)
        assert set(why) == {f.name for f in fields(settings)}, name
        assert all(len(text) > 5 and ": " not in text[:3] for text in why.values()), name
    lines = call("solvers", "zones").stdout.splitlines()
    assert lines[0] == "option\tdraft\tstandard\treference\twhat it is"
    assert "polar_directions\t9\t14\t" in lines[2] and lines[2].endswith("\tdirections per hemisphere")
    assert "brightness\t0.01\t0.1\tof the sky above the horizon" in call("solvers", "plain").stdout
    assert "did you mean zones?" in call("solvers", "zons").stderr


def test_suggestions_are_of_the_kind_asked_for():
    for command, kind, other in (("describe", "climates are", "sweep-haze"), ("sweep", "configurations are", "urban")):
        refused = call(command, "nowhere")
        assert refused.exit_code == 2 and kind in refused.stderr
        assert "did you mean" not in refused.stderr and other not in refused.stderr
    assert "did you mean sweep-haze?" in call("sweep", "sweep-hase").stderr
    either = call("render", "nowhere").stderr
    assert "climates are antarctic" in either and "configurations are compare" in either


def test_describe_takes_settings_and_the_shell_completes_names(tmp_path):
    shown = [
        call("describe", "pure-air", "--output", tmp_path / "p.png", *more).stdout
        for more in ((), ("--set", "gases.ozone.column_du=150"))
    ]
    ozone = [next(line.split("\t") for line in text.splitlines() if line.startswith("ozone\t")) for text in shown]
    columns = shown[0].splitlines()[1].split("\t")
    at = columns.index("550 nm")
    assert columns[1] == "300 nm" and columns[-1] == "1000 nm"
    assert float(ozone[1][at]) < 0.6 * float(ozone[0][at])
    wrong = call("describe", "pure-air", "--set", "gases.ozne=3")
    assert wrong.exit_code == 2 and "did you mean ozone?" in wrong.stderr
    from twilight.cli.options import climate_names, scene_names, solver_names

    assert climate_names("urb") == ["urban"] and "sweep-haze" in scene_names("sw") and solver_names("zo") == ["zones"]
    assert "--show-completion" in call("--help").stdout


def test_describe_prints_depths_and_draws_the_profile(table, tmp_path):
    result = call("describe", table, "--output", tmp_path / "profile.png")
    assert result.exit_code == 0, result.stderr
    lines = dict(line.split("\t", 1) for line in result.stdout.splitlines() if "\t" in line)
    depth = 1e-2 * 60 * (1 - 1e-3) / np.log(1e3)
    assert float(lines["air"].split("\t")[1]) == pytest.approx(depth, abs=6e-5)
    assert float(lines["aerosol"].split("\t")[1]) == pytest.approx(5 * depth, abs=6e-5)
    assert lines["scale height of the air"] == f"{60 / np.log(1e3) * (1 - 1e-3):.2f} km"
    assert (tmp_path / "profile.png").read_bytes().startswith(b"\x89PNG")
    assert list(tmp_path.glob(".*")) == []


def test_version_and_help():
    from twilight import __version__

    assert __version__ in call("--version").stdout
    assert "render" in call("--help").stdout


def test_a_picture_sheet_of_a_missing_picture_is_refused(tmp_path):
    from twilight.plotting import contact_sheet

    with pytest.raises(TwilightError, match=r"sheet.png"):
        contact_sheet([("a", Path(tmp_path / "none.png"))], tmp_path / "sheet.png")
    assert list(tmp_path.iterdir()) == []
