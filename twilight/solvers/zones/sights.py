"""Lines of sight: what depends on the air and the elevation alone is kept for the next sun."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.solvers.zones.paths import Points
from twilight.transport.bundle import Rays, species_share, trace_rays
from twilight.transport.lines import ALTITUDE
from twilight.transport.profile import Profile

MOST_BYTES = 64 << 20
"""Lines of sight that take more are not kept."""
SHARP, LEAST_SHARP = 1.5, 2.25
"""Density of steps on a line of sight for light scattered once: over that for the rest, and at least."""


@dataclass
class LinesOfSight:
    """Lines of sight from one altitude at R elevations.

    rays: for light scattered more than once; pairs: for light scattered once, two points a step; and the share
    (1 + K, P, W) of each species in what their points scatter; points: of `rays`, for each block of wavelengths.
    """

    rays: Rays
    pairs: Rays
    rays_share: np.ndarray
    pairs_share: np.ndarray
    points: dict[int, Points] = field(default_factory=dict)

    @property
    def n_bytes(self) -> int:
        """Of all arrays."""
        tuples = [self.rays, self.pairs, *self.points.values()]
        return (
            self.rays_share.nbytes
            + self.pairs_share.nbytes
            + sum(array.nbytes for arrays in tuples for array in arrays)
        )


class KeptLines:
    """The last lines of sight that were asked for, as many as MOST_BYTES hold."""

    def __init__(self) -> None:
        self._kept: OrderedDict[Hashable, LinesOfSight] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], LinesOfSight]) -> LinesOfSight:
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


def make_lines(
    profile: Profile,
    scaled: Medium,
    altitude_km: float,
    ends: np.ndarray,
    density: float,
    with_ground: bool,
    pairs_for_all: bool = False,
) -> LinesOfSight:
    """Lines of sight from an altitude at ends (2, R): elevation [deg], and distance [km] at which each stops.

    profile: through which they go; scaled: the medium that scatters; density: of their points; pairs_for_all: two
    points a step for light scattered more than once too, which across a thin layer is one step or two.
    """
    start, cosine = np.full(ends.shape[1], altitude_km), np.sin(np.radians(ends[0]))
    rays = trace_rays(profile, start, cosine, density, pairs=pairs_for_all, far_km=ends[1])
    pairs = trace_rays(profile, start, cosine, max(LEAST_SHARP, SHARP * density), pairs=True, far_km=ends[1])
    if not with_ground:
        rays, pairs = (r._replace(ground_weight=np.zeros_like(r.ground_weight)) for r in (rays, pairs))
    of_rays, of_pairs = (np.ascontiguousarray(species_share(scaled, r.place[:, ALTITUDE])) for r in (rays, pairs))
    return LinesOfSight(rays, pairs, of_rays, of_pairs)
