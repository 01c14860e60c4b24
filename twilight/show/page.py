"""A page: one HTML file that needs no other, made of `twilight/show/web` and packed tables.

The tables: one `SkyTable` for each altitude of the observer, on nodes that go along with the horizon.

Rows of the ground end at the horizon, those above begin there; they begin anew at the ray that grazes the top of the
haze, where light has a kink that is next to a step.  Every altitude has as many rows in each of these parts, at the
same fractions of it, so that the page may interpolate between altitudes.

Arrays as a page carries them: logarithms in 16 bits, compressed, in base64.
"""

import base64
import gzip
import json
import re
from dataclasses import dataclass, field
from functools import lru_cache
from html import escape
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from twilight.base.progress import Progress, part_of
from twilight.base.whole_files import whole_file
from twilight.engine import Field
from twilight.engine.sun_tables import LOWEST_SUN_DEG, SunTables
from twilight.engine.table import shared_columns
from twilight.show import tones
from twilight.sky.table import SkyTable
from twilight.transport.rays import horizon_dip_deg
from twilight.transport.scattered_once import sudden_edges

LEVELS = 65535
"""Largest sample of 16 bits."""


@dataclass
class Pack:
    """Named arrays in one stretch of bytes, and what a reader must know of each."""

    header: dict[str, Any]
    arrays: dict[str, Any] = field(default_factory=dict)
    parts: list[bytes] = field(default_factory=list)

    def logarithm(self, name: str, logs: np.ndarray) -> None:
        """Add logarithms of light in 16 bits.

        Stored are differences along the last axis, modulo 65536: first all high bytes, then all low ones.
        """
        low, high = float(logs.min()), float(logs.max())
        step = max(high - low, 1e-9) / LEVELS
        whole = np.rint((logs - low) / step).astype(np.int64)
        change = np.diff(whole, axis=-1, prepend=0) % 65536
        self._add(
            name, logs.shape, (change >> 8).astype(np.uint8).tobytes() + (change & 255).astype(np.uint8).tobytes()
        )
        self.arrays[name] |= {"kind": "log16", "low": low, "step": step}

    def numbers(self, name: str, values: np.ndarray) -> None:
        """Add values as float32."""
        self._add(name, np.shape(values), np.ascontiguousarray(values, "<f4").tobytes())
        self.arrays[name] |= {"kind": "float32"}

    def file(self, name: str, content: bytes) -> None:
        """Add the bytes of a file."""
        self._add(name, (), content)
        self.arrays[name] |= {"kind": "file"}

    def _add(self, name: str, shape: tuple[int, ...], content: bytes) -> None:
        start = sum(map(len, self.parts))
        self.arrays[name] = {"shape": list(shape), "start": start, "bytes": len(content)}
        # the next one starts where a reader may look at four bytes as a number
        self.parts.append(content + bytes(-len(content) % 4))

    def text(self) -> tuple[str, str]:
        """The header as JSON that may stand in HTML, and the arrays in base64."""
        head = json.dumps({**self.header, "arrays": self.arrays}, allow_nan=False).replace("<", "\\u003c")
        return head, base64.b64encode(gzip.compress(b"".join(self.parts), 9, mtime=0)).decode()


USUAL_HAZE_TOP_KM = 2.0
"""Height of the haze's top above the ground in air where extinction never falls suddenly [km]."""
LEAST_HAZE_DEG = 0.02
"""Least height of the haze's part of the rows, as for an observer within the haze [deg]."""


@dataclass(frozen=True)
class PageNodes:
    """Rows of each part and columns; every second is one of the spectral table, so that all are odd numbers."""

    ground: int = 17
    haze: int = 11
    sky: int = 39
    columns: int = 29
    space: tuple[int, ...] = (21, 11, 13, 35)
    """Above the air: rows of the ground, of the haze, and of the limb below and above another layer's edge."""
    space_columns: int = 37
    """With 29 the limb in deep twilight is 3 to 4 % off between them."""

    def rises(self, *, space: bool = False) -> list[np.ndarray]:
        """Places of the rows in the parts, 0 to 1: of the ground, of the haze, and of the sky or the limb."""
        low, high = (2.5, 1.5) if space else (2.0, 2.0)
        u = [np.linspace(0.0, 1.0, n) for n in (self.space if space else (self.ground, self.haze, self.sky))]
        inner = [np.sin(0.5 * np.pi * part) ** 2 for part in u[1:-1]]
        return [1.0 - (1.0 - u[0]) ** low, *inner, u[-1] ** high]

    def every_second_row(self, *, space: bool = False) -> np.ndarray:
        """Rows of the spectral table: every second one of each part."""
        starts = np.cumsum([0, *(part.size for part in self.rises(space=space))])
        return np.concatenate([np.arange(a, b, 2) for a, b in pairwise(starts)])

    def columns_deg(self, *, space: bool = False) -> np.ndarray:
        """Azimuths from the sun."""
        return shared_columns(self.space_columns if space else self.columns)


def between_edges(rises: list[np.ndarray], edges: list[float]) -> np.ndarray:
    """Rows of parts from edge to edge."""
    ends = zip(pairwise(edges), rises, strict=True)
    return np.concatenate([low * (1.0 - rise) + high * rise for (low, high), rise in ends])


def haze_top_km(solved: Field) -> float:
    """The altitude at which extinction falls most suddenly upwards: the top of the haze."""
    level_km, fall = sudden_edges(solved.medium)
    return float(level_km[np.argmax(fall)]) if fall.size else solved.medium.bottom_km + USUAL_HAZE_TOP_KM


def horizon_and_haze_deg(solved: Field, altitude_km: float) -> tuple[float, float]:
    """Apparent elevations of the horizon and of the ray that grazes the top of the haze."""
    horizon = -horizon_dip_deg(solved.medium, altitude_km)
    haze = -horizon_dip_deg(solved.medium, altitude_km, haze_top_km(solved))
    return horizon, max(haze, horizon + LEAST_HAZE_DEG)


def spectra_at(solved: Field, altitude_km: float, nodes: PageNodes, progress: Progress) -> SkyTable:
    """The table of all suns of the page for an observer in the air, at the field's wavelengths."""
    rows = between_edges(nodes.rises(), [-90.0, *horizon_and_haze_deg(solved, altitude_km), 90.0])
    tables = SunTables(solved, altitude_km, rows_deg=rows, columns_deg=nodes.columns_deg())
    return tables.between(LOWEST_SUN_DEG, 90.0, part_of(progress, 0.0, 1.0, f"{altitude_km:g} km"))


SCRIPTS = (
    "state vector sun moon tables space night projection gpu air exposure overlay probe command controls main".split()
)
"""In the order in which they are read; all of them have one scope."""
SHADERS = ("whole.vert", "sky.frag", "stars.vert", "stars.frag", "linear.frag", "blur.frag", "tone.frag")


def program_text(name: str) -> str:
    """A file of the page's program."""
    return resources.files("twilight").joinpath("show/web", name).read_text(encoding="utf-8")


@lru_cache(maxsize=1)
def _program() -> dict[str, str]:
    text = program_text
    shaders = {name: text(name) for name in (*SHADERS, "projection.glsl", "space.glsl", "table.glsl", "tone.glsl")}
    shaders["tone.glsl"] = shaders["tone.glsl"].replace("//#include constants.glsl", tones.shader_constants())
    script = "\n".join(text(f"{name}.js") for name in SCRIPTS)
    return {
        "page": text("page.html"),
        "style": text("style.css"),
        "script": f"const SHADERS = {json.dumps(shaders)};\n{script}".replace("</script", "<\\/script"),
    }


@dataclass(frozen=True, repr=False)
class Page:
    """A page that shows a sky in a browser; in a notebook it shows itself."""

    pack: Pack
    title: str

    def __repr__(self) -> str:
        """What it is, how large, and what to do with it."""
        size = sum(map(len, self.pack.parts)) / 1e6
        return (
            f"<Page: {self.title}\n"
            f"  {len(self.pack.arrays)} tables, {size:.1f} MB\n"
            f"  shows itself in a notebook; save(path) writes one HTML file that needs WebGL 2 and no network>"
        )

    @property
    def html(self) -> str:
        """The whole file; it needs WebGL 2 and no network."""
        program = _program()
        head, data = self.pack.text()
        parts = {
            "TITLE": escape(self.title),
            "STYLE": program["style"],
            "HEAD": head,
            "DATA": data,
            "SCRIPT": f'"use strict";\n(() => {{\n{program["script"]}\n}})();',
        }
        return re.sub(r"{{(.*?)}}", lambda found: parts[found[1]], program["page"])

    def save(self, path: str | Path) -> Path:
        """Write the file, whole or not at all.

        Errors: TwilightError where it cannot be written.
        """
        path = Path(path)
        with whole_file(path) as temporary:
            temporary.write_text(self.html, encoding="utf-8")
        return path

    def _repr_html_(self) -> str:
        frame = "width:100%;height:560px;border:0"
        return f'<iframe style="{frame}" allow="fullscreen; clipboard-write" srcdoc="{escape(self.html)}"></iframe>'
