"""Files of measurements and analyses of the air: each is recognised by its content."""

from twilight.io.air.read import KINDS, read_air_file
from twilight.io.air.wanted import Wanted

__all__ = ["KINDS", "Wanted", "read_air_file"]
