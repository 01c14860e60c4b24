"""A table of light over time, and the times at which a quantity passes a value, to the second.

A column is a quantity of a direction or a surface, as `V@zenith`; presets by purpose have published thresholds.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.engine.light import SOURCE_NAMES, LightField
from twilight.sky.moments import Moments, moments_at
from twilight.sky.quantities.measure import Quantity, check_of, quantity, unit_of
from twilight.sky.surfaces import Direction, Surface, towards
from twilight.sky.twilight_times import TwilightTime, moon_times, twilight_times


@dataclass(frozen=True)
class Column:
    """A quantity of a direction or a surface over time.

    text: as it was asked for; needs: the quantity, which the wavelengths must cover; target: what it is of.
    """

    text: str
    needs: Quantity
    target: Direction | Surface

    @property
    def unit(self) -> str:
        """Of its values."""
        return unit_of(self.needs, "surface" if isinstance(self.target, Surface) else "direction")

    @property
    def variable(self) -> str:
        """Its name in files, with its unit."""
        where = "".join(c if c.isalnum() else "_" for c in self.text.partition("@")[2])
        return f"{self.needs.variable}{'_' + where if where else ''}"

    @property
    def about(self) -> str:
        """What it is, in one line."""
        return self.needs.about

    def values(self, field: LightField, moments: Moments, sources: Sequence[str] | None = None) -> np.ndarray:
        """Its values at moments, (N,), of some sources, None: all."""
        if isinstance(self.target, Surface):
            radiance = field.surfaces(moments, [self.target], sources)
        else:
            radiance = field.directions(moments, *_angles(self.target, moments), sources)
        return self.needs.value(field.spectra(radiance[:, 0]))


def column(text: str) -> Column:
    """The column of a text: `QUANTITY@WHERE`; without WHERE of the zenith, or of level ground.

    Errors: TwilightError for a quantity, or what it is of, that is none.
    """
    text = text.strip()
    name, _, where = text.partition("@")
    wanted = quantity(name)
    target = towards(where or ("zenith" if wanted.of == ("direction",) else "horizontal"))
    check_of(wanted, "surface" if isinstance(target, Surface) else "direction")
    return Column(text, wanted, target)


def _angles(target: Direction, moments: Moments) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth from north (N, 1)."""
    count = len(moments)
    azimuth = target.azimuth_deg + (moments.sun.azimuth_deg if target.from_sun else np.zeros(count))
    return np.full((count, 1), target.elevation_deg), azimuth[:, None]


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
MAX_ROWS = 20_000
"""Most rows of a table."""
_CONDITION = re.compile(r"(?P<column>[^<>]+)(?P<sign>[<>])(?P<value>[^<>]+)")
_STEP = re.compile(r"(?P<count>\d+(?:\.\d+)?)\s*(?P<unit>s|min|h)")
_SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}
FINE_S = (10.0, 1.0)
"""Steps by which a crossing between two rows is narrowed down [s]; within the last step time is linear."""


@dataclass(frozen=True)
class Condition:
    """A column that is to be above (>) or below (<) a value."""

    column: Column
    sign: Literal["<", ">"]
    value: float

    @property
    def text(self) -> str:
        """As it is written."""
        return f"{self.column.text} {self.sign} {self.value:g}"


@dataclass(frozen=True)
class Crossing:
    """A condition that begins or ends to hold: time (with its offset), true elevation of the sun [deg]."""

    condition: Condition
    begins: bool
    time: datetime
    sun_elevation_deg: float


@dataclass(frozen=True)
class Outcome:
    """What became of a condition: its crossings in their order, and whether it held at the first row.

    moon_prevents: it is never reached, and would be without the moon.
    """

    condition: Condition
    holds_at_first: bool
    crossings: tuple[Crossing, ...]
    moon_prevents: bool = False

    @property
    def sentence(self) -> str:
        """Where there is no crossing: what holds instead; empty where there are some."""
        if self.crossings:
            return ""
        if self.holds_at_first:
            return "all the time"
        return "not reached, for the moon shines" if self.moon_prevents else "not reached"


@dataclass(frozen=True)
class TimeSeries:
    """Rows of times (T,) with their suns and moons [deg] (T,), the moon's lit fraction (T,), values of every column
    (T,), marks, and the outcomes of conditions."""

    times: tuple[datetime, ...]
    sun_elevation_deg: np.ndarray
    moon_elevation_deg: np.ndarray
    moon_lit: np.ndarray
    columns: tuple[Column, ...]
    values: tuple[np.ndarray, ...]
    marks: tuple[TwilightTime, ...]
    outcomes: tuple[Outcome, ...] = field(default=())


def condition(text: str) -> Condition:
    """The condition of a text such as `V@zenith > 21`; TwilightError for another."""
    match = _CONDITION.fullmatch(text)
    if match is None:
        raise TwilightError(
            f"--when: '{text}' is not QUANTITY[@WHERE] < VALUE or > VALUE in quotes, e.g. 'V@zenith > 21'"
        )
    try:
        value = float(match["value"])
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise TwilightError(f"--when: '{match['value'].strip()}' is not a number")
    return Condition(column(match["column"]), match["sign"], value)  # type: ignore[arg-type]


def step_of(text: str) -> timedelta:
    """A duration such as 30s, 1min or 0.5h; TwilightError for another."""
    match = _STEP.fullmatch(text.strip())
    seconds = float(match["count"]) * _SECONDS[match["unit"]] if match else 0.0
    if not 1.0 <= seconds <= 86400.0:
        raise TwilightError(f"--step: '{text}' is not a duration from 1s to 24h, e.g. 30s, 1min, 0.5h")
    return timedelta(seconds=seconds)


def rows(start: datetime, stop: datetime, step: timedelta) -> list[datetime]:
    """Times from start to stop; TwilightError where stop is not later, and for too many."""
    if not start < stop:
        raise TwilightError(f"--stop: {stop.isoformat()} is not after --start, {start.isoformat()}")
    count = int((stop - start) / step + ROUNDING) + 1
    if not 2 <= count <= MAX_ROWS:
        raise TwilightError(f"--step: makes {count:,} rows; allowed is 2 to {MAX_ROWS:,}")
    return [(start.astimezone(UTC) + i * step).astimezone(start.tzinfo) for i in range(count)]


def timeline(
    light: LightField,
    latitude_deg: float,
    longitude_deg: float,
    times: Sequence[datetime],
    columns: Sequence[Column],
    conditions: Sequence[Condition] = (),
    time_zone: str | None = None,
    progress: Progress = silent,
) -> TimeSeries:
    """Values of columns at times, and the times at which conditions begin and end to hold.

    light: a field that covers the quantities; times: of the rows, with offsets, in their order; columns, conditions:
    what is tabulated, and what is looked for; time_zone: of the marks, None: UTC.
    Errors: TwilightError for times outside the ephemeris."""

    def moments_of(at: Sequence[datetime]) -> Moments:
        count = len(at)
        return moments_at([latitude_deg] * count, [longitude_deg] * count, at, light.solved.scene.altitude_km)

    def evaluate(column: Column, at: Sequence[datetime]) -> np.ndarray:
        return column.values(light, moments_of(at))

    moments = moments_of(times)
    wanted = {asked.text: asked for asked in (*columns, *(c.column for c in conditions))}
    light.prepare(moments, part_of(progress, 0.0, 0.8))
    values = {}
    for n, (text, which) in enumerate(wanted.items()):
        progress(text, 0.8 + 0.1 * n / len(wanted))
        values[text] = which.values(light, moments)
    outcomes = []
    for n, asked in enumerate(conditions):
        progress(asked.text, 0.9 + 0.1 * n / len(conditions))
        crossings = []
        over = _over(asked, values[asked.column.text])
        for i in np.flatnonzero(_passes(over)).tolist():
            when = _refined(asked, times[i], times[i + 1], partial(evaluate, asked.column))
            at = moments_at([latitude_deg], [longitude_deg], [when])
            crossings.append(Crossing(asked, bool(over[i + 1] > 0), when, float(at.sun.elevation_deg[0])))
        held = bool(over[0] > 0)
        prevented = not (crossings or held) and _moon_prevents(asked, light, moments)
        outcomes.append(Outcome(asked, held, tuple(crossings), prevented))
    days = sorted({moment.date() for moment in times})
    place = latitude_deg, longitude_deg, time_zone, light.solved.scene.altitude_km
    all_marks = [mark for day in days for mark in (*twilight_times(day, *place), *moon_times(day, *place))]
    passed = [mark for mark in all_marks if mark.time is not None and times[0] <= mark.time <= times[-1]]
    passed.sort(key=lambda mark: (mark.time or times[0], mark.event))
    # an event that no day of the table has is reported one time
    missing = {mark.event: mark for mark in all_marks if mark.time is None}
    present = {mark.event for mark in passed}
    marks = (*passed, *(mark for event, mark in missing.items() if event not in present))
    assert moments.moon is not None
    return TimeSeries(
        tuple(times),
        moments.sun.elevation_deg,
        moments.moon.elevation_deg,
        0.5 * (1.0 + np.cos(np.radians(moments.moon.phase_angle_deg))),
        tuple(columns),
        tuple(values[asked.text] for asked in columns),
        marks,
        tuple(outcomes),
    )


def _moon_prevents(one: Condition, light: LightField, moments: Moments) -> bool:
    """Whether a condition that no moment fulfils is fulfilled at one when the moon is taken away."""
    assert moments.moon is not None
    moonlit = np.flatnonzero(moments.moon.shines)
    if not moonlit.size:
        return False
    without = [name for name in SOURCE_NAMES if name != "moon"]
    return bool((_over(one, one.column.values(light, moments.part(moonlit), without)) > 0).any())


def _over(one: Condition, values: np.ndarray) -> np.ndarray:
    """By how much a condition holds, (T,); below 0 where it does not; NaN where there is no value."""
    return values - one.value if one.sign == ">" else one.value - values


def _passes(over: np.ndarray) -> np.ndarray:
    """Whether a condition changes from each row to the next, (T - 1,)."""
    known = ~(np.isnan(over[:-1]) | np.isnan(over[1:]))
    return known & ((over[:-1] > 0) != (over[1:] > 0))


def _refined(
    one: Condition, first: datetime, last: datetime, values_at: Callable[[Sequence[datetime]], np.ndarray]
) -> datetime:
    """When the condition changes between two times, to the second; values_at: of its column."""
    for step_s in FINE_S:
        span = (last - first).total_seconds()
        if span <= step_s:
            continue
        count = int(np.ceil(span / step_s)) + 1
        at = [first + timedelta(seconds=span * i / (count - 1)) for i in range(count)]
        over = _over(one, values_at(at))
        k = int(np.argmax(_passes(over)))
        first, last = at[k], at[k + 1]
    return (first + 0.5 * (last - first) + timedelta(milliseconds=500)).replace(microsecond=0)
