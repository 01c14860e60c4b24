"""Methods of `Sky` that give quantities: magnitudes, luminance, illuminance and others."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.sky.quantities.measure import MAX_UNCOVERED, Spectra, check_covered, check_of, quantity, uncovered
from twilight.sky.quantities.responses import response

ILLUMINANCES = ("photopic", "scotopic", "s_cone_opic", "m_cone_opic", "l_cone_opic", "rhodopic", "melanopic")
"""Eyes and receptors of `illuminance_lux`."""


class SkyLight:
    """The measures of a sky: what each method needs of it is declared below."""

    if TYPE_CHECKING:
        wavelength_nm: np.ndarray
        solar_spectrum: str
        distance_au: float

        @property
        def normalised_radiance(self) -> np.ndarray: ...
        def sample(self, elevation_deg: ArrayLike, azimuth_deg: ArrayLike) -> np.ndarray: ...
        def irradiance_factor(self, horizontal: bool = True, direct: bool = False) -> np.ndarray: ...

    def _spectra(self, factor: np.ndarray) -> Spectra:
        return Spectra(factor, self.wavelength_nm, self.solar_spectrum, self.distance_au)

    def _luminous(self, factor: np.ndarray) -> np.ndarray:
        """683 lm/W times the integral of factor x solar spectrum x V(lambda), for factors (..., W) of any coverage."""
        return luminance(factor, self.wavelength_nm, self.solar_spectrum, self.distance_au)

    def luminance(self) -> np.ndarray:
        """Luminance [cd m^-2], (E, A): V(lambda) of the 2 deg observer, integrated at 1 nm."""
        return self._luminous(self.normalised_radiance)

    def luminance_at(self, elevation_deg: ArrayLike = 90.0, azimuth_deg: ArrayLike = 0.0) -> Any:
        """Luminance [cd m^-2] in one direction or several; azimuth relative to the sun [deg]."""
        return _number(self._luminous(self.sample(elevation_deg, azimuth_deg)))

    def magnitude(
        self,
        band: Any = "V",
        elevation_deg: ArrayLike = 90.0,
        azimuth_deg: ArrayLike = 0.0,
        system: str | None = None,
    ) -> Any:
        """Surface brightness in one direction or several, by default of the zenith.

        Parameters
        ----------
        band
            One of `twilight.sky.quantities.responses.names` (U, B, V, R, I; u, g, r, i, z; gaia-G ...; SQM), one of
            speclite's, a CSV file of wavelength [nm] and response to energy, two arrays of the same, or a `Response`.
        elevation_deg, azimuth_deg
            Of the line of sight, broadcast; azimuth relative to the sun [deg].
        system
            AB or Vega; None: AB for ugrizy and others, Vega for Johnson-Cousins, Gaia and SQM.

        Returns
        -------
        float or numpy.ndarray
            [mag arcsec^-2], the shape of the directions; infinite without light.

        Raises
        ------
        TwilightError
            For a band that is not known, or that the sky's wavelengths do not cover.
        """
        return _number(self._spectra(self.sample(elevation_deg, azimuth_deg)).magnitude(band, system))

    def covers(self, band: Any) -> bool:
        """Whether the wavelengths cover a response, so that there is a `magnitude` in it."""
        return uncovered(response(band), self.wavelength_nm) <= MAX_UNCOVERED

    def radiance_in(self, response: Any, elevation_deg: ArrayLike = 90.0, azimuth_deg: ArrayLike = 0.0) -> Any:
        """Radiance within a response, integral of L R over wavelength [W m^-2 sr^-1]; arguments as `magnitude`."""
        return _number(self._spectra(self.sample(elevation_deg, azimuth_deg)).within(response))

    def illuminance_lux(self, horizontal: bool = True, direct: bool = False, eye: str = "photopic") -> float:
        """Illuminance from the upper hemisphere.

        Parameters
        ----------
        horizontal, direct
            As of `irradiance_factor`.
        eye
            photopic; scotopic (CIE 1951); or a receptor of CIE S 026, whose equivalent daylight (D65) illuminance it
            then is: melanopic, rhodopic, s_cone_opic, m_cone_opic, l_cone_opic.

        Returns
        -------
        float
            [lx]

        Raises
        ------
        TwilightError
            For another eye, and where wavelengths do not cover one that is not photopic.
        """
        factor = self.irradiance_factor(horizontal, direct)
        if eye == "photopic":
            return float(self._luminous(factor))
        if eye not in ILLUMINANCES:
            raise TwilightError(f"illuminance_lux: the eye '{eye}' is not known; {', '.join(ILLUMINANCES)} are")
        light = self._spectra(factor)
        return float(light.scotopic() if eye == "scotopic" else light.alpha_opic_edi(eye))

    def measure(
        self,
        name: str,
        elevation_deg: ArrayLike | None = None,
        azimuth_deg: ArrayLike = 0.0,
        *,
        horizontal: bool = True,
        direct: bool = False,
    ) -> Any:
        """Any quantity, of a direction where an elevation is given, else of a horizontal plane or a sphere.

        Parameters
        ----------
        name
            One of `twilight.sky.quantities.measure.QUANTITIES` (mesopic_luminance, ppfd, uv_index, cct, duv ...),
            `in:RESPONSE`, `photons:RESPONSE`, or a band.
        elevation_deg, azimuth_deg
            Of the line of sight [deg]; azimuth relative to the sun.
        horizontal, direct
            As of `irradiance_factor`.

        Returns
        -------
        float or numpy.ndarray
            In the unit that the quantity has.

        Raises
        ------
        TwilightError
            For a name that is none, a quantity that a direction or a plane does not have, and wavelengths that do not
            cover it.
        """
        asked = quantity(name)
        check_of(asked, "surface" if elevation_deg is None else "direction")
        for curve in asked.responses():
            check_covered(curve, self.wavelength_nm)
        if elevation_deg is None:
            return _number(asked.value(self._spectra(self.irradiance_factor(horizontal, direct))))
        return _number(asked.value(self._spectra(self.sample(elevation_deg, azimuth_deg))))


def luminance(factor: np.ndarray, wavelength_nm: np.ndarray, solar_spectrum: str, distance_au: float) -> np.ndarray:
    """Luminance [cd m^-2] of radiances over F0, (..., W): V(lambda) of the 2 deg observer, integrated at 1 nm."""
    sun = spectrum.solar_at_visible(solar_spectrum, distance_au)
    weight = spectrum.LUMINOUS_EFFICACY_LM_PER_W * sun * spectrum.colour_matching_functions("cie1931_2deg")[:, 1]
    return spectrum.integrate(factor, wavelength_nm, weight)


def _number(value: np.ndarray) -> Any:
    return float(value) if np.ndim(value) == 0 else np.asarray(value)
