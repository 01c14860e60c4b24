"""The command line: renders of several skies, their table, dataset and numbered files."""

import csv
from datetime import datetime

import numpy as np
import pytest
from PIL import Image
from rendering import FILES, SHEETS, PlainField, call

from twilight.io.netcdf import read_sky


def test_many_suns_prepare_once_and_each_frame_has_its_folder(plain, table, tmp_path):
    """A field would be solved for every sun, or frames share a folder."""
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
    """Table, dataset and numbered pictures would be of other skies than the folders."""
    import xarray

    import twilight.api.accessor  # noqa: F401 - registers .sky

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
    """What was finished would be computed again, or another sky taken for it."""
    computed = []
    real = PlainField.radiance

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        computed.append(sun_elevation_deg)
        if computed == [5, 0, -5]:
            raise KeyboardInterrupt
        return real(self, sun_elevation_deg, elevation_deg, azimuth_deg)

    monkeypatch.setattr(PlainField, "radiance", radiance)
    command = ("render", table, "--sun-elevation=5,0,-5", "--output", tmp_path / "out")
    assert call(*command).exit_code == 130 and computed == [5, 0, -5]
    again = call(*command)
    assert again.exit_code == 0 and computed == [5, 0, -5, -5]
    assert "2 of 3 were there already" in again.stderr and len(again.stdout.splitlines()) == 5
    assert call(*command).stdout == again.stdout and computed == [5, 0, -5, -5]
    refused = call(*command, "--set", "ground.albedo=0.5")
    assert refused.exit_code == 2 and "(ground.albedo is 0.0, asked is 0.5)" in refused.stderr
    fewer = call("render", table, "--sun-elevation=5,0", "--output", tmp_path / "out")
    assert fewer.exit_code == 2 and "sun-05.00: holds a sky that is not part of this render" in fewer.stderr
    assert call("render", table, "--sun-elevation=5,0", "--output", tmp_path / "out", "--overwrite").exit_code == 0
    assert not (tmp_path / "out" / "sun-05.00").exists() and len(list((tmp_path / "out" / "frames").iterdir())) == 4


def test_one_exposure_for_a_series_keeps_the_night_dark(plain, table, tmp_path):
    """A night would be shown as bright as a day."""

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


def test_what_is_finished_stays_when_a_later_frame_fails(plain, table, tmp_path):
    """One frame that fails would take the finished ones with it."""
    out = tmp_path / "evening"
    settings = ["--set", "sun={elevations_deg: [5, 0, -5]}", "--set", "solver.fail_at_deg=0"]
    result = call("render", table, *settings, "--output", out)
    assert result.exit_code == 2
    assert result.stderr.splitlines()[-1].startswith("twilight: plain: a sun at 0")
    assert {p.name for p in out.iterdir()} == {"sun+05.00", "skies.jsonl"}
    assert {p.name for p in (out / "sun+05.00").iterdir()} == FILES


def test_a_series_of_a_key_has_one_folder_for_each_value(plain, table, tmp_path):
    """Values of a series would overwrite each other."""
    out = tmp_path / "series"
    result = call("render", table, "--sun-elevation", 3, "--set", "vary={ground.albedo: [0, 0.5]}", "--output", out)
    assert result.exit_code == 0, result.stderr
    assert {p.name for p in out.iterdir()} == {"albedo=0", "albedo=0.5", "frames", *SHEETS}
    assert read_sky(out / "albedo=0.5" / "sky.h5").ground_albedo.tolist() == [0.5] * 4


def test_an_evening_is_one_file_where_one_is_asked_for(plain, table, tmp_path):
    """The one file would hold other numbers than the folders, or suns in another order."""
    from twilight import open_dataset, read_sky

    suns = ["--set", "texture={}", "--set", "texture.resolution_deg=6", "--sun-elevation=5,0,-5"]
    out = tmp_path / "new" / "evening.nc"
    result = call("render", table, *suns, "--output", out)
    assert result.exit_code == 0, result.stderr
    assert [p.name for p in tmp_path.joinpath("new").iterdir()] == [
        "evening.nc"
    ] and f"3 suns to {out}" in result.stdout
    assert len(plain.calls) == 1 and len(result.stdout.splitlines()) == 5
    assert call("render", table, *suns, "--only", "h5", "--output", tmp_path / "many").exit_code == 0
    with open_dataset(out) as data:
        assert data.sun_elevation_deg.values.tolist() == [5.0, 0.0, -5.0]
        for sun, name in ((5.0, "sun+05.00"), (-5.0, "sun-05.00")):
            sky, one = data.sky.scene(sun_elevation_deg=sun), read_sky(tmp_path / "many" / name / "sky.h5")
            read = one.sample(sky.elevation_deg[:, None], sky.azimuth_deg) * one.solar_irradiance
            assert np.allclose(sky.radiance, read, rtol=1e-5) and np.array_equal(sky.ground_albedo, one.ground_albedo)
            assert sky.provenance["configuration"]["climate"]["name"] == "T1" and sky.provenance["solver"] == "plain"
    again = call("render", table, *suns, "--output", out)
    assert again.exit_code == 2 and f"{out}: is there already; give --overwrite" in again.stderr
    assert call("render", table, *suns, "--output", out, "--overwrite").exit_code == 0
    start = ["--set", "sun={start: 2026-06-21T20:00, stop: 2026-06-21T21:00, step_minutes: 30, time_zone: UTC, "
             "latitude_deg: 52, longitude_deg: 13}"]  # fmt: skip
    assert call("render", table, *suns[:4], *start, "--output", tmp_path / "times.nc").exit_code == 0
    with open_dataset(tmp_path / "times.nc") as data:
        assert data.time.values.astype("datetime64[m]").tolist() == [
            datetime(2026, 6, 21, 20), datetime(2026, 6, 21, 20, 30), datetime(2026, 6, 21, 21)
        ]  # fmt: skip
        assert data.sky.illuminance_lux().dims == ("time",) and data.solar_azimuth_angle.dims == ("time",)
