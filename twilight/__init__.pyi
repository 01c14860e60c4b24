"""Types of the public names, which `__init__.py` loads when they are used."""

from twilight.api.calls import medium, render, skies, solve, solver
from twilight.api.light import light
from twilight.api.photographs import estimate, read_sky
from twilight.api.representation import Sky, SkySeries, open_dataset
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config import Climate, Config, load, load_climate
from twilight.engine import Field
from twilight.sky.surfaces import Direction, Surface

__version__: str
__all__ = [
    "Climate",
    "Config",
    "Direction",
    "Field",
    "Medium",
    "Sky",
    "SkySeries",
    "Surface",
    "TwilightError",
    "TwilightWarning",
    "__version__",
    "estimate",
    "light",
    "load",
    "load_climate",
    "medium",
    "open_dataset",
    "read_sky",
    "render",
    "skies",
    "solve",
    "solver",
]
