"""Linear polarisation in spin-2 harmonics (E and B), and what a phase matrix does to each degree.

In every direction of view, with v the unit vector that is normal to it and points up and h the horizontal unit vector
to the right, light is the tensor I/2 (vv + hh) + Q/2 (vv - hh) + U/2 (vh + hv).  A field that is its own
mirror image about the sun's vertical is
    I = sum I_lm Y_lm cos(m a),
    Q = sum (E_lm X_lm + B_lm Z_lm) cos(m a),      U = sum (E_lm Z_lm + B_lm X_lm) sin(m a),      l >= 2,
with the azimuth a from the sun, positive to the right, and polar parts of a mean square of 1 over the sphere:
    Y_lm = N d^l_m0,   X_lm = N (d^l_m2 + d^l_m,-2)/2,   Z_lm = N (d^l_m2 - d^l_m,-2)/2,   N^2 = (2l + 1)(1 or 2),
where d^l_mn are Wigner's functions of the zenith angle (generalised spherical functions).  Scattering by
particles that lie at random keeps l and m, and does not mix what a mirror leaves (I, E) with what it turns round (B):
    I' = chi_l I + b_l E,      E' = b_l I + even_l E,      B' = odd_l B,
    b_l = 2 pi int P12 d^l_02 dmu,     even_l +- odd_l = 2 pi int (P22 +- P33) d^l_2,+-2 dmu.
Air has only b_2 = -3 Delta/(5 sqrt 6) and even_2 = 3 Delta/5: it sees the traceless tensor of the field, five numbers.
Reference: Hovenier, van der Mee & Domke 2004, Transfer of Polarized Light in Planetary Atmospheres, appendix B.
"""

from __future__ import annotations

import numpy as np

from twilight.transport.scaling import wigner_d


def spin2_harmonics(cosine: np.ndarray, degree: int, highest: int) -> tuple[np.ndarray, np.ndarray]:
    """Polar parts X and Z (P, C) at cosines (P,), sorted by m = 0..highest and within by l = max(m, 2)..degree."""
    x = np.asarray(cosine, dtype=float)
    polar_x, polar_z = [np.zeros((0, x.size))], [np.zeros((0, x.size))]
    for m in range(highest + 1):
        first = max(m, 2)
        right, left = wigner_d(degree, m, 2, x)[first:], wigner_d(degree, m, -2, x)[first:]
        # the harmonics of the intensity are taken with positive P_mm, Wigner's functions are not
        norm = 0.5 * (-1.0) ** m * np.sqrt((2.0 * np.arange(first, degree + 1) + 1.0) * (2.0 if m else 1.0))[:, None]
        polar_x.append(norm * (right + left))
        polar_z.append(norm * (right - left))
    return np.concatenate(polar_x).T, np.concatenate(polar_z).T


def spin2_degrees_and_orders(degree: int, highest: int) -> tuple[np.ndarray, np.ndarray]:
    """Degrees and orders (C,) of the spin-2 harmonics, in the sequence of `spin2_harmonics`."""
    pairs = [(n, m) for m in range(highest + 1) for n in range(max(m, 2), degree + 1)]
    return np.array([n for n, _ in pairs], dtype=int), np.array([m for _, m in pairs], dtype=int)


def scattering_geometry(
    cosine: np.ndarray, cos_azimuth: np.ndarray, sin_azimuth: np.ndarray, sun_zenith_rad: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(cosine of the scattering angle, cos 2 sigma, sin 2 sigma) of sunlight scattered towards the observer.

    cosine: of the zenith angles of the directions of view; azimuths from the sun; sigma: from the vertical plane,
        clockwise, to the plane through line of sight and sun.  Towards the sun itself there is no such plane: there
        both are 0, as P12 is.
    """
    mu = cosine
    sine = np.sqrt(np.maximum(0.0, 1.0 - mu * mu))
    up, aside = np.cos(sun_zenith_rad), np.sin(sun_zenith_rad)
    along = mu * up + sine * aside * cos_azimuth
    of_v = sine * up - mu * aside * cos_azimuth
    of_h = -aside * sin_azimuth
    square = of_v * of_v + of_h * of_h
    safe = np.where(square > 1e-30, square, 1.0)
    lit = square > 1e-30
    return along, np.where(lit, (of_v * of_v - of_h * of_h) / safe, 0.0), np.where(lit, 2.0 * of_v * of_h / safe, 0.0)
