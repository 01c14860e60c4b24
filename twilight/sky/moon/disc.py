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
    def elevation_deg(self) -> np.ndarray:
        """Apparent, of the rows (H,) [deg]."""
        return self.path.elevation_deg

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

    def without_dispersion(self) -> MoonDisc:
        """The disc with one edge for all wavelengths, for pixels that are much wider than a coloured rim."""
        true = self.path.true_elevation_deg.mean(axis=1, keepdims=True)
        return replace(self, path=replace(self.path, true_elevation_deg=true.repeat(self.wavelength_nm.size, axis=1)))

    @property
    def bright_limb_deg(self) -> float:
        """Position angle of the middle of the lit limb [deg]: 0 up, 90 towards larger azimuth."""
        right, up = towards_sun(self.moon, self.sun_elevation_deg)
        return float(np.degrees(np.arctan2(right, up)) % 360.0)

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
            out[near] = self._surface(true, azimuth.ravel()[near][:, None]) * self._scale() * passed
        return out.reshape(*elevation.shape, self.wavelength_nm.size)

    def rows(self) -> np.ndarray:
        """Irradiance over the sun's at 1 au that each row of `path` brings, (H, W), as `Disc.rows`."""
        node, weight = np.polynomial.legendre.leggauss(24)
        half, path = self.half_width_deg(), self.path
        angle = 0.5 * np.pi * node
        value = self._surface(path.true_elevation_deg[..., None], half[..., None] * np.sin(angle))
        across = (value * (0.5 * np.pi * np.cos(angle) * weight)).sum(axis=-1) * np.radians(half)
        step = np.radians(path.elevation_deg[1] - path.elevation_deg[0])
        return across * self._scale() * path.transmittance * np.cos(np.radians(path.elevation_deg))[:, None] * step

    def irradiance_factor(self) -> np.ndarray:
        """Irradiance of what is seen of the disc, on a surface that faces it, over the sun's at 1 au, (W,)."""
        return self.rows().sum(axis=0)

    def _scale(self) -> np.ndarray:
        """Radiance over the sun's irradiance at 1 au, (W,), of a place where `surface` is 1."""
        radius = np.sin(np.radians(self.path.radius_deg))
        return self.moon.irradiance_factor(self.wavelength_nm) / radius**2 / disc_integral(self.moon.phase_angle_deg)

    def _surface(self, true_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """`surface` in true directions; azimuth from the moon."""
        t, m, a = (np.radians(x) for x in (true_deg, self.moon.elevation_deg, azimuth_deg))
        radius = np.sin(np.radians(self.path.radius_deg))
        x = np.cos(t) * np.sin(a) / radius
        y = (np.sin(t) * np.cos(m) - np.cos(t) * np.sin(m) * np.cos(a)) / radius
        in_front = np.cos(t) * np.cos(m) * np.cos(a) + np.sin(t) * np.sin(m) > 0.0
        return np.where(
            in_front, surface(x, y, towards_sun(self.moon, self.sun_elevation_deg), self.moon.phase_angle_deg), 0.0
        )


def towards_sun(moon: Moon, sun_elevation_deg: float) -> tuple[float, float]:
    """Unit vector on the moon's disc towards the sun: to larger azimuth, and up."""
    m, s, a = np.radians([moon.elevation_deg, sun_elevation_deg, -moon.azimuth_deg])
    right, up = np.cos(s) * np.sin(a), np.sin(s) * np.cos(m) - np.cos(s) * np.sin(m) * np.cos(a)
    length = float(np.hypot(right, up))
    return (float(right) / length, float(up) / length) if length > 1e-12 else (0.0, 1.0)


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
    of what is seen of its disc, normal to its light [W m^-2 nm^-1].  disc: None where the moon is below the horizon.
    """

    moon: Moon
    apparent_elevation_deg: float
    direct_irradiance: np.ndarray
    disc: MoonDisc | None

    def dimmed(self, factor: float) -> MoonSeen:
        """Its light behind a filter."""
        disc = None if self.disc is None else replace(self.disc, path=self.disc.path.dimmed(factor))
        return replace(self, direct_irradiance=factor * self.direct_irradiance, disc=disc)
