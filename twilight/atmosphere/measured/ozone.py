"""The usual ozone column of a latitude and day: zonal means of sondes and satellites.

Linear in latitude between bands of 10 deg and in time between the middles of the months, constant poleward of 85 deg.
On one day the column stands off the mean by 20 to 40 DU (the weather of the stratosphere) and, in the north, by up to
20 DU with longitude.

References
----------
McPeters, Labow and Logan 2007, J. Geophys. Res. 112, D05308.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from twilight.base.shipped_data import data_numbers

MIDDLE_OF_MONTH = np.array([16.0, 45.0, 75.0, 105.5, 136.0, 166.5, 197.0, 228.0, 258.5, 289.0, 319.5, 350.0])
"""Day of the year."""

DAYS = 365.25


@lru_cache(maxsize=1)
def _table() -> tuple[np.ndarray, np.ndarray]:
    names, rows = data_numbers("gases/ozone_columns_mcpeters2007.csv")
    return np.array([float(name) for name in names[1:]]), rows[:, 1:]


def climatological_column_du(latitude_deg: float, day_of_year: float) -> float:
    """The usual ozone column [DU]; latitude north positive, day 1 to 366."""
    latitude, months = _table()
    at_latitude = np.array([np.interp(latitude_deg, latitude, row) for row in months])
    return float(np.interp(day_of_year, MIDDLE_OF_MONTH, at_latitude, period=DAYS))


def climatology_source(latitude_deg: float, day_of_year: float) -> str:
    """The climatology, its latitude and its day, in words."""
    return f"zonal mean (McPeters, Labow and Logan 2007), {latitude_deg:.4g} N, day {day_of_year:g}"
