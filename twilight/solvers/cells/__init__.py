"""Haber, Magnor & Seidel 2005: cells around the observer that exchange scattered light.

In the order of the paper: `haber` (section 3), `grid` (4.1.2, 4.1.3), `ground` (4.1.4), `direct_light` (4.4, 4.6.2),
`exchange` (4.5.3 to 4.6.2, and 5), `sky_texture` (4.7).
"""

from twilight.solvers.base import Capabilities
from twilight.solvers.cells.haber import QUALITIES, CellsField, CellsSettings, cost, prepare

CAPABILITIES = Capabilities(simple_phases=True, cost=cost)

__all__ = ["CAPABILITIES", "QUALITIES", "CellsField", "CellsSettings", "prepare"]
