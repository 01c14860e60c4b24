"""Directions and surfaces that light falls on, as numbers and as text."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twilight.base.arguments import in_units
from twilight.base.errors import TwilightError

GRAMMAR = (
    "zenith, ELEVATION/AZIMUTH of a direction (azimuth from north, or sun, sun+90 ...), horizontal, "
    "plane:TILT/AZIMUTH, sphere or cylinder"
)
"""What may be asked for, for errors and help."""
_ANGLES = re.compile(r"(?P<height>[-+]?\d+(?:\.\d+)?)/(?P<sun>sun)?(?P<azimuth>[-+]?\d+(?:\.\d+)?)?")
"""Elevation of a direction or tilt of a plane, and azimuth; in lower case."""


@in_units
@dataclass(frozen=True)
class Surface:
    """A surface.

    kind: plane; sphere, whose light is the fluence (actinic flux), the integral of the radiance over all directions;
    cylinder: the mean of all vertical planes.
    tilt_deg: of a plane, 0 level and facing up, 90 vertical, 180 facing down; azimuth_deg: of the plane's normal, from
    north, or from the sun where from_sun is true.
    """

    kind: Literal["plane", "sphere", "cylinder"] = "plane"
    tilt_deg: float = 0.0
    azimuth_deg: float = 0.0
    from_sun: bool = False

    def __post_init__(self) -> None:
        if self.kind not in ("plane", "sphere", "cylinder"):
            raise TwilightError(f"surface: '{self.kind}' is not known; plane, sphere and cylinder are")
        if not (0.0 <= self.tilt_deg <= 180.0 and np.isfinite(self.azimuth_deg)):
            raise TwilightError(f"surface: tilt_deg is {self.tilt_deg:g}; allowed is 0 (level) to 180 (facing down)")

    @staticmethod
    def horizontal() -> Surface:
        """Level, facing up."""
        return Surface()

    def view(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, sun_azimuth_deg: np.ndarray) -> np.ndarray:
        """Irradiance over the radiance and solid angle of directions (N, D), azimuths from north, (N, D).

        plane: max(0, cosine of the angle to its normal); sphere: 1; cylinder: cos(elevation) / pi.
        """
        e = np.radians(elevation_deg)
        if self.kind == "sphere":
            return np.ones_like(e)
        if self.kind == "cylinder":
            return np.cos(e) / np.pi
        tilt = np.radians(self.tilt_deg)
        normal = self.azimuth_deg + (sun_azimuth_deg[:, None] if self.from_sun else 0.0)
        cosine = np.sin(e) * np.cos(tilt) + np.cos(e) * np.sin(tilt) * np.cos(np.radians(azimuth_deg - normal))
        return np.maximum(cosine, 0.0)

    @property
    def ground_view(self) -> float:
        """Irradiance by ground of radiance 1 that fills the lower hemisphere [sr]."""
        if self.kind == "sphere":
            return 2.0 * np.pi
        if self.kind == "cylinder":
            return 0.5 * np.pi
        return 0.5 * np.pi * (1.0 - float(np.cos(np.radians(self.tilt_deg))))

    @property
    def sky_view(self) -> float:
        """Irradiance by a sky of radiance 1 all over [sr]."""
        if self.kind == "plane":
            return np.pi - self.ground_view
        return self.ground_view

    @property
    def turns(self) -> bool:
        """Whether it matters where its normal points to."""
        return self.kind == "plane" and 0.0 < self.tilt_deg < 180.0


@in_units
@dataclass(frozen=True)
class Direction:
    """A line of sight: elevation_deg 0 to 90; azimuth_deg from north, or from the sun where from_sun is true."""

    elevation_deg: float
    azimuth_deg: float = 0.0
    from_sun: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.elevation_deg <= 90.0:
            raise TwilightError(f"direction: elevation_deg is {self.elevation_deg:g}; allowed is 0 to 90")


def towards(text: str) -> Direction | Surface:
    """The direction or the surface of a text; TwilightError for one that is neither."""
    word = text.strip().lower()
    if word == "zenith":
        return Direction(90.0)
    if word == "horizontal":
        return Surface.horizontal()
    if word in ("sphere", "cylinder"):
        return Surface(word)  # type: ignore[arg-type]
    kind, colon, angles = word.partition(":")
    match = _ANGLES.fullmatch(angles if colon and kind == "plane" else word)
    if match is None or not (match["sun"] or match["azimuth"]):
        raise TwilightError(f"towards: '{text}' is none of {GRAMMAR}")
    angles_of = float(match["height"]), float(match["azimuth"] or 0.0), bool(match["sun"])
    return Surface("plane", *angles_of) if colon else Direction(*angles_of)
