"""A screen beyond the horizon, fitted to spectra of level ground recorded through twilight.

Light is linear in the direct beam, and T(h), the part of the beams that passes at a least altitude h
(`twilight.atmosphere.screen`), is linear between nodes h_0 ... h_J.  With p_j >= 0 the rise of T from h_{j-1} to h_j,
p_0 = T(h_0), and T = 1 at the last of them,

    E(sun, wavelength) = sum_j p_j E_j(sun, wavelength),      sum_j p_j = 1,

E_j being the irradiance under a screen that rises from 0 to 1 between the two nodes (E_0: without a screen).  The p_j
that make the colours nearest to those recorded are sought, in the mean square of

    r(sun, wavelength) = ln computed - ln recorded - its mean over the wavelengths,

so that every spectrum has a level of its own (clouds overhead, the sensor).  As clouds with one top each: cover
1 - p_0, and their tops the distribution p_j / (1 - p_0).  With a free calibration the mean of r over the suns goes too.
What a sensor makes of colours is read from the recording's own day: with the sun at `DAY_DEG` and above nothing beyond
the horizon matters, and the recorded light is divided by its mean ratio to what is computed there, wavelength by
wavelength (`on_own_day`).
The zenith, which no such spectrum holds, may become fainter by a limit.  Standard errors: the fit without each of the
suns in turn (jackknife), for residuals of neighbouring wavelengths are not independent.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from twilight.atmosphere.csv_columns import cells_of
from twilight.atmosphere.screen import Screen
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.config.scene import TYPICAL, Config, Observer
from twilight.engine.field import solve
from twilight.numerics.spectrum import solar_irradiance
from twilight.scene import resolve
from twilight.scene.usual import CLEAN

WAVELENGTHS_NM = (400.0, 424.0, 450.0, 490.0, 520.0, 550.0, 603.0, 650.0)
"""Where spectra are compared: between the bands of the gases."""
HALF_WIDTH_NM = 6.0
"""A recorded wavelength is the mean of those within this distance [nm]."""
DAY_DEG = (9.0, 30.0)
"""Suns of a recording's own day [deg]."""
REFERENCE_NM = 550.0
"""Of the green that blue and red are divided by [nm]."""
HEIGHTS_KM = (0.0, 3.0, 5.0, 6.5, 8.0, 9.5, 11.0, 13.0, 16.0, 20.0)
"""Nodes of T(h)."""
FROM_KM = (0.0, 150.0, 300.0)
"""Distances at which a screen may begin."""
ZENITH_BELOW_DEG = -4.0
"""The zenith's limit holds for the suns at this elevation and below."""
SUN_NAMES = ("sun_elevation_deg", "elevation_deg")
"""Names that a file's column of the sun's elevation [deg] may have."""
SERIES_NAMES = ("session", "run")
"""Names that the column may have that parts several series in one file."""


@dataclass(frozen=True)
class Recorded:
    """Irradiance of level ground (S, W), any unit, by the sun's elevation (S,) [deg] and wavelength (W,) [nm]."""

    sun_deg: np.ndarray
    wavelength_nm: np.ndarray
    irradiance: np.ndarray


@dataclass(frozen=True)
class Basis:
    """Light under each part of a screen that begins at `from_km`: ground (J, S, W), and zenith (J, S) at 550 nm."""

    from_km: float
    ground: np.ndarray
    zenith: np.ndarray


@dataclass(frozen=True)
class Fit:
    """A fitted screen and what it leaves.

    rises (J,): p_j; stderr (J,): of T at HEIGHTS_KM; log_ratio, log_bare (S, W): ln computed - ln recorded, over their
    level, under the screen and without; calibration (W,): factor on what is computed, 1 unless it was free;
    zenith_mag (S,): by how much the zenith is fainter than without a screen.
    """

    from_km: float
    rises: np.ndarray
    stderr: np.ndarray
    log_ratio: np.ndarray
    log_bare: np.ndarray
    calibration: np.ndarray
    zenith_mag: np.ndarray

    @property
    def transmission(self) -> np.ndarray:
        """T at HEIGHTS_KM, (J,)."""
        return np.minimum(np.cumsum(self.rises), 1.0)

    @property
    def rms(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.log_ratio**2)))

    @property
    def clouds(self) -> tuple[float, float, float]:
        """(cover, mean, standard deviation of the tops [km]) of clouds that are this screen."""
        cover = float(self.rises[1:].sum())
        middle = 0.5 * (np.array(HEIGHTS_KM[1:]) + np.array(HEIGHTS_KM[:-1]))
        if cover < 1e-3:
            return 0.0, 0.0, 0.0
        weight = self.rises[1:] / cover
        mean = float(weight @ middle)
        return cover, mean, float(np.sqrt(weight @ (middle - mean) ** 2))

    def screen(self) -> Screen:
        """The screen itself."""
        return Screen(HEIGHTS_KM, tuple(float(t) for t in self.transmission), self.from_km)


def read_spectra(path: Path, series: str | None = None) -> Recorded:
    """Spectra of a CSV: a column of the sun's elevation, one for each wavelength with its number [nm] as a name, and
    perhaps one that parts several series, of which `series` is one.

    Errors: TwilightError that names the file, the line or the column, and what is allowed.
    """
    lines = cells_of(path)
    names = lines[0][1] if lines else []
    sun = next((name for name in SUN_NAMES if name in names), None)
    columns = [name for name in names if name.replace(".", "", 1).isdigit()]
    if sun is None or len(columns) < 2:
        raise TwilightError(
            f"{path}: needs a first line with {SUN_NAMES[0]} and two wavelengths [nm] or more as names of columns"
        )
    part = next((name for name in SERIES_NAMES if name in names), None)
    if series is not None and part is None:
        raise TwilightError(f"{path}: --series {series}: has no column {' or '.join(SERIES_NAMES)}")
    suns: list[float] = []
    spectra: list[list[float]] = []
    known: dict[str, None] = {}
    for n, cells in lines[1:]:
        row = dict(zip(names, cells, strict=True))
        if part is not None:
            known[row[part]] = None
            if series is not None and row[part] != series:
                continue
        try:
            suns.append(float(row[sun]))
            spectra.append([float(row[name]) for name in columns])
        except ValueError:
            raise TwilightError(f"{path}: line {n}: {sun} and all wavelengths must be numbers") from None
        if not -90.0 <= suns[-1] <= 90.0:
            raise TwilightError(f"{path}: line {n}: {sun} is {suns[-1]:g}; allowed is -90 to 90")
    if part is not None and (not suns or (series is None and len(known) > 1)):
        raise TwilightError(f"{path}: --series must be one of {', '.join(known)}")
    order = np.argsort(suns)[::-1]
    nm = np.array(columns, dtype=float)
    return Recorded(np.array(suns)[order], nm, np.array(spectra).reshape(-1, nm.size)[order])


def at_nodes(recorded: Recorded, highest_deg: float, lowest_deg: float) -> Recorded:
    """What is compared: suns between two elevations [deg], at those WAVELENGTHS_NM that were recorded.

    Errors: TwilightError for too few suns or wavelengths, or light that is not above 0.
    """
    rows = (recorded.sun_deg <= highest_deg) & (recorded.sun_deg >= lowest_deg)
    near = [np.abs(recorded.wavelength_nm - nm) < HALF_WIDTH_NM for nm in WAVELENGTHS_NM]
    nodes = [k for k, chosen in enumerate(near) if chosen.any()]
    if rows.sum() < 3 or len(nodes) < 2 or WAVELENGTHS_NM.index(REFERENCE_NM) not in nodes:
        raise TwilightError(
            f"the spectra hold {rows.sum()} suns from {lowest_deg:g} to {highest_deg:g} deg and {len(nodes)} of the "
            f"wavelengths {', '.join(f'{nm:g}' for nm in WAVELENGTHS_NM)} nm; needed are 3 suns and 2 wavelengths, one "
            f"of them {REFERENCE_NM:g} nm"
        )
    light = np.stack([recorded.irradiance[rows][:, near[k]].mean(axis=1) for k in nodes], axis=1)
    if not np.all(light > 0.0):
        sun, k = np.argwhere(~(light > 0.0))[0]
        raise TwilightError(
            f"the spectrum at {recorded.sun_deg[rows][sun]:g} deg is not above 0 at {WAVELENGTHS_NM[nodes[k]]:g} nm; "
            "leave such suns out"
        )
    return Recorded(recorded.sun_deg[rows], np.array([WAVELENGTHS_NM[k] for k in nodes]), light)


def bases(
    config: Config, recorded: Recorded, from_km: tuple[float, ...] = FROM_KM, progress: Progress = silent
) -> list[Basis]:
    """The light under every part of a screen, for each distance at which it may begin.

    Errors: TwilightError for a configuration that has a screen of its own, or a solver that knows none.
    """
    if config.horizon is not None and config.horizon.screen is not None:
        raise TwilightError("validate spectra: horizon.screen is what is fitted; leave it out of the configuration")
    config = config.model_copy(update={"horizon": CLEAN})
    scene = replace(resolve(config, wavelength_nm=recorded.wavelength_nm), observer=Observer(), bands=None)
    able = scene.capabilities
    if not (able.screen and able.every_sun and able.every_observer):
        raise TwilightError("validate spectra: needs a solver that knows what lies beyond the horizon, as zones")
    ramps = [(start, Screen(pair, (0.0, 1.0), start)) for start in from_km for pair in pairwise(HEIGHTS_KM)]
    solar = solar_irradiance(recorded.wavelength_nm, config.solar_spectrum)
    green = int(np.argmin(np.abs(recorded.wavelength_nm - REFERENCE_NM)))

    def light(screen: Screen | None, k: int) -> tuple[np.ndarray, np.ndarray]:
        part = part_of(progress, k / (len(ramps) + 1), 1.0 / (len(ramps) + 1))
        medium = replace(scene.medium, screen=screen)
        solved = solve(replace(scene, medium=medium), progress=part, cached=False)
        ground, zenith = [], []
        for sun in recorded.sun_deg:
            ground.append(solved.horizontal_irradiance(float(sun), direct=True) * solar)
            zenith.append(solved.radiance(float(sun), [90.0], [0.0])[0, green])
        return np.array(ground), np.array(zenith)

    bare = light(None, 0)
    parts = [light(screen, k) for k, (_, screen) in enumerate(ramps, 1)]
    count = len(HEIGHTS_KM) - 1
    return [
        Basis(start, *(np.stack(kind) for kind in zip(bare, *parts[i * count : (i + 1) * count], strict=True)))
        for i, start in enumerate(from_km)
    ]


def on_own_day(
    recorded: Recorded, made: list[Basis], highest_deg: float
) -> tuple[Recorded, list[Basis], np.ndarray | None]:
    """What was recorded, on the scale of its own day, and the bases of the same suns: those up to `highest_deg`.

    The factor (W,) is recorded over computed by day, the mean over its wavelengths 1; None, and the light as it was
    recorded, without a spectrum of a sun between `DAY_DEG`.
    """
    day = (recorded.sun_deg >= DAY_DEG[0]) & (recorded.sun_deg <= DAY_DEG[1])
    kept = recorded.sun_deg <= highest_deg
    factor = None
    light = recorded.irradiance
    if day.any():
        ratio = np.log(light[day] / made[0].ground[0, day]).mean(axis=0)
        factor = np.exp(ratio - ratio.mean())
        light = light / factor
    parts = [replace(one, ground=one.ground[:, kept], zenith=one.zenith[:, kept]) for one in made]
    return Recorded(recorded.sun_deg[kept], recorded.wavelength_nm, light[kept]), parts, factor


def fit(recorded: Recorded, basis: Basis, most_mag: float, free_calibration: bool = False) -> Fit:
    """The screen whose colours are nearest to the recorded; most_mag: by how much the zenith may become fainter."""
    every = np.ones(recorded.sun_deg.size, dtype=bool)
    rises = _solve(recorded, basis, most_mag, free_calibration, every)
    without = []
    for k in range(every.size):
        others = every.copy()
        others[k] = False
        without.append(np.cumsum(_solve(recorded, basis, most_mag, free_calibration, others, rises)))
    n = every.size
    spread = np.sqrt((n - 1.0) / n * np.sum((np.array(without) - np.mean(without, axis=0)) ** 2, axis=0))
    residual, calibration = _residuals(recorded, basis, rises, free_calibration, every)
    bare, _ = _residuals(recorded, basis, np.eye(rises.size)[0], False, every)
    fainter = -2.5 * np.log10(rises @ basis.zenith / basis.zenith[0])
    return Fit(basis.from_km, rises, spread, residual, bare, calibration, fainter)


def _residuals(
    recorded: Recorded, basis: Basis, rises: np.ndarray, free_calibration: bool, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """r (S', W) of the suns where `used` (S,) is true, and the calibration (W,)."""
    logarithms = np.log(np.tensordot(rises, basis.ground[:, used], 1) / recorded.irradiance[used])
    logarithms = logarithms - logarithms.mean(axis=1, keepdims=True)
    level = logarithms.mean(axis=0) if free_calibration else np.zeros(logarithms.shape[1])
    return logarithms - level, np.exp(-level)


def typical_rises() -> np.ndarray:
    """The preset `horizon: typical` as rises p_j (J,): where the search for a screen begins."""
    return np.diff(np.interp(HEIGHTS_KM, TYPICAL["heights_km"], TYPICAL["transmission"]), prepend=0.0)


def _solve(
    recorded: Recorded, basis: Basis, most_mag: float, free_calibration: bool, used: np.ndarray,
    start: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """The rises p_j (J,), by sequential quadratic programming with exact derivatives."""
    count = basis.ground.shape[0]
    ground = basis.ground[:, used]

    def cost(rises: np.ndarray) -> tuple[float, np.ndarray]:
        residual, _ = _residuals(recorded, basis, rises, free_calibration, used)
        slope = ground / np.tensordot(rises, ground, 1)
        # the residual's own means are 0, so that those of the slope do not count
        return float(np.sum(residual**2)), 2.0 * np.sum(residual * slope, axis=(1, 2))

    limits = [{"type": "eq", "fun": lambda p: p.sum() - 1.0, "jac": lambda p: np.ones(count)}]
    low = recorded.sun_deg <= ZENITH_BELOW_DEG
    if np.isfinite(most_mag) and low.any():
        transmittance = (basis.zenith / basis.zenith[0])[:, low].T
        least = 10.0 ** (-0.4 * most_mag)
        limits.append({"type": "ineq", "fun": lambda p: transmittance @ p - least, "jac": lambda p: transmittance})
    first = 0.9 * typical_rises() + 0.1 / count if start is None else start.copy()
    first[0] += 1.0 - first.sum()
    solution = minimize(
        cost, first, jac=True, method="SLSQP", bounds=[(0.0, 1.0)] * count, constraints=limits,
        options={"maxiter": 500, "ftol": 1e-12},
    )  # fmt: skip
    if not solution.success:
        raise TwilightError(f"no screen was found: {solution.message}")
    rises = np.clip(solution.x, 0.0, None)
    return rises / rises.sum()
