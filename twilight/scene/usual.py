"""What a scene has that its configuration leaves unset: the horizon of usual evenings, ozone of the place and day."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from twilight import solvers
from twilight.atmosphere.measured import climatological_column_du, climatology_source, profile_column_du
from twilight.atmosphere.screen import Screen
from twilight.config.measured import place_and_time_of
from twilight.config.scene import Config, Horizon
from twilight.io.air.lines import PlaceAndTime

if TYPE_CHECKING:
    from twilight.config.climate import Climate
    from twilight.solvers.base import Solver


ONE_COLUMN_DU = 4.0
"""Places and times whose usual columns lie within this have one air [DU]: illuminance at -6 deg is within 0.7 %."""
NOWHERE = PlaceAndTime()
"""No place and no time."""
CLEAN = Horizon()
"""Nothing beyond the horizon: of papers, references and other codes."""


def completed(config: Config) -> Config:
    """The configuration with the horizon and the ozone that it leaves unset; what is set stays."""
    return config.model_copy(update={"climate": _with_ozone(config)[0], "horizon": usual_horizon(config)})


def with_ozone_of(config: Config, time: datetime, latitude_deg: float) -> Config:
    """The configuration with the usual ozone of a place and time that its sun does not tell, where it is left unset."""
    climate, _ = with_usual_ozone(config.climate, PlaceAndTime(time, latitude_deg))
    return config.model_copy(update={"climate": climate})


def between_ozone_of(
    config: Config, times: Sequence[datetime], latitude_deg: Sequence[float]
) -> tuple[list[Config], np.ndarray]:
    """The configuration with the least and the most usual ozone of N places and times, and the share (N,) of the second
    in each; as it is, and zeros, where ozone is set; of the mean alone where all are within ONE_COLUMN_DU."""
    if not _leaves_ozone(config.climate):
        return [config], np.zeros(len(times))
    days = [time.astimezone(UTC).timetuple().tm_yday for time in times]
    pairs = list(zip(latitude_deg, days, strict=True))
    columns = {pair: climatological_column_du(*pair) for pair in set(pairs)}
    least, most = min(columns.values()), max(columns.values())
    if most - least <= ONE_COLUMN_DU:
        return [_of_column(config, 0.5 * (least + most))], np.zeros(len(pairs))
    shares = (np.array([columns[pair] for pair in pairs]) - least) / (most - least)
    return [_of_column(config, least), _of_column(config, most)], shares


def _of_column(config: Config, column_du: float) -> Config:
    return config.model_copy(update={"climate": _with_column(config.climate, column_du)})


def _with_ozone(config: Config) -> tuple[Climate, str | None]:
    return with_usual_ozone(config.climate, place_and_time_of(config))


def said(config: Config) -> list[str]:
    """What the configuration leaves unset, in words for people."""
    horizon = usual_horizon(config)
    words = [] if config.horizon is not None or horizon == CLEAN else [f"beyond the horizon, {described(horizon)}"]
    climate, source = _with_ozone(config)
    return words + ([] if source is None else [f"ozone {climate.gases.ozone.column_du:.0f} DU, {source}"])


def usual_horizon(config: Config, solver: Solver | None = None) -> Horizon:
    """The configuration's horizon; where it names none `typical`, and `clean` where the solver (None: its own) takes no
    screen or the climate is a table, which is all that its author wanted of the air."""
    if config.horizon is not None:
        return config.horizon
    solver = solver or solvers.load(config.chosen_solver[0])
    return Horizon.model_validate(
        "typical" if solver.CAPABILITIES.screen and config.climate.medium is None else "clean"
    )


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


def described(horizon: Horizon) -> str:
    """One line about what lies beyond the horizon."""
    section = horizon.screen
    if section is None:
        return "clean: nothing takes sunbeams on their way"
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
        f"{'typical: ' if horizon.name else ''}{beams} at {section.heights_km[0]:g} to {section.heights_km[-1]:g} km, "
        f"from {section.from_km:g} km on{haze}"
    )


def with_usual_ozone(climate: Climate, at: PlaceAndTime = NOWHERE) -> tuple[Climate, str | None]:
    """The climate with the zonal mean of its ozone in place of an unset column, and its source in words: of a place and
    day, or of the latitude and season for which the profile stands.

    As it is, and None, where the column, levels or a table were given, or `gases.ozone.climatology` is false.
    """
    if not _leaves_ozone(climate):
        return climate, None
    if at.time is None or at.latitude_deg is None:
        column, source = profile_column_du(climate.atmosphere.profile)
    else:
        day = at.time.astimezone(UTC).timetuple().tm_yday
        column, source = climatological_column_du(at.latitude_deg, day), climatology_source(at.latitude_deg, day)
    return _with_column(climate, column), source


def _leaves_ozone(climate: Climate) -> bool:
    """Whether the climate leaves its ozone to the climatology."""
    ozone = climate.gases.ozone
    own = climate.medium is not None or climate.atmosphere.levels is not None or not ozone.climatology
    return not (own or ozone.column_du is not None or ozone.day_of_year is not None or ozone.treatment == "none")


def _with_column(climate: Climate, column_du: float) -> Climate:
    ozone = climate.gases.ozone.model_copy(update={"column_du": round(column_du, 1)})
    return climate.model_copy(update={"gases": climate.gases.model_copy(update={"ozone": ozone})})
