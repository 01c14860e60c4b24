"""Zones: cells that are rings about the direction of the sun; one solve serves every sun and every observer."""

from twilight.solvers.base import Capabilities
from twilight.solvers.zones.constants import table as tuned_numbers
from twilight.solvers.zones.cost import cost
from twilight.solvers.zones.field import ZonesField
from twilight.solvers.zones.grids import kinds_met, spectral_groups
from twilight.solvers.zones.settings import QUALITIES, ZonesSettings
from twilight.solvers.zones.solver import carried, load, prepare
from twilight.solvers.zones.stated_error import stated_error

CAPABILITIES = Capabilities(
    finite_segments=True,
    takes_suns=True,
    every_sun=True,
    every_observer=True,
    screen=True,
    spectral_groups=spectral_groups,
    carried=carried,
    cost=cost,
    expected_error=stated_error,
)

__all__ = ["CAPABILITIES", "QUALITIES", "ZonesField", "ZonesSettings", "kinds_met", "load", "prepare", "tuned_numbers"]
