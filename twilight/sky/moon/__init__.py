"""The moon as a second sun: where it stands, how bright it is, and its disc."""

from twilight.sky.moon.disc import MoonDisc, MoonSeen
from twilight.sky.moon.light import Moon
from twilight.sky.moon.place import moon_over

__all__ = ["Moon", "MoonDisc", "MoonSeen", "moon_over"]
