"""The light of every clear sky, from one file: this module and `data/compact/clear-air.npz` need numpy alone.

    L / F0 = sum_k P_k(angle from the sun) Q_k  +  M,        M = M_0 exp(sum_n c_n v_n(sun, elevation, azimuth))

Q_k, of scattering by air and each aerosol, are integrals along refracted lines of sight through spherical shells
(`Shells`); P_k are the phase functions, their forward peaks widened (`_widened`).  M_0 are orders of scattering, the
first and the last with their direction (`Skies._diffuse`).  c_n, one set for each wavelength, air and observer, for
every sun, are the mean of some small networks of what names the air (`Air.inputs`) and of ln M_0 under all suns; v_n
are principal components of ln(M / M_0) in air that `zones` has solved.  Q / M and U / M are sums of the same kind.

    skies = Skies(Model.load("clear-air.npz"), Air(**numpy.load("air.npz")), observer_km=0.0)
    light = skies.sky(-4.0).light(elevation_deg, azimuth_deg, n_stokes=3)       # (E, A, 3, W) [sr^-1]

Several airs over one Earth are one `Air` whose wavelengths stand side by side.  Derivatives: give
the air an imaginary part of `STEP` times a direction (`Air.towards`); that of the light is STEP x its derivative.

The file is a zip of arrays (.npy), W wavelengths, S = 32 suns `SUN_DEG`, E = 15 and A = 13 nodes over the sky:

    format "twilight clear air 2"; provenance: how it was fitted, as JSON
    segments (6, N): of rays between scatterings: layer they start from and layer they cross (of `BOUNDARY_KM`, the
        ground last), length [km], angle at the Earth's centre from start to middle [rad], cosine of the ray's zenith
        angle, its weight in the mean over directions at the ray's first segment and 0 at the others
    base_mean (480,), base_vectors (48, 480): components of ln M_0 at `BASE_ELEVATION_DEG` x `BASE_AZIMUTH_DEG`
    input_mean, input_scale (138,): of the inputs: 90 of the air, then 48 components
    layers (members, 5), weights: sizes of each network's layers; then its weights (I, O) and offsets (O,) in a row.
        Hidden layers have the activation silu; all but the first add their input
    intensity_mean (S E A,), intensity (128, S E A), intensity_scale (128,): v_n are intensity x scale
    polarisation_mean (2 S E A,), polarisation, polarisation_scale: of Q / M, then U / M
    limits (9, 2): least and largest of what `LIMITED` names in the airs of the fit
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

if TYPE_CHECKING:
    from twilight.atmosphere.screen import Screen

FORMAT = "twilight clear air 2"
EARTH_RADIUS_KM = 6371.0
SUN_DEG = np.concatenate(
    [[-18, -16.5, -15, -13.5], np.arange(-12, 3), [3.5, 5, 7.5, 10, 15], np.arange(20.0, 91.0, 10.0)]
)
"""Elevations of the sun at which ln(M / M_0) is stored [deg]."""
ELEVATION_DEG = np.array([0, 1, 2.5, 5, 8, 12, 17, 23, 30, 38, 47, 57, 68, 79, 90.0])
AZIMUTH_DEG = np.array([0, 6, 12, 20, 30, 45, 60, 80, 100, 120, 140, 160, 180.0])
"""Nodes over the sky, from the sun [deg]."""
NODES = (SUN_DEG.size, ELEVATION_DEG.size, AZIMUTH_DEG.size)
BASE_ELEVATION_DEG, BASE_AZIMUTH_DEG = ELEVATION_DEG[[0, 3, 6, 10, 14]], AZIMUTH_DEG[[0, 6, 12]]
ALTITUDE_KM = np.concatenate(
    [
        *([0, 0.02, 0.06, 0.12, 0.25, 0.45, 0.7, 1, 1.35, 1.7], np.arange(2, 6, 0.5), np.arange(6.0, 16.0)),
        *([16, 17.5, 19, 20.5, 22, 24, 26, 28, 30, 33], np.arange(36.0, 81.0, 3.0), [82, 86, 90, 95, 100]),
    ]
)
"""Boundaries of the L layers above the ground [km]."""
BOUNDARY_KM = np.array(
    [0, 0.25, 0.7, 1.35, 2, 3, 4.5, 6, 8, 10, 12, 14, 16, 19, 22, 26, 30, 36, 42, 48, 54, 63, 72, 82, 100]
)
"""Boundaries of the layers of diffuse light; all are in ALTITUDE_KM."""
ZENITH_DEG = np.concatenate([[0, 25, 45, 60, 70, 76, 80, 83, 85.5, 87.5], np.arange(89.0, 113.0), [115, 118, 122]])
"""Local solar zenith angles of diffuse light [deg]."""
ORDERS = 4
"""Legendre orders of the phase functions in the first scattering of diffuse light."""
AZIMUTHS = 8
"""Azimuths of rays of diffuse light over half a turn."""
SCATTERINGS, MOST_RATIO = 8, 0.95
"""Orders of scattering that are followed; the largest ratio of two of which a geometric series is summed."""
DECAY_DEG, DECAY = 88.0, 1.1
"""`_log_reference` falls from this zenith angle on, from 8 deg beyond it on by so much a degree."""
SUBLAYERS = 4
"""Parts of each layer in which n r is linear; with 6 the sunbeam differs by less than 0.1 %."""
STEEPEST_DEG, RAYS_FROM_ABOVE, RAYS_FROM_BELOW = 0.03, 90, 100
"""Of the table of sunbeams of an altitude: elevation of the lowest ray from above beside the horizontal one; counts."""
LEAST_SPREAD = 0.05
"""Least d(true)/d(apparent zenith angle) of a sunbeam: beyond it the beam would be focused."""
SCREEN_ERROR = 0.1
"""Error at 95 % of a sky, as a part of what a screen takes of ln(light), by `benchmarks/clear_air.py screen`."""
DARKEST_PASSED = 1e-6
"""Least part of a sunbeam that passes a screen, so that it has a logarithm, which is interpolated."""
SPARED_DEG = 2.5
"""How far above the highest sun whose beams a screen dims anywhere it takes less than 0.1 % of any sky [deg]."""
DARK_LOG, DARK = -700.0, 1e-35
"""Logarithm of the sunbeam in the shadow of the Earth; least radiance over F0 whose logarithm is taken [sr^-1]."""
MOST_DEGREE = 16
"""Degree to which phase functions are followed at most; what is beyond is their forward peak."""
PEAK_DEGREE, PEAK_ANGLES, LEAST_PEAK_DEPTH = 400, 161, 1e-4
"""Of the widened peaks: degree, angles of tables, optical depth of scattering in peaks below which they stay."""
SLAB_KM = np.array([0, 0.25, 0.7, 1.35, 2, 3, 4.5, 6, 8, 10, 12, 15, 19, 24, 30, 39, 60, 100])
COARSE_SLABS, ABSORPTION_SLABS = (0, 4, 8, 11, 13, 15, 17), (*range(0, 18, 2), 17)
"""Slabs whose optical depths are inputs of the network; of air's scattering and of the aerosol's absorption these."""
MOMENTS, ANGLES_DEG = (1, 2, 3, 4, 6, 8, 12), (60.0, 90.0, 120.0, 150.0, 180.0)
"""Legendre moments, and angles at which logarithms of phase functions, are inputs [deg]."""
STEP = 1e-6
"""Imaginary part of an air whose light's derivative is asked for: an error of its square."""
OUTERMOST = 5.0
"""Standard deviations from the mean at which inputs are cut off."""
NEGLIGIBLE = 1e-3
"""Fraction of M that is added to every Q_k before its logarithm is interpolated: in the shadow it falls without end."""
DARKEST_TERM = 1e-3
"""Light of a wavelength, of that of the brightest one, below which it does not count in the error of a sky."""
AIR, ABSORPTION, EXTINCTION, LOW, HIGH = range(5)
"""Rows of `Air.depth`: scattering by air, absorption by gases, extinction by aerosol, its scattering below and above
12 km."""


class Air(NamedTuple):
    """Air at W wavelengths in the L layers between ALTITUDE_KM, with K aerosols.

    depth (5, L, W): vertical optical depths, rows AIR to HIGH; aerosol_depth (K, L, W): of scattering by each aerosol
    degree (W,): to which phase functions are followed, 12 to 16; a fraction stands between two
    moments (K, W, 401): Legendre moments of the phase functions, the first is 1
    mixed_moments (2, W, 18), mixed_phase (2, W, 6): of the mean phase functions below and above 12 km; their
        integral of 2 pi P12 sin^3, and ln P at ANGLES_DEG
    log_phase, polarising (K, N, W): ln P [sr^-1] and P12 / P at angles pi (n / (N - 1))^2
    depolarisation, ground_albedo, ground_refractivity (W,)
    refractivity (SUBLAYERS L + 1,): n - 1 at the boundaries of the parts of layers; radius_km: of the ground
    """

    depth: np.ndarray
    aerosol_depth: np.ndarray
    degree: np.ndarray
    moments: np.ndarray
    mixed_moments: np.ndarray
    mixed_phase: np.ndarray
    log_phase: np.ndarray
    polarising: np.ndarray
    depolarisation: np.ndarray
    ground_albedo: np.ndarray
    ground_refractivity: np.ndarray
    refractivity: np.ndarray
    radius_km: float = EARTH_RADIUS_KM

    def towards(self, direction: Air) -> Air:
        """The same air with an imaginary part of STEP times a direction, for derivatives of light along it."""
        arrays = {key: getattr(self, key) + 1j * STEP * getattr(direction, key) for key in Air._fields[:-2]}
        return self._replace(**arrays)

    def peaks(self, moments: np.ndarray) -> np.ndarray:
        """Fraction of phase functions in their forward peaks (..., W): the moment after the last that is followed."""
        whole = self.degree.real.astype(int)
        rest, row = self.degree - whole, np.arange(whole.size)
        after = moments[:, row, np.minimum(whole + 2, MOST_DEGREE + 1)]
        return np.clip((1.0 - rest) * moments[:, row, whole + 1] + rest * after, 0.0, 0.999)

    def inputs(self, observer_km: float) -> np.ndarray:
        """Inputs of the network that name the air, (W, F)."""
        d, f = self.depth, self.peaks(self.mixed_moments)
        absorbed = np.maximum(d[EXTINCTION] - d[LOW] - d[HIGH], 0.0)
        particles = (1.0 - f[0]) * d[LOW] + (1.0 - f[1]) * d[HIGH]
        total = d[AIR] + d[ABSORPTION] + d[EXTINCTION] - f[0] * d[LOW] - f[1] * d[HIGH]  # extinction without peaks
        every, n = tuple(range(SLAB_KM.size)), self.degree.size

        def slabs(depth: np.ndarray, some: tuple[int, ...]) -> np.ndarray:
            place = np.abs(ALTITUDE_KM[None] - SLAB_KM[list(some), None]).argmin(axis=1)
            return np.diff(_summed(depth)[place], axis=0)

        def below(depth: np.ndarray) -> np.ndarray:
            k = int(np.clip(np.searchsorted(ALTITUDE_KM, observer_km) - 1, 0, ALTITUDE_KM.size - 2))
            part = (observer_km - ALTITUDE_KM[k]) / (ALTITUDE_KM[k + 1] - ALTITUDE_KM[k])
            return (_summed(depth)[k] + part * depth[k])[None]

        sums = [d[AIR].sum(axis=0), total.sum(axis=0), d[ABSORPTION].sum(axis=0) + 1e-4, particles.sum(axis=0) + 1e-4]
        sums += [absorbed.sum(axis=0) + 1e-4, ((1.0 - f[1]) * d[HIGH]).sum(axis=0) + 1e-5]
        rows = [np.sqrt(np.maximum(slabs(particles, every), 0.0))]
        rows += [np.sqrt(np.maximum(slabs(absorbed, ABSORPTION_SLABS), 0.0))]
        rows += [np.sqrt(np.maximum(slabs(d[ABSORPTION], every), 0.0)), np.log(slabs(d[AIR], COARSE_SLABS))]
        rows.append(np.log(sums))
        for k, phase in enumerate(self.mixed_phase):
            scaled = (self.mixed_moments[k] - f[k][:, None]) / (1.0 - f[k][:, None])
            rows += [scaled[:, MOMENTS].T, phase[:, :1].T, f[k][None], phase[:, 1:].T]
        rows += [self.ground_albedo[None], 1e4 * self.ground_refractivity[None]]
        rows += [np.full((1, n), observer_km), np.full((1, n), np.sqrt(observer_km))]
        rows += [below(total), np.sqrt(below(d[AIR])), np.sqrt(below(particles))]
        return np.concatenate(rows).T


def _summed(depth: np.ndarray) -> np.ndarray:
    """Optical depths (..., L + 1, W) below the boundaries of layers, from those of the layers (..., L, W)."""
    return np.concatenate([np.zeros_like(depth[..., :1, :]), np.cumsum(depth, axis=-2)], axis=-2)


@dataclass(frozen=True)
class Model:
    """What the file holds (above); members: for each network its layers, as (weights (I, O), offsets (O,))."""

    members: tuple[tuple[tuple[np.ndarray, np.ndarray], ...], ...]
    segments: np.ndarray
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
        return _single(np.clip(inputs, -OUTERMOST, OUTERMOST))

    def at_nodes(self, air: np.ndarray, log_base: np.ndarray) -> np.ndarray:
        """ln(M / M_0), Q / M, U / M and the spread of ln M at the nodes, (4, W, suns, elevations, azimuths)."""
        inputs = self.standardised(air, log_base)
        each = np.array([_outputs(layers, inputs) for layers in self.members])
        c, k = each.mean(axis=0), self.intensity.shape[0]
        spread = np.sqrt(np.mean([((one - c).real[:, :k] @ self.intensity) ** 2 for one in each], axis=0))
        polarisation = self.polarisation_mean + c[:, k:] @ self.polarisation
        parts = (self.intensity_mean + c[:, :k] @ self.intensity, *np.split(polarisation, 2, axis=1), spread)
        return np.stack([part.reshape(inputs.shape[0], *NODES) for part in parts])


def _outputs(layers: tuple, hidden: np.ndarray) -> np.ndarray:
    """Outputs (W, K + N) of a network for standardised inputs (W, F)."""
    for n, (weights, offsets) in enumerate(layers[:-1]):
        linear = hidden @ weights + offsets
        active = linear / (1.0 + np.exp(-linear))
        hidden = active + hidden if n else active
    return hidden @ layers[-1][0] + layers[-1][1]


def _single(x: np.ndarray) -> np.ndarray:
    """In single precision, real or complex."""
    return x.astype(np.complex64 if np.iscomplexobj(x) else np.float32, copy=False)


class Beams(NamedTuple):
    """Geometry of shells: rays from the sun to each boundary, R in all, those to boundary k from start[k] on.

    zenith_rad, apparent_rad (R,): true and apparent solar zenith angles; log_factor (R,): ln of the beam's spreading
    path_km (R, L): ways in the layers
    """

    start: np.ndarray
    zenith_rad: np.ndarray
    apparent_rad: np.ndarray
    log_factor: np.ndarray
    path_km: np.ndarray


def sublayers(boundary_km: np.ndarray) -> np.ndarray:
    """Boundaries of the equal parts of layers (L + 1,), (SUBLAYERS L + 1,)."""
    part = np.arange(SUBLAYERS) / SUBLAYERS
    low, high = boundary_km[:-1, None], boundary_km[1:, None]
    return np.append((low + part * (high - low)).ravel(), boundary_km[-1])


def _through_layers(
    x: np.ndarray, slope: np.ndarray, index: np.ndarray, b: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Path [km] and angle at the Earth's centre [rad] of rays in each layer, (B, L), on one side of their lowest point:
    s = sqrt(x^2 - b^2) / (dx/dr), phi = n arccos(b / x) / (dx/dr), b (B,) = n r sin(zenith angle) being Bouguer's
    invariant [km] and x = n r, linear in r."""
    b = b[:, None]
    beyond = np.maximum(x[None], b)
    path = np.diff(np.sqrt(np.maximum(beyond * beyond - b * b, 0.0)), axis=1) / slope
    angle = np.diff(np.arccos(np.minimum(b / beyond, 1.0)), axis=1) * (index / slope)
    shape = (len(b), -1, SUBLAYERS)
    return path.reshape(shape).sum(axis=2), angle.reshape(shape).sum(axis=2)


@functools.lru_cache(maxsize=8)
def _parts(boundary: bytes, refractivity: bytes, radius_km: float) -> tuple[np.ndarray, ...]:
    """n, n r [km] at the boundaries of parts of layers, d(n r)/d r and mean n of the parts."""
    n, radius = 1.0 + np.frombuffer(refractivity), radius_km + sublayers(np.frombuffer(boundary))
    return n, n * radius, np.diff(n * radius) / np.diff(radius), 0.5 * (n[1:] + n[:-1])


@functools.lru_cache(maxsize=512)
def _rays_to(k: int, boundary: bytes, refractivity: bytes, radius_km: float) -> tuple[np.ndarray, ...]:
    """Rays from the sun to boundary k: true and apparent zenith angles, ln of the spreading, ways in layers (R, L)."""
    n, x, slope, index = _parts(boundary, refractivity, radius_km)
    edge, right, m, j = x[::SUBLAYERS], 0.5 * np.pi, RAYS_FROM_BELOW // 4, SUBLAYERS * k
    apparent = np.append(right - np.radians(np.geomspace(STEEPEST_DEG, 90.0, RAYS_FROM_ABOVE)[::-1]), right)
    down = apparent.size
    if k:
        even, grazing = np.linspace(0.0, 1.0, 3 * m + 1)[1:], 1.0 - np.geomspace(1e-4, 0.5, m)
        below = right + np.arccos(edge[0] / edge[k]) * np.unique(np.concatenate([even, grazing]))
        apparent = np.concatenate([apparent, below])
    b = edge[k] * np.sin(apparent)
    path, angle = np.zeros((2, apparent.size, edge.size - 1))
    if j < slope.size:
        path[:down, k:], angle[:down, k:] = _through_layers(x[j:], slope[j:], index[j:], b[:down])
    if k:
        path[down:], angle[down:] = _through_layers(x, slope, index, b[down:])
        path[down:, :k] *= 2.0  # layers below the point twice, down and up again
        angle[down:, :k] *= 2.0
    true = angle.sum(axis=1) + np.arcsin(np.minimum(b / edge[-1], 1.0))
    spread, sine = np.maximum(np.gradient(true, apparent), LEAST_SPREAD), np.sin(apparent)
    factor = n[j] ** 2 * sine / np.maximum(np.sin(true), 1e-9) / spread
    factor[sine < 1e-6] = 1.0
    return true, apparent, np.log(factor), path


@functools.lru_cache(maxsize=8)
def _beams(boundary: bytes, refractivity: bytes, radius_km: float) -> Beams:
    rows = [_rays_to(k, boundary, refractivity, radius_km) for k in range(np.frombuffer(boundary).size)]
    start = np.cumsum([0, *(row[0].size for row in rows)])
    return Beams(start, *(np.concatenate(part) for part in zip(*rows, strict=True)))


class Line(NamedTuple):
    """Lines of sight (E,) through the layers above the observer: way [km] (E, K), angle from the observer at the
    Earth's centre (E, K + 1) [rad] and optical depth (E, K + 1, W) at each boundary."""

    path: np.ndarray
    angle: np.ndarray
    depth: np.ndarray

    def zenith(self, sun_deg: np.ndarray | float, azimuth_deg: np.ndarray, middle: bool = False) -> np.ndarray:
        """True solar zenith angles [rad] at boundaries, or in the middle of layers, (suns, E, A, K + 1)."""
        sun = np.radians(90.0 - np.atleast_1d(sun_deg))[:, None, None, None]
        angle = 0.5 * (self.angle[:, 1:] + self.angle[:, :-1]) if middle else self.angle
        aside = np.sin(angle)[:, None] * np.cos(np.radians(azimuth_deg))[:, None]
        return np.arccos(np.clip(np.cos(angle)[:, None] * np.cos(sun) + aside * np.sin(sun), -1.0, 1.0))


class Shells:
    """Light scattered once in refracting spherical shells, for one observer, by closed forms.

    The sunbeam at a point is exp(-tau) n^2 sin(i) / (sin(chi) d chi / d i), i the apparent and chi the true solar
    zenith angle, tabulated for each altitude over chi.  Along a line of sight ln(transmittance x sunbeam) is linear in
    each layer, in its part outside the shadow of the ground.

    boundary_km (L + 1,): altitudes above the ground, the observer's among them; extinction, peak (L, W), scattering
    (S, L, W) [km^-1]: without scattering in forward peaks, that in peaks, and of each of S kinds; refractivity
    (SUBLAYERS L + 1,); screen: what dims the sunbeam beyond the horizon, and the powers (W,) of its T
    """

    def __init__(
        self,
        boundary_km: np.ndarray,
        extinction: np.ndarray,
        scattering: np.ndarray,
        peak: np.ndarray,
        refractivity: np.ndarray,
        observer_km: float = 0.0,
        radius_km: float = EARTH_RADIUS_KM,
        screen: tuple[Screen, np.ndarray] | None = None,
    ):
        self.boundary_km, self.extinction, self.scattering, self.peak = boundary_km, extinction, scattering, peak
        self.screen = screen
        self.first = int(np.argmin(np.abs(boundary_km - observer_km)))
        parts = (np.asarray(boundary_km, float).tobytes(), np.asarray(refractivity, float).tobytes())
        self._geometry = (*parts, float(radius_km))

    @functools.cached_property
    def beams(self) -> Beams:
        """All sunbeams, computed when they are first asked for."""
        return _beams(*self._geometry)

    @functools.cached_property
    def _tables(self) -> tuple[np.ndarray, np.ndarray]:
        """Zenith angles that go on rising from boundary to boundary, (R,), and -ln of the sunbeams, (R, W)."""
        b = self.beams
        key = b.zenith_rad + 4.0 * np.repeat(np.arange(self.boundary_km.size), np.diff(b.start))
        depth = b.path_km @ self.extinction - b.log_factor[:, None]
        if self.screen is not None:
            screen, powers = self.screen
            depth -= np.log(np.maximum(screen.at(self._least_km(screen)), DARKEST_PASSED))[:, None] * powers
        return key, depth

    def _least_km(self, screen: Screen) -> np.ndarray:
        """Least altitudes (R,) of the sunbeams on the part of their way that counts for a screen [km]."""
        b, x = self.beams, _parts(*self._geometry)[1]
        at_end = np.repeat(x[::SUBLAYERS], np.diff(b.start))
        near, far = (at_end * np.cos(b.apparent_rad) + s for s in (screen.from_km, screen.to_km))
        along = np.where(near > 0.0, near, np.where(far < 0.0, far, 0.0))
        highest = np.maximum.accumulate(x)
        return np.interp(np.hypot(at_end * np.sin(b.apparent_rad), along), highest, sublayers(self.boundary_km))

    def _place(self, k: Any, zenith_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The ray before each zenith angle at boundaries k, and the part of the way to the next, 0 to 1."""
        b = self.beams
        i = np.searchsorted(self._tables[0], zenith_rad + 4.0 * k) - 1
        i = np.minimum(np.maximum(i, b.start[k]), b.start[np.asarray(k) + 1] - 2)
        f = (zenith_rad - b.zenith_rad[i]) / (b.zenith_rad[i + 1] - b.zenith_rad[i])
        return i, np.minimum(np.maximum(f, 0.0), 1.0)

    def log_sunbeam(self, k: Any, zenith_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ln of the sunbeam over F0 at boundaries k for true solar zenith angles (...,), (..., W), and how far these
        are from the shadow of the ground [rad]: negative within it, where the logarithm is that at its edge."""
        i, f = self._place(k, zenith_rad)
        depth = self._tables[1]
        here = depth[i]
        out = (here - depth[i + 1]) * f[..., None] - here
        return np.maximum(out, DARK_LOG), self.beams.zenith_rad[self.beams.start[np.asarray(k) + 1] - 1] - zenith_rad

    def apparent_elevation_deg(self, sun_elevation_deg: float) -> float:
        """Apparent elevation [deg] of a sun of true elevation; of one in the shadow as far above it as at its edge."""
        true, apparent = _rays_to(self.first, *self._geometry)[:2]
        lifted = np.interp(np.radians(90.0 - sun_elevation_deg), true, true - apparent)
        return sun_elevation_deg + float(np.degrees(lifted))

    def line(self, elevation_deg: np.ndarray) -> Line:
        """Lines of sight (E,), by their apparent elevations [deg]."""
        j, (_, x, slope, index) = SUBLAYERS * self.first, _parts(*self._geometry)
        invariant = x[j] * np.cos(np.radians(elevation_deg))
        path, angle = _through_layers(x[j:], slope[j:], index[j:], invariant)
        depth = _summed(path[:, :, None] * self.extinction[self.first :])
        return Line(path, np.concatenate([np.zeros((len(path), 1)), np.cumsum(angle, axis=1)], axis=1), depth)

    def sunlit(self, zenith: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Transmittance x sunbeam in layers (E, A, K, W), from zenith angles (E, A, K + 1) and depths (E, K + 1, W)."""
        logs, edge = self.log_sunbeam(np.arange(self.first, self.boundary_km.size), zenith)
        logs = np.maximum(logs - depth[:, None], DARK_LOG)
        return log_mean(logs[:, :, :-1], logs[:, :, 1:]) * lit_fraction(edge[:, :, :-1], edge[:, :, 1:])[..., None]

    def scattered_once(self, sun_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Integrals of scattering coefficient x transmittance x sunbeam along lines of sight, (S, E, A, W); times phase
        functions [sr^-1] they are light scattered once, L / F0."""
        line = self.line(elevation_deg)
        return self.integrated(line, self.sunlit(line.zenith(sun_deg, azimuth_deg)[0], line.depth))

    def integrated(self, line: Line, mean: np.ndarray) -> np.ndarray:
        """Sums of scattering (S, E, A, W) along lines of sight, of light in layers (E, A, K, W)."""
        weight = line.path[None, :, :, None] * self.scattering[:, None, self.first :]
        return np.einsum("sekw,eakw->seaw", weight, mean, optimize=True)


def log_mean(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Mean of an exponential between two points, from its logarithms at both."""
    drop, a, b = first - last, np.exp(first), np.exp(last)
    small = np.abs(drop) < 1e-3
    return np.where(small, 0.5 * (a + b), (a - b) / np.where(small, 1.0, drop))


def lit_fraction(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Fraction of a segment outside a shadow, from the distances of its ends to the edge, which are negative within."""
    low, high = np.minimum(first, last), np.maximum(first, last)
    return np.clip(high / np.maximum(high - low, 1e-12), 0.0, 1.0) * (high > 0.0)


def _log_reference(zenith_deg: np.ndarray) -> np.ndarray:
    """About the logarithm of the light of the sky over that of day, by which diffuse light is interpolated."""
    beyond = np.maximum(np.asarray(zenith_deg, float) - DECAY_DEG, 0.0)
    return -np.where(beyond < 8.0, DECAY * beyond**2 / 16.0, DECAY * (beyond - 4.0))


class Exchange(NamedTuple):
    """How the rays from one layer bring light to it from all layers: P pairs of zenith angles (chi, chi') of each layer
    that they cross, in order of layers.

    groups: for each layer, the first and after the last of its n segments in the order of `_exchanges`, and operators
        (P, ORDERS n) of them: the mean over azimuths of P_l(ray . sun) x linear interpolation from chi' to the part's
        own angles; and the same times cos(azimuth)
    columns, rows (P,): indices of (layer, chi') and of chi of each pair; starts: of the pairs of each (layer, chi)
    """

    groups: list[tuple[int, int, np.ndarray, np.ndarray]]
    columns: np.ndarray
    rows: np.ndarray
    starts: np.ndarray

    def summed(self, factors: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Light (C, ..., W) that factors (P, ..., W) make of light ((L + 1) C, W)."""
        here = light[self.columns].reshape(-1, *[1] * (factors.ndim - 2), light.shape[-1])
        rows = np.add.reduceat(factors * here, self.starts, axis=0)
        return rows.reshape(-1, ZENITH_DEG.size, *rows.shape[1:]).sum(axis=0)


@functools.lru_cache(maxsize=2)
def _exchanges(segments: bytes) -> tuple[np.ndarray, list[Exchange]]:
    """Segments in order of the layers that rays start from and cross, (N,); and for each layer that rays start from,
    from the lowest up, the ground last."""
    table = np.frombuffer(segments).reshape(6, -1)
    sequence = np.lexsort((table[1], table[0]))
    count, azimuth = ZENITH_DEG.size, np.cos((np.arange(AZIMUTHS) + 0.5) * np.pi / AZIMUTHS)
    chi, at_nodes = np.radians(ZENITH_DEG)[:, None, None], np.exp(-_log_reference(ZENITH_DEG))
    out: list[Exchange] = []
    for k in range(BOUNDARY_KM.size):
        before, after = np.searchsorted(table[0, sequence], [k, k + 1])
        own = sequence[before:after]
        layer, (phi, mu) = table[1, own].astype(int), table[3:5, own, None]
        local = np.cos(chi) * np.cos(phi) + np.sin(chi) * np.sin(phi) * azimuth
        zenith = np.minimum(np.degrees(np.arccos(np.clip(local, -1.0, 1.0))), ZENITH_DEG[-1] - 1e-6)  # C N A
        toward_sun = mu * np.cos(chi) + np.sqrt(1.0 - mu * mu) * np.sin(chi) * azimuth
        below = np.clip(np.searchsorted(ZENITH_DEG, zenith, side="right") - 1, 0, count - 2)
        f = (zenith - ZENITH_DEG[below]) / (ZENITH_DEG[below + 1] - ZENITH_DEG[below])
        reference = np.exp(_log_reference(zenith)) / AZIMUTHS
        parts = np.stack([(1.0 - f) * reference * at_nodes[below], f * reference * at_nodes[below + 1]])
        # pairs: where any segment of the layer has a part in them
        place = (layer[:, None] * count + np.arange(count)[:, None, None]) * count + np.stack([below, below + 1])
        number = np.zeros(BOUNDARY_KM.size * count * count, int)
        number[place] = 1
        used = np.flatnonzero(number)
        number[used] = np.arange(used.size)
        columns = used // count**2 * count + used % count
        # operators of each layer in a row: its pairs times its segments
        layers, segment, own_layer = np.unique(layer, return_index=True, return_inverse=True)
        edges = np.append(segment, own.size)
        bounds = np.searchsorted(used, np.append(layers, BOUNDARY_KM.size) * count**2)
        sizes = np.diff(edges)
        base = np.concatenate([[0], np.cumsum(np.diff(bounds) * sizes)])
        shift = (base[:-1] - bounds[:-1] * sizes)[own_layer] + np.arange(own.size) - segment[own_layer]
        index = (number[place] * sizes[own_layer][:, None] + shift[:, None]).ravel()
        rows, x = np.empty((2, ORDERS, base[-1]), np.float32), toward_sun
        for order, series in enumerate((np.ones_like(x), x, 1.5 * x * x - 0.5, (2.5 * x * x - 1.5) * x)):
            for n, by in enumerate((series, series * azimuth)):
                rows[n, order] = np.bincount(index, (parts * by).ravel(), minlength=base[-1])
        groups: list[tuple[int, int, np.ndarray, np.ndarray]] = []
        for n, (i, j) in enumerate(pairwise(edges)):
            some = rows[:, :, base[n] : base[n + 1]].reshape(2, ORDERS, -1, j - i)
            upright, turned = np.swapaxes(some, 1, 2).reshape(2, -1, ORDERS * (j - i))
            groups.append((before + i, before + j, upright, turned))
        starts = np.searchsorted(used // count, np.unique(used // count))
        out.append(Exchange(groups, columns, used // count % count, starts))
    return sequence, out


def _positive(first: np.ndarray, further: np.ndarray) -> np.ndarray:
    """The sum of the first term of a series, at least 0, and further ones; never negative, without a kink."""
    ratio = further / np.maximum(first, 1e-35)
    return first * np.where(ratio.real > 0.0, 1.0 + ratio, np.exp(np.minimum(ratio, 0.0)))


def _factors(group: tuple, every: np.ndarray, aside: np.ndarray, sources: np.ndarray, out: np.ndarray) -> None:
    """Sums over the segments of one layer, operators times weights of the segments, into out (P, 7 W)."""
    first, last, upright, turned = group
    n, w = last - first, aside.shape[1]
    here = sources[:, :, first:last].reshape(3, ORDERS * n, w)

    def times(operators: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return (operators @ weights.view(np.float32)).view(weights.dtype)

    both = times(upright[:, :n], every[first:last])
    out[:, : 2 * w], out[:, 3 * w : 4 * w] = both[:, : 2 * w], both[:, 2 * w :]
    out[:, 2 * w : 3 * w] = times(turned[:, :n], aside[first:last])
    out[:, 4 * w : 5 * w] = times(upright[:, n:], here[0, n:])
    out[:, 5 * w : 6 * w], out[:, 6 * w :] = times(upright, here[1]), times(turned, here[2])


class Skies:
    """The skies of an air seen by one observer, under every sun; observer_km: above the ground, 0 to 15."""

    def __init__(self, model: Model, air: Air, observer_km: float = 0.0):
        self.model, self.air = model, air
        boundary = ALTITUDE_KM
        if np.abs(boundary - observer_km).min() > 1e-4:
            boundary = np.sort(np.append(boundary, observer_km))
        layer = np.searchsorted(ALTITUDE_KM, 0.5 * (boundary[1:] + boundary[:-1])) - 1
        per_km, d, of_aerosols = 1.0 / np.diff(ALTITUDE_KM)[:, None], air.depth, air.aerosol_depth
        self.peak_fraction = air.peaks(air.moments)
        peak = np.einsum("kw,klw->lw", self.peak_fraction, of_aerosols)
        asymmetry = np.einsum("kw,klw->lw", air.moments[:, :, 1] - self.peak_fraction, of_aerosols)
        ln = np.interp(sublayers(boundary), sublayers(ALTITUDE_KM), np.log(air.refractivity))
        self.shells = Shells(
            boundary,
            ((d[AIR] + d[ABSORPTION] + d[EXTINCTION] - peak) * per_km)[layer],
            (np.concatenate([d[AIR][None], of_aerosols]) * per_km)[:, layer],
            (peak * per_km)[layer],
            np.exp(ln) if boundary is not ALTITUDE_KM else air.refractivity,
            observer_km,
            air.radius_km,
        )
        self._peak_depth = self.shells.beams.path_km @ self.shells.peak
        self._scattering = ((d[AIR] + of_aerosols.sum(axis=0) - peak) * per_km)[layer][self.shells.first :]
        self._forward = _single(
            (3.0 * asymmetry * per_km)[layer][self.shells.first :] / np.maximum(self._scattering, 1e-30)
        )
        self.nodes = self.shells.line(ELEVATION_DEG)
        self._diffuse = self._diffuse_light()
        self.inputs, self.log_base = air.inputs(observer_km), self._log_base()
        *fitted, self._spread = model.at_nodes(self.inputs, self.log_base)
        self._fitted, self._taken = np.array(fitted), np.zeros(SUN_DEG.size)

    def behind(self, screen: Screen, powers: np.ndarray) -> Skies:
        """The same behind a screen, whose altitudes are above the ground and whose T has these powers (W,): every Q_k
        and M_0 are of the sunbeam that passes, and M / M_0 is that of the whole one."""
        made, made.shells = copy.copy(self), copy.copy(self.shells)
        made.shells.screen = screen, powers
        made.shells.__dict__.pop("_tables")
        made._diffuse = made._diffuse_light()
        taken = (self.log_base - made._log_base()).real.reshape(len(powers), SUN_DEG.size, -1)
        made._taken = np.percentile(taken, 95, axis=(0, 2))
        return made

    def lowest_spared_deg(self, screen: Screen) -> float:
        """Sun elevation [deg] from which on a screen takes nothing (0.1 %) of a sky: `SPARED_DEG` above the highest one
        whose beams it dims anywhere."""
        dims = screen.at(self.shells._least_km(screen)) < 1.0
        first = self.shells.beams.zenith_rad[dims].min(initial=np.pi)
        return 90.0 - float(np.degrees(first)) + SPARED_DEG

    def _coefficients(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the layers between BOUNDARY_KM, by the similarity rule: extinction [km^-1], albedo (L, W); and (2 l + 1) x
        moment l of what scatters the sunbeam x its coefficient, over scattering, (ORDERS, L, W)."""
        air, rho = self.air, self.air.depolarisation
        place = np.searchsorted(ALTITUDE_KM, BOUNDARY_KM - 1e-9)
        d = np.diff(_summed(np.concatenate([air.depth, air.aerosol_depth]))[:, place], axis=1)
        of_aerosols, moments = d[len(air.depth) :], air.moments
        forwards = np.einsum("kw,klw->lw", moments[:, :, 1], of_aerosols)
        scattering = d[AIR] + of_aerosols.sum(axis=0) - forwards
        extinction = d[AIR] + d[ABSORPTION] + d[EXTINCTION] - forwards
        of_air = [np.ones_like(rho), np.zeros_like(rho), (1.0 - rho) / (5.0 * (2.0 + rho)), np.zeros_like(rho)]
        first = []
        for order in range(ORDERS):
            of_aerosol = np.einsum("kw,klw->lw", moments[:, :, order] - self.peak_fraction, of_aerosols)
            first.append((2 * order + 1) * (of_air[order] * d[AIR] + of_aerosol) / scattering)
        return extinction / np.diff(BOUNDARY_KM)[:, None], scattering / extinction, np.array(first)

    def _diffuse_light(self) -> np.ndarray:
        """Light scattered at least once, over F0, in layers between BOUNDARY_KM at ZENITH_DEG, (3, L, C, W): its mean
        intensity J, and V, the mean of its radiance times the direction it comes from, upwards and towards the sun.

            J_next(z, chi) = sum_rays w sum_segments T (1 - exp(-tau)) albedo sum_chi' G(chi, chi') J(z', chi')
        """
        extinction, albedo, phases = self._coefficients()
        zenith = np.radians(ZENITH_DEG)
        places = np.array([int(np.argmin(np.abs(self.shells.boundary_km - z))) for z in BOUNDARY_KM])
        beam, edge = self.shells.log_sunbeam(places[:, None], zenith)
        direct = log_mean(beam[:-1], beam[1:]) * lit_fraction(edge[:-1], edge[1:])[..., None]  # L C W
        on_ground = np.maximum(np.cos(zenith), 0.0) * (edge[0] > 0.0)
        layer = self.model.segments[1].astype(int)
        length, _, cosine, weight = self.model.segments[2:].astype(float)
        top = layer == BOUNDARY_KM.size - 1
        clear = np.zeros((1, extinction.shape[1]))
        depth = np.where(top[:, None], 60.0, np.concatenate([extinction, clear])[layer] * length[:, None])
        passed, ray = np.cumsum(depth, axis=0) - depth, np.cumsum(weight > 0.0) - 1
        passed -= passed[weight > 0.0][ray]
        reaches = np.exp(-passed) * -np.expm1(-depth) * np.concatenate([albedo, clear + 1.0])[layer]
        order, exchanges = _exchanges(self.model.segments.astype(float).tobytes())
        reaches = _single(reaches * weight[weight > 0.0][ray, None])[order]
        up, layer = cosine.astype(np.float32)[order, None], layer[order]
        aside, n = reaches * np.sqrt(1.0 - up * up), reaches.shape[1]
        ground_alone = np.eye(ORDERS)[:, :1, None] * np.ones(n)  # (ORDERS, 1, W)
        of_order = _single(np.concatenate([phases, ground_alone], axis=1))[:, layer]  # ORDERS N W
        every = np.concatenate([reaches, reaches * up, of_order[0] * reaches], axis=1)
        sources = np.stack([of_order * part for part in (reaches, reaches * up, aside)])
        ground = self.air.ground_albedo / np.pi * np.exp(beam[0]) * on_ground[:, None]
        light = _single(np.concatenate([direct / (4.0 * np.pi), ground[None]])).reshape(-1, n)
        first: list[np.ndarray] = []
        vector: list[list[np.ndarray]] = []
        flows, factors, pairs = list(first), list(first), list(first)
        for k, one in enumerate(exchanges):
            made, place = np.empty((one.columns.size, 7 * n), reaches.dtype), 0
            for group in one.groups:
                _factors(group, every, aside, sources, made[place : place + len(group[2])])
                place += len(group[2])
            made = made.reshape(len(made), 7, n)  # of any order: J, V upwards, aside; of the first: J in two parts, V
            zeroth, further, *flow = np.moveaxis(one.summed(made[:, 3:], light), 1, 0)
            first.append(_positive(zeroth, further))
            vector.append(flow)
            flows.append(np.ascontiguousarray(made[:, 1:3]))
            factors.append(made[:, 0].T.copy())
            pairs.append((k * ZENITH_DEG.size + one.rows) * len(light) + one.columns)
        now = np.array(first)
        now[-1] *= self.air.ground_albedo
        total = self._later_orders(np.concatenate(factors, axis=1), np.concatenate(pairs), now.reshape(-1, n))
        more = [one.summed(f, total) for one, f in zip(exchanges, flows, strict=True)]
        directed = np.moveaxis(np.array(vector), 1, 0) + np.moveaxis(np.array(more), 2, 0)
        return np.concatenate([total.reshape(1, *now.shape), directed])[:, :-1]

    def _later_orders(self, factors: np.ndarray, pairs: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Light of all orders ((L + 1) C, W) from the first one, by factors (W, P) at pairs in ((L + 1) C)^2."""
        out, count = np.empty_like(first), len(first)
        for w, albedo in enumerate(self.air.ground_albedo):
            matrix = np.zeros(count * count, factors.dtype)
            matrix[pairs] = factors[w]
            matrix = matrix.reshape(count, count)
            matrix[-ZENITH_DEG.size :] *= _single(np.asarray(albedo))
            now = total = np.ascontiguousarray(first[:, w])
            for _ in range(SCATTERINGS - 1):
                before, now = now, matrix @ now
                total = total + now
            ratio = np.clip(now / np.maximum(before, 1e-30), 0.0, MOST_RATIO)
            out[:, w] = total + now * ratio / (1.0 - ratio)
        return out

    def base_at(
        self, sun_deg: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, line: Line
    ) -> np.ndarray:
        """M_0 under suns (S,) in directions, (S, E, A, W): the last scattering has its direction, J + 3 g V.e."""
        extinction = self.shells.extinction[self.shells.first :]
        inside = line.path[:, :, None] * extinction
        seen = np.where(
            np.abs(inside) > 1e-6, -np.expm1(-inside) / np.maximum(extinction, 1e-30), line.path[:, :, None]
        )
        weight = np.exp(-line.depth[:, :-1]) * seen * self._scattering
        zenith = line.zenith(sun_deg, azimuth_deg, middle=True)
        degrees = np.minimum(np.degrees(zenith), ZENITH_DEG[-1] - 1e-6)
        k = np.clip(np.searchsorted(ZENITH_DEG, degrees, side="right") - 1, 0, ZENITH_DEG.size - 2)
        f = ((degrees - ZENITH_DEG[k]) / (ZENITH_DEG[k + 1] - ZENITH_DEG[k]))[..., None].astype(np.float32)
        scaled = _single(self._diffuse * np.exp(-_log_reference(ZENITH_DEG))[:, None])
        middle = 0.5 * (self.shells.boundary_km[1:] + self.shells.boundary_km[:-1])[self.shells.first :]
        layer = np.searchsorted(BOUNDARY_KM, middle) - 1
        mean, up, aside = (part[layer, k] * (1.0 - f) + part[layer, k + 1] * f for part in scaled)
        sun, elevation = np.radians(90.0 - np.atleast_1d(sun_deg))[:, None, None], np.radians(elevation_deg)[:, None]
        upwards = np.sin(elevation + 0.5 * (line.angle[:, 1:] + line.angle[:, :-1]))[:, None]
        from_sun = np.cos(sun) * np.sin(elevation) + np.sin(sun) * np.cos(elevation) * np.cos(np.radians(azimuth_deg))
        towards = (from_sun[..., None] - np.cos(zenith) * upwards) / np.maximum(np.sin(zenith), 1e-3)
        further = up * upwards[..., None].astype(np.float32) + aside * towards[..., None].astype(np.float32)
        source = _positive(mean, self._forward * further) * np.exp(_log_reference(degrees))[..., None]
        return np.maximum(np.einsum("ekw,seakw->seaw", weight, source, optimize=True), DARK)

    def _log_base(self) -> np.ndarray:
        """ln M_0 under all suns, an input of the network, (W, B)."""
        line = self.shells.line(BASE_ELEVATION_DEG)
        light = np.log(self.base_at(SUN_DEG, BASE_ELEVATION_DEG, BASE_AZIMUTH_DEG, line))
        return light.reshape(-1, light.shape[-1]).T

    def sky(self, sun_elevation_deg: float) -> Sky:
        """The sky under one sun, from -18 to 90 deg."""
        air, shells, line = self.air, self.shells, self.nodes
        weight = splines(SUN_DEG, np.array([sun_elevation_deg]))[0]
        log_ratio, *polarised = np.einsum("s,pwsea->peaw", weight, self._fitted)
        base = self.base_at(np.array([sun_elevation_deg]), ELEVATION_DEG, AZIMUTH_DEG, line)[0]
        multiple = np.log(base) + log_ratio
        mean = shells.sunlit(line.zenith(sun_elevation_deg, AZIMUTH_DEG)[0], line.depth)
        single = np.log(np.maximum(shells.integrated(line, mean), DARK) + NEGLIGIBLE * np.exp(multiple))
        peaks = self._widened(sun_elevation_deg, mean[:, 0]) if len(air.aerosol_depth) else None
        apparent = shells.apparent_elevation_deg(sun_elevation_deg)
        sky = Sky(apparent, air, np.concatenate([multiple[None], single]), np.array(polarised), peaks)
        light = sky.light(ELEVATION_DEG, AZIMUTH_DEG, widen=False).real[..., 0, :]
        spread = np.abs(np.einsum("s,wsea->eaw", weight, self._spread)) * np.exp(multiple.real) / light
        # terms of bands of gases that let no light through have no part in the sky
        brightest = light.max(axis=(0, 1))
        counted = spread[..., brightest > DARKEST_TERM * brightest.max()]
        least, times, taken = (np.interp(sun_elevation_deg, SUN_DEG, row) for row in (*self.model.error, self._taken))
        error = least + times * np.percentile(counted, 95)
        return sky._replace(relative_error=float(np.hypot(error, SCREEN_ERROR * taken)))

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
        return x[..., 0], np.swapaxes(_single(series) @ _legendre_terms().T, -1, -2)

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
        multiple, *single = np.exp(_interpolated(self.logarithms, rows, even, on_grid))
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
        stokes = [multiple + sum(phase * q for phase, q in zip([phases[0], *widened], single, strict=True))]
        if n_stokes > 1:
            rayleigh = -3.0 / (16.0 * np.pi) * (1.0 - rho) / (1.0 + 0.5 * rho) * (1.0 - cosine[..., None] ** 2)
            polarised = rayleigh * single[0] + sum(
                phase * (ratio[i] * (1.0 - f) + ratio[i + 1] * f) * q
                for phase, ratio, q in zip(phases[1:], air.polarising, single[1:], strict=True)
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
