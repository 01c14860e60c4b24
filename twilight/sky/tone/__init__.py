"""From light to a picture: curves of luminance and colour, `eye` as a person sees it, `camera` as one takes it.

A tone says what it measures of a spectrum (``see``, a linear functional with K channels, the second of them luminance
[cd m^-2]) and makes a picture of a field of these (``develop``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.sky import colour

NAMES = (*colour.TONE_MAPPINGS, "eye", "camera")


@dataclass(frozen=True)
class Light:
    """What multiplies sun-normalised spectra: the solar spectrum, by name, and the distance to the sun [au]."""

    solar_spectrum: str
    distance_au: float


@dataclass(frozen=True)
class Shot:
    """What a picture is of: its exposure value at ISO 100 by the meter (or by hand), the size of a pixel [deg], and its
    number in a film, whose pictures have different noise."""

    ev100: float
    pixel_deg: float
    number: int = 0


class Tone(Protocol):
    """How light becomes a picture.

    highlights_over_mean: how far over the log-mean of a picture the meter lets its highlights go.
    """

    highlights_over_mean: ClassVar[float]

    def see(self, factor: np.ndarray, wavelength_nm: np.ndarray, light: Light) -> np.ndarray:
        """Channels (..., K) of sun-normalised spectra (..., W); the second is luminance [cd m^-2]."""
        ...

    def develop(self, seen: np.ndarray, shot: Shot) -> tuple[np.ndarray, dict[str, float | str]]:
        """Display values 0..1 (height, width, 3) of a field of channels, and what was set or found, by name."""
        ...


@dataclass(frozen=True)
class CurveTone:
    """The curves of ``colour.tone_map``."""

    highlights_over_mean: ClassVar[float] = colour.HIGHLIGHTS_OVER_MEAN
    tone_mapping: str = colour.DEFAULT_TONE_MAPPING
    observer: str = colour.DEFAULT_OBSERVER

    def see(self, factor: np.ndarray, wavelength_nm: np.ndarray, light: Light) -> np.ndarray:
        return colour.factor_to_xyz(factor, wavelength_nm, light.solar_spectrum, light.distance_au, self.observer)

    def develop(self, seen: np.ndarray, shot: Shot) -> tuple[np.ndarray, dict[str, float | str]]:
        return colour.tone_map(colour.xyz_to_linear_rgb(seen[..., :3]), shot.ev100, self.tone_mapping), {}


def tone_of(name: str, observer: str, settings: Mapping[str, Mapping[str, Any]] | None = None) -> Tone:
    """The tone of a name; settings: of ``eye`` and ``camera``, as the sections of a configuration have them."""
    given = dict((settings or {}).get(name) or {})
    if name == "eye":
        from twilight.sky.tone.eye import Eye  # start-up

        return Eye(observer=observer, **given)
    if name == "camera":
        from twilight.sky.tone.camera import Camera  # start-up

        return Camera(**given)
    if name not in NAMES:
        raise TwilightError(f"tone_mapping: '{name}' is not known, choose one of {', '.join(NAMES)}")
    return CurveTone(name, observer)


def to_display(linear: np.ndarray, white: float = np.inf) -> np.ndarray:
    """Linear RGB to display values 0..1: into the gamut, ``colour.photographic`` with its white, sRGB encoding."""
    return colour.srgb_encode(colour.photographic(colour.into_gamut(linear), white))


def weights_at_1nm(light: Light) -> np.ndarray:
    """Solar irradiance [W m^-2 nm^-1] at ``spectrum.VISIBLE_NM``, (471,)."""
    return spectrum.solar_at_visible(light.solar_spectrum, light.distance_au)
