"""Tables and the picture of `twilight validate photometry`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.whole_files import whole_file, write_csv
from twilight.studies.validate.measured.photometry import Level, PhotometricPoint
from twilight.studies.validate.measured.references import KOOMEN_SITES, horizontal_illuminance_lux

POINT_COLUMNS = (
    "climate",
    "quantity",
    "site",
    "observer_altitude_km",
    "sun_elevation_deg",
    "computed",
    "of_which_night",
    "measured",
    "log10_ratio",
)
LEVEL_COLUMNS = (
    "climate",
    "quantity",
    "site",
    "sun_from_deg",
    "sun_to_deg",
    "points",
    "factor",
    "level_dex",
    "lowest_dex",
    "highest_dex",
    "slope_difference_dex_per_deg",
)


def write_points(points: Sequence[PhotometricPoint], path: Path) -> None:
    """CSV of all points; illuminance in lx, luminance in cd m^-2; empty where nothing was measured."""
    rows = []
    for p in points:
        known = np.isfinite(p.measured)
        rows.append(
            [p.climate, p.quantity, p.site, f"{p.observer_altitude_km:g}", f"{p.sun_elevation_deg:g}"]
            + [f"{p.computed:.5g}", f"{p.night:.4g}"]
            + ([f"{p.measured:.5g}", f"{p.log_ratio:+.3f}"] if known else ["", ""])
        )
    write_csv(path, POINT_COLUMNS, rows)


def level_rows(found: Sequence[Level]) -> list[list[str]]:
    """Rows of LEVEL_COLUMNS."""
    return [
        [v.climate, v.quantity, v.site, f"{v.low_deg:g}", f"{v.high_deg:g}", str(v.count), f"{v.factor:.2f}"]
        + [f"{x:+.3f}" for x in (v.level_dex, v.lowest_dex, v.highest_dex)]
        + [f"{v.slope_difference:+.4f}"]
        for v in found
    ]


def write_levels(found: Sequence[Level], path: Path) -> None:
    """CSV of levels and slopes."""
    write_csv(path, LEVEL_COLUMNS, level_rows(found))


def draw(points: Sequence[PhotometricPoint], path: Path) -> None:
    """PNG: illuminance and zenith luminance over sun elevation above, log10 ratio to the measurements below."""
    import matplotlib  # start-up

    matplotlib.use("Agg")
    from matplotlib import pyplot  # start-up

    figure: Any
    figure, axes = pyplot.subplots(
        2, 3, figsize=(15, 8), layout="constrained", gridspec_kw={"height_ratios": [2.2, 1]}, squeeze=False
    )
    panels = [("illuminance", "ground", "illuminance of level ground [lx]")]
    panels += [
        (
            "zenith luminance",
            site.name,
            f"zenith luminance, {site.name}, {1000 * site.altitude_km:.0f} m [cd m$^{{-2}}$]",
        )
        for site in KOOMEN_SITES
    ]
    climates = list(dict.fromkeys(p.climate for p in points))
    for column, (quantity, site, label) in enumerate(panels):
        top, bottom = axes[0, column], axes[1, column]
        for i, climate in enumerate(climates):
            line = [p for p in points if (p.climate, p.quantity, p.site) == (climate, quantity, site)]
            sun = [p.sun_elevation_deg for p in line]
            top.plot(sun, [p.computed for p in line], color=f"C{i}", label=climate, lw=1.4)
            if any(p.night > 0 for p in line):
                without = [p.computed - p.night for p in line]
                top.plot(sun, without, color=f"C{i}", ls=":", lw=1.2, label="without the night sky" if i == 0 else None)
            known = [p for p in line if np.isfinite(p.measured)]
            marker = None if quantity == "illuminance" else "o"
            bottom.plot(
                [p.sun_elevation_deg for p in known], [p.log_ratio for p in known], color=f"C{i}", marker=marker, lw=1.2
            )
        if quantity == "illuminance":
            fine = np.linspace(-18, 60, 400)
            measured = (fine, horizontal_illuminance_lux(fine))
            top.plot(*measured, "k--", lw=1.2, label="Janiczek and DeYoung 1987")
        else:
            first = [p for p in points if p.site == site and p.climate == climates[0] and np.isfinite(p.measured)]
            top.plot(
                [p.sun_elevation_deg for p in first],
                [p.measured for p in first],
                "ks",
                label="Koomen et al. 1952",
            )
        top.set(yscale="log", ylabel=label)
        bottom.set(xlabel="true elevation of the sun [deg]", ylabel="log$_{10}$ computed / measured", ylim=(-0.6, 0.6))
        bottom.axhspan(-0.3, 0.3, color="0.92", zorder=0)
        bottom.axhline(0, color="0.5", lw=0.8)
        for axis in (top, bottom):
            axis.grid(alpha=0.3)
        top.legend(fontsize=8)
    axes[1, 0].text(0.02, 0.03, "grey: a factor 2", transform=axes[1, 0].transAxes, fontsize=8)
    try:
        with whole_file(path) as temporary:
            figure.savefig(temporary, dpi=110)
    finally:
        pyplot.close(figure)
