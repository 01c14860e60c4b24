"""The direct sun beam at any point of the air: one table per medium that every solver looks up.

Irradiance at normal incidence over F0 is transmittance x spreading of the refracted beam

    E/F0 = exp(-tau) n^2 sin(i)/sin(chi) / (d chi/d i),

i the apparent and chi the true zenith angle of the sun.  Its logarithm is tabulated in the coordinates of the ray that
arrives, because these follow the features of the field, which chi does not:

* a ray from above (i <= 90 deg): altitude x apparent cosine.  Only air above the point matters, so nothing is sharper
  than the levels of the medium, and tables end at every jump of a coefficient.
* a ray that has passed its lowest point: invariant p x distance u from the lowest point.  The table holds the sum of
  the logarithms of this ray and of its mirror image from above, which is the whole ray through the limb: nearly
  independent of u.  The sharp features (the limb of an aerosol layer, the ground) lie at fixed p.

Dispersion: a point and a true direction of the sun belong to a different ray at every wavelength.  Tables are laid out
for the most refracted wavelength, the reference; the table of limb rays is entered with each wavelength's own lowest
point, found from a tabulated shift that is proportional to the difference of the refractivities.

What jumps or bends strongly at an edge of a layer is in neither table but added in closed form, at every wavelength's
own ray: :mod:`twilight.transport.beam_edges`.

What the table leaves out: several images of the sun (mirages; d chi/d i is kept above 0.05), the gap in direction that
a duct makes (bridged), and dispersion of the ground's edge for rays from above (0.01 deg in the lowest metre).

In a segment between two jumps a..b the nodes are uniform in sqrt((b - z)/(b - a)): just below a jump optical depths go
like a square root.  Interpolation is cubic and never crosses a jump.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from twilight.atmosphere.medium import Medium, with_joined_refractivity
from twilight.base.errors import TwilightError
from twilight.transport import beam_edges, beam_tables
from twilight.transport import beam_lookup as lookup
from twilight.transport.beam_lookup import Beam, beam_at, beam_at_one, beam_on_ground, lit_at
from twilight.transport.beam_pack import Segments, Tables, pack
from twilight.transport.ray_profile import (
    AEROSOL,
    AIR,
    BOTTOM,
    GASES,
    LOG_SLOPE,
    RayProfile,
    ray_profile,
    refractivity_at,
)
from twilight.transport.rays import lowest_point

__all__ = ["Beam", "beam_at", "beam_at_one", "beam_on_ground", "lit_at", "prepare_beam"]

DEEPEST_DUCT_KM = 1.0
"""Air that traps light up to higher than this makes no shadow whose edge the tables could follow."""
_FAR_KM = 400.0
"""The table of limb rays holds log(E) + log(1 + u/400 km): finite however far behind the limb."""
_LIMB_PATH_KM = 600.0
"""Optical depth of the limb is about extinction x 600 km (sqrt(2 pi R H))."""


def _segments(medium: Medium, max_breaks: int, sharp_km: np.ndarray) -> np.ndarray:
    """Altitudes [km] where tables must end: jumps and strong bends of the extinction, `sharp_km` among them, the rest
    evenly cut."""
    z = medium.altitude_km
    k = medium.extinction_per_km + 1e-30
    lower, upper = k[:-1], k[1:]
    # a jump of k is worth a tenth of its horizontal path over a table step, a bend its air mass x step^2/16
    bends = {}
    for i in range(1, z.size - 1):
        if z[i] == z[i - 1] or z[i] <= z[0] or z[i] >= z[-1]:
            continue
        j = i
        while j + 1 < z.size and z[j + 1] == z[i]:
            j += 1
        jump = np.max(np.abs(k[j] - k[i]))
        below, above = z[i] - z[i - 1], z[j + 1] - z[j]
        slope_jump = np.max(np.abs((k[i] - lower[i - 1]) / below - (upper[j] - k[j]) / above))
        step = 0.1 + 0.02 * (z[i] - z[0])
        bends[float(z[i])] = (
            3.0 * jump * math.sqrt(2.0 * medium.earth_radius_km * step) / 30.0 + 2.5 * slope_jump * 0.01
        )
    strong = sorted((zz for zz, b in bends.items() if b > 1e-3), key=lambda zz: -bends[zz])[:max_breaks]
    strong += [float(e) for e in sharp_km if z[0] < e < z[-1]]
    edges = [float(z[0]), *sorted(set(strong)), float(z[-1])]
    cut = [edges[0]]
    for b in edges[1:]:
        while True:
            a = cut[-1]
            longest = 2.0 + 0.6 * (a - edges[0])
            if b - a <= 1.5 * longest:
                cut.append(b)
                break
            cut.append(a + longest)
    return np.array(cut)


def _nodes(edges: np.ndarray, profile: RayProfile, per_scale: float, smallest: int, largest: int, step_km: float = 0.0):
    """Numbers of intervals, first node and node altitudes of every segment."""
    size = np.empty(edges.size - 1, dtype=np.int64)
    for s, (a, b) in enumerate(pairwise(edges)):
        inside = (profile.top_km > a) & (profile.bottom_km < b)
        share = np.minimum(profile.top_km[inside], b) - np.maximum(profile.bottom_km[inside], a)
        folds = 0.0
        for part in (AIR, GASES, AEROSOL):
            # an error of interpolation goes like optical depth x step^4
            weight = (_LIMB_PATH_KM * profile.coefficient[:, inside, part + BOTTOM]) ** 0.25
            q = np.abs(profile.coefficient[:, inside, part + LOG_SLOPE]) / (profile.top_km - profile.bottom_km)[inside]
            folds = max(folds, float((np.minimum(weight, 2.0) * q * share).sum(axis=1).max()))
        # a thin layer just above is seen from within its thickness: sqrt(b - z) must resolve that
        above = (edges[s + 2] - b) if s + 2 < edges.size else b - a
        needed = max(per_scale * max(folds, 0.2 * (b - a) ** 0.5), 2.5 * ((b - a) / above) ** 0.5)
        if step_km > 0.0:  # nodes are twice the mean distance apart at the bottom of a segment
            needed = max(needed, 2.0 * (b - a) / (step_km + 0.1 * max(0.0, a - 15.0)))
        size[s] = int(np.clip(math.ceil(needed), smallest, largest))
    start = np.concatenate([[0], np.cumsum(size)]).astype(np.int64)
    nodes = np.empty(start[-1] + 1)
    for s, (a, b) in enumerate(pairwise(edges)):
        t = 1.0 - np.arange(size[s] + 1) / size[s]
        nodes[start[s] : start[s + 1] + 1] = b - (b - a) * t**2
        nodes[start[s]] = a
    return size, start[:-1], nodes


def _limb_edges(edges: np.ndarray, profile: RayProfile, w: int) -> tuple[np.ndarray, np.ndarray]:
    """Edges that a ray from space can have as its lowest point, and n r there: in a duct n r is not below all above."""
    r = profile.radius_km
    candidates = np.unique(np.concatenate([edges, profile.bottom_km[profile.bottom_km >= edges[0]]]))
    x = np.array([(r + z) * (1.0 + refractivity_at(profile, w, z)) for z in candidates])
    x[-1] = r + candidates[-1]
    lowest_above = np.minimum.accumulate(x[::-1])[::-1]
    first = int(np.flatnonzero(x <= lowest_above)[0])
    keep = np.isin(candidates, edges) & (candidates > candidates[first])
    keep[first] = True
    keep[:-1] &= x[:-1] < lowest_above[1:] - 1e-9 * r
    keep[-1] = True
    return candidates[keep], x[keep]


def _uniform_in_invariant(lowest, edges, x, size, start, profile: RayProfile, w: int) -> np.ndarray:
    """Altitudes [km] of the lowest points of rays uniform in sqrt((x_b - p)/(x_b - x_a)) in every segment a..b."""
    out = np.array(lowest)
    for s in range(size.size):
        for m in range(1, size[s]):
            p = x[s + 1] - (x[s + 1] - x[s]) * (1.0 - m / size[s]) ** 2
            u = math.sqrt((x[s + 1] - p) * (x[s + 1] + p))
            out[start[s] + m] = lowest_point(profile, w, edges[s + 1], u, False)[0]
    return out


def prepare_beam(
    medium: Medium,
    *,
    refraction: bool = True,
    spreading: bool = True,
    altitude_nodes_per_scale: float = 8.0,
    limb_nodes_per_scale: float = 12.0,
    cosine_nodes: int = 40,
    distance_nodes: int = 12,
    guess_nodes: int = 48,
    spreading_window_km: float = 0.25,
    max_breaks: int = 120,
    laid_out_for: Medium | None = None,
) -> Beam:
    """Tables of the direct sun beam in `medium`, for every altitude and every position of the sun.

    refraction: bend the rays by `medium.refractivity`; without it they are straight.
    spreading: include the dilution of the beam by differential refraction.
    altitude_nodes_per_scale, limb_nodes_per_scale: nodes per factor e of the steepest coefficient.
    cosine_nodes, distance_nodes, guess_nodes: intervals of the other coordinates.
    A refractivity that jumps between layers is joined at the mean of both sides: at a jump all rays close to the
    horizontal would be reflected or focused, which is a property of the layers and not of the air.
    spreading_window_km: least half-width in altitude over which the bending of limb rays is differentiated.  An index
        that bends at the levels of a profile has a spike of the spreading below every level; this averages over it.
    laid_out_for: the same levels at other wavelengths, whose coefficients say where nodes are, and whose most refracted
        wavelength is the reference, so that the tables of one wavelength do not depend on others; None: the medium.

    Errors: TwilightError for air that traps light up to more than DEEPEST_DUCT_KM above the ground.
    """
    refraction = refraction and medium.has_refraction
    if refraction:
        medium = with_joined_refractivity(medium)
    profile = ray_profile(medium, refraction=refraction)
    n_w = medium.n_wavelengths
    layout = profile
    if laid_out_for is not None:
        layout = ray_profile(with_joined_refractivity(laid_out_for), refraction=refraction)
        coefficient = np.concatenate([profile.coefficient, layout.coefficient])
        profile = layout._replace(coefficient=coefficient)
    ground = np.array([refractivity_at(profile, w, medium.bottom_km) for w in range(profile.coefficient.shape[0])])
    reference, other = int(np.argmax(ground)), int(np.argmin(ground))
    sharp = beam_edges.make_edges(profile, layout, reference, n_w, max_breaks)
    n_sharp, of_sharp = sharp.record.shape[0], sharp.flat()
    edges = _segments(laid_out_for or medium, max_breaks, sharp.altitude_km)
    size, start, altitudes = _nodes(edges, layout, altitude_nodes_per_scale, 6, 64)
    limb_edges, limb_x = _limb_edges(edges, profile, reference)
    limb_size, limb_start, lowest = _nodes(limb_edges, layout, limb_nodes_per_scale, 8, 128, 0.7 if refraction else 0.0)
    lowest = _uniform_in_invariant(lowest, limb_edges, limb_x, limb_size, limb_start, profile, reference)
    scales = ground / ground[reference] if ground[reference] > 0 else np.ones(ground.size)
    scale = scales[:n_w]
    invariant, bending = np.empty((ground.size, lowest.size)), np.empty((ground.size, lowest.size))
    slope, free = np.empty(bending.shape), np.empty(bending.shape, dtype=np.bool_)
    # each node stands for the flux up to half-way to its neighbours
    half = 0.5 * np.diff(lowest)
    below = lowest - np.maximum(np.concatenate([half[:1], half]), spreading_window_km)
    above = lowest + np.maximum(np.concatenate([half, half[-1:]]), spreading_window_km)
    for w in {*range(n_w), reference}:
        beam_tables.limb_table(profile, w, lowest, below, above, invariant[w], bending[w], slope[w], free[w])
    lowest_free = float(lowest[int(np.argmax(free[reference]))])
    if lowest_free - medium.bottom_km > DEEPEST_DUCT_KM:
        raise TwilightError(
            f"{medium.name or 'the medium'}: its air bends light around the Earth up to {lowest_free:.3g} km, so that "
            f"sunlight would come from all sides at once; allowed is a duct of up to {DEEPEST_DUCT_KM:g} km: the "
            "refractivity must fall more slowly with altitude"
        )
    for m in range(1, lowest.size):
        if not free[reference, m]:
            bending[reference, m] = bending[reference, m - 1]

    edge_chi, edge_cos = np.empty(altitudes.size), np.empty(altitudes.size)
    beam_tables.edge_table(profile, reference, altitudes, lowest_free, edge_chi, edge_cos)
    # the edge sinks with altitude like a square root
    dip = (edge_chi - edge_chi[0]) * np.abs(edge_chi - edge_chi[0])
    t = np.arange(guess_nodes + 1) / guess_nodes
    depths = lookup.DEPTH_SCALE * t / (1.0 + lookup.DEPTH_SCALE - t)
    guess = np.zeros((altitudes.size, guess_nodes + 1, 2))
    if refraction:
        beam_tables.guess_table(
            profile, reference, altitudes, depths, edge_chi, edge_cos, lowest, slope[reference], guess
        )
    t = np.arange(cosine_nodes + 1) / cosine_nodes
    cosines = lookup.COSINE_SCALE * t / (1.0 + lookup.COSINE_SCALE - t)
    log_up = np.empty((altitudes.size, cosine_nodes + 1, n_w))
    up_bending, beta = np.empty(log_up.shape[:2]), np.empty(log_up.shape[:2])
    beam_tables.up_table(
        profile,
        reference,
        altitudes,
        cosines,
        scale,
        spreading and refraction,
        of_sharp,
        n_sharp,
        log_up,
        up_bending,
        beta,
    )
    t = (
        np.arange(distance_nodes + 1)
        / distance_nodes
        * (lookup.MAX_DISTANCE_KM / (lookup.MAX_DISTANCE_KM + lookup.NEAR_KM))
    )
    distances = lookup.NEAR_KM * t / (1.0 - t)
    shift = np.zeros((lowest.size, distance_nodes + 1))
    dispersing = bool(refraction and scales[other] < 1.0 - 1e-9)
    if dispersing:
        beam_tables.shift_table(profile, reference, other, lowest, invariant[reference], distances, slope, shift)
        shift /= 1.0 - scales[other]
    log_down = np.empty((n_w, lowest.size, distance_nodes + 1))
    far = _FAR_KM if spreading and refraction else 1e300
    beam_tables.down_table(
        profile,
        reference,
        lowest,
        invariant[reference],
        distances,
        scale,
        shift,
        slope,
        spreading and refraction,
        far,
        of_sharp,
        n_sharp,
        log_down,
    )
    return pack(
        Tables(
            radius_km=medium.earth_radius_km,
            ground_km=edges[0],
            top_km=medium.top_km,
            far_km=far,
            edge_rad=edge_chi[0],
            refracting=refraction,
            dispersing=dispersing,
            altitude_segments=Segments(edges, size, start),
            limb_segments=Segments(limb_x, limb_size, limb_start),
            refractivity=np.array([refractivity_at(profile, reference, z) for z in altitudes]),
            edge_dip=dip,
            guess=guess,
            up_bending=up_bending,
            limb_bending=bending[reference],
            shift_km=shift,
            overhead=medium.overhead_absorption_optical_depth,
            dispersion=1.0 - scale,
            log_up=log_up,
            log_down=log_down,
            edges=sharp,
        )
    )
