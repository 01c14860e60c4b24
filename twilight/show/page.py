"""The page itself: one HTML file that needs no other, made of `twilight/web` and the packed tables."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from importlib import resources
from pathlib import Path

from twilight.base.whole_files import whole_file
from twilight.show import tones
from twilight.show.tables import Pack

SCRIPTS = "state vector sun moon tables space night projection gpu exposure overlay probe command controls main".split()
"""In the order in which they are read; all of them have one scope."""
SHADERS = ("whole.vert", "sky.frag", "stars.vert", "stars.frag", "linear.frag", "blur.frag", "tone.frag")


@lru_cache(maxsize=1)
def _program() -> dict[str, str]:
    folder = resources.files("twilight").joinpath("show/web")

    def text(name: str) -> str:
        return folder.joinpath(name).read_text(encoding="utf-8")

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
