"""Stills of three films for docs/animate.md: each film by its command, small and with six pictures, as one strip.

    python benchmarks/films.py [NAME ...]

Writes docs/films/NAME.jpg.  A minute of processor time for each.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageSequence

ROOT = Path(__file__).resolve().parents[1]
WIDTH = 420
"""Of a film [px]."""
HEIGHT = 236
"""Of a film [px]."""
COLUMNS = 3
"""Films beside one another."""
GAP = 4
"""Between them [px]."""
FILMS = {
    "clean-air": "pure-air --from 3 --to -9 --disc",
    "purple-light": "volcanic-stratosphere --from 0 --to -7.5",
    "earths-shadow": "continental-clean --from 2 --to -5.5 --set observer.view.azimuth_deg=180",
}
"""What follows `twilight animate`."""
FALL_DEG_PER_S = 15.0 / 3600.0


def strip(name: str) -> None:
    """Six pictures, evenly spaced, in two rows; the first is at the upper left."""
    words = shlex.split(FILMS[name])
    first, last = (float(words[words.index(key) + 1]) for key in ("--from", "--to"))
    speed = (first - last) / FALL_DEG_PER_S / 5.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.webp"
        more = f"--speed {speed:g} --frames-per-second 1 --width {WIDTH} --height {HEIGHT} --quality draft"
        command = [sys.executable, "-m", "twilight", "animate", *words, *more.split(), "--output", str(path)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        with Image.open(path) as film:
            pictures = [frame.convert("RGB") for frame in ImageSequence.Iterator(film)]
    rows = -(-len(pictures) // COLUMNS)
    page = Image.new("RGB", (COLUMNS * (WIDTH + GAP) - GAP, rows * (HEIGHT + GAP) - GAP), "white")
    for i, picture in enumerate(pictures):
        page.paste(picture, (i % COLUMNS * (WIDTH + GAP), i // COLUMNS * (HEIGHT + GAP)))
    target = ROOT / "docs" / "films" / f"{name}.jpg"
    target.parent.mkdir(exist_ok=True)
    page.save(target, quality=88)


def main() -> None:
    for name in sys.argv[1:] or FILMS:
        strip(name)
        print(name, flush=True)


if __name__ == "__main__":
    main()
