"""Several processes, no locks, damaged and foreign files: nothing is lost, nothing of others is run."""

import errno
import os
import pickle
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from closed_sky import closed
from toy_sky import glow_sky

import twilight
from twilight.base import cache
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.io.folder import JOURNAL, RequestedSky, open_folder
from twilight.io.journal import locked
from twilight.io.netcdf import write_sky
from twilight.studies.compare.bench import WORKER

FAST = {"solver": "preetham", "settings": {"texture.resolution_deg": 15, "wavelengths.list_nm": [450, 550, 650]}}
WANTED = {"": RequestedSky("hash", {})}


def test_a_refused_render_leaves_the_folder_of_the_first_alone(tmp_path):
    """A second render would take the journal of the first away, which has not finished a sky."""
    with open_folder(tmp_path / "out", WANTED, "1", overwrite=False) as first:
        first.begin("", WANTED[""])
        before = {path: path.read_bytes() for path in (tmp_path / "out").rglob("*")}
        for overwrite in (False, True):
            with pytest.raises(TwilightError, match="another render is writing it"):
                with open_folder(tmp_path / "out", WANTED, "1", overwrite=overwrite):
                    pass
        assert {path: path.read_bytes() for path in (tmp_path / "out").rglob("*")} == before
        write_sky(glow_sky(step_deg=30.0), tmp_path / "out" / "sky.h5")
        first.add("", WANTED[""], [tmp_path / "out" / "sky.h5"], {"a": 1})
        assert first.file_names() == {"": ["sky.h5"]}
    with open_folder(tmp_path / "out", WANTED, "1", overwrite=False) as again:
        assert again.finished == {"": {"a": 1}}


def test_a_journal_that_was_removed_while_it_was_opened_is_not_written(tmp_path, monkeypatch):
    """Whoever opens the journal of a render that ends without a sky would write to a file that is no longer there."""
    import fcntl

    lock = fcntl.flock

    def flock(file, how):
        lock(file, how)
        (tmp_path / JOURNAL).unlink()

    monkeypatch.setattr(fcntl, "flock", flock)
    with pytest.raises(TwilightError, match="try again"), locked(tmp_path / JOURNAL, "another render"):
        pass


@pytest.mark.parametrize("code", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL])
def test_a_file_system_without_locks_is_one_warning(tmp_path, monkeypatch, code):
    """It would be taken for another render."""
    import fcntl

    def flock(*_):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(fcntl, "flock", flock)
    with (
        pytest.warns(TwilightWarning, match="has no locks"),
        open_folder(tmp_path, WANTED, "1", overwrite=False) as made,
    ):
        made.begin("", WANTED[""])


def test_a_field_and_skies_go_to_other_processes():
    """What a worker is handed would be a traceback of pickle's."""
    field = twilight.solve("pure-air", **FAST)
    again = pickle.loads(pickle.dumps(field))
    assert np.array_equal(again.radiance(30.0, 40.0, 50.0), field.radiance(30.0, 40.0, 50.0))
    series = twilight.render("pure-air", sun_elevation_deg=[20, 30], **FAST)
    copy = pickle.loads(pickle.dumps(series))
    assert np.array_equal(copy[1].radiance, series[1].radiance) and copy[1].provenance == series[1].provenance
    air = pickle.loads(pickle.dumps(field.medium))
    assert np.array_equal(air.optical_depth(), field.medium.optical_depth())
    with pytest.raises(TwilightError, match="hand over the climate"):
        pickle.dumps(closed("no configuration"))


def damaged():
    """What is left of an archive of arrays."""
    made = bytearray()
    yield bytes(made)
    yield b"PK\x03\x04 and no archive"
    yield b"\x93NUMPY"
    yield None
    yield "middle"


def test_a_damaged_file_of_the_skies_cache_is_made_again(tmp_path, monkeypatch):
    """It would be a traceback until the cache is cleared."""
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("TWILIGHT_CACHE_GB", "1")
    good = {"lines": np.ones((4, 3), np.float32)}
    for damage in damaged():
        cache.store_arrays(cache.SKIES, "key", good)
        path = cache.path_of(cache.SKIES, "key")
        whole = path.read_bytes()
        if damage is None:
            path.write_bytes(whole[: len(whole) // 2])
        elif damage == "middle":
            path.write_bytes(whole.replace(np.ones(4, np.float32).tobytes(), np.zeros(4, np.float32).tobytes()))
        else:
            path.write_bytes(damage)
        assert cache.read_arrays(cache.SKIES, "key") is None and not path.exists()


def test_a_worker_of_compare_runs_nothing_of_the_working_folder(tmp_path):
    """A random.py of somebody's would be run."""
    for name in ("random", "json", "twilight"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('of the working folder')")
    program = WORKER.format(package=str(Path(twilight.__file__).parents[1]))
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    ended = subprocess.run([sys.executable, "-P", "-c", program], cwd=tmp_path, input="{}", text=True,
                           capture_output=True, env=environment)  # fmt: skip
    assert "of the working folder" not in ended.stderr and "KeyError" in ended.stderr


@pytest.mark.parametrize("kind", ["external storage", "external link", "soft link", "virtual"])
def test_a_sky_whose_data_are_in_other_files_is_refused(tmp_path, kind):
    """A file from elsewhere would show what other files of the reader hold."""
    import h5py

    write_sky(glow_sky(step_deg=30.0), tmp_path / "sky.h5")
    (tmp_path / "secret").write_bytes(bytes(8 * 20))
    with h5py.File(tmp_path / "sky.h5", "a") as file:
        if kind == "external storage":
            file.create_dataset("more", (20,), "f8", external=[(str(tmp_path / "secret"), 0, 160)])
        elif kind == "external link":
            file["more"] = h5py.ExternalLink("other.h5", "/radiance")
        elif kind == "soft link":
            file["more"] = h5py.SoftLink("/radiance")
        else:
            layout = h5py.VirtualLayout((2,), "f8")
            layout[:] = h5py.VirtualSource("other.h5", "a", (2,))
            file.create_virtual_dataset("more", layout)
    for read in (twilight.read_sky, twilight.open_dataset):
        with pytest.raises(TwilightError, match="'more'"):
            read(tmp_path / "sky.h5")


def test_the_double_hour_has_its_offset_in_its_name(tmp_path):
    """Two suns of an interval over the end of summer time would have one name; the first would be taken in silence."""
    from twilight.scene.suns import suns_of

    place = {"latitude_deg": -72, "longitude_deg": 2.5, "time_zone": "Europe/Berlin"}
    interval = {"start": "2026-10-25T01:30", "stop": "2026-10-25T03:30", "step_minutes": 30, **place}
    names = [sun.name for sun in suns_of(twilight.load({"version": 1, "climate": "pure-air", "sun": interval}))]
    assert len(set(names)) == len(names) == 7
    assert names[1:4] == ["2026-10-25T0200+0200", "2026-10-25T0230+0200", "2026-10-25T0200+0100"]
    assert names[0] == "2026-10-25T0130" and names[-1] == "2026-10-25T0330"
    with pytest.warns(TwilightWarning, match=r"twice .* the first, 2026-10-25T02:30\+02:00, is taken"):
        twilight.light((52.5, 13.4), "2026-10-25T02:30", time_zone="Europe/Berlin")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        twilight.light((52.5, 13.4), "2026-10-25T03:30", time_zone="Europe/Berlin")
        twilight.light((52.5, 13.4), "2026-10-25T02:30+01:00", time_zone="Europe/Berlin")


@pytest.mark.parametrize("chosen", [True, False], ids=["TWILIGHT_CACHE_DIR", "nowhere"])
def test_kernels_are_kept_in_the_cache_or_not_where_the_package_cannot_be_written(tmp_path, monkeypatch, chosen):
    """In a container whose package and home are read-only the first command would be a traceback of numba's."""
    from twilight.jit import machine_code
    from twilight.jit.kernels import njit

    class Refused:
        @classmethod
        def from_function(cls, py_func, py_file):
            return None

    locators = [Refused, Refused, machine_code._InCacheFolder, Refused, machine_code._NotKept]
    monkeypatch.setattr(machine_code._Files, "_locator_classes", locators)

    def read_only(self):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(machine_code._NotKept, "ensure_cache_path", read_only)
    monkeypatch.setattr(machine_code, "_warned", [])
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    if chosen:
        monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path))
    else:
        monkeypatch.delenv("TWILIGHT_CACHE_DIR", raising=False)
    kernels = [njit(cache=True)(lambda x: x + 1.5), njit(cache=True)(lambda x: x - 1.5)]
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert [kernel(2.0) for kernel in kernels] == [3.5, 0.5]
    mine = [str(one.message) for one in said if issubclass(one.category, TwilightWarning)]
    assert len(mine) == (0 if chosen else 1)
    assert bool(list(tmp_path.rglob("*.nbi"))) == chosen
    assert chosen or "Read-only file system" in mine[0]
