"""Films of a sky in closed form, for tests."""

from dataclasses import fields

import numpy as np
from airs import scene_of_field, turbid
from closed_sky import FIVE_NM, ClosedSky

from twilight.config import load
from twilight.show.film import Animation
from twilight.show.timeline import Pace

FIVE = {"from_deg": 0.0, "to_deg": -10.0, "speed": 600.0, "frames_per_second": 1.0, "nodes": (17, 13)}
"""Of five pictures."""
MEDIUM = turbid(wavelength_nm=FIVE_NM)
SKY = ClosedSky(MEDIUM, lambda sun_deg: 10.0 ** (sun_deg / 4.0) * 0.01, lambda e, a: np.full(e.shape, -1.5))
"""A factor of 10 darker for every 4 deg that the sun falls."""


def closed_scene():
    return scene_of_field(SKY)


def scene(**settings):
    view = {"observer.view.kind": "perspective", "observer.view.width": 64, "observer.view.height": 64}
    return load("pure-air", {**view, "observer.view.elevation_deg": 30.0, **settings})


def film(path, config=None, **options):
    pace, rest = paced({**FIVE, **options})
    return Animation(config or scene(), path, pace, scene=closed_scene(), **rest)


def paced(options):
    """The pace of a film, and its other options."""
    names = {field.name for field in fields(Pace)}
    return Pace(**{k: v for k, v in options.items() if k in names}), {k: options[k] for k in options.keys() - names}
