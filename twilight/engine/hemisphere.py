"""Light on surfaces: directions and weights that integrate a sky over a hemisphere, and the sun's disc on the
ground."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from twilight.sky.disc import SOLAR_RADIUS_DEG
from twilight.transport.beam import Beam, beam_at

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium
    from twilight.engine.field_light import FieldLight

DISC_STRIPS = 12
"""Horizontal strips of the sun's disc."""
ROWS = 12
"""Nodes of `whole_hemisphere` below the sun's elevation, and as many above it (uniform skies: test_light.py)."""
COLUMNS = 20
"""Nodes over the azimuths of either half of `whole_hemisphere`."""
LOWEST_NODE_DEG = 6.0
"""Least elevation of the sun [deg] that parts the hemisphere's nodes in two: for lower suns the nodes stand still."""
HIGHEST_NODE_DEG = 84.0
"""Greatest elevation of the sun [deg] that parts them: for higher suns they stand still too."""


def disc_irradiance(
    beam: Beam, medium: Medium, sun_elevation_deg: float, altitude_km: float | None = None
) -> np.ndarray:
    """Irradiance of a level surface by the sun's disc over F0, (W,): uniform disc in horizontal strips, each refracted.

    altitude_km: of the surface; None: the ground.
    """
    total, out = np.zeros(medium.n_wavelengths), np.zeros(medium.n_wavelengths)
    for offset, fraction in zip(*disc_strips(), strict=True):
        true = np.radians(sun_elevation_deg + SOLAR_RADIUS_DEG * offset)
        bending = beam_at(beam, medium.bottom_km if altitude_km is None else altitude_km, np.sin(true), out)
        total += fraction * max(0.0, float(np.sin(true + bending))) * out
    return total


def disc_strips() -> tuple[np.ndarray, np.ndarray]:
    """Heights of strips above the disc's centre, over its radius, and fractions of its area.

    Nodes of Gauss and Chebyshev's second kind: strips of a disc weigh by their chord.
    """
    k = np.arange(1, DISC_STRIPS + 1) * np.pi / (DISC_STRIPS + 1)
    return np.cos(k), 2.0 / (DISC_STRIPS + 1) * np.sin(k) ** 2


def disc_beams(
    solved: FieldLight, sun_elevation_deg: float, observer_altitude_km: float | None = None
) -> tuple[np.ndarray, np.ndarray] | None:
    """Apparent elevations [deg] (S,) of the disc's strips and their irradiances at normal incidence over F0 (S, W).

    observer_altitude_km: None for the scene's.  None where the sun is down.
    """
    altitude_km = solved.scene.altitude_km if observer_altitude_km is None else observer_altitude_km
    altitude_km = max(altitude_km, solved.medium.bottom_km)
    if not all(block.sunbeam.reaches(sun_elevation_deg + SOLAR_RADIUS_DEG, altitude_km) for block in solved.blocks):
        return None
    offsets, fractions = disc_strips()
    elevation, parts = np.zeros(DISC_STRIPS), []
    for block in solved.blocks:
        out = np.zeros((DISC_STRIPS, block.sunbeam.medium.n_wavelengths))
        for s, offset in enumerate(offsets):
            true = np.radians(sun_elevation_deg + SOLAR_RADIUS_DEG * offset)
            elevation[s] = np.degrees(true + beam_at(block.sunbeam.beam, altitude_km, np.sin(true), out[s]))
        parts.append(out if block.bands is None else block.bands.sum_terms(out))
    return elevation, fractions[:, None] * np.concatenate(parts, axis=1)


def hemisphere(
    sun_elevation_deg: float, rows: int = 24, columns: int = 20
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions (elevation, azimuth) [deg] and weights whose sum over radiance is horizontal irradiance, each (D,).

    Gauss-Legendre in sin^2 of the elevation, with the sun's elevation as an edge, and in the root of the azimuth: dense
    about the sun; 2e-4 in continental air.  The other half of the sky is the mirror image.
    """
    edge = float(np.sin(np.radians(min(max(sun_elevation_deg, 0.0), 90.0))) ** 2)
    edges = [0.0, edge, 1.0] if 0.01 < edge < 0.99 else [0.0, 1.0]
    x, w = np.polynomial.legendre.leggauss(rows // (len(edges) - 1))
    square, row_weight = [], []
    for low, high in pairwise(edges):
        square.append(low + 0.5 * (high - low) * (x + 1))
        row_weight.append(0.5 * (high - low) * w)
    s, sw = np.concatenate(square), np.concatenate(row_weight)
    u, uw = np.polynomial.legendre.leggauss(columns)
    root = 0.5 * (u + 1)
    azimuth, aw = np.pi * root**2, np.pi * root * uw
    grid = np.meshgrid(np.degrees(np.arcsin(np.sqrt(s))), np.degrees(azimuth), indexing="ij")
    # cos dOmega = d(sin^2)/2 dA, both halves
    return grid[0].ravel(), grid[1].ravel(), np.outer(sw, aw).ravel()


def whole_hemisphere(sun_elevation_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevations, azimuths from the sun [deg] and solid angles [sr] of both halves of the upper hemisphere.

    Gauss-Legendre in the sine of the elevation, below and above the sun, and in the root of the azimuth.
    """
    edge = np.sin(np.radians(np.clip(sun_elevation_deg, LOWEST_NODE_DEG, HIGHEST_NODE_DEG)))
    x, w = np.polynomial.legendre.leggauss(ROWS)
    sine = np.concatenate([0.5 * edge * (x + 1.0), edge + 0.5 * (1.0 - edge) * (x + 1.0)])
    height = np.concatenate([0.5 * edge * w, 0.5 * (1.0 - edge) * w])
    u, uw = np.polynomial.legendre.leggauss(COLUMNS)
    root = 0.5 * (u + 1.0)
    grid = np.meshgrid(np.degrees(np.arcsin(sine)), np.degrees(np.pi * root**2), indexing="ij")
    elevation, azimuth = grid[0].ravel(), grid[1].ravel()
    solid = np.outer(height, np.pi * root * uw).ravel()
    return np.tile(elevation, 2), np.concatenate([azimuth, -azimuth]), np.tile(solid, 2)
