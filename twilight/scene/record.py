"""A configuration as it is written into files: every default said, and rendering it gives the same sky."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from twilight.config.climate import climate_files
from twilight.config.scene import Config
from twilight.config.solver import complete_solver
from twilight.config.sun import SunAt, SunElevation
from twilight.scene.medium import name_by_content, wavelengths_of


def resolved_configuration(config: Config, section: SunElevation | SunAt) -> dict[str, Any]:
    """The configuration of one frame with every default written out, as JSON values; rendering it gives the frame.

    Tables of the climate are named by their files' names and the SHA-256 of their content, not by where they were.
    """
    data = config.model_copy(update={"sun": section, "vary": {}}).model_dump(mode="json", exclude_none=True)
    data["solver"] = complete_solver(config.solver)
    rows, columns = config.texture.shape
    data["texture"] = {"elevation_count": rows, "azimuth_count": columns} if config.texture.plain else {}
    wavelength_nm = wavelengths_of(config)
    if wavelength_nm is not None:
        data["wavelengths"] = {"list_nm": wavelength_nm.tolist()}
    name_by_content(data["climate"])
    for holder, _, name, _ in climate_files(data["climate"]):
        holder[name] = Path(holder[name]).name
    if config.climate.medium is not None:
        for key in ("atmosphere", "gases", "refraction"):
            data["climate"].pop(key)
    return data
