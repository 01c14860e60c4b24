"""The exact mode: what it prepares for one medium and observer, its solution for one sun, what the observer sees.

Light scattered once is integrated along each line of sight, with the aerosol's own phase function and the refracted
beam; light scattered more often along a coarse set of directions, and interpolated between them.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline

from twilight.atmosphere.medium import Medium
from twilight.base.progress import Progress
from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.base import Convergence
from twilight.solvers.cells.ordinates import TINY, Ordinates, ScatteredLight, gather, mirror, once_scattered
from twilight.solvers.cells.settings import CellsSettings
from twilight.solvers.cells.stencils import (
    Mesh,
    make_directions,
    make_mesh,
    make_nodes,
    make_stencils,
    new_steps,
    real_harmonics,
    trace,
)
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


SOURCE_VALUES = 25_000_000
"""Values of the source function that are computed at once for lines of sight."""


class ExactCells:
    """Nodes, directions and ray stencils; phase functions are followed at every order of scattering."""

    def __init__(
        self,
        medium: Medium,
        scaled: ScaledMedium,
        profile: Profile,
        beam: Beam,
        settings: CellsSettings,
        observer_altitude_km: float,
    ):
        self.medium, self.scaled, self.profile, self.beam = medium, scaled, profile, beam
        self.settings, self.observer_altitude_km = settings, observer_altitude_km
        nodes = make_nodes(settings, observer_altitude_km, medium.bottom_km, medium.top_km, medium.earth_radius_km)
        directions = make_directions(settings)
        mesh = make_mesh(nodes, medium.earth_radius_km + observer_altitude_km)
        stencils = make_stencils(profile, nodes, mesh, directions, settings.azimuth_nodes)
        chi = np.einsum("spw,slw->lpw", species_fraction(scaled.medium, nodes.altitude_km), scaled.moments)
        self.ordinates = Ordinates(stencils, mesh, nodes, directions, chi, medium.ground_albedo, settings.azimuth_nodes)

    def solve(self, sun_elevation_deg: float, progress: Progress) -> tuple[ScatteredLight, Convergence]:
        """All orders of scattering at the nodes for one sun, and how well they converged."""
        o, s = self.ordinates, self.settings
        h = np.radians(sun_elevation_deg)
        d = o.directions
        vectors = unit_vectors(
            np.degrees(np.arcsin(np.repeat(d.cosine, d.azimuth.size))), np.degrees(np.tile(d.azimuth, d.cosine.size))
        )
        cosine = vectors @ np.array([np.cos(h), 0.0, np.sin(h)])
        legendre = np.polynomial.legendre.legvander(cosine, s.degree) * (2 * np.arange(s.degree + 1) + 1)
        phase = np.einsum("dl,slw->dsw", legendre, self.scaled.moments) / (4.0 * np.pi)
        first = np.zeros(
            (vectors.shape[0], o.nodes.altitude_km.size, o.n_azimuth, self.medium.n_wavelengths), np.float32
        )
        progress("light scattered once", 0.1)
        phase = np.ascontiguousarray(phase)
        sun = np.array([np.sin(h), np.cos(h)])
        places = np.stack([o.nodes.x_km, o.nodes.z_km, o.nodes.altitude_km], axis=1)
        in_slices(
            lambda begin, end: once_scattered(
                self.profile, self.beam, phase, self.medium.ground_albedo, places, d.cosine, o.n_azimuth,
                o.n_azimuth // d.azimuth.size, sun, first, begin, end,
            ),
            places.shape[0],
        )  # fmt: skip
        mirror(first, d.cosine.size, d.azimuth.size)
        scattered = o.solve(
            first,
            s.max_orders,
            s.tolerance,
            lambda n, residual: progress(f"order of scattering {n + 1}", min(0.9, 0.3 + 0.1 * n)),
        )
        return scattered, Convergence(scattered.orders, scattered.residual)

    def view(self, scattered: ScatteredLight, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Multiple scattering (E, A, W) on a grid of directions."""
        e, a = np.meshgrid(elevation_deg, azimuth_deg, indexing="ij")
        directions = unit_vectors(e.ravel(), a.ravel())
        harmonics, _ = real_harmonics(directions[:, 2], np.radians(a.ravel()), self.settings.degree)
        moments = scattered.moments * self.ordinates.chi[:, :, None, :].astype(np.float32)
        log_ground = np.log(np.maximum(scattered.ground, TINY))
        observer = (self.profile, self.ordinates.mesh, self.observer_altitude_km)
        at_once = max(1, SOURCE_VALUES // moments[0].size)
        radiance = []
        for start in range(0, directions.shape[0], at_once):
            part = slice(start, start + at_once)
            j = harmonics[part].astype(np.float32) @ moments.reshape(moments.shape[0], -1)
            log_source = np.log(np.maximum(j, TINY, out=j), out=j).reshape(-1, *moments.shape[1:])
            radiance.append(multiple_scattering(*observer, directions[part], log_source, log_ground))
        return np.concatenate(radiance).reshape(*e.shape, -1)
