"""Light that a wind-roughened water surface reflects: Fresnel's amplitudes on facets with the slopes of Cox and Munk.

Slopes of the facets are Gaussian and the same in all directions, of the mean square slope s2 = 0.003 + 0.00512 W of a
clean sea under the wind W [m/s] at 12.5 m (Cox & Munk 1954, J. Opt. Soc. Am. 44, 838: measured from 1 to 14 m/s).  A
facet mirrors light from the zenith angle of cosine mu_in to that of mu_out; beta is its tilt, i its angle of incidence:
    reflected radiance / irradiance normal to a beam = R(i) p S / (4 mu_out cos^4 beta),
    p = exp(-tan^2 beta / s2) / (pi s2),      cos beta = (mu_in + mu_out) / (2 cos i),
with S the fraction of facets that other facets do not hide from either side (Smith 1967, IEEE Trans. Antennas Propag.
15, 668).  Light that leaves one facet for another is lost, a few per cent at grazing angles.  R becomes the matrix
    P11 = P22 = (rp^2 + rs^2)/2,   P12 = (rp^2 - rs^2)/2,   P33 = rp rs
on (I, Q, U) that refer to the plane of incidence, in the signs of :mod:`twilight.numerics.phase`.
"""

from __future__ import annotations

import math

import numpy as np

from twilight.base.errors import TwilightError
from twilight.jit.kernels import njit

WIND_RANGE_M_S = (1.0, 14.0)
"""Wind for which Cox and Munk measured [m/s]; a flatter surface would mirror the sun as a beam."""

SALINITY = 35.0
"""Salt of the sea [g kg^-1]."""

WATER_C = 15.0
"""Temperature of the sea [deg C]."""


def refractive_index(wavelength_nm) -> np.ndarray:
    """Of sea water over that of air at wavelengths [nm], which keep their shape: Quan & Fry 1995, Appl. Opt. 34, 3477.

    Fitted from 400 to 700 nm and within 0.001 from 300 to 900 nm.
    """
    w = np.asarray(wavelength_nm, dtype=float)
    s, t = SALINITY, WATER_C
    steady = 1.31405 + (1.779e-4 - 1.05e-6 * t + 1.6e-8 * t * t) * s - 2.02e-6 * t * t
    return steady + (15.868 + 0.01155 * s - 0.00423 * t) / w - 4382.0 / w**2 + 1.1455e6 / w**3


def mean_square_slope(wind_speed_m_s: float) -> float:
    """Mean square slope, of both directions together, of a clean sea under a wind.

    Errors: TwilightError for a wind outside WIND_RANGE_M_S.
    """
    low, high = WIND_RANGE_M_S
    if not low <= wind_speed_m_s <= high:
        raise TwilightError(f"wind over water of {wind_speed_m_s:g} m/s: allowed is {low:g} to {high:g}")
    return 0.003 + 0.00512 * wind_speed_m_s


@njit(cache=True, inline="always")
def fresnel(cos_incidence, index):
    """Amplitudes (rp, rs) reflected by a flat surface; both -1 at grazing angles.

    cos_incidence: cosine of the angle of incidence; index: the refractive one, real, above 1.
    """
    c = min(1.0, max(0.0, cos_incidence))
    inside = math.sqrt(index * index - 1.0 + c * c)
    return (index * index * c - inside) / (index * index * c + inside), (c - inside) / (c + inside)


@njit(cache=True, inline="always")
def flat_reflectance(cos_incidence, index):
    """Fraction of unpolarised light that a flat surface reflects; cos_incidence, index: as in `fresnel`."""
    rp, rs = fresnel(cos_incidence, index)
    return 0.5 * (rp * rp + rs * rs)


@njit(cache=True, inline="always")
def smith_lambda(cosine, slope2):
    """Smith's Lambda: facets hidden from a zenith angle over those seen.

    cosine: of the zenith angle; slope2: mean square slope.
    """
    sine2 = 1.0 - cosine * cosine
    if sine2 < 1e-12 or cosine <= 0.0:
        return 0.0 if cosine > 0.0 else 1e9
    v = cosine / math.sqrt(slope2 * sine2)
    if v > 5.0:
        return 0.0
    return 0.5 * (math.exp(-v * v) / (math.sqrt(math.pi) * v) - math.erfc(v))


@njit(cache=True, inline="always")
def glitter(mu_in, mu_out, cos_scatter, index, slope2):
    """(P11, P12, P33) [sr^-1]: radiance (I, Q, U) reflected over the irradiance normal to an incoming beam.

    mu_in, mu_out: cosines of the zenith angles of where light comes from and goes to; cos_scatter: cosine of the angle
    by which it turns, -1 for light sent straight back; index: of the water; slope2: mean square slope.
    """
    if mu_in <= 0.0 or mu_out <= 0.0:
        return 0.0, 0.0, 0.0
    cos_i = math.sqrt(max(0.0, 0.5 * (1.0 - cos_scatter)))
    tilt = min(1.0, (mu_in + mu_out) / max(2.0 * cos_i, 1e-12))
    square = tilt * tilt
    exponent = (1.0 - square) / (square * slope2)
    if exponent > 50.0:
        return 0.0, 0.0, 0.0
    seen = 1.0 / (1.0 + smith_lambda(mu_in, slope2) + smith_lambda(mu_out, slope2))
    factor = math.exp(-exponent) / (math.pi * slope2) * seen / (4.0 * mu_out * square * square)
    rp, rs = fresnel(cos_i, index)
    return 0.5 * factor * (rp * rp + rs * rs), 0.5 * factor * (rp * rp - rs * rs), factor * rp * rs


@njit(cache=True, inline="always")
def facet_density(mu_in, mu_out, cos_scatter, slope2):
    """Density [sr^-1] of mirrored directions where facets are drawn by their slopes alone.

    mu_in, mu_out, cos_scatter, slope2: as in `glitter`.
    """
    cos_i = math.sqrt(max(0.0, 0.5 * (1.0 - cos_scatter)))
    tilt = (mu_in + mu_out) / max(2.0 * cos_i, 1e-12)
    if tilt <= 1e-3 or cos_i < 1e-9:
        return 0.0
    square = min(1.0, tilt * tilt)
    return math.exp(-(1.0 - square) / (square * slope2)) / (math.pi * slope2) / (4.0 * cos_i * square * tilt)
