"""How bright each picture of a film is: one exposure for all, a camera that meters, an eye that adapts."""

from __future__ import annotations

import numpy as np

from twilight.colour import auto_exposure_ev100
from twilight.io.view import DARKEST_SHARE

MODES = ("camera", "constant", "eye")
CAMERA_S = 1.0
"""Seconds of the film, standard deviation, over which a camera's exposure is smoothed."""


def meter(light: np.ndarray) -> tuple[float, float]:
    """(exposure value at ISO 100 as `io.view` takes it, log-mean luminance [cd m^-2]) of a picture (H, W, 4) without
    the sun's disc; 0 is left out."""
    seen = light[..., 1][light[..., 1] > 0.0]
    if not seen.size:
        return auto_exposure_ev100(seen), 1e-6
    lit = seen[seen >= DARKEST_SHARE * np.quantile(seen, 0.995)]
    return auto_exposure_ev100(lit), float(np.exp(np.log(seen).mean()))


def smoothed(metered: np.ndarray, frames_per_second: float) -> np.ndarray:
    """A camera's exposure values (N,) from metered ones: a mean over the pictures before and after, so that it does not
    lag and a straight line stays one to its ends."""
    values = np.asarray(metered, float)
    sigma = CAMERA_S * frames_per_second
    reach = min(int(3.0 * sigma), values.size - 1)
    if reach < 1:
        return values.copy()
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return np.convolve(np.pad(values, reach, "reflect", reflect_type="odd"), weight / weight.sum(), "valid")
