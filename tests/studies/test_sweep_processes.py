"""Sweeps on real clusters: what is left when workers, clients, schedulers or users stop one."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from rendering import call
from sweeping import BASE, SUNS, right

from twilight.studies.sweep.store import JOURNAL


def command(path, out, *more):
    return [sys.executable, "-c", "import toy_solver; from twilight.cli import main; main()",
            "sweep", str(path), "--output", str(out), *more]  # fmt: skip


def start(arguments, log):
    return subprocess.Popen(
        arguments,
        env={**os.environ, "TOY_LOG": str(log)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def until(condition, seconds=600.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def lines(path):
    return path.read_text().splitlines() if path.exists() else []


def test_a_local_cluster_listens_to_this_machine_alone_and_shows_no_pages():
    """Others on the network could run code in a sweep."""
    from urllib.error import HTTPError
    from urllib.request import urlopen

    import psutil

    from twilight.studies.sweep.run import Resources, connect

    with connect(Resources(workers=1)) as client:
        processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
        open_to = {c.laddr.ip for p in processes for c in p.net_connections() if c.status == "LISTEN"}
        assert open_to == {"127.0.0.1"}
        known = client.scheduler_info(n_workers=-1)
        ports = [who["services"]["dashboard"] for who in (known, *known["workers"].values())]
        assert len(ports) == 2
        for port in ports:
            for page in ("", "status", "info/main/workers.html", "json/counts.json", "metrics"):
                with pytest.raises(HTTPError, match="404"):
                    urlopen(f"http://127.0.0.1:{port}/{page}", timeout=5)


@pytest.fixture
def slow_sweep(toy, tmp_path):
    """A file of six tasks of half a second and more."""
    path = tmp_path / "slow.yaml"
    vary = {"solver.factor": [1, 2, 3, 4, 5, 6], "sun.elevation_deg": SUNS}
    path.write_text(json.dumps({**BASE, "solver": {"name": "toy", "wait_s": 0.25}, "vary": vary}))
    return path, tmp_path / "out.zarr"


def assert_right(toy, out):
    with xr.open_zarr(out) as data:
        assert data.sun_normalised_radiance.chunks is not None  # lazy
        assert (data.status == 1).all()
        for i in range(6):
            assert np.allclose(data.sun_normalised_radiance.values[i], right(toy, data, i + 1), rtol=1e-6)


def test_a_killed_worker_then_a_killed_client_lose_only_their_tasks(toy, slow_sweep, log):
    """A killed process would cost finished skies."""
    path, out = slow_sweep
    process = start(command(path, out, "--workers", "2"), log)
    until(lambda: len(lines(log)) >= 3)
    pids = {int(line.split()[0]) for line in lines(log)}
    assert len(pids) == 2  # two workers took part
    os.kill(int(lines(log)[-1].split()[0]), signal.SIGKILL)
    until(lambda: len(lines(out / JOURNAL)) >= 4)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert len({line.split()[0] for line in lines(log)}) >= 2
    done = len(lines(out / JOURNAL))
    before = len(lines(log))
    result = subprocess.run(
        command(path, out, "--workers", "1"), env={**os.environ, "TOY_LOG": str(log)}, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stderr
    assert len(lines(log)) - before == 6 - done < 6
    assert_right(toy, out)


@pytest.mark.slow
def test_an_interrupt_stops_cleanly_and_a_dead_scheduler_is_a_sentence(toy, slow_sweep, log):
    """Ctrl-C or a dead scheduler would hang a sweep."""
    path, out = slow_sweep
    process = start(command(path, out, "--workers", "1"), log)
    until(lambda: len(lines(out / JOURNAL)) >= 1)
    os.killpg(process.pid, signal.SIGINT)
    error = process.communicate(timeout=300)[1]
    said = [line for line in error.splitlines() if " left: " not in line]  # progress, on a busy machine
    assert process.returncode == 130 and len(said) == 1 and "interrupted" in said[0], error
    with pytest.raises(ProcessLookupError):
        os.kill(int(lines(log)[0].split()[0]), 0)
    done = len(lines(out / JOURNAL))
    assert 1 <= done < 6

    address = out.with_name("scheduler.json")
    servers = [
        start([sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard",
               "--scheduler-file", str(address)], log),
    ]  # fmt: skip
    try:
        until(address.exists)
        servers.append(
            start([sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(address),
                   "--nthreads", "1", "--no-dashboard", "--no-nanny"], log)
        )  # fmt: skip
        where = json.loads(address.read_text())["address"]
        process = start(command(path, out, "--scheduler", where), log)
        until(lambda: len(lines(out / JOURNAL)) > done)
        servers[0].kill()
        error = process.communicate(timeout=300)[1]
        assert process.returncode == 2 and "the scheduler is gone" in error and "Traceback" not in error, error
    finally:
        for server in servers:
            server.kill()
            server.communicate()
    done = len(lines(out / JOURNAL))
    output, error = start(command(path, out, "--workers", "1"), log).communicate(timeout=300)
    assert f"({done} tasks were there)" in output and "failed" not in output, output + error
    assert_right(toy, out)


@pytest.mark.slow
def test_a_scheduler_that_is_not_there_is_a_sentence(toy, slow_sweep):
    """A wrong address would hang."""
    path, out = slow_sweep
    result = call("sweep", str(path), "--output", str(out), "--scheduler", "tcp://127.0.0.1:9")
    assert result.exit_code == 2 and "cannot be reached" in result.output, result.output


@pytest.mark.slow
def test_jobs_of_a_batch_system(toy, slow_sweep, log, tmp_path, monkeypatch):
    """Slurm's two commands, played by scripts: sbatch starts the job's script."""
    pytest.importorskip("dask_jobqueue")
    path, out = slow_sweep
    commands = tmp_path / "bin"
    commands.mkdir()
    for name, text in {
        "sbatch": f"""cp $1 {tmp_path}/job.sh  # which is deleted when sbatch returns
            setsid bash {tmp_path}/job.sh > {tmp_path}/job.log 2>&1 &
            echo $! > {tmp_path}/pid
            echo Submitted batch job 17""",
        "scancel": f"kill -- -$(cat {tmp_path}/pid)",
    }.items():
        (commands / name).write_text(f"#!/bin/bash\n{text}\n")
        (commands / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{commands}{os.pathsep}{os.environ['PATH']}")
    settings = tmp_path / "dask"
    settings.mkdir()
    (settings / "jobqueue.yaml").write_text(
        "jobqueue:\n  slurm: {name: twilight, cores: 1, memory: 2GB, walltime: '00:10:00', interface: lo}\n"
    )
    monkeypatch.setenv("DASK_CONFIG", str(settings))
    process = start(command(path, out, "--batch-system", "slurm", "--workers", "1"), log)
    output, error = process.communicate(timeout=600)
    assert process.returncode == 0, error + (tmp_path / "job.log").read_text()
    assert "18 skies in 6 tasks" in output
    assert_right(toy, out)
    assert Path(tmp_path / "pid").exists()
