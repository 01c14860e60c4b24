"""The air of a scene with a little more of what its medium does not hold by itself: for derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twilight.atmosphere.layer_changes import Shifted
from twilight.base.errors import TwilightError
from twilight.config.profile import air_profile
from twilight.scene.medium import built_medium
from twilight.scene.plan import make_plan
from twilight.scene.scene import Scene

KELVIN = 0.5
"""Change of temperature [K]: the air's density is in proportion to 1/T, and its slope half a step away off by 0.1 %."""
DOBSON = 1.0
"""Change of the ozone column [DU]."""


def shifted(scene: Scene, quantity: str, wavelength_nm: np.ndarray) -> Shifted | None:
    """The medium of a scene at wavelengths (W,) [nm] with more of a quantity everywhere.

    temperature: KELVIN warmer.  At every altitude the pressure stays, and the number densities of ozone, nitrogen
    dioxide and aerosol; the number density of air, and of the water vapour in it, goes as 1/T, and with it scattering,
    refractivity and pairs of oxygen; absorption cross sections are those of the temperature.  The ozone of an overhead
    filter is at no altitude, and stays.
    ozone_column: DOBSON more, in proportion at all altitudes.  Any other quantity is in the medium itself: None.

    Errors: TwilightError for a medium that has no temperatures, or no ozone.
    """
    if quantity not in ("temperature", "ozone_column"):
        return None
    climate = make_plan(scene.configuration, wavelength_nm).climate
    if climate.medium is not None:
        raise TwilightError(f"derivatives by {quantity}: a medium that is a table knows its coefficients alone")
    if quantity == "temperature":
        air = air_profile(climate)
        thinner = air.temperature_k / (air.temperature_k + KELVIN)
        warmer = replace(
            air,
            temperature_k=air.temperature_k + KELVIN,
            air_per_cm3=air.air_per_cm3 * thinner,
            h2o_per_cm3=air.h2o_per_cm3 * thinner,
        )
        return Shifted(_like(scene, built_medium(climate, wavelength_nm, warmer)), KELVIN)
    if climate.gases.ozone.treatment == "none":
        raise TwilightError("derivatives by ozone_column: gases.ozone.treatment is none, and there is no ozone")
    column = scene.medium.notes["ozone_column_du"] + DOBSON
    more = climate.gases.ozone.model_copy(update={"column_du": column, "day_of_year": None})
    gases = climate.gases.model_copy(update={"ozone": more})
    made = built_medium(climate.model_copy(update={"gases": gases}), wavelength_nm)
    return Shifted(_like(scene, made), DOBSON)


def _like(scene: Scene, made):
    """The medium over the scene's ground and behind its screen."""
    albedo = np.interp(made.wavelength_nm, scene.medium.wavelength_nm, scene.medium.ground_albedo)
    return replace(made, ground_albedo=albedo, screen=scene.medium.screen)
