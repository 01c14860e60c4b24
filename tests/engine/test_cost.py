"""Cost of a scene before it is computed: against measured memory, and the blocks of wavelengths that follow from it."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twilight.config import load
from twilight.engine import plan
from twilight.engine.problem import full_cost
from twilight.scene import resolve
from twilight.solvers.base import Cost

KEYS = {
    "sun.elevation_deg": -4.0,
    "solver.quality": "draft",
    "solver.expert.spectrum": "solved",
    "wavelengths": {"min_nm": 400, "max_nm": 700, "count": 16},
}


def test_as_many_wavelengths_as_the_memory_holds():
    """Blocks would exceed the memory that they were made for."""
    cost = Cost(100.0, 10.0, 1.0, 0.0, block_size=4)
    assert cost.n_bytes(1) == cost.n_bytes(4) == 140.0 and cost.n_bytes(5) == 180.0
    wet = replace(cost, band_bytes=60.0)
    assert wet.n_bytes(5, True) == cost.n_bytes(5) + 60.0 and wet.n_bytes(5) == cost.n_bytes(5)
    assert wet.max_wavelengths(32, 240.0) == 12 and wet.max_wavelengths(32, 240.0, True) == 8
    for room in (0.0, 139.0, 140.0, 200.0, 1e9):
        n = cost.max_wavelengths(32, room)
        assert 4 <= n <= 32 and (cost.n_bytes(n) <= room or n == 4)
        assert n == 32 or cost.n_bytes(n + 4) > room


def test_blocks_shrink_until_the_limit_holds(monkeypatch):
    """A large field would not be divided."""
    config = load(
        "pure-air",
        {
            "solver.quality": "standard",
            "solver.expert.spectrum": "solved",
            "wavelengths": {"min_nm": 600, "max_nm": 740, "count": 48},
        },
    )
    sizes = {}
    for limit in (4e9, 0.25e9, 1e6):
        monkeypatch.setattr(sys.modules["twilight.engine.problem"], "FIELD_BYTES", limit)
        problem = plan(resolve(config), (-4.0,))
        assert sum(part.stop - part.start for part in problem.slices) == 48
        sizes[limit] = max(part.stop - part.start for part in problem.slices)
        assert sizes[limit] == problem.cost.block_size or problem.cost.n_bytes(sizes[limit]) <= limit
    assert sizes[4e9] > sizes[0.25e9] > sizes[1e6] == problem.cost.block_size


@pytest.mark.parametrize("solver", ["preetham", "cie"])
def test_of_a_solver_that_does_not_say_the_arrays_alone_are_known(solver):
    """A plan would invent figures for solvers that give none."""
    sizes = full_cost(resolve(load("pure-air", {"solver.name": solver, "sun.elevation_deg": 5.0})))
    assert sizes.sky_bytes > 0 and (sizes.field_bytes, sizes.total_bytes, sizes.cpu_s) == (None, None, None)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read from /proc")
def test_the_memory_is_what_the_plan_says():
    """The plan would be off by more than 40 % of the memory that a run takes."""
    plan = full_cost(resolve(load("continental-average", KEYS)))
    code = f"""
from numba.core import event
compiled = event.RecordingListener()
event.register("numba:compile", compiled)
from twilight.config import load
from twilight.config.load import load_axes
from twilight.engine import run
from twilight.scene import resolve
run(resolve(load("continental-average", {KEYS!r})))
# of this program alone: getrusage tells the largest of it and of the process that started it
status = open("/proc/self/status").read()
print(len(compiled.buffer), 1024 * int(status.partition("VmHWM:")[2].split()[0]))
"""
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), "TWILIGHT_CACHE_GB": "0"}
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
        compiled, peak_bytes = map(int, done.stdout.split())
        if not compiled:  # which takes memory of its own
            break
    assert np.log(plan.total_bytes / peak_bytes) == pytest.approx(0.0, abs=np.log(1.4))


def test_a_plan_of_many_wavelengths_computes_no_optics(monkeypatch):
    """It took two minutes at 701 wavelengths: Mie optics at each of them, and an exponential sum fitted for each."""
    from twilight.atmosphere import bands, mie

    def never(*_):
        raise AssertionError("a plan computes Mie optics")

    monkeypatch.setattr(mie, "compute_optics", never)
    wavelengths = {"min_nm": 300, "max_nm": 1000, "count": 701}
    config = load("continental-average", {"sun.elevation_deg": -4.0, "wavelengths": wavelengths})
    before = bands.terms.cache_info().misses
    planned = full_cost(resolve(config, for_plan=True))
    assert bands.terms.cache_info().misses - before < 80
    assert planned.wavelengths == 701 and planned.blocks > 8 and planned.cpu_s > 60.0


def test_a_run_that_compiles_promises_no_time(monkeypatch):
    """It said 7:53 left where the whole run took 75 s."""
    from twilight.cli import terminal

    assert terminal.time_left(0.2, 10.0) == "0:00:40 left"
    monkeypatch.setattr(terminal, "compiling", True)
    assert terminal.time_left(0.2, 60.0) == "compiling, time left not known"
    assert terminal.time_left(0.8, 60.0) == "0:00:15 left"


DEEP = {"sun.elevation_deg": -9.0, "wavelengths": {"count": 8}}
BAND = KEYS | {"solver.quality": "standard", "wavelengths": {"list_nm": [720.0, 725.0, 730.0]}}
HABER = {"solver.azimuth_cells": 48, "sun": {"elevations_deg": [5.0]}}


@pytest.mark.parametrize(
    ("scene", "keys", "less", "part", "least"),
    [
        ("pure-air", {**DEEP, "solver.name": "montecarlo"}, {"solver.quality": "draft"}, "cpu_s", 1.05),
        ("pure-air", {**DEEP, "solver.name": "montecarlo"}, {"sun.elevation_deg": 30.0}, "cpu_s", 1.05),
        ("pure-air", {**DEEP, "solver.name": "montecarlo"}, {"texture.resolution_deg": 6.0}, "cpu_s", 1.05),
        ("pure-air", {**DEEP, "solver.name": "cells"}, {"solver.quality": "draft"}, "cpu_s", 1.05),
        ("pure-air", {**DEEP, "solver.name": "tables"}, {"solver.max_orders": 3}, "cpu_s", 1.05),
        ("pure-air", {**DEEP, "solver.name": "compact"}, {"wavelengths": {"count": 4}}, "cpu_s", 1.05),
        ("pure-air", KEYS, {"wavelengths": {"count": 8}}, "cpu_s", 1.1),
        ("pure-air", KEYS | {"solver.quality": "reference"}, {"solver.quality": "standard"}, "field_bytes", 1.5),
        ("pure-air", KEYS | {"solver.quality": "standard"}, {"solver.quality": "draft"}, "field_bytes", 1.5),
        ("pure-air", KEYS | {"texture.resolution_deg": 1}, {"texture.resolution_deg": 3}, "total_bytes", 1.01),
        ("continental-average", BAND, {"wavelengths": {"list_nm": [640.0, 645.0, 650.0]}}, "total_bytes", 1.05),
        ("continental-average", KEYS | {"observer.view": {"kind": "latlong", "width": 2048, "height": 1024}},
         {"observer.view": None}, "total_bytes", 1.2),
        ("haber2005", HABER, {"solver.azimuth_cells": 24}, "field_bytes", 4.0),
        ("haber2005", HABER | {"sun": {"elevations_deg": [5.0, 0.0, -3.0]}}, HABER, "cpu_s", 2.2),
        ("sunset-over-ridges", {}, {"terrain": None}, "cpu_s", 1.05),
        ("pure-air", {"sun.elevations_deg": [float(s) for s in range(20)]}, {"sun.elevations_deg": [5.0, 0.0]},
         "cpu_s", 1.5),
    ],
)  # fmt: skip
def test_less_of_anything_costs_less(scene, keys, less, part, least):
    """`render --plan` would print a dash for hours of work, or miss suns, terrain, views or the terms of a band."""
    more, fewer = (getattr(full_cost(resolve(load(scene, one), for_plan=True)), part) for one in (keys, keys | less))
    assert more > least * fewer > 0.0
