"""A user's own aerosol: spheres of given sizes and refractive index, a power law, or tables of its optics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twilight.atmosphere.aerosols import MixtureOptics, mixture_of
from twilight.atmosphere.csv_columns import Columns, read_columns
from twilight.atmosphere.levels import interpolate_coefficient
from twilight.atmosphere.mie import LogNormal
from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.numerics.phase import PhaseFunction

MAX_RADIUS_UM = 100.0
"""Largest radius of a mode that gives none [um]."""

OPTICS_COLUMNS: Columns = {
    "wavelength_nm": (100.0, 20000.0, "100 to 20000"),
    "extinction_per_km": (0.0, 1e6, "0 to 1e6"),
    "single_scattering_albedo": (0.0, 1.0, "0 to 1"),
    "asymmetry": (-0.9999, 0.9999, "-0.9999 to 0.9999"),
}
"""Columns of a file of optics, with the range that is allowed."""

PHASE_COLUMNS: Columns = {
    "wavelength_nm": (100.0, 20000.0, "100 to 20000"),
    "angle_deg": (0.0, 180.0, "0 to 180"),
    "phase_per_sr": (1e-30, 1e30, "1e-30 to 1e30"),
}
"""Columns of a file of a phase function, with the range that is allowed."""

MATRIX_COLUMNS: Columns = {
    name: (-1.0, 1.0, "-1 to 1") for name in ("p12_ratio", "p22_ratio", "p33_ratio", "p34_ratio")
}
"""Further columns of such a file, for polarised light: elements of the phase matrix over P11."""


@dataclass(frozen=True)
class SizeMode:
    """Spheres of one log-normal size distribution.

    number_density_per_cm3: of all of them; sigma: geometric standard deviation of the radii.
    min_radius_um, max_radius_um: None leaves out what carries no light: 5 ln sigma below the median and above the mode
        of the cross section, and radii above 100 um.
    index: refractive index n - ik (V,) at wavelength_nm (V,), linear in between and constant outside.
    """

    number_density_per_cm3: float
    median_radius_um: float
    sigma: float
    wavelength_nm: Sequence[float]
    index: Sequence[complex]
    min_radius_um: float | None = None
    max_radius_um: float | None = None

    def size(self) -> LogNormal:
        width = np.log(self.sigma)
        low = self.median_radius_um * np.exp(-5.0 * width) if self.min_radius_um is None else self.min_radius_um
        high = self.max_radius_um
        if high is None:
            high = min(MAX_RADIUS_UM, self.median_radius_um * np.exp(2.0 * width**2 + 5.0 * width))
        if not low < high:
            raise TwilightError(f"aerosol.modes: min_radius_um, {low:g}, must be below max_radius_um, {high:g}")
        return LogNormal(self.median_radius_um, self.sigma, float(low), float(high))

    def index_at(self, wavelength_nm: np.ndarray) -> np.ndarray:
        index = np.asarray(self.index, dtype=complex)
        return np.interp(wavelength_nm, self.wavelength_nm, index.real) + 1j * np.interp(
            wavelength_nm, self.wavelength_nm, index.imag
        )


@dataclass(frozen=True)
class SizeModes:
    """An external mixture of modes, by Mie theory."""

    modes: tuple[SizeMode, ...]

    def optics(self, wavelength_nm, phase_function: str, name: str) -> MixtureOptics:
        wavelength = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
        particles = [(mode.number_density_per_cm3, mode.size(), mode.index_at(wavelength)) for mode in self.modes]
        return mixture_of(particles, wavelength, phase_function, name)


@dataclass(frozen=True)
class AngstromLaw:
    """Extinction as a power of the wavelength, (wavelength / 550 nm)^-exponent per km; the amount is scaled elsewhere.

    Source: Angstrom 1929, Geogr. Ann. 11, 156.  Albedo and asymmetry (Henyey-Greenstein) do not change with wavelength.
    """

    exponent: float
    single_scattering_albedo: float
    asymmetry: float

    def optics(self, wavelength_nm, phase_function: str, name: str) -> MixtureOptics:
        wavelength = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
        phase = PhaseFunction.henyey_greenstein(np.full(wavelength.size, self.asymmetry), name)
        albedo = np.full(wavelength.size, self.single_scattering_albedo)
        return MixtureOptics((wavelength / 550.0) ** -self.exponent, albedo, phase)


@dataclass(frozen=True)
class OpticsFile:
    """Extinction, albedo, and asymmetry or a phase function from files; see :func:`read_optics`, :func:`read_phase`."""

    file: str
    phase_file: str | None = None

    def optics(self, wavelength_nm, phase_function: str, name: str) -> MixtureOptics:
        wavelength = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
        table = read_optics(Path(self.file), with_asymmetry=self.phase_file is None)
        at = {key: _at(Path(self.file), table, key, wavelength) for key in table if key != "wavelength_nm"}
        if self.phase_file is None:
            phase = PhaseFunction.henyey_greenstein(at["asymmetry"], name)
        else:
            phase = read_phase(Path(self.phase_file), wavelength, name)
            if phase_function == "henyey_greenstein":
                phase = PhaseFunction.henyey_greenstein(phase.asymmetry, name)
        return MixtureOptics(at["extinction_per_km"], at["single_scattering_albedo"], phase)


OwnAerosol = SizeModes | AngstromLaw | OpticsFile


def read_optics(file: Path, with_asymmetry: bool) -> dict[str, np.ndarray]:
    """Columns of a CSV file with one row per wavelength, in the order of the wavelengths.

    wavelength_nm, extinction_per_km, single_scattering_albedo and, where no phase function is given, asymmetry.
    """
    columns = {key: value for key, value in OPTICS_COLUMNS.items() if with_asymmetry or key != "asymmetry"}
    names, rows, lines = read_columns(file, columns)
    order = np.argsort(rows[:, 0], kind="stable")
    repeated = np.flatnonzero(np.diff(rows[order, 0]) == 0)
    if repeated.size:
        line = lines[order[repeated[0] + 1]]
        raise TwilightError(f"{file}: line {line}: wavelength_nm {rows[order[repeated[0]], 0]:g} is given twice")
    return dict(zip(names, rows[order].T, strict=True))


def read_phase(file: Path, wavelength_nm: np.ndarray, name: str = "") -> PhaseFunction:
    """The phase function of a CSV file with one row per wavelength and angle, at wavelengths (W,) inside its range.

    Columns: wavelength_nm, angle_deg (each wavelength from 0 to 180, increasing), phase_per_sr (with any factor, it is
    normalised), and for polarised light p12_ratio, p33_ratio and, if wanted, p22_ratio and p34_ratio: elements of the
    phase matrix over the phase function.  Its logarithm is linear between angles, and in
    the logarithm of the wavelength between wavelengths.
    """
    names, rows, lines = read_columns(file, PHASE_COLUMNS, MATRIX_COLUMNS)
    elements = {key: i for i, key in enumerate(names) if key in MATRIX_COLUMNS}
    tabulated = []
    table_nm = np.unique(rows[:, 0])
    for w in table_nm:
        selected = np.flatnonzero(rows[:, 0] == w)
        angle = rows[selected, 1]
        if np.any(np.diff(angle) <= 0):
            line = lines[selected[int(np.argmax(np.diff(angle) <= 0)) + 1]]
            raise TwilightError(f"{file}: line {line}: angle_deg must increase for wavelength_nm {w:g}")
        if angle[0] != 0.0 or angle[-1] != 180.0:
            raise TwilightError(
                f"{file}: line {lines[selected[0]]}: angle_deg must go from 0 to 180 for wavelength_nm {w:g}, "
                f"not from {angle[0]:g} to {angle[-1]:g}"
            )
        more = {key: rows[selected, i][None, :] for key, i in elements.items()}
        tabulated.append(PhaseFunction.from_samples(np.radians(angle), rows[selected, 2][None, :], name, **more))
    lower, fraction = _between(file, table_nm, wavelength_nm)
    upper = np.minimum(lower + 1, table_nm.size - 1)
    log_table = np.concatenate([p.log_table for p in tabulated])
    ratios = np.concatenate([p.ratios for p in tabulated], axis=1)
    f = fraction[:, None]
    mixed = log_table[lower] * (1 - f) + log_table[upper] * f
    return PhaseFunction.from_log_table(mixed, name, ratios[:, lower] * (1 - f) + ratios[:, upper] * f)


def _between(file: Path, table_nm: np.ndarray, wavelength_nm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the wavelength of the table below each, and how far it is to the next in the logarithm."""
    slack = ROUNDING
    outside = (wavelength_nm < table_nm[0] * (1 - slack)) | (wavelength_nm > table_nm[-1] * (1 + slack))
    if np.any(outside):
        raise TwilightError(
            f"{file}: wavelength_nm {wavelength_nm[outside][0]:g} is outside the table, which has {table_nm[0]:g} to "
            f"{table_nm[-1]:g} nm"
        )
    position = np.interp(np.log(wavelength_nm), np.log(table_nm), np.arange(table_nm.size))
    lower = np.clip(np.floor(position).astype(int), 0, max(0, table_nm.size - 2))
    return lower, position - lower


def _at(file: Path, table: Mapping[str, np.ndarray], key: str, wavelength_nm: np.ndarray) -> np.ndarray:
    """A column at other wavelengths: extinction log-log (linear where one end is 0), others linear in the logarithm."""
    lower, fraction = _between(file, table["wavelength_nm"], wavelength_nm)
    low, high = table[key][lower], table[key][np.minimum(lower + 1, table[key].size - 1)]
    if key == "extinction_per_km":
        return interpolate_coefficient(low, high, fraction)
    return low * (1 - fraction) + high * fraction
