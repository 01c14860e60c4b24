"""Air in spherical shells, and the light that it scatters once, by closed forms and numpy alone."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from twilight.atmosphere.screen import Screen

EARTH_RADIUS_KM = 6371.0
ALTITUDE_KM = np.concatenate(
    [
        *([0, 0.02, 0.06, 0.12, 0.25, 0.45, 0.7, 1, 1.35, 1.7], np.arange(2, 15, 0.5), np.arange(15, 24, 0.25)),
        *(np.arange(24, 28, 0.5), np.arange(28.0, 42.0), np.arange(42, 60, 1.5), np.arange(60.0, 101.0)),
    ]
)
"""Boundaries of the L layers above the ground [km].

Below a volcano's layer, whose extinction rises fourfold within two km and falls sixteenfold within the next two, light
scattered once is off by 5 to 12 % at -4 to -6 deg with layers of 1.5 km, by 2 % with these, as with those of 125 m;
with layers of 3 and 5 km above 60 km it is off by 15 % at -9 deg.
"""
SUBLAYERS = 4
"""Parts of layers between ALTITUDE_KM at which air has its refractivity."""
STEEPEST_DEG = 0.03
"""Of the sunbeams to an altitude, elevation of the lowest one from above, beside the horizontal one [deg]."""
RAYS_FROM_ABOVE = 90
"""Sunbeams from above to an altitude, at elevations in a geometric series."""
RAYS_FROM_BELOW = 30
"""Sunbeams that come to an altitude from below its horizontal, evenly down to the ground's horizon."""
RAYS_AT_GROUND = 25
"""More of them close to the ground's edge, in a geometric series."""
LOWEST_POINTS_KM = np.concatenate([np.arange(0.5, 26, 0.5), np.arange(26.0, 30.0), np.arange(30.0, 100.0, 2.0)])
"""Altitudes at which others have their lowest points: between these the depth of air is nearly linear in the angle."""
LEAST_APART = 0.015
"""By how much sunbeams from below differ at least, as a part of the way from one to the ground's horizon: between
closer ones the spreading of the beam, a difference over a difference, is that of a kink in n r."""
LEAST_SPREAD = 0.05
"""Least d(true)/d(apparent zenith angle) of a sunbeam: beyond it the beam would be focused."""
DARKEST_PASSED = 1e-6
"""Least part of a sunbeam that passes a screen, so that it has a logarithm, which is interpolated."""
MOST_DEGREE = 16
"""Degree to which phase functions are followed at most; what is beyond is their forward peak."""
ROWS_AT_ONCE = 8
"""Elevations whose light is computed at once: it stays in the processor's cache."""
STEP = 1e-6
"""Imaginary part of an air whose light's derivative is asked for: an error of its square."""
AIR = 0
"""Row of `Air.depth`: scattering by air."""
ABSORPTION = 1
"""Row of `Air.depth`: absorption by gases."""
EXTINCTION = 2
"""Row of `Air.depth`: extinction by aerosol."""
LOW = 3
"""Row of `Air.depth`: scattering by aerosol below 12 km."""
HIGH = 4
"""Row of `Air.depth`: scattering by aerosol above 12 km."""
DARK_LOG = -700.0
"""Least logarithm of a sunbeam: its exponential is 0."""
DARK = 1e-35
"""Least radiance over F0 whose logarithm is taken [sr^-1]; single precision ends at 1e-38."""


def summed(depth: np.ndarray) -> np.ndarray:
    """Optical depths (..., L + 1, W) below the boundaries of layers, from those of the layers (..., L, W)."""
    return np.concatenate([np.zeros_like(depth[..., :1, :]), np.cumsum(depth, axis=-2)], axis=-2)


def single(x: np.ndarray) -> np.ndarray:
    """In single precision, real or complex."""
    return x.astype(np.complex64 if np.iscomplexobj(x) else np.float32, copy=False)


class Air(NamedTuple):
    """Air at W wavelengths in the L layers between ALTITUDE_KM, with K aerosols.

    depth (5, L, W): vertical optical depths, rows AIR to HIGH; aerosol_depth (K, L, W): of scattering by each aerosol
    degree (W,): to which phase functions are followed, 12 to 16; a fraction stands between two
    moments (K, W, 401): Legendre moments of the phase functions, the first is 1
    mixed_moments (2, W, 18), mixed_phase (2, W, 6): of the mean phase functions below and above 12 km; their
        integral of 2 pi P12 sin^3, and ln P at ANGLES_DEG
    log_phase, polarising (K, N, W): ln P [sr^-1] and P12 / P at angles pi (n / (N - 1))^2
    depolarisation, ground_albedo, ground_refractivity (W,)
    refractivity (SUBLAYERS L + 1,): n - 1 at the boundaries of the parts of layers; radius_km: of the ground
    """

    depth: np.ndarray
    aerosol_depth: np.ndarray
    degree: np.ndarray
    moments: np.ndarray
    mixed_moments: np.ndarray
    mixed_phase: np.ndarray
    log_phase: np.ndarray
    polarising: np.ndarray
    depolarisation: np.ndarray
    ground_albedo: np.ndarray
    ground_refractivity: np.ndarray
    refractivity: np.ndarray
    radius_km: float = EARTH_RADIUS_KM

    def towards(self, direction: Air) -> Air:
        """The same air with an imaginary part of STEP times a direction, for derivatives of light along it."""
        arrays = {key: getattr(self, key) + 1j * STEP * getattr(direction, key) for key in Air._fields[:-2]}
        return self._replace(**arrays)

    def peaks(self, moments: np.ndarray) -> np.ndarray:
        """Fraction of phase functions in their forward peaks (..., W): the moment after the last that is followed."""
        whole = self.degree.real.astype(int)
        rest, row = self.degree - whole, np.arange(whole.size)
        after = moments[:, row, np.minimum(whole + 2, moments.shape[2] - 1)]
        return np.clip((1.0 - rest) * moments[:, row, whole + 1] + rest * after, 0.0, 0.999)


class Beams(NamedTuple):
    """Geometry of shells: rays from the sun to each boundary, R in all, those to boundary k from start[k] on.

    zenith_rad, apparent_rad (R,): true and apparent solar zenith angles; log_factor (R,): ln of the beam's spreading
    path_km (R, L): ways in the layers
    """

    start: np.ndarray
    zenith_rad: np.ndarray
    apparent_rad: np.ndarray
    log_factor: np.ndarray
    path_km: np.ndarray


def sublayers(boundary_km: np.ndarray, count: int = SUBLAYERS) -> np.ndarray:
    """Boundaries of the equal parts of layers (L + 1,), (count L + 1,)."""
    part = np.arange(count) / count
    low, high = boundary_km[:-1, None], boundary_km[1:, None]
    return np.append((low + part * (high - low)).ravel(), boundary_km[-1])


def without_ducts(altitude_km: np.ndarray, refractivity: np.ndarray, radius_km: float) -> np.ndarray:
    """Refractivity (P + 1,), less where n r would fall upwards and no ray leave; the air above is as it is."""
    radius = radius_km + altitude_km
    x, least = (1.0 + refractivity) * radius, LEAST_RISE * np.diff(radius)
    if (np.diff(x) >= least).all():
        return refractivity
    for k in range(x.size - 2, -1, -1):
        x[k] = min(x[k], x[k + 1] - least[k])
    return x / radius - 1.0


class Parts(NamedTuple):
    """Parts of layers, `per_layer` in each, in which n r is linear: altitude [km], n and x = n r [km] at their
    boundaries (P + 1,), d(n r) / dr and mean n of each (P,)."""

    per_layer: int
    altitude_km: np.ndarray
    n: np.ndarray
    x: np.ndarray
    slope: np.ndarray
    mean_n: np.ndarray

    @staticmethod
    def of(altitude_km: np.ndarray, n: np.ndarray, radius_km: float, per_layer: int = 1) -> Parts:
        """From n at the boundaries of parts."""
        radius = radius_km + altitude_km
        x = n * radius
        return Parts(per_layer, altitude_km, n, x, np.diff(x) / np.diff(radius), 0.5 * (n[1:] + n[:-1]))

    def through(self, b: np.ndarray, first: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Path [km] and angle at the Earth's centre [rad] of rays in each layer from one on, (B, L), on one side of
        their lowest point: s = sqrt(x^2 - b^2) / (dx/dr), phi = n arccos(b / x) / (dx/dr), b (B,) = n r sin(zenith
        angle) being Bouguer's invariant [km]."""
        j, b = self.per_layer * first, b[:, None]
        beyond = np.maximum(self.x[j:], b)
        arc = b / beyond
        np.arccos(arc, out=arc)
        beyond *= beyond
        beyond -= b * b
        np.sqrt(beyond, out=beyond)
        path, angle = beyond[:, 1:] - beyond[:, :-1], arc[:, 1:] - arc[:, :-1]
        path /= self.slope[j:]
        angle *= self.mean_n[j:] / self.slope[j:]
        if self.per_layer == 1:
            return path, angle
        parts = range(self.per_layer)
        return sum(path[:, p :: self.per_layer] for p in parts), sum(angle[:, p :: self.per_layer] for p in parts)


@functools.lru_cache(maxsize=8)
def _parts(boundary: bytes, refractivity: bytes, radius_km: float) -> Parts:
    altitude, n = np.frombuffer(boundary), 1.0 + np.frombuffer(refractivity)
    count = (n.size - 1) // (altitude.size - 1)
    return Parts.of(sublayers(altitude, count), n, radius_km, count)


LEAST_RISE = 0.05
"""Least rise of n r over that of r."""

FROM_ABOVE_RAD = np.append(np.radians(90.0 - np.geomspace(90.0, STEEPEST_DEG, RAYS_FROM_ABOVE)), 0.5 * np.pi)
"""Apparent zenith angles of sunbeams from above."""
FROM_BELOW = np.concatenate(
    [np.linspace(0.0, 1.0, RAYS_FROM_BELOW + 1)[1:], 1.0 - np.geomspace(1e-4, 0.5, RAYS_AT_GROUND)]
)
"""Of sunbeams from below the horizontal that all altitudes have, parts of the way to the ground's horizon."""


def _from_below_rad(k: int, parts: Parts) -> np.ndarray:
    """Apparent zenith angles of the sunbeams to boundary k from below its horizontal, (R,)."""
    altitude, edge = (values[:: parts.per_layer] for values in (parts.altitude_km, parts.x))
    lowest = np.interp(LOWEST_POINTS_KM[LOWEST_POINTS_KM < altitude[k]], altitude, edge)
    part = np.unique(np.append(FROM_BELOW, np.arccos(lowest / edge[k]) / np.arccos(edge[0] / edge[k])))
    part = part[np.diff(part, prepend=0.0) > LEAST_APART * (1.0 - part)]
    return 0.5 * np.pi + np.arccos(edge[0] / edge[k]) * part


def _rays_to(k: int, parts: Parts) -> tuple[np.ndarray, ...]:
    """Rays from the sun to boundary k: true and apparent zenith angles, ln of the spreading, ways in layers (R, L)."""
    edge, apparent, down = parts.x[:: parts.per_layer], FROM_ABOVE_RAD, FROM_ABOVE_RAD.size
    if k:
        apparent = np.concatenate([apparent, _from_below_rad(k, parts)])
    b = edge[k] * np.sin(apparent)
    path, angle = np.zeros((2, apparent.size, edge.size - 1))
    if k < edge.size - 1:
        path[:down, k:], angle[:down, k:] = parts.through(b[:down], k)
    if k:
        path[down:], angle[down:] = parts.through(b[down:])
        path[down:, :k] *= 2.0  # layers below the point twice, down and up again
        angle[down:, :k] *= 2.0
    true = angle.sum(axis=1) + np.arcsin(np.minimum(b / edge[-1], 1.0))
    spread, sine = np.maximum(np.gradient(true, apparent), LEAST_SPREAD), np.sin(apparent)
    factor = parts.n[parts.per_layer * k] ** 2 * sine / np.maximum(np.sin(true), 1e-9) / spread
    factor[sine < 1e-6] = 1.0
    return true, apparent, single(np.log(factor)), single(path)


@functools.lru_cache(maxsize=8)
def _beams(geometry: tuple[bytes, bytes, float]) -> Beams:
    parts = _parts(*geometry)
    rows = [_rays_to(k, parts) for k in range(parts.slope.size // parts.per_layer + 1)]
    start = np.cumsum([0, *(row[0].size for row in rows)])
    return Beams(start, *(np.concatenate(part) for part in zip(*rows, strict=True)))


class Line(NamedTuple):
    """Lines of sight (E,) through the layers above the observer: way [km] (E, K), angle from the observer at the
    Earth's centre (E, K + 1) [rad] and optical depth (E, K + 1, W) at each boundary; optical depth of scattering of
    each of S kinds in each layer (E, W, S, K), empty where lines look down."""

    path: np.ndarray
    angle: np.ndarray
    depth: np.ndarray
    scattered: np.ndarray = np.empty(0)

    def zenith(self, sun_deg: np.ndarray | float, azimuth_deg: np.ndarray) -> np.ndarray:
        """True solar zenith angles [rad] at boundaries, (suns, E, A, K + 1)."""
        sun = np.radians(90.0 - np.atleast_1d(sun_deg))[:, None, None, None]
        cosine = np.sin(self.angle)[:, None] * np.cos(np.radians(azimuth_deg))[:, None] * np.sin(sun)
        cosine += np.cos(self.angle)[:, None] * np.cos(sun)
        return np.arccos(np.clip(cosine, -1.0, 1.0, out=cosine), out=cosine)


class Shells:
    """Light scattered once in refracting spherical shells, for one observer, by closed forms.

    The sunbeam at a point is exp(-tau) n^2 sin(i) / (sin(chi) d chi / d i), i the apparent and chi the true solar
    zenith angle, tabulated for each altitude over chi.  Along a line of sight ln(transmittance x sunbeam) is linear in
    each layer, in its part outside the shadow of the ground.

    boundary_km (L + 1,): altitudes above the ground, the observer's among them; extinction, peak (L, W), scattering
    (S, L, W) [km^-1]: without scattering in forward peaks, that in peaks, and of each of S kinds; refractivity
    (P L + 1,): n - 1 at the boundaries of P equal parts of each layer; screen: what dims the sunbeam beyond the
    horizon, and the powers (W,) of its T
    """

    def __init__(
        self,
        boundary_km: np.ndarray,
        extinction: np.ndarray,
        scattering: np.ndarray,
        peak: np.ndarray,
        refractivity: np.ndarray,
        observer_km: float = 0.0,
        radius_km: float = EARTH_RADIUS_KM,
        screen: tuple[Screen, np.ndarray] | None = None,
    ):
        self.boundary_km, self.extinction, self.scattering, self.peak = boundary_km, extinction, scattering, peak
        self.screen = screen
        self.first = int(np.argmin(np.abs(boundary_km - observer_km)))
        parts_km = sublayers(boundary_km, (refractivity.size - 1) // (boundary_km.size - 1))
        air = without_ducts(parts_km, np.asarray(refractivity, float), radius_km)
        self._geometry = (np.asarray(boundary_km, float).tobytes(), air.tobytes(), float(radius_km))

    @functools.cached_property
    def beams(self) -> Beams:
        """All sunbeams, computed when they are first asked for."""
        return _beams(self._geometry)

    @functools.cached_property
    def _tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Zenith angles that go on rising from boundary to boundary, (R,), and of the sunbeams ln and the depth of
        scattering in peaks, (W, R)."""
        b = self.beams
        key = b.zenith_rad + 4.0 * np.repeat(np.arange(self.boundary_km.size), np.diff(b.start))
        each = single(np.concatenate([self.extinction, self.peak], axis=1).T)
        depth, peak = np.split(each @ b.path_km.T, 2)
        log = b.log_factor - depth
        if self.screen is not None:
            screen, powers = self.screen
            passed = np.log(np.maximum(screen.at(self._least_km(screen)), DARKEST_PASSED))
            log += single(powers[:, None] * passed)
        return key, np.maximum(log, DARK_LOG), peak

    def _least_km(self, screen: Screen) -> np.ndarray:
        """Least altitudes (R,) of the sunbeams on the part of their way that counts for a screen [km]."""
        b, parts = self.beams, _parts(*self._geometry)
        at_end = np.repeat(parts.x[:: parts.per_layer], np.diff(b.start))
        near, far = (at_end * np.cos(b.apparent_rad) + s for s in (screen.from_km, screen.to_km))
        along = np.where(near > 0.0, near, np.where(far < 0.0, far, 0.0))
        highest = np.maximum.accumulate(parts.x)
        return np.interp(np.hypot(at_end * np.sin(b.apparent_rad), along), highest, parts.altitude_km)

    @functools.cached_property
    def _numbers(self) -> np.ndarray:
        """Indices of the sunbeams, (R,), as `np.interp` takes them."""
        return np.arange(self.beams.zenith_rad.size, dtype=float)

    def _place(self, k: Any, zenith_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The ray before each zenith angle at boundaries k, and the part of the way to the next, 0 to 1."""
        start, end = self.beams.start[k], self.beams.start[np.asarray(k) + 1] - 1
        # along the last but one axis each is close to the one before: the search goes on from there
        key = np.swapaxes(np.atleast_2d(zenith_rad + 4.0 * k), -1, -2)
        where = np.swapaxes(np.interp(key, self._tables[0], self._numbers), -1, -2)
        where = np.clip(where.reshape(np.shape(zenith_rad + 0.0 * k)), start, end)
        i = np.minimum(where.astype(int), end - 1)
        return i, where - i

    def log_sunbeam(self, k: Any, zenith_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ln of the sunbeam over F0 at boundaries k for true solar zenith angles (...,), (..., W), and how far these
        are from the shadow of the ground [rad]: negative within it, where the logarithm is that at its edge."""
        b = self.beams
        edge = b.zenith_rad[b.start[np.asarray(k) + 1] - 1]
        return self._between(self._tables[1], *self._place(k, zenith_rad)), edge - zenith_rad

    def peak_depth(self, k: Any, zenith_rad: np.ndarray) -> np.ndarray:
        """Depth of scattering in peaks on the way of the sunbeam to boundaries k, (..., W)."""
        return self._between(self._tables[2], *self._place(k, zenith_rad))

    def _between(self, table: np.ndarray, i: np.ndarray, f: np.ndarray) -> np.ndarray:
        """What a table (W, R) has at a `_place`, (..., W); in memory wavelengths come first."""
        here, after = (table.take(at, axis=1, mode="clip") for at in (i, i + 1))
        after -= here
        after *= single(f)
        after += here
        return np.moveaxis(after, 0, -1)

    @functools.cached_property
    def _own_rays(self) -> tuple[np.ndarray, ...]:
        """True and apparent zenith angles of the sunbeams to the observer."""
        return _rays_to(self.first, _parts(*self._geometry))[:2]

    def apparent_elevation_deg(self, sun_elevation_deg: float) -> float:
        """Apparent elevation [deg] of a sun of true elevation; of one in the shadow as far above it as at its edge."""
        true, apparent = self._own_rays
        lifted = np.interp(np.radians(90.0 - sun_elevation_deg), true, true - apparent)
        return sun_elevation_deg + float(np.degrees(lifted))

    def line(self, elevation_deg: np.ndarray) -> Line:
        """Lines of sight (E,), by their apparent elevations [deg]."""
        parts = _parts(*self._geometry)
        path, angle = parts.through(
            parts.x[parts.per_layer * self.first] * np.cos(np.radians(elevation_deg)), self.first
        )
        depth = summed((path[:, None] * self.extinction[self.first :].T)[..., None])[..., 0].swapaxes(1, 2)
        scattered = single(path[:, None, None] * self.scattering[:, self.first :].transpose(2, 0, 1))
        at_boundaries = np.concatenate([np.zeros((len(path), 1)), np.cumsum(angle, axis=1)], axis=1)
        return Line(path, at_boundaries, depth, scattered)

    def sunlit(self, zenith: np.ndarray, depth: np.ndarray, first: int | None = None) -> np.ndarray:
        """Transmittance x sunbeam in layers (E, A, K, W), from zenith angles (E, A, K + 1) and depths (E, K + 1, W) at
        boundaries from one on: the observer's where it is not given."""
        first = self.first if first is None else first
        logs, edge = self.log_sunbeam(np.arange(first, self.boundary_km.size), zenith)
        by_wavelength = np.ascontiguousarray(np.moveaxis(single(depth), -1, 0))  # as those of the sunbeam in memory
        logs -= np.moveaxis(by_wavelength, 0, -1)[:, None]
        light = _means_along(logs)
        if edge.min() < 0.0:
            light *= single(lit_fraction(edge[:, :, :-1], edge[:, :, 1:]))[..., None]
        return light

    def scattered_once(self, sun_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Integrals of scattering coefficient x transmittance x sunbeam along lines of sight, (S, E, A, W); times phase
        functions [sr^-1] they are light scattered once, L / F0."""
        return self.scattered_along(self.line(elevation_deg), sun_deg, azimuth_deg)

    def scattered_along(self, line: Line, sun_deg: float, azimuth_deg: np.ndarray) -> np.ndarray:
        """`scattered_once` of lines."""
        rows = (Line(*(part[some] for part in line)) for some in in_rows(len(line.path)))
        return np.concatenate([self._scattered_along(row, sun_deg, azimuth_deg) for row in rows], axis=1)

    def _scattered_along(self, line: Line, sun_deg: float, azimuth_deg: np.ndarray) -> np.ndarray:
        zenith, b = line.zenith(sun_deg, azimuth_deg)[0], self.beams
        edge = b.zenith_rad[b.start[1:] - 1][self.first :]
        lit = np.flatnonzero((zenith < edge).any(axis=(0, 1)))
        k = max(int(lit[0]) - 1, 0) if lit.size else zenith.shape[2] - 2  # below it is night
        first = self.first + k
        mean = self.sunlit(zenith[:, :, k:], line.depth[:, k:], first)
        sums = mean.transpose(0, 3, 1, 2) @ line.scattered[..., k:].swapaxes(2, 3)  # E W A S
        return sums.transpose(3, 0, 2, 1).astype(np.result_type(sums, float))


def in_rows(count: int) -> list[slice]:
    """ROWS_AT_ONCE elevations at a time."""
    return [slice(first, first + ROWS_AT_ONCE) for first in range(0, count, ROWS_AT_ONCE)]


def log_mean(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Mean of an exponential between two points, from its logarithms at both."""
    return _mean(first - last, np.exp(first), np.exp(last))


def log_means(logs: np.ndarray, axis: int) -> np.ndarray:
    """`log_mean` between neighbours along an axis."""
    values = np.exp(logs)
    before, after = ((*[slice(None)] * axis, part) for part in (slice(None, -1), slice(1, None)))
    return _mean(logs[before] - logs[after], values[before], values[after])


def _means_along(logs: np.ndarray) -> np.ndarray:
    """`log_mean` between neighbours along lines (E, A, K + 1, W), (E, A, K, W): in memory they come last, so that all
    are neighbours in one row; values between the end of a line and the start of the next are not used."""
    by_wavelength = np.moveaxis(logs, -1, 0)
    row = by_wavelength.reshape(-1)
    values = np.exp(row)
    means = np.append(_mean(row[:-1] - row[1:], values[:-1], values[1:]), values[-1:])
    return np.moveaxis(means.reshape(by_wavelength.shape)[..., :-1], 0, -1)


def _mean(drop: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Mean of an exponential between its values at two points; drop: of its logarithm."""
    middle, mean = first + last, first - last
    middle *= 0.5
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        mean /= drop
    np.copyto(mean, middle, where=np.abs(drop) < 1e-3)
    return mean


def lit_fraction(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Fraction of a segment outside a shadow, from the distances of its ends to the edge, which are negative within."""
    low, high = np.minimum(first, last), np.maximum(first, last)
    return np.clip(high / np.maximum(high - low, 1e-12), 0.0, 1.0) * (high > 0.0)
