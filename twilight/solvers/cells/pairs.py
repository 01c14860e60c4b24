"""Transfer of scattered light from cell to cell (Haber section 4.6 and 5): the kernel, and his loop over all pairs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.cells.grid import CellGrid
from twilight.transport.chord import chord_depth
from twilight.transport.profile import Profile


class Rings(NamedTuple):
    """Rings of cells as arrays for kernels; G rings, W wavelengths.

    radius, sin_elevation, cos_elevation, altitude (G,); size (G, 3): edges of a cell along radius, elevation, azimuth
        [km]
    volume (G,); extinction, scattering (G, W): mean over the cell [km^-1]
    """

    radius: np.ndarray
    sin_elevation: np.ndarray
    cos_elevation: np.ndarray
    altitude: np.ndarray
    size: np.ndarray
    volume: np.ndarray
    extinction: np.ndarray
    scattering: np.ndarray
    observer_radius: float


def make_rings(grid: CellGrid, profile: Profile, subcells: int, which: np.ndarray) -> Rings:
    """The rings `which` (indices) with coefficients averaged over subcells^2 points in radius and elevation."""
    d = 2.0 * math.pi / grid.azimuth_cells
    low = grid.shell_radius_km[grid.ring_shell[which]]
    high = grid.shell_radius_km[grid.ring_shell[which] + 1]
    r, e = grid.ring_radius_km[which], grid.ring_elevation[which]
    observer = grid.earth_radius_km + grid.observer_altitude_km
    extinction = np.zeros((which.size, profile.extinction.shape[1]))
    scattering = np.zeros_like(extinction)
    total = np.zeros(which.size)
    offsets = (np.arange(subcells) + 0.5) / subcells
    for a in offsets:
        for b in offsets:
            rs = low + a * (high - low) if subcells > 1 else r
            es = e + (b - 0.5) * d
            step = rs * (rs + 2.0 * observer * np.sin(es))
            z = grid.observer_altitude_km + step / (np.sqrt(observer**2 + step) + observer)
            weight = rs**2 * np.cos(es)
            inside = (z >= profile.altitude_km[0]) & (z <= profile.altitude_km[-1])
            for w in range(extinction.shape[1]):
                extinction[:, w] += weight * inside * np.interp(z, profile.altitude_km, profile.extinction[:, w])
                scattering[:, w] += weight * inside * np.interp(z, profile.altitude_km, profile.scattering[:, w])
            total += weight
    size = np.stack([high - low, r * d, r * d * np.cos(e)], axis=1)
    return Rings(
        r,
        np.sin(e),
        np.cos(e),
        grid.ring_altitude_km[which],
        size,
        grid.ring_volume_km3[which],
        extinction / total[:, None],
        scattering / total[:, None],
        observer,
    )


@njit(cache=True)
def sphere_capture(optical_radius):
    """Fraction of isotropic light born evenly in a sphere that the sphere itself extinguishes (1 - escape probability).

    1 - 3/(8 t^3) (2 t^2 - 1 + (1 + 2 t) exp(-2 t)) (Case, de Hoffmann & Placzek 1953); a series where this cancels.
    optical_radius: t.
    """
    t = optical_radius
    if t < 0.02:
        return t * (0.75 - t * (0.4 - t / 6.0))
    return 1.0 - 3.0 / (8.0 * t * t * t) * (2.0 * t * t - 1.0 + (1.0 + 2.0 * t) * math.exp(-2.0 * t))


@njit(cache=True)
def pair_capture(profile, rings, target, source, azimuth_target, azimuth_source, depth, out_target, out_source, toward):
    """Fraction of the light that leaves cell `source` isotropically and is extinguished in `target` (Haber eq. 5).

    out_target = fraction of the solid angle that the target fills * (transmission to its front - transmission to its
    back).  The path is the same the other way: out_source is the fraction of the target's light that the source cell
    captures.

    profile: `Profile`; rings: `Rings`; target, source: indices of rings; azimuth_target, azimuth_source [rad]: of the
    cells; depth (W,): work space; out_target, out_source (W,): filled; toward (3,): filled, unit vector from source to
    target.  Returns False where the ground is between the two.
    """
    n_wavelengths = out_target.size
    if target == source and azimuth_target == azimuth_source:
        a = (0.75 * rings.volume[source] / math.pi) ** (1.0 / 3.0)
        for w in range(n_wavelengths):
            out_target[w] = sphere_capture(rings.extinction[source, w] * a)
            out_source[w] = out_target[w]
        toward[:] = 0.0
        return True
    xs = rings.radius[source] * rings.cos_elevation[source] * math.cos(azimuth_source)
    ys = rings.radius[source] * rings.cos_elevation[source] * math.sin(azimuth_source)
    zs = rings.radius[source] * rings.sin_elevation[source]
    dx = rings.radius[target] * rings.cos_elevation[target] * math.cos(azimuth_target) - xs
    dy = rings.radius[target] * rings.cos_elevation[target] * math.sin(azimuth_target) - ys
    dz = rings.radius[target] * rings.sin_elevation[target] - zs
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx /= distance
    dy /= distance
    dz /= distance
    toward[0] = dx
    toward[1] = dy
    toward[2] = dz
    zc = zs + rings.observer_radius
    mu = (xs * dx + ys * dy + zc * dz) / math.sqrt(xs * xs + ys * ys + zc * zc)
    if not chord_depth(profile, rings.altitude[source], mu, distance, depth):
        out_target[:] = 0.0
        out_source[:] = 0.0
        return False
    _capture_along(rings, target, azimuth_target, dx, dy, dz, distance, depth, out_target)
    _capture_along(rings, source, azimuth_source, dx, dy, dz, distance, depth, out_source)
    return True


@njit(inner=True, cache=True)
def _capture_along(rings, cell, azimuth, dx, dy, dz, distance, depth, out):
    """Fraction of light that a cell captures, out (W,), by the chord through its middle, as a box along its own axes.

    rings: `Rings`; cell: its ring; azimuth [rad]; (dx, dy, dz): unit vector of the light; distance [km] of its origin;
    depth (W,): optical depth between them.
    """
    c, s = math.cos(azimuth), math.sin(azimuth)
    horizontal = dx * c + dy * s
    along_r = abs(horizontal * rings.cos_elevation[cell] + dz * rings.sin_elevation[cell])
    along_e = abs(dz * rings.cos_elevation[cell] - horizontal * rings.sin_elevation[cell])
    along_a = abs(dy * c - dx * s)
    chord = rings.size[cell, 0] / max(along_r, 1e-9)
    chord = min(chord, rings.size[cell, 1] / max(along_e, 1e-9))
    chord = min(chord, rings.size[cell, 2] / max(along_a, 1e-9))
    area = rings.volume[cell] / chord
    x = area / (math.pi * distance * distance)
    root = math.sqrt(1.0 + x)
    solid_angle_fraction = 0.5 * x / (root * (1.0 + root))
    for w in range(out.size):
        half = 0.5 * chord * rings.extinction[cell, w]
        front = max(depth[w] - half, 0.0)
        out[w] = solid_angle_fraction * math.exp(-front) * -math.expm1(-2.0 * half)


@njit(cache=True)
def pair_pass(profile, rings, n_azimuth, power, phase_table, sun, left_right, mirrored, ring_reuse, out):
    """One more scattering by Haber's loop over pairs of cells: extinguished power out[ring, azimuth, wavelength].

    power (species, ring, azimuth, W): scattered power that leaves each cell.  phase_table (species, N, W): 4 pi p on N
    nodes uniform in the cosine of the scattering angle, for light that comes straight from the sun; with N = 1 the
    light is isotropic.  left_right: sources on one side of the sun's meridian only.  mirrored: a path serves its mirror
    image.  ring_reuse: the paths of a ring's first cell serve all its cells.  Returns the number of paths traced.
    profile: `Profile`; rings: `Rings`; n_azimuth: cells of a ring; sun (3,): unit vector to it.
    """
    n_rings = rings.radius.size
    n_species, _, _, n_wavelengths = power.shape
    step = 2.0 * math.pi / n_azimuth
    half = n_azimuth // 2
    n_nodes = phase_table.shape[1]
    depth = np.empty(n_wavelengths)
    back = np.empty(n_wavelengths)
    toward = np.empty(3)
    kernel = np.empty((n_azimuth, n_wavelengths))
    vector = np.empty((n_azimuth, 3))
    paths = 0
    out[:] = 0.0
    for source in range(n_rings):
        for target in range(n_rings):
            for s in range(half + 1 if left_right else n_azimuth):
                if s == 0 or not ring_reuse:
                    first = 0.0 if ring_reuse else s * step
                    for d in range(half + 1 if mirrored else n_azimuth):
                        pair_capture(
                            profile, rings, target, source, first + d * step, first, depth, kernel[d], back, toward
                        )
                        paths += 1
                        c, t = math.cos(first), math.sin(first)
                        vector[d, 0] = c * toward[0] + t * toward[1]
                        vector[d, 1] = c * toward[1] - t * toward[0]
                        vector[d, 2] = toward[2]
                        if mirrored and 0 < d < n_azimuth - d:
                            kernel[n_azimuth - d] = kernel[d]
                            vector[n_azimuth - d, 0] = vector[d, 0]
                            vector[n_azimuth - d, 1] = -vector[d, 1]
                            vector[n_azimuth - d, 2] = vector[d, 2]
                c, t = math.cos(s * step), math.sin(s * step)
                for d in range(n_azimuth):
                    u = (s + d) % n_azimuth
                    if n_nodes > 1:
                        x = c * vector[d, 0] - t * vector[d, 1]
                        cosine = x * sun[0] + vector[d, 2] * sun[2]
                        # light travels away from the sun: the scattering angle is between -sun and the way to the
                        # target
                        place = 0.5 * (1.0 - cosine) * (n_nodes - 1)
                        i = min(int(place), n_nodes - 2)
                        f = place - i
                    else:
                        i, f = 0, 0.0
                    for w in range(n_wavelengths):
                        sent = 0.0
                        for k in range(n_species):
                            p = phase_table[k, i, w]
                            if n_nodes > 1:
                                p += f * (phase_table[k, i + 1, w] - p)
                            sent += power[k, source, s, w] * p
                        sent *= kernel[d, w]
                        out[target, u, w] += sent
                        if left_right and 0 < s < half:
                            out[target, (n_azimuth - u) % n_azimuth, w] += sent
    return paths
