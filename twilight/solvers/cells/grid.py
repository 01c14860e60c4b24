"""Haber sections 4.1.2 and 4.1.3: layers of the atmosphere, and cells around the observer; 4.6.1, eq. (3) and (4): the
optical depth of a straight path through the layers.

A layer has constant coefficients, those of the medium at its centre.  Of a medium that is cut into layers (the key
`layers` of a climate's `atmosphere`) each is one of these; a smooth medium is cut finely.  With a(h) = h (2 R + h), the
square of the distance from the Earth's centre less R^2, a path that is lowest at a_0 crosses altitude h at the distance
sqrt(a(h) - a_0) from its lowest point: eq. (4) is a sum of differences of such roots.

Cells are shells around the observer, cut into equal azimuths and elevations.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.jit.kernels import njit

LAYER_KM = 0.5
"""Thickness near the ground of the layers of a medium that is not cut into layers [km]."""
LAYER_CHANGE = 0.02
"""Error that linear interpolation over such a layer would have; its coefficients change by e^(0.4) at most."""


class Layers(NamedTuple):
    """N layers at W wavelengths.

    boundary_km (N + 1,): H_min of each layer and the top; square_km2 (N + 1,): a(h) of them
    air, aerosol (N, W): scattering coefficients [km^-1]; extinction (N, W), of all that is there
    later_scattering, later_extinction (N, W): those of the second scattering event and all that follow (eq. 2)
    asymmetry (N, W): g of the aerosol; refractivity (N, W): n - 1
    """

    boundary_km: np.ndarray
    square_km2: np.ndarray
    air: np.ndarray
    aerosol: np.ndarray
    extinction: np.ndarray
    later_scattering: np.ndarray
    later_extinction: np.ndarray
    asymmetry: np.ndarray
    refractivity: np.ndarray
    earth_radius_km: float


def make_layers(medium: Medium, reduce_extinction: bool) -> Layers:
    """The layers of a medium.

    reduce_extinction: eq. (2) takes g of the aerosol's scattering from its extinction too; otherwise from scattering
    alone, as the paper has it, and that part of the light is lost.
    """
    cut = 2 * np.unique(medium.altitude_km).size - 2 == medium.altitude_km.size  # every inner level is two
    edges = np.unique((medium if cut else medium.refined(LAYER_KM, LAYER_CHANGE)).altitude_km)
    at = medium.at(0.5 * (edges[1:] + edges[:-1]))
    g = np.zeros_like(at.air_scattering)
    for phase, fraction in zip(medium.phase_functions, at.aerosol_phase_fraction, strict=True):
        g += fraction * phase.legendre_moments(1)[:, 1]
    g = np.clip(g, -0.999, 0.999)
    scattering = at.aerosol_scattering
    lost = g * scattering if reduce_extinction else 0.0
    return Layers(
        edges,
        edges * (2.0 * medium.earth_radius_km + edges),
        np.ascontiguousarray(at.air_scattering),
        np.ascontiguousarray(scattering),
        np.ascontiguousarray(at.extinction),
        at.air_scattering + (1.0 - g) * scattering,
        at.extinction - lost,
        g,
        np.ascontiguousarray(at.refractivity),
        medium.earth_radius_km,
    )


def layer_of(layers: Layers, altitude_km: np.ndarray) -> np.ndarray:
    """Index of the layer that holds each altitude."""
    inside = np.searchsorted(layers.boundary_km, altitude_km, side="right") - 1
    return np.clip(inside, 0, layers.boundary_km.size - 2)


@njit(cache=True, makes_arrays=False)
def add_climb(square, extinction, layer, lowest, near, far, out):
    """Add the optical depth (W,) of a path that climbs from `near` to `far` [km] from its lowest point to out.

    square (N + 1,): of `Layers`; extinction (N, W); layer: index where the climb begins; lowest [km^2]: a there; out
    (W,): added to.
    """
    k, at = layer, near
    while True:
        end = far
        if k + 1 < square.size - 1:
            end = min(far, math.sqrt(max(square[k + 1] - lowest, 0.0)))
        if end > at:
            for w in range(out.size):
                out[w] += extinction[k, w] * (end - at)
            at = end
        if at >= far or k + 1 >= square.size - 1:
            return
        k += 1


@njit(cache=True, makes_arrays=False)
def path_depth(layers, extinction, first, last, start_square, climb, length, out):
    """Optical depth out (W,) of a straight path, eq. (4); False, with out unset, where the ground is in between.

    layers: `Layers`; extinction (N, W): which of its coefficients; first, last: layers of both ends; start_square
    [km^2]: a(h) of the start; climb [km]: distance of the start from the path's lowest point, negative before it;
    length [km].
    """
    square = layers.square_km2
    end = climb + length
    lowest = start_square - climb * climb
    out[:] = 0.0
    if climb >= 0.0:
        add_climb(square, extinction, first, lowest, climb, end, out)
        return True
    if end <= 0.0:
        add_climb(square, extinction, last, lowest, -end, -climb, out)
        return True
    if lowest < square[0]:
        return False
    k = min(first, last)
    while k > 0 and square[k] > lowest:
        k -= 1
    add_climb(square, extinction, k, lowest, 0.0, -climb, out)
    add_climb(square, extinction, k, lowest, 0.0, end, out)
    return True


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

    @property
    def shells_without_cells(self) -> np.ndarray:
        """Indices of the shells that hold air, as all do, and the centre of no cell."""
        return np.setdiff1d(np.arange(self.n_shells), self.ring_shell)


def make_grid(
    azimuth_cells: int,
    inner_radius_km: float,
    observer_altitude_km: float,
    bottom_km: float,
    top_km: float,
    earth_radius_km: float,
    reach: float = 1.0,
) -> CellGrid:
    """All cells whose centre is above the ground and below the top, for an observer inside the air.

    reach: how far the shells go, over R_max.
    """
    outer = reach * outer_radius_km(top_km, observer_altitude_km, earth_radius_km)
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
