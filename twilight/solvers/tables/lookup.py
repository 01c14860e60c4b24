"""Interpolation in the tables of `passes`.

Arguments that the kernels share: mapping: `Mapping`; height_km: above the ground; mu, mu_s, nu: cosines of the view's
zenith angle, of the sun's and of the angle between them; ground: whether the view ends on the ground; depth (r, mu, W):
-ln T at the texels; out (W,): filled.
"""

from __future__ import annotations

import math

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.tables.mapping import (
    angle_texel,
    height_texel,
    irradiance_texels,
    meets_ground,
    sun_texel,
    transmittance_texels,
    view_texel,
)
from twilight.transport.ray_profile import at_wavelength, passing

DARK = np.float32(1e-30)
"""What a texel without light holds where logarithms are interpolated."""


@njit(cache=True, inline="always")
def _split(position, count):
    """(node below, fraction of the way to the next) of a position, 0 to count - 1; position: in texels; count: of the
    texels.
    """
    i = min(int(position), count - 2)
    return i, position - i


@njit(cache=True, inline="always")
def _bilinear(table, x, y, out):
    """The values (W,) of a table (X, Y, W) at a position, into out; x, y: in texels."""
    i, f = _split(x, table.shape[0])
    j, g = _split(y, table.shape[1])
    a, b, c, d = (1.0 - f) * (1.0 - g), (1.0 - f) * g, f * (1.0 - g), f * g
    for w in range(out.size):
        out[w] = a * table[i, j, w] + b * table[i, j + 1, w] + c * table[i + 1, j, w] + d * table[i + 1, j + 1, w]


@njit(cache=True)
def optical_depth_to_top(mapping, depth, height_km, mu, out):
    """Optical depth (W,) to the top of a ray that does not meet the ground, into out; bilinear.

    depth (r, mu, W): -ln T at the texels; the logarithm is what stays finite in dense air.
    """
    x, y = transmittance_texels(mapping, height_km, mu)
    _bilinear(depth, x, y, out)


@njit(cache=True)
def sunlight(mapping, depth, screen, height_km, mu_s, out):
    """Transmittance (W,) to the sun; 0 in the shadow of the Earth.  Returns whether the sun is up.

    screen: of `transport.ray_profile.screen_table`, for straight rays.
    """
    if meets_ground(mapping, height_km, mu_s):
        out[:] = 0.0
        return False
    optical_depth_to_top(mapping, depth, height_km, mu_s, out)
    for w in range(out.size):
        out[w] = math.exp(-out[w])
    if screen.size > 0:
        r = mapping.bottom_km + height_km
        passed = passing(screen, 0, r * math.sqrt(max(0.0, (1.0 - mu_s) * (1.0 + mu_s))), r * mu_s)
        for w in range(out.size):
            out[w] *= at_wavelength(screen, 0, w, passed)
    return True


@njit(cache=True)
def irradiance(mapping, table, height_km, mu_s, out):
    """E (W,) of the sky alone, bilinear; table (r, mu_s, W)."""
    x, y = irradiance_texels(mapping, height_km, mu_s)
    _bilinear(table, x, y, out)


@njit(cache=True, fastmath={"contract", "nsz"})
def scattering(mapping, table, logarithmic, height_km, mu, mu_s, nu, ground, out):
    """S (W,) of one table (r, mu_s, nu, mu, W), from 16 texels; logarithmic: whether they hold logarithms.

    table: float32.
    """
    i, f = _split(height_texel(mapping, height_km), mapping.n_r)
    j, g = _split(sun_texel(mapping, mu_s), mapping.n_mu_s)
    k, h = _split(angle_texel(mapping, nu), mapping.n_nu)
    half = mapping.n_mu // 2
    position = view_texel(mapping, height_km, mu, ground)
    first = 0 if ground else half
    m = min(first + int(position - first), first + half - 2)
    t = np.float32(position - m)
    one = np.float32(1.0)
    out[:] = 0.0
    for corner in range(8):
        weight = np.float32(
            (f if corner & 4 else 1.0 - f) * (g if corner & 2 else 1.0 - g) * (h if corner & 1 else 1.0 - h)
        )
        if weight == np.float32(0.0):
            continue
        near = table[i + (corner >> 2), j + ((corner >> 1) & 1), k + (corner & 1)]
        low, high = weight * (one - t), weight * t
        for w in range(out.size):
            out[w] += low * near[m, w] + high * near[m + 1, w]
    if logarithmic:
        for w in range(out.size):
            out[w] = math.exp(out[w])
