"""Fixtures of more than one file; no test finds a field that another one, or the user, has left on disk."""

import hashlib
import os
import pickle

import pytest
from rendering import plain, table
from sweeping import log, toy

from twilight.engine import sunbeam

os.environ["TWILIGHT_CACHE_GB"] = "0"

__all__ = ["log", "plain", "table", "toy"]


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
