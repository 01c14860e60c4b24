"""The light of every clear sky, from one file: `data/compact/clear-air.npz`, this module and those that it stands on,
`shells`, `diffuse` and `diffuse_rays`, need numpy alone.

    L / F0 = sum_k P_k(angle from the sun) Q_k  +  M,        M = M_0 exp(sum_n c_n v_n(sun, elevation, azimuth))

Q_k, of scattering by air and each aerosol, are integrals along refracted lines of sight through spherical shells
(`Shells`); P_k are the phase functions, their forward peaks widened (`_widened`).  M_0 are orders of scattering
in fewer layers and directions (`diffuse`).  c_n, one set for each wavelength, air and observer, for
every sun, are the mean of some small networks of what names the air (`network_inputs`) and of ln M_0 under all suns;
v_n are principal components of ln(M / M_0) in air that `zones` has solved.  Q / M and U / M are sums of the same kind.

    skies = Skies(Model.load("clear-air.npz"), Air(**numpy.load("air.npz")), observer_km=0.0)
    light = skies.sky(-4.0).light(elevation_deg, azimuth_deg, n_stokes=3)       # (E, A, 3, W) [sr^-1]

Several airs over one Earth are one `Air` whose wavelengths stand side by side.  Derivatives: give
the air an imaginary part of `STEP` times a direction (`Air.towards`); that of the light is STEP x its derivative.

The file is a zip of arrays (.npy), S = 32 suns `SUN_DEG`, E = 15 and A = 13 nodes over the sky:

    format "twilight clear air 3"; provenance: how it was fitted, as JSON
    base_mean (480,), base_vectors (48, 480): components of ln M_0 at `BASE_ELEVATION_DEG` x `BASE_AZIMUTH_DEG`
    input_mean, input_scale (138,): of the inputs: 90 of the air, then 48 components
    layers (members, 5), weights: sizes of each network's layers; then its weights (I, O) and offsets (O,) in a row.
        Hidden layers have the activation silu; all but the first add their input
    intensity_mean (S E A,), intensity (128, S E A), intensity_scale (128,): v_n are intensity x scale
    polarisation_mean (2 S E A,), polarisation, polarisation_scale: of Q / M, then U / M
    limits (10, 2): least and largest of what `LIMITED` names in the airs of the fit
    error (2, S): the error at 95 % of a sky is error[0] + error[1] x spread of the networks
"""

from __future__ import annotations

import copy
import functools
import json
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from twilight.transport.diffuse import diffuse_light, seen_along
from twilight.transport.shells import (
    ABSORPTION,
    AIR,
    ALTITUDE_KM,
    DARK,
    EXTINCTION,
    HIGH,
    LOW,
    Air,
    Line,
    Shells,
    single,
    sublayers,
    summed,
)

if TYPE_CHECKING:
    from twilight.atmosphere.screen import Screen

FORMAT = "twilight clear air 3"
HALVED_KM = (30.0, 30.0)
"""Up to which layers are halved for the sunbeam, and once more: of a low sun it rises steeply below the top of haze."""


def _halved(boundary_km: np.ndarray, highest_km: float) -> np.ndarray:
    """Boundaries of layers, with the middles of those up to an altitude."""
    middle = 0.5 * (boundary_km[1:] + boundary_km[:-1])
    return np.unique(np.concatenate([boundary_km, middle[boundary_km[1:] <= highest_km]]))


SHELLS_KM = functools.reduce(_halved, HALVED_KM, ALTITUDE_KM)
"""Boundaries of shells."""
LEAST_REFRACTIVITY = 1e-30
"""Least n - 1, so that it has a logarithm."""
SUN_DEG = np.concatenate(
    [[-18, -16.5, -15, -13.5], np.arange(-12, 3), [3.5, 5, 7.5, 10, 15], np.arange(20.0, 91.0, 10.0)]
)
"""Elevations of the sun at which ln(M / M_0) is stored [deg]."""
ELEVATION_DEG = np.array([0, 1, 2.5, 5, 8, 12, 17, 23, 30, 38, 47, 57, 68, 79, 90.0])
AZIMUTH_DEG = np.array([0, 6, 12, 20, 30, 45, 60, 80, 100, 120, 140, 160, 180.0])
"""Nodes over the sky, from the sun [deg]."""
NODES = (SUN_DEG.size, ELEVATION_DEG.size, AZIMUTH_DEG.size)
BASE_ELEVATION_DEG, BASE_AZIMUTH_DEG = ELEVATION_DEG[[0, 3, 6, 10, 14]], AZIMUTH_DEG[[0, 6, 12]]
SCREEN_ERROR = 0.1
"""Error at 95 % of a sky, as a part of what a screen takes of ln(light), by `benchmarks/clear_air.py screen`."""
SPARED_DEG = 2.5
"""How far above the highest sun whose beams a screen dims anywhere it takes less than 0.1 % of any sky [deg]."""
PEAK_DEGREE, PEAK_ANGLES, LEAST_PEAK_DEPTH = 400, 161, 1e-4
"""Of the widened peaks: degree, angles of tables, optical depth of scattering in peaks below which they stay."""
SLAB_KM = np.array([0, 0.25, 0.7, 1.35, 2, 3, 4.5, 6, 8, 10, 12, 15, 19, 24, 30, 39, 60, 100])
COARSE_SLABS, ABSORPTION_SLABS = (0, 4, 8, 11, 13, 15, 17), (*range(0, 18, 2), 17)
"""Slabs whose optical depths are inputs of the network; of air's scattering and of the aerosol's absorption these."""
MOMENTS, ANGLES_DEG = (1, 2, 3, 4, 6, 8, 12), (60.0, 90.0, 120.0, 150.0, 180.0)
"""Legendre moments, and angles at which logarithms of phase functions, are inputs [deg]."""
OUTERMOST = 5.0
"""Standard deviations from the mean at which inputs are cut off."""
NEGLIGIBLE = 1e-3
"""Fraction of M that is added to every Q_k before its logarithm is interpolated: in the shadow it falls without end."""
DARKEST_TERM = 1e-3
"""Light of a wavelength, of that of the brightest one, below which it does not count in the error of a sky."""


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


class Skies:
    """The skies of an air seen by one observer, under every sun; observer_km: above the ground, 0 to 15."""

    def __init__(self, model: Model | None, air: Air, observer_km: float = 0.0):
        self.model, self.air, self.observer_km = model, air, observer_km
        boundary = SHELLS_KM
        if np.abs(boundary - observer_km).min() > 1e-4:
            boundary = np.sort(np.append(boundary, observer_km))
        layer = np.searchsorted(ALTITUDE_KM, 0.5 * (boundary[1:] + boundary[:-1])) - 1
        per_km, d, of_aerosols = 1.0 / np.diff(ALTITUDE_KM)[:, None], air.depth, air.aerosol_depth
        self.peak_fraction = air.peaks(air.moments)
        peak = np.einsum("kw,klw->lw", self.peak_fraction, of_aerosols)
        ln = np.log(np.maximum(air.refractivity, LEAST_REFRACTIVITY))
        ln = np.interp(sublayers(boundary), sublayers(ALTITUDE_KM), ln)
        self.shells = Shells(
            boundary,
            ((d[AIR] + d[ABSORPTION] + d[EXTINCTION] - peak) * per_km)[layer],
            (np.concatenate([d[AIR][None], of_aerosols]) * per_km)[:, layer],
            (peak * per_km)[layer],
            np.exp(ln),
            observer_km,
            air.radius_km,
        )
        self._peak_depth = self.shells.beams.path_km @ self.shells.peak
        self.nodes = self.shells.line(ELEVATION_DEG)
        self._taken = np.zeros(SUN_DEG.size)

    @functools.cached_property
    def _diffuse(self) -> np.ndarray:
        return diffuse_light(self.air, self.shells)

    @functools.cached_property
    def inputs(self) -> np.ndarray:
        """`network_inputs`."""
        return network_inputs(self.air, self.observer_km)

    @functools.cached_property
    def log_base(self) -> np.ndarray:
        """ln M_0 under all suns, an input of the network, (W, B)."""
        return self._log_base()

    def behind(self, screen: Screen, powers: np.ndarray) -> Skies:
        """The same behind a screen, whose altitudes are above the ground and whose T has these powers (W,): every Q_k
        and M_0 are of the sunbeam that passes, and M / M_0 is that of the whole one."""
        whole = self.log_base  # the network's, of the whole sunbeam
        made, made.shells = copy.copy(self), copy.copy(self.shells)
        made.shells.screen = screen, powers
        made.shells.__dict__.pop("_tables")
        made._diffuse = diffuse_light(self.air, made.shells)
        taken = (whole - made._log_base()).real.reshape(len(powers), SUN_DEG.size, -1)
        made._taken = np.percentile(taken, 95, axis=(0, 2))
        return made

    @functools.cached_property
    def at_nodes(self) -> np.ndarray:
        """`Model.at_nodes`."""
        return self._fitted_model.at_nodes(self.inputs, self.log_base)

    @property
    def _fitted_model(self) -> Model:
        if self.model is None:
            raise ValueError("a sky needs a model; without one there is M_0 alone")
        return self.model

    def lowest_spared_deg(self, screen: Screen) -> float:
        """Sun elevation [deg] from which on a screen takes nothing (0.1 %) of a sky: `SPARED_DEG` above the highest one
        whose beams it dims anywhere."""
        dims = screen.at(self.shells._least_km(screen)) < 1.0
        first = self.shells.beams.zenith_rad[dims].min(initial=np.pi)
        return 90.0 - float(np.degrees(first)) + SPARED_DEG

    def base_at(
        self, sun_deg: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, line: Line
    ) -> np.ndarray:
        """M_0 under suns (S,) in directions along lines of sight, (S, E, A, W)."""
        return seen_along(self.air, self.shells, self._diffuse, sun_deg, elevation_deg, azimuth_deg, line)

    def _log_base(self) -> np.ndarray:
        line = self.shells.line(BASE_ELEVATION_DEG)
        light = np.log(self.base_at(SUN_DEG, BASE_ELEVATION_DEG, BASE_AZIMUTH_DEG, line))
        return light.reshape(-1, light.shape[-1]).T

    def sky(self, sun_elevation_deg: float) -> Sky:
        """The sky under one sun, from -18 to 90 deg."""
        air, shells, line = self.air, self.shells, self.nodes
        weight = splines(SUN_DEG, np.array([sun_elevation_deg]))[0]
        log_ratio, *polarised, spread = np.einsum("s,pwsea->peaw", weight, self.at_nodes)
        base = self.base_at(np.array([sun_elevation_deg]), ELEVATION_DEG, AZIMUTH_DEG, line)[0]
        multiple = np.log(base) + log_ratio
        integrals, peaks = self._scattered_once(sun_elevation_deg)
        once = np.log(np.maximum(integrals, DARK) + NEGLIGIBLE * np.exp(multiple))
        apparent = shells.apparent_elevation_deg(sun_elevation_deg)
        sky = Sky(apparent, air, np.concatenate([multiple[None], once]), np.array(polarised), peaks)
        light = sky.light(ELEVATION_DEG, AZIMUTH_DEG, widen=False).real[..., 0, :]
        spread = np.abs(spread) * np.exp(multiple.real) / light
        # terms of bands of gases that let no light through have no part in the sky
        brightest = light.max(axis=(0, 1))
        counted = spread[..., brightest > DARKEST_TERM * brightest.max()]
        least, times, taken = (
            np.interp(sun_elevation_deg, SUN_DEG, row) for row in (*self._fitted_model.error, self._taken)
        )
        error = least + times * np.percentile(counted, 95)
        return sky._replace(relative_error=float(np.hypot(error, SCREEN_ERROR * taken)))

    def single_scattering(self, sun_elevation_deg: float) -> np.ndarray:
        """Light scattered once, with what forward peaks have scattered, at the nodes: I, Q, U over F0, (E, A, 3, W)."""
        integrals, peaks = self._scattered_once(sun_elevation_deg)
        logarithms = np.log(np.concatenate([np.zeros_like(integrals[:1]), integrals]) + DARK)
        apparent = self.shells.apparent_elevation_deg(sun_elevation_deg)
        none = np.zeros((2, *integrals.shape[1:]))
        return Sky(apparent, self.air, logarithms, none, peaks).light(ELEVATION_DEG, AZIMUTH_DEG, 3)

    def _scattered_once(self, sun_deg: float) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray] | None]:
        """Q_k at the nodes (1 + K, E, A, W), and `_widened`."""
        line = self.nodes
        mean = self.shells.sunlit(line.zenith(sun_deg, AZIMUTH_DEG)[0], line.depth)
        peaks = self._widened(sun_deg, mean[:, 0]) if len(self.air.aerosol_depth) else None
        return self.shells.integrated(line, mean), peaks

    def _widened(self, sun_deg: float, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Light that forward peaks have scattered more than once, at the elevations of the nodes, from light in layers
        (E, K, W) towards the sun: depth x (E, W) of scattering in peaks on its way, and what is added to exp(-x) P at
        PEAK_ANGLES angles, (K, E, angles, W).  With f the fraction in the peak and p_l its moments (1 up to the degree
        that is followed, chi_l / f beyond; m_l of the mixture), all convolutions of the peak with itself (Nakajima and
        Tanaka 1988, J. Quant. Spectrosc. Radiat. Transfer 40, 51, to all orders):

            sum_l (2 l + 1)/(4 pi) P_l [f p_l g_l + (1 - exp(-x)) (chi_l - f)],
            g_l = [exp(-x (1 - m_l)) - exp(-x)] / (x m_l) - exp(-x)
        """
        line, first, f = self.nodes, self.shells.first, self.peak_fraction
        scattered = line.path[..., None] * f[:, None, None] * self.shells.scattering[1:, None, first:] * light
        passed = np.cumsum(line.path[..., None] * self.shells.peak[first:], axis=1)
        i, part = self.shells._place(
            np.arange(first, self.shells.boundary_km.size), line.zenith(sun_deg, np.zeros(1))[0, :, 0]
        )
        before = self._peak_depth[i] * (1.0 - part[..., None]) + self._peak_depth[i + 1] * part[..., None]
        shifted = np.concatenate([np.zeros_like(passed[:, :1]), passed[:, :-1]], axis=1)
        mean_depth = 0.5 * (shifted + passed + before[:, :-1] + before[:, 1:])
        by_kind = scattered.sum(axis=2)
        total = by_kind.sum(axis=0)
        safe_total = np.where(total.real > 0.0, total, 1.0)
        x = np.einsum("sekw,ekw->ew", scattered, mean_depth) / safe_total
        x = np.where((total.real > 0.0) & (x.real >= LEAST_PEAK_DEPTH), x, 0.0)[..., None]
        moments, followed = self._peaks
        mixed = np.einsum("kew,kwl->ewl", by_kind / safe_total, moments)
        none, small = np.exp(-x), np.abs(mixed) * x.real < 1e-6
        g = np.where(
            small, 0.5 * none * x * mixed, (np.exp(-x * (1.0 - mixed)) - none) / np.where(small, 1.0, mixed * x) - none
        )
        series = (np.where(f > 1e-6, f, 0.0)[..., None] * moments)[:, None] * g + (1.0 - none) * followed[:, None]
        return x[..., 0], np.swapaxes(single(series) @ _legendre_terms().T, -1, -2)

    @functools.cached_property
    def _peaks(self) -> tuple[np.ndarray, np.ndarray]:
        """p_l and chi_l - f, 0 beyond what is followed, (K, W, PEAK_DEGREE + 1)."""
        f, chi = self.peak_fraction[..., None], self.air.moments
        beyond = np.arange(PEAK_DEGREE + 1) > np.ceil(self.air.degree.real)[:, None]
        # those of a peak of less than a hundredth are errors of quadrature where they are negative or above 1
        most, least = np.where(f.real > 0.01, 2.0, 1.0), np.where(f.real > 0.01, -2.0, 0.0)
        return np.where(beyond, np.clip(chi / np.maximum(f, 1e-6), least, most), 1.0), np.where(beyond, 0.0, chi - f)


@functools.cache
def _legendre_terms() -> np.ndarray:
    """(2 l + 1)/(4 pi) P_l at PEAK_ANGLES angles, (angles, l)."""
    angle = np.pi * np.linspace(0.0, 1.0, PEAK_ANGLES) ** 2
    legendre = np.polynomial.legendre.legvander(np.cos(angle), PEAK_DEGREE)
    return (legendre * (2 * np.arange(PEAK_DEGREE + 1) + 1) / (4.0 * np.pi)).astype(np.float32)


class Sky(NamedTuple):
    """The sky of one sun: its apparent elevation; ln of M and of Q_k of air and K aerosols at the nodes, (2 + K, E, A,
    W); Q / M and U / M (2, E, A, W); `Skies._widened`; error of radiance at 95 % of directions, as estimated."""

    sun_elevation_deg: float
    air: Air
    logarithms: np.ndarray
    polarised: np.ndarray
    peaks: tuple[np.ndarray, np.ndarray] | None
    relative_error: float = 0.0

    def light(
        self, elevation_deg, azimuth_deg, n_stokes: int = 1, on_grid: bool = True, widen: bool = True
    ) -> np.ndarray:
        """The first n_stokes, 1 or 3, of I, Q, U over F0 [sr^-1], in rows (E,) times columns (A,), (E, A, n_stokes, W);
        not on_grid: in directions (D,), (D, n_stokes, W)."""
        air, rho = self.air, self.air.depolarisation
        rows = splines(np.log(ELEVATION_DEG + 1.5), np.log(elevation_deg + 1.5))
        even, odd = azimuth_splines(azimuth_deg)
        multiple, *once = np.exp(_interpolated(self.logarithms, rows, even, on_grid))
        sun, e, a = (np.radians(x) for x in (self.sun_elevation_deg, elevation_deg, azimuth_deg))
        e, a = (e[:, None], a[None]) if on_grid else (e, a)
        cosine = np.clip(np.sin(e) * np.sin(sun) + np.cos(e) * np.cos(sun) * np.cos(a), -1.0, 1.0)
        phases = [3.0 / (8.0 * np.pi * (2.0 + rho)) * ((1.0 + rho) + (1.0 - rho) * cosine[..., None] ** 2)]
        i, f = _place_of_angle(cosine, air.log_phase.shape[1])
        phases += [np.exp(table[i] * (1.0 - f) + table[i + 1] * f) for table in air.log_phase]
        widened = phases[1:]
        if self.peaks is not None and widen:
            dimmed = np.exp(-np.maximum(rows @ self.peaks[0], 0.0))
            added = np.moveaxis(np.tensordot(rows, self.peaks[1], (1, 1)), 1, 0)
            j, part = _place_of_angle(cosine, PEAK_ANGLES)
            row = np.arange(len(rows))[:, None] if on_grid else np.arange(len(rows))
            dimmed = dimmed[:, None] if on_grid else dimmed
            widened = [
                np.maximum(phase * dimmed + more[row, j] * (1.0 - part) + more[row, j + 1] * part, 0.0)
                for phase, more in zip(widened, added, strict=True)
            ]
        stokes = [multiple + sum(phase * q for phase, q in zip([phases[0], *widened], once, strict=True))]
        if n_stokes > 1:
            rayleigh = -3.0 / (16.0 * np.pi) * (1.0 - rho) / (1.0 + 0.5 * rho) * (1.0 - cosine[..., None] ** 2)
            polarised = rayleigh * once[0] + sum(
                phase * (ratio[i] * (1.0 - f) + ratio[i + 1] * f) * q
                for phase, ratio, q in zip(phases[1:], air.polarising, once[1:], strict=True)
            )
            # across the line of sight, the sun's direction has these components in the vertical plane and beside it
            vertical = np.cos(e) * np.sin(sun) - np.sin(e) * np.cos(sun) * np.cos(a)
            beside = -np.cos(sun) * np.sin(a)
            square = np.maximum(vertical**2 + beside**2, 1e-30)
            turns = ((vertical**2 - beside**2) / square, 2.0 * vertical * beside / square)
            for values, columns, turn in zip(self.polarised, (even, odd), turns, strict=True):
                part = _interpolated(values[None], rows, columns, on_grid)[0]
                stokes.append(multiple * part + polarised * turn[..., None])
        return np.stack(stokes, axis=-2)


def _place_of_angle(cosine: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Index into a table at angles pi (n / (count - 1))^2, and the part of the way to the next (..., 1)."""
    where = np.sqrt(np.arccos(cosine) / np.pi) * (count - 1)
    index = np.minimum(where.astype(int), count - 2)
    return index, (where - index)[..., None]


def _interpolated(values: np.ndarray, rows: np.ndarray, columns: np.ndarray, on_grid: bool) -> np.ndarray:
    """Values at the nodes (P, E, A, W) by splines over elevation and azimuth, (P, R, C, W) or (P, R, W)."""
    over_rows = np.tensordot(rows, values, (1, 1))  # R P A W
    return np.moveaxis(columns @ over_rows if on_grid else (columns[:, None, None] @ over_rows)[:, :, 0], 1, 0)


def splines(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The cubic spline (not-a-knot) through values at the nodes (N,), as a matrix (X, N) that gives its values at x."""
    n, h = nodes.size, np.diff(nodes)
    left, right = np.zeros((n, n)), np.zeros((n, n))  # left @ (second derivatives) = right @ (values)
    for i in range(1, n - 1):
        left[i, i - 1 : i + 2] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
        right[i, i - 1 : i + 2] = 6.0 / h[i - 1], -6.0 / h[i - 1] - 6.0 / h[i], 6.0 / h[i]
    left[0, :3] = h[1], -(h[0] + h[1]), h[0]  # one cubic across the second and the last but one node
    left[-1, -3:] = h[-1], -(h[-2] + h[-1]), h[-2]
    j = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, n - 2)
    b = (x - nodes[j]) / h[j]
    second, a = np.linalg.solve(left, right), 1.0 - b
    bent = [((p**3 - p) * h[j] ** 2 / 6.0)[:, None] for p in (a, b)]
    out = bent[0] * second[j] + bent[1] * second[j + 1]
    out[np.arange(x.size), j] += a
    out[np.arange(x.size), j + 1] += b
    return out


def azimuth_splines(azimuth_deg: np.ndarray) -> list[np.ndarray]:
    """Splines through the nodes and three mirror images on either side, (N, A): of what is the same on both sides of
    the sun, and of what changes its sign."""
    wrapped = (np.asarray(azimuth_deg, float) + 180.0) % 360.0 - 180.0
    count, beside = AZIMUTH_DEG.size, np.arange(3, 0, -1)
    mirrored = count - 1 - beside[::-1]
    nodes = np.concatenate([-AZIMUTH_DEG[beside], AZIMUTH_DEG, 360.0 - AZIMUTH_DEG[mirrored]])
    through = splines(nodes, np.abs(wrapped))
    out: list[np.ndarray] = []
    for sign in (1.0, -1.0):
        one = through[:, 3 : 3 + count].copy()
        one[:, beside] += sign * through[:, :3]
        one[:, mirrored] += sign * through[:, 3 + count :]
        out.append(one * np.where(wrapped < 0.0, sign, 1.0)[:, None])
    return out
