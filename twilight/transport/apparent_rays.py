"""Lines of sight followed backwards to space: where refraction shows what is beyond the air, and how dimmed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from twilight.jit.kernels import njit
from twilight.transport.ray_profile import ray_profile, refractive_radius, refractivity_at
from twilight.transport.rays import OUTSIDE, sun_ray

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium

NO_LIGHT = -1.0
"""Transmittance that marks a line of sight which does not leave the air."""


@njit(cache=True)
def _follow(profile, w, altitude_km, elevation_rad, bending, transmittance):
    """Fill bending (H,) [rad] and transmittance (H,), or NO_LIGHT, at one wavelength.

    profile: `RayProfile`; w: index of the wavelength; altitude_km: of the observer; elevation_rad (H,): apparent.
    """
    n = refractivity_at(profile, w, altitude_km)
    x = (profile.radius_km + altitude_km) * (1.0 + n)
    for i in range(elevation_rad.size):
        angle, tau, status = sun_ray(profile, w, altitude_km, x * math.sin(elevation_rad[i]), np.bool_(False))
        bending[i] = angle
        transmittance[i] = (1.0 + n) ** 2 * math.exp(-tau) if status == OUTSIDE else NO_LIGHT


class ApparentRays:
    """Rays of a medium by the apparent elevation under which an observer sees them."""

    def __init__(self, medium: Medium):
        self.medium = medium
        self._profile = ray_profile(medium)

    def follow(
        self, altitude_km: float, elevation_deg: np.ndarray, wavelengths: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """True elevation [deg] and transmittance (H, len(wavelengths)) of apparent elevations (H,) [deg].

        altitude_km: of the observer; wavelengths: indices of wavelengths of the medium.  The transmittance contains the
        square of the observer's refractive index (a path conserves radiance over n^2), and is 0 where a line of sight
        meets the ground or stays in a duct; its true elevation is then that without air.
        """
        z = max(altitude_km, self.medium.bottom_km)
        shape = (elevation_deg.size, len(wavelengths))
        true, passed = np.empty(shape), np.empty(shape)
        angle, transmittance = np.empty(elevation_deg.size), np.empty(elevation_deg.size)
        for k, w in enumerate(wavelengths):
            _follow(self._profile, int(w), z, np.radians(elevation_deg), angle, transmittance)
            free = transmittance >= 0.0
            true[:, k] = elevation_deg - np.where(free, np.degrees(angle), 0.0)
            passed[:, k] = np.where(free, transmittance, 0.0)
        return true, passed


def horizon_dip_deg(medium: Medium, altitude_km: float, level_km: float | None = None) -> float:
    """How far below the horizontal the refracted ray leaves that touches the ground [deg], in the middle wavelength.

    level_km: the altitude that the ray touches; None: the ground's.  Bouguer's invariant n r cos(elevation) is the same
    there and at the observer.
    """
    bottom, z = medium.bottom_km, max(altitude_km, medium.bottom_km)
    w = medium.n_wavelengths // 2
    profile = ray_profile(medium)
    touching = refractive_radius(profile, w, bottom if level_km is None else level_km)
    here = refractive_radius(profile, w, z)
    return float(np.degrees(np.arccos(min(1.0, touching / here))))
