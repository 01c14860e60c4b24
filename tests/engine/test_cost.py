"""Cost of a scene before it is computed: against measured memory, and the blocks of wavelengths that follow from it."""

import itertools
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twilight.config import load
from twilight.config.load import load_axes
from twilight.engine import plan
from twilight.engine.problem import full_cost
from twilight.scene import resolve
from twilight.solvers.base import Cost
from twilight.studies.sweep.sweep import Sweep

KEYS = {
    "sun.elevation_deg": -4.0,
    "solver.quality": "draft",
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
        "pure-air", {"solver.quality": "standard", "wavelengths": {"min_nm": 600, "max_nm": 740, "count": 48}}
    )
    sizes = {}
    for limit in (4e9, 0.3e9, 1e6):
        monkeypatch.setattr(sys.modules["twilight.engine.problem"], "FIELD_BYTES", limit)
        problem = plan(resolve(config), (-4.0,))
        assert sum(part.stop - part.start for part in problem.slices) == 48
        sizes[limit] = max(part.stop - part.start for part in problem.slices)
        assert sizes[limit] == problem.cost.block_size or problem.cost.n_bytes(sizes[limit]) <= limit
    assert sizes[4e9] > sizes[0.3e9] > sizes[1e6] == problem.cost.block_size


@pytest.mark.parametrize("solver", ["preetham", "cie"])
def test_of_a_solver_that_does_not_say_the_arrays_alone_are_known(solver):
    """A plan would invent figures for solvers that give none."""
    sizes = full_cost(resolve(load("pure-air", {"solver.name": solver, "sun.elevation_deg": 5.0})))
    assert sizes.sky_bytes > 0 and (sizes.field_bytes, sizes.total_bytes, sizes.cpu_s) == (None, None, None)


@pytest.mark.parametrize(
    "solver, more",
    [
        ("montecarlo", {"solver.quality": "draft"}),
        ("montecarlo", {"sun.elevation_deg": 30.0}),
        ("montecarlo", {"texture.resolution_deg": 6.0}),
        ("cells", {"solver.quality": "draft"}),
        ("tables", {"solver.max_orders": 3}),
        ("compact", {"wavelengths": {"count": 4}}),
    ],
)
def test_every_solver_that_takes_long_says_how_long(solver, more):
    """`render --plan` would print a dash for hours of Monte-Carlo."""
    base = {"solver.name": solver, "sun.elevation_deg": -9.0, "wavelengths": {"count": 8}}
    full, less = (full_cost(resolve(load("pure-air", keys))) for keys in (base, base | more))
    assert 0.0 < less.cpu_s < 0.95 * full.cpu_s and full.total_bytes > 1e8


def test_a_sweep_says_how_long_before_it_begins():
    """Its plan would say nothing until a task is finished; suns that share a field count once in it."""

    def planned(solver, suns):
        keys = {"ground.albedo": [0.1, 0.4, 0.8], "sun.elevation_deg": suns}
        base = {"version": 1, "climate": "pure-air", "solver": {"name": solver}, "wavelengths": {"count": 8}}
        return Sweep(load_axes({**base, "texture": {"resolution_deg": 15}, "vary": keys})).planned_cpu_s()

    assert 1.5 * planned("zones", [5]) > planned("zones", [5, 4, 3]) > planned("zones", [5])
    assert planned("montecarlo", [-9]) > 2.0 * planned("montecarlo", [30])
    assert planned("preetham", [30, 20]) is None


def test_habers_system_is_planned_for_each_sun():
    """The plan of `render haber2005` was without time and memory; every sun is a solution of its own."""
    plans = {}
    for cells, suns in ((24, (5.0,)), (48, (5.0,)), (48, (5.0, 0.0, -3.0))):
        changes = {"solver.azimuth_cells": cells, "sun": {"elevations_deg": suns}}
        plans[cells, suns] = full_cost(resolve(load("haber2005", changes)))
    one, three = (plans[48, suns].cpu_s for suns in ((5.0,), (5.0, 0.0, -3.0)))
    assert three - one > 1.5 * (one - plans[24, (5.0,)].cpu_s) > 0.0
    assert plans[48, (5.0,)].field_bytes > 4.0 * plans[24, (5.0,)].field_bytes > 0.0


def test_more_of_anything_costs_more():
    """The plan would miss wavelengths, quality or texture."""
    base = {"sun.elevation_deg": -4.0, "solver.quality": "draft", "wavelengths": {"count": 40}}
    small = full_cost(resolve(load("pure-air", base)))
    for more in (
        {"wavelengths": {"count": 80}},
        {"solver.quality": "standard"},
        {"texture.resolution_deg": 1},
    ):
        large = full_cost(resolve(load("pure-air", base | more)))
        assert large.cpu_s > 1.2 * small.cpu_s
        assert large.total_bytes > small.total_bytes or "wavelengths" in more
    qualities = [
        full_cost(resolve(load("pure-air", base | {"solver.quality": q}))) for q in ("draft", "standard", "reference")
    ]
    assert all(b.field_bytes > 1.5 * a.field_bytes for a, b in itertools.pairwise(qualities))


def test_a_band_and_a_view_cost_more():
    """The plan would miss the terms of an exponential sum, or a view."""
    nm = {"sun.elevation_deg": -4.0, "solver.quality": "standard"}
    clear, wet = (
        full_cost(resolve(load("continental-average", nm | {"wavelengths": {"list_nm": [a, a + 5.0, a + 10.0]}})))
        for a in (640.0, 720.0)
    )
    assert 1.2 * clear.total_bytes < wet.total_bytes < 3.0 * clear.total_bytes and wet.cpu_s > 1.5 * clear.cpu_s
    view = {"observer.view": {"kind": "latlong", "width": 2048, "height": 1024}}
    seen = full_cost(resolve(load("continental-average", KEYS | view)))
    assert seen.total_bytes > 1.2 * full_cost(resolve(load("continental-average", KEYS))).total_bytes


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


def test_terrain_and_more_suns_cost_more():
    """Terrain was planned as if it were sky, and a sun's files as if they were free."""
    ridges = load("sunset-over-ridges", {})
    open_sky = ridges.model_copy(update={"terrain": None})
    with_terrain, without = (full_cost(resolve(one, for_plan=True)).cpu_s for one in (ridges, open_sky))
    pixels = 1280 * 640
    assert with_terrain - without > 2e-5 * pixels
    few = load("pure-air", {"sun.elevations_deg": [5.0, 0.0]})
    many = load("pure-air", {"sun.elevations_deg": [float(s) for s in range(20)]})
    assert full_cost(resolve(many, for_plan=True)).cpu_s - full_cost(resolve(few, for_plan=True)).cpu_s > 15.0


def test_a_run_that_compiles_promises_no_time(monkeypatch):
    """It said 7:53 left where the whole run took 75 s."""
    from twilight.cli import terminal

    assert terminal.time_left(0.2, 10.0) == "0:00:40 left"
    monkeypatch.setattr(terminal, "compiling", True)
    assert terminal.time_left(0.2, 60.0) == "compiling, time left not known"
    assert terminal.time_left(0.8, 60.0) == "0:00:15 left"
