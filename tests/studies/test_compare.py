"""Error against run time: statistics, tables of the reference solution, workers, and the command from end to end."""

import csv
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rendering import call

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.progress import silent
from twilight.config import load
from twilight.studies.compare import bench as bench_module
from twilight.studies.compare.bench import Bench
from twilight.studies.compare.comparison import compare
from twilight.studies.compare.job import Job, SampleDirections, stratified_directions
from twilight.studies.compare.presets import SolverPreset, solver_presets, with_preset
from twilight.studies.compare.reference_solution import (
    ReferenceSolution,
    ReferenceSolver,
    read_references,
    write_references,
)
from twilight.studies.compare.report import read_points

NM = (450.0, 550.0, 680.0)
SCENE = {"version": 1, "climate": {"version": 1, "name": "toy air"}, "wavelengths": {"list_nm": list(NM)}}


LIGHT = 1.0 / 1.01
"""The light of the references over that of the toy solver at quality standard."""
ERROR_PERCENT = {"draft": 100.0 * (1.1 / LIGHT - 1.0), "standard": 1.0}


def reference(toy, sun, stderr=0.0, nm=NM, seed=1):
    elevation, azimuth = stratified_directions((30, 120), 40)
    right = toy.truth(LIGHT, 0.0, sun, 0.0, elevation, azimuth, nm)
    noise = 1.0 + stderr * np.random.default_rng(seed).standard_normal(right.shape)
    return ReferenceSolution(elevation, azimuth, np.array(nm), right * noise, stderr * right)


def scene(**solver):
    return load(SCENE | {"solver": {"name": "toy", **solver}})


def test_what_leaving_out_costs_leaves_out_one_thing(monkeypatch):
    """A row of the benchmark would be refused, or be of the whole scene."""
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    from ablations import LEFT_OUT

    whole = load("continental-average")
    each = [load("continental-average", settings) for settings in LEFT_OUT.values()]
    assert len({one.model_dump_json() for one in (whole, *each)}) == len(each) + 1


def test_a_table_of_references_survives_the_file(toy, tmp_path):
    """A stored reference would be read back otherwise."""
    stored = {sun: reference(toy, sun, stderr=0.01, nm=(428.57142857142856, 600.0)) for sun in (5.0, -6.5)}
    write_references(tmp_path / "t.csv", stored)
    again = read_references(tmp_path / "t.csv")
    assert list(again) == [5.0, -6.5]
    for sun, r in stored.items():
        order = np.lexsort((r.azimuth_deg, r.elevation_deg))
        assert np.array_equal(again[sun].azimuth_deg, r.azimuth_deg[order])
        assert again[sun].wavelength_nm.tolist() == [428.57142857142856, 600.0]
        assert np.allclose(again[sun].radiance, r.radiance[order], rtol=1e-5)
        assert np.allclose(again[sun].standard_error, r.standard_error[order], rtol=1e-2)


def test_presets_are_named_by_solvers_and_qualities(toy):
    """`--solvers` would mean others."""
    assert solver_presets(["toy"]) == [SolverPreset("toy", "draft"), SolverPreset("toy", "standard")]
    assert solver_presets(["toy:draft", " toy "]) == [SolverPreset("toy", "draft"), SolverPreset("toy", "standard")]
    assert {r.solver for r in solver_presets(None)} == set(solvers.installed())
    for names, says in ((["tiy"], "did you mean toy"), (["toy:fine"], "quality of toy")):
        with pytest.raises(TwilightError, match=says):
            solver_presets(names)


def test_options_of_the_scene_stay_with_the_solver_that_it_names(toy):
    """An option of one solver would reach another."""
    config = scene(factor=3.0)
    assert with_preset(config, SolverPreset("toy", "draft")).solver["factor"] == 3.0
    assert "factor" not in with_preset(config, SolverPreset("cells", "draft")).solver


def job(toy, suns=(5.0, -6.0), repeats=1, **solver):
    directions = {sun: SampleDirections((10.0, 80.0), (0.0, 90.0)) for sun in suns}
    return Job(scene(**solver), tuple(suns), directions, repeats=repeats)


def test_a_job_gives_radiances_times_and_memory_and_is_kept(toy, tmp_path, monkeypatch):
    """A worker's figures would be lost, or computed again."""
    work = Bench(tmp_path / "rows")
    outcomes = work.measure(job(toy, repeats=2, wait_s=0.05, hold_mib=100))
    for sun, outcome in outcomes.items():
        assert np.allclose(outcome.radiance, toy.truth(1.0, 0.0, sun, 0.0, (10.0, 80.0), (0.0, 90.0), NM), rtol=1e-3)
        timing = outcome.timing
        assert len(timing.set_up_s) == len(timing.sky_s) == 2 and timing.directions == 3600
        assert min(timing.sky_s) >= 0.05
    timing = outcomes[-6.0].timing
    assert timing.peak_mib >= 100 and timing.before_mib < timing.peak_mib

    def never(*args, **kwargs):
        raise AssertionError("a worker was started")

    monkeypatch.setattr(bench_module.subprocess, "Popen", never)
    again = work.measure(job(toy, repeats=2, wait_s=0.05, hold_mib=100))
    assert np.array_equal(again[5.0].radiance, outcomes[5.0].radiance) and again[5.0].timing == outcomes[5.0].timing
    with pytest.raises(AssertionError):
        work.measure(job(toy, repeats=2, wait_s=0.05, hold_mib=100, factor=2.0))


@pytest.mark.slow
def test_damaged_results_are_made_again(toy, tmp_path):
    """A damaged result would enter the table."""
    work = Bench(tmp_path / "rows")
    first = work.measure(job(toy, suns=(5.0,)))
    radiance, timing = sorted((tmp_path / "rows").iterdir())
    radiance.write_text('{"radiance": [[1, "x"')
    timing.write_text('{"timing": {"a": 1}}')
    again = work.measure(job(toy, suns=(5.0,)))
    assert np.array_equal(first[5.0].radiance, again[5.0].radiance) and again[5.0].timing is not None


@pytest.mark.slow
def test_wavelengths_of_a_stored_reference_are_computed_apart(toy, tmp_path, log):
    """Errors would be of other wavelengths."""
    directions = SampleDirections((10.0,), (0.0,), (500.0, 600.0))
    outcome = Bench(tmp_path / "rows").measure(Job(scene(), (5.0,), {5.0: directions}, repeats=1))[5.0]
    assert np.allclose(outcome.radiance, toy.truth(1.0, 0.0, 5.0, 0.0, [10.0], [0.0], (500.0, 600.0)), rtol=1e-3)
    counts = [int(line.split()[-1]) for line in log.read_text().splitlines()]
    assert counts == [1, 3, 2]  # warming up, the timed run, the reference's wavelengths


@pytest.mark.parametrize(
    "solver, says",
    (({"factor": 13.0}, "the toy broke"), pytest.param({"wait_s": 20.0}, "stopped after 4 s", marks=pytest.mark.slow)),
)
def test_a_solver_that_breaks_or_lasts_is_a_reason(toy, tmp_path, log, solver, says):
    """One solver that breaks would end the comparison."""
    limit_s = 4.0 if "wait_s" in solver else 100.0
    outcome = Bench(tmp_path / "rows", time_limit_s=limit_s).measure(job(toy, suns=(5.0,), **solver))[5.0]
    assert outcome.radiance is None and says in outcome.reason


def test_a_time_limit_is_remembered_until_it_grows(toy, tmp_path, monkeypatch):
    """Every run would wait for the slowest solver again."""
    slow = job(toy, suns=(5.0,), wait_s=1.5)
    assert Bench(tmp_path / "rows", 1.0).measure(slow)[5.0].reason
    started = []
    monkeypatch.setattr(bench_module, "_Worker", lambda *a: started.append(a) or pytest.fail("a worker was started"))
    assert Bench(tmp_path / "rows", 1.0).measure(slow)[5.0].reason and not started
    monkeypatch.undo()


def test_known_errors_come_out_and_refused_suns_are_listed(toy, tmp_path):
    """The table would state other errors than there are."""
    references = {sun: reference(toy, sun, stderr=0.002) for sun in (5.0, -12.0)}
    rows = [
        r
        for found in compare(scene(), solver_presets(["toy"]), references, Bench(tmp_path / "rows"), repeats=1)
        for r in found
    ]
    by = {(r.preset.quality, r.sun_elevation_deg): r for r in rows}
    assert by["draft", 5.0].error.median == pytest.approx(ERROR_PERCENT["draft"], rel=0.02)
    assert by["standard", 5.0].error.mean == pytest.approx(1.0, abs=0.1)
    assert by["standard", 5.0].colour.luminance.median == pytest.approx(1.0, abs=0.3)
    assert set(by["draft", 5.0].by_wavelength) == set(NM)
    for quality in ("draft", "standard"):
        assert by[quality, -12.0].error is None and "-10 deg or higher" in by[quality, -12.0].reason


@pytest.fixture
def files(toy, tmp_path):
    """A scene's file and a table of references for two suns."""
    path = tmp_path / "air.yaml"
    path.write_text("version: 1\nclimate: {version: 1, name: air}\nwavelengths: {list_nm: [450, 550, 680]}\n")
    write_references(tmp_path / "right.csv", {sun: reference(toy, sun, stderr=0.003) for sun in (5.0, -6.0)})
    return path, tmp_path / "right.csv", tmp_path / "out"


def test_the_command_writes_tables_and_a_picture(files):
    """The command would miss a table, or put figures in wrong columns."""
    path, right, out = files
    arguments = ["compare", str(path), "--solvers", "toy", "--reference", str(right), "--output", str(out)]
    result = call(*arguments, "--repeats", "1")
    assert result.exit_code == 0, result.output
    with open(out / "compare.csv") as stream:
        rows = list(csv.DictReader(stream))
    assert [(r["quality"], r["sun_elevation_deg"]) for r in rows] == [
        (q, s) for q in ("draft", "standard") for s in ("5", "-6")
    ]
    for row in rows:
        true_percent = ERROR_PERCENT[row["quality"]]
        # of a constant error the reference solution's 0.3 % widens the upper end, by 1.64 standard deviations at most
        assert true_percent - 0.2 < float(row["p95_percent"]) < true_percent + 0.6
        assert float(row["mean_percent"]) == pytest.approx(true_percent, abs=0.15)
        assert float(row["time_s"]) > 0 and float(row["peak_memory_mib"]) > 20
        assert not row["reason"]
    with open(out / "wavelengths.csv") as stream:
        assert len(list(csv.DictReader(stream))) == 12
    assert (out / "error-against-time.png").stat().st_size > 5000
    assert {p.solver for p in read_points(out / "compare.csv")} == {"toy"}
    assert "reference solution's own error" in result.output


def test_a_sun_that_the_reference_lacks_is_refused(files):
    """Another sun would be compared."""
    path, right, out = files
    result = call("compare", path, "--solvers", "toy", "--reference", right, "--output", out, "--sun-elevation", "4")
    assert result.exit_code == 2 and "no sun at 4 deg; it has 5, -6" in result.output and not out.exists()


@pytest.mark.slow
def test_an_interrupt_keeps_what_is_finished_and_ends_the_worker(files, log):
    """Ctrl-C would lose hours, or leave a worker running."""
    path, right, out = files
    program = "import toy_solver; from twilight.cli import main; main()"
    settings = ["--set", "solver.name=toy", "--set", "solver.wait_s=1.0"]
    arguments = ["compare", str(path), "--solvers", "toy:draft", "--reference", str(right), "--output", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-c", program, *arguments, *settings, "--repeats", "1"],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while not list(out.glob("rows/*radiance*.json")) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    error = process.communicate(timeout=20)[1]
    assert process.returncode == 130 and "Traceback" not in error
    worker = int(log.read_text().splitlines()[-1].split()[0])
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)
    finished = {f.name: f.read_bytes() for f in out.glob("rows/*")}
    assert any("radiance" in name for name in finished) and not any(".part" in name for name in finished)
    before = len(log.read_text().splitlines())
    result = call(*arguments, *settings, "--repeats", "1")
    assert result.exit_code == 0, result.output
    assert all((out / "rows" / name).read_bytes() == content for name, content in finished.items())
    assert len(log.read_text().splitlines()) > before


def test_the_reference_solver_caches_each_sun(tmp_path, monkeypatch):
    """Hours of Monte-Carlo would be computed again."""
    config = load({"version": 1, "climate": "pure-air", "wavelengths": {"list_nm": [550.0]}})
    reference_solver = ReferenceSolver(config, tmp_path / "rows", 0.05)
    directions = (np.array([10.0, 60.0]), np.array([0.0, 90.0]))
    fractions = []
    found = reference_solver.references([5.0], directions, lambda doing, fraction: fractions.append(fraction))
    assert found[5.0].radiance.shape == (2, 1) and (found[5.0].radiance > 0).all()
    assert (found[5.0].standard_error < 0.1 * found[5.0].radiance).all()
    assert fractions and max(fractions) <= 1.0
    monkeypatch.setattr(solvers.load("montecarlo"), "prepare", None)
    again = reference_solver.references([5.0], directions, silent)
    assert np.array_equal(again[5.0].radiance, found[5.0].radiance)
    with pytest.raises(TypeError):
        replace(reference_solver, target_stderr=0.04).references([5.0], directions, silent)
