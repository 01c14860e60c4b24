"""What every kernel of the walk uses: how it is compiled, its arguments, random numbers, Stokes vectors.

Arguments that kernels share.  air: `air.MonteCarloAir`; at: `air.MonochromaticAir`; sun: `sunlight.SolarBeam`; beam:
`transport.beam.Beam`; importance: `importance.ImportanceTables`; walk: `paths.WalkOptions`; options: `leg.LegOptions`;
leg: `leg.Leg`; totals: `leg.LegTotals`; memory: `paths.PathMemory`; work: `events.DirectionWorkspace`; w: index of the
wavelength; stream (1,): state of a stream of random numbers, moved on by every draw; to_sun (3,): unit vector to the
true sun, in the Cartesian frame of the point or ray; ray (9,), chord (9,): columns named in `rays`; event
(EVENT_COLUMNS,): columns named in `events`; pieces (M, PIECE_COLUMNS), piece (PIECE_COLUMNS,): columns named in `leg`;
polarised: whether Q and U count; z [km]: altitude; (i, f): a place among the levels of the air, the fraction f of the
way from level i to the next one; cos_sun, mu_sun: cosine of the true sun's zenith angle at the point.  A kernel's own
text has the rest.

Random numbers come from a counter that any thread can start anywhere, SplitMix64 (Steele, Lea & Flood 2014).

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
"""

import math
from typing import Any

import numpy as np

from twilight.jit.kernels import njit
from twilight.numerics.phase import aerosol_matrix, rayleigh_matrix

INNER: dict[str, Any] = {"cache": True, "makes_arrays": False}
"""Options of kernels that only read and write arrays they are given.

Numba counts references whenever an array is taken out of a named tuple, 40 % of the time of a path; a kernel that makes
no arrays needs none of that.  A constant that is handed to a kernel is written np.int64(1) or np.bool_(False): of plain
1 and False numba makes types of their own, and compiles the kernel once more for them.
"""
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
MIX_2 = np.uint64(0x94D049BB133111EB)
TO_UNIT = 2.0**-53
N_STOKES = 3
"""Stokes parameters of light: I, Q, U."""


@njit(inline="always", **INNER)
def mix(z):
    """The finaliser of SplitMix64: a bijection of 64-bit integers z (uint64) that leaves no visible order."""
    z = (z ^ (z >> np.uint64(30))) * MIX_1
    z = (z ^ (z >> np.uint64(27))) * MIX_2
    return z ^ (z >> np.uint64(31))


@njit(inline="always", **INNER)
def uniform(stream):
    """Next number in [0, 1) of a stream (an array of one uint64, advanced in place)."""
    stream[0] += GOLDEN
    return np.float64(mix(stream[0]) >> np.uint64(11)) * TO_UNIT


@njit(inline="always", **INNER)
def draw_from(cumulative, x):
    """First index whose running sum exceeds x.

    cumulative (N,): running sums; x: from 0 to the last of them.
    """
    lo = 0
    hi = cumulative.size - 1
    while lo < hi:
        mid = (lo + hi) // 2
        if cumulative[mid] > x:
            hi = mid
        else:
            lo = mid + 1
    return lo


@njit(**INNER)
def start(stream, seed, pixel_key, wavelength, chunk):
    """Set a stream for one chunk of one pixel and wavelength; chunks of anything else get unrelated streams.

    stream (1,): uint64, set; seed, pixel_key, wavelength, chunk: whole numbers that name the chunk.
    """
    key = mix(np.uint64(seed) + GOLDEN)
    key = mix(key ^ np.uint64(pixel_key)) + GOLDEN
    key = mix(key ^ np.uint64(wavelength)) + GOLDEN
    stream[0] = mix(key ^ np.uint64(chunk))


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
