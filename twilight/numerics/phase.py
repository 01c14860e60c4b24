"""Phase functions and matrices: Rayleigh with depolarisation, Henyey-Greenstein, tables over the scattering angle.

Every phase function is per steradian and integrates to 1 over the sphere.  Its phase matrix acts on Stokes parameters
(I, Q, U) that refer to the scattering plane, Q > 0 for light that vibrates in it (Hovenier & van der Mee 1983, Astron.
Astrophys. 128, 1):
    | P11  P12   0  |
    | P12  P22   0  |
    |  0    0   P33 |
Spheres have P22 = P11.  P34, which makes circular polarisation of U, is tabulated too and used by no solver here.
Henyey-Greenstein functions say nothing about polarisation: light scattered by one is unpolarised, all but P11 is 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.jit.kernels import njit

HENYEY_GREENSTEIN, TABLE = range(2)
"""Kinds of phase function: the formula, or a table over the scattering angle."""

RATIO_P12, RATIO_P22, RATIO_P33, RATIO_P34 = range(4)
"""Rows of a table of ratios: of these elements of the phase matrix to P11."""

MAX_CACHED_DEGREE = 400
"""Largest degree of moments whose quadrature is cached: 13 MB with 513 nodes (degree 2400: 79 MB)."""


@njit(cache=True, inline="always")
def rayleigh_phase(cos_angle, depolarisation):
    """Rayleigh phase function [sr^-1] of air with depolarisation factor rho (0 gives 3/(16 pi)(1 + cos^2)).

    p = 3/(16 pi) * 2/(2 + rho) * ((1 + rho) + (1 - rho) cos^2), Bucholtz 1995 eq. 10-11; cos_angle: cosine of the
    scattering angle; depolarisation: rho.
    """
    return (
        3.0
        / (8.0 * math.pi * (2.0 + depolarisation))
        * ((1.0 + depolarisation) + (1.0 - depolarisation) * cos_angle * cos_angle)
    )


@njit(cache=True, inline="always")
def rayleigh_matrix(cos_angle, depolarisation):
    """(P11, P12, P22, P33) [sr^-1] of air with depolarisation factor rho, for natural light.

    With Delta = (1 - rho)/(1 + rho/2), 4 pi P = Delta x 3/4 (1 + c^2, -(1 - c^2), 1 + c^2, 2 c) + (1 - Delta) x (1, 0,
    0, 0): Hansen & Travis 1974, Space Sci. Rev. 16, 527, eq. 2.15; cos_angle: c; depolarisation: rho.
    """
    delta = (1.0 - depolarisation) / (1.0 + 0.5 * depolarisation)
    c = cos_angle
    part = 3.0 / (16.0 * math.pi) * delta
    p22 = part * (1.0 + c * c)
    return p22 + (1.0 - delta) / (4.0 * math.pi), -part * (1.0 - c * c), p22, 2.0 * part * c


@njit(cache=True, inline="always")
def henyey_greenstein(cos_angle, asymmetry):
    """Henyey-Greenstein phase function [sr^-1]; Haber 2005 eq. 1.

    cos_angle: cosine of the scattering angle; asymmetry: its mean g.  The denominator is written as (1-g)^2 +
    2g(1-cos), which does not cancel in the forward peak.
    """
    d = (1.0 - asymmetry) * (1.0 - asymmetry) + 2.0 * asymmetry * (1.0 - cos_angle)
    return (1.0 - asymmetry * asymmetry) / (4.0 * math.pi * d * math.sqrt(d))


@njit(cache=True, inline="always")
def table_matrix(cos_angle, log_table_row, ratios):
    """(P11, P12, P22, P33) [sr^-1] from one row of a table: log_table_row (N,) of ln P11 and ratios (4, N) to it.

    cos_angle: cosine of the scattering angle.  Nodes are uniform in u = sqrt(angle / pi), which is dense where the
    forward peak is; between them ln P11 and the ratios are linear.
    """
    n = log_table_row.shape[0]
    u = math.sqrt(math.acos(min(1.0, max(-1.0, cos_angle))) / math.pi) * (n - 1)
    i = min(int(u), n - 2)
    f = u - i
    g = 1.0 - f
    p11 = math.exp(g * log_table_row[i] + f * log_table_row[i + 1])
    return (
        p11,
        p11 * (g * ratios[RATIO_P12, i] + f * ratios[RATIO_P12, i + 1]),
        p11 * (g * ratios[RATIO_P22, i] + f * ratios[RATIO_P22, i + 1]),
        p11 * (g * ratios[RATIO_P33, i] + f * ratios[RATIO_P33, i + 1]),
    )


def table_angles_rad(n_nodes: int = 513) -> np.ndarray:
    """Scattering angles [rad] of the nodes of a table, shape (n_nodes,)."""
    return np.pi * np.linspace(0.0, 1.0, n_nodes) ** 2


@dataclass(frozen=True)
class PhaseFunction:
    """One aerosol phase function at each of W wavelengths.

    kind: ``HENYEY_GREENSTEIN`` (then ``asymmetry`` is used) or ``TABLE`` (then ``log_table`` is).
    asymmetry: (W,), the mean cosine of the scattering angle; for a table it is informative.
    log_table: (W, N), natural logarithm of p [sr^-1] at ``table_angles_rad(N)``; shape (W, 1) for Henyey-Greenstein.
    ratios: (4, W, N), of P12, P22, P33 and P34 to P11 = p at the same angles; where it is not given all are 0, as for
        Henyey-Greenstein: scattered light is then unpolarised.
    """

    kind: int
    asymmetry: np.ndarray
    log_table: np.ndarray
    name: str = ""
    ratios: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self):
        shape = (4, *self.log_table.shape)
        if self.ratios.size == 0:
            object.__setattr__(self, "ratios", np.zeros(shape))
        if self.ratios.shape != shape:
            raise TwilightError(
                f"phase function {self.name}: ratios of the phase matrix have shape {self.ratios.shape}, "
                f"expected {shape}"
            )
        p12, p22, p33, p34 = np.abs(self.ratios)
        # a tenth of a per cent beyond is rounding of whoever tabulated them
        if not np.all(np.isfinite(self.ratios)) or max(p12.max(), p22.max(), p33.max(), p34.max()) > 1.001:
            raise TwilightError(
                f"phase function {self.name}: ratios of the phase matrix to P11 must be between -1 and 1"
            )

    def select(self, wavelengths: slice | np.ndarray) -> PhaseFunction:
        """The same phase function at some of its wavelengths."""
        s = wavelengths
        return PhaseFunction(self.kind, self.asymmetry[s], self.log_table[s], self.name, self.ratios[:, s])

    @staticmethod
    def henyey_greenstein(asymmetry, name: str = "henyey-greenstein") -> PhaseFunction:
        g = np.atleast_1d(np.asarray(asymmetry, dtype=float))
        return PhaseFunction(HENYEY_GREENSTEIN, g, np.zeros((g.size, 1)), name)

    @staticmethod
    def cornette_shanks(g, name: str = "cornette-shanks") -> PhaseFunction:
        """Table of p = 3/(8 pi) (1 - g^2)(1 + mu^2) / ((2 + g^2)(1 + g^2 - 2 g mu)^1.5) at g (W,); Bruneton and Neyret
        2008 eq. 4.  Its mean cosine is not g."""
        g = np.atleast_1d(np.asarray(g, dtype=float))[:, None]
        mu = np.cos(table_angles_rad())
        shape = (1.0 - g) ** 2 + 2.0 * g * (1.0 - mu)
        p = 3.0 / (8.0 * np.pi) * (1.0 - g**2) * (1.0 + mu**2) / ((2.0 + g**2) * shape**1.5)
        return PhaseFunction.from_samples(table_angles_rad(), p, name)

    @staticmethod
    def from_samples(
        angle_rad,
        phase_per_sr,
        name: str = "",
        n_nodes: int = 513,
        *,
        p12_ratio=None,
        p22_ratio=None,
        p33_ratio=None,
        p34_ratio=None,
    ) -> PhaseFunction:
        """Resample p(angle) [sr^-1], shape (W, A), to the nodes and normalise its integral over the sphere to 1.

        p12_ratio ... p34_ratio (W, A): elements of the phase matrix over P11 = p, in [-1, 1].  P12 and P33 belong
        together; P22 is P11 where it is not given, P34 is 0.  With none of them scattered light is unpolarised.

        Errors: TwilightError for one of P12 and P33 without the other, and for a ratio beyond 1.
        """
        if (p12_ratio is None) != (p33_ratio is None) or (p12_ratio is None and not (p22_ratio is p34_ratio is None)):
            raise TwilightError(f"phase function {name}: a phase matrix needs both p12_ratio and p33_ratio")
        angle_rad = np.asarray(angle_rad, dtype=float)
        phase = np.atleast_2d(np.asarray(phase_per_sr, dtype=float))
        nodes = table_angles_rad(n_nodes)
        log_table = np.stack([np.interp(nodes, angle_rad, np.log(np.maximum(row, 1e-300))) for row in phase])
        ratios = np.zeros((4, *log_table.shape))
        if p12_ratio is not None:
            ratios[RATIO_P22] = 1.0
            for row, values in zip(ratios, (p12_ratio, p22_ratio, p33_ratio, p34_ratio), strict=True):
                if values is not None:
                    samples = np.broadcast_to(np.asarray(values, dtype=float), phase.shape)
                    row[:] = np.stack([np.interp(nodes, angle_rad, sample) for sample in samples])
        return PhaseFunction.from_log_table(log_table, name, ratios)

    @staticmethod
    def from_log_table(log_table: np.ndarray, name: str, ratios: np.ndarray) -> PhaseFunction:
        """Phase function from its logarithm (W, N) but for a constant, normalised under the table's own quadrature.

        ratios (4, W, N): as of the class.
        """
        moments = PhaseFunction(TABLE, np.zeros(log_table.shape[0]), log_table, name).legendre_moments(1)
        return PhaseFunction(TABLE, moments[:, 1] / moments[:, 0], log_table - np.log(moments[:, :1]), name, ratios)

    def __call__(self, cos_angle) -> np.ndarray:
        """p [sr^-1] at the cosines of scattering angles: shape (W, *cos_angle.shape)."""
        c = np.asarray(cos_angle, dtype=float)
        if self.kind == HENYEY_GREENSTEIN:
            g = self.asymmetry.reshape(-1, *([1] * c.ndim))
            d = (1.0 - g) ** 2 + 2.0 * g * (1.0 - c)
            return (1.0 - g * g) / (4.0 * math.pi * d * np.sqrt(d))
        i, f = self._place(c)
        return np.exp(self.log_table[:, i] * (1.0 - f) + self.log_table[:, i + 1] * f)

    def _place(self, cos_angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The node of the table below each scattering angle, and the way to the next."""
        n = self.log_table.shape[1]
        u = np.sqrt(np.arccos(np.clip(cos_angle, -1.0, 1.0)) / math.pi) * (n - 1)
        i = np.minimum(u.astype(np.int64), n - 2)
        return i, u - i

    def matrix(self, cos_angle) -> np.ndarray:
        """(P11, P12, P22, P33) [sr^-1] at the cosines of scattering angles: shape (4, W, *cos_angle.shape)."""
        c = np.asarray(cos_angle, dtype=float)
        p11 = self(c)
        if self.kind == HENYEY_GREENSTEIN:
            return np.stack([p11, *np.zeros((3, *p11.shape))])
        i, f = self._place(c)
        ratios = self.ratios[:3]
        return np.concatenate([p11[None], p11 * (ratios[:, :, i] * (1.0 - f) + ratios[:, :, i + 1] * f)])

    def legendre_moments(self, degree: int) -> np.ndarray:
        """Moments chi_l = 2 pi int p(mu) P_l(mu) dmu, l = 0..degree, shape (W, degree + 1); chi_0 = 1, chi_1 = g."""
        if self.kind == HENYEY_GREENSTEIN:
            return self.asymmetry[:, None] ** np.arange(degree + 1)[None, :]
        rule_of = _cached_moment_rule if degree <= MAX_CACHED_DEGREE else _moment_rule
        mu, rule = rule_of(self.log_table.shape[1] - 1, degree)
        return self(mu) @ rule


def _moment_rule(n: int, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Cosines mu (Q,) and weights (Q, degree + 1) that integrate 2 pi p(mu) P_l(mu) of a table of n intervals.

    Gauss-Legendre on each interval of a mesh that is uniform in u = sqrt(angle/pi), like the table itself.
    """
    x, w = np.polynomial.legendre.leggauss(4)
    intervals = n if degree < 64 else 2 * n
    edges = np.linspace(0.0, 1.0, intervals + 1)
    u = (0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * x[None, :]).ravel()
    wu = (0.5 * np.diff(edges)[:, None] * w[None, :]).ravel()
    angle = np.pi * u**2
    mu = np.cos(angle)
    weight = 2.0 * np.pi * np.sin(angle) * (2.0 * np.pi * u) * wu
    return mu, np.polynomial.legendre.legvander(mu, degree) * weight[:, None]


_cached_moment_rule = lru_cache(maxsize=4)(_moment_rule)
"""A medium has several phase functions, which need the same rules."""


class PhaseArrays(NamedTuple):
    """K phase functions at W wavelengths as arrays for kernels; rows as in `PhaseFunction`.

    kind (K,); asymmetry (K, W); log_table (K, W, N); ratios (K, 4, W, N)
    """

    kind: np.ndarray
    asymmetry: np.ndarray
    log_table: np.ndarray
    ratios: np.ndarray


def phase_arrays(phase_functions: Sequence[PhaseFunction], n_wavelengths: int) -> PhaseArrays:
    """The phase functions of one medium as arrays.  Errors: ValueError where tables of different length are mixed."""
    count = len(phase_functions)
    width = max((p.log_table.shape[1] for p in phase_functions), default=1)
    tables = np.zeros((count, n_wavelengths, width))
    ratios = np.zeros((count, 4, n_wavelengths, width))
    for k, p in enumerate(phase_functions):
        if p.log_table.shape[1] not in (1, width):
            raise ValueError("phase tables of one medium must have the same number of nodes")
        tables[k, :, : p.log_table.shape[1]] = p.log_table
        ratios[k, :, :, : p.log_table.shape[1]] = p.ratios
    kinds = np.array([p.kind for p in phase_functions], dtype=np.int64)
    asymmetry = np.array([p.asymmetry for p in phase_functions]).reshape(count, n_wavelengths)
    return PhaseArrays(kinds, asymmetry, tables, ratios)


@njit(cache=True, inline="always")
def aerosol_matrix(kind, asymmetry, log_table_row, ratios, cos_angle):
    """(P11, P12, P22, P33) [sr^-1] of one phase function at one wavelength.

    kind: HENYEY_GREENSTEIN, with `asymmetry`, or TABLE, with log_table_row (N,) of ln p and the ratios (4, N) of the
    elements to P11; cos_angle: cosine of the scattering angle.
    """
    if kind == HENYEY_GREENSTEIN:
        return henyey_greenstein(cos_angle, asymmetry), 0.0, 0.0, 0.0
    return table_matrix(cos_angle, log_table_row, ratios)
