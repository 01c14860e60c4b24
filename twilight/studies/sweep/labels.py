"""What a dataset calls the coordinate of a key that a sweep varies: a few words and a unit, for axes and legends."""

from __future__ import annotations

from typing import Any

from twilight.config.climate import Climate
from twilight.config.scene import Config
from twilight.io.labels import LABELS, attributes
from twilight.studies.sweep.dimensions import variable_name

TEXTS = {
    "aerosol.angstrom.asymmetry": "asymmetry of the aerosol",
    "aerosol.angstrom.exponent": "Ångström exponent",
    "aerosol.angstrom.single_scattering_albedo": "single scattering albedo",
    "aerosol.boundary_layer_top_km": "top of the boundary layer",
    "aerosol.mineral_transported.bottom_km": "bottom of the mineral layer",
    "aerosol.mineral_transported.number_density_per_cm3": "mineral particles",
    "aerosol.mineral_transported.optical_depth_550nm": "mineral optical depth at 550 nm",
    "aerosol.mineral_transported.top_km": "top of the mineral layer",
    "aerosol.modes.number_density_per_cm3": "particles (modes)",
    "aerosol.optical_depth_550nm": "aerosol optical depth at 550 nm",
    "aerosol.relative_humidity_percent": "relative humidity",
    "aerosol.scale_height_km": "scale height of the aerosol",
    "aerosol.type": "aerosol",
    "atmosphere.layers.equal_air_mass": "layers of equal air mass",
    "atmosphere.profile": "profile of the air",
    "atmosphere.top_km": "top of the air",
    "gases.no2": "NO2",
    "gases.o4": "O4",
    "gases.oxygen": "bands of oxygen",
    "gases.ozone.column_du": "ozone column",
    "gases.ozone.day_of_year": "day of the year",
    "gases.ozone.treatment": "treatment of ozone",
    "gases.water_vapour.column_mm": "water vapour column",
    "ground.albedo": "albedo of the ground",
    "ground.altitude_km": "altitude of the ground",
    "horizon.screen.clouds.cover": "cover of clouds beyond the horizon",
    "horizon.screen.clouds.top_km": "top of clouds beyond the horizon",
    "medium.earth_radius_km": "radius of the Earth",
    "observer.altitude_km": "observer altitude",
    "night.airglow": "airglow over usual",
    "night.light_pollution.zenith_mag_per_arcsec2": "zenith under light pollution",
    "night.starlight": "starlight over usual",
    "night.zodiacal_light": "zodiacal light over usual",
    "refraction.co2_ppm": "CO2",
    "refraction.relative_humidity_percent": "humidity of Haber's refraction",
    "stratosphere.kind": "stratosphere",
    "stratosphere.levels.altitude_km": "altitude (stratospheric levels)",
    "sun.at": "time",
    "sun.distance_au": "distance of the sun",
    "sun.latitude_deg": "latitude",
    "sun.longitude_deg": "longitude",
    "sun.time_zone": "time zone",
    "terrain.albedo": "albedo of the mountains",
    "terrain.azimuth_deg": "azimuth of the mountains",
    "terrain.base_km": "foot of the mountains",
    "terrain.distance_km": "distance of the mountains",
    "terrain.height_km": "height of the mountains",
}
"""Of keys whose own words would not do."""
UNITS = {"deg": "degree", "au": "astronomical_unit", "cm^-3": "cm-3", "m/s": "m s-1"}
"""Units of keys as UDUNITS spells them."""


def key_attributes(key: str) -> dict[str, str]:
    """CF attributes of a dotted key: long_name, units and, as the comment, its line of help; and the key itself."""
    unit, text = describe_key(key)
    short = key.removeprefix("climate.")
    made = {"long_name": label_of(short, unit), "units": UNITS.get(unit, unit), "comment": text, "key": key}
    if variable_name(key) in LABELS:
        made |= attributes(variable_name(key))
    return {name: value for name, value in made.items() if value}


def label_of(key: str, unit: str = "") -> str:
    """A few words for a key: those of `TEXTS`, else its own without the unit at their end."""
    if key in TEXTS:
        return TEXTS[key]
    section, _, last = key.rpartition(".")
    words = last.split("_")
    if unit and len(words) > 1 and words[-1] == unit.split("/")[0].lower():
        words.pop()
    of = section.rpartition(".")[2].replace("_", " ")
    text = " ".join(words)
    return text if not of or of in ("expert", "climate", text) else f"{text} ({of})"


def describe_key(key: str) -> tuple[str, str]:
    """(unit, one line of help) of a dotted key, empty where there is none."""
    parts = key.removeprefix("climate.").split(".")
    for model in (Config, Climate):
        owner: Any = model
        info = None
        for part in parts:
            info = next((m.model_fields[part] for m in _models(owner) if part in m.model_fields), None)
            if info is None:
                break
            owner = info.annotation
        if info is not None:
            extra = info.json_schema_extra
            return (str(extra.get("unit", "")) if isinstance(extra, dict) else "", info.description or "")
    return "", ""


def _models(annotation: Any) -> list[Any]:
    """All models in an annotation, through unions."""
    if hasattr(annotation, "model_fields"):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in _models(inner)]
