"""From luminance and chromaticity to spectra by the CIE daylight basis (Preetham 1999, appendix A.5), over the sun.

A model's spectrum is divided by the solar spectrum in bins: the mean of one over the mean of the other.  The basis is
known every 10 nm, so bins are 10 nm wide at least; the quotient is then smooth, as sun-normalised radiance has to be.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.solvers.analytic.shipped_tables import table

LOWEST_NM = 300.0
"""Where the daylight basis begins [nm]."""

HIGHEST_NM = 830.0
"""Where the daylight basis ends [nm]."""

NARROWEST_BIN_NM = 10.0
"""Narrowest bin of a wavelength [nm]: the spacing of the daylight basis."""

SINGULAR = -1e-3
"""Largest value of the denominator of M1 and M2; at 0 no mixture of the basis has that chromaticity."""

_CHUNK = 100_000
"""Directions that are handled at once, so that large pictures need little memory."""


def daylight_weights(x, y) -> np.ndarray:
    """Weights (..., 3) of S0, S1, S2 in the daylight spectrum of CIE 1931 chromaticity x, y: 1, M1, M2.

    M1 = (-1.3515 - 1.7703 x + 5.9114 y) / (0.0241 + 0.2562 x - 0.7341 y), M2 = (0.0300 - 31.4424 x + 30.0717 y) / same.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    # The denominator is negative wherever daylight lies; it would be 0 in a purple that no sky has.
    m = np.minimum(0.0241 + 0.2562 * x - 0.7341 * y, SINGULAR)
    m1 = (-1.3515 - 1.7703 * x + 5.9114 * y) / m
    m2 = (0.0300 - 31.4424 * x + 30.0717 * y) / m
    return np.stack([np.ones_like(m1), m1, m2], axis=-1)


def daylight_spectrum(x, y) -> np.ndarray:
    """Spectrum (..., 54) of that chromaticity every 10 nm from 300 to 830 nm for 1 lm m^-2 [W m^-2 nm^-1].

    S0 + M1 S1 + M2 S2 where positive and 0 elsewhere: the red of a low sun would be negative in the blue.
    That moves the chromaticity of Preetham's sky by 0.007 at most for a sun above 5 deg, 0.02 at the horizon.
    """
    relative = np.maximum(daylight_weights(x, y) @ _basis().T, 0.0)
    return relative / (relative @ _luminous_weights())[..., None]


def locus_y(x) -> np.ndarray:
    """y of the CIE daylight locus, -3 x^2 + 2.87 x - 0.275 (CIE 15, for 0.25 <= x <= 0.38)."""
    x = np.asarray(x, float)
    return -3.0 * x**2 + 2.87 * x - 0.275


def daylight_chromaticity(colour_temperature_k: float) -> tuple[float, float]:
    """CIE 1931 x, y of daylight of a correlated colour temperature from 4000 to 25000 K (CIE 15)."""
    t = 1000.0 / colour_temperature_k
    if colour_temperature_k <= 7000.0:
        x = 0.244063 + 0.09911 * t + 2.9678 * t**2 - 4.6070 * t**3
    else:
        x = 0.237040 + 0.24748 * t + 1.9018 * t**2 - 2.0064 * t**3
    return x, float(locus_y(x))


class SpectralBins:
    """The bins of sampled wavelengths, and what turns luminance and chromaticity into sun-normalised radiance there."""

    def __init__(self, wavelength_nm: np.ndarray, solver: str):
        """Raises TwilightError, in the name of ``solver``, for a wavelength without a daylight basis."""
        wavelength = np.asarray(wavelength_nm, float)
        outside = (wavelength < LOWEST_NM) | (wavelength > HIGHEST_NM)
        if outside.any():
            raise TwilightError(
                f"the {solver} solver has daylight spectra from {LOWEST_NM:g} to {HIGHEST_NM:g} nm: "
                f"wavelengths holds {wavelength[outside][0]:g} nm"
            )
        half = 0.5 * NARROWEST_BIN_NM
        bounds = spectrum.wavelength_bounds(wavelength)
        low = np.maximum(np.minimum(bounds[:, 0], wavelength - half), LOWEST_NM)
        high = np.minimum(np.maximum(bounds[:, 1], wavelength + half), HIGHEST_NM)
        step = (np.arange(400) + 0.5) / 400.0
        inside = low[:, None] + (high - low)[:, None] * step
        grid, irradiance = spectrum.solar_spectrum()
        # 400 points in a bin see the 1 nm steps of the solar spectrum to 1e-3 or better.
        sun = irradiance[np.clip(np.rint(inside - grid[0]).astype(int), 0, grid.size - 1)].mean(axis=1)
        nodes = _nodes()
        self.to_bins = np.stack([np.interp(inside, nodes, hat).mean(axis=1) for hat in np.eye(nodes.size)], axis=1)
        self.to_bins /= sun[:, None]
        unit = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.colour_matching_functions("cie1931_2deg")[:, 1].sum()
        self.of_flat_spectrum = 1.0 / unit / sun
        """Sun-normalised radiance [sr^-1] of light of 1 cd m^-2 whose spectrum is constant, (W,)."""

    def from_chromaticity(self, luminance_cd_per_m2, x, y) -> np.ndarray:
        """Sun-normalised radiance [sr^-1] (..., W) of daylight of that luminance and chromaticity."""
        luminance, x, y = np.broadcast_arrays(np.asarray(luminance_cd_per_m2, float), x, y)
        flat = [v.ravel() for v in (luminance, x, y)]
        out = np.empty((luminance.size, self.to_bins.shape[0]))
        for start in range(0, luminance.size, _CHUNK):
            part = slice(start, start + _CHUNK)
            out[part] = flat[0][part, None] * (daylight_spectrum(flat[1][part], flat[2][part]) @ self.to_bins.T)
        return out.reshape(*luminance.shape, out.shape[1])


def _nodes() -> np.ndarray:
    return table("daylight_basis")[1][:, 0]


def _basis() -> np.ndarray:
    return table("daylight_basis")[1][:, 1:]


@lru_cache(maxsize=1)
def _luminous_weights() -> np.ndarray:
    """683 lm/W times V(lambda) integrated over the hat functions of the basis, (54,)."""
    nodes = _nodes()
    v = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.colour_matching_functions("cie1931_2deg")[:, 1]
    return np.array([np.interp(spectrum.VISIBLE_NM, nodes, hat) @ v for hat in np.eye(nodes.size)])
