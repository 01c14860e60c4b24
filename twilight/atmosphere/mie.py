"""Optics of a population of spheres by Mie theory, cached on disk.

Efficiencies and scattering functions are sums over the Mie coefficients a_n, b_n of each radius (``coefficients``); for
many radii and angles these sums are matrix products, with
S1 +- S2 = sum_n (2n+1)/(n(n+1)) (a_n +- b_n) (pi_n +- tau_n)   (Bohren & Huffman 1983, sec. 4.4).
With p = S1 + S2 and m = S1 - S2 the elements of the scattering matrix (their eq. 4.77) are
4 S11 = |p|^2 + |m|^2,   2 S12 = -Re(p m*),   4 S33 = |p|^2 - |m|^2,   2 S34 = Im(p m*).
"""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from twilight.atmosphere import shipped_optics
from twilight.base import cache
from twilight.numerics.phase import TABLE, PhaseFunction, table_angles_rad

METHOD_VERSION = 3
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

SPECTRAL_STEP = 0.025
"""Largest step in the logarithm of the wavelength over which optics are interpolated."""

INDEX_ERROR = 3e-4
"""Largest error of the real part of the refractive index over such a step."""

ABSORPTION_ERROR = 2e-3
"""Largest relative error of its imaginary part over such a step, where that is above some 1e-6."""

_EXTRA_ORDERS = 25.0
"""Orders above the last one needed, plus 1.5 sqrt(argument), at which downward recurrences begin: double precision."""


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


def n_terms(x):
    """Terms of the Mie series at size parameters x; Wiscombe 1980, Appl. Opt. 19, 1505."""
    return (x + 4.05 * np.cbrt(x) + 2.0).astype(np.int64)


def coefficients(m: complex, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mie coefficients a_n, b_n of spheres, n = 1..N, each (R, N), 0 beyond the terms of a sphere.

    With D_n = psi_n'(m x)/psi_n(m x), xi = psi + i chi of x, and u_n = (D_n/m + n/x) psi_n - psi_{n-1},
        a_n* = u_n / ((D_n/m + n/x) xi_n - xi_{n-1}),    b_n* with D_n m in place of D_n/m
    (Bohren & Huffman 1983, eq. 4.88).  D and psi come by downward, chi by upward recurrence.  Beside miepython within
    1e-10 of the largest coefficient for x from 0.01 on, and 1e-9 at sharp resonances of large clear spheres, where the
    error is miepython's.

    m: n - i k; x: (R,), size parameters that ascend.
    """
    terms = n_terms(x)
    last = int(terms[-1])
    inverse_x, inverse_z = 1.0 / x, 1.0 / (m * x)

    def begins(argument: np.ndarray) -> np.ndarray:
        """The first sphere (n_max + 1,) that takes part in a downward recurrence at order n."""
        at = (np.maximum(terms, argument) + _EXTRA_ORDERS + 1.5 * np.sqrt(argument)).astype(np.int64)
        return np.searchsorted(at, np.arange(at[-1] + 1))

    psi = np.empty((last + 1, x.size))
    above, current = np.zeros(x.size), np.full(x.size, 1e-50)
    first = begins(x)
    for n in range(first.size - 1, 0, -1):
        i = first[n]
        above[i:], current[i:] = current[i:], (2 * n + 1) * inverse_x[i:] * current[i:] - above[i:]
        if n <= last + 1:
            psi[n - 1] = current
    sine, cosine = np.sin(x), np.cos(x)
    psi_1 = sine * inverse_x - cosine
    psi *= np.where(np.abs(sine) > np.abs(psi_1), sine / psi[0], psi_1 / psi[1])  # they are not both small

    derivative = np.empty((last, x.size), dtype=complex)
    d = np.zeros(x.size, dtype=complex)
    first = begins(np.abs(m * x))
    for n in range(first.size - 1, 1, -1):
        i = first[n]
        ratio = n * inverse_z[i:]
        d[i:] = ratio - 1.0 / (d[i:] + ratio)
        if n <= last + 1:
            derivative[n - 2] = d

    chi = np.zeros((last + 1, x.size))
    chi[0], chi[1] = cosine, cosine * inverse_x + sine
    first = np.searchsorted(terms, np.arange(last + 1))
    for n in range(1, last):
        i = first[n + 1]
        chi[n + 1, i:] = (2 * n + 1) * inverse_x[i:] * chi[n, i:] - chi[n - 1, i:]

    orders = np.arange(1, last + 1)[:, None]
    beyond = orders > terms
    a_and_b = []
    for factor in (derivative * (1.0 / m), derivative * m):  # in place: what is allocated anew costs most here
        factor += orders * inverse_x
        upper = factor * psi[1:]
        upper -= psi[:-1]
        factor *= chi[1:]
        factor -= chi[:-1]
        factor *= 1j
        factor += upper
        factor[beyond] = np.inf
        upper /= factor
        a_and_b.append(np.conj(upper, out=upper).T)
    return a_and_b[0], a_and_b[1]


def compute_optics(size: SizeDistribution, index: complex, wavelength_nm: float) -> np.ndarray:
    """Extinction, scattering [km^-1 per cm^-3], asymmetry, and at the table's angles ln P11, P12/P11, P33/P11, P34/P11.

    One array (ROW,).

    index: n + i k with k of either sign; k is taken as absorption.
    """
    wavelength_um = wavelength_nm * 1e-3
    wavenumber = 2.0 * math.pi / wavelength_um
    m = complex(index.real, -abs(index.imag))
    radii, weights = radius_grid(size, m, wavelength_um)
    most = int(n_terms(wavenumber * radii[-1]))
    plus, minus = _angular_functions(128 * 2 ** max(0, math.ceil(math.log2(most / 128))))
    extinction = scattering = forward = 0.0
    intensity, difference, cross, twist = np.zeros((4, N_ANGLES))
    for start in range(0, radii.size, _GROUP):
        group = slice(start, start + _GROUP)
        a, b = coefficients(m, wavenumber * radii[group])
        length, w = a.shape[1], weights[group]
        n = np.arange(1, length + 1)
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
    """Optics of a population at W wavelengths [nm], with the refractive index (W,) of the particles in air.

    Of at least twice as many wavelengths as there are `spectral_nodes` those between the nodes are interpolated: ln
    extinction, ln scattering, ln P11 and the rest go linearly with the logarithm of the wavelength.  In the middle of a
    step OPAC's ten mixtures are then within 4e-4 (extinction), 7e-5 (albedo) and 3e-4 (asymmetry) of computed ones;
    P11 at 95 % of the angles within 3e-4 on continents, 2e-3 in desert and the Arctic, 5e-3 over the sea, where
    computed ones 4 nm apart scatter by 3e-3, for their radii sample ripples.
    """
    wavelengths = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
    indices = np.broadcast_to(np.asarray(index, dtype=complex), wavelengths.shape)
    nodes = spectral_nodes(indices, wavelengths)
    if 2 * nodes.size > wavelengths.size:
        nodes = np.arange(wavelengths.size)
    table = np.stack([_row(size, complex(indices[i]), float(wavelengths[i])) for i in nodes])
    if nodes.size < wavelengths.size:
        at = np.interp(np.log(wavelengths), np.log(wavelengths[nodes]), np.arange(nodes.size))
        lower = np.minimum(at.astype(np.int64), nodes.size - 2)
        part = (at - lower)[:, None]
        table[:, :2] = np.log(table[:, :2])
        table = (1.0 - part) * table[lower] + part * table[lower + 1]
        table[:, :2] = np.exp(table[:, :2])
    p11, p12, p33, p34 = table[:, 3:].reshape(-1, 4, N_ANGLES).transpose(1, 0, 2)
    return ParticleOptics(table[:, 0], table[:, 1], table[:, 2], p11, np.stack([p12, np.ones_like(p12), p33, p34]))


def spectral_nodes(index: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    """Which of some wavelengths (W,) [nm] are so close that optics are nearly linear between them: indices, ascending.

    Neighbours are within SPECTRAL_STEP, and the refractive index (W,) is linear between them within INDEX_ERROR
    and ABSORPTION_ERROR.
    All wavelengths where they do not ascend.
    """
    if np.any(np.diff(wavelength_nm) <= 0.0):
        return np.arange(wavelength_nm.size)
    nodes, at = [0], np.log(wavelength_nm)
    while nodes[-1] < at.size - 1:
        i = nodes[-1]
        j = max(i + 1, int(np.searchsorted(at, at[i] + SPECTRAL_STEP, side="right")) - 1)
        while j > i + 1:
            straight = index[i] + (index[j] - index[i]) * (at[i:j] - at[i]) / (at[j] - at[i])
            off, k = straight - index[i:j], np.abs(index[i:j].imag)
            if np.abs(off.real).max() <= INDEX_ERROR and np.all(np.abs(off.imag) <= ABSORPTION_ERROR * k + 1e-6):
                break
            j -= 1
        nodes.append(j)
    return np.array(nodes)


def _row(size: SizeDistribution, index: complex, wavelength_nm: float) -> np.ndarray:
    """What `compute_optics` gives (ROW,): shipped, from the cache, or computed now."""
    key = cache_key(size, index, wavelength_nm)
    row = shipped_optics.load().get(key)
    if row is None:
        row = (cache.read_arrays(cache.OPTICS, key) or {}).get("row")
    if row is None or row.shape != (ROW,):
        row = compute_optics(size, index, wavelength_nm)
        cache.store_arrays(cache.OPTICS, key, {"row": row})
    return row


def cache_key(size: SizeDistribution, index: complex, wavelength_nm: float) -> str:
    """Hash of everything that enters one row of results; numbers count to 12 digits."""
    numbers = (*size.numbers, index.real, abs(index.imag), wavelength_nm)
    method = (METHOD_VERSION, N_ANGLES, _NEGLIGIBLE, _NODES_PER_PANEL, _PANELS_ABSORBING, _PANELS_CLEAR, _CLEAR_BELOW)
    text = " ".join(f"{x:.12e}" for x in numbers) + f" {method}"
    return hashlib.sha256(text.encode()).hexdigest()
