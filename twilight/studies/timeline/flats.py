"""Twilight flats: electrons of a pixel from the sky's photons, and how long an exposure takes.

    electrons s^-1 = eta A omega integral L(lambda) R(lambda) lambda / (h c) dlambda

A the collecting area, omega the pixel's solid angle, R the band's response, eta the throughput of all else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twilight.base.errors import TwilightError
from twilight.sky.quantities.measure import ARCSEC2_SR


@dataclass(frozen=True)
class Telescope:
    """aperture_m, obstruction_m: diameters; pixel_arcsec: side; throughput: of optics and detector at the band's
    maximum, where its curve is 1; gain: electrons of a count; level_counts: that a flat is to have."""

    aperture_m: float = 1.0
    obstruction_m: float = 0.0
    pixel_arcsec: float = 0.5
    throughput: float = 0.5
    gain: float = 1.0
    level_counts: float = 30_000.0

    def __post_init__(self) -> None:
        for name in ("aperture_m", "pixel_arcsec", "throughput", "gain", "level_counts"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise TwilightError(f"--{name.replace('_', '-')}: must be above 0, not {getattr(self, name):g}")
        if not 0.0 <= self.obstruction_m < self.aperture_m:
            raise TwilightError("--obstruction-m: must be from 0 to less than the aperture")
        if self.throughput > 1.0:
            raise TwilightError("--throughput: must be at most 1")

    def electrons_per_s(self, photon_radiance: np.ndarray) -> np.ndarray:
        """Of a pixel, from photon radiance within the band [s^-1 m^-2 sr^-1]."""
        area = 0.25 * np.pi * (self.aperture_m**2 - self.obstruction_m**2)
        return photon_radiance * area * self.pixel_arcsec**2 * ARCSEC2_SR * self.throughput

    def exposure_s(self, photon_radiance: np.ndarray) -> np.ndarray:
        """Until a pixel has level_counts."""
        with np.errstate(divide="ignore"):
            return self.level_counts * self.gain / self.electrons_per_s(photon_radiance)
