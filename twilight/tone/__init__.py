"""From light to a picture: `plain` curves of luminance and colour, `eye` as a person sees it, `camera` as one takes it.

A film says what it measures of a spectrum (``see``, a linear functional with K channels, the second of them luminance
[cd m^-2]) and makes a picture of a field of these (``develop``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from twilight import colour, spectrum

NAMES = (*colour.TONE_MAPPINGS, "eye", "camera")


@dataclass(frozen=True)
class Light:
    """What multiplies sun-normalised spectra: the solar spectrum, by name, and the distance to the sun [au]."""

    solar_spectrum: str
    distance_au: float


@dataclass(frozen=True)
class Shot:
    """What a picture is of: its exposure value at ISO 100 by the meter (or by hand), and the size of a pixel [deg]."""

    ev100: float
    pixel_deg: float


class Film(Protocol):
    """How light becomes a picture."""

    def see(self, factor: np.ndarray, wavelength_nm: np.ndarray, light: Light) -> np.ndarray:
        """Channels (..., K) of sun-normalised spectra (..., W); the second is luminance [cd m^-2]."""
        ...

    def develop(self, seen: np.ndarray, shot: Shot) -> tuple[np.ndarray, dict[str, float | str]]:
        """Display values 0..1 (height, width, 3) of a field of channels, and what was set or found, by name."""
        ...


@dataclass(frozen=True)
class Plain:
    """The curves of ``colour.tone_map``."""

    tone_mapping: str = colour.DEFAULT_TONE_MAPPING
    observer: str = colour.DEFAULT_OBSERVER

    def see(self, factor: np.ndarray, wavelength_nm: np.ndarray, light: Light) -> np.ndarray:
        return colour.factor_to_xyz(factor, wavelength_nm, light.solar_spectrum, light.distance_au, self.observer)

    def develop(self, seen: np.ndarray, shot: Shot) -> tuple[np.ndarray, dict[str, float | str]]:
        return colour.tone_map(colour.xyz_to_linear_rgb(seen), shot.ev100, self.tone_mapping), {}


def film_of(name: str, observer: str, settings: Mapping[str, Mapping[str, Any]] | None = None) -> Film:
    """The film of a tone's name; settings: of ``eye`` and ``camera``, as the sections of a configuration have them."""
    from twilight.errors import TwilightError

    given = dict((settings or {}).get(name) or {})
    if name == "eye":
        from twilight.tone.eye import Eye

        return Eye(observer=observer, **given)
    if name == "camera":
        from twilight.tone.camera import Camera

        return Camera(**given)
    if name not in NAMES:
        raise TwilightError(f"tone_mapping: '{name}' is not known, choose one of {', '.join(NAMES)}")
    return Plain(name, observer)


def to_display(linear: np.ndarray) -> np.ndarray:
    """Linear RGB, 1 = white, to display values: into the gamut, the curve of a photograph, the sRGB encoding."""
    return colour.srgb_encode(colour.photographic(colour.into_gamut(linear)))


def weights_at_1nm(light: Light) -> np.ndarray:
    """Solar irradiance [W m^-2 nm^-1] at ``spectrum.VISIBLE_NM``, (471,)."""
    return spectrum.solar_at_visible(light.solar_spectrum, light.distance_au)
