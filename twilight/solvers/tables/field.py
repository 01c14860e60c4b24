"""Bruneton and Neyret 2008, sec. 5: the sky read from the tables by eq. 16; `prepare` and `TablesField`.

What is read is C_M, S of each aerosol scattered once, and C_* = S_R + S_multiple / P_R (sec. 4, "Angular precision").
Aerial perspective is S at the observer less T times S at the far end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from twilight.atmosphere.medium import Medium, observer_at
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.base.threads import in_slices
from twilight.solvers.base import BareField, Convergence, check_sun
from twilight.solvers.tables.algorithm import QUALITIES, TablesSettings, rayleigh_at, solve, stored
from twilight.solvers.tables.mapping import Mapping, grid
from twilight.solvers.tables.passes import depths, read
from twilight.transport.profile import prepare_profile
from twilight.transport.ray_profile import passing_at, ray_profile
from twilight.transport.scaling import delta_scaled, species_phase, with_light_in_peak

LOWEST_JUDGED_SUN_DEG = -6.0
"""Suns above this [deg] are those whose irradiance of the ground by the sky says how far the orders have converged."""


def prepare(
    medium: Medium,
    settings: TablesSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> TablesField:
    """Fill the tables of a medium: for every sun, observer and direction.

    Errors: TwilightError for an observer below the ground, and for layers that lie between two heights of the tables.
    """
    return TablesField(medium, settings or QUALITIES["standard"], observer_altitude_km, progress)


class TablesField(BareField):
    """The sky of one medium for any sun, observer and direction, without refraction."""

    def __init__(
        self,
        medium: Medium,
        settings: TablesSettings,
        observer_altitude_km: float = 0.0,
        progress: Progress | None = None,
    ):
        self.medium, self.settings = medium, settings
        self.observer_altitude_km = observer_at(medium, observer_altitude_km)
        report = progress or silent
        self.scaled = delta_scaled(medium, settings.degree)
        self.profile = prepare_profile(medium)
        self._filtered = np.exp(-medium.overhead_absorption_optical_depth)
        self.tables = solve(self.scaled, settings, report)
        of_ground = self.tables.irradiance_by_order[:, 0, self._sunlit()]
        whole = of_ground.sum(axis=0)
        last = np.divide(of_ground[-1], whole, out=np.zeros_like(whole), where=whole > 0.0)
        self.convergence = Convergence(settings.max_orders, float(np.max(last, initial=0.0)))
        self._store()
        report("tables", 1.0)

    def _sunlit(self) -> np.ndarray:
        """Which texels of E along mu_s have the sun above LOWEST_JUDGED_SUN_DEG."""
        mu_s = np.linspace(-1.0, 1.0, self.tables.mapping.n_e_mu_s)
        return mu_s > math.sin(math.radians(LOWEST_JUDGED_SUN_DEG))

    def _store(self) -> None:
        """Fill `parts`, what is interpolated: C_* and the C_M of each aerosol."""
        tables = self.tables
        rayleigh = rayleigh_at(grid(tables.mapping)[3], self.medium.depolarisation)
        parts = [tables.single[0] + (tables.multiple / rayleigh).astype(np.float32), *tables.single[1:]]
        # what aerosol scattered once is zero in the shadow: always linear
        self.logarithmic = [self.settings.interpolation == "logarithmic" and self.settings.max_orders > 1]
        self.logarithmic += [False] * (len(parts) - 1)
        self.parts = [stored(p.astype(np.float32), log) for p, log in zip(parts, self.logarithmic, strict=True)]

    @property
    def mapping(self) -> Mapping:
        return self.tables.mapping

    def radiance(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], shape of the directions plus (W,); angles in degrees, azimuth from the sun.

        Directions may look down: then the Lambertian ground is seen through the air, lit by the sun and the sky.
        """
        rays = self._rays(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km)
        out = self.inscattered(rays)
        out[rays.ground] += self._ground(rays)
        return out.reshape(*rays.shape, -1)

    def inscatter(
        self,
        sun_elevation_deg: float,
        elevation_deg,
        azimuth_deg,
        distance_km,
        *,
        observer_altitude_km=None,
        peak_passes: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """As `SegmentField.inscatter`: (sun-normalised radiance [sr^-1], transmittance), directions plus (W,) each.

        Eq. 16: S at the observer minus T times S at the far end.  The tables count light in the narrow forward peak of
        aerosol as passed (`peak_passes`); otherwise what the segment scatters in it of the light behind is added.
        Errors: TwilightError for a distance that is not a number of 0 or more.
        """
        directions = np.broadcast_arrays(elevation_deg, azimuth_deg, distance_km)
        elevation, azimuth, distance = (np.asarray(a, dtype=float) for a in directions)
        if not np.all(distance >= 0.0):
            raise TwilightError("distance_km must be 0 or more")
        near = self._rays(sun_elevation_deg, elevation, azimuth, observer_altitude_km)
        left = np.minimum(np.maximum(distance.ravel() - near.entry_km, 0.0), near.length_km)
        far = near.moved(self.mapping, left)
        passed = np.exp(-self._depths(self.tables.profile, near, left))
        ends = (left >= near.length_km)[:, None]
        light = self.inscattered(near) - np.where(ends, 0.0, passed * self.inscattered(far))
        light, shape = np.maximum(light, 0.0), (*near.shape, -1)
        if peak_passes:
            return light.reshape(shape), passed.reshape(shape)
        true = np.exp(-self._depths(self.profile, near, left))
        whole = self.inscattered(near)
        whole[near.ground] += self._ground(near)
        light = with_light_in_peak(light, whole, passed, true)
        return light.reshape(shape), true.reshape(shape)

    def inscattered(self, rays: ViewRays) -> np.ndarray:
        """S (D, W) of rays."""
        values = []
        for part, log in zip(self.parts, self.logarithmic, strict=True):
            out = np.zeros((rays.mu.size, part.shape[-1]))
            where = rays.height_km, rays.mu, rays.mu_s, rays.nu, rays.ground
            in_slices(partial(read, self.mapping, part, log, *where, out), rays.mu.size)
            values.append(out)
        phase = species_phase(self.medium, self.scaled.forward_fraction, rays.nu)
        light = np.einsum("dsw,sdw->dw", phase, np.stack(values)) * self._filtered
        return np.where(rays.hits[:, None], light, 0.0)

    def _ground(self, rays: ViewRays) -> np.ndarray:
        """Radiance of the ground in view (G, W), for the rays that end on it."""
        g = rays.ground
        mu_s = (rays.mu_s * rays.radius_km + rays.length_km * rays.nu)[g] / self.mapping.bottom_km
        tables = self.tables
        direct = np.zeros((mu_s.size, self.medium.n_wavelengths))
        up = mu_s > 0.0
        tau = np.zeros((int(up.sum()), direct.shape[1]))
        on_ground, sky_above, to_the_top = np.zeros(len(tau)), np.zeros(len(tau), bool), np.full(len(tau), np.inf)
        depths(tables.profile, self.mapping, on_ground, mu_s[up], sky_above, to_the_top, tau)
        direct[up] = np.exp(-tau) * mu_s[up, None]
        if self.medium.screen is not None:
            r, across = self.mapping.bottom_km, np.sqrt(np.clip(1.0 - mu_s[up] ** 2, 0.0, 1.0))
            straight = ray_profile(self.medium, refraction=False)
            for w, nm in enumerate(self.medium.wavelength_nm):
                direct[up, w] *= passing_at(self.medium.screen, straight, 0, nm, r * across, r * mu_s[up])
        nodes = np.linspace(-1.0, 1.0, self.mapping.n_e_mu_s)
        sky = np.stack([np.interp(mu_s, nodes, column) for column in tables.irradiance[0].T], axis=-1)
        passed = np.exp(-self._depths(tables.profile, rays, rays.length_km)[g])
        return passed * self._filtered * self.medium.ground_albedo / np.pi * (direct + sky)

    def _depths(self, profile, rays: ViewRays, stop_km: np.ndarray) -> np.ndarray:
        """Optical depths (D, W) up to distances (D,)."""
        key = np.stack([rays.height_km, rays.mu, stop_km, rays.ground], axis=1)
        unique, back = np.unique(key, axis=0, return_inverse=True)
        out = np.zeros((unique.shape[0], self.medium.n_wavelengths))
        height, mu, length, ground = (np.ascontiguousarray(column) for column in unique.T)
        depths(profile, self.mapping, height, mu, ground > 0.0, length, out)
        return np.where(rays.hits[:, None], out[back.ravel()], 0.0)

    def _rays(self, sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km) -> ViewRays:
        check_sun(sun_elevation_deg)
        altitude = observer_at(self.medium, observer_altitude_km, self.observer_altitude_km)
        elevation, azimuth = np.broadcast_arrays(
            np.asarray(elevation_deg, dtype=float), np.asarray(azimuth_deg, dtype=float)
        )
        e, a, sun = np.radians(elevation.ravel()), np.radians(azimuth.ravel()), math.radians(sun_elevation_deg)
        mu, mu_s = np.sin(e), np.full(e.size, math.sin(sun))
        nu = np.clip(mu * mu_s + np.cos(e) * math.cos(sun) * np.cos(a), -1.0, 1.0)
        return ViewRays.of(self.mapping, altitude - self.medium.bottom_km, mu, mu_s, nu, elevation.shape)


@dataclass(frozen=True)
class ViewRays:
    """Lines of sight (D,) from points inside the air; those from above it begin where they enter the air.

    height_km, radius_km: of the start, above the ground and from the centre of the Earth; mu, mu_s, nu: cosines there
    ground: whether the line ends on the ground; length_km: to its end
    entry_km: from the observer to the start; hits: whether the line meets the air
    shape: of the directions that were asked for
    """

    height_km: np.ndarray
    mu: np.ndarray
    mu_s: np.ndarray
    nu: np.ndarray
    ground: np.ndarray
    length_km: np.ndarray
    entry_km: np.ndarray
    hits: np.ndarray
    radius_km: np.ndarray
    shape: tuple[int, ...]

    @staticmethod
    def of(mapping: Mapping, height_km: float, mu, mu_s, nu, shape) -> ViewRays:
        height, top = np.full(mu.size, height_km), mapping.thickness_km
        entry, hits = np.zeros(mu.size), np.ones(mu.size, dtype=bool)
        if height_km > top:
            r = mapping.bottom_km + height_km
            c = (height_km - top) * (2.0 * mapping.bottom_km + height_km + top)
            under = (r * mu) ** 2 - c
            hits = (mu < 0.0) & (under > 0.0)
            entry = np.where(hits, c / np.maximum(np.sqrt(np.maximum(under, 0.0)) - r * mu, 1e-9), 0.0)
            at = mapping.bottom_km + top
            mu = np.where(hits, np.clip((r * mu + entry) / at, -1.0, 0.0), 1.0)
            mu_s = np.where(hits, np.clip((r * mu_s + entry * nu) / at, -1.0, 1.0), mu_s)
            height = np.full(mu.size, top)
        return ViewRays._inside(mapping, height, mu, mu_s, nu, entry, hits, None, shape)

    @staticmethod
    def _inside(mapping, height, mu, mu_s, nu, entry, hits, ground, shape) -> ViewRays:
        b, r = mapping.bottom_km, mapping.bottom_km + height
        below = height * (2.0 * b + height)
        left = mapping.thickness_km - height
        above = left * (2.0 * r + left)
        if ground is None:
            ground = hits & (mu < 0.0) & ((r * mu) ** 2 > below)
        root = np.sqrt(np.maximum((r * mu) ** 2 - below, 0.0))
        to_ground = below / np.maximum(root - r * mu, 1e-12)
        to_top = np.sqrt((r * mu) ** 2 + above) - r * mu
        length = np.where(hits, np.where(ground, to_ground, to_top), 0.0)
        return ViewRays(height, mu, mu_s, nu, ground, length, entry, hits, r, shape)

    def moved(self, mapping: Mapping, distance_km: np.ndarray) -> ViewRays:
        """The same rays from points farther along them; what they end on stays."""
        r = self.radius_km
        change = distance_km * (2.0 * r * self.mu + distance_km)
        there = np.sqrt(r * r + change)
        height = np.clip(self.height_km + change / (there + r), 0.0, mapping.thickness_km)
        there = mapping.bottom_km + height
        mu = np.clip((r * self.mu + distance_km) / there, -1.0, 1.0)
        mu_s = np.clip((r * self.mu_s + distance_km * self.nu) / there, -1.0, 1.0)
        return ViewRays._inside(mapping, height, mu, mu_s, self.nu, self.entry_km, self.hits, self.ground, self.shape)
