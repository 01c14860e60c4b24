"""Optical depth, bending and irradiance of single sunbeams by quadrature of the medium itself: no tables, no kernels.

A ray keeps p = n r sin(i).  With v^2 = r - r_lowest the integrands of

    tau = int k x dr/u,   bending = -int (dn/dr)/n p dr/u,   u^2 = x^2 - p^2,   x = n r

are smooth in every layer of the medium, where a few dozen Gauss points are exact to rounding.
"""

import math

import numpy as np
from scipy.optimize import brentq

from twilight.atmosphere.levels import interpolate_smooth, log_cubics
from twilight.atmosphere.medium import Medium, interpolate_coefficient, with_joined_refractivity

NODE, WEIGHT = np.polynomial.legendre.leggauss(8)
LONGEST_KM = 2.0
"""Thicker layers are cut, so that the points are enough."""


class ExactSunbeam:
    """Rays of one wavelength through a medium: bent by its index, and for `straight_depth` straight."""

    def __init__(self, medium: Medium, *, wavelength: int = 0):
        self.medium = medium = with_joined_refractivity(medium.select(slice(wavelength, wavelength + 1)))
        self.radius_km = medium.earth_radius_km
        levels = np.unique(medium.altitude_km)
        self.levels = np.unique(np.concatenate([levels, np.arange(levels[0], levels[-1], LONGEST_KM)]))
        self._air = log_cubics(medium.altitude_km, medium.air_scattering_per_km)
        self._index = log_cubics(medium.altitude_km, medium.refractivity)
        self.overhead = float(medium.overhead_absorption_optical_depth[0])

    def _layer(self, z):
        """(Layer, fraction of it below) of altitudes; on a jump the layer above."""
        levels = self.medium.altitude_km
        i = np.clip(np.searchsorted(levels, z, side="right") - 1, 0, levels.size - 2)
        thickness = levels[i + 1] - levels[i]
        return i, np.clip((z - levels[i]) / np.where(thickness > 0.0, thickness, 1.0), 0.0, 1.0)

    def _extinction(self, z):
        """[km^-1] by the rules of the medium."""
        i, f = self._layer(z)
        m = self.medium
        a = m.air_scattering_per_km[:, 0]
        total = interpolate_smooth(a[i], a[i + 1], self._air[:, i, 0], f)
        for part in (m.absorption_per_km[:, 0], m.aerosol_extinction_per_km[:, 0]):
            total = total + interpolate_coefficient(part[i], part[i + 1], f)
        return total

    def _refractivity(self, z):
        i, f = self._layer(z)
        a = self.medium.refractivity[:, 0]
        return interpolate_smooth(a[i], a[i + 1], self._index[:, i, 0], f)

    def _index_slope(self, z):
        """dn/dr [km^-1]: n - 1 = a exp(c1 f + c2 f^2 + c3 f^3) between levels, or linear to 0."""
        i, f = self._layer(z)
        a, levels = self.medium.refractivity[:, 0], self.medium.altitude_km
        c1, c2, c3 = self._index[:, i, 0]
        slope = self._refractivity(z) * (c1 + f * (2.0 * c2 + 3.0 * f * c3))
        return np.where((a[i] > 0.0) & (a[i + 1] > 0.0), slope, a[i + 1] - a[i]) / (levels[i + 1] - levels[i])

    def _x(self, z):
        return (self.radius_km + z) * (1.0 + self._refractivity(z))

    def lowest_km(self, altitude_km: float, apparent_rad: float) -> float:
        """Altitude of the lowest point of the ray that arrives under an apparent zenith angle; NaN behind the Earth."""
        if apparent_rad <= 0.5 * math.pi:
            return altitude_km
        # x(altitude) - p without the difference of two large numbers
        fall = float(self._x(altitude_km)) * 2.0 * math.sin(0.5 * (apparent_rad - 0.5 * math.pi)) ** 2

        def missing(z):
            n, n_start = float(self._refractivity(z)), float(self._refractivity(altitude_km))
            return (altitude_km - z) * (1.0 + n) + (n_start - n) * (self.radius_km + altitude_km) - fall

        if missing(self.levels[0]) < 0.0:
            return math.nan
        return brentq(missing, self.levels[0], altitude_km, xtol=1e-13)

    def _outward(self, start_km: float, stop_km: float, p_squared_fall: float) -> tuple[float, float]:
        """(depth, bending) from start to stop of the ray whose u^2 is `p_squared_fall` at the start."""
        edges = self.levels[(self.levels > start_km) & (self.levels < stop_km)]
        edges = np.concatenate([[start_km], edges, [min(stop_km, self.levels[-1])]])
        if edges[-1] <= start_km:
            return 0.0, 0.0
        n_start = float(self._refractivity(start_km))
        x_start = float(self._x(start_km))
        p = math.sqrt(max(0.0, x_start**2 - p_squared_fall))
        # where u does not vanish at the start, v = sqrt(rise + h) with h the rise over which u^2 would
        h = p_squared_fall / (2.0 * x_start)
        v = np.sqrt(edges - start_km + h)
        low, high = v[:-1, None], v[1:, None]
        at = 0.5 * (low + high) + 0.5 * (high - low) * NODE
        rise = at**2 - h
        bottom, top = edges[:-1, None], edges[1:, None]
        z = np.clip(start_km + rise, bottom + 1e-13, np.nextafter(top, -np.inf))
        rise = np.maximum(rise, 0.0)
        n = self._refractivity(z)
        dx = rise * (1.0 + n) + (n - n_start) * (self.radius_km + start_km)
        uu = p_squared_fall + dx * (2.0 * x_start + dx)
        step = (high - low) * WEIGHT * at / np.sqrt(uu)  # dr/u = 2 v dv/u
        depth = float(np.sum(self._extinction(z) * (x_start + dx) * step))
        return depth, float(np.sum(-self._index_slope(z) / (1.0 + n) * p * step))

    def ray(self, altitude_km: float, apparent_rad: float) -> tuple[float, float]:
        """(optical depth, bending [rad]) of the ray that arrives under an apparent zenith angle; infinite, NaN behind
        the Earth."""
        if apparent_rad <= 0.5 * math.pi:
            u = float(self._x(altitude_km)) * math.cos(apparent_rad)
            depth, bending = self._outward(altitude_km, math.inf, u * u)
        else:
            lowest = self.lowest_km(altitude_km, apparent_rad)
            if math.isnan(lowest):
                return math.inf, math.nan
            out = self._outward(lowest, math.inf, 0.0)
            near = self._outward(lowest, altitude_km, 0.0)
            depth, bending = out[0] + near[0], out[1] + near[1]
        return depth + self.overhead, bending

    def apparent(self, altitude_km: float, sun_elevation_deg: float) -> float:
        """Apparent zenith angle [rad] of a sun at true elevation; NaN behind the Earth."""
        chi = math.radians(90.0 - sun_elevation_deg)

        def miss(i):
            return i + self.ray(altitude_km, i)[1] - chi

        sine = float(self._x(self.levels[0]) / self._x(altitude_km))
        last = math.pi - math.asin(min(1.0, sine)) - 1e-12  # of the ray that touches the ground
        if miss(last) < 0.0:
            return math.nan
        return brentq(miss, max(0.0, chi - 0.06), min(chi, last), xtol=1e-14)

    def irradiance(self, altitude_km: float, sun_elevation_deg: float) -> float:
        """Over F0 at normal incidence, thinned by differential refraction (the equation of `transport.beam`)."""
        apparent = self.apparent(altitude_km, sun_elevation_deg)
        if math.isnan(apparent):
            return 0.0
        depth, _ = self.ray(altitude_km, apparent)
        h = 2e-5
        a, b = (self.ray(altitude_km, apparent + s * h)[1] for s in (-1.0, 1.0))
        widening = 1.0 + (b - a) / (2.0 * h)
        chi = math.radians(90.0 - sun_elevation_deg)
        n = 1.0 + float(self._refractivity(altitude_km))
        return math.exp(-depth) * n * n * math.sin(apparent) / math.sin(chi) / widening

    def straight_depth(self, altitude_km, cos_zenith):
        """Optical depth (N,) to space of straight rays from altitudes (N,) [km]; infinite where they meet the ground.

        cos_zenith (N,): of the sun's zenith angle there.
        """
        z, c = np.asarray(altitude_km, float), np.asarray(cos_zenith, float)
        r = self.radius_km + z
        lowest = np.where(c >= 0.0, z, z - r * c * c / (1.0 + np.sqrt((1.0 - c) * (1.0 + c))))
        start = np.where(c >= 0.0, r * c, 0.0)
        depth = self._straight(lowest, start, np.full(z.shape, math.inf))
        below = c < 0.0
        if below.any():
            depth[below] += self._straight(lowest[below], start[below], z[below])
        return np.where(lowest < self.levels[0] - 1e-12, math.inf, depth) + self.overhead

    def _straight(self, lowest, start, stop_km):
        """Depth (N,) from altitudes `lowest`, where r cos(zenith angle) is `start`, up to `stop_km`."""
        levels = np.minimum(np.maximum(self.levels, lowest[:, None]), stop_km[:, None])
        rise = (levels - lowest[:, None]) * (2.0 * self.radius_km + levels + lowest[:, None])
        s = np.sqrt(rise + start[:, None] ** 2)
        low, high = s[:, :-1, None], s[:, 1:, None]
        at = 0.5 * (low + high) + 0.5 * (high - low) * NODE
        bottom = self.radius_km + lowest[:, None, None]
        climb = at**2 - start[:, None, None] ** 2
        z = lowest[:, None, None] + climb / (np.sqrt(bottom**2 + climb) + bottom)
        z = np.clip(z, self.levels[:-1, None] + 1e-13, np.nextafter(self.levels[1:, None], -np.inf))
        return np.sum(0.5 * (high - low) * WEIGHT * self._extinction(z), axis=(1, 2))


NODE_01 = 0.5 + 0.5 * NODE
FINE = np.array([1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.05, 0.2, 0.5])
"""Fractions at which a piece of a line is cut beside a point where the sun's ray grazes an edge."""


def scattered_once(medium: Medium, observer_km: float, elevation_deg: float, azimuth_deg: float, sun_deg: float):
    """L/F0 [sr^-1] of light scattered once by the air along a straight line, at the one wavelength of the medium.

    The line is cut where it meets a level and where the ray to the sun grazes one.
    """
    exact = ExactSunbeam(medium)
    radius, levels = exact.radius_km, np.unique(medium.altitude_km)
    e, a, h = np.radians([elevation_deg, azimuth_deg, sun_deg])
    r0, up = radius + observer_km, math.sin(e)
    to_sun = math.sin(e) * math.sin(h) + math.cos(e) * math.cos(h) * math.cos(a)
    r = radius + levels
    # |P|^2 = r0^2 + 2 r0 up s + s^2; P.sun = r0 sin h + to_sun s; the sun's ray grazes r where |P|^2 - (P.sun)^2 = r^2
    cuts = []
    for q, b, c in (
        (1.0, r0 * up, (r0 - r) * (r0 + r)),
        (
            max(1.0 - to_sun**2, 1e-15),
            r0 * (up - math.sin(h) * to_sun),
            (r0 * math.cos(h) - r) * (r0 * math.cos(h) + r),
        ),
    ):
        inside = b * b - q * c
        root = np.sqrt(inside[inside >= 0.0])
        cuts.append(np.concatenate([(-b - root) / q, (-b + root) / q]))
    far = math.sqrt(max(0.0, (r0 * up) ** 2 + (r[-1] - r0) * (r[-1] + r0))) - r0 * up
    sunk = (r0 * up) ** 2 - (r0 - radius) * (r0 + radius)
    if up < 0.0 and sunk >= 0.0:
        far = -r0 * up - math.sqrt(sunk)
    near = 0.0
    if far <= 0.0:
        return 0.0
    if observer_km > levels[-1]:
        inside = (r0 * up) ** 2 + (r[-1] - r0) * (r[-1] + r0)
        if up >= 0.0 or inside <= 0.0:
            return 0.0
        near = -r0 * up - math.sqrt(inside)
        far = -r0 * up + math.sqrt(inside) if sunk < 0.0 else far
    turn = [-r0 * up, -r0 * math.sin(h) / to_sun if to_sun else 0.0]
    marks = np.concatenate([*cuts, turn, [near, far], np.linspace(near, far, 2 + int((far - near) / 5.0))])
    marks = np.unique(marks[(marks >= near) & (marks <= far)])
    width = np.diff(marks)
    sharp = np.concatenate(cuts)
    begins, ends = np.isin(marks[:-1], sharp), np.isin(marks[1:], sharp)
    first = (marks[:-1][begins, None] + FINE * width[begins, None]).ravel()
    last = (marks[1:][ends, None] - FINE * width[ends, None]).ravel()
    s = np.unique(np.concatenate([marks, first, last]))

    def altitude(x):
        climb = x * (2.0 * r0 * up + x)
        return np.clip(observer_km + climb / (np.sqrt(r0 * r0 + climb) + r0), levels[0], np.nextafter(levels[-1], 0.0))

    # short steps in thick air, while anything can be seen
    begin, length, passed, steps = s[:-1], np.diff(s), 0.0, []
    for b, ds in zip(begin, length, strict=True):
        step_depth = float(exact._extinction(altitude(b + ds * NODE_01)).max()) * ds
        count = int(np.clip(math.ceil(4.0 * step_depth), 1, 400))
        steps.append(b + ds * np.arange(count) / count)
        passed += step_depth
        if passed > 60.0:
            break
    s = np.concatenate([*steps, [b + ds]])
    node, weight = np.polynomial.legendre.leggauss(4)
    half = 0.5 * np.diff(s)
    at = (s[:-1] + half)[:, None] + half[:, None] * node
    z = altitude(at)
    k = exact._extinction(z)
    steps = (k * half[:, None] * weight).sum(axis=1)
    power = np.linalg.inv(np.vander(node, increasing=True))
    to_node = np.array([[(x ** (m + 1) - (-1.0) ** (m + 1)) / (m + 1) for m in range(node.size)] for x in node])
    passed = np.concatenate([[0.0], np.cumsum(steps)[:-1]])[:, None] + k @ (to_node @ power).T * half[:, None]
    c = medium.at(z)
    phase = medium.phase_functions[0](np.array([to_sun]))[0, 0]
    sigma = c.air_scattering[..., 0] * 3.0 / (16.0 * math.pi) * (1.0 + to_sun**2) + c.aerosol_scattering[..., 0] * phase
    source = (half[:, None] * weight * sigma * np.exp(-passed)).ravel()
    seen = source > 1e-13 * source.max()
    z, at = z.ravel()[seen], at.ravel()[seen]
    cosine = np.clip((r0 * math.sin(h) + at * to_sun) / (radius + z), -1.0, 1.0)
    total = 0.0
    for part in np.array_split(np.arange(z.size), 1 + z.size // 500):
        total += float(np.sum(source[seen][part] * np.exp(-exact.straight_depth(z[part], cosine[part]))))
    return total
