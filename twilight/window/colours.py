"""What the page draws with: X, Y, Z and scotopic luminance of a sky, and the same of light that is not the sun's."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from twilight import spectrum
from twilight.colour import sky_to_xyz
from twilight.sky import Sky

SCOTOPIC_EFFICACY_LM_PER_W = 1700.05
"""Luminous efficacy of 540 THz radiation for rods, lm W^-1 (CIE 018:2019)."""
CHANNELS = 4


@lru_cache(maxsize=1)
def scotopic_efficiency() -> np.ndarray:
    """V'(lambda) of CIE 1951 at `spectrum.VISIBLE_NM`, (471,), from colour-science."""
    from colour.colorimetry import SDS_LEFS_SCOTOPIC

    curve = SDS_LEFS_SCOTOPIC["CIE 1951 Scotopic Standard Observer"]
    return np.interp(spectrum.VISIBLE_NM, curve.wavelengths, curve.values, left=0.0, right=0.0)


class Channels:
    """Weights of one set of wavelengths (W,) [nm] under one solar spectrum at 1 au."""

    def __init__(self, wavelength_nm: np.ndarray, solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM):
        self.wavelength_nm = np.asarray(wavelength_nm, float)
        self.solar_irradiance = spectrum.solar_irradiance(self.wavelength_nm, solar_spectrum)
        nothing = np.zeros((1, 1, self.wavelength_nm.size))
        self._sky = Sky(self.wavelength_nm, np.array([45.0]), np.zeros(1), nothing, 0.0, solar_spectrum=solar_spectrum)
        sun = spectrum.solar_at_visible(solar_spectrum)
        self._rods = SCOTOPIC_EFFICACY_LM_PER_W * scotopic_efficiency() * sun

    def of(self, factor: np.ndarray) -> np.ndarray:
        """X, Y, Z as `colour.sky_to_xyz` and scotopic luminance [cd m^-2], (..., 4), of a radiance over F0 (..., W)."""
        rods = spectrum.integrate(factor, self.wavelength_nm, self._rods)
        return np.concatenate([sky_to_xyz(self._sky, factor), rods[..., None]], axis=-1)
