"""Random numbers by a counter that any thread can start anywhere, SplitMix64 (Steele, Lea & Flood 2014), and draws."""

from __future__ import annotations

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.kernel import INNER

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
MIX_2 = np.uint64(0x94D049BB133111EB)
TO_UNIT = 2.0**-53


@njit(inline="always", **INNER)
def mix(z):
    """The finaliser of SplitMix64: a bijection of 64-bit integers z (uint64) that leaves no visible order."""
    z = (z ^ (z >> np.uint64(30))) * MIX_1
    z = (z ^ (z >> np.uint64(27))) * MIX_2
    return z ^ (z >> np.uint64(31))


@njit(inline="always", **INNER)
def uniform(stream):
    """Next number in [0, 1) of a stream (an array of one uint64, advanced in place)."""
    stream[0] += GOLDEN
    return np.float64(mix(stream[0]) >> np.uint64(11)) * TO_UNIT


@njit(inline="always", **INNER)
def draw_from(cumulative, x):
    """First index whose running sum exceeds x.

    cumulative (N,): running sums; x: from 0 to the last of them.
    """
    lo = 0
    hi = cumulative.size - 1
    while lo < hi:
        mid = (lo + hi) // 2
        if cumulative[mid] > x:
            hi = mid
        else:
            lo = mid + 1
    return lo


@njit(**INNER)
def start(stream, seed, pixel_key, wavelength, chunk):
    """Set a stream for one chunk of one pixel and wavelength; chunks of anything else get unrelated streams.

    stream (1,): uint64, set; seed, pixel_key, wavelength, chunk: whole numbers that name the chunk.
    """
    key = mix(np.uint64(seed) + GOLDEN)
    key = mix(key ^ np.uint64(pixel_key)) + GOLDEN
    key = mix(key ^ np.uint64(wavelength)) + GOLDEN
    stream[0] = mix(key ^ np.uint64(chunk))
