"""Display values to 8 bits: the one place where pictures of skies lose their depth."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

MAX_CACHED_VALUES = 1 << 23
"""The noise of pictures with more values is not cached."""

ROWS_AT_ONCE = 64
"""Rows that are worked on at the same time: each step has copies of its own."""


def to_bytes(picture: np.ndarray, first_row: int = 0) -> np.ndarray:
    """Display values 0..1 (height, width, K) as 8 bits, dithered by one step so that a smooth sky shows no bands.

    The mean over a few pixels is the value itself.  The noise is interleaved gradient noise (Jimenez 2014, Next
    generation post processing in Call of Duty), another part of it for each channel, so that the noise is grey in the
    mean and not in every pixel; it is fixed: equal skies give equal files.  NaN is black.  first_row: of the
    whole picture, where this is a part of it.
    """
    make_noise = _cached_noise if picture.size <= MAX_CACHED_VALUES else _noise
    noise = make_noise(picture.shape, first_row)
    out = np.empty(picture.shape, np.uint8)
    for first in range(0, len(picture), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        out[rows] = np.clip(np.floor(np.nan_to_num(picture[rows]) * 255.0 + noise[rows]), 0, 255)
    return out


def _noise(shape: tuple[int, ...], first_row: int) -> np.ndarray:
    height, width, channels = shape
    x, shift = np.arange(float(width)), 5.588238 * np.arange(channels)
    out = np.empty(shape)
    for first in range(0, height, ROWS_AT_ONCE):
        y = np.arange(float(first), float(min(first + ROWS_AT_ONCE, height)))[:, None, None]
        phase = 0.06711056 * (x[:, None] + shift) + 0.00583715 * (y + first_row + shift)
        out[first : first + ROWS_AT_ONCE] = np.mod(52.9829189 * np.mod(phase, 1.0), 1.0)
    return out


@lru_cache(maxsize=1)
def _cached_noise(shape: tuple[int, ...], first_row: int) -> np.ndarray:
    """The pictures of a film have the same noise."""
    noise = _noise(shape, first_row)
    noise.flags.writeable = False
    return noise
