"""The usual ozone column of a place and date: van Heuklon's formula.

    U = 235 + (A + C sin(D (d + F)) + 20 sin(H (longitude + I))) sin^2(B latitude)   [DU], arguments in degrees

d is the day of the year.  Against zonal means of sondes and satellites of 1988 to 2002 (McPeters, Labow and Logan 2007)
it is off by 22 DU rms between 60 S and 60 N, by up to -40 DU at 5 to 15 N in spring and summer, and by up to +165 DU
over Antarctica from August to November: it is older than the ozone hole.

References
----------
van Heuklon 1979, Solar Energy 22, 63.  McPeters, Labow and Logan 2007, J. Geophys. Res. 112, D05308.
"""

from __future__ import annotations

import math

OLDER_THAN_THE_HOLE = "which knows no Antarctic ozone hole"

LATITUDE_OF_THE_HOLE_DEG = -58.0
"""South of it the formula is far too high in spring."""

NORTH = {"A": 150.0, "B": 1.28, "C": 40.0, "F": -30.0, "H": 3.0}
SOUTH = {"A": 100.0, "B": 1.5, "C": 30.0, "F": 152.625, "H": 2.0}
DEGREES_PER_DAY = 0.9865


def climatological_column_du(latitude_deg: float, longitude_deg: float, day_of_year: float) -> float:
    """The usual ozone column [DU]; latitude north positive, longitude east positive, day 1 to 366."""
    north = latitude_deg >= 0.0
    of = NORTH if north else SOUTH
    longitude = (longitude_deg + 180.0) % 360.0 - 180.0
    shift = (20.0 if longitude > 0.0 else 0.0) if north else -75.0
    season = of["C"] * math.sin(math.radians(DEGREES_PER_DAY * (day_of_year + of["F"])))
    wave = 20.0 * math.sin(math.radians(of["H"] * (longitude + shift)))
    return 235.0 + (of["A"] + season + wave) * math.sin(math.radians(of["B"] * latitude_deg)) ** 2


def climatology_source(latitude_deg: float, longitude_deg: float, day_of_year: float) -> str:
    """The formula, its place and its day, in words."""
    text = f"van Heuklon 1979, {latitude_deg:.4g} N {longitude_deg:.4g} E, day {day_of_year:g}"
    return f"{text}, {OLDER_THAN_THE_HOLE}" if latitude_deg < LATITUDE_OF_THE_HOLE_DEG else text
