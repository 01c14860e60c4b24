"""Haber section 4.1.3, atmosphere cells: shells around the observer, cut into equal azimuths and elevations."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


def shell_radii(azimuth_cells: int, inner_radius_km: float, outer_radius_km: float) -> np.ndarray:
    """Radii of the shells' boundaries: r_j = R_min q^j with q = (1 + d/2)/(1 - d/2), d = 2 pi/S.

    A shell is as thick as its mean arc is long.  Their number is the whole number that ends nearest to `outer`: with
    R_min = 100 m and 669 km the paper's 101 at S = 72 and 252 at S = 180 (his printed 10 m gives others).  Where they
    end short of it (at 662 km with S = 120) the last one goes on to `outer`.
    """
    d = 2.0 * math.pi / azimuth_cells
    log_q = math.log((1.0 + d / 2.0) / (1.0 - d / 2.0))
    n = max(1, round(math.log(outer_radius_km / inner_radius_km) / log_q))
    radii = inner_radius_km * np.exp(log_q * np.arange(n + 1))
    radii[-1] = max(radii[-1], outer_radius_km)
    return radii


def outer_radius_km(top_km: float, observer_altitude_km: float, earth_radius_km: float) -> float:
    """R_max, where a horizontal line from the observer leaves the air: sqrt(H^2 + 2 R H) from the ground."""
    h = top_km - observer_altitude_km
    return math.sqrt(h * (h + 2.0 * (earth_radius_km + observer_altitude_km)))


@dataclass(frozen=True)
class CellGrid:
    """Cells grouped into rings: all cells of one shell and one elevation differ in their azimuth alone.

    shell_radius_km (J + 1,) boundaries; ring_shell, ring_row (G,): shell of a ring and its elevation row
    ring_radius_km, ring_elevation, ring_altitude_km (G,): centre of the ring's cells; elevation in radians
    ring_volume_km3 (G,): of one cell
    azimuth_cells S; cell k of a ring has its centre at azimuth 2 pi k/S, so that the sun's meridian is a symmetry plane
    """

    azimuth_cells: int
    shell_radius_km: np.ndarray
    ring_shell: np.ndarray
    ring_row: np.ndarray
    ring_radius_km: np.ndarray
    ring_elevation: np.ndarray
    ring_altitude_km: np.ndarray
    ring_volume_km3: np.ndarray
    observer_altitude_km: float
    earth_radius_km: float

    @property
    def n_rings(self) -> int:
        return self.ring_shell.size

    @property
    def n_shells(self) -> int:
        return self.shell_radius_km.size - 1


def make_grid(
    azimuth_cells: int,
    inner_radius_km: float,
    observer_altitude_km: float,
    bottom_km: float,
    top_km: float,
    earth_radius_km: float,
) -> CellGrid:
    """All cells whose centre is above the ground and below the top, for an observer inside the air."""
    outer = outer_radius_km(top_km, observer_altitude_km, earth_radius_km)
    edges = shell_radii(azimuth_cells, inner_radius_km, outer)
    d = 2.0 * math.pi / azimuth_cells
    rows = azimuth_cells // 2
    low = -0.5 * math.pi + d * np.arange(rows)
    elevation = low + 0.5 * d
    centre = 0.5 * (edges[1:] + edges[:-1])
    r, e = np.meshgrid(centre, elevation, indexing="ij")
    radius_observer = earth_radius_km + observer_altitude_km
    step = r * (r + 2.0 * radius_observer * np.sin(e))
    altitude = observer_altitude_km + step / (np.sqrt(radius_observer**2 + step) + radius_observer)
    shell, row = np.nonzero((altitude > bottom_km) & (altitude < top_km))
    cap = np.sin(low + d) - np.sin(low)
    volume = (edges[shell + 1] ** 3 - edges[shell] ** 3) / 3.0 * d * cap[row]
    return CellGrid(
        azimuth_cells,
        edges,
        shell,
        row,
        centre[shell],
        elevation[row],
        altitude[shell, row],
        volume,
        float(observer_altitude_km),
        float(earth_radius_km),
    )
