import gc
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path
from shutil import copyfile

import h5netcdf
import numpy as np
import pytest
import xarray
from toy_sky import glow_sky

from twilight import __version__
from twilight.base.errors import TwilightError
from twilight.io import read_sky, whole_file, write_outputs, write_sky
from twilight.io.provenance import configuration_hash, provenance_fields, provenance_from_fields
from twilight.io.series import on_one_grid, write_series
from twilight.sky.sky import Sky


def full_sky():
    sky = glow_sky(
        sun_elevation_deg=-4.25,
        sun_azimuth_deg=231.7,
        apparent_sun_elevation_deg=-3.9,
        distance_au=0.985,
        observer_altitude_km=0.23,
        latitude_deg=49.23,
        longitude_deg=7.0,
        time=datetime(2003, 12, 8, 16, 50, 1, tzinfo=timezone(timedelta(hours=1))),
        ground_albedo=np.linspace(0.1, 0.3, 7),
        direct_irradiance=np.linspace(0.0, 0.2, 7),
        provenance={
            "configuration": {"version": 1, "name": "T1", "medium": {"table": "t1.csv"}, "ü": [1.5, None]},
            "version": __version__, "hash": "ab" * 32, "run_time_s": 12.25, "solver": "toy",
        },
    )  # fmt: skip
    return replace(sky, standard_error=0.01 * sky.sun_normalised_radiance)


def test_h5_comes_back_bit_for_bit(tmp_path):
    """A field of a sky would be lost in its file."""
    sky = full_sky()
    back = read_sky(write_sky(sky, tmp_path / "sky.h5"))
    for key in Sky.__dataclass_fields__:
        before, after = getattr(sky, key), getattr(back, key)
        if isinstance(before, np.ndarray):
            assert before.dtype == after.dtype, key
            np.testing.assert_array_equal(before, after, err_msg=key)
        else:
            assert before == after, key


def test_h5_of_the_least_sky_comes_back(tmp_path):
    """What a sky has not would come back as something."""
    sky = Sky([550.0], [45.0], [0.0], np.full((1, 1, 1), 1e-9, dtype=np.float32), -12.0)
    back = read_sky(write_sky(sky, tmp_path / "sky.h5"))
    assert back.sun_normalised_radiance.dtype == np.float32
    assert back.sun_azimuth_deg is None and back.time is None and back.standard_error is None
    np.testing.assert_array_equal(back.sun_normalised_radiance, sky.sun_normalised_radiance)


def test_h5_opens_in_xarray_with_names_units_and_chunks(tmp_path):
    """xarray would find other names, units or chunks."""
    sky = full_sky()
    path = write_sky(sky, tmp_path / "sky.h5")
    with xarray.open_dataset(path, engine="h5netcdf") as data:
        assert data["radiance"].dims == ("elevation", "azimuth", "wavelength")
        assert data["radiance"].attrs["units"] == "W m-2 nm-1 sr-1"
        assert data["sun_normalised_radiance"].attrs["units"] == "sr-1"
        assert data["sun_normalised_radiance"].attrs["ancillary_variables"] == "standard_error"
        assert data["luminance"].attrs["units"] == "cd m-2"
        assert data["wavelength"].attrs["standard_name"] == "radiation_wavelength"
        assert float(data["solar_elevation_angle"]) == -4.25
        assert data["radiance"].encoding["chunksizes"] == (30, 120, 1)
        assert data["radiance"].encoding["zlib"]
        product = data["sun_normalised_radiance"] * data["solar_irradiance"]
        np.testing.assert_array_equal(product.transpose(*data["radiance"].dims), data["radiance"])
        assert data.attrs["run_time_s"] == 12.25 and data.attrs["twilight_version"] == __version__
        assert data.attrs["configuration_hash"] == "ab" * 32
        assert '"name": "T1"' in data.attrs["configuration"]
        assert data["time"].values == np.datetime64("2003-12-08T15:50:01")


def test_h5_takes_a_configuration_longer_than_an_hdf5_attribute_may_be(tmp_path):
    """A long configuration would be cut."""
    provenance = {"configuration": {"table": list(range(30_000))}}
    sky = glow_sky(provenance=provenance)
    back = read_sky(write_sky(sky, tmp_path / "sky.h5"))
    assert back.provenance["configuration"] == provenance["configuration"]


def test_h5_follows_the_cf_conventions(tmp_path):
    # The checker insists on the suffix; the content is the same file.
    """Tools that rely on CF would misread the file."""
    for name, sky in (("full", full_sky()), ("small", glow_sky(wavelength_nm=(550.0,)))):
        copyfile(write_sky(sky, tmp_path / "sky.h5"), tmp_path / f"{name}.nc")
    names = [str(tmp_path / f"{name}.nc") for name in ("full", "small")]
    command = [sys.executable, str(Path(sys.executable).with_name("compliance-checker")), "--test=cf:1.11"]
    done = subprocess.run([*command, "--criteria=strict", *names], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("All tests passed!") == 2, done.stdout


@pytest.mark.parametrize("keep", [0.0, 0.01, 0.5, 0.999])
def test_a_truncated_h5_is_refused_in_one_sentence(tmp_path, keep):
    """A download cut off would be a traceback of HDF5."""
    path = write_sky(full_sky(), tmp_path / "sky.h5")
    data = path.read_bytes()
    path.write_bytes(data[: int(keep * len(data))])
    with pytest.raises(TwilightError, match=r"sky\.h5: is not a complete HDF5 file") as caught:
        read_sky(path)
    assert "\n" not in str(caught.value)


def test_other_files_are_refused_by_name(tmp_path):
    """Another file would be a KeyError."""
    with pytest.raises(TwilightError, match="no such file"):
        read_sky(tmp_path / "none.h5")
    other = tmp_path / "other.h5"
    xarray.Dataset({"x": ("y", [1.0])}).to_netcdf(other, engine="h5netcdf")
    with pytest.raises(TwilightError, match="has no variable 'elevation'"):
        read_sky(other)


def test_a_file_is_whole_or_what_it_was(tmp_path):
    """A writer that fails would leave half a file."""
    path = tmp_path / "a.txt"
    path.write_text("before")
    with pytest.raises(RuntimeError), whole_file(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "before"
    with whole_file(path) as temporary:
        temporary.write_text("after")
        assert path.read_text() == "before" and temporary.suffix == ".txt"
    assert path.read_text() == "after"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    with pytest.raises(TwilightError, match="folder does not exist"), whole_file(tmp_path / "no" / "a.txt"):
        pass


@pytest.mark.parametrize(
    "work", ["write", *(pytest.param(work, marks=pytest.mark.slow) for work in ("read", "series"))]
)
def test_an_interrupt_within_the_library_says_nothing_of_its_own(tmp_path, monkeypatch, work):
    """A half made file of h5netcdf would print from its `__del__`."""
    code, path = h5netcdf.File.__init__.__code__, tmp_path / "a.h5"
    sky = glow_sky(step_deg=30.0, wavelength_nm=(500.0, 550.0))
    write_sky(sky, path)
    works = {
        "write": lambda: write_sky(sky, path),
        "read": lambda: read_sky(path),
        "series": lambda: write_series([sky], path, {}, 1),
    }
    before, printed, reached = path.read_bytes(), [], 0
    monkeypatch.setattr(sys, "unraisablehook", lambda found: printed.append(repr(found.exc_value)))
    traced, ran = sys.gettrace(), {}

    def run(stop):
        """The work, interrupted at a line of the constructor; None: the lines that it runs are noted."""

        def at_line(frame, event, argument):
            if event == "line":
                ran[frame.f_lineno] = True
                if frame.f_lineno == stop:
                    raise KeyboardInterrupt
            return at_line

        sys.settrace(lambda frame, event, argument: at_line if frame.f_code is code else None)
        try:
            works[work]()
        finally:
            sys.settrace(traced)

    run(None)
    for stop in [*ran][::3]:
        write_sky(sky, path)
        with suppress(KeyboardInterrupt):
            run(stop)
            raise AssertionError("was not interrupted")
        reached += 1
        assert [p.name for p in tmp_path.iterdir()] == ["a.h5"] and path.read_bytes() == before
        gc.collect()
    assert reached > 8 and not printed, printed[:3]


def test_provenance_fields_come_back_and_default_to_the_configuration_hash():
    """A record would be lost, or its hash depend on the order of keys."""
    provenance = {"configuration": {"b": 1, "a": np.float64(2.5)}, "solver": "x", "run_time_s": 3}
    fields = provenance_fields(provenance)
    assert fields["configuration_hash"] == configuration_hash({"a": 2.5, "b": 1})
    assert fields["twilight_version"] == __version__
    back = provenance_from_fields(fields)
    assert back["configuration"] == {"a": 2.5, "b": 1} and back["solver"] == "x" and back["run_time_s"] == 3.0
    with pytest.raises(TwilightError, match="JSON"):
        provenance_fields({"x": object()})


def test_outputs_are_written_together(tmp_path):
    """A file would be missing, or one there that nobody asked for; Radiance reads its own format."""
    sky = full_sky()
    paths = write_outputs(sky, tmp_path / "new" / "folder", width=64, spectral_width=32, views=("panorama", "fisheye"))
    names = [p.name for p in paths]
    assert names == ["sky.png", "sky.fisheye.png", "sky.rgb.exr", "sky.spectral.exr", "sky.h5", "sun.json", "sky.usda"]
    assert sorted(names) == sorted(p.name for p in (tmp_path / "new" / "folder").iterdir())
    paths = write_outputs(glow_sky(), tmp_path, files=("rgb",), renderer="radiance", width=16)
    assert [p.name for p in paths] == ["sky.rgb.exr", "sky.rgb.hdr"]


def test_skies_on_one_grid_keep_their_edges():
    """In the series of a hill light 0.05 deg above its horizon was the ground's: rows closer than 0.08 deg were one."""
    skies = []
    for shift in (0.0, 0.013):
        rows = np.concatenate([np.linspace(-90.0, -3.0, 30), [-2.01, -2.0003, -1.9997, -1.99, -1.97 + shift]])
        rows = np.concatenate([rows, -1.9 + shift + 91.8 * np.linspace(0.0, 1.0, 40) ** 2])
        rows, columns = rows[rows <= 90.0], np.arange(0.0, 360.0, 30.0)
        light = np.where(rows < -2.0, 0.02, 1.0) * np.exp(0.01 * rows)
        light = np.broadcast_to(light[:, None, None], (rows.size, columns.size, 1)).copy()
        skies.append(Sky(np.array([550.0]), rows, columns, light, -3.0 + shift))
    e = -2.0 + np.array([-0.4, -0.03, -0.005, 0.005, 0.03, 0.06, 0.4])
    for before, after in zip(skies, on_one_grid(skies), strict=True):
        np.testing.assert_allclose(after.sample(e, 40.0), before.sample(e, 40.0), rtol=2e-3)
