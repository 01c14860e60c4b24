"""Lines of sight through a solved field: their points, and light scattered at least twice along them.

The points depend on the air and the elevation, not on the sun: the last lines of sight are cached.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

import numpy as np

from twilight.jit.kernels import njit
from twilight.jit.simd import LANES, exp, load, maximum, store
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones.next_order import (
    MIN_SOURCE,
    ONE,
    ZERO,
    empty_slab_source,
    fill_slab_source,
    sum_intensity,
    sum_q_and_u,
)
from twilight.solvers.zones.ray_points import RayPoints
from twilight.transport.beam import Beam, beam_at
from twilight.transport.lines import ALTITUDE, ANGLE, COSINE, RayBundle, species_fraction, trace_rays
from twilight.transport.profile import Profile

MAX_CACHE_BYTES = 64 << 20
"""Bytes that the cached lines of sight may take together."""
MIN_REFRACTION_RAD = math.radians(0.01)
"""Least angle [rad] by which the sun is lifted and rays are lowered to evaluate phase functions a second time."""
SUNSET_RAD = math.radians(1e-4)
"""Tolerance [rad] of the solar zenith angle at which the sun sets."""


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
    altitude_km: float,
    ends: np.ndarray,
    density: float,
    with_ground: bool,
    pairs_for_all: bool = False,
) -> LinesOfSight:
    """Lines of sight from an altitude at ends (2, R): elevation [deg], and distance [km] at which each stops.

    profile: through which they go; density: of their points; pairs_for_all: two points a step for light scattered more
    than once too, which across a thin layer is one step or two.
    """
    start, cosine = np.full(ends.shape[1], altitude_km), np.sin(np.radians(ends[0]))
    rays = trace_rays(profile, start, cosine, density, pairs=pairs_for_all, far_km=ends[1])
    pairs = trace_rays(
        profile,
        start,
        cosine,
        max(tuned.MIN_SINGLE_DENSITY, tuned.SINGLE_DENSITY_FACTOR * density),
        pairs=True,
        far_km=ends[1],
    )
    if not with_ground:
        rays, pairs = (r._replace(ground_weight=np.zeros_like(r.ground_weight)) for r in (rays, pairs))
    of_rays, of_pairs = (np.ascontiguousarray(species_fraction(profile, r.place[:, ALTITUDE])) for r in (rays, pairs))
    return LinesOfSight(rays, pairs, of_rays, of_pairs)


def sun_lift(beam: Beam, altitude_km: float, zenith_rad: float) -> float:
    """By how much refraction lifts the sun [rad] for an observer; where it has set, by how much when it did.

    So the lift has no jump when the sun sets, in which the sky beside it would jump, too.

    altitude_km: of the observer; zenith_rad: of the true sun
    """
    light = np.zeros(beam.n_wavelengths)
    bending = beam_at(beam, altitude_km, math.cos(zenith_rad), light)
    if light.any():
        return bending
    up, down, bending = 0.5 * math.pi, zenith_rad, 0.0
    while down - up > SUNSET_RAD:
        between = 0.5 * (up + down)
        lift = beam_at(beam, altitude_km, math.cos(between), light)
        if light.any():
            up, bending = between, lift
        else:
            down = between
    return bending


def lift_and_lowering(rays, elevation: np.ndarray, lift: float) -> tuple[float, np.ndarray]:
    """By how much the sun is lifted and each of R rays is lowered [rad] to evaluate its phase functions again.

    Refraction does both, by more or by less at each point of a ray, and phase functions are linear between these two
    and the sun and the ray as they are.  So the two are the most that the points of the ray see: the lift of the sun at
    the observer, and the bending of the ray to its end.  Half a degree for all would make the peak of coarse particles,
    which doubles within that, 5 % too bright a degree from a sun at 5 deg.

    rays: `RayBundle`; elevation (R,): apparent [rad]; lift: of the sun at the observer [rad]
    """
    ends = rays.first[1:] - 1
    lowered = np.full(elevation.size, MIN_REFRACTION_RAD)
    some = ends >= rays.first[:-1]
    place = rays.place[ends[some]]
    lowered[some] = elevation[some] - (np.arcsin(np.clip(place[:, COSINE], -1.0, 1.0)) - place[:, ANGLE])
    return max(lift, MIN_REFRACTION_RAD), np.maximum(lowered, MIN_REFRACTION_RAD)


@njit(inner=True, cache=True, inline=True)
def nodes_around(nodes_rad, zenith, psi):
    """First and last of the nodes of solar zenith angle, nodes_rad (T,), around what points at the geocentric angle psi
    [rad] from the observer may have, in any azimuth; zenith [rad]: the observer's."""
    last = nodes_rad.size - 1
    low = max(0, np.searchsorted(nodes_rad, zenith - psi, side="right") - 1)
    high = min(last, np.searchsorted(nodes_rad, zenith + psi))
    low = min(low, last - 1)
    return low, max(high, low + 1)


@njit(inner=True, cache=True, inline=True)
def fine_interval(fine, angle, low, high):
    """Interval j of a fine grid of solar zenith angles that holds `angle`, within low..high, and the way into it.

    fine (T',) [rad]: the grid; angle [rad].
    """
    j = min(max(np.searchsorted(fine, angle, side="right") - 1, low), high)
    return j, np.float32(min(1.0, max(0.0, (angle - fine[j]) / (fine[j + 1] - fine[j]))))


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def view_multiple(rays, point, directions, light, grid, series, out, begin, end):
    """Light scattered at least twice, out (D, Stokes, LANES), for rays begin..end; U as to the right of the sun.

    rays: `RayBundle`, its ground_weight (R, LANES) that of the wavelengths of the block
    point: `RayPoints`; directions: `RayDirections`; light: `RadianceField`; grid: `ZenithGrid`; series: `Truncation`
    The Stokes axis has 1 or 3 entries.
    """
    fine, ground_weight = grid.fine_rad, rays.ground_weight
    per_interval = grid.per_interval
    source = empty_slab_source(point, light, grid, series)
    log_mean, amplitudes = source.log_mean, source.amplitude
    sums = np.zeros((3, LANES), np.float32)
    zenith = directions.zenith_rad
    ct, st = math.cos(zenith), math.sin(zenith)
    for r in range(begin, end):
        if directions.first[r] == directions.first[r + 1]:
            continue
        for k in range(rays.first[r], rays.first[r + 1]):
            psi = rays.place[k, ANGLE]
            low, high = nodes_around(grid.nodes_rad, zenith, psi)
            fill_slab_source(point, k, light, grid, series, low, high, source)
            strength = load(point.weight, k)
            highest = point.highest[k]
            cp, sp = math.cos(psi), math.sin(psi)
            for d in range(directions.first[r], directions.first[r + 1]):
                ahead = -sp * ct + cp * st * directions.cos_azimuth[d]
                up = cp * ct + sp * st * directions.cos_azimuth[d]
                across = math.sqrt(max(0.0, 1.0 - up * up))
                c = np.float32(min(1.0, max(-1.0, ahead / max(across, 1e-9))))
                angle = math.acos(min(1.0, max(-1.0, up)))
                j, b1 = fine_interval(fine, angle, low * per_interval, high * per_interval - 1)
                b0 = ONE - b1
                mean = strength * exp(b0 * load(log_mean, j) + b1 * load(log_mean, j + 1))
                store(sums, 0, mean * maximum(sum_intensity(amplitudes, j, b0, b1, c, highest), MIN_SOURCE))
                if out.shape[1] > 1:
                    q, u = sum_q_and_u(amplitudes, j, b0, b1, c, series.azimuthal_orders, series.spin2_orders)
                    store(sums, 1, mean * q)
                    store(sums, 2, mean * u)
                for s in range(out.shape[1]):
                    for w in range(LANES):
                        out[d, s, w] += sums[s, w]
        if ground_weight[r].max() > ZERO:
            cp, sp = math.cos(rays.ground_angle_rad[r]), math.sin(rays.ground_angle_rad[r])
            for d in range(directions.first[r], directions.first[r + 1]):
                angle = math.acos(min(1.0, max(-1.0, cp * ct + sp * st * directions.cos_azimuth[d])))
                j, b1 = fine_interval(fine, angle, 0, fine.size - 2)
                for w in range(ground_weight.shape[1]):
                    out[d, 0, w] += ground_weight[r, w] * math.exp(
                        (ONE - b1) * light.log_ground[j, w] + b1 * light.log_ground[j + 1, w]
                    )
