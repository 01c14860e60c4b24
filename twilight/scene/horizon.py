"""From the section `horizon` to the screen that dims the direct beam, and what the plan says of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from twilight.atmosphere.csv_columns import Columns, read_columns
from twilight.atmosphere.screen import Screen
from twilight.base.errors import TwilightError
from twilight.config.horizon import Horizon, Skyline
from twilight.scene.suns import SceneSun

SAME_KM = 0.01
"""Suns between whose skylines there is no more than this are taken to have one [km]."""
COLUMNS: Columns = {
    "azimuth_deg": (-360.0, 360.0, "-360 to 360 deg"),
    "height_km": (0.0, 100.0, "0 to 100 km"),
    "distance_km": (0.0, 2000.0, "0 to 2000 km"),
}
"""Of a file of a skyline, which may have others."""


def screen_of(horizon: Horizon, suns: Sequence[SceneSun]) -> Screen | None:
    """The screen beyond the horizon under some suns; None where nothing is there.

    Errors: TwilightError for a skyline by azimuth whose file cannot be read, or that is not the same under all suns.
    """
    section = horizon.screen
    if section is None:
        return None
    if section.clouds is not None:
        return Screen.of_clouds(**section.clouds.model_dump(), angstrom_exponent=section.angstrom_exponent)
    if section.skyline is not None:
        if not section.skyline.by_azimuth:
            return Screen.of_skyline(section.skyline.height_km, section.skyline.distance_km)
        return _by_azimuth(section.skyline, suns)
    assert section.heights_km is not None and section.transmission is not None
    return Screen(
        section.heights_km, section.transmission, section.from_km, angstrom_exponent=section.angstrom_exponent
    )


def described(horizon: Horizon, suns: Sequence[SceneSun]) -> str | None:
    """One line about what lies beyond the horizon; None where nothing does."""
    section, screen = horizon.screen, screen_of(horizon, suns)
    if section is None or screen is None:
        return None
    haze = f", at 550 nm (Angstrom exponent {section.angstrom_exponent:g})" if section.angstrom_exponent else ""
    if section.clouds is not None:
        c = section.clouds
        return (
            f"clouds from {c.from_km:g} km on stop {c.cover:.0%} of the beams below {c.top_km:g} "
            f"+- {c.top_spread_km:g} km{haze}"
        )
    if section.skyline is not None:
        one = f"a skyline of {screen.altitude_km[-1]:.4g} km at {screen.from_km:.4g} km"
        if not section.skyline.by_azimuth:
            return one
        where = f"the azimuth of the sun, {_azimuths(section.skyline, suns)[0]:.1f} deg"
        return f"{one}, as it is in {where}, for all beams (montecarlo: azimuth by azimuth)"
    assert section.heights_km is not None and section.transmission is not None
    beams = f"{min(section.transmission):.0%} to {max(section.transmission):.0%} of the beams pass"
    return (
        f"{beams} at {section.heights_km[0]:g} to {section.heights_km[-1]:g} km, from {section.from_km:g} km on{haze}"
    )


def _azimuths(skyline: Skyline, suns: Sequence[SceneSun]) -> list[float]:
    """Azimuths of the suns [deg] among those of the points."""
    if skyline.sun_azimuth_deg is not None:
        return [skyline.sun_azimuth_deg]
    return [0.0 if sun.azimuth_deg is None else sun.azimuth_deg for sun in suns]


def _by_azimuth(skyline: Skyline, suns: Sequence[SceneSun]) -> Screen:
    points = np.array(_read(skyline.file) if skyline.points is None else skyline.points, dtype=float)
    azimuths = _azimuths(skyline, suns)
    if not azimuths:
        raise TwilightError(
            "horizon.screen.skyline: this is made for all suns at once, and none says where the skyline lies; give "
            "height_km and distance_km, or sun_azimuth_deg"
        )
    height, distance = (np.interp(azimuths, points[:, 0], points[:, k], period=360.0) for k in (1, 2))
    if np.ptp(height) > SAME_KM or np.ptp(distance) > SAME_KM:
        raise TwilightError(
            f"horizon.screen.skyline: the suns of this scene stand in azimuths {min(azimuths):.0f} to "
            f"{max(azimuths):.0f} deg, where the skyline is {height.min():.3g} to {height.max():.3g} km high; one "
            "solution holds one of them: give each sun a scene of its own (vary: {sun.at: [...]}), or height_km and "
            "distance_km"
        )
    around = [(float((a - azimuths[0]) % 360.0), float(h), float(d)) for a, h, d in points]
    return Screen.of_skyline(float(height[0]), float(distance[0]), tuple(sorted(around)))


def _read(file: str | None) -> list[tuple[float, ...]]:
    """The points of a file.  Errors: TwilightError as `read_columns`, and for an azimuth that is there twice."""
    assert file is not None
    _, rows, _ = read_columns(Path(file), COLUMNS, others=True)
    if np.unique(rows[:, 0] % 360.0).size < len(rows):
        raise TwilightError(f"{file}: a skyline needs each azimuth once")
    return [tuple(row) for row in rows]
