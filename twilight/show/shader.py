"""The sky of one air for one observer in two textures, read by GLSL or WGSL: every direction and every sun.

The textures hold the nodes of a `SkyTable` of X, Y, Z and scotopic luminance [cd m^-2] with the sun at 1 au, and the
shaders read them by its rule: `SkyTable.light` is the same in Python.
"""

import base64
import json
from dataclasses import dataclass
from importlib import resources
from typing import Any

from twilight.base.progress import Progress, part_of, silent
from twilight.engine import Field
from twilight.engine.sun_tables import LOWEST_SUN_DEG, ROW_COUNT, SunTables
from twilight.engine.table import shared_rows
from twilight.numerics import spectrum
from twilight.show.skies import check_altitudes
from twilight.show.tones import Channels, layers, node_lines
from twilight.sky.table import SkyTable


@dataclass(frozen=True, eq=False)
class ShaderSky:
    """table: of X, Y, Z and scotopic luminance; header: what `sky.json` says besides its nodes."""

    header: dict[str, Any]
    table: SkyTable

    def files(self) -> dict[str, bytes]:
        """Name and content of every file."""
        table, lines = layers(self.table), node_lines(self.table)
        count = {"columns": table.shape[2], "rows": table.shape[1], "suns": table.shape[0] // 2}
        header = self.header | {
            "texels": count,
            "sun_elevation_deg": self.table.sun_elevation_deg.tolist(),
            "apparent_sun_elevation_deg": self.table.apparent_sun_deg.tolist(),
            "elevation_deg": self.table.elevation_deg.tolist(),
            "azimuth_deg": self.table.azimuth_deg.tolist(),
            "sky.bin": "rgba32float, columns x rows x (2 suns), not filtered",
            "lines.bin": f"rgba32float, {lines.shape[1]} x {lines.shape[0]}, not filtered",
        }
        sources = {name: self._source(name, count) for name in ("sky.glsl", "sky.wgsl")}
        page = _web("export/shader.html").replace("{{TITLE}}", str(self.header["name"]).replace("<", "&lt;"))
        page = page.replace("{{HEAD}}", json.dumps(header).replace("<", "\\u003c"))
        page = page.replace("{{GLSL}}", json.dumps(sources["sky.glsl"]))
        contents = {"TABLE": table.astype("<f4").tobytes(), "LINES": lines.astype("<f4").tobytes()}
        for name, content in contents.items():
            page = page.replace(f"{{{{{name}}}}}", base64.b64encode(content).decode())
        return {
            "sky.bin": contents["TABLE"],
            "lines.bin": contents["LINES"],
            "sky.json": (json.dumps(header, indent=1) + "\n").encode(),
            "index.html": page.encode(),
            **{name: text.encode() for name, text in sources.items()},
        }

    def _source(self, name: str, count: dict[str, int]) -> str:
        """A shader with this sky's numbers in it."""
        rgb = spectrum.xyz_to_rgb_matrix("cie1931_2deg").T.ravel()
        text = _web(f"export/{name}").replace("//#include table.glsl\n", _web("table.glsl"))
        text = text.replace("{{RGB}}", ", ".join(f"{v:.7f}" for v in rgb))
        for key, value in count.items():
            text = text.replace(f"{{{{{key.upper()}}}}}", str(value))
        return text


def _web(name: str) -> str:
    return resources.files("twilight").joinpath("show", "web", *name.split("/")).read_text(encoding="utf-8")


def shader_sky(
    solved: Field,
    name: str,
    solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM,
    progress: Progress = silent,
    tables: SunTables | None = None,
) -> ShaderSky:
    """The textures of a field, seen from the altitude of its scene.

    tables: of the field, with the ground; None: on the usual nodes
    Errors: TwilightError for a field that cannot show every sun and direction.
    """
    [altitude_km] = check_altitudes(solved.scene, None, name)
    channels = Channels(solved.medium.wavelength_nm, solar_spectrum)
    if tables is None:
        rows = shared_rows(solved.scene, altitude_km, ROW_COUNT, ground=True)
        tables = SunTables(solved, altitude_km, rows_deg=rows)
    spectra = tables.between(LOWEST_SUN_DEG, 90.0, part_of(progress, 0.0, 0.9))
    header = {
        "name": name,
        "observer_altitude_km": altitude_km,
        "quantity": "linear Rec. 709 or X, Y, Z and scotopic luminance [cd m^-2], the sun at 1 au",
    }
    return ShaderSky(header, spectra.seen(channels.of))
