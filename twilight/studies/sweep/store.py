"""The dataset of a sweep: a Zarr store that xarray opens lazily, and in it the journal of its finished tasks.

A chunk is a file that is there whole or not at all, with a checksum of its bytes (CRC-32C) inside; a task counts as
done when a line of the journal says so, which is written after its chunks.  Whatever stops a sweep, nothing but the
tasks at hand is lost; a chunk that was damaged or deleted since is computed again.
"""

from __future__ import annotations

import json
import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight import __version__
from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_folder, writing
from twilight.io.journal import Journal, open_journal, read_journal
from twilight.io.labels import attributes
from twilight.io.provenance import differences, to_json
from twilight.numerics.spectrum import solar_irradiance
from twilight.studies.sweep.dimensions import key_attributes, variable_name
from twilight.studies.sweep.sweep import Sweep
from twilight.studies.sweep.work import BENDING, DIRECT, RADIANCE, STANDARD_ERROR, Chunk, Task, TaskResult

if TYPE_CHECKING:
    from xarray import Dataset

JOURNAL = "tasks.jsonl"
MISSING = 0
"""`status` of a scene that is not computed yet."""
COMPUTED = 1
"""`status` of one whose sky is there."""
REFUSED = 2
"""`status` of one that its solver refused."""
PARTS = {"train": 0, "validation": 1}
"""Values of `split`, the part of each draw, by the names that users give."""
RESERVE_BYTES = 64 * 2**20
"""Free space beside the dataset's without which a sweep is not begun."""
COMPRESSED_FRACTION = 0.4
"""Least fraction of the bytes of radiances that remains after compression: less space is refused at once."""


class Store:
    """An open dataset, written by this process alone.

    done: what the journal says of each finished task by its key: {"refused": {scene: sentence}, "turbidity", "cpu_s",
        "wall_s"}.  damaged: how many tasks are forgotten because a chunk is no longer what was written.
    """

    def __init__(self, path: Path, sweep: Sweep, journal: Journal):
        import zarr  # optional

        self.path, self.sweep, self._journal = path, sweep, journal
        self._group: Any = zarr.open_group(path, mode="r+", use_consolidated=False)
        had = _finished(path)
        self.done = {
            task.key: had[task.key] for task in sweep.tasks if task.key in had and all(map(self._is_whole, task.chunks))
        }
        self.damaged = len(had) - len(self.done)

    def write(self, task: Task, result: TaskResult) -> None:
        """Chunks first, then the line that says that they are there.  TwilightError where the system refuses."""
        scenes = list(task.scenes())
        refused = {",".join(map(str, scenes[i])): reason for i, reason in result.refused.items()}
        entry: dict[str, Any] = {"refused": refused, "cpu_s": round(result.cpu_s, 3), "wall_s": round(result.wall_s, 3)}
        if np.isfinite(result.turbidity):
            entry["turbidity"] = round(result.turbidity, 6)
        with writing(self.path):
            at = 0
            for chunk in task.chunks:
                shape = tuple(map(len, chunk))
                skies = slice(at, at := at + int(np.prod(shape)))
                for name, values in result.arrays.items():
                    self._group[name][_slices(chunk)] = values[skies].reshape(*shape, *values.shape[1:])
            self._journal.write({"task": task.key, **entry})
        self.done[task.key] = entry

    def _is_whole(self, chunk: Chunk) -> bool:
        place = [str(r.start // size) for r, size in zip(chunk, self.sweep.chunk, strict=True)]
        try:
            for name in _computed(self.sweep):  # a file that is not there would be read as NaN
                (self.path / name / "c").joinpath(*place, *("0" for _ in _trailing(name))).stat()
                self._group[name][_slices(chunk)]
        except Exception:  # of the checksum, the decompressor or the system
            return False
        return True

    def write_status(self) -> None:
        """Bring the variables `status` and `turbidity` up to date with the journal."""
        status, turbidity = _bookkeeping(self.sweep)
        for task in self.sweep.tasks:
            for chunk in task.chunks if task.key in self.done else ():
                status[_slices(chunk)] = COMPUTED
                turbidity[tuple(r[0] for r in chunk[: turbidity.ndim])] = self.done[task.key].get("turbidity", np.nan)
        for scene, _ in self.refused():
            status[scene] = REFUSED
        with suppress(OSError):  # the journal knows it all; this may come after a full disk
            self._group["status"][...], self._group["turbidity"][...] = status, turbidity

    def refused(self) -> Iterator[tuple[tuple[int, ...], str]]:
        """Index and sentence of each scene that its solver refused."""
        for entry in self.done.values():
            for scene, reason in entry["refused"].items():
                yield tuple(map(int, scene.split(","))), reason


def _slices(chunk: Chunk) -> tuple[slice, ...]:
    return tuple(slice(r.start, r.stop) for r in chunk)


@contextmanager
def open_store(path: Path, sweep: Sweep) -> Iterator[Store]:
    """The dataset of a sweep at `path`, made where there is none.

    Errors: TwilightError where something else lies there, where another sweep writes it, where it cannot be written, or
    where the disk lacks space.
    """
    import zarr  # optional

    if not path.exists():
        try:
            _create(path, sweep)
        except TwilightError:
            if not path.exists():
                raise  # else another sweep has just begun it
    _check_same(path, sweep)
    with (
        writing(path),
        open_journal(path / JOURNAL, "another sweep") as journal,
        zarr.config.set({"array.write_empty_chunks": True}),
    ):
        for left in path.rglob("*.partial"):  # chunks that a killed process had begun
            left.unlink()
        store = Store(path, sweep, journal)
        _check_space(store)
        try:
            yield store
        finally:
            store.write_status()


def finished_tasks(path: Path, sweep: Sweep) -> list[float]:
    """Processor time [s] of each task of a sweep that the journal of the dataset at `path` calls finished, none where
    there is no dataset; it reads no chunk and changes nothing.

    Errors: TwilightError where something else lies there.
    """
    if path.exists():
        _check_same(path, sweep)
    return [float(entry.get("cpu_s", 0.0)) for entry in _finished(path).values()]


def _finished(path: Path) -> dict[str, dict[str, Any]]:
    """What the journal of a dataset says of each finished task, by its key."""
    return {entry.pop("task"): entry for entry in read_journal(path / JOURNAL) if {"task", "refused"} <= entry.keys()}


def _check_same(path: Path, sweep: Sweep) -> None:
    try:
        written = json.loads((path / "zarr.json").read_text(encoding="utf-8"))["attributes"]
        stored, stored_hash = json.loads(written["sweep"]), written["sweep_hash"]
    except (OSError, ValueError, KeyError, TypeError):
        raise TwilightError(f"{path}: is there and is not the dataset of a sweep; give another --output") from None
    if stored_hash != sweep.hash:
        asked = json.loads(to_json(sweep.document))
        keys = (next(differences(stored.get(part), asked[part], (part,)), None) for part in sweep.document)
        changed = next((".".join(key[0]) for key in keys if key is not None), "the content of a file that it names")
        raise TwilightError(f"{path}: holds another sweep ({changed} differs); give another --output")


def _check_space(store: Store) -> None:
    missing = sum(task.skies for task in store.sweep.tasks if task.key not in store.done)
    needed = COMPRESSED_FRACTION * store.sweep.bytes * missing / store.sweep.scenes + RESERVE_BYTES
    free = shutil.disk_usage(store.path).free
    if missing and needed > free:
        raise TwilightError(
            f"{store.path}: {missing:,} skies need at least {needed / 1e9:.3g} GB, and {free / 1e9:.3g} GB are free: "
            f"take fewer scenes, fewer wavelengths, a larger texture.resolution_deg, or another --output"
        )


# A new dataset --------------------------------------------------------------------------------------------------


def _create(path: Path, sweep: Sweep) -> None:
    """All metadata and coordinates, made beside `path` and moved there."""
    with whole_folder(path) as temporary, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Consolidated metadata")  # which xarray reads, whatever zarr's standard says
        data, encoding = _empty(sweep)
        data.to_zarr(temporary, mode="w", compute=False, encoding=encoding, zarr_format=3)
        (temporary / JOURNAL).touch()


def _empty(sweep: Sweep) -> tuple[Dataset, dict[str, Any]]:
    """The dataset without its skies, and how they are to be stored."""
    import dask.array  # optional
    import xarray  # optional
    from zarr.codecs import BloscCodec, Crc32cCodec  # optional

    axes = {"elevation": sweep.elevation_deg, "azimuth": sweep.azimuth_deg, "wavelength": sweep.wavelength_nm}
    names = [d.name for d in sweep.dimensions]
    variables: dict[str, Any] = {name: (name, values, attributes(name)) for name, values in axes.items()}
    encoding = {}
    for name in _computed(sweep):
        last = {along: axes[along].size for along in _trailing(name)}
        shape = (*sweep.shape, *last.values())
        about = attributes(name)
        if name == RADIANCE and STANDARD_ERROR in sweep.layers:
            about["ancillary_variables"] = STANDARD_ERROR
        variables[name] = ([*names, *last], dask.array.full(shape, np.nan, np.float32, chunks=shape), about)
        codecs = [BloscCodec(cname="zstd", clevel=5, shuffle="shuffle"), Crc32cCodec()]
        encoding[name] = {"chunks": (*sweep.chunk, *last.values()), "compressors": codecs}
    irradiance = solar_irradiance(sweep.wavelength_nm, sweep.first.solar_spectrum, 1.0)
    about = attributes("solar_irradiance") | {"comment": "on top of the atmosphere, at 1 au"}
    variables["solar_irradiance"] = ("wavelength", irradiance, about)
    status, turbidity = _bookkeeping(sweep)
    flags = {"flag_values": [MISSING, COMPUTED, REFUSED], "flag_meanings": "missing computed refused"}
    variables["status"] = (names, status, flags)
    variables["turbidity"] = (names[: turbidity.ndim], turbidity, attributes("turbidity"))
    for dimension in sweep.dimensions:
        for key in dimension.points[0]:
            values = _plain([point[key] for point in dimension.points])
            variables[variable_name(key)] = (dimension.name, values, key_attributes(key))
    if (drawn := sweep.drawn) is not None:
        held = np.array([i in drawn.held_out for i in range(drawn.size)], np.int8)
        flags = {"flag_values": [*PARTS.values()], "flag_meanings": " ".join(PARTS)}
        variables["split"] = ("draw", held, {"long_name": "part of the draw", **flags})
    about = {
        "title": f"Skies of {sweep.first.title}",
        "source": f"twilight {__version__}",
        "comment": "The sky is its own mirror image about the sun's vertical: radiance at an azimuth of 200 degrees is "
        "that at 160, Stokes parameter U the negative of that at 160.  NaN: not computed (see status).  Radiance in "
        "W m-2 nm-1 sr-1 is sun_normalised_radiance times solar_irradiance over the square of earth_sun_distance.",
        "sweep": to_json(sweep.document),
        "sweep_hash": sweep.hash,
        "azimuth_count": str(sweep.first.texture.shape[1]),
        "solar_spectrum": sweep.first.solar_spectrum,
    }
    return xarray.Dataset(variables | _sun_positions(sweep), attrs=about), encoding


def _trailing(name: str) -> tuple[str, ...]:
    """The dimensions of a variable behind those of the sweep."""
    if name == BENDING:
        return ()
    return ("wavelength",) if name == DIRECT else ("elevation", "azimuth", "wavelength")


def _computed(sweep: Sweep) -> tuple[str, ...]:
    """The variables that tasks fill."""
    return RADIANCE, *sweep.layers, DIRECT, BENDING


def _bookkeeping(sweep: Sweep) -> tuple[np.ndarray, np.ndarray]:
    """Status and turbidity of a sweep of which nothing is computed."""
    return np.full(sweep.shape, MISSING, np.int8), np.full(sweep.shape[: len(sweep.outer)], np.nan)


def _sun_positions(sweep: Sweep) -> dict[str, Any]:
    """Where the sun is, along the dimensions that move it, and the coordinate of the configuration's own suns."""
    timed = sweep.sun([0] * len(sweep.shape))[0].time is not None
    heads = ("sun.", "observer.") if timed else ("sun.",)
    moves = [d.own_suns or any(key.startswith(heads) for key in d.points[0]) for d in sweep.dimensions]
    shape = [n if moved else 1 for n, moved in zip(sweep.shape, moves, strict=True)]
    suns = [sweep.sun(scene)[0] for scene in np.ndindex(*shape)]
    positions = {
        "solar_elevation_angle": [sun.elevation_deg for sun in suns],
        "solar_azimuth_angle": [np.nan if sun.azimuth_deg is None else sun.azimuth_deg for sun in suns],
        "earth_sun_distance": [sun.distance_au for sun in suns],
    }
    still = tuple(i for i, moved in enumerate(moves) if not moved)
    names = [d.name for d, moved in zip(sweep.dimensions, moves, strict=True) if moved]
    variables: dict[str, Any] = {
        name: (names, np.array(values).reshape(shape).squeeze(still), attributes(name))
        for name, values in positions.items()
        if not np.isnan(values).all()
    }
    for place, dimension in enumerate(sweep.dimensions):
        if dimension.own_suns:
            scenes = (np.eye(len(moves), dtype=int)[place] * i for i in range(dimension.size))
            listed = [sweep.sun(scene.tolist())[0] for scene in scenes]
            values = [sun.elevation_deg if sun.time is None else sun.time.timestamp() for sun in listed]
            about = attributes(dimension.name) | ({"calendar": "standard"} if dimension.name == "time" else {})
            variables[dimension.name] = (dimension.name, np.array(values, float), about)
    return variables


def _plain(values: list[Any]) -> np.ndarray:
    """Numbers as float64 (null is NaN), anything else as text."""
    if all(v is None or (isinstance(v, int | float) and not isinstance(v, bool)) for v in values):
        return np.array([np.nan if v is None else v for v in values], float)
    return np.array([v if isinstance(v, str) else to_json(v) for v in values], object)
