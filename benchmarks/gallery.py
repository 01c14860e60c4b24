"""The gallery of the documentation: twenty skies, each by its command.

    python benchmarks/gallery.py [NUMBER ...]

Runs the commands below in a temporary folder and writes docs/gallery/NAME.jpg, 640 pixels wide, and docs/gallery.md.
Numbers choose some of them; the page always lists all.  20 minutes of processor time with nothing solved before.
`python benchmarks/gallery.py dawn` cuts docs/dawn.jpg, the picture of README, out of docs/photos/kiara_1_dawn.png.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
WIDTH = 640

SKIES = (
    (
        "clear-sunset",
        "Sunset in air without particles, the sun's disc on the horizon",
        "pure-air --sun-elevation 0.3 --disc",
    ),
    ("hazy-sunset", "The same sun in continental haze", "continental-average --sun-elevation 0.3 --disc"),
    (
        "disc",
        "Its disc: flattened, redder below, a green rim above",
        "pure-air --sun-elevation 0.3 --disc --only disc --output disc",
    ),
    ("civil-twilight", "Civil twilight", "continental-average --sun-elevation -4"),
    ("nautical-twilight", "Nautical twilight, the arch over the sun", "continental-average --sun-elevation -9"),
    ("blue-hour", "Clean air in the blue hour: ozone makes it blue", "continental-clean --sun-elevation -6"),
    ("purple-light", "Purple light under a volcanic stratosphere", "volcanic-stratosphere --sun-elevation -4.5"),
    (
        "belt-of-venus",
        "All round: the Earth's shadow and the Belt of Venus on the left and right edge",
        "continental-clean --sun-elevation -2 --set output.views=[panorama]",
    ),
    ("desert", "Desert dust in the late afternoon", "desert --sun-elevation 6 --disc"),
    ("urban", "A polluted city at sunset", "urban --sun-elevation 1 --disc"),
    ("maritime", "Over the sea in the tropics", "maritime-tropical --sun-elevation 12"),
    ("arctic", "Arctic twilight over snow", "arctic --sun-elevation -5 --set ground.albedo=0.85"),
    (
        "noon",
        "The whole sky at noon, looking up",
        "continental-average --sun-elevation 55 --set output.views=[fisheye]",
    ),
    (
        "polariser",
        "Through a polariser, its axis horizontal",
        "pure-air --sun-elevation 20 --set output.views=[fisheye] --polariser 90",
    ),
    (
        "airliner",
        "From 10 km: the horizon dips by 3 degrees",
        "continental-average --sun-elevation -4 --altitude-km 10",
    ),
    (
        "moonrise",
        "The full moon rises opposite the sun, in the Earth's shadow",
        "continental-average --sun-elevation -3.5 --set 'moon={elevation_deg: 1.2, azimuth_deg: 178}' --only view "
        "--projection perspective --size 640x360 --set observer.view.azimuth_deg=180 "
        "--set observer.view.field_of_view_deg=16 --set observer.view.elevation_deg=3",
    ),
    (
        "night",
        "The last light, and airglow over it",
        "pure-air --sun-elevation -17 --set night.airglow=1 --exposure -6",
    ),
    ("eye", "Nautical twilight as an eye sees it", "continental-average --sun-elevation -11 --tone eye"),
    (
        "camera",
        "The same as a camera takes it: ISO 1600, f/2.8",
        "continental-average --sun-elevation -11 --tone camera --set output.camera.iso=1600 "
        "--set output.camera.f_number=2.8 --output camera",
    ),
    (
        "haber2005",
        "The air of Haber, Magnor and Seidel 2005 at -6 deg: brown, for its ozone filters sunlight vertically only: no "
        "blue hour",
        "haber2005-air --sun-elevation -6",
    ),
)
"""Name, title, and what follows `twilight render` (and `--quality draft`)."""


def command(arguments: str) -> str:
    return f"twilight render {arguments} --quality draft"


def picture(name: str, arguments: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        only = [] if "--only" in arguments else ["--only", "png"]
        words = [*shlex.split(command(arguments))[1:], *only, "--output", folder]
        subprocess.run([sys.executable, "-m", "twilight", *words], check=True, stdout=subprocess.DEVNULL)
        [made] = Path(folder).glob("s*.png")
        image = Image.open(made).convert("RGB")
        if image.width > WIDTH:
            image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
        target = ROOT / "docs" / "gallery" / f"{name}.jpg"
        target.parent.mkdir(exist_ok=True)
        image.save(target, quality=88)


def dawn() -> None:
    """The upper panels of a comparison: the photograph, and the sky that was computed for it."""
    image = Image.open(ROOT / "docs" / "photos" / "kiara_1_dawn.png").convert("RGB")
    image.crop((0, 0, image.width, round(0.475 * image.height))).save(ROOT / "docs" / "dawn.jpg", quality=88)


def page() -> str:
    parts = [
        "# Gallery",
        "",
        "Each picture by the command below it (`python benchmarks/gallery.py`).",
        "",
    ]
    for name, title, arguments in SKIES:
        parts += [f"## {title}", "", f"![{name}](gallery/{name}.jpg)", "", "```sh", command(arguments), "```", ""]
    return "\n".join(parts)


def main() -> None:
    if sys.argv[1:] == ["dawn"]:
        dawn()
        return
    chosen = {int(word) for word in sys.argv[1:]} or range(1, len(SKIES) + 1)
    for i, (name, _, arguments) in enumerate(SKIES, start=1):
        if i in chosen:
            picture(name, arguments)
            print(f"{i} {name}", flush=True)
    (ROOT / "docs" / "gallery.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
