"""One job in a process of its own, so that time and peak memory are its own: python -m peers.job JOB.json

The job: {"model": "SOLVER:QUALITY", "task": "error" | "one" | "thirty", "threads": n,
"reference": path, "suns": some of its suns [deg] or null, "output": path.npz}.  `error` gives the radiances of the
reference's rows; `one` and `thirty` are whole half-skies at eight wavelengths for one sun or thirty.
Writes {"wall_s", "cpu_s", "memory_mib", "memory_before_mib"} to standard output.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from dataclasses import replace

import numpy as np


def main() -> None:
    with open(sys.argv[1]) as stream:
        job = json.load(stream)
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: job["threads"]])
    os.environ["NUMBA_NUM_THREADS"] = str(job["threads"])
    from peers import case  # numba reads its thread count when it is imported

    model, _, variant = job["model"].partition(":")
    if job["task"] == "error":
        medium = case.straight_air(case.ReferenceSolution.read(job["reference"], job["suns"]).wavelengths())
    else:
        medium = case.straight_air(case.WAVELENGTHS_NM)
    set_up = _solver(model, variant, job)
    before = _peak_mib()
    wall, cpu = time.perf_counter(), time.process_time()
    radiance = set_up(medium)
    measured = {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}
    np.savez(job["output"], radiance=radiance)
    json.dump(measured | {"memory_mib": _peak_mib(), "memory_before_mib": before}, sys.stdout)


def _peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _questions(job: dict) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """(sun, elevations, azimuths) of every sky that is asked for; rows of the reference solution in its own order."""
    from peers import case

    if job["task"] == "error":
        reference = case.ReferenceSolution.read(job["reference"], job["suns"])
        directions = reference.directions()
        return [(float(sun), *directions) for sun in reference.suns_deg]
    suns = case.THIRTY_SUNS_DEG if job["task"] == "thirty" else (case.ONE_SUN_DEG,)
    return [(sun, *case.texture()) for sun in suns]


def _solver(model: str, variant: str, job: dict):
    from peers import case
    from twilight import solvers

    solver = solvers.load(model)
    settings = solver.QUALITIES[variant]
    if hasattr(settings, "threads"):
        settings = replace(settings, threads=job["threads"])
    questions = _questions(job)
    # every kernel is loaded (compiled where the cache is empty) by a sky that costs little
    small = case.straight_air(case.WAVELENGTHS_NM[[3]])
    quick = solver.QUALITIES["draft"]
    if hasattr(quick, "max_orders"):
        quick = replace(quick, max_orders=2)
    solver.prepare(small, quick).radiance(0.0, np.array([10.0]), np.array([0.0]))

    def run(medium):
        known = {"sun_elevations_deg": [q[0] for q in questions]} if solver.CAPABILITIES.takes_suns else {}
        field = solver.prepare(medium, settings, **known)
        return np.stack([field.radiance(*q) for q in questions])

    return run


if __name__ == "__main__":
    main()
