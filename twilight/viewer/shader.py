"""The sky of one air in two textures, read by 50 lines of GLSL or WGSL: every direction and sun, seen from the ground.

    light = exp(S + s) + P(scattering angle) exp(A + a)        X, Y, Z and scotopic luminance [cd m^-2] at 1 au

s, a: `sky.bin`, 3-D, half floats, filtered linearly, over the axes of `viewer.tables` without haze rows; S, A: their
means under each sun, and P, the phase function of the column's aerosol: `lines.bin`, single floats.  With the means
apart halves keep logarithms to 0.2 %.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np

from twilight.base.progress import Progress, silent
from twilight.engine import Solved
from twilight.numerics import spectrum
from twilight.studies.export import sky_tables
from twilight.studies.export.field_values import PHASE_ANGLES, FieldSource, read_phase
from twilight.viewer.colours import Channels
from twilight.viewer.scene import check_altitudes
from twilight.viewer.tables import ViewerTableSizes, fill

SIZES = ViewerTableSizes(suns=113, haze=0, sky=45, ground=9, azimuths=37)
"""Of the textures: 3.6 MB."""
NO_LIGHT = -60.0
"""Logarithm that stands for no light."""
PHASE = 2
"""Row of `lines.bin` with the phase function, after the means of the sky and of the aureole."""


@dataclass(frozen=True, eq=False)
class ShaderSky:
    """table (2, suns, rows, azimuths, 4) float16: s and a; lines (3, 256, 4) float32: S, A by the sun, ln P; header: of
    `sky.json`."""

    header: dict[str, Any]
    table: np.ndarray
    lines: np.ndarray

    def light(self, sun_elevation_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """X, Y, Z and scotopic luminance (..., 4) [cd m^-2], as the shaders read them; azimuth from the sun [deg]."""
        elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        h, horizon = self.header, self.header["horizon_deg"]
        ground, sky = h["texels"]["ground"], h["texels"]["sky"]
        suns, azimuths = self.table.shape[1], self.table.shape[3]
        low, high = sky_tables.sun_coordinate(sky_tables.LOWEST_SUN_DEG), sky_tables.sun_coordinate(90.0)
        s = np.clip((sky_tables.sun_coordinate(sun_elevation_deg) - low) / (high - low), 0.0, 1.0) * (suns - 1)
        up = np.sqrt(np.clip((elevation - horizon) / (90.0 - horizon), 0.0, 1.0))
        down = np.sqrt(np.clip((horizon - elevation) / (90.0 + horizon), 0.0, 1.0))
        y = np.where(elevation >= horizon, ground + up * (sky - 1), (1.0 - down) * (ground - 1))
        beside = np.abs((azimuth + 180.0) % 360.0 - 180.0) / 180.0
        x = beside ** (1.0 / sky_tables.AZIMUTH_POWER) * (azimuths - 1)
        e, a, t = np.radians(elevation), np.radians(azimuth), np.radians(sun_elevation_deg)
        cosine = np.sin(t) * np.sin(e) + np.cos(t) * np.cos(e) * np.cos(a)
        means = [[np.interp(s, np.arange(suns), c) for c in row[:suns].T] for row in self.lines[:PHASE]]
        parts = [np.exp(_trilinear(part, float(s), y, x) + mean) for part, mean in zip(self.table, means, strict=True)]
        return parts[0] + read_phase(np.exp(self.lines[PHASE].astype(float)), cosine) * parts[1]

    def files(self) -> dict[str, bytes]:
        """Name and content of every file."""
        table, lines = self.table.astype("<f2").tobytes(), self.lines.astype("<f4").tobytes()
        sources = {name: self._source(name) for name in ("sky.glsl", "sky.wgsl")}
        page = _web("shader.html").replace("{{TITLE}}", str(self.header["name"]).replace("<", "&lt;"))
        page = page.replace("{{HEAD}}", json.dumps(self.header).replace("<", "\\u003c"))
        page = page.replace("{{GLSL}}", json.dumps(sources["sky.glsl"]))
        for name, content in (("TABLE", table), ("LINES", lines)):
            page = page.replace(f"{{{{{name}}}}}", base64.b64encode(content).decode())
        return {
            "sky.bin": table,
            "lines.bin": lines,
            "sky.json": (json.dumps(self.header, indent=1) + "\n").encode(),
            "index.html": page.encode(),
            **{name: text.encode() for name, text in sources.items()},
        }

    def _source(self, name: str) -> str:
        """A shader with this sky's numbers in it."""
        texels, rgb = self.header["texels"], spectrum.xyz_to_rgb_matrix("cie1931_2deg").T.ravel()
        numbers = {key.upper(): str(int(value)) for key, value in texels.items()}
        numbers |= {"HORIZON": repr(float(self.header["horizon_deg"])), "LOWEST": repr(sky_tables.LOWEST_SUN_DEG)}
        text = _web(name).replace("{{RGB}}", ", ".join(f"{v:.7f}" for v in rgb))
        for key, value in numbers.items():
            text = text.replace(f"{{{{{key}}}}}", value)
        return text


def _web(name: str) -> str:
    return resources.files("twilight").joinpath("viewer", "web", "export", name).read_text(encoding="utf-8")


def shader_sky(
    solved: Solved,
    name: str,
    solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM,
    sizes: ViewerTableSizes = SIZES,
    progress: Progress = silent,
) -> ShaderSky:
    """The textures of a field, seen from the altitude of its scene.

    Errors: TwilightError for a field that cannot show every sun and direction.
    """
    [altitude_km] = check_altitudes(solved.scene, None, name)
    channels = Channels(solved.medium.wavelength_nm, solar_spectrum)
    source = FieldSource(solved, solved.medium, bool(getattr(solved.scene.settings, "refraction", False)))
    made = fill(source, channels, (altitude_km,), sizes, progress)
    parts = [made.sky, np.full_like(made.sky, np.exp(NO_LIGHT)) if made.aureole is None else made.aureole]
    logs = np.log(np.stack([np.moveaxis(part[:, 0, :, :-1], 0, -1) for part in parts]))
    means = logs.mean(axis=(2, 3))
    lines = np.zeros((3, PHASE_ANGLES, means.shape[-1]), np.float32)
    lines[:PHASE, : sizes.suns] = means
    if made.phase is not None:
        lines[PHASE] = np.log(made.phase)
    header = {
        "name": name,
        "observer_altitude_km": altitude_km,
        "horizon_deg": float(made.horizon_deg[0]),
        "texels": {"azimuths": sizes.azimuths, "ground": sizes.ground, "sky": sizes.sky, "suns": sizes.suns},
        "sky.bin": "rgba16float, azimuths x (ground + sky) x (2 suns), filtered linearly, clamped",
        "lines.bin": f"rgba32float, {PHASE_ANGLES} x 3, not filtered",
        "quantity": "linear Rec. 709 or X, Y, Z and scotopic luminance [cd m^-2], the sun at 1 au",
    }
    return ShaderSky(header, (logs - means[:, :, None, None]).astype(np.float16), lines)


def _trilinear(table: np.ndarray, s: float, y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(..., 4) of (suns, rows, azimuths, 4)."""
    i = min(int(s), table.shape[0] - 2)
    under = (1.0 - s + i) * table[i].astype(float) + (s - i) * table[i + 1].astype(float)
    j, k = (np.minimum(np.floor(v).astype(int), n - 2) for v, n in ((y, under.shape[0]), (x, under.shape[1])))
    g, h = (y - j)[..., None], (x - k)[..., None]
    low, high = ((1.0 - h) * under[j + b, k] + h * under[j + b, k + 1] for b in (0, 1))
    return (1.0 - g) * low + g * high
