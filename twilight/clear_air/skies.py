"""The skies of an air under every sun: light scattered once along lines of sight, M_0, and what the networks add."""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from .diffuse import LastScattering, diffuse_light, last_scattering, seen_along
from .model import (
    AZIMUTH_DEG,
    BASE_AZIMUTH_DEG,
    BASE_ELEVATION_DEG,
    ELEVATION_DEG,
    SUN_DEG,
    Model,
    network_inputs,
    splines,
)
from .shells import ABSORPTION, AIR, ALTITUDE_KM, DARK, EXTINCTION, Air, Line, Shells, single, sublayers
from .sky import NEGLIGIBLE, PEAK_ANGLES, Sky, azimuth_splines, elevation_splines

if TYPE_CHECKING:
    from twilight.atmosphere.screen import Screen

HALVED_KM = (6.0, 2.0)
"""Up to which layers are halved for the sunbeam, and once more: of a low sun it rises steeply below the top of haze."""


def _halved(nodes: np.ndarray, highest: float) -> np.ndarray:
    """Nodes, with the middles between those up to one."""
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    return np.unique(np.concatenate([nodes, middle[nodes[1:] <= highest]]))


SHELLS_KM = functools.reduce(_halved, HALVED_KM, ALTITUDE_KM)
"""Boundaries of shells."""
PARTS = 2
"""Parts of shells in which n r is linear; with 16 the light of twilight differs by 0.15 % at most."""
LEAST_REFRACTIVITY = 1e-30
"""Least n - 1, so that it has a logarithm."""
SCREEN_ERROR = 0.1
"""Error at 95 % of a sky, as a part of what a screen takes of ln(light): beside `zones` 0.03 in the median and 0.11 in
95 of 100 skies in which `typical` takes more than 0.02 (three airs, eleven suns, three wavelengths)."""
SPARED_DEG = 2.5
"""How far above the highest sun whose beams a screen dims anywhere it takes less than 0.1 % of any sky [deg]."""
PEAK_DEGREE = 400
"""Degree of the Legendre series of widened peaks."""
LEAST_PEAK_DEPTH = 1e-4
"""Optical depth of scattering in peaks below which they are not widened."""
MOST_PEAK_DEPTH = 60.0
"""Optical depth of scattering in peaks that counts at most: exp(-60) of the light passes, and exp(60) is a number."""
LEAST_MOMENT = 1e-9
"""Legendre moment of the scattering in peaks below which it and all beyond are none: errors of quadrature."""
SHADOWED_DEG = 2.0
"""Elevation of suns below which the shadow of the Earth crosses the sky, or its edge is near [deg]."""
FINER_ELEVATION_DEG = {False: _halved(ELEVATION_DEG, 90.0), True: _halved(_halved(ELEVATION_DEG, 90.0), 8.0)}
"""Elevations at which Q_k are computed [deg]; True: under suns below SHADOWED_DEG."""
ROWS_DEG = _halved(ELEVATION_DEG, 12.0)
"""Elevations at which M_0 is computed [deg]."""
FINER_AZIMUTH_DEG = {False: AZIMUTH_DEG, True: np.unique(np.append(AZIMUTH_DEG, _halved(AZIMUTH_DEG[3:], 180.0)))}
"""Azimuths at which Q_k are computed [deg]; True: under suns below SHADOWED_DEG."""
DARKEST_TERM = 1e-3
"""Light of a wavelength, of that of the brightest one, below which it does not count in the error of a sky."""

LEAST_SHARE = 0.5
"""Share of the estimated error without particles; by `benchmarks/clear_air.py calibrate`."""
MANY_PARTICLES = 0.1
"""Optical depth of aerosol from which on all of it is stated."""


class Skies:
    """The skies of an air seen by one observer, under every sun; observer_km: above the ground, 0 to 15; diffuse: what
    computes `diffuse_light`."""

    def __init__(
        self,
        model: Model | None,
        air: Air,
        observer_km: float = 0.0,
        diffuse: Callable[[Air, Shells], np.ndarray] = diffuse_light,
    ):
        self.model, self.air, self.observer_km, self._diffuse_light = model, air, observer_km, diffuse
        boundary = SHELLS_KM
        if np.abs(boundary - observer_km).min() > 1e-4:
            boundary = np.sort(np.append(boundary, observer_km))
        layer = np.searchsorted(ALTITUDE_KM, 0.5 * (boundary[1:] + boundary[:-1])) - 1
        per_km, d, of_aerosols = 1.0 / np.diff(ALTITUDE_KM)[:, None], air.depth, air.aerosol_depth
        self.peak_fraction = air.peaks(air.moments)
        peak = np.einsum("kw,klw->lw", self.peak_fraction, of_aerosols)
        ln = np.log(np.maximum(air.refractivity, LEAST_REFRACTIVITY))
        self.shells = Shells(
            boundary,
            ((d[AIR] + d[ABSORPTION] + d[EXTINCTION] - peak) * per_km)[layer],
            (np.concatenate([d[AIR][None], of_aerosols]) * per_km)[:, layer],
            (peak * per_km)[layer],
            np.exp(np.interp(sublayers(boundary, PARTS), sublayers(ALTITUDE_KM), ln)),
            observer_km,
            air.radius_km,
        )
        self.nodes = self.shells.line(ELEVATION_DEG)
        self._taken = np.zeros(SUN_DEG.size)
        self._lines: dict[bool, Line] = {}
        self._spared: dict[Screen, float] = {}

    @functools.cached_property
    def _diffuse(self) -> np.ndarray:
        return self._diffuse_light(self.air, self.shells)

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
        for key in ("_diffuse", "_last_scattering", "_in_rows"):
            made.__dict__.pop(key, None)
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

    @property
    def share(self) -> np.ndarray:
        """Share of the estimated error that counts at each wavelength, (W,): networks disagree by more than they are
        off where there are few particles."""
        many = np.minimum(self.air.depth[EXTINCTION].real.sum(axis=0) / MANY_PARTICLES, 1.0)
        return LEAST_SHARE + (1.0 - LEAST_SHARE) * many

    def lowest_spared_deg(self, screen: Screen) -> float:
        """Sun elevation [deg] from which on a screen takes nothing (0.1 %) of a sky: `SPARED_DEG` above the highest one
        whose beams it dims anywhere."""
        if screen not in self._spared:
            dims = screen.at(self.shells._least_km(screen)) < 1.0
            first = self.shells.beams.zenith_rad[dims].min(initial=np.pi)
            self._spared[screen] = 90.0 - float(np.degrees(first)) + SPARED_DEG
        return self._spared[screen]

    def base(self, sun_deg: np.ndarray) -> np.ndarray:
        """M_0 under suns (S,) at the nodes, (S, E, A, W)."""
        return seen_along(sun_deg, AZIMUTH_DEG, self._last_scattering)

    @functools.cached_property
    def _last_scattering(self) -> LastScattering:
        return last_scattering(self._diffuse, self.air, self.shells, self.nodes, ELEVATION_DEG)

    def _along(self, elevation_deg: np.ndarray) -> LastScattering:
        line = self.shells.line(elevation_deg)
        return last_scattering(self._diffuse, self.air, self.shells, line, elevation_deg)

    def _log_base(self) -> np.ndarray:
        light = np.log(seen_along(SUN_DEG, BASE_AZIMUTH_DEG, self._along(BASE_ELEVATION_DEG)))
        return light.reshape(-1, light.shape[-1]).T

    @functools.cached_property
    def _in_rows(self) -> LastScattering:
        return self._along(ROWS_DEG)

    def _finer(self, shadowed: bool) -> Line:
        """Lines of sight at FINER_ELEVATION_DEG, computed when they are first asked for."""
        if shadowed not in self._lines:
            self._lines[shadowed] = self.shells.line(FINER_ELEVATION_DEG[shadowed])
        return self._lines[shadowed]

    def sky(self, sun_elevation_deg: float) -> Sky:
        """The sky under one sun, from -18 to 90 deg."""
        shadowed = sun_elevation_deg < SHADOWED_DEG
        elevation, azimuth = FINER_ELEVATION_DEG[shadowed], FINER_AZIMUTH_DEG[shadowed]
        weight = splines(SUN_DEG, np.array([sun_elevation_deg]))[0]
        log_ratio, *polarised, spread = np.einsum("s,pwsea->peaw", weight, self.at_nodes)
        base = seen_along(np.array([sun_elevation_deg]), AZIMUTH_DEG, self._in_rows)[0]
        finer = np.tensordot(elevation_splines(ROWS_DEG, elevation), np.log(base), (1, 0))
        finer = finer + np.tensordot(elevation_splines(ELEVATION_DEG, elevation), log_ratio, (1, 0))
        multiple = azimuth_splines(AZIMUTH_DEG, azimuth)[0] @ finer
        integrals = self.shells.scattered_along(self._finer(shadowed), sun_elevation_deg, azimuth)
        once = np.log(np.maximum(integrals, DARK) + NEGLIGIBLE * np.exp(multiple))
        logarithms = np.concatenate([multiple[None], once])
        peaks = self._peaks_of(sun_elevation_deg)
        apparent = self.shells.apparent_elevation_deg(sun_elevation_deg)
        sky = Sky(apparent, self.air, elevation, azimuth, logarithms, np.array(polarised), peaks)
        light = sky.at_nodes().real
        spread = np.abs(spread) * np.exp(finer[np.searchsorted(elevation, ELEVATION_DEG)].real) / light
        # terms of bands of gases that let no light through have no part in the sky
        brightest = light.max(axis=(0, 1))
        bright = brightest > DARKEST_TERM * brightest.max()
        least, times, taken = (
            np.interp(sun_elevation_deg, SUN_DEG, row) for row in (*self._fitted_model.error, self._taken)
        )
        error = self.share.real[bright].mean() * (least + times * np.percentile(spread[..., bright], 95))
        return sky._replace(relative_error=float(np.hypot(error, SCREEN_ERROR * taken)))

    def single_scattering(self, sun_elevation_deg: float) -> np.ndarray:
        """Light scattered once, with what forward peaks have scattered, at the nodes: I, Q, U over F0, (E, A, 3, W)."""
        integrals = self.shells.scattered_along(self.nodes, sun_elevation_deg, AZIMUTH_DEG)
        logarithms = np.log(np.concatenate([np.zeros_like(integrals[:1]), integrals]) + DARK)
        apparent, peaks = self.shells.apparent_elevation_deg(sun_elevation_deg), self._peaks_of(sun_elevation_deg)
        none = np.zeros((2, *integrals.shape[1:]))
        sky = Sky(apparent, self.air, ELEVATION_DEG, AZIMUTH_DEG, logarithms, none, peaks)
        return sky.light(ELEVATION_DEG, AZIMUTH_DEG, 3)

    def _peaks_of(self, sun_deg: float) -> tuple[np.ndarray, np.ndarray] | None:
        """`_widened` at the nodes; None without aerosols."""
        if not len(self.air.aerosol_depth):
            return None
        zenith = self.nodes.zenith(sun_deg, np.zeros(1))[0]
        light = self.shells.sunlit(zenith, self.nodes.depth)
        return self._widened(zenith[:, 0], light[:, 0])

    def _widened(self, zenith: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Light that forward peaks have scattered more than once, at the elevations of the nodes, from light in layers
        (E, K, W) towards the sun, whose zenith angles at boundaries are (E, K + 1) [rad]: depth x (E, W) of scattering
        in peaks on its way, and what is added to exp(-x) P at PEAK_ANGLES angles, (K, E, angles, W).  With f the
        fraction in the peak and p_l its moments (1 up to the degree that is followed, chi_l / f beyond; m_l of the
        mixture), all convolutions of the peak with itself (Nakajima and Tanaka 1988, J. Quant. Spectrosc. Radiat.
        Transfer 40, 51, to all orders):

            sum_l (2 l + 1)/(4 pi) P_l [f p_l g_l + (1 - exp(-x)) (chi_l - f)],
            g_l = [exp(-x (1 - m_l)) - exp(-x)] / (x m_l) - exp(-x)
        """
        line, f = self.nodes, self.peak_fraction.T
        boundaries = np.arange(self.shells.first, self.shells.boundary_km.size)
        before = self.shells.peak_depth(boundaries, zenith)
        depth = np.swapaxes(0.5 * (before[:, :-1] + before[:, 1:]), 1, 2) + self._passed_peaks
        light = np.swapaxes(light, 1, 2)
        both = np.stack([light, light * depth], axis=2)  # E W 2 layers
        sums = line.scattered[:, :, 1:] @ np.swapaxes(both, 2, 3)
        by_kind, weighted = np.moveaxis(sums * f[..., None], -1, 0)  # E W kinds
        total = by_kind.sum(axis=-1)
        safe_total = np.where(total.real > 0.0, total, 1.0)
        x = weighted.sum(axis=-1) / safe_total
        x = np.where((total.real > 0.0) & (x.real >= LEAST_PEAK_DEPTH), x, 0.0)
        x = np.where(x.real < MOST_PEAK_DEPTH, x, MOST_PEAK_DEPTH)
        of_peaks, moments, followed, counts = self._peaks
        mixed = np.swapaxes(by_kind / safe_total[..., None], 0, 1) @ moments  # W E degrees
        power = x.T[..., None] * mixed + 1e-30  # which is never 0
        none = np.exp(-x)
        g = single((np.expm1(power) / power - 1.0) * none.T[..., None])
        rest, added = single(1.0 - none.T)[..., None], []
        for k, n in enumerate(counts):
            series = (of_peaks[:, k, None, :n] * g[..., :n]).reshape(-1, n) @ _legendre_terms()[:, :n].T
            added.append(series.reshape(*g.shape[:2], -1) + rest * followed[:, k, None])
        return x, np.stack(added).transpose(0, 2, 3, 1)

    @functools.cached_property
    def _passed_peaks(self) -> np.ndarray:
        """Depth of scattering in peaks from the observer to the middle of layers along lines of sight, (E, W, K)."""
        inside = self.nodes.path[:, None] * self.shells.peak[self.shells.first :].T
        return single(np.cumsum(inside, axis=2) - 0.5 * inside)

    @functools.cached_property
    def _peaks(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[int]]:
        """f p_l and p_l (W, K, PEAK_DEGREE + 1); at PEAK_ANGLES angles what is added in proportion to 1 - exp(-x), of
        chi_l - f, 0 beyond what is followed, (W, K, angles); and how many f p_l of each kind are not negligible."""
        f, chi = self.peak_fraction[..., None], self.air.moments
        beyond = np.arange(PEAK_DEGREE + 1) > np.ceil(self.air.degree.real)[:, None]
        # those of a peak of less than a hundredth are errors of quadrature where they are negative or above 1
        most, least = np.where(f.real > 0.01, 2.0, 1.0), np.where(f.real > 0.01, -2.0, 0.0)
        moments = np.where(beyond, np.clip(chi / np.maximum(f, 1e-6), least, most), 1.0)
        followed = single(np.where(beyond, 0.0, chi - f)) @ _legendre_terms().T
        of_peaks = single(np.where(f > 1e-6, f, 0.0) * moments)
        counts = [1 + int(np.flatnonzero((np.abs(one) > LEAST_MOMENT).any(axis=0)).max(initial=0)) for one in of_peaks]
        return of_peaks.swapaxes(0, 1), moments.swapaxes(0, 1), followed.swapaxes(0, 1), counts


@functools.cache
def _legendre_terms() -> np.ndarray:
    """(2 l + 1)/(4 pi) P_l at PEAK_ANGLES angles, (angles, l)."""
    angle = np.pi * np.linspace(0.0, 1.0, PEAK_ANGLES) ** 2
    legendre = np.polynomial.legendre.legvander(np.cos(angle), PEAK_DEGREE)
    return (legendre * (2 * np.arange(PEAK_DEGREE + 1) + 1) / (4.0 * np.pi)).astype(np.float32)
