"""How far a set of coefficients is from computed skies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twilight.sky.colour import uv_of_xy
from twilight.solvers.analytic.coefficients import SkyCoefficients
from twilight.studies.fit.truth import ColourSky


@dataclass(frozen=True)
class SetError:
    """Errors over all directions of some skies.

    luminance_*: |model / truth - 1| of the absolute luminance; distribution_*: with the best scale for every sky;
    chromaticity_*: distance in CIE 1976 u', v'.  bias: mean of ln(model / truth).
    """

    luminance_bias: float
    luminance_median: float
    luminance_p95: float
    distribution_median: float
    distribution_p95: float
    chromaticity_median: float
    chromaticity_p95: float


def error_of(made: SkyCoefficients, skies: Sequence[ColourSky]) -> SetError:
    """Errors of a set over skies whose turbidity and sun it covers."""
    bias, absolute, distribution, chromaticity = [], [], [], []
    for sky in skies:
        luminance, x, y = made.sky(sky.turbidity, sky.sun_elevation_deg, sky.elevation_deg, sky.azimuth_deg)
        ratio = luminance / sky.luminance
        bias.append(np.log(ratio))
        absolute.append(np.abs(ratio - 1.0))
        scale = np.exp(-np.sum(sky.weight * np.log(ratio)))
        distribution.append(np.abs(scale * ratio - 1.0))
        chromaticity.append(np.linalg.norm(uv_of_xy(x, y) - uv_of_xy(sky.x, sky.y), axis=-1))
    errors = [np.concatenate(e) for e in (absolute, distribution, chromaticity)]
    quantiles = [float(np.percentile(e, q)) for e in errors for q in (50, 95)]
    return SetError(float(np.mean(np.concatenate(bias))), *quantiles)
