"""Fixtures of several files, and the order of files; no test finds a field that another, or the user, left on disk."""

import hashlib
import os
import pickle
import signal

import pytest
from hazy_zones import SCALAR
from rendering import plain, table
from sweeping import log, toy

from twilight.engine import sunbeam
from twilight.solvers import zones

os.environ["TWILIGHT_CACHE_GB"] = "0"
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # a shell's background job ignores it, and so would the programs that tests start and interrupt
    signal.signal(signal.SIGINT, signal.default_int_handler)

__all__ = ["log", "plain", "table", "toy"]

LONG = (
    "test_zones",
    "test_montecarlo_walk",
    "test_cells",
    "test_readme",
    "test_bands",
    "test_tables",
    "test_sweep",
    "test_run",
    "test_stability_media",
    "test_photo_estimate",
    "test_energy",
    "test_compare",
    "test_photo",
)
"""Files that take longest.  They go first, so that no process has one left when the others are done; the first two
compile different solvers, so that two processes do not compile the same one at once."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    places = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path.stem, len(LONG)))


@pytest.fixture
def coarse_draft(monkeypatch):
    """`draft` of `zones` is coarser than it is, for tests of what is done with a sky, whatever it looks like."""
    monkeypatch.setitem(zones.QUALITIES, "draft", SCALAR)


@pytest.fixture(scope="session", autouse=True)
def sunbeams_of_the_same_air_are_made_once():
    """The direct light of rendered skies: its tables take a second for each air, and have tests of their own."""
    made: dict[str, object] = {}
    real = sunbeam.prepare_beam

    def prepare_beam(medium):
        shown = {k: v for k, v in vars(medium).items() if k != "phase_functions"}
        key = hashlib.sha256(pickle.dumps(sorted(shown.items()))).hexdigest()
        if key not in made:
            made[key] = real(medium)
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sunbeam, "prepare_beam", prepare_beam)
        yield
