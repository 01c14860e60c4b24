"""A table of sunlight for the random walk, which may be rough: `leg.trace` corrects it without bias.

The logarithm of the irradiance is tabulated bilinearly over altitude and, for a sun above the horizontal, its cosine;
for a lower sun over the height of the straight ray's lowest point above that of the ray that touches the shadow,
because the limb's features lie at nearly fixed heights there.

Arguments that kernels share: `kernel`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.air import MonteCarloAir
from twilight.solvers.montecarlo.kernel import INNER
from twilight.transport.beam import beam_at_one

N_ALTITUDE = 64
"""Steps of the root of the relative height."""
N_HIGH = 32
"""Steps of a sun above the horizontal."""
N_LOW = 128
"""Steps of a lower sun."""
COSINE_SCALE = 0.05
"""Cosine of the zenith angle below which the steps of a sun above the horizontal are dense."""
BLACK = -2000.0
"""Logarithm of irradiance / F0 that stands for the shadow."""


class SolarBeamTable(NamedTuple):
    """Tables of the direct beam over W wavelengths and A = N_ALTITUDE + 1 altitudes.

    edge_km (W, A): lowest point [km] of the straight ray that touches the shadow.
    high (W, A, N_HIGH + 1, 2), low (W, A, N_LOW + 1, 2): logarithm of irradiance / F0, and bending [rad].
    """

    bottom_km: float
    depth_km: float
    radius_km: float
    edge_km: np.ndarray
    high: np.ndarray
    low: np.ndarray


def prepare_beam_table(air: MonteCarloAir, beam) -> SolarBeamTable:
    """Tabulate a beam for the altitudes of the air."""
    n_w = air.table.shape[0]
    table = SolarBeamTable(
        float(air.shell_km[0]),
        float(air.shell_km[-1] - air.shell_km[0]),
        float(air.earth_radius_km),
        np.empty((n_w, N_ALTITUDE + 1)),
        np.empty((n_w, N_ALTITUDE + 1, N_HIGH + 1, 2), dtype=np.float32),
        np.empty((n_w, N_ALTITUDE + 1, N_LOW + 1, 2), dtype=np.float32),
    )
    in_slices(lambda a, b: _fill(beam, table, a, b), table.edge_km.size)
    return table


@njit(**INNER)
def _entry(beam, z, cosine, w, row):
    """Fill row (2,): logarithm of irradiance / F0, and bending [rad].

    z [km]: altitude; cosine: of the true sun's zenith angle there.
    """
    irradiance, bending = beam_at_one(beam, z, cosine, w)
    row[0] = math.log(irradiance) if irradiance > 1e-300 else BLACK
    row[1] = bending


@njit(cache=True, nogil=True)
def _fill(beam, table, first, end):
    """Fill rows of the table: every altitude of every wavelength is one, counted through altitudes first.

    table: `SolarBeamTable`; first, end: the first row and the one after the last.
    """
    for job in range(first, end):
        w = job // (N_ALTITUDE + 1)
        a = job % (N_ALTITUDE + 1)
        # just inside the air, so that no altitude counts as space
        z = table.bottom_km + table.depth_km * min((a / N_ALTITUDE) ** 2, 1.0 - 1e-12)
        r = table.radius_km + z
        dark = -1.0
        lit = 0.0
        for _ in range(60):
            middle = 0.5 * (dark + lit)
            irradiance, _ = beam_at_one(beam, z, middle, w)
            if irradiance > 1e-300:
                lit = middle
            else:
                dark = middle
        drop = lowest_drop(r, lit)
        table.edge_km[w, a] = z - drop
        for n in range(N_LOW + 1):
            # height above the edge's lowest point, quadratic: y = (n / N)^2 of the whole drop
            d = drop * (1.0 - (n / N_LOW) ** 2)
            sine = 1.0 - d / r
            _entry(beam, z, max(lit, -math.sqrt(max(0.0, (1.0 - sine) * (1.0 + sine)))), w, table.low[w, a, n])
        for n in range(N_HIGH + 1):
            t = n / N_HIGH
            _entry(beam, z, COSINE_SCALE * t / (1.0 + COSINE_SCALE - t), w, table.high[w, a, n])


@njit(inline="always", **INNER)
def lowest_drop(r, cosine):
    """How far [km] the lowest point of a straight line lies below a point at the radius r [km]: r (1 - sine).

    cosine: of the line's angle to the vertical at the point.
    """
    c2 = cosine * cosine
    return r * c2 / (1.0 + math.sqrt(max(0.0, 1.0 - c2)))


@njit(inner=True, **INNER)
def tabulated_beam(edge_km, high, low, radius_km, z, root, cosine):
    """(logarithm of irradiance / F0, bending [rad]) at a point of the air; BLACK in the shadow.

    edge_km (A,), high (A, N_HIGH + 1, 2), low (A, N_LOW + 1, 2): of `SolarBeamTable` at one wavelength, as arrays
    because this is the innermost loop; radius_km: of the Earth; z [km]: altitude; root: of the altitude above the
    ground over the depth of the air; cosine: of the true sun's zenith angle.
    """
    x = root * N_ALTITUDE
    a = min(int(x), N_ALTITUDE - 1)
    x = min(1.0, x - a)
    if cosine >= 0.0:
        y = cosine * (1.0 + COSINE_SCALE) / (cosine + COSINE_SCALE) * N_HIGH
        b = min(int(y), N_HIGH - 1)
        t = high
    else:
        edge = edge_km[a] * (1.0 - x) + edge_km[a + 1] * x
        height = z - lowest_drop(radius_km + z, cosine) - edge
        if height < 0.0 or edge >= z:
            return BLACK, 0.0
        y = math.sqrt(height / (z - edge)) * N_LOW
        b = min(int(y), N_LOW - 1)
        t = low
    y -= b
    w00 = (1.0 - x) * (1.0 - y)
    w01 = (1.0 - x) * y
    w10 = x * (1.0 - y)
    w11 = x * y
    light = w00 * t[a, b, 0] + w01 * t[a, b + 1, 0] + w10 * t[a + 1, b, 0] + w11 * t[a + 1, b + 1, 0]
    bending = w00 * t[a, b, 1] + w01 * t[a, b + 1, 1] + w10 * t[a + 1, b, 1] + w11 * t[a + 1, b + 1, 1]
    return light, bending
