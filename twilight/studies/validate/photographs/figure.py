"""The side-by-side picture of a photograph and a computed sky, as Haber 2005, Fig. 12, with the numbers beside it."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from twilight.base.whole_files import whole_file
from twilight.sky import colour
from twilight.studies.validate.photographs.mask import Mask
from twilight.studies.validate.photographs.panorama import Panorama
from twilight.studies.validate.photographs.photo import OBSERVER, Comparison, MeridianProfile

RATIO_LIMITS = (0.5, 1.0, 2.0)
"""Ranges of the ratio map, in factors of two; the first that holds 95 % of the cells is taken."""
COMPUTED = "computed sky, with the photograph's own ground, trees and clouds before it"
"""Title of the computed picture, in which none of these is computed."""
PANEL_COLUMNS = 58
"""Characters in a line of the panel of numbers, which is not cut."""
UV_LIMIT = 0.04
"""Largest distance in u'v' on the scale of its map."""


def write_figure(
    path: str | Path, comparison: Comparison, panorama: Panorama, mask: Mask, *, title: str = "", lines: tuple = ()
) -> None:
    """Write the picture as PNG, whole or not at all.

    From above: the photograph; the computed sky at the same exposure, with the photograph's foreground before it; the
    ratio of their luminances and the distance of their chromaticities where clear sky is compared; and the profiles
    through the zenith.  The sun's azimuth is in the middle.  lines: sentences for the panel of numbers.
    """
    from matplotlib.figure import Figure  # start-up

    photo, simulated, extent = _pictures(comparison, panorama, mask)
    wide = (extent[1] - extent[0]) / max(extent[3] - extent[2], 1.0)
    figure = Figure(figsize=(11, 11 if wide > 2.5 else 13), layout="constrained")
    grid = figure.add_gridspec(4, 2, height_ratios=[1, 1, 0.85, 1.15])
    for i, (name, image) in enumerate((("photograph", photo), (COMPUTED, simulated))):
        axes = figure.add_subplot(grid[i, :])
        axes.imshow(image, extent=extent, origin="lower", aspect="auto", interpolation="nearest")
        axes.set(ylabel="elevation [deg]", title=f"{name}{': ' + title if title and i == 0 else ''}")
        axes.tick_params(labelbottom=i == 1)
        axes.set_xticks(_ticks(extent))
    ratio = comparison.log_ratio / np.log(2.0)
    spread = float(np.nanpercentile(np.abs(ratio), 95))
    limit = next((r for r in RATIO_LIMITS if spread <= r), RATIO_LIMITS[-1])
    maps = (
        (ratio, "photograph / computed luminance [factors of 2]", "RdBu_r", -limit, limit),
        (comparison.delta_uv, "distance in u'v'", "viridis", 0.0, UV_LIMIT),
    )
    for i, (values, label, colours, low, high) in enumerate(maps):
        axes = figure.add_subplot(grid[2, i])
        cell = 360.0 / values.shape[1]
        centred = np.roll(values, values.shape[1] // 2, axis=1)
        box = (-180.0 - 0.5 * cell, 180.0 - 0.5 * cell, 0.0, 90.0)
        axes.set_facecolor("0.75")
        drawn = axes.imshow(
            centred, extent=box, origin="lower", aspect="auto", cmap=colours, vmin=low, vmax=high,
            interpolation="nearest",
        )  # fmt: skip
        axes.set(xlim=extent[:2], ylim=(0, extent[3]), xlabel="azimuth from the sun [deg]", title=label)
        axes.set_xticks(_ticks(extent)[::2])
        figure.colorbar(drawn, ax=axes, pad=0.01)
    profiles = figure.add_subplot(grid[3, 0])
    _draw_profile(profiles, comparison.solar, "C1", "towards the sun - zenith - away from it", 1.0)
    _draw_profile(profiles, comparison.perpendicular, "C0", "90 deg right - zenith - 90 deg left (/ 3)", 1.0 / 3.0)
    profiles.set(yscale="log", xlim=(0, 180), title="profiles: photograph (points), computed (lines)")
    profiles.set(xlabel="angle from the horizon, over the zenith [deg]", ylabel="luminance [cd m$^{-2}$]")
    profiles.set_xticks(range(0, 181, 30))
    profiles.legend(fontsize=8)
    profiles.grid(alpha=0.3)
    panel = figure.add_subplot(grid[3, 1])
    panel.axis("off")
    sentences = (*lines, *summary(comparison.figures))
    text = "\n".join(textwrap.fill(line, PANEL_COLUMNS, subsequent_indent="  ") for line in sentences)
    panel.text(0.05, 1.0, text, va="top", fontsize=8.5, family="monospace", in_layout=False)
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=84)


def _ticks(extent: tuple) -> list[float]:
    step = 30.0 if extent[1] - extent[0] > 120 else 10.0
    return [t for t in np.arange(-180.0, 181.0, step) if extent[0] <= t <= extent[1]]


def _draw_profile(axes: Any, profile: MeridianProfile, line_colour: str, label: str, scale: float) -> None:
    axes.plot(profile.angle_deg, scale * profile.simulated[:, 1], color=line_colour, lw=1.2, label=label)
    axes.plot(profile.angle_deg, scale * profile.photo[:, 1], ".", color=line_colour, ms=3.5)


def _pictures(comparison: Comparison, panorama: Panorama, mask: Mask) -> tuple[np.ndarray, np.ndarray, tuple]:
    """Display values of both (rows, columns, 3), bottom row first, the sun in the middle, cut to the photograph."""
    half = panorama.azimuth_deg.size // 2
    order = np.roll(np.arange(panorama.azimuth_deg.size), half)
    first = -180.0 + (panorama.azimuth_deg[0] - 0.5 * panorama.step_deg)
    covered = panorama.covered
    columns, rows = (
        slice(int(shown[0]), int(shown[-1]) + 1)
        for shown in (np.flatnonzero(np.asarray(covered.any(axis=0))[order]), np.flatnonzero(covered.any(axis=1)))
    )
    to_xyz = np.linalg.inv(colour.spectrum.xyz_to_rgb_matrix(OBSERVER))
    photo = comparison.balance.apply(panorama.rgb @ to_xyz.T)
    simulated = photo.copy()
    above = np.asarray(panorama.elevation_deg > 0)
    sky = comparison.simulated.fine_xyz
    foreground = _foreground(photo[above], sky, mask.foreground[above], panorama.step_deg)
    simulated[above] = np.where(foreground[..., None], photo[above], sky)
    simulated[~covered] = np.nan
    light = comparison.simulated.xyz[..., 1]
    ev100 = colour.auto_exposure_ev100(np.nan_to_num(light), comparison.photo.solid_angle_sr)
    out = []
    for xyz in (photo, simulated):
        rgb = colour.xyz_to_linear_rgb(np.nan_to_num(xyz), OBSERVER)
        shown = colour.tone_map(rgb, ev100)
        shown[~covered] = 0.75
        out.append(shown[:, order][rows, columns])
    left, right = (first + panorama.step_deg * np.array([columns.start, columns.stop])).tolist()
    bottom = panorama.elevation_deg[rows.start] - 0.5 * panorama.step_deg
    top = panorama.elevation_deg[rows.stop - 1] + 0.5 * panorama.step_deg
    return out[0], out[1], (left, right, bottom, top)


def _foreground(photo: np.ndarray, sky: np.ndarray, masked: np.ndarray, step_deg: float) -> np.ndarray:
    """What is drawn before the computed sky (e, a): from the horizon up, what is darker than it or of another colour.

    The mask of ground and trees also holds a rim of sky about them, and clouds, which would be mistaken for computed.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        unlike = photo[..., 1] < 0.75 * sky[..., 1]
        unlike |= np.hypot(*np.moveaxis(colour.uv_of_xyz(photo) - colour.uv_of_xyz(sky), -1, 0)) > 0.03
    gap = max(1, round(1.5 / step_deg))
    padded = np.pad(np.pad(unlike & masked, ((gap, gap), (0, 0)), mode="edge"), ((0, 0), (gap, gap)), mode="wrap")
    closed = ndimage.binary_closing(padded, np.ones((2 * gap + 1, gap)))[gap:-gap, gap:-gap]
    return np.logical_and.accumulate(closed, axis=0)


def summary(figures: dict[str, Any]) -> list[str]:
    """The figures in words, one line each."""

    def percent(key: str) -> str:
        return "-" if figures.get(key) is None else f"{figures[key]:.1f} %"

    correlation = figures["correlation_of_log_luminance"]
    lines = [
        f"compared: {100 * figures['fraction_of_hemisphere']:.0f} % of the hemisphere",
        f"luminance, median / rms / 95 %: {figures['luminance_median_percent']:.1f} / "
        f"{figures['luminance_rms_percent']:.1f} / {figures['luminance_p95_percent']:.1f} %",
        f"  solar meridian, rms: {percent('solar_meridian_rms_percent')}",
        f"  perpendicular meridian, rms: {percent('perpendicular_meridian_rms_percent')}",
        f"correlation of ln(luminance): {'-' if correlation is None else f'{correlation:.4f}'}",
    ]
    if "uv_distance_median" in figures:
        lines += [
            f"u'v' distance, median / 95 %: {figures['uv_distance_median']:.4f} / {figures['uv_distance_p95']:.4f}",
            f"CIEDE2000, median / 95 %: {figures['ciede2000_median']:.1f} / {figures['ciede2000_p95']:.1f}",
            f"  of the colour alone: {figures['ciede2000_colour_median']:.1f} / {figures['ciede2000_colour_p95']:.1f}",
        ]
    gains = figures["white_balance_gains"]
    balanced = "none" if gains == [1.0, 1.0, 1.0] else " ".join(f"{g:.3f}" for g in gains)
    return [*lines, f"exposure: 1 = {figures['exposure_cd_per_m2']:.4g} cd/m^2", f"white balance: {balanced}"]
