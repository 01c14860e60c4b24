"""What a scene takes, said before it is computed: beside what it takes, and blocks that follow from it."""

import itertools
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twilight import solvers
from twilight.config import load
from twilight.engine.memory import takes_in_full
from twilight.engine.solve import problem_of
from twilight.solvers.base import Takes

KEYS = {
    "sun.elevation_deg": -4.0,
    "solver.quality": "draft",
    "wavelengths": {"min_nm": 400, "max_nm": 700, "count": 16},
}


def test_as_many_wavelengths_as_the_memory_holds():
    takes = Takes(100.0, 10.0, 1.0, 0.0, together=4)
    assert takes.n_bytes(1) == takes.n_bytes(4) == 140.0 and takes.n_bytes(5) == 180.0
    wet = replace(takes, band_bytes=60.0)
    assert wet.n_bytes(5, True) == takes.n_bytes(5) + 60.0 and wet.n_bytes(5) == takes.n_bytes(5)
    assert wet.at_once(32, 240.0) == 12 and wet.at_once(32, 240.0, True) == 8
    for room in (0.0, 139.0, 140.0, 200.0, 1e9):
        n = takes.at_once(32, room)
        assert 4 <= n <= 32 and (takes.n_bytes(n) <= room or n == 4)
        assert n == 32 or takes.n_bytes(n + 4) > room


def test_blocks_shrink_until_the_limit_holds(monkeypatch):
    config = load(
        "pure-air", {"solver.quality": "standard", "wavelengths": {"min_nm": 600, "max_nm": 740, "count": 48}}
    )
    sizes = {}
    for limit in (4e9, 0.6e9, 1e6):
        monkeypatch.setattr(sys.modules["twilight.engine.solve"], "FIELD_BYTES", limit)
        problem = problem_of(config, [-4.0])
        assert sum(part.stop - part.start for part in problem.slices) == 48
        sizes[limit] = max(part.stop - part.start for part in problem.slices)
        assert sizes[limit] == problem.takes.together or problem.takes.n_bytes(sizes[limit]) <= limit
    assert sizes[4e9] > sizes[0.6e9] > sizes[1e6] == problem.takes.together


@pytest.mark.parametrize("solver", ["preetham", "cie", "montecarlo"])
def test_of_a_solver_that_does_not_say_the_arrays_alone_are_known(solver):
    assert solvers.load(solver).CAPABILITIES.takes is None
    sizes = takes_in_full(load("pure-air", {"solver.name": solver, "sun.elevation_deg": 5.0}))
    assert sizes.sky_bytes > 0 and (sizes.field_bytes, sizes.total_bytes, sizes.cpu_s) == (None, None, None)


def test_more_of_anything_takes_more():
    base = {"sun.elevation_deg": -4.0, "solver.quality": "draft", "wavelengths": {"count": 40}}
    small = takes_in_full(load("pure-air", base))
    for more in (
        {"wavelengths": {"count": 80}},
        {"solver.quality": "standard"},
        {"texture.resolution_deg": 1},
        {"texture.latlong_width": 2048},
    ):
        large = takes_in_full(load("pure-air", base | more))
        assert large.cpu_s > 1.2 * small.cpu_s
        assert large.total_bytes > small.total_bytes or "wavelengths" in more
    qualities = [
        takes_in_full(load("pure-air", base | {"solver.quality": q})) for q in ("draft", "standard", "reference")
    ]
    assert all(b.field_bytes > 3 * a.field_bytes for a, b in itertools.pairwise(qualities))


def test_a_band_and_a_view_take_more():
    nm = {"sun.elevation_deg": -4.0, "solver.quality": "standard"}
    clear, wet = (
        takes_in_full(load("continental-average", nm | {"wavelengths": {"list_nm": [a, a + 5.0, a + 10.0]}}))
        for a in (640.0, 720.0)
    )
    assert 1.2 * clear.total_bytes < wet.total_bytes < 3.0 * clear.total_bytes and wet.cpu_s > 1.5 * clear.cpu_s
    view = {"observer.view": {"kind": "latlong", "width": 2048, "height": 1024}}
    seen = takes_in_full(load("continental-average", KEYS | view))
    assert seen.total_bytes > 1.2 * takes_in_full(load("continental-average", KEYS)).total_bytes


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read from /proc")
def test_the_memory_is_what_the_plan_says():
    plan = takes_in_full(load("continental-average", KEYS))
    code = f"""
from twilight.config import load
from twilight.engine import run
run(load("continental-average", {KEYS!r}))
# of this program alone: getrusage tells the largest of it and of the process that started it
status = open("/proc/self/status").read()
print(1024 * int(status.partition("VmHWM:")[2].split()[0]))
"""
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), "TWILIGHT_CACHE_GB": "0"}
    for _ in range(2):  # once to compile what is missing, which takes memory of its own
        done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    assert np.log(plan.total_bytes / float(done.stdout)) == pytest.approx(0.0, abs=np.log(1.4))
