"""The air from a photograph: which aerosol, humidity, ozone, ground and sun make the sky that it shows.

Least squares of ``photo.residual_vector`` (ln(luminance), u' and v' over the clear sky, after one free exposure and, on
request, one free white balance) over a library of precomputed skies (``library``), for every aerosol type in turn.

*Uncertainty.* What is left after the fit (clouds, stitching, haze in streaks) is not noise of single cells: it is
correlated over some degrees, and the photograph counts as N = clear solid angle / CORRELATED_SR independent samples
with three numbers each.  Errors that the fit cannot see because they are correlated over the whole sky (vignetting left
over, the camera's colours, the solver) are taken to be FLOOR, in M samples, 1 to SYSTEMATIC_SAMPLES by the fraction of
the hemisphere that is seen; the library's own error is added to it.  So chi^2 = 3 Q / (Q_best / N + FLOOR / M), where Q
is the sum of squares of the residuals.
Standard errors are from its curvature, intervals from its profile (chi^2 + 1, all others fitted again).

*A parameter that the photograph does not constrain* is one whose standard deviation, limited by its bounds, is more
than UNCONSTRAINED of that of a uniform distribution between the bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.studies.validate.photographs.library import SUN, Library, Parameter
from twilight.studies.validate.photographs.photo import CHROMATICITY_SCALE, LOG_SCALE, PhotoSky, residual_vector

CORRELATED_SR = 0.1
"""Solid angle within which errors are correlated [sr]: a disc of 10 deg radius."""
FLOOR = (0.02 / LOG_SCALE) ** 2 + 2.0 * (0.0015 / CHROMATICITY_SCALE) ** 2
"""Sum of squares of errors correlated over the whole sky: 2 % in luminance and 0.0015 in u', v'."""
SYSTEMATIC_SAMPLES = 5.0
"""Independent samples of a whole hemisphere for errors correlated over the sky."""
UNCONSTRAINED = 0.6
"""Standard deviation over that of a uniform distribution beyond which a photograph does not constrain a parameter."""
PROFILE_POINTS = 8
"""Values of a parameter, around its best, at which all others are fitted again."""
AT_BOUND = 1e-6
"""Distance to a bound, as a fraction of a parameter's range, within which a value counts as at the bound."""
STEP = 2e-3
"""Step of the Jacobian's differences, as a fraction of a parameter's range."""
REFINEMENTS = 2
"""Largest number of times that a fit is repeated with skies computed at its best values."""
SETTLED = 0.01
"""Change, as a fraction of every parameter's range, below which a fit is not refined again."""

Refine = Callable[[str, Mapping[str, float]], np.ndarray]
"""From an aerosol type and the values of all parameters to the XYZ (E, A, 3) of that sky on the library's texture."""


@dataclass(frozen=True)
class Estimated:
    """One parameter: best value, standard error (curvature, in the parameter's unit; at most that of a
    uniform distribution between the bounds), interval of the profile, bounds.

    constrained: the photograph says what it is, which it does not where the fit ends at a bound.  relative_width: its
    standard deviation within the bounds over that of no knowledge.
    """

    name: str
    unit: str
    value: float
    standard_error: float
    low: float
    high: float
    bounds: tuple[float, float]
    relative_width: float
    constrained: bool


@dataclass(frozen=True, eq=False)
class AirEstimate:
    """The best climate of one aerosol type.

    misfit: sum of squares Q.  chi2_above_best: its chi^2 above that of the best type, on the best type's scale.
    correlation (P, P): of the parameters.  samples: independent ones.  values: of all parameters, with ``sun`` where it
    was fitted.
    """

    aerosol_type: str
    parameters: list[Estimated]
    misfit: float
    chi2_above_best: float
    correlation: np.ndarray
    samples: float
    values: dict[str, float] = field(default_factory=dict)


class _Problem:
    """Residuals of a photograph against a library, in parameters scaled to 0..1 within their bounds."""

    def __init__(self, photo: PhotoSky, library: Library, white_balance: bool, with_colour: bool):
        self.photo, self.library = photo, library
        self.white_balance, self.with_colour = white_balance, with_colour
        self.table = library.on(photo)
        self.shape = self.table.shape[1:]
        self.table = self.table.reshape(self.table.shape[0], -1)
        self.parameters: list[Parameter] = list(library.design.parameters)
        suns = library.sun_elevations_deg
        if suns.size > 1:
            self.parameters.append(Parameter(SUN, "sun.elevation_deg", "deg", (suns[0], suns[-1]), "linear"))
        ends = [p.scaled(np.array([p.nodes[0], p.nodes[-1]])) for p in self.parameters]
        self.low, self.high = np.array(ends).T
        self.samples = max(float(photo.solid_angle_sr.sum()) / CORRELATED_SR, 1.0)

    def variance(self, q: float) -> float:
        """Variance of the mean over the sky of one number, for a best sum of squares q."""
        seen = float(self.photo.solid_angle_sr.sum()) / (2.0 * np.pi)
        library = (self.library.luminance_error / LOG_SCALE) ** 2
        if self.with_colour:
            library += (self.library.chromaticity_error / CHROMATICITY_SCALE) ** 2
        return q / self.samples + (FLOOR + library) / (1.0 + (SYSTEMATIC_SAMPLES - 1.0) * seen)

    def values(self, x: np.ndarray) -> dict[str, float]:
        scaled = self.low + x * (self.high - self.low)
        return {p.name: float(p.value(s)) for p, s in zip(self.parameters, scaled, strict=True)}

    def error(self, x: np.ndarray, xyz: np.ndarray) -> np.ndarray:
        """Error of the library at x, where the sky itself is xyz (E, A, 3); (1, cells x 3)."""
        return self.library.cells(self.photo, xyz).reshape(1, -1) - self.library.weights(self.values(x)) @ self.table

    def correct(self, error: np.ndarray) -> None:
        """Add an error of the library to all of its skies."""
        self.table = self.table + error  # the weights of all skies sum to 1

    def residuals(self, x: np.ndarray) -> np.ndarray:
        log_xyz = (self.library.weights(self.values(x)) @ self.table).reshape(self.shape)
        xyz = np.full(self.photo.xyz.shape, np.nan)
        xyz[self.photo.counts] = np.exp(log_xyz)
        return residual_vector(self.photo, xyz, white_balance=self.white_balance, with_colour=self.with_colour)

    def fit(self, start: np.ndarray, fixed: Mapping[int, float] | None = None) -> tuple[np.ndarray, float, np.ndarray]:
        """(x, Q, Jacobian of the free ones) from a start, with some of x held."""
        fixed = fixed or {}
        free = [i for i in range(start.size) if i not in fixed]

        def full(part: np.ndarray) -> np.ndarray:
            x = start.copy()
            for i, value in fixed.items():
                x[i] = value
            x[free] = part
            return x

        if not free:
            r = self.residuals(full(np.zeros(0)))
            return full(np.zeros(0)), float(r @ r), np.zeros((r.size, 0))

        def residuals(part: np.ndarray) -> np.ndarray:
            return self.residuals(full(part))

        def jacobian(part: np.ndarray) -> np.ndarray:
            # differences over a fixed step, inwards: relative ones mean nothing for a value near 0, at a bound
            here, steps = residuals(part), np.where(part < 0.5, STEP, -STEP)
            return np.stack(
                [(residuals(part + h * e) - here) / h for h, e in zip(steps, np.eye(part.size), strict=True)], -1
            )

        inside = np.clip(start[free], 0.01, 0.99)
        found = least_squares(residuals, inside, jacobian, bounds=(0.0, 1.0), xtol=1e-5, ftol=1e-7)
        x = full(found.x)
        return np.where(x < AT_BOUND, 0.0, np.where(x > 1.0 - AT_BOUND, 1.0, x)), float(2.0 * found.cost), found.jac


def estimate(
    photo: PhotoSky,
    libraries: list[Library],
    *,
    white_balance: bool = False,
    with_colour: bool = True,
    refine: Refine | None = None,
    progress: Progress = silent,
) -> list[AirEstimate]:
    """The best climate of every library, the best type first.

    refine: computes the sky of a climate itself; all types are then fitted again with what the library of the best is
    off there taken out, REFINEMENTS times at most, so that neither the design's spacing nor the solver's quality in the
    library biases the result.

    Errors: TwilightError without a library, and where a library's suns do not suit the photograph.
    """
    if not libraries:
        raise TwilightError("estimate: needs one library of skies at least")
    fits = []
    for i, library in enumerate(libraries):
        progress(f"fitting {library.aerosol_type}", i / len(libraries))
        problem = _Problem(photo, library, white_balance, with_colour)
        starts = [np.array([aerosol, *[0.5] * (len(problem.parameters) - 1)]) for aerosol in (0.2, 0.5, 0.8)]
        fits.append((problem, *min((problem.fit(start) for start in starts), key=lambda f: f[1])))
    for _ in range(0 if refine is None else REFINEMENTS):
        assert refine is not None
        problem, x, _, _ = fits[int(np.argmin([q for _, _, q, _ in fits]))]
        progress(f"computing the sky of the best {problem.library.aerosol_type}", 0.45)
        error = problem.error(x, refine(problem.library.aerosol_type, problem.values(x)))
        for i, (other, start, _, _) in enumerate(fits):
            other.correct(error)
            fits[i] = (other, *other.fit(start))
        moved = next(found for other, found, _, _ in fits if other is problem)
        if np.abs(moved - x).max() < SETTLED:
            break
    best = min(q for _, _, q, _ in fits)
    made = []
    for i, (problem, x, q, jacobian) in enumerate(fits):
        progress(f"profiles of {problem.library.aerosol_type}", (i + 0.5) / len(fits))
        above = 3.0 * (q - best) / problem.variance(best)
        made.append(_describe(problem, x, q, jacobian, problem.variance(q), above))
    return sorted(made, key=lambda e: e.misfit)


def _describe(
    problem: _Problem, x: np.ndarray, q: float, jacobian: np.ndarray, variance: float, above: float
) -> AirEstimate:
    """Uncertainties of a fit: curvature and profiles."""
    information = 3.0 / variance * (jacobian.T @ jacobian)
    # a prior with a thousandth of the information of a uniform distribution keeps what is not constrained finite
    covariance = np.linalg.inv(information + np.eye(x.size) * 12.0e-3)
    deviation = np.sqrt(np.diag(covariance))
    parameters = []
    for i, p in enumerate(problem.parameters):
        grid, chi2 = _profile(problem, x, q, i, deviation[i], variance)
        low, high, spread = _interval(grid, chi2, x[i])
        span = problem.high[i] - problem.low[i]
        ends = np.clip(np.array([x[i] - deviation[i], x[i] + deviation[i]]), 0.0, 1.0)
        value = float(p.value(problem.low[i] + span * x[i]))
        per_unit = np.ptp(p.value(problem.low[i] + span * ends)) / max(np.ptp(ends), 1e-12)
        relative_width = float(spread * np.sqrt(12.0))
        parameters.append(
            Estimated(
                name=p.name,
                unit=p.unit,
                value=value,
                standard_error=float(per_unit * min(deviation[i], 1.0 / np.sqrt(12.0))),
                low=float(p.value(problem.low[i] + span * low)),
                high=float(p.value(problem.low[i] + span * high)),
                bounds=(float(p.nodes[0]), float(p.nodes[-1])),
                relative_width=relative_width,
                # at a bound the best value may lie beyond it
                constrained=relative_width <= UNCONSTRAINED and bool(0.0 < x[i] < 1.0),
            )
        )
    correlation = covariance / np.outer(deviation, deviation)
    return AirEstimate(
        problem.library.aerosol_type, parameters, q, above, correlation, problem.samples, problem.values(x)
    )


def _profile(
    problem: _Problem, x: np.ndarray, q: float, i: int, deviation: float, variance: float
) -> tuple[np.ndarray, np.ndarray]:
    """chi^2 above the best along one parameter, the others fitted again at every point."""
    half_width = float(np.clip(3.0 * deviation, 1e-3, 1.0))
    grid = np.linspace(max(0.0, x[i] - half_width), min(1.0, x[i] + half_width), PROFILE_POINTS)
    grid = np.unique(np.append(grid, x[i]))
    chi2 = np.empty(grid.size)
    at = int(np.flatnonzero(grid == x[i])[0])
    for order in (range(at, grid.size), range(at, -1, -1)):
        start = x
        for k in order:
            if k == at:
                chi2[k] = 0.0
                continue
            start, here, _ = problem.fit(start, {i: float(grid[k])})
            chi2[k] = 3.0 * (here - q) / variance
    return grid, np.maximum(chi2, 0.0)


def _interval(grid: np.ndarray, chi2: np.ndarray, best: float) -> tuple[float, float, float]:
    """Where chi^2 is 1 above the best on both sides (or the bound), and the standard deviation of exp(-chi^2 / 2)."""
    fine = np.linspace(grid[0], grid[-1], 2001)
    # the root of a parabola is straight: interpolate it
    root = np.interp(fine, grid, np.sqrt(chi2) * np.sign(grid - best))
    inside = fine[np.abs(root) <= 1.0]
    low, high = (float(inside[0]), float(inside[-1])) if inside.size else (best, best)
    weight = np.exp(-0.5 * root**2)
    weight /= weight.sum()
    mean = weight @ fine
    return low, high, float(np.sqrt(weight @ (fine - mean) ** 2))


def facts(estimates: list[AirEstimate]) -> list[dict[str, Any]]:
    """Estimates as JSON values."""
    return [
        {
            "aerosol_type": e.aerosol_type,
            "misfit": e.misfit,
            "chi2_above_best": e.chi2_above_best,
            "independent_places": e.samples,
            "parameters": {p.name: {k: v for k, v in vars(p).items() if k != "name"} for p in e.parameters},
            "correlation": e.correlation.tolist(),
        }
        for e in estimates
    ]


def unconstrained_wavelengths(white_balance: bool, with_colour: bool) -> str:
    """A sentence on the wavelengths that a fit does not constrain: a photograph has three broad bands, of which a white
    balance takes two."""
    if not with_colour:
        return "wavelengths: luminance alone was fitted, about 500 to 620 nm; of other wavelengths it tells nothing"
    if white_balance:
        return (
            "wavelengths: with a free white balance the photograph cannot tell how much red, green or blue light the "
            "sky has as a whole, only how its colour changes from place to place"
        )
    return (
        "wavelengths: three broad bands, red, green and blue, as the camera balanced them; within a band, and below "
        "430 and above 650 nm, the photograph tells nothing"
    )


def sentences(estimates: list[AirEstimate]) -> list[str]:
    """What a reader must know: parameters that the photograph does not constrain, and types that it does not
    distinguish."""
    best = estimates[0]
    out = []
    for p in best.parameters:
        unit = "" if p.unit in ("", "1") else f" {p.unit}"
        if p.relative_width > UNCONSTRAINED:
            out.append(
                f"{p.name}: the photograph cannot tell it (its standard deviation is {100 * p.relative_width:.0f} % of "
                f"that of an even spread over {p.bounds[0]:g} to {p.bounds[1]:g}{unit})"
            )
        elif not p.constrained or min(abs(p.value - b) for b in p.bounds) < 0.01 * (p.bounds[1] - p.bounds[0]):
            out.append(f"{p.name}: lies at the bound {p.value:.3g}{unit} of what was tried, and may lie beyond it")
    equivalent = [e.aerosol_type for e in estimates[1:] if e.chi2_above_best < 4.0]
    if equivalent:
        out.append(f"aerosol type: {best.aerosol_type} cannot be distinguished from {', '.join(equivalent)}")
    return out
