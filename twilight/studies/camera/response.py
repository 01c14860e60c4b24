"""The response curve of a camera: undone, recovered from a bracketed series, and the series merged into one picture.

A response curve says which exposure (light times exposure time, relative) a stored sample z in 0..1 stands for.  The
file of a curve is a CSV with the columns ``sample,exposure`` or ``sample,red,green,blue``: samples that increase from 0
to 1, exposures that are not negative and do not decrease; between the rows it is linear.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twilight.atmosphere.csv_columns import read_columns
from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.base.extras import missing
from twilight.base.whole_files import write_csv
from twilight.io.stored_image import ResponseFunction, StoredImage, srgb_to_linear

NODES = 256
"""Samples at which a curve is recovered and stored."""

SAMPLES = 300
"""Levels of each picture that a curve is recovered from."""
MOST_PIXELS = 1e6
"""Pixels of each picture, about, that are looked at."""
LEAST_PIXELS = 50
"""Pixels that must be well exposed in two pictures."""
TINY = 1e-12
"""Exposure that stands for none in logarithms."""

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
    if (np.diff(sample) <= 0).any() or abs(sample[0]) > ROUNDING or sample[-1] != 1.0:
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


def recover_response(pictures: Sequence[StoredImage], times_s: Sequence[float]) -> ResponseCurve:
    """The response curve from pictures of one still scene with known exposure times [s].

    That of colour-hdri: least squares after Debevec and Malik 1997 (Recovering high dynamic range radiance maps from
    photographs) at `NODES` levels, of levels that the same part of each picture's pixels is below (Grossberg and Nayar
    2003).  It is made not to decrease, and is linear from the lowest level that was measured to 0 at sample 0.
    Errors: TwilightError for a series that cannot be used, and without colour-hdri.
    """
    try:
        import colour_hdri  # optional
    except ImportError:
        raise missing("colour_hdri", "recovering a response curve") from None
    times = check_bracket(pictures, times_s)
    if any(picture.linear for picture in pictures):
        raise TwilightError("response: pictures that hold linear light (HDR, EXR, RAW, float TIFF) have no curve")
    height, width = pictures[0].samples.shape[:2]
    every = max(1, round((height * width / MOST_PIXELS) ** 0.5))
    # the library rounds levels down
    stored = [picture.samples[::every, ::every].astype(float) for picture in pictures]
    levels = np.stack([np.rint(z * (NODES - 1)) / (NODES - 1) for z in stored])
    exposed = _weight(levels)
    if ((exposed > 0).sum(axis=0) >= 2).sum(axis=(0, 1)).min() < LEAST_PIXELS:
        raise TwilightError(
            f"response: fewer than {LEAST_PIXELS} pixels are well exposed in two pictures; the exposure times are too "
            "far apart"
        )
    series = colour_hdri.ImageStack()
    for z, seconds in zip(levels, times, strict=True):
        # exposures count in proportion to the time: one aperture, one sensitivity
        metadata = colour_hdri.Metadata(f_number=1.0, exposure_time=seconds, iso=100.0)
        series.append(colour_hdri.Image(data=z, metadata=metadata))
    found = colour_hdri.camera_response_functions_Debevec1997(
        series, sampling_function_kwargs={"samples": SAMPLES}, weighting_function=_weight, n=NODES
    )
    sample = np.linspace(0.0, 1.0, NODES)
    measured = _weight(sample) > 0
    measured[[0, -1]] = True
    exposure = found[measured]
    exposure[0] = 0.0
    exposure = np.maximum.accumulate(np.maximum(exposure, 0.0), axis=0)
    curve = ResponseCurve(sample[measured], exposure / exposure[-1])
    light = np.log(np.maximum(curve(np.stack(stored)), TINY)) - np.log(times)[:, None, None, None]
    mean = (exposed * light).sum(axis=0) / np.maximum(exposed.sum(axis=0), TINY)
    used = (exposed > 0) & ((exposed > 0).sum(axis=0) >= 2)
    residual = np.sqrt(np.average((light - mean)[used] ** 2, weights=exposed[used]))
    return replace(curve, residual=float(residual), pairs=int(used.sum()))


_LOWEST = 0.01
"""Sample below which nothing is measured: black level."""
_HIGHEST = 0.99
"""Sample above which nothing is measured: saturation."""


def _weight(z: np.ndarray) -> np.ndarray:
    """Distance of a sample from the nearer end of its range; 0 beyond."""
    return np.maximum(np.minimum(z - _LOWEST, _HIGHEST - z), 0.0) * 2.0


# Merging --------------------------------------------------------------------------------------------------------


def merge_bracket(
    pictures: Sequence[StoredImage], times_s: Sequence[float], response: ResponseFunction | None
) -> tuple[np.ndarray, np.ndarray]:
    """One linear picture (H, W, 3), exposure per second, from a bracketed series; and where it is saturated (H, W).

    response: as ``stored_image.read_image``; for pictures that are linear already give None.  A pixel is the mean over
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
