"""Nodes and directions of the exact mode: points on shells around the observer, Gauss angles times equal azimuths."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import sph_harm_y

from twilight.solvers.cells.settings import CellsSettings

POLAR_POWER = 1.5
"""Power by which the elevations of the nodes crowd at the horizon."""
LOWEST_STEP_KM = 0.7
"""Interval between altitudes at the ground [km], at node_density 1."""
STEP_GROWTH = 0.22
"""Growth of that interval with height above the ground."""


@dataclass(frozen=True)
class CellNodes:
    """Columns of points on shells around the observer, the same at every azimuth.

    shell_radius_km (J,): distance from the observer; shell_start (J + 1,): first point of each shell in the flat lists
    altitude_km (P,), rising within a shell; x_km, z_km (P,): horizontal distance and height in the observer's frame,
    from the centre of the Earth
    """

    shell_radius_km: np.ndarray
    shell_start: np.ndarray
    altitude_km: np.ndarray
    x_km: np.ndarray
    z_km: np.ndarray


def make_nodes(
    settings: CellsSettings, observer_altitude_km: float, bottom_km: float, top_km: float, earth_radius_km: float
) -> CellNodes:
    """Points at graded altitudes on shells around the observer, whose radii grow by a constant ratio."""
    ratio = 1.0 + 0.6 / settings.node_density
    radius_observer = earth_radius_km + observer_altitude_km
    far = math.sqrt((top_km - bottom_km) * (2 * earth_radius_km + top_km + bottom_km))
    far += math.sqrt(max(observer_altitude_km - bottom_km, 0.0) * (2 * earth_radius_km + observer_altitude_km))
    largest_step_km = 80.0 / settings.node_density
    shells = [1.0]
    while shells[-1] < far:
        shells.append(min(shells[-1] * ratio, shells[-1] + largest_step_km))
    radii, start, altitudes, x, z = [], [0], [], [], []
    graded = graded_altitudes(bottom_km, top_km, settings.node_density)
    for r in shells:
        low = max(bottom_km, observer_altitude_km - r)
        high = min(top_km, observer_altitude_km + r)
        if high - low < 1e-6:
            continue
        h = graded[(graded > low) & (graded < high)]
        h = np.unique(np.concatenate([[low], h, [high]]))
        keep = np.ones(h.size, dtype=bool)
        keep[1:-1] = np.diff(h)[:-1] > 0.05
        h = h[keep]
        rho = earth_radius_km + h
        sine = ((rho - radius_observer) * (rho + radius_observer) - r * r) / (2.0 * radius_observer * r)
        sine = np.clip(sine, -1.0, 1.0)
        radii.append(r)
        altitudes.append(h)
        x.append(r * np.sqrt(1.0 - sine**2))
        z.append(radius_observer + r * sine)
        start.append(start[-1] + h.size)
    return CellNodes(np.array(radii), np.array(start), np.concatenate(altitudes), np.concatenate(x), np.concatenate(z))


def graded_altitudes(bottom_km: float, top_km: float, density: float) -> np.ndarray:
    """Altitudes [km] whose interval is (LOWEST_STEP_KM + STEP_GROWTH x height) / density."""
    out = [bottom_km]
    while out[-1] < top_km:
        out.append(out[-1] + (LOWEST_STEP_KM + STEP_GROWTH * (out[-1] - bottom_km)) / density)
    out[-1] = top_km
    return np.array(out)


@dataclass(frozen=True)
class QuadratureDirections:
    """Gauss points in each hemisphere times equal azimuths; directions look away from the point, towards the light.

    cosine (M,) of the zenith angle in the observer's frame; azimuth (F,) from 0; weight (M,) with sum over all = 4 pi
    harmonics (M * F, (degree + 1)^2): real spherical harmonics, orthonormal; degree_of (that many,)
    """

    cosine: np.ndarray
    azimuth: np.ndarray
    weight: np.ndarray
    harmonics: np.ndarray
    degree_of: np.ndarray


def gauss_directions(per_hemisphere: int, around: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosines of the zenith angle, azimuths [rad] and weights of all directions, flat; the weights sum to 4 pi."""
    x, w = np.polynomial.legendre.leggauss(per_hemisphere)
    cosine = np.repeat(np.concatenate([0.5 * (x - 1.0), 0.5 * (x + 1.0)]), around)
    azimuth = np.tile(2.0 * np.pi * np.arange(around) / around, 2 * per_hemisphere)
    return cosine, azimuth, np.repeat(np.concatenate([w, w]) * np.pi / around, around)


def make_directions(settings: CellsSettings) -> QuadratureDirections:
    x, w = np.polynomial.legendre.leggauss(settings.polar_directions)
    # Gauss in u = cosine^(1/1.5): closer to the horizon, where the light of twilight comes from
    u = 0.5 * (x + 1.0)
    w = w * u ** (POLAR_POWER - 1.0)
    w *= 1.0 / w.sum()
    cosine = np.concatenate([-(u[::-1] ** POLAR_POWER), u**POLAR_POWER])
    n_azimuth = settings.azimuth_directions
    weight = np.concatenate([w[::-1], w]) * 2.0 * np.pi / n_azimuth
    azimuth = 2.0 * np.pi * np.arange(n_azimuth) / n_azimuth
    mu, phi = np.meshgrid(cosine, azimuth, indexing="ij")
    harmonics, degree_of = real_harmonics(mu.ravel(), phi.ravel(), settings.degree)
    return QuadratureDirections(cosine, azimuth, weight, harmonics, degree_of)


def real_harmonics(cosine, azimuth, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal real spherical harmonics at directions, (D, (degree + 1)^2), and the degree of each column."""
    columns, degrees = [], []
    theta = np.arccos(np.clip(cosine, -1.0, 1.0))
    for deg in range(degree + 1):
        for order in range(-deg, deg + 1):
            y = sph_harm_y(deg, abs(order), theta, azimuth)
            if order < 0:
                columns.append(math.sqrt(2.0) * y.imag)
            elif order == 0:
                columns.append(y.real)
            else:
                columns.append(math.sqrt(2.0) * y.real)
            degrees.append(deg)
    return np.stack(columns, axis=1), np.array(degrees)
