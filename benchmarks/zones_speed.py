"""Processor seconds of `zones`: a field of all suns, and one more sky of it.

    python benchmarks/zones_speed.py [--beside FOLDER] [--qualities draft,standard,reference] [--repeat 3]

Continental air at 8 wavelengths, one thread, kernels compiled before.  A sky is 120 x 30 directions of a `standard`
field for a sun that it has not been asked for before, the least time of REPEAT.  FOLDER is another checkout of the
program: its figures are measured in turn with these and written beside them, with the largest and the root mean square
change of its skies.  Writes benchmarks/zones_speed.csv.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
ROOT = HERE.parent
WAVELENGTH_NM = (380.0, 440.0, 472.0, 548.0, 580.0, 616.0, 676.0, 720.0)
SUNS_DEG = (60.0, 30.0, 5.0, 0.0, -2.0, -4.0, -6.0, -8.0, -10.0, -12.0, -15.0, -18.0)
AZIMUTH_DEG = np.arange(120) * 3.0 + 1.5
ELEVATION_DEG = np.arange(30) * 3.0 + 1.5
OF_SKIES = "standard"
NEXT_DEG = 0.3
"""How far a sun is from the one asked for before."""


def measure(qualities: list[str], repeat: int) -> None:
    """Print one JSON object: seconds of fields by quality, seconds of a sky by sun, and the file of the skies."""
    from twilight.config.load import load_climate
    from twilight.scene.medium import climate_medium
    from twilight.solvers import zones

    medium = climate_medium(load_climate("continental-average"), np.array(WAVELENGTH_NM))
    warm = climate_medium(load_climate("continental-average"), np.array([550.0]))
    directions = (ELEVATION_DEG[:, None], AZIMUTH_DEG)
    for polarised in {zones.QUALITIES[q].polarisation for q in [*qualities, OF_SKIES]}:
        settings = zones.ZonesSettings(
            degree=4, polar_directions=3, azimuth_directions=3, late_degree=3, late_polar_directions=3,
            late_azimuth_directions=3, altitude_density=0.3, zenith_density=0.3, step_density=0.3, beam_density=0.3,
            polarisation=polarised, polarisation_degree=3, late_polarisation_degree=3,
        )  # fmt: skip
        zones.prepare(warm, settings).radiance(-4.0, *directions)
    fields, seconds = {}, {}
    for quality in dict.fromkeys([*qualities, OF_SKIES]):
        begin = time.process_time()
        field = zones.prepare(medium, zones.QUALITIES[quality])
        seconds[quality] = time.process_time() - begin
        if quality == OF_SKIES:
            fields[quality] = field
    skies, of_sun = [], {}
    for sun in SUNS_DEG:
        times = []
        fields[OF_SKIES].radiance(sun + NEXT_DEG, *directions)
        for _ in range(repeat):
            begin = time.process_time()
            sky = fields[OF_SKIES].radiance(sun, *directions)
            times.append(time.process_time() - begin)
        skies.append(sky)
        of_sun[sun] = min(times)
    found = {"fields": {q: seconds[q] for q in qualities}, "skies": of_sun}
    np.save(sys.stdout.buffer, np.array(skies))
    sys.stdout.buffer.write(json.dumps(found).encode())


def of_checkout(root: Path, qualities: list[str], repeat: int) -> tuple[np.ndarray, dict]:
    """(skies (suns, elevations, azimuths, W), seconds) of the program at `root`."""
    one_thread = {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    env = {**os.environ, **one_thread, "PYTHONPATH": str(root), "TWILIGHT_CACHE_GB": "0"}
    command = [sys.executable, "-P", str(Path(__file__).resolve()), "--measure", ",".join(qualities), str(repeat)]
    out = subprocess.run(command, cwd=root, env=env, stdout=subprocess.PIPE, check=True).stdout
    end = out.rindex(b'{"fields"')
    shape = (len(SUNS_DEG), ELEVATION_DEG.size, AZIMUTH_DEG.size, len(WAVELENGTH_NM))
    size = 8 * int(np.prod(shape))
    return np.frombuffer(out[end - size : end]).reshape(shape), json.loads(out[end:])


def main() -> None:
    """Measure this program, and another beside it, and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--beside", type=Path)
    parser.add_argument("--qualities", default="draft,standard,reference")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--measure", nargs=2, metavar=("QUALITIES", "REPEAT"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        measure(options.measure[0].split(","), int(options.measure[1]))
        return
    import results  # a process that measures another checkout sees that one's modules alone

    qualities = options.qualities.split(",")
    skies, new = of_checkout(ROOT, qualities, options.repeat)
    columns, notes = ["what", "processor_s"], ["one thread; fields of all suns at 8 wavelengths, skies of 120 x 30"]
    rows = [[f"field, {quality}", f"{new['fields'][quality]:.2f}"] for quality in qualities]
    rows += [[f"one more sky, sun at {sun:g} deg", f"{new['skies'][str(sun)]:.3f}"] for sun in SUNS_DEG]
    if options.beside is not None:
        root = options.beside.resolve()
        before, old = of_checkout(root, qualities, options.repeat)
        wrong = skies / before - 1.0
        columns += ["beside_processor_s", "largest_change", "rms_change"]
        for row, quality in zip(rows, qualities, strict=False):
            row += [f"{old['fields'][quality]:.2f}", "", ""]
        for row, sun, change in zip(rows[len(qualities) :], SUNS_DEG, wrong, strict=True):
            largest, usual = np.abs(change).max(), np.sqrt(np.mean(change**2))
            row += [f"{old['skies'][str(sun)]:.3f}", f"{largest:.1e}", f"{usual:.1e}"]
        git = subprocess.run(["git", "log", "-1", "--format=%h"], cwd=root, capture_output=True, text=True)
        notes.append(f"beside: commit {git.stdout.strip() or 'unknown'}; changes of skies are relative to it")
    command = "python benchmarks/zones_speed.py" + ("" if options.beside is None else " --beside OLD")
    results.write(HERE / "zones_speed.csv", columns, rows, notes=notes, command=command)
    print((HERE / "zones_speed.csv").read_text(), end="")


if __name__ == "__main__":
    main()
