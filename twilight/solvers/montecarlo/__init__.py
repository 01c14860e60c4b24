"""Backward Monte-Carlo in the exact spherical atmosphere: the reference solution for every other solver.

It has its own random walk, ray geometry and shells, so that a mistake in the geometry, quadrature or iteration of the
others is not repeated here.  It shares with them the medium and the tables of the direct beam (`transport.beam`) alone,
and tests hold those against rays integrated on their own.
"""

from twilight.solvers.base import Capabilities
from twilight.solvers.montecarlo.field import Field, prepare
from twilight.solvers.montecarlo.settings import QUALITIES, MonteCarloSettings, cost
from twilight.solvers.montecarlo.tally import MonteCarloResult, StokesResult

CAPABILITIES = Capabilities(
    standard_error=True,
    finite_segments=True,
    screen=True,
    cost=cost,
)

__all__ = [
    "CAPABILITIES",
    "QUALITIES",
    "Field",
    "MonteCarloResult",
    "MonteCarloSettings",
    "StokesResult",
    "prepare",
]
