"""Where in the spectrum light scattered more than once is solved, and how the rest follows from there.

The field, light scattered at least once, is smooth in the optical properties of the air: of its logarithm at every
place, and of its moments relative to it, a wavelength or a term of a gas's exponential sum takes a weighted mean over a
few others, the nodes.  Weights come from universal kriging (Sacks, Welch, Mitchell and Wynn 1989, Statistical Science
4, 409) over coordinates of the air's optics: logarithms of the wavelength and of scattering, growing logarithms of what
absorbs in four ranges of altitude, the ground's albedo.  They do not depend on the place, so that one small matrix
serves all of a field.  Nodes are taken one by one where the interpolation so far knows least (pivoted Cholesky
decomposition).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from twilight.atmosphere.bands import GasBands
from twilight.atmosphere.medium import Medium
from twilight.solvers.zones.ray_points import LANES

MIN_COLUMNS = 24
"""Wavelengths, or terms of exponential sums, of one spectral group beyond which light is interpolated."""
RANGES_KM = (0.0, 3.0, 10.0, 30.0)
"""Altitudes [km] above the ground at which ranges begin whose absorption is a coordinate: water vapour is in the first
two, oxygen in three, ozone in the last two."""
WEAK_DEPTH = 0.05
"""Vertical optical depth of absorption up to which its coordinate grows in proportion, beyond like its logarithm."""
SCALES = {"wavelength": 2.0, "scattering": 6.0, "absorption": 3.0, "albedo": 0.5}
"""Change of a coordinate over which the interpolated light changes in another way, by `benchmarks/hyperspectral.py`."""
CURVATURE = 1.0
"""Standard deviation of ln of the light about a plane through the coordinates, over one such change."""
PLANE_VARIANCE = 100.0
"""Variance of the plane's parameters while nodes are chosen: nearly unknown."""
NUGGET = 1e-8
"""Variance of a node's own value, which keeps weights small where two nodes are nearly the same."""
TOLERANCE = 4e-4
"""Standard deviation of ln of the light at which no more nodes are taken."""
TOLERANCE_IN_BANDS = 1e-3
"""The same for terms of bands of gases."""
MASSES = (1.0, 6.0, 30.0)
"""Relative air masses at which a term's fraction of its wavelength's light is evaluated; the largest counts."""
MIN_FRACTION = 0.02
"""Least such fraction that a term counts with."""


def coordinates(medium: Medium, bands: GasBands | None = None) -> np.ndarray:
    """Coordinates (N, F) of a medium's wavelengths, or of the terms of its bands, scaled to SCALES."""
    z = medium.altitude_km
    edges = medium.bottom_km + np.array([*RANGES_KM, np.inf])
    inside = [(z >= low) & (z <= high) for low, high in pairwise(edges)]

    def depths(per_km: np.ndarray, where: list[np.ndarray]) -> np.ndarray:
        return np.stack([np.trapezoid(np.where(w[:, None], per_km, 0.0), z, axis=0) for w in where], axis=1)

    absorption = depths(medium.absorption_per_km, inside)
    particles = medium.aerosol_extinction_per_km
    absorption += depths(particles * (1.0 - medium.aerosol_single_scattering_albedo), inside)
    of_air = depths(medium.air_scattering_per_km, [np.ones(z.size, bool)])
    scattering = of_air + depths(particles * medium.aerosol_single_scattering_albedo, [z >= z[0], z >= edges[2]])
    index = np.arange(medium.n_wavelengths) if bands is None else bands.wavelength_index
    if bands is not None:
        absorption = absorption[index] + depths(bands.absorption_per_km, inside)
    columns = [
        np.log(medium.wavelength_nm[index])[:, None] / SCALES["wavelength"],
        np.log(scattering[index] + 1e-6) / SCALES["scattering"],
        np.log1p(absorption / WEAK_DEPTH) / SCALES["absorption"],
        medium.ground_albedo[index][:, None] / SCALES["albedo"],
    ]
    return np.concatenate(columns, axis=1)


def largest_fractions(medium: Medium, bands: GasBands | None) -> np.ndarray:
    """Largest fraction (N,) of a term in its wavelength's light, at least MIN_FRACTION; 1 without terms."""
    if bands is None:
        return np.ones(medium.n_wavelengths)
    depth = np.trapezoid(bands.absorption_per_km, medium.altitude_km, axis=0)
    found = np.full(bands.weight.size, MIN_FRACTION)
    for mass in MASSES:
        light = bands.weight * np.exp(-mass * depth)
        found = np.maximum(found, light / np.bincount(bands.wavelength_index, light)[bands.wavelength_index])
    return found


def covariance(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Covariance (N, M) of ln of the light about the plane, of coordinates (N, F) and (M, F)."""
    squared = ((one[:, None] - other[None]) ** 2).sum(axis=2)
    r = np.sqrt(7.0 * squared)  # Matern's covariance of smoothness 7/2
    return CURVATURE**2 * (1.0 + r + 0.4 * r**2 + r**3 / 15.0) * np.exp(-r)


def choose_nodes(coordinates: np.ndarray, fraction: np.ndarray, tolerance: float) -> np.ndarray:
    """Indices (n,), ascending, of the nodes among columns (N, F): a multiple of LANES of them where there are so many.

    fraction (N,): of each column in the light of its wavelength, from 0 to 1
    """
    count = coordinates.shape[0]
    plane = np.concatenate([np.ones((count, 1)), coordinates - coordinates.mean(axis=0)], axis=1)
    left = CURVATURE**2 + PLANE_VARIANCE * (plane**2).sum(axis=1)
    factors = np.zeros((count, 0))
    chosen: list[int] = []
    while len(chosen) < count:
        deviation = fraction * np.sqrt(np.maximum(left, 0.0))
        deviation[chosen] = 0.0
        worst = int(np.argmax(deviation))
        if deviation[worst] < tolerance and len(chosen) % LANES == 0:
            break
        column = covariance(coordinates, coordinates[worst : worst + 1])[:, 0] + PLANE_VARIANCE * plane @ plane[worst]
        column = (column - factors @ factors[worst]) / np.sqrt(max(left[worst], NUGGET))
        factors = np.concatenate([factors, column[:, None]], axis=1)
        left = left - column**2
        chosen.append(worst)
    return np.sort(np.array(chosen))


def kriging_weights(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Weights (n, N), of sum 1, of the nodes (n, F) in columns with coordinates (N, F).

    The interpolated light is exact at the nodes, and everywhere where it is a plane over the coordinates.
    """
    centre = nodes.mean(axis=0)
    spread = np.ptp(nodes, axis=0) > 1e-9
    plane = np.concatenate([np.ones((nodes.shape[0], 1)), (nodes - centre)[:, spread]], axis=1)
    plane_at = np.concatenate([np.ones((at.shape[0], 1)), (at - centre)[:, spread]], axis=1)
    n, p = plane.shape
    matrix = np.zeros((n + p, n + p))
    matrix[:n, :n] = covariance(nodes, nodes) + NUGGET * np.eye(n)
    matrix[:n, n:], matrix[n:, :n] = plane, plane.T
    right = np.concatenate([covariance(nodes, at), plane_at.T])
    return np.linalg.lstsq(matrix, right, rcond=1e-13)[0][:n]
