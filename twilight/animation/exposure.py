"""How bright each picture of a film is: one exposure for all, a camera that meters, an eye that adapts."""

from __future__ import annotations

import numpy as np

from twilight.io.view import DARKEST_FRACTION
from twilight.sky.colour import HIGHLIGHTS_OVER_MEAN, auto_exposure_ev100

CAMERA_S = 1.0
"""Seconds of the film, standard deviation, over which a camera's exposure is smoothed."""


def meter(light: np.ndarray, highlights_over_mean: float = HIGHLIGHTS_OVER_MEAN) -> tuple[float, float]:
    """(exposure value at ISO 100 as `io.view` meters it, log-mean luminance [cd m^-2]) of a picture (H, W, 4) without
    the sun's disc; 0 is left out."""
    seen = light[..., 1][light[..., 1] > 0.0]
    if not seen.size:
        return auto_exposure_ev100(seen), 1e-6
    lit = seen[seen >= DARKEST_FRACTION * np.quantile(seen, 0.995)]
    return auto_exposure_ev100(lit, None, highlights_over_mean), float(np.exp(np.log(seen).mean()))


def smoothed(metered: np.ndarray, frames_per_second: float) -> np.ndarray:
    """A camera's exposure values (N,) from metered ones: a mean over the pictures before and after, so that it does not
    lag and a straight line stays one to its ends."""
    values = np.asarray(metered, float)
    sigma = CAMERA_S * frames_per_second
    radius = min(int(3.0 * sigma), values.size - 1)
    if radius < 1:
        return values.copy()
    weight = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return np.convolve(np.pad(values, radius, "reflect", reflect_type="odd"), weight / weight.sum(), "valid")
