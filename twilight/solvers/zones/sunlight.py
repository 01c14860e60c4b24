"""The direct sun beam on a grid over altitude and distance to the edge of the shadow, for the inner loops.

At every altitude the beam is tabulated by the angle to the edge of the Earth's shadow, which is where it is sharp;
interpolation is linear in its logarithm and never mixes light with shadow.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.transport.beam import Beam, beam_at, beam_on_ground, lit_at

DARK = np.float32(-690.0)
"""ln(irradiance over F0) that counts as no light."""
N_ANGLE = 1280
"""Number of intervals of the angle to the shadow's edge: 0.01 deg where light that grazes a hazy layer changes by e
within 0.05 deg."""
MIN_ROWS = 8
"""Least altitudes of the table in an interval between the field's nodes."""
MAX_STEP_KM = 0.1
"""Largest interval between altitudes of the table at the ground [km]."""
STEP_GROWTH = 0.02
"""Growth of that largest interval with height above the ground."""
BELOW_JUMP_KM = 1e-7
"""Distance [km] below a jump of the air at which the table has the jump's lower side."""


class Sunlight(NamedTuple):
    """The direct beam on a grid: altitude_km (A,), doubled at a jump of the air; edge_rad (A,): solar zenith angle of
    the shadow's edge.

    log_light (A, N_ANGLE + 1, W): logarithm of the beam's irradiance over F0 at the angle span_rad (j/N_ANGLE)^2
    inside the edge; ground (N_ANGLE + 1, W): logarithm of the irradiance on the horizontal ground.
    """

    altitude_km: np.ndarray
    edge_rad: np.ndarray
    log_light: np.ndarray
    ground: np.ndarray
    span_rad: float


@njit(cache=True, nogil=True)
def _fill(beam, altitude, span, edge, log_light, ground, begin, end):
    """Fill edge (Z,) [rad], log_light (Z, angles, W) and ground (angles, W) for the altitudes begin..end.

    beam: `Beam`; altitude (Z,) [km]; span [rad]: of the angles from the shadow's edge.
    """
    n_w = log_light.shape[2]
    light = np.empty(n_w)
    for k in range(begin, end):
        z = altitude[k]
        low, high = 0.5 * math.pi, math.pi
        for _ in range(48):
            middle = 0.5 * (low + high)
            if lit_at(beam, z, math.cos(middle)):
                low = middle
            else:
                high = middle
        edge[k] = low
        for j in range(N_ANGLE + 1):
            angle = max(0.0, low - span * (j / N_ANGLE) ** 2)
            beam_at(beam, z, math.cos(angle), light)
            for w in range(n_w):
                log_light[k, j, w] = max(DARK, math.log(max(light[w], 1e-300)))
            if k == 0:
                beam_on_ground(beam, z, math.cos(angle), light)
                for w in range(n_w):
                    ground[j, w] = max(DARK, math.log(max(light[w], 1e-300)))


def table_altitudes(node_km: np.ndarray, jumps_km: np.ndarray) -> np.ndarray:
    """Altitudes [km] of the table: MIN_ROWS in every interval of the field's nodes, more in a long one.

    Nodes crowd where the air is layered, and there the grazing beam's logarithm bends most.  A jump is doubled.
    """
    rows = []
    for a, b in pairwise(node_km):
        longest = MAX_STEP_KM + STEP_GROWTH * (a - node_km[0])
        rows.append(np.linspace(a, b, max(MIN_ROWS, math.ceil((b - a) / longest)), endpoint=False))
    # a value on a jump is the one above it: stay just below
    return np.sort(np.concatenate([*rows, jumps_km - BELOW_JUMP_KM, node_km[-1:] - BELOW_JUMP_KM]))


def make_sunlight(beam: Beam, node_km: np.ndarray, jumps_km: np.ndarray) -> Sunlight:
    """Tabulate `beam` for a field with these node altitudes, of which some are jumps of the air."""
    altitude = table_altitudes(node_km, jumps_km)
    n_w = beam.n_wavelengths
    edge = np.empty(altitude.size)
    log_light = np.empty((altitude.size, N_ANGLE + 1, n_w), np.float32)
    ground = np.empty((N_ANGLE + 1, n_w), np.float32)
    span = math.pi
    in_slices(partial(_fill, beam, altitude, span, edge, log_light, ground), altitude.size)
    return Sunlight(altitude, edge, log_light, ground, span)
