"""The night floor: airglow, starlight and zodiacal light, so that a sky without the sun is not black.

A layer of its own in W m^-2 nm^-1 sr^-1, added to the sky that the sun makes and independent of the solver.
"""

from twilight.sky.moments import Place
from twilight.sky.night.glows import NightLevels, night_radiance

__all__ = ["NightLevels", "Place", "night_radiance"]
