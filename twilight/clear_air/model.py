"""What corrects M_0: the file of the model, its nodes over suns and sky, and its networks."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from .shells import ABSORPTION, AIR, ALTITUDE_KM, EXTINCTION, HIGH, LOW, Air, single, summed

FORMAT = "twilight clear air 3"
NUMBER = 1
"""Of the model: file, closed forms and numerics together; whatever moves a pixel raises it."""
SUN_DEG = np.concatenate(
    [[-18, -16.5, -15, -13.5], np.arange(-12, 3), [3.5, 5, 7.5, 10, 15], np.arange(20.0, 91.0, 10.0)]
)
"""Elevations of the sun at which ln(M / M_0) is stored [deg]."""
ELEVATION_DEG = np.array([0, 1, 2.5, 5, 8, 12, 17, 23, 30, 38, 47, 57, 68, 79, 90.0])
AZIMUTH_DEG = np.array([0, 6, 12, 20, 30, 45, 60, 80, 100, 120, 140, 160, 180.0])
"""Nodes over the sky, from the sun [deg]."""
NODES = (SUN_DEG.size, ELEVATION_DEG.size, AZIMUTH_DEG.size)
BASE_ELEVATION_DEG = ELEVATION_DEG[[0, 3, 6, 10, 14]]
"""Elevations at which ln M_0 is an input of the networks [deg]."""
BASE_AZIMUTH_DEG = AZIMUTH_DEG[[0, 6, 12]]
"""Azimuths of these, from the sun [deg]."""
SLAB_KM = np.array([0, 0.25, 0.7, 1.35, 2, 3, 4.5, 6, 8, 10, 12, 15, 19, 24, 30, 39, 60, 100])
"""Boundaries of slabs whose optical depths are inputs of the networks [km]."""
COARSE_SLABS = (0, 4, 8, 11, 13, 15, 17)
"""Boundaries, by their places, between which scattering by air is an input."""
ABSORPTION_SLABS = (*range(0, 18, 2), 17)
"""Boundaries, by their places, between which absorption by aerosol is an input."""
MOMENTS = (1, 2, 3, 4, 6, 8, 12)
"""Degrees of the Legendre moments of phase functions that are inputs."""
ANGLES_DEG = (60.0, 90.0, 120.0, 150.0, 180.0)
"""Scattering angles at which logarithms of phase functions are inputs [deg]."""
MOST_CACHED = 200
"""Largest number of values at which splines are cached: rows and columns of a sky are the same under every sun."""
OUTERMOST = 5.0
"""Standard deviations from the mean at which inputs are cut off."""


def network_inputs(air: Air, observer_km: float) -> np.ndarray:
    """Inputs of the network that name the air, (W, F)."""
    d, f = air.depth, air.peaks(air.mixed_moments)
    absorbed = np.maximum(d[EXTINCTION] - d[LOW] - d[HIGH], 0.0)
    particles = (1.0 - f[0]) * d[LOW] + (1.0 - f[1]) * d[HIGH]
    total = d[AIR] + d[ABSORPTION] + d[EXTINCTION] - f[0] * d[LOW] - f[1] * d[HIGH]  # extinction without peaks
    every, n = tuple(range(SLAB_KM.size)), air.degree.size

    def slabs(depth: np.ndarray, some: tuple[int, ...]) -> np.ndarray:
        place = np.abs(ALTITUDE_KM[None] - SLAB_KM[list(some), None]).argmin(axis=1)
        return np.diff(summed(depth)[place], axis=0)

    def below(depth: np.ndarray) -> np.ndarray:
        k = int(np.clip(np.searchsorted(ALTITUDE_KM, observer_km) - 1, 0, ALTITUDE_KM.size - 2))
        part = (observer_km - ALTITUDE_KM[k]) / (ALTITUDE_KM[k + 1] - ALTITUDE_KM[k])
        return (summed(depth)[k] + part * depth[k])[None]

    sums = [d[AIR].sum(axis=0), total.sum(axis=0), d[ABSORPTION].sum(axis=0) + 1e-4, particles.sum(axis=0) + 1e-4]
    sums += [absorbed.sum(axis=0) + 1e-4, ((1.0 - f[1]) * d[HIGH]).sum(axis=0) + 1e-5]
    rows = [np.sqrt(np.maximum(slabs(particles, every), 0.0))]
    rows += [np.sqrt(np.maximum(slabs(absorbed, ABSORPTION_SLABS), 0.0))]
    rows += [np.sqrt(np.maximum(slabs(d[ABSORPTION], every), 0.0)), np.log(slabs(d[AIR], COARSE_SLABS))]
    rows.append(np.log(sums))
    for k, phase in enumerate(air.mixed_phase):
        scaled = (air.mixed_moments[k] - f[k][:, None]) / (1.0 - f[k][:, None])
        rows += [scaled[:, MOMENTS].T, phase[:, :1].T, f[k][None], phase[:, 1:].T]
    rows += [air.ground_albedo[None], 1e4 * air.ground_refractivity[None]]
    rows += [np.full((1, n), observer_km), np.full((1, n), np.sqrt(observer_km))]
    rows += [below(total), np.sqrt(below(d[AIR])), np.sqrt(below(particles))]
    return np.concatenate(rows).T


@dataclass(frozen=True)
class Model:
    """What the file holds (above); members: for each network its layers, as (weights (I, O), offsets (O,))."""

    members: tuple[tuple[tuple[np.ndarray, np.ndarray], ...], ...]
    input_mean: np.ndarray
    input_scale: np.ndarray
    base_mean: np.ndarray
    base_vectors: np.ndarray
    intensity_mean: np.ndarray
    intensity: np.ndarray
    polarisation_mean: np.ndarray
    polarisation: np.ndarray
    limits: np.ndarray
    error: np.ndarray
    provenance: dict[str, Any]

    @staticmethod
    def load(path: Any) -> Model:
        """Read a file; ValueError, OSError, KeyError, EOFError or zipfile's and zlib's errors for one that is none."""
        with np.load(path, allow_pickle=False) as file:
            if str(file["format"]) != FORMAT:
                raise ValueError(f"not of this version, {FORMAT}")
            arrays = {key: file[key].astype(np.float32) for key in tuple(Model.__dataclass_fields__)[1:-1]}
            for key in ("intensity", "polarisation"):
                arrays[key] *= file[f"{key}_scale"][:, None]
            values, place = file["weights"].astype(np.float32), 0
            members: list[tuple[tuple[np.ndarray, np.ndarray], ...]] = []
            for sizes in file["layers"]:
                layers = []
                for i, o in pairwise(sizes):
                    weights, offsets = np.split(values[place : place + i * o + o], [i * o])
                    layers.append((weights.reshape(i, o), offsets))
                    place += i * o + o
                members.append(tuple(layers))
            return Model(tuple(members), provenance=json.loads(str(file["provenance"])), **arrays)

    def standardised(self, air: np.ndarray, log_base: np.ndarray) -> np.ndarray:
        """Inputs of the networks (W, F), from those that name the air (W, F') and ln M_0 under all suns (W, B)."""
        base = (log_base - self.base_mean) @ self.base_vectors.T
        inputs = (np.concatenate([air, base], axis=1) - self.input_mean) / self.input_scale
        return single(np.clip(inputs, -OUTERMOST, OUTERMOST))

    def at_nodes(self, air: np.ndarray, log_base: np.ndarray) -> np.ndarray:
        """ln(M / M_0), Q / M, U / M and the spread of ln M at the nodes, (4, W, suns, elevations, azimuths)."""
        inputs = self.standardised(air, log_base)
        each = np.array([outputs(layers, inputs) for layers in self.members])
        c, k = each.mean(axis=0), self.intensity.shape[0]
        spread = np.sqrt(np.mean([((one - c).real[:, :k] @ self.intensity) ** 2 for one in each], axis=0))
        polarisation = self.polarisation_mean + c[:, k:] @ self.polarisation
        parts = (self.intensity_mean + c[:, :k] @ self.intensity, *np.split(polarisation, 2, axis=1), spread)
        return np.stack([part.reshape(inputs.shape[0], *NODES) for part in parts])


def outputs(layers: tuple, hidden: np.ndarray) -> np.ndarray:
    """Outputs (W, K + N) of a network for standardised inputs (W, F)."""
    for n, (weights, offsets) in enumerate(layers[:-1]):
        linear = hidden @ weights + offsets
        active = linear / (1.0 + np.exp(-linear))
        hidden = active + hidden if n else active
    return hidden @ layers[-1][0] + layers[-1][1]


def splines(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The cubic spline (not-a-knot) through values at the nodes (N,), as a matrix (X, N) that gives its values at x."""
    cached = _splines if x.size <= MOST_CACHED else _splines.__wrapped__
    return cached(np.asarray(nodes, float).tobytes(), np.asarray(x, float).tobytes())


@functools.lru_cache(maxsize=64)
def _splines(nodes_bytes: bytes, x_bytes: bytes) -> np.ndarray:
    nodes, x = np.frombuffer(nodes_bytes), np.frombuffer(x_bytes)
    h = np.diff(nodes)
    j = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 2)
    b = (x - nodes[j]) / h[j]
    second, a = _second_derivatives(nodes_bytes), 1.0 - b
    bent = [((p**3 - p) * h[j] ** 2 / 6.0)[:, None] for p in (a, b)]
    out = bent[0] * second[j] + bent[1] * second[j + 1]
    out[np.arange(x.size), j] += a
    out[np.arange(x.size), j + 1] += b
    out.flags.writeable = False
    return out


@functools.lru_cache(maxsize=32)
def _second_derivatives(nodes: bytes) -> np.ndarray:
    """Those of `splines` at the nodes (N,), as a matrix (N, N) that gives them from the values."""
    h = np.diff(np.frombuffer(nodes))
    n = h.size + 1
    left, right = np.zeros((n, n)), np.zeros((n, n))  # left @ (second derivatives) = right @ (values)
    for i in range(1, n - 1):
        left[i, i - 1 : i + 2] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
        right[i, i - 1 : i + 2] = 6.0 / h[i - 1], -6.0 / h[i - 1] - 6.0 / h[i], 6.0 / h[i]
    left[0, :3] = h[1], -(h[0] + h[1]), h[0]  # one cubic across the second and the last but one node
    left[-1, -3:] = h[-1], -(h[-2] + h[-1]), h[-2]
    return np.linalg.solve(left, right)
