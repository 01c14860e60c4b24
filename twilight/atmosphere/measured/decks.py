"""Layers of cloud from the cloud water of an analysis.

Where at least OVERCAST of the sky is covered, neighbouring altitudes with water (or with ice) are one homogeneous layer
over the whole sky, the only clouds that the program knows.  Its optical depth is that of particles that are large
against the wavelength, whose extinction is twice their area (Stephens 1978, J. Atmos. Sci. 35, 2123, eq. 7):

    tau = 3 W / (2 rho r_e),   W the water [kg m^-2], rho its density as liquid or ice, r_e the effective radius.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from twilight.atmosphere.clouds import KINDS, CloudLayer
from twilight.atmosphere.measured.parts import CloudWater

OVERCAST = 0.5
"""Covered fraction of an altitude from which it counts as covered."""

LEAST_DEPTH = 0.05
"""Thinner layers are left out: they cannot be told from the analysis' noise."""

MIDDLE_KM = 2.0
"""From this base on droplets are altostratus (International Cloud Atlas, WMO)."""

KG_PER_M3 = {"water": 1000.0, "ice": 917.0}


def optical_depth(kg_per_m2: float, substance: str, effective_radius_um: float) -> float:
    """Optical depth of large particles of `water` or `ice`."""
    return 1.5 * kg_per_m2 / (KG_PER_M3[substance] * effective_radius_um * 1e-6)


def decks(water: CloudWater) -> list[CloudLayer]:
    """The layers of cloud, from the lowest up, liquid before ice."""
    return [
        layer
        for substance, amount in (("water", water.liquid_kg_per_m2), ("ice", water.ice_kg_per_m2))
        for layer in _layers(water, substance, amount)
    ]


def _layers(water: CloudWater, substance: str, kg_per_m2: np.ndarray) -> Iterator[CloudLayer]:
    covered = np.concatenate([[False], (water.cover >= OVERCAST) & (kg_per_m2 > 0.0), [False]])
    first = np.flatnonzero(covered[1:] & ~covered[:-1])
    last = np.flatnonzero(covered[:-1] & ~covered[1:])
    for a, b in zip(first, last, strict=True):
        base, top = float(water.base_km[a]), float(water.top_km[b - 1])
        kind = "cirrus" if substance == "ice" else "stratus" if base < MIDDLE_KM else "altostratus"
        radius = KINDS[kind].effective_radius_um
        depth = optical_depth(float(np.sum(kg_per_m2[a:b])), substance, radius)
        if depth >= LEAST_DEPTH:
            yield CloudLayer(kind, max(0.0, base), top, depth, radius)


def most_cover(water: CloudWater) -> float:
    """Largest covered fraction of any altitude with water or ice; 0 where there are none."""
    wet = water.liquid_kg_per_m2 + water.ice_kg_per_m2 > 0.0
    return float(np.max(water.cover[wet], initial=0.0))
