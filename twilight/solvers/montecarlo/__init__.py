"""Backward Monte-Carlo in the exact spherical atmosphere: the referee of every other solver."""

from twilight.solvers.base import Capabilities
from twilight.solvers.montecarlo.field import Field, prepare
from twilight.solvers.montecarlo.settings import QUALITIES, MonteCarloSettings
from twilight.solvers.montecarlo.tally import MonteCarloResult, StokesResult

CAPABILITIES = Capabilities(standard_error=True, stokes=True)

__all__ = [
    "CAPABILITIES",
    "QUALITIES",
    "Field",
    "MonteCarloResult",
    "MonteCarloSettings",
    "StokesResult",
    "prepare",
]
