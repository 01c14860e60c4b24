"""The tables of a comparison: CSV files and what is printed."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from twilight.base.whole_files import write_csv
from twilight.studies.compare.accuracy import ErrorQuantiles
from twilight.studies.compare.comparison import ComparisonRow

_QUANTILES = ("median", "p95", "max", "mean", "noise_median", "noise_p95", "noise_max")

TABLE_COLUMNS = (
    *("solver", "quality", "sun_elevation_deg"),
    *(f"{name}_percent" for name in _QUANTILES),
    *(f"ciede2000_{name}" for name in ("median", "p95", "max", "noise_median")),
    *(f"luminance_{name}_percent" for name in ("median", "p95", "max")),
    *("time_s", "set_up_s", "sky_s", "runs", "directions_timed", "cpu_s", "compiled_s"),
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
    time = [""] * 12
    t = row.timing
    if t is not None:
        times = (row.time_s, row.set_up_s, row.sky_s, len(t.sky_s), t.directions, row.cpu_s, t.compiled_s)
        rest = (t.peak_mib, t.before_mib, row.radiances_per_s, t.threads, t.load)
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
