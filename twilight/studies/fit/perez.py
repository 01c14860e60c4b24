"""Preetham's procedure: Perez's five parameters for luminance and chromaticity, fitted to computed skies.

Residuals are ln(model / truth), weighted by solid angle.  The scale of every sky is free, as the zenith of a high sun
lies in the aureole, and becomes the zenith value of the set afterwards.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from twilight.base.errors import TwilightError
from twilight.solvers.analytic.coefficients import QUANTITIES, SkyCoefficients, angles, perez
from twilight.studies.fit.truth import ColourSky

STARTS = {
    "luminance": ((-0.7, -0.6, 5.0, -2.0, 0.1), (-0.3, -1.5, 5.0, -1.5, 0.0), (-1.0, -0.3, 10.0, -3.0, 0.45)),
    "x": ((-0.3, -0.2, 0.2, -1.1, 0.03), (0.5, -0.5, 0.5, -1.0, 0.0)),
    "y": ((-0.3, -0.3, 0.2, -1.8, 0.02), (0.5, -0.5, 0.5, -1.0, 0.0)),
}
"""A to E from which the search starts: near Preetham's at turbidity 3 and 5, and the clear sky of the CIE."""
BOUNDS = {
    "luminance": (np.array([-20.0, -20.0, -1.0, -20.0, -2.0]), np.array([50.0, -1e-3, 200.0, -0.05, 50.0])),
    "x": (np.array([-5.0, -20.0, -1.0, -20.0, -2.0]), np.array([5.0, -1e-3, 3.0, -0.1, 3.0])),
    "y": (np.array([-5.0, -20.0, -1.0, -20.0, -2.0]), np.array([5.0, -1e-3, 3.0, -0.1, 3.0])),
}
"""Lowest and highest A to E.  B and D stay negative, so that the horizon is finite and the sun's glow falls with the
angle; C and E of the chromaticities stay small, for they cancel each other where they are large."""
SMALLEST = 1e-9
"""Least value of the formula during the search, so that it has a logarithm."""

ANY_TURBIDITY = (1.0, 100.0)
"""Range of turbidity of coefficients that do not depend on it."""


@dataclass(frozen=True)
class SkyFit:
    """Five parameters, the value they give in the zenith, and their error, for one quantity of one sky."""

    quantity: str
    parameters: tuple[float, ...]
    zenith: float
    median_error: float
    p95_error: float


def fit_sky(sky: ColourSky) -> list[SkyFit]:
    """The five parameters of luminance, x and y of one sky.  TwilightError for a sun below the horizon."""
    if sky.sun_elevation_deg < 0:
        raise TwilightError(
            f"sun.elevation_deg is {sky.sun_elevation_deg:g}; the five parameters are for a sun from 0 to 90"
        )
    fits = []
    for quantity in QUANTITIES:
        values = _fit_parameters(quantity, [sky], 1)[0]
        shape = _shape(values, sky)
        scale = _scale(shape, sky.quantity(quantity), sky.weight)
        zenith = scale * float(perez(values, 1.0, np.radians(90.0 - sky.sun_elevation_deg)))
        error = np.abs(scale * shape / sky.quantity(quantity) - 1.0)
        fits.append(SkyFit(quantity, tuple(map(float, values)), zenith, *_quantiles(error, sky.weight)))
    return fits


def single_set(sky: ColourSky, fits: Sequence[SkyFit], name: str, source: str) -> SkyCoefficients:
    """A set of coefficients for one sky: for its sun only, and the same at every turbidity."""
    by = {fit.quantity: fit for fit in fits}
    zenith_deg = 90.0 - sky.sun_elevation_deg
    return SkyCoefficients(
        name,
        source,
        ANY_TURBIDITY,
        (zenith_deg, zenith_deg),
        {q: tuple((p,) for p in by[q].parameters) for q in QUANTITIES},
        {"luminance": ((0.0,), (by["luminance"].zenith / 1000.0,), (0.0,))}
        | {q: ((0.0,), (0.0,), (0.0,), (by[q].zenith,)) for q in ("x", "y")},
    )


def fit_set(skies: Sequence[ColourSky], name: str, source: str) -> SkyCoefficients:
    """A set of coefficients in Preetham's form for skies of several turbidities and suns.

    The parameters are linear in the turbidity, as he prints them, for all suns alike: fitted at each turbidity, then
    all together.  The zenith luminance has his form with each of its three constants linear in the turbidity, the
    zenith's x and y are cubic in the sun's zenith angle and quadratic in the turbidity.  Raises TwilightError for
    fewer than three turbidities or four suns, which do not determine these.
    """
    turbidities = sorted({float(sky.turbidity) for sky in skies})
    suns = sorted({90.0 - sky.sun_elevation_deg for sky in skies})
    if len(turbidities) < 3 or len(suns) < 4:
        raise TwilightError(f"the fit needs at least 3 turbidities and 4 suns; got {len(turbidities)} and {len(suns)}")
    distribution: dict[str, tuple[tuple[float, ...], ...]] = {}
    zenith: dict[str, tuple[tuple[float, ...], ...]] = {}
    for quantity in QUANTITIES:
        single = [_fit_parameters(quantity, [sky for sky in skies if sky.turbidity == t], 1)[0] for t in turbidities]
        linear = np.polyfit(turbidities, np.array(single), 1)
        ends = np.array([turbidities[0], turbidities[-1]])
        start = np.clip(ends[:, None] * linear[0] + linear[1], *BOUNDS[quantity])
        values = _fit_parameters(quantity, skies, 2, start)
        slope = (values[1] - values[0]) / (ends[1] - ends[0])
        rows = np.stack([slope, values[0] - slope * ends[0]], axis=1)
        distribution[quantity] = tuple(tuple(map(float, row)) for row in rows)
        scales = []
        for sky in skies:
            parameters = rows @ [sky.turbidity, 1.0]
            scale = _scale(_shape(parameters, sky), sky.quantity(quantity), sky.weight)
            scales.append(scale * float(perez(parameters, 1.0, np.radians(90.0 - sky.sun_elevation_deg))))
        t = np.array([sky.turbidity for sky in skies])
        z = np.radians([90.0 - sky.sun_elevation_deg for sky in skies])
        fit = _fit_zenith_luminance if quantity == "luminance" else _fit_zenith_chromaticity
        zenith[quantity] = fit(t, z, np.array(scales))
    coefficients = SkyCoefficients(
        name, source, (turbidities[0], turbidities[-1]), (suns[0], suns[-1]), distribution, zenith
    )
    coefficients.check(name)
    return coefficients


def _shape(parameters: np.ndarray, sky: ColourSky) -> np.ndarray:
    cosine, gamma = angles(sky.sun_elevation_deg, sky.elevation_deg, sky.azimuth_deg)
    return np.maximum(perez(parameters, cosine, gamma), SMALLEST)


def _scale(shape: np.ndarray, truth: np.ndarray, weight: np.ndarray) -> float:
    """The factor on `shape` with the smallest residuals: the mean of ln(truth / shape)."""
    return float(np.exp(np.sum(weight * np.log(truth / shape)) / np.sum(weight)))


def _fit_parameters(
    quantity: str, skies: Sequence[ColourSky], rows: int, start: np.ndarray | None = None
) -> np.ndarray:
    """Least squares over all skies: A to E (1, 5), or their values at the lowest and highest turbidity (2, 5)."""
    turbidity = np.array([sky.turbidity for sky in skies])
    low, high = turbidity.min(), turbidity.max()
    prepared = [
        (
            *angles(sky.sun_elevation_deg, sky.elevation_deg, sky.azimuth_deg),
            sky.quantity(quantity),
            sky.weight,
            (sky.turbidity - low) / (high - low) if rows == 2 else 0.0,
        )
        for sky in skies
    ]

    def residuals(values: np.ndarray) -> np.ndarray:
        ends = values.reshape(rows, 5)
        out = []
        for cosine, gamma, truth, weight, fraction in prepared:
            parameters = ends[0] * (1.0 - fraction) + ends[-1] * fraction
            logarithm = np.log(np.maximum(perez(parameters, cosine, gamma), SMALLEST) / truth)
            out.append(np.sqrt(weight) * (logarithm - np.sum(weight * logarithm)))
        return np.concatenate(out)

    lowest, highest = BOUNDS[quantity]
    best = None
    for first in [start] if start is not None else STARTS[quantity]:
        fit = least_squares(
            residuals,
            np.ravel(first),
            bounds=(np.tile(lowest, rows), np.tile(highest, rows)),
            x_scale=np.tile([1.0, 1.0, 5.0, 1.0, 0.5], rows),
            max_nfev=400,
        )
        if best is None or fit.cost < best.cost:
            best = fit
    assert best is not None
    return best.x.reshape(rows, 5)


def _fit_zenith_luminance(turbidity, sun_zenith_rad, luminance) -> tuple[tuple[float, ...], ...]:
    """slope, constant and chi, linear in the turbidity, of slope tan(chi (pi - 2 z)) + constant [kcd m^-2]."""
    ends = np.array([turbidity.min(), turbidity.max()])
    fraction = (turbidity - ends[0]) / (ends[1] - ends[0])
    truth = luminance / 1000.0

    def model(values):
        low, high = values.reshape(2, 3)
        slope, constant, chi = low[:, None] * (1 - fraction) + high[:, None] * fraction
        return slope * np.tan(chi * (np.pi - 2.0 * sun_zenith_rad)) + constant

    fit = least_squares(
        lambda values: np.log(np.maximum(model(values), SMALLEST) / truth),
        [3.0, 1.0, 0.42, 15.0, 1.0, 0.39],
        bounds=(np.tile([-100.0, 0.0, 0.01], 2), np.tile([1000.0, 100.0, 0.49], 2)),
        x_scale=np.tile([3.0, 1.0, 0.05], 2),
        max_nfev=2000,
    )
    low, high = fit.x.reshape(2, 3)
    rise = (high - low) / (ends[1] - ends[0])
    return tuple((float(r), float(c)) for r, c in zip(rise, low - rise * ends[0], strict=True))


def _fit_zenith_chromaticity(turbidity, sun_zenith_rad, value) -> tuple[tuple[float, ...], ...]:
    """Polynomials in the turbidity (degree 2) of the powers 3 to 0 of the sun's zenith angle."""
    z = np.vander(sun_zenith_rad, 4)
    t = np.vander(turbidity, 3)
    design = (z[:, :, None] * t[:, None, :]).reshape(value.size, 12)
    solution = np.linalg.lstsq(design, value, rcond=None)[0].reshape(4, 3)
    return tuple(tuple(map(float, row)) for row in solution)


def _quantiles(error: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Median and 95th percentile by solid angle."""
    order = np.argsort(error)
    fraction = np.cumsum(weight[order]) / weight.sum()
    median, high = np.interp([0.5, 0.95], fraction, error[order])
    return float(median), float(high)
