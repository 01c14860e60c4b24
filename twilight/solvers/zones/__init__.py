"""Zones: cells that are rings about the direction of the sun; one solve serves every sun and every observer."""

from twilight.solvers.zones.field import Field, prepare
from twilight.solvers.zones.settings import QUALITIES, ZonesSettings

__all__ = ["QUALITIES", "Field", "ZonesSettings", "prepare"]
