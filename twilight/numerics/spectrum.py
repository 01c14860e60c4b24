"""The solar spectrum, the standard observers, and the one way to get from sampled wavelengths to 1 nm.

What is smooth in wavelength (a radiance divided by the solar irradiance) is interpolated; what is not (the solar
spectrum with its Fraunhofer lines) is tabulated at 1 nm and multiplied in afterwards; the product is never
interpolated.

Linear RGB of any primaries becomes linear Rec. 709 without adaptation to another white: the same light.
"""

from __future__ import annotations

import csv
from functools import lru_cache

import numpy as np

from twilight.base.errors import TwilightError, check_known
from twilight.base.shipped_data import data_file, data_numbers, data_rows

LUMINOUS_EFFICACY_LM_PER_W = 683.002
"""Luminous efficacy of 540 THz radiation over V(555 nm) in standard air, lm W^-1 (CIE 018:2019)."""

DEFAULT_SOLAR_SPECTRUM = "astm_g173_etr"
"""ASTM G173, extraterrestrial."""

OBSERVERS = {
    "cie1931_2deg": "CIE 1931 2 Degree Standard Observer",
    "cie1964_10deg": "CIE 1964 10 Degree Standard Observer",
}
"""Names of the standard observers here and in colour-science."""

VISIBLE_NM = np.arange(360.0, 831.0)
"""Wavelengths of the colour matching functions [nm], step 1."""
VISIBLE_NM.flags.writeable = False

STEEPEST_EXPONENT = 8.0
"""Bound on the power of the wavelength with which a spectrum is continued beyond its samples."""
SAME_MATRIX = 2e-3
"""Matrices that are nearer to the identity than this in every element stand for Rec. 709 itself, as files round it."""


@lru_cache(maxsize=1)
def _solar_table() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Wavelengths and irradiances of each spectrum, as `solar_spectrum` gives them."""
    names, values = data_numbers("solar/solar_irradiance_1nm.csv")
    table = {}
    for column, name in enumerate(names[1:], start=1):
        pairs = np.ascontiguousarray(values[np.isfinite(values[:, column])][:, [0, column]])
        pairs.flags.writeable = False
        table[name] = (pairs[:, 0], pairs[:, 1])
    return table


def solar_spectra() -> list[str]:
    """Names of the solar spectra that can be chosen."""
    return list(_solar_table())


def solar_spectrum(name: str = DEFAULT_SOLAR_SPECTRUM) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths [nm] (step 1) and solar irradiance on top of the atmosphere at 1 au [W m^-2 nm^-1], 1 nm bin means.

    Raises TwilightError for a name that is not one of ``solar_spectra()``.  Sources: in the data file's head.
    """
    check_known("solar_spectrum", name, solar_spectra())
    return _solar_table()[name]


def wavelength_bounds(wavelength_nm: np.ndarray, name: str = DEFAULT_SOLAR_SPECTRUM) -> np.ndarray:
    """Bin of every sampled wavelength [nm], (W, 2): midpoints between neighbours, the outer ones symmetric.

    A single wavelength has a bin of 1 nm.  The bins are cut where the solar spectrum ``name`` ends.  Raises
    TwilightError where a wavelength is outside the spectrum.
    """
    wavelength = np.asarray(wavelength_nm, dtype=float)
    grid, _ = solar_spectrum(name)
    low, high = grid[0] - 0.5, grid[-1] + 0.5
    outside = (wavelength < low) | (wavelength > high)
    if outside.any():
        raise TwilightError(
            f"wavelength_nm: {wavelength[outside][0]:g} nm is outside the solar spectrum {name}, {low:g} to {high:g} nm"
        )
    if wavelength.size == 1:
        edges = wavelength[0] + np.array([-0.5, 0.5])
    else:
        middle = 0.5 * (wavelength[1:] + wavelength[:-1])
        edges = np.concatenate([[2 * wavelength[0] - middle[0]], middle, [2 * wavelength[-1] - middle[-1]]])
    edges = np.clip(edges, low, high)
    return np.stack([edges[:-1], edges[1:]], axis=1)


def solar_irradiance(
    wavelength_nm: np.ndarray, name: str = DEFAULT_SOLAR_SPECTRUM, distance_au: float = 1.0
) -> np.ndarray:
    """Mean solar irradiance over the bin of every sampled wavelength [W m^-2 nm^-1], (W,).

    The bins are those of ``wavelength_bounds``, so that the sum of irradiance times bin width is the irradiance of the
    whole range however coarse the samples are.  ``distance_au`` scales with its inverse square.
    """
    grid, irradiance = solar_spectrum(name)
    bounds = wavelength_bounds(wavelength_nm, name)
    integral = np.concatenate([[0.0], np.cumsum(irradiance)])
    cumulative = np.interp(bounds, np.arange(grid.size + 1) + grid[0] - 0.5, integral)
    return (cumulative[:, 1] - cumulative[:, 0]) / (bounds[:, 1] - bounds[:, 0]) / distance_au**2


def colour_matching_functions(observer: str = "cie1964_10deg") -> np.ndarray:
    """Colour matching functions (471, 3) of a standard observer at ``VISIBLE_NM`` (data/colour/observers.csv).

    The second column of ``cie1931_2deg`` is the luminous efficiency function V(lambda).  Raises TwilightError for an
    observer that is not in ``OBSERVERS``.
    """
    return _observer(observer)[:-3]


def xyz_to_rgb_matrix(observer: str = "cie1964_10deg") -> np.ndarray:
    """Matrix (3, 3) from XYZ of an observer to linear Rec. 709 (data/colour/observers.csv).

    For the 10 deg observer a Bradford adaptation takes its D65 white to that of Rec. 709 (defined for 2 deg), so that
    D65 is neutral with either observer.  Raises TwilightError for an observer that is not in ``OBSERVERS``.
    """
    return _observer(observer)[-3:]


def _observer(name: str) -> np.ndarray:
    check_known("observer", name, OBSERVERS)
    return _observer_tables()[name]


@lru_cache(maxsize=1)
def _observer_tables() -> dict[str, np.ndarray]:
    """Matching functions and, below them, the RGB matrix of every observer, (474, 3) each."""
    text = data_file("colour/observers.csv").read_text(encoding="utf-8")
    rows = list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))[1:]
    tables = {name: np.array([row[2:] for row in rows if row[0] == name], float) for name in OBSERVERS}
    for table in tables.values():
        table.flags.writeable = False
    return tables


@lru_cache(maxsize=1)
def _colour_spectra() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    found: dict[str, list[tuple[float, float]]] = {}
    for row in data_rows("colour/spectra.csv"):
        found.setdefault(row["spectrum"], []).append((float(row["wavelength_nm"]), float(row["value"])))
    columns = {name: np.array(pairs).T for name, pairs in found.items()}
    return {name: (nm, values) for name, (nm, values) in columns.items()}


def colour_spectrum(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths [nm] and values of a spectrum of data/colour/spectra.csv, whose head says what they are."""
    return _colour_spectra()[name]


def at_visible(name: str) -> np.ndarray:
    """A spectrum of data/colour/spectra.csv at ``VISIBLE_NM``, (471,), 0 beyond its ends."""
    return np.interp(VISIBLE_NM, *colour_spectrum(name), left=0.0, right=0.0)


def daylight(kelvin: float) -> np.ndarray:
    """Relative spectrum (471,) of CIE daylight at ``VISIBLE_NM``, of a colour temperature of 4000 to 25 000 K.

    CIE 015:2018, section 4.1.2: S0 + M1 S1 + M2 S2, M1 and M2 to three decimals, linear between 5 nm.
    """
    warm, cool = (0.244063, 0.09911, 2.9678, -4.6070), (0.23704, 0.24748, 1.9018, -2.0064)
    x = float(np.polynomial.polynomial.polyval(1e3 / kelvin, warm if kelvin <= 7000.0 else cool))
    y = -3.0 * x**2 + 2.87 * x - 0.275
    m = 0.0241 + 0.2562 * x - 0.7341 * y
    m1 = round((-1.3515 - 1.7703 * x + 5.9114 * y) / m, 3)
    m2 = round((0.0300 - 31.4424 * x + 30.0717 * y) / m, 3)
    s0, s1, s2 = (at_visible(f"daylight S{k}") for k in range(3))
    return s0 + m1 * s1 + m2 * s2


def hermite_weights(x: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Four nodes (T, 4, int) and their weights (T, 4) of a local cubic interpolation from nodes x (N,) to target (T,).

    Cubic Hermite between increasing nodes; the slope at a node is that of the parabola through three neighbours, at the
    ends of the outermost pair.  A node that stands twice is such an end on both its sides; a target on it takes the
    upper one.  Exact for straight lines, reproduces the nodes.  Targets beyond the nodes take the outermost value.  One
    node means a constant.
    """
    x, t = np.asarray(x, dtype=float), np.clip(np.asarray(target, dtype=float), x[0], x[-1])
    n = x.size
    if n == 1:
        return np.zeros((t.size, 4), int), np.tile([1.0, 0.0, 0.0, 0.0], (t.size, 1))
    j = np.clip(np.searchsorted(x, t, side="right") - 1, 0, n - 2)
    nodes = np.clip(j[:, None] + np.arange(-1, 3), 0, n - 1)
    h = x[j + 1] - x[j]
    before, after = x[j] - x[nodes[:, 0]], x[nodes[:, 3]] - x[j + 1]
    before = np.where(before > 0.0, before, np.inf)
    after = np.where(after > 0.0, after, np.inf)
    # Weight of the inner secant in the slope at either end; the rest belongs to the neighbouring secant.
    left, right = 1.0 / (1.0 + h / before), 1.0 / (1.0 + h / after)
    u = (t - x[j]) / h
    p, q = u * (1 - u) ** 2, u**2 * (1 - u)
    inner = p * left - q * right
    outer_left, outer_right = p * (1 - left) * h / before, q * (1 - right) * h / after
    weights = np.stack(
        [
            -outer_left,
            (1 + 2 * u) * (1 - u) ** 2 - inner + outer_left,
            u**2 * (3 - 2 * u) + inner + outer_right,
            -outer_right,
        ],
        axis=1,
    )
    return nodes, weights


def linear_weights(x: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two nodes (T, 2, int) and their weights (T, 2) of straight lines between nodes x (N,), held beyond them."""
    x, t = np.asarray(x, dtype=float), np.clip(np.asarray(target, dtype=float), x[0], x[-1])
    if x.size == 1:
        return np.zeros((t.size, 2), int), np.tile([1.0, 0.0], (t.size, 1))
    j = np.clip(np.searchsorted(x, t, side="right") - 1, 0, x.size - 2)
    u = (t - x[j]) / (x[j + 1] - x[j])
    return np.stack([j, j + 1], axis=1), np.stack([1.0 - u, u], axis=1)


def hermite_matrix(x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """``hermite_weights`` as a matrix (T, N)."""
    nodes, weights = hermite_weights(x, target)
    matrix = np.zeros((weights.shape[0], np.size(x)))
    np.add.at(matrix, (np.arange(weights.shape[0])[:, None], nodes), weights)
    return matrix


def expand(factor: np.ndarray, wavelength_nm: np.ndarray, target_nm: np.ndarray = VISIBLE_NM) -> np.ndarray:
    """Interpolate smooth, non-negative spectra (..., W) to the target wavelengths, (..., T), in the logarithm.

    Inside the sampled range the logarithm is a local cubic in ln(wavelength) (``hermite_matrix``), so that power laws
    are exact; beyond it the spectrum goes on as a power of the wavelength, with the exponent of the outermost pair of
    samples held within +-``STEEPEST_EXPONENT``.  A spectrum with a zero is interpolated linearly instead and held
    constant beyond the samples.  A single sample means a constant.  float32 in, float32 out.
    """
    factor = np.asarray(factor)
    work = np.dtype(np.float32 if factor.dtype == np.float32 else np.float64)
    wavelength = np.asarray(wavelength_nm, dtype=float)
    target = np.asarray(target_nm, dtype=float)
    flat: np.ndarray = factor.reshape(-1, factor.shape[-1]).astype(work, copy=False)
    if wavelength.size == 1:
        out = np.repeat(flat, target.size, axis=1)
        return out.reshape(*factor.shape[:-1], target.size)
    positive = np.all(flat > 0, axis=1)
    logarithm = np.log(np.where(positive[:, None], flat, 1.0))
    # The scale is taken out so that float32 keeps its digits far from 1.
    scale = logarithm.mean(axis=1, keepdims=True)
    logarithm -= scale
    out = logarithm @ hermite_matrix(np.log(wavelength), np.log(target)).T.astype(work)
    log_target, x = np.log(target), np.log(wavelength)
    for beyond, edge, inner in ((target < wavelength[0], 0, 1), (target > wavelength[-1], -1, -2)):
        if beyond.any():
            exponent = (logarithm[:, edge] - logarithm[:, inner]) / work.type(x[edge] - x[inner])
            exponent = np.clip(exponent, -STEEPEST_EXPONENT, STEEPEST_EXPONENT)
            out[:, beyond] += exponent[:, None] * (log_target[beyond] - x[edge]).astype(work)
    np.exp(out, out=out)
    out *= np.exp(scale)
    if not positive.all():
        linear = np.stack([np.interp(target, wavelength, hat) for hat in np.eye(wavelength.size)]).astype(work)
        out[~positive] = flat[~positive] @ linear
    return out.reshape(*factor.shape[:-1], target.size)


def solar_at(target_nm: np.ndarray, name: str = DEFAULT_SOLAR_SPECTRUM, distance_au: float = 1.0) -> np.ndarray:
    """Solar irradiance [W m^-2 nm^-1] at whole nanometres within the spectrum, (T,)."""
    grid, irradiance = solar_spectrum(name)
    return irradiance[np.searchsorted(grid, target_nm)] / distance_au**2


def solar_at_visible(name: str = DEFAULT_SOLAR_SPECTRUM, distance_au: float = 1.0) -> np.ndarray:
    """Solar irradiance [W m^-2 nm^-1] at ``VISIBLE_NM``, (471,)."""
    return solar_at(VISIBLE_NM, name, distance_au)


def integrate(
    factor: np.ndarray, wavelength_nm: np.ndarray, weight: np.ndarray, grid_nm: np.ndarray = VISIBLE_NM
) -> np.ndarray:
    """Sum over 1 nm of ``expand(factor)`` times ``weight``, for factors (..., W) and weights (G,) or (G, K) at grid_nm.

    grid_nm: consecutive whole nanometres, (G,).  Returns (...) or (..., K).  Where the samples are 5 nm or more apart
    the expansion is evaluated every 5 nm and taken to 1 nm by ``hermite_matrix``, which is folded into the weights
    once: 5 times faster, the same to 2e-5.  Works through large arrays in pieces and, beyond 1e5 spectra, in float32
    (5e-6).
    """
    factor, wavelength = np.asarray(factor), np.asarray(wavelength_nm, dtype=float)
    flat = factor.reshape(-1, factor.shape[-1])
    columns, target = weight.reshape(weight.shape[0], -1), grid_nm
    if np.diff(wavelength).min(initial=np.inf) >= 5.0:
        target = np.arange(grid_nm[0], grid_nm[-1] + 5.0, 5.0)
        columns = hermite_matrix(target, grid_nm).T @ columns
    if flat.shape[0] > 100_000:
        flat = flat.astype(np.float32, copy=False)
    out = np.empty((flat.shape[0], columns.shape[1]))
    for start in range(0, flat.shape[0], 4096):
        part = slice(start, start + 4096)
        out[part] = expand(flat[part], wavelength, target) @ columns.astype(flat.dtype)
    return out.reshape(factor.shape[:-1] + weight.shape[1:])


def to_rec709(chromaticities: tuple[float, ...]) -> np.ndarray | None:
    """Matrix (3, 3) from linear RGB with x, y of red, green, blue and white (8 numbers); None: it is Rec. 709.

    ValueError where these are no primaries.
    """
    return from_xyz(rgb_to_xyz(chromaticities))


def rgb_to_xyz(chromaticities: tuple[float, ...]) -> np.ndarray:
    """Matrix (3, 3) to XYZ from linear RGB of primaries; arguments and errors as `to_rec709`."""
    x, y = np.reshape(np.asarray(chromaticities, dtype=float), (4, 2)).T
    if not np.isfinite([x, y]).all() or y[3] <= 0.0:
        raise ValueError("no chromaticities")
    primaries = np.array([x[:3], y[:3], 1.0 - x[:3] - y[:3]])
    white = np.array([x[3], y[3], 1.0 - x[3] - y[3]]) / y[3]
    if abs(np.linalg.det(primaries)) < 1e-6:
        raise ValueError("primaries on one line")
    return np.asarray(primaries * np.linalg.solve(primaries, white))


def from_xyz(rgb_to_xyz: np.ndarray) -> np.ndarray | None:
    """The matrix (3, 3) to linear Rec. 709 for one to XYZ (CIE 1931); None: it is Rec. 709."""
    matrix = xyz_to_rgb_matrix("cie1931_2deg") @ rgb_to_xyz
    return None if np.abs(matrix - np.eye(3)).max() < SAME_MATRIX else np.asarray(matrix)
