"""``moon.json``: where the moon of a sky stands, how much of it is lit, and its own light at the observer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.whole_files import write_json
from twilight.io.provenance import provenance_fields
from twilight.io.rendered import Options, Rendered
from twilight.io.sun import lamps
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.moon import PHASE_RANGE_DEG, moon_illuminance_lux
from twilight.sky.sky import Sky

SOURCE = "Kieffer and Stone 2005 (ROLO 311g), without libration; beyond 97 deg of phase continued by Allen 1976"


def moon_facts(sky: Sky, observer: str = colour.DEFAULT_OBSERVER, *, in_map: bool = False) -> dict[str, Any]:
    """What ``moon.json`` holds, as JSON values, by the names and units of ``sun.json`` where both have them.

    Irradiances are of the moon's own beam, normal to its light, at the observer; 0 where it is below the horizon.
    Errors: TwilightError for a sky without a moon.
    """
    if sky.moon is None:
        raise TwilightError("output.files: moon needs the moon: add moon: {} to the configuration")
    moon, disc = sky.moon.moon, sky.moon.disc
    azimuth = moon.azimuth_deg if sky.sun_azimuth_deg is None else (sky.sun_azimuth_deg + moon.azimuth_deg) % 360.0
    factor = sky.moon.direct_irradiance / spectrum.solar_irradiance(sky.wavelength_nm, sky.solar_spectrum)
    xyz = colour.factor_to_xyz(factor, sky.wavelength_nm, sky.solar_spectrum, 1.0, observer)
    rgb = colour.into_gamut(colour.xyz_to_linear_rgb(xyz)) / spectrum.LUMINOUS_EFFICACY_LM_PER_W
    facts: dict[str, Any] = {
        "true_elevation_deg": moon.elevation_deg,
        "apparent_elevation_deg": sky.moon.apparent_elevation_deg,
        "above_horizon": disc is not None,
        "azimuth_deg": azimuth if sky.sun_azimuth_deg is not None else None,
        "azimuth_from_sun_deg": moon.azimuth_deg,
        "phase_angle_deg": moon.phase_angle_deg,
        "phase_angle_range_deg": [*PHASE_RANGE_DEG],
        "phase_angle_is_in_range": not moon.continued,
        "waxing": moon.waxing,
        "illuminated_fraction": moon.illuminated_fraction,
        "bright_limb_deg": None if disc is None else disc.bright_limb_deg,
        "distance_km": moon.distance_km,
        "angular_diameter_deg": 2.0 * moon.radius_deg,
        "in_environment_map": in_map and disc is not None,
        "illuminance_above_the_air_lux": moon_illuminance_lux(moon, sky.solar_spectrum),
        "wavelength_nm": sky.wavelength_nm.tolist(),
        "irradiance_W_per_m2_nm": sky.moon.direct_irradiance.tolist(),
        "irradiance_rgb_W_per_m2": rgb.tolist(),
        "illuminance_lux": float(xyz[1]),
        "model": SOURCE,
    }
    if disc is not None:
        lower, upper = disc.edges_deg()
        if np.isfinite(lower):
            facts["lower_edge_deg"], facts["upper_edge_deg"] = lower, upper
    lit = lamps(sky.moon.apparent_elevation_deg, azimuth, moon.radius_deg, rgb)
    return facts | lit | provenance_fields(sky.provenance)


def write_moon(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``moon.json``, whole or not at all."""
    return [write_json(folder / "moon.json", moon_facts(rendered.seen, options.observer, in_map=options.disc))]
