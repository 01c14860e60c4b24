"""Multiple scattering seen by the observer: gathered on a coarse set of directions, interpolated to the texture's."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import RectBivariateSpline

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.cells.nodes import real_harmonics
from twilight.solvers.cells.ordinates import TINY, gather
from twilight.solvers.cells.stencils import Mesh, trace
from twilight.transport.lines import new_line
from twilight.transport.profile import Profile


def coarse_elevations(lowest_deg: float, highest_deg: float, n: int) -> np.ndarray:
    """Elevations [deg] dense at the low end, where the air mass changes fastest."""
    u = np.linspace(0.0, 1.0, n)
    return lowest_deg + (highest_deg - lowest_deg) * (0.25 * u + 0.75 * u**3)


@njit(cache=True, nogil=True)
def gather_views(
    profile, mesh, altitude0, directions, fineness, log_source, per_direction, log_ground, out, begin, end
):
    """Multiple scattering along lines of sight begin..end: out (D, W).

    profile: `Profile`; mesh: `Mesh`; altitude0 [km]: of the observer; directions (D, 3): unit vectors; fineness:
    density of steps; log_source (D or 1, P, A, W): logarithm of the light that points scatter, for each direction where
    per_direction is true; log_ground (P, A, W): of the ground's radiance.  per_direction: whether log_source has D
    rows.
    """
    n_wavelengths = profile.extinction.shape[1]
    n_azimuth = log_source.shape[2]
    z0 = profile.earth_radius_km + altitude0
    line = new_line(profile)
    for d in range(begin, end):
        size = line.place.shape[0]
        entries = (
            np.zeros((size, 4), np.int32),
            np.zeros((size, 4), np.float32),
            np.zeros(size, np.float32),
            np.zeros((size, n_wavelengths), np.float32),
        )
        g_corner = np.zeros((1, 4), np.int32)
        g_corner_weight = np.zeros((1, 4), np.float32)
        g_azimuth = np.zeros(1, np.float32)
        g_weight = np.zeros((1, n_wavelengths), np.float32)
        ground = (g_corner, g_corner_weight, g_azimuth, g_weight, np.int64(0))
        count = trace(
            profile, line, mesh, 0.0, z0, altitude0, directions[d, 0], directions[d, 1], directions[d, 2], fineness,
            True, entries, np.int64(0), ground,
        )  # fmt: skip
        total = np.zeros(n_wavelengths, np.float32)
        row = log_source[d if per_direction else 0]
        gather(entries, 0, count, row, 0.0, 1.0, n_azimuth, total)
        if np.max(g_weight) > 0.0:
            gather((g_corner, g_corner_weight, g_azimuth, g_weight), 0, 1, log_ground, 0.0, 1.0, n_azimuth, total)
        for w in range(n_wavelengths):
            out[d, w] = total[w]


class MultipleView:
    """Multiple scattering as a smooth function of direction: log-spline over a coarse grid, one per hemisphere side."""

    def __init__(self, elevation_deg, azimuth_deg, radiance):
        """radiance (E, A, W) on elevations and on azimuths 0..180 deg."""
        # mirrored across the sun's meridian so that the spline is flat there
        left = -azimuth_deg[1:4][::-1]
        right = 360.0 - azimuth_deg[-4:-1][::-1]
        azimuth = np.concatenate([left, azimuth_deg, right])
        self.floor = 1e-28
        values = np.log(np.maximum(radiance, self.floor))
        values = np.concatenate([values[:, 3:0:-1], values, values[:, -2:-5:-1]], axis=1)
        self.splines = [
            RectBivariateSpline(elevation_deg, azimuth, values[:, :, w], kx=3, ky=3) for w in range(radiance.shape[2])
        ]

    def __call__(self, elevation_deg, azimuth_deg) -> np.ndarray:
        a = np.abs((np.asarray(azimuth_deg) + 180.0) % 360.0 - 180.0)
        out = np.stack([np.exp(s.ev(elevation_deg, a)) for s in self.splines], axis=-1)
        return np.where(out > 10 * self.floor, out, 0.0)


def _gather(profile, mesh, altitude0, directions, log_source, per_direction, log_ground, out) -> None:
    in_slices(
        lambda begin, end: gather_views(
            profile, mesh, altitude0, directions, 1.5, log_source, per_direction, log_ground, out, begin, end
        ),
        directions.shape[0],
    )


def isotropic_view(profile, mesh, altitude0, directions, log_source) -> np.ndarray:
    """Radiance (D, W) along lines of sight through an isotropic source, log_source (1, P, A, W)."""
    out = np.zeros((directions.shape[0], log_source.shape[3]))
    no_ground = np.full(log_source.shape[1:], math.log(TINY), np.float32)
    _gather(profile, mesh, altitude0, directions, log_source, False, no_ground, out)
    return out


def exact_view(
    profile: Profile,
    mesh: Mesh,
    altitude0: float,
    elevation_deg: np.ndarray,
    azimuth_deg: np.ndarray,
    moments: np.ndarray,
    chi: np.ndarray,
    ground: np.ndarray,
    degree: int,
) -> np.ndarray:
    """Multiple scattering (E, A, W) on a grid of directions from moments (n_lm, P, A, W) already summed over orders."""
    e, a = np.meshgrid(elevation_deg, azimuth_deg, indexing="ij")
    er, ar = np.radians(e.ravel()), np.radians(a.ravel())
    directions = np.stack([np.cos(er) * np.cos(ar), np.cos(er) * np.sin(ar), np.sin(er)], axis=-1)
    harmonics, _ = real_harmonics(directions[:, 2], ar, degree)
    scaled = (moments * chi[:, :, None, :].astype(np.float32)).reshape(moments.shape[0], -1)
    out = np.zeros((directions.shape[0], profile.extinction.shape[1]))
    log_ground = np.log(np.maximum(ground, TINY))
    block = max(1, int(2.5e7 / scaled.shape[1]))
    for start in range(0, directions.shape[0], block):
        part = slice(start, start + block)
        j = harmonics[part].astype(np.float32) @ scaled
        log_source = np.log(np.maximum(j, TINY, out=j), out=j).reshape(-1, *moments.shape[1:])
        _gather(profile, mesh, altitude0, directions[part], log_source, True, log_ground, out[part])
    return out.reshape(*e.shape, -1)


def horizon_deg(altitude_km: float, bottom_km: float, earth_radius_km: float) -> float:
    """Elevation of the geometric horizon [deg], 0 on the ground, negative above it."""
    h = altitude_km - bottom_km
    return (
        -math.degrees(math.acos(min(1.0, (earth_radius_km + bottom_km) / (earth_radius_km + altitude_km))))
        if h > 0
        else 0.0
    )
