"""Skies of a training set by their number, for numpy and for loaders that want `__len__` and `__getitem__`.

    from torch.utils.data import DataLoader
    from twilight.studies.dataset import SkyDataset
    loader = DataLoader(SkyDataset("skies.zarr"), batch_size=32, sampler=...)

Skies of one air lie in one or a few chunks of the file, so that orders which stay with an air for a while read fast:
`SkyDataset.batches` draws airs at random and mixes the skies of a few of them.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from twilight.base.errors import TwilightError
from twilight.studies.dataset.draw import AIR, PARTS, SPLIT
from twilight.studies.sweep.store import COMPUTED

RADIANCE = "sun_normalised_radiance"
CACHED_AIRS = 16
"""Airs whose skies are kept in memory."""


class SkyDataset:
    """The skies of one part of a training set that are there.

    Parameters
    ----------
    path
        Folder that `twilight dataset` wrote.
    part
        `train`, `validation` or `all`.
    logarithm
        Whether targets are natural logarithms of the sun-normalised radiance, over 1 sr^-1.

    Attributes
    ----------
    names
        What each number of an input is: coordinates of the air, then of the sun and of the observer, as the file has
        them; a text counts as its index in `texts[name]`.
    elevation_deg, azimuth_deg, wavelength_nm
        Axes of a target.

    Raises
    ------
    TwilightError
        For a folder that is no training set.
    """

    def __init__(
        self, path: str | Path, part: Literal["train", "validation", "all"] = "train", logarithm: bool = False
    ):
        if part != "all" and part not in PARTS:
            raise TwilightError(f"part: {part} is not known, choose one of all, {', '.join(PARTS)}")
        self.path, self.part, self.logarithm = Path(path), part, logarithm
        group = self._group()
        if SPLIT not in group or group[SPLIT].attrs["_ARRAY_DIMENSIONS"] != [AIR]:
            raise TwilightError(f"{path}: is not a training set that `twilight dataset` wrote")
        self.elevation_deg, self.azimuth_deg, self.wavelength_nm = (
            group[name][...] for name in ("elevation", "azimuth", "wavelength")
        )
        dimensions = list(group[RADIANCE].attrs["_ARRAY_DIMENSIONS"])[:-3]
        there = group["status"][...] == COMPUTED
        if part != "all":
            shape = [-1 if name == AIR else 1 for name in dimensions]
            there = there & (group[SPLIT][...] == PARTS[part]).reshape(shape)
        self._scenes = np.argwhere(there)
        self._air = dimensions.index(AIR)
        self.texts: dict[str, list[str]] = {}
        self._columns: dict[str, np.ndarray] = {}
        for name in sorted(group.array_keys()):
            along = group[name].attrs.get("_ARRAY_DIMENSIONS", [])
            if along and set(along) <= set(dimensions) and name not in ("status", SPLIT, "solar_bending"):
                self._columns[name] = self._column(name, group[name][...], [dimensions.index(d) for d in along])
        if "solar_elevation_angle" in self._columns:
            self._columns.pop("sun_elevation_deg", None)  # the same
        self.names = tuple(self._columns)
        self._sky = functools.lru_cache(CACHED_AIRS)(self._read)

    def _group(self) -> Any:
        import zarr  # start-up

        try:
            return zarr.open_group(self.path, mode="r")
        except (OSError, ValueError) as error:
            raise TwilightError(f"{self.path}: is not a training set ({error})") from None

    def _column(self, name: str, values: np.ndarray, along: list[int]) -> np.ndarray:
        if not np.issubdtype(values.dtype, np.number):
            known, codes = np.unique(values.astype(str), return_inverse=True)
            self.texts[name] = known.tolist()
            values = codes.reshape(values.shape)
        return values[tuple(self._scenes[:, d] for d in along)].astype(np.float32)

    def _read(self, air: int) -> np.ndarray:
        place: list[Any] = [slice(None)] * self._scenes.shape[1]
        place[self._air] = air
        return np.asarray(self._group()[RADIANCE][tuple(place)], dtype=np.float32)

    def __len__(self) -> int:
        return len(self._scenes)

    @property
    def inputs(self) -> np.ndarray:
        """All inputs, (len, names), float32."""
        return np.stack(list(self._columns.values()), axis=-1)

    @property
    def airs(self) -> np.ndarray:
        """The air of each sky, (len,): no air is in both parts."""
        return self._scenes[:, self._air]

    def __getitem__(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Input (names,) and target (elevation, azimuth, wavelength) of a sky, float32 both.

        The target is sun-normalised radiance [sr^-1]; azimuths run from the sun to 180 deg, the rest is its mirror.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"{index}: the {self.part} part has {len(self)} skies")
        scene = self._scenes[index]
        rest = tuple(int(i) for d, i in enumerate(scene) if d != self._air)
        target = self._sky(int(scene[self._air]))[rest]
        numbers = np.array([column[index] for column in self._columns.values()], np.float32)
        return numbers, np.log(target) if self.logarithm else target.copy()

    def batches(self, size: int, seed: int = 0) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Every sky once, in batches of inputs (n, names) and targets (n, elevation, azimuth, wavelength).

        Airs come in a random order, `CACHED_AIRS` at a time, whose skies are mixed.
        """
        random = np.random.default_rng(seed)
        airs = random.permutation(np.unique(self.airs))
        for start in range(0, airs.size, CACHED_AIRS):
            skies = random.permutation(np.flatnonzero(np.isin(self.airs, airs[start : start + CACHED_AIRS])))
            for first in range(0, skies.size, size):
                pairs = [self[int(i)] for i in skies[first : first + size]]
                yield np.stack([pair[0] for pair in pairs]), np.stack([pair[1] for pair in pairs])

    def __getstate__(self) -> dict[str, Any]:
        """Without what it holds in memory: a loader's processes read for themselves."""
        return {"path": self.path, "part": self.part, "logarithm": self.logarithm}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]
