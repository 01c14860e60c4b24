"""Pictures from the tables of a field (`twilight.viewer.tables`), for any sun between those of the tables.

    light = exp(sky) + P(scattering angle) exp(aureole)

cubic (Catmull-Rom) in sun, elevation and azimuth, P linear in its logarithm: what the page of `twilight view` draws.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.jit.simd import LANES, broadcast, exp, load, store
from twilight.studies.export import sky_tables
from twilight.studies.export.field_values import PHASE_ANGLES
from twilight.viewer.colours import CHANNELS
from twilight.viewer.tables import ViewerTables, ViewerTableSizes

NO_LIGHT = -200.0
"""Logarithm that stands for no light."""
NONE = np.float32(0.0)
"""0 in the single precision of the tables, which a literal is not."""
ONE = np.float32(1.0)
"""1 in that precision."""


@njit(cache=True, nogil=True)
def _weights(t, out):
    """Weights out (4,) of the nodes -1, 0, 1, 2 at the place t, 0 to 1 (Catmull-Rom)."""
    t2, t3 = t * t, t * t * t
    out[0] = -0.5 * t + t2 - 0.5 * t3
    out[1] = 1.0 - 2.5 * t2 + 1.5 * t3
    out[2] = 0.5 * t + 2.0 * t2 - 1.5 * t3
    out[3] = 0.5 * (t3 - t2)


@njit(cache=True, nogil=True)
def _place(n_columns, n_ground, n_haze, n_sky, up, y, x, rows, columns, wy, wx):
    """Rows and columns (4,) of the 16 texels around the place (y, x), and their weights wy, wx (4,).

    n_columns, n_ground, n_haze, n_sky: of the table.  It is even about the sun's vertical, about the horizon, which
    lies below its rows (`up`, y from there) or above, and above the top of the haze; below that it goes on as a
    straight line.  There is a row beyond the zenith.
    """
    j = min(max(math.floor(y), 0), (n_haze + n_sky if up else n_ground) - 2)
    i = min(max(math.floor(x), 0), n_columns - 2)
    _weights(y - j, wy)
    _weights(x - i, wx)
    for k in range(4):
        row = j + k - 1
        if up:
            low = 0 if j < n_haze else n_haze
            rows[k] = n_ground + (2 * low - row if row < low else row)
        else:
            rows[k] = 2 * n_ground - 2 - row if row >= n_ground else max(row, 0)
        column = abs(i + k - 1)
        columns[k] = 2 * n_columns - 2 - column if column >= n_columns else column
    if up and j == n_haze - 1:
        wy[1] -= wy[3]
        wy[2] += 2.0 * wy[3]
        wy[3] = 0.0


@njit(inner=True, cache=True, nogil=True)
def _read(table, rows, columns, wy, wx):
    """The channels of a table (rows, columns, LANES) there, `Lanes`; rows, columns, wy, wx: of `_place`."""
    value = broadcast(NONE)
    for k in range(4):
        for m in range(4):
            value += np.float32(wy[k] * wx[m]) * load(table, (rows[k], columns[m]))
    return value


@njit(cache=True, nogil=True)
def _draw(table, phase, sizes, directions, azimuth, above, sun, sun_azimuth, near, out, first, end):
    """Light out (N, 4) of directions first to end; angles in rad.

    table (rows, columns, LANES): logarithms over the tables' elevation and azimuth, of the channels of the sky, then
    of what the aerosol's phase function multiplies; phase (angles, LANES): 0, then its logarithm; sizes: rows of the
    ground, of the haze and of the sky; directions (N, 4): sine and cosine of the elevation, and its places in the rows
    of the ground and of the sky; azimuth (N,); above (N,): part of each pixel that is over the horizon; sun,
    sun_azimuth: of the sun; near [au^-2]: one over the square of its distance; first, end: range of directions.
    """
    n_ground, n_haze, n_sky = sizes
    wy, wx = np.empty(4), np.empty(4)
    rows, columns = np.empty(4, np.int64), np.empty(4, np.int64)
    seen = np.empty((1, LANES), np.float32)
    n_columns, n_angles, power = table.shape[1], phase.shape[0], 1.0 / sky_tables.AZIMUTH_POWER
    sun_up, sun_aside = math.sin(sun), math.cos(sun)
    for p in range(first, end):
        a = abs((azimuth[p] - sun_azimuth + math.pi) % (2.0 * math.pi) - math.pi)
        x = (a / math.pi) ** power * (n_columns - 1)
        cosine = directions[p, 0] * sun_up + directions[p, 1] * sun_aside * math.cos(a)
        place = math.sqrt(math.acos(min(1.0, max(-1.0, cosine))) / math.pi) * (n_angles - 1)
        q = min(int(place), n_angles - 2)
        f = np.float32(place - q)
        for c in range(CHANNELS):
            out[p, c] = 0.0
        for side in range(2):
            fraction = above[p] if side == 1 else 1.0 - above[p]
            if fraction <= 0.0:
                continue
            fraction *= near
            y = directions[p, 2 + side]
            _place(n_columns, n_ground, n_haze, n_sky, side == 1, y, x, rows, columns, wy, wx)
            value = _read(table, rows, columns, wy, wx)
            value += (ONE - f) * load(phase, q) + f * load(phase, q + 1)
            store(seen, 0, exp(value))
            for c in range(CHANNELS):
                out[p, c] += fraction * (seen[0, c] + seen[0, CHANNELS + c])


@dataclass
class Painter:
    """Draws a fixed set of directions under any sun.

    tables: of one altitude, under suns_deg.  elevation_deg, azimuth_deg (H, W): azimuth from north, or from whatever
    the sun's azimuth is counted from; NaN is outside the picture.
    """

    tables: ViewerTables
    sizes: ViewerTableSizes
    suns_deg: np.ndarray
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray

    def __post_init__(self) -> None:
        self.outside = ~np.isfinite(self.elevation_deg)
        elevation = np.nan_to_num(self.elevation_deg)
        self._azimuth = np.radians(np.nan_to_num(self.azimuth_deg)).ravel()
        horizon = float(self.tables.horizon_deg[0])
        tall = np.abs(np.gradient(elevation, axis=0)) + np.abs(np.gradient(elevation, axis=1))
        self._above = np.clip((elevation - horizon) / np.maximum(tall, 1e-9) + 0.5, 0.0, 1.0).ravel()
        self._directions = self._placed(np.radians(elevation).ravel())
        self._table = np.full((*self.tables.sky[:, 0].transpose(1, 2, 3, 0).shape[:-1], LANES), NO_LIGHT, np.float32)
        self._table[..., :CHANNELS] = np.log(self.tables.sky[:, 0]).transpose(1, 2, 3, 0)
        self._phase = np.zeros((PHASE_ANGLES, LANES), np.float32)
        if self.tables.aureole is not None and self.tables.phase is not None:
            self._table[..., CHANNELS:] = np.log(self.tables.aureole[:, 0]).transpose(1, 2, 3, 0)
            self._phase[:, CHANNELS:] = np.log(self.tables.phase)

    def _placed(self, elevation: np.ndarray) -> np.ndarray:
        """`directions` of `_draw` for elevations (N,) [rad]."""
        horizon, haze = math.radians(float(self.tables.horizon_deg[0])), math.radians(float(self.tables.haze_deg[0]))
        zenith, n = 0.5 * np.pi, self.sizes
        below = np.clip((horizon - elevation) / (zenith + horizon), 0.0, 1.0)
        in_haze = np.clip((elevation - horizon) / max(haze - horizon, 1e-9), 0.0, 1.0)
        over_haze = np.clip((elevation - haze) / (zenith - haze), 0.0, 1.0)
        above = np.where(
            elevation < haze,
            2.0 / np.pi * np.arcsin(np.sqrt(in_haze)) * n.haze,
            n.haze + np.sqrt(over_haze) * (n.sky - 1),
        )
        ground = (1.0 - np.sqrt(below)) * (n.ground - 1)
        return np.stack([np.sin(elevation), np.cos(elevation), ground, above], axis=-1)

    def light(self, sun_elevation_deg: float, sun_azimuth_deg: float = 0.0, distance_au: float = 1.0) -> np.ndarray:
        """X, Y, Z and scotopic luminance [cd m^-2], (H, W, 4), without the sun's disc; 0 outside the picture."""
        table = np.ascontiguousarray(self._under(self._table, sun_elevation_deg))
        out = np.empty((self._azimuth.size, CHANNELS))
        towards = math.radians(sun_elevation_deg), math.radians(sun_azimuth_deg)
        sizes = self.sizes.ground, self.sizes.haze, self.sizes.sky
        about = self._phase, sizes, self._directions, self._azimuth
        in_slices(
            lambda i, j: _draw(table, *about, self._above, *towards, 1.0 / distance_au**2, out, i, j),
            self._azimuth.size,
        )
        out = out.reshape(*self.elevation_deg.shape, CHANNELS)
        out[self.outside] = 0.0
        return out

    def _under(self, table: np.ndarray, sun_elevation_deg: float) -> np.ndarray:
        """The table under one sun: cubic between four of its suns, a straight line beyond the ends."""
        places = np.arcsinh((self.suns_deg - sky_tables.SUN_CENTRE_DEG) / sky_tables.SUN_WIDTH_DEG)
        t = math.asinh((sun_elevation_deg - sky_tables.SUN_CENTRE_DEG) / sky_tables.SUN_WIDTH_DEG)
        n = places.size
        x = (t - places[0]) / (places[1] - places[0])
        i = min(max(math.floor(x), 0), n - 2)
        near = np.empty(4)
        _weights(x - i, near)
        weights = np.zeros(n)
        for k, value in enumerate(near):
            j = i + k - 1
            inner = min(max(j, 0), n - 1)
            weights[inner] += value if inner == j else 2.0 * value
            if inner != j:
                weights[inner + (1 if j < 0 else -1)] -= value
        used = np.nonzero(weights)[0]
        return np.tensordot(weights[used], table[used], axes=1).astype(np.float32)


def suns_between(low_deg: float, high_deg: float, sizes: ViewerTableSizes) -> np.ndarray:
    """The suns of the tables that a film from one elevation to another needs, two on each side where there are."""
    nodes = sky_tables.sun_nodes(sizes.suns)
    first = max(0, int(np.searchsorted(nodes, low_deg, "right")) - 2)
    last = min(nodes.size, int(np.searchsorted(nodes, high_deg)) + 2)
    return nodes[first:last]
