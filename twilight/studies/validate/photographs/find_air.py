"""From a photograph to its air: the sun where it is not known, the aerosol types, and what they say."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twilight.base.progress import Progress, silent
from twilight.studies.validate.photographs.airs import SUN, SUN_DEG, Airs, Skies
from twilight.studies.validate.photographs.estimate import AirEstimate, Fit, described, plain, starts
from twilight.studies.validate.photographs.photo import Cells, residual_vector

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

SECOND_BEST = 1.5
"""Q over that of the best sun up to which another minimum of the search is fitted too."""

SETTLED = 0.02
"""Change, as a fraction of every parameter's range, below which a fit is not made again with a sky of its own."""

EQUIVALENT = 4.0
"""chi^2 above the best up to which a type cannot be told from it."""

NEAR_ENOUGH = (16.0, EQUIVALENT)
"""chi^2 above the best up to which a type is fitted again with a sky of its own, in each round."""

Refine = Callable[[str, Mapping[str, float], Cells], np.ndarray]
"""From an aerosol type, the values of all parameters and cells to ln(XYZ) (n, 3) of that sky by another solver."""


@dataclass(frozen=True)
class Options:
    """types: of aerosol; own_type: the scene's, which is taken where it cannot be told from the best
    low_deg, high_deg: suns between which it is sought, equal where it is known
    white_balance: gains of red, green and blue are free; with_colour: colours count, not luminance alone
    """

    types: Sequence[str]
    own_type: str | None = None
    low_deg: float = SUN_DEG[0]
    high_deg: float = SUN_DEG[1]
    white_balance: bool = False
    with_colour: bool = True


def find_air(
    airs: Airs, cells: Cells, options: Options, refine: Refine | None = None, progress: Progress = silent
) -> list[AirEstimate]:
    """The best air of every type, the best type first; the one that is taken has parameters with intervals.

    refine: another solver's sky of an air; all types are fitted again with the difference from `airs` at the best one.
    Errors: TwilightError for an air that cannot be computed.
    """

    def fitted(skies: Skies) -> Fit:
        made = Fit(cells, skies, options.white_balance, options.with_colour)
        made.find(starts(made))
        return made

    first = _with_sun(airs, cells, options, fitted)
    _again(first, airs.log_xyz, cells)
    fits = [first, *(fitted(airs.like(first.skies, name, first.values(), cells)) for name in options.types[1:])]
    settled: set[str] = set()
    for near in NEAR_ENOUGH:
        best = min(fits, key=lambda fit: fit.q)
        for fit in fits:
            name = fit.skies.aerosol_type
            if name not in settled and plain(fit, best).chi2_above_best <= near:
                if _again(fit, airs.log_xyz, cells) < SETTLED:
                    settled.add(name)
    best = min(fits, key=lambda fit: fit.q)
    if refine is not None:
        progress(f"computing the sky of {best.skies.aerosol_type} by the scene's solver", 0.8)
        values = best.values()
        error = refine(best.skies.aerosol_type, values, cells) - best.log_xyz(best.x)
        for fit in fits:
            fit.correct(error)
            fit.find([fit.x])
        best = min(fits, key=lambda fit: fit.q)
    alike = [fit for fit in fits if plain(fit, best).chi2_above_best < EQUIVALENT]
    taken = next((fit for fit in alike if fit.skies.aerosol_type == options.own_type), best)
    progress(f"intervals of {taken.skies.aerosol_type}", 0.9)
    made = [described(fit, best) if fit is taken else plain(fit, best) for fit in fits]
    return sorted(made, key=lambda one: one.misfit)


def _again(fit: Fit, log_xyz: Callable[..., np.ndarray], cells: Cells) -> float:
    """Fit again with the sky of the best values itself; how far they move, as a fraction of the ranges."""
    values, before = fit.values(), fit.x
    sun = values.get(SUN, float(fit.skies.sun_elevations_deg[0]))
    fit.correct(log_xyz(fit.skies.aerosol_type, values, [sun], cells)[0] - fit.log_xyz(before))
    fit.find([before])
    return float(np.abs(fit.x - before).max())


def _with_sun(airs: Airs, cells: Cells, options: Options, fitted: Callable[[Skies], Fit]) -> Fit:
    """The fit of the first type, with the sun where it is sought."""
    name = options.types[0]
    if options.low_deg == options.high_deg:
        return fitted(airs.first(name, [options.low_deg], cells))
    inside = SEARCHED_DEG[(SEARCHED_DEG > options.low_deg) & (SEARCHED_DEG < options.high_deg)]
    suns = np.concatenate([[options.low_deg], inside, [options.high_deg]])
    if suns.size < 2 * WINDOW + 1:
        suns = np.linspace(options.low_deg, options.high_deg, 2 * WINDOW + 1)
    misfit = np.full(suns.size, np.inf)
    free = {"white_balance": options.white_balance, "with_colour": options.with_colour}
    for depth in SEARCH_DEPTHS:
        for s, log_xyz in enumerate(airs.log_xyz(name, airs.design.nodes[depth], suns.tolist(), cells)):
            r = residual_vector(cells, np.exp(log_xyz), **free)
            misfit[s] = min(misfit[s], float(r @ r))
    lowest = [s for s in range(suns.size) if misfit[s] <= misfit[max(0, s - 1) : s + 2].min()]
    lowest = sorted(lowest, key=lambda s: misfit[s])[:2]
    found = []
    for at in lowest:
        if misfit[at] > SECOND_BEST * misfit[lowest[0]]:
            continue
        for _ in range(MOST_WINDOWS):
            begin = int(np.clip(at - WINDOW, 0, suns.size - 2 * WINDOW - 1))
            end = begin + 2 * WINDOW
            fit = fitted(airs.first(name, suns[begin : end + 1].tolist(), cells))
            sun = fit.values()[SUN]
            if sun < suns[begin + 1] and begin > 0:
                at = begin
            elif sun > suns[end - 1] and end < suns.size - 1:
                at = end
            else:
                break
        found.append(fit)
    return min(found, key=lambda fit: fit.q)
