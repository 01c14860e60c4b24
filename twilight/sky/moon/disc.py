"""The moon's disc as the observer sees it: its lit part, turned to the sun, flattened and coloured by the air.

The refracted paths are those of `twilight.sky.disc.Disc`.  The surface reflects by the law of Lommel and Seeliger, with
which the full moon is evenly bright, as it is; seas and craters are not drawn, nor is the Earth's light on the dark
part.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twilight.sky.disc import Disc
from twilight.sky.moon.light import Moon


@dataclass(frozen=True, eq=False)
class MoonDisc:
    """What the air does to the light of the moon's disc.

    path: its refracted image, whose radius and elevation are the moon's.  moon: its place and phase.
    sun_elevation_deg: true, of the sun, which with `moon.azimuth_deg` says to where the lit limb points.
    """

    path: Disc
    moon: Moon
    sun_elevation_deg: float

    @property
    def wavelength_nm(self) -> np.ndarray:
        """(W,)."""
        return self.path.wavelength_nm

    @property
    def is_seen(self) -> bool:
        """Whether any part of the disc, lit or not, is above the horizon."""
        return self.path.is_seen

    def edges_deg(self) -> tuple[float, float]:
        """Lower and upper apparent edge [deg] of the whole disc, lit or not; NaN where nothing of it is seen."""
        return self.path.edges_deg()

    def half_width_deg(self) -> np.ndarray:
        """As `Disc.half_width_deg`."""
        return self.path.half_width_deg()

    def at_wavelengths(self, wavelength_nm: np.ndarray) -> MoonDisc:
        """The disc at other wavelengths, as `Disc.at_wavelengths`."""
        return replace(self, path=self.path.at_wavelengths(wavelength_nm))

    @property
    def bright_limb_deg(self) -> float:
        """Position angle of the middle of the lit limb [deg]: 0 up, 90 towards larger azimuth."""
        right, up = self._towards_sun()
        return float(np.degrees(np.arctan2(right, up)) % 360.0)

    def _towards_sun(self) -> tuple[float, float]:
        """Unit vector on the disc towards the sun: to larger azimuth, and up."""
        m, s, a = np.radians([self.moon.elevation_deg, self.sun_elevation_deg, -self.moon.azimuth_deg])
        right, up = np.cos(s) * np.sin(a), np.sin(s) * np.cos(m) - np.cos(s) * np.sin(m) * np.cos(a)
        length = float(np.hypot(right, up))
        return (float(right) / length, float(up) / length) if length > 1e-12 else (0.0, 1.0)

    def radiance(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Radiance over the sun's irradiance at 1 au [sr^-1] in apparent directions; azimuth from the moon.

        Broadcast shape plus (W,); 0 off the disc and on its dark part.
        """
        elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        out = np.zeros((elevation.size, self.wavelength_nm.size))
        low, high = self.path.elevation_deg[[0, -1]]
        near = np.flatnonzero((elevation.ravel() >= low) & (elevation.ravel() <= high))
        if near.size and self.is_seen:
            true, passed = self.path.along(elevation.ravel()[near])
            out[near] = self._above_the_air(true, azimuth.ravel()[near][:, None]) * passed
        return out.reshape(*elevation.shape, self.wavelength_nm.size)

    def _above_the_air(self, true_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        t, m, a = (np.radians(x) for x in (true_deg, self.moon.elevation_deg, azimuth_deg))
        radius = np.sin(np.radians(self.path.radius_deg))
        x = np.cos(t) * np.sin(a) / radius
        y = (np.sin(t) * np.cos(m) - np.cos(t) * np.sin(m) * np.cos(a)) / radius
        ahead = np.cos(t) * np.cos(m) * np.cos(a) + np.sin(t) * np.sin(m) > 0.0
        right, up = self._towards_sun()
        light = surface(x, y, (right, up), self.moon.phase_angle_deg)
        scale = self.moon.irradiance_factor(self.wavelength_nm) / radius**2 / disc_integral(self.moon.phase_angle_deg)
        return np.where(ahead, light, 0.0) * scale


def surface(x: np.ndarray, y: np.ndarray, towards_sun: tuple[float, float], phase_angle_deg: float) -> np.ndarray:
    """Brightness mu0 / (mu0 + mu) of a sphere (Lommel and Seeliger) at places x, y of its disc of radius 1.

    mu0, mu: cosines of the angles between its normal and sun, observer; 0 off the disc and where it is night.
    """
    z2 = 1.0 - x**2 - y**2
    mu = np.sqrt(np.maximum(z2, 0.0))
    g = np.radians(phase_angle_deg)
    mu0 = (x * towards_sun[0] + y * towards_sun[1]) * np.sin(g) + mu * np.cos(g)
    lit = (z2 > 0.0) & (mu0 > 0.0)
    return np.where(lit, mu0 / np.where(lit, mu0 + mu, 1.0), 0.0)


def disc_integral(phase_angle_deg: float) -> float:
    """Integral of `surface` over the disc: pi/2 (1 - sin(g/2) tan(g/2) ln(cot(g/4))), from 0 to 179.9 deg.

    Beyond, where the crescent is thinner than mountains are high, that of 179.9 deg.
    """
    g = np.radians(np.clip(phase_angle_deg, 1e-6, 179.9))
    return float(0.5 * np.pi * (1.0 - np.sin(g / 2) * np.tan(g / 2) * np.log(1.0 / np.tan(g / 4))))


@dataclass(frozen=True, eq=False)
class MoonSeen:
    """The moon of a sky.

    moon: its place above the air.  apparent_elevation_deg: where refraction shows its centre.  direct_irradiance (W,):
    of its beam at the observer, normal to its light [W m^-2 nm^-1].  disc: None where the moon is below the horizon.
    """

    moon: Moon
    apparent_elevation_deg: float
    direct_irradiance: np.ndarray
    disc: MoonDisc | None
