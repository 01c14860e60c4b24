"""Sweeps that go wrong: failed tasks, full disks, damaged journals and chunks."""

import resource

import numpy as np
import pytest
import xarray as xr
from sweeping import SUNS, planned, right, swept

from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config.load import warn_of_slips
from twilight.studies.sweep.store import JOURNAL, open_store


def test_failures_are_listed_and_do_not_stop_the_rest(toy, client, tmp_path, log):
    """One air that fails would stop a night's sweep."""
    made = planned({"solver.factor": [1, 13, 2], "sun.elevation_deg": [*SUNS, -11.0]})
    outcome, failed = swept(made, client, tmp_path / "a.zarr")
    assert outcome.tasks == 2 and outcome.skies == 8
    assert failed == {
        "the toy solver needs a sun at -10 deg or higher": [(0, 3), (2, 3)],
        "ZeroDivisionError: the toy broke": [(1, i) for i in range(4)],
    }
    with xr.open_zarr(tmp_path / "a.zarr") as data:
        assert data.status.values.tolist() == [[1, 1, 1, 2], [0, 0, 0, 0], [1, 1, 1, 2]]
        for i, factor in ((0, 1), (2, 2)):
            found = data.sun_normalised_radiance.values[i, :3]
            assert np.allclose(found, right(toy, data, factor)[:3], rtol=1e-6)
        assert np.isnan(data.sun_normalised_radiance.values[1]).all()
    log.with_name("mended").touch()
    outcome, failed = swept(made, client, tmp_path / "a.zarr")
    assert outcome.tasks == 1 and list(failed) == ["the toy solver needs a sun at -10 deg or higher"]
    assert [line.split()[1] for line in log.read_text().splitlines()] == ["1", "13", "2", "13"]


@pytest.mark.parametrize("limit_bytes, most_done", ((200, 0), (600, 7)), ids=("chunk", "journal"))
def test_a_full_disk_loses_only_the_task_at_hand(toy, client, tmp_path, log, limit_bytes, most_done):
    """A limit on the size of files stands for the disk: a chunk has 360 bytes, a line of the journal some 90."""
    made = planned({"solver.factor": list(range(1, 10)), "sun.elevation_deg": SUNS})
    path = tmp_path / "a.zarr"
    with open_store(path, made):
        pass
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limits[1]))
    try:
        with pytest.raises(TwilightError, match=r"a\.zarr: cannot be written"):
            swept(made, client, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    finished = {p: p.stat().st_mtime_ns for p in path.rglob("sun_normalised_radiance/c/**/*") if p.is_file()}
    assert (not finished and most_done == 0) or 2 <= len(finished) <= most_done + 1
    outcome, failed = swept(made, client, path)
    assert not failed and 9 - outcome.tasks in ({0} if most_done == 0 else {len(finished), len(finished) - 1})
    assert sum(p.stat().st_mtime_ns == at for p, at in finished.items()) == 9 - outcome.tasks
    with xr.open_zarr(path) as data:
        assert (data.status == 1).all()
        for i in range(9):
            assert np.allclose(data.sun_normalised_radiance.values[i], right(toy, data, i + 1), rtol=1e-6)
    assert not list(path.rglob("*.partial"))


def test_a_damaged_journal_and_another_sweep(toy, client, tmp_path, log):
    """Another sweep's skies would be taken for these."""
    vary = {"solver.factor": [1, 2], "sun.elevation_deg": SUNS}
    path = tmp_path / "a.zarr"
    swept(planned(vary), client, path)
    first, second = (path / JOURNAL).read_text().splitlines()
    (path / JOURNAL).write_text(first + "\n" + second[: len(second) // 2])
    outcome, _ = swept(planned(vary), client, path)
    assert outcome.tasks == 1 and swept(planned(vary), client, path)[0].tasks == 0
    with pytest.raises(TwilightError, match=r"holds another sweep \(dimensions.sun_elevation_deg differs\)"):
        swept(planned(vary | {"sun.elevation_deg": [-1]}), client, path)
    with pytest.raises(TwilightError, match=r"configuration.climate.gases.no2 differs"):
        swept(planned(vary, climate={"version": 1, "name": "air", "gases": {"no2": False}}), client, path)
    with open_store(path, planned(vary)), pytest.raises(TwilightError, match="another sweep is writing"):
        with open_store(path, planned(vary)):
            pass
    (tmp_path / "b.zarr").mkdir()
    with pytest.raises(TwilightError, match="not the dataset of a sweep"):
        swept(planned(vary), client, tmp_path / "b.zarr")


@pytest.mark.parametrize("damage", ("a bit", "cut", "deleted", "emptied"))
def test_a_damaged_chunk_is_computed_again(toy, client, tmp_path, log, damage):
    """A bit that flipped would stay in the dataset."""
    made = planned({"solver.factor": [1, 2, 3], "sun.elevation_deg": SUNS})
    path = tmp_path / "a.zarr"
    swept(made, client, path)
    before = xr.load_dataset(path, engine="zarr")
    chunk = path / "sun_normalised_radiance" / "c" / "1" / "0" / "0" / "0" / "0"
    data = bytearray(chunk.read_bytes())
    if damage == "deleted":
        chunk.unlink()
    else:
        data[len(data) // 2] ^= 1
        chunk.write_bytes({"a bit": data, "cut": data[: len(data) // 2], "emptied": b""}[damage])
        with pytest.raises((RuntimeError, ValueError)), xr.open_zarr(path) as opened:
            opened.sun_normalised_radiance.load()
    with open_store(path, made) as store:
        assert store.damaged == 1 and len(store.done) == 2
    assert swept(made, client, path)[0].tasks == 1
    xr.testing.assert_identical(xr.load_dataset(path, engine="zarr"), before)
    with open_store(path, made) as store:
        assert store.damaged == 0 and len(store.done) == 3


def test_a_slip_anywhere_along_an_axis_is_warned_of(toy):
    """Metres in the middle of an axis would be taken for kilometres."""
    made = planned({"observer.altitude_km": [0.0, 4200.0, 1.0]})
    with pytest.warns(TwilightWarning, match="4200 m are 4.2 km") as said:
        warn_of_slips(*made.ends())
    assert len(said) == 1


def test_a_sweep_that_the_disk_cannot_hold_is_refused(toy, tmp_path, monkeypatch):
    """A sweep would fill the disk after hours."""
    monkeypatch.setattr(
        "twilight.studies.sweep.store.shutil.disk_usage", lambda path: type("Usage", (), {"free": 10**6})
    )
    with pytest.raises(TwilightError, match=r"3 skies need at least .* GB, and 0.001 GB are free"):
        with open_store(tmp_path / "a.zarr", planned({"sun.elevation_deg": SUNS})):
            pass


def test_a_second_sweep_that_begins_at_the_same_time_is_told_so(toy, tmp_path, monkeypatch):
    """Of two sweeps that make the same dataset at once, one would be told that its folder is not empty."""
    from twilight.studies.sweep import store

    made, path = planned({"solver.factor": [1, 2], "sun.elevation_deg": SUNS}), tmp_path / "a.zarr"
    create, first = store._create, []

    def meanwhile(*arguments):
        monkeypatch.setattr(store, "_create", create)
        first.append(open_store(path, made))
        first[0].__enter__()
        create(*arguments)

    monkeypatch.setattr(store, "_create", meanwhile)
    with pytest.raises(TwilightError, match="another sweep is writing it"), open_store(path, made):
        pass
    first[0].__exit__(None, None, None)
    with open_store(path, made) as again:
        assert not again.done
