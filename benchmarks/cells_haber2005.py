"""Run time and memory of Haber's own configuration: python benchmarks/cells_haber2005.py

He reports "less than two hours" and "up to 100 MB" for S = 120, 50 layers, 8 wavelengths and 5 events on a 3 GHz PC.
"""

from __future__ import annotations

import resource
import time

import numpy as np

from twilight.config import load
from twilight.engine import run
from twilight.scene import resolve


def main() -> None:
    settings = {"climate": "haber2005", "solver.name": "cells", "solver.quality": "haber2005", "sun.elevation_deg": 9}
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times, peaks = [], []
    for _ in range(2):  # the first run compiles
        start = time.perf_counter()
        sky = run(resolve(load({"version": 1, **{"climate": settings["climate"]}}, {
            k: v for k, v in settings.items() if k != "climate"})))  # fmt: skip
        times.append(time.perf_counter() - start)
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    assert np.all(np.isfinite(sky.sun_normalised_radiance))
    print(f"with compilation {times[0]:.1f} s, compiled {times[1]:.1f} s")
    print(f"peak memory of one run {peaks[0] / 1024:.0f} MiB, of which {before / 1024:.0f} MiB before it")
    print(f"zenith luminance {sky.luminance()[-1].mean():.0f} cd/m^2")


if __name__ == "__main__":
    main()
