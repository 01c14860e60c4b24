"""The ground as an event: a Lambertian surface, or water over the Lambertian light from below.

Water is that of :mod:`twilight.atmosphere.water_surface`.  Both directions of an event are those of `matrix`: the leg
looks down along d, the next leg up along `new`.

Arguments that kernels share: `kernel`.
"""

from __future__ import annotations

import math

from twilight.atmosphere.water_surface import facet_density, flat_reflectance, glitter
from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.random import uniform

FACET_FRACTION = 0.7
"""Fraction of directions after water that mirror at a facet drawn by its slope; the rest follows the cosine law."""


@njit(**INNER)
def ground_reflectance(air, w, cosine):
    """Approximate reflectance of the ground for sampling, which moves no mean.

    cosine: of the zenith angle of the leg.
    """
    if air.water_slope > 0.0:
        return min(1.0, air.ground_albedo[w] + flat_reflectance(cosine, air.water_index[w]))
    return air.ground_albedo[w]


@njit(inner=True, **INNER)
def ground_matrix(air, w, mu_in, mu_out, cosine):
    """(P11, P12, P22, P33) [sr^-1] of the ground: light (I, Q, U) sent on over the irradiance normal to a beam.

    mu_in, mu_out: cosines of the zenith angles of the light's origin and of the viewer; cosine: of the angle between d
    and `new`.
    """
    if mu_in <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    diffuse = air.ground_albedo[w] * mu_in / math.pi
    if air.water_slope <= 0.0:
        return diffuse, 0.0, 0.0, 0.0
    p11, p12, p33 = glitter(mu_in, mu_out, cosine, air.water_index[w], air.water_slope)
    return diffuse + p11, p12, p11, p33


@njit(inner=True, **INNER)
def ground_density(air, mu_in, mu_out, cosine):
    """Density [sr^-1] of the directions that `draw_ground` draws.

    mu_in, mu_out, cosine: as in `ground_matrix`.
    """
    lambertian = max(0.0, mu_in) / math.pi
    if air.water_slope <= 0.0:
        return lambertian
    return FACET_FRACTION * facet_density(mu_in, mu_out, cosine, air.water_slope) + (1.0 - FACET_FRACTION) * lambertian


@njit(inner=True, **INNER)
def draw_ground(air, frame, d, a, b, stream, out):
    """Draw a direction after the ground into out (3,).  It may point below the horizon.

    frame (3, 3): two horizontal unit vectors and the vertical; d (3,): of the leg that meets the ground; a, b: in [0,
    1), decide; stream (1,): decides whether a facet mirrors.
    """
    facet = air.water_slope > 0.0 and uniform(stream) < FACET_FRACTION
    up = 1.0 / math.sqrt(1.0 - air.water_slope * math.log(1.0 - a)) if facet else math.sqrt(a)
    level = math.sqrt(max(0.0, 1.0 - up * up))
    x, y = level * math.cos(2.0 * math.pi * b), level * math.sin(2.0 * math.pi * b)
    along = 0.0
    for m in range(3):
        out[m] = x * frame[0, m] + y * frame[1, m] + up * frame[2, m]
        along += out[m] * d[m]
    if facet:
        for m in range(3):
            out[m] = d[m] - 2.0 * along * out[m]
