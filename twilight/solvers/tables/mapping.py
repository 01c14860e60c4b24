"""Bruneton and Neyret 2008, sec. 4, "Parameterization": texels of T, E and S, and the values between them.

All radii are altitudes here: r = R + z.  With H the distance from the horizon to the top, rho the distance to the
horizon and d the one to where the ray ends (ground or top):

    2008: u_r = rho/H;  u_mu: d/rho (ground), d/(rho + H) (sky);  u_mu_s = (1 - e^(-3 mu_s - 0.6))/(1 - e^-3.6)
    2017: u_r = rho/H;  u_mu: the same with d from its least to its greatest;
          u_mu_s = (1 - a/A)/(1 + a), a = (d_s - d_min)/(H - d_min), d_s from the ground to the top along mu_s

2008 is the paper's mapping (its figure 4), 2017 that of Bruneton's later code.  Positions are in texels, 0 to n - 1;
the halves of mu that end on the ground and on the top do not mix.

Arguments that the kernels share: mapping: `Mapping`; height_km: above the ground; mu, mu_s, nu: cosines of the view's
zenith angle, of the sun's and of the angle between them; ground: whether the view ends on the ground; texel: a
position; depth (r, mu, W): -ln T at the texels; out (W,): filled.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.ray_profile import at_wavelength, passing

BRUNETON_2008, BRUNETON_2017 = range(2)
"""Kinds of mapping: of the paper, of the later code."""

MAPPINGS = {"bruneton2008": BRUNETON_2008, "bruneton2017": BRUNETON_2017}
"""Kind of each mapping, by its name in the settings."""

TRANSMITTANCE_TEXELS = 64, 256
"""Texels of T along r and mu (Bruneton 2017)."""

IRRADIANCE_TEXELS = 16, 64
"""Texels of E along r and mu_s (Bruneton 2017)."""
LEAST_LIGHT = np.float32(1e-30)
"""What a texel without light holds where logarithms are interpolated."""


class Mapping(NamedTuple):
    """Sizes of the tables, and how texels stand in them.

    kind: BRUNETON_2008 or BRUNETON_2017
    bottom_km, thickness_km: radius of the ground, and from there to the top of the air
    mu_s_min: cosine of the largest solar zenith angle
    n_r, n_mu, n_mu_s, n_nu: texels of S; n_t_r, n_t_mu: of T; n_e_r, n_e_mu_s: of E
    half_sines: texels of nu are even in the sine of half the scattering angle, instead of in nu
    """

    kind: int
    bottom_km: float
    thickness_km: float
    mu_s_min: float
    n_r: int
    n_mu: int
    n_mu_s: int
    n_nu: int
    n_t_r: int
    n_t_mu: int
    n_e_r: int
    n_e_mu_s: int
    half_sines: bool = False


@njit(cache=True, inline="always")
def horizon_km(mapping, height_km):
    """rho: distance to the horizon from a height above the ground."""
    return math.sqrt(max(0.0, height_km * (2.0 * mapping.bottom_km + height_km)))


@njit(cache=True, inline="always")
def meets_ground(mapping, height_km, mu):
    """Whether a ray ends on the ground; one along the horizon does not."""
    if mu >= 0.0:
        return False
    rho = horizon_km(mapping, height_km)
    r = mapping.bottom_km + height_km
    return r * r * mu * mu > rho * rho


@njit(cache=True, inline="always")
def distance_to_ground_km(mapping, height_km, mu):
    """d, for a ray that ends on the ground."""
    r = mapping.bottom_km + height_km
    rho = horizon_km(mapping, height_km)
    root = math.sqrt(max(0.0, r * r * mu * mu - rho * rho))
    return rho * rho / max(root - r * mu, 1e-12)


@njit(cache=True, inline="always")
def distance_to_top_km(mapping, height_km, mu):
    """d, for a ray that ends on the top."""
    r = mapping.bottom_km + height_km
    left = mapping.thickness_km - height_km
    c = left * (2.0 * r + left)
    b = r * mu
    root = math.sqrt(max(0.0, b * b + c))
    return c / (b + root) if b > 0.0 else root - b


@njit(cache=True, inline="always")
def sun_texel(mapping, mu_s):
    """Position of mu_s."""
    last = mapping.n_mu_s - 1
    if mapping.kind == BRUNETON_2008:
        u = (1.0 - math.exp(-3.0 * mu_s - 0.6)) / (1.0 - math.exp(-3.6))
    else:
        least = mapping.thickness_km
        span = horizon_km(mapping, mapping.thickness_km) - least
        a = (distance_to_top_km(mapping, 0.0, mu_s) - least) / span
        most = (distance_to_top_km(mapping, 0.0, mapping.mu_s_min) - least) / span
        u = (1.0 - a / most) / (1.0 + a)
    return last * min(1.0, max(0.0, u))


@njit(cache=True, inline="always")
def sun_cosine(mapping, texel):
    """mu_s at a position."""
    u = texel / (mapping.n_mu_s - 1)
    if mapping.kind == BRUNETON_2008:
        return min(1.0, -(math.log(1.0 - u * (1.0 - math.exp(-3.6))) + 0.6) / 3.0)
    least = mapping.thickness_km
    far = horizon_km(mapping, mapping.thickness_km)
    most = (distance_to_top_km(mapping, 0.0, mapping.mu_s_min) - least) / (far - least)
    a = most * (1.0 - u) / (1.0 + u * most)
    d = least + a * (far - least)
    return min(1.0, max(-1.0, (far * far - d * d) / (2.0 * mapping.bottom_km * d)))


@njit(cache=True, inline="always")
def angle_texel(mapping, nu):
    """Position of nu, the cosine of the scattering angle."""
    u = 0.5 * (1.0 + min(1.0, max(-1.0, nu)))
    return (mapping.n_nu - 1) * (1.0 - math.sqrt(1.0 - u) if mapping.half_sines else u)


@njit(cache=True, inline="always")
def angle_cosine(mapping, texel):
    """nu at a position."""
    u = texel / (mapping.n_nu - 1)
    return 1.0 - 2.0 * (1.0 - u) ** 2 if mapping.half_sines else 2.0 * u - 1.0


@njit(cache=True, inline="always")
def height_texel(mapping, height_km):
    """Position of r."""
    u = horizon_km(mapping, height_km) / horizon_km(mapping, mapping.thickness_km)
    return (mapping.n_r - 1) * min(1.0, max(0.0, u))


@njit(cache=True, inline="always")
def texel_height_km(mapping, texel, count):
    """Height above the ground at a position of `count` in r (S and T)."""
    rho = horizon_km(mapping, mapping.thickness_km) * texel / (count - 1)
    return min(mapping.thickness_km, rho * rho / (math.sqrt(rho * rho + mapping.bottom_km**2) + mapping.bottom_km))


@njit(cache=True, inline="always")
def view_texel(mapping, height_km, mu, ground):
    """Position of mu, on the half that `ground` says."""
    half = mapping.n_mu // 2
    rho = horizon_km(mapping, height_km)
    if ground:
        d = distance_to_ground_km(mapping, height_km, mu)
        least = 0.0 if mapping.kind == BRUNETON_2008 else height_km
        span = rho - least
        u = (d - least) / span if span > 1e-9 else 0.0
        return (half - 1) * (1.0 - min(1.0, max(0.0, u)))
    d = distance_to_top_km(mapping, height_km, mu)
    least = 0.0 if mapping.kind == BRUNETON_2008 else mapping.thickness_km - height_km
    most = rho + horizon_km(mapping, mapping.thickness_km)
    return half + (half - 1) * min(1.0, max(0.0, (d - least) / (most - least)))


@njit(cache=True, inline="always")
def view_cosine(mapping, height_km, texel):
    """(mu, whether the ray ends on the ground) at a position."""
    half = mapping.n_mu // 2
    rho = horizon_km(mapping, height_km)
    r = mapping.bottom_km + height_km
    if texel < half:
        least = 0.0 if mapping.kind == BRUNETON_2008 else height_km
        d = max(height_km, least + (rho - least) * (1.0 - texel / (half - 1)))
        mu = -(rho * rho + d * d) / (2.0 * r * d) if d > 1e-9 else -1.0
        return min(-rho / r, max(-1.0, mu)), True
    far = horizon_km(mapping, mapping.thickness_km)
    nearest = mapping.thickness_km - height_km
    least = 0.0 if mapping.kind == BRUNETON_2008 else nearest
    d = max(nearest, least + (rho + far - least) * (texel - half) / (half - 1))
    mu = (far * far - rho * rho - d * d) / (2.0 * r * d) if d > 1e-9 else 1.0
    return max(-rho / r, min(1.0, mu)), False


@njit(cache=True, inline="always")
def possible_nu(mu, mu_s, nu):
    """nu within what mu and mu_s allow."""
    across = math.sqrt(max(0.0, (1.0 - mu * mu) * (1.0 - mu_s * mu_s)))
    return min(mu * mu_s + across, max(mu * mu_s - across, nu))


@njit(cache=True, inline="always")
def transmittance_texels(mapping, height_km, mu):
    """Positions of (r, mu) in T, for rays that do not meet the ground."""
    least = mapping.thickness_km - height_km
    far = horizon_km(mapping, mapping.thickness_km)
    rho = horizon_km(mapping, height_km)
    u = (distance_to_top_km(mapping, height_km, mu) - least) / (rho + far - least)
    return (mapping.n_t_r - 1) * min(1.0, rho / far), (mapping.n_t_mu - 1) * min(1.0, max(0.0, u))


@njit(cache=True, inline="always")
def irradiance_texels(mapping, height_km, mu_s):
    """Positions of (r, mu_s) in E, linear in both."""
    u = min(1.0, max(0.0, height_km / mapping.thickness_km))
    return (mapping.n_e_r - 1) * u, (mapping.n_e_mu_s - 1) * 0.5 * (1.0 + min(1.0, max(-1.0, mu_s)))


@njit(cache=True)
def grid(mapping):
    """Heights (r,), view cosines (r, mu), solar cosines (mu_s,) and scattering cosines (nu,) of the texels of S."""
    heights = np.empty(mapping.n_r)
    view = np.empty((mapping.n_r, mapping.n_mu))
    sun = np.empty(mapping.n_mu_s)
    for i in range(mapping.n_r):
        heights[i] = texel_height_km(mapping, i, mapping.n_r)
        for k in range(mapping.n_mu):
            view[i, k] = view_cosine(mapping, heights[i], k)[0]
    for j in range(mapping.n_mu_s):
        sun[j] = sun_cosine(mapping, j)
    nus = np.empty(mapping.n_nu)
    for k in range(mapping.n_nu):
        nus[k] = angle_cosine(mapping, k)
    return heights, view, sun, nus


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
    unity = np.float32(1.0)
    out[:] = 0.0
    for corner in range(8):
        weight = np.float32(
            (f if corner & 4 else 1.0 - f) * (g if corner & 2 else 1.0 - g) * (h if corner & 1 else 1.0 - h)
        )
        if weight == np.float32(0.0):
            continue
        near = table[i + (corner >> 2), j + ((corner >> 1) & 1), k + (corner & 1)]
        low, high = weight * (unity - t), weight * t
        for w in range(out.size):
            out[w] += low * near[m, w] + high * near[m + 1, w]
    if logarithmic:
        for w in range(out.size):
            out[w] = math.exp(out[w])
