"""Lines of sight: what depends on the air and the elevation alone is kept for the next sun."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

import numpy as np

from twilight.solvers.zones.paths import Points
from twilight.transport.bundle import Rays

MOST_BYTES = 64 << 20
"""Lines of sight that take more are not kept."""


@dataclass
class Sights:
    """Lines of sight from one altitude at R elevations.

    rays: for light scattered more than once; pairs: for light scattered once, two points a step, and share
    (1 + K, P, W) of each species in what these scatter; points: of `rays`, for each block of wavelengths asked for.
    """

    rays: Rays
    pairs: Rays
    share: np.ndarray
    points: dict[int, Points] = field(default_factory=dict)

    @property
    def n_bytes(self) -> int:
        """Of all arrays."""
        tuples = [self.rays, self.pairs, *self.points.values()]
        return self.share.nbytes + sum(array.nbytes for arrays in tuples for array in arrays)


class KeptSights:
    """The last lines of sight that were asked for, as many as MOST_BYTES hold."""

    def __init__(self) -> None:
        self._kept: OrderedDict[Hashable, Sights] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], Sights]) -> Sights:
        """Those of a key, which says all that they depend on."""
        sights = self._kept.pop(key, None)
        if sights is None:
            sights = make()
        self._kept[key] = sights
        return sights

    def trim(self) -> None:
        """Let the oldest go until the rest is small enough."""
        while self._kept and sum(s.n_bytes for s in self._kept.values()) > MOST_BYTES:
            self._kept.popitem(last=False)
