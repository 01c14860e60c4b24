"""A photograph on a fine grid of directions: what its pixels saw, before anything is masked.

Rows are elevations, increasing, from a little below the horizon (where the ground begins) to the zenith; columns are
azimuths that grow clockwise over the whole circle, counted from ``origin_deg`` of the camera's azimuths.  The fine grid
divides the coarse cells on which skies are compared: ``MARGIN_DEG`` below the horizon, ``k`` x ``k`` fine cells in a
coarse one, the first coarse cell centred on the origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twilight.base.errors import TwilightError
from twilight.io.stored_image import StoredImage
from twilight.numerics.directions import direction
from twilight.sky.colour import REC709_LUMINANCE
from twilight.studies.camera.model import CameraModel

MARGIN_DEG = 6.0
"""Angle below the horizon at which the rows begin [deg], so that the edge of the ground can be seen as one."""


@dataclass(frozen=True, eq=False)
class Panorama:
    """Linear RGB over directions.

    elevation_deg (E,), azimuth_deg (A,): centres of the fine cells; azimuths relative to ``origin_deg``.
    rgb (E, A, 3): linear Rec. 709 in the photograph's own scale, vignetting undone; NaN outside the photograph.
    saturated (E, A): a pixel within the cell is saturated.
    step_deg: of the fine grid.  origin_deg: azimuth of column 0's coarse cell, in the camera's azimuths.
    grey: the photograph has no colour.
    """

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    rgb: np.ndarray
    saturated: np.ndarray
    step_deg: float
    origin_deg: float
    grey: bool = False

    @property
    def covered(self) -> np.ndarray:
        """(E, A): the photograph shows this direction."""
        return np.asarray(np.isfinite(self.rgb[..., 0]))

    @property
    def luminance(self) -> np.ndarray:
        """Rec. 709 luminance (E, A) in the photograph's scale; NaN outside it."""
        return self.rgb @ REC709_LUMINANCE


def fine_grid(cell_deg: float, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevations (E,) and azimuths (A,) of the fine cells, ``k`` x ``k`` in every coarse cell of ``cell_deg``."""
    if not cell_deg > 0 or abs(90.0 / cell_deg - round(90.0 / cell_deg)) > 1e-9 or k < 1:
        raise TwilightError(f"resolution: {cell_deg:g} deg must be positive and divide 90 deg, as 2 or 3 do")
    step = cell_deg / k
    below = int(np.ceil(MARGIN_DEG / step))
    elevation = (np.arange(-below, round(90.0 / cell_deg) * k) + 0.5) * step
    azimuth = -0.5 * cell_deg + (np.arange(round(360.0 / cell_deg) * k) + 0.5) * step
    return elevation, azimuth


def make_panorama(
    picture: StoredImage, camera: CameraModel, cell_deg: float = 2.0, k: int = 4, origin_deg: float = 0.0
) -> Panorama:
    """The photograph on the fine grid: the mean of what each cell covers, by bilinear samples of the pixels.

    picture: linear (``stored_image.read_image``).  Errors: TwilightError where the picture has not the camera's size or
    shows nothing above the horizon.
    """
    height, width = picture.samples.shape[:2]
    if (width, height) != (camera.image.width_px, camera.image.height_px):
        raise TwilightError(
            f"camera: image is {camera.image.width_px} x {camera.image.height_px} pixels, "
            f"the photograph {width} x {height}"
        )
    elevation, azimuth = fine_grid(cell_deg, k)
    step = cell_deg / k
    pixel_deg = np.degrees(1.0 / camera.focal_length_px)
    block = max(1, int(step / (2.0 * pixel_deg)))
    rgb, saturated = _shrink(_flat_fielded(picture, camera), picture.saturated, block)
    n = int(np.clip(np.ceil(step / (block * pixel_deg)), 1, 4))
    total = np.zeros((elevation.size, azimuth.size, 3))
    saturated_cells = np.zeros((elevation.size, azimuth.size), bool)
    offsets = ((np.arange(n) + 0.5) / n - 0.5) * step
    wraps = camera.projection == "latlong"
    for up in offsets:
        for right in offsets:
            towards = direction(azimuth[None, :] + right + origin_deg, elevation[:, None] + up)
            xy = camera.project(towards)
            xy[~camera.inside(xy)] = np.nan
            total += _bilinear(rgb, xy / block, wraps)
            saturated_cells |= _nearest(saturated, xy / block)
    panorama = Panorama(elevation, azimuth, total / n**2, saturated_cells, step, origin_deg, picture.grey)
    if not panorama.covered[elevation > 0].any():
        raise TwilightError("camera: the photograph shows nothing above the horizon with this orientation")
    return panorama


def mask_image_on(panorama: Panorama, sky_fraction: np.ndarray, camera: CameraModel) -> np.ndarray:
    """A mask picture (H, W), 1 where there is sky, on the panorama's grid: True where every pixel of a cell is sky."""
    if sky_fraction.shape != (camera.image.height_px, camera.image.width_px):
        raise TwilightError(
            f"mask: the mask image is {sky_fraction.shape[1]} x {sky_fraction.shape[0]} pixels, "
            f"the photograph {camera.image.width_px} x {camera.image.height_px}"
        )
    out = np.ones((panorama.elevation_deg.size, panorama.azimuth_deg.size), bool)
    offsets = np.array([-0.5, 0.0, 0.5]) * panorama.step_deg
    for up in offsets:
        for right in offsets:
            elevation = np.minimum(panorama.elevation_deg + up, 90.0)
            xy = camera.project(
                direction(panorama.azimuth_deg[None, :] + right + panorama.origin_deg, elevation[:, None])
            )
            xy[~camera.inside(xy)] = np.nan
            out &= _nearest(sky_fraction > 0.5, xy)
    return out


def _flat_fielded(picture: StoredImage, camera: CameraModel) -> np.ndarray:
    """Samples with the vignetting undone; NaN where the lens shows nothing."""
    lens = camera.lens
    if camera.projection == "latlong":
        return picture.samples
    if not lens.vignetting and not lens.natural_vignetting and lens.image_circle_px is None:
        return picture.samples
    out = np.empty_like(picture.samples)
    centres = np.arange(camera.image.width_px) + 0.5
    for start in range(0, out.shape[0], 256):  # the positions of all pixels of a large picture would be many
        rows = np.arange(start, min(start + 256, out.shape[0])) + 0.5
        light = camera.relative_illumination(np.stack(np.meshgrid(centres, rows), axis=-1))
        out[start : start + 256] = picture.samples[start : start + 256] / light[..., None]
    return out


def _shrink(rgb: np.ndarray, saturated: np.ndarray, block: int) -> tuple[np.ndarray, np.ndarray]:
    """Means over blocks of pixels, the last ones partly filled; saturated where any pixel of a block is."""
    if block == 1:
        return np.asarray(rgb, float), saturated
    height, width = saturated.shape
    down, right = np.arange(0, height, block), np.arange(0, width, block)
    total = np.add.reduceat(np.add.reduceat(rgb.astype(float), down, axis=0), right, axis=1)
    count = np.diff(np.append(down, height))[:, None] * np.diff(np.append(right, width))
    any_of = np.logical_or.reduceat(np.logical_or.reduceat(saturated, down, axis=0), right, axis=1)
    return total / count[..., None], any_of


def _bilinear(values: np.ndarray, xy: np.ndarray, wraps: bool) -> np.ndarray:
    """Values (H, W, 3) at positions (..., 2) from the corner of the picture; NaN where a position is NaN."""
    height, width = values.shape[:2]
    x, y = xy[..., 0] - 0.5, xy[..., 1] - 0.5
    known = np.isfinite(x) & np.isfinite(y)
    x, y = np.where(known, x, 0.0), np.clip(np.where(known, y, 0.0), 0.0, height - 1.0)
    if not wraps:
        x = np.clip(x, 0.0, width - 1.0)
    left, top = np.floor(x).astype(int), np.minimum(np.floor(y).astype(int), max(height - 2, 0))
    u, v = (x - left)[..., None], (y - top)[..., None]
    columns = (left % width, (left + 1) % width) if wraps else (left, np.minimum(left + 1, width - 1))
    below = np.minimum(top + 1, height - 1)
    out = (1 - v) * ((1 - u) * values[top, columns[0]] + u * values[top, columns[1]])
    out += v * ((1 - u) * values[below, columns[0]] + u * values[below, columns[1]])
    out[~known] = np.nan
    return out


def _nearest(values: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Flags (H, W) of the pixels at positions (..., 2); False where a position is NaN."""
    known = np.isfinite(xy).all(axis=-1)
    x = np.clip(np.where(known, xy[..., 0], 0.0).astype(int), 0, values.shape[1] - 1)
    y = np.clip(np.where(known, xy[..., 1], 0.0).astype(int), 0, values.shape[0] - 1)
    return known & values[y, x]
