"""The named phenomena of twilight as numbers: each function measures one on the computed sky of an air.

Chromaticities are CIE 1931 x, y.  Azimuth 0 is towards the sun, 180 deg the antisolar meridian.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twilight.config.scene import Config
from twilight.engine import solve
from twilight.numerics import spectrum
from twilight.scene import resolve
from twilight.sky import colour

WAVELENGTHS_NM = (390.0, 410, 430, 450, 465, 490, 510, 530, 550, 560, 590, 605, 620, 645, 670, 720)
"""Dense enough for a chromaticity to 0.002, on both sides of the O4 bands at 477, 577 and 630 nm."""

NOTICEABLE_UV = 0.0038
"""A just noticeable difference of u', v' side by side: three standard deviations of MacAdam near white."""

LEAST_BELT = 0.002
"""Least difference of x between the Belt of Venus and its surroundings: half of what can be noticed."""


class VerticalCircle(NamedTuple):
    """Elevations [deg], chromaticity x and y, and luminance [cd m^-2] along a vertical circle."""

    elevation_deg: np.ndarray
    x: np.ndarray
    y: np.ndarray
    luminance: np.ndarray


class Air:
    """The solved air of a configuration: its colours in single directions."""

    def __init__(self, config: Config):
        self.config = config
        # few wavelengths stand for the visible: 590 nm would count the edge of water vapour's band for 20 nm
        self.solved = solve(replace(resolve(config), bands=None), cached=False)
        self.medium = self.solved.medium

    def xyz(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """XYZ (D, 3), 2 deg observer, Y in cd m^-2."""
        factor = self.solved.radiance(sun_elevation_deg, elevation_deg, azimuth_deg)
        nm, name = self.medium.wavelength_nm, self.config.solar_spectrum
        return colour.spectrum_to_xyz(factor, nm, solar_spectrum=name, observer="cie1931_2deg")

    def profile(self, sun_elevation_deg: float, azimuth_deg: float, elevation_deg: np.ndarray) -> VerticalCircle:
        """Colour and luminance along a vertical circle."""
        xyz = self.xyz(sun_elevation_deg, elevation_deg, np.full(np.shape(elevation_deg), float(azimuth_deg)))
        x, y = chromaticity(xyz)
        return VerticalCircle(np.asarray(elevation_deg, float), x, y, xyz[:, 1])


def chromaticity(xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x and y of XYZ (..., 3)."""
    total = xyz.sum(axis=-1)
    return xyz[..., 0] / total, xyz[..., 1] / total


def above_daylight(x: float, y: float) -> float:
    """How far y lies above the CIE daylight locus, -3 x^2 + 2.87 x - 0.275: below it is pink, above it green."""
    return float(y - (-3.0 * x * x + 2.87 * x - 0.275))


class Belt(NamedTuple):
    """Belt of Venus: elevation [deg] and x of the reddest band, of the bluest sky below (the shadow) and above."""

    elevation_deg: float
    x: float
    shadow_elevation_deg: float
    shadow_x: float
    sky_x: float


def belt_of_venus(air: Air, sun_elevation_deg: float) -> Belt | None:
    """The reddest band of the antisolar meridian with bluer sky below and above it; None where there is none to see.

    The maximum of x that stands out most against the bluest sky on either side, up to 45 deg and not below the
    antisolar point, for there the air is in the shadow; by ``LEAST_BELT`` at least.
    """
    return _belt(_antisolar(air, sun_elevation_deg), -sun_elevation_deg)


def shadow_edge_deg(air: Air, sun_elevation_deg: float) -> float | None:
    """Elevation [deg] of the edge of the Earth's shadow: where x is half way from the shadow's to the Belt of Venus's.

    None where there is no Belt of Venus.
    """
    p = _antisolar(air, sun_elevation_deg)
    belt = _belt(p, -sun_elevation_deg)
    if belt is None:
        return None
    low, high = (int(np.searchsorted(p.elevation_deg, e)) for e in (belt.shadow_elevation_deg, belt.elevation_deg))
    half = 0.5 * (belt.shadow_x + belt.x)
    i = low + int(np.argmax(p.x[low + 1 : high + 1] >= half))
    fraction = (half - p.x[i]) / (p.x[i + 1] - p.x[i])
    return float(p.elevation_deg[i] + fraction * (p.elevation_deg[i + 1] - p.elevation_deg[i]))


def _antisolar(air: Air, sun_elevation_deg: float) -> VerticalCircle:
    return air.profile(sun_elevation_deg, 180.0, np.arange(0.5, 45.01, 0.5))


def _belt(p: VerticalCircle, antisolar_deg: float) -> Belt | None:
    best, found = LEAST_BELT, None
    for i in range(1, p.x.size - 1):
        if p.elevation_deg[i] >= antisolar_deg and p.x[i] > p.x[i - 1] and p.x[i] >= p.x[i + 1]:
            low = int(np.argmin(p.x[:i]))
            above = float(p.x[i:].min())
            stands_out = p.x[i] - max(p.x[low], above)
            if stands_out > best:
                best = stands_out
                here = float(p.elevation_deg[i]), float(p.x[i])
                found = Belt(*here, float(p.elevation_deg[low]), float(p.x[low]), above)
    return found


class Bands(NamedTuple):
    """Near the horizon under the sun: noticeable steps of colour in the lowest degrees, and luminance maxima."""

    colour_steps: float
    steps_per_degree_at_most: float
    fastest_elevation_deg: float
    luminance_maxima: tuple[float, ...]


def horizon_bands(air: Air, sun_elevation_deg: float, highest_deg: float = 8.0) -> Bands:
    """Colour bands that lie on the horizon in the sun's azimuth: the way of (u', v') over the lowest degrees in units
    of a noticeable step, its fastest change and where, and the elevations of maxima of luminance."""
    p = air.profile(sun_elevation_deg, 0.0, np.arange(0.1, highest_deg + 0.01, 0.2))
    way = np.linalg.norm(np.diff(colour.uv_of_xy(p.x, p.y), axis=0), axis=1) / NOTICEABLE_UV
    inner = p.luminance[1:-1]
    maxima = np.flatnonzero((inner > p.luminance[:-2]) & (inner > p.luminance[2:])) + 1
    return Bands(
        float(way.sum()),
        float(way.max() / 0.2),
        float(p.elevation_deg[way.argmax()]) + 0.1,
        tuple(float(p.elevation_deg[i]) for i in maxima),
    )


class Glow(NamedTuple):
    """The glow over the sun's azimuth: x at 3 deg, where x falls to that of D65 (0.3127) [deg], and its luminance at 3
    deg over that of the zenith."""

    horizon_x: float
    height_deg: float
    over_zenith: float


def afterglow(air: Air, sun_elevation_deg: float) -> Glow:
    """The warm glow above the sun's azimuth and how high it reaches (0: none)."""
    elevation = np.append(np.arange(1.0, 61.0, 1.0), 90.0)
    p = air.profile(sun_elevation_deg, 0.0, elevation)
    warm = p.x[:-1] > 0.3127
    height = float(elevation[:-1][warm].max()) if warm.any() else 0.0
    return Glow(float(p.x[2]), height, float(p.luminance[2] / p.luminance[-1]))


def red_over_blue(air: Air, sun_elevation_deg: float, elevation_deg: float, azimuth_deg: float) -> float:
    """Spectral radiance at 670 nm over that at 450 nm, each over the sun's: 1 is white."""
    factor = air.solved.radiance(sun_elevation_deg, [elevation_deg], [azimuth_deg])[0]
    red, blue = spectrum.expand(factor, air.medium.wavelength_nm, np.array([670.0, 450.0]))
    return float(red / blue)
