"""Error against run time: statistics, tables of the reference solution, workers, and the command from end to end."""

from __future__ import annotations

import csv
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config import load
from twilight.studies.compare import bench as bench_module
from twilight.studies.compare.ablations import ABLATIONS, Ablation, ablate
from twilight.studies.compare.bench import Bench
from twilight.studies.compare.comparison import Rung, compare, ladder, with_rung
from twilight.studies.compare.directions import stratified_directions
from twilight.studies.compare.figure import FigurePoint, draw, read_points
from twilight.studies.compare.job import Job, SampleDirections
from twilight.studies.compare.reference_solution import (
    COLUMNS,
    ReferenceSolution,
    ReferenceSolver,
    read_references,
    write_references,
)

TOY = '''
"""A solver with a closed form and a known error; it knows no sun below -10 deg."""

import os
import time
from dataclasses import dataclass

import numpy as np

from twilight.base.errors import TwilightError
from twilight.solvers.base import BareField, Capabilities


@dataclass(frozen=True)
class Settings:
    error_percent: float = 1.0
    wait_s: float = 0.0
    hold_mib: int = 0
    crash: bool = False


CAPABILITIES = Capabilities()
QUALITIES = {"draft": Settings(10.0), "standard": Settings()}


def truth(sun, elevation, azimuth, wavelength_nm):
    elevation, azimuth = np.broadcast_arrays(elevation, azimuth)
    shape = 10.0 ** (sun / 10.0) * (2.0 + np.cos(np.radians(azimuth))) * (2.0 - np.sin(np.radians(elevation)))
    return shape[..., None] * (np.asarray(wavelength_nm) / 550.0) ** -3.0


class Field(BareField):
    def __init__(self, medium, settings, progress):
        self.medium, self.settings, self.progress = medium, settings, progress

    def radiance(self, sun, elevation, azimuth):
        if sun < -10.0:
            raise TwilightError("the toy solver needs a sun at -10 deg or higher")
        if self.settings.crash:
            raise ZeroDivisionError("the toy broke")
        hold = np.ones(self.settings.hold_mib * 2**17)
        self.progress("toy", 0.5)
        time.sleep(self.settings.wait_s)
        right = truth(sun, elevation, azimuth, self.medium.wavelength_nm)
        return right * (1.0 + self.settings.error_percent / 100.0) + 0.0 * hold.sum()


def prepare(medium, settings, *, observer_altitude_km=0.0, progress=None):
    if os.environ.get("TOY_LOG"):
        with open(os.environ["TOY_LOG"], "a") as log:
            log.write(f"{medium.n_wavelengths} {os.getpid()}\\n")
    return Field(medium, settings, progress)
'''
NM = (450.0, 550.0, 680.0)
SCENE = {"version": 1, "climate": {"version": 1, "name": "toy air"}, "wavelengths": {"list_nm": list(NM)}}


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """The registered solver `toy`, known to worker processes too."""
    folder = tmp_path / "modules"
    folder.mkdir()
    (folder / "toy_compared.py").write_text(TOY)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setitem(solvers.SOLVERS, "toy", "toy_compared")
    yield __import__("toy_compared")
    sys.modules.pop("toy_compared")


def reference(toy, sun, stderr=0.0, nm=NM, seed=1):
    elevation, azimuth = stratified_directions((30, 120), 40)
    right = toy.truth(sun, elevation, azimuth, nm)
    noise = 1.0 + stderr * np.random.default_rng(seed).standard_normal(right.shape)
    return ReferenceSolution(elevation, azimuth, np.array(nm), right * noise, stderr * right)


def scene(**solver):
    return load(SCENE | {"solver": {"name": "toy", **solver}})


# Statistics -----------------------------------------------------------------------------------------------------


def test_a_table_of_references_survives_the_file(toy, tmp_path):
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


def test_the_ladder_names_solvers_and_qualities(toy):
    assert ladder(["toy"]) == [Rung("toy", "draft"), Rung("toy", "standard")]
    assert ladder(["toy:draft", " toy "]) == [Rung("toy", "draft"), Rung("toy", "standard")]
    assert {r.solver for r in ladder(None)} == set(solvers.installed())
    for names, says in ((["tiy"], "did you mean toy"), (["toy:fine"], "quality of toy")):
        with pytest.raises(TwilightError, match=says):
            ladder(names)


def test_options_of_the_scene_stay_with_the_solver_that_it_names(toy):
    config = scene(error_percent=3.0)
    assert with_rung(config, Rung("toy", "draft")).solver["error_percent"] == 3.0
    assert "error_percent" not in with_rung(config, Rung("cells", "draft")).solver


# Workers --------------------------------------------------------------------------------------------------------


def job(toy, suns=(5.0, -6.0), repeats=1, **solver):
    directions = {sun: SampleDirections((10.0, 80.0), (0.0, 90.0)) for sun in suns}
    return Job(scene(**solver), tuple(suns), directions, repeats=repeats)


def test_a_job_gives_radiances_times_and_memory_and_is_kept(toy, tmp_path, monkeypatch):
    work = Bench(tmp_path / "rows")
    outcomes = work.measure(job(toy, repeats=2, wait_s=0.05, hold_mib=100))
    for sun, outcome in outcomes.items():
        assert np.allclose(outcome.radiance, 1.01 * toy.truth(sun, (10.0, 80.0), (0.0, 90.0), NM))
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
        work.measure(job(toy, repeats=2, wait_s=0.05, hold_mib=100, error_percent=2.0))


@pytest.mark.slow
def test_damaged_results_are_made_again(toy, tmp_path):
    work = Bench(tmp_path / "rows")
    first = work.measure(job(toy, suns=(5.0,)))
    radiance, timing = sorted((tmp_path / "rows").iterdir())
    radiance.write_text('{"radiance": [[1, "x"')
    timing.write_text('{"timing": {"a": 1}}')
    again = work.measure(job(toy, suns=(5.0,)))
    assert np.array_equal(first[5.0].radiance, again[5.0].radiance) and again[5.0].timing is not None


@pytest.mark.slow
def test_wavelengths_of_a_stored_reference_are_computed_apart(toy, tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_LOG", str(tmp_path / "log"))
    directions = SampleDirections((10.0,), (0.0,), (500.0, 600.0))
    outcome = Bench(tmp_path / "rows").measure(Job(scene(), (5.0,), {5.0: directions}, repeats=1))[5.0]
    assert np.allclose(outcome.radiance, 1.01 * toy.truth(5.0, [10.0], [0.0], (500.0, 600.0)))
    counts = [int(line.split()[0]) for line in (tmp_path / "log").read_text().splitlines()]
    assert counts == [1, 3, 2]  # warming up, the timed run, the reference's wavelengths


@pytest.mark.parametrize("solver, says", (({"crash": True}, "the toy broke"), ({"wait_s": 20.0}, "stopped after 4 s")))
def test_a_solver_that_breaks_or_lasts_is_a_reason(toy, tmp_path, solver, says):
    limit_s = 4.0 if "wait_s" in solver else 100.0
    outcome = Bench(tmp_path / "rows", time_limit_s=limit_s).measure(job(toy, suns=(5.0,), **solver))[5.0]
    assert outcome.radiance is None and says in outcome.reason


def test_a_time_limit_is_remembered_until_it_grows(toy, tmp_path, monkeypatch):
    slow = job(toy, suns=(5.0,), wait_s=1.5)
    assert Bench(tmp_path / "rows", 1.0).measure(slow)[5.0].reason
    started = []
    monkeypatch.setattr(bench_module, "_Worker", lambda *a: started.append(a) or pytest.fail("a worker was started"))
    assert Bench(tmp_path / "rows", 1.0).measure(slow)[5.0].reason and not started
    monkeypatch.undo()


def test_known_errors_come_out_and_refused_suns_are_listed(toy, tmp_path):
    references = {sun: reference(toy, sun, stderr=0.002) for sun in (5.0, -12.0)}
    rows = [
        r for found in compare(scene(), ladder(["toy"]), references, Bench(tmp_path / "rows"), repeats=1) for r in found
    ]
    by = {(r.rung.quality, r.sun_elevation_deg): r for r in rows}
    assert by["draft", 5.0].error.median == pytest.approx(10.0, rel=0.02)
    assert by["standard", 5.0].error.mean == pytest.approx(1.0, abs=0.1)
    assert by["standard", 5.0].colour.luminance.median == pytest.approx(1.0, abs=0.3)
    assert set(by["draft", 5.0].by_wavelength) == set(NM)
    for quality in ("draft", "standard"):
        assert by[quality, -12.0].error is None and "-10 deg or higher" in by[quality, -12.0].reason


# The command ----------------------------------------------------------------------------------------------------


@pytest.fixture
def files(toy, tmp_path):
    """A scene's file and a table of references for two suns."""
    path = tmp_path / "air.yaml"
    path.write_text("version: 1\nclimate: {version: 1, name: air}\nwavelengths: {list_nm: [450, 550, 680]}\n")
    write_references(tmp_path / "right.csv", {sun: reference(toy, sun, stderr=0.003) for sun in (5.0, -6.0)})
    return path, tmp_path / "right.csv", tmp_path / "out"


def test_the_command_writes_tables_and_a_picture(files):
    path, right, out = files
    arguments = ["compare", str(path), "--solvers", "toy", "--reference", str(right), "--output", str(out)]
    result = CliRunner().invoke(app, [*arguments, "--repeats", "1"])
    assert result.exit_code == 0, result.output
    with open(out / "compare.csv") as stream:
        rows = list(csv.DictReader(stream))
    assert [(r["quality"], r["sun_elevation_deg"]) for r in rows] == [
        (q, s) for q in ("draft", "standard") for s in ("5", "-6")
    ]
    for row in rows:
        true_percent = 10.0 if row["quality"] == "draft" else 1.0
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


def test_radiances_computed_elsewhere_are_a_row_and_a_line(files, toy, tmp_path):
    """Those of the reference, 5 % brighter, by sun, direction and wavelength."""
    path, right, out = files
    with open(right) as stream:
        rows = list(csv.DictReader(stream))
    lines = [[r[c] for c in COLUMNS[:4]] + [repr(1.05 * float(r["radiance_per_sr"]))] for r in rows]
    mine = tmp_path / "mine.csv"
    mine.write_text("\n".join(",".join(line) for line in [COLUMNS[:5], *lines]))
    arguments = ["compare", str(path), "--solvers", "toy:draft", "--reference", str(right), "--output", str(out)]
    result = CliRunner().invoke(app, [*arguments, "--repeats", "1", "--add", f"my code={mine}"])
    assert result.exit_code == 0, result.output
    with open(out / "compare.csv") as stream:
        found = [r for r in csv.DictReader(stream) if r["solver"] == "my code"]
    assert [r["sun_elevation_deg"] for r in found] == ["5", "-6"] and "my code added" in result.output
    assert all(float(r["mean_percent"]) == pytest.approx(5.0, abs=0.15) and not r["time_s"] for r in found)
    marks = [FigurePoint("toy", "draft", 5.0, 1.0, 10.0), FigurePoint("my code", "added", 5.0, math.nan, 5.0)]
    assert (
        draw(marks, tmp_path / "a.png") and draw(marks[:1], tmp_path / "b.png") and not draw(marks[1:], tmp_path / "c")
    )
    with_line, without = (np.asarray(Image.open(tmp_path / f"{n}.png").convert("RGB")) for n in "ab")
    dashes = (with_line == (0xD5, 0x5E, 0x00)).all(axis=2)
    assert dashes.sum(axis=1).max() > 100 and not (without == (0xD5, 0x5E, 0x00)).all(axis=2).any()


@pytest.mark.parametrize(
    "arguments, says",
    (
        (["--add", "missing.csv"], "missing.csv: cannot be read"),
        (["--solvers", "tiy"], "did you mean toy"),
        (["--sun-elevation", "5,x"], "numbers with commas"),
        (["--sun-elevation", "95"], "from -90 to 90"),
        (["--sun-elevation", "4"], "no sun at 4 deg; it has 5, -6"),
        (["--reference", "missing.csv"], "cannot be read"),
        (["--reference-stderr", "0"], "--reference-stderr"),
        (["--directions", "0"], "--directions"),
        (["--time-limit", "nan"], "--time-limit"),
        (["--repeats", "0"], "--repeats"),
        (["--ablations"], "takes no --solvers"),
        (["--set", "vary={observer.altitude_km: [0, 1]}"], "series of 2 scenes"),
    ),
)
def test_bad_arguments_are_one_sentence(files, arguments, says):
    path, right, out = files
    fixed = ["compare", str(path), "--solvers", "toy", "--reference", str(right), "--output", str(out)]
    result = CliRunner().invoke(app, [*fixed, *arguments])
    assert result.exit_code == 2 and says in result.output, result.output
    assert "Traceback" not in result.output and not out.exists()


@pytest.mark.slow
def test_an_interrupt_keeps_what_is_finished_and_ends_the_worker(files, monkeypatch):
    path, right, out = files
    log = out.with_name("log")
    program = (
        "from twilight import solvers; solvers.SOLVERS['toy'] = 'toy_compared'; from twilight.cli import main; main()"
    )
    settings = ["--set", "solver.name=toy", "--set", "solver.wait_s=1.0"]
    arguments = ["compare", str(path), "--solvers", "toy:draft", "--reference", str(right), "--output", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-c", program, *arguments, *settings, "--repeats", "1"],
        env={**os.environ, "TOY_LOG": str(log)},
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
    worker = int(log.read_text().split()[-1])
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)
    kept = {f.name: f.read_bytes() for f in out.glob("rows/*")}
    assert any("radiance" in name for name in kept) and not any(".part" in name for name in kept)
    before = len(log.read_text().splitlines())
    result = CliRunner().invoke(app, [*arguments, *settings, "--repeats", "1"], env={"TOY_LOG": str(log)})
    assert result.exit_code == 0, result.output
    assert all((out / "rows" / name).read_bytes() == content for name, content in kept.items())
    assert len(log.read_text().splitlines()) > before


# Ablations, reference solution ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_an_ablation_is_the_difference_of_two_runs(toy, tmp_path):
    base = {"solver.name": "toy"}
    ablations = (
        Ablation("worse", {**base, "solver.error_percent": 3.0}, base),
        Ablation("top", {**base, "atmosphere.top_km": 500.0}, base),
    )
    found = list(ablate(SCENE, {}, (5.0, -12.0), Bench(tmp_path / "rows"), ablations=ablations))
    day, deep = found[0]
    for percent in (day.difference.median, day.difference.largest, day.difference.mean):
        assert percent == pytest.approx(100.0 * (1.03 / 1.01 - 1.0))
    assert day.colour.luminance.mean == pytest.approx(100.0 * (1.03 / 1.01 - 1.0))
    assert "-10 deg or higher" in deep.reason
    assert "top_km" in found[1][0].reason


def test_every_ablation_is_a_configuration_that_can_be_read():
    assert len({a.name for a in ABLATIONS}) == len(ABLATIONS)
    for ablation in ABLATIONS:
        simple, full = load("continental-average", ablation.settings), load("continental-average", ablation.against)
        assert simple != full, ablation.name


def test_the_reference_solver_caches_each_sun(tmp_path, monkeypatch):
    config = load({"version": 1, "climate": "pure-air", "wavelengths": {"list_nm": [550.0]}})
    reference_solver = ReferenceSolver(config, tmp_path / "rows", 0.05)
    directions = (np.array([10.0, 60.0]), np.array([0.0, 90.0]))
    shares = []
    found = reference_solver.references([5.0], directions, lambda doing, share: shares.append(share))
    assert found[5.0].radiance.shape == (2, 1) and (found[5.0].radiance > 0).all()
    assert (found[5.0].standard_error < 0.1 * found[5.0].radiance).all()
    assert shares and max(shares) <= 1.0
    monkeypatch.setattr(solvers.load("montecarlo"), "prepare", None)
    again = reference_solver.references([5.0], directions, lambda doing, share: None)
    assert np.array_equal(again[5.0].radiance, found[5.0].radiance)
    with pytest.raises(TypeError):
        replace(reference_solver, target_stderr=0.04).references([5.0], directions, lambda doing, share: None)
