"""Point sources in a picture: found above a local background, centred to a fraction of a pixel, hot pixels dropped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, maximum_filter, median_filter
from scipy.spatial import cKDTree

from twilight.base.conventions import DARK
from twilight.studies.camera.model import CameraModel

CELL_PX = 24
"""Side of the cells in which background and noise are measured: many stars wide, narrow beside a skyline."""
SMOOTHING_PX = 1.0
"""Standard deviation of the Gaussian that a star is looked for with."""
LEAST_NOISE = 0.2
"""Smallest noise that is believed, as a fraction of the picture's median noise."""
BLACK_SKY_NOISE = 1e-3
"""Noise as a fraction of the brightest star, where the median is 0."""
WIDEST = 2.5
"""Sources this many times wider than usual are clouds."""
HALF_PATCH = 5
"""Pixels on either side of a source in the patch where it is measured."""
WINDOW_PX = 1.8
"""Standard deviation of the window of the centroid."""
RING_PX = 3.6
"""Pixels of the patch farther out than this tell the level under a star."""
CENTRING_STEPS = 12
"""Iterations of the centroid."""
MOST_STARS = 4000
"""Brightest sources that are used."""
LEAST_NEIGHBOUR = 0.2
"""A source whose brightest neighbour pixel has less than this fraction of its peak is a hot pixel or a cosmic ray,
where the picture's stars are never as sharp: no clear source lies between LEAST_NEIGHBOUR and GAP_NEIGHBOUR."""
GAP_NEIGHBOUR = 0.3
"""Upper end of that gap.  Stars of an undersampled picture fill it, and no shape tells them from hot pixels."""
LARGEST_GAP_FRACTION = 0.05
"""Fraction of the clear sources that may lie in the gap."""
CLEAR = 15.0
"""Signal to noise of a clear source."""
POLAR_LATITUDE_RAD = np.radians(50.0)
"""Latitude in a latlong picture beyond which sources are found in an equidistant view of the cap."""


@dataclass(frozen=True, eq=False)
class Sources:
    """Point sources, brightest first.

    xy (N, 2): centres in the picture.  flux (N,): above the background in a Gaussian window, the picture's unit times
    pixels.  signal_to_noise (N,): of the smoothed peak.  width_px (N,): standard deviation of the light about it.
    """

    xy: np.ndarray
    flux: np.ndarray
    signal_to_noise: np.ndarray
    width_px: np.ndarray

    def __len__(self) -> int:
        return len(self.flux)

    def take(self, chosen: np.ndarray) -> Sources:
        """The sources of these indices, or where this mask is true."""
        return Sources(self.xy[chosen], self.flux[chosen], self.signal_to_noise[chosen], self.width_px[chosen])


def detect(picture: np.ndarray, camera: CameraModel, threshold: float = 5.0) -> Sources:
    """Sources in a picture (height, width) or (height, width, 3) of linear light, `threshold` standard deviations up.

    The caps of a latlong picture, whose rows are stretched there, are searched in an equidistant view; hot
    pixels are not looked for in it, for it was resampled from photographs, and stars in it may be single pixels.
    """
    light = np.asarray(picture, dtype=np.float32)
    light = np.nan_to_num(light.mean(axis=-1) if light.ndim == 3 else light, posinf=0.0, neginf=0.0)
    if camera.projection != "latlong":
        sources = _detect_flat(light, threshold, single_pixels=False)
        return sources.take(np.isfinite(camera.angle_off_axis(sources.xy)))
    return _detect_panorama(light, camera, threshold)


def _detect_panorama(light: np.ndarray, camera: CameraModel, threshold: float) -> Sources:
    """The belt of the picture itself, continued across its seam, and a view of each pole."""
    height, width = light.shape
    seam = 2 * CELL_PX
    belt = _detect_flat(np.pad(light, ((0, 0), (seam, seam)), mode="wrap"), threshold, single_pixels=True)
    xy = belt.xy - [seam, 0]
    latitude = np.pi * (0.5 - xy[:, 1] / height)
    # a pixel of the belt has the solid angle of cos(latitude) pixels of the equator
    belt = Sources(xy, belt.flux * np.cos(latitude), belt.signal_to_noise, belt.width_px)
    parts = [belt.take((xy[:, 0] >= 0) & (xy[:, 0] < width) & (np.abs(latitude) < POLAR_LATITUDE_RAD))]
    focal = width / (2.0 * np.pi)
    margin = 1.15
    side = int(np.ceil(2.0 * margin * focal * (np.pi / 2 - POLAR_LATITUDE_RAD)))
    wrapped = np.pad(light, ((1, 1), (3, 3)), mode="wrap")
    wrapped[0], wrapped[-1] = wrapped[1], wrapped[-2]
    for sign in (1.0, -1.0):
        cap = CameraModel.model_validate(
            {
                "projection": "equidistant",
                "image": {"width_px": side, "height_px": side},
                "lens": {"focal_length_px": float(focal)},
                "orientation": {"elevation_deg": 90.0 * sign},
            }
        )
        level = CameraModel.model_validate({"projection": "latlong", "image": {"width_px": width, "height_px": height}})
        directions = cap.directions(cap.pixel_centres())
        at = level.project(directions)
        # the mean over the width of a pixel of the view, which is many pixels of a row wide near the pole
        stretch = 1.0 / np.maximum(np.hypot(directions[..., 0], directions[..., 1]), 1e-3)
        view = np.zeros((side, side), dtype=np.float32)
        offsets = (np.arange(8) + 0.5) / 8 - 0.5
        for offset in offsets:
            column = np.mod(at[..., 0] - 0.5 + offset * np.minimum(stretch, width / 2), width)
            view += map_coordinates(wrapped, [at[..., 1] - 0.5 + 1.0, column + 3.0], order=1, mode="nearest")
        sources = _detect_flat(view / len(offsets), threshold, single_pixels=True)
        position = level.project(cap.directions(sources.xy))
        polar = sign * (0.5 - position[:, 1] / height) * np.pi >= POLAR_LATITUDE_RAD
        parts.append(Sources(position, sources.flux, sources.signal_to_noise, sources.width_px).take(polar))
    joined = [np.concatenate([getattr(p, n) for p in parts]) for n in ("xy", "flux", "signal_to_noise", "width_px")]
    all_of_them = Sources(*joined)
    return all_of_them.take(np.argsort(-all_of_them.flux, kind="stable")[:MOST_STARS])


def background(light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(background, noise) of every pixel: median and 1.4826 median absolute deviation of cells, interpolated.

    Cells are smoothed by a 3 x 3 median, so that a lamp or a bright star that fills one does not count.
    """
    height, width = light.shape
    rows, columns = -(-height // CELL_PX), -(-width // CELL_PX)
    full = np.pad(light, ((0, rows * CELL_PX - height), (0, columns * CELL_PX - width)), mode="symmetric")
    cells = full.reshape(rows, CELL_PX, columns, CELL_PX).transpose(0, 2, 1, 3).reshape(rows, columns, -1)
    middle = np.median(cells, axis=-1)
    spread = 1.4826 * np.median(np.abs(cells - middle[..., None]), axis=-1)
    along_y, along_x = _linear(height, rows), _linear(width, columns)
    low, noise = (along_y @ median_filter(m, 3, mode="nearest") @ along_x.T for m in (middle, spread))
    return low, noise


def _linear(size: int, cells: int) -> np.ndarray:
    """Weights (size, cells) that interpolate between the cells' centres, and hold the outer ones."""
    at = np.clip((np.arange(size) + 0.5) / CELL_PX - 0.5, 0.0, cells - 1.0)
    return np.maximum(1.0 - np.abs(at[:, None] - np.arange(cells)[None, :]), 0.0).astype(np.float32)


def _detect_flat(light: np.ndarray, threshold: float, single_pixels: bool) -> Sources:
    low, _ = background(light)
    above = light - low
    smooth = gaussian_filter(above, SMOOTHING_PX, mode="nearest")
    _, noise = background(smooth)
    # a sky that 8 bits made black has no noise of its own
    usual = float(np.median(noise))
    floor = LEAST_NOISE * usual if usual > 0 else BLACK_SKY_NOISE * max(float(smooth.max()), DARK)
    ratio = smooth / np.maximum(noise, floor)
    peaks = (ratio >= threshold) & (smooth == maximum_filter(smooth, size=5, mode="nearest"))
    edge = HALF_PATCH + 1
    peaks[:edge], peaks[-edge:], peaks[:, :edge], peaks[:, -edge:] = False, False, False, False
    row, column = np.nonzero(peaks)
    strongest = np.argsort(-smooth[row, column], kind="stable")[: 2 * MOST_STARS]
    row, column = row[strongest], column[strongest]
    if not len(row):
        return Sources(np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0))
    xy, flux, width, settled = _centres(above, row, column)
    keep = settled & (flux > 0)
    if not single_pixels:
        keep &= ~_hot(_largest_neighbour(above, row, column), ratio[row, column])
    sources = Sources(xy, flux, ratio[row, column], width).take(keep)
    width_px = float(np.median(sources.width_px)) if len(sources) else 0.0
    sources = sources.take(sources.width_px <= WIDEST * max(width_px, SMOOTHING_PX))
    return _without_twins(sources.take(np.argsort(-sources.flux, kind="stable")))


def _centres(above: np.ndarray, row: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, ...]:
    """(positions, flux, width, settled) by moments in a Gaussian window that follows the centre.

    With a window w about the current centre the step is 2 sum(w I d) / sum(w I), whose fixed point for a Gaussian star
    is its centre (Bertin's XWIN of SExtractor).
    """
    offset = np.arange(-HALF_PATCH, HALF_PATCH + 1)
    patch = above[row[:, None, None] + offset[None, :, None], column[:, None, None] + offset[None, None, :]]
    patch = patch.astype(float)
    ring = np.hypot(offset[:, None], offset[None, :]) > RING_PX
    patch -= np.median(patch[:, ring], axis=1)[:, None, None]  # what is left of the background, and of the Milky Way
    dx, dy = np.zeros(len(row)), np.zeros(len(row))
    grid_x, grid_y = offset[None, None, :], offset[None, :, None]
    for _ in range(CENTRING_STEPS):
        ex, ey = grid_x - dx[:, None, None], grid_y - dy[:, None, None]
        weighted = np.exp(-0.5 * (ex**2 + ey**2) / WINDOW_PX**2) * patch
        total = weighted.sum(axis=(1, 2))
        total = np.where(total > 0, total, np.inf)
        dx = dx + 2.0 * (weighted * ex).sum(axis=(1, 2)) / total
        dy = dy + 2.0 * (weighted * ey).sum(axis=(1, 2)) / total
        dx, dy = np.clip(dx, -3.0, 3.0), np.clip(dy, -3.0, 3.0)
    ex, ey = grid_x - dx[:, None, None], grid_y - dy[:, None, None]
    square = ex**2 + ey**2
    weighted = np.exp(-0.5 * square / WINDOW_PX**2) * patch
    total = weighted.sum(axis=(1, 2))
    windowed = 0.5 * (weighted * square).sum(axis=(1, 2)) / np.where(total > 0, total, np.inf)
    windowed = np.clip(windowed, 0.02, 0.98 * WINDOW_PX**2)
    variance = 1.0 / (1.0 / windowed - 1.0 / WINDOW_PX**2)  # of the star itself, were it Gaussian
    flux = total  # in the window only: what lies beyond it belongs to clouds and lamps more than to stars
    settled = np.hypot(dx, dy) < 2.0
    return np.stack([column + 0.5 + dx, row + 0.5 + dy], axis=-1), flux, np.sqrt(variance), settled & np.isfinite(total)


def _largest_neighbour(above: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """The brightest of the four pixels beside the brightest pixel within one of each position, as a fraction of it."""
    offset = np.arange(-1, 2)
    around = above[row[:, None, None] + offset[None, :, None], column[:, None, None] + offset[None, None, :]]
    best = around.reshape(len(row), 9).argmax(axis=1)
    row, column = row + best // 3 - 1, column + best % 3 - 1
    sides = np.stack([above[row + i, column + j] for i, j in ((-1, 0), (1, 0), (0, -1), (0, 1))])
    peak = above[row, column]
    return sides.max(axis=0) / np.where(peak > 0, peak, np.inf)


def _hot(neighbour: np.ndarray, signal_to_noise: np.ndarray) -> np.ndarray:
    """Which sources are single bright pixels; none where the picture's own stars are as sharp."""
    clear = signal_to_noise >= CLEAR
    between = clear & (neighbour >= LEAST_NEIGHBOUR) & (neighbour < GAP_NEIGHBOUR)
    wide = clear & (neighbour >= GAP_NEIGHBOUR)
    sampled = between.sum() <= LARGEST_GAP_FRACTION * wide.sum()
    return (neighbour < LEAST_NEIGHBOUR) if sampled else np.zeros(len(neighbour), dtype=bool)


def _without_twins(sources: Sources) -> Sources:
    """Centres that ran into one another within a pixel and a half are one source."""
    keep = np.ones(len(sources), dtype=bool)
    if len(sources):
        for i, j in sorted(cKDTree(sources.xy).query_pairs(1.5)):
            if keep[i]:
                keep[j] = False
    return sources.take(keep)
