"""Tables and picture of a frontier."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_file, write_csv
from twilight.studies.frontier.measure import Measurement
from twilight.studies.frontier.search import Point, frontier
from twilight.studies.frontier.space import ZONES

SUN = "error_percent_sun_"
"""How the columns of errors begin."""
LEAST_PERCENT = 0.01
"""Smallest error of the picture [%]; smaller ones are drawn there."""
COLOURS = {"tried": "#56B4E9", "frontier": "#D55E00", "start": "#000000"}


def write_tables(points: Sequence[Point], folder: Path) -> None:
    """points.csv: every point, a row for each scene it was measured on; frontier.csv: the frontier's alone."""
    suns = sorted({sun for p in points for m in p.found.values() for sun in m.error_percent}, reverse=True)
    keys = [d.key for d in ZONES.dimensions]
    best = frontier(points)
    columns = ["point", "origin", "complete", "on_frontier", "scene", "processor_s", "peak_mib", "error_percent"]
    columns += [f"{SUN}{sun:g}" for sun in suns] + keys
    rows: list[list[Any]] = []
    for number, p in enumerate(points):
        for scene, m in p.found.items():
            by_sun = [f"{m.error_percent[sun]:.3f}" if sun in m.error_percent else "" for sun in suns]
            what = [number, p.origin, int(p.complete), int(any(p is b for b in best)), scene]
            where = [f"{p.values[key]:g}" for key in keys]
            rows.append([*what, f"{m.processor_s:.3f}", f"{m.peak_mib:.0f}", f"{m.worst_percent:.3f}", *by_sun, *where])
    write_csv(folder / "points.csv", columns, rows)
    head = ["point", "origin", "processor_s", "peak_mib", "error_percent"]
    lines = _frontier_rows(points, 3)
    values = ([f"{p.values[key]:g}" for key in keys] for p in best)
    write_csv(folder / "frontier.csv", [*head, *keys], [a + b for a, b in zip(lines, values, strict=True)])


def read_points(path: Path, scenes: Sequence[str]) -> list[Point]:
    """The points of a points.csv, which must be of the same scenes.

    Errors: TwilightError that names the file, for one that cannot be read, that is not such a table, or is of others.
    """
    try:
        with open(path, newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
        points: dict[int, Point] = {}
        for row in rows:
            values = {d.key: int(row[d.key]) if d.whole else float(row[d.key]) for d in ZONES.dimensions}
            point = points.setdefault(int(row["point"]), Point(values, row["origin"]))
            point.complete = row["complete"] == "1"
            suns = {key.removeprefix(SUN): float(text) for key, text in row.items() if key.startswith(SUN) and text}
            errors = {float(sun): error for sun, error in suns.items()}
            point.found[row["scene"]] = Measurement(float(row["processor_s"]), errors, float(row["peak_mib"]))
    except OSError as error:
        raise TwilightError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (KeyError, ValueError, TypeError, csv.Error, UnicodeDecodeError):
        raise TwilightError(f"{path}: is no table of points that `twilight frontier` wrote") from None
    found = {name for point in points.values() for name in point.found}
    if other := found.symmetric_difference(scenes):
        raise TwilightError(f"{path}: is not of the same scenes: {', '.join(sorted(other))}; resume takes those alone")
    return list(points.values())


def printed(points: Sequence[Point]) -> list[list[str]]:
    """Rows (point, origin, processor time, memory, error) of the frontier for the terminal."""
    return _frontier_rows(points, 2)


def _frontier_rows(points: Sequence[Point], digits: int) -> list[list[str]]:
    number = {id(p): str(n) for n, p in enumerate(points)}
    return [
        [number[id(p)], p.origin, f"{p.processor_s:.{digits}f}", f"{p.peak_mib:.0f}", f"{p.error_percent:.{digits}f}"]
        for p in frontier(points)
    ]


def draw(points: Sequence[Point], path: Path, title: str) -> None:
    """PNG, log-log: the points measured on every scene, the frontier as a line, qualities by name."""
    import matplotlib  # start-up

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    best = frontier(points)
    with pyplot.rc_context({"font.size": 11, "axes.spines.top": False, "axes.spines.right": False}):
        figure: Any
        figure, axes = pyplot.subplots(figsize=(7.2, 5.0), layout="constrained")
        axes.set(xscale="log", yscale="log")
        axes.grid(which="major", color="0.9", linewidth=0.8)
        axes.set_axisbelow(True)
        given_up = sum(not p.complete for p in points)
        for name, some in (
            ("tried", [p for p in points if p.complete and p.origin == "search"]),
            ("start", [p for p in points if p.complete and p.origin != "search"]),
        ):
            label = f"tried ({given_up} more were given up)" if name == "tried" and given_up else name
            size = 22 if name == "start" else 14
            if some:
                axes.scatter(*_along(some), s=size, color=COLOURS[name], label=label, linewidths=0)
        axes.step(*_along(best), where="post", color=COLOURS["frontier"], linewidth=1.6, label="frontier")
        for p in points:
            if p.complete and p.origin in ("draft", "standard", "reference"):
                axes.annotate(p.origin, _place(p), xytext=(5, 5), textcoords="offset points", fontsize=10)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, position: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
        axes.set_xlabel("processor time of the field [s]")
        axes.set_ylabel("error of the radiance at 95 % [%]")
        axes.set_title(title, loc="left", fontsize=11)
        axes.legend(frameon=False, fontsize=9)
        try:
            with whole_file(path) as temporary:
                figure.savefig(temporary, dpi=150)
        finally:
            pyplot.close(figure)


def _place(point: Point) -> tuple[float, float]:
    return point.processor_s, max(point.error_percent, LEAST_PERCENT)


def _along(points: Sequence[Point]) -> tuple[list[float], list[float]]:
    places = [_place(p) for p in points]
    return [x for x, _ in places], [y for _, y in places]
