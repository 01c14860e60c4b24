"""From the section `horizon` to the screen that dims the direct beam, and what the plan says of it."""

from __future__ import annotations

from twilight.atmosphere.screen import Screen
from twilight.config.scene import Horizon


def screen_of(horizon: Horizon) -> Screen | None:
    """The screen beyond the horizon; None where nothing is there."""
    section = horizon.screen
    if section is None:
        return None
    if section.clouds is not None:
        return Screen.of_clouds(**section.clouds.model_dump(), angstrom_exponent=section.angstrom_exponent)
    if section.skyline is not None:
        return Screen.of_skyline(section.skyline.height_km, section.skyline.distance_km)
    assert section.heights_km is not None and section.transmission is not None
    return Screen(
        section.heights_km, section.transmission, section.from_km, angstrom_exponent=section.angstrom_exponent
    )


def described(horizon: Horizon) -> str | None:
    """One line about what lies beyond the horizon; None where nothing does."""
    section = horizon.screen
    if section is None:
        return None
    haze = f", at 550 nm (Angstrom exponent {section.angstrom_exponent:g})" if section.angstrom_exponent else ""
    if section.clouds is not None:
        c = section.clouds
        return (
            f"clouds from {c.from_km:g} km on stop {c.cover:.0%} of the beams below {c.top_km:g} "
            f"+- {c.top_spread_km:g} km{haze}"
        )
    if section.skyline is not None:
        return f"a skyline of {section.skyline.height_km:.4g} km at {section.skyline.distance_km:.4g} km"
    assert section.heights_km is not None and section.transmission is not None
    beams = f"{min(section.transmission):.0%} to {max(section.transmission):.0%} of the beams pass"
    return (
        f"{beams} at {section.heights_km[0]:g} to {section.heights_km[-1]:g} km, from {section.from_km:g} km on{haze}"
    )
