"""The figures of the three papers that are renderings, from the configurations by their names, on one sheet.

    python benchmarks/paper_figures.py [NAME ...]      writes docs/paper-figures.jpg

Each row is a configuration, each picture one of its cases by `twilight render`; of haber2005-fig7 a third picture is
the difference of the two (each exposed by itself), gamma 3 as in the paper.
Haber's cells are S = 36 here (2 s a picture; 120 are his).
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import results
from PIL import Image, ImageDraw, ImageOps

ROOT = Path(__file__).resolve().parents[1]
SIZE = (300, 135)
HABER = ["--set", "solver.azimuth_cells=36", "--set", "texture.resolution_deg=10"]
FIGURES = {
    "haber2005-fig7": HABER,
    "haber2005-fig8": HABER,
    "haber2005-fig9": HABER,
    "haber2005-fig10": HABER,
    "haber2005-fig12": HABER,
    "bruneton2008-fig6": ["--set", "wavelengths={list_nm: [440, 550, 680]}"],  # his three
    "preetham1999-fig9": [],
    "preetham1999-fig10": [],
}


def in_frame(image: Image.Image) -> Image.Image:
    """A wide picture cut to SIZE, a fisheye whole."""
    return ImageOps.fit(image, SIZE) if image.width > image.height else ImageOps.pad(image, SIZE, color="white")


def pictures(name: str, folder: Path) -> list[tuple[str, Image.Image]]:
    """Label and picture of each case of a configuration."""
    command = [sys.executable, "-m", "twilight", "render", name, *FIGURES[name], "--output", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    plan = subprocess.run(
        [*command[:5], *FIGURES[name], "--plan"], check=True, stdout=subprocess.PIPE, text=True
    ).stdout
    labels = dict.fromkeys(line.split("\t")[0] for line in plan.splitlines())
    made = [(label, path) for label in labels if (path := folder / label / "sky.png").is_file()]
    made = made or [(path.parent.name, path) for path in sorted(folder.glob("sun*/sky*.png"), reverse=True)]
    found = [(label, Image.open(path).convert("RGB")) for label, path in made]
    if name == "haber2005-fig7":
        once, more = (np.asarray(image, float) / 255.0 for _, image in found)
        found.append(("difference", Image.fromarray((255.0 * np.abs(more - once) ** (1.0 / 3.0)).astype(np.uint8))))
    return found


def main() -> None:
    names = sys.argv[1:] or list(FIGURES)
    rows = []
    for name in names:
        made = pictures(name, ROOT / "out" / "paper-figures" / name)  # what is there is not rendered again
        rows.append((name, [(label, in_frame(image)) for label, image in made]))
        print(name, flush=True)
    columns = max(len(found) for _, found in rows)
    sheet = Image.new("RGB", (columns * SIZE[0], len(rows) * (SIZE[1] + 18)), "white")
    draw = ImageDraw.Draw(sheet)
    for i, (name, found) in enumerate(rows):
        for j, (label, image) in enumerate(found):
            sheet.paste(image, (j * SIZE[0], i * (SIZE[1] + 18) + 18))
            draw.text((j * SIZE[0] + 4, i * (SIZE[1] + 18) + 3), f"{name}: {label[:30]}", fill="black")
    sheet.save(ROOT / "docs" / "paper-figures.jpg", quality=88)


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
