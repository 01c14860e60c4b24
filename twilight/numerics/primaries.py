"""Linear RGB of any primaries as linear Rec. 709, without adaptation to another white: the same light."""

from __future__ import annotations

import numpy as np

from twilight.numerics.spectrum import xyz_to_rgb_matrix

SAME = 2e-3
"""Matrices that are nearer to the identity than this in every element stand for Rec. 709 itself, as files round it."""


def to_rec709(chromaticities: tuple[float, ...]) -> np.ndarray | None:
    """Matrix (3, 3) from linear RGB with x, y of red, green, blue and white (8 numbers); None: it is Rec. 709.

    ValueError where these are no primaries.
    """
    x, y = np.reshape(np.asarray(chromaticities, dtype=float), (4, 2)).T
    if not np.isfinite([x, y]).all() or y[3] <= 0.0:
        raise ValueError("no chromaticities")
    primaries = np.array([x[:3], y[:3], 1.0 - x[:3] - y[:3]])
    white = np.array([x[3], y[3], 1.0 - x[3] - y[3]]) / y[3]
    if abs(np.linalg.det(primaries)) < 1e-6:
        raise ValueError("primaries on one line")
    return from_xyz(primaries * np.linalg.solve(primaries, white))


def from_xyz(rgb_to_xyz: np.ndarray) -> np.ndarray | None:
    """The matrix (3, 3) to linear Rec. 709 for one to XYZ (CIE 1931); None: it is Rec. 709."""
    matrix = xyz_to_rgb_matrix("cie1931_2deg") @ rgb_to_xyz
    return None if np.abs(matrix - np.eye(3)).max() < SAME else np.asarray(matrix)
