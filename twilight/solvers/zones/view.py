"""Lines of sight through a solved field: light scattered at least twice."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from twilight.solvers.zones.passes import LEAST, ONE, ZERO, slab
from twilight.solvers.zones.paths import LANES
from twilight.transport.lines import ANGLE

REFERENCE_TURN_RAD = math.radians(0.5)
"""Phase functions are taken with sun and ray as they are, with the sun lifted by this, and with the ray lowered by it,
and linearly between and beyond."""


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def view_multiple(
    rays_first, place, point, zenith, row_first, cos_azimuth, fine, zenith_nodes, log_mean, ratio, log_ground,
    ground_weight, ground_angle, rule_node, rule_weight, per_interval, degree, n_order, out, begin, end,
):  # fmt: skip
    """Light scattered at least twice, out (D, LANES), in directions row_first[r]..row_first[r + 1] of ray r.

    zenith: solar zenith angle at the observer [rad]; cos_azimuth (D,): of the directions from the sun.
    """
    n_fine = fine.size
    n_nodes = zenith_nodes.size
    fine_log = np.zeros((n_fine, LANES), np.float32)
    fine_wave = np.zeros((n_fine, n_order, LANES), np.float32)
    series = np.zeros(LANES, np.float32)
    ct, st = math.cos(zenith), math.sin(zenith)
    for r in range(begin, end):
        for k in range(rays_first[r], rays_first[r + 1]):
            psi = place[k, ANGLE]
            low = max(0, np.searchsorted(zenith_nodes, zenith - psi, side="right") - 1)
            high = min(n_nodes - 1, np.searchsorted(zenith_nodes, zenith + psi))
            low = min(low, n_nodes - 2)
            high = max(high, low + 1)
            slab(
                point, k, log_mean, ratio, rule_node, rule_weight, per_interval, degree, low, high, fine_log, fine_wave
            )
            strength = point.weight[k]
            highest = point.highest[k]
            cp, sp = math.cos(psi), math.sin(psi)
            for d in range(row_first[r], row_first[r + 1]):
                ahead = -sp * ct + cp * st * cos_azimuth[d]
                up = cp * ct + sp * st * cos_azimuth[d]
                across = math.sqrt(max(0.0, 1.0 - up * up))
                c = np.float32(min(1.0, max(-1.0, ahead / max(across, 1e-9))))
                angle = math.acos(min(1.0, max(-1.0, up)))
                j = min(
                    max(np.searchsorted(fine, angle, side="right") - 1, low * per_interval), high * per_interval - 1
                )
                b1 = np.float32(min(1.0, max(0.0, (angle - fine[j]) / (fine[j + 1] - fine[j]))))
                b0 = ONE - b1
                u, v = fine_wave[j], fine_wave[j + 1]
                for w in range(LANES):
                    series[w] = b0 * u[0, w] + b1 * v[0, w]
                before, here = ONE, c
                for m in range(1, highest + 1):
                    for w in range(LANES):
                        series[w] += here * (b0 * u[m, w] + b1 * v[m, w])
                    before, here = here, np.float32(2.0) * c * here - before
                for w in range(LANES):
                    mean = math.exp(b0 * fine_log[j, w] + b1 * fine_log[j + 1, w])
                    out[d, w] += strength[w] * mean * max(LEAST, series[w])
        if ground_weight[r].max() > ZERO:
            cp, sp = math.cos(ground_angle[r]), math.sin(ground_angle[r])
            for d in range(row_first[r], row_first[r + 1]):
                angle = math.acos(min(1.0, max(-1.0, cp * ct + sp * st * cos_azimuth[d])))
                j = min(max(np.searchsorted(fine, angle, side="right") - 1, 0), n_fine - 2)
                b1 = np.float32(min(1.0, max(0.0, (angle - fine[j]) / (fine[j + 1] - fine[j]))))
                for w in range(LANES):
                    out[d, w] += ground_weight[r, w] * math.exp(
                        (ONE - b1) * log_ground[j, w] + b1 * log_ground[j + 1, w]
                    )
