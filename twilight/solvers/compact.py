"""The solver compact: skies from a model of all clear air in one file (`clear_air`), without compiled code."""

from __future__ import annotations

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.base.sections import option, settings
from twilight.clear_air.entry import ClearAir, checked_observer, skies
from twilight.clear_air.model import NUMBER, SUN_DEG
from twilight.solvers.base import BareField, Capabilities, Cost, ModelError


@settings
class CompactSettings:
    """What is computed beside the radiance."""

    polarisation: bool = option("the Stokes parameters Q and U too", default=True)


QUALITIES: dict[str, CompactSettings] = {"standard": CompactSettings()}


COST = Cost(fixed_bytes=1.75e8, bytes_per_wavelength=4.3e6, cpu_s_per_wavelength=0.022, cpu_s_per_direction=2.5e-5)
"""Of a field: the process takes 165 MiB with one wavelength, 325 with forty, and eight of a new air 0.17 processor
seconds; a direction and wavelength 25 microseconds in a sky of some hundred, which compute the sunbeam anew."""


def prepare(
    medium: Medium,
    settings: CompactSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> Field:
    """The skies of a medium.  Errors: TwilightError for an observer, air or wavelengths that the model lacks."""
    return Field(ClearAir(medium), observer_altitude_km, (settings or QUALITIES["standard"]).polarisation)


def expected_error(
    medium: Medium, settings: CompactSettings, lowest_sun_deg: float, observer_altitude_km: float
) -> float:
    """What the model says of its error [fraction, 95 % of directions] under a sun, -inf: its lowest.

    Errors: TwilightError as of `prepare`, and for a sun below -18 deg.
    """
    sun = float(SUN_DEG[0]) if np.isneginf(lowest_sun_deg) else lowest_sun_deg
    return float(skies([medium], [sun], 90.0, 0.0, [observer_altitude_km]).relative_error[0, 0, 0])


CAPABILITIES = Capabilities(
    kind="fitted",
    every_sun=True,
    every_observer=True,
    looks_down=False,
    screen=True,
    cost=lambda medium, settings, suns, altitude_km: COST,
    expected_error=expected_error,
)


class Field(BareField):
    """The skies of one air for any sun from -18 to 90 deg and observers up to 15 km above the ground.

    convergence: its error is what the model says of the sky that was asked for last.
    """

    def __init__(self, air: ClearAir, observer_altitude_km: float, polarisation: bool):
        self.air, self.medium, self._polarised = air, air.medium, polarisation
        self._altitude_km = checked_observer(self.medium, observer_altitude_km)
        self.facts = {"clear_air_model": NUMBER}

    @property
    def polarised(self) -> bool:
        """Whether Q and U were asked for."""
        return self._polarised

    @property
    def sun_range_deg(self) -> tuple[float, float]:
        """Lowest and highest sun elevation of the model [deg]."""
        return float(SUN_DEG[0]), float(SUN_DEG[-1])

    def radiance(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], shape of the directions plus (W,); angles in degrees, azimuth from the sun.
        Errors: as of `clear_air.entry.skies`."""
        return self._light(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km)

    def stokes(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """Sun-normalised Stokes parameters I, Q, U [sr^-1], shape of the directions plus (3, W); signs and errors as of
        `twilight.base.conventions` and `radiance`."""
        if not self._polarised:
            raise TwilightError("solver.polarisation is false: this field has no Stokes parameters")
        return self._light(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km, True)

    def _light(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, altitude_km, polarisation=False
    ) -> np.ndarray:
        altitude = self._altitude_km if altitude_km is None else altitude_km
        found = skies([self.air], [sun_elevation_deg], elevation_deg, azimuth_deg, [altitude], polarisation)
        self.convergence = ModelError(float(found.relative_error[0, 0, 0]))
        return found.radiance[0, 0, 0]
