"""Lines of sight as a few points each: straight or bent by refraction, short steps where the air changes.

A line is followed by the steps of `steps`.  Within a step optical depth and scattered light are two-point Gauss sums.
A `RayBundle` holds many lines at once: what depends on the air alone, for any sun.

Arguments that the kernels share: profile: `Profile`; altitude_km, z [km]: of the point; psi [rad]: geocentric angle
from the start of the line; a [rad]: elevation of the line at the point; travelled, s [km]: its length up to there.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.gases import ciddor_refractivity
from twilight.atmosphere.medium import Medium, with_joined_refractivity
from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.transport.profile import Profile, locate
from twilight.transport.steps import GAUSS_HIGH, GAUSS_LOW, INSIDE_KM, advance, distance_to_sphere, step, step_length

ALTITUDE, ANGLE, COSINE, DISTANCE = range(4)
"""Columns of `Line.place`."""

END_ANGLE, END_COSINE, END_DISTANCE = range(3)
"""Elements of `Line.end`."""

MAX_POINTS = 3000
"""Points of a line in air without stops; each stop may add four."""

LONG_STEP_KM = 5.0
"""A longer step is two points [km]: the sunbeam changes by e within tens of km along a line near the terminator."""

THICK_STEP = 0.5
"""A step of more optical depths than this is two points too: in thick air the beam changes by e within it."""

THICK_FINENESS = 1.0
"""Least fineness of steps in air thicker than they are made for.

With 0.4, 1.7 optical depths a step, thick haze was 3 % too bright after tens of orders of scattering.
"""

OPAQUE_DEPTH = 40.0
"""Optical depth at the clearest wavelength behind which a line is not followed.

In deep twilight light of a far, lit place is brighter by that much.  With 25, 380 nm alone below a volcanic cloud was
3.5 % off with the sun at -18 deg.
"""

_SAME_KM = 1e-9
"""Distances that differ by less are the same [km]."""

BENDING_NM = 550.0
"""Wavelength whose index bends lines of sight at all wavelengths [nm]."""

GRADIENT_KM = 1e-3
"""Half of the difference of altitude over which the gradient of the index is taken [km]."""

OUT, GROUND = 0, 1
"""What a line ends on: space (or its greatest length), the ground."""


class Line(NamedTuple):
    """One line of sight for kernels to fill; the first `count` rows hold its points, from the start outwards.

    place (P, 4): ALTITUDE [km], geocentric ANGLE from the start [rad], COSINE of the local zenith angle, path DISTANCE
    from the start [km]; weight (P, W): scattering coefficient x transmittance x length.
    transmittance (W,): to the end of the line; end (3,): END_ANGLE, END_COSINE and END_DISTANCE, as ANGLE, COSINE and
    DISTANCE there.
    """

    place: np.ndarray
    weight: np.ndarray
    transmittance: np.ndarray
    end: np.ndarray


@njit(inner=True, cache=True)
def new_line(profile):
    """Room for one line through `profile`."""
    n_w = profile.extinction.shape[1]
    rows = MAX_POINTS + 4 * profile.stop_km.size
    return Line(np.empty((rows, 4)), np.empty((rows, n_w)), np.empty(n_w), np.empty(3))


def with_refraction(profile: Profile, medium: Medium) -> Profile:
    """The same profile, in which rays are bent by the index of `medium` at BENDING_NM, whatever its wavelengths are.

    Dispersion across the visible moves a line at the horizon by 0.01 deg.  An index that jumps between layers is
    joined.
    """
    if not medium.has_refraction:
        return profile
    nearest = int(np.argmin(np.abs(medium.wavelength_nm - BENDING_NM)))
    own, at_bending = ciddor_refractivity(np.array([medium.wavelength_nm[nearest], BENDING_NM]), 288.15, 1013.25)
    at_sight = with_joined_refractivity(medium.select(slice(nearest, nearest + 1)))
    z = profile.altitude_km
    low, high = np.maximum(z - GRADIENT_KM, z[0]), np.minimum(z + GRADIENT_KM, z[-1])
    refractivity = (at_bending / own) * at_sight.at(np.stack([low, high])).refractivity[:, :, 0]
    return profile._replace(gradient_per_km=np.diff(np.log1p(refractivity), axis=0)[0] / (high - low))


def horizon_cosine(profile: Profile, altitude_km: np.ndarray, touched_km: np.ndarray | None = None) -> np.ndarray:
    """Cosines (Z,) of the zenith angles under which rays from these altitudes touch the ground, 0 from the ground on.

    Where n is the index and r the distance to the Earth's centre, n r sin(zenith angle) is the same all along a ray.
    Refraction raises the horizon by 0.02 to 0.19 deg: from above, light comes from around the Earth's edge.  0 too
    where rays that leave the ground level are turned back to it.

    touched_km (Z,): altitudes [km] that they touch in place of the ground
    """
    z = profile.altitude_km
    touched = np.full(altitude_km.shape, z[0]) if touched_km is None else touched_km
    gradient = profile.gradient_per_km
    log_index = np.insert(np.cumsum(0.5 * np.diff(z) * (gradient[1:] + gradient[:-1])), 0, 0.0)
    ratio = np.log((profile.earth_radius_km + touched) / (profile.earth_radius_km + altitude_km))
    log_sine = ratio - np.interp(altitude_km, z, log_index) + np.interp(touched, z, log_index)
    return -np.sqrt(-np.expm1(2.0 * np.minimum(0.0, log_sine)))


@njit(inner=True, cache=True)
def trace_line(profile, altitude_km, cos_zenith, fineness, pairs, line, far_km=math.inf):
    """Follow a line of sight and fill `line`; returns (number of points, OUT or GROUND).

    Steps grow once a line has used up half of its room, so that its end is reached in any air.

    altitude_km: of the start, in the air, on the ground or above the top (then the line begins where it enters;
    one that misses the air has no points); cos_zenith: of the direction there.
    pairs: keep both Gauss points of every step; otherwise those of a step up to LONG_STEP_KM are one point between.
    far_km: distance from the start at which the line ends at the latest.

    fineness: of the steps, 1 is usual.
    """
    place, weight, transmittance, end = line
    stop = profile.stop_km
    bottom, top = stop[0], stop[stop.size - 1]
    radius = profile.earth_radius_km
    k, sigma = profile.extinction, profile.scattering
    most, guide, clear = profile.thickest_per_km, profile.guide_per_km, profile.clearest_per_km
    negligible = profile.negligible
    n_w = transmittance.size
    rows = place.shape[0]
    z, psi, a = altitude_km, 0.0, math.asin(min(1.0, max(-1.0, cos_zenith)))
    for w in range(n_w):
        transmittance[w] = 1.0
    travelled = 0.0
    end[END_ANGLE], end[END_COSINE], end[END_DISTANCE] = 0.0, cos_zenith, 0.0
    if z > top:
        s = distance_to_sphere(z, cos_zenith, top, radius)
        if s < 0.0 or s >= far_km:
            return 0, OUT
        psi = math.atan2(s * math.cos(a), radius + z + s * cos_zenith)
        a = a + psi
        z = top
        travelled = s
    elif z <= bottom:
        if cos_zenith < 0.0:
            return 0, GROUND
        z = bottom
    passed = np.zeros(n_w)
    start = travelled
    n = 0
    depth = darkest = least = 0.0
    status = -1
    j = min(max(np.searchsorted(stop, z, side="right") - 1, 0), stop.size - 2)
    for _ in range(4 * rows):
        if n >= rows - 2:
            break
        left = max(0.02, min(1.0, 2.0 - 2.0 * n / rows))
        lowest, highest = stop[j] + INSIDE_KM, stop[j + 1] - INSIDE_KM
        inside = max(lowest, min(highest, z))
        fine, thick_fine = left * fineness, left * max(fineness, THICK_FINENESS)
        h = step_length(profile, inside, math.sin(a), travelled - start, fine, thick_fine, depth, darkest)
        h = min(h, far_km - travelled)
        h, z_end, psi_end, a_end, j_end = step(profile, j, z, psi, a, h)
        if h > 0.0:
            z0, psi0, a0 = advance(profile, z, psi, a, GAUSS_LOW * h)
            z1, psi1, a1 = advance(profile, z, psi, a, GAUSS_HIGH * h)
            i0, f0 = locate(profile, max(lowest, min(highest, z0)))
            i1, f1 = locate(profile, max(lowest, min(highest, z1)))
            low_most = most[i0] * (1 - f0) + most[i0 + 1] * f0
            thickest = max(low_most, most[i1] * (1 - f1) + most[i1 + 1] * f1)
            two = pairs or h > LONG_STEP_KM or thickest * h > THICK_STEP
            # the place of the one point of a step must not depend on the other wavelengths
            low_guide = guide[i0] * (1 - f0) + guide[i0 + 1] * f0
            high_guide = guide[i1] * (1 - f1) + guide[i1 + 1] * f1
            if low_guide >= low_most:
                darkest += 0.5 * h * (low_guide + high_guide)
            high_guide *= math.exp((GAUSS_LOW - GAUSS_HIGH) * 0.5 * h * (low_guide + high_guide))
            is_bright = False
            clearest = 1e300
            for w in range(n_w):
                k0 = 0.5 * h * (k[i0, w] * (1 - f0) + k[i0 + 1, w] * f0)
                k1 = 0.5 * h * (k[i1, w] * (1 - f1) + k[i1 + 1, w] * f1)
                tau = k0 + k1
                # light at the second point over that at the first: the first alone may be 0 in double precision
                t1 = math.exp((GAUSS_LOW - GAUSS_HIGH) * tau)
                # what a step takes from the light, exactly: thick conservative air sums thousands of scatterings
                taken = k0 + k1 * t1
                t = 0.5 * h * math.exp(-passed[w]) * (-math.expm1(-tau) / taken if taken > 1e-280 else 1.0)
                low = t * (sigma[i0, w] * (1 - f0) + sigma[i0 + 1, w] * f0)
                high = t * t1 * (sigma[i1, w] * (1 - f1) + sigma[i1 + 1, w] * f1)
                passed[w] += tau
                is_bright = is_bright or low + high > negligible[w]
                clearest = min(clearest, passed[w])
                if two:
                    weight[n, w] = low
                    weight[n + 1, w] = high
                else:
                    weight[n, w] = low + high
            s_low, s_high = travelled + GAUSS_LOW * h, travelled + GAUSS_HIGH * h
            depth += 0.5 * h * (clear[i0] * (1 - f0) + clear[i0 + 1] * f0)
            depth += 0.5 * h * (clear[i1] * (1 - f1) + clear[i1 + 1] * f1)
            least = clearest
            if is_bright:
                if two:
                    _put(place[n], z0, psi0, a0, s_low)
                    n += 1
                    _put(place[n], z1, psi1, a1, s_high)
                else:
                    g = high_guide / (low_guide + high_guide)
                    _put(
                        place[n],
                        z0 + g * (z1 - z0),
                        psi0 + g * (psi1 - psi0),
                        a0 + g * (a1 - a0),
                        s_low + g * (s_high - s_low),
                    )
                n += 1
        travelled += h
        z, psi, a, j = z_end, psi_end, a_end, j_end
        if j < 0:
            status = GROUND
        elif j > stop.size - 2 or travelled >= far_km - _SAME_KM:
            status = OUT
        if status >= 0 or least > OPAQUE_DEPTH:
            break
    for w in range(n_w):
        transmittance[w] = math.exp(-passed[w])
    end[END_ANGLE], end[END_COSINE], end[END_DISTANCE] = psi, math.sin(a), travelled
    return n, (GROUND if status == GROUND else OUT)


@njit(inner=True, cache=True, makes_arrays=False)
def weight_by_species(profile, altitude_km, weight, out):
    """Part out (1 + K, W) of each species in the scattering `weight` (W,) of a point."""
    i, f = locate(profile, altitude_km)
    for w in range(weight.size):
        total = profile.scattering[i, w] * (1.0 - f) + profile.scattering[i + 1, w] * f
        factor = weight[w] / total if total > 0.0 else 0.0
        for c in range(out.shape[0]):
            species = profile.species_scattering[c, i, w] * (1.0 - f) + profile.species_scattering[c, i + 1, w] * f
            out[c, w] = factor * species


@njit(inner=True, cache=True, makes_arrays=False)
def per_scattering(profile, altitude_km, weight, out):
    """The `weight` (W,) of a point over its scattering coefficient [km] into out (W,): transmittance x length."""
    i, f = locate(profile, altitude_km)
    for w in range(weight.size):
        total = profile.scattering[i, w] * (1.0 - f) + profile.scattering[i + 1, w] * f
        out[w] = weight[w] / total if total > 0.0 else 0.0


@njit(inner=True, cache=True, inline=True, makes_arrays=False)
def _put(row, z, psi, a, s):
    """Fill a point's row (4,) of `Line`."""
    row[ALTITUDE] = z
    row[ANGLE] = psi
    row[COSINE] = math.sin(a)
    row[DISTANCE] = s


class RayBundle(NamedTuple):
    """R rays with P points in all.

    first (R + 1,): where the points of each ray start; place (P, 4), weight (P, W): as in `Line`
    ground_weight (R, W): transmittance to the ground, 0 for rays that miss it; ground_angle_rad (R,): geocentric angle
        from the start of the ray to where it meets the ground
    passed (R, W): transmittance to the end of each ray, whatever it ends on
    """

    first: np.ndarray
    place: np.ndarray
    weight: np.ndarray
    ground_weight: np.ndarray
    ground_angle_rad: np.ndarray
    passed: np.ndarray


@njit(cache=True, nogil=True)
def _trace(profile, altitude_km, cosine, far_km, fineness, pairs, store, rays, begin, end):
    """Trace rays: count their points into rays.first[r + 1], or store them from rays.first[r] on.

    profile: `Profile`; altitude_km (R,), cosine (R,), far_km (R,), fineness, pairs: as `lines.trace_line` has them;
    store: keep the points, else count; rays: `RayBundle`, filled; begin, end: the first ray and the one after the last.
    """
    line = new_line(profile)
    for r in range(begin, end):
        n, status = trace_line(profile, altitude_km[r], cosine[r], fineness, pairs, line, far_km[r])
        if not store:
            rays.first[r + 1] = n
            continue
        # by loops: an assignment of slices brings the text of numba's error with it, 3 s to compile
        for k in range(n):
            for i in range(line.place.shape[1]):
                rays.place[rays.first[r] + k, i] = line.place[k, i]
            for w in range(line.weight.shape[1]):
                rays.weight[rays.first[r] + k, w] = line.weight[k, w]
        rays.ground_angle_rad[r] = line.end[END_ANGLE]
        for w in range(line.transmittance.size):
            rays.passed[r, w] = line.transmittance[w]
            rays.ground_weight[r, w] = line.transmittance[w] if status == GROUND else 0.0


def trace_rays(
    profile: Profile,
    altitude_km: np.ndarray,
    cosine: np.ndarray,
    fineness: float,
    *,
    pairs: bool = False,
    far_km: np.ndarray | None = None,
) -> RayBundle:
    """Rays that start at `altitude_km` (R,) under `cosine` (R,); each is traced twice, to count points and to store.

    pairs: two points for every step; otherwise one for short steps.  far_km (R,): distance at which each ends at the
    latest; None: none does.
    """
    # in C order: the kernel is compiled for each order of its arrays
    far = np.full(altitude_km.size, np.inf) if far_km is None else np.ascontiguousarray(far_km, dtype=float)
    n_rays, n_w = altitude_km.size, profile.extinction.shape[1]
    first = np.zeros(n_rays + 1, np.int64)

    def trace(n_points: int, store: bool) -> RayBundle:
        rays = RayBundle(
            first,
            np.empty((n_points, 4)),
            np.empty((n_points, n_w)),
            np.zeros((n_rays, n_w)),
            np.zeros(n_rays),
            np.ones((n_rays, n_w)),
        )
        in_slices(
            lambda begin, end: _trace(profile, altitude_km, cosine, far, fineness, pairs, store, rays, begin, end),
            n_rays,
        )
        return rays

    trace(1, False)
    np.cumsum(first, out=first)
    return trace(int(first[-1]), True)


def species_fraction(profile: Profile, altitude_km: np.ndarray, some: slice = slice(None)) -> np.ndarray:
    """Fraction (1 + K, P, W) of air and of each aerosol phase function in the scattering at altitudes (P,) [km] of the
    profile, at some of its wavelengths."""
    levels, scattering = profile.altitude_km, profile.species_scattering[..., some]
    i = np.clip(np.searchsorted(levels, altitude_km, side="right") - 1, 0, levels.size - 2)
    step = levels[i + 1] - levels[i]
    f = ((altitude_km - levels[i]) / np.where(step > 0.0, step, 1.0))[:, None]
    species = scattering[:, i] * (1.0 - f) + scattering[:, i + 1] * f
    total = species.sum(axis=0)
    fraction = np.where(total > 0, species / np.where(total > 0, total, 1.0), 0.0)
    fraction[0] = np.where(total > 0, fraction[0], 1.0)
    return fraction
