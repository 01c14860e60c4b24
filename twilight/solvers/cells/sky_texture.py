"""Haber section 4.7: the sky texture, sums of cells along every direction of the grid, linear in between.

The radiance that reaches the observer from one cell of power I at distance r, which fills the solid angle dOmega, is
    (I_isotropic / 4 pi + I_aerosol p_HG) tau / (r^2 dOmega),
tau by eq. (4) from the cell's centre; it is summed over the shells.
"""

import math

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.cells.exchange import Rings
from twilight.solvers.cells.grid import CellGrid, Layers, layer_of, path_depth


@njit(cache=True)
def to_observer(layers, rings, altitude, layer, out):
    """Optical depth from the observer to each ring, out (G, W); infinite behind the ground.

    layers: `Layers`; rings: `Rings`; altitude [km], layer: of the observer.
    """
    square = altitude * (2.0 * layers.earth_radius_km + altitude)
    for g in range(rings.radius.size):
        climb = rings.observer_radius * rings.sin_elevation[g]
        if not path_depth(layers, layers.extinction, layer, rings.layer[g], square, climb, rings.radius[g], out[g]):
            out[g] = math.inf


class SkyTexture:
    """Radiance at the middles of the cells' rows and azimuths, and linear interpolation between them."""

    def __init__(self, grid: CellGrid, layers: Layers, rings: Rings):
        self.grid, self.layers, self.rings = grid, layers, rings
        depth = np.empty((grid.n_rings, layers.air.shape[1]))
        altitude = grid.observer_altitude_km
        to_observer(layers, rings, altitude, int(layer_of(layers, np.array(altitude))), depth)
        d = 2.0 * math.pi / grid.azimuth_cells
        bounds = -0.5 * math.pi + d * np.arange(grid.azimuth_cells // 2 + 1)
        solid_angle = d * np.diff(np.sin(bounds))
        self.elevation = 0.5 * (bounds[1:] + bounds[:-1])
        self.weight = np.exp(-depth) / (rings.radius**2 * solid_angle[grid.ring_row])[:, None]

    def radiance(self, isotropic: np.ndarray, aerosol: np.ndarray, sun: np.ndarray) -> np.ndarray:
        """Radiance over F0 [sr^-1] of all rows and azimuths of one side, (S/2, H, W), of powers (G, W, H)."""
        azimuth = np.pi * np.arange(isotropic.shape[2]) / (isotropic.shape[2] - 1)
        # from the cell to the observer, light that travelled away from the sun
        e = self.elevation[:, None]
        cosine = (np.cos(e) * np.cos(azimuth) * sun[0] + np.sin(e) * sun[2])[self.grid.ring_row]
        out = np.zeros((self.elevation.size, isotropic.shape[2], isotropic.shape[1]))
        for w in range(isotropic.shape[1]):
            g = self.layers.asymmetry[self.rings.layer, w, None]
            forward = (1.0 - g**2) / (1.0 + g**2 - 2.0 * g * cosine) ** 1.5
            light = (isotropic[:, w] + aerosol[:, w] * forward) / (4.0 * np.pi) * self.weight[:, w, None]
            np.add.at(out[:, :, w], self.grid.ring_row, light)
        return out

    def interpolate(self, texture: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """The texture (S/2, H, W) at directions (D,), (D, W).

        Across the zenith the row on the other side follows; beyond the last row above or below the horizon it is held.
        """
        step = 360.0 / self.grid.azimuth_cells
        n, first = self.elevation.size, self.elevation.size // 2
        place = (np.asarray(elevation_deg) + 90.0) / step - 0.5
        up = np.asarray(elevation_deg) >= 0.0
        place = np.clip(place, np.where(up, first, -0.5), np.where(up, n - 0.5, first - 1))
        row = np.floor(place).astype(int)
        across = np.abs((np.asarray(azimuth_deg) + 180.0) % 360.0 - 180.0) / step
        out = np.zeros((place.size, texture.shape[2]))
        half = texture.shape[1] - 1
        for side in (0, 1):
            r = row + side
            part = np.where(side, place - row, 1.0 - (place - row))
            over = (r >= n) | (r < 0)
            r = np.clip(np.where(r >= n, 2 * n - 1 - r, np.where(r < 0, -1 - r, r)), 0, n - 1)
            at = np.where(over, half - across, across)
            j = np.clip(np.floor(at).astype(int), 0, half - 1)
            f = (at - j)[:, None]
            out += part[:, None] * (texture[r, j] * (1.0 - f) + texture[r, j + 1] * f)
        return out
