"""From skies to splines over the sky, from splines to a Tucker decomposition, from few wavelengths to all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twilight.compact import Grid, Term, spline_matrix

SMOOTH = 1e-3
"""Weight of the curvature of the splines' coefficients: it decides only where data do not."""
TIE = 1e-5
"""Weight of the coefficients themselves, which decides what the splines over the sky and around the sun share."""


def spline_coefficients(
    grid: Grid, sun_elevation_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, logarithm: np.ndarray
) -> np.ndarray:
    """Coefficients (K, N) of the splines over the sky that come nearest to logarithms (D, N) in directions (D,)."""
    index, value = grid.splines(sun_elevation_deg, elevation_deg, azimuth_deg)
    n = elevation_deg.size
    design = np.zeros((n, grid.size))
    np.add.at(design, (np.arange(n), index), value)
    return np.linalg.solve(design.T @ design / n + _penalty(grid), design.T @ logarithm / n)


def _penalty(grid: Grid) -> np.ndarray:
    """Quadratic form (K, K) of curvature and size of the coefficients."""
    rows, columns, rings = grid.elevation_intervals + 3, grid.azimuth_intervals + 1, grid.angle_intervals + 3
    curved = [_second_differences(n) for n in (rows, columns, rings)]
    split = rows * columns
    out = np.zeros((grid.size, grid.size))
    out[:split, :split] = np.kron(curved[0], np.eye(columns)) + np.kron(np.eye(rows), curved[1])
    out[:split, :split] *= SMOOTH / split
    out[split:, split:] = SMOOTH / rings * curved[2]
    return out + TIE / grid.size * np.eye(grid.size)


def _second_differences(n: int) -> np.ndarray:
    d = np.diff(np.eye(n), 2, axis=0)
    return d.T @ d


def decompose(tensor: np.ndarray, ranks: Sequence[int]) -> Term:
    """Tucker's decomposition (higher-order singular value decomposition) of coefficients (K, S, W, T)."""
    factors = []
    for axis, rank in enumerate(ranks):
        unfolded = np.moveaxis(tensor, axis, 0).reshape(tensor.shape[axis], -1)
        _, vectors = np.linalg.eigh(unfolded @ unfolded.T)
        factors.append(vectors[:, ::-1][:, :rank].T)
    core = np.einsum("kswt,bk,cs,dw,ft->bcdf", tensor, *factors, optimize=True)
    return Term(*(x.astype(np.float32) for x in (core, *factors)))


def refine_wavelengths(
    wavelength_nm: np.ndarray, values: np.ndarray, fine_nm: np.ndarray, absorption: np.ndarray
) -> np.ndarray:
    """Values (R, W) at a few wavelengths, at many (R, F): multiples of the absorption spectra (G, F) plus a spline.

    The values are met at the few wavelengths; the multiples are those that leave the smoothest spline.
    """
    spline = spline_matrix(np.log(wavelength_nm), np.log(fine_nm))
    at = np.stack([np.interp(wavelength_nm, fine_nm, spectrum) for spectrum in absorption])
    curvature = np.diff(spline, 2, axis=0)
    multiples = np.linalg.lstsq(curvature @ at.T, curvature @ values.T, rcond=None)[0]
    return (spline @ (values.T - at.T @ multiples) + absorption.T @ multiples).T


def absorption_spectra(medium, count: int = 2) -> np.ndarray:
    """The spectra (count, W) that make up most of the gases' absorption in the layers of a medium (all if fewer)."""
    layer = medium.absorption_per_km * np.gradient(medium.altitude_km)[:, None]
    _, strength, spectra = np.linalg.svd(layer, full_matrices=False)
    return spectra[: int(np.sum(strength[:count] > 1e-6))]
