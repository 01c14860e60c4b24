"""Layers of the atmosphere: Haber's equal air masses, free boundaries, and the mean of a medium over each layer."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError

HABER_SCALE_HEIGHT_KM = 8.0
"""Scale height of the air that divides the atmosphere into layers (Haber 2005 sec. 4.1.2)."""

MAX_LAYERS = 2000
"""Most layers that are allowed."""


@dataclass(frozen=True)
class EqualAirMass:
    """N layers of equal air mass, for an exponential atmosphere of scale height 8 km (Haber 2005 sec. 4.1.2)."""

    count: int
    coefficients: str = "mean"

    def boundaries_km(self, top_km: float, ground_km: float = 0.0) -> np.ndarray:
        """Boundaries ground = H_0 < ... < H_N = top: H_{i+1} = -8 ln(exp(-H_i/8) - M/8), M the mass of a layer."""
        if not 1 <= self.count <= MAX_LAYERS:
            raise TwilightError(f"layers.count: {self.count} is not possible, allowed is 1 to {MAX_LAYERS}")
        fraction = np.arange(self.count + 1) / self.count
        depth = (top_km - ground_km) / HABER_SCALE_HEIGHT_KM
        heights = ground_km - HABER_SCALE_HEIGHT_KM * np.log1p(fraction * math.expm1(-depth))
        heights[0], heights[-1] = ground_km, top_km
        return heights


@dataclass(frozen=True)
class Boundaries:
    """Layers between given altitudes [km]; the first is the ground and the last the top of the atmosphere."""

    altitude_km: tuple[float, ...]
    coefficients: str = "mean"

    def boundaries_km(self, top_km: float, ground_km: float = 0.0) -> np.ndarray:
        z = np.asarray(self.altitude_km, dtype=float)
        if z.ndim != 1 or not 2 <= z.size <= MAX_LAYERS + 1 or not np.all(np.isfinite(z)) or np.any(np.diff(z) <= 0):
            raise TwilightError(
                f"layers.boundaries_km must be 2 to {MAX_LAYERS + 1} altitudes, each above the one before"
            )
        if z[0] != ground_km or not math.isclose(z[-1], top_km, rel_tol=1e-9):
            raise TwilightError(
                f"layers.boundaries_km must begin at {ground_km:g} and end at the top of the air, {top_km:g} km, "
                f"not {z[0]:g} and {z[-1]:g}"
            )
        return z


def layered(medium: Medium, boundaries_km: np.ndarray, coefficients: str = "mean") -> Medium:
    """The medium with constant coefficients in each layer: the layer's mean, or what they are at its centre.

    Means change no column: extinction and absorption are averaged over altitude, the albedo with the extinction as
    weight and the phase fractions with the scattering.  Each inner boundary is two levels.  Refractivity has no jumps:
    it keeps its values at the boundaries and goes smoothly between them.
    """
    z = np.asarray(boundaries_km, dtype=float)
    if coefficients == "centre":
        return _at_centres(medium, z)
    inner = medium.altitude_km[(medium.altitude_km > z[0]) & (medium.altitude_km < z[-1])]
    edges = np.unique(np.concatenate([z, inner]))
    layer = np.searchsorted(z, 0.5 * (edges[1:] + edges[:-1])) - 1
    x, w = np.polynomial.legendre.leggauss(6)
    thickness = np.diff(edges)
    points = edges[:-1, None] + 0.5 * thickness[:, None] * (1 + x)
    weight = (0.5 * thickness[:, None] * w / np.diff(z)[layer][:, None])[..., None]
    at = medium.at(points)
    n = z.size - 1

    def mean(values: np.ndarray) -> np.ndarray:
        out = np.zeros((n, medium.n_wavelengths))
        np.add.at(out, layer, np.sum(values * weight, axis=1))
        return np.repeat(out, 2, axis=0)

    extinction = mean(at.aerosol_extinction)
    scattering = mean(at.aerosol_scattering)
    albedo = np.where(extinction > 0, np.minimum(1.0, scattering / np.where(extinction > 0, extinction, 1.0)), 0.0)
    fractions = [
        np.where(
            scattering > 0,
            mean(fraction * at.aerosol_scattering) / np.where(scattering > 0, scattering, 1.0),
            1.0 if k == 0 else 0.0,
        )
        for k, fraction in enumerate(at.aerosol_phase_fraction)
    ]
    doubled = np.repeat(z, 2)[1:-1]
    return replace(
        medium,
        altitude_km=doubled,
        air_scattering_per_km=mean(at.air_scattering),
        absorption_per_km=mean(at.absorption),
        aerosol_extinction_per_km=extinction,
        aerosol_single_scattering_albedo=albedo,
        aerosol_phase_fraction=np.stack(fractions) if fractions else np.zeros((0, doubled.size, medium.n_wavelengths)),
        refractivity=medium.at(doubled).refractivity,
    )


def _at_centres(medium: Medium, z: np.ndarray) -> Medium:
    """The medium with the coefficients of the centre of each layer (Haber 2005 sec. 4.1.2: z_i at H*_i)."""
    at = medium.at(0.5 * (z[1:] + z[:-1]))
    doubled = np.repeat(z, 2)[1:-1]
    both = [np.repeat(a, 2, axis=-2) for a in at]
    return replace(
        medium,
        altitude_km=doubled,
        air_scattering_per_km=both[0],
        absorption_per_km=both[1],
        aerosol_extinction_per_km=both[2],
        aerosol_single_scattering_albedo=both[3],
        aerosol_phase_fraction=both[4],
        refractivity=medium.at(doubled).refractivity,
    )
