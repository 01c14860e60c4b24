"""A configuration as it is written into files: every default said, and rendering it gives the same sky."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from twilight.config.scene import Config, SunAt, SunElevation
from twilight.config.solver import complete_solver
from twilight.scene.medium import table_sha256, wavelengths_of


def resolved_configuration(config: Config, section: SunElevation | SunAt) -> dict[str, Any]:
    """The configuration of one frame with every default written out, as JSON values; rendering it gives the frame.

    A tabulated medium is named by its file's name and the SHA-256 of its content, not by where it was.
    """
    data = config.model_copy(update={"sun": section, "vary": {}}).model_dump(mode="json", exclude_none=True)
    data["solver"] = complete_solver(config.solver)
    rows, columns = config.texture.shape
    data["texture"] = {"elevation_count": rows, "azimuth_count": columns}
    if config.texture.latlong_width is not None:
        data["texture"]["latlong_width"] = config.texture.latlong_width
    wavelength_nm = wavelengths_of(config)
    if wavelength_nm is not None:
        data["wavelengths"] = {"list_nm": wavelength_nm.tolist()}
    if config.climate.medium is not None:
        table = config.climate.medium.table
        data["climate"]["medium"] |= {"table": Path(table).name, "sha256": table_sha256(table)}
        for key in ("atmosphere", "gases", "refraction"):
            data["climate"].pop(key)
    return data
