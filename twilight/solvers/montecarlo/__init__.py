"""Backward Monte-Carlo in the exact spherical atmosphere: the referee of every other solver.

It keeps its own walk, lines and shells, so that a mistake in the geometry, quadrature or iteration of the others is not
made here too.  It shares with them the medium and the tables of the sunbeam (`transport.beam`) alone, and tests hold
those against rays integrated on their own.
"""

from twilight.solvers.base import Capabilities
from twilight.solvers.montecarlo.field import Field, prepare
from twilight.solvers.montecarlo.settings import QUALITIES, MonteCarloSettings
from twilight.solvers.montecarlo.tally import MonteCarloResult, StokesResult

CAPABILITIES = Capabilities(standard_error=True, finite_segments=True, stokes=True, water=True, target_stderr=True)

__all__ = [
    "CAPABILITIES",
    "QUALITIES",
    "Field",
    "MonteCarloResult",
    "MonteCarloSettings",
    "StokesResult",
    "prepare",
]
