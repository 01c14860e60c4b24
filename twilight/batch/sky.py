"""A scene of a sweep's dataset as a `Sky`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twilight.errors import TwilightError
from twilight.sky import Sky

if TYPE_CHECKING:
    import xarray


def sky_of(scene: xarray.Dataset) -> Sky:
    """The whole sky of one scene, both halves, with what it says about the sun.

    scene: the dataset of a sweep with one scene selected, e.g. ds.sel(sun_elevation_deg=-4, ground_albedo=0.2).
    Errors: TwilightError where more than one scene is left, or the scene has not been computed.
    """
    left = [name for name in scene.status.dims if scene.sizes[name] != 1]
    if left:
        raise TwilightError(f"sky_of: takes one scene; select also along {', '.join(map(str, left))}")
    scene = scene.squeeze(list(scene.status.dims))
    status = int(scene.status)
    if status != 1:
        raise TwilightError(
            f"sky_of: this scene {'was refused by its solver' if status == 2 else 'is not computed yet'}"
        )
    count = int(scene.attrs["azimuth_count"])
    azimuth = np.arange(count) * (360.0 / count)
    half = scene.azimuth.values
    column = np.abs(np.minimum(azimuth, 360.0 - azimuth)[:, None] - half).argmin(axis=1)

    def grid(name: str) -> np.ndarray | None:
        if name not in scene or np.isnan(scene[name]).all():
            return None
        return scene[name].transpose("elevation", "azimuth", "wavelength").values.astype(float)[:, column]

    elevation = float(scene.solar_elevation_angle)
    radiance = grid("sun_normalised_radiance")
    if radiance is None:
        raise TwilightError("sky_of: this scene holds no radiance")
    return Sky(
        wavelength_nm=scene.wavelength.values,
        elevation_deg=scene.elevation.values,
        azimuth_deg=azimuth,
        sun_normalised_radiance=radiance,
        sun_elevation_deg=elevation,
        sun_azimuth_deg=float(scene.solar_azimuth_angle) if "solar_azimuth_angle" in scene else None,
        distance_au=float(scene.earth_sun_distance),
        standard_error=grid("standard_error"),
        direct_irradiance=scene.direct_irradiance_factor.values.astype(float),
        apparent_sun_elevation_deg=elevation + float(scene.solar_bending),
        solar_spectrum=str(scene.attrs["solar_spectrum"]),
        provenance={"sweep_hash": scene.attrs["sweep_hash"]},
    )
