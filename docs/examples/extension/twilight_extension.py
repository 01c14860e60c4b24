"""A solver and an output format for twilight: `--solver uniform --only luminance-csv`."""

from dataclasses import dataclass

import numpy as np

from twilight.api.extension import BareField, Capabilities, TwilightError, whole_file

CAPABILITIES = Capabilities(every_sun=True, wavelengths_at_once=2000)


@dataclass(frozen=True)
class Settings:
    """Options of the solver.

    radiance: of the whole sky, sun-normalised [sr^-1].
    """

    radiance: float = 0.01

    def __post_init__(self):
        if not 0.0 <= self.radiance < np.inf:
            raise TwilightError(f"solver.radiance is {self.radiance:g}; allowed is 0 and more")


QUALITIES = {"standard": Settings()}


class UniformField(BareField):
    """The same radiance in all directions, times the transmittance of the air above."""

    def __init__(self, medium, settings):
        self.medium, self.settings = medium, settings

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        shape = np.broadcast_shapes(np.shape(elevation_deg), np.shape(azimuth_deg))
        return np.broadcast_to(
            self.settings.radiance * np.exp(-self.medium.optical_depth("total")), (*shape, self.medium.n_wavelengths)
        ).copy()


def prepare(medium, settings=None, *, observer_altitude_km=0.0, progress=None):
    return UniformField(medium, settings or QUALITIES["standard"])


def write_luminance(rendered, folder, options):
    path, sky = folder / "sky.luminance.csv", rendered.sky
    with whole_file(path) as temporary:
        np.savetxt(temporary, sky.luminance(), "%.6g", ",", header=f"cd m-2, {len(sky.elevation_deg)} elevations")
    return [path]


write_luminance.files = ("sky.luminance.csv",)
