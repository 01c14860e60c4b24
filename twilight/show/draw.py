"""Pictures from a `SkyTable` of four channels, by its rule, for any sun between those of the table.

The rule is compiled here because films read some millions of directions a second; `SkyTable.light` is the same.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.jit.simd import LANES, broadcast, exp, load, store
from twilight.numerics.directions import PHASE_COUNT
from twilight.show.tones import CHANNELS, NO_LIGHT, padded_columns
from twilight.sky.table import DARKEST, SkyTable

NONE = np.float32(0.0)
"""0 in the single precision of the tables, which a literal is not."""
ONE = np.float32(1.0)
"""1 in that precision."""
BELOW_DEG = 1e-7
"""How far below the horizon light counts as the ground's [deg]."""


@njit(cache=True, nogil=True)
def _stencil(nodes, x, at, weight):
    """The four of nodes (N,) about x, at (4,), and their weight (4,), both filled: `hermite_weights` of one place."""
    last = nodes.size - 1
    x = min(max(x, nodes[0]), nodes[last])
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if nodes[middle] <= x:
            low = middle
        else:
            high = middle
    for k in range(4):
        at[k] = min(max(low + k - 1, 0), last)
    h = nodes[at[2]] - nodes[at[1]]
    before, after = nodes[at[1]] - nodes[at[0]], nodes[at[3]] - nodes[at[2]]
    b = h / before if before > 0.0 else 0.0
    a = h / after if after > 0.0 else 0.0
    left, right = 1.0 / (1.0 + b), 1.0 / (1.0 + a)
    u = (x - nodes[at[1]]) / h
    p, q = u * (1.0 - u) ** 2, u**2 * (1.0 - u)
    inner = p * left - q * right
    outer_left, outer_right = p * (1.0 - left) * b, q * (1.0 - right) * a
    weight[0] = -outer_left
    weight[1] = (1.0 + 2.0 * u) * (1.0 - u) ** 2 - inner + outer_left
    weight[2] = u**2 * (3.0 - 2.0 * u) + inner + outer_right
    weight[3] = -outer_right


class Nodes(NamedTuple):
    """The sky of one sun: table (rows, columns, LANES), S of the channels, then A; phase (angles, LANES): 0, then ln P;
    rows, columns: nodes [deg]; darkest (4,): light that counts as none."""

    table: np.ndarray
    phase: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    darkest: np.ndarray


class Pixels(NamedTuple):
    """directions (N, 2): elevation [deg] and its cosine; azimuth (N,) [deg]; above (N,): part of each pixel that is
    over the horizon [deg]."""

    directions: np.ndarray
    azimuth: np.ndarray
    above: np.ndarray
    horizon: float


class SunSeen(NamedTuple):
    """Apparent elevation and azimuth [deg], and one over the square of the distance [au^-2]."""

    elevation: float
    azimuth: float
    near: float


@njit(cache=True, nogil=True)
def _draw(nodes, pixels, sun, out, i, j):
    """Light out (N, 4) of directions i to j; nodes: `Nodes`; pixels: `Pixels`; sun: `SunSeen`."""
    table, phase, rows, columns, darkest = nodes
    directions, azimuth, above, horizon = pixels
    at, weight = np.empty(4, np.int64), np.empty(4)
    across, beside = np.empty(4, np.int64), np.empty(4)
    channels = np.empty((1, LANES), np.float32)
    n_angles, level = phase.shape[0], math.cos(math.radians(sun.elevation))
    for p in range(i, j):
        a = abs((azimuth[p] - sun.azimuth + 180.0) % 360.0 - 180.0)
        _stencil(columns, a, across, beside)
        half = math.sin(math.radians(0.5 * (directions[p, 0] - sun.elevation)))
        chord = half * half + directions[p, 1] * level * math.sin(math.radians(0.5 * a)) ** 2
        place = math.sqrt(2.0 * math.asin(math.sqrt(min(1.0, chord))) / math.pi) * (n_angles - 1)
        k = min(int(place), n_angles - 2)
        f = np.float32(place - k)
        for c in range(CHANNELS):
            out[p, c] = 0.0
        for side in range(2):
            fraction = above[p] if side == 1 else 1.0 - above[p]
            if fraction <= 0.0:
                continue
            e = max(directions[p, 0], horizon) if side == 1 else min(directions[p, 0], horizon - BELOW_DEG)
            _stencil(rows, e, at, weight)
            value = broadcast(NONE)
            for m in range(4):
                if weight[m] != 0.0:
                    for n in range(4):
                        value += np.float32(weight[m] * beside[n]) * load(table, (at[m], across[n]))
            value += (ONE - f) * load(phase, k) + f * load(phase, k + 1)
            store(channels, 0, exp(value))
            for c in range(CHANNELS):
                light = channels[0, c] + channels[0, CHANNELS + c]
                if light > darkest[c]:
                    out[p, c] += sun.near * fraction * light


@dataclass
class Painter:
    """Draws a fixed set of directions under any sun.

    table: of four channels [cd m^-2] at 1 au, many suns, and the ground.  elevation_deg, azimuth_deg (H, W): azimuth
    from north, or from whatever the sun's azimuth is counted from; NaN is outside the picture.
    """

    table: SkyTable
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray

    def __post_init__(self) -> None:
        self.outside = ~np.isfinite(self.elevation_deg)
        elevation = np.nan_to_num(self.elevation_deg)
        self._azimuth = np.nan_to_num(self.azimuth_deg).ravel()
        self.horizon_deg = horizon_of(self.table)
        tall = np.abs(np.gradient(elevation, axis=0)) + np.abs(np.gradient(elevation, axis=1))
        self._above = np.clip((elevation - self.horizon_deg) / np.maximum(tall, 1e-9) + 0.5, 0.0, 1.0).ravel()
        self._directions = np.stack([elevation.ravel(), np.cos(np.radians(elevation)).ravel()], axis=-1)
        self._columns, self._column = padded_columns(self.table.azimuth_deg)
        self._phase = np.zeros((PHASE_COUNT, LANES), np.float32)
        if self.table.log_phase is not None:
            self._phase[:, CHANNELS:] = self.table.log_phase

    def light(self, sun_elevation_deg: float, sun_azimuth_deg: float = 0.0, distance_au: float = 1.0) -> np.ndarray:
        """The channels [cd m^-2], (H, W, 4), without the sun's disc; 0 outside the picture."""
        sky = self.table.under(sun_elevation_deg)
        smooth = sky.smooth[0][:, self._column]
        layers = np.full((*smooth.shape[:2], LANES), NO_LIGHT, np.float32)
        layers[..., :CHANNELS] = smooth
        if sky.aureole is not None:
            layers[..., CHANNELS:] = sky.aureole[0][:, self._column]
        darkest = 2.0 * DARKEST * np.exp(smooth.max(axis=(0, 1)).astype(float))
        out = np.empty((self._azimuth.size, CHANNELS))
        nodes = Nodes(layers, self._phase, self.table.elevation_deg, self._columns, darkest)
        pixels = Pixels(self._directions, self._azimuth, self._above, self.horizon_deg)
        sun = SunSeen(float(sky.apparent_sun_deg[0]), float(sun_azimuth_deg), 1.0 / distance_au**2)
        in_slices(lambda i, j: _draw(nodes, pixels, sun, out, i, j), self._azimuth.size)
        out = out.reshape(*self.elevation_deg.shape, CHANNELS)
        out[self.outside] = 0.0
        return out


def horizon_of(table: SkyTable) -> float:
    """Apparent elevation of the horizon [deg]: the lowest break of a table that has the ground."""
    rows = table.elevation_deg
    return float(rows[np.flatnonzero(np.diff(rows) == 0.0)[0]])
