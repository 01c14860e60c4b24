"""Zones: cells that are rings about the direction of the sun; one solve serves every sun and every observer."""

from twilight.solvers.zones.field import Field
from twilight.solvers.zones.settings import QUALITIES, ZonesSettings
from twilight.solvers.zones.solver import load, prepare

TAKES_SUNS = True
"""`prepare` takes sun_elevations_deg, and computes only what those suns need."""
WAVELENGTH_BLOCK = 32

__all__ = ["QUALITIES", "TAKES_SUNS", "WAVELENGTH_BLOCK", "Field", "ZonesSettings", "load", "prepare"]
