"""A table of light over time as CSV, netCDF and a figure, each whole or not at all."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.whole_files import save_figure, write_csv
from twilight.io.netcdf import write_netcdf
from twilight.sky.twilight_times import SUNRISE_DEG
from twilight.studies.timeline import TimeSeries

SHADED = {"civil": -6.0, "nautical": -12.0, "astronomical": -18.0}
"""Twilights by the sun's lowest elevation [deg]."""
LABEL_PLACES = [(x, sign * y) for y in range(4, 120, 9) for sign in (1, -1) for x in (5.0, -41.0)]
"""Where the clock of a crossing may stand beside its point [points], the first that is free."""
SHADE_STEP_S = 20.0
"""Step of time at which the shades of a figure begin and end [s]."""


def write_table(series: TimeSeries, path: Path, note: str) -> None:
    """A row for each time: time, the sun's elevation, and every column with its unit in its name."""
    names = ["time", "sun_elevation_deg", *(column.variable for column in series.columns)]
    names += ["moon_elevation_deg", "moon_illuminated_fraction"]
    moon = (series.moon_elevation_deg, series.moon_lit)
    cells = (
        [time.isoformat(), f"{sun:.4f}", *(_cell(values[i]) for values in series.values), *(_cell(m[i]) for m in moon)]
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
    moon = ("time", series.moon_elevation_deg, {"units": "degree", "long_name": "true elevation of the moon"})
    lit = ("time", series.moon_lit, {"units": "1", "long_name": "lit fraction of the moon's disc"})
    coords = {"time": time.astype("datetime64[ns]"), "solar_elevation_angle": sun}
    coords |= {"moon_elevation": moon, "moon_illuminated_fraction": lit}
    write_netcdf(xarray.Dataset(variables, coords, {"Conventions": "CF-1.10", **attributes}), path)


def draw(series: TimeSeries, path: Path, title: str) -> None:
    """One panel a column over the hours, twilights shaded, the moon a bar below, crossings marked."""
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
        panel.fill_between(
            series.times, 0.0, 0.03, series.moon_elevation_deg > SUNRISE_DEG, color="goldenrod",
            transform=panel.get_xaxis_transform(), linewidth=0,
        )  # fmt: skip
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
    save_figure(path, figure, 120)


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
            inside = panel.bbox.padded(1.0).containsx(box.x0) and panel.bbox.padded(1.0).containsx(box.x1)
            inside &= panel.bbox.y0 <= box.y0 and box.y1 <= panel.bbox.y1
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
