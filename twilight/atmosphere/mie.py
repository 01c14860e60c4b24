"""Optics of a population of spheres by Mie theory (miepython), cached on disk.

The Mie coefficients a_n, b_n of each radius come from ``miepython.coefficients``.  Efficiencies and scattering
functions are sums over them; for many radii and angles these sums are matrix products, with
S1 +- S2 = sum_n (2n+1)/(n(n+1)) (a_n +- b_n) (pi_n +- tau_n)   (Bohren & Huffman 1983, sec. 4.4).
With p = S1 + S2 and m = S1 - S2 the elements of the scattering matrix (their eq. 4.77) are
4 S11 = |p|^2 + |m|^2,   2 S12 = -Re(p m*),   4 S33 = |p|^2 - |m|^2,   2 S34 = Im(p m*).
"""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata

import numpy as np

from twilight.atmosphere import shipped_optics
from twilight.base import cache
from twilight.numerics.phase import TABLE, PhaseFunction, table_angles_rad

METHOD_VERSION = 2
"""Part of every cache key; to be raised with any change of this file that moves a number."""

N_ANGLES = 513
"""Nodes of the tabulated phase functions, dense in the forward peak."""

ROW = 3 + 4 * N_ANGLES
"""Numbers per population and wavelength: extinction, scattering, asymmetry, ln P11, and P12, P33, P34 over P11."""

RATIO_STEP = 1.0 / shipped_optics.RATIO_SCALE
"""Ratios of matrix elements are rounded to this, as they ship: 3e-5 at most, and so a computed row is a shipped one."""

_NEGLIGIBLE = 1e-6
"""Radii that carry less than this part of the largest r^2 n(r) min(1, x) are left out."""

_NODES_PER_PANEL = 4
"""Gauss-Legendre nodes of a panel in ln r."""

_PANELS_ABSORBING = ((1.0, 0.40), (10.0, 0.10), (math.inf, 0.05))
"""Size parameters, and the width of the panels in ln r up to each: optics are smooth below 1 and ripple above."""

_PANELS_CLEAR = ((1.0, 0.40), (10.0, 0.10), (math.inf, 0.02))
"""The panels for particles that hardly absorb: only a fine grid averages out their resonances.

Extinction is then good to about 1e-3.
"""

_CLEAR_BELOW = 1e-3
"""Imaginary part of the index below which a particle counts as not absorbing."""

_GROUP = 96
"""Radii per matrix product."""

_JIT_FROM_SECONDS = 4.0
"""Estimated work of one population from which miepython's compiled kernels are loaded: twenty times faster, but 3 s to
load, and 20 s of compilation once per machine.  Eight wavelengths of land aerosol stay below, of sea salt are above."""


@dataclass(frozen=True)
class LogNormal:
    """dN/dln r = N/(sqrt(2 pi) ln sigma) exp(-(ln r/median)^2/(2 ln^2 sigma)) between two radii [um].

    The number N that it is multiplied with is that of the whole distribution, cut or not, as in OPAC.
    """

    median_radius_um: float
    sigma: float
    min_radius_um: float
    max_radius_um: float

    @property
    def numbers(self) -> tuple[float, ...]:
        """All that distinguishes it from other distributions of its kind."""
        return self.median_radius_um, self.sigma, self.min_radius_um, self.max_radius_um

    @property
    def ln_width(self) -> float:
        """Standard deviation of ln r."""
        return math.log(self.sigma)

    @property
    def ln_span(self) -> tuple[float, float]:
        """Of ln r [um], beyond which nothing matters."""
        ln_sigma, ln_median = self.ln_width, math.log(self.median_radius_um)
        return (
            max(math.log(self.min_radius_um), ln_median - 12.0 * ln_sigma),
            min(math.log(self.max_radius_um), ln_median + 12.0 * ln_sigma + 3.0 * ln_sigma**2),
        )

    def ln_shape(self, ln_r: np.ndarray) -> np.ndarray:
        """ln(dN/dln r) but for a constant."""
        return -0.5 * ((ln_r - math.log(self.median_radius_um)) / self.ln_width) ** 2

    def density(self, ln_r: np.ndarray) -> np.ndarray:
        """dN/dln r for N = 1."""
        return np.exp(self.ln_shape(ln_r)) / (math.sqrt(2 * math.pi) * self.ln_width)


@dataclass(frozen=True)
class Gamma:
    """dN/dln r = N x^p exp(-x) / Gamma(p), x = r/(a b), p = 1/b - 2: effective radius a [um], effective variance b.

    Hansen & Travis 1974, Space Sci. Rev. 16, 527, eq. 2.56; 0 < b < 1/2.
    """

    effective_radius_um: float
    effective_variance: float

    @property
    def numbers(self) -> tuple[float, ...]:
        """All that distinguishes it from other distributions of its kind."""
        return self.effective_radius_um, self.effective_variance

    @property
    def ln_width(self) -> float:
        """About the standard deviation of ln r."""
        return math.sqrt(self.effective_variance)

    @property
    def ln_span(self) -> tuple[float, float]:
        """Of ln r [um], beyond which nothing matters."""
        middle = math.log(self.effective_radius_um)
        return middle - 12.0 * self.ln_width, middle + 5.0

    def ln_shape(self, ln_r: np.ndarray) -> np.ndarray:
        """ln(dN/dln r) but for a constant."""
        ln_x = ln_r - math.log(self.effective_radius_um * self.effective_variance)
        return (1.0 / self.effective_variance - 2.0) * ln_x - np.exp(ln_x)

    def density(self, ln_r: np.ndarray) -> np.ndarray:
        """dN/dln r for N = 1."""
        return np.exp(self.ln_shape(ln_r) - math.lgamma(1.0 / self.effective_variance - 2.0))


SizeDistribution = LogNormal | Gamma


@dataclass(frozen=True)
class ParticleOptics:
    """Optics of one particle per cm^3 at W wavelengths.

    extinction_per_km, scattering_per_km: (W,), km^-1 per (particle cm^-3), that is 1e-5 cm^2 of cross section.
    asymmetry: (W,), mean cosine from the Mie coefficients.
    log_phase: (W, N_ANGLES), ln p [sr^-1] at ``table_angles_rad(N_ANGLES)``; its integral over the sphere is 1.
    ratios: (4, W, N_ANGLES), P12, P22 (1 for spheres), P33 and P34 over P11 = p, to 1.5e-5; P34 with the sign of
        Bohren & Huffman, whose V is positive for right-handed light.
    """

    extinction_per_km: np.ndarray
    scattering_per_km: np.ndarray
    asymmetry: np.ndarray
    log_phase: np.ndarray
    ratios: np.ndarray


def radius_grid(size: SizeDistribution, index: complex, wavelength_um: float) -> tuple[np.ndarray, np.ndarray]:
    """Radii [um] and weights with sum_i w_i f(r_i) = integral of f dN for N = 1, over the radii that matter."""
    panels = _PANELS_CLEAR if abs(index.imag) < _CLEAR_BELOW else _PANELS_ABSORBING
    wavenumber = 2.0 * math.pi / wavelength_um
    u = np.linspace(*size.ln_span, 2001)
    importance = 2 * u + size.ln_shape(u) + np.minimum(0.0, u + math.log(wavenumber))
    included = u[importance >= importance.max() + math.log(_NEGLIGIBLE)]
    lower, last = float(included[0]), float(included[-1])
    x, w = np.polynomial.legendre.leggauss(_NODES_PER_PANEL)
    nodes, weights = [], []
    for up_to, width in panels:
        upper = min(last, math.log(up_to / wavenumber)) if math.isfinite(up_to) else last
        if upper <= lower:
            continue
        edges = np.linspace(lower, upper, math.ceil((upper - lower) / min(width, size.ln_width)) + 1)
        half = 0.5 * np.diff(edges)[:, None]
        nodes.append((edges[:-1, None] + half * (1 + x)).ravel())
        weights.append((half * w).ravel())
        lower = upper
    ln_r = np.concatenate(nodes)
    return np.exp(ln_r), np.concatenate(weights) * size.density(ln_r)


@lru_cache(maxsize=4)
def _angular_functions(n_terms: int) -> tuple[np.ndarray, np.ndarray]:
    """pi_n + tau_n and pi_n - tau_n at the table's angles, each (n_terms, N_ANGLES), by upward recurrence."""
    mu = np.cos(table_angles_rad(N_ANGLES))
    plus = np.empty((n_terms, mu.size))
    minus = np.empty((n_terms, mu.size))
    before, current = np.zeros_like(mu), np.ones_like(mu)
    for n in range(1, n_terms + 1):
        tau = n * mu * current - (n + 1) * before
        plus[n - 1] = current + tau
        minus[n - 1] = current - tau
        before, current = current, ((2 * n + 1) * mu * current - (n + 1) * before) / n
    return plus, minus


def _groups(radii: np.ndarray) -> Iterator[slice]:
    for start in range(0, radii.size, _GROUP):
        yield slice(start, min(start + _GROUP, radii.size))


def compute_optics(
    size: SizeDistribution, index: complex, wavelength_nm: float, mie_coefficients: Callable | None = None
) -> np.ndarray:
    """Extinction, scattering [km^-1 per cm^-3], asymmetry, and at the table's angles ln P11, P12/P11, P33/P11, P34/P11.

    One array (ROW,).

    index: n + i k with k of either sign; k is taken as absorption.
    mie_coefficients: function (m, x) -> (a_n, b_n), None to choose by the amount of work.
    """
    wavelength_um = wavelength_nm * 1e-3
    wavenumber = 2.0 * math.pi / wavelength_um
    m = complex(index.real, -abs(index.imag))
    mie_coefficients = mie_coefficients or _mie_coefficients(_seconds(size, m, wavelength_nm))
    radii, weights = radius_grid(size, m, wavelength_um)
    n_terms = int(wavenumber * radii[-1] + 4.05 * (wavenumber * radii[-1]) ** (1 / 3) + 4)
    plus, minus = _angular_functions(128 * 2 ** max(0, math.ceil(math.log2(n_terms / 128))))
    extinction = scattering = forward = 0.0
    intensity, difference, cross, twist = np.zeros((4, N_ANGLES))
    for group in _groups(radii):
        pairs = [mie_coefficients(m, wavenumber * r) for r in radii[group]]
        length = max(a_n.size for a_n, _ in pairs)
        a, b = np.zeros((2, len(pairs), length), dtype=complex)
        for i, (a_n, b_n) in enumerate(pairs):
            a[i, : a_n.size] = a_n
            b[i, : b_n.size] = b_n
        n = np.arange(1, length + 1)
        w = weights[group]
        extinction += float(w @ ((a.real + b.real) @ (2 * n + 1)))
        scattering += float(w @ ((np.abs(a) ** 2 + np.abs(b) ** 2) @ (2 * n + 1)))
        neighbours = (a[:, :-1] * a[:, 1:].conj() + b[:, :-1] * b[:, 1:].conj()).real @ (n * (n + 2) / (n + 1))[:-1]
        own = (a * b.conj()).real @ ((2 * n + 1) / (n * (n + 1)))
        forward += float(w @ (neighbours + own))
        scale = (2 * n + 1) / (n * (n + 1))
        p, q = (a + b) * scale, (a - b) * scale
        p_real, p_imag = p.real @ plus[:length], p.imag @ plus[:length]
        q_real, q_imag = q.real @ minus[:length], q.imag @ minus[:length]
        p_square, q_square = w @ (p_real**2 + p_imag**2), w @ (q_real**2 + q_imag**2)
        intensity += p_square
        intensity += q_square
        difference += p_square - q_square
        cross += w @ (p_real * q_real + p_imag * q_imag)
        twist += w @ (p_imag * q_real - p_real * q_imag)
    if m.imag == 0.0:
        scattering = extinction
    log_phase = np.log(intensity / (4.0 * math.pi * scattering))
    moments = PhaseFunction(TABLE, np.zeros(1), log_phase[None, :]).legendre_moments(0)
    log_phase = (log_phase - math.log(moments[0, 0])).astype(np.float32).astype(float)  # as it ships: 2e-7
    to_per_km = 2.0 * math.pi / wavenumber**2 * 1e-3  # um^2 cm^-3 = 1e-8 cm^-1 = 1e-3 km^-1
    ratios = np.stack([-2.0 * cross, difference, 2.0 * twist]) / intensity
    ratios = np.round(np.clip(ratios, -1.0, 1.0) / RATIO_STEP) * RATIO_STEP
    head = [extinction * to_per_km, scattering * to_per_km, 2.0 * forward / scattering]
    return np.concatenate([head, log_phase, ratios.ravel()])


def particle_optics(size: SizeDistribution, index: Sequence[complex] | np.ndarray, wavelength_nm) -> ParticleOptics:
    """Optics of a population at W wavelengths [nm], with the refractive index (W,) of the particles in air."""
    wavelengths = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
    indices = [complex(m) for m in np.broadcast_to(np.asarray(index, dtype=complex), wavelengths.shape)]
    keys = [cache_key(size, m, w, installed_miepython()) for m, w in zip(indices, wavelengths, strict=True)]
    found = [
        cache.read_array(cache.OPTICS, key, (ROW,)) if shipped is None else shipped
        for key, shipped in zip(keys, _shipped(size, indices, wavelengths), strict=True)
    ]
    missing = [i for i, row in enumerate(found) if row is None]
    mie_coefficients = (
        _mie_coefficients(sum(_seconds(size, indices[i], wavelengths[i]) for i in missing)) if missing else None
    )
    table = np.empty((wavelengths.size, ROW))
    for i, row in enumerate(found):
        if row is None:
            row = compute_optics(size, indices[i], wavelengths[i], mie_coefficients)
            cache.store_array(cache.OPTICS, keys[i], row)
        table[i] = row
    p11, p12, p33, p34 = table[:, 3:].reshape(-1, 4, N_ANGLES).transpose(1, 0, 2)
    return ParticleOptics(table[:, 0], table[:, 1], table[:, 2], p11, np.stack([p12, np.ones_like(p12), p33, p34]))


def _shipped(size: SizeDistribution, indices: Sequence[complex], wavelengths: np.ndarray) -> list[np.ndarray | None]:
    """Rows that come with the package, None for the others."""
    table = shipped_optics.load()
    return [
        table.rows.get(cache_key(size, m, w, table.miepython_version))
        for m, w in zip(indices, wavelengths, strict=True)
    ]


@lru_cache(maxsize=1)
def installed_miepython() -> str:
    return metadata.version("miepython")


def cache_key(size: SizeDistribution, index: complex, wavelength_nm: float, miepython_version: str) -> str:
    """Hash of everything that enters one row of results; numbers count to 12 digits."""
    numbers = (*size.numbers, index.real, abs(index.imag), wavelength_nm)
    method = (METHOD_VERSION, N_ANGLES, _NEGLIGIBLE, _NODES_PER_PANEL, _PANELS_ABSORBING, _PANELS_CLEAR, _CLEAR_BELOW)
    text = " ".join(f"{x:.12e}" for x in numbers) + f" {method} miepython {miepython_version}"
    return hashlib.sha256(text.encode()).hexdigest()


def _seconds(size: SizeDistribution, index: complex, wavelength_nm: float) -> float:
    """Rough time for one wavelength without compiled kernels: 0.1 ms + 8 us per term of each radius."""
    radii, _ = radius_grid(size, index, wavelength_nm * 1e-3)
    return float(np.sum(1e-4 + 8e-6 * (2e3 * math.pi / wavelength_nm) * radii))


def _mie_coefficients(seconds: float) -> Callable:
    """The function (m, x) -> (a_n, b_n): of miepython, compiled where there is much to do, else in numpy.

    Both give the same numbers to rounding.  miepython itself chooses once, at import, by an environment variable;
    here the choice depends on the work, because loading the compiled kernels takes longer than a small job.
    """
    if seconds >= _JIT_FROM_SECONDS or "miepython.mie_jit" in sys.modules:
        from miepython import mie_jit  # start-up

        kernel = getattr(mie_jit, "_an_bn_nb", None)  # not part of miepython's public interface
        if kernel is not None:
            return lambda m, x: kernel(m, x, 0)
    import miepython  # start-up

    return miepython.coefficients
