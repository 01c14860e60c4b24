"""Methods of `Field` that give quantities: of directions, and of level ground."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.arguments import in_units
from twilight.numerics.directions import hemisphere
from twilight.sky.quantities.measure import Quantity, Spectra, check_covered, check_of, quantity
from twilight.sky.quantities.responses import ResponseLike

if TYPE_CHECKING:
    from twilight.atmosphere.medium import Medium


@in_units
class FieldLight:
    """The measures of a field: what each method needs of it is declared below."""

    if TYPE_CHECKING:
        blocks: tuple[Any, ...]

        @property
        def scene(self) -> Any: ...
        @property
        def medium(self) -> Medium: ...
        @property
        def solar_spectrum(self) -> str: ...
        def radiance(self, *question: Any, **more: Any) -> np.ndarray: ...

    def measure(
        self,
        name: str | Quantity,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike | None = None,
        azimuth_deg: ArrayLike = 0.0,
        *,
        direct: bool = False,
        distance_au: float = 1.0,
        observer_altitude_km: float | None = None,
    ) -> np.ndarray:
        """Any quantity of directions, or of level ground, without the night.

        Parameters
        ----------
        name
            As of `Sky.measure`.
        sun_elevation_deg
            True elevation of the sun [deg].
        elevation_deg, azimuth_deg
            Of the lines of sight [deg], azimuth from the sun; None: level ground under the whole sky.
        direct
            Whether the sun's own disc shines on the ground too.
        distance_au
            Earth to sun [au].
        observer_altitude_km
            Above sea level [km]; None: the scene's observer.

        Returns
        -------
        numpy.ndarray
            In the quantity's unit, the shape of the directions; of level ground a number.

        Raises
        ------
        TwilightError
            For a name that is none, and wavelengths that do not cover it.
        """
        asked = quantity(name)
        check_of(asked, "surface" if elevation_deg is None else "direction")
        for curve in asked.responses():
            check_covered(curve, self.medium.wavelength_nm, "the field")
        if elevation_deg is None:
            factor = self.horizontal_irradiance(sun_elevation_deg, direct, observer_altitude_km)
        else:
            factor = self.radiance(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km)
        return asked.value(self._spectra(factor, distance_au))

    def magnitude(
        self,
        band: ResponseLike,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike = 90.0,
        azimuth_deg: ArrayLike = 0.0,
        system: str | None = None,
    ) -> np.ndarray:
        """Surface brightness [mag arcsec^-2]; band and system as of `Sky.magnitude`, the rest as of `measure`."""
        factor = self.radiance(sun_elevation_deg, elevation_deg, azimuth_deg)
        return self._spectra(factor).magnitude(band, system)

    def radiance_in(
        self,
        response: ResponseLike,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike = 90.0,
        azimuth_deg: ArrayLike = 0.0,
    ) -> np.ndarray:
        """Radiance within a response [W m^-2 sr^-1], as `Sky.radiance_in`."""
        factor = self.radiance(sun_elevation_deg, elevation_deg, azimuth_deg)
        return self._spectra(factor).within(response)

    def _spectra(self, factor: np.ndarray, distance_au: float = 1.0) -> Spectra:
        return Spectra(factor, self.medium.wavelength_nm, self.solar_spectrum, distance_au, "the field")

    def illuminance_lux(self, sun_elevation_deg: float, direct: bool = False) -> float:
        """Illuminance of level ground by the sky [lx]; direct: with the sun's disc."""
        return float(self.measure("illuminance", sun_elevation_deg, direct=direct))

    def horizontal_irradiance(
        self, sun_elevation_deg: float, direct: bool = False, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """Irradiance of level ground over F0, (W,); direct: with the sun's disc, each strip of it refracted."""
        elevation, azimuth, weight = hemisphere(sun_elevation_deg)
        out = weight @ self.radiance(sun_elevation_deg, elevation, azimuth, observer_altitude_km)
        return out + self.disc_irradiance(sun_elevation_deg, observer_altitude_km) if direct else out

    def disc_irradiance(self, sun_elevation_deg: float, observer_altitude_km: float | None = None) -> np.ndarray:
        """Irradiance of level ground by the sun's disc over F0, (W,)."""
        altitude = self.scene.altitude_km if observer_altitude_km is None else observer_altitude_km
        each = [block.disc_irradiance(sun_elevation_deg, altitude) for block in self.blocks]
        return np.concatenate(each)
