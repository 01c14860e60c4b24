"""Eclipses of the moon: where the moon stands in the shadow of the Earth, and when it meets its edges.

The axis of the shadow is the line from the sun, as its light arrives (with aberration), through the Earth's centre.
The moon by ERFA's `moon98` (10 arcsec, or 20 s of time).  Contacts are those of almanacs: with the moon's parallax
pi_m, the sun's pi_s and its radius s, the radii of umbra and penumbra as seen from the Earth's centre are
1.01 pi_m + pi_s -+ s, the parallax enlarged by a hundredth for the air (Danjon 1951).
"""

from __future__ import annotations

import datetime as dt
from typing import NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.sky.bodies import AU_KM, Sites

EARTH_RADIUS_KM = 6378.137
"""Equatorial radius of the Earth [km] (WGS 84)."""
SUN_RADIUS_KM = 695_700.0
"""Nominal radius of the sun [km] (IAU 2015)."""
MOON_RADIUS_KM = 1737.4
"""Mean radius of the moon [km] (IAU 2015)."""
DANJON = 1.01
"""Factor on the moon's parallax."""
FIND_HOURS = 26.0
"""Time before and after a date's noon within which an eclipse is found [h]."""
STEP_S = 60.0
"""Time between the moments at which the moon's position is computed [s]."""


class MoonPositions(NamedTuple):
    """The moon at T moments: offset_rad (T,), angle at the Earth's centre between the moon and the shadow's axis;
    distance_km (T,); sun_distance_km (T,); position_rad (T,): position angle of the moon about the axis, from celestial
    north to the east."""

    offset_rad: np.ndarray
    distance_km: np.ndarray
    sun_distance_km: np.ndarray
    position_rad: np.ndarray

    @property
    def umbra_rad(self) -> np.ndarray:
        """Radius of the umbra at the moon, (T,)."""
        return self._edge(-1.0)

    @property
    def penumbra_rad(self) -> np.ndarray:
        """Radius of the penumbra at the moon, (T,)."""
        return self._edge(1.0)

    def _edge(self, sign: float) -> np.ndarray:
        parallax = np.arcsin(EARTH_RADIUS_KM / self.distance_km)
        of_sun = np.arcsin(EARTH_RADIUS_KM / self.sun_distance_km)
        return DANJON * parallax + of_sun + sign * np.arcsin(SUN_RADIUS_KM / self.sun_distance_km)

    @property
    def moon_radius_rad(self) -> np.ndarray:
        """Of the moon's disc, (T,)."""
        return np.arcsin(MOON_RADIUS_KM / self.distance_km)


class Eclipse(NamedTuple):
    """moments (T,) a minute apart over the whole eclipse, `moon` at them, and contacts by name: P1, U1, U2, greatest,
    U3, U4, P4, those that there are."""

    moments: list[dt.datetime]
    moon: MoonPositions
    contacts: dict[str, dt.datetime]
    umbral_magnitude: float


def moon_positions(moments: list[dt.datetime]) -> MoonPositions:
    """Where the moon stands to the axis of the shadow.

    Errors: TwilightError for years outside 1000 to 3000.
    """
    site = Sites(moments, 0.0, 0.0)
    moon, sun = site.body("moon"), site.sun()
    to_moon = moon.towards * moon.distance_au[:, None] + site.observer
    to_sun = sun.towards * sun.distance_au[:, None] + site.observer
    axis = -to_sun / np.linalg.norm(to_sun, axis=-1, keepdims=True)
    along = (to_moon * axis).sum(axis=-1, keepdims=True)
    across = to_moon - along * axis
    offset = np.arctan2(np.linalg.norm(across, axis=-1), along[:, 0])
    east = np.cross([0.0, 0.0, 1.0], axis)
    east /= np.linalg.norm(east, axis=-1, keepdims=True)
    north = np.cross(axis, east)
    position = np.arctan2((across * east).sum(axis=-1), (across * north).sum(axis=-1))
    distance = AU_KM * np.linalg.norm(to_moon, axis=-1)
    return MoonPositions(offset, distance, AU_KM * np.linalg.norm(to_sun, axis=-1), position)


def find_eclipse(date: dt.date) -> Eclipse:
    """The eclipse of the moon on a date (UTC), or within a day of it.

    Errors: TwilightError where there is none, and for years outside 1000 to 3000.
    """
    noon = dt.datetime(date.year, date.month, date.day, 12, tzinfo=dt.UTC)
    count = int(2.0 * FIND_HOURS * 3600.0 / STEP_S) + 1
    moments = [noon + dt.timedelta(seconds=STEP_S * k - FIND_HOURS * 3600.0) for k in range(count)]
    moon = moon_positions(moments)
    within = moon.penumbra_rad + moon.moon_radius_rad - moon.offset_rad
    nearest = int(np.argmin(moon.offset_rad))
    if within[nearest] <= 0.0:
        raise TwilightError(
            f"{date.isoformat()}: there is no eclipse of the moon within a day; the moon passes the shadow's axis at "
            f"{np.degrees(moon.offset_rad[nearest]):.1f} deg"
        )
    inside = np.flatnonzero(within > 0.0)
    inside = inside[(inside >= nearest - 300) & (inside <= nearest + 300)]
    part = slice(max(int(inside[0]) - 5, 0), int(inside[-1]) + 6)
    here = MoonPositions(*(np.asarray(v)[part] for v in moon))
    return Eclipse(moments[part], here, _contacts(moments[part], here), _magnitude(here))


def _contacts(moments: list[dt.datetime], at: MoonPositions) -> dict[str, dt.datetime]:
    seconds = np.array([(m - moments[0]).total_seconds() for m in moments])
    found: dict[str, float] = {}
    middle = int(np.argmin(at.offset_rad))
    near = slice(middle - 3, middle + 4)
    curve = np.polyfit(seconds[near] - seconds[middle], at.offset_rad[near] ** 2, 2)
    found["greatest"] = seconds[middle] - 0.5 * curve[1] / curve[0]
    edges = {
        ("P1", "P4"): at.penumbra_rad + at.moon_radius_rad,
        ("U1", "U4"): at.umbra_rad + at.moon_radius_rad,
        ("U2", "U3"): at.umbra_rad - at.moon_radius_rad,
    }
    for (first, last), edge in edges.items():
        gap = edge - at.offset_rad
        if gap[middle] <= 0.0:
            continue
        before, after = slice(0, middle + 1), slice(middle, None)
        found[first] = float(np.interp(0.0, gap[before], seconds[before]))
        found[last] = float(np.interp(0.0, -gap[after], seconds[after]))
    ordered = sorted(found.items(), key=lambda item: item[1])
    return {name: moments[0] + dt.timedelta(seconds=round(value)) for name, value in ordered}


def _magnitude(at: MoonPositions) -> float:
    """Part of the moon's diameter within the umbra at greatest eclipse; below 0 where it stays outside."""
    k = int(np.argmin(at.offset_rad))
    return float((at.umbra_rad[k] + at.moon_radius_rad[k] - at.offset_rad[k]) / (2.0 * at.moon_radius_rad[k]))
