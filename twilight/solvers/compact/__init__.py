"""The solver compact: skies from a small fitted file, without compiled code; of all clear air, or of one climate."""

from twilight.solvers.base import Capabilities
from twilight.solvers.compact.clear_air_field import ClearAirField as Field
from twilight.solvers.compact.field import QUALITIES, CompactSettings, prepare, recorded

CAPABILITIES = Capabilities(
    every_sun=True,
    every_observer=True,
    looks_down=False,
    stokes=True,
    reads_files=True,
    numpy_only=True,
)

__all__ = ["CAPABILITIES", "QUALITIES", "CompactSettings", "Field", "prepare", "recorded"]
