"""Fixtures of several files, the order of files, thirds of the long tests; no test finds a field left on disk."""

import csv
import functools
import hashlib
import os
import pickle
import signal
import zlib
from pathlib import Path

# before numpy is imported (which a plugin of zarr's did: `pyproject.toml`); as in all that people call: what tests call
# below it waits for a second thread four times as long as one takes
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
import typer.testing
from hazy_zones import SCALAR
from rendering import plain, table
from sweeping import client, log, toy

from twilight.engine import sunbeam, view
from twilight.solvers import zones

os.environ["TWILIGHT_CACHE_GB"] = "0"
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # a shell's background job ignores it, and so would the programs that tests start and interrupt
    signal.signal(signal.SIGINT, signal.default_int_handler)

__all__ = ["client", "log", "plain", "table", "toy"]

LONG = (
    "test_montecarlo_walk", "test_cells", "test_all_suns", "test_stability_media", "test_neighbours",
    "test_montecarlo_plane", "test_montecarlo_polarised", "test_smoothness", "test_terrain", "test_tables",
    "test_zones_thick", "test_zones", "test_zones_layers", "test_window_access", "test_animate",
    "test_photo_estimate", "test_docs", "test_bands", "test_window", "test_zones_peaks", "test_cost",
    "test_montecarlo_single",
)  # fmt: skip
"""Files that take longest, of short tests or of long ones.  They go first, so that no process has one left when the
others are done; the first two compile different solvers, so that two processes do not compile the same one at once."""

PARTS = 3
COSTS = Path(__file__).parents[1] / "benchmarks" / "results" / "slow_tests.csv"
"""Processor time [s] of each file's long tests, written by `python benchmarks/reliability.py`."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--third",
        type=int,
        choices=range(PARTS),
        help="of the long tests only this third: files, spread by their recorded processor time; others one by one",
    )


def parts() -> dict[str, int]:
    """The part of every file of long tests whose cost is known: the dearest first, each to the cheapest part."""
    with open(COSTS, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    found, seconds = {}, [0.0] * PARTS
    for row in sorted(rows, key=lambda row: (-float(row["processor_s"]), row["file"])):
        part = seconds.index(min(seconds))
        found[row["file"]] = part
        seconds[part] += float(row["processor_s"])
    return found


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    places = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path.stem, len(LONG)))
    wanted = config.getoption("--third")
    if wanted is None:
        return
    known = parts()

    def elsewhere(item: pytest.Item) -> bool:
        part = known.get(item.path.name, zlib.crc32(item.nodeid.encode()) % PARTS)
        return item.get_closest_marker("slow") is not None and part != wanted

    config.hook.pytest_deselected(items=[item for item in items if elsewhere(item)])
    items[:] = [item for item in items if not elsewhere(item)]


@pytest.fixture
def coarse_draft(monkeypatch):
    """`draft` of `zones` is coarser than it is, for tests of what is done with a sky, whatever it looks like."""
    monkeypatch.setitem(zones.QUALITIES, "draft", SCALAR)


@pytest.fixture(scope="session", autouse=True)
def the_command_line_is_built_once():
    """`CliRunner` builds all commands with their options anew for every call, which takes 0.05 s."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.testing, "_get_command", functools.cache(typer.testing._get_command))
        yield


@pytest.fixture(scope="session", autouse=True)
def sunbeams_of_the_same_air_are_made_once():
    """The sunbeam of renders, films, pages and tables of export: its own take a second for each air, and have tests of
    their own.  Solvers make theirs."""
    made: dict[str, object] = {}
    real = sunbeam.prepare_beam

    def prepare_beam(medium, **options):
        shown = {k: v for k, v in vars(medium).items() if k != "phase_functions"}
        key = hashlib.sha256(pickle.dumps((sorted(shown.items()), sorted(options.items())))).hexdigest()
        if key not in made:
            made[key] = real(medium, **options)
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        for user in (sunbeam, view):
            patch.setattr(user, "prepare_beam", prepare_beam)
        yield
