"""A table of light over time, and the times at which a quantity passes a value, to the second.

A column is a quantity of a direction or a surface, as `V@zenith`; presets by purpose have published thresholds.

Written as CSV, netCDF and a figure, each whole or not at all.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.base.whole_files import whole_file, write_csv
from twilight.engine.light import SOURCE_NAMES, LightField
from twilight.io.netcdf import write_netcdf
from twilight.sky.moments import Moments, moments_at
from twilight.sky.quantities.measure import Quantity, check_of, quantity, unit_of
from twilight.sky.surfaces import Direction, Surface, towards
from twilight.sky.twilight_times import SUNRISE_DEG, TwilightTime, twilight_times


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
    """Rows of times (T,) with their suns [deg] (T,), values of every column (T,), marks, and the outcomes of
    conditions."""

    times: tuple[datetime, ...]
    sun_elevation_deg: np.ndarray
    columns: tuple[Column, ...]
    values: tuple[np.ndarray, ...]
    marks: tuple[TwilightTime, ...]
    outcomes: tuple[Outcome, ...] = field(default=())


def condition(text: str) -> Condition:
    """The condition of a text such as `V@zenith > 21`; TwilightError for another."""
    match = _CONDITION.fullmatch(text)
    if match is None:
        raise TwilightError(f"--when: '{text}' is not QUANTITY[@WHERE] < VALUE or > VALUE, e.g. 'V@zenith > 21'")
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
    count = int((stop - start) / step + 1e-9) + 1
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

    Parameters
    ----------
    light
        A field that covers the quantities.
    latitude_deg, longitude_deg
        Of the place [deg].
    times
        Of the rows, with offsets, in their order.
    columns, conditions
        What is tabulated, and what is looked for.
    time_zone
        Of the marks; None: UTC.
    progress
        Called as progress(doing, fraction) now and then.

    Raises
    ------
    TwilightError
        For times outside the ephemeris.
    """

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
    all_marks = [mark for day in days for mark in twilight_times(day, *place)]
    passed = [mark for mark in all_marks if mark.time is not None and times[0] <= mark.time <= times[-1]]
    # an event that no day of the table has is reported one time
    missing = {mark.event: mark for mark in all_marks if mark.time is None}
    present = {mark.event for mark in passed}
    marks = (*passed, *(mark for event, mark in missing.items() if event not in present))
    return TimeSeries(
        tuple(times),
        moments.sun.elevation_deg,
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


SHADED = {"civil": -6.0, "nautical": -12.0, "astronomical": -18.0}
"""Twilights by the sun's lowest elevation [deg]."""
LABEL_PLACES = [(x, y) for y in (4.0, 13.0, -8.0, 22.0, -17.0, 31.0, -26.0, 40.0) for x in (5.0, -41.0)]
"""Where the clock of a crossing may stand beside its point [points], the first that is free."""
SHADE_STEP_S = 20.0
"""Step of time at which the shades of a figure begin and end [s]."""


def write_table(series: TimeSeries, path: Path, note: str) -> None:
    """A row for each time: time, the sun's elevation, and every column with its unit in its name."""
    names = ["time", "sun_elevation_deg", *(column.variable for column in series.columns)]
    cells = (
        [time.isoformat(), f"{sun:.4f}", *(_cell(values[i]) for values in series.values)]
        for i, (time, sun) in enumerate(zip(series.times, series.sun_elevation_deg, strict=True))
    )
    write_csv(path, names, cells, note)


def _cell(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else ""


def write_dataset(series: TimeSeries, path: Path, attributes: dict[str, Any]) -> None:
    """The table as netCDF along `time` (UTC)."""
    import xarray  # optional

    time = np.array([t.astimezone(UTC).replace(tzinfo=None) for t in series.times], "datetime64[us]")
    variables: dict[str, Any] = {
        one.variable: ("time", values, {"units": one.unit, "long_name": one.about})
        for one, values in zip(series.columns, series.values, strict=True)
    }
    sun = ("time", series.sun_elevation_deg, {"units": "degree", "standard_name": "solar_elevation_angle"})
    coords = {"time": time.astype("datetime64[ns]"), "solar_elevation_angle": sun}
    write_netcdf(xarray.Dataset(variables, coords, {"Conventions": "CF-1.10", **attributes}), path)


def draw(series: TimeSeries, path: Path, title: str) -> None:
    """One panel a column over the hours, twilights shaded, crossings marked."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter  # optional
    from matplotlib.figure import Figure

    zone = series.times[0].tzinfo
    count = len(series.columns)
    figure = Figure(figsize=(8.0, 1.2 + 2.1 * count), layout="constrained")
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)
    shaded = shades(series)
    for panel, one, values in zip(axes[:, 0], series.columns, series.values, strict=True):
        for start, stop, depth in shaded:  # day white, each twilight darker, night darkest
            panel.axvspan(start, stop, color=str(1.0 - 0.11 * depth), linewidth=0)
        panel.plot(series.times, values, color="black", linewidth=1.4)
        panel.set_ylabel(f"{one.text}\n[{one.unit}]" if one.unit != "1" else one.text, fontsize="small")
        known = values[np.isfinite(values)]
        if known.size and known.min() > 0.0 and known.max() > 100.0 * known.min():
            panel.set_yscale("log")
        if one.unit.startswith("mag"):
            panel.invert_yaxis()
        panel.grid(alpha=0.3)
        places: list[tuple[datetime, float]] = []
        for outcome in series.outcomes:
            if outcome.condition.column.text != one.text:
                continue
            panel.axhline(outcome.condition.value, color="tab:red", linewidth=0.8, linestyle="--")
            places += [(crossing.time, outcome.condition.value) for crossing in outcome.crossings]
        if places:
            panel.plot(*zip(*places, strict=True), "o", color="tab:red", markersize=5)
            _label(panel, places)
    axes[0, 0].set_title(title, fontsize="small")
    locator = AutoDateLocator(tz=zone)
    axes[-1, 0].xaxis.set_major_locator(locator)
    axes[-1, 0].xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=zone))
    axes[-1, 0].set_xlim(series.times[0], series.times[-1])
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=120)


def _label(panel: Any, places: list[tuple[datetime, float]]) -> None:
    """The clock at points of a panel, beside each where nothing stands yet, else above or below what stands there."""
    panel.figure.draw_without_rendering()
    taken: list[Any] = []
    for time, value in sorted(places):
        text = panel.annotate(
            f"{time:%H:%M:%S}", (time, value), LABEL_PLACES[0], textcoords="offset points", color="tab:red",
            fontsize="x-small",
        )  # fmt: skip
        for place in LABEL_PLACES:
            text.set_position(place)
            box = text.get_window_extent()
            inside = panel.bbox.x0 <= box.x0 and box.x1 <= panel.bbox.x1
            if inside and not any(box.overlaps(other) for other in taken):
                break
        taken.append(box)


def shades(series: TimeSeries) -> list[tuple[datetime, datetime, int]]:
    """First and last time of each twilight, 1 to 3, and night, 4; the sun's elevation is linear between the rows."""
    ends = [SUNRISE_DEG, *SHADED.values()]
    times = [time.astimezone(UTC) for time in series.times]
    second = np.array([(time - times[0]).total_seconds() for time in times])
    fine = np.linspace(second[0], second[-1], max(2, int(second[-1] / SHADE_STEP_S) + 1))
    depth = np.digitize(-np.interp(fine, second, series.sun_elevation_deg), [-end for end in ends])
    edges = np.flatnonzero(np.diff(depth)) + 1
    spans = []
    for start, stop in zip([0, *edges], [*edges, fine.size - 1], strict=True):
        if depth[start]:
            first, last = (times[0] + timedelta(seconds=float(fine[k])) for k in (start, stop))
            spans.append((first, last, int(depth[start])))
    return spans


WRITERS: dict[str, Callable[[TimeSeries, Path, str], None]] = {
    ".csv": lambda made, path, about: write_table(made, path, f"twilight timeline: {about}"),
    ".nc": lambda made, path, about: write_dataset(made, path, {"title": about}),
    ".png": draw,
}
"""The files of a timeline by their suffix; about: what it is of, in a few words."""
NEEDED = {".nc": ("xarray",), ".png": ("matplotlib",)}
"""Extras by the suffix of the files that they write."""
