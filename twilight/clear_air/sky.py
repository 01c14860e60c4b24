"""The sky of one sun, in any direction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .model import AZIMUTH_DEG, ELEVATION_DEG, splines
from .shells import Air

PEAK_ANGLES = 161
"""Of the widened peaks: angles of tables."""
NEGLIGIBLE = 0.01
"""Fraction of M that is added to every Q_k before its logarithm is interpolated, and taken off again: in the shadow it
falls without end."""


class Sky(NamedTuple):
    """The sky of one sun: its apparent elevation; ln of M and of Q_k of air and K aerosols, with what is added to them,
    at elevations (R,) and azimuths (C,), (2 + K, R, C, W); Q / M and U / M at the nodes (2, E, A, W); `Skies._widened`;
    error of radiance at 95 % of directions, as estimated."""

    sun_elevation_deg: float
    air: Air
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    logarithms: np.ndarray
    polarised: np.ndarray
    peaks: tuple[np.ndarray, np.ndarray] | None
    relative_error: float = 0.0

    def light(self, elevation_deg, azimuth_deg, n_stokes: int = 1, on_grid: bool = True) -> np.ndarray:
        """The first n_stokes, 1 or 3, of I, Q, U over F0 [sr^-1], in rows (E,) times columns (A,), (E, A, n_stokes, W);
        not on_grid: in directions (D,), (D, n_stokes, W)."""
        rho = self.air.depolarisation
        rows, (even, odd) = elevation_splines(ELEVATION_DEG, elevation_deg), azimuth_splines(AZIMUTH_DEG, azimuth_deg)
        finer = elevation_splines(self.elevation_deg, elevation_deg), azimuth_splines(self.azimuth_deg, azimuth_deg)[0]
        multiple, once = _light_of(_interpolated(self.logarithms, *finer, on_grid))
        sun, e, a = (np.radians(x) for x in (self.sun_elevation_deg, elevation_deg, azimuth_deg))
        e, a = (e[:, None], a[None]) if on_grid else (e, a)
        cosine = self._cosine(e, a)
        phases, (i, f) = self._phases(cosine)
        widened = phases[1:]
        if self.peaks is not None:
            dimmed = np.exp(-np.maximum(rows @ self.peaks[0], 0.0))
            added = np.moveaxis(np.tensordot(rows, self.peaks[1], (1, 1)), 1, 0)
            j, part = _place_of_angle(cosine, PEAK_ANGLES)
            row = np.arange(len(rows))[:, None] if on_grid else np.arange(len(rows))
            dimmed = dimmed[:, None] if on_grid else dimmed
            widened = [
                np.maximum(phase * dimmed + more[row, j] * (1.0 - part) + more[row, j + 1] * part, 0.0)
                for phase, more in zip(widened, added, strict=True)
            ]
        stokes = [multiple + sum(phase * q for phase, q in zip([phases[0], *widened], once, strict=True))]
        if n_stokes > 1:
            rayleigh = -3.0 / (16.0 * np.pi) * (1.0 - rho) / (1.0 + 0.5 * rho) * (1.0 - cosine[..., None] ** 2)
            polarised = rayleigh * once[0] + sum(
                phase * (ratio[i] * (1.0 - f) + ratio[i + 1] * f) * q
                for phase, ratio, q in zip(phases[1:], self.air.polarising, once[1:], strict=True)
            )
            # across the line of sight, the sun's direction has these components in the vertical plane and beside it
            vertical = np.cos(e) * np.sin(sun) - np.sin(e) * np.cos(sun) * np.cos(a)
            beside = -np.cos(sun) * np.sin(a)
            square = np.maximum(vertical**2 + beside**2, 1e-30)
            turns = ((vertical**2 - beside**2) / square, 2.0 * vertical * beside / square)
            for values, columns, turn in zip(self.polarised, (even, odd), turns, strict=True):
                part = _interpolated(values[None], rows, columns, on_grid)[0]
                stokes.append(multiple * part + polarised * turn[..., None])
        return np.stack(stokes, axis=-2)

    def at_nodes(self) -> np.ndarray:
        """I over F0 [sr^-1] at the nodes, which are among the rows and columns, without widened peaks, (E, A, W)."""
        rows, columns = self.elevation_deg.searchsorted(ELEVATION_DEG), self.azimuth_deg.searchsorted(AZIMUTH_DEG)
        multiple, once = _light_of(self.logarithms[:, rows[:, None], columns])
        phases, _ = self._phases(self._cosine(np.radians(ELEVATION_DEG)[:, None], np.radians(AZIMUTH_DEG)))
        return multiple + sum(phase * q for phase, q in zip(phases, once, strict=True))

    def _cosine(self, elevation: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        """Cosines of the angles between directions [rad] and the sun."""
        sun = np.radians(self.sun_elevation_deg)
        cosine = np.sin(elevation) * np.sin(sun) + np.cos(elevation) * np.cos(sun) * np.cos(azimuth)
        return np.clip(cosine, -1.0, 1.0)

    def _phases(self, cosine: np.ndarray) -> tuple[list[np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Phase functions [sr^-1] of air and aerosols at cosines (...,), (..., W) each, and their place in tables."""
        rho = self.air.depolarisation
        of_air = 3.0 / (8.0 * np.pi * (2.0 + rho)) * ((1.0 + rho) + (1.0 - rho) * cosine[..., None] ** 2)
        i, f = _place_of_angle(cosine, self.air.log_phase.shape[1])
        return [of_air, *(np.exp(table[i] * (1.0 - f) + table[i + 1] * f) for table in self.air.log_phase)], (i, f)


def _light_of(logarithms: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """M and Q_k of air and aerosols, from `Sky.logarithms` in some directions."""
    multiple, *once = np.exp(logarithms)
    once = [q - NEGLIGIBLE * multiple for q in once]
    return multiple, [np.where(q.real > 0.0, q, 0.0) for q in once]


def _place_of_angle(cosine: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Index into a table at angles pi (n / (count - 1))^2, and the part of the way to the next (..., 1)."""
    where = np.sqrt(np.arccos(cosine) / np.pi) * (count - 1)
    index = np.minimum(where.astype(int), count - 2)
    return index, (where - index)[..., None]


def _interpolated(values: np.ndarray, rows: np.ndarray, columns: np.ndarray, on_grid: bool) -> np.ndarray:
    """Values at the nodes (P, E, A, W) by splines over elevation and azimuth, (P, R, C, W) or (P, R, W)."""
    over_rows = np.tensordot(rows, values, (1, 1))  # R P A W
    return np.moveaxis(columns @ over_rows if on_grid else (columns[:, None, None] @ over_rows)[:, :, 0], 1, 0)


def elevation_splines(nodes_deg: np.ndarray, elevation_deg: np.ndarray) -> np.ndarray:
    """Splines through nodes (N,), close to each other along the horizon, (E, N)."""
    return splines(np.log(nodes_deg + 1.5), np.log(elevation_deg + 1.5))


def azimuth_splines(nodes_deg: np.ndarray, azimuth_deg: np.ndarray) -> list[np.ndarray]:
    """Splines through nodes (N,) from 0 to 180 deg and three mirror images on either side, (A, N): of what is the same
    on both sides of the sun, and of what changes its sign."""
    wrapped = (np.asarray(azimuth_deg, float) + 180.0) % 360.0 - 180.0
    count, beside = nodes_deg.size, np.arange(3, 0, -1)
    mirrored = count - 1 - beside[::-1]
    nodes = np.concatenate([-nodes_deg[beside], nodes_deg, 360.0 - nodes_deg[mirrored]])
    through = splines(nodes, np.abs(wrapped))
    out: list[np.ndarray] = []
    for sign in (1.0, -1.0):
        one = through[:, 3 : 3 + count].copy()
        one[:, beside] += sign * through[:, :3]
        one[:, mirrored] += sign * through[:, 3 + count :]
        out.append(one * np.where(wrapped < 0.0, sign, 1.0)[:, None])
    return out
