"""Timelines by what they are for: columns and conditions with the published thresholds that they stand on."""

from __future__ import annotations

from typing import NamedTuple


class Preset(NamedTuple):
    """Columns and conditions as text; about: what the thresholds are, with their sources."""

    columns: tuple[str, ...]
    conditions: tuple[str, ...]
    about: str


PRESETS = {
    "darkness": Preset(
        ("V@zenith", "B@zenith", "luminance@zenith"),
        ("V@zenith > 20", "V@zenith > 21"),
        "the zenith of a dark site without moon is at V 21.6 at solar maximum (Paranal, Patat 2003), where a Sky "
        "Quality Meter has read 21.9 in the mean of seven years (Cosmic Campground); 21 is within a magnitude of it",
    ),
    "reading": Preset(
        ("illuminance", "cct"),
        ("illuminance < 450", "illuminance < 3.4"),
        "level ground at sunset 450 lx; at the end of civil twilight, where outdoor work needs lamps, 3.4 lx (Janiczek "
        "& DeYoung 1987)",
    ),
    "melanopic": Preset(
        ("melanopic@plane:90/sun", "melanopic@plane:90/sun+180", "illuminance"),
        ("melanopic@plane:90/sun < 250", "melanopic@plane:90/sun < 10", "melanopic@plane:90/sun < 1"),
        "at the eye, upright: 250 lx or more by day, 10 lx at most in the evening, 1 lx at night (Brown et al. 2022, "
        "PLoS Biol. 20, e3001571)",
    ),
}
