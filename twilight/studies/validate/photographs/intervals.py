"""What photographs tell of an air: the best values, and the intervals that hold the truth.

Intervals are the shortest that hold 68 or 95 % of

    exp(-chi^2 / 2),     integrated over all other parameters (airs drawn about the best, and weighted),

all values within a parameter's bounds being as likely before, but for ozone and albedo, which are about as usual at the
place (`Parameter.usual`): 68 or 95 of 100 pictures have the truth in them, also of a parameter that they do not tell,
whose interval is then that of the usual value.  What a sky has that no air of the fit has (haze that differs from side
to side, a type that is none of those tried) leaves residuals that are alike over whole regions.  How far these pull the
parameters is measured, not assumed (`_pulled`), and widens the intervals.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from twilight.studies.validate.photographs.air import AEROSOL, SUN, Parameter
from twilight.studies.validate.photographs.comparison import Curve
from twilight.studies.validate.photographs.fit import CONTRAST, SATURATION, STRAINED, Fit

UNCONSTRAINED = 0.6
"""Standard deviation over that before the picture was seen beyond which the picture does not tell a parameter."""

LARGEST_MISFIT = 1.0
"""Q beyond which a fit does not fit: 10 % in luminance, or 0.01 in u', v', over the whole sky."""

DARKEST_DEG = -15.0
"""Sun that was sought and found below which there is no fit [deg]: the sun's light is less than that of a night, and a
grey cloud resembles it."""

DRAWN = 1500
"""Airs that are drawn for intervals."""

MOST_TRIED = 20000
"""Of how many that are tried."""

ROUNDS = 3
"""How often they are drawn, each time about those before."""

WIDER = 1.5
"""Variances of what is drawn over those expected."""

NEAR_BOUND = 0.01
"""Distance of an interval to a bound, as a fraction of the range, within which it reaches that."""

AEROSOL_WIDENED = 1.35
"""Factor on the aerosol's intervals of pictures in 8 bits, in its scale: of fifty simulated phone pictures
(`benchmarks/phone.py`) 84 % lay within 1.9 standard deviations, which is 68 % within 1.35."""

REGIONS = (4, 2)
"""Regions of a sky that pull alike: parts of its azimuths, and of its elevations, with as many cells in each."""

PULL = 1.3
"""Factor on standard errors by so few regions: Student's distribution of 7 degrees of freedom holds 95 % within 2.4,
and the residuals are those of a fit to them."""


@dataclass(frozen=True)
class Estimated:
    """One parameter.

    value, standard_error: best, and from curvature, in the unit; the latter at most that of a uniform distribution
        between the bounds
    low, high and low_95, high_95: intervals that hold the truth in 68 and in 95 of 100 pictures
    bounds: of what was tried
    constrained: the photograph tells it, which it does not where the fit does not fit, or reaches a bound
    relative_width: standard deviation over that before the picture was seen
    usual, source: of `Parameter`
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
    usual: tuple[float, float] | None = None
    source: str = ""


@dataclass(frozen=True, eq=False)
class AirEstimate:
    """The best climate of one aerosol type.

    misfit: sum of squares Q.  chi2_above_best: its chi^2 above that of the best type.
    values: of all parameters, with ``sun`` where it was fitted, and the camera's angles beyond what was told.
    parameters: with intervals, of the type that is taken; correlation (P, P): of them.
    camera: what the camera did to the picture, by kind: exposure, white balance, curve, lens.  curve: of its tones,
        None where it is not free.  costs: how many times wider the optical depth's interval is for not knowing each.
    amplitude: of the sky's own errors, over `fit.SKY_LN`.  strained: the brightness contradicts the file's exposure.
    """

    aerosol_type: str
    misfit: float
    chi2_above_best: float
    values: dict[str, float]
    parameters: list[Estimated] = field(default_factory=list)
    correlation: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    camera: dict[str, np.ndarray] = field(default_factory=dict)
    curve: Curve | None = None
    costs: dict[str, float] = field(default_factory=dict)
    amplitude: float = 1.0
    strained: bool = False

    @property
    def fits(self) -> bool:
        """Whether the sky is about as the photograph shows it, as bright as its exposure says, and lit by the sun."""
        lit = self.values.get(SUN, 0.0) >= DARKEST_DEG
        return self.misfit <= LARGEST_MISFIT and not self.strained and not self.overdrawn and lit

    @property
    def overdrawn(self) -> bool:
        """Whether the picture's contrasts are further from those of light than pictures' are."""
        told = (("contrast", CONTRAST), ("saturation", SATURATION))
        return any(abs(self.values.get(name, 0.0)) > STRAINED * error for name, error in told)


def plain(fit: Fit, best: Fit) -> AirEstimate:
    """A type's estimate without intervals, beside the fit of the best type."""
    return AirEstimate(
        fit.skies.aerosol_type, fit.misfit(), fit.chi2 - best.chi2, fit.values(), strained=fit.strained()
    )


def described(
    fit: Fit, best: Fit, lifted_ln: np.ndarray | None = None, beyond_ln: np.ndarray | None = None
) -> AirEstimate:
    """The same with intervals, by curvature and profiles; lifted_ln (`DRAWN`,): of `Airs.lifted_ln`, for a camera of
    unknown altitude; beyond_ln (3 n,): one standard error of the sky by what lies beyond a horizon that is not known.
    """
    made, x = plain(fit, best), fit.x
    covariance = _covariance(fit.jacobian)
    deviation = np.sqrt(np.diag(covariance))
    pulled = np.maximum(_pulled(fit) - deviation**2, 0.0)
    if beyond_ln is not None:
        pulled += _moved(fit, beyond_ln) ** 2
    pulled = np.sqrt(pulled)
    drawn, weight = _drawn(fit, covariance)
    random = np.random.default_rng(2)
    column = np.cumsum(~fit.angles) - 1
    parameters = []
    for i, p in enumerate(fit.parameters):
        if fit.angles[i]:
            wide = float(np.hypot(deviation[i], pulled[i]))
            one, two = ((x[i] - k * wide, x[i] + k * wide) for k in (1.0, 2.0))
            deviation_now = wide
        else:
            values = np.clip(drawn[:, column[i]] + pulled[i] * random.standard_normal(len(drawn)), 0.0, 1.0)
            if p.name == AEROSOL.name and lifted_ln is not None:
                above = random.permutation(lifted_ln)[: values.size]
                values = np.minimum(values + above / (fit.high[i] - fit.low[i]), 1.0)
            wide = AEROSOL_WIDENED if p.name == AEROSOL.name and fit.errors.inflation > 1.0 else 1.0
            values = np.clip(x[i] + wide * (values - x[i]), 0.0, 1.0)
            one, two = (_densest(values, weight, part) for part in (0.683, 0.954))
            deviation_now = np.sqrt(weight @ (values - weight @ values) ** 2)
        relative_width = float(deviation_now / _before(fit.usual[i], fit.strength[i]))
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
                high=value(max(one[1], x[i])),
                low_95=value(min(one[0], two[0], x[i])),
                high_95=value(max(one[1], two[1], x[i])),
                bounds=(float(p.nodes[0]), float(p.nodes[-1])),
                relative_width=relative_width,
                # at a bound the best value may lie beyond it
                constrained=made.fits
                and relative_width <= UNCONSTRAINED
                and bool(one[0] > NEAR_BOUND and one[1] < 1.0 - NEAR_BOUND),
                usual=p.usual,
                source=p.source,
            )
        )
    return replace(
        made,
        parameters=parameters,
        correlation=covariance / np.outer(deviation, deviation),
        camera=fit.camera(),
        curve=fit.curve(),
        costs=_costs(fit),
        amplitude=fit.errors.amplitude,
    )


def _before(usual: float, strength: float) -> float:
    """Standard deviation, scaled, of what was known before the picture, within the bounds."""
    x = (np.arange(500) + 0.5) / 500
    weight = np.exp(-0.5 * (strength * (x - usual)) ** 2)
    return float(np.sqrt(np.cov(x, aweights=weight, ddof=0)))


def _covariance(jacobian: np.ndarray) -> np.ndarray:
    # a prior with a thousandth of the information of a uniform distribution keeps what is not told finite
    return np.linalg.inv(jacobian.T @ jacobian + np.eye(jacobian.shape[1]) * 12.0e-3)


def _drawn(fit: Fit, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (N, P) of what is not an angle of the camera, and the weights of each: the angles, near the best linear in
    what is seen, are integrated over."""
    held, random = ~fit.angles, np.random.default_rng(1)
    angles = np.linalg.qr(fit.jacobian[:, fit.angles])[0]
    low, span = fit.low[held], (fit.high - fit.low)[held]
    named = [p for p, chosen in zip(fit.parameters, held, strict=True) if chosen]

    def chi2(x: np.ndarray) -> np.ndarray:
        scaled = low + x * span
        values = {p.name: p.value(scaled[:, i]) for i, p in enumerate(named)}
        r = fit.differences(values)[:, fit.errors.used] @ fit.errors.whitening.T
        whole = np.tile(fit.x, (len(x), 1))
        whole[:, held] = x
        r = np.concatenate([r, fit.before(whole)], axis=1)
        return (r**2).sum(axis=1) - ((r @ angles) ** 2).sum(axis=1)

    middle, even = fit.x[held], 12.0 * np.eye(int(held.sum()))
    width = np.linalg.inv(np.linalg.inv(covariance[np.ix_(held, held)]) + even)
    for _ in range(ROUNDS):
        root = np.linalg.cholesky(WIDER * width + 1e-7 * np.eye(middle.size))
        z = random.standard_normal((MOST_TRIED, middle.size))
        x = middle + z @ root.T
        inside = ((x >= 0.0) & (x <= 1.0)).all(axis=1)
        x, z = x[inside][:DRAWN], z[inside][:DRAWN]
        log_weight = -0.5 * chi2(x) + 0.5 * (z**2).sum(axis=1)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        middle = weight @ x
        width = (x - middle).T @ ((x - middle) * weight[:, None])
    return x, weight


def _densest(x: np.ndarray, weight: np.ndarray, part: float) -> tuple[float, float]:
    """Ends of the shortest interval that holds a part of the weight."""
    order = np.argsort(x)
    x, passed = x[order], np.concatenate([[0.0], np.cumsum(weight[order])])
    last = np.searchsorted(passed, passed[:-1] + part) - 1
    fits = last < x.size
    first = int(np.argmin(np.where(fits, x[np.minimum(last, x.size - 1)] - x, np.inf)))
    return float(x[first]), float(x[last[first]])


def _pulled(fit: Fit) -> np.ndarray:
    """Variances (P,) of the parameters, scaled, by what the residuals of each region of the sky pull them.

    With the slopes J' = C0 C^-1 J, from which what the camera's modes take up is gone (C0: C without these), the score
    of a region is s_b = sum over its cells of J'^T C^-1 r, and with H = J^T C^-1 J the variances are the diagonal of
    H^-1 (sum_b s_b s_b^T) H^-1 (Liang and Zeger 1986, Biometrika 73, 13).  Parameters at a bound stay there.
    """
    errors, n = fit.errors, fit.errors.root.shape[0]
    free = (fit.x > 0.0) & (fit.x < 1.0)
    slopes = errors.of_cells(errors.amplitude) @ (errors.whitening.T @ fit.jacobian[:n])
    weighted = errors.whitening.T @ (errors.whitening @ fit.difference(fit.x)[errors.used])
    azimuth = np.concatenate([(f.azimuth_deg + 180.0) % 360.0 for f in fit.frames])
    elevation = np.concatenate([f.elevation_deg for f in fit.frames])
    region = np.zeros(azimuth.size, int)
    for where, count in zip((azimuth, elevation), REGIONS, strict=True):
        rank = np.argsort(np.argsort(where, kind="stable"), kind="stable")
        region = region * count + rank * count // where.size
    region = np.tile(region, 3)[errors.used]
    scores = np.array([(slopes * weighted[:, None])[region == b].sum(axis=0) for b in range(REGIONS[0] * REGIONS[1])])
    held = np.flatnonzero(free)
    inverse = np.linalg.inv((fit.jacobian.T @ fit.jacobian + 12.0e-3 * np.eye(fit.x.size))[np.ix_(held, held)])
    made = np.zeros(fit.x.size)
    made[held] = PULL**2 * ((scores[:, held] @ inverse) ** 2).sum(axis=0)
    return made


def _moved(fit: Fit, change_ln: np.ndarray) -> np.ndarray:
    """How far a change (3 n,) of the computed sky moves the parameters (P,), scaled; those at a bound stay there."""
    free, n = np.flatnonzero((fit.x > 0.0) & (fit.x < 1.0)), fit.errors.root.shape[0]
    information = fit.jacobian.T @ fit.jacobian + 12.0e-3 * np.eye(fit.x.size)
    score = fit.jacobian[:n].T @ (fit.errors.whitening @ change_ln[fit.errors.used])
    made = np.zeros(fit.x.size)
    made[free] = np.linalg.solve(information[np.ix_(free, free)], score[free])
    return made


def _costs(fit: Fit) -> dict[str, float]:
    """How many times wider the optical depth's interval is for not knowing each of what a camera does."""
    errors, count = fit.errors, len(fit.parameters)
    turned = fit.jacobian[: errors.root.shape[0]]
    slopes = errors.root @ turned
    own = np.diag(np.maximum(fit.strength**2, 12.0e-3))
    whole = np.linalg.inv(turned.T @ turned + own)[0, 0]
    made: dict[str, float] = {}
    for kind in ("exposure", "white balance", "curve", "lens"):
        if kind in errors.kinds:
            known = np.linalg.solve(errors.covariance(errors.amplitude, kind), slopes)
            made[kind] = float(np.sqrt(whole / np.linalg.inv(slopes.T @ known + own)[0, 0]))
    held = [i for i in range(count) if not fit.angles[i]]
    if len(held) < count:
        kept = (turned.T @ turned + own)[np.ix_(held, held)]
        made["orientation"] = float(np.sqrt(whole / np.linalg.inv(kept)[0, 0]))
    return made
