"""What light is asked of, as text: `zenith`, `30/180`, `5/sun+90`; `horizontal`, `plane:35/180`, `sphere`."""

from __future__ import annotations

import re
from dataclasses import dataclass

from twilight.base.errors import TwilightError
from twilight.engine.surfaces import Surface

GRAMMAR = (
    "zenith, ELEVATION/AZIMUTH of a direction (azimuth from north, or sun, sun+90 ...), horizontal, "
    "plane:TILT/AZIMUTH, sphere or cylinder"
)
"""What may be asked for, for errors and help."""
_ANGLES = re.compile(r"(?P<height>[-+]?\d+(?:\.\d+)?)/(?P<sun>sun)?(?P<azimuth>[-+]?\d+(?:\.\d+)?)?")
"""Elevation of a direction or tilt of a plane, and azimuth; in lower case."""


@dataclass(frozen=True)
class Direction:
    """A line of sight: elevation_deg 0 to 90; azimuth_deg from north, or from the sun where from_sun is true."""

    elevation_deg: float
    azimuth_deg: float = 0.0
    from_sun: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.elevation_deg <= 90.0:
            raise TwilightError(f"direction: elevation_deg is {self.elevation_deg:g}; allowed is 0 to 90")


def towards(text: str) -> Direction | Surface:
    """The direction or the surface of a text; TwilightError for one that is neither."""
    word = text.strip().lower()
    if word == "zenith":
        return Direction(90.0)
    if word == "horizontal":
        return Surface.horizontal()
    if word in ("sphere", "cylinder"):
        return Surface(word)  # type: ignore[arg-type]
    kind, colon, angles = word.partition(":")
    found = _ANGLES.fullmatch(angles if colon and kind == "plane" else word)
    if found is None or not (found["sun"] or found["azimuth"]):
        raise TwilightError(f"towards: '{text}' is none of {GRAMMAR}")
    angles_of = float(found["height"]), float(found["azimuth"] or 0.0), bool(found["sun"])
    return Surface("plane", *angles_of) if colon else Direction(*angles_of)
