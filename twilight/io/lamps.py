"""``sun.json`` and ``moon.json``: light of sun and moon as lamps for renderers, whose environment map has no discs."""

from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_file, write_json
from twilight.io.provenance import provenance_fields
from twilight.io.rendered import Options, Rendered
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.disc import SOLAR_RADIUS_DEG
from twilight.sky.moon import PHASE_RANGE_DEG, moon_illuminance_lux
from twilight.sky.sky import Sky


def sun_irradiance_factor(sky: Sky) -> np.ndarray | None:
    """Irradiance of the sun at the observer, normal to its light, over F0, (W,); None where the sky does not know it.

    Of what is seen of the disc where the sky has it, else of the beam from the disc's centre.
    """
    return sky.direct_irradiance if sky.disc is None else sky.disc.irradiance_factor()


def sun_facts(sky: Sky, observer: str = colour.DEFAULT_OBSERVER, *, in_map: bool = False) -> dict[str, Any]:
    """What ``sun.json`` holds, as JSON values; its keys are explained in docs/environment-maps.md.

    Irradiances are normal to the light.  RGB is linear Rec. 709 in W m^-2 as in ``sky.rgb.exr``: times 683.002 it is
    lux; colours outside the gamut are moved into it, as lamps want it.  in_map: the disc is in the environment map.
    """
    factor = sun_irradiance_factor(sky)
    disc = sky.disc
    true, azimuth = sky.sun_elevation_deg, sky.sun_azimuth_deg
    apparent = true if sky.apparent_sun_elevation_deg is None else sky.apparent_sun_elevation_deg
    if disc is not None and disc.is_seen:
        apparent = disc.centroid_deg()
    radius = disc.radius_deg if disc else np.degrees(np.arcsin(np.sin(np.radians(SOLAR_RADIUS_DEG)) / sky.distance_au))
    facts: dict[str, Any] = {
        "true_elevation_deg": true,
        "apparent_elevation_deg": float(apparent),
        "azimuth_deg": azimuth,
        "angular_diameter_deg": float(2.0 * radius),
        "in_environment_map": in_map,
    }
    if disc is not None:
        lower, upper = disc.edges_deg()
        visible = bool(np.isfinite(lower))
        facts["lower_edge_deg"], facts["upper_edge_deg"] = (lower, upper) if visible else (None, None)
    facts["exposure_ev100"] = colour.auto_exposure_ev100(sky.luminance(), sky.solid_angle_sr())
    facts["wavelength_nm"] = sky.wavelength_nm.tolist()
    if factor is None:
        rgb = None
        facts["irradiance_W_per_m2_nm"] = facts["irradiance_rgb_W_per_m2"] = facts["illuminance_lux"] = None
    else:
        xyz = colour.factor_to_xyz(factor, sky.wavelength_nm, sky.solar_spectrum, sky.distance_au, observer)
        rgb = colour.into_gamut(colour.xyz_to_linear_rgb(xyz)) / spectrum.LUMINOUS_EFFICACY_LM_PER_W
        facts["irradiance_W_per_m2_nm"] = (factor * sky.solar_irradiance).tolist()
        facts["irradiance_rgb_W_per_m2"] = rgb.tolist()
        facts["illuminance_lux"] = float(xyz[1])
    return facts | lamps(float(apparent), azimuth or 0.0, float(radius), rgb) | provenance_fields(sky.provenance)


def lamps(elevation_deg: float, azimuth_deg: float, radius_deg: float, rgb: np.ndarray | None) -> dict[str, Any]:
    """A disc as a lamp of Blender and of Mitsuba; rgb (3,): irradiance [W m^-2]."""
    return {
        "blender": _blender(elevation_deg, azimuth_deg, radius_deg, rgb),
        "mitsuba": _mitsuba(elevation_deg, azimuth_deg, rgb),
    }


def _blender(elevation_deg: float, azimuth_deg: float, radius_deg: float, rgb: np.ndarray | None) -> dict[str, Any]:
    """A sun lamp: +Z up, +X east, +Y north; it shines along its own -Z, and strength times colour is W m^-2."""
    strength = 0.0 if rgb is None else float(rgb.max())
    return {
        "rotation_euler_rad": np.radians([90.0 - elevation_deg, 0.0, 180.0 - azimuth_deg]).tolist(),
        "energy": strength,
        "color": (rgb / strength).tolist() if rgb is not None and strength > 0.0 else [1.0, 1.0, 1.0],
        "angle_rad": float(np.radians(2.0 * radius_deg)),
    }


def _mitsuba(elevation_deg: float, azimuth_deg: float, rgb: np.ndarray | None) -> dict[str, Any]:
    """An emitter ``directional``: +Y up, +Z north, -X east; the direction is that in which light travels."""
    e, a = np.radians([elevation_deg, azimuth_deg])
    towards = np.array([-np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])
    return {
        "type": "directional",
        "direction": (-towards).tolist(),
        "irradiance": {"type": "rgb", "value": [0.0] * 3 if rgb is None else rgb.tolist()},
    }


USD = """#usda 1.0
(
    defaultPrim = "Sky"
    metersPerUnit = 1
    upAxis = "Y"
    doc = "+Z north, -X east; light in W m^-2 weighted with V, times 683 lm; exposure EV100 {ev100:.2f}"
)

def Xform "Sky"
{{{lights}
}}
"""
"""``sky.usda``; lights: of it."""
USD_DOME = """
    def DomeLight "Dome"
    {
        asset inputs:texture:file = @./sky.rgb.exr@
        token inputs:texture:format = "latlong"
    }
"""
"""The environment map, in the axes of `openexr` and `mitsuba`."""
USD_SUN = """
    def DistantLight "Sun"
    {{
        float inputs:intensity = {energy:.9g}
        color3f inputs:color = ({color[0]:.9g}, {color[1]:.9g}, {color[2]:.9g})
        float inputs:angle = {angular_diameter_deg:.9g}
        bool inputs:normalize = 1
        double3 xformOp:rotateXYZ = ({x:.9g}, {y:.9g}, 0)
        uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
    }}
"""
"""The sun's beam, from the disc's middle; its intensity is the irradiance."""


def usd_text(facts: dict[str, Any], *, dome: bool) -> str:
    """``sky.usda`` for what `sun_facts` gives: the map, where it is there, and the sun, where the map has none."""
    x, y = -facts["apparent_elevation_deg"], -(facts["azimuth_deg"] or 0.0)
    sun = "" if facts["in_environment_map"] and dome else USD_SUN.format(**facts, **facts["blender"], x=x, y=y)
    return USD.format(ev100=facts["exposure_ev100"], lights=((USD_DOME if dome else "") + sun).rstrip())


def write_sun(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sun.json``, and ``sky.usda`` beside it: map and sun for programs that read USD; each whole or not at all."""
    facts = sun_facts(rendered.seen, options.observer, in_map=options.disc and rendered.seen.disc is not None)
    dome = options.renderer in ("openexr", "mitsuba") and (folder / "sky.rgb.exr").is_file()
    with whole_file(folder / "sky.usda") as temporary:
        temporary.write_text(usd_text(facts, dome=dome), encoding="utf-8")
    return [write_json(folder / "sun.json", facts), folder / "sky.usda"]


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
