"""How a camera was held, from the picture alone: the line along which bright sky ends at dark ground.

In every column the step from light to dark that is largest is a candidate; the line that most of them lie on, in the
camera's own directions, is the horizon, and its normal the vertical.  Hills and houses stand above the true horizon, so
that the camera is taken to have looked lower than it did; `SKYLINE_ERROR_DEG` stands for that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from twilight.sky.colour import REC709_LUMINANCE
from twilight.studies.camera.image import StoredImage
from twilight.studies.camera.model import CameraModel

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
    """elevation_deg, roll_deg: as of `camera.model.Orientation`; columns: fraction of the picture's that show it."""

    elevation_deg: float
    roll_deg: float
    columns: float


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
    return Horizon(elevation, float(np.degrees(np.arctan2(-up[0], up[2]))), float(on.sum() / drop.shape[1]))


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
