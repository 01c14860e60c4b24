"""Haber sections 4.5.3 to 4.6.2, eq. (1), (2) and (5), and section 5: light goes from every cell to every other.

Of the power P that a source cell scatters a target cell extinguishes
    P (tau_front - tau_back) omega / 4 pi,   omega / 4 pi = 1/2 (1 - cos arctan(sqrt(A / pi) / distance)),
A = V / chord being the area of the target that the source sees, and tau the transmittance to the front and the back of
its chord; times sigma_s / sigma_e of the target (the caller's part) that is what it scatters.  A cell's own light is
extinguished as in a sphere of its volume, of which the paper says nothing.  In the second scattering event the part
that aerosol scattered goes out by Henyey and Greenstein's function, eq. (1); in later ones all goes out alike.

The paper's savings, all exact: the paths from one cell of a ring serve all its cells (ring reuse), a path serves its
mirror image in the source's own vertical plane, and power is that of the half of the cells on one side of the sun's
vertical.  Beyond the paper the way back is the same path.  Nothing of a pair is stored, and threads share one sum: the
rings are dealt into blocks, and of the pairs of blocks only disjoint ones are worked on at a time.

Haber section 5: only every n-th shell takes part in the passes; the others are interpolated.

The shells in between get their light by linear interpolation along radius; what is interpolated is the mean radiance
P / (4 pi sigma_s V), which does not jump with the size of the cells.  "The total amount of energy received by every
target cell has to be scaled by the ratio I_all / I_active", of what all cells and those of active shells send out.
"""

import math
from typing import NamedTuple

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.cells.grid import CellGrid, Layers, layer_of, path_depth


class ActiveShells(NamedTuple):
    """Which of G rings take part, and how the others follow.

    ring (A,): indices of those that do; inner, outer (G,): the two of them (indices into `ring`) between which each
    ring lies; part (G,): 0 at the inner one, 1 at the outer
    """

    ring: np.ndarray
    inner: np.ndarray
    outer: np.ndarray
    part: np.ndarray

    def spread(self, values: np.ndarray, rings: slice = slice(None)) -> np.ndarray:
        """From the active rings (A, ...) to all (G, ...), or to some of these."""
        part = self.part[rings].reshape(-1, *(1,) * (values.ndim - 1))
        return values[self.inner[rings]] * (1.0 - part) + values[self.outer[rings]] * part


def make_active_shells(grid: CellGrid, step: int) -> ActiveShells:
    """Every `step`-th shell of a grid, counted so that the outermost one takes part.

    Where a row of cells has no active cell on one side the other side serves; where it has none, the nearest row's.
    """
    ring = np.nonzero((grid.n_shells - 1 - grid.ring_shell) % step == 0)[0]
    rows, shells = grid.ring_row[ring], grid.ring_shell[ring]
    inner, outer = np.zeros(grid.n_rings, int), np.zeros(grid.n_rings, int)
    part = np.zeros(grid.n_rings)
    for row in np.unique(grid.ring_row):
        here = np.nonzero(np.abs(rows - row) == np.abs(rows - row).min())[0]
        here = here[np.argsort(shells[here], kind="stable")]
        followers = np.nonzero(grid.ring_row == row)[0]
        place = np.clip(grid.ring_shell[followers], shells[here[0]], shells[here[-1]])
        k = np.clip(np.searchsorted(shells[here], place, side="right") - 1, 0, max(here.size - 2, 0))
        following = np.minimum(k + 1, here.size - 1)
        inner[followers], outer[followers] = here[k], here[following]
        distance = np.maximum(shells[here[following]] - shells[here[k]], 1)
        part[followers] = (place - shells[here[k]]) / distance
    return ActiveShells(ring, inner, outer, part)


def energy_ratio(energy: np.ndarray, active: ActiveShells) -> np.ndarray:
    """I_all / I_active (W,) of the energy (G, W) that all cells of each ring send out."""
    among_active = energy[active.ring].sum(axis=0)
    return np.where(among_active > 0.0, energy.sum(axis=0) / np.where(among_active > 0.0, among_active, 1.0), 1.0)


BLOCKS = 32
"""Blocks of rings, twice the most threads of a pass; the order of all sums follows from them alone."""


class Rings(NamedTuple):
    """G rings of equal cells as arrays for kernels.

    radius, sin_elevation, cos_elevation, altitude (G,) [km]: of the cells' centres, seen by the observer; size (G, 3):
    edges of a cell along radius, elevation and azimuth [km]; volume (G,) [km^3]; layer (G,): that holds the centre;
    observer_radius [km] from the Earth's centre; azimuth_cells: S
    """

    radius: np.ndarray
    sin_elevation: np.ndarray
    cos_elevation: np.ndarray
    altitude: np.ndarray
    size: np.ndarray
    volume: np.ndarray
    layer: np.ndarray
    observer_radius: float
    azimuth_cells: int


def make_rings(grid: CellGrid, layers: Layers, which: np.ndarray) -> Rings:
    """The rings `which` (indices) of a grid."""
    d = 2.0 * math.pi / grid.azimuth_cells
    shell = grid.ring_shell[which]
    r, e = grid.ring_radius_km[which], grid.ring_elevation[which]
    thickness = grid.shell_radius_km[shell + 1] - grid.shell_radius_km[shell]
    altitude = grid.ring_altitude_km[which]
    return Rings(
        r,
        np.sin(e),
        np.cos(e),
        altitude,
        np.stack([thickness, r * d, r * d * np.cos(e)], axis=1),
        grid.ring_volume_km3[which],
        layer_of(layers, altitude),
        grid.earth_radius_km + grid.observer_altitude_km,
        grid.azimuth_cells,
    )


def full_turn(azimuth_cells: int) -> np.ndarray:
    """Cells of a ring that each of the S/2 + 1 azimuths of one side stands for."""
    weight = np.full(azimuth_cells // 2 + 1, 2.0)
    weight[0] = weight[-1] = 1.0
    return weight


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


@njit(cache=True, makes_arrays=False)
def chord_of(rings, cell, azimuth, dx, dy, dz):
    """Length [km] of the chord along a unit vector (dx, dy, dz) through the middle of a cell, as a box on its own axes.

    rings: `Rings`; cell: its ring; azimuth [rad].
    """
    c, s = math.cos(azimuth), math.sin(azimuth)
    horizontal = dx * c + dy * s
    along_r = abs(horizontal * rings.cos_elevation[cell] + dz * rings.sin_elevation[cell])
    along_e = abs(dz * rings.cos_elevation[cell] - horizontal * rings.sin_elevation[cell])
    along_a = abs(dy * c - dx * s)
    chord = rings.size[cell, 0] / max(along_r, 1e-9)
    chord = min(chord, rings.size[cell, 1] / max(along_e, 1e-9))
    return min(chord, rings.size[cell, 2] / max(along_a, 1e-9))


@njit(cache=True, makes_arrays=False)
def sky_fraction(area, distance):
    """omega / 4 pi of a disc of an area [km^2] at a distance [km]."""
    x = area / (math.pi * distance * distance)
    root = math.sqrt(1.0 + x)
    return 0.5 * x / (root * (1.0 + root))


@njit(cache=True, makes_arrays=False)
def taken(depth, transmittance, half):
    """tau_front - tau_back of a cell: exp(-(depth - half)) - exp(-(depth + half)), the front no nearer than the source.

    depth: optical depth to its middle; transmittance: exp(-depth); half: optical depth from its front to its middle.
    """
    if depth < half:
        return -math.expm1(-2.0 * half)
    if half < 0.3:  # 2 sinh(half) to 2e-7: a quarter of the time was exp
        square = half * half
        return transmittance * 2.0 * half * (1.0 + square / 6.0 * (1.0 + square / 20.0))
    return transmittance * 2.0 * math.sinh(half)


@njit(cache=True, makes_arrays=False)
def pair_capture(layers, extinction, rings, pair, depth, there, back, way):
    """Fractions of isotropic light that a target cell takes of a source's, eq. (5), and the source of the target's.

    layers: `Layers`; extinction (N, W): which of its coefficients; rings: `Rings`; pair: rings of target and source,
    and the target's azimuth from the source's [rad], which is at 0; depth (W,): work space; there, back (W,), way (3,):
    filled, the latter with the unit vector from source to target.  False where the ground is in between, or the two
    are one.
    """
    target, source, turn = pair
    if target == source and turn == 0.0:
        t = (0.75 * rings.volume[source] / math.pi) ** (1.0 / 3.0)
        for w in range(there.size):
            there[w] = sphere_capture(extinction[rings.layer[source], w] * t)
            back[w] = there[w]
        way[:] = 0.0
        return False
    xs, zs = rings.radius[source] * rings.cos_elevation[source], rings.radius[source] * rings.sin_elevation[source]
    across = rings.radius[target] * rings.cos_elevation[target]
    dx, dy = across * math.cos(turn) - xs, across * math.sin(turn)
    dz = rings.radius[target] * rings.sin_elevation[target] - zs
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / distance, dy / distance, dz / distance
    way[0], way[1], way[2] = dx, dy, dz
    climb = xs * dx + (zs + rings.observer_radius) * dz
    altitude = rings.altitude[source]
    square = altitude * (2.0 * layers.earth_radius_km + altitude)
    first, last = rings.layer[source], rings.layer[target]
    if not path_depth(layers, extinction, first, last, square, climb, distance, depth):
        there[:] = 0.0
        back[:] = 0.0
        return False
    chord = chord_of(rings, target, turn, dx, dy, dz)
    fraction = sky_fraction(rings.volume[target] / chord, distance)
    for w in range(depth.size):
        back[w] = math.exp(-depth[w])
    for w in range(depth.size):
        there[w] = fraction * taken(depth[w], back[w], 0.5 * chord * extinction[last, w])
    chord = chord_of(rings, source, 0.0, dx, dy, dz)
    fraction = sky_fraction(rings.volume[source] / chord, distance)
    for w in range(depth.size):
        back[w] = fraction * taken(depth[w], back[w], 0.5 * chord * extinction[first, w])
    return True


@njit(cache=True, makes_arrays=False)
def unfold(capture, out):
    """capture (H, W) by turns of half a circle, into out (W, 3 H - 2): by turns from -S/2 to S, of all pairs."""
    half = capture.shape[0] - 1
    for w in range(out.shape[0]):
        for i in range(out.shape[1]):
            turn = abs(i - half)
            out[w, i] = capture[turn if turn <= half else 2 * half - turn, w]


@njit(cache=True, makes_arrays=False)
def add_alike(capture, power, out):
    """Add to out (W, H) what a ring takes of power (W, H) that leaves another ring isotropically.

    capture (W, 3 H - 2): of `unfold`; H azimuths of one side, the other side is its mirror image.
    """
    half = power.shape[1] - 1
    for w in range(power.shape[0]):
        for s in range(half + 1):
            sent = power[w, s]
            if sent == 0.0:
                continue
            if s == 0 or s == half:
                for u in range(half + 1):
                    out[w, u] += sent * capture[w, half + u - s]
            else:
                for u in range(half + 1):
                    out[w, u] += sent * (capture[w, half + u - s] + capture[w, half + u + s])


@njit(cache=True, makes_arrays=False)
def add_own(capture, power, out):
    """Add to out (W, H) the fractions capture (W,) of power (W, H) that cells take of their own."""
    for w in range(power.shape[0]):
        for s in range(power.shape[1]):
            out[w, s] += capture[w] * power[w, s]


@njit(cache=True, makes_arrays=False)
def add_forward(capture, ways, power, asymmetry, sun, cosine, sent, out):
    """The same of light that aerosol scattered once, which leaves by eq. (1).

    capture, power, out: as in `add_alike`; ways (H, 3): unit vectors from the source at azimuth 0 to the target at each
    turn; asymmetry (W,): g of the source; sun (3,): unit vector to it; cosine, sent (S,): work space.
    """
    half = power.shape[1] - 1
    n = 2 * half
    for s in range(half + 1):
        brightest = 0.0
        for w in range(power.shape[0]):
            brightest = max(brightest, power[w, s])
        if brightest == 0.0:
            continue
        c, t = math.cos(math.pi * s / half), math.sin(math.pi * s / half)
        for d in range(n):
            turn = d if d <= half else n - d
            y = ways[turn, 1] if d <= half else -ways[turn, 1]
            # light travels away from the sun
            cosine[d] = -((c * ways[turn, 0] - t * y) * sun[0] + ways[turn, 2] * sun[2])
        for w in range(power.shape[0]):
            g = np.float32(asymmetry[w])
            level = np.float32(1.0) - g * g
            for d in range(n):
                x = np.float32(1.0) + g * g - np.float32(2.0) * g * cosine[d]
                sent[d] = level / (x * math.sqrt(x))
            level = power[w, s]
            for d in range(n):
                sent[d] *= level * capture[w, half + d]
            # source s sends to azimuth s + d, and its mirror image -s to -(s + d)
            if s == 0:
                for u in range(half + 1):
                    out[w, u] += sent[u]
            elif s == half:
                out[w, half] += sent[0]
                for u in range(half):
                    out[w, u] += sent[half + u]
            else:
                for u in range(s, half + 1):
                    out[w, u] += sent[u - s]
                for u in range(half, n):
                    out[w, n - u] += sent[u - s]
                for u in range(s):
                    out[w, u] += sent[n - s + u]
                out[w, 0] += sent[n - s]


def rounds_of_blocks(n: int) -> list[np.ndarray]:
    """All pairs of n blocks (an even number), (P, 2) each: those of equal ones, then n - 1 rounds of a tournament.

    Within a round no block comes twice but with itself.
    """
    last = n - 1
    games = [[(r, last), *(((r + k) % last, (r - k) % last) for k in range(1, n // 2))] for r in range(last)]
    return [np.array([(b, b) for b in range(n)]), *map(np.array, games)]


@njit(cache=True, nogil=True)
def _exchange(layers, rings, power, forward, sun, out, pairs, begin, end):
    """`exchange` for the pairs begin..end of blocks, added to out (G, W, H); ring i is in block i modulo BLOCKS.

    layers, rings, power, forward, sun: as there; pairs (P, 2): of `rounds_of_blocks`.
    """
    extinction, asymmetry = layers.later_extinction, layers.asymmetry
    n_rings, n_wavelengths, n_half = power.shape
    directed = forward.shape[0] > 0
    there, back = np.empty((n_half, n_wavelengths)), np.empty((n_half, n_wavelengths))
    ways, ways_back = np.empty((n_half, 3)), np.empty((n_half, 3))
    depth = np.empty(n_wavelengths)
    wide = np.empty((n_wavelengths, 3 * n_half - 2))
    cosine, sent = np.empty(2 * n_half - 2, np.float32), np.empty(2 * n_half - 2, np.float32)
    for i in range(begin, end):
        for a in range(pairs[i, 0], n_rings, BLOCKS):
            for b in range(pairs[i, 1], n_rings, BLOCKS):
                if pairs[i, 0] == pairs[i, 1] and b > a:
                    break
                target, source = max(a, b), min(a, b)
                for d in range(n_half):
                    turn = math.pi * d / (n_half - 1)
                    pair_capture(layers, extinction, rings, (target, source, turn), depth, there[d], back[d], ways[d])
                    # the way back, turned and mirrored so that it begins at azimuth 0 and ends at this turn
                    c, t = math.cos(turn), math.sin(turn)
                    ways_back[d, 0] = -(c * ways[d, 0] + t * ways[d, 1])
                    ways_back[d, 1] = c * ways[d, 1] - t * ways[d, 0]
                    ways_back[d, 2] = -ways[d, 2]
                unfold(there, wide)
                add_alike(wide, power[source], out[target])
                if source == target:
                    if directed:
                        # of its own light a cell takes what leaves in the mean of all directions
                        add_own(there[0], forward[source], out[target])
                        there[0] = 0.0
                        unfold(there, wide)
                        g = asymmetry[rings.layer[source]]
                        add_forward(wide, ways, forward[source], g, sun, cosine, sent, out[target])
                    continue
                if directed:
                    g = asymmetry[rings.layer[source]]
                    add_forward(wide, ways, forward[source], g, sun, cosine, sent, out[target])
                unfold(back, wide)
                add_alike(wide, power[target], out[source])
                if directed:
                    g = asymmetry[rings.layer[target]]
                    add_forward(wide, ways_back, forward[target], g, sun, cosine, sent, out[source])


def exchange(
    layers: Layers, rings: Rings, power: np.ndarray, forward: np.ndarray | None = None, sun: np.ndarray | None = None
) -> np.ndarray:
    """Power (G, W, H) that cells extinguish of what all cells scatter: one scattering pass.

    power (G, W, H): scattered isotropically, of the H = S/2 + 1 azimuths from 0 to 180 deg; forward: scattered by
    aerosol once, which goes out by eq. (1) from the sun, unit vector (3,); extinction is that of later events.
    """
    out = np.zeros(power.shape)
    forward = np.zeros((0, *power.shape[1:])) if forward is None else forward
    sun = np.zeros(3) if sun is None else sun
    for pairs in rounds_of_blocks(BLOCKS):

        def work(begin: int, end: int, pairs: np.ndarray = pairs) -> None:
            _exchange(layers, rings, power, forward, sun, out, pairs, begin, end)

        in_slices(work, len(pairs))
    return out
