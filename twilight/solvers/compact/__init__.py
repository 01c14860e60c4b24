"""The solver compact: skies from a small fitted file, without compiled code; of all clear air, or of one climate."""

from twilight.solvers.base import Capabilities
from twilight.solvers.compact.clear_air_field import ClearAirField as Field
from twilight.solvers.compact.derivatives import differentiate
from twilight.solvers.compact.field import QUALITIES, CompactSettings, prepare, recorded

CAPABILITIES = Capabilities(
    kind="fitted",
    every_sun=True,
    every_observer=True,
    looks_down=False,
    differentiate=differentiate,
)

__all__ = ["CAPABILITIES", "QUALITIES", "CompactSettings", "Field", "prepare", "recorded"]
