"""The sun's direct light at an observer."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twilight.transport.beam import Beam, beam_at, prepare_beam
from twilight.transport.ground_sun import GroundSun

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium


class Direct(NamedTuple):
    """Irradiance of the beam at normal incidence over F0 (W,), 0 in the shadow, and how far it is bent [deg]."""

    irradiance: np.ndarray
    bending_deg: float


def join_direct(parts: Sequence[Direct]) -> Direct:
    """The direct light at all wavelengths from that of each block."""
    return Direct(np.concatenate([one.irradiance for one in parts]), parts[-1].bending_deg)


class Sunbeam:
    """Direct sunlight in a medium; its tables are made for the first sun that can reach an observer.

    numpy_only: sunlight on the ground is found by quadrature in numpy, without tables and without compiled code.
    """

    DARK_BELOW_HORIZON_DEG = 2.0
    """Depth of the sun below the horizon beyond which no direct light arrives: refraction lifts the sun by 1.2 deg at
    most, down and up again (Haber 2005 sec. 4.4: below 2)."""

    def __init__(self, medium: Medium, numpy_only: bool = False):
        self.medium, self._numpy_only = medium, numpy_only

    def at(self, sun_elevation_deg: float, altitude_km: float) -> Direct:
        """The direct light of a sun at true elevation, for an observer at an altitude."""
        ground_km = self.medium.bottom_km
        out = np.zeros(self.medium.n_wavelengths)
        if not self.reaches(sun_elevation_deg, altitude_km):
            return Direct(out, 0.0)
        if self._numpy_only and altitude_km <= ground_km:
            return Direct(*self._ground.at(sun_elevation_deg))
        bending = beam_at(self.beam, float(altitude_km), np.sin(np.radians(sun_elevation_deg)), out)
        return Direct(out, float(np.degrees(bending)) if out.any() else 0.0)

    def reaches(self, sun_elevation_deg: float, altitude_km: float) -> bool:
        """Whether the sun may reach an observer at an altitude; False only where no refraction lifts it that far."""
        radius, ground_km = self.medium.earth_radius_km, self.medium.bottom_km
        dip_deg = float(np.degrees(np.arccos((radius + ground_km) / (radius + max(altitude_km, ground_km)))))
        return sun_elevation_deg >= -dip_deg - self.DARK_BELOW_HORIZON_DEG

    @cached_property
    def beam(self) -> Beam:
        """The tables themselves."""
        return prepare_beam(self.medium)

    @cached_property
    def _ground(self) -> GroundSun:
        return GroundSun(self.medium)
