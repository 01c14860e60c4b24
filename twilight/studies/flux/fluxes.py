"""Irradiances, actinic fluxes and absorbed light at any altitude, for any sun, from a solved field.

With L the radiance in direction e and B the sunbeam at normal incidence, from which the sun is seen at elevation s,

    E_down = int L |sin e| dOmega over the upper hemisphere + B max(0, sin s)
    E_up   = int L |sin e| dOmega over the lower hemisphere + B max(0, -sin s)     seen from above, before it sets
    A      = int L dOmega + B                                                       actinic flux
    absorbed light in a volume = k_abs A,  heating rate = int k_abs A dlambda / (rho c_p)

Within the bands of gases these hold for each term of an exponential sum, and the terms are added.  The sun is a point
here: while its disc rises or sets, for 3 minutes, its light comes at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.engine import Solved
from twilight.engine.block import Block
from twilight.numerics import spectrum
from twilight.numerics.sphere_quadrature import POINTS, Hemisphere, hemispheres
from twilight.scene.scene import Scene

if TYPE_CHECKING:
    import xarray

PARTS = ("direct_down", "diffuse_down", "direct_up", "diffuse_up", "actinic_direct", "actinic_down", "actinic_up")
"""Fluxes over F0 that `around` returns, besides the light that is absorbed."""
LONG_NAMES = {
    "direct_down": "irradiance of a horizontal surface from above, sunbeam",
    "diffuse_down": "irradiance of a horizontal surface from above, scattered light",
    "direct_up": "irradiance of a horizontal surface from below, sunbeam",
    "diffuse_up": "irradiance of a horizontal surface from below, scattered and reflected light",
    "actinic_direct": "actinic flux, sunbeam",
    "actinic_down": "actinic flux from above, scattered light",
    "actinic_up": "actinic flux from below, scattered and reflected light",
    "net": "net irradiance downwards",
    "actinic": "actinic flux",
    "absorbed": "light absorbed by gases and aerosol",
}


def tangent_elevation_deg(medium: Medium, altitude_km: float, heights_km: np.ndarray) -> np.ndarray:
    """Elevation [deg] of bent lines of sight from an altitude to their lowest points, at heights above the ground [km].

    n r cos(elevation) is the same all along a line (Snell's law in spheres), n at the middle one of the wavelengths.
    """
    levels = np.append(medium.bottom_km + heights_km, altitude_km)
    index = 1.0 + medium.at(levels).refractivity[:, medium.n_wavelengths // 2]
    radius = index * (medium.earth_radius_km + levels)
    return -np.degrees(np.arccos(np.minimum(1.0, radius[:-1] / radius[-1])))


def _over(block: Block, sun_elevation_deg: float, altitude_km: float, sky: Hemisphere) -> tuple[np.ndarray, np.ndarray]:
    """Irradiance of a horizontal surface and actinic flux from one hemisphere over F0, of the block's terms (N,)."""
    elevation, azimuth = np.meshgrid(sky.elevation_deg, sky.azimuth_deg, indexing="ij")
    radiance = block.answer(sun_elevation_deg, elevation, azimuth, altitude_km, by_term=True).radiance
    return np.tensordot(sky.horizontal_weight, radiance, 2), np.tensordot(sky.weight_sr, radiance, 2)


def around(
    block: Block, sun_elevation_deg: float, altitude_km: float, points: int = POINTS
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Fluxes over F0 at one altitude [km], of the block's wavelengths: PARTS (W,), and light absorbed [km^-1] (W,)."""
    medium = block.term_medium
    beam, bending_deg = block.sunbeam.at(sun_elevation_deg, altitude_km)
    seen_deg = sun_elevation_deg + bending_deg
    upper, lower = hemispheres(
        seen_deg,
        altitude_km - medium.bottom_km,
        lambda heights: tangent_elevation_deg(medium, altitude_km, heights),
        points,
    )
    down, actinic_down = _over(block, sun_elevation_deg, altitude_km, upper)
    up, actinic_up = _over(block, sun_elevation_deg, altitude_km, lower)
    sine = float(np.sin(np.radians(seen_deg)))
    values = (beam * max(0.0, sine), down, beam * max(0.0, -sine), up, beam, actinic_down, actinic_up)
    at = medium.at(altitude_km)
    absorption = at.absorption + at.aerosol_extinction * (1.0 - at.aerosol_albedo)
    absorbed = absorption * (beam + actinic_down + actinic_up)
    if block.bands is None:
        return dict(zip(PARTS, values, strict=True)), absorbed
    return {k: block.bands.sum_terms(v) for k, v in zip(PARTS, values, strict=True)}, block.bands.sum_terms(absorbed)


def check(scene: Scene, altitude_km: np.ndarray) -> None:
    """Raise TwilightError for a solver that does not look down, and for altitudes that are below the ground."""
    if not scene.capabilities.looks_down:
        name = scene.solver.__name__.rsplit(".", 1)[-1]
        raise TwilightError(
            f"fluxes: the solver {name} does not look below the horizon; zones, tables and montecarlo do"
        )
    lowest = scene.medium.bottom_km
    if altitude_km.size == 0 or not np.all((altitude_km >= lowest) & np.isfinite(altitude_km)):
        raise TwilightError(f"altitude_km: must be one number or more, each {lowest:g} km (the ground) or more")


def fluxes_of(
    solved: Solved,
    sun_elevation_deg: ArrayLike,
    altitude_km: ArrayLike = 0.0,
    *,
    solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM,
    distance_au: float = 1.0,
    progress: Progress = silent,
) -> xarray.Dataset:
    """Fluxes of light at altitudes, for suns.

    Parameters
    ----------
    solved
        A field, of a solver that looks below the horizon.
    sun_elevation_deg : (S,) or one
        True elevations of the sun [deg].
    altitude_km : (Z,) or one
        Altitudes above sea level [km].
    solar_spectrum, distance_au
        Name of the solar spectrum, and the sun's distance [au].
    progress
        Called as progress(doing, fraction) now and then.

    Returns
    -------
    xarray.Dataset
        Over sun_elevation (S,), altitude (Z,) and wavelength (W,): the parts of LONG_NAMES in W m^-2 nm^-1, `absorbed`
        in W m^-3 nm^-1; `albedo`, upward over downward irradiance.  Means over the wavelengths' bins
        (`spectrum.wavelength_bounds`), whose widths are `wavelength_width`.

    Raises
    ------
    TwilightError
        For a solver that does not look down, an altitude below the ground, and what the solver cannot do.
    """
    import xarray  # start-up

    suns, altitudes = (np.atleast_1d(np.asarray(v, dtype=float)) for v in (sun_elevation_deg, altitude_km))
    if suns.size == 0 or not np.all((suns >= -90.0) & (suns <= 90.0)):
        raise TwilightError("sun_elevation_deg: must be one number or more, each from -90 to 90")
    check(solved.scene, altitudes)
    nm = solved.medium.wavelength_nm
    found = {key: np.zeros((suns.size, altitudes.size, nm.size)) for key in (*PARTS, "absorbed")}
    # lines of sight are traced once for an altitude
    for z, altitude in enumerate(altitudes):
        for s, sun in enumerate(suns):
            progress("fluxes", (z * suns.size + s) / (altitudes.size * suns.size))
            for block in solved.blocks:
                parts, absorbed = around(block, float(sun), float(altitude))
                for key, value in parts.items():
                    found[key][s, z, block.wavelengths] += value
                found["absorbed"][s, z, block.wavelengths] += 1e-3 * absorbed
    down = found["direct_down"] + found["diffuse_down"]
    up = found["direct_up"] + found["diffuse_up"]
    found["net"] = down - found["direct_up"] - found["diffuse_up"]
    found["actinic"] = found["actinic_direct"] + found["actinic_down"] + found["actinic_up"]
    solar = spectrum.solar_irradiance(nm, solar_spectrum, distance_au)
    axes = ("sun_elevation", "altitude", "wavelength")
    values = {}
    for key, name in LONG_NAMES.items():
        units = "W m-3 nm-1" if key == "absorbed" else "W m-2 nm-1"
        values[key] = (axes, found[key] * solar, {"units": units, "long_name": name})
    albedo = up / np.where(down > 0.0, down, np.nan)
    values["albedo"] = (axes, albedo, {"units": "1", "long_name": "up over down"})
    bounds = spectrum.wavelength_bounds(nm, solar_spectrum)
    return xarray.Dataset(
        values,
        {
            "sun_elevation": ("sun_elevation", suns, {"units": "degree", "long_name": "true elevation of the sun"}),
            "altitude": ("altitude", altitudes, {"units": "km", "long_name": "altitude above sea level"}),
            "wavelength": ("wavelength", nm, {"units": "nm"}),
            "wavelength_width": ("wavelength", bounds[:, 1] - bounds[:, 0], {"units": "nm"}),
            "solar_irradiance": ("wavelength", solar, {"units": "W m-2 nm-1"}),
        },
        {"solar_spectrum": solar_spectrum, "distance_au": distance_au, "title": solved.scene.title},
    )
