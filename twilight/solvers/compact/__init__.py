"""A compact model as a solver: a climate's skies from one small file, without tables, orders or compiled code."""

from twilight.solvers.base import ALL_WAVELENGTHS, Capabilities
from twilight.solvers.compact.field import QUALITIES, CompactSettings, Field, prepare, recorded

CAPABILITIES = Capabilities(
    every_sun=True, looks_down=False, reads_files=True, numpy_only=True, wavelengths_at_once=ALL_WAVELENGTHS
)

__all__ = ["CAPABILITIES", "QUALITIES", "CompactSettings", "Field", "prepare", "recorded"]
