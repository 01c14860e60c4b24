"""What a file can hold of the air: one class for each kind of measurement, in the program's units."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class AirColumn:
    """Air above a place, at Z altitudes from the lowest up; all arrays have shape (Z,).

    altitude_km: geometric, above sea level, increasing.  pressure_hpa decreases.
    water_vapour, ozone: molecules per molecule of moist air; NaN at altitudes without, None where the file has none.
    source: the file and what it measured where and when, in words.
    """

    source: str
    altitude_km: np.ndarray
    pressure_hpa: np.ndarray
    temperature_k: np.ndarray
    water_vapour: np.ndarray | None = None
    ozone: np.ndarray | None = None


@dataclass(frozen=True)
class OzoneColumn:
    """Ozone above the ground [DU]."""

    source: str
    column_du: float


@dataclass(frozen=True)
class WaterColumn:
    """Precipitable water [mm]."""

    source: str
    column_mm: float


@dataclass(frozen=True)
class AerosolDepth:
    """Optical depth (C,) of all aerosol at wavelengths (C,) [nm], increasing; one or more."""

    source: str
    wavelength_nm: np.ndarray
    optical_depth: np.ndarray


@dataclass(frozen=True)
class SizeDistribution:
    """Sizes and refractive index of the aerosol of a column.

    radius_um: (R,), equidistant in ln r; volume_um3_per_um2: (R,), dV/dln r of the column.
    wavelength_nm: (C,), of the index n - ik (C,) and of the extinction's optical_depth (C,).
    """

    source: str
    radius_um: np.ndarray
    volume_um3_per_um2: np.ndarray
    wavelength_nm: np.ndarray
    index: np.ndarray
    optical_depth: np.ndarray


@dataclass(frozen=True)
class CloudWater:
    """Clouds above a place at Z altitudes from the lowest up; all arrays have shape (Z,).

    cover: fraction of the sky.  liquid_kg_per_m2, ice_kg_per_m2: of the air that each altitude stands for, the mean
    over cloud and clear.  base_km, top_km: of that air.
    """

    source: str
    base_km: np.ndarray
    top_km: np.ndarray
    cover: np.ndarray
    liquid_kg_per_m2: np.ndarray
    ice_kg_per_m2: np.ndarray


Part = AirColumn | OzoneColumn | WaterColumn | AerosolDepth | SizeDistribution | CloudWater


@dataclass(frozen=True)
class Reading:
    """The parts that were taken from one file, and what it holds besides that is not used, in words.

    warnings: sentences on what lies far from the place and time that were asked for.
    """

    kind: str
    parts: tuple[Part, ...]
    not_used: tuple[str, ...] = field(default=())
    warnings: tuple[str, ...] = field(default=())
