"""Backward Monte-Carlo in the exact spherical atmosphere: the reference solution for every other solver.

It has its own random walk, ray geometry and shells, so that a mistake in the geometry, quadrature or iteration of the
others is not repeated here: what `rays`, `leg` and `sunlight` have in common with `transport` is there twice on
purpose.  It shares with the other solvers the medium and the tables of the direct beam (`transport.beam`) alone, and
tests hold those against rays integrated on their own.

From the bottom up: `kernel`, `air`, `rays`, `sunlight`, `importance`, `leg` and `line_of_sight`, `events`, `paths`,
`chunks`, `field`.
"""

from twilight.solvers.base import Capabilities
from twilight.solvers.montecarlo.chunks import MonteCarloResult, StokesResult
from twilight.solvers.montecarlo.field import MonteCarloField, prepare
from twilight.solvers.montecarlo.settings import QUALITIES, MonteCarloSettings, carried, cost

CAPABILITIES = Capabilities(
    standard_error=True,
    finite_segments=True,
    screen=True,
    carried=carried,
    cost=cost,
)

__all__ = [
    "CAPABILITIES",
    "QUALITIES",
    "MonteCarloField",
    "MonteCarloResult",
    "MonteCarloSettings",
    "StokesResult",
    "prepare",
]
