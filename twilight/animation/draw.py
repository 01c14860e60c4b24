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
from twilight.studies.export import sky_tables
from twilight.studies.export.field_values import PHASE_ANGLES
from twilight.viewer.colours import CHANNELS
from twilight.viewer.tables import ViewerTables, ViewerTableSizes


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


@njit(cache=True, nogil=True, fastmath=True)
def _read(table, rows, columns, wy, wx):
    """The four channels of a table (rows, columns, 4) there; rows, columns, wy, wx: of `_place`."""
    a = b = c = d = 0.0
    for k in range(4):
        for m in range(4):
            w = wy[k] * wx[m]
            r, s = rows[k], columns[m]
            a += w * table[r, s, 0]
            b += w * table[r, s, 1]
            c += w * table[r, s, 2]
            d += w * table[r, s, 3]
    return a, b, c, d


@njit(cache=True, nogil=True)
def _draw(sky, aureole, phase, bounds, sizes, elevation, azimuth, above, sun, sun_azimuth, near, out, first, end):
    """Light out (N, 4) of directions first to end; angles in rad.

    sky (rows, columns, 4): logarithms over the tables' elevation and azimuth; aureole: the same of what the aerosol's
    phase function multiplies, or empty; phase (angles, 4): its logarithm; bounds: elevations of the horizon and of the
    top of the haze; sizes: rows of the ground, of the haze and of the sky; elevation, azimuth (N,); above (N,): part
    of each pixel that is over the horizon; sun, sun_azimuth: of the sun; near [au^-2]: one over the square of its
    distance; first, end: range of directions.
    """
    (horizon, haze), (n_ground, n_haze, n_sky) = bounds, sizes
    wy, wx = np.empty(4), np.empty(4)
    rows, columns = np.empty(4, np.int64), np.empty(4, np.int64)
    n_columns, n_angles, power = sky.shape[1], phase.shape[0], 1.0 / sky_tables.AZIMUTH_POWER
    for p in range(first, end):
        e = elevation[p]
        a = abs((azimuth[p] - sun_azimuth + math.pi) % (2.0 * math.pi) - math.pi)
        x = (a / math.pi) ** power * (n_columns - 1)
        cosine = math.sin(e) * math.sin(sun) + math.cos(e) * math.cos(sun) * math.cos(a)
        place = math.sqrt(math.acos(min(1.0, max(-1.0, cosine))) / math.pi) * (n_angles - 1)
        q = min(int(place), n_angles - 2)
        f = place - q
        for c in range(4):
            out[p, c] = 0.0
        for side in range(2):
            fraction = above[p] if side == 1 else 1.0 - above[p]
            if fraction <= 0.0:
                continue
            fraction *= near
            if side == 1:
                if e < haze:
                    y = 2.0 / math.pi * math.asin(math.sqrt(max(0.0, e - horizon) / max(haze - horizon, 1e-9))) * n_haze
                else:
                    y = n_haze + math.sqrt(min(1.0, (e - haze) / (0.5 * math.pi - haze))) * (n_sky - 1)
            else:
                y = (1.0 - math.sqrt(min(1.0, max(0.0, (horizon - e) / (0.5 * math.pi + horizon))))) * (n_ground - 1)
            _place(n_columns, n_ground, n_haze, n_sky, side == 1, y, x, rows, columns, wy, wx)
            value = _read(sky, rows, columns, wy, wx)
            out[p, 0] += fraction * math.exp(value[0])
            out[p, 1] += fraction * math.exp(value[1])
            out[p, 2] += fraction * math.exp(value[2])
            out[p, 3] += fraction * math.exp(value[3])
            if aureole.shape[0] > 0:
                value = _read(aureole, rows, columns, wy, wx)
                out[p, 0] += fraction * math.exp(value[0] + (1.0 - f) * phase[q, 0] + f * phase[q + 1, 0])
                out[p, 1] += fraction * math.exp(value[1] + (1.0 - f) * phase[q, 1] + f * phase[q + 1, 1])
                out[p, 2] += fraction * math.exp(value[2] + (1.0 - f) * phase[q, 2] + f * phase[q + 1, 2])
                out[p, 3] += fraction * math.exp(value[3] + (1.0 - f) * phase[q, 3] + f * phase[q + 1, 3])


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
        self._elevation, self._azimuth = (np.radians(v).ravel() for v in (elevation, np.nan_to_num(self.azimuth_deg)))
        horizon = float(self.tables.horizon_deg[0])
        tall = np.abs(np.gradient(elevation, axis=0)) + np.abs(np.gradient(elevation, axis=1))
        self._above = np.clip((elevation - horizon) / np.maximum(tall, 1e-9) + 0.5, 0.0, 1.0).ravel()
        self._bounds = math.radians(horizon), math.radians(float(self.tables.haze_deg[0]))
        self._sky = np.log(self.tables.sky[:, 0]).transpose(1, 2, 3, 0).astype(np.float32)
        self._aureole = np.zeros((0, 0, 0, CHANNELS), np.float32)
        self._phase = np.zeros((PHASE_ANGLES, CHANNELS))
        if self.tables.aureole is not None and self.tables.phase is not None:
            self._aureole = np.log(self.tables.aureole[:, 0]).transpose(1, 2, 3, 0).astype(np.float32)
            self._phase = np.log(self.tables.phase)

    def light(self, sun_elevation_deg: float, sun_azimuth_deg: float = 0.0, distance_au: float = 1.0) -> np.ndarray:
        """X, Y, Z and scotopic luminance [cd m^-2], (H, W, 4), without the sun's disc; 0 outside the picture."""
        sky = self._under(self._sky, sun_elevation_deg)
        aureole = np.zeros((0, 0, CHANNELS), np.float32)
        if self._aureole.size:
            aureole = self._under(self._aureole, sun_elevation_deg)
        out = np.empty((self._elevation.size, CHANNELS))
        towards = math.radians(sun_elevation_deg), math.radians(sun_azimuth_deg)
        sizes = self.sizes.ground, self.sizes.haze, self.sizes.sky
        about = self._phase, self._bounds, sizes, self._elevation, self._azimuth
        in_slices(
            lambda i, j: _draw(sky, aureole, *about, self._above, *towards, 1.0 / distance_au**2, out, i, j),
            self._elevation.size,
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
