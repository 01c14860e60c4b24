"""Processor seconds of `zones`: a field of all suns, line by line, and one more sky of it.

    python benchmarks/zones_speed.py           writes results/zones_speed.csv
    python benchmarks/zones_speed.py profile   prints where a field's time goes, in two climates
    python benchmarks/zones_speed.py busy      prints a new air and sun as people ask for them, by `zones` and
                                               `compact`, alone and beside two processes that spin

Eight wavelengths, one thread, kernels compiled before; continental air, and desert in the profile.  A sky is 120 x 30
directions of a `standard` field for a sun that it has not been asked for before, the least time of three.
"""

from __future__ import annotations

import cProfile
import os
import pstats
import subprocess
import sys
import time
from pathlib import Path

os.environ |= {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "TWILIGHT_CACHE_GB": "0"}

import numpy as np
import results

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones

WAVELENGTH_NM = (380.0, 440.0, 472.0, 548.0, 580.0, 616.0, 676.0, 720.0)
SUNS_DEG = (60.0, 30.0, 5.0, 0.0, -2.0, -4.0, -6.0, -8.0, -10.0, -12.0, -15.0, -18.0)
AZIMUTH_DEG = np.arange(120) * 3.0 + 1.5
ELEVATION_DEG = np.arange(30) * 3.0 + 1.5
OF_SKIES = "standard"
NEXT_DEG = 0.3
"""How far a sun is from the one asked for before [deg]."""
REPEAT = 3
COARSEST = zones.ZonesSettings(
    degree=4, polar_directions=3, azimuth_directions=3, late_degree=3, late_polar_directions=3,
    late_azimuth_directions=3, altitude_density=0.3, zenith_density=0.3, step_density=0.3, beam_density=0.3,
    polarisation=True, polarisation_degree=3, late_polarisation_degree=3,
)  # fmt: skip
"""Compiles everything in little time."""


def warm_up() -> None:
    """Compile everything, or read what was compiled."""
    medium = climate_medium(load_climate("continental-average"), np.array([550.0]))
    zones.prepare(medium, COARSEST).radiance(-4.0, ELEVATION_DEG[:, None], AZIMUTH_DEG)


LINES = {
    "orders after the first": ("next_order.py", "scatter"),
    "their moments": ("next_order.py", "moments_of"),
    "points of their rays": ("ray_points.py", "make_ray_points"),
    "first order: light along rays": ("first_order.py", "scatter_sunlight"),
    "first order: points of rays": ("scattering.py", "_sunlit"),
    "first order: table of sunlight": ("first_order.py", "make_sunlight"),
    "sunbeam: rays past their lowest point": ("beam_tables.py", "down_table"),
    "sunbeam: rays from above": ("beam_tables.py", "up_table"),
    "sunbeam: first guess, dispersion, limb": ("beam_tables.py", "guess_table", "shift_table", "limb_table"),
    "grids": ("grids.py", "lay_out"),
}
"""Lines of the profile, which do not overlap, and the functions that they are the time of, with all that these call."""


def profile(climate: str, quality: str) -> None:
    """Print the lines of a field's time [s of the processor], its optics being stored."""
    medium = climate_medium(load_climate(climate), np.array(WAVELENGTH_NM))
    profiler = cProfile.Profile(time.process_time)
    profiler.enable()
    zones.prepare(medium, zones.QUALITIES[quality])
    profiler.disable()
    stats = pstats.Stats(profiler)
    spent = {(Path(file).name, name): row[3] for (file, _, name), row in stats.stats.items()}  # type: ignore[attr-defined]
    lines = {line: sum(spent.get((file, name), 0.0) for name in names) for line, (file, *names) in LINES.items()}
    total = stats.total_tt  # type: ignore[attr-defined]
    lines |= {"the rest": total - sum(lines.values()), "all": total}
    for line, seconds in lines.items():
        print(climate, quality, line, f"{seconds:.2f}", f"{100.0 * seconds / total:.0f} %", sep="\t", flush=True)


ASKED = """
import sys, time, twilight
def sky(depth):
    air = twilight.load("continental-average", {"climate.aerosol.optical_depth_550nm": depth})
    twilight.solve(air, solver=sys.argv[1], quality=sys.argv[2]).radiance(-4.0, 30.0, 10.0)
sky(0.2)
begin = time.process_time()
for n in range(5):
    sky(0.21 + 0.01 * n)
print((time.process_time() - begin) / 5.0)
"""
"""Processor seconds of a new air and its sun in a warm process, on as many threads as numpy takes by itself."""


def busy() -> None:
    """Print those seconds alone and beside two processes that spin."""
    free = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")} | {"NUMBA_NUM_THREADS": "1"}
    for beside in (0, 2):
        spinning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(beside)]
        try:
            for words in (("compact", "standard"), ("zones", "draft")):
                command = [sys.executable, "-c", ASKED, *words]
                done = subprocess.run(command, env=free, check=True, capture_output=True, text=True)
                print(*words, f"beside {beside}", f"{float(done.stdout):.3f}", sep="\t", flush=True)
        finally:
            for one in spinning:
                one.kill()


def main() -> None:
    """Measure and write the table."""
    climate = load_climate("continental-average")
    directions = (ELEVATION_DEG[:, None], AZIMUTH_DEG)
    warm_up()
    medium = climate_medium(climate, np.array(WAVELENGTH_NM))
    rows = []
    for quality in ("draft", OF_SKIES):
        begin = time.process_time()
        field = zones.prepare(medium, zones.QUALITIES[quality])
        rows.append([f"field, {quality}", f"{time.process_time() - begin:.2f}"])
        if quality == OF_SKIES:
            standard = field
    for sun in SUNS_DEG:
        times = []
        standard.radiance(sun + NEXT_DEG, *directions)
        for _ in range(REPEAT):
            begin = time.process_time()
            standard.radiance(sun, *directions)
            times.append(time.process_time() - begin)
        rows.append([f"one more sky, sun at {sun:g} deg", f"{min(times):.3f}"])
    notes = ["one thread; fields of all suns at 8 wavelengths, skies of 120 x 30"]
    results.write(results.FOLDER / "zones_speed.csv", ["what", "processor_s"], rows, notes=notes)
    print((results.FOLDER / "zones_speed.csv").read_text(), end="")


if __name__ == "__main__":
    results.say_help(__doc__)
    if sys.argv[1:] == ["profile"]:
        warm_up()
        for of_climate in ("continental-average", "desert"):
            for at_quality in ("draft", "standard"):
                profile(of_climate, at_quality)
    elif sys.argv[1:] == ["busy"]:
        busy()
    else:
        main()
