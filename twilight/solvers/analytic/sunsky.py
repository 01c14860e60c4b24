"""Mitsuba's `sunsky` emitter as a solver: the sky of Hosek and Wilkie (2012) as a renderer has it; sun above 0 deg.

It is here to be compared with.  Its data are sampled every 40 nm from 320 to 720 nm and hold the solar spectrum; they
are divided by the mean of the solar spectrum (ASTM G173) over those 40 nm, at the same wavelengths, before both are
interpolated.  Turbidity as for `preetham`, 1 to 10; the ground's albedo counts.  The sun's own disc is left out.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.extras import missing
from twilight.base.progress import Progress
from twilight.base.sections import option, settings
from twilight.numerics import spectrum
from twilight.solvers.analytic.daylight import check_observer, check_sun, chosen_turbidity
from twilight.solvers.base import ALL_WAVELENGTHS, BareField, Capabilities

NODES_NM = np.arange(320.0, 721.0, 40.0)
"""Wavelengths of the emitter's data [nm]."""

TURBIDITY = (1.0, 10.0)
"""Lowest and highest turbidity of the emitter's data."""

CAPABILITIES = Capabilities(kind="formula", wavelengths_at_once=ALL_WAVELENGTHS, package="mitsuba")
"""All wavelengths are done at once: the turbidity is read from the medium at 550 nm."""

WAVELENGTHS_PER_CALL = 4
"""Wavelengths that one call of the emitter takes."""


@settings
class SunskySettings:
    """The turbidity of the sky."""

    turbidity: float | None = option(
        "at 550 nm; null: that of the medium", default=None, ge=TURBIDITY[0], le=TURBIDITY[1]
    )
    outside: Literal["nearest", "refuse"] = option(
        "'nearest' takes the nearest turbidity that the data cover where the medium's is not, and warns; 'refuse' "
        "does not",
        default="nearest",
    )


QUALITIES: dict[str, SunskySettings] = {"standard": SunskySettings()}


def prepare(
    medium: Medium,
    settings: SunskySettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> SunskyField:
    """The sky of this medium's turbidity; nothing is computed yet.

    Raises TwilightError where Mitsuba is not installed, for an observer high above the ground, and for wavelengths
    outside 320 to 720 nm.
    """
    return SunskyField(medium, settings or QUALITIES["standard"], observer_altitude_km)


class SunskyField(BareField):
    """The sky of one turbidity for any sun above the horizon."""

    def __init__(self, medium: Medium, settings: SunskySettings, altitude_km: float):
        try:
            import mitsuba  # optional
        except ImportError:
            raise missing("mitsuba", "the solver sunsky") from None
        check_observer(medium, altitude_km, "sunsky")
        self.medium = medium
        self.turbidity, self.medium_turbidity = chosen_turbidity(
            settings.turbidity, settings.outside, TURBIDITY, medium, "sunsky"
        )
        outside = (medium.wavelength_nm < NODES_NM[0]) | (medium.wavelength_nm > NODES_NM[-1])
        if outside.any():
            raise TwilightError(
                f"the sunsky solver has data from {NODES_NM[0]:g} to {NODES_NM[-1]:g} nm: wavelengths holds "
                f"{medium.wavelength_nm[outside][0]:g} nm"
            )
        grid, irradiance = spectrum.solar_spectrum()
        means = [irradiance[np.abs(grid - node) <= 20.0].mean() for node in NODES_NM]
        self._solar = np.interp(medium.wavelength_nm, NODES_NM, means)
        mitsuba.set_variant("scalar_spectral")
        self._mitsuba = mitsuba

    def radiance(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], shape of the directions plus (W,); angles in degrees, azimuth from the sun.

        Errors: TwilightError for a sun below the horizon and for directions below it.
        """
        check_sun(sun_elevation_deg, "sunsky")
        elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        if np.any(elevation < 0.0):
            raise TwilightError("the sunsky solver has no ground: elevations must not be below 0 deg")
        e, a = np.radians(elevation.ravel()), np.radians(azimuth.ravel())
        view = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)
        sun = np.radians(max(sun_elevation_deg, 0.0))
        nm = self.medium.wavelength_nm
        out = np.empty((e.size, nm.size))
        emitter = self._emitter(sun)
        surface = self._mitsuba.SurfaceInteraction3f()
        for first in range(0, nm.size, WAVELENGTHS_PER_CALL):
            part = np.minimum(np.arange(first, first + WAVELENGTHS_PER_CALL), nm.size - 1)
            surface.wavelengths = nm[part].tolist()
            for d, direction in enumerate((-view).tolist()):
                surface.wi = direction
                out[d, part] = emitter.eval(surface)
        out /= self._solar
        # a sun below 2 deg: the fit is negative by up to 2 % of its brightest blue at the horizon, far from the sun
        np.maximum(out, 0.0, out=out)
        return out.reshape(*elevation.shape, nm.size)

    def _emitter(self, sun_elevation_rad: float):
        albedo = float(np.interp(550.0, self.medium.wavelength_nm, self.medium.ground_albedo))
        return self._mitsuba.load_dict(
            {
                "type": "sunsky",
                "turbidity": self.turbidity,
                "albedo": {"type": "spectrum", "value": albedo},
                "sun_direction": [float(np.cos(sun_elevation_rad)), 0.0, float(np.sin(sun_elevation_rad))],
                "sun_scale": 0.0,
            }
        )
