"""The skies of one air by the model of clear air: what is computed, times what the network gives.

See :mod:`twilight.solvers.compact.clear_air` for the equation.  M, Q_k and the ratios of Stokes parameters of M are
smooth over the sky, so they are computed at nodes and interpolated by cubic splines; phase functions are not, and are
evaluated in every direction, at the angle from the apparent sun: a ray towards the sun is bent as its light is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twilight.base.blas import one_blas_thread
from twilight.numerics.phase import PhaseFunction, rayleigh_matrix, rayleigh_phase
from twilight.numerics.spectrum import spline_matrix
from twilight.solvers.compact.air_columns import AirColumns
from twilight.solvers.compact.clear_air import AZIMUTH_DEG, ELEVATION_DEG, SUN_DEG, ClearAirModel
from twilight.solvers.compact.diffuse_light import diffuse_light, line_of_sight_radiance
from twilight.solvers.compact.forward_peak import WidenedPeaks, forward_peaks, place_of_angle, widened

BASE_ELEVATION_DEG = ELEVATION_DEG[[0, 3, 6, 10, 14]]
"""Elevations at which ln M_0 is an input of the network [deg]."""

BASE_AZIMUTH_DEG = AZIMUTH_DEG[[0, 6, 12]]
"""Azimuths from the sun at which ln M_0 is an input of the network [deg]."""

MIRRORED = 3
"""Nodes beyond the sun's vertical on either side through which splines in azimuth go: the sky mirrors itself there."""

ELEVATION_OFFSET_DEG = 1.5
"""Splines in elevation run over ln(elevation + ELEVATION_OFFSET_DEG)."""

NEGLIGIBLE = 1e-3
"""Fraction of M that is added to every Q_k before its logarithm is interpolated; times a phase function, 1e-4 of M."""

DARKEST_TERM = 1e-3
"""Light of a wavelength, of that of the brightest one, below which it does not count in the error of a sky."""

DARK = 1e-35
"""Least radiance over F0 whose logarithm is taken [sr^-1]."""


class ApproximateSkies:
    """What is computed of the skies of one air seen by one observer, before anything that is fitted.

    columns: the air; observer_km: above the ground
    """

    @one_blas_thread()
    def __init__(self, columns: AirColumns, observer_km: float = 0.0):
        self.columns = columns
        self.shells, self._scattering = columns.shells(observer_km)
        self._light = diffuse_light(self.shells, columns.diffuse_coefficients(), columns.medium.ground_albedo)
        self.inputs = columns.inputs(observer_km)

    def base_at(self, sun_elevation_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """M_0 in directions, (E, A, W)."""
        where = (sun_elevation_deg, elevation_deg, azimuth_deg)
        return np.maximum(line_of_sight_radiance(self.shells, self._light, self._scattering, *where), DARK)

    def single_at_nodes(self, sun_elevation_deg: float) -> np.ndarray:
        """Q_k at the nodes of the sky, (1 + K, E, A, W)."""
        return np.maximum(self.shells.scattered_once(sun_elevation_deg, ELEVATION_DEG, AZIMUTH_DEG), DARK)

    def log_base(self) -> np.ndarray:
        """ln M_0 under all suns, an input of the network, (W, B)."""
        light = np.array([self.base_at(float(sun), BASE_ELEVATION_DEG, BASE_AZIMUTH_DEG) for sun in SUN_DEG])
        return np.log(light).reshape(-1, light.shape[-1]).T


class ClearAirSkies(ApproximateSkies):
    """The skies of one air seen by one observer, under every sun."""

    @one_blas_thread()
    def __init__(self, model: ClearAirModel, columns: AirColumns, observer_km: float = 0.0):
        super().__init__(columns, observer_km)
        self._model = model
        self._peaks = forward_peaks(columns.phase_functions, columns.aerosol_forward, columns.degree)
        *fitted, self._spread = model.at_nodes(self.inputs, self.log_base())
        self._fitted = np.array(fitted)

    @one_blas_thread()
    def sky(self, sun_elevation_deg: float, with_polarisation: bool = False) -> ClearAirSky:
        """The sky under one sun, from -18 to 90 deg."""
        weight = spline_matrix(SUN_DEG, np.array([sun_elevation_deg]))[0]
        parts = self._fitted if with_polarisation else self._fitted[:1]
        log_ratio, *polarised = np.einsum("s,pwsea->peaw", weight, parts)
        log_multiple = np.log(self.base_at(sun_elevation_deg, ELEVATION_DEG, AZIMUTH_DEG)) + log_ratio
        # in the shadow ln(Q) falls without end, and splines would swing beside it
        shells, forward = self.shells, self.columns.aerosol_forward
        single = self.single_at_nodes(sun_elevation_deg) + NEGLIGIBLE * np.exp(log_multiple)
        apparent = shells.apparent_elevation_deg(sun_elevation_deg)
        peaks = None
        if forward.size:
            peaks = widened(self._peaks, *shells.depth_in_peaks(sun_elevation_deg, ELEVATION_DEG, forward))
        logarithms = np.concatenate([log_multiple[None], np.log(single)])
        medium = self.columns.medium
        phases = (medium.depolarisation, self.columns.phase_functions)
        sky = ClearAirSky(apparent, *phases, logarithms, np.array(polarised), peaks)
        light = sky.at_nodes()
        spread = np.einsum("s,wsea->eaw", weight, self._spread) * np.exp(log_multiple) / light
        # terms of bands of gases that let no light through have no part in the sky
        brightest = light.max(axis=(0, 1))
        counted = spread[..., brightest > DARKEST_TERM * brightest.max()]
        error = self._model.error_of(sun_elevation_deg, float(np.percentile(np.abs(counted), 95)))
        return replace(sky, relative_error=error)


@dataclass(frozen=True)
class ClearAirSky:
    """The sky of one sun.

    sun_elevation_deg: apparent
    depolarisation (W,), phase_functions: of air and of each aerosol
    logarithms (2 + K, E, A, W): of M and of Q_k, of air and K aerosols, at the nodes
    polarised (2, E, A, W): Q / M and U / M at the nodes; (0, ...) without polarisation
    peaks: the widened forward peaks of the aerosol at the elevations of the nodes; None: they are left as they are
    relative_error: of radiance, at 95 % of the directions, as the model estimates it
    """

    sun_elevation_deg: float
    depolarisation: np.ndarray
    phase_functions: tuple[PhaseFunction, ...]
    logarithms: np.ndarray
    polarised: np.ndarray
    peaks: WidenedPeaks | None = None
    relative_error: float = 0.0

    @one_blas_thread()
    def light(
        self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, *, on_grid: bool, n_stokes: int = 1
    ) -> np.ndarray:
        """The first n_stokes, 1 or 3, of I, Q and U over F0 [sr^-1].

        on_grid: in rows (E,) times columns (A,), (E, A, n_stokes, W); otherwise in directions (D,), (D, n_stokes, W)
        """
        rows, columns = elevation_splines(elevation_deg), azimuth_splines(azimuth_deg)
        multiple, *single = np.exp(_interpolated(self.logarithms, rows, columns, on_grid))
        where = (elevation_deg[:, None], azimuth_deg[None]) if on_grid else (elevation_deg, azimuth_deg)
        cosine, *double_angle = self._geometry(*where)
        phases = self._phases(cosine)
        if self.peaks is not None:
            phases[1:] = self._with_widened_peaks(phases[1:], cosine, rows, on_grid)
        stokes = [multiple + sum(phase * part for phase, part in zip(phases, single, strict=True))]
        if n_stokes > 1:
            polarised = sum(phase * part for phase, part in zip(self._polarising_phases(cosine), single, strict=True))
            odd = azimuth_splines(azimuth_deg, odd=True)
            for values, over_azimuth, rotation in zip(self.polarised, (columns, odd), double_angle, strict=True):
                part = _interpolated(values[None], rows, over_azimuth, on_grid)[0]
                stokes.append(multiple * part + polarised * rotation[..., None])
        return np.stack(stokes, axis=-2)

    def at_nodes(self) -> np.ndarray:
        """L / F0 [sr^-1] at the nodes, (E, A, W)."""
        multiple, *single = np.exp(self.logarithms)
        cosine = self._geometry(ELEVATION_DEG[:, None], AZIMUTH_DEG[None])[0]
        return multiple + sum(phase * part for phase, part in zip(self._phases(cosine), single, strict=True))

    def _geometry(
        self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cosine of the scattering angle; cosine and sine of twice the angle, clockwise, from the vertical plane of the
        line of sight to the plane of scattering."""
        sun, elevation, azimuth = (np.radians(a) for a in (self.sun_elevation_deg, elevation_deg, azimuth_deg))
        cosine = np.sin(elevation) * np.sin(sun) + np.cos(elevation) * np.cos(sun) * np.cos(azimuth)
        # across the line of sight, the sun's direction has these components in the vertical plane and beside it
        vertical = np.cos(elevation) * np.sin(sun) - np.sin(elevation) * np.cos(sun) * np.cos(azimuth)
        horizontal = -np.cos(sun) * np.sin(azimuth)
        square = np.maximum(vertical**2 + horizontal**2, 1e-30)
        cos_double = (vertical**2 - horizontal**2) / square
        return np.clip(cosine, -1.0, 1.0), cos_double, 2.0 * vertical * horizontal / square

    def _phases(self, cosine: np.ndarray) -> list[np.ndarray]:
        """Phase functions of air and of each aerosol, (..., W) each [sr^-1]."""
        air = rayleigh_phase.py_func(cosine[..., None], self.depolarisation)
        return [air, *(np.moveaxis(phase(cosine), 0, -1) for phase in self.phase_functions)]

    def _with_widened_peaks(
        self, phases: list[np.ndarray], cosine: np.ndarray, rows: np.ndarray, on_grid: bool
    ) -> list[np.ndarray]:
        """Phase functions of the aerosol with their peaks as light from the sun has widened them."""
        assert self.peaks is not None
        depth = np.maximum(rows @ self.peaks.depth, 0.0)  # rows W
        added = np.moveaxis(np.tensordot(rows, self.peaks.added, (1, 1)), 1, 0)
        index, f = place_of_angle(cosine)
        row = np.arange(rows.shape[0])[:, None] if on_grid else np.arange(rows.shape[0])
        f, dimmed = f[..., None], np.exp(-depth[:, None] if on_grid else -depth)
        return [
            np.maximum(phase * dimmed + more[row, index] * (1.0 - f) + more[row, index + 1] * f, 0.0)
            for phase, more in zip(phases, added, strict=True)
        ]

    def _polarising_phases(self, cosine: np.ndarray) -> list[np.ndarray]:
        """P12 of air and of each aerosol, (..., W) each [sr^-1]."""
        air = rayleigh_matrix.py_func(cosine[..., None], self.depolarisation)[1]
        return [air, *(np.moveaxis(phase.matrix(cosine)[1], 0, -1) for phase in self.phase_functions)]


def _interpolated(values: np.ndarray, rows: np.ndarray, columns: np.ndarray, on_grid: bool) -> np.ndarray:
    """Values at the nodes (P, E, A, W) by splines over elevation (R, E) and azimuth (C, A): (P, R, C, W), or (P, R, W)
    in directions where they are not on_grid."""
    over_rows = np.tensordot(rows, values, (1, 1))  # R P A W
    if on_grid:
        return np.moveaxis(columns @ over_rows, 1, 0)
    return np.moveaxis((columns[:, None, None] @ over_rows)[:, :, 0], 1, 0)


def elevation_splines(elevation_deg: np.ndarray) -> np.ndarray:
    """Splines through the nodes in elevation, (N, E)."""
    return spline_matrix(np.log(ELEVATION_DEG + ELEVATION_OFFSET_DEG), np.log(elevation_deg + ELEVATION_OFFSET_DEG))


def azimuth_splines(azimuth_deg: np.ndarray, odd: bool = False) -> np.ndarray:
    """Splines through the nodes in azimuth and their mirror images, (N, A).

    odd: of what changes its sign from one side of the sun to the other
    """
    wrapped = (np.asarray(azimuth_deg, float) + 180.0) % 360.0 - 180.0
    count, beside = AZIMUTH_DEG.size, np.arange(MIRRORED, 0, -1)
    nodes = np.concatenate([-AZIMUTH_DEG[beside], AZIMUTH_DEG, 360.0 - AZIMUTH_DEG[count - 1 - beside[::-1]]])
    through = spline_matrix(nodes, np.abs(wrapped))
    out = through[:, MIRRORED : MIRRORED + count].copy()
    sign = -1.0 if odd else 1.0
    out[:, beside] += sign * through[:, :MIRRORED]
    out[:, count - 1 - beside[::-1]] += sign * through[:, MIRRORED + count :]
    return out * np.where(wrapped < 0.0, sign, 1.0)[:, None]
