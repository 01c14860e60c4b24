"""Danjon's number of a total eclipse of the moon, estimated from the luminance of its disc.

Danjon (1921, L'Astronomie 35, 261) tells five degrees by what the naked eye makes of colour: none on a moon that is
almost invisible (0), grey or brownish (1), deep red (2), brick-red (3), bright copper or orange (4).  No published
relation to a photometric quantity is used, as none was found.  Here the degrees are spread evenly over the logarithm
of the luminance between the limits of mesopic vision (CIE 191:2010), below which an eye sees no colour and above which
it sees all of it.  Observers of one eclipse differ by one degree and more.
"""

from __future__ import annotations

import numpy as np

from twilight.sky.eye_limit import MAGNITUDE_0_LUX
from twilight.sky.tone.eye import DAY_CD_PER_M2, NIGHT_CD_PER_M2
from twilight.studies.eclipse.circumstances import MOON_RADIUS_KM

DESCRIPTIONS = ("almost invisible", "grey or brownish", "deep red", "brick-red", "bright copper or orange")
"""Of the moon in mid-eclipse, by the degree."""


def luminance(magnitude: float, distance_km: float) -> float:
    """Mean luminance [cd m^-2] of the moon's disc of a visual magnitude at a distance [km]."""
    solid_angle = np.pi * (MOON_RADIUS_KM / distance_km) ** 2
    return float(MAGNITUDE_0_LUX * 10.0 ** (-0.4 * magnitude) / solid_angle)


def danjon_number(luminance_cd_per_m2: float) -> float:
    """0 to 4 of the luminance [cd m^-2] of the moon's disc in the middle of a total eclipse."""
    decades = np.log10(DAY_CD_PER_M2 / NIGHT_CD_PER_M2)
    return float(np.clip(4.0 * np.log10(luminance_cd_per_m2 / NIGHT_CD_PER_M2) / decades, 0.0, 4.0))


def description(number: float) -> str:
    """Danjon's words for the nearest degree."""
    return DESCRIPTIONS[round(number)]
