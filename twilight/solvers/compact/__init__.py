"""The solver compact: skies from a model of all clear air in one file, without compiled code."""

from twilight.solvers.base import Capabilities
from twilight.solvers.compact.field import COST, QUALITIES, CompactSettings, expected_error, prepare
from twilight.solvers.compact.field import ClearAirField as Field

CAPABILITIES = Capabilities(
    kind="fitted",
    every_sun=True,
    every_observer=True,
    looks_down=False,
    screen=True,
    cost=lambda medium, settings, suns, altitude_km: COST,
    expected_error=expected_error,
)

__all__ = ["CAPABILITIES", "QUALITIES", "CompactSettings", "Field", "prepare"]
