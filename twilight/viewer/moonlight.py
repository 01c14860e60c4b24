"""Moonlit channels of sunlit ones: the moon's light in the air is the sun's, times a smooth spectrum.

    moonlit = f(550 nm) C sunlit,      C (4, 4) so that C see(L) = see(L f / f(550 nm)) for the spectra L of one air

f is the moon's irradiance over the sun's, see(L) the channels of a spectrum.  The spectra of one sky are few enough
that C exists: 95 % of the residuals are within 0.2 % of luminance and 0.8 % of X, Z and scotopic luminance
(`tests/test_moon_films.py`), so that the tables of a field serve the moon as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from twilight.sky.moon import PHASE_RANGE_DEG, Moon
from twilight.viewer.colours import Channels

PHASES_DEG = np.array([PHASE_RANGE_DEG[0], 15.0, 40.0, PHASE_RANGE_DEG[1]])
"""Phase angles at which C is found; linear in between, for the moon reddens evenly with its phase."""
LEVEL_NM = np.array([550.0])
"""Wavelength at which the moon's irradiance over the sun's is a factor of its own [nm]."""
DARK = 1e-25
"""Spectra are left out whose light is less than this [sr^-1]."""

LEVEL_PHASES_DEG = np.concatenate([[0.0, 1.55, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20], np.arange(25.0, 181.0, 5.0)])
"""Phase angles at which a page has the moon's light; its logarithm is linear in between."""


def reddening(wavelength_nm: np.ndarray, phase_angle_deg: float) -> np.ndarray:
    """f / f(550 nm), (W,)."""
    moon = Moon(0.0, 0.0, phase_angle_deg)
    return moon.reflectance(wavelength_nm) / moon.reflectance(LEVEL_NM)


def page_header() -> dict[str, Any]:
    """What `web/moon.js` needs of every moon: ln f(550 nm) at mean distances, phase unknown, waxing and waning."""
    moons = [[Moon(0.0, 0.0, float(g), waxing=w) for g in LEVEL_PHASES_DEG] for w in (None, True, False)]
    rows = [[float(np.log(moon.irradiance_factor(LEVEL_NM)[0])) for moon in row] for row in moons]
    return {"phase_deg": LEVEL_PHASES_DEG.tolist(), "log_level": rows, "colours_at_deg": PHASES_DEG.tolist()}


@dataclass(frozen=True, eq=False)
class MoonColours:
    """matrices (K, 4, 4): C at `PHASES_DEG`."""

    matrices: np.ndarray

    @classmethod
    def of(cls, spectra: np.ndarray, channels: Channels) -> MoonColours:
        """From spectra (..., W) of an air over the sun's irradiance [sr^-1]: least squares of relative residuals."""
        spectra = spectra.reshape(-1, spectra.shape[-1])
        spectra = spectra[spectra.min(axis=-1) > DARK]
        sunlit, found = channels.of(spectra), []
        for phase in PHASES_DEG:
            moonlit = channels.of(spectra * reddening(channels.wavelength_nm, float(phase)))
            rows = [
                np.linalg.lstsq(sunlit / moonlit[:, c : c + 1], np.ones(len(sunlit)), rcond=None)[0]
                for c in range(moonlit.shape[-1])
            ]
            found.append(np.stack(rows))
        return cls(np.stack(found))

    def page_header(self, wavelength_nm: np.ndarray) -> dict[str, Any]:
        """What `web/moon.js` needs of a field: matrices by columns, and f / f(550 nm) at its wavelengths."""
        return {
            "moon_colours": self.matrices.transpose(0, 2, 1).reshape(PHASES_DEG.size, -1).tolist(),
            "moon_spectrum": [reddening(wavelength_nm, float(g)).tolist() for g in PHASES_DEG],
        }

    def moonlit(self, sunlit: np.ndarray, moon: Moon) -> np.ndarray:
        """Channels (..., 4) under the moon from those under the sun in its place at 1 au."""
        phase = np.clip(moon.phase_angle_deg, *PHASES_DEG[[0, -1]])
        k = min(int(np.searchsorted(PHASES_DEG, phase, side="right")) - 1, PHASES_DEG.size - 2)
        t = (phase - PHASES_DEG[k]) / (PHASES_DEG[k + 1] - PHASES_DEG[k])
        matrix = (1.0 - t) * self.matrices[k] + t * self.matrices[k + 1]
        return np.maximum(sunlit @ (matrix.T * moon.irradiance_factor(LEVEL_NM)[0]), 0.0)
