"""What the observer sees in the exact mode.

Light scattered once is integrated along each line of sight, with the aerosol's own phase function and the refracted
beam; light scattered more often along a coarse set of directions, and interpolated between them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline

from twilight.atmosphere.medium import Medium
from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.cells.ordinates import gather
from twilight.solvers.cells.stencils import Mesh, new_steps, trace
from twilight.transport.azimuth_series import RayDirections
from twilight.transport.beam import Beam
from twilight.transport.lines import ALTITUDE, RayBundle, new_line, species_fraction, trace_rays
from twilight.transport.profile import Profile
from twilight.transport.scaling import ScaledMedium, species_phase
from twilight.transport.sunlit import scattered_once
from twilight.transport.sunlit_ray import Phases, SunlitAir

REFERENCE_BEND_RAD = math.radians(0.5)
"""Lift of the sun [rad] at which phase functions are taken a second time; they are linear in the lift."""


def unit_vectors(elevation_deg, azimuth_deg) -> np.ndarray:
    """Directions (D, 3) in the observer's frame: z up, x towards the sun's azimuth."""
    e, a = np.radians(elevation_deg), np.radians(azimuth_deg)
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)


class StraightLines(NamedTuple):
    """Lines of sight from one altitude, for any sun: D directions on R rays.

    rays: straight ones, one for each elevation; fraction (1 + K, P, W): of each species in what their points scatter
    elevation (R,), azimuth (D,) [rad]; order (D,): of the directions by ray; row_first (R + 1,): where each ray's begin
    """

    rays: RayBundle
    fraction: np.ndarray
    elevation: np.ndarray
    azimuth: np.ndarray
    order: np.ndarray
    row_first: np.ndarray


def make_straight_lines(
    profile: Profile, scaled: ScaledMedium, altitude_km: float, elevation_deg, azimuth_deg, fineness: float = 2.0
) -> StraightLines:
    """Lines of sight in directions elevation_deg, azimuth_deg (D,); `profile` is that of the scaled medium."""
    elevation, row = np.unique(np.radians(elevation_deg), return_inverse=True)
    order = np.argsort(row, kind="stable")
    rays = trace_rays(profile, np.full(elevation.size, altitude_km), np.sin(elevation), fineness, pairs=True)
    fraction = np.ascontiguousarray(species_fraction(scaled.medium, rays.place[:, ALTITUDE]))
    row_first = np.searchsorted(row[order], np.arange(elevation.size + 1))
    return StraightLines(rays, fraction, elevation, np.radians(azimuth_deg), order, row_first)


def single_scattering(
    lines: StraightLines,
    beam: Beam,
    medium: Medium,
    forward_fraction: np.ndarray,
    sun_elevation_deg: float,
    phase: np.ndarray | None = None,
) -> np.ndarray:
    """Sun-normalised radiance (D, W) [sr^-1] of light scattered once by air or by the ground in view.

    beam: of the scaled medium; medium: the unscaled one, for its phase functions and its ground
    phase (D, 1 + K, W): replaces the phase functions where it is given; it may be negative, and is not corrected for
    the bending of the beam.
    """
    sun = math.radians(sun_elevation_deg)
    order = lines.order
    if phase is None:
        elevation = lines.elevation[np.repeat(np.arange(lines.elevation.size), np.diff(lines.row_first))]
        turned = []
        for h in (sun, sun + REFERENCE_BEND_RAD):
            cosine = np.sin(elevation) * math.sin(h) + np.cos(elevation) * math.cos(h) * np.cos(lines.azimuth[order])
            turned.append(species_phase(medium, forward_fraction, cosine))
        value, of_sun, floor = turned[0], (turned[1] - turned[0]) / REFERENCE_BEND_RAD, 0.0
    else:
        value, of_sun, floor = phase[order], np.zeros_like(phase), -np.inf
    phases = Phases(value[None], of_sun[None], np.zeros_like(value)[None])
    directions = RayDirections(lines.row_first, np.cos(lines.azimuth[order]), 0.5 * math.pi - sun)
    found = np.zeros((order.size, 1, medium.n_wavelengths))
    no_other = np.zeros((order.size, medium.n_wavelengths))
    air = SunlitAir(beam, lines.rays, lines.fraction, phases, floor, no_other)
    in_slices(
        lambda begin, end: scattered_once(
            air, lines.elevation, directions, medium.bottom_km, medium.ground_albedo, found, begin, end
        ),
        lines.elevation.size,
    )
    out = np.empty_like(found[:, 0])
    out[order] = found[:, 0]
    return out


FINENESS = 1.5
"""Density of the steps of lines of sight."""


def coarse_elevations(lowest_deg: float, highest_deg: float, n: int) -> np.ndarray:
    """Elevations [deg] dense at the low end, where the air mass changes fastest."""
    u = np.linspace(0.0, 1.0, n)
    return lowest_deg + (highest_deg - lowest_deg) * (0.25 * u + 0.75 * u**3)


@njit(cache=True, nogil=True)
def _integrate(profile, mesh, altitude_km, directions, log_source, log_ground, out, begin, end):
    """`multiple_scattering` of the lines of sight begin..end, whose arguments these are, into their rows of out (D, W).

    profile: `Profile`; mesh: `Mesh`; altitude_km, directions, log_source, log_ground: as there.
    """
    n_wavelengths = profile.extinction.shape[1]
    z0 = profile.earth_radius_km + altitude_km
    line = new_line(profile)
    zero = np.int64(0)
    for d in range(begin, end):
        steps, ground = new_steps(line.place.shape[0], n_wavelengths), new_steps(np.int64(1), n_wavelengths)
        count = trace(
            profile, line, mesh, 0.0, z0, altitude_km, directions[d, 0], directions[d, 1], directions[d, 2], FINENESS,
            np.bool_(True), steps, zero, ground, zero,
        )  # fmt: skip
        total = np.zeros(n_wavelengths, np.float32)
        gather(steps, zero, count, log_source[min(d, log_source.shape[0] - 1)], 0.0, 1.0, total)
        if np.max(ground.weight) > 0.0:
            gather(ground, zero, np.int64(1), log_ground, 0.0, 1.0, total)
        for w in range(n_wavelengths):
            out[d, w] = total[w]


class MultipleView:
    """Multiple scattering as a smooth function of direction: log-spline over a coarse grid, one per hemisphere side."""

    def __init__(self, elevation_deg, azimuth_deg, radiance):
        """radiance (E, A, W) on elevations and on azimuths 0..180 deg."""
        self.floor = 1e-28
        # mirrored across the sun's meridian so that the spline is flat there
        azimuth = np.pad(azimuth_deg, 3, mode="reflect", reflect_type="odd")
        values = np.pad(np.log(np.maximum(radiance, self.floor)), ((0, 0), (3, 3), (0, 0)), mode="reflect")
        self.splines = [
            RectBivariateSpline(elevation_deg, azimuth, values[:, :, w], kx=3, ky=3) for w in range(radiance.shape[2])
        ]

    def __call__(self, elevation_deg, azimuth_deg) -> np.ndarray:
        a = np.abs((np.asarray(azimuth_deg) + 180.0) % 360.0 - 180.0)
        out = np.stack([np.exp(s.ev(elevation_deg, a)) for s in self.splines], axis=-1)
        return np.where(out > 10 * self.floor, out, 0.0)


def multiple_scattering(
    profile: Profile,
    mesh: Mesh,
    altitude_km: float,
    directions: np.ndarray,
    log_source: np.ndarray,
    log_ground: np.ndarray,
) -> np.ndarray:
    """Radiance (D, W) of light scattered more than once, along lines of sight from the altitude of the observer.

    directions (D, 3): unit vectors; log_source (D, P, A, W): logarithm of the source function of each direction, or
    (1, P, A, W) of an isotropic one; log_ground (P, A, W): of the ground's radiance.
    """
    out = np.zeros((directions.shape[0], profile.extinction.shape[1]))
    in_slices(
        lambda begin, end: _integrate(profile, mesh, altitude_km, directions, log_source, log_ground, out, begin, end),
        directions.shape[0],
    )
    return out


def horizon_deg(altitude_km: float, bottom_km: float, earth_radius_km: float) -> float:
    """Elevation of the geometric horizon [deg], 0 on the ground, negative above it."""
    cosine = (earth_radius_km + bottom_km) / (earth_radius_km + altitude_km)
    return -math.degrees(math.acos(min(1.0, cosine)))
