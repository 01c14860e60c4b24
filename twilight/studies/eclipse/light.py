"""The moon in the shadow: its light through an eclipse, as a magnitude and a colour; and a satellite's sunlight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twilight.numerics import spectrum
from twilight.sky.bodies import AU_KM
from twilight.studies.eclipse.circumstances import Eclipse, MoonPositions
from twilight.studies.eclipse.scattered import SinglyScatteredLight, above
from twilight.studies.eclipse.shadow import SUN_RADIUS_DEG, Shadow

FULL_MOON_MAG = -12.73
"""V of the mean full moon at its mean distance (Allen 1976, Astrophysical Quantities)."""
MEAN_DISTANCE_KM = 384_400.0
"""Distance of the moon to which FULL_MOON_MAG belongs [km]."""
OFFSETS = 80
"""Angles from the shadow's axis at which irradiance is computed, between which its logarithm is linear."""
SCATTERED_OFFSETS = 8
"""Angles from the shadow's axis at which scattered light is computed: over the umbra it changes by 10 % at most."""
RINGS = 10
"""Radii of the moon's disc over which irradiance is averaged, Gauss-Legendre in their squares."""
AROUND = 24
"""Azimuths about the middle of the moon's disc over which it is averaged."""
LEAST = 1e-12
"""Irradiance over that without the Earth that counts as none."""
GRAVITY_KM3_S2 = 398_600.4418
"""GM of the Earth [km^3 s^-2] (WGS 84)."""


class ShadowLight(NamedTuple):
    """Irradiance over that without the Earth against the angle from the shadow's axis.

    offset_rad (N,); irradiance (N, W): of all light; scattered (N, W): the part of it that the air scattered once;
    visual (N,): irradiance by V(lambda) and the solar spectrum; distance_km: of the moon
    """

    offset_rad: np.ndarray
    irradiance: np.ndarray
    scattered: np.ndarray
    visual: np.ndarray
    distance_km: float

    def visual_at(self, offset_rad: np.ndarray) -> np.ndarray:
        """`visual` at any angles."""
        return np.exp(np.interp(offset_rad, self.offset_rad, np.log(self.visual)))


def visual(irradiance: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    """Illuminance over that of the sun, from irradiance over the sun's (..., W)."""
    weight = spectrum.colour_matching_functions("cie1931_2deg")[:, 1] * spectrum.solar_at_visible()
    return spectrum.integrate(irradiance, wavelength_nm, weight) / weight.sum()


def shadow_light(shadow: Shadow, eclipse: Eclipse) -> ShadowLight:
    """Light from the shadow's axis to beyond the penumbra, at the moon's distance at greatest eclipse."""
    p = eclipse.moon
    k = int(np.argmin(p.offset_rad))
    distance = float(p.distance_km[k])
    sun_rad = float(np.radians(SUN_RADIUS_DEG) * AU_KM / (p.sun_distance_km[k] + distance))
    farthest = float(np.max(p.offset_rad + p.moon_radius_rad)) * 1.02
    # closest about the edge of the umbra, where light falls by a thousand
    umbra = float(p.umbra_rad[k])
    offset = np.unique(
        np.concatenate([np.linspace(0.0, 0.8 * umbra, OFFSETS // 4), np.linspace(0.8, 1.1, OFFSETS // 2) * umbra,
                        np.linspace(1.1 * umbra, farthest, OFFSETS // 4)])
    )  # fmt: skip
    # the observer on the moon sees sun and Earth farther apart than the Earth sees moon and axis, by the sun's distance
    seen = offset * (1.0 + distance / float(p.sun_distance_km[k]))
    m = shadow.medium
    clear_air = m if shadow.lowest_km == m.bottom_km else above(m, shadow.lowest_km)
    nodes = np.linspace(0.0, float(seen[-1]), SCATTERED_OFFSETS)
    at_nodes = np.maximum(SinglyScatteredLight(clear_air, distance).irradiance(nodes), LEAST)
    scattered = np.stack([np.exp(np.interp(seen, nodes, np.log(one))) for one in at_nodes.T], axis=1)
    total = np.maximum(shadow.irradiance(seen, distance, sun_rad), LEAST) + scattered
    return ShadowLight(offset, total, scattered, np.maximum(visual(total, m.wavelength_nm), LEAST), distance)


def disc_mean(light: ShadowLight, moon: MoonPositions) -> np.ndarray:
    """Mean of `visual` over the moon's disc at T moments, (T,): the full moon's disc is as bright at its limb."""
    x, w = np.polynomial.legendre.leggauss(RINGS)
    radius, weight = np.sqrt(0.5 * (x + 1.0)), 0.5 * w
    azimuth = (np.arange(AROUND) + 0.5) * 2.0 * np.pi / AROUND
    r = radius[:, None, None] * moon.moon_radius_rad
    offset = np.sqrt(moon.offset_rad**2 + r**2 + 2.0 * moon.offset_rad * r * np.cos(azimuth)[None, :, None])
    return np.einsum("r,rat->t", weight, light.visual_at(offset)) / AROUND


def magnitudes(light: ShadowLight, moon: MoonPositions) -> np.ndarray:
    """Visual magnitude of the moon above the air at T moments, (T,)."""
    full = FULL_MOON_MAG + 5.0 * np.log10(moon.distance_km / MEAN_DISTANCE_KM)
    return full - 2.5 * np.log10(disc_mean(light, moon))


def satellite(shadow: Shadow, altitude_km: float, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sunlight on a satellite that enters the shadow, its orbit a circle with the sun in its plane.

    Parameters
    ----------
    shadow
        Of the air.
    altitude_km
        Of the orbit above sea level [km]; beyond the air.
    seconds : (T,)
        Since it crossed the edge of the shadow of an airless Earth, for the sun's centre [s].

    Returns
    -------
    offset_deg : (T,)
        Angle between the sun's centre and the Earth's, as seen from there [deg].
    irradiance : (T, W)
        Over that above the shadow.

    Raises
    ------
    TwilightError
        For an altitude within the air.
    """
    earth = shadow.medium.earth_radius_km
    radius = earth + altitude_km
    angular_speed = np.sqrt(GRAVITY_KM3_S2 / radius**3)
    edge = np.arcsin(min(1.0, (earth + shadow.medium.bottom_km) / radius))
    offset = edge - angular_speed * np.asarray(seconds, dtype=float)
    return np.degrees(offset), shadow.irradiance(offset, radius)
