"""The ring operator: transfer between rings of equal cells depends on the azimuth difference only, so a Fourier
transform in azimuth turns it into one small matrix per mode.  The operator is made once per medium, for every sun."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.numerics.geometry import distance_to_sphere
from twilight.solvers.cells.grid import CellGrid
from twilight.solvers.cells.pairs import Rings, make_rings, pair_capture
from twilight.solvers.cells.settings import CellsSettings
from twilight.transport.chord import chord_depth
from twilight.transport.profile import Profile

N_HALF_TURN = 8
"""Azimuths of half a turn in which the exact energy balance of a cell follows rays."""


@njit(cache=True, nogil=True)
def ring_kernels(profile, rings, n_azimuth, transform, out, begin, end):
    """Azimuthal Fourier coefficients of the captured fraction, out (modes, W, target, source).

    profile: `Profile`; rings: `Rings`; n_azimuth: cells of a ring; transform (modes, S/2 + 1): of azimuths into modes;
    for the rows begin..end, each with its mirror image from the other end.
    """
    n_rings = rings.radius.size
    n_modes, n_half = transform.shape
    n_wavelengths = rings.extinction.shape[1]
    step = 2.0 * math.pi / n_azimuth
    # rows i and n - 1 - i together have as many pairs as any other two: threads get equal work
    for row in range(begin, end):
        depth = np.empty(n_wavelengths)
        forward = np.empty(n_wavelengths)
        back = np.empty(n_wavelengths)
        toward = np.empty(3)
        sum_forward = np.empty((n_modes, n_wavelengths))
        sum_back = np.empty((n_modes, n_wavelengths))
        for side in range(2):
            target = row if side == 0 else n_rings - 1 - row
            if side == 1 and target == row:
                continue
            for source in range(target + 1):
                sum_forward[:] = 0.0
                sum_back[:] = 0.0
                for d in range(n_half):
                    seen = pair_capture(profile, rings, target, source, d * step, 0.0, depth, forward, back, toward)
                    if not seen:
                        continue
                    for m in range(n_modes):
                        c = transform[m, d]
                        for w in range(n_wavelengths):
                            sum_forward[m, w] += c * forward[w]
                            sum_back[m, w] += c * back[w]
                for m in range(n_modes):
                    for w in range(n_wavelengths):
                        out[m, w, target, source] = sum_forward[m, w]
                        if source != target:
                            out[m, w, source, target] = sum_back[m, w]


@njit(cache=True, nogil=True)
def ground_kernels(profile, rings, patch_area, patch_position, n_azimuth, transform, to_ground, to_cells, begin, end):
    """Fractions of light that go from cells to patches of the ground, and from Lambertian patches to cells.

    to_ground (modes, W, patch, ring), to_cells (modes, W, ring, patch): filled; profile: `Profile`; rings: `Rings`;
    patch_area (N,) [km^2]; patch_position (N, 2) [km]: x and z from the centre of the Earth; n_azimuth: cells of a
    ring; transform (modes, half): of azimuths into modes; for the rings begin..end.
    """
    n_modes, n_half = transform.shape
    n_wavelengths = rings.extinction.shape[1]
    step = 2.0 * math.pi / n_azimuth
    for ring in range(begin, end):
        depth = np.empty(n_wavelengths)
        for patch in range(patch_area.size):
            xg, zg = patch_position[patch, 0], patch_position[patch, 1]
            rho_g = math.sqrt(xg * xg + zg * zg)
            for d in range(n_half):
                xc = rings.radius[ring] * rings.cos_elevation[ring] * math.cos(d * step)
                yc = rings.radius[ring] * rings.cos_elevation[ring] * math.sin(d * step)
                zc = rings.radius[ring] * rings.sin_elevation[ring] + rings.observer_radius
                dx, dy, dz = xc - xg, yc, zc - zg
                distance = math.sqrt(dx * dx + dy * dy + dz * dz)
                cosine = (dx * xg + dz * zg) / (distance * rho_g)
                if cosine <= 0.0:
                    continue
                chord_depth(profile, profile.altitude_km[0], cosine, distance, depth)
                size = (rings.volume[ring]) ** (1.0 / 3.0)
                x_ground = patch_area[patch] * cosine / (math.pi * distance * distance)
                x_cell = size * size / (math.pi * distance * distance)
                root = math.sqrt(1.0 + x_ground)
                ground_fraction = 0.5 * x_ground / (root * (1.0 + root))
                root = math.sqrt(1.0 + x_cell)
                cell_fraction = 4.0 * cosine * 0.5 * x_cell / (root * (1.0 + root))
                for w in range(n_wavelengths):
                    half = 0.5 * size * rings.extinction[ring, w]
                    arrive = ground_fraction * math.exp(-depth[w])
                    caught = cell_fraction * math.exp(-max(depth[w] - half, 0.0)) * -math.expm1(-2.0 * half)
                    for m in range(n_modes):
                        to_ground[m, w, patch, ring] += transform[m, d] * arrive
                        to_cells[m, w, ring, patch] += transform[m, d] * caught


@njit(cache=True, nogil=True)
def exact_fractions(profile, rings, cosine, cosine_weight, outer, captured, ground, begin, end):
    """Fractions of isotropic light that the air within `outer` [km] of the observer extinguishes and the ground gets.

    profile: `Profile`; rings: `Rings`, from the centres of whose cells the light goes out; cosine, cosine_weight (M,):
    of the zenith angle of rays there, each in N_HALF_TURN azimuths of half a turn; captured, ground (G, W) are added
    to; for the rings begin..end.
    """
    n_wavelengths = profile.extinction.shape[1]
    radius = profile.earth_radius_km
    bottom, top = profile.altitude_km[0], profile.altitude_km[profile.altitude_km.size - 1]
    depth = np.empty(n_wavelengths)
    for ring in range(begin, end):
        altitude = rings.altitude[ring]
        x = rings.radius[ring] * rings.cos_elevation[ring]
        z = rings.radius[ring] * rings.sin_elevation[ring] + rings.observer_radius
        rho = math.sqrt(x * x + z * z)
        for m in range(cosine.size):
            sine = math.sqrt(1.0 - cosine[m] * cosine[m])
            length = distance_to_sphere(altitude, cosine[m], bottom, radius) if cosine[m] < 0.0 else -1.0
            lands = length >= 0.0
            if not lands:
                length = distance_to_sphere(altitude, cosine[m], top, radius)
            for a in range(N_HALF_TURN):
                phi = math.pi * (a + 0.5) / N_HALF_TURN
                # directions around the point's own vertical
                ux, uz = x / rho, z / rho
                dx = cosine[m] * ux + sine * math.cos(phi) * uz
                dz = cosine[m] * uz - sine * math.cos(phi) * ux
                qz = z - rings.observer_radius
                b = x * dx + qz * dz
                c = x * x + qz * qz - outer * outer
                limit = -b + math.sqrt(max(b * b - c, 0.0))
                chord_depth(profile, altitude, cosine[m], min(length, limit), depth)
                weight = cosine_weight[m] / N_HALF_TURN
                for w in range(n_wavelengths):
                    t = math.exp(-depth[w])
                    captured[ring, w] += weight * (1.0 - t)
                    if lands and length <= limit:
                        ground[ring, w] += weight * t


@dataclass
class RingOperator:
    """Transfer between the active rings, by azimuthal Fourier mode.

    kernel (modes, W, G, G): power extinguished in ring t per power scattered by ring c, also by way of the ground
    ring (G,): index of the active rings in the grid; group (G, W): power of all cells that a ring stands for, over
    its own
    closure (G, W): the factors that closed the energy balance (1 = nothing to do)
    captured, to_ground (G, W): exact fractions of the light of each ring; the rest leaves the volume
    """

    rings: Rings
    ring: np.ndarray
    kernel: np.ndarray
    group: np.ndarray
    closure: np.ndarray
    captured: np.ndarray
    to_ground: np.ndarray

    def next_order(self, power: np.ndarray) -> np.ndarray:
        """Scattered power (modes, G, W) after one more scattering."""
        weighted = (power * self.group[None]).transpose(0, 2, 1)[..., None]
        caught = (self.kernel @ weighted.astype(np.float32))[..., 0].transpose(0, 2, 1)
        albedo = self.rings.scattering / np.maximum(self.rings.extinction, 1e-300)
        return caught * albedo[None]


def cosine_transform(n_azimuth: int, n_modes: int) -> np.ndarray:
    """(modes, S/2 + 1): sums an even function over all S azimuths against cos(m phi)."""
    d = np.arange(n_azimuth // 2 + 1)
    weight = np.full(d.size, 2.0)
    weight[0] = weight[-1] = 1.0
    return np.cos(2.0 * np.pi * np.outer(np.arange(n_modes), d) / n_azimuth) * weight


def active_rings(grid: CellGrid, step: int) -> np.ndarray:
    """Indices of the rings on every `step`-th shell, counted so that the outermost shell is active."""
    active = (grid.n_shells - 1 - grid.ring_shell) % step == 0
    return np.nonzero(active)[0]


def spread_matrix(grid: CellGrid, active: np.ndarray) -> np.ndarray:
    """(all rings, active rings): linear interpolation between the active shells inside and outside, on the same row.

    Where a row has no active cell on one side the other side serves; where it has none at all, the next row does.
    """
    out = np.zeros((grid.n_rings, active.size))
    rows = grid.ring_row[active]
    for ring in range(grid.n_rings):
        row = grid.ring_row[ring]
        candidates = np.nonzero(rows == row)[0]
        if candidates.size == 0:
            candidates = np.nonzero(np.abs(rows - row) == np.abs(rows - row).min())[0]
        shells = grid.ring_shell[active[candidates]]
        order = np.argsort(shells)
        candidates, shells = candidates[order], shells[order]
        place = float(np.clip(grid.ring_shell[ring], shells[0], shells[-1]))
        k = int(np.clip(np.searchsorted(shells, place, side="right") - 1, 0, max(shells.size - 2, 0)))
        if shells.size == 1:
            out[ring, candidates[0]] = 1.0
            continue
        f = (place - shells[k]) / (shells[k + 1] - shells[k])
        out[ring, candidates[k]] += 1.0 - f
        out[ring, candidates[k + 1]] += f
    return out


def ground_patches(grid: CellGrid, rings: Rings, ring_shell: np.ndarray, bottom_km: float):
    """Patches of the ground below the active shells: area of one azimuth cell (N,), position (x, z) (N, 2)."""
    observer, ground = rings.observer_radius, grid.earth_radius_km + bottom_km
    shells = np.unique(ring_shell)
    centre = 0.5 * (grid.shell_radius_km[shells] + grid.shell_radius_km[shells + 1])
    height = grid.observer_altitude_km - bottom_km
    inner = np.concatenate([[max(height, 0.0)], np.sqrt(centre[1:] * centre[:-1])])
    outer = np.concatenate([np.sqrt(centre[1:] * centre[:-1]), grid.shell_radius_km[-1:]])
    keep = outer > max(height, 0.0)
    inner, outer = np.maximum(inner[keep], height), outer[keep]

    def cap(r):  # area of the ground closer than r: 2 pi Rg^2 (1 - cos angle)
        return np.pi * (r * r - height * height) * ground / observer

    middle = np.sqrt(0.5 * (inner**2 + outer**2))
    sine = ((ground - observer) * (ground + observer) - middle**2) / (2.0 * observer * middle)
    position = np.stack([middle * np.sqrt(np.maximum(1.0 - sine**2, 0.0)), observer + middle * sine], axis=1)
    return (cap(outer) - cap(inner)) / grid.azimuth_cells, position


def make_operator(
    grid: CellGrid, profile: Profile, settings: CellsSettings, n_modes: int, ground_albedo: np.ndarray
) -> tuple[RingOperator, np.ndarray]:
    """The operator and the spread matrix (all rings, active rings)."""
    active = active_rings(grid, settings.active_shell_step)
    rings = make_rings(grid, profile, settings.subcells, active)
    n_wavelengths = profile.extinction.shape[1]
    transform = cosine_transform(grid.azimuth_cells, n_modes)
    kernel = np.zeros((n_modes, n_wavelengths, active.size, active.size), np.float32)
    in_slices(
        lambda begin, end: ring_kernels(profile, rings, grid.azimuth_cells, transform, kernel, begin, end),
        (active.size + 1) // 2,
    )
    spread = spread_matrix(grid, active)
    everyone = make_rings(grid, profile, settings.subcells, np.arange(grid.n_rings))
    amount = everyone.scattering * everyone.volume[:, None]
    own = np.maximum(rings.scattering * rings.volume[:, None], 1e-300)
    group = (spread.T @ amount) / own

    nodes, weights = np.polynomial.legendre.leggauss(8)
    cosine = np.concatenate([0.5 * (nodes - 1.0), 0.5 * (nodes + 1.0)])
    weights = 0.25 * np.concatenate([weights, weights])
    captured = np.zeros((active.size, n_wavelengths))
    to_ground = np.zeros_like(captured)
    outer = float(grid.shell_radius_km[-1])
    in_slices(
        lambda begin, end: exact_fractions(profile, rings, cosine, weights, outer, captured, to_ground, begin, end),
        active.size,
    )
    weight_target = (spread.T @ (everyone.extinction * everyone.volume[:, None])) / np.maximum(
        rings.extinction * rings.volume[:, None], 1e-300
    )
    found = np.einsum("wtc,tw->cw", kernel[0], weight_target)
    closure = np.where(found > 0, captured / np.maximum(found, 1e-300), 1.0)
    if settings.close_energy:
        kernel *= closure.T[None, :, None, :].astype(np.float32)
    if np.any(ground_albedo > 0):
        area, position = ground_patches(grid, rings, grid.ring_shell[active], float(profile.altitude_km[0]))
        down = np.zeros((n_modes, n_wavelengths, area.size, active.size))
        up = np.zeros((n_modes, n_wavelengths, active.size, area.size))
        in_slices(
            lambda begin, end: ground_kernels(
                profile, rings, area, position, grid.azimuth_cells, transform, down, up, begin, end
            ),
            active.size,
        )
        # each cell's light reaches the ground with the exact fraction
        total = down[0].sum(axis=1)
        down *= np.where(total > 0, to_ground.T / np.maximum(total, 1e-300), 0.0)[None, :, None, :]
        kernel += ((up * ground_albedo[None, :, None, None]) @ down).astype(np.float32)
    return RingOperator(rings, active, kernel, group, closure, captured, to_ground), spread
