"""The dataset of a sweep: a Zarr store that xarray opens lazily, and in it the journal of its finished tasks.

A chunk is a file that is there whole or not at all, with a CRC-32 of its values inside; a task counts as done when a
line of the journal says so, which is written after its chunks.  Whatever stops a sweep, nothing but the tasks at hand
is lost; a chunk that was damaged or deleted since is computed again.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from twilight import __version__
from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_folder
from twilight.io.labels import attributes
from twilight.io.provenance import Journal, differences, open_journal, read_journal, to_json
from twilight.numerics.spectrum import solar_irradiance
from twilight.studies.sweep.dimensions import key_attributes, variable_name
from twilight.studies.sweep.sweep import Sweep
from twilight.studies.sweep.work import STANDARD_ERROR, DatasetBlock, Task, TaskResult

JOURNAL = "tasks.jsonl"
MISSING = 0
"""Value of `status` of a scene that is not computed yet."""
COMPUTED = 1
"""Value of `status` of a scene whose sky is there."""
REFUSED = 2
"""Value of `status` of a scene that its solver refused."""
PARTS = {"train": 0, "validation": 1}
"""Values of `split`, the part of each draw, by the names that users give."""
RESERVE_BYTES = 64 * 2**20
"""Free space beside the dataset's without which a sweep is not begun."""
COMPRESSED_FRACTION = 0.4
"""Least fraction of the bytes of radiances that remains after compression: less space is refused at once."""

_RADIANCE = "sun_normalised_radiance"
_DIRECTIONS = ("elevation", "azimuth", "wavelength")


class Store:
    """An open dataset, written by this process alone.

    done: what the journal says of each finished task by its key: {"refused": {scene: sentence}, "turbidity", "cpu_s",
        "wall_s"}.
    """

    def __init__(self, path: Path, sweep: Sweep, group: Any, journal: Journal):
        self.path, self.sweep = path, sweep
        self.done = _finished(path / JOURNAL)
        self._group, self._journal = group, journal
        self.damaged = self._without_damaged()

    def write(self, task: Task, result: TaskResult) -> None:
        """Chunks first, then the line that says that they are there.  TwilightError where the system refuses."""
        refused: dict[str, str] = {}
        try:
            for block, found in zip(task.blocks, result.blocks, strict=True):
                arrays = {_RADIANCE: found.radiance, "direct_irradiance_factor": found.direct}
                arrays["solar_bending"] = found.bending_deg
                for name in self.sweep.layers:
                    arrays[name] = found.more.get(name, np.full_like(found.radiance, np.nan))
                for name, values in arrays.items():
                    self._group[name][block.region] = values.reshape((*block.shape, *values.shape[1:]))
                scenes = list(block.scenes())
                for i, reason in found.refused.items():
                    refused[",".join(map(str, scenes[i]))] = reason
            entry: dict[str, Any] = {"refused": refused}
            if np.isfinite(result.turbidity):
                entry["turbidity"] = round(result.turbidity, 6)
            entry |= {"cpu_s": round(result.cpu_s, 3), "wall_s": round(result.wall_s, 3)}
            self._journal.write({"task": task.key, **entry})
        except OSError as error:
            raise TwilightError(f"{self.path}: cannot be written ({error.strerror or error})") from error
        self.done[task.key] = entry

    def _without_damaged(self) -> int:
        """Forget the tasks of which a chunk is no longer what was written; how many they are."""
        names = [_RADIANCE, "direct_irradiance_factor", "solar_bending"]
        names += list(self.sweep.layers)
        lost = [
            task.key
            for task in self.sweep.tasks
            if task.key in self.done and not all(self._is_whole(name, block) for block in task.blocks for name in names)
        ]
        for key in lost:
            del self.done[key]
        return len(lost)

    def _is_whole(self, name: str, block: DatasetBlock) -> bool:
        chunk = [part.start // size for part, size in zip(block.region, self.sweep.chunk, strict=True)]
        array = self._group[name]
        chunk += [0] * (array.ndim - len(chunk))
        if not (self.path / name).joinpath("/".join(map(str, chunk)) or "0").is_file():
            return False  # which zarr reads as NaN
        try:
            array[block.region]
        except Exception:  # of the checksum, the decompressor or the system
            return False
        return True

    def write_status(self) -> None:
        """Bring the variables `status` and `turbidity` up to date with the journal."""
        status = np.zeros(self.sweep.shape, np.int8)
        turbidity = np.full(self.sweep.shape[: len(self.sweep.outer)], np.nan)
        for task in self.sweep.tasks:
            if task.key in self.done:
                for block in task.blocks:
                    status[block.region] = COMPUTED
                    turbidity[block.index] = self.done[task.key].get("turbidity", np.nan)
        for scene, _ in self.refused():
            status[scene] = REFUSED
        with suppress(OSError):  # the journal knows it all; this may come after a full disk
            self._group["status"][...] = status
            self._group["turbidity"][...] = turbidity

    def refused(self) -> Iterator[tuple[tuple[int, ...], str]]:
        """Index and sentence of each scene that its solver refused."""
        for task in self.sweep.tasks:
            for scene, reason in self.done.get(task.key, {}).get("refused", {}).items():
                yield tuple(int(i) for i in scene.split(",") if i), reason


@contextmanager
def open_store(path: Path, sweep: Sweep) -> Iterator[Store]:
    """The dataset of a sweep at `path`, made where there is none.

    Errors: TwilightError where something else lies there, where another sweep writes it, or where the disk lacks space.
    """
    import zarr  # start-up

    if path.exists():
        _check_same(path, sweep)
    else:
        _create(path, sweep)
    try:
        with open_journal(path / JOURNAL, "another sweep") as journal:
            for left in path.rglob("*.partial"):  # chunks that a killed process had begun
                left.unlink()
            with zarr.config.set({"array.write_empty_chunks": True}):
                store = Store(path, sweep, zarr.open_group(path, mode="r+", use_consolidated=False), journal)
                _check_space(path, sweep, store)
                try:
                    yield store
                finally:
                    store.write_status()
    except OSError as error:
        raise TwilightError(f"{path}: cannot be written ({error.strerror or error})") from error


def finished_tasks(path: Path, sweep: Sweep) -> list[float]:
    """Processor time [s] of each task of a sweep that the journal of the dataset at `path` calls finished, none where
    there is no dataset; it reads no chunk and changes nothing.

    Errors: TwilightError where something else lies there.
    """
    if not path.exists():
        return []
    _check_same(path, sweep)
    done = _finished(path / JOURNAL)
    return [float(done[task.key].get("cpu_s", 0.0)) for task in sweep.tasks if task.key in done]


def _finished(path: Path) -> dict[str, dict[str, Any]]:
    """What the journal says of each finished task, by its key."""
    done = {}
    for entry in read_journal(path):
        with suppress(ValueError, TypeError, KeyError):
            done[entry.pop("task")] = entry | {"refused": dict(entry["refused"])}
    return done


def _check_same(path: Path, sweep: Sweep) -> None:
    try:
        written = json.loads((path / ".zattrs").read_text(encoding="utf-8"))
        stored, stored_hash = json.loads(written["sweep"]), written["sweep_hash"]
    except (OSError, ValueError, KeyError, TypeError):
        raise TwilightError(f"{path}: is there and is not the dataset of a sweep; give another --output") from None
    if stored_hash != sweep.hash:
        asked = json.loads(to_json(sweep.document))
        parts = ("dimensions", "held_out", "configuration", "version", "code")
        found = (next(differences(stored.get(part), asked[part], (part,)), None) for part in parts)
        changed = next((".".join(one[0]) for one in found if one is not None), "a task")
        if changed == "code":
            changed = "the source or data of the program"
        raise TwilightError(f"{path}: holds another sweep ({changed} differs); give another --output")


def _check_space(path: Path, sweep: Sweep, store: Store) -> None:
    missing = sum(task.skies for task in sweep.tasks if task.key not in store.done)
    needed = COMPRESSED_FRACTION * sweep.bytes * missing / sweep.scenes + RESERVE_BYTES
    free = shutil.disk_usage(path).free
    if missing and needed > free:
        raise TwilightError(
            f"{path}: {missing:,} skies need at least {needed / 1e9:.3g} GB, and {free / 1e9:.3g} GB are free: take "
            f"fewer scenes, fewer wavelengths, a larger texture.resolution_deg, or another --output"
        )


# A new dataset --------------------------------------------------------------------------------------------------


def _create(path: Path, sweep: Sweep) -> None:
    """All metadata and coordinates, made beside `path` and moved there."""
    import zarr  # start-up

    with whole_folder(path) as temporary:
        group = zarr.open_group(temporary, mode="w", zarr_format=2)
        group.attrs.update(_attributes(sweep))
        _results(group, sweep)
        _coordinates(group, sweep)
        zarr.consolidate_metadata(temporary, zarr_format=2)
        (temporary / JOURNAL).touch()


def _attributes(sweep: Sweep) -> dict[str, str]:
    return {
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


def _results(group: Any, sweep: Sweep) -> None:
    grid = (sweep.elevation_deg.size, sweep.azimuth_deg.size, sweep.wavelength_nm.size)
    names = tuple(d.name for d in sweep.dimensions)

    def add(name: str, last: tuple[str, ...], shape: tuple[int, ...], **more: str) -> None:
        from numcodecs import CRC32, Blosc  # start-up

        group.create_array(
            name,
            shape=(*sweep.shape, *shape),
            chunks=(*sweep.chunk, *shape),
            dtype="f4",
            fill_value=float("nan"),
            filters=[CRC32()],
            compressors=[Blosc(cname="zstd", clevel=5, shuffle=Blosc.SHUFFLE)],
            chunk_key_encoding={"name": "v2", "separator": "/"},
            attributes={"_ARRAY_DIMENSIONS": [*names, *last], **attributes(name), **more},
        )

    ancillary = {"ancillary_variables": STANDARD_ERROR} if STANDARD_ERROR in sweep.layers else {}
    add(_RADIANCE, _DIRECTIONS, grid, **ancillary)
    for name in sweep.layers:
        add(name, _DIRECTIONS, grid)
    add("direct_irradiance_factor", ("wavelength",), grid[2:])
    add("solar_bending", (), ())
    _array(
        group,
        "status",
        names,
        np.zeros(sweep.shape, np.int8),
        flag_values=[MISSING, COMPUTED, REFUSED],
        flag_meanings="missing computed refused",
    )
    outer = [d.name for d in sweep.outer]
    _array(group, "turbidity", outer, np.full([d.size for d in sweep.outer], np.nan), **attributes("turbidity"))


def _coordinates(group: Any, sweep: Sweep) -> None:
    for name, values in (
        ("wavelength", sweep.wavelength_nm),
        ("elevation", sweep.elevation_deg),
        ("azimuth", sweep.azimuth_deg),
    ):
        _array(group, name, (name,), values, **attributes(name))
    irradiance = solar_irradiance(sweep.wavelength_nm, sweep.first.solar_spectrum, 1.0)
    about = attributes("solar_irradiance") | {"comment": "on top of the atmosphere, at 1 au"}
    _array(group, "solar_irradiance", ("wavelength",), irradiance, **about)
    for dimension in sweep.dimensions:
        if dimension.axis is None:
            _own_suns(group, sweep, dimension.name)
            continue
        for key in dimension.axis.points[0]:
            values = _plain([point[key] for point in dimension.axis.points])
            _array(group, variable_name(key), (dimension.name,), values, **key_attributes(key))
    if (drawn := sweep.drawn) is not None and drawn.axis is not None:
        held = [int(i in drawn.axis.held_out) for i in range(drawn.size)]
        marks: dict[str, Any] = {
            "long_name": "part of the draw",
            "flag_values": [*PARTS.values()],
            "flag_meanings": " ".join(PARTS),
        }
        _array(group, "split", (drawn.name,), np.array(held, np.int8), **marks)
    _sun_positions(group, sweep)


def _own_suns(group: Any, sweep: Sweep, name: str) -> None:
    """The coordinate along the suns that the configuration lists itself."""
    place = [d.name for d in sweep.dimensions].index(name)
    scenes = [tuple(i if d == place else 0 for d in range(len(sweep.shape))) for i in range(sweep.shape[place])]
    positions = [sweep.position(scene) for scene in scenes]
    values = [p.time_s if name == "time" else p.sun_elevation_deg for p in positions]
    more = {"calendar": "standard"} if name == "time" else {}
    _array(group, name, (name,), np.array(values, float), **more, **attributes(name))


def _sun_positions(group: Any, sweep: Sweep) -> None:
    """Where the sun is, along the dimensions that move it."""
    heads = ("sun",) if sweep.position([0] * len(sweep.shape)).time_s is None else ("sun", "observer")
    moves = [d.axis is None or any(key.split(".")[0] in heads for key in d.axis.points[0]) for d in sweep.dimensions]
    names = [d.name for d, moved in zip(sweep.dimensions, moves, strict=True) if moved]
    shape = tuple(n for n, moved in zip(sweep.shape, moves, strict=True) if moved)
    values = np.full((3, *shape), np.nan)
    for index in np.ndindex(*shape):
        along = iter(index)
        position = sweep.position(tuple(next(along) if moved else 0 for moved in moves))
        azimuth = np.nan if position.sun_azimuth_deg is None else position.sun_azimuth_deg
        values[(slice(None), *index)] = position.sun_elevation_deg, azimuth, position.distance_au
    for name, found in zip(("solar_elevation_angle", "solar_azimuth_angle", "earth_sun_distance"), values, strict=True):
        if not np.isnan(found).all():
            _array(group, name, names, found, **attributes(name))


def _plain(values: list[Any]) -> np.ndarray:
    """Numbers as float64 (null is NaN), anything else as text."""
    if all(v is None or (isinstance(v, int | float) and not isinstance(v, bool)) for v in values):
        return np.array([np.nan if v is None else v for v in values], float)
    return np.array([v if isinstance(v, str) else to_json(v) for v in values])


def _array(group: Any, name: str, dimensions: Any, values: np.ndarray, **about: Any) -> None:
    array = group.create_array(
        name,
        shape=values.shape,
        chunks=values.shape or "auto",
        dtype=values.dtype,
        fill_value=None,
        attributes={"_ARRAY_DIMENSIONS": list(dimensions), **about},
    )
    array[...] = values
