"""A solver with a closed form for every observer, without suns below -10 deg, which waits, holds memory or fails on
request."""

import os
import time
from pathlib import Path

import numpy as np

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.sections import option, settings
from twilight.solvers.base import BareField, Capabilities

solvers.SOLVERS["toy"] = "toy_solver"


@settings
class Settings:
    wait_s: float = option("for each sky", default=0.0)
    factor: float = option("on its light, 13 fails", default=1.0)
    hold_mib: int = option("memory during each sky", default=0)


CAPABILITIES = Capabilities(every_observer=True)
QUALITIES = {"draft": Settings(factor=1.1), "standard": Settings()}


def truth(factor, albedo, sun, altitude_km, elevation, azimuth, wavelength_nm):
    elevation, azimuth = np.broadcast_arrays(elevation, azimuth)
    shape = 10.0 ** (sun / 10.0) * (2.0 + np.cos(np.radians(azimuth))) * (2.0 - np.sin(np.radians(elevation)))
    return factor * (1.0 + albedo) * np.exp(-altitude_km) * shape[..., None] * (np.asarray(wavelength_nm) / 550.0) ** -3


class Field(BareField):
    def __init__(self, medium, settings):
        self.medium, self.settings = medium, settings

    def radiance(self, sun, elevation, azimuth, *, observer_altitude_km=0.0):
        if sun < -10.0:
            raise TwilightError("the toy solver needs a sun at -10 deg or higher")
        time.sleep(self.settings.wait_s)
        _ = np.ones(self.settings.hold_mib * 2**17)
        albedo, nm = self.medium.ground_albedo[0], self.medium.wavelength_nm
        return truth(self.settings.factor, albedo, sun, observer_altitude_km, elevation, azimuth, nm)


def prepare(medium, settings, *, observer_altitude_km=0.0, progress=None):
    if os.environ.get("TOY_LOG"):
        with open(os.environ["TOY_LOG"], "a") as log:
            log.write(f"{os.getpid()} {settings.factor:g} {medium.ground_albedo[0]:g} {medium.n_wavelengths}\n")
    if settings.factor == 13.0 and not Path(os.environ["TOY_LOG"]).with_name("mended").exists():
        raise ZeroDivisionError("the toy broke")
    return Field(medium, settings)
