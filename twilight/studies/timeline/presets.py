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
        "the zenith of a dark site without moon is at V 21.6 to 21.9 (Patat 2003); 21 is within half a magnitude of it",
    ),
    "dawn": Preset(
        ("dawn_contrast", "luminance@5/sun", "luminance@5/sun+180"),
        ("dawn_contrast > 0.1", "dawn_contrast > 1", "dawn_contrast > 2"),
        "luminance 5 deg above the horizon at the sun's azimuth over that opposite, less 1, zodiacal light in it; 0.1 "
        "is about what an eye adapted to a night sky sees of something large with an edge (Blackwell 1946); dawn has "
        "none: where observers in deserts see first light, at a sun of -14.6 to -14.8 deg (Hassan et al. 2014), it is "
        "about 2",
    ),
    "reading": Preset(
        ("illuminance", "cct"),
        ("illuminance < 400", "illuminance < 3.4"),
        "level ground at sunset 400 lx; at the end of civil twilight, where outdoor work needs lamps, 3.4 lx (Janiczek "
        "& DeYoung 1987)",
    ),
    "melanopic": Preset(
        ("melanopic@plane:90/sun", "melanopic@plane:90/sun+180", "illuminance"),
        ("melanopic@plane:90/sun < 250", "melanopic@plane:90/sun < 10", "melanopic@plane:90/sun < 1"),
        "at the eye, upright: 250 lx or more by day, 10 lx at most in the evening, 1 lx at night (Brown et al. 2022, "
        "PLoS Biol. 20, e3001571)",
    ),
}
"""`flats` has columns of its own (`flats`)."""
