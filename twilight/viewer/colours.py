"""What pages and films draw with: the channels of a tone, for light that is the sun's and light that is not."""

from __future__ import annotations

import numpy as np

from twilight.numerics import spectrum
from twilight.sky.tone import Eye, Light, Tone

CHANNELS = 4
"""X, Y, Z and scotopic luminance."""


class Channels:
    """Channels of a tone for one set of wavelengths (W,) [nm] under one solar spectrum at 1 au.

    tone: `Eye`, whose channels X, Y, Z and scotopic luminance serve all tones of the eye's colours, or a `Camera`.
    """

    def __init__(
        self, wavelength_nm: np.ndarray, solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM, tone: Tone | None = None
    ):
        self.wavelength_nm = np.asarray(wavelength_nm, float)
        self.solar_irradiance = spectrum.solar_irradiance(self.wavelength_nm, solar_spectrum)
        self._tone = tone or Eye()
        self._light = Light(solar_spectrum, 1.0)

    def of(self, factor: np.ndarray) -> np.ndarray:
        """Channels (..., 4) [cd m^-2], the second of them luminance, of a radiance over F0 (..., W)."""
        return self._tone.see(factor, self.wavelength_nm, self._light)
