"""Phase matrices and the planes that they refer to: how a scattering event turns Stokes vectors.

Light is (I, Q, U).  On every leg Q and U refer to a frame: d, the unit vector along which the leg looks (against the
light), the *reference* e normal to d, and f = e x d.  Light that vibrates along cos(chi) e + sin(chi) f has
Q = I cos(2 chi), U = I sin(2 chi).  No vertical plane enters, so nothing happens at the zenith or towards the sun.

An event between the leg d and the next leg d' has the scattering angle cos(Theta) = d . d'.  The plane of d and d'
meets the plane normal to d along d' - cos(Theta) d, at the angle phi from e, where

    cos(2 phi) = (a^2 - b^2) / (a^2 + b^2),  sin(2 phi) = 2 a b / (a^2 + b^2),  a = d' . e,  b = d' . f.

With the reference of the next leg in the scattering plane, e' ~ cos(Theta) d' - d, light (I', Q', U') that arrives
along the next leg leaves as

    I = P11 I' + P12 Q',   q = P12 I' + P22 Q',   u = P33 U';
    Q = cos(2 phi) q - sin(2 phi) u,   U = sin(2 phi) q + cos(2 phi) u.

Circular polarisation is left out: P34 turns U into V, and V acts on Q and U in a further event only.

Arguments that kernels share: `kernel`.
"""

from __future__ import annotations

import math

from twilight.jit.kernels import njit
from twilight.numerics.phase import aerosol_matrix, rayleigh_matrix
from twilight.solvers.montecarlo.kernel import INNER

N_STOKES = 3
"""Stokes parameters of light: I, Q, U."""


@njit(inner=True, **INNER)
def species_matrix(air, w, c, cosine):
    """(P11, P12, P22, P33) [sr^-1] of a species.

    c: its number, 0 being air; cosine: of the scattering angle.
    """
    if c == 0:
        return rayleigh_matrix(cosine, air.depolarisation[w])
    k = c - 1
    return aerosol_matrix(
        air.phase_kind[k], air.phase_asymmetry[k, w], air.phase_log_table[k, w], air.phase_ratios[k, :, w], cosine
    )


@njit(inner=True, **INNER)
def species_polarising(air, w, c, cosine):
    """(P11, P12) [sr^-1] of a species: what becomes of unpolarised light.

    c, cosine: as in `species_matrix`.
    """
    p11, p12, _, _ = species_matrix(air, w, c, cosine)
    return p11, p12


@njit(inline="always", **INNER)
def double_angle(a, b):
    """(cos 2 phi, sin 2 phi) of the direction with the components (a, b) along e and f; (1, 0) for none."""
    h = a * a + b * b
    if h < 1e-30:
        return 1.0, 0.0
    return (a * a - b * b) / h, 2.0 * a * b / h


@njit(inline="always", **INNER)
def components(e, d, x, y, z):
    """(v . e, v . f) of a vector v = (x, y, z), where f = e x d; e (3,), d (3,): unit vectors normal to one another."""
    a = e[0] * x + e[1] * y + e[2] * z
    b = (e[1] * d[2] - e[2] * d[1]) * x + (e[2] * d[0] - e[0] * d[2]) * y + (e[0] * d[1] - e[1] * d[0]) * z
    return a, b


@njit(inner=True, **INNER)
def any_normal(d, e):
    """Write some unit vector normal to the unit vector d (3,) into e (3,)."""
    if abs(d[2]) < 0.9:
        h = 1.0 / math.sqrt(d[0] * d[0] + d[1] * d[1])
        e[0], e[1], e[2] = -d[1] * h, d[0] * h, 0.0
    else:
        h = 1.0 / math.sqrt(d[0] * d[0] + d[2] * d[2])
        e[0], e[1], e[2] = -d[2] * h, 0.0, d[0] * h


@njit(inner=True, **INNER)
def next_reference(d, e, new, out):
    """Write into out (3,) the reference of the leg `new` after the leg d with the reference e, all (3,)."""
    cosine = d[0] * new[0] + d[1] * new[1] + d[2] * new[2]
    x = cosine * new[0] - d[0]
    y = cosine * new[1] - d[1]
    z = cosine * new[2] - d[2]
    h = x * x + y * y + z * z
    if h < 1e-20:
        # straight on or straight back: no plane is set apart, so the old reference stays
        cosine = e[0] * new[0] + e[1] * new[1] + e[2] * new[2]
        x, y, z = e[0] - cosine * new[0], e[1] - cosine * new[1], e[2] - cosine * new[2]
        h = x * x + y * y + z * z
    h = 1.0 / math.sqrt(h)
    out[0], out[1], out[2] = x * h, y * h, z * h


@njit(**INNER)
def scatter(matrix, cos_2phi, sin_2phi, m12, m22, m33, out):
    """Multiply the rows of a path's matrix by one event's; returns the new upper left element, out (9,) divided by it.

    matrix (9,): the product so far, row by row; it takes the light of the present leg to the observer's.  (cos_2phi,
    sin_2phi): of the angle between the leg's reference and the scattering plane; m12, m22, m33: elements of the phase
    matrix over P11.

    Divided by the first element, no element of a product of phase matrices is beyond 2, so that the weight of a path
    says all of its size.
    """
    for k in range(N_STOKES):
        i, q, u = matrix[3 * k], matrix[3 * k + 1], matrix[3 * k + 2]
        along = q * cos_2phi + u * sin_2phi
        across = u * cos_2phi - q * sin_2phi
        out[3 * k] = i + along * m12
        out[3 * k + 1] = i * m12 + along * m22
        out[3 * k + 2] = across * m33
    first = out[0]
    if first > 0.0:
        for k in range(9):
            out[k] /= first
    return first


@njit(inner=True, **INNER)
def depolarise(out, matrix):
    """Write into out (9,) a path's matrix (9,) after a Lambertian ground, which forgets how the light vibrated."""
    for k in range(N_STOKES):
        out[3 * k] = matrix[3 * k]
        out[3 * k + 1] = 0.0
        out[3 * k + 2] = 0.0
