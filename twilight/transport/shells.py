"""Light scattered once in refracting spherical shells, by closed forms along rays and numpy alone.

Between two altitudes n r is taken as linear in r.  With b = n r sin(zenith angle), the invariant of a refracted ray
(Bouguer), and x = n r, the path through a layer and the angle at the Earth's centre are then

    s = [sqrt(x^2 - b^2)] / (dx/dr),      phi = n [arccos(b / x)] / (dx/dr),

also where the ray grazes the layer.  The sunbeam at a point is exp(-tau) n^2 sin(i) / (sin(chi) d chi/d i), i the
apparent and chi the true solar zenith angle (glossary: spreading of the beam), tabulated for each altitude over chi.
Along a line of sight ln(transmittance x sunbeam) is linear in each layer, in its part outside the shadow of the ground.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twilight.base.conventions import EARTH_RADIUS_KM

ALTITUDE_KM = np.concatenate(
    [
        [0.0, 0.02, 0.06, 0.12, 0.25, 0.45, 0.7, 1.0, 1.35, 1.7],
        np.arange(2.0, 6.0, 0.5),
        np.arange(6.0, 16.0, 1.0),
        [16.0, 17.5, 19.0, 20.5, 22.0, 24.0, 26.0, 28.0, 30.0, 33.0],
        np.arange(36.0, 84.0, 3.0)[:-1],
        [82.0, 86.0, 90.0, 95.0, 100.0],
    ]
)
"""Boundaries of the model's layers above the ground [km]."""

SUBLAYERS = 4
"""Parts of each layer in which n r is linear; with 6 the sunbeam differs by less than 0.1 %."""

STEEPEST_DEG = 0.03
"""Elevation of the lowest ray from above that a table holds, beside the horizontal one [deg]."""

RAYS_FROM_ABOVE = 90
"""Rays from above in the table of an altitude."""

RAYS_FROM_BELOW = 100
"""Rays that have passed their lowest point in the table of an altitude."""

LEAST_SPREAD = 0.05
"""Least d chi/d i: beyond it the beam would be focused."""

DARK_LOG = -700.0
"""Logarithm of the sunbeam in the shadow of the Earth."""

SMALL_STEP = 1e-3
"""Difference of two logarithms below which the mean of both exponentials is theirs."""


def log_mean(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Mean of an exponential between two points, from its logarithms at both."""
    drop = first - last
    a, b = np.exp(first), np.exp(last)
    small = np.abs(drop) < SMALL_STEP
    return np.where(small, 0.5 * (a + b), (a - b) / np.where(small, 1.0, drop))


class Sunbeams(NamedTuple):
    """Sunbeams that come to an altitude, R of them: true and apparent solar zenith angles [rad], the true ones
    increasing, (R,); -ln of the sunbeam over F0 and optical depth of scattering in forward peaks, (R, W)."""

    zenith_rad: np.ndarray
    depth: np.ndarray
    apparent_rad: np.ndarray
    peak_depth: np.ndarray


def lit_fraction(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Fraction of a segment outside a shadow, from the distances of its ends to the edge, which are negative within."""
    low, high = np.minimum(first, last), np.maximum(first, last)
    return np.clip(high / np.maximum(high - low, 1e-12), 0.0, 1.0) * (high > 0.0)


class RefractedShells:
    """Sunbeam and lines of sight through layers, for one observer.

    Parameters
    ----------
    boundary_km : (L + 1,)
        Altitudes above the ground that bound the layers; the observer's is one of them.
    extinction_per_km, scattering_per_km : (L, W), (S, L, W)
        Of the layers; scattering by each of S kinds, air and S - 1 aerosols.
    peak_per_km : (L, W)
        Scattering in forward peaks, which extinction leaves out.
    refractivity : (SUBLAYERS L + 1,)
        n - 1 at the boundaries of the parts of layers.
    observer_km
        Altitude of the observer above the ground.
    radius_km
        Of the ground.
    """

    def __init__(
        self,
        boundary_km: np.ndarray,
        extinction_per_km: np.ndarray,
        scattering_per_km: np.ndarray,
        peak_per_km: np.ndarray,
        refractivity: np.ndarray,
        observer_km: float = 0.0,
        radius_km: float = EARTH_RADIUS_KM,
    ):
        self.boundary_km, self.extinction, self.scattering = boundary_km, extinction_per_km, scattering_per_km
        self.peak = peak_per_km
        self.layers, self.wavelengths = extinction_per_km.shape
        self.first = int(np.argmin(np.abs(boundary_km - observer_km)))
        radius = radius_km + sublayers(boundary_km)
        self._x = (1.0 + refractivity) * radius
        self._slope = np.diff(self._x) / np.diff(radius)
        self._index = 1.0 + 0.5 * (refractivity[1:] + refractivity[:-1])
        self._n = (1.0 + refractivity)[::SUBLAYERS]
        self._boundary_x = self._x[::SUBLAYERS]
        self._known: dict[int, Sunbeams] = {}

    def _through_layers(self, invariant: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Path [km] and angle at the Earth's centre [rad] of rays in each layer, (B, L), on one side of their lowest
        point.  invariant (B,): n r sin(zenith angle) of the rays [km]"""
        b = invariant[:, None]
        x = np.maximum(self._x[None], b)
        path = np.diff(np.sqrt(np.maximum(x * x - b * b, 0.0)), axis=1) / self._slope
        angle = np.diff(np.arccos(np.minimum(b / x, 1.0)), axis=1) * (self._index / self._slope)
        shape = (invariant.size, self.layers, SUBLAYERS)
        return path.reshape(shape).sum(axis=2), angle.reshape(shape).sum(axis=2)

    def _sunbeam(self, k: int) -> Sunbeams:
        """The sunbeams that come to boundary k, computed when they are first asked for."""
        if k not in self._known:
            self._known[k] = self._sunbeam_at(k)
        return self._known[k]

    def _sunbeam_at(self, k: int) -> Sunbeams:
        right = 0.5 * np.pi
        above = right - np.radians(np.geomspace(STEEPEST_DEG, 90.0, RAYS_FROM_ABOVE)[::-1])
        apparent = np.append(above, right)
        if k > 0:
            deepest = np.arccos(self._boundary_x[0] / self._boundary_x[k])
            n = RAYS_FROM_BELOW // 4
            even, grazing = np.linspace(0.0, 1.0, 3 * n + 1)[1:], 1.0 - np.geomspace(1e-4, 0.5, n)
            apparent = np.concatenate([apparent, right + deepest * np.unique(np.concatenate([even, grazing]))])
        below = apparent > right
        path, angle = self._through_layers(self._boundary_x[k] * np.sin(apparent))
        # layers above once; those below the point twice, down and up again
        passes = np.where(np.arange(self.layers) >= k, 1.0, np.where(below[:, None], 2.0, 0.0))
        leaving = np.arcsin(np.minimum(self._boundary_x[k] * np.sin(apparent) / self._boundary_x[-1], 1.0))
        true = (angle * passes).sum(axis=1) + leaving
        spread = np.maximum(np.gradient(true, apparent), LEAST_SPREAD)
        sine = np.sin(apparent)
        factor = self._n[k] ** 2 * sine / np.maximum(np.sin(true), 1e-9) / spread
        factor[sine < 1e-6] = 1.0
        path = path * passes
        return Sunbeams(true, path @ self.extinction - np.log(factor)[:, None], apparent, path @ self.peak)

    def log_sunbeam(self, k: int, zenith_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ln of the sunbeam over F0 at boundary k for true solar zenith angles (N,), (N, W), and how far these are from
        the shadow of the ground, (N,) [rad]; within it the logarithm is that at its edge, and the distance negative."""
        true, depth = self._sunbeam(k).zenith_rad, self._sunbeam(k).depth
        i = np.clip(np.searchsorted(true, zenith_rad) - 1, 0, true.size - 2)
        f = (zenith_rad - true[i]) / (true[i + 1] - true[i])
        out = -(depth[i] + (depth[i + 1] - depth[i]) * np.clip(f, 0.0, 1.0)[:, None])
        return np.maximum(out, DARK_LOG), true[-1] - zenith_rad

    def apparent_elevation_deg(self, sun_elevation_deg: float) -> float:
        """Apparent elevation [deg] of a sun of true elevation; of one in the shadow as far above it as at its edge."""
        beams = self._sunbeam(self.first)
        zenith = np.radians(90.0 - sun_elevation_deg)
        lifted = np.interp(zenith, beams.zenith_rad, beams.zenith_rad - beams.apparent_rad)
        return sun_elevation_deg + float(np.degrees(lifted))

    def _line(self, elevation_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Path (E, K) [km] in the K layers above the observer; angle at the Earth's centre (E, K + 1) and optical depth
        (E, K + 1, W) up to each boundary."""
        path, angle = self._through_layers(self._boundary_x[self.first] * np.cos(np.radians(elevation_deg)))
        path, angle = path[:, self.first :], angle[:, self.first :]
        depth = np.cumsum(path[:, :, None] * self.extinction[self.first :], axis=1)
        start = np.zeros((elevation_deg.size, 1))
        return (
            path,
            np.concatenate([start, np.cumsum(angle, axis=1)], axis=1),
            np.concatenate([np.zeros((*start.shape, self.wavelengths)), depth], axis=1),
        )

    def scattered_once(
        self, sun_elevation_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray
    ) -> np.ndarray:
        """Integrals of scattering coefficient x transmittance x sunbeam along lines of sight, (S, E, A, W).

        Times phase functions [sr^-1] they are light scattered once, L / F0.  elevation_deg (E,): apparent;
        azimuth_deg (A,): from the sun.
        """
        path, angle, depth = self._line(elevation_deg)
        mean = self._light_in_layers(local_zenith(sun_elevation_deg, angle, azimuth_deg), depth)
        weight = path[None, :, :, None] * self.scattering[:, None, self.first :]  # S E K W
        return np.einsum("sekw,eakw->seaw", weight, mean, optimize=True)

    def _light_in_layers(self, zenith: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Transmittance x sunbeam in layers (E, A, K, W), from true solar zenith angles (E, A, K + 1) [rad] at their
        boundaries and optical depths (E, K + 1, W) up to these."""
        light, edge = np.empty((*zenith.shape, self.wavelengths)), np.empty(zenith.shape)
        for j in range(zenith.shape[2]):
            here, distance = self.log_sunbeam(self.first + j, zenith[:, :, j].ravel())
            light[:, :, j] = here.reshape(*zenith.shape[:2], -1) - depth[:, None, j]
            edge[:, :, j] = distance.reshape(zenith.shape[:2])
        light = np.maximum(light, DARK_LOG)
        lit = lit_fraction(edge[:, :, :-1], edge[:, :, 1:])[..., None]
        return log_mean(light[:, :, :-1], light[:, :, 1:]) * lit

    def depth_in_peaks(
        self, sun_elevation_deg: float, elevation_deg: np.ndarray, fraction: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Optical depth of scattering in forward peaks on the path of light from the sun to the observer by lines of
        sight in the sun's azimuth, (E, W), a mean weighted with the light that peaks scatter; and that light by kind,
        (S - 1, E, W).

        fraction (S - 1, W): of the scattering by each aerosol in its peak
        """
        path, angle, depth = self._line(elevation_deg)
        zenith = local_zenith(sun_elevation_deg, angle, np.zeros(1))
        light = self._light_in_layers(zenith, depth)[:, 0]
        scattered = path[..., None] * fraction[:, None, None] * self.scattering[1:, None, self.first :] * light
        passed = np.cumsum(path[..., None] * self.peak[self.first :], axis=1)
        sunlight = np.empty((*zenith.shape[::2], self.wavelengths))
        for j in range(zenith.shape[2]):
            beams = self._sunbeam(self.first + j)
            for w in range(self.wavelengths):
                sunlight[:, j, w] = np.interp(zenith[:, 0, j], beams.zenith_rad, beams.peak_depth[:, w])
        before = np.concatenate([np.zeros_like(passed[:, :1]), passed[:, :-1]], axis=1)
        mean_depth = 0.5 * (before + passed + sunlight[:, :-1] + sunlight[:, 1:])
        by_kind = scattered.sum(axis=2)
        total = by_kind.sum(axis=0)
        return np.einsum("sekw,ekw->ew", scattered, mean_depth) / np.where(total > 0.0, total, 1.0), by_kind

    def emission_weights(self, elevation_deg: np.ndarray, coefficient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weights (E, K, W) of sources in the K layers above the observer in what lines of sight bring, and the angle
        at the Earth's centre in the middle of each, (E, K).

        coefficient (L, W): of the scattering that sources are multiplied with [km^-1]
        """
        path, angle, depth = self._line(elevation_deg)
        extinction = self.extinction[self.first :]
        inside = path[:, :, None] * extinction
        seen = np.where(inside > 1e-6, -np.expm1(-inside) / np.maximum(extinction, 1e-30), path[:, :, None])
        return np.exp(-depth[:, :-1]) * seen * coefficient[self.first :], 0.5 * (angle[:, 1:] + angle[:, :-1])


def sublayers(boundary_km: np.ndarray) -> np.ndarray:
    """Boundaries of the equal parts of layers (L + 1,), (SUBLAYERS L + 1,)."""
    part = np.arange(SUBLAYERS) / SUBLAYERS
    low, high = boundary_km[:-1, None], boundary_km[1:, None]
    return np.append((low + part * (high - low)).ravel(), boundary_km[-1])


def local_zenith(sun_elevation_deg: float, angle: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
    """True solar zenith angle [rad] at angles (E, K) from the observer along azimuths (A,), (E, A, K)."""
    sun = np.radians(90.0 - sun_elevation_deg)
    azimuth = np.cos(np.radians(azimuth_deg))[None, :, None]
    cosine = np.cos(angle)[:, None] * np.cos(sun) + np.sin(angle)[:, None] * np.sin(sun) * azimuth
    return np.arccos(np.clip(cosine, -1.0, 1.0))
