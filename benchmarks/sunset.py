"""README's first picture, and photographs beside skies computed for their suns, to judge its colours by.

    python benchmarks/sunset.py
    python benchmarks/sunset.py FOLDER_OF_PHOTOS

The first runs the command of docs/sunset.jpg.  The second writes docs/photographs.jpg: Poly Haven's panoramas (CC0,
kiara_1_dawn_1k.hdr, pmndrs_sunset.hdr, rooitou_park_1k.hdr, dikhololo_night_1k.hdr) as wide perspective views towards
the sun, exposed and toned as the program's own pictures, each over the sky computed for its sun and the haze of
docs/photos.  White balance is the photographs' own.  Two minutes of processor time.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from twilight.io.picture import to_bytes
from twilight.io.view import view_exposure_ev100
from twilight.numerics.directions import azimuth_elevation
from twilight.numerics.projections import view_rays
from twilight.sky import colour
from twilight.studies.camera.image import read_image

ROOT = Path(__file__).resolve().parents[1]
SUNSET = "render configs/sunset-over-ridges.yaml --only view"
WIDTH = 560
"""Of each picture [px]."""
HEIGHT = 280
"""Of each picture [px]."""
FIELD_DEG = 100.0
"""Each picture's field of view across [deg]."""
UP_DEG = 16.0
"""Elevation of each picture's middle [deg]."""
PHOTOS = (  # file, azimuth of its sun from the picture's middle [deg], what is rendered beside it
    ("pmndrs_sunset.hdr", 36.0, "--sun-elevation 3 --disc --set aerosol.optical_depth_550nm=0.31"),
    ("rooitou_park_1k.hdr", 36.0, "--sun-elevation 10.4 --disc --set aerosol.optical_depth_550nm=0.065"),
    ("kiara_1_dawn_1k.hdr", 47.8, "--sun-elevation=-3.9 --set aerosol.optical_depth_550nm=0.084"),
    ("dikhololo_night_1k.hdr", 0.0, "--sun-elevation=-18 --set night.airglow=1"),
)


def photograph(path: Path, azimuth_deg: float) -> np.ndarray:
    """The view out of a panorama, (H, W, 3) 8 bit; its middle is straight ahead, azimuths grow to the right."""
    rgb = read_image(path).samples
    height, width = rgb.shape[:2]
    rays = view_rays(
        "perspective", WIDTH, HEIGHT, field_of_view_deg=FIELD_DEG, azimuth_deg=azimuth_deg, elevation_deg=UP_DEG
    )
    azimuth, elevation = azimuth_elevation(rays)
    row = np.clip(((90.0 - elevation) / 180.0 * height).astype(int), 0, height - 1)
    column = ((azimuth / 360.0 + 0.5) * width).astype(int) % width
    seen = rgb[row, column].astype(float)
    return to_bytes(colour.tone_map(seen, view_exposure_ev100(seen @ colour.REC709_LUMINANCE)))


def rendered(arguments: str) -> Image.Image:
    """The picture that a command writes."""
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, "-m", "twilight", *arguments.split(), "--output", folder, "--only", "view"]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, cwd=ROOT)
        return Image.open(Path(folder) / "sky.view.png").convert("RGB")


def sheet(folder: Path) -> None:
    """Photographs above, computed skies below."""
    page = Image.new("RGB", (2 * WIDTH + 8, 4 * HEIGHT + 24), "white")
    for i, (name, azimuth, arguments) in enumerate(PHOTOS):
        x, y = (i % 2) * (WIDTH + 8), (i // 2) * (2 * HEIGHT + 16)
        page.paste(Image.fromarray(photograph(folder / name, azimuth)), (x, y))
        words = (
            f"render continental-average {arguments} --quality draft --projection perspective --size {WIDTH}x{HEIGHT}"
        )
        view = f"--set observer.view.field_of_view_deg={FIELD_DEG:g} --set observer.view.elevation_deg={UP_DEG:g}"
        page.paste(rendered(f"{words} {view}"), (x, y + HEIGHT))
    page.save(ROOT / "docs" / "photographs.jpg", quality=88)


def main() -> None:
    if sys.argv[1:]:
        sheet(Path(sys.argv[1]))
        return
    rendered(SUNSET).save(ROOT / "docs" / "sunset.jpg", quality=90)


if __name__ == "__main__":
    main()
