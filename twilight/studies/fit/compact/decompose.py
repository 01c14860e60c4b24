"""From splines over the sky to a Tucker decomposition, from few wavelengths to all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twilight.solvers.compact.compact_sky import TuckerTerm, spline_matrix


def decompose(tensor: np.ndarray, ranks: Sequence[int]) -> TuckerTerm:
    """Tucker's decomposition (higher-order singular value decomposition) of coefficients (K, S, W, T)."""
    factors = []
    for axis, rank in enumerate(ranks):
        unfolded = np.moveaxis(tensor, axis, 0).reshape(tensor.shape[axis], -1)
        _, vectors = np.linalg.eigh(unfolded @ unfolded.T)
        factors.append(vectors[:, ::-1][:, :rank].T)
    core = np.einsum("kswt,bk,cs,dw,ft->bcdf", tensor, *factors, optimize=True)
    return TuckerTerm(*(x.astype(np.float32) for x in (core, *factors)))


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
