"""Phase functions: Rayleigh with depolarisation, Henyey-Greenstein, and tables over the scattering angle.

Every function is per steradian and integrates to 1 over the sphere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

HENYEY_GREENSTEIN = 0
TABLE = 1


@njit(cache=True, inline="always")
def rayleigh_phase(cos_angle, depolarisation):
    """Rayleigh phase function [sr^-1] of air with depolarisation factor rho (0 gives 3/(16 pi)(1 + cos^2)).

    p = 3/(16 pi) * 2/(2 + rho) * ((1 + rho) + (1 - rho) cos^2), Bucholtz 1995 eq. 10-11.
    """
    return (
        3.0
        / (8.0 * math.pi * (2.0 + depolarisation))
        * ((1.0 + depolarisation) + (1.0 - depolarisation) * cos_angle * cos_angle)
    )


@njit(cache=True, inline="always")
def henyey_greenstein(cos_angle, asymmetry):
    """Henyey-Greenstein phase function [sr^-1]; Haber 2005 eq. 1.

    The denominator is written as (1-g)^2 + 2g(1-cos), which does not cancel in the forward peak.
    """
    d = (1.0 - asymmetry) * (1.0 - asymmetry) + 2.0 * asymmetry * (1.0 - cos_angle)
    return (1.0 - asymmetry * asymmetry) / (4.0 * math.pi * d * math.sqrt(d))


@njit(cache=True, inline="always")
def table_phase(cos_angle, node_scale, table):
    """Phase function from one row of :class:`PhaseTable`: linear in log(p) between nodes.

    Nodes are uniform in u = sqrt(angle / pi), which is dense where the forward peak is.
    """
    angle = math.acos(min(1.0, max(-1.0, cos_angle)))
    u = math.sqrt(angle / math.pi) * node_scale
    i = int(u)
    n = table.shape[0]
    if i >= n - 1:
        return math.exp(table[n - 1])
    f = u - i
    return math.exp(table[i] + f * (table[i + 1] - table[i]))


def table_angles_rad(n_nodes: int = 513) -> np.ndarray:
    """Scattering angles [rad] of the nodes of a table, shape (n_nodes,)."""
    return np.pi * np.linspace(0.0, 1.0, n_nodes) ** 2


@dataclass(frozen=True)
class PhaseFunction:
    """One aerosol phase function at each of W wavelengths.

    kind: ``HENYEY_GREENSTEIN`` (then ``asymmetry`` is used) or ``TABLE`` (then ``log_table`` is).
    asymmetry: (W,), the mean cosine of the scattering angle; for a table it is informative.
    log_table: (W, N), natural logarithm of p [sr^-1] at ``table_angles_rad(N)``; shape (W, 1) for Henyey-Greenstein.
    """

    kind: int
    asymmetry: np.ndarray
    log_table: np.ndarray
    name: str = ""

    @staticmethod
    def henyey_greenstein(asymmetry, name: str = "henyey-greenstein") -> PhaseFunction:
        g = np.atleast_1d(np.asarray(asymmetry, dtype=float))
        return PhaseFunction(HENYEY_GREENSTEIN, g, np.zeros((g.size, 1)), name)

    @staticmethod
    def from_samples(angle_rad, phase_per_sr, name: str = "", n_nodes: int = 513) -> PhaseFunction:
        """Resample p(angle) [sr^-1], shape (W, A), to the nodes and normalise its integral over the sphere to 1."""
        angle_rad = np.asarray(angle_rad, dtype=float)
        phase = np.atleast_2d(np.asarray(phase_per_sr, dtype=float))
        nodes = table_angles_rad(n_nodes)
        log_table = np.stack([np.interp(nodes, angle_rad, np.log(np.maximum(row, 1e-300))) for row in phase])
        raw = PhaseFunction(TABLE, np.zeros(phase.shape[0]), log_table, name)
        norm = raw.legendre_moments(1)
        log_table = log_table - np.log(norm[:, :1])
        return PhaseFunction(TABLE, norm[:, 1] / norm[:, 0], log_table, name)

    def __call__(self, cos_angle) -> np.ndarray:
        """p [sr^-1] at the cosines of scattering angles: shape (W, *cos_angle.shape)."""
        c = np.asarray(cos_angle, dtype=float)
        out = np.empty((self.asymmetry.size, c.size))
        _evaluate(self.kind, self.asymmetry, self.log_table, c.ravel(), out)
        return out.reshape((self.asymmetry.size, *c.shape))

    def legendre_moments(self, degree: int) -> np.ndarray:
        """Moments chi_l = 2 pi int p(mu) P_l(mu) dmu, l = 0..degree, shape (W, degree + 1); chi_0 = 1, chi_1 = g."""
        if self.kind == HENYEY_GREENSTEIN:
            return self.asymmetry[:, None] ** np.arange(degree + 1)[None, :]
        # Gauss-Legendre on each interval of a mesh that is uniform in u = sqrt(angle/pi), like the table itself
        x, w = np.polynomial.legendre.leggauss(4)
        n = self.log_table.shape[1] - 1
        per_interval = 1 if degree < 64 else 2
        edges = np.linspace(0.0, 1.0, n * per_interval + 1)
        u = (0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * x[None, :]).ravel()
        wu = (0.5 * np.diff(edges)[:, None] * w[None, :]).ravel()
        angle = np.pi * u**2
        mu = np.cos(angle)
        weight = 2.0 * np.pi * np.sin(angle) * (2.0 * np.pi * u) * wu
        p = self(mu)
        return (p * weight) @ np.polynomial.legendre.legvander(mu, degree)


@njit(cache=True)
def _evaluate(kind, asymmetry, log_table, cos_angle, out):
    for w in range(asymmetry.size):
        for i in range(cos_angle.size):
            out[w, i] = aerosol_phase(kind, asymmetry[w], log_table[w], cos_angle[i])


@njit(cache=True, inline="always")
def aerosol_phase(kind, asymmetry, log_table_row, cos_angle):
    """p [sr^-1] of one phase function at one wavelength: the one place where the kind is looked at."""
    if kind == HENYEY_GREENSTEIN:
        return henyey_greenstein(cos_angle, asymmetry)
    return table_phase(cos_angle, log_table_row.shape[0] - 1, log_table_row)
