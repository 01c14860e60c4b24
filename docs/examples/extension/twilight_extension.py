"""A solver and an output format for twilight: `--solver uniform --only luminance-csv`."""

import numpy as np

from twilight.api.extension import BareField, Capabilities, option, settings, whole_file


@settings
class Settings:
    radiance: float = option("of the whole sky above the air, sun-normalised [sr^-1]", default=0.01, ge=0.0)


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
