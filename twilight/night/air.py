"""What the air does to light that comes from above it in all directions: extinction and, to first order, scattering."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium, layer_mean

DIFFUSIVITY = 1.66
"""Mean slant of diffuse light (Elsasser 1942)."""


class Veil(NamedTuple):
    """transmittance (E, W) along lines of sight; source (W,): what the air scatters in, over the mean light above."""

    transmittance: np.ndarray
    source: np.ndarray

    def behind(self, above: np.ndarray, mean: np.ndarray) -> np.ndarray:
        """Radiance (E, A, W) at the observer of light `above` (E, A, W) the air whose hemispheric mean is `mean` (W,).

            L = L_above t + L_mean (1 - t) s

        s holds the share of light that is scattered towards the lower hemisphere, single scattering albedo, and the
        dimming of the field by the air itself.
        """
        t = self.transmittance[:, None, :]
        return above * t + mean * (1.0 - t) * self.source


def veil(medium: Medium, elevation_deg: np.ndarray, observer_km: float = 0.0) -> Veil:
    """The air of a medium between an observer and the sources above, for light from all directions of the upper half.

    A uniform field from above is scattered on by air half up, half down, by particles of asymmetry g to (1 + g)/2
    down; the ground gives back its albedo.  The field is dimmed as by a two-stream layer, 1/(1 + 1.66 t_abs +
    0.75 ((1 - g) t_aerosol + t_air)).  5 to 7 % darker than the effective extinction of Noll et al. 2012 (A&A
    543, A92, fits to multiple scattering at Paranal) to 60 deg from the zenith.  Lines of sight
    are straight; those that end on the ground have transmittance 0.
    """
    fine = medium.refined(0.25, 1e-3)
    z = fine.altitude_km
    observer = max(float(observer_km), float(z[0]))
    keep = np.diff(z) > 0
    lower, upper = z[:-1][keep], z[1:][keep]

    def mean(coefficient: np.ndarray) -> np.ndarray:
        return layer_mean(coefficient[:-1][keep], coefficient[1:][keep])

    air, gas, particles = (
        mean(a) for a in (fine.air_scattering_per_km, fine.absorption_per_km, fine.aerosol_extinction_per_km)
    )
    albedo = 0.5 * (fine.aerosol_single_scattering_albedo[:-1] + fine.aerosol_single_scattering_albedo[1:])[keep]
    above = np.clip(upper - np.maximum(lower, observer), 0.0, None)[:, None]
    depth_air, depth_gas, depth_particles = ((a * above).sum(axis=0) for a in (air, gas, particles))
    scattered = (particles * albedo * above).sum(axis=0)
    g = np.zeros(scattered.size)
    for share, phase in zip(fine.aerosol_share, fine.phase_functions, strict=True):
        mixed = 0.5 * (share[:-1] + share[1:])[keep]
        g += phase.asymmetry * (mixed * particles * albedo * above).sum(axis=0)
    g = np.divide(g, scattered, out=np.zeros_like(g), where=scattered > 0)
    total = depth_air + depth_gas + depth_particles
    absorbed = depth_gas + depth_particles - scattered
    down = 0.5 * depth_air + 0.5 * (1 + g) * scattered
    up = 0.5 * depth_air + 0.5 * (1 - g) * scattered
    share_kept = np.divide(down + medium.ground_albedo * up, total, out=np.zeros_like(total), where=total > 0)
    dimming = 1.0 / (1.0 + DIFFUSIVITY * absorbed + 0.75 * ((1 - g) * scattered + depth_air))
    depth = _lengths_km(lower, upper, elevation_deg, observer, medium.earth_radius_km) @ (air + gas + particles)
    blocked = _ends_on_ground(elevation_deg, observer, medium)
    transmittance = np.where(blocked[:, None], 0.0, np.exp(-depth))
    return Veil(transmittance, share_kept * dimming)


def _ends_on_ground(elevation_deg: np.ndarray, observer_km: float, medium: Medium) -> np.ndarray:
    e = np.radians(elevation_deg)
    lowest = (medium.earth_radius_km + observer_km) * np.cos(e)
    return (e < 0) & (lowest < medium.earth_radius_km + medium.bottom_km)


def _lengths_km(lower: np.ndarray, upper: np.ndarray, elevation_deg: np.ndarray, observer_km: float, radius_km: float):
    """Lengths of straight lines in spherical layers (E, L) [km], from the observer outwards."""
    e = np.radians(np.asarray(elevation_deg, float))[:, None]
    start = radius_km + observer_km
    nearest = start * np.cos(e)

    def along(altitude: np.ndarray) -> np.ndarray:
        """Distance from the point of the line that is nearest to the Earth's centre."""
        return np.sqrt(np.maximum((radius_km + altitude) ** 2 - nearest**2, 0.0))

    out = along(np.maximum(upper, observer_km)) - along(np.maximum(lower, observer_km))
    dip = along(np.minimum(upper, observer_km)) - along(np.minimum(lower, observer_km))
    return np.where(e < 0, out + 2.0 * dip, out)
