"""A medium from a table, so that different codes can be compared on exactly the same air.

A CSV file with one header line and one row per level and wavelength.  Lines that begin with # are comments.  Columns,
in any order: altitude_km, wavelength_nm, air_scattering_per_km, aerosol_extinction_per_km,
aerosol_single_scattering_albedo, aerosol_asymmetry, absorption_per_km, refractivity.

For each wavelength the altitudes must go up (or all go down) and be the same as for the others; an altitude given twice
is a jump.  The lowest level is the ground, whatever its altitude; above the highest is vacuum.  Between levels
coefficients go exponentially (linearly where one end is 0), but the scattering and the refractivity of air through all
levels up to a jump as smooth curves, monotone cubics of the logarithm; albedo goes linearly, and the aerosol's phase
function as a linear mixture of the Henyey-Greenstein functions of the two levels.
"""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from twilight.atmosphere.build import check_ground_albedo
from twilight.atmosphere.csv_columns import Columns, read_columns
from twilight.atmosphere.levels import interpolate_coefficient
from twilight.atmosphere.medium import Medium
from twilight.atmosphere.own_aerosol import read_phase
from twilight.base.conventions import EARTH_RADIUS_KM, ROUNDING
from twilight.base.errors import TwilightError
from twilight.numerics.phase import PhaseFunction

COLUMNS: Columns = {
    "altitude_km": (-1.0, 2000.0, "-1 to 2000"),
    "wavelength_nm": (100.0, 20000.0, "100 to 20000"),
    "air_scattering_per_km": (0.0, 1e6, "0 to 1e6"),
    "aerosol_extinction_per_km": (0.0, 1e6, "0 to 1e6"),
    "aerosol_single_scattering_albedo": (0.0, 1.0, "0 to 1"),
    "aerosol_asymmetry": (-0.9999, 0.9999, "-0.9999 to 0.9999"),
    "absorption_per_km": (0.0, 1e6, "0 to 1e6"),
    "refractivity": (0.0, 0.1, "0 to 0.1"),
}
"""Columns of a table, with the range that is allowed."""

ASYMMETRY = "aerosol_asymmetry"
"""The column that a table with a phase function of its own does not have."""

PHASE_MODELS: dict[str, Callable] = {
    "henyey_greenstein": PhaseFunction.henyey_greenstein,
    "cornette_shanks": PhaseFunction.cornette_shanks,
}
"""Phase functions of an asymmetry, by name."""

MAX_PHASE_FUNCTIONS = 8
"""With more different asymmetries than this at one wavelength, a grid of so many stands for them."""


def medium_from_table(
    path: str | os.PathLike,
    *,
    ground_albedo=0.0,
    depolarisation=0.0,
    wavelength_nm=None,
    phase_function: str | os.PathLike | None = None,
    phase_model: str = "henyey_greenstein",
    earth_radius_km: float = EARTH_RADIUS_KM,
    name: str = "",
) -> Medium:
    """The medium of a table (see the module's text), at the table's own wavelengths or at others inside its range.

    depolarisation: of the Rayleigh phase function, one number or one per wavelength; 0 gives 3/(16 pi)(1 + cos^2).
    wavelength_nm: None for the table's.  Others are interpolated: the logarithm of coefficients and refractivity
        linearly in the logarithm of the wavelength (linearly where one end is 0), albedo and asymmetry linearly in it.

    phase_function: file of the aerosol's phase function at all levels (``own.read_phase``); the table then has no
        column aerosol_asymmetry.

    Without it the phase function at every level is the Henyey-Greenstein function of the table's asymmetry, or, where
    phase_model is `cornette_shanks`, that of Cornette and Shanks with the asymmetry as its g.  Where one wavelength has
    more than 8 different asymmetries, each is a mixture of the two nearest of 8 with the right mean cosine.
    Raises TwilightError, with file, line and column, on anything that is not allowed.
    """
    file = Path(path)
    names = {key: value for key, value in COLUMNS.items() if phase_function is None or key != ASYMMETRY}
    altitude, table_nm, columns = _grid(file, *read_columns(file, names))
    if wavelength_nm is None:
        wavelength = table_nm
    else:
        wavelength = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
        columns = _at_wavelengths(file, columns, table_nm, wavelength)
    albedo = check_ground_albedo(ground_albedo, wavelength.size)
    depolarisation = _check_depolarisation(depolarisation, wavelength.size)
    if phase_function is None:
        phase_fraction, phases = _phase_functions(columns[ASYMMETRY], PHASE_MODELS[phase_model])
    else:
        phase_fraction = np.ones((1, altitude.size, wavelength.size))
        phases = (read_phase(Path(phase_function), wavelength),)
    if not np.any(columns["aerosol_extinction_per_km"] > 0):
        phase_fraction, phases = phase_fraction[:0], ()
    return Medium(
        wavelength_nm=wavelength,
        altitude_km=altitude,
        air_scattering_per_km=columns["air_scattering_per_km"],
        absorption_per_km=columns["absorption_per_km"],
        aerosol_extinction_per_km=columns["aerosol_extinction_per_km"],
        aerosol_single_scattering_albedo=columns["aerosol_single_scattering_albedo"],
        aerosol_phase_fraction=phase_fraction,
        phase_functions=phases,
        refractivity=columns["refractivity"],
        depolarisation=depolarisation,
        ground_albedo=albedo,
        overhead_absorption_optical_depth=np.zeros(wavelength.size),
        earth_radius_km=earth_radius_km,
        name=name or file.stem,
        notes={"table": file.name},
    )


def _check_depolarisation(depolarisation, n_wavelengths: int) -> np.ndarray:
    values = np.asarray(depolarisation, dtype=float)
    if values.ndim > 1 or values.size not in (1, n_wavelengths) or not np.all((values >= 0) & (values <= 1)):
        raise TwilightError(f"medium.depolarisation must be 1 or {n_wavelengths} numbers between 0 and 1")
    return np.broadcast_to(values.ravel(), (n_wavelengths,)).astype(float)


def _grid(
    file: Path, names: list[str], rows: np.ndarray, lines: list[int]
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Altitudes (L,), wavelengths (W,) and the other columns as (L, W)."""
    wavelengths = np.unique(rows[:, 1])
    by_wavelength = [_upwards(file, rows, lines, np.flatnonzero(rows[:, 1] == w)) for w in wavelengths]
    altitudes = [rows[selected, 0] for selected in by_wavelength]
    _check_same_levels(file, wavelengths, altitudes)
    z = altitudes[0]
    if z.size < 2 or z[-1] <= z[0]:
        raise TwilightError(f"{file}: the table has one altitude, at least two are needed")
    stacked = np.stack([rows[selected] for selected in by_wavelength], axis=1)
    return z, wavelengths, {key: np.ascontiguousarray(stacked[:, :, names.index(key)]) for key in names[2:]}


def _upwards(file: Path, rows: np.ndarray, lines: list[int], selected: np.ndarray) -> np.ndarray:
    """The rows of one wavelength from the ground up; raises TwilightError where the altitudes turn round."""
    z = rows[selected, 0]
    if z.size > 1 and z[-1] < z[0]:
        selected, z = selected[::-1], z[::-1]
    at_wavelength = f"for wavelength_nm {rows[selected[0], 1]:g}"
    step = np.diff(z)
    if np.any(step < 0):
        worst = int(np.argmax(step < 0))
        number = max(lines[selected[worst]], lines[selected[worst + 1]])
        raise TwilightError(
            f"{file}: line {number}: altitude_km goes both up and down {at_wavelength}; the rows of one wavelength "
            f"must be in the order of their altitudes"
        )
    repeated = np.flatnonzero((step[:-1] == 0) & (step[1:] == 0))
    if repeated.size:
        raise TwilightError(
            f"{file}: line {lines[selected[repeated[0] + 2]]}: altitude_km {z[repeated[0]]:g} is given more than twice "
            f"{at_wavelength}; once is a level, twice is a jump"
        )
    return selected


def _check_same_levels(file: Path, wavelengths: np.ndarray, altitudes: list[np.ndarray]) -> None:
    """One row for every pair of level and wavelength."""
    first = altitudes[0]
    if all(np.array_equal(z, first) for z in altitudes):
        return
    levels = np.unique(np.concatenate(altitudes))
    counts = np.array([[np.count_nonzero(z == level) for z in altitudes] for level in levels])
    level, k = np.argwhere(counts < counts.max(axis=1)[:, None])[0]
    which = "no row" if counts[level, k] == 0 else "only one of two rows"
    raise TwilightError(
        f"{file}: there is {which} for altitude_km {levels[level]:g} and wavelength_nm {wavelengths[k]:g}; "
        f"one row is needed for every pair of level and wavelength"
    )


def _at_wavelengths(
    file: Path, columns: dict[str, np.ndarray], table_nm: np.ndarray, wavelength: np.ndarray
) -> dict[str, np.ndarray]:
    """The columns (L, W) at other wavelengths, inside the table's range."""
    if wavelength.ndim != 1 or wavelength.size == 0 or not np.all(np.isfinite(wavelength)):
        raise TwilightError("wavelength_nm must be a list of one or more numbers")
    if np.any(np.diff(wavelength) <= 0):
        raise TwilightError("wavelength_nm must increase from one wavelength to the next")
    slack = ROUNDING
    if wavelength[0] < table_nm[0] * (1 - slack) or wavelength[-1] > table_nm[-1] * (1 + slack):
        bad = wavelength[0] if wavelength[0] < table_nm[0] * (1 - slack) else wavelength[-1]
        raise TwilightError(
            f"{file}: wavelength_nm {bad:g} is outside the table, which has {table_nm[0]:g} to {table_nm[-1]:g} nm"
        )
    if table_nm.size == 1 or np.array_equal(wavelength, table_nm):
        return columns
    upper = np.clip(np.searchsorted(table_nm, wavelength), 1, table_nm.size - 1)
    lower = upper - 1
    fraction = np.log(wavelength / table_nm[lower]) / np.log(table_nm[upper] / table_nm[lower])
    fraction = np.clip(fraction, 0.0, 1.0)
    out = {}
    for key, values in columns.items():
        low, high = values[:, lower], values[:, upper]
        if key in ("aerosol_single_scattering_albedo", ASYMMETRY):
            out[key] = low * (1 - fraction) + high * fraction
        else:
            out[key] = interpolate_coefficient(low, high, fraction[None, :])
    return out


def _phase_functions(asymmetry: np.ndarray, of: Callable) -> tuple[np.ndarray, tuple[PhaseFunction, ...]]:
    """Fractions (K, L, W) and K phase functions of(g) that together give the asymmetry (L, W) at every level."""
    n_levels, n_wavelengths = asymmetry.shape
    nodes = [np.unique(column) for column in asymmetry.T]
    count = max(node.size for node in nodes)
    if count > MAX_PHASE_FUNCTIONS:
        count = MAX_PHASE_FUNCTIONS
        nodes = [node if node.size <= count else np.linspace(node[0], node[-1], count) for node in nodes]
    phase_fraction = np.zeros((count, n_levels, n_wavelengths))
    g = np.empty((count, n_wavelengths))
    for w, node in enumerate(nodes):
        g[:, w] = np.append(node, np.full(count - node.size, node[-1]))
        position = np.interp(asymmetry[:, w], node, np.arange(node.size))
        phase_fraction[: node.size, :, w] = np.maximum(0.0, 1.0 - np.abs(position - np.arange(node.size)[:, None]))
    return phase_fraction, tuple(of(row) for row in g)
