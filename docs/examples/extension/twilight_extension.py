"""A solver and an output format for twilight: `--solver uniform --only luminance-csv`."""

from dataclasses import dataclass

import numpy as np

from twilight.api.extension import BareField, Capabilities, TwilightError, whole_file


@dataclass(frozen=True)
class Settings:
    """radiance: of the whole sky above the air, sun-normalised [sr^-1]."""

    radiance: float = 0.01

    def __post_init__(self):
        if not 0.0 <= self.radiance < np.inf:
            raise TwilightError(f"solver.radiance is {self.radiance:g}; allowed is 0 and more")


class UniformField(BareField):
    def __init__(self, medium, settings=None, *, observer_altitude_km=0.0, progress=None):
        self.medium = medium
        self.light = (settings or Settings()).radiance * np.exp(-medium.optical_depth("total"))

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        return np.tile(self.light, (*np.broadcast(elevation_deg, azimuth_deg).shape, 1))


CAPABILITIES = Capabilities(every_sun=True, wavelengths_at_once=2000)
QUALITIES = {"standard": Settings()}
prepare = UniformField


def write_luminance(rendered, folder, options):
    with whole_file(folder / "sky.luminance.csv") as temporary:
        np.savetxt(temporary, rendered.sky.luminance(), delimiter=",", header="cd m-2, a row an elevation")
    return [folder / "sky.luminance.csv"]


write_luminance.files = ("sky.luminance.csv",)
