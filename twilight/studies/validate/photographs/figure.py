"""What is written of a comparison: the side-by-side picture as Haber 2005, Fig. 12, and files of its numbers."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import xarray
from scipy import ndimage

from twilight.base.whole_files import save_figure, whole_file
from twilight.io.netcdf import write_netcdf
from twilight.sky import colour
from twilight.sky.sky import Sky
from twilight.studies.validate.photographs.comparison import Comparison, MeridianProfile
from twilight.studies.validate.photographs.mask import GROW_DEG
from twilight.studies.validate.photographs.picture_sky import OBSERVER

RATIO_LIMITS = (0.5, 1.0, 2.0)
"""Ranges of the ratio map, in factors of two; the first that holds 95 % of the cells is taken."""
PANEL_COLUMNS = 58
"""Characters in a line of the panel of numbers, which is not cut."""
LINE_INCHES = 0.165
"""Height of such a line."""
UV_LIMIT = 0.04
"""Largest distance in u'v' on the scale of its map."""
WIDE = 2.5
"""Width over height beyond which pictures stand below each other."""
REPORT = ("comparison.png", "figures.json", "comparison.h5")
"""Files that are written of a comparison."""
DARKER = 0.7
"""Luminance of ground and trees over the computed sky behind them, at most; what is brighter is sky or cloud."""


def write_figure(path: str | Path, comparison: Comparison, *, title: str = "", lines: tuple[str, ...] = ()) -> None:
    """Write the picture as PNG, whole or not at all.

    The photograph; the computed sky at the same exposure, alone, and behind the photograph's own ground; the ratio of
    luminances and the distance of chromaticities where clear sky is compared; the profiles through the zenith.  The
    sun's azimuth is in the middle.  lines: sentences for the panel of numbers.
    """
    from matplotlib.figure import Figure  # optional

    pictures, extent = _pictures(comparison)
    wide = (extent[1] - extent[0]) / max(extent[3] - extent[2], 1.0) > WIDE
    sentences = (*lines, *summary(comparison.figures))
    wrapped = [textwrap.fill(line, PANEL_COLUMNS, subsequent_indent="  ") for line in sentences]
    last = max(3.2, LINE_INCHES * (sum(1 + text.count("\n") for text in wrapped) + 1))
    left, middle, right, half, rest, across = (slice(*ends) for ends in ((2,), (2, 4), (4, 6), (3,), (3, 6), (6,)))
    if wide:
        heights, width = [2.4, 2.4, 2.4, 2.3, last], 11.0
        places, maps, bottom = [(k, across) for k in range(3)], [(3, half), (3, rest)], [(4, half), (4, rest)]
    else:
        heights, width = [3.4, 3.4, last], 15.0
        places, maps = [(0, left), (0, middle), (0, right)], [(1, left), (1, middle)]
        bottom = [(1, right), (2, across)]
    figure = Figure(figsize=(width, sum(heights) + 0.4), layout="constrained")
    grid = figure.add_gridspec(len(heights), 6, height_ratios=heights)
    names = [
        f"photograph{': ' + title if title else ''}",
        "computed sky alone",
        "computed, behind the photograph's ground",
    ]
    for place, name, image in zip(places, names, pictures, strict=True):
        axes = figure.add_subplot(grid[place[0], place[1]])
        axes.imshow(image, extent=extent, origin="lower", aspect="auto" if wide else "equal", interpolation="nearest")
        axes.set_title(name, fontsize=10 if wide else 9)
        axes.set(ylabel="elevation [deg]")
        axes.set_xticks(_ticks(extent))
    ratio = comparison.log_ratio / np.log(2.0)
    spread = float(np.nanpercentile(np.abs(ratio), 95))
    limit = next((r for r in RATIO_LIMITS if spread <= r), RATIO_LIMITS[-1])
    drawn_maps = (
        (ratio, "photograph / computed [factors of 2]", "RdBu_r", -limit, limit),
        (comparison.delta_uv, "distance in u'v'", "viridis", 0.0, UV_LIMIT),
    )
    for place, (values, label, colours, low, high) in zip(maps, drawn_maps, strict=True):
        axes = figure.add_subplot(grid[place[0], place[1]])
        cell = 360.0 / values.shape[1]
        centred = np.roll(values, values.shape[1] // 2, axis=1)
        box = (-180.0 - 0.5 * cell, 180.0 - 0.5 * cell, 0.0, 90.0)
        axes.set_facecolor("0.75")
        drawn = axes.imshow(
            centred, extent=box, origin="lower", aspect="auto", cmap=colours, vmin=low, vmax=high,
            interpolation="nearest",
        )  # fmt: skip
        axes.set(xlim=extent[:2], ylim=(0, extent[3]), xlabel="azimuth from the sun [deg]")
        axes.set_title(label, fontsize=10)
        axes.set_xticks(_ticks(extent)[::2])
        figure.colorbar(drawn, ax=axes, pad=0.01)
    profiles = figure.add_subplot(grid[bottom[0][0], bottom[0][1]])
    _draw_profile(profiles, comparison.solar, "C1", "towards the sun - zenith - away", 1.0)
    _draw_profile(profiles, comparison.perpendicular, "C0", "90 deg right - zenith - 90 deg left (/ 3)", 1.0 / 3.0)
    profiles.set(yscale="log", xlim=(0, 180))
    profiles.set_title("profiles: photograph (points), computed (lines)", fontsize=10)
    profiles.set(xlabel="angle from the horizon, over the zenith [deg]", ylabel="luminance [cd m$^{-2}$]")
    profiles.set_xticks(range(0, 181, 30))
    profiles.legend(fontsize=7, loc="best")
    profiles.grid(alpha=0.3)
    panel = figure.add_subplot(grid[bottom[1][0], bottom[1][1]])
    panel.axis("off")
    panel.text(0.02, 1.0, "\n".join(wrapped), va="top", fontsize=8.0, family="monospace")
    save_figure(path, figure, 84)


def _ticks(extent: tuple) -> list[float]:
    step = 30.0 if extent[1] - extent[0] > 120 else 10.0
    return [t for t in np.arange(-180.0, 181.0, step) if extent[0] <= t <= extent[1]]


def _draw_profile(axes: Any, profile: MeridianProfile, line_colour: str, label: str, scale: float) -> None:
    axes.plot(profile.angle_deg, scale * profile.simulated[:, 1], color=line_colour, lw=1.2, label=label)
    axes.plot(profile.angle_deg, scale * profile.photo[:, 1], ".", color=line_colour, ms=3.5)


def _pictures(comparison: Comparison) -> tuple[list[np.ndarray], tuple]:
    """Display values (rows, columns, 3), bottom row first, the sun in the middle, cut to the photograph: the
    photograph, the sky alone and behind the ground."""
    seen = comparison.photo
    half = seen.columns_deg.size // 2
    order = np.roll(np.arange(seen.columns_deg.size), half)
    first = -180.0 + (seen.columns_deg[0] - 0.5 * seen.step_deg)
    covered = seen.covered
    columns, rows = (
        slice(int(shown[0]), int(shown[-1]) + 1)
        for shown in (np.flatnonzero(np.asarray(covered.any(axis=0))[order]), np.flatnonzero(covered.any(axis=1)))
    )
    to_xyz = np.linalg.inv(colour.spectrum.xyz_to_rgb_matrix(OBSERVER))
    photo = comparison.balance.apply(seen.rgb @ to_xyz.T)
    above = np.asarray(seen.rows_deg > 0)

    def alone(fine: np.ndarray) -> np.ndarray:
        xyz = np.full_like(photo, np.nan)
        xyz[above] = np.where(covered[above][..., None], fine, np.nan)
        return xyz

    sky = comparison.simulated.fine_xyz
    ground = foreground(photo[above], sky, seen.foreground[above], seen.step_deg)[..., None]
    behind = photo.copy()
    behind[above] = np.where(ground > 0.0, ground * np.nan_to_num(photo[above]) + (1.0 - ground) * sky, sky)
    behind[~covered] = np.nan
    computed, out = comparison.simulated, []
    ev100 = float(colour.auto_exposure_ev100(np.nan_to_num(computed.xyz[..., 1]), computed.solid_angle_sr))
    for xyz in (photo, alone(sky), behind):
        image = colour.tone_map(colour.xyz_to_linear_rgb(np.nan_to_num(xyz), OBSERVER), ev100)
        image[~np.isfinite(xyz[..., 1])] = 0.75
        out.append(image[:, order][rows, columns])
    left, right = (first + seen.step_deg * np.array([columns.start, columns.stop])).tolist()
    bottom = seen.rows_deg[rows.start] - 0.5 * seen.step_deg
    top = seen.rows_deg[rows.stop - 1] + 0.5 * seen.step_deg
    return out, (left, right, bottom, top)


def foreground(photo: np.ndarray, sky: np.ndarray, masked: np.ndarray, step_deg: float) -> np.ndarray:
    """Opacity (e, a), 0 to 1, of what is drawn before the computed sky: ground and trees, rows from the horizon up.

    The mask also holds a rim of sky, by which it was grown and is made smaller again, and clouds: what is brighter than
    `DARKER` of the computed sky, or does not stand on the ground, is none, unless it is below what does.
    """
    rim = max(1, round(GROW_DEG / step_deg))
    reach = np.arange(-rim, rim + 1)
    disc = reach[:, None] ** 2 + reach**2 <= rim**2
    below = np.concatenate([np.ones((rim + 1, masked.shape[1]), bool), masked])
    wrapped = np.pad(below, ((0, 0), (rim, rim)), mode="wrap")
    inner = ndimage.binary_erosion(wrapped, disc, border_value=1)[rim + 1 :, rim:-rim]
    with np.errstate(invalid="ignore"):
        dark = photo[..., 1] < DARKER * sky[..., 1]
    # thin things, as branches, are narrower than what was taken off; they are dark themselves
    kept = (inner | masked) & dark
    standing = np.concatenate([np.ones((1, kept.shape[1]), bool), kept])
    labels, _ = ndimage.label(np.pad(standing, ((0, 0), (1, 1)), mode="wrap"), np.ones((3, 3)))
    solid = (labels == labels[0, 0])[1:, 1:-1]
    solid |= inner & (np.cumsum(solid[::-1], axis=0)[::-1] > 0)  # a bright wall below its dark edge
    return np.where(solid, 1.0, 0.0)


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
        uv = figures["uv_distance_median"], figures["uv_distance_p95"]
        lines.append("u'v' distance, median / 95 %: {:.4f} / {:.4f}".format(*uv))
    gains = figures["white_balance_gains"]
    balanced = "none" if gains == [1.0, 1.0, 1.0] else " ".join(f"{g:.3f}" for g in gains)
    return [*lines, f"exposure: 1 = {figures['exposure_cd_per_m2']:.4g} cd/m^2", f"white balance: {balanced}"]


# Files ----------------------------------------------------------------------------------------------------------


def write_report(
    folder: Path,
    comparison: Comparison,
    sky: Sky,
    facts: dict[str, Any],
    lines: tuple[str, ...],
) -> None:
    """Write `REPORT` of one photograph beside its computed sky into a folder, which is made where it is missing.

    facts: of the photograph, its name among them; lines: for the picture.
    """
    folder.mkdir(parents=True, exist_ok=True)
    said = {"sun_elevation_deg": sky.sun_elevation_deg, **facts, "masked": comparison.photo.taken}
    said |= {"figures": comparison.figures, "computed_sky": sky.provenance}
    write_figure(folder / "comparison.png", comparison, title=facts["photograph"], lines=lines)
    write_json(folder / "figures.json", said)
    write_dataset(folder / "comparison.h5", comparison, said)


def write_json(path: str | Path, facts: dict[str, Any]) -> None:
    """Write facts as JSON; numbers that are not finite become null."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(_plain(facts), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def write_dataset(path: str | Path, comparison: Comparison, facts: dict[str, Any]) -> None:
    """Write photograph and simulation with all maps, NaN where masked, as HDF5 that is netCDF-4; facts: as JSON."""
    photo, grid = comparison.photo, ("elevation", "azimuth")
    light = {"long_name": "CIE 1931 tristimulus values, Y is the luminance", "units": "cd m-2"}
    maps = {
        "log_ratio": (comparison.log_ratio, "ln(photograph / computed) luminance", "1"),
        "delta_uv": (comparison.delta_uv, "distance in CIE 1976 u', v'", "1"),
        "solid_angle": (photo.solid_angle_sr, "clear part of the cell", "sr"),
    }
    variables = {
        "photograph_xyz": ((*grid, "tristimulus"), comparison.photo_xyz, light),
        "computed_xyz": ((*grid, "tristimulus"), comparison.simulated.xyz, light),
        **{name: (grid, values, {"long_name": text, "units": unit}) for name, (values, text, unit) in maps.items()},
    }
    coordinates = {
        "elevation": ("elevation", photo.elevation_deg, {"units": "degree", "long_name": "elevation"}),
        "azimuth": ("azimuth", photo.azimuth_deg, {"units": "degree", "long_name": "azimuth from the sun, clockwise"}),
        "tristimulus": ("tristimulus", ["X", "Y", "Z"]),
    }
    attributes = {"title": "Photograph and computed sky", "facts": json.dumps(_plain(facts))}
    encoding = {name: {"zlib": True, "complevel": 4, "dtype": "float32"} for name in variables}
    write_netcdf(xarray.Dataset(variables, coordinates, attributes), path, encoding)
