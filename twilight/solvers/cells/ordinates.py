"""The exact mode: the radiance at every node in every direction, order by order, with phase functions.

Each order follows every ray of every node through the source function J (radiance per scattering coefficient),
    L_{n+1}(x, d) = int sigma_s J_n T ds + ground,     J_n(x, d) = sum_lm chi_l(x) Y_lm(d) int Y_lm L_n,
with J interpolated in its logarithm between nodes: in the shadow it falls by e in a fraction of a degree.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.cells.stencils import CellNodes, Mesh, QuadratureDirections, Stencils
from twilight.transport.beam import beam_at, beam_on_ground
from twilight.transport.lines import (
    ALTITUDE,
    DISTANCE,
    END_DISTANCE,
    GROUND,
    Line,
    new_line,
    trace_line,
    weight_by_species,
)

TINY = 1e-30
"""Least radiance over F0 [sr^-1] whose logarithm is taken."""


@dataclass(frozen=True)
class ScatteredLight:
    """All light scattered at least once, for one sun.

    moments (n_lm, P, A, W): of the radiance at the nodes; ground (P, A, W): radiance of the ground under each node
    orders: orders of scattering that were followed; residual: largest fraction by which the remainder may be wrong
    """

    moments: np.ndarray
    ground: np.ndarray
    orders: int
    residual: float


class Ray(NamedTuple):
    """One line from a node, in the frame that is turned to the node's azimuth, for kernels to fill.

    line: `Line` of K points; position (K, 3): unit vectors to them from the centre of the Earth; coefficient (K, 1 + K,
    W): fraction of each species in the light that they scatter; ground (3,): unit vector to where the line ends there.
    """

    line: Line
    position: np.ndarray
    coefficient: np.ndarray
    ground: np.ndarray


@njit(cache=True, nogil=True)
def once_scattered(profile, beam, phase, ground_albedo, places, cosine, n_azimuth, stride, sun, out, begin, end):
    """Light scattered once (air or ground) that reaches the nodes begin..end: out (D, P, A, W).

    A ray of direction cosine `m` and relative azimuth `a` is traced once and serves every azimuth of the node.
    Azimuths 0 to 180 deg are computed, the others mirrored.

    profile: `Profile`; beam: `Beam`; phase (D, 1 + K, W): of each species from the sun into each direction;
    ground_albedo (W,); places (P, 3) [km]: of the nodes at azimuth 0, x and z from the centre of the Earth and
    altitude; cosine (M,): of the directions' zenith angles, D = M n_azimuth/stride; n_azimuth: of the nodes; stride:
    node azimuths from one azimuth of directions to the next; sun (2,): sine and cosine of its elevation.
    """
    n_dir_azimuth = n_azimuth // stride
    n_species, n_wavelengths = phase.shape[1], phase.shape[2]
    line = new_line(profile)
    rows = line.place.shape[0]
    ray = Ray(line, np.empty((rows, 3)), np.empty((rows, n_species, n_wavelengths)), np.zeros(3))
    light = np.empty(n_wavelengths)
    for p in range(begin, end):
        for m in range(cosine.size):
            for a in range(n_azimuth // 2 + 1):
                points, lands = _follow(profile, places[p], cosine[m], 2.0 * math.pi * a / n_azimuth, ray)
                for side in range(2):
                    if side == 1 and (a == 0 or 2 * a == n_azimuth):
                        continue
                    relative = a if side == 0 else n_azimuth - a
                    sign = 1.0 if side == 0 else -1.0
                    for j in range((-relative) % stride, n_azimuth // 2 + 1, stride):
                        d = m * n_dir_azimuth + ((j + relative) % n_azimuth) // stride
                        angle = 2.0 * math.pi * j / n_azimuth
                        # the sun seen in the frame that is turned to the node's azimuth
                        to_sun = (sun[1] * math.cos(angle), -sign * sun[1] * math.sin(angle), sun[0])
                        row = out[d, p, j]
                        _sunlight(profile, beam, ray, points, lands, to_sun, phase[d], ground_albedo, light, row)


@njit(cache=True, nogil=True)
def _follow(profile, place, cosine, azimuth, ray):
    """Fill a `Ray` from a node; returns (number of its points, whether it ends on the ground).

    profile: `Profile`; place (3,) [km]: row of `places`; cosine: of the line's zenith angle in the observer's frame;
    azimuth [rad]; ray: `Ray`.
    """
    x, z, altitude = place[0], place[1], place[2]
    sine = math.sqrt(1.0 - cosine * cosine)
    dx, dy, dz = sine * math.cos(azimuth), sine * math.sin(azimuth), cosine
    mu = (x * dx + z * dz) / math.sqrt(x * x + z * z)
    line = ray.line
    points, status = trace_line(profile, altitude, mu, 1.0, np.bool_(False), line, math.inf)
    for k in range(points):
        _unit(x, z, dx, dy, dz, line.place[k, DISTANCE], ray.position[k])
        weight_by_species(profile, line.place[k, ALTITUDE], line.weight[k], ray.coefficient[k])
    if status == GROUND:
        _unit(x, z, dx, dy, dz, line.end[END_DISTANCE], ray.ground)
    return points, status == GROUND


@njit(cache=True, nogil=True)
def _sunlight(profile, beam, ray, points, lands, to_sun, phase, ground_albedo, light, out):
    """Light scattered once along a ray, by its points and by the ground where it lands, into out (W,).

    profile, beam, ground_albedo: as in `once_scattered`; ray: `Ray` with so many points; to_sun: its unit vector, a
    tuple; phase (1 + K, W): from the sun into the ray's direction; points, lands: of `_follow`; light (W,): work space.
    """
    x, y, z = to_sun
    for w in range(out.size):
        out[w] = 0.0
    for k in range(points):
        c_sun = ray.position[k, 0] * x + ray.position[k, 1] * y + ray.position[k, 2] * z
        beam_at(beam, ray.line.place[k, ALTITUDE], c_sun, light)
        for w in range(out.size):
            if light[w] > 0.0:
                source = 0.0
                for c in range(phase.shape[0]):
                    source += ray.coefficient[k, c, w] * phase[c, w]
                out[w] += light[w] * source
    if lands:
        c_sun = ray.ground[0] * x + ray.ground[1] * y + ray.ground[2] * z
        beam_on_ground(beam, profile.altitude_km[0], c_sun, light)
        for w in range(out.size):
            out[w] += ray.line.transmittance[w] * ground_albedo[w] / math.pi * light[w]


@njit(cache=True, inline="always")
def _unit(x, z, dx, dy, dz, s, out):
    """Unit vector into out (3,) from the centre of the Earth to the point s [km] along (dx, dy, dz) from (x, 0, z)."""
    px, py, pz = x + s * dx, s * dy, z + s * dz
    r = math.sqrt(px * px + py * py + pz * pz)
    out[0], out[1], out[2] = px / r, py / r, pz / r


@njit(cache=True)
def mirror(field, n_cos, n_dir_azimuth):
    """Fill azimuths beyond 180 deg: the field is its own mirror image about the sun's meridian.

    field (D, P, A, W): D directions, n_cos, n_dir_azimuth: of zenith angles and of azimuths.
    """
    n_azimuth = field.shape[2]
    for m in range(n_cos):
        for b in range(n_dir_azimuth):
            source = field[m * n_dir_azimuth + (n_dir_azimuth - b) % n_dir_azimuth]
            target = field[m * n_dir_azimuth + b]
            for p in range(field.shape[1]):
                for j in range(n_azimuth // 2 + 1, n_azimuth):
                    for w in range(field.shape[3]):
                        target[p, j, w] = source[p, n_azimuth - j, w]


@njit(inner=True, cache=True)
def gather(steps, first, last, log_source, azimuth_cell, sign, out):
    """Add the source along one ray to out (W,).

    steps: `Steps`; first, last: the ray's first entry and the one after its last; log_source (P, A, W): logarithm of
    what points scatter; azimuth_cell: azimuth index of the node, which may be fractional; sign: 1, or -1 for the ray's
    mirror image.
    """
    corner, corner_weight, azimuth, weight = steps
    n_azimuth, n_wavelengths = log_source.shape[1], out.size
    per_cell = n_azimuth / (2.0 * math.pi)
    one = np.float32(1.0)
    for e in range(first, last):
        place = azimuth_cell + sign * azimuth[e] * per_cell
        base = math.floor(place)
        f = np.float32(place - base)
        j0 = int(base) % n_azimuth
        j1 = (j0 + 1) % n_azimuth
        inner, outer = corner[e, 0], corner[e, 2]
        w0, w1, w2, w3 = corner_weight[e, 0], corner_weight[e, 1], corner_weight[e, 2], corner_weight[e, 3]
        g = one - f
        for w in range(n_wavelengths):
            exponent = g * (
                w0 * log_source[inner, j0, w]
                + w1 * log_source[inner + 1, j0, w]
                + w2 * log_source[outer, j0, w]
                + w3 * log_source[outer + 1, j0, w]
            ) + f * (
                w0 * log_source[inner, j1, w]
                + w1 * log_source[inner + 1, j1, w]
                + w2 * log_source[outer, j1, w]
                + w3 * log_source[outer + 1, j1, w]
            )
            out[w] += weight[e, w] * math.exp(exponent)


@njit(cache=True, nogil=True)
def scatter_once_more(stencils, log_source, log_ground, n_cos, out, begin, end):
    """One more scattering: radiance at the nodes, out (D, P, A, W), for the directions begin..end.

    stencils: `Stencils`; log_source (D, P, A, W): logarithm of what the order before scatters; log_ground (P, A, W):
    of the ground's radiance; n_cos: zenith angles of the directions.
    """
    n_directions, n_points, n_azimuth, n_wavelengths = log_source.shape
    n_dir_azimuth = n_directions // n_cos
    n_relative = n_azimuth // 2 + 1
    stride = n_azimuth // n_dir_azimuth
    first, steps, ground = stencils.first, stencils.steps, stencils.ground
    for d in range(begin, end):
        m = d // n_dir_azimuth
        b = d % n_dir_azimuth
        total = np.empty(n_wavelengths, np.float32)
        for p in range(n_points):
            for j in range(n_azimuth // 2 + 1):
                a = (b * stride - j) % n_azimuth
                sign = 1.0
                if 2 * a > n_azimuth:
                    a = n_azimuth - a
                    sign = -1.0
                ray = (p * n_cos + m) * n_relative + a
                for w in range(n_wavelengths):
                    total[w] = np.float32(0.0)
                gather(steps, first[ray], first[ray + 1], log_source[d], float(j), sign, total)
                # the air may hide the ground at some wavelengths only
                if np.max(ground.weight[ray]) > 0.0:
                    gather(ground, ray, ray + 1, log_ground, float(j), sign, total)
                for w in range(n_wavelengths):
                    out[d, p, j, w] = total[w]


class Ordinates:
    """What the exact mode prepares once per medium and observer: stencils, harmonics and mixed phase moments."""

    def __init__(
        self,
        stencils: Stencils,
        mesh: Mesh,
        nodes: CellNodes,
        directions: QuadratureDirections,
        chi: np.ndarray,
        ground_albedo: np.ndarray,
        n_azimuth: int,
    ):
        """chi (L, P, W): Legendre moments of the mixture of species at the nodes; ground_albedo (W,); n_azimuth: A."""
        self.stencils, self.mesh, self.nodes, self.directions = stencils, mesh, nodes, directions
        self.chi = chi[directions.degree_of]  # (n_lm, P, W)
        self.ground_albedo = ground_albedo
        self.n_azimuth = n_azimuth
        n_dir_azimuth = directions.azimuth.size
        weight = np.repeat(directions.weight, n_dir_azimuth)
        self.synthesis = directions.harmonics.astype(np.float32)
        # least squares with these weights: exact for every field that the harmonics span
        weighted = (directions.harmonics * weight[:, None]).T
        self.analysis = np.linalg.solve(weighted @ directions.harmonics, weighted).astype(np.float32)
        # cosine of each direction with the local vertical of each point and azimuth, for the flux on the ground
        lowest = mesh.shell_start[:-1]
        rho = np.hypot(nodes.x_km[lowest], nodes.z_km[lowest])
        tilt_x, tilt_z = nodes.x_km[lowest] / rho, nodes.z_km[lowest] / rho
        mu = np.repeat(directions.cosine, n_dir_azimuth)
        phi = np.tile(directions.azimuth, directions.cosine.size)
        node_phi = 2.0 * np.pi * np.arange(n_azimuth) / n_azimuth
        cosine = (
            np.sqrt(1 - mu**2)[:, None, None] * np.cos(phi[:, None, None] - node_phi) * tilt_x[None, :, None]
            + mu[:, None, None] * tilt_z[None, :, None]
        )
        self.lowest = lowest
        flux_weight = np.maximum(cosine, 0.0) * weight[:, None, None]
        # a Lambertian dome gives exactly pi
        self.flux_weight = (flux_weight * (np.pi / flux_weight.sum(axis=0))).astype(np.float32)

    def analyse(self, radiance: np.ndarray) -> np.ndarray:
        """Moments (n_lm, P, A, W) of radiance (D, P, A, W)."""
        shape = radiance.shape
        return (self.analysis @ radiance.reshape(shape[0], -1)).reshape(-1, *shape[1:])

    def source(self, moments: np.ndarray) -> np.ndarray:
        """log J at the nodes in every direction."""
        scaled = moments * self.chi[:, :, None, :].astype(np.float32)
        j = self.synthesis @ scaled.reshape(scaled.shape[0], -1)
        return np.log(np.maximum(j, TINY, out=j), out=j).reshape(-1, *moments.shape[1:])

    def ground_radiance(self, radiance: np.ndarray) -> np.ndarray:
        """Radiance (P, A, W) that the Lambertian ground sends back, taken at each shell's lowest point."""
        out = np.zeros(radiance.shape[1:], np.float32)
        flux = np.einsum("dpa,dpaw->paw", self.flux_weight, radiance[:, self.lowest])
        out[self.lowest] = flux * (self.ground_albedo / np.pi).astype(np.float32)
        return out

    def _pass(self, log_source: np.ndarray, log_ground: np.ndarray, out: np.ndarray) -> None:
        """The light `out` (D, P, A, W) of one more scattering."""
        n_cos = self.directions.cosine.size
        in_slices(
            lambda begin, end: scatter_once_more(self.stencils, log_source, log_ground, n_cos, out, begin, end),
            out.shape[0],
        )
        mirror(out, n_cos, self.directions.azimuth.size)

    def solve(
        self, radiance: np.ndarray, max_orders: int, tolerance: float, progress: Callable[[int, float], None]
    ) -> ScatteredLight:
        """Sum of all orders from the light scattered once, radiance (D, P, A, W); progress(orders, residual)."""
        moments = self.analyse(radiance)
        ground = self.ground_radiance(radiance)
        total, total_ground = moments.copy(), ground.copy()
        residual, orders = 1.0, 1
        ratio = previous_ratio = None
        while orders + 1 < max_orders:  # the last order is the one scattered on the line of sight
            out = np.empty_like(radiance)
            self._pass(self.source(moments), np.log(np.maximum(ground, TINY)), out)
            radiance = out
            before = moments[0]
            moments = self.analyse(radiance)
            ground = self.ground_radiance(radiance)
            total += moments
            total_ground += ground
            orders += 1
            previous_ratio, ratio = ratio, np.clip(moments[0] / np.maximum(before, TINY), 0.0, 0.95)
            fraction = moments[0] / np.maximum(total[0], TINY)
            residual = float(fraction.max())
            if previous_ratio is not None:
                # what the geometric remainder may be wrong by
                residual = float((fraction * np.abs(ratio - previous_ratio) / (1.0 - ratio) ** 2).max())
            progress(orders, residual)
            if tolerance > 0.0 and residual < tolerance:
                # what is left behaves like a geometric series at every node
                total += moments * (ratio / (1.0 - ratio))[None]
                total_ground += ground * (ratio / (1.0 - ratio))
                break
        return ScatteredLight(total, total_ground, orders + 1, residual)
