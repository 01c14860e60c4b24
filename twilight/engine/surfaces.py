"""Surfaces that light falls on: planes of any tilt, spheres, vertical cylinders; their projections by direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from twilight.base.errors import TwilightError


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
