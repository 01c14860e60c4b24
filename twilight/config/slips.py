"""Values that are allowed and almost surely a slip: a fraction meant as per cent, metres meant as kilometres."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

from twilight.base.errors import TwilightWarning
from twilight.config.scene import Config

LOWEST_OZONE_DU = 70.0
"""NASA Ozone Watch has 73 DU as the lowest column measured (30 September 1994)."""
HIGHEST_CLOSE_VIEW_KM = 100.0
"""Altitude [km] from which a picture of the upper hemisphere alone is dark: the Karman line."""
LARGEST_USUAL_DEPTH = 5.0
"""Vertical optical depth at 550 nm above which a slip is likelier than a dust storm."""
LOWEST_CO2_PPM = 100.0
"""Least carbon dioxide that is no slip [ppm]: the last 800 000 years had 172 and more (Luethi et al. 2008)."""


def warn_of_slips(config: Config) -> None:
    """A TwilightWarning for each value of a configuration that is almost surely a slip."""
    for sentence in slips(config):
        warnings.warn(sentence, TwilightWarning, stacklevel=3)


def slips(config: Config) -> Iterator[str]:
    """One sentence for each, with the key, its unit and what was perhaps meant."""
    climate = config.climate
    if climate.aerosol is not None:
        humidity = climate.aerosol.relative_humidity_percent
        if 0.0 < humidity <= 1.0:
            meant = f"{100 * humidity:g} is {100 * humidity:g} %"
            yield f"aerosol.relative_humidity_percent is {humidity:g} %, drier than any desert; {meant}"
        depth = climate.aerosol.optical_depth_550nm
        if depth is not None and depth > LARGEST_USUAL_DEPTH:
            yield f"aerosol.optical_depth_550nm is {depth:g}, more than all but the densest smoke and dust"
    column = climate.gases.ozone.column_du
    if column is not None and 0.0 < column < LOWEST_OZONE_DU:
        meant = f"{column:g} mm of ozone are {100 * column:g} DU"
        yield f"gases.ozone.column_du is {column:g} DU, less than has ever been measured; {meant}"
    carbon_dioxide = climate.refraction.co2_ppm
    if 0.0 < carbon_dioxide < LOWEST_CO2_PPM:
        yield f"refraction.co2_ppm is {carbon_dioxide:g} ppm; the air has 420"
    altitude = config.observer.altitude_km
    if altitude >= HIGHEST_CLOSE_VIEW_KM and config.observer.view is None:
        yield f"observer.altitude_km is {altitude:g} km, above the air; {altitude:g} m are {altitude / 1000:g} km"
