"""Aerial perspective of Preetham 1999 sec. 4: air and haze, each exponential in height over a flat ground.

An object at a distance s is seen as L0 tau + Lin.  With u_i(x) = exp(-a_i h(x)) and h(x) = h0 + x cos(theta),

    tau(s) = exp(-tau_1 - tau_2),  tau_i = b_i H_i (1 - exp(-a_i s cos theta)) / (a_i cos theta),  H_i = u_i(0)  (7)
    Lin = S_1 I_1 + S_2 I_2,       I_i = integral of u_i(x) tau(0..x) dx from 0 to s                           (8)

S_i is the light of sky and sun scattered into the ray per length at the ground.  The integral has a closed form where
the attenuation by the other constituent is replaced by a cubic through its ends and slopes (eq. 11).  Three changes
make it hold for every ray.  It is taken over t = tau_1(x) / tau_1(s) instead of u, so that the 1/K^4 of the printed sum
become moments of an exponential, which lose no digits.  The cubic stands for what exp(-tau_2 t) leaves of the other's
attenuation, so that level rays are exact and eq. 10 is the limit, not a case.  And the ray is cut into pieces that rise
by PIECE_KM at most: one cubic for the whole ray, as printed, makes I of haze 1.5 to 6 times too large over 10 km
straight up, and I of air 0 over 20 km of level ray at turbidity 6.

The paper prints K = -b / (a cos theta) beside exp(-K (H - u)): transmittance is below 1 with +.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.numerics.spectrum import hermite_matrix
from twilight.solvers.analytic.coefficients import angles
from twilight.solvers.analytic.daylight import column, hemisphere, table

HAZE_DECAY_PER_KM = 0.8333
"""Fall of the haze's density with height [km^-1] (Preetham 1999 sec. 4)."""

AIR_DECAY_PER_KM = 0.1136
"""Fall of the air's density with height [km^-1] (Preetham 1999 sec. 4)."""

REFRACTIVITY = 3e-4
"""n - 1 of air at the ground, as printed (appendix A.3); that of real air, 2.78e-4, would scatter 14 % less."""

MOLECULES_PER_CM3 = 2.545e19
"""Number density of air at the ground [cm^-3] (appendix A.3)."""

DEPOLARISATION = 0.035
"""Depolarisation factor of air (appendix A.3)."""

PIECE_KM = 0.25
"""Rise of a ray [km] over which one cubic stands for the attenuation by the other constituent."""

MOST_PIECES = 100
"""Pieces of a ray at most."""

_RAYS = 2048
"""Rays that are handled at once, so that many rays need little memory."""


def air_scattering_per_km(wavelength_nm) -> np.ndarray:
    """beta = 8 pi^3 (n^2 - 1)^2 / (3 N lambda^4) (6 + 3 p) / (6 - 7 p) at the ground [km^-1] (appendix A.3)."""
    wavelength_cm = np.asarray(wavelength_nm, float) * 1e-7
    n2 = ((1.0 + REFRACTIVITY) ** 2 - 1.0) ** 2
    king = (6.0 + 3.0 * DEPOLARISATION) / (6.0 - 7.0 * DEPOLARISATION)
    return 8.0 * np.pi**3 * n2 / (3.0 * MOLECULES_PER_CM3 * wavelength_cm**4) * king * 1e5


def haze_scattering_per_km(wavelength_nm, turbidity: float) -> np.ndarray:
    """beta = 0.434 c pi (2 pi / lambda)^(v - 2) K at the ground [km^-1], v = 4, c = (0.6544 T - 0.6510) 1e-16.

    With lambda in cm the result is in cm^-1: so it gives an optical depth of T - 1 times that of the air, within 7 %.
    """
    wavelength = np.asarray(wavelength_nm, float)
    k = np.interp(wavelength, column("preetham1999_spectra", "wavelength_nm"), column("preetham1999_spectra", "haze_k"))
    c = max(0.6544 * turbidity - 0.6510, 0.0) * 1e-16
    return 0.434 * c * np.pi * (2.0 * np.pi / (wavelength * 1e-7)) ** 2 * k * 1e5


def air_phase(angle_rad) -> np.ndarray:
    """3 / (16 pi) (1 + cos^2), per steradian."""
    return 3.0 / (16.0 * np.pi) * (1.0 + np.cos(angle_rad) ** 2)


def haze_phase(angle_rad, wavelength_nm) -> np.ndarray:
    """Phase function of the haze (Junge exponent 4, table 1), per steradian, (*angles, W); flat within 1 deg.

    ln eta is interpolated by a local cubic in the angle and linearly in the wavelength, held beyond 400 to 850 nm, and
    normalised: eta over pi K integrates to 1 within 0.2 % only.
    """
    angle = np.degrees(np.asarray(angle_rad, float))
    head, values = table("preetham1999_haze_phase")
    columns = np.array([float(name) for name in head[1:]])
    wavelength = np.clip(np.asarray(wavelength_nm, float), columns[0], columns[-1])
    across = np.stack([np.interp(wavelength, columns, hat) for hat in np.eye(columns.size)])
    logarithm = np.log(values[:, 1:]) @ across
    fine = np.linspace(0.0, 180.0, 721)
    eta = np.exp(hermite_matrix(values[:, 0], np.maximum(fine, values[0, 0])) @ logarithm)
    total = 2.0 * np.pi * np.trapezoid(eta * np.sin(np.radians(fine))[:, None], np.radians(fine), axis=0)
    position = np.clip(angle, 0.0, 180.0) * 4.0
    low = np.minimum(position.astype(int), 719)
    fraction = (position - low)[..., None]
    return ((1.0 - fraction) * eta[low] + fraction * eta[low + 1]) / total


class Integrals(NamedTuple):
    """Optical depths and the integrals I [km] of haze and air over rays, (R, W) each.

    Within 0.4 % of quadrature for turbidity 2 to 6, 380 to 720 nm and rays of 1 to 100 km.
    """

    haze_depth: np.ndarray
    air_depth: np.ndarray
    haze: np.ndarray
    air: np.ndarray


def path_integrals(haze_per_km, air_per_km, height_km: float, cos_zenith, distance_km) -> Integrals:
    """Eq. 7 and 11 for scattering coefficients at the ground (W,) and rays (R,), the ray cut into pieces."""
    cosine = np.atleast_1d(np.asarray(cos_zenith, float))[:, None]
    s = np.atleast_1d(np.asarray(distance_km, float))[:, None]
    cosine, s = np.broadcast_arrays(cosine, s)
    haze, air = np.asarray(haze_per_km, float), np.asarray(air_per_km, float)
    pieces = int(np.clip(np.ceil(np.abs(s * cosine).max(initial=0.0) / PIECE_KM), 1, MOST_PIECES))
    total = Integrals(*(np.zeros((s.shape[0], haze.size)) for _ in range(4)))
    for i in range(pieces):
        piece = _piece(haze, air, height_km + s * cosine * (i / pieces), cosine, s / pieces)
        before = np.exp(-total.haze_depth - total.air_depth)
        total = Integrals(
            total.haze_depth + piece.haze_depth,
            total.air_depth + piece.air_depth,
            total.haze + before * piece.haze,
            total.air + before * piece.air,
        )
    return total


def _piece(haze, air, height_km, cosine, s) -> Integrals:
    """The closed form for one piece of every ray, heights (R, 1)."""
    x1, x2 = (_column(a, height_km, cosine, s) for a in (HAZE_DECAY_PER_KM, AIR_DECAY_PER_KM))
    # density of the other over that of the one at both ends of the piece
    ratio = np.exp((HAZE_DECAY_PER_KM - AIR_DECAY_PER_KM) * np.stack([height_km, height_km + s * cosine]))
    haze_depth, air_depth = haze * x1, air * x2
    return Integrals(
        haze_depth,
        air_depth,
        _integral(x1, haze_depth, air_depth, air * x1 * ratio[0], air * x1 * ratio[1]),
        _integral(x2, air_depth, haze_depth, haze * x2 / ratio[0], haze * x2 / ratio[1]),
    )


def _column(decay_per_km: float, height_km: float, cosine, s) -> np.ndarray:
    """Integral of exp(-decay h) along the ray [km]."""
    a = decay_per_km * cosine * s
    small = np.abs(a) < 1e-8
    return np.exp(-decay_per_km * height_km) * s * np.where(small, 1.0, -np.expm1(-a) / np.where(small, 1.0, a))


def _integral(column_km, depth, other_depth, slope_start, slope_end) -> np.ndarray:
    """column x integral over t from 0 to 1 of exp(-(depth + other_depth) t) g(t).

    g is the cubic of what the other's transmittance leaves beyond exp(-other_depth t): 1 at both ends, with the slopes
    there.  slopes: of the other's optical depth in t.
    """
    d0, d1 = other_depth - slope_start, other_depth - slope_end
    cubic = (1.0, d0, -2.0 * d0 - d1, d0 + d1)
    value = sum(c * m for c, m in zip(cubic, _moments(depth + other_depth), strict=True))
    return np.maximum(column_km * value, 0.0)


def _moments(depth) -> list[np.ndarray]:
    """Integrals of t^n exp(-depth t) over 0 to 1, n = 0 to 3."""
    thin = np.minimum(depth, 2.0)
    series = [sum((-thin) ** k / (math.factorial(k) * (n + k + 1)) for k in range(24)) for n in range(4)]
    thick = np.maximum(depth, 2.0)
    rest = np.exp(-thick)
    closed = [(1.0 - rest) / thick]
    for n in range(1, 4):
        closed.append((n * closed[-1] - rest) / thick)
    return [np.where(depth < 2.0, a, b) for a, b in zip(series, closed, strict=True)]


def aerial_perspective(
    wavelength_nm: np.ndarray,
    turbidity: float,
    sky: Callable[[np.ndarray, np.ndarray], np.ndarray],
    direct: np.ndarray,
    sun_elevation_deg: float,
    height_km: float,
    elevation_deg,
    azimuth_deg,
    distance_km,
) -> tuple[np.ndarray, np.ndarray]:
    """(inscattered sun-normalised radiance [sr^-1], transmittance), directions plus (W,) each.

    sky(elevation_deg, azimuth_deg) -> (N, W) [sr^-1]; direct (W,): sunlight at normal incidence over F0.
    Raises TwilightError for a distance that is negative, not finite, or ends below the ground.
    """
    e, a, s = np.broadcast_arrays(*(np.asarray(v, float) for v in (elevation_deg, azimuth_deg, distance_km)))
    shape = (*e.shape, direct.size)
    e, a, s = e.ravel(), a.ravel(), s.ravel()
    if not (np.isfinite(s).all() and (s >= 0).all()):
        raise TwilightError("distance_km must be finite and not negative")
    cosine = np.sin(np.radians(e))
    if (height_km + s * cosine < -ROUNDING).any():
        raise TwilightError(f"distance_km: a ray from {height_km:g} km above the ground ends below it")
    haze_per_km, air_per_km = haze_scattering_per_km(wavelength_nm, turbidity), air_scattering_per_km(wavelength_nm)
    integrals = path_integrals(haze_per_km, air_per_km, height_km, cosine, s)
    haze, air = _scattered(wavelength_nm, sky, direct, sun_elevation_deg, e, a)
    inscattered = haze * haze_per_km * integrals.haze + air * air_per_km * integrals.air
    return inscattered.reshape(shape), np.exp(-integrals.haze_depth - integrals.air_depth).reshape(shape)


def _scattered(wavelength_nm, sky, direct, sun_elevation_deg: float, e: np.ndarray, a: np.ndarray):
    """Light of sky and sun, not of the ground, that haze and air scatter into rays at the ground, over their scattering
    coefficients [sr^-1], (R, W) each."""
    sky_e, sky_a, solid = hemisphere()
    light = np.concatenate([sky(sky_e, sky_a) * solid[:, None], direct[None]])
    from_e, from_a = np.append(sky_e, sun_elevation_deg), np.append(sky_a, 0.0)
    haze, air = np.empty((2, e.size, direct.size))
    for start in range(0, e.size, _RAYS):
        part = slice(start, start + _RAYS)
        # the light of a source goes on along the ray it came by; what reaches the eye goes against the ray
        gamma = _angle_between(e[part], a[part], from_e, from_a)
        air[part] = air_phase(gamma) @ light
        haze[part] = np.einsum("rsw,sw->rw", haze_phase(gamma, wavelength_nm), light)
    return haze, air


def _angle_between(elevation_deg, azimuth_deg, from_elevation_deg, from_azimuth_deg) -> np.ndarray:
    """Angles [rad] between R directions and S sources, (R, S): forward scattering is 0."""
    rows = [
        angles(float(fe), elevation_deg, azimuth_deg - fa)[1]
        for fe, fa in zip(from_elevation_deg, from_azimuth_deg, strict=True)
    ]
    return np.stack(rows, axis=1)
