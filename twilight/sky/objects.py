"""The things to look for: by name, where they stand over a night, and how bright they are above the air."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass

import numpy as np

from twilight.base.errors import TwilightError
from twilight.sky.bodies import AU_KM, PLANETS, BodyPlace, Sites
from twilight.sky.eye_limit import illuminance_magnitude
from twilight.sky.moon.light import Moon, moon_illuminance_lux
from twilight.sky.planets import planet_magnitude
from twilight.sky.stars import bright_stars

NAKED_EYE_PLANETS = ("mercury", "venus", "mars", "jupiter", "saturn")
"""Planets that were always seen."""
V_MAG = {"Sirius": -1.46}
"""V of stars whose Hp of the catalogue is not within 0.15 mag of it (Johnson; Sirius saturated Hipparcos)."""
FIRST_STARS_MAG = 1.6
"""Stars of the list `stars` [mag]."""


@dataclass(frozen=True)
class Track:
    """One object at T moments.

    elevation_deg, azimuth_deg (T,): true, from north.  magnitude (T,): above the air, V.  moons: the moon at each
    moment, None for what is a point.
    """

    name: str
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    magnitude: np.ndarray
    moons: tuple[Moon, ...] | None = None


def names_of(text: str) -> list[str]:
    """The objects that a word stands for: one by its name, or `stars` or `planets` for those of a list.

    Errors: TwilightError for an unknown name.
    """
    word = text.strip().lower()
    stars = {str(s).lower(): str(s) for s in bright_stars(2000.0).names if s}
    if word == "planets":
        return list(NAKED_EYE_PLANETS)
    if word == "stars":
        sky = bright_stars(2000.0, FIRST_STARS_MAG)
        return [sky.label(i) for i in range(len(sky)) if sky.names[i]]
    if word == "moon" or word in PLANETS:
        return [word]
    if word in stars:
        return [stars[word]]
    raise TwilightError(
        f"object: '{text}' is not known; moon, {', '.join(PLANETS)}, planets, stars, and the proper names of bright "
        "stars (Sirius, Vega) are"
    )


def tracks(
    names: list[str], moments: list[dt.datetime], latitude_deg: float, longitude_deg: float, altitude_km: float = 0.0
) -> list[Track]:
    """Where objects of `names_of` stand at some moments, and how bright they are."""
    site = Sites(moments, latitude_deg, longitude_deg, altitude_km)
    middle = moments[len(moments) // 2]
    sky = bright_stars(middle.year + middle.timetuple().tm_yday / 365.25)
    found = []
    for name in names:
        if name == "moon":
            found.append(_moon(site))
        elif name in PLANETS:
            place = site.body(name)
            rows = zip(place.sun_distance_au, place.distance_au, place.phase_angle_deg, place.towards, strict=True)
            magnitude = np.array([planet_magnitude(name, *row) for row in rows])
            found.append(_point(name, place, magnitude))
        else:
            i = int(np.flatnonzero(sky.names == name)[0])
            magnitude = np.full(len(moments), V_MAG.get(name, float(sky.magnitude[i])))
            found.append(_point(name, site.star(sky.directions[i]), magnitude))
    return found


def _point(name: str, place: BodyPlace, magnitude: np.ndarray) -> Track:
    return Track(name, place.elevation_deg, place.azimuth_deg, magnitude)


def _moon(site: Sites) -> Track:
    place, sun = site.body("moon"), site.sun()
    away = np.mod(place.azimuth_deg - sun.azimuth_deg, 360.0)
    rows = zip(place.elevation_deg, away, place.phase_angle_deg, place.distance_au, place.sun_distance_au, strict=True)
    moons = tuple(Moon(float(e), float(a), float(g), float(d) * AU_KM, float(r)) for e, a, g, d, r in rows)
    lux = np.array([moon_illuminance_lux(moon) for moon in moons])
    return Track("moon", place.elevation_deg, place.azimuth_deg, illuminance_magnitude(lux), moons)
