"""Haber section 4.1.4: isotropic ground.  He shows a dark one; here patches below the active shells reflect.

A patch of area A takes A cos / (4 pi d^2) of a cell's light (as sky_fraction bounds it near by) and sends what it
reflects by Lambert's law, 4 cos times as much as isotropic light.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.cells.direct_light import find_sun
from twilight.solvers.cells.exchange import add_alike, sky_fraction, unfold
from twilight.solvers.cells.grid import CellGrid, path_depth


class Patches(NamedTuple):
    """N rings of patches of the ground: area of one of S [km^2], distance [km] from the observer, and position x, z
    [km] (N, 2) of the one at azimuth 0, from the Earth's centre."""

    area: np.ndarray
    distance: np.ndarray
    position: np.ndarray


def make_patches(grid: CellGrid, active_shells: np.ndarray, bottom_km: float) -> Patches:
    """Patches whose borders lie between the active shells (indices)."""
    observer, ground = grid.earth_radius_km + grid.observer_altitude_km, grid.earth_radius_km + bottom_km
    centre = 0.5 * (grid.shell_radius_km[active_shells] + grid.shell_radius_km[active_shells + 1])
    height = max(grid.observer_altitude_km - bottom_km, 0.0)
    border = np.sqrt(centre[1:] * centre[:-1])
    inner, outer = np.concatenate([[height], border]), np.concatenate([border, grid.shell_radius_km[-1:]])
    inner, outer = np.maximum(inner, height), np.maximum(outer, height)
    inner, outer = inner[outer > inner], outer[outer > inner]
    # area of the ground closer than r: pi (r^2 - height^2) R_ground / R_observer
    area = np.pi * (outer**2 - inner**2) * ground / observer / grid.azimuth_cells
    middle = np.sqrt(0.5 * (inner**2 + outer**2))
    sine = ((ground - observer) * (ground + observer) - middle**2) / (2.0 * observer * middle)
    position = np.stack([middle * np.sqrt(np.maximum(1.0 - sine**2, 0.0)), observer + middle * sine], axis=1)
    return Patches(area, middle, position)


@njit(cache=True)
def sunlit_ground(layers, patches, sun, tolerance, out):
    """Sunlight over F0 [km^2] on each patch, out (N, W, H).

    layers: `Layers`; patches: `Patches`; sun (3,): unit vector to it; tolerance [rad]: of `find_sun`.
    """
    half = out.shape[2] - 1
    for n in range(out.shape[0]):
        x, z = patches.position[n]
        for j in range(half + 1):
            cosine = (x * math.cos(math.pi * j / half) * sun[0] + z * sun[2]) / math.hypot(x, z)
            for w in range(out.shape[1]):
                elevation = math.asin(max(-1.0, min(1.0, cosine)))
                lift, depth, _ = find_sun(layers, w, layers.boundary_km[0], 0, elevation, tolerance)
                lit = not math.isnan(lift) and elevation + lift > 0.0
                out[n, w, j] = patches.area[n] * math.sin(elevation + lift) * math.exp(-depth) if lit else 0.0


@njit(cache=True)
def exchange_with_ground(layers, rings, patches, from_cells, from_ground, to_cells, to_ground):
    """Add what cells extinguish of the ground's light to to_cells (G, W, H), and what reaches the ground to to_ground.

    layers: `Layers`; rings: `Rings`; patches: `Patches`; from_cells (G, W, H), from_ground (N, W, H): power sent;
    to_ground (N, W, H).
    """
    n_half, n_wavelengths = from_cells.shape[2], from_cells.shape[1]
    depth = np.empty(n_wavelengths)
    down, up = np.empty((n_half, n_wavelengths)), np.empty((n_half, n_wavelengths))
    wide = np.empty((n_wavelengths, 3 * n_half - 2))
    extinction = layers.later_extinction
    bottom = layers.square_km2[0]
    for ring in range(rings.radius.size):
        k = rings.layer[ring]
        size = rings.volume[ring] ** (1.0 / 3.0)
        across = rings.radius[ring] * rings.cos_elevation[ring]
        z = rings.radius[ring] * rings.sin_elevation[ring] + rings.observer_radius
        for n in range(patches.area.size):
            gx, gz = patches.position[n]
            for d in range(n_half):
                turn = math.pi * d / (n_half - 1)
                dx, dy, dz = across * math.cos(turn) - gx, across * math.sin(turn), z - gz
                distance = math.sqrt(dx * dx + dy * dy + dz * dz)
                climb = (dx * gx + dz * gz) / distance
                cosine = climb / math.hypot(gx, gz)
                down[d] = 0.0
                up[d] = 0.0
                if cosine <= 0.0:
                    continue
                path_depth(layers, extinction, 0, k, bottom, climb, distance, depth)
                at_ground = sky_fraction(patches.area[n] * cosine, distance)
                at_cell = min(1.0, 4.0 * cosine * sky_fraction(size * size, distance))
                for w in range(n_wavelengths):
                    inside = size * extinction[k, w]
                    down[d, w] = at_ground * math.exp(-depth[w])
                    up[d, w] = at_cell * math.exp(-max(depth[w] - 0.5 * inside, 0.0)) * -math.expm1(-inside)
            unfold(down, wide)
            add_alike(wide, from_cells[ring], to_ground[n])
            unfold(up, wide)
            add_alike(wide, from_ground[n], to_cells[ring])
