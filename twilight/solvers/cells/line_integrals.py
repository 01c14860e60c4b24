"""Multiple scattering seen by the observer: integrated along a coarse set of directions, interpolated between them."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import RectBivariateSpline

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.cells.ordinates import gather
from twilight.solvers.cells.stencils import Mesh, new_steps, trace
from twilight.transport.lines import new_line
from twilight.transport.profile import Profile

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
