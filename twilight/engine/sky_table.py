"""A field's sky for many suns and directions: read from tables of whole skies that are computed when they are needed.

A table holds ln(L / P) over elevation and azimuth from the sun, L the sun-normalised radiance and P the phase
function of all that scatters in the column: the ratio has no aureole, so that it may be interpolated although the
aureole moves with the sun.  Between tables of neighbouring suns, and in either angle, a local cubic.  Tables are
cached, in memory and in the user's folder.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twilight.base import cache
from twilight.base.errors import TwilightError
from twilight.numerics.phase import rayleigh_phase
from twilight.numerics.spectrum import hermite_weights

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium
    from twilight.engine.solve import Field

ROW_POWER = 1.8
"""Power of the row's number with which elevations rise: rows stand closer together at the horizon."""
ROWS_DEG = 90.0 * np.linspace(0.0, 1.0, 31) ** ROW_POWER
"""Elevations of a table [deg], from 0.2 deg apart at the horizon to 5 deg at the zenith."""
COLUMN_POWER = 1.5
"""Power of the column's number with which azimuths rise: columns stand closer together at the sun."""
COLUMNS_DEG = 180.0 * np.linspace(0.0, 1.0, 31) ** COLUMN_POWER
"""Azimuths from the sun of a table [deg], from 1 deg apart to 9 deg."""
SUNS_DEG = np.concatenate(
    [np.arange(-40.0, -22.0, 2.0), np.arange(-22.0, -9.0, 1.0), np.arange(-9.0, 4.0, 0.5), np.arange(4.0, 10.0, 1.0),
     np.arange(10.0, 90.1, 2.5)]
)  # fmt: skip
"""True elevations of the sun [deg] whose tables are interpolated; below the first there is no sunlight."""
ANGLES_RAD = np.concatenate([np.linspace(0.0, 0.2, 201), np.linspace(0.2, np.pi, 361)[1:]])
"""Scattering angles at which P is tabulated [rad]."""
FEW_FRACTION = 0.2
"""Lines of sight are computed one by one up to this fraction of those of the tables that would serve them."""
DARK = 1e-30
"""Radiance [sr^-1] that stands for none where logarithms are interpolated."""


class SkyTable:
    """Tables of a solved field, for one observer; every method takes azimuths from the sun.

    Errors: TwilightError for a solver whose field serves one sun alone.
    """

    def __init__(self, solved: Field):
        self.solved = solved
        if not solved.scene.capabilities.every_sun:
            name = solved.scene.solver_name
            raise TwilightError(f"light: needs a solver whose field serves every sun, as zones, not {name}")
        self._log_phase = _log_phase(solved.medium)
        self._made: dict[int, np.ndarray] = {}
        self._key = hashlib.sha256("".join(solved.keys).encode() + repr(solved.scene.altitude_km).encode()).hexdigest()

    def radiance(self, sun_elevation_deg: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], (N, D, W), of N suns (N,) and D directions of each (N, D), 0 to 90 deg high.

        Where few lines of sight are asked for (FEW_FRACTION), each is computed.
        """
        suns = np.asarray(sun_elevation_deg, float)
        elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        out = np.zeros((*elevation.shape, self.solved.medium.n_wavelengths))
        lit = np.flatnonzero(suns >= SUNS_DEG[0])
        if not lit.size:
            return out
        nodes, weights = hermite_weights(SUNS_DEG, suns[lit])
        missing = [k for k in np.unique(nodes[weights != 0.0]) if k not in self._made and self._stored(k) is None]
        rows = sum(np.unique(elevation[n]).size for n in lit)
        if rows <= FEW_FRACTION * len(missing) * ROWS_DEG.size:
            for n in lit:
                out[n] = self.solved.radiance(float(suns[n]), elevation[n], azimuth[n])
            return out
        for n, four, weight in zip(lit, nodes, weights, strict=True):
            table = sum(w * self._table(int(k)) for k, w in zip(four, weight, strict=True) if w != 0.0)
            out[n] = self._interpolate(np.asarray(table), suns[n], elevation[n], azimuth[n])
        return out

    def _interpolate(self, table: np.ndarray, sun_deg: float, elevation: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        """Radiance (D, W) of one sun."""
        from_sun = np.abs((azimuth + 180.0) % 360.0 - 180.0)
        i, u = hermite_weights(np.arange(ROWS_DEG.size, dtype=float), _place(elevation, ROWS_DEG, ROW_POWER))
        j, v = hermite_weights(np.arange(COLUMNS_DEG.size, dtype=float), _place(from_sun, COLUMNS_DEG, COLUMN_POWER))
        weight = (u[:, :, None] * v[:, None, :]).reshape(elevation.size, 16)
        place = (i[:, :, None] * COLUMNS_DEG.size + j[:, None, :]).reshape(elevation.size, 16)
        flat = table.reshape(-1, table.shape[-1])
        logarithm = np.einsum("dk,dkw->dw", weight, flat[place])
        return np.exp(logarithm + self._log_phase_at(sun_deg, elevation, azimuth))

    def _log_phase_at(self, sun_deg: float, elevation: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        e, s, a = np.radians(elevation), np.radians(sun_deg), np.radians(azimuth)
        chord = np.sin((e - s) / 2) ** 2 + np.cos(e) * np.cos(s) * np.sin(a / 2) ** 2
        angle = 2.0 * np.arcsin(np.sqrt(np.clip(chord, 0.0, 1.0)))
        k = np.clip(np.searchsorted(ANGLES_RAD, angle, side="right") - 1, 0, ANGLES_RAD.size - 2)
        f = ((angle - ANGLES_RAD[k]) / (ANGLES_RAD[k + 1] - ANGLES_RAD[k]))[..., None]
        return (1.0 - f) * self._log_phase[k] + f * self._log_phase[k + 1]

    def _table(self, k: int) -> np.ndarray:
        """ln(L / P), (R, C, W), of one of SUNS_DEG."""
        if k not in self._made:
            found = self._stored(k)
            self._made[k] = self._compute(k) if found is None else found
        return self._made[k]

    def _compute(self, k: int) -> np.ndarray:
        sun = float(SUNS_DEG[k])
        e, a = np.meshgrid(ROWS_DEG, COLUMNS_DEG, indexing="ij")
        radiance = np.maximum(self.solved.radiance(sun, e, a), DARK)
        made = (np.log(radiance) - self._log_phase_at(sun, e, a)).astype(np.float32)
        cache.store(cache.SKIES, self._file(k), lambda path: _save(path, made))
        return made

    def _file(self, k: int) -> str:
        about = f"{self._key} {SUNS_DEG[k]} {ROWS_DEG.tolist()} {COLUMNS_DEG.tolist()}"
        return hashlib.sha256(about.encode()).hexdigest()

    def _stored(self, k: int) -> np.ndarray | None:
        path = cache.find(cache.SKIES, self._file(k))
        if path is None:
            return None
        try:
            with np.load(path) as file:
                found = file["table"]
        except (OSError, ValueError, KeyError, EOFError):
            found = np.zeros(0)
        shape = (ROWS_DEG.size, COLUMNS_DEG.size, self.solved.medium.n_wavelengths)
        if found.shape != shape or not np.isfinite(found).all():
            cache.discard(path)
            return None
        return found


def _save(path: Path, table: np.ndarray) -> None:
    with open(path, "wb") as stream:
        np.savez(stream, table=table)


def _place(angle_deg: np.ndarray, nodes_deg: np.ndarray, power: float) -> np.ndarray:
    """Place among rows or columns, 0 to their number less 1: linear in that in which the nodes are equidistant."""
    largest_deg = nodes_deg[-1]
    return (np.clip(angle_deg, 0.0, largest_deg) / largest_deg) ** (1.0 / power) * (nodes_deg.size - 1)


def _log_phase(medium: Medium) -> np.ndarray:
    """ln of the phase function of the whole column, (angles, W): of air and particles by their scattering."""
    cosine = np.cos(ANGLES_RAD)
    z = medium.altitude_km
    thick = np.diff(z)[:, None]

    def column(coefficient: np.ndarray) -> np.ndarray:
        return (0.5 * (coefficient[1:] + coefficient[:-1]) * thick).sum(axis=0)

    weight = column(medium.air_scattering_per_km)
    total = weight * rayleigh_phase(cosine[:, None], medium.depolarisation)
    scattering = medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo
    for fraction, phase in zip(medium.aerosol_phase_fraction, medium.phase_functions, strict=True):
        part = column(scattering * fraction)
        total = total + part * phase(cosine).T
        weight = weight + part
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(weight > 0.0, total / weight, 1.0 / (4.0 * np.pi))
    return np.log(mean)
