"""Spectral radiance of the whole clear sky, from full day to the last light of astronomical twilight.

    import twilight
    sky = twilight.render("continental-average", sun_elevation_deg=-4)
    sky.radiance, sky.magnitude("V", elevation_deg=90), sky.illuminance_lux(), sky.plot(), sky.to_xarray()
    field = twilight.solve("continental-average")
    field.radiance(-4.0, 20.0, 0.0)  # sun-normalised [sr^-1], for any sun and direction

`__all__` is all that programs may rely on; everything else may change.  Names are loaded when they are used: importing
the package costs nothing.
"""

from importlib import import_module

__version__ = "1.0.0rc1"

_WHERE = {
    "Climate": "twilight.config",
    "Config": "twilight.config",
    "Direction": "twilight.sky.surfaces",
    "Field": "twilight.api.calls",
    "Medium": "twilight.atmosphere.medium",
    "Sky": "twilight.api.representation",
    "SkySeries": "twilight.api.representation",
    "Surface": "twilight.sky.surfaces",
    "TwilightError": "twilight.base.errors",
    "TwilightWarning": "twilight.base.errors",
    "estimate": "twilight.api.photographs",
    "light": "twilight.api.light",
    "load": "twilight.config",
    "load_climate": "twilight.config",
    "medium": "twilight.api.calls",
    "open_dataset": "twilight.api.representation",
    "read_sky": "twilight.api.photographs",
    "render": "twilight.api.calls",
    "skies": "twilight.api.calls",
    "solve": "twilight.api.calls",
    "solver": "twilight.api.calls",
}
"""The module of each public name.  All ways to a `Sky` lead through `twilight.api`, which attaches what draws it."""
__all__ = sorted(["__version__", *_WHERE])


def __getattr__(name: str) -> object:
    if name not in _WHERE:
        raise AttributeError(f"module 'twilight' has no attribute '{name}'")
    return getattr(import_module(_WHERE[name]), name)


def __dir__() -> list[str]:
    return __all__
