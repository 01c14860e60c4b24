"""The air from a photograph: which aerosol, ozone, ground and sun make the sky that it shows.

Least squares of ``photo.residual_vector`` (ln(luminance), u' and v' over the clear sky, after one free exposure and, on
request, one free white balance) over the skies of `airs`, for every aerosol type in turn.

*Uncertainty.* What is left after the fit (clouds, stitching, haze in streaks) is not noise of single cells: it is
correlated over some degrees, and the photograph counts as N = clear solid angle / CORRELATED_SR independent samples
with three numbers each.  Errors that the fit cannot see because they are correlated over the whole sky (vignetting left
over, the camera's colours) are taken to be FLOOR, in M samples, 1 to SYSTEMATIC_SAMPLES by the fraction of the
hemisphere that is seen; the solver's own error is added to it.  So chi^2 = 3 Q / (Q_best / N + FLOOR / M), where Q is
the sum of squares of the residuals.
Standard errors are from its curvature, intervals from its profile: chi^2 + 1 and + 4, all others fitted again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import least_squares

from twilight.studies.validate.photographs.airs import SUN, Parameter, Skies
from twilight.studies.validate.photographs.photo import CHROMATICITY_SCALE, LOG_SCALE, Cells, residual_vector

CORRELATED_SR = 0.1
"""Solid angle within which errors are correlated [sr]: a disc of 10 deg radius."""

FLOOR = (0.02 / LOG_SCALE) ** 2 + 2.0 * (0.0015 / CHROMATICITY_SCALE) ** 2
"""Sum of squares of errors correlated over the whole sky: 2 % in luminance and 0.0015 in u', v'."""

SYSTEMATIC_SAMPLES = 5.0
"""Independent samples of a whole hemisphere for errors correlated over the sky."""

UNCONSTRAINED = 0.6
"""Standard deviation over that of a uniform distribution beyond which a photograph does not tell a parameter."""

LARGEST_MISFIT = 1.0
"""Q beyond which a fit does not fit: 10 % in luminance, or 0.01 in u', v', over the whole sky."""

PROFILE_POINTS = 8
"""Values of a parameter, around its best, at which all others are fitted again."""

AT_BOUND = 1e-6
"""Distance to a bound, as a fraction of a parameter's range, within which a value counts as at the bound."""

STEP = 2e-3
"""Step of the Jacobian's differences, as a fraction of a parameter's range."""


@dataclass(frozen=True)
class Estimated:
    """One parameter.

    value, standard_error: best, and from curvature, in the unit; the latter at most that of a uniform distribution
        between the bounds
    low, high and low_95, high_95: intervals that hold the truth in 68 and in 95 of 100 pictures
    bounds: of what was tried
    constrained: the photograph tells it, which it does not where the fit does not fit, or reaches a bound
    relative_width: standard deviation within the bounds over that of no knowledge
    """

    name: str
    unit: str
    value: float
    standard_error: float
    low: float
    high: float
    low_95: float
    high_95: float
    bounds: tuple[float, float]
    relative_width: float
    constrained: bool


@dataclass(frozen=True, eq=False)
class AirEstimate:
    """The best climate of one aerosol type.

    misfit: sum of squares Q.  chi2_above_best: its chi^2 above that of the best type, on the best type's scale.
    values: of all parameters, with ``sun`` where it was fitted.
    parameters: with intervals, of the type that is taken; correlation (P, P): of them.
    """

    aerosol_type: str
    misfit: float
    chi2_above_best: float
    values: dict[str, float]
    parameters: list[Estimated] = field(default_factory=list)
    correlation: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def fits(self) -> bool:
        """Whether the sky is about as the photograph shows it."""
        return self.misfit <= LARGEST_MISFIT


class Fit:
    """Residuals of a photograph against skies, in parameters scaled to 0..1 within their bounds, and the best."""

    def __init__(self, cells: Cells, skies: Skies, white_balance: bool, with_colour: bool):
        self.cells, self.skies = cells, skies
        self.white_balance, self.with_colour = white_balance, with_colour
        self.table = skies.log_xyz.reshape(-1, cells.xyz.size)
        self.parameters: list[Parameter] = list(skies.design.parameters)
        suns = skies.sun_elevations_deg
        if suns.size > 1:
            self.parameters.append(Parameter(SUN, "sun.elevation_deg", "deg", (suns[0], suns[-1])))
        ends = [p.scaled(np.array([p.nodes[0], p.nodes[-1]])) for p in self.parameters]
        self.low, self.high = np.array(ends).T
        self.samples = max(float(cells.solid_angle_sr.sum()) / CORRELATED_SR, 1.0)
        self.x, self.q, self.jacobian = np.full(self.low.size, 0.5), np.inf, np.zeros((0, 0))

    def variance(self, q: float) -> float:
        """Variance of the mean over the sky of one number, for a best sum of squares q."""
        seen = float(self.cells.solid_angle_sr.sum()) / (2.0 * np.pi)
        solver = (self.skies.luminance_error / LOG_SCALE) ** 2
        if self.with_colour:
            solver += (self.skies.chromaticity_error / CHROMATICITY_SCALE) ** 2
        return q / self.samples + (FLOOR + solver) / (1.0 + (SYSTEMATIC_SAMPLES - 1.0) * seen)

    def values(self, x: np.ndarray | None = None) -> dict[str, float]:
        """The parameters at x; None: at the best."""
        scaled = self.low + (self.x if x is None else x) * (self.high - self.low)
        return {p.name: float(p.value(s)) for p, s in zip(self.parameters, scaled, strict=True)}

    def log_xyz(self, x: np.ndarray) -> np.ndarray:
        """ln(XYZ) (n, 3) of the sky at x."""
        return (self.skies.weights(self.values(x)) @ self.table).reshape(self.cells.xyz.shape)

    def correct(self, error: np.ndarray) -> None:
        """Add an error (n, 3) of the skies to all of them."""
        self.table = self.table + error.reshape(1, -1)  # the weights of all skies sum to 1

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Residuals at x, whose sum of squares is Q."""
        free = {"white_balance": self.white_balance, "with_colour": self.with_colour}
        return residual_vector(self.cells, np.exp(self.log_xyz(x)), **free)

    def find(self, starts: list[np.ndarray]) -> None:
        """Move to the best x that is found from the starts."""
        found = min((self.from_start(start) for start in starts), key=lambda one: one[1])
        self.x, self.q, self.jacobian = found

    def from_start(
        self, start: np.ndarray, fixed: Mapping[int, float] | None = None
    ) -> tuple[np.ndarray, float, np.ndarray]:
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
        found = least_squares(residuals, inside, jacobian, bounds=(0.0, 1.0), xtol=1e-4, ftol=1e-6)
        x = full(found.x)
        return np.where(x < AT_BOUND, 0.0, np.where(x > 1.0 - AT_BOUND, 1.0, x)), float(2.0 * found.cost), found.jac


def starts(fit: Fit) -> list[np.ndarray]:
    """Where a first fit begins: three optical depths, all others in the middle."""
    return [np.array([aerosol, *[0.5] * (len(fit.parameters) - 1)]) for aerosol in (0.2, 0.5, 0.8)]


def plain(fit: Fit, best: Fit) -> AirEstimate:
    """A type's estimate without intervals, beside the fit of the best type."""
    above = 3.0 * (fit.q - best.q) / fit.variance(best.q)
    return AirEstimate(fit.skies.aerosol_type, fit.q, above, fit.values())


def described(fit: Fit, best: Fit) -> AirEstimate:
    """The same with intervals, by curvature and profiles."""
    made, variance, x = plain(fit, best), fit.variance(fit.q), fit.x
    information = 3.0 / variance * (fit.jacobian.T @ fit.jacobian)
    # a prior with a thousandth of the information of a uniform distribution keeps what is not told finite
    covariance = np.linalg.inv(information + np.eye(x.size) * 12.0e-3)
    deviation = np.sqrt(np.diag(covariance))
    parameters = []
    for i, p in enumerate(fit.parameters):
        fine, root = _profile(fit, i, deviation[i], variance)
        weight = np.exp(-0.5 * root**2)
        weight /= weight.sum()
        relative_width = float(np.sqrt(weight @ (fine - weight @ fine) ** 2) * np.sqrt(12.0))
        one, two = (fine[np.abs(root) <= level] for level in (1.0, 2.0))
        span = fit.high[i] - fit.low[i]

        def value(place: float, p: Parameter = p, low: float = fit.low[i], span: float = span) -> float:
            return float(p.value(low + span * place))

        ends = np.clip(np.array([x[i] - deviation[i], x[i] + deviation[i]]), 0.0, 1.0)
        per_unit = (value(ends[1]) - value(ends[0])) / max(float(np.ptp(ends)), 1e-12)
        parameters.append(
            Estimated(
                name=p.name,
                unit=p.unit,
                value=value(x[i]),
                standard_error=float(per_unit * min(deviation[i], 1.0 / np.sqrt(12.0))),
                low=value(min(one[0], x[i])),
                high=value(max(one[-1], x[i])),
                low_95=value(min(two[0], x[i])),
                high_95=value(max(two[-1], x[i])),
                bounds=(float(p.nodes[0]), float(p.nodes[-1])),
                relative_width=relative_width,
                # at a bound the best value may lie beyond it
                constrained=made.fits and relative_width <= UNCONSTRAINED and bool(one[0] > 0.0 and one[-1] < 1.0),
            )
        )
    return replace(made, parameters=parameters, correlation=covariance / np.outer(deviation, deviation))


def _profile(fit: Fit, i: int, deviation: float, variance: float) -> tuple[np.ndarray, np.ndarray]:
    """Values of one parameter, and the root of chi^2 above the best, negative below it, the others fitted again."""
    best = fit.x[i]
    half_width = float(np.clip(3.0 * deviation, 1e-3, 1.0))
    grid = np.linspace(max(0.0, best - half_width), min(1.0, best + half_width), PROFILE_POINTS)
    grid = np.unique(np.append(grid, best))
    chi2 = np.zeros(grid.size)
    at = int(np.flatnonzero(grid == best)[0])
    for order in (range(at + 1, grid.size), range(at - 1, -1, -1)):
        start = fit.x
        for k in order:
            start, here, _ = fit.from_start(start, {i: float(grid[k])})
            chi2[k] = max(0.0, 3.0 * (here - fit.q) / variance)
    fine = np.linspace(grid[0], grid[-1], 2001)
    # the root of a parabola is straight: interpolate it
    return fine, np.interp(fine, grid, np.sqrt(chi2) * np.sign(grid - best))
