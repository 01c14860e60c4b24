"""Tables and figure of a comparison: CSV files, printed tables, and error against run time for each sun and solver."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twilight.base.errors import TwilightError
from twilight.base.whole_files import save_figure, write_csv
from twilight.studies.compare.accuracy import ErrorQuantiles
from twilight.studies.compare.comparison import ComparisonRow

_QUANTILES = ("median", "p95", "max", "mean", "noise_median", "noise_p95", "noise_max")
TABLE_COLUMNS = (
    *("solver", "quality", "sun_elevation_deg"),
    *(f"{name}_percent" for name in _QUANTILES),
    *(f"ciede2000_{name}" for name in ("median", "p95", "max", "noise_median")),
    *(f"luminance_{name}_percent" for name in ("median", "p95", "max")),
    *("time_s", "set_up_s", "sky_s", "runs", "directions_timed", "cpu_s", "sky_cpu_s", "compiled_s"),
    *("peak_memory_mib", "memory_before_mib", "radiances_per_s", "threads", "load_average"),
    "reason",
)
WAVELENGTH_COLUMNS = (
    *("solver", "quality", "sun_elevation_deg", "wavelength_nm"),
    *(f"{name}_percent" for name in _QUANTILES),
)


def write_tables(rows: Iterable[ComparisonRow], folder: Path) -> list[Path]:
    """`compare.csv`, one line for each solver, quality and sun, and `wavelengths.csv`, its errors by wavelength."""
    rows = list(rows)
    by_wavelength = []
    for row in rows:
        for nm, errors in row.by_wavelength.items():
            by_wavelength.append([*_names(row), _number(nm), *_quantile_cells(errors)])
    return [
        write_csv(folder / "compare.csv", TABLE_COLUMNS, [_cells(row) for row in rows]),
        write_csv(folder / "wavelengths.csv", WAVELENGTH_COLUMNS, by_wavelength),
    ]


def _names(row: ComparisonRow) -> list[str]:
    return [row.preset.solver, row.preset.quality, f"{row.sun_elevation_deg:g}"]


def _quantile_cells(errors: ErrorQuantiles | None) -> list[str]:
    if errors is None:
        return [""] * len(_QUANTILES)
    e = errors
    return [_number(v) for v in (e.median, e.p95, e.largest, e.mean, e.noise_median, e.noise_p95, e.noise_largest)]


def _cells(row: ComparisonRow) -> list[str]:
    colour = [""] * 7
    if row.colour is not None:
        c, y = row.colour.ciede2000, row.colour.luminance
        colour = [_number(v) for v in (c.median, c.p95, c.largest, c.noise_median, y.median, y.p95, y.largest)]
    time = [""] * 13
    t = row.timing
    if t is not None:
        times = (row.time_s, row.set_up_s, row.sky_s, len(t.sky_s), t.directions, row.cpu_s, row.sky_cpu_s)
        rest = (t.compiled_s, t.peak_mib, t.before_mib, row.radiances_per_s, t.threads, t.load)
        time = [_number(v) for v in (*times, *rest)]
    return [*_names(row), *_quantile_cells(row.error), *colour, *time, row.reason]


def _number(value: float) -> str:
    return f"{value:.4g}" if isinstance(value, float) and value < 1e4 else f"{round(value)}"


PRINTED = ("sun", "solver", "med. %", "95 %", "max %", "ΔE00", "lum. %", "time s", "MiB")


def printed(rows: Iterable[ComparisonRow]) -> list[list[str]]:
    """Lines of the columns `PRINTED`: errors of the radiance (median, 95th percentile, largest), CIEDE2000 and error of
    the luminance (medians), time of one sky with its set-up, peak memory.

    An error below half of the reference solution's noise is shown as `<` that half.
    """
    lines = []
    for row in sorted(rows, key=lambda r: -r.sun_elevation_deg):
        error, colour = row.error, row.colour
        cells = [f"{row.sun_elevation_deg:+g}", row.preset.name]
        cells += ["-", "-", "-"] if error is None else [
            _resolved(error.median, error.noise_median),
            _resolved(error.p95, error.noise_p95),
            _resolved(error.largest, error.noise_largest),
        ]  # fmt: skip
        cells += ["", ""] if colour is None else [
            _resolved(colour.ciede2000.median, colour.ciede2000.noise_median),
            _resolved(colour.luminance.median, colour.luminance.noise_median),
        ]  # fmt: skip
        if row.timing is None:
            cells += ["", ""]
        else:
            about = "" if row.timing.directions == row.texture_directions else "~"
            cells += [f"{about}{row.time_s:.3g}", f"{row.timing.peak_mib:.0f}"]
        lines.append(cells)
    return lines


def remarks(rows: Iterable[ComparisonRow]) -> list[str]:
    """A sentence on how to read the table, and one for each reason why something is missing."""
    rows = list(rows)
    lines = []
    noise = [row.error.noise_median for row in rows if row.error is not None and row.error.noise_median > 0]
    if noise:
        lines.append(
            f"the reference solution's own error, {min(noise):.2g} to {max(noise):.2g} % in the median, "
            "is taken out in quadrature"
        )
    if any(row.timing and row.timing.directions != row.texture_directions for row in rows):
        lines.append("~: timed in the directions of the reference solution and scaled to the whole texture")
    busy = max((row.timing.load - row.timing.threads for row in rows if row.timing), default=0.0)
    if busy > 1.0:
        lines.append(f"the machine had about {busy:.0f} other busy threads: wall times are too long, see cpu_s")
    reasons: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row.reason:
            reasons.setdefault((row.preset.name, row.reason), []).append(f"{row.sun_elevation_deg:+g}")
    lines += [f"{name}, sun {', '.join(suns)} deg: {reason}" for (name, reason), suns in reasons.items()]
    return lines


def _resolved(value: float, noise: float) -> str:
    return f"<{noise / 2:.2g}" if value < noise / 2 else f"{value:.2g}" if value < 100 else f"{value:.0f}"


# Okabe and Ito's colours, which differ for every kind of colour vision, a grey and a brown
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C8C8C", "#6B4423")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "p", "<")
JOINED_QUALITIES = ("draft", "standard", "reference")
"""Qualities that a line joins; others stand alone."""
LEAST_SAVED = 0.8
"""One more sky has a mark of its own where it takes less than this part of a first one."""
LARGEST_PERCENT = 200.0
"""Errors beyond this are drawn here, hollow."""


@dataclass(frozen=True)
class FigurePoint:
    """A mark: the error [%] over the directions and wavelengths, and the time of a first sky [s], set-up included.

    more_s: of one more sky of the same air; nan where it is not known.
    noise_percent: the part of the error that the reference's own noise would give, already taken out.
    memory_mib: the most that its process held; nan where it was not measured.  time_s is nan for radiances that were
    computed elsewhere.
    """

    solver: str
    quality: str
    sun_elevation_deg: float
    time_s: float
    error_percent: float
    noise_percent: float = 0.0
    memory_mib: float = math.nan
    more_s: float = math.nan

    @property
    def resolved(self) -> bool:
        return self.error_percent >= 0.5 * self.noise_percent

    @property
    def drawn_percent(self) -> float:
        return min(max(self.error_percent, 0.5 * self.noise_percent, 1e-3), LARGEST_PERCENT)


def points(rows: Iterable[ComparisonRow]) -> list[FigurePoint]:
    """The marks of the rows that hold an error and a time: 95th percentiles."""
    return [
        FigurePoint(
            r.preset.solver,
            r.preset.quality,
            r.sun_elevation_deg,
            r.time_s,
            r.error.p95,
            r.error.noise_p95,
            r.timing.peak_mib,
            r.sky_s,
        )
        for r in rows
        if r.error is not None and r.timing is not None
    ]


def read_points(path: str | Path, *, processor: bool = False) -> list[FigurePoint]:
    """The marks of a `compare.csv`, or of any table with its columns solver, quality, sun_elevation_deg, time_s and
    p95_percent (and noise_p95_percent, peak_memory_mib, sky_s); with `processor` their times are processor times, from
    cpu_s and sky_cpu_s.

    Errors: TwilightError for a file that cannot be read or has other columns.
    """
    points = []
    column, more = ("cpu_s", "sky_cpu_s") if processor else ("time_s", "sky_s")
    try:
        with open(path, newline="", encoding="utf-8") as stream:
            for row in csv.DictReader(line for line in stream if not line.startswith("#")):
                if row[column] and row["p95_percent"]:
                    points.append(
                        FigurePoint(
                            row["solver"],
                            row["quality"],
                            float(row["sun_elevation_deg"]),
                            float(row[column]),
                            float(row["p95_percent"]),
                            float(row.get("noise_p95_percent") or 0.0),
                            float(row.get("peak_memory_mib") or "nan"),
                            float(row.get(more) or "nan"),
                        )
                    )
    except (OSError, KeyError, ValueError) as error:
        raise TwilightError(f"{path}: is not a table of errors and times: {error}") from None
    return points


def draw(
    marks: Sequence[FigurePoint],
    path: Path,
    *,
    title: str = "",
    time_label: str = "time of a first sky, and of one more (small) [s]",
    columns: int = 4,
    panel_inches: tuple[float, float] = (2.4, 2.5),
) -> bool:
    """PNG of the marks, log-log; False where there is nothing to draw and no file is written."""
    marks = [m for m in marks if m.time_s > 0]
    if not marks:
        return False
    from matplotlib import rc_context  # optional
    from matplotlib.figure import Figure

    suns = sorted({m.sun_elevation_deg for m in marks}, reverse=True)
    columns = min(columns, len(suns))
    rows = math.ceil(len(suns) / columns)
    with rc_context({"font.size": 11, "axes.spines.top": False, "axes.spines.right": False}):
        inches = max(columns * panel_inches[0], 5.0) + 0.5, rows * panel_inches[1] + 1.1
        figure = Figure(figsize=inches, layout="constrained")
        grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        solvers = list(dict.fromkeys(m.solver for m in marks))
        for axes, sun in zip(grid.flat, suns, strict=False):
            _panel(axes, [m for m in marks if m.sun_elevation_deg == sun], solvers)
            axes.set_title(f"sun {sun:g}°".replace("-", "−"), fontsize=11, loc="left")
        for axes in grid.flat[len(suns) :]:
            axes.set_visible(False)
        _limits(grid[0, 0], marks)
        figure.supxlabel(time_label, fontsize=11)
        figure.supylabel("error of the radiance," + ("\n" if rows == 1 else " ") + "95th percentile [%]", fontsize=11)
        _heading(figure, {name: _memory(m for m in marks if m.solver == name) for name in solvers}, title)
        save_figure(path, figure, 150)
    return True


def _panel(axes: Any, marks: Sequence[FigurePoint], solvers: Sequence[str]) -> None:
    axes.set(xscale="log", yscale="log")
    axes.grid(which="major", color="0.88", linewidth=0.8)
    axes.set_axisbelow(True)
    noise = [m.noise_percent for m in marks if m.noise_percent > 0]
    if noise:
        axes.axhspan(1e-6, 0.5 * max(noise), color="0.93", linewidth=0)
    for i, solver in enumerate(solvers):
        joined = [m for m in marks if m.solver == solver and m.quality in JOINED_QUALITIES]
        joined.sort(key=lambda m: JOINED_QUALITIES.index(m.quality))
        line = [m.time_s for m in joined], [m.drawn_percent for m in joined]
        axes.plot(*line, color=COLOURS[i % len(COLOURS)], linewidth=1.6)
    for solver in solvers:
        style = {"color": COLOURS[solvers.index(solver) % len(COLOURS)]}
        marker = MARKERS[solvers.index(solver) % len(MARKERS)]
        own = [m for m in marks if m.solver == solver]
        for m in own:
            solid = m.resolved and m.quality in JOINED_QUALITIES and m.error_percent <= LARGEST_PERCENT
            fill = style["color"] if solid else "white"
            axes.plot(
                m.time_s, m.drawn_percent, marker=marker, markersize=6, markerfacecolor=fill, linestyle="none", **style
            )
            if m.more_s < LEAST_SAVED * m.time_s:
                across = [m.more_s, m.time_s], [m.drawn_percent] * 2
                axes.plot(*across, marker=marker, markersize=3, markevery=[0], linestyle=":", linewidth=0.8, **style)


def _limits(axes: Any, marks: Sequence[FigurePoint]) -> None:
    """The same limits for all panels, of at least a decade each so that every axis has a labelled tick."""
    from matplotlib.ticker import FuncFormatter, NullFormatter  # optional

    formatter = FuncFormatter(lambda value, position: f"{value:g}")
    for axis, values, set_limits in (
        (axes.xaxis, [t for m in marks for t in (m.time_s, m.more_s) if t > 0.0], axes.set_xlim),
        (axes.yaxis, [m.drawn_percent for m in marks], axes.set_ylim),
    ):
        low, high = math.log10(min(values)) - 0.2, math.log10(max(values)) + 0.2
        more = max(0.0, 1.05 - (high - low)) / 2.0
        set_limits(10.0 ** (low - more), 10.0 ** (high + more))
        axis.set_major_formatter(formatter)
        axis.set_minor_formatter(NullFormatter())


def _memory(marks: Iterable[FigurePoint]) -> str:
    """The least and the most that the qualities of a solver hold, in words; empty where it is not known."""
    known = [m.memory_mib / 1024.0 for m in marks if math.isfinite(m.memory_mib)]
    if not known:
        return ""
    low, high = f"{min(known):.1f}", f"{max(known):.1f}"
    return f" ({low} GiB)" if low == high else f" ({low} to {high} GiB)"


def _heading(figure: Any, solvers: Mapping[str, str], title: str) -> None:
    """The legend: names of the solvers, each with the memory of its process."""
    from matplotlib.lines import Line2D  # optional

    handles = []
    for i, (name, held) in enumerate(solvers.items()):
        colour, marker = COLOURS[i % len(COLOURS)], MARKERS[i % len(MARKERS)]
        handles.append(Line2D([], [], color=colour, marker=marker, linewidth=1.6, label=name + held))
    figure.legend(
        handles=handles,
        title=title or None,
        alignment="left",
        loc="outside upper left",
        ncols=min(len(handles), 4) if any(solvers.values()) else len(handles),
        frameon=False,
        columnspacing=1.4,
        handletextpad=0.5,
        borderaxespad=0.2,
    )
