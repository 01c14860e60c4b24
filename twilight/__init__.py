"""Spectral radiance of the whole clear sky, from full day to the last light of astronomical twilight.

    import twilight
    sky = twilight.render("continental-average", sun_elevation_deg=-4)
    sky.radiance, sky.magnitude("V", elevation_deg=90), sky.illuminance_lux(), sky.plot(), sky.to_xarray()
    field = twilight.solve("continental-average")
    field.radiance(-4.0, 20.0, 0.0)  # sun-normalised [sr^-1], for any sun and direction

Names are loaded when they are used: importing the package costs nothing.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"
__all__ = ["Sky", "TwilightError", "TwilightWarning", "__version__", "load", "read_sky", "render", "solve"]

_WHERE = {
    "Sky": "twilight.sky",
    "TwilightError": "twilight.errors",
    "TwilightWarning": "twilight.errors",
    "load": "twilight.config",
    "read_sky": "twilight.io",
    "render": "twilight.face",
    "solve": "twilight.face",
}


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'twilight' has no attribute '{name}'")
    return getattr(import_module(_WHERE[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
