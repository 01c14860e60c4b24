"""Correlated colour temperature and Duv: the nearest point of Planck's locus in (u, v) of CIE 1960.

Ohno 2014 (Leukos 10, 47): the foot of the perpendicular on the locus, here on a table that is fine enough for its arcs
to be straight.  Wavelengths from 360 to 830 nm, second radiation constant 1.4388e-2 m K (CIE 015:2018).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from twilight.numerics import spectrum

RANGE_K = (1000.0, 1e5)
"""Temperatures of the table; light that is nearer to one of its ends than to any other point has none.  From 1e5 K to
infinity the locus goes on by 0.0024 in u, v, about what an eye can tell: 925,000 K says no more than that it is bluer
than any."""
STEP = 0.002
"""Relative step of the temperature in the table: found within 0.01 %."""
MAX_DUV = 0.05
"""Distance from the locus beyond which a colour temperature means nothing (CIE 015:2018)."""


def uv_1960(xyz: np.ndarray) -> np.ndarray:
    """(u, v) of CIE 1960 (..., 2) of XYZ (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(xyz, float), -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        total = x + 15.0 * y + 3.0 * z
        return np.stack([4.0 * x / total, 6.0 * y / total], axis=-1)


@lru_cache(maxsize=1)
def _locus() -> tuple[np.ndarray, np.ndarray]:
    """log of the temperature [K] (T,) and (u, v) (T, 2) of black bodies."""
    log_t = np.arange(np.log(RANGE_K[0]), np.log(RANGE_K[1]), STEP)
    nm = spectrum.VISIBLE_NM
    x = 1.4388e7 / nm[None, :] / np.exp(log_t)[:, None]
    body = (560.0 / nm) ** 5 / np.expm1(x)
    return log_t, uv_1960(body @ spectrum.colour_matching_functions("cie1931_2deg"))


def correlated_colour_temperature(xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Correlated colour temperature [K] and Duv of XYZ (..., 3), (...) each; Duv > 0 above the locus (greenish).

    NaN where there is no light, where Duv is beyond 0.05, and outside 1000 to 1e5 K; Duv itself is then kept.
    """
    from scipy.spatial import cKDTree  # start-up

    log_t, locus = _locus()
    uv = uv_1960(xyz).reshape(-1, 2)
    lit = np.isfinite(uv).all(axis=1)
    _, nearest = cKDTree(locus).query(np.where(lit[:, None], uv, 0.0))
    k = np.clip(nearest, 1, log_t.size - 2)
    best, temperature, duv = np.full(k.shape, np.inf), np.zeros(k.shape), np.zeros(k.shape)
    for first in (k - 1, k):
        a, b = locus[first], locus[first + 1]
        chord = b - a
        along = np.clip(((uv - a) * chord).sum(axis=1) / (chord**2).sum(axis=1), 0.0, 1.0)
        foot = a + along[:, None] * chord
        distance = np.hypot(*(uv - foot).T)
        # the locus runs from red to blue, towards smaller u: above it is to its right
        side = np.sign(chord[:, 1] * (uv - a)[:, 0] - chord[:, 0] * (uv - a)[:, 1])
        better = distance < best
        best = np.where(better, distance, best)
        temperature = np.where(better, np.exp(log_t[first] + along * STEP), temperature)
        duv = np.where(better, side * distance, duv)
    known = lit & (best <= MAX_DUV) & (nearest > 0) & (nearest < log_t.size - 1)
    shape = np.shape(xyz)[:-1]
    return np.where(known, temperature, np.nan).reshape(shape), np.where(lit, duv, np.nan).reshape(shape)
