"""Light that aerosol scattered once, about, by closed forms and numpy alone: what a `SkyTable` holds apart.

It stands for no solver's light: a table's two layers always add up to that.  The nearer this is to what the solver has
of light scattered once by aerosol, the smoother both layers are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twilight.numerics.directions import PHASE_ANGLE_RAD, scattering_angle_rad
from twilight.transport.shells import ALTITUDE_KM, RefractedShells, sublayers

if TYPE_CHECKING:
    from twilight.atmosphere.bands import GasBands
    from twilight.atmosphere.medium import Medium

PEAK_DEGREE = 17
"""Legendre degree whose moment is the fraction of scattering in the forward peak, which counts as not scattered."""

LOWEST_OBSERVER_KM = 1e-4
"""Distance of an observer from a boundary of the shells within which it is taken as on it [km]."""


ON_GROUND_KM = 0.1
"""Height up to which an observer sees no air between himself and the ground [km]."""


class ScatteredOnce:
    """Light scattered once by the aerosol of a medium, for one observer.

    medium, bands: as of the engine's block of wavelengths; altitude_km: of the observer above sea level
    aerosol: whether its light is wanted, else the sun's apparent place alone
    log_phase (PHASE_COUNT, W): ln of the phase function of the column's aerosol; None without aerosol or above the air
    """

    def __init__(self, medium: Medium, bands: GasBands | None, altitude_km: float, *, aerosol: bool = True):
        self.altitude_km = altitude_km
        height = max(altitude_km - medium.bottom_km, 0.0)
        self._bands = bands
        terms = medium if bands is None else bands.expand(medium)
        self._phases = terms.phase_functions
        dip = np.degrees(np.sqrt(2.0 * height / terms.earth_radius_km))
        self._ground_deg = -float(dip) if height <= ON_GROUND_KM else -90.0
        boundary = ALTITUDE_KM
        within = height <= ALTITUDE_KM[-1]
        if within and np.abs(boundary - height).min() > LOWEST_OBSERVER_KM:
            boundary = np.sort(np.append(boundary, height))
        wavelengths = terms.n_wavelengths if aerosol else 1
        shape = (len(self._phases), boundary.size - 1, wavelengths)
        scatters, rest, peak = np.zeros(shape), np.zeros(shape[1:]), np.zeros(shape[1:])
        if aerosol:
            fine = terms.refined()
            z = fine.altitude_km - fine.bottom_km
            scattering = fine.aerosol_extinction_per_km * fine.aerosol_single_scattering_albedo
            kinds = [_in_layers(z, scattering * f, boundary) for f in fine.aerosol_phase_fraction]
            scatters = np.reshape(kinds, shape)
            per_km = fine.air_scattering_per_km + fine.absorption_per_km + fine.aerosol_extinction_per_km
            rest = _in_layers(z, per_km, boundary)
        if aerosol and self._phases:
            forward = np.array([p.legendre_moments(PEAK_DEGREE)[:, PEAK_DEGREE] for p in self._phases])
            peak = np.einsum("kw,klw->lw", np.clip(forward, 0.0, 0.999), scatters)
        middle = terms.n_wavelengths // 2
        self._shells = RefractedShells(
            boundary,
            rest - peak,
            scatters,
            peak,
            terms.at(sublayers(boundary) + terms.bottom_km).refractivity[:, middle],
            min(height, ALTITUDE_KM[-1]),
            terms.earth_radius_km + terms.bottom_km,
        )
        column = np.einsum("klw,l->kw", scatters, np.diff(boundary))
        self.log_phase = None
        if aerosol and self._phases and within and column.any():
            each = np.stack([p(np.cos(PHASE_ANGLE_RAD)).T for p in self._phases])
            total = column.sum(axis=0)
            weight = np.where(total > 0.0, column / np.where(total > 0.0, total, 1.0), 1.0 / len(column))
            phase = np.einsum("kaw,kw->aw", each, weight)
            if bands is not None:  # all terms of a wavelength have its phase function
                phase = phase[:, np.unique(bands.wavelength_index, return_index=True)[1]]
            self.log_phase = np.log(np.maximum(phase, 1e-30)).astype(np.float32)

    def apparent_sun_deg(self, sun_elevation_deg: float) -> float:
        """Apparent elevation of a sun [deg]; of one below the horizon, as far above it as at the horizon."""
        return self._shells.apparent_elevation_deg(sun_elevation_deg)

    def light(self, sun_elevation_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
        """Light / F0 on rows (E,) and columns (A,), (E, A, W); rows below the horizontal as the lowest above it.

        The ground in front of an observer who stands on it has none.
        """
        if self.log_phase is None:
            return None
        rows = np.maximum(elevation_deg, 0.0)
        unique, back = np.unique(rows, return_inverse=True)
        factors = self._shells.scattered_once(sun_elevation_deg, unique, azimuth_deg)[:, back]
        factors[:, elevation_deg < self._ground_deg] = 0.0
        apparent = self.apparent_sun_deg(sun_elevation_deg)
        cosine = np.cos(scattering_angle_rad(apparent, elevation_deg[:, None], azimuth_deg))
        out = sum(np.moveaxis(p(cosine), 0, -1) * part for p, part in zip(self._phases, factors, strict=True))
        return np.asarray(out) if self._bands is None else self._bands.sum_terms(np.asarray(out))


def _in_layers(height_km: np.ndarray, per_km: np.ndarray, boundary_km: np.ndarray) -> np.ndarray:
    """Mean coefficient of layers (L, W), of one (Z, W) at heights above the ground."""
    step = np.diff(height_km)[:, None]
    below = np.concatenate([np.zeros_like(per_km[:1]), np.cumsum(0.5 * step * (per_km[1:] + per_km[:-1]), axis=0)])
    depth = np.stack([np.interp(boundary_km, height_km, column) for column in below.T], axis=1)
    return np.diff(depth, axis=0) / np.diff(boundary_km)[:, None]
