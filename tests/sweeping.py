"""What the tests of sweeps share: the toy solver of `toy_solver`, its scene, and what it must give."""

import os
from pathlib import Path

import numpy as np
import pytest

from twilight import solvers
from twilight.config.load import load_axes
from twilight.studies.sweep.store import open_store
from twilight.studies.sweep.sweep import Sweep

BASE = {
    "version": 1, "climate": {"version": 1, "name": "air"}, "solver": {"name": "toy"},
    "wavelengths": {"list_nm": [450.0, 600.0]}, "texture": {"azimuth_count": 8, "elevation_count": 3},
    "sun": {"elevation_deg": -5},
}  # fmt: skip
SUNS = [-4.0, -5.0, -6.0]


@pytest.fixture(scope="module")
def toy():
    """The module of the toy solver, here and in every worker that is started."""
    folder = Path(__file__).parent
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        paths = [str(folder), *([os.environ["PYTHONPATH"]] if os.environ.get("PYTHONPATH") else [])]
        patch.setenv("PYTHONPATH", os.pathsep.join(paths))
        patch.setenv("DASK_DISTRIBUTED__WORKER__PRELOAD", "['toy_solver']")
        patch.setitem(solvers.SOLVERS, "toy", "toy_solver")
        import toy_solver

        yield toy_solver


@pytest.fixture
def log(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_LOG", str(tmp_path / "log"))
    return tmp_path / "log"


def right(toy, data, factor=1.0, albedo=0.0, altitude=0.0):
    """What the dataset's radiance must be for all its suns, in their order."""
    e, a = np.meshgrid(data.elevation.values, data.azimuth.values, indexing="ij")
    suns = np.atleast_1d(data.sun_elevation_deg.values)
    return np.stack([toy.truth(factor, albedo, sun, altitude, e, a, data.wavelength.values) for sun in suns])


@pytest.fixture(scope="module")
def client(toy):
    """Workers that are threads of this process: a cluster without its start."""
    import distributed

    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster, set_as_default=False) as made,
    ):
        yield made


def planned(vary, **changes):
    return Sweep(load_axes({**BASE, **changes, "vary": vary}))


def swept(sweep, client, path):
    from twilight.studies.sweep.run import failures, run_sweep

    with open_store(path, sweep) as store:
        outcome = run_sweep(client, store, threads=1)
        return outcome, dict(failures(store, outcome))
