"""The map of limiting magnitude: the whole sky, zenith in the middle, as an observer who lies on the back sees it."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.whole_files import whole_file
from twilight.engine.light import Moments
from twilight.engine.visibility import NakedEye
from twilight.sky.objects import NAKED_EYE_PLANETS, tracks

ROWS_DEG = np.concatenate([np.arange(1.0, 15.0, 2.0), np.arange(15.0, 91.0, 5.0)])
"""Apparent elevations of the map [deg]."""
COLUMNS_DEG = np.arange(0.0, 361.0, 7.5)
"""Azimuths of the map, from north [deg]."""
STEP_MAG = 0.5
"""Step of the colours [mag]."""
DEEPEST_MAG = 6.0
"""Range of the colours below the faintest limit of the map [mag]."""


def limits(eye: NakedEye, moment: Moments) -> np.ndarray:
    """Limiting magnitude over `ROWS_DEG` and `COLUMNS_DEG`, (rows, columns), at one moment."""
    e, a = np.meshgrid(ROWS_DEG, COLUMNS_DEG[:-1], indexing="ij")
    found = eye.limit(moment, e.reshape(1, -1), a.reshape(1, -1)).reshape(e.shape)
    return np.concatenate([found, found[:, :1]], axis=1)


def draw_map(eye: NakedEye, latitude_deg: float, longitude_deg: float, time: dt.datetime, path: Path) -> np.ndarray:
    """Draw the limiting magnitude of a moment into a PNG, whole or not at all; returns the values of `limits`."""
    from matplotlib.figure import Figure  # start-up

    moment = eye.moments(latitude_deg, longitude_deg, [time])
    values = limits(eye, moment)
    figure = Figure(figsize=(7.2, 6.6), layout="constrained")
    axes: Any = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(1)  # east is left, as one who lies on the back has it
    azimuth, zenith_deg = np.radians(COLUMNS_DEG), 90.0 - ROWS_DEG
    low, high = max(np.nanmin(values), np.nanmax(values) - DEEPEST_MAG), np.nanmax(values)
    levels = STEP_MAG * np.arange(np.floor(low / STEP_MAG), np.ceil(high / STEP_MAG) + 1.0)
    shown = axes.contourf(azimuth, zenith_deg, values, levels, cmap="cividis", extend="min")
    for k, track in enumerate(tracks([*NAKED_EYE_PLANETS, "moon"], [time], latitude_deg, longitude_deg)):
        height = float(eye.seen_at(track.elevation_deg)[0][0])
        if np.isfinite(height):
            where = np.radians(track.azimuth_deg[0]), 90.0 - height
            axes.plot(*where, "o", color="white", markersize=5, markeredgecolor="black")
            left = np.sin(where[0]) < 0.0 and height < 30.0
            axes.annotate(
                f"{track.name} {track.magnitude[0]:.1f}", where, (-6 if left else 6, 4 if k % 2 else -10),
                textcoords="offset points", ha="right" if left else "left", fontsize=8,
                bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.7, "linewidth": 0.0},
            )  # fmt: skip
    axes.set_rlim(0.0, 90.0)
    axes.set_rgrids([30.0, 60.0], ["60°", "30°"], fontsize=8)
    axes.set_thetagrids(np.arange(0, 360, 90), ["N", "E", "S", "W"])
    axes.grid(alpha=0.3)
    axes.set_title(
        f"{time.isoformat(sep=' ', timespec='minutes')}, sun at {float(moment.sun_elevation_deg[0]):.1f}°, "
        f"{eye.field.solved.scene.configuration.title}, F = {eye.field_factor:g}",
        fontsize=10,
    )
    figure.colorbar(shown, label="faintest star that is seen [V mag, above the air]", shrink=0.85)
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=130)
    return values
