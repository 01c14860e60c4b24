"""Files of measurements and analyses of the air: each is recognised by its content."""

from twilight.io.air.lines import PlaceAndTime
from twilight.io.air.read import KINDS, read_air_file

__all__ = ["KINDS", "PlaceAndTime", "read_air_file"]
