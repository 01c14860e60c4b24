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

A screen beyond the horizon (:mod:`twilight.transport.ray_profile`) is a factor on all this, at every wavelength's own
ray.

What the table leaves out: several images of the sun (mirages; d chi/d i is kept above 0.05), the gap in direction that
a duct makes (bridged), and dispersion of the ground's edge for rays from above (0.01 deg in the lowest metre).
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium, with_joined_refractivity
from twilight.base.errors import TwilightError
from twilight.jit.kernels import njit
from twilight.transport import beam_edges, beam_tables
from twilight.transport import beam_lookup as lookup
from twilight.transport.beam_edges import Edges
from twilight.transport.beam_layout import (
    LimbRays,
    Segments,
    Tables,
    limb_edges,
    pack,
    segment_nodes,
    segments,
    uniform_in_invariant,
)
from twilight.transport.beam_lookup import Beam, beam_at, beam_at_one, lit_at
from twilight.transport.beam_tables import BeamAir
from twilight.transport.ray_profile import AIR, RayProfile, ray_profile, refractivity_at, screen_table

__all__ = ["Beam", "beam_at", "beam_at_one", "beam_on_ground", "lit_at", "prepare_beam"]

DEEPEST_DUCT_KM = 1.0
"""Air that traps light up to higher than this makes no shadow whose edge the tables could follow."""
_FAR_KM = 400.0
"""The table of limb rays holds log(E) + log(1 + u/400 km): finite however far behind the limb."""


class _Air(NamedTuple):
    """What rays are traced through.

    traced: the W wavelengths of the medium; its profile holds, behind them, those that nodes are laid out for; layout:
    profile of the latter; scales: refractivity at the ground of all in it over that of the reference; edges: what
    jumps or bends at edges of layers.
    """

    traced: BeamAir
    layout: RayProfile
    scales: np.ndarray
    edges: Edges
    refraction: bool

    @property
    def disperses(self) -> bool:
        """Whether wavelengths are refracted differently."""
        return self.refraction and self.traced.least_scale < 1.0 - 1e-9

    @property
    def far_km(self) -> float:
        """u over which log(1 + u / far_km) is part of the table of limb rays."""
        return _FAR_KM if self.traced.spreading else 1e300


class BeamNodes(NamedTuple):
    """Nodes of a beam's tables: per factor e of the steepest coefficient, and intervals of the other coordinates."""

    altitude_per_scale: float = 8.0
    limb_per_scale: float = 12.0
    cosine: int = 40
    distance: int = 12
    guess: int = 48


def prepare_beam(
    medium: Medium,
    *,
    refraction: bool = True,
    spreading: bool = True,
    nodes: BeamNodes = BeamNodes(),  # noqa: B008, a tuple of numbers
    spreading_window_km: float = 0.25,
    max_breaks: int = 120,
    laid_out_for: Medium | None = None,
) -> Beam:
    """Tables of the direct sun beam in `medium`, for every altitude and every position of the sun.

    refraction: bend the rays by `medium.refractivity`; without it they are straight.
    spreading: include the dilution of the beam by differential refraction.
    A refractivity that jumps between layers is joined at the mean of both sides: at a jump all rays close to the
    horizontal would be reflected or focused, which is a property of the layers and not of the air.
    spreading_window_km: least half-width in altitude over which the bending of limb rays is differentiated.  An index
        that bends at the levels of a profile has a spike of the spreading below every level; this averages over it.
    laid_out_for: the same levels at other wavelengths, whose coefficients say where nodes are, and whose most refracted
        wavelength is the reference, so that the tables of one wavelength do not depend on others; None: the medium.

    Errors: TwilightError for air that traps light up to more than DEEPEST_DUCT_KM above the ground.
    """
    air = _air(medium, laid_out_for, refraction, spreading, max_breaks)
    edges = segments(laid_out_for or medium, max_breaks, air.edges.altitude_km)
    size, start, altitudes = segment_nodes(edges, air.layout, nodes.altitude_per_scale, 6, 64)
    limb, limb_segments, lowest_free_km = _limb(air, edges, nodes.limb_per_scale, spreading_window_km)
    if lowest_free_km - medium.bottom_km > DEEPEST_DUCT_KM:
        raise TwilightError(
            f"{medium.name or 'the medium'}: its air bends light around the Earth up to {lowest_free_km:.3g} km, so "
            f"that sunlight would come from all sides at once; allowed is a duct of up to {DEEPEST_DUCT_KM:g} km: the "
            "refractivity must fall more slowly with altitude"
        )
    edge_chi, guess = _guess(air, limb, lowest_free_km, altitudes, nodes.guess)
    log_up, up_bending = _from_above(air, altitudes, nodes.cosine)
    distances = _distances(nodes.distance)
    shift = _shift(air, limb, distances)
    profile, reference = air.traced.profile, air.traced.reference
    return pack(
        Tables(
            radius_km=medium.earth_radius_km,
            ground_km=edges[0],
            top_km=medium.top_km,
            far_km=air.far_km,
            edge_rad=edge_chi[0],
            refracting=air.refraction,
            dispersing=air.disperses,
            altitude_segments=Segments(edges, size, start),
            limb_segments=limb_segments,
            refractivity=np.array([refractivity_at(profile, reference, z) for z in altitudes]),
            # the edge sinks with altitude like a square root
            edge_dip=(edge_chi - edge_chi[0]) * np.abs(edge_chi - edge_chi[0]),
            guess=guess,
            up_bending=up_bending,
            limb_bending=limb.bending[reference],
            shift_km=shift,
            overhead=medium.overhead_absorption_optical_depth,
            dispersion=1.0 - air.traced.scale,
            log_up=log_up,
            log_down=_past_lowest_point(air, limb, distances, shift),
            edges=air.edges,
            screen=screen_table(medium.screen, profile, reference, medium.wavelength_nm),
        )
    )


def _air(medium: Medium, laid_out_for: Medium | None, refraction: bool, spreading: bool, max_breaks: int) -> _Air:
    """What rays are traced through, with the edges of its layers."""
    refraction = refraction and medium.has_refraction
    if refraction:
        medium = with_joined_refractivity(medium)
    layout = profile = ray_profile(medium, refraction=refraction)
    if laid_out_for is not None:
        layout = ray_profile(with_joined_refractivity(laid_out_for), refraction=refraction)
        profile = layout._replace(coefficient=np.concatenate([profile.coefficient, layout.coefficient]))
    ground = np.array([refractivity_at(profile, w, medium.bottom_km) for w in range(profile.coefficient.shape[0])])
    reference, least = int(np.argmax(ground)), int(np.argmin(ground))
    scales = ground / ground[reference] if ground[reference] > 0 else np.ones(ground.size)
    edges = beam_edges.make_edges(profile, layout, reference, medium.n_wavelengths, max_breaks)
    index = profile.coefficient[: medium.n_wavelengths, :, :AIR].reshape(medium.n_wavelengths, -1)
    _, firsts, which = np.unique(index, axis=0, return_index=True, return_inverse=True)
    traced = BeamAir(
        profile, reference, scales[: medium.n_wavelengths], firsts[which.ravel()], least, float(scales[least]),
        spreading and refraction, edges.flat(), edges.record.shape[0],
    )  # fmt: skip
    return _Air(traced, layout, scales, edges, refraction)


def _limb(air: _Air, edges: np.ndarray, nodes_per_scale: float, window_km: float) -> tuple[LimbRays, Segments, float]:
    """Rays by their lowest point, segments of their invariant, and the lowest point of the lowest ray that leaves the
    air [km].

    The bending of a ray that a duct catches is that of the ray below it.
    """
    profile, reference, rays_of = air.traced.profile, air.traced.reference, air.traced.rays_of
    altitudes, x = limb_edges(edges, profile, reference)
    size, start, lowest = segment_nodes(altitudes, air.layout, nodes_per_scale, 8, 128, 0.7 if air.refraction else 0.0)
    lowest = uniform_in_invariant(lowest, altitudes, x, size, start, profile, reference)
    invariant, bending = np.empty((air.scales.size, lowest.size)), np.empty((air.scales.size, lowest.size))
    slope, free = np.empty(bending.shape), np.empty(bending.shape, dtype=np.bool_)
    # each node stands for the flux up to half-way to its neighbours
    half = 0.5 * np.diff(lowest)
    below = lowest - np.maximum(np.concatenate([half[:1], half]), window_km)
    above = lowest + np.maximum(np.concatenate([half, half[-1:]]), window_km)
    for w in [*range(rays_of.size), reference]:
        first = rays_of[w] if w < rays_of.size else w
        if first == w:
            beam_tables.limb_table(profile, w, lowest, below, above, invariant[w], bending[w], slope[w], free[w])
        for table in (invariant, bending, slope, free):
            table[w] = table[first]
    for m in range(1, lowest.size):
        if not free[reference, m]:
            bending[reference, m] = bending[reference, m - 1]
    lowest_free_km = float(lowest[int(np.argmax(free[reference]))])
    return LimbRays(lowest, invariant, bending, slope), Segments(x, size, start), lowest_free_km


def _guess(
    air: _Air, limb: LimbRays, lowest_free_km: float, altitudes: np.ndarray, intervals: int
) -> tuple[np.ndarray, np.ndarray]:
    """True zenith angles (J,) [rad] of the shadow's edge, and first guesses (J, G + 1, 2) of the bending and its
    derivative by the apparent zenith angle, by the distance from that edge."""
    profile, reference = air.traced.profile, air.traced.reference
    edge_chi, edge_cos = np.empty(altitudes.size), np.empty(altitudes.size)
    beam_tables.edge_table(profile, reference, altitudes, lowest_free_km, edge_chi, edge_cos)
    t = np.arange(intervals + 1) / intervals
    depths = lookup.DEPTH_SCALE * t / (1.0 + lookup.DEPTH_SCALE - t)
    guess = np.zeros((altitudes.size, intervals + 1, 2))
    if air.refraction:
        beam_tables.guess_table(profile, reference, altitudes, depths, edge_chi, edge_cos, limb, guess)
    return edge_chi, guess


def _from_above(air: _Air, altitudes: np.ndarray, intervals: int) -> tuple[np.ndarray, np.ndarray]:
    """Of rays from above by altitude and apparent cosine: ln(E/F0) (J, C + 1, W), and the bending (J, C + 1) [rad]."""
    t = np.arange(intervals + 1) / intervals
    cosines = lookup.COSINE_SCALE * t / (1.0 + lookup.COSINE_SCALE - t)
    log_up = np.empty((altitudes.size, intervals + 1, air.traced.scale.size))
    bending, beta = np.empty(log_up.shape[:2]), np.empty(log_up.shape[:2])
    beam_tables.up_table(air.traced, altitudes, cosines, log_up, bending, beta)
    return log_up, bending


def _distances(intervals: int) -> np.ndarray:
    """Nodes of the distance u from the lowest point of a ray [km]."""
    largest = lookup.MAX_DISTANCE_KM / (lookup.MAX_DISTANCE_KM + lookup.NEAR_KM)
    t = np.arange(intervals + 1) / intervals * largest
    return lookup.NEAR_KM * t / (1.0 - t)


def _shift(air: _Air, limb: LimbRays, distances: np.ndarray) -> np.ndarray:
    """Shift (Y, D + 1) [km] of the lowest point of a ray over the difference of refractivity; 0 without dispersion."""
    shift = np.zeros((limb.lowest_km.size, distances.size))
    if not air.disperses:
        return shift
    beam_tables.shift_table(air.traced.profile, air.traced.reference, air.traced.least, limb, distances, shift)
    return shift / (1.0 - air.traced.least_scale)


def _past_lowest_point(air: _Air, limb: LimbRays, distances: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """ln(E/F0), mirror image and distance included, of rays that have passed their lowest point, (W, Y, D + 1)."""
    log_down = np.empty((air.traced.scale.size, limb.lowest_km.size, distances.size))
    beam_tables.down_table(air.traced, limb, distances, shift, air.far_km, log_down)
    return log_down


@njit(inner=True, cache=True, makes_arrays=False)
def beam_on_ground(beam, ground_km, cos_sun_zenith, out):
    """Irradiance of the horizontal ground by the beam over F0 into out (W,): what arrives at the sun's apparent place.

    beam: from :func:`prepare_beam`; ground_km: altitude of the ground [km]; cos_sun_zenith: of the true sun there.
    """
    bending = beam_at(beam, ground_km, cos_sun_zenith, out)
    apparent = math.acos(min(1.0, max(-1.0, cos_sun_zenith))) - bending
    incidence = max(0.0, math.cos(max(0.0, apparent)))
    for w in range(out.size):
        out[w] *= incidence
