"""One model of all clear air: light scattered once is computed, light scattered more often is computed roughly and fitted.

    L / F0 = sum_k P_k(angle from the sun) Q_k  +  M_0 exp(sum_n c_n v_n(sun, elevation, azimuth))

- Q_k, of scattering by air and by the aerosol below and above 12 km: integrals along refracted lines of sight in
  spherical shells (:mod:`twilight.solvers.compact.refracted_shells`); P_k are the phase functions.
- M_0: isotropic orders of scattering in spherical shells (:mod:`twilight.solvers.compact.diffuse_light`).
- c_n, one set for each wavelength, air and observer, for every sun: a small network of what names the air
  (:class:`twilight.solvers.compact.air_columns.AirColumns`) and of ln M_0 under all suns.  v_n: principal components of
  ln(M / M_0) in air that `zones` has solved.

All three are smooth over the sky but for P_k, so they are computed at the nodes below and interpolated by cubic splines.
`benchmarks/clear_air.py` draws the air, fits the file `data/compact/clear-air.npz` and measures its errors.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.numerics.phase import rayleigh_phase
from twilight.solvers.compact.air_columns import AirColumns
from twilight.solvers.compact.compact_sky import spline_matrix
from twilight.solvers.compact.diffuse_light import diffuse_light, seen

FORMAT = "twilight clear air 1"
"""The array `format` of a file."""

SUN_DEG = np.array(
    [-18, -16.5, -15, -13.5, -12, -11, -10, -9, -8, -7, -6, -5, -4, -3, -2, -1, 0, 1, 2, 3.5, 5, 7.5, 10, 15, 20, 30, 40]
    + [50, 60, 70, 80, 90]
)
"""Elevations of the sun at which ln(M / M_0) is stored [deg]."""

ELEVATION_DEG = np.array([0, 1, 2.5, 5, 8, 12, 17, 23, 30, 38, 47, 57, 68, 79, 90.0])
"""Elevations of the nodes over the sky [deg]."""

AZIMUTH_DEG = np.array([0, 6, 12, 20, 30, 45, 60, 80, 100, 120, 140, 160, 180.0])
"""Azimuths of the nodes from the sun [deg]."""

BASE_ELEVATIONS = (0, 3, 6, 10, 14)
"""Indices of the elevations at which ln M_0 is an input of the network."""

BASE_AZIMUTHS = (0, 6, 12)
"""Indices of the azimuths at which it is."""

MIRRORED = 3
"""Nodes beyond the sun's vertical on either side through which splines in azimuth go: the sky is its own mirror image."""

ELEVATION_OFFSET_DEG = 1.5
"""Splines in elevation run over the logarithm of elevation and this."""

OUTERMOST = 5.0
"""Standard deviations from the mean at which inputs of the network are cut off."""

DARK = 1e-30
"""Least radiance over F0 whose logarithm is taken [sr^-1]."""


@dataclass(frozen=True)
class ClearAirModel:
    """The fitted part: a network of several members, and the patterns that it gives coefficients of.

    members: for each member its layers, as (weights (I, O), offsets (O,)); silu with a way around every layer but the
        first and the last; the members' mean counts
    input_mean, input_scale (F,): inputs are standardised with them
    base_mean (B,), base_vectors (N, B): principal components of ln M_0, which are inputs too
    pattern_mean (P,), patterns (K, P): of ln(M / M_0) over suns, elevations and azimuths, P their product
    lowest, highest (F,): of the inputs that the fit saw
    provenance: how it was fitted, and its errors
    """

    members: tuple[tuple[tuple[np.ndarray, np.ndarray], ...], ...]
    input_mean: np.ndarray
    input_scale: np.ndarray
    base_mean: np.ndarray
    base_vectors: np.ndarray
    pattern_mean: np.ndarray
    patterns: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    provenance: dict[str, Any]

    @staticmethod
    def load(path: Path) -> ClearAirModel:
        """Read a file; TwilightError for one that is none."""
        try:
            with np.load(path, allow_pickle=False) as file:
                if str(file["format"]) != FORMAT:
                    raise TwilightError(f"{path}: is no model of clear air of this version ({FORMAT})")
                shapes = file["layers"]
                values = file["weights"].astype(np.float32)
                rest = {
                    key: file[key].astype(np.float32)
                    for key in (
                        "input_mean",
                        "input_scale",
                        "base_mean",
                        "base_vectors",
                        "pattern_mean",
                        "patterns",
                        "lowest",
                        "highest",
                    )
                }
                rest["patterns"] *= file["pattern_scale"].astype(np.float32)[:, None]
                provenance = json.loads(str(file["provenance"]))
        except (OSError, KeyError, ValueError) as error:
            raise TwilightError(f"{path}: is no model of clear air ({error})") from None
        members, place = [], 0
        for sizes in shapes:
            layers = []
            for inputs, outputs in zip(sizes[:-1], sizes[1:], strict=True):
                weights = values[place : place + inputs * outputs].reshape(inputs, outputs)
                place += inputs * outputs
                layers.append((weights, values[place : place + outputs]))
                place += outputs
            members.append(tuple(layers))
        return ClearAirModel(tuple(members), provenance=provenance, **rest)

    def coefficients(self, inputs: np.ndarray) -> np.ndarray:
        """c of standardised inputs (W, F), (W, K)."""
        return np.mean([_member(layers, inputs) for layers in self.members], axis=0)

    def log_ratio(self, air: np.ndarray, log_base: np.ndarray) -> np.ndarray:
        """ln(M / M_0) at the nodes of all suns, (W, suns, elevations, azimuths).

        air (W, F'): inputs that name the air; log_base (W, B): ln M_0 under all suns
        """
        base = (log_base - self.base_mean) @ self.base_vectors.T
        inputs = (np.concatenate([air, base], axis=1) - self.input_mean) / self.input_scale
        inputs = np.clip(inputs, -OUTERMOST, OUTERMOST).astype(np.float32)
        out = self.pattern_mean + self.coefficients(inputs) @ self.patterns
        return out.reshape(-1, SUN_DEG.size, ELEVATION_DEG.size, AZIMUTH_DEG.size)


def _member(layers: tuple[tuple[np.ndarray, np.ndarray], ...], inputs: np.ndarray) -> np.ndarray:
    hidden = inputs
    for n, (weights, offsets) in enumerate(layers):
        linear = hidden @ weights + offsets
        if n == len(layers) - 1:
            return linear
        active = linear / (1.0 + np.exp(-linear))
        hidden = active + hidden if n else active
    raise AssertionError("a member without layers")


class RoughSkies:
    """What is computed of the skies of one air seen by one observer, before anything that is fitted.

    columns: the air; observer_km: above the ground
    """

    def __init__(self, columns: AirColumns, observer_km: float = 0.0):
        self.columns = columns
        self.shells, self._scattering = columns.shells(observer_km)
        self._light = diffuse_light(self.shells, columns.diffuse_coefficients(), columns.medium.ground_albedo)
        self.inputs = columns.inputs(observer_km)

    def base_at(self, sun_elevation_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """M_0 in directions, (E, A, W)."""
        where = (sun_elevation_deg, elevation_deg, azimuth_deg)
        return seen(self.shells, self._light, self._scattering, *where)


class ClearAirSkies(RoughSkies):
    """The skies of one air seen by one observer, under every sun."""

    def __init__(self, model: ClearAirModel, columns: AirColumns, observer_km: float = 0.0):
        super().__init__(columns, observer_km)
        self._log_ratio = model.log_ratio(self.inputs, log_base(self.base_at))

    def sky(self, sun_elevation_deg: float) -> ClearAirSky:
        """The sky under one sun, from -18 to 90 deg."""
        nodes = (sun_elevation_deg, ELEVATION_DEG, AZIMUTH_DEG)
        weight = spline_matrix(SUN_DEG, np.array([sun_elevation_deg]))[0]
        ratio = np.einsum("s,wsea->eaw", weight, self._log_ratio)
        several = np.log(np.maximum(self.base_at(*nodes), DARK)) + ratio
        once = np.log(np.maximum(self.shells.scattered_once(*nodes), DARK))
        return ClearAirSky(sun_elevation_deg, self.columns, np.concatenate([several[None], once]))


def log_base(base_at: Callable[[float, np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """ln M_0 under all suns, an input of the network, (W, B)."""
    where = ELEVATION_DEG[list(BASE_ELEVATIONS)], AZIMUTH_DEG[list(BASE_AZIMUTHS)]
    light = np.array([base_at(float(sun), *where) for sun in SUN_DEG])  # suns E A W
    return np.log(np.maximum(light, DARK)).reshape(-1, light.shape[-1]).T


@dataclass(frozen=True)
class ClearAirSky:
    """The sky of one sun: logarithms at the nodes (4, E, A, W) of M and of Q_k."""

    sun_elevation_deg: float
    columns: AirColumns
    logarithms: np.ndarray

    def on_grid(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """L / F0 [sr^-1] in rows times columns, (E, A, W)."""
        rows, columns = elevation_splines(elevation_deg), azimuth_splines(azimuth_deg)
        parts = np.exp(np.einsum("re,peaw,ca->prcw", rows, self.logarithms, columns, optimize=True))
        return self._summed(parts, elevation_deg[:, None], azimuth_deg[None])

    def radiance(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """L / F0 [sr^-1] in directions of one shape, that shape plus (W,)."""
        rows, columns = elevation_splines(elevation_deg.ravel()), azimuth_splines(azimuth_deg.ravel())
        parts = np.exp(np.einsum("de,peaw,da->pdw", rows, self.logarithms, columns, optimize=True))
        out = self._summed(parts, elevation_deg.ravel(), azimuth_deg.ravel())
        return out.reshape(*elevation_deg.shape, -1)

    def _summed(self, parts: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        sun, elevation, azimuth = (np.radians(a) for a in (self.sun_elevation_deg, elevation_deg, azimuth_deg))
        cosine = np.sin(elevation) * np.sin(sun) + np.cos(elevation) * np.cos(sun) * np.cos(azimuth)
        medium = self.columns.medium
        phases = [rayleigh_phase.py_func(cosine[..., None], medium.depolarisation)]
        phases += [np.moveaxis(phase(cosine), 0, -1) for phase in medium.phase_functions]
        return parts[0] + sum(phase * part for phase, part in zip(phases, parts[1:], strict=True))


def elevation_splines(elevation_deg: np.ndarray) -> np.ndarray:
    """Splines through the nodes in elevation, (N, E)."""
    return spline_matrix(np.log(ELEVATION_DEG + ELEVATION_OFFSET_DEG), np.log(elevation_deg + ELEVATION_OFFSET_DEG))


def azimuth_splines(azimuth_deg: np.ndarray) -> np.ndarray:
    """Splines through the nodes in azimuth and their mirror images, (N, A)."""
    azimuth = np.abs((np.asarray(azimuth_deg, float) + 180.0) % 360.0 - 180.0)
    count, beside = AZIMUTH_DEG.size, np.arange(MIRRORED, 0, -1)
    nodes = np.concatenate([-AZIMUTH_DEG[beside], AZIMUTH_DEG, 360.0 - AZIMUTH_DEG[count - 1 - beside[::-1]]])
    through = spline_matrix(nodes, azimuth)
    out = through[:, MIRRORED : MIRRORED + count].copy()
    np.add.at(out, (slice(None), beside), through[:, :MIRRORED])
    np.add.at(out, (slice(None), count - 1 - beside[::-1]), through[:, MIRRORED + count :])
    return out


@functools.lru_cache(maxsize=1)
def shipped_model(path: Path) -> ClearAirModel:
    """The model that comes with the package, read once."""
    return ClearAirModel.load(path)
