"""Drawn skies by their number, for numpy and for loaders that want `__len__` and `__getitem__`.

    from torch.utils.data import DataLoader
    from twilight.studies.sweep.loader import load_skies
    loader = DataLoader(load_skies("skies.zarr"), batch_size=32, sampler=...)

Skies of one draw lie in one or a few chunks of the file, so that orders which stay with a draw for a while read fast:
`SkyDataset.batches` takes draws at random and mixes the skies of a few of them.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from twilight.base.errors import TwilightError
from twilight.studies.sweep.store import COMPUTED, PARTS
from twilight.studies.sweep.work import RADIANCE

NO_INPUTS = ("status", "split", "solar_bending")
"""Variables over draws and suns that are no inputs."""
CACHED_DRAWS = 16
"""Draws whose skies are kept in memory."""


class SkyDataset:
    """The skies that are there of one part of a sweep with draws, by their number; it can be pickled.

    Parameters
    ----------
    path
        Folder that `twilight sweep` wrote.
    part
        `train`, `validation` or `all`: no draw is in both parts.
    logarithm
        Whether targets are natural logarithms of the sun-normalised radiance, over 1 sr^-1.

    Attributes
    ----------
    names
        What each number of an input is: coordinates of the draw, then of the sun and of the observer, as the file has
        them, and the turbidity; a text counts as its index in `texts[name]`.
    inputs, draws
        Inputs of all skies (len, names), float32; the draw of each.
    elevation_deg, azimuth_deg, wavelength_nm
        Axes of a target.

    Raises
    ------
    TwilightError
        For a folder that is no sweep, or one without draws.
    """

    def __init__(
        self, path: str | Path, part: Literal["train", "validation", "all"] = "train", logarithm: bool = False
    ):
        if part != "all" and part not in PARTS:
            raise TwilightError(f"part: {part} is not known, choose one of all, {', '.join(PARTS)}")
        self.path, self.part, self.logarithm = Path(path), part, logarithm
        data = _opened(self.path)
        if "split" not in data or RADIANCE not in data:
            raise TwilightError(
                f"{path}: is no sweep with draws, as `twilight sweep` makes of a configuration with draws"
            )
        there = data["status"] == COMPUTED
        if part != "all":
            there = there & (data["split"] == PARTS[part])
        dims = data["status"].dims
        self._drawn = dims.index("draw")
        self._scenes = np.argwhere(there.transpose(*dims).values)
        self.draws = self._scenes[:, self._drawn]
        self.texts: dict[str, list[str]] = {}
        columns: dict[str, np.ndarray] = {}
        for name in sorted(map(str, data.variables)):
            along = data[name].dims
            if along and set(along) <= set(dims) and name not in NO_INPUTS:
                values = data[name].values
                if not np.issubdtype(values.dtype, np.number):
                    known, codes = np.unique(values.astype(object), return_inverse=True)
                    self.texts[name] = known.tolist()
                    values = codes.reshape(values.shape)
                columns[name] = values[tuple(self._scenes[:, dims.index(d)] for d in along)].astype(np.float32)
        if "solar_elevation_angle" in columns:
            columns.pop("sun_elevation_deg", None)  # the same
        self.names, self.inputs = tuple(columns), np.stack(list(columns.values()), axis=-1)
        self.elevation_deg, self.azimuth_deg = data["elevation"].values, data["azimuth"].values
        self.wavelength_nm = data["wavelength"].values
        self._skies = functools.lru_cache(CACHED_DRAWS)(lambda draw: data[RADIANCE].isel(draw=draw).values)

    def __reduce__(self) -> tuple[Any, ...]:
        """Without the skies that it holds in memory: a loader's processes read for themselves."""
        return SkyDataset, (self.path, self.part, self.logarithm)

    def __len__(self) -> int:
        return len(self._scenes)

    def __getitem__(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Input (names,) and target (elevation, azimuth, wavelength) of a sky, float32 both.

        The target is sun-normalised radiance [sr^-1]; azimuths run from the sun to 180 deg, the rest is its mirror.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"{index}: the {self.part} part has {len(self)} skies")
        target = self._skies(int(self.draws[index]))[tuple(np.delete(self._scenes[index], self._drawn))]
        return self.inputs[index], np.log(target) if self.logarithm else target.copy()

    def batches(self, size: int, seed: int = 0) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Every sky once, in batches of inputs (n, names) and targets (n, elevation, azimuth, wavelength).

        Draws come in a random order, `CACHED_DRAWS` at a time, whose skies are mixed.
        """
        random = np.random.default_rng(seed)
        draws = random.permutation(np.unique(self.draws))
        for start in range(0, draws.size, CACHED_DRAWS):
            skies = random.permutation(np.flatnonzero(np.isin(self.draws, draws[start : start + CACHED_DRAWS])))
            for first in range(0, skies.size, size):
                pairs = [self[int(i)] for i in skies[first : first + size]]
                yield np.stack([pair[0] for pair in pairs]), np.stack([pair[1] for pair in pairs])


load_skies = SkyDataset


def _opened(path: Path) -> Any:
    import xarray  # optional

    try:
        return xarray.open_zarr(path, chunks=None, decode_times=False)
    except (OSError, ValueError) as error:
        raise TwilightError(f"{path}: is not the dataset of a sweep ({error})") from None
