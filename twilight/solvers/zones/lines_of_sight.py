"""Cached lines of sight: their points depend on the air and the elevation, not on the sun."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.solvers.zones.ray_points import RayPoints
from twilight.transport.lines import ALTITUDE, RayBundle, species_fraction, trace_rays
from twilight.transport.profile import Profile

MAX_CACHE_BYTES = 64 << 20
"""Bytes that the cached lines of sight may take together."""
SINGLE_DENSITY_FACTOR = 1.5
"""Density of steps on a line of sight for light scattered once, over that for light scattered more often."""
MIN_SINGLE_DENSITY = 2.25
"""Least density of steps on a line of sight for light scattered once."""


@dataclass
class LinesOfSight:
    """Lines of sight from one altitude at R elevations.

    rays: for light scattered more than once; pairs: for light scattered once, two points a step
    rays_fraction, pairs_fraction (1 + K, P, W): of each species in what their points scatter
    points: of `rays`, for each block of wavelengths
    """

    rays: RayBundle
    pairs: RayBundle
    rays_fraction: np.ndarray
    pairs_fraction: np.ndarray
    points: dict[int, RayPoints] = field(default_factory=dict)

    @property
    def n_bytes(self) -> int:
        """Of all arrays."""
        tuples = [self.rays, self.pairs, *self.points.values()]
        return (
            self.rays_fraction.nbytes
            + self.pairs_fraction.nbytes
            + sum(array.nbytes for arrays in tuples for array in arrays)
        )


class LineCache:
    """The last lines of sight that were asked for, as many as MAX_CACHE_BYTES hold."""

    def __init__(self) -> None:
        self._cached: OrderedDict[Hashable, LinesOfSight] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], LinesOfSight]) -> LinesOfSight:
        """The lines of sight of a key, which holds all that they depend on."""
        lines = self._cached.pop(key, None)
        if lines is None:
            lines = make()
        self._cached[key] = lines
        return lines

    def trim(self) -> None:
        """Drop the oldest until the others fit in MAX_CACHE_BYTES."""
        while self._cached and sum(s.n_bytes for s in self._cached.values()) > MAX_CACHE_BYTES:
            self._cached.popitem(last=False)


def trace_lines_of_sight(
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
    pairs = trace_rays(
        profile, start, cosine, max(MIN_SINGLE_DENSITY, SINGLE_DENSITY_FACTOR * density), pairs=True, far_km=ends[1]
    )
    if not with_ground:
        rays, pairs = (r._replace(ground_weight=np.zeros_like(r.ground_weight)) for r in (rays, pairs))
    of_rays, of_pairs = (np.ascontiguousarray(species_fraction(scaled, r.place[:, ALTITUDE])) for r in (rays, pairs))
    return LinesOfSight(rays, pairs, of_rays, of_pairs)
