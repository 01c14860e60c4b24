"""Haber, Magnor & Seidel 2005: cells around the observer that exchange scattered light, and an exact mode beyond it."""

from twilight.solvers.base import Capabilities
from twilight.solvers.cells.settings import QUALITIES, CellsSettings
from twilight.solvers.cells.solver import Field, cost, prepare

CAPABILITIES = Capabilities(cost=cost)

__all__ = ["CAPABILITIES", "QUALITIES", "CellsSettings", "Field", "prepare"]
