"""Light scattered once and twice in exponential air with one uniform layer over black ground, by plain quadrature.

It shares nothing with the solvers.  Optical depths in the layer are lengths of chords by Pythagoras; those in air, and
every other integral, are Gauss-Legendre sums on pieces that end where a ray meets the layer's edges, its lowest point
and where the layer's depth grows.  Directions at a point are cut at the horizon and where rays begin to touch the
layer.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange

NODE, WEIGHT = np.polynomial.legendre.leggauss(4)
FAR = 60.0
"""Longest pieces [km]."""
HIGH = 8.0
"""Most altitude that a piece crosses [km]."""
DEEP = 0.7
"""Largest optical depth of a piece in the layer."""
DARK = 20.0
"""Optical depth behind which nothing is added."""


class Layer(NamedTuple):
    """Air `air_per_km` exp(-z/scale_km), a layer of optical depth `depth` (HG `asymmetry`, white) from base to top
    [km]; `space_km`: where the air ends."""

    air_per_km: float
    scale_km: float
    base_km: float
    top_km: float
    depth: float
    asymmetry: float
    space_km: float
    radius_km: float


@njit(cache=True)
def _marks(air, r, mu, out):
    """Distances along a ray from (r, mu) at which it begins, meets the layer, its lowest point and its end, sorted;
    their number, negative where the ray ends on the ground."""
    perigee2 = r * r * (1.0 - mu * mu)
    middle = -r * mu
    rg = air.radius_km
    ground = mu < 0.0 and perigee2 < rg * rg
    end = middle + math.sqrt((air.radius_km + air.space_km) ** 2 - perigee2)
    if ground:
        end = middle - math.sqrt(rg * rg - perigee2)
    n = 0
    out[n] = 0.0
    n += 1
    for z in (air.base_km, air.top_km):
        c = (rg + z) ** 2 - perigee2
        if c > 0.0:
            for sign in (-1.0, 1.0):
                s = middle + sign * math.sqrt(c)
                if 1e-9 < s < end:
                    out[n] = s
                    n += 1
    if 1e-9 < middle < end:
        out[n] = middle
        n += 1
    out[n] = max(end, 0.0)
    n += 1
    out[:n].sort()
    return -n if ground else n


@njit(cache=True)
def _altitude(air, r, mu, s):
    # without the loss of digits of sqrt(...) - R
    z = r - air.radius_km
    return z + s * (2.0 * r * mu + s) / (math.sqrt(r * r + s * (2.0 * r * mu + s)) + r)


@njit(cache=True)
def _air_depth(air, r, mu, a, b, node, weight):
    total = 0.0
    rise = abs(_altitude(air, r, mu, b) - _altitude(air, r, mu, a))
    pieces = 1 + int(max((b - a) / FAR, rise / HIGH))
    h = 0.5 * (b - a) / pieces
    for p in range(pieces):
        centre = a + (2 * p + 1) * h
        for k in range(node.size):
            total += weight[k] * h * math.exp(-_altitude(air, r, mu, centre + h * node[k]) / air.scale_km)
    return air.air_per_km * total


@njit(cache=True)
def _to_sun(air, r, mu, marks, node, weight):
    """Transmittance from a point to the sun."""
    n = _marks(air, r, mu, marks)
    if n < 0:
        return 0.0
    depth = 0.0
    for i in range(n - 1):
        a, b = marks[i], marks[i + 1]
        z = _altitude(air, r, mu, 0.5 * (a + b))
        if air.base_km < z < air.top_km:
            depth += (b - a) * air.depth / (air.top_km - air.base_km)
        depth += _air_depth(air, r, mu, a, b, node, weight)
    return math.exp(-depth)


@njit(cache=True)
def _phase(air, z, cosine):
    """Scattering coefficient times phase function [km^-1 sr^-1]."""
    out = air.air_per_km * math.exp(-z / air.scale_km) * 3.0 / (16.0 * math.pi) * (1.0 + cosine * cosine)
    if air.base_km < z < air.top_km:
        g = air.asymmetry
        hg = (1.0 - g * g) / (4.0 * math.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)
        out += hg * air.depth / (air.top_km - air.base_km)
    return out


@njit(cache=True)
def points_of(air, r, mu, distance, passed, length, marks, node, weight):
    """Quadrature points of a ray: distances, optical depths to them and lengths; their number."""
    n_marks = abs(_marks(air, r, mu, marks))
    own = marks[:n_marks].copy()
    n, depth = 0, 0.0
    for i in range(n_marks - 1):
        a, b = own[i], own[i + 1]
        if b - a < 1e-9:
            continue
        z = _altitude(air, r, mu, 0.5 * (a + b))
        layer = air.depth / (air.top_km - air.base_km) if air.base_km < z < air.top_km else 0.0
        rise = abs(_altitude(air, r, mu, b) - _altitude(air, r, mu, a))
        pieces = 1 + int(max((b - a) / FAR, rise / HIGH, (b - a) * layer / DEEP))
        h = (b - a) / pieces
        for p in range(pieces):
            if depth > DARK or n + node.size > distance.size:
                return n
            start = a + p * h
            for k in range(node.size):
                s = start + 0.5 * h * (1.0 + node[k])
                distance[n] = s
                passed[n] = depth + layer * (s - start) + _air_depth(air, r, mu, start, s, node, weight)
                length[n] = 0.5 * h * weight[k]
                n += 1
            depth += layer * h + _air_depth(air, r, mu, start, start + h, node, weight)
    return n


@njit(cache=True)
def once(air, r, up, towards, sun, node, weight):
    """Radiance over F0 scattered once that comes to the point r up (unit vectors) along the line of sight `towards`."""
    distance, passed, length = np.empty(2000), np.empty(2000), np.empty(2000)
    marks = np.empty(8)
    mu = up @ towards
    n = points_of(air, r, mu, distance, passed, length, marks, node, weight)
    cosine = towards @ sun
    total = 0.0
    for i in range(n):
        place = r * up + distance[i] * towards
        here = math.sqrt(place @ place)
        z = _altitude(air, r, mu, distance[i])
        light = _to_sun(air, here, (place @ sun) / here, marks, node, weight)
        if light > 0.0:
            total += length[i] * math.exp(-passed[i]) * _phase(air, z, cosine) * light
    return total


@njit(cache=True)
def _edges(air, r, out):
    """Cosines of the zenith angle between which light from one side changes smoothly."""
    n = 0
    for x in (-1.0, -0.6, -0.3, 0.0, 0.01, 0.03, 0.1, 0.3, 0.6, 1.0):
        out[n] = x
        n += 1
    for z in (0.0, air.base_km, air.top_km):
        x = (air.radius_km + z) / r
        if x < 1.0:
            edge = -math.sqrt(1.0 - x * x)
            for y in (edge, 0.5 * edge, 1.3 * edge):
                out[n] = max(y, -1.0)
                n += 1
    out[:n].sort()
    return n


@njit(parallel=True, cache=True)
def _twice(air, r0, up0, towards, sun, distance, passed, length, n_azimuth, node, weight):
    out = np.zeros(distance.size)
    for i in prange(distance.size):
        place = r0 * up0 + distance[i] * towards
        r = math.sqrt(place @ place)
        up = place / r
        z = _altitude(air, r0, up0 @ towards, distance[i])
        # a frame about the vertical here
        side = np.cross(up, sun)
        side /= math.sqrt(side @ side)
        towards_sun = np.cross(side, up)
        edges = np.empty(24)
        n = _edges(air, r, edges)
        light = 0.0
        for e in range(n - 1):
            a, b = edges[e], edges[e + 1]
            if b - a < 1e-12:
                continue
            for k in range(node.size):
                mu = 0.5 * (a + b + (b - a) * node[k])
                sine = math.sqrt(1.0 - mu * mu)
                for m in range(n_azimuth):
                    phi = 2.0 * math.pi * (m + 0.5) / n_azimuth
                    way = mu * up + sine * (math.cos(phi) * towards_sun + math.sin(phi) * side)
                    solid_angle = 0.5 * (b - a) * weight[k] * 2.0 * math.pi / n_azimuth
                    # light that travels along -way turns to -towards
                    light += solid_angle * _phase(air, z, way @ towards) * once(air, r, up, way, sun, node, weight)
        out[i] = light * length[i] * math.exp(-passed[i])
    return out


def first_two_orders(air: Layer, elevation_deg: float, azimuth_deg: float, sun_deg: float, n_azimuth: int = 24):
    """L/F0 [sr^-1] of light scattered once and of light scattered twice that an observer on the ground sees."""
    e, a, h = np.radians([elevation_deg, azimuth_deg, sun_deg])
    up = np.array([0.0, 0.0, 1.0])
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    sun = np.array([np.cos(h), 0.0, np.sin(h)])
    r0 = air.radius_km * (1.0 + 1e-15)
    first = once(air, r0, up, towards, sun, NODE, WEIGHT)
    distance, passed, length = np.empty((3, 2000))
    n = points_of(air, r0, up @ towards, distance, passed, length, np.empty(8), NODE, WEIGHT)
    second = _twice(air, r0, up, towards, sun, distance[:n], passed[:n], length[:n], n_azimuth, NODE, WEIGHT)
    return float(first), float(second.sum())
