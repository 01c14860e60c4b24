"""What of a photograph is clear sky: ground, trees, clouds, saturated pixels and the sun's glare are masked.

The automatic mask assumes a sky that is smooth and continuous, as a clear sky is, and takes what is connected with the
upper part of the photograph.  It finds buildings, trees, hills, poles and clouds with edges.  It does not see what is
as smooth as the sky: thin cirrus, fog, an overcast, an evenly lit wall that reaches the top of the photograph.  A mask
image or an elevation profile (or both) can be given instead or in addition.
"""

from __future__ import annotations

from dataclasses import dataclass
from os.path import isfile
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from twilight.atmosphere.csv_columns import read_columns
from twilight.base.errors import TwilightError
from twilight.studies.camera.image import read_samples
from twilight.studies.validate.photographs.panorama import Panorama

PROFILE_COLUMNS = {"azimuth_deg": (-360.0, 360.0, "-360 to 360"), "elevation_deg": (-90.0, 90.0, "-90 to 90")}
"""Columns of an elevation profile, and the numbers that they may hold."""
EDGE = 0.05
"""Second difference of ln(RGB) between neighbouring cells beyond which a cell is an edge and no sky."""
EDGE_OVER_NOISE = 3.0
"""In a noisy photograph: EDGE is raised, up to three times, to this many times the median over its upper half."""
EDGE_STEP_DEG = 0.5
"""Distance of the neighbouring cells for which EDGE is meant [deg]."""
EDGE_SMALLEST_SQUARE_DEG = 0.4
"""Edge cells that together are smaller than this are noise [deg^2]."""
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
FOREGROUND = {"below the horizon", "below the profile", "mask image", "ground, trees, buildings"}


@dataclass(frozen=True, eq=False)
class Mask:
    """Which fine cells of a panorama are clear sky, and what took the others.

    valid (E, A).
    foreground (E, A): ground, trees, buildings, whichever way they were found.
    taken: fraction of the sky above the horizon (by solid angle) that each cause took; a cell with several causes
        counts for the one that is listed before the others.
    """

    valid: np.ndarray
    foreground: np.ndarray
    taken: dict[str, float]


def make_mask(
    panorama: Panorama,
    *,
    profile: tuple[np.ndarray, np.ndarray] | None = None,
    image: np.ndarray | None = None,
    automatic: bool = True,
    min_elevation_deg: float = 0.0,
    sun: tuple[float, float] | None = None,
    glare_deg: float = SUN_GLARE_DEG,
) -> Mask:
    """The mask of a panorama.

    profile: (azimuth_deg, elevation_deg) in the camera's azimuths below which there is no sky (``read_profile``).
    image (E, A): a mask picture on the panorama's grid (``panorama.mask_image_on``).
    automatic: also look for edges and clouds.
    sun: apparent (azimuth_deg, elevation_deg) of the sun relative to the panorama's origin; its glare is masked where
    the disc is not wholly below the horizon.
    """
    rows, columns = panorama.elevation_deg, panorama.azimuth_deg
    causes: dict[str, np.ndarray] = {
        "outside the photograph": ~panorama.covered,
        "below the horizon": rows[:, None] < min_elevation_deg,
    }
    with np.errstate(invalid="ignore"):
        dark = ~(panorama.luminance > 0)
    causes["saturated or black"] = dilate(panorama.saturated, panorama, GROW_DEG) | dark
    if sun is not None and sun[1] > -SUN_DISC_DEG:
        causes["glare of the sun"] = separation_deg(rows[:, None], columns[None, :], sun[1], sun[0]) < glare_deg
    if profile is not None:
        edge = np.interp(columns + panorama.origin_deg, *_around(*profile))
        causes["below the profile"] = rows[:, None] < edge[None, :] + 0.5 * panorama.step_deg
    if image is not None:
        causes["mask image"] = ~image
    if automatic:
        known = causes["outside the photograph"] | causes["saturated or black"]
        glare = causes.get("glare of the sun", np.zeros_like(known))
        sky = find_sky(panorama, ignore=known | glare)
        causes["ground, trees, buildings"] = ~sky
        aureole = None
        if sun is not None:
            aureole = separation_deg(rows[:, None], columns[None, :], sun[1], sun[0]) < AUREOLE_DEG
        causes["clouds"] = find_clouds(panorama, sky & ~known & ~glare, aureole)
    return _collect(causes, rows)


def _collect(causes: dict[str, np.ndarray], rows: np.ndarray) -> Mask:
    shape = np.broadcast_shapes(*(cause.shape for cause in causes.values()))
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
    return Mask(valid, foreground, taken)


def separation_deg(elevation_deg, azimuth_deg, other_elevation_deg, other_azimuth_deg) -> np.ndarray:
    """Angle between directions [deg], broadcast."""
    e, f = np.radians(elevation_deg), np.radians(other_elevation_deg)
    azimuth = np.radians(np.subtract(azimuth_deg, other_azimuth_deg))
    # by the half angles (haversine), exact for small ones
    h = np.sin(0.5 * (e - f)) ** 2 + np.cos(e) * np.cos(f) * np.sin(0.5 * azimuth) ** 2
    return 2.0 * np.degrees(np.arcsin(np.sqrt(np.clip(h, 0.0, 1.0))))


# Automatic ------------------------------------------------------------------------------------------------------


def find_sky(panorama: Panorama, ignore: np.ndarray | None = None) -> np.ndarray:
    """Cells (E, A) that are connected with the top of the photograph without crossing an edge.

    ignore (E, A): cells that are no sky and no edge either (saturated, the sun's glare): the sky goes on behind them.
    """
    ignore = np.zeros(panorama.covered.shape, bool) if ignore is None else ignore
    rows = panorama.elevation_deg
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm = np.log(np.maximum(panorama.rgb, 1e-12 * np.nanmax(panorama.rgb)))
    distance = max(1, round(EDGE_STEP_DEG / panorama.step_deg))
    roughness = np.zeros(rows.shape + panorama.azimuth_deg.shape)
    for axis in (0, 1):
        second = np.abs(_shift(logarithm, distance, axis) + _shift(logarithm, -distance, axis) - 2 * logarithm)
        second = second.max(axis=-1)
        if axis == 1:  # towards the zenith columns are closer together: compare over the same angle, at least in part
            second *= np.clip(np.cos(np.radians(rows)), 0.2, None)[:, None]
        roughness = np.fmax(roughness, second)
    upper = panorama.covered & ~ignore & (rows[:, None] > 0.5 * float(rows[panorama.covered.any(axis=1)].max()))
    noise = float(np.median(roughness[upper])) if upper.any() else 0.0
    limit = float(np.clip(EDGE_OVER_NOISE * noise, EDGE, 3.0 * EDGE))
    edge = _larger_than((roughness > limit) & ~ignore, panorama, EDGE_SMALLEST_SQUARE_DEG)
    smooth = (panorama.covered | ignore) & ~edge & (rows[:, None] > -2.0)
    labels, _ = ndimage.label(smooth)
    labels = _join_across_north(labels)
    highest = [labels[i] for i in range(rows.size - 1, -1, -1) if smooth[i].any()][
        : max(1, round(10 / panorama.step_deg))
    ]
    if not highest:
        return np.zeros_like(smooth)
    seeds = np.concatenate([row[row > 0] for row in highest])
    main = np.bincount(seeds).argmax()
    return ~dilate(labels != main, panorama, GROW_DEG)


def find_clouds(panorama: Panorama, sky: np.ndarray, aureole: np.ndarray | None = None) -> np.ndarray:
    """Cells (E, A) of ``sky`` that are redder or brighter than the sky to their left and right.

    aureole (E, A): where that says nothing.  The sky varies smoothly along a parallel; a cloud does not.
    """
    if not sky.any():
        return np.zeros_like(sky)
    with np.errstate(divide="ignore", invalid="ignore"):
        luminance = np.log(np.where(sky, panorama.luminance, np.nan))
        redness = np.log(np.where(sky, panorama.rgb[..., 0] / panorama.rgb[..., 2], np.nan))
    found = np.zeros_like(sky)
    size = max(1, round(1.0 / panorama.step_deg))
    for values, limit in ((redness, CLOUD_REDDER), (luminance, CLOUD_BRIGHTER)):
        if aureole is not None:
            values = np.where(aureole, np.nan, values)
        known = np.isfinite(values)
        fraction = ndimage.uniform_filter(known.astype(float), size, mode=("nearest", "wrap"))
        total = ndimage.uniform_filter(np.where(known, values, 0.0), size, mode=("nearest", "wrap"))
        with np.errstate(invalid="ignore", divide="ignore"):
            smooth = np.where(known, total / fraction, np.nan)
            for distance in CLOUD_DISTANCES_DEG:
                found |= smooth - _beside(smooth, panorama, distance) > limit
    found &= sky
    return dilate(_larger_than(found, panorama, CLOUD_SMALLEST_SQUARE_DEG), panorama, GROW_DEG) & sky


def _larger_than(found: np.ndarray, panorama: Panorama, square_deg: float) -> np.ndarray:
    """The connected parts of ``found`` (E, A) that are at least that large."""
    labels, count = ndimage.label(found, np.ones((3, 3)))
    labels = _join_across_north(labels)
    area = np.cos(np.radians(panorama.elevation_deg))[:, None] * panorama.step_deg**2 * np.ones(found.shape)
    large = ndimage.sum_labels(area, labels, np.arange(count + 1)) >= square_deg
    large[0] = False
    return large[labels]


def _beside(values: np.ndarray, panorama: Panorama, distance_deg: float) -> np.ndarray:
    """Mean of the values at an angle to the left and to the right along the parallel, (E, A)."""
    out = np.full_like(values, np.nan)
    for i, elevation in enumerate(panorama.elevation_deg):
        cells = round(distance_deg / panorama.step_deg / max(np.cos(np.radians(elevation)), 1e-3))
        if cells <= values.shape[1] // 8:  # nearer the zenith a parallel is no longer straight
            out[i] = 0.5 * (np.roll(values[i], cells) + np.roll(values[i], -cells))
    return out


def dilate(mask: np.ndarray, panorama: Panorama, radius_deg: float) -> np.ndarray:
    """``mask`` grown by an angle; wider in columns towards the zenith, wrapped in azimuth."""
    steps = round(radius_deg / panorama.step_deg)
    if steps < 1 or not mask.any():
        return mask.copy()
    grown = mask.copy()
    flat = np.maximum(np.cos(np.radians(panorama.elevation_deg)), 0.02)
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


def _join_across_north(labels: np.ndarray) -> np.ndarray:
    """Labels (E, A), 0 for no component, with one label for components that touch across the first and last column."""
    left, right = labels[:, 0], labels[:, -1]
    touch = (left > 0) & (right > 0)
    count = int(labels.max()) + 1
    joined = coo_array((np.ones(touch.sum()), (left[touch], right[touch])), shape=(count, count))
    return connected_components(joined, directed=False)[1][labels]


# Files ----------------------------------------------------------------------------------------------------------


def read_profile(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation [deg] of the skyline from a CSV with the columns azimuth_deg,elevation_deg.

    Errors: TwilightError where the file is not that.
    """
    if not isfile(path):  # a pipe or a device could go on for ever
        raise TwilightError(f"{path}: no such file")
    _, table, _ = read_columns(Path(path), PROFILE_COLUMNS)
    azimuth = np.mod(table[:, 0], 360.0)
    if np.unique(azimuth).size < azimuth.size:
        raise TwilightError(f"{path}: the profile gives the same azimuth twice")
    order = np.argsort(azimuth)
    return azimuth[order], table[order, 1]


def _around(azimuth_deg: np.ndarray, elevation_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A profile repeated so that azimuths from -720 to 1080 deg lie within it."""
    turns = np.arange(-3, 4)[:, None] * 360.0
    return (azimuth_deg[None, :] + turns).ravel(), np.tile(elevation_deg, 7)


def read_mask_image(path: str | Path) -> np.ndarray:
    """A mask picture (H, W), 1 where it is bright (sky) and 0 where dark; a PNG, JPEG or TIFF."""
    return (read_samples(path).samples.mean(axis=-1) > 0.5).astype(float)
