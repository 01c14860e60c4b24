"""Beside the ray that grazes the top of haze the sky changes by as much as a quadrature says: the edge is the air's."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.transport.scaling import species_phase

STRAIGHT = replace(
    zones.QUALITIES["draft"], max_orders=1, polarisation=False, refraction=False, bent_lines_of_sight=False,
    bent_paths=False, line_of_sight_density=2.0,
)  # fmt: skip
SUN_DEG = 1.0
"""Elevation of the sun [deg]."""
AZIMUTH_DEG = 0.0
"""Of the lines of sight, from the sun [deg]."""
NODE, WEIGHT = np.polynomial.legendre.leggauss(6)


class Quadrature:
    """Sunlight scattered once along straight lines through the air of a field, its levels taken one by one."""

    def __init__(self, field: zones.Field):
        self.profile = field.grids.profile
        self.radius_km = field.medium.earth_radius_km
        self.levels_km = np.unique(field.medium.altitude_km)
        self.top_km = field.medium.top_km
        cosine = math.cos(math.radians(AZIMUTH_DEG))
        self.phase = lambda elevation: species_phase(
            field.medium,
            field.grids.scaled.forward_fraction,
            np.array([_scattering_cosine(elevation, math.radians(SUN_DEG), cosine)]),
        )[0, :, 0]

    def at(self, per_km: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.interp(z, self.profile.altitude_km, per_km, right=0.0)

    def points(self, z: float, cosine: float, step_km: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(distances, weights, altitudes) [km] along a line from z through the air, to the ground or its end."""
        r = self.radius_km + z
        lowest = r * math.sqrt(1.0 - cosine**2)
        within = math.sqrt(max(0.0, (self.radius_km + self.top_km) ** 2 - lowest**2))
        near, far = max(0.0, -r * cosine - within), -r * cosine + within
        if cosine < 0.0 and lowest < self.radius_km:
            far = -r * cosine - math.sqrt(self.radius_km**2 - lowest**2)
        reached = np.sqrt(np.maximum(0.0, (self.radius_km + self.levels_km) ** 2 - lowest**2))
        ends = np.concatenate([np.arange(near, far, step_km), -r * cosine - reached, -r * cosine + reached])
        ends = np.unique(np.append(ends[(ends >= near) & (ends < far)], far))
        half = 0.5 * np.diff(ends)
        s = (0.5 * (ends[1:] + ends[:-1])[:, None] + half[:, None] * NODE).ravel()
        return s, (half[:, None] * WEIGHT).ravel(), np.sqrt(r * r + s * s + 2.0 * r * s * cosine) - self.radius_km

    def sunlight(self, z: float, cosine: float) -> float:
        if cosine < 0.0 and (self.radius_km + z) * math.sqrt(1.0 - cosine**2) < self.radius_km:
            return 0.0
        _, weight, altitude = self.points(z, cosine, 50.0)
        return math.exp(-np.sum(weight * self.at(self.profile.extinction[:, 0], altitude)))

    def radiance(self, z: float, elevation: float) -> float:
        s, weight, altitude = self.points(z, math.sin(elevation), 10.0)
        depth = weight * self.at(self.profile.extinction[:, 0], altitude)
        passed = np.exp(-(np.cumsum(depth) - 0.5 * depth))
        sun = np.array([math.cos(math.radians(SUN_DEG)), math.sin(math.radians(SUN_DEG))])
        place = np.array([0.0, self.radius_km + z]) + s[:, None] * np.array([math.cos(elevation), math.sin(elevation)])
        towards_sun = place @ sun / (self.radius_km + altitude)
        scattered = sum(
            p * self.at(k[:, 0], altitude)
            for p, k in zip(self.phase(elevation), self.profile.species_scattering, strict=True)
        )
        lit = [self.sunlight(h, c) for h, c in zip(altitude, towards_sun, strict=True)]
        return float(np.sum(weight * passed * scattered * lit))


def _scattering_cosine(elevation: float, sun: float, cosine_azimuth: float) -> float:
    return math.sin(elevation) * math.sin(sun) + math.cos(elevation) * math.cos(sun) * cosine_azimuth


@pytest.mark.parametrize("observer_km", [10.0, pytest.param(400.0, marks=pytest.mark.slow)])
def test_the_step_beside_the_top_of_haze_is_that_of_the_air(observer_km):
    """From 10 km, 0.01 deg beside the ray that grazes the top of urban haze, the sky is 15 % darker: a line just below
    passes tens of kilometres of haze, one just above none."""
    field = zones.prepare(climate_medium(load_climate("urban"), np.array([550.0])), STRAIGHT)
    top = float(field.grids.profile.sharp_km[0])
    exact = Quadrature(field)
    grazing = -math.acos((exact.radius_km + top) / (exact.radius_km + observer_km))
    elevation = grazing + np.radians([-0.015, -0.005, 0.005, 0.015])
    seen = field.radiance(SUN_DEG, np.degrees(elevation), AZIMUTH_DEG, observer_altitude_km=observer_km)[:, 0]
    expected = np.array([exact.radiance(observer_km, e) for e in elevation])
    np.testing.assert_allclose(seen, expected, rtol=4e-3)
    # the edge is there to be seen
    assert np.abs(np.diff(np.log(expected))).max() > 0.04
