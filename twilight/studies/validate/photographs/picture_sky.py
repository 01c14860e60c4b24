"""The sky of a picture: its colours on the texture of a computed one, and what of it is clear.

Rows are elevations, increasing, from a little below the horizon (where the ground begins) to the zenith; columns are
azimuths that grow clockwise over the whole circle, counted from ``origin_deg`` of the camera's azimuths: the sun's,
where that is known.  This fine grid, on which masks are made (`mask.masked`), divides the cells on which skies are
compared: ``MARGIN_DEG`` below the horizon, ``k`` x ``k`` fine cells in a cell, the first cell centred on the origin.

A photograph has no spectrum, so both skies become XYZ (CIE 1931, which camera profiles are made for): luminance in the
photograph's own scale and chromaticity, NaN where masked.  A cell of the photograph is the mean of its clear fine
cells, and the computed sky is averaged over the very same ones, so a cell half behind a tree compares like with like.
A `Frame` holds those cells that a fit takes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.io.stored_image import StoredImage
from twilight.numerics import spectrum
from twilight.numerics.directions import azimuth_elevation, camera_axes, direction
from twilight.sky import colour
from twilight.sky.colour import REC709_LUMINANCE
from twilight.sky.sky import Sky
from twilight.studies.camera.model import CameraModel

MARGIN_DEG = 6.0
"""Angle below the horizon at which the rows begin [deg], so that the edge of the ground can be seen as one."""
OBSERVER = "cie1931_2deg"
LEAST_CLEAR_FRACTION = 0.5
"""A cell counts where at least this fraction of its fine cells is clear sky."""
LEAST_CELLS = 20
"""Cells of clear sky that a comparison needs."""
HIGHLIGHT = 0.7
"""Stored linear light, 218 of 255 in sRGB, from which on a channel's curve is too flat to be undone."""
FLOOR = 0.03
"""Part of the luminance below which a channel counts as that: colours beyond Rec. 709."""
YCBCR = np.array([[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]])
"""Luma and chroma of JPEG (JFIF 1.02) from stored red, green, blue; each is a whole number."""
NONE_YET = np.zeros((0, 0))


@dataclass(frozen=True, eq=False)
class PhotoSky:
    """A picture's sky, or a computed one seen through its mask.

    rows_deg (e,), columns_deg (a,): centres of the fine cells; azimuths from the sun, or from ``origin_deg``.
    rgb (e, a, 3): linear Rec. 709 in the photograph's own scale, vignetting undone; NaN outside the photograph.
    saturated (e, a): a pixel within the cell is saturated.
    step_deg: of the fine grid, cell_deg: of the cells.  colour_known: False for a grey photograph.
    valid, foreground (e, a), taken: clear sky; ground, trees, buildings, whichever way they were found; fraction of the
        sky above the horizon (by solid angle) that each cause of the mask took (`mask.masked`).
    fine_xyz (f, a, 3), fine_valid (f, a): of the rows above the horizon, not masked, and where they are clear sky.
    xyz (E, A, 3), solid_angle_sr (E, A): of the cells (`in_cells`): luminance in Y, in the photograph's scale (or
        cd m^-2 for a computed sky), and of the clear part, 0 where a cell does not count.
    """

    rows_deg: np.ndarray
    columns_deg: np.ndarray
    rgb: np.ndarray
    saturated: np.ndarray
    step_deg: float
    cell_deg: float
    origin_deg: float
    colour_known: bool = True
    valid: np.ndarray = field(default_factory=lambda: NONE_YET)
    foreground: np.ndarray = field(default_factory=lambda: NONE_YET)
    taken: dict[str, float] = field(default_factory=dict)
    fine_xyz: np.ndarray = field(default_factory=lambda: NONE_YET)
    fine_valid: np.ndarray = field(default_factory=lambda: NONE_YET)
    xyz: np.ndarray = field(default_factory=lambda: NONE_YET)
    solid_angle_sr: np.ndarray = field(default_factory=lambda: NONE_YET)

    @property
    def covered(self) -> np.ndarray:
        """(e, a): the photograph shows this direction."""
        return np.asarray(np.isfinite(self.rgb[..., 0]))

    @property
    def luminance(self) -> np.ndarray:
        """Rec. 709 luminance (e, a) in the photograph's scale; NaN outside it."""
        return self.rgb @ REC709_LUMINANCE

    @property
    def k(self) -> int:
        """Fine cells on the side of a cell."""
        return round(self.cell_deg / self.step_deg)

    @property
    def fine_elevation_deg(self) -> np.ndarray:
        """Rows (f,) above the horizon."""
        return self.rows_deg[self.rows_deg > 0]

    @property
    def elevation_deg(self) -> np.ndarray:
        """Of the cells (E,)."""
        return self.fine_elevation_deg.reshape(-1, self.k).mean(axis=1)

    @property
    def azimuth_deg(self) -> np.ndarray:
        """Of the cells (A,), from the sun."""
        return np.arange(self.columns_deg.size // self.k) * self.cell_deg

    @property
    def counts(self) -> np.ndarray:
        """(E, A): the cell takes part in the comparison."""
        return self.solid_angle_sr > 0


@dataclass(frozen=True, eq=False)
class Frame:
    """The cells of a picture that a fit takes, which stand for equal parts of its clear sky.

    elevation_deg, azimuth_deg (n,): middle of the clear part of each, azimuth from the sun.  xyz (n, 3),
    solid_angle_sr (n,), colour_known: as of `PhotoSky`.  spread_deg (2, n): standard deviations of elevation and
    azimuth over it.  camera_deg: azimuth (from the sun), elevation and roll of the camera as told.  sun_deg: true
    elevation, None where it is sought.  lens (n,): squared angle off the axis, 1 in the corner; None: no lens.
    log_exposure: ln of cd m^-2 of the picture's 1, and its standard error; None: unknown.  eight_bits: of sRGB.
    """

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    xyz: np.ndarray
    solid_angle_sr: np.ndarray
    colour_known: bool = True
    spread_deg: np.ndarray | float = 0.0
    camera_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sun_deg: float | None = None
    lens: np.ndarray | None = None
    log_exposure: tuple[float, float] | None = None
    eight_bits: bool = False

    @classmethod
    def of(cls, photo: PhotoSky, most: int, **more: Any) -> Frame:
        """At most so many of the cells that count, spread evenly over the clear sky; more: fields."""
        rows, columns = photo.fine_elevation_deg, photo.columns_deg
        shape = photo.fine_valid.shape
        middle = np.stack([np.broadcast_to(rows[:, None], shape), np.broadcast_to(columns, shape)], axis=-1)
        where, _ = _average(np.concatenate([middle, middle**2], axis=-1), photo.fine_valid, photo)
        weight = photo.solid_angle_sr[photo.counts]
        chosen = np.arange(weight.size)
        if weight.size > most:
            passed = np.cumsum(weight)
            chosen = np.unique(np.searchsorted(passed, (np.arange(most) + 0.5) / most * passed[-1]))
            weight = np.full(weight.size, passed[-1] / chosen.size)
        e, a, *squares = where[photo.counts][chosen].T
        spread = np.sqrt(np.maximum(np.array(squares) - np.array([e, a]) ** 2, 0.0))
        return cls(e, a, photo.xyz[photo.counts][chosen], weight[chosen], photo.colour_known, spread, **more)

    @property
    def counts(self) -> np.ndarray:
        """(n,): the cell takes part in the comparison."""
        return self.solid_angle_sr > 0

    def below_white(self) -> Frame:
        """Those whose channels are below HIGHLIGHT, or in the darker half: of the rest a camera's curve says little."""
        brightest = colour.xyz_to_linear_rgb(self.xyz, OBSERVER).max(axis=-1)
        keep = brightest < max(HIGHLIGHT, float(np.median(brightest)))
        spread = self.spread_deg if np.ndim(self.spread_deg) == 0 else np.asarray(self.spread_deg)[:, keep]
        arrays = {key: getattr(self, key)[keep] for key in ("elevation_deg", "azimuth_deg", "xyz", "solid_angle_sr")}
        return replace(self, spread_deg=spread, **arrays)

    @cached_property
    def own(self) -> np.ndarray:
        """Directions (n, 3) in the camera's axes."""
        return direction(self.azimuth_deg, self.elevation_deg) @ camera_axes(*self.camera_deg).T

    @cached_property
    def components(self) -> np.ndarray:
        """(3, n) of the photograph."""
        return components(self.xyz, self.colour_known)

    def rounded(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """What one whole step of luma and of either chroma is in ln G, ln R/G and ln B/G (3, n), and those (n,)."""
        green, red, blue = self.components + np.array([[0.0], [1.0], [1.0]]) * self.components[0]
        light = np.exp([red, green, blue])
        stored = 255.0 * colour.srgb_encode(light)
        per_step = 0.01 / (255.0 * colour.srgb_encode(1.01 * light) - stored)
        for of_rgb, to_rgb in zip(YCBCR, np.linalg.inv(YCBCR).T, strict=True):
            r, g, b = to_rgb[:, None] * per_step
            yield np.array([g, r - g, b - g]), of_rgb @ stored

    def turned(self, heading: float, pitch: float, roll: float, zoom: float) -> tuple[np.ndarray, np.ndarray]:
        """Elevations and azimuths from the sun (n,) [deg] of the cells with the camera turned by these angles, and its
        view wider by so many per cent."""
        if heading == pitch == roll == zoom == 0.0:
            return self.elevation_deg, self.azimuth_deg
        azimuth, elevation, tilt = self.camera_deg
        own = self.own * (1.0 + 0.01 * zoom, 1.0, 1.0 + 0.01 * zoom)
        a, e = azimuth_elevation(own @ camera_axes(azimuth + heading, elevation + pitch, tilt + roll))
        return e, a


def fine_grid(cell_deg: float, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevations (E,) and azimuths (A,) of the fine cells, ``k`` x ``k`` in every coarse cell of ``cell_deg``."""
    if not cell_deg > 0 or abs(90.0 / cell_deg - round(90.0 / cell_deg)) > 1e-9 or k < 1:
        raise TwilightError(f"resolution: {cell_deg:g} deg must be positive and divide 90 deg, as 2 or 3 do")
    step = cell_deg / k
    below = int(np.ceil(MARGIN_DEG / step))
    elevation = (np.arange(-below, round(90.0 / cell_deg) * k) + 0.5) * step
    azimuth = -0.5 * cell_deg + (np.arange(round(360.0 / cell_deg) * k) + 0.5) * step
    return elevation, azimuth


def fine_sky(
    picture: StoredImage, camera: CameraModel, cell_deg: float = 2.0, k: int = 4, origin_deg: float = 0.0
) -> PhotoSky:
    """The photograph on the fine grid: the mean of what each cell covers, by bilinear samples of the pixels.

    picture: linear (`stored_image.read_image`).  Errors: TwilightError where the picture has not the camera's size or
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
    sky = PhotoSky(elevation, azimuth, total / n**2, saturated_cells, step, cell_deg, origin_deg, not picture.grey)
    if not sky.covered[elevation > 0].any():
        raise TwilightError("camera: the photograph shows nothing above the horizon with this orientation")
    return sky


def mask_image_on(sky: PhotoSky, sky_fraction: np.ndarray, camera: CameraModel) -> np.ndarray:
    """A mask picture (H, W), 1 where there is sky, on the fine grid: True where every pixel of a cell is sky."""
    if sky_fraction.shape != (camera.image.height_px, camera.image.width_px):
        raise TwilightError(
            f"mask: the mask image is {sky_fraction.shape[1]} x {sky_fraction.shape[0]} pixels, "
            f"the photograph {camera.image.width_px} x {camera.image.height_px}"
        )
    out = np.ones((sky.rows_deg.size, sky.columns_deg.size), bool)
    offsets = np.array([-0.5, 0.0, 0.5]) * sky.step_deg
    for up in offsets:
        for right in offsets:
            elevation = np.minimum(sky.rows_deg + up, 90.0)
            xy = camera.project(direction(sky.columns_deg[None, :] + right + sky.origin_deg, elevation[:, None]))
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


# Cells ---------------------------------------------------------------------------------------------------------------


def in_cells(sky: PhotoSky) -> PhotoSky:
    """A masked sky whose origin is the sun's azimuth, averaged over the clear fine cells of every cell.

    Errors: TwilightError where hardly any sky is left.
    """
    above = sky.rows_deg > 0
    to_xyz = np.linalg.inv(spectrum.xyz_to_rgb_matrix(OBSERVER))
    fine = sky.rgb[above] @ to_xyz.T
    with np.errstate(invalid="ignore"):
        clear = sky.valid[above] & (fine[..., 1] > 0)
    xyz, solid_angle = _average(fine, clear, sky)
    if (solid_angle > 0).sum() < LEAST_CELLS:
        raise TwilightError(
            f"photo: only {(solid_angle > 0).sum()} cells of {sky.cell_deg:g} deg hold clear sky after masking, and "
            f"{LEAST_CELLS} are needed; see the mask options"
        )
    return replace(sky, fine_xyz=fine, fine_valid=clear, xyz=xyz, solid_angle_sr=solid_angle)


def simulated_sky(sky: Sky, photo: PhotoSky) -> PhotoSky:
    """The computed sky on the grid of a photograph, averaged over the same clear fine cells; Y in cd m^-2."""
    xyz = colour.sky_to_xyz(sky, observer=OBSERVER)
    fine = np.asarray(sky.smooth(xyz, photo.fine_elevation_deg[:, None], photo.columns_deg[None, :]), float)
    averaged, _ = _average(fine, photo.fine_valid, photo)
    return replace(photo, xyz=averaged, fine_xyz=fine, colour_known=colour.colour_is_defined(sky.wavelength_nm))


def _average(fine: np.ndarray, clear: np.ndarray, sky: PhotoSky) -> tuple[np.ndarray, np.ndarray]:
    """Means (E, A, N) over clear fine cells (f, a, N) by solid angle, NaN where too few; their solid angle (E, A)."""
    k = sky.k
    weight = clear * np.cos(np.radians(sky.fine_elevation_deg))[:, None]
    e, a = fine.shape[0] // k, fine.shape[1] // k
    total = np.where(clear[..., None], fine, 0.0) * weight[..., None]
    total = total.reshape(e, k, a, k, -1).sum(axis=(1, 3))
    weights = weight.reshape(e, k, a, k).sum(axis=(1, 3))
    enough = clear.reshape(e, k, a, k).mean(axis=(1, 3)) >= LEAST_CLEAR_FRACTION
    with np.errstate(divide="ignore", invalid="ignore"):
        xyz = np.where(enough[..., None], total / weights[..., None], np.nan)
    return xyz, np.where(enough, weights, 0.0) * np.radians(sky.step_deg) ** 2


def components(xyz: np.ndarray, colour_known: bool = True) -> np.ndarray:
    """ln G, ln R/G, ln B/G (3, ..., n) of XYZ (..., n, 3); of a grey photograph ln Y thrice."""
    if not colour_known:
        return np.log(np.repeat(xyz[None, ..., 1], 3, axis=0))
    rgb = colour.xyz_to_linear_rgb(xyz, OBSERVER)
    floor = 2.0 * FLOOR * xyz[..., 1:2]
    red, green, blue = np.moveaxis(np.log(0.5 * (rgb + np.hypot(rgb, floor))), -1, 0)
    return np.stack([green, red - green, blue - green])
