"""The response curve of a camera: undone, recovered from a bracketed series, and the series merged into one picture.

A response curve says which exposure (light times exposure time, relative) a stored sample z in 0..1 stands for.  The
file of a curve is a CSV with the columns ``sample,exposure`` or ``sample,red,green,blue``: samples that increase from 0
to 1, exposures that are not negative and do not decrease; between the rows it is linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twilight.atmosphere.csv_columns import read_columns
from twilight.base.errors import TwilightError
from twilight.base.whole_files import write_csv
from twilight.studies.camera.image import ResponseFunction, StoredImage, srgb_to_linear

NODES = 256
"""Samples at which a curve is recovered and stored."""

EXPOSURES = dict.fromkeys(("exposure", "red", "green", "blue"), (0.0, 1e300, "0 to 1e300"))
"""Columns of a curve's file beside its samples, and the numbers that they may hold."""


@dataclass(frozen=True, eq=False)
class ResponseCurve:
    """A tabulated curve: sample (N,) from 0 to 1, exposure (N, 3); call it with samples (..., 3).

    residual: root mean square of ln(exposure) against the series it was recovered from; None for other curves.
    pairs: equations that it was recovered from.
    """

    sample: np.ndarray
    exposure: np.ndarray
    residual: float | None = None
    pairs: int = 0

    def __call__(self, samples: np.ndarray) -> np.ndarray:
        z = np.asarray(samples)
        return np.stack([np.interp(z[..., c], self.sample, self.exposure[:, c]) for c in range(3)], axis=-1)


def load_response(response: float | str) -> ResponseFunction | None:
    """The function of a camera's ``response``: None for ``linear``, ``srgb``, an exponent, or the path of a curve.

    An exponent p means exposure = sample^p.  Errors: TwilightError as ``read_response``.
    """
    if response == "linear":
        return None
    if response == "srgb":
        return srgb_to_linear
    if isinstance(response, str):
        return read_response(response)
    exponent = float(response)
    return lambda samples: np.maximum(samples, 0.0) ** exponent


def read_response(path: str | Path) -> ResponseCurve:
    """A curve from its CSV file.  Errors: TwilightError where it is not what the module says."""
    names, table, _ = read_columns(Path(path), {"sample": (0.0, 1.0, "0 to 1")}, EXPOSURES)
    if names not in (["sample", "exposure"], ["sample", "red", "green", "blue"]):
        raise TwilightError(f"{path}: a response curve has the columns sample,exposure or sample,red,green,blue")
    sample, exposure = table[:, 0], table[:, 1:]
    if (np.diff(sample) <= 0).any() or abs(sample[0]) > 1e-9 or sample[-1] != 1.0:
        raise TwilightError(f"{path}: the samples of a response curve must increase from 0 to 1")
    if (np.diff(exposure, axis=0) < 0).any() or (exposure[-1] <= exposure[0]).any():
        raise TwilightError(f"{path}: the exposures of a response curve must not decrease, nor be all the same")
    return ResponseCurve(sample, np.broadcast_to(exposure, (sample.size, 3)).copy())


def write_response(path: str | Path, curve: ResponseCurve) -> None:
    """Write a curve that ``read_response`` reads, whole or not at all."""
    note = ""
    if curve.residual is not None:
        note = f"recovered by twilight from a bracketed series; rms of ln(exposure) {curve.residual:.4g}"
    rows = [
        [f"{z:.9g}", *(f"{value:.7g}" for value in row)] for z, row in zip(curve.sample, curve.exposure, strict=True)
    ]
    write_csv(path, ["sample", "red", "green", "blue"], rows, note)


# Recovery -------------------------------------------------------------------------------------------------------


def check_bracket(pictures: Sequence[StoredImage], times_s: Sequence[float]) -> np.ndarray:
    """The exposure times (P,) of a series that can be used.  Errors: TwilightError that says what is wrong with it."""
    times = np.asarray(times_s, dtype=float)
    if len(pictures) < 2 or times.size != len(pictures):
        raise TwilightError(
            f"response: a bracketed series needs two pictures at least and a time for each, got "
            f"{len(pictures)} pictures and {times.size} times"
        )
    if not (np.isfinite(times).all() and (times > 0).all()) or times.max() / times.min() < 1.1:
        raise TwilightError("response: the exposure times must be positive and differ by a tenth at least")
    shapes = {picture.samples.shape[:2] for picture in pictures}
    if len(shapes) > 1:
        sizes = ", ".join(f"{w} x {h}" for h, w in sorted(shapes))
        raise TwilightError(f"response: the pictures of a series must have the same size, got {sizes}")
    return times


def recover_response(
    pictures: Sequence[StoredImage], times_s: Sequence[float], *, n_pixels: int = 400, smoothness: float = 0.03
) -> ResponseCurve:
    """The response curve from pictures of one still scene with known exposure times [s].

    Least squares after Debevec and Malik 1997 (Recovering high dynamic range radiance maps from photographs): in each
    channel ln f(z_pj) = ln E_p + ln t_j for pixels p and exposures j, weighted with the distance of z from both ends,
    and with the second derivative of ln f by ln z held small, which is 0 for any gamma curve.  Here f is linear between
    ``NODES`` nodes, so any bit depth can be used, and the E_p are eliminated.  Dark and saturated ends, where the
    weights go to 0, are continued smoothly.  The curve is scaled to exposure 1 at sample 1 and made not to decrease.

    n_pixels: taken from even parts of the picture and of the range of brightness.  Errors: TwilightError for a series
    that cannot be used.
    """
    times = check_bracket(pictures, times_s)
    if any(picture.linear for picture in pictures):
        raise TwilightError("response: pictures that hold linear light (HDR, EXR, RAW, float TIFF) have no curve")
    stack = np.stack([picture.samples for picture in pictures])
    channels = [_solve(_choose(stack[..., c], n_pixels), np.log(times), smoothness) for c in range(3)]
    curves, squares, counts = zip(*channels, strict=True)
    exposure = np.exp(np.stack(curves, axis=-1))
    exposure = np.maximum.accumulate(exposure / exposure[-1], axis=0)
    exposure[0] = 0.0  # no light, sample 0: the logarithm cannot say so
    residual = float(np.sqrt(np.sum(squares) / sum(counts)))
    return ResponseCurve(np.linspace(0.0, 1.0, NODES), exposure, residual, sum(counts))


_LOWEST = 0.01
"""Sample below which nothing is measured: black level."""
_HIGHEST = 0.99
"""Sample above which nothing is measured: saturation."""


def _weight(z: np.ndarray) -> np.ndarray:
    """Distance of a sample from the nearer end of its range; 0 beyond."""
    return np.maximum(np.minimum(z - _LOWEST, _HIGHEST - z), 0.0) * 2.0


def _choose(stack: np.ndarray, n_pixels: int) -> np.ndarray:
    """Samples (n, P) of pixels well exposed in two pictures at least, spread over the range of brightness.

    Pixels where the scene is smooth come first: a series that moved by a pixel, or was sharpened, spoils edges most.
    """
    usable = (_weight(stack) > 0).sum(axis=0) >= 2
    if usable.sum() < 50:
        raise TwilightError(
            "response: fewer than 50 pixels are well exposed in two pictures; the exposure times are too far apart"
        )
    middle = stack.mean(axis=0)
    down, right = np.gradient(middle) if min(middle.shape) > 1 else (np.zeros_like(middle),) * 2
    rough = np.hypot(down, right)[usable]
    z = stack[:, usable].T
    level = np.argsort(np.argsort(middle[usable], kind="stable"), kind="stable") * n_pixels // usable.sum()
    order = np.lexsort((rough, level))
    first = np.unique(level[order], return_index=True)[1]
    return z[order[first]]


def _solve(z: np.ndarray, log_times: np.ndarray, smoothness: float) -> tuple[np.ndarray, float, int]:
    """ln f at the nodes (NODES,) for samples (n, P); sum of squares of the residuals, and how many there are."""
    n, p = z.shape
    weight = _weight(z)
    position = np.clip(z, 0.0, 1.0) * (NODES - 1)
    low = np.minimum(position.astype(int), NODES - 2)
    upper_fraction = position - low
    basis = np.zeros((n, p, NODES))
    i, j = np.meshgrid(np.arange(n), np.arange(p), indexing="ij")
    basis[i, j, low] = 1.0 - upper_fraction
    basis[i, j, low + 1] += upper_fraction
    # ln E of a pixel is the weighted mean of ln f - ln t over its exposures
    total = weight.sum(axis=1, keepdims=True)
    fraction = weight / total
    basis = basis - np.einsum("np,npk->nk", fraction, basis)[:, None, :]
    target = log_times - (fraction @ log_times)[:, None]
    root = np.sqrt(weight)
    rows = (root[..., None] * basis).reshape(n * p, NODES)
    right = (root * target).ravel()
    used = root.ravel() > 0
    bend = smoothness * _exponent_changes()
    pin = np.zeros((1, NODES))
    pin[0, NODES // 2] = 1.0
    matrix = np.concatenate([rows[used], bend, pin])
    solution = np.linalg.lstsq(matrix, np.concatenate([right[used], np.zeros(NODES - 1)]), rcond=None)[0]
    difference = (basis.reshape(n * p, NODES)[used] @ solution) - target.ravel()[used]
    weights = weight.ravel()[used]
    squares = float((weights * difference**2).sum() / weights.mean())
    return solution, squares, int(used.sum())


def _exponent_changes() -> np.ndarray:
    """(NODES - 2, NODES): change of the local exponent d ln f / d ln z at each inner node over sqrt(d ln z).

    Its sum of squares is the integral of the squared second derivative of ln f by ln z, 0 for any gamma curve.
    """
    log_z = np.log(np.maximum(np.arange(NODES), 0.5) / (NODES - 1))
    step = np.diff(log_z)
    k = np.arange(NODES - 2)
    out = np.zeros((NODES - 2, NODES))
    out[k, k] = 1.0 / step[:-1]
    out[k, k + 1] = -1.0 / step[:-1] - 1.0 / step[1:]
    out[k, k + 2] = 1.0 / step[1:]
    return out / np.sqrt(0.5 * (step[:-1] + step[1:]))[:, None]


# Merging --------------------------------------------------------------------------------------------------------


def merge_bracket(
    pictures: Sequence[StoredImage], times_s: Sequence[float], response: ResponseFunction | None
) -> tuple[np.ndarray, np.ndarray]:
    """One linear picture (H, W, 3), exposure per second, from a bracketed series; and where it is saturated (H, W).

    response: as ``camera.image.read_image``; for pictures that are linear already give None.  A pixel is the mean over
    the exposures, weighted with the distance of its samples from both ends and with the exposure time (long exposures
    hold more light); all channels of a pixel have the weight of the worst.  Where no exposure is good, the longest that
    is not saturated is taken, and the shortest where all are.  Errors: TwilightError as ``check_bracket``.
    """
    times = check_bracket(pictures, times_s)
    total = np.zeros(pictures[0].samples.shape, dtype=np.float64)
    weights = np.zeros(pictures[0].samples.shape[:2])
    order = np.argsort(times)
    fallback, saturated = None, None
    for index in order:
        picture, seconds = pictures[index], times[index]
        z = picture.samples
        light = picture.light(response).astype(float) / seconds
        if fallback is None:
            fallback, saturated = light, picture.saturated.copy()
        else:
            fallback = np.where(picture.saturated[..., None], fallback, light)
        weight = np.where(picture.saturated, 0.0, _weight(z).min(axis=-1) * seconds)
        total += weight[..., None] * light
        weights += weight
    assert fallback is not None and saturated is not None
    with np.errstate(divide="ignore", invalid="ignore"):
        merged = np.where(weights[..., None] > 0, total / weights[..., None], fallback)
    return merged.astype(np.float32), saturated
