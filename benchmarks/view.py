"""Pictures of the page for docs/view.md, and how long it takes to load.

    twilight view continental-average --quality draft --altitudes-km 0,400 --output sky.html
    python benchmarks/view.py sky.html

Needs playwright and chromium-headless-shell, which draws in software; writes docs/view/*.jpg.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from browser import open_page, until

CLOCK = {"mode": "clock", "zone": 2, "latitude": 47, "longitude": 11}
PICTURES = {
    "arch": {"sun": -4, "fov": 110, "elevation": 20},
    "disc": {"sun": 0.1, "fov": 4, "elevation": 0.8, "exposure": "manual", "ev": 15},
    "night": {
        **CLOCK,
        "date": "2026-08-12",
        "hours": 23.2,
        "projection": "fisheye",
        "fov": 180,
        "elevation": 90,
        "tone": "eye",
    },
    "orbit": {
        "mode": "elevation",
        "tone": "photographic",
        "exposure": "metered",
        "projection": "perspective",
        "altitude": 400,
        "sun": -19.4,
        "fov": 50,
        "azimuth": 0,
        "elevation": -17,
    },
    "path": {
        **CLOCK,
        "altitude": 0,
        "date": "2026-06-21",
        "hours": 20.5,
        "projection": "latlong",
        "fov": 360,
        "elevation": 0,
    },
}


def processor_s(program: str = "chromium") -> float:
    """Processor time of the browser so far, all its processes."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            if program in (stat.parent / "cmdline").read_text():
                fields = stat.read_text().rsplit(")", 1)[1].split()
                ticks += int(fields[11]) + int(fields[12])
        except OSError:  # it has ended
            continue
    return ticks / os.sysconf("SC_CLK_TCK")


def main() -> None:
    folder = Path(__file__).resolve().parents[1] / "docs" / "view"
    folder.mkdir(exist_ok=True)
    start = time.perf_counter()
    with open_page(Path(sys.argv[1]), 1000, 620) as (page, errors):
        print(f"loaded after {time.perf_counter() - start:.1f} s, with the start of the browser")
        before = processor_s()
        page.reload()
        until(page, "!!window.twilight")
        spent = page.evaluate("twilight.loaded")
        print(f"reloaded: {processor_s() - before:.2f} s of processor; tables after {spent['tables_ms']:.0f}, "
              f"first picture after {spent['drawn_ms']:.0f} ms of this machine's time")  # fmt: skip
        for name, state in PICTURES.items():
            page.evaluate("s => { twilight.set(s); twilight.draw(); }", state)
            if name == "path":
                page.evaluate("twilight.set({ azimuth: 270 }); twilight.draw()")
            if name == "arch":
                page.mouse.click(250, 400)
            page.wait_for_timeout(500)
            if name == "disc":
                page.click("#probe-close")
                page.click("#toggle")
                page.mouse.move(5, 5)
            page.screenshot(path=folder / f"{name}.jpg", type="jpeg", quality=82)
    with open_page(Path(sys.argv[1]), 390, 844, has_touch=True, is_mobile=True) as (page, more):
        page.wait_for_timeout(500)
        page.screenshot(path=folder / "phone.jpg", type="jpeg", quality=82)
    if errors or more:
        raise SystemExit("\n".join(errors + more))


if __name__ == "__main__":
    main()
