"""From photographs to their air: the sun where it is not known, the aerosol types, and what they say.

Every aerosol type is fitted in turn (`photographs.fit`), and the one that is taken gets intervals
(`photographs.intervals`).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twilight.base.progress import Progress, silent
from twilight.studies.validate.photographs.air import AEROSOL, SUN, SUN_DEG, Airs, Design, Skies
from twilight.studies.validate.photographs.fit import Errors, Fit, Freedom
from twilight.studies.validate.photographs.intervals import DRAWN, LARGEST_MISFIT, AirEstimate, described, plain
from twilight.studies.validate.photographs.picture_sky import Frame, components

SEARCHED_DEG = np.array(
    [-18, -16, -14, -12, -10, -8.5, -7, -6, -5, -4, -3, -2, -1, 0, 1, 2.5, 4, 6, 9, 12, 16, 20, 25, 30, 37, 45, 55, 65,
     78, 90], float,
)  # fmt: skip
"""Suns of the search [deg]."""

SEARCH_DEPTHS = (0, 2)
"""Nodes of the optical depth with which the sun is searched."""

WINDOW = 2
"""Suns of the search on either side of the best one between which it is fitted."""

MOST_WINDOWS = 4
"""Times that these are moved where the fit ends at one of them."""

SECOND_BEST = 30.0
"""chi^2 above that of the best sun up to which another minimum of the search is fitted too."""

SETTLED = 0.3
"""Change in standard errors below which a fit is not made again with a sky of its own."""

SECANT = (-0.5, 0.8)
"""Slopes between which one such fit after another is taken to go on: near the sun, where the aureole is steeper than
the splines between airs, each goes some 0.6 of the way of that before, and three of them left a camera 0.2 deg off."""

EQUIVALENT = 4.0
"""chi^2 above the best up to which a type cannot be told from it."""

NEAR_ENOUGH = (16.0, EQUIVALENT, EQUIVALENT, EQUIVALENT)
"""chi^2 above the best up to which a type is fitted again with a sky of its own, in each round."""

MOST_STARTS = 2
"""The best of the starts, from which a first fit is made."""

ALBEDOS = (0.25, 0.7)
"""Where the next begins, as fractions of the range."""

BEYOND_DEG = 2.0
"""Sun below which what lies beyond the horizon counts [deg]."""

LARGE_PITCH_DEG = 5.0
"""Error of a camera's pitch beyond which a fit begins at several."""


@dataclass(frozen=True)
class Options:
    """types: of aerosol; own_type: the scene's, which is taken where it cannot be told from the best
    low_deg, high_deg: suns between which it is sought where a frame does not know its own
    freedom: what may differ besides the air
    altitude_known: of the camera; else the aerosol's interval holds what may lie below it
    horizon_known: what lies beyond the horizon; else intervals hold that nothing may
    """

    types: Sequence[str]
    own_type: str | None = None
    low_deg: float = SUN_DEG[0]
    high_deg: float = SUN_DEG[1]
    freedom: Freedom = field(default_factory=Freedom)
    altitude_known: bool = True
    horizon_known: bool = True


def find_air(
    airs: Airs,
    frames: Sequence[Frame],
    options: Options,
    progress: Progress = silent,
    first: Fit | None = None,
) -> list[AirEstimate]:
    """The best air of every type, the best type first; the one that is taken has parameters with intervals.

    frames: one whose sun may be unknown, or several of one camera, held the same, whose suns are known.
    first: `first_look` of the same frames, where it was made.
    Errors: TwilightError for an air that cannot be computed.
    """
    first = first or first_look(airs, frames, options)
    errors = first.errors
    errors.take(errors.likeliest(first.difference(first.x)))
    first.find([first.x])

    def like(name: str) -> Fit:
        made = Fit(frames, airs.like(first.skies, name, first.values()), options.freedom, errors)
        made.find([first.x])
        return made

    fits = [first, *(like(name) for name in options.types[1:])]
    settled: set[str] = set()
    for near in NEAR_ENOUGH:
        best = min(fits, key=lambda fit: fit.chi2)
        for fit in fits:
            name = fit.skies.aerosol_type
            if name not in settled and fit.chi2 - best.chi2 <= near and _again(fit, airs) < SETTLED:
                settled.add(name)
    best = min(fits, key=lambda fit: fit.chi2)
    alike = [fit for fit in fits if fit.chi2 - best.chi2 < EQUIVALENT]
    taken = next((fit for fit in alike if fit.skies.aerosol_type == options.own_type), best)
    progress(f"intervals of {taken.skies.aerosol_type}", 0.9)
    lifted = None if options.altitude_known else airs.lifted_ln(taken.skies.aerosol_type, DRAWN)
    beyond = None if options.horizon_known else _behind_nothing(taken, airs)
    made = [described(fit, best, lifted, beyond) if fit is taken else plain(fit, best) for fit in fits]
    return sorted(made, key=lambda one: one.chi2_above_best)


def first_look(airs: Airs, frames: Sequence[Frame], options: Options) -> Fit:
    """The fit of the first type, before what is left tells how far the sky differs from any that is computed."""
    made = _with_sun(airs, frames, options)
    _again(made, airs)
    return made


def starts(fit: Fit) -> list[np.ndarray]:
    """Where a first fit begins: optical depths, pitches where that is not known; the rest in the middle."""
    pitches = [0.5]
    if fit.freedom.pitch > LARGE_PITCH_DEG:
        pitches = [0.3, 0.43, 0.57, 0.7]
    made = []
    for aerosol, pitch in itertools.product((0.2, 0.5, 0.8), pitches):
        chosen = {AEROSOL.name: aerosol, "pitch": pitch}
        made.append(np.array([chosen.get(p.name, 0.5) for p in fit.parameters]))
    return made


def _again(fit: Fit, airs: Airs) -> float:
    """Fit again with the skies of the best values themselves, in the very directions, or where a secant through the
    last two such fits has its fixed point; how far they move then, in standard errors."""
    before = fit.x
    if len(fit.fixed) > 1:
        (x0, moved0), (x1, moved1) = fit.fixed[-2:]
        step = x1 - x0
        slope = float(np.clip(1.0 + (moved1 - moved0) @ step / max(step @ step, 1e-12), *SECANT))
        before = np.clip(x1 + moved1 / (1.0 - slope), 0.0, 1.0)
    values = fit.values(before)
    computed = zip(fit.frames, fit.log_xyz(before, corrected=False), fit.uneven(before), strict=True)
    for k, (frame, log_xyz, uneven) in enumerate(computed):
        sun = values[SUN] if frame.sun_deg is None else frame.sun_deg
        exact = airs.log_xyz(fit.skies.aerosol_type, values, sun, *fit.where(frame, values))
        fit.corrections[k] = exact + uneven - log_xyz
    fit.find([before])
    fit.fixed.append((before, fit.x - before))
    return float(np.linalg.norm(fit.jacobian @ (fit.x - before)))


def _behind_nothing(fit: Fit, airs: Airs) -> np.ndarray | None:
    """ln (3 n,) of the best sky behind a clean horizon over that behind the scene's; None: all suns are too high for
    it to matter."""
    values, made = fit.values(), []
    for frame in fit.frames:
        sun = values[SUN] if frame.sun_deg is None else frame.sun_deg
        if sun > BEYOND_DEG:
            made.append(np.zeros((3, frame.elevation_deg.size)))
            continue
        at = (fit.skies.aerosol_type, values, sun, *fit.where(frame, values))
        clean, there = (components(np.exp(of(*at)), frame.colour_known) for of in (airs.behind_nothing, airs.log_xyz))
        made.append(clean - there)
    moved = np.concatenate(made, axis=1).ravel()
    return moved if moved.any() else None


def _with_sun(airs: Airs, frames: Sequence[Frame], options: Options) -> Fit:
    """The fit of the first type, with the sun where it is sought."""

    def fitted(suns: Sequence[float], errors: Errors | None = None) -> Fit:
        depths = Fit(frames, airs.first(options.types[0], suns), options.freedom, errors)
        depths.find(starts(depths), MOST_STARTS)
        skies = airs.first(options.types[0], suns, depths.values()[AEROSOL.name])
        made = Fit(frames, skies, options.freedom, depths.errors)
        albedo = [p.name == "albedo" for p in made.parameters]
        made.find([np.where(albedo, value, depths.x) for value in ALBEDOS], len(ALBEDOS))
        if made.misfit() > LARGEST_MISFIT:  # the best depth for one albedo was beside another valley
            made.find([made.x, *starts(made)], 1 + len(starts(made)))
        return made

    known = sorted({frame.sun_deg for frame in frames if frame.sun_deg is not None})
    if known:
        return fitted(known)
    suns = _searched(options)
    chi2, misfit, errors = _search(airs, frames, options, suns)
    lowest = _two_lowest(chi2)
    lowest = [s for s in lowest if chi2[s] <= chi2[lowest[0]] + SECOND_BEST]
    lowest += _two_lowest(misfit)  # thin clouds may carry chi^2 off
    found: list[Fit] = []
    for at in lowest:
        if any(suns[at] in fit.skies.sun_elevations_deg[1:-1] for fit in found):
            continue
        for _ in range(MOST_WINDOWS):
            begin = int(np.clip(at - WINDOW, 0, suns.size - 2 * WINDOW - 1))
            end = begin + 2 * WINDOW
            fit = fitted(suns[begin : end + 1].tolist(), errors)
            sun = fit.values()[SUN]
            if sun < suns[begin + 1] and begin > 0:
                at = begin
            elif sun > suns[end - 1] and end < suns.size - 1:
                at = end
            else:
                break
        _again(fit, airs)
        found.append(fit)
    return min(found, key=lambda fit: (fit.misfit() > LARGEST_MISFIT, fit.chi2))


def _two_lowest(values: np.ndarray) -> list[int]:
    """Places of the two lowest local minima."""
    places = [s for s in range(values.size) if values[s] <= values[max(0, s - 1) : s + 2].min()]
    return sorted(places, key=lambda s: values[s])[:2]


def _searched(options: Options) -> np.ndarray:
    inside = SEARCHED_DEG[(SEARCHED_DEG > options.low_deg) & (SEARCHED_DEG < options.high_deg)]
    suns = np.concatenate([[options.low_deg], inside, [options.high_deg]])
    if suns.size < 2 * WINDOW + 1:
        suns = np.linspace(options.low_deg, options.high_deg, 2 * WINDOW + 1)
    return suns


def _search(
    airs: Airs, frames: Sequence[Frame], options: Options, suns: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Errors]:
    """chi^2 of every sun of the search, and Q, each the least of a few optical depths and pitches; the errors, with the
    likeliest amplitude of the sky's."""
    made: list[tuple[int, Fit]] = []
    errors: Errors | None = None
    for depth in SEARCH_DEPTHS:
        node = airs.design.nodes[depth]
        for s, splines in enumerate(airs.splines(options.types[0], node, suns.tolist())):
            design = Design(airs.design.others, None)
            same = np.broadcast_to(splines, (len(design.nodes), 1, *splines.shape))
            skies = Skies(design, options.types[0], suns[s : s + 1], same, airs.error)
            fit = Fit([replace(frame, sun_deg=float(suns[s])) for frame in frames], skies, options.freedom, errors)
            errors, pitched = fit.errors, starts(fit)
            # the same sky for all depths
            fit.x = min(pitched[: len(pitched) // 3], key=lambda x: float(np.sum(fit.residuals(x) ** 2)))
            made.append((s, fit))
    assert errors is not None
    best = min((fit for _, fit in made), key=lambda fit: float(np.sum(fit.residuals(fit.x) ** 2)))
    errors.take(errors.likeliest(best.difference(best.x)))
    found = np.full((2, suns.size), np.inf)
    for s, fit in made:
        found[:, s] = np.minimum(found[:, s], (float(np.sum(fit.residuals(fit.x) ** 2)), fit.misfit()))
    return found[0], found[1], errors
