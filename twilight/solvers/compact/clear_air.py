"""One model of all clear air: light scattered once is computed, light scattered more often computed roughly and fitted.

    L / F0 = sum_k P_k(angle from the sun) Q_k  +  M,        M = M_0 exp(sum_n c_n v_n(sun, elevation, azimuth))

- Q_k, of scattering by air and by each aerosol: integrals along refracted lines of sight in spherical shells
  (:mod:`twilight.transport.shells`); P_k are the phase functions, their forward peaks widened
  (:mod:`twilight.solvers.compact.forward_peak`).
- M_0: orders of scattering in spherical shells, the first and the last with their direction, isotropic ones between
  (:mod:`twilight.solvers.compact.diffuse_light`).
- c_n, one set for each wavelength, air and observer, for every sun: a small network of what names the air
  (:class:`twilight.solvers.compact.air_columns.AirColumns`) and of ln M_0 under all suns.  v_n: principal components of
  ln(M / M_0) in air that `zones` has solved.  Q / M and U / M, the Stokes parameters of M, are sums of the same kind.

This file holds the fitted part, :mod:`twilight.solvers.compact.clear_air_sky` the sum.  `benchmarks/clear_air.py` fits
the file `data/compact/clear-air.npz` to skies of `benchmarks/clear_air_airs.py`, and measures its errors.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_file

FORMAT = "twilight clear air 1"
"""The array `format` of a file."""

SUN_DEG = np.concatenate(
    [[-18, -16.5, -15, -13.5], np.arange(-12, 3), [3.5, 5, 7.5, 10, 15], np.arange(20.0, 91.0, 10.0)]
)
"""Elevations of the sun at which ln(M / M_0) is stored [deg]."""

ELEVATION_DEG = np.array([0, 1, 2.5, 5, 8, 12, 17, 23, 30, 38, 47, 57, 68, 79, 90.0])
"""Elevations of the nodes over the sky [deg]."""

AZIMUTH_DEG = np.array([0, 6, 12, 20, 30, 45, 60, 80, 100, 120, 140, 160, 180.0])
"""Azimuths of the nodes from the sun [deg]."""

NODES = (SUN_DEG.size, ELEVATION_DEG.size, AZIMUTH_DEG.size)
"""Numbers of suns, elevations and azimuths at which light is stored."""

OUTERMOST = 5.0
"""Standard deviations from the mean at which inputs of the network are cut off."""

ARRAYS = (
    *("input_mean", "input_scale", "base_mean", "base_vectors"),
    *("intensity_mean", "intensity", "polarisation_mean", "polarisation", "limits", "error"),
)
"""Arrays of a file that are fields of `ClearAirModel`."""

Layers = tuple[tuple[np.ndarray, np.ndarray], ...]


@dataclass(frozen=True)
class ClearAirModel:
    """The fitted part: a network of several members, and the principal components that it gives coefficients of.

    members: for each member its layers, as (weights (I, O), offsets (O,)); hidden layers with the activation silu, all
        but the first residual: their input is added to their output; the members' mean counts
    input_mean, input_scale (F,): inputs are standardised with them
    base_mean (B,), base_vectors (N, B): principal components of ln M_0, which are inputs too
    intensity_mean (P,), intensity (K, P): of ln(M / M_0) over suns, elevations and azimuths, P their product
    polarisation_mean (2 P,), polarisation (N, 2 P): the same of Q / M and U / M
    limits (L, 2): least and largest of what limits the airs that were fitted (`air_columns.LIMITED`)
    error (2, suns): the error of radiance at 95 % of the directions of a sky is about error[0] + error[1] x spread,
        with the standard deviation of ln M between members, times the part of M in all light, at 95 % of the nodes
    provenance: how it was fitted, and its errors in airs that it never saw
    """

    members: tuple[Layers, ...]
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
    def load(path: Path) -> ClearAirModel:
        """Read a file; TwilightError for one that is none."""
        try:
            with np.load(path, allow_pickle=False) as file:
                if str(file["format"]) != FORMAT:
                    raise TwilightError(f"{path}: is no model of clear air of this version ({FORMAT})")
                arrays = {key: file[key].astype(np.float32) for key in ARRAYS}
                for key in ("intensity", "polarisation"):
                    arrays[key] *= file[f"{key}_scale"][:, None]
                members = _unpacked(file["layers"], file["weights"].astype(np.float32))
                return ClearAirModel(members, provenance=json.loads(str(file["provenance"])), **arrays)
        except (OSError, KeyError, ValueError, EOFError, BadZipFile, zlib.error) as error:
            raise TwilightError(f"{path}: is no model of clear air ({error})") from None

    def save(self, path: Path) -> None:
        """Write a file: principal components and weights as half floats."""
        arrays: dict[str, Any] = {key: getattr(self, key).astype(np.float32) for key in ARRAYS}
        for key in ("intensity", "polarisation"):
            scale = np.abs(arrays[key]).max(axis=1)
            arrays[f"{key}_scale"] = scale
            arrays[key] = (arrays[key] / scale[:, None]).astype(np.float16)
        arrays["base_vectors"] = arrays["base_vectors"].astype(np.float16)
        arrays["layers"] = np.array([[w.shape[0] for w, _ in m] + [m[-1][0].shape[1]] for m in self.members])
        arrays["weights"] = np.concatenate([a.ravel() for m in self.members for layer in m for a in layer]).astype(
            np.float16
        )
        with whole_file(path) as unfinished, open(unfinished, "wb") as file:
            np.savez_compressed(file, format=FORMAT, provenance=json.dumps(self.provenance), **arrays)

    def standardised(self, air: np.ndarray, log_base: np.ndarray) -> np.ndarray:
        """Inputs of the network (W, F), from those that name the air (W, F') and ln M_0 under all suns (W, B)."""
        base = (log_base - self.base_mean) @ self.base_vectors.T
        inputs = (np.concatenate([air, base], axis=1) - self.input_mean) / self.input_scale
        return np.clip(inputs, -OUTERMOST, OUTERMOST).astype(np.float32)

    def at_nodes(self, air: np.ndarray, log_base: np.ndarray) -> np.ndarray:
        """ln(M / M_0), Q / M, U / M and the spread of ln M at the nodes, (4, W, suns, elevations, azimuths)."""
        inputs = self.standardised(air, log_base)
        each = np.array([_outputs(layers, inputs) for layers in self.members])
        c, k = each.mean(axis=0), self.intensity.shape[0]
        intensity = self.intensity_mean + c[:, :k] @ self.intensity
        polarisation = self.polarisation_mean + c[:, k:] @ self.polarisation
        spread = np.sqrt(np.mean([((one - c)[:, :k] @ self.intensity) ** 2 for one in each], axis=0))
        shape = (inputs.shape[0], *NODES)
        parts = (intensity, *np.split(polarisation, 2, axis=1), spread)
        return np.stack([part.reshape(shape) for part in parts])

    def error_of(self, sun_elevation_deg: float, spread: float) -> float:
        """Relative error of radiance at 95 % of the directions of a sky, about."""
        least, times = (np.interp(sun_elevation_deg, SUN_DEG, row) for row in self.error)
        return float(least + times * spread)


def _outputs(layers: Layers, hidden: np.ndarray) -> np.ndarray:
    """Outputs (W, K + N) of a member for standardised inputs (W, F)."""
    *before, (last_weights, last_offsets) = layers
    for n, (weights, offsets) in enumerate(before):
        linear = hidden @ weights + offsets
        active = linear / (1.0 + np.exp(-linear))
        hidden = active + hidden if n else active
    return hidden @ last_weights + last_offsets


def _unpacked(shapes: np.ndarray, values: np.ndarray) -> tuple[Layers, ...]:
    """Layers of members from their sizes (members, layers + 1) and all weights and offsets in one row."""
    members, place = [], 0
    for sizes in shapes:
        layers = []
        for inputs, outputs in pairwise(sizes):
            weights = values[place : place + inputs * outputs].reshape(inputs, outputs)
            place += inputs * outputs
            layers.append((weights, values[place : place + outputs]))
            place += outputs
        members.append(tuple(layers))
    return tuple(members)
