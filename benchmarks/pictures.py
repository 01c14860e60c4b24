"""Pictures of README and docs, by the commands that they show.

    python benchmarks/pictures.py gallery [NAME ...]   docs/gallery/NAME.jpg, by the commands in docs/gallery.md
    python benchmarks/pictures.py films [NAME ...]     docs/films/NAME.jpg: six stills each
    python benchmarks/pictures.py sunset               docs/sunset.jpg, README's first picture
    python benchmarks/pictures.py photographs FOLDER   docs/photographs.jpg, and docs/dawn.jpg out of docs/photos
    python benchmarks/pictures.py page SKY.html        docs/view/*.jpg: the page of `twilight view` in a browser

The gallery takes 20 minutes of processor time with nothing solved before, a film one, photographs two.  FOLDER holds
Poly Haven's panoramas (CC0): they become perspective views towards the sun, exposed and toned as the program's own
pictures, each over the sky computed for its sun and the haze of docs/photos; white balance is the photographs' own.
SKY.html is of `twilight view continental-average --quality draft --altitudes-km 0,400`; it needs playwright and
chromium-headless-shell, which draws in software.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import results
from PIL import Image, ImageSequence
from results import ROOT

from twilight.io.picture import to_bytes
from twilight.io.stored_image import read_image
from twilight.io.view import view_exposure_ev100
from twilight.numerics.directions import azimuth_elevation
from twilight.numerics.projections import view_rays
from twilight.sky import colour

DOCS = ROOT / "docs"
GALLERY_WIDTH = 640
FILM_PX = (420, 236)
FILMS = {
    "clean-air": "pure-air --from 3 --to -9 --disc",
    "purple-light": "volcanic-stratosphere --from 0 --to -7.5",
    "earths-shadow": "continental-clean --from 2 --to -5.5 --set observer.view.azimuth_deg=180",
}
"""What follows `twilight animate`."""
FALL_DEG_PER_S = 15.0 / 3600.0
PHOTO_PX = (560, 280)
FIELD_DEG = 100.0
"""Field of view across the views of photographs [deg]."""
UP_DEG = 16.0
"""Elevation of their middle [deg]."""
PHOTOS = (  # file, azimuth of its sun from the picture's middle [deg], what is rendered beside it
    ("pmndrs_sunset.hdr", 36.0, "--sun-elevation 3 --disc --set aerosol.optical_depth_550nm=0.31"),
    (
        "rooitou_park_1k.hdr",
        36.0,
        "--sun-elevation 10.4 --disc --set aerosol.type=desert --set aerosol.optical_depth_550nm=0.051",
    ),
    ("kiara_1_dawn_1k.hdr", 47.8, "--sun-elevation=-3.5 --set aerosol.optical_depth_550nm=0.09 --set horizon=typical"),
    ("dikhololo_night_1k.hdr", 0.0, "--sun-elevation=-18 --set night.airglow=1"),
)
CLOCK = {"mode": "clock", "zone": 2, "latitude": 47, "longitude": 11}
PAGES: dict[str, dict] = {
    "arch": {"sun": -4, "fov": 110, "elevation": 20},
    "disc": {"sun": 0.1, "fov": 4, "elevation": 0.8, "exposure": "manual", "ev": 15},
    "night": CLOCK
    | {"date": "2026-08-12", "hours": 23.2, "projection": "fisheye", "fov": 180, "elevation": 90, "tone": "eye"},
    "orbit": {"mode": "elevation", "tone": "photographic", "exposure": "metered", "projection": "perspective"}
    | {"altitude": 400, "sun": -19.4, "fov": 50, "azimuth": 0, "elevation": -17},
    "path": CLOCK
    | {"altitude": 0, "date": "2026-06-21", "hours": 20.5, "projection": "latlong", "fov": 360, "elevation": 0},
}
"""States of the page."""


def run(words: Sequence[str], target: str) -> list[Image.Image]:
    """The picture, or the pictures of the film, that a command writes; target: a file in its folder."""
    with tempfile.TemporaryDirectory() as folder:
        to = folder if "*" in target or words[0] == "render" else str(Path(folder) / target)
        command = [sys.executable, "-m", "twilight", *words, "--output", to]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=ROOT)
        [path] = Path(folder).glob(target)
        with Image.open(path) as picture:
            return [frame.convert("RGB") for frame in ImageSequence.Iterator(picture)]


def sheet(pictures: Sequence[Image.Image], columns: int, gap: int = 4) -> Image.Image:
    """Pictures of one size beside and below one another."""
    width, height = pictures[0].size
    rows = -(-len(pictures) // columns)
    page = Image.new("RGB", (columns * (width + gap) - gap, rows * (height + gap) - gap), "white")
    for i, picture in enumerate(pictures):
        page.paste(picture, (i % columns * (width + gap), i // columns * (height + gap)))
    return page


def gallery_commands() -> dict[str, str]:
    """Name of each picture of the gallery and the command below it."""
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^!\[(\S+)\]\(gallery/\1\.jpg\)\n\n```sh\ntwilight (.+)\n```$", page, re.MULTILINE))


def gallery(names: Sequence[str]) -> None:
    commands = gallery_commands()
    for name in names or commands:
        words = shlex.split(commands[name])
        only = [] if "--only" in words else ["--only", "png"]
        [image] = run([*words, *only, "--quality", "draft"], "s*.png")
        if image.width > GALLERY_WIDTH:
            image = image.resize((GALLERY_WIDTH, round(image.height * GALLERY_WIDTH / image.width)), 1)
        image.save(DOCS / "gallery" / f"{name}.jpg", quality=88)


def films(names: Sequence[str]) -> None:
    for name in names or FILMS:
        words = FILMS[name].split()
        first, last = (float(words[words.index(key) + 1]) for key in ("--from", "--to"))
        speed = (first - last) / FALL_DEG_PER_S / 5.0
        more = f"--speed {speed:g} --frames-per-second 1 --width {FILM_PX[0]} --height {FILM_PX[1]} --quality draft"
        stills = run(["animate", *words, *more.split()], f"{name}.webp")
        sheet(stills, 3).save(DOCS / "films" / f"{name}.jpg", quality=88)


def sunset(_: Sequence[str]) -> None:
    [image] = run(["render", "configs/sunset-over-ridges.yaml", "--only", "view"], "sky.view.png")
    image.save(DOCS / "sunset.jpg", quality=90)


def photograph(path: Path, azimuth_deg: float) -> Image.Image:
    """The view out of a panorama; its middle is straight ahead, azimuths grow to the right."""
    rgb = read_image(path).samples
    height, width = rgb.shape[:2]
    rays = view_rays(
        "perspective", *PHOTO_PX, field_of_view_deg=FIELD_DEG, azimuth_deg=azimuth_deg, elevation_deg=UP_DEG
    )
    azimuth, elevation = azimuth_elevation(rays)
    row = np.clip(((90.0 - elevation) / 180.0 * height).astype(int), 0, height - 1)
    column = ((azimuth / 360.0 + 0.5) * width).astype(int) % width
    view = rgb[row, column].astype(float)
    return Image.fromarray(to_bytes(colour.tone_map(view, view_exposure_ev100(view @ colour.REC709_LUMINANCE))))


def photographs(folder: Sequence[str]) -> None:
    """Photographs above, computed skies below."""
    pairs = []
    for name, azimuth, arguments in PHOTOS:
        words = f"render continental-average {arguments} --quality draft --projection perspective --only view"
        view = f"--set observer.view.field_of_view_deg={FIELD_DEG:g} --set observer.view.elevation_deg={UP_DEG:g}"
        [sky] = run(f"{words} --size {PHOTO_PX[0]}x{PHOTO_PX[1]} {view}".split(), "sky.view.png")
        pairs.append(sheet([photograph(Path(folder[0]) / name, azimuth), sky], 1, 0))
    sheet(pairs, 2, 8).save(DOCS / "photographs.jpg", quality=88)
    compared = Image.open(DOCS / "photos" / "kiara_1_dawn.png").convert("RGB")
    compared.crop((0, 0, compared.width, round(0.455 * compared.height))).save(DOCS / "dawn.jpg", quality=88)


def page(file: Sequence[str]) -> None:
    sys.path.insert(0, str(ROOT / "tests"))
    from browser import open_page

    with open_page(Path(file[0]), 1000, 620) as (tab, errors):
        for name, state in PAGES.items():
            tab.evaluate("s => { twilight.set(s); twilight.draw(); }", state)
            if name == "path":
                tab.evaluate("twilight.set({ azimuth: 270 }); twilight.draw()")
            if name == "arch":
                tab.mouse.click(250, 400)
            tab.wait_for_timeout(500)
            if name == "disc":
                tab.click("#probe-close")
                tab.click("#toggle")
                tab.mouse.move(5, 5)
            tab.screenshot(path=DOCS / "view" / f"{name}.jpg", type="jpeg", quality=82)
    with open_page(Path(file[0]), 390, 844, has_touch=True, is_mobile=True) as (tab, more):
        tab.wait_for_timeout(500)
        tab.screenshot(path=DOCS / "view" / "phone.jpg", type="jpeg", quality=82)
    if errors or more:
        raise SystemExit("\n".join(errors + more))


if __name__ == "__main__":
    results.say_help(__doc__)
    parts = {"gallery": gallery, "films": films, "sunset": sunset, "photographs": photographs, "page": page}
    if len(sys.argv) < 2 or sys.argv[1] not in parts:
        raise SystemExit((__doc__ or "").split("\n\n")[1])
    parts[sys.argv[1]](sys.argv[2:])
