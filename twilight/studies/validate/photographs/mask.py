"""What of a photograph is clear sky: ground, trees, clouds, saturated pixels and the sun's glare are masked.

The automatic mask assumes a sky that is smooth and continuous, as a clear sky is, and takes what is connected with the
upper part of the photograph.  It finds buildings, trees, hills, poles and clouds with edges.  It does not see what is
as smooth as the sky: thin cirrus, fog, an overcast, an evenly lit wall that reaches the top of the photograph.  A mask
image can be given instead or in addition.

How a camera was held, from the picture alone: the line along which bright sky ends at dark ground.

In every column the step from light to dark that is largest is a candidate; the line that most of them lie on, in the
camera's own directions, is the horizon, and its normal the vertical.  Hills and houses stand above the true horizon, so
that the camera is taken to have looked lower than it did; `SKYLINE_ERROR_DEG` stands for that.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from twilight.io.stored_image import StoredImage, read_samples
from twilight.sky.colour import REC709_LUMINANCE
from twilight.studies.camera.model import CameraModel
from twilight.studies.validate.photographs.picture_sky import PhotoSky

EDGE = 0.05
"""Second difference of ln(RGB) between neighbouring cells beyond which a cell is an edge and no sky."""
EDGE_OVER_NOISE = 3.0
"""In a noisy photograph: EDGE is raised, up to three times, to this many times the median over its upper half."""
EDGE_STEP_DEG = 0.5
"""Distance of the neighbouring cells for which EDGE is meant [deg]."""
EDGE_SMALLEST_SQUARE_DEG = 0.4
"""Edge cells that together are smaller than this are noise [deg^2]."""
DARK_GROUND = 0.5
"""Luminance over the median of the sky at the same elevation below which ground is told from cloud."""
GROW_DEG = 1.0
"""Distance from an edge at which the sky begins [deg]: bloom, and cells that are partly something else."""
CLOUD_BRIGHTER = 0.04
"""Excess of ln(luminance) over the mean of two directions at the same elevation, left and right, that makes a cloud."""
CLOUD_REDDER = 0.04
"""Excess of ln(red / blue) over the mean of those two directions that makes a cloud."""
CLOUD_DISTANCES_DEG = (3.0, 6.0)
"""Angles at which directions to the left and right are compared [deg]."""
CLOUD_SMALLEST_SQUARE_DEG = 1.0
"""Cloudy cells that together are smaller than this are noise [deg^2]."""
AUREOLE_DEG = 20.0
"""Distance from the sun [deg] within which the sky itself is peaked, and a cloud shows by its edges only."""
SUN_GLARE_DEG = 6.0
"""Radius about the sun [deg] that is masked while it is up: disc, bloom, veiling glare and ghosts of the lens."""
SUN_DISC_DEG = 0.27
"""Angular radius of the sun [deg], above whose setting its glare is masked."""
FOREGROUND = {"below the horizon", "mask image", "ground, trees, buildings"}


def masked(
    sky: PhotoSky,
    *,
    image: np.ndarray | None = None,
    automatic: bool = True,
    min_elevation_deg: float = 0.0,
    sun: tuple[float, float] | None = None,
    glare_deg: float = SUN_GLARE_DEG,
) -> PhotoSky:
    """The same with its mask.

    image (e, a): a mask picture on its grid (`picture_sky.mask_image_on`).
    automatic: also look for edges and clouds.
    sun: apparent (azimuth_deg, elevation_deg) of the sun relative to the origin; its glare is masked where
    the disc is not wholly below the horizon.
    """
    rows, columns = sky.rows_deg, sky.columns_deg
    causes: dict[str, np.ndarray] = {
        "outside the photograph": ~sky.covered,
        "below the horizon": rows[:, None] < min_elevation_deg,
    }
    with np.errstate(invalid="ignore"):
        dark = ~(sky.luminance > 0)
    causes["saturated or black"] = dilate(sky.saturated, sky, GROW_DEG) | dark
    if sun is not None and sun[1] > -SUN_DISC_DEG:
        causes["glare of the sun"] = separation_deg(rows[:, None], columns[None, :], sun[1], sun[0]) < glare_deg
    if image is not None:
        causes["mask image"] = ~image
    if automatic:
        known = causes["outside the photograph"] | causes["saturated or black"]
        glare = causes.get("glare of the sun", np.zeros_like(known))
        clear = find_sky(sky, ignore=known | glare)
        causes["ground, trees, buildings"] = ~clear
        aureole = None
        if sun is not None:
            aureole = separation_deg(rows[:, None], columns[None, :], sun[1], sun[0]) < AUREOLE_DEG
        causes["clouds"] = find_clouds(sky, clear & ~known & ~glare, aureole)
    shape = sky.covered.shape
    foreground = np.zeros(shape, bool)
    for name in FOREGROUND & causes.keys():
        foreground |= causes[name]
    weight = np.broadcast_to(np.cos(np.radians(rows))[:, None] * (rows[:, None] > 0), shape)
    valid = np.ones(shape, bool)
    taken = {}
    for name, cause in causes.items():
        fraction = float((weight * (valid & cause)).sum() / weight.sum())
        if fraction > 0 and name != "below the horizon":
            taken[name] = fraction
        valid &= ~cause
    return replace(sky, valid=valid, foreground=foreground, taken=taken)


def separation_deg(elevation_deg, azimuth_deg, other_elevation_deg, other_azimuth_deg) -> np.ndarray:
    """Angle between directions [deg], broadcast."""
    e, f = np.radians(elevation_deg), np.radians(other_elevation_deg)
    azimuth = np.radians(np.subtract(azimuth_deg, other_azimuth_deg))
    # by the half angles (haversine), exact for small ones
    h = np.sin(0.5 * (e - f)) ** 2 + np.cos(e) * np.cos(f) * np.sin(0.5 * azimuth) ** 2
    return 2.0 * np.degrees(np.arcsin(np.sqrt(np.clip(h, 0.0, 1.0))))


# Automatic ------------------------------------------------------------------------------------------------------


def find_sky(sky: PhotoSky, ignore: np.ndarray | None = None) -> np.ndarray:
    """Cells (E, A) that are connected with the top of the photograph without crossing an edge.

    ignore (E, A): cells that are no sky and no edge either (saturated, the sun's glare): the sky goes on behind them.
    """
    ignore = np.zeros(sky.covered.shape, bool) if ignore is None else ignore
    rows = sky.rows_deg
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm = np.log(np.maximum(sky.rgb, 1e-12 * np.nanmax(sky.rgb)))
    distance = max(1, round(EDGE_STEP_DEG / sky.step_deg))
    roughness = np.zeros(rows.shape + sky.columns_deg.shape)
    for axis in (0, 1):
        second = np.abs(_shift(logarithm, distance, axis) + _shift(logarithm, -distance, axis) - 2 * logarithm)
        second = second.max(axis=-1)
        if axis == 1:  # towards the zenith columns are closer together: compare over the same angle, at least in part
            second *= np.clip(np.cos(np.radians(rows)), 0.2, None)[:, None]
        roughness = np.fmax(roughness, second)
    upper = sky.covered & ~ignore & (rows[:, None] > 0.5 * float(rows[sky.covered.any(axis=1)].max()))
    noise = float(np.median(roughness[upper])) if upper.any() else 0.0
    limit = float(np.clip(EDGE_OVER_NOISE * noise, EDGE, 3.0 * EDGE))
    edge = _larger_than((roughness > limit) & ~ignore, sky, EDGE_SMALLEST_SQUARE_DEG)
    smooth = (sky.covered | ignore) & ~edge & (rows[:, None] > -2.0)
    labels, _ = ndimage.label(smooth)
    labels = join_across_north(labels)
    highest = [labels[i] for i in range(rows.size - 1, -1, -1) if smooth[i].any()][: max(1, round(10 / sky.step_deg))]
    if not highest:
        return np.zeros_like(smooth)
    seeds = np.concatenate([row[row > 0] for row in highest])
    main = np.bincount(seeds).argmax()
    ground = dilate(labels != main, sky, GROW_DEG)
    # below what is dark against the sky of its height stands what carries it: a smooth roof below its edge
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # rows without sky
        level = np.nanmedian(np.where(ground, np.nan, sky.luminance), axis=1)
        dark = ground & ~ignore & (sky.luminance < DARK_GROUND * level[:, None])
    dark = _larger_than(dark, sky, EDGE_SMALLEST_SQUARE_DEG)
    return ~(ground | (np.cumsum(dark[::-1], axis=0)[::-1] > 0))


def find_clouds(sky: PhotoSky, clear: np.ndarray, aureole: np.ndarray | None = None) -> np.ndarray:
    """Cells (E, A) of ``clear`` that are redder or brighter than the sky to their left and right.

    aureole (E, A): where that says nothing.  The sky varies smoothly along a parallel; a cloud does not.
    """
    if not clear.any():
        return np.zeros_like(clear)
    with np.errstate(divide="ignore", invalid="ignore"):
        luminance = np.log(np.where(clear, sky.luminance, np.nan))
        redness = np.log(np.where(clear, sky.rgb[..., 0] / sky.rgb[..., 2], np.nan))
    found = np.zeros_like(clear)
    size = max(1, round(1.0 / sky.step_deg))
    for values, limit in ((redness, CLOUD_REDDER), (luminance, CLOUD_BRIGHTER)):
        if aureole is not None:
            values = np.where(aureole, np.nan, values)
        known = np.isfinite(values)
        fraction = ndimage.uniform_filter(known.astype(float), size, mode=("nearest", "wrap"))
        total = ndimage.uniform_filter(np.where(known, values, 0.0), size, mode=("nearest", "wrap"))
        with np.errstate(invalid="ignore", divide="ignore"):
            smooth = np.where(known, total / fraction, np.nan)
            for distance in CLOUD_DISTANCES_DEG:
                found |= smooth - _beside(smooth, sky, distance) > limit
    found &= clear
    return dilate(_larger_than(found, sky, CLOUD_SMALLEST_SQUARE_DEG), sky, GROW_DEG) & clear


def _larger_than(found: np.ndarray, sky: PhotoSky, square_deg: float) -> np.ndarray:
    """The connected parts of ``found`` (E, A) that are at least that large."""
    labels, count = ndimage.label(found, np.ones((3, 3)))
    labels = join_across_north(labels)
    area = np.cos(np.radians(sky.rows_deg))[:, None] * sky.step_deg**2 * np.ones(found.shape)
    large = ndimage.sum_labels(area, labels, np.arange(count + 1)) >= square_deg
    large[0] = False
    return large[labels]


def _beside(values: np.ndarray, sky: PhotoSky, distance_deg: float) -> np.ndarray:
    """Mean of the values at an angle to the left and to the right along the parallel, (E, A)."""
    out = np.full_like(values, np.nan)
    for i, elevation in enumerate(sky.rows_deg):
        cells = round(distance_deg / sky.step_deg / max(np.cos(np.radians(elevation)), 1e-3))
        if cells <= values.shape[1] // 8:  # nearer the zenith a parallel is no longer straight
            out[i] = 0.5 * (np.roll(values[i], cells) + np.roll(values[i], -cells))
    return out


def dilate(mask: np.ndarray, sky: PhotoSky, radius_deg: float) -> np.ndarray:
    """``mask`` grown by an angle; wider in columns towards the zenith, wrapped in azimuth."""
    steps = round(radius_deg / sky.step_deg)
    if steps < 1 or not mask.any():
        return mask.copy()
    grown = mask.copy()
    flat = np.maximum(np.cos(np.radians(sky.rows_deg)), 0.02)
    for i in range(-steps, steps + 1):
        moved = np.zeros_like(mask)
        moved[max(i, 0) : mask.shape[0] + min(i, 0)] = mask[max(-i, 0) : mask.shape[0] + min(-i, 0)]
        across = np.sqrt(max(steps**2 - i**2, 0.0))
        for row in np.flatnonzero(moved.any(axis=1)):
            radius = int(np.ceil(across / flat[row] - 1e-9))
            grown[row] |= _widen(moved[row], min(radius, mask.shape[1] // 2))
    return grown


def _widen(row: np.ndarray, radius: int) -> np.ndarray:
    """A circular row of flags grown by ``radius`` cells to both sides."""
    if radius == 0:
        return row
    padded = np.concatenate([row[-radius:], row, row[:radius]]).astype(int)
    total = np.concatenate([[0], np.cumsum(padded)])
    return total[2 * radius + 1 :] - total[: -2 * radius - 1] > 0


def _shift(values: np.ndarray, steps: int, axis: int) -> np.ndarray:
    """Values moved along elevation (edges repeated) or azimuth (wrapped)."""
    if axis == 1:
        return np.roll(values, steps, axis=1)
    index = np.clip(np.arange(values.shape[0]) - steps, 0, values.shape[0] - 1)
    return values[index]


def join_across_north(labels: np.ndarray) -> np.ndarray:
    """Labels (E, A), 0 for no component, with one label for components that touch across the first and last column."""
    left, right = labels[:, 0], labels[:, -1]
    touch = (left > 0) & (right > 0)
    count = int(labels.max()) + 1
    joined = coo_array((np.ones(touch.sum()), (left[touch], right[touch])), shape=(count, count))
    return connected_components(joined, directed=False)[1][labels]


# Files ----------------------------------------------------------------------------------------------------------


def read_mask_image(path: str | Path) -> np.ndarray:
    """A mask picture (H, W), 1 where it is bright (sky) and 0 where dark; a PNG, JPEG or TIFF."""
    return (read_samples(path).samples.mean(axis=-1) > 0.5).astype(float)


WIDTH = 240
"""Columns that a picture is made smaller to."""
LEAST_STEP = 0.5
"""Least difference of ln(luminance) between sky and ground."""
BAND = 0.02
"""Height over which a step is taken, and within which a column lies on the line, as a fraction of the picture's."""
LEAST_COLUMNS = 0.45
"""Fraction of the columns that must lie on the line."""
LARGEST_ROLL_DEG = 30.0
"""Largest tilt of a horizon [deg]."""
SKYLINE_ERROR_DEG = 1.5
"""Standard error of the angle above the horizontal by a line of ground, hills and trees [deg]."""
TILT_ERROR_DEG = 1.0
"""Standard error of the tilt by the same [deg]."""


class Horizon(NamedTuple):
    """elevation_deg, roll_deg: as of `camera.model.Orientation`."""

    elevation_deg: float
    roll_deg: float


def find_horizon(picture: StoredImage, camera: CameraModel) -> Horizon | None:
    """The orientation of a camera by the horizon in its picture; None where there is no such line."""
    height, width = picture.samples.shape[:2]
    step = max(1, width // WIDTH)
    light = picture.samples[: height // step * step, : width // step * step] @ REC709_LUMINANCE.astype(np.float32)
    light = light.reshape(height // step, step, width // step, step).mean(axis=(1, 3))
    logarithm = np.log(np.maximum(light, 1e-3 * max(float(np.median(light)), 1e-12)))
    band = max(2, round(BAND * logarithm.shape[0]))
    if logarithm.shape[0] < 6 * band or logarithm.shape[1] < 20:
        return None
    mean = ndimage.uniform_filter1d(logarithm, band, axis=0)
    # mean of the band above a row's upper edge less that below it
    drop = mean[:-band] - mean[band:]
    rows = drop.argmax(axis=0)
    columns = np.flatnonzero(drop.max(axis=0) > LEAST_STEP)
    if columns.size < LEAST_COLUMNS * drop.shape[1]:
        return None
    x, y = columns.astype(float), rows[columns] + (band + 1) // 2 - 0.5
    line = _line(x, y, band)
    on = np.abs(y - np.polyval(line, x)) <= band
    if on.sum() < LEAST_COLUMNS * drop.shape[1] or abs(np.degrees(np.arctan(line[0]))) > LARGEST_ROLL_DEG:
        return None
    line = np.polyfit(x[on], y[on], 1)
    ends = np.array([0.0, drop.shape[1] - 1.0])
    pixels = np.stack([ends + 0.5, np.polyval(line, ends) + 0.5], axis=-1) * step
    left, right = camera.directions_own(pixels)
    up = np.cross(right, left)
    if not np.isfinite(up).all():
        return None
    up /= np.linalg.norm(up)
    if up[2] < 0.0:
        up = -up
    elevation = float(np.degrees(np.arcsin(np.clip(up[1], -1.0, 1.0))))
    return Horizon(elevation, float(np.degrees(np.arctan2(-up[0], up[2]))))


def _line(x: np.ndarray, y: np.ndarray, band: float) -> np.ndarray:
    """Slope and height of the line through two of the points that most of them lie near; always the same pairs."""
    random = np.random.default_rng(1)
    best, most = np.polyfit(x, y, 1), -1
    for _ in range(400):
        i, j = random.choice(x.size, 2, replace=False)
        if abs(x[i] - x[j]) < 0.2 * np.ptp(x):
            continue
        slope = (y[j] - y[i]) / (x[j] - x[i])
        found = np.array([slope, y[i] - slope * x[i]])
        count = int((np.abs(y - np.polyval(found, x)) <= 0.5 * band).sum())
        if count > most:
            best, most = found, count
    return best
