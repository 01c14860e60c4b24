"""Light shafts exactly and by eq. 17 and 18 of Bruneton and Neyret 2008: python benchmarks/terrain.py

The two shipped pictures with mountains' shadows (configs/light-shafts.yaml, mountain-shadow.yaml), smaller, at 450, 550
and 650 nm.  Where shadows darken a line of sight: what they take away, in percent of the light without shadows, exactly
(sunlight scattered once, out of every dark part) and by cutting the dark length off one end, and how far the second is
from the first.  Writes results/terrain.csv.
"""

from __future__ import annotations

import numpy as np
import results

from twilight.config import load_series
from twilight.engine import solve
from twilight.engine.view import landscape, view_radiance
from twilight.scene import Scene
from twilight.scene.medium import climate_medium
from twilight.sky.lights import Sun
from twilight.solvers import zones

OUT = results.FOLDER / "terrain.csv"
CONFIGS = ("light-shafts", "mountain-shadow")
WIDTH = 224
"""Of a view [px]."""
HEIGHT = 126
"""Of a view [px]."""
NM = (450.0, 550.0, 650.0)
LEAST_PERCENT = 0.5
"""Lines of sight that lose less by either are not counted."""


def main() -> None:
    rows = []
    for name in CONFIGS:
        config = load_series(f"configs/{name}.yaml")[0].config
        assert config.terrain is not None and config.observer.view is not None
        sun = config.sun.elevation_deg
        view = config.observer.view.model_copy(update={"width": WIDTH, "height": HEIGHT})
        medium = climate_medium(config.climate, np.array(NM))
        solved = solve(Scene(medium, None, zones, zones.QUALITIES["draft"], observer=config.observer), cached=False)
        seen = view_radiance(solved, view, Sun(sun)).whole()
        made = {
            shadows: landscape(solved, seen, config.terrain.model_copy(update={"shadows": shadows}), Sun(sun))
            for shadows in ("none", "exact", "segments")
        }
        clear = made["none"].radiance.astype(float)
        taken = {how: 100.0 * (1.0 - made[how].radiance / clear) for how in ("exact", "segments")}
        ground = made["none"].hidden
        for part, where in (("ground", ground), ("sky", ~ground)):
            loses = np.maximum(taken["exact"], taken["segments"]).max(axis=-1) > LEAST_PERCENT
            for w, nm in enumerate(NM):
                a, b = (taken[how][where & loses, w] for how in ("exact", "segments"))
                off = b - a
                numbers = [a.mean(), b.mean(), np.median(off), np.sqrt(np.mean(off**2)), np.quantile(np.abs(off), 0.95)]
                rows.append(
                    [name, part, f"{nm:g}", f"{100.0 * np.mean(loses[where]):.1f}", *(f"{v:.1f}" for v in numbers)]
                )
                print(*rows[-1], flush=True)
    columns = (
        "config", "lines_end_on", "wavelength_nm", "darkened_percent", "exact_takes_percent", "segments_take_percent",
        "median_difference_percent", "rms_difference_percent", "p95_difference_percent",
    )  # fmt: skip
    note = f"{WIDTH} x {HEIGHT} pixels, zones draft; darkened: share of the lines that lose over {LEAST_PERCENT} %"
    results.write(OUT, columns, rows, notes=[note])


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
