"""The comparison's air, its texture, and the reference solution's answers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import results

from twilight.atmosphere.medium import Medium
from twilight.config import load
from twilight.scene.medium import climate_medium

CLIMATE = "continental-average"
WAVELENGTHS_NM = np.linspace(380.0, 720.0, 8)
THIRTY_SUNS_DEG = tuple(np.round(np.linspace(43.0, -15.0, 30), 6))
ONE_SUN_DEG = -4.0
REFERENCE = Path(__file__).parents[1] / "reference"


def straight_air(wavelength_nm: np.ndarray) -> Medium:
    """The climate's medium without refraction, which the peer does not do in twilight (its beam does not spread)."""
    config = load(CLIMATE, {"climate.refraction.model": "none"})
    return climate_medium(config.climate, np.asarray(wavelength_nm, dtype=float))


def texture() -> tuple[np.ndarray, np.ndarray]:
    """Elevations and azimuths [deg] of a half-sky of 60 azimuths x 30 elevations, each (1800,)."""
    grid = np.meshgrid((np.arange(30) + 0.5) * 3.0, np.linspace(0.0, 180.0, 60), indexing="ij")
    return grid[0].ravel(), grid[1].ravel()


@dataclass(frozen=True)
class ReferenceSolution:
    """Rows of the Monte-Carlo reference solution: sun, elevation, azimuth, wavelength, radiance, standard error."""

    sun_deg: np.ndarray
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    wavelength_nm: np.ndarray
    radiance: np.ndarray
    error: np.ndarray

    @staticmethod
    def read(path: Path, suns_deg: list[float] | None = None) -> ReferenceSolution:
        """A table as benchmarks/montecarlo_reference.py writes it, or some of its suns; black skies are left out."""
        rows = results.read_numbers(path)
        rows = rows[rows["radiance_per_sr"] > 0]
        if suns_deg is not None:
            rows = rows[np.isin(rows["sun_elevation_deg"], suns_deg)]
        names = ("sun_elevation_deg", "elevation_deg", "azimuth_deg", "wavelength_nm", "radiance_per_sr")
        return ReferenceSolution(*(rows[n] for n in names), rows["standard_error_per_sr"])

    @property
    def suns_deg(self) -> np.ndarray:
        return np.unique(self.sun_deg)[::-1]

    def wavelengths(self) -> np.ndarray:
        return np.unique(self.wavelength_nm)

    def at(self, sun_deg: float) -> ReferenceSolution:
        here = self.sun_deg == sun_deg
        return replace(self, **{k: getattr(self, k)[here] for k in self.__dataclass_fields__})

    def directions(self) -> tuple[np.ndarray, np.ndarray]:
        """The different directions of all suns, (D,) each."""
        pairs = np.unique(np.c_[self.elevation_deg, self.azimuth_deg], axis=0)
        return pairs[:, 0], pairs[:, 1]


@dataclass(frozen=True)
class Errors:
    """Statistics of |L / L_ref - 1| in per cent; the reference solution's own noise is taken out in quadrature."""

    median: float
    mean: float
    p95: float
    worst: float
    bias: float
    reference: float
    worst_at: tuple[float, float, float]


def compare(reference: ReferenceSolution, radiance: np.ndarray) -> Errors:
    """Errors of radiances (N,) given in the order of the reference solution's rows.

    For normal noise of standard deviation s the median, mean and 95th percentile of its size are 0.674, 0.798 and
    1.960 s: that much is subtracted in quadrature; from the largest, one standard error of that row.
    """
    difference = 100.0 * (radiance / reference.radiance - 1.0)
    noise = 100.0 * reference.error / reference.radiance
    typical = float(np.sqrt(np.mean(noise**2)))
    size = np.abs(difference)
    w = int(np.argmax(size))

    def less(value: float, share: float) -> float:
        return float(np.sqrt(max(value**2 - share**2, 0.0)))

    return Errors(
        less(float(np.median(size)), 0.6745 * typical),
        less(float(np.mean(size)), 0.7979 * typical),
        less(float(np.percentile(size, 95)), 1.9600 * typical),
        less(float(size[w]), float(noise[w])),
        float(difference.mean()),
        float(np.median(noise)),
        (float(reference.elevation_deg[w]), float(reference.azimuth_deg[w]), float(reference.wavelength_nm[w])),
    )
