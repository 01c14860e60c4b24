"""The medium of the random walk: fine levels to interpolate, coarse shells to step through, phase tables to sample.

Between the refined levels coefficients go linearly; `medium.refined` places them so that this departs from the medium's
exponential rule by less than LEVEL_TOLERANCE of a coefficient.  A line is cut in two ways.  Where it is steep, optical
depth is the integral over altitude of extinction x secant: the secant is a parabola in altitude over a whole *layer*,
and integrals of extinction x altitude^n are tabulated, whatever the extinction does in between.  Close to the
horizontal it is cut at *shells*, runs of levels over which Simpson's rule integrates the extinction along the line to
SHELL_TOLERANCE; no shell contains a jump, and a layer is a whole number of shells.

Arguments that kernels share: `kernel`.
"""

from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium, with_joined_refractivity
from twilight.jit.kernels import njit
from twilight.numerics.phase import phase_arrays
from twilight.solvers.montecarlo.kernel import INNER

LEVEL_TOLERANCE = 1e-4
"""Largest relative error of a coefficient that is linear between levels."""
SHELL_TOLERANCE = 2e-4
"""Largest relative error of the optical depth of a shell by Simpson's rule."""
LAYER_KM = 0.8
"""Thickness [km] of layers at the ground."""
LAYER_GROWTH = 0.35
"""Thickness of layers over their height above the ground, from where that is more."""
SHARP = 0.3
"""Change of the logarithm of scattering at which a layer ends: by a jump, or beyond the change by STEEPEST_KM."""
STEEPEST_KM = 2.0
"""Scale height [km] of scattering that a layer may hold throughout."""
N_BINS = 4096
"""Equal parts of the altitude in which a level is looked up."""
N_SAMPLING = 1024
"""Cells of the phase functions that are drawn from."""
N_SMOOTH = 128
"""Cells of the blurred phase functions, equal in the cosine."""
SMOOTHING_RAD = 0.12
"""Standard deviation [rad] of the blur, about the size of a cell of directions of the importance function."""
# Columns of `MonteCarloAir.table`.
EXTINCTION = 0
SCATTERING = 1
SPECIES = 2


class MonteCarloAir(NamedTuple):
    """Tables of a medium: N refined levels, M shells, Y layers, W wavelengths, C = 1 + K species (air first).

    level_km (N,); bin_start (N_BINS + 1,): a level at or below the start of each of the equal bins of altitude; per_km
        (N - 1,): 1 / thickness between levels.
    table (W, N, 2 + C) [km^-1]: EXTINCTION of diffuse light; SCATTERING of diffuse light (order two and above); from
        SPECIES on, scattering of the direct beam by each species.
    moment (W, N, 3): integrals from the ground to a level of extinction x h^n, n = 0, 1, 2, h the height above ground.
    refractivity (W, N): n - 1.
    shell_km (M + 1,); shell_first, shell_last (M,): levels at the two ends of a shell.
    layer_km (Y + 1,); layer_first, layer_last (Y,): the same for layers; layer_of_shell (M,); layer_shell (Y + 1,): the
        lowest shell of a layer.
    phase_kind, phase_asymmetry, phase_log_table, phase_ratios: of `phase_arrays`.
    sample_cdf, sample_density (W, C, N_SAMPLING): piecewise constant phase functions, to draw from.
    smooth (W, C, N_SMOOTH): phase functions blurred by SMOOTHING_RAD, over the cosine.
    isotropic_events: diffuse light scatters isotropically.
    """

    level_km: np.ndarray
    bin_start: np.ndarray
    bins_per_km: float
    per_km: np.ndarray
    table: np.ndarray
    moment: np.ndarray
    refractivity: np.ndarray
    shell_km: np.ndarray
    shell_first: np.ndarray
    shell_last: np.ndarray
    layer_km: np.ndarray
    layer_first: np.ndarray
    layer_last: np.ndarray
    layer_of_shell: np.ndarray
    layer_shell: np.ndarray
    phase_kind: np.ndarray
    phase_asymmetry: np.ndarray
    phase_log_table: np.ndarray
    phase_ratios: np.ndarray
    depolarisation: np.ndarray
    sample_cdf: np.ndarray
    sample_density: np.ndarray
    smooth: np.ndarray
    ground_albedo: np.ndarray
    isotropic_events: bool
    earth_radius_km: float


class MonochromaticAir(NamedTuple):
    """The arrays of `MonteCarloAir` that innermost loops read, at one wavelength; bottom_km: altitude of the ground."""

    level_km: np.ndarray
    bin_start: np.ndarray
    bins_per_km: float
    per_km: np.ndarray
    table: np.ndarray
    moment: np.ndarray
    refractivity: np.ndarray
    bottom_km: float


def prepare_air(medium: Medium, forward_moment: int | None = None) -> MonteCarloAir:
    """Tables of one medium; with `forward_moment`, of an equivalent medium for light that has been scattered.

    There the fraction f of the aerosol's scattering counts as not scattered, f being that Legendre moment of its phase
    function: diffuse light meets scattering (1 - f) beta_s and extinction beta_e - f beta_s; the beam keeps the true
    scattering and phase functions.  With moment 1, f = g, events are isotropic: similarity, Haber 2005 sec. 4.5.3.
    """
    fine = medium.refined(tolerance=LEVEL_TOLERANCE)
    z = fine.altitude_km
    aerosol = fine.aerosol_extinction_per_km * fine.aerosol_single_scattering_albedo
    species = np.concatenate([fine.air_scattering_per_km[None], aerosol[None] * fine.aerosol_phase_fraction])
    extinction = fine.extinction_per_km
    scattering = species.sum(axis=0)
    if forward_moment is not None:
        for k, phase in enumerate(medium.phase_functions):
            f = np.clip(phase.legendre_moments(forward_moment)[:, forward_moment], 0.0, 0.999)
            forward = species[1 + k] * f
            extinction = extinction - forward
            scattering = scattering - forward
    table = np.stack([extinction, scattering, *species], axis=-1).transpose(1, 0, 2)
    phases = phase_arrays(medium.phase_functions, medium.n_wavelengths)
    bins_per_km = N_BINS / (z[-1] - z[0])
    starts = z[0] + np.arange(N_BINS + 1) / bins_per_km
    first, last = shells(z, table[:, :, EXTINCTION], scattering > 0)
    start = layers(z, first, last, scattering)
    cdf, density = _sampling_tables(medium)
    return MonteCarloAir(
        np.ascontiguousarray(z),
        np.clip(np.searchsorted(z, starts, side="right") - 1, 0, z.size - 2).astype(np.int64),
        float(bins_per_km),
        np.ascontiguousarray(1.0 / np.where(np.diff(z) > 0, np.diff(z), 1.0)),
        np.ascontiguousarray(table),
        moments(z, table[:, :, EXTINCTION]),
        np.ascontiguousarray(with_joined_refractivity(medium).at(z).refractivity.T),
        np.ascontiguousarray(np.append(z[first], z[-1])),
        first,
        last,
        np.ascontiguousarray(np.append(z[first[start[:-1]]], z[-1])),
        first[start[:-1]],
        last[start[1:] - 1],
        np.repeat(np.arange(start.size - 1), np.diff(start)),
        start,
        *phases,
        np.ascontiguousarray(medium.depolarisation, dtype=float),
        cdf,
        density,
        _smooth_tables(medium),
        np.ascontiguousarray(medium.ground_albedo, dtype=float),
        forward_moment == 1,
        float(medium.earth_radius_km),
    )


def shells(altitude_km, extinction, scatters, tolerance: float = SHELL_TOLERANCE):
    """First and last level of each shell: as thick as Simpson's rule allows.

    altitude_km (N,), extinction (W, N), scatters (N, W) tells where there is scattering at all: a shell holds either
    scattering throughout or nowhere, so that no piece of a line gets zero weight where light may come from.
    """
    z = altitude_km
    dz = np.diff(z)
    depth = np.concatenate(
        [np.zeros((extinction.shape[0], 1)), np.cumsum(0.5 * (extinction[:, 1:] + extinction[:, :-1]) * dz, axis=1)],
        axis=1,
    )
    any_scattering = scatters[:-1] | scatters[1:]
    span = z[-1] - z[0]

    def fits(a: int, b: int) -> bool:
        if b == a + 1:
            return True
        if np.any(dz[a:b] <= 0) or np.any(any_scattering[a:b] != any_scattering[a]):
            return False
        width = z[b] - z[a]
        if width > max(0.05 * span, 0.15 * (z[a] - z[0])):
            return False
        middle = 0.5 * (z[a] + z[b])
        i = int(np.clip(np.searchsorted(z, middle) - 1, a, b - 1))
        f = (middle - z[i]) / dz[i]
        lower, upper = extinction[:, a], extinction[:, b]
        centre = extinction[:, i] * (1 - f) + extinction[:, i + 1] * f
        half = depth[:, i] + (middle - z[i]) * 0.5 * (extinction[:, i] + centre)
        total = depth[:, b] - depth[:, a]
        limit = tolerance * total + 1e-9
        whole_ok = np.abs(width * (lower + 4 * centre + upper) / 6 - total) <= limit
        half_ok = np.abs(width * (5 * lower + 8 * centre - upper) / 24 - (half - depth[:, a])) <= limit
        return bool(np.all(whole_ok & half_ok))

    first, last = [], []
    a = 0
    while a < z.size - 1:
        if dz[a] <= 0:
            a += 1
            continue
        b = a + 1
        while b < z.size - 1 and fits(a, b + 1):
            b += 1
        first.append(a)
        last.append(b)
        a = b
    return np.array(first, dtype=np.int64), np.array(last, dtype=np.int64)


def layers(altitude_km, first, last, scattering) -> np.ndarray:
    """First shell of every layer, and the number of shells: LAYER_KM thick at the ground and thicker above.

    Like a shell, a layer holds scattering (N, W) throughout or nowhere.  It ends where scattering jumps or climbs
    steeply: one point stands for a piece, and must not stand for a thin layer inside that it misses.
    """
    z = altitude_km
    scatters = scattering > 0
    size = np.log(np.maximum(scattering, 1e-300))
    any_scattering = scatters[:-1] | scatters[1:]
    thin = min(LAYER_KM, 0.2 * (z[-1] - z[0]))
    start = [0]
    for k in range(1, first.size):
        a = first[start[-1]]
        width = z[last[k]] - z[a]
        sharp = max(
            np.abs(size[first[k]] - size[last[k - 1]]).max(),
            np.abs(size[last[k]] - size[first[k]]).max() - (z[last[k]] - z[first[k]]) / STEEPEST_KM,
            np.abs(size[last[k - 1]] - size[first[k - 1]]).max() - (z[last[k - 1]] - z[first[k - 1]]) / STEEPEST_KM,
        )
        too_wide = width > max(thin, LAYER_GROWTH * (z[a] - z[0]))
        if too_wide or sharp > SHARP or np.any(any_scattering[first[k]] != any_scattering[a]):
            start.append(k)
    return np.array([*start, first.size], dtype=np.int64)


def moments(altitude_km, extinction) -> np.ndarray:
    """Integrals (W, N, 3) from the ground to every level of extinction (W, N) x h^n, h the height, n = 0, 1, 2."""
    h = altitude_km - altitude_km[0]
    d = np.diff(h)
    lower, slope = extinction[:, :-1], np.diff(extinction, axis=1)
    m0 = d * (lower + slope / 2)
    m1 = d**2 * (lower / 2 + slope / 3)
    m2 = d**3 * (lower / 3 + slope / 4)
    steps = np.stack([m0, m1 + h[:-1] * m0, m2 + 2 * h[:-1] * m1 + h[:-1] ** 2 * m0], axis=-1)
    # in C order for any number of wavelengths: kernels are compiled for each order of their arrays
    return np.ascontiguousarray(np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1))


def _phase_at(medium: Medium, cosine: np.ndarray) -> np.ndarray:
    """Phase functions (W, C, *cosine.shape), air first."""
    rho = medium.depolarisation.reshape(-1, *([1] * cosine.ndim))
    air = 3.0 / (8.0 * np.pi * (2.0 + rho)) * ((1.0 + rho) + (1.0 - rho) * cosine**2)
    return np.stack([air, *(p(cosine) for p in medium.phase_functions)], axis=1)


def _sampling_tables(medium: Medium):
    x = np.linspace(0.0, 1.0, N_SAMPLING + 1)
    edges = 1.0 - 2.0 * x**4  # cosines, dense in the forward peak
    offsets = (np.arange(4) + 0.5) / 4
    inner = 1.0 - 2.0 * (x[:-1, None] + offsets[None, :] * np.diff(x)[:, None]) ** 4
    mass = _phase_at(medium, inner).mean(axis=-1) * -np.diff(edges)
    mass /= mass.sum(axis=-1, keepdims=True)
    density = mass / (2.0 * np.pi * -np.diff(edges))
    return np.ascontiguousarray(np.cumsum(mass, axis=-1)), np.ascontiguousarray(density)


def _smooth_tables(medium: Medium) -> np.ndarray:
    """Phase functions after diffusion on the sphere: moment l is damped by exp(-l (l + 1) sigma^2 / 2)."""
    degree = 64
    cosine = -1.0 + 2.0 * (np.arange(N_SMOOTH) + 0.5) / N_SMOOTH
    out = np.empty((medium.n_wavelengths, 1 + len(medium.phase_functions), N_SMOOTH))
    order = np.arange(degree + 1)
    legendre = np.polynomial.legendre.legvander(cosine, degree)
    damping = np.exp(-0.5 * order * (order + 1) * SMOOTHING_RAD**2) * (2 * order + 1) / (4 * np.pi)
    rho = medium.depolarisation
    air = np.zeros((medium.n_wavelengths, degree + 1))
    air[:, 0] = 1.0
    air[:, 2] = 0.2 * (1.0 - rho) / (2.0 + rho)
    for c, moments in enumerate([air, *(p.legendre_moments(degree) for p in medium.phase_functions)]):
        out[:, c] = np.maximum((moments * damping) @ legendre.T, 1e-3 / (4 * np.pi))
    return out


@njit(inner=True, **INNER)
def locate_level(levels, bin_start, bins_per_km, per_km, z, first, last):
    """(i, f): level below z and fraction of the way to the next one, between the levels `first` and `last`.

    Takes arrays, not the whole `MonteCarloAir`: in the innermost loop a tuple of arrays costs more than the search.

    levels (N,) [km]; bin_start (B,): level at or below the start of each of B equal bins of altitude; bins_per_km
    [km^-1]; per_km (N - 1,) [km^-1]: 1 over the distances between levels; z [km].
    """
    b = int((z - levels[0]) * bins_per_km)
    b = min(max(b, 0), bin_start.size - 1)
    i = min(max(bin_start[b], first), last - 1)
    while i < last - 1 and levels[i + 1] < z:
        i += 1
    f = (z - levels[i]) * per_km[i]
    return i, min(1.0, max(0.0, f))


@njit(inner=True, **INNER)
def locate(air, z, first, last):
    """`locate_level` in the levels of the air: altitude z [km], between the levels `first` and `last`."""
    return locate_level(air.level_km, air.bin_start, air.bins_per_km, air.per_km, z, first, last)


@njit(inline="always", **INNER)
def air_at(air, w):
    """The air at the wavelength of the index w."""
    return MonochromaticAir(
        air.level_km,
        air.bin_start,
        air.bins_per_km,
        air.per_km,
        air.table[w],
        air.moment[w],
        air.refractivity[w],
        air.shell_km[0],
    )


@njit(inline="always", **INNER)
def place_in(at, z, first, last):
    """`locate_level` in the levels of a `MonochromaticAir`: altitude z [km], between the levels `first` and `last`."""
    return locate_level(at.level_km, at.bin_start, at.bins_per_km, at.per_km, z, first, last)


@njit(inline="always", **INNER)
def column(table, i, f, c):
    """Coefficient [km^-1] of a table (N, 2 + C) of one wavelength at the place (i, f) of the levels; c: its column."""
    return table[i, c] * (1.0 - f) + table[i + 1, c] * f


@njit(inline="always", **INNER)
def interpolate(air, w, i, f, column):
    """Coefficient [km^-1] at the wavelength w and the place (i, f) of the levels; column: of `MonteCarloAir.table`."""
    return air.table[w, i, column] * (1.0 - f) + air.table[w, i + 1, column] * f


@njit(inline="always", **INNER)
def depth_from_ground(at, i, f, c0, c1, c2):
    """Integral from the ground of extinction x (c0 + c1 h + c2 h^2), h the height, to the place (i, f) of the levels.

    c0 [1], c1 [km^-1], c2 [km^-2]: secant of the line.
    """
    table, moment = at.table, at.moment
    h = at.level_km[i] - at.bottom_km
    y = f * (1.0 / at.per_km[i])
    lower = table[i, EXTINCTION]
    slope = (table[i + 1, EXTINCTION] - lower) * f
    m0 = y * (lower + slope * 0.5)
    m1 = y * y * (lower * 0.5 + slope * (1.0 / 3.0))
    m2 = y * y * y * (lower * (1.0 / 3.0) + slope * 0.25)
    return (
        c0 * (moment[i, 0] + m0)
        + c1 * (moment[i, 1] + m1 + h * m0)
        + c2 * (moment[i, 2] + m2 + h * (2.0 * m1 + h * m0))
    )


@njit(inner=True, **INNER)
def shell_of(air, z):
    """Index of the shell of the air that holds the altitude z [km]."""
    lo = 0
    hi = air.shell_km.size - 1
    while hi - lo > 1:
        mid = (lo + hi) // 2
        if air.shell_km[mid] <= z:
            lo = mid
        else:
            hi = mid
    return lo
