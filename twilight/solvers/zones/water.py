"""A water surface under the field: what it makes of the sky's light and of sunlight
(:mod:`twilight.atmosphere.water_surface`).

The surface looks the same from all sides, so that it keeps the order m of cos(m azimuth) in I and Q and of sin(m
azimuth) in U: each order has a matrix of its own from the polar angles above the ground to those that one looks down
in.  It is summed over slopes of facets, with light interpolated by cubics between polar angles.
Sunlight is mirrored with exact angles wherever a ray ends on the water.

Arguments that the kernels share: rays: `NodeRays`, ray: index of one of them; transmittance (LANES,): of a ray to its
end; index (W,): refractive index; slope2: mean square slope; c: cosine of the azimuth from the sun; surface:
`WaterSurface`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.atmosphere.water_surface import fresnel, glitter, refractive_index, smith_lambda
from twilight.jit.kernels import njit
from twilight.solvers.zones.grid import HORIZON_WIDTH
from twilight.solvers.zones.ray_points import COS_AZIMUTH, PLACE, ZENITH
from twilight.solvers.zones.sunlight import N_ANGLE
from twilight.transport.beam import beam_at

N_COSINES = 48
"""Number of cosines of the zenith angle at which the reflected sky is tabulated; it is linear between them."""
COSINE_WIDTH = 0.3
"""Cosine below which the cosines of that table lie closer together."""
N_SLOPES = 64
"""Number of slopes in the quadrature over facets of the water."""
N_FACET_AZIMUTHS = 72
"""Number of azimuths over half a turn in the quadrature over facets; the other half is the mirror image."""
MIN_RADIANCE = 1e-30
"""Least mean radiance over azimuths [sr^-1] whose logarithm is taken."""
MIN_AZIMUTH_RATIO = 1e-3
"""Least radiance at an azimuth over the mean of all azimuths whose logarithm is taken."""
N_CELL = 5
"""Number of points, in zenith angle and in azimuth, at which mirrored sunlight is taken in the cell of a direction."""


class WaterSurface(NamedTuple):
    """refractive_index (W,) and mean square slope slope2 of water, see :mod:`twilight.atmosphere.water_surface`;
    slope2 is 0 for land."""

    refractive_index: np.ndarray
    slope2: float


def cosines() -> np.ndarray:
    """Cosines (N_COSINES,) of the table, increasing from about 0 to 1."""
    return np.sinh(np.linspace(0.0, np.arcsinh(1.0 / COSINE_WIDTH), N_COSINES)) * COSINE_WIDTH * (1.0 - 1e-3) + 1e-3


def reflection(
    cosine: np.ndarray, azimuthal_orders: int, n_stokes: int, index: np.ndarray, slope2: float
) -> np.ndarray:
    """(W, orders, N_COSINES, S, P, S): amplitudes reflected of those that fall in.

    cosine (P,): of the zenith angles that light falls in from, increasing from above 0
    index (W,): refractive index of the water; orders from 0; S = n_stokes, 1 or 3
    """
    t, part = np.polynomial.laguerre.laggauss(N_SLOPES)
    turn = np.pi * (np.arange(N_FACET_AZIMUTHS) + 0.5) / N_FACET_AZIMUTHS
    slope = np.sqrt(slope2 * np.repeat(t, N_FACET_AZIMUTHS))
    weight = np.repeat(part, N_FACET_AZIMUTHS) / N_FACET_AZIMUTHS
    up = 1.0 / np.sqrt(1.0 + slope**2)
    normal = np.stack([slope * np.cos(np.tile(turn, N_SLOPES)) * up, slope * np.sin(np.tile(turn, N_SLOPES)) * up, up])
    out = np.zeros((index.size, azimuthal_orders, N_COSINES, n_stokes, cosine.size, n_stokes))
    m = np.arange(azimuthal_orders)[:, None]
    for k, mu in enumerate(cosines()):
        sine = math.sqrt(max(0.0, 1.0 - mu * mu))
        view = np.array([sine, 0.0, -mu])
        cos_i = -view @ normal
        source = view[:, None] + 2.0 * cos_i * normal
        seen = (cos_i > 1e-9) & (source[2] > 0.0)
        if not seen.any():
            continue
        mu_in, cos_in = np.where(seen, source[2], 1.0), np.where(seen, cos_i, 1.0)
        visible = 1.0 / (1.0 + smith_lambda(mu, slope2) + _smith_lambda(mu_in, slope2))
        factor = np.where(seen, weight * visible * cos_in / (mu * up), 0.0)
        azimuth = np.arctan2(source[1], source[0])
        fraction = _between(cosine, mu_in)
        cos_m, sin_m = np.cos(m * azimuth), np.sin(m * azimuth)
        c2, s2, c20, s20 = _rotations(view, source)
        for w, n in enumerate(index):
            rp, rs = _fresnel(cos_in, n)
            p11, p12, p33 = 0.5 * (rp**2 + rs**2), 0.5 * (rp**2 - rs**2), rp * rs
            # into the plane of incidence, by Fresnel's matrix, and into the vertical plane of the view
            rows = _mueller_rows(p11, p12, p33, c2, s2, c20, s20)
            for a in range(n_stokes):
                for b in range(n_stokes):
                    odd = (a == 2) != (b == 2)
                    # I and Q go with the cosine, U with the sine
                    amplitude = cos_m if not odd else (sin_m if b == 2 else -sin_m)
                    out[w, :, k, a, :, b] = (factor * rows[a][b] * amplitude) @ fraction
    return out


@njit(cache=True)
def _smith_lambda(cosine, slope2):
    """`twilight.atmosphere.water_surface.smith_lambda` for cosines of zenith angles, cosine (N,)."""
    out = np.empty(cosine.size)
    for k in range(cosine.size):
        out[k] = smith_lambda(cosine[k], slope2)
    return out


@njit(cache=True)
def _fresnel(cosine, index):
    """`twilight.atmosphere.water_surface.fresnel` for cosines of the angle of incidence, cosine (N,), and one index:
    (2, N)."""
    out = np.empty((2, cosine.size))
    for k in range(cosine.size):
        out[0, k], out[1, k] = fresnel(cosine[k], index)
    return out


def _between(cosine: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Weights (N, P) of the light at cosines (P,), increasing, in that at the wanted ones (N,): cubics through the four
    around each in arcsinh(cosine / HORIZON_WIDTH), in which the sky is smooth; below the lowest it is constant."""
    x, at = np.arcsinh(cosine / HORIZON_WIDTH), np.arcsinh(np.maximum(wanted, cosine[0]) / HORIZON_WIDTH)
    width = min(4, x.size)
    first = np.clip(np.searchsorted(x, at, side="right") - 2, 0, x.size - width)
    out = np.zeros((at.size, x.size))
    row = np.arange(at.size)
    for j in range(width):
        factor = np.ones(at.size)
        for k in range(width):
            if k != j:
                factor *= (at - x[first + k]) / (x[first + j] - x[first + k])
        out[row, first + j] = factor
    return out


def _mueller_rows(p11, p12, p33, c2, s2, c20, s20):
    """Rows of the Mueller matrix from (I, Q, U) of the source's vertical plane to those of the view's."""
    q = [p12, p11 * c2, p11 * s2]
    u = [np.zeros_like(p11), -p33 * s2, p33 * c2]
    return [
        [p11, p12 * c2, p12 * s2],
        [c20 * x - s20 * y for x, y in zip(q, u, strict=True)],
        [s20 * x + c20 * y for x, y in zip(q, u, strict=True)],
    ]


def _rotations(view: np.ndarray, source: np.ndarray):
    """Cosine and sine of twice the angle from the vertical to the plane of both directions, at the source (N,), then at
    the view; view (3,) at azimuth 0, source (3, N)."""
    across = np.maximum(np.hypot(source[0], source[1]), 1e-12)
    right = np.stack([-source[1] / across, source[0] / across, 0.0 * across])
    upward = np.stack([-source[2] * source[0] / across, -source[2] * source[1] / across, across])
    level = math.hypot(view[0], view[1])
    if level < 1e-12:
        right0, upward0 = np.array([0.0, 1.0, 0.0]), np.array([-view[2], 0.0, 0.0])
    else:
        right0 = np.array([-view[1] / level, view[0] / level, 0.0])
        upward0 = np.array([-view[2] * view[0] / level, -view[2] * view[1] / level, level])
    out = []
    for a, b in ((view @ upward, view @ right), (upward0 @ source, right0 @ source)):
        square = np.maximum(a * a + b * b, 1e-300)
        out += [(a * a - b * b) / square, 2.0 * a * b / square]
    return out


def reflected_sky(table: np.ndarray, radiance: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Amplitudes (N_COSINES, S, orders, T, LANES) of the reflected light.

    table: of `reflection`, a matrix for every wavelength of the block; radiance (P, T, F, S', LANES) at its cosines and
        azimuths (F,), S' being S or 1.  Orders may be more than F: see `_more_azimuths`.
    """
    known, azimuthal_orders = radiance.shape[3], table.shape[1]
    fine, light = _more_azimuths(radiance, azimuth, 2 * azimuthal_orders)
    m = np.arange(azimuthal_orders)[:, None]
    norm = np.where(m == 0, 1.0, 2.0) / fine.size
    cos_m, sin_m = norm * np.cos(m * fine), norm * np.sin(m * fine)
    parts = [np.einsum("mf,ptfw->mptw", sin_m if s == 2 else cos_m, light[..., s, :]) for s in range(known)]
    return np.einsum("wmkapb,bmptw->kamtw", table[..., :known], np.stack(parts), optimize=True)


def _more_azimuths(radiance: np.ndarray, azimuth: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """n azimuths [rad] and the light (P, T, n, S, LANES) at them, from that at the middles (F,) of equal parts.

    Through the logarithm of I, and Q and U over I, goes a trigonometric polynomial: the sky beside a low sun is sharper
    than one of F orders, its logarithm is not.
    """
    fine = (np.arange(n) + 0.5) * np.pi / n
    m = np.arange(azimuth.size)[:, None]
    even = np.cos(m * fine).T @ (np.where(m == 0, 1.0, 2.0) / azimuth.size * np.cos(m * azimuth))
    odd = np.sin((m + 1) * fine).T @ (
        np.where(m + 1 == azimuth.size, 1.0, 2.0) / azimuth.size * np.sin((m + 1) * azimuth)
    )
    intensity = radiance[..., 0, :].astype(float)
    mean = np.maximum(intensity.mean(axis=2, keepdims=True), MIN_RADIANCE)
    intensity = np.maximum(intensity, MIN_AZIMUTH_RATIO * mean)
    found = np.exp(np.einsum("nf,ptfw->ptnw", even, np.log(intensity)))
    relative = [
        np.einsum("nf,ptfw->ptnw", odd if s == 2 else even, radiance[..., s, :] / intensity)
        for s in range(1, radiance.shape[3])
    ]
    return fine, np.stack([found, *(found * ratio for ratio in relative)], axis=3)


def surface_of(medium: Medium, wavelengths: np.ndarray) -> WaterSurface:
    """Of a medium, at some of its wavelengths, indices (N,)."""
    return WaterSurface(refractive_index(medium.wavelength_nm)[wavelengths], float(medium.water_mean_square_slope))


def place_of_cosine(cosine: np.ndarray) -> np.ndarray:
    """Fractional indices (R,) of cosines among those of the table."""
    return np.interp(cosine, cosines(), np.arange(N_COSINES))


@njit(inner=True, cache=True, inline=True)
def add_amplitudes(log_ground, amplitudes, j, b1, place, c, transmittance, out):
    """Add the reflected sky to out (S, LANES); amplitudes (T', N_COSINES, S', orders, LANES) of S' >= S parameters.

    log_ground (T', LANES): as in `RadianceField`; (j, b1): place among the zenith angles of the sun; place: among the
        cosines;
    c: cosine of the azimuth from the sun.
    """
    k = min(int(place), amplitudes.shape[1] - 2)
    h1 = place - k
    h0 = 1.0 - h1
    b0 = 1.0 - b1
    c1 = min(1.0, max(-1.0, c))
    s1 = math.sqrt(1.0 - c1 * c1)
    for w in range(out.shape[1]):
        scale = transmittance[w] * math.exp(b0 * log_ground[j, w] + b1 * log_ground[j + 1, w])
        for s in range(out.shape[0]):
            total = 0.0
            cosine, sine = 1.0, 0.0
            for m in range(amplitudes.shape[3]):
                near = h0 * amplitudes[j, k, s, m, w] + h1 * amplitudes[j, k + 1, s, m, w]
                far = h0 * amplitudes[j + 1, k, s, m, w] + h1 * amplitudes[j + 1, k + 1, s, m, w]
                total += (b0 * near + b1 * far) * (sine if s == 2 else cosine)
                cosine, sine = cosine * c1 - sine * s1, sine * c1 + cosine * s1
            out[s, w] += scale * (max(0.0, total) if s == 0 else total)


@njit(cache=True, nogil=True)
def reflect(rays, light, cosine_place, out, begin, end):
    """Add the sky that water reflects at the ends of rays to out[node, polar, zenith, azimuth, I Q U, LANES].

    light: `RadianceField`; cosine_place (R,): of `place_of_cosine`; for node altitudes begin..end.
    """
    n_polar = out.shape[1]
    for node in range(begin, end):
        for i in range(n_polar):
            ray = node * n_polar + i
            if rays.ground_weight[ray].max() > 0.0:
                add_reflected(rays, ray, light.log_ground, light.amplitudes, cosine_place[ray], out[node, i])


@njit(cache=True, nogil=True)
def mirror_sunlight(rays, beams, ground_cells, surface, out, begin, end):
    """Add the sunlight that water mirrors at the ends of rays to out[node, polar, zenith, azimuth, I Q U, LANES].

    beams: `BeamAtPoints`; ground_cells (R, 3): of `cells`; for node altitudes begin..end.
    """
    n_polar = out.shape[1]
    for node in range(begin, end):
        for i in range(n_polar):
            ray = node * n_polar + i
            if rays.ground_weight[ray].max() > 0.0:
                add_sunlit_water(rays, ray, beams, surface, ground_cells[ray], out[node, i])


@njit(inner=True, cache=True, nogil=True)
def add_reflected(rays, ray, log_ground, amplitudes, cosine_place, sums):
    """The sky that water reflects at the end of a ray, added to sums (T, F, S, LANES).

    log_ground (T', LANES), amplitudes (T', N_COSINES, S', orders, LANES): as in `RadianceField`; cosine_place: of
    `place_of_cosine`.
    """
    geometry, place, transmittance = rays.geometry, rays.ground_place[ray], rays.ground_weight[ray]
    step = min(int(place), geometry.shape[0] - 2)
    h1 = place - step
    for t in range(sums.shape[0]):
        for a in range(sums.shape[1]):
            x = (1.0 - h1) * geometry[step, t, a, PLACE] + h1 * geometry[step + 1, t, a, PLACE]
            c = (1.0 - h1) * geometry[step, t, a, COS_AZIMUTH] + h1 * geometry[step + 1, t, a, COS_AZIMUTH]
            j = min(int(x), log_ground.shape[0] - 2)
            add_amplitudes(log_ground, amplitudes, j, x - j, cosine_place, c, transmittance, sums[t, a])


@njit(inner=True, cache=True, inline=True)
def add_mirrored(mu_in, mu_out, c, index, slope2, light, transmittance, out):
    """Sunlight that water mirrors, added to out (S, W): light (W,) is the irradiance normal to the beam.

    mu_in, mu_out: cosines of the zenith angles of where light comes from and goes to.
    """
    sine_in = math.sqrt(max(0.0, 1.0 - mu_in * mu_in))
    sine_out = math.sqrt(max(0.0, 1.0 - mu_out * mu_out))
    cosine = sine_in * sine_out * c - mu_in * mu_out
    # from the vertical to the scattering plane, as `scattering_geometry` for a direction that looks down
    of_v = sine_out * mu_in + mu_out * sine_in * c
    of_h = -sine_in * math.sqrt(max(0.0, 1.0 - c * c))
    square = max(of_v * of_v + of_h * of_h, 1e-30)
    for w in range(out.shape[1]):
        p11, p12, _ = glitter(mu_in, mu_out, cosine, index[w], slope2)
        strength = transmittance[w] * light[w]
        out[0, w] += strength * p11
        if out.shape[0] > 1:
            out[1, w] += strength * p12 * (of_v * of_v - of_h * of_h) / square
            out[2, w] += strength * p12 * 2.0 * of_v * of_h / square


@njit(inner=True, cache=True, nogil=True)
def add_sunlit_water(rays, ray, beams, surface, cell, sums):
    """Sunlight that water mirrors at the end of a ray, added to sums (T, F, S, LANES); beams: `BeamAtPoints`.

    The glint is narrower than the field's directions are apart, and is taken as its mean over the cell of each: the
    `cell` of `cells`, and the part of the half turn that an azimuth stands for.
    """
    geometry, place, transmittance = rays.geometry, rays.ground_place[ray], rays.ground_weight[ray]
    low, high, squeeze = cell
    index, slope2 = surface.refractive_index, surface.slope2
    step = min(int(place), geometry.shape[0] - 2)
    h1 = place - step
    scale = N_ANGLE / math.sqrt(beams.span_rad)
    light = np.zeros(sums.shape[3])
    width = math.pi / sums.shape[1]
    for t in range(sums.shape[0]):
        for a in range(sums.shape[1]):
            inside = beams.edge_rad[0] - (
                (1.0 - h1) * geometry[step, t, a, ZENITH] + h1 * geometry[step + 1, t, a, ZENITH]
            )
            if inside < 0.0:
                continue
            x = scale * math.sqrt(inside)
            j = min(int(x), N_ANGLE - 1)
            b1 = x - j
            mu_in = 0.0
            for w in range(light.size):
                log_light = (1.0 - b1) * beams.log_light[0, j, w] + b1 * beams.log_light[0, j + 1, w]
                log_level = (1.0 - b1) * beams.log_ground[j, w] + b1 * beams.log_ground[j + 1, w]
                light[w] = math.exp(log_light) / N_CELL**2
                # the beam's light on a level surface over that on one normal to it: the sine of the sun as it is seen
                mu_in = max(mu_in, min(1.0, math.exp(log_level - log_light)))
            c = (1.0 - h1) * geometry[step, t, a, COS_AZIMUTH] + h1 * geometry[step + 1, t, a, COS_AZIMUTH]
            azimuth = math.acos(min(1.0, max(-1.0, c)))
            for m in range(N_CELL):
                cosine = math.cos(min(math.pi, max(0.0, azimuth + width * ((m + 0.5) / N_CELL - 0.5))))
                for n in range(N_CELL):
                    mu = low + (high - low) * (n + 0.5) / N_CELL
                    mu_out = math.sqrt(max(1e-6, 1.0 - (1.0 - mu * mu) * squeeze))
                    add_mirrored(mu_in, mu_out, cosine, index, slope2, light, transmittance, sums[t, a])


def cells(cosine: np.ndarray, weight: np.ndarray, ground_cosine: np.ndarray) -> np.ndarray:
    """Cells (R, 3) of the rays to the ground: cosines of the zenith angle from and to which each stands for at its
    start, and the square of the sine at the ground over that at the start.

    cosine, weight (Z, M): of the directions of each altitude, as in `Angles`; ground_cosine (R,): of the zenith angle
    where each ray ends.  Cells are as wide as the weights say: light that is the mean over its cell loses nothing in
    the sum over directions.  The sine at the ground over that at the start is the same for all rays from one altitude.
    """
    edge = np.concatenate([np.full((cosine.shape[0], 1), -1.0), 2.0 * np.cumsum(weight, axis=1) - 1.0], axis=1)
    ends = ground_cosine.reshape(cosine.shape)
    flattest = np.argmax(np.where(ends < 0.0, 1.0 - cosine**2, -1.0), axis=1)
    row = np.arange(cosine.shape[0])
    squeeze = (1.0 - ends[row, flattest] ** 2) / (1.0 - cosine[row, flattest] ** 2)
    all_rays = np.broadcast_to(squeeze[:, None], cosine.shape)
    return np.stack([edge[:, :-1], edge[:, 1:], all_rays], axis=-1).reshape(-1, 3)


@njit(cache=True, nogil=True)
def view_sunlit_water(beam, rays, directions, surface, ground_km, out, begin, end):
    """Sunlight that water in view mirrors, added to out (D, S, W) for rays begin..end; U as to the right of the sun.

    beam: of :func:`twilight.transport.beam.prepare_beam`; rays: `RayBundle`; directions: `RayDirections`; surface of
        all W.
    ground_km: altitude of the water.
    """
    light = np.empty(out.shape[2])
    ct, st = math.cos(directions.zenith_rad), math.sin(directions.zenith_rad)
    for r in range(begin, end):
        if rays.ground_weight[r].max() <= 0.0:
            continue
        cp, sp = math.cos(rays.ground_angle_rad[r]), math.sin(rays.ground_angle_rad[r])
        mu_out = -rays.ground_cosine[r]
        for d in range(directions.first[r], directions.first[r + 1]):
            ahead = -sp * ct + cp * st * directions.cos_azimuth[d]
            up = min(1.0, max(-1.0, cp * ct + sp * st * directions.cos_azimuth[d]))
            bending = beam_at(beam, ground_km, up, light)
            mu_in = math.cos(max(0.0, math.acos(up) - bending))
            c = min(1.0, max(-1.0, ahead / max(math.sqrt(1.0 - up * up), 1e-9)))
            add_mirrored(
                mu_in, mu_out, c, surface.refractive_index, surface.slope2, light, rays.ground_weight[r], out[d]
            )
