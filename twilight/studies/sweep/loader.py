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
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from twilight.base.errors import TwilightError
from twilight.studies.sweep.store import COMPUTED, PARTS

RADIANCE = "sun_normalised_radiance"
SPLIT = "split"
NO_INPUTS = ("status", SPLIT, "solar_bending")
"""Variables over draws and suns that are no inputs."""
CACHED_DRAWS = 16
"""Draws whose skies are kept in memory."""


def load_skies(
    path: str | Path, part: Literal["train", "validation", "all"] = "train", logarithm: bool = False
) -> SkyDataset:
    """The skies that are there of one part of a sweep with draws.

    Parameters
    ----------
    path
        Folder that `twilight sweep` wrote.
    part
        `train`, `validation` or `all`: no draw is in both parts.
    logarithm
        Whether targets are natural logarithms of the sun-normalised radiance, over 1 sr^-1.

    Raises
    ------
    TwilightError
        For a folder that is no sweep, or one without draws.
    """
    if part != "all" and part not in PARTS:
        raise TwilightError(f"part: {part} is not known, choose one of all, {', '.join(PARTS)}")
    path = Path(path)
    group = _opened(path)
    if SPLIT not in group or RADIANCE not in group:
        raise TwilightError(f"{path}: is no sweep with draws, as `twilight sweep` makes of a configuration with draws")
    (drawn,) = group[SPLIT].attrs["_ARRAY_DIMENSIONS"]
    dimensions = list(group[RADIANCE].attrs["_ARRAY_DIMENSIONS"])[:-3]
    there = group["status"][...] == COMPUTED
    if part != "all":
        shape = [-1 if name == drawn else 1 for name in dimensions]
        there = there & (group[SPLIT][...] == PARTS[part]).reshape(shape)
    scenes = np.argwhere(there)
    texts: dict[str, list[str]] = {}
    columns: dict[str, np.ndarray] = {}
    for name in sorted(group.array_keys()):
        along = group[name].attrs.get("_ARRAY_DIMENSIONS", [])
        if along and set(along) <= set(dimensions) and name not in NO_INPUTS:
            values = group[name][...]
            if not np.issubdtype(values.dtype, np.number):
                known, codes = np.unique(values.astype(str), return_inverse=True)
                texts[name] = known.tolist()
                values = codes.reshape(values.shape)
            columns[name] = values[tuple(scenes[:, dimensions.index(d)] for d in along)].astype(np.float32)
    if "solar_elevation_angle" in columns:
        columns.pop("sun_elevation_deg", None)  # the same
    return SkyDataset(
        path,
        part,
        logarithm,
        names=tuple(columns),
        texts=texts,
        inputs=np.stack(list(columns.values()), axis=-1),
        scenes=scenes,
        drawn=dimensions.index(drawn),
        elevation_deg=group["elevation"][...],
        azimuth_deg=group["azimuth"][...],
        wavelength_nm=group["wavelength"][...],
    )


def _opened(path: Path) -> Any:
    import zarr  # start-up

    try:
        return zarr.open_group(path, mode="r")
    except (OSError, ValueError) as error:
        raise TwilightError(f"{path}: is not the dataset of a sweep ({error})") from None


@dataclass
class SkyDataset:
    """Skies by their number, as `load_skies` finds them; it can be pickled.

    names: what each number of an input is: coordinates of the draw, then of the sun and of the observer, as the file
        has them, and the turbidity; a text counts as its index in texts[name]
    inputs (len, names), float32; scenes (len, dimensions): indices of each sky in the file
    drawn: which of the dimensions is that of the draws
    elevation_deg, azimuth_deg, wavelength_nm: axes of a target
    """

    path: Path
    part: str
    logarithm: bool
    names: tuple[str, ...]
    texts: dict[str, list[str]]
    inputs: np.ndarray
    scenes: np.ndarray
    drawn: int
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    wavelength_nm: np.ndarray

    def __post_init__(self) -> None:
        self._skies = functools.lru_cache(CACHED_DRAWS)(self._read)

    def _read(self, draw: int) -> np.ndarray:
        place: list[Any] = [slice(None)] * self.scenes.shape[1]
        place[self.drawn] = draw
        return np.asarray(_opened(self.path)[RADIANCE][tuple(place)], dtype=np.float32)

    def __len__(self) -> int:
        return len(self.scenes)

    @property
    def draws(self) -> np.ndarray:
        """The draw of each sky, (len,): no draw is in both parts."""
        return self.scenes[:, self.drawn]

    def __getitem__(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Input (names,) and target (elevation, azimuth, wavelength) of a sky, float32 both.

        The target is sun-normalised radiance [sr^-1]; azimuths run from the sun to 180 deg, the rest is its mirror.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"{index}: the {self.part} part has {len(self)} skies")
        scene = self.scenes[index]
        rest = tuple(int(i) for d, i in enumerate(scene) if d != self.drawn)
        target = self._skies(int(scene[self.drawn]))[rest]
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

    def __getstate__(self) -> dict[str, Any]:
        """Without the skies that it holds in memory: a loader's processes read for themselves."""
        return {name: value for name, value in vars(self).items() if name != "_skies"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.__post_init__()
