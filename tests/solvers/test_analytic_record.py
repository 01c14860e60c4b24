"""What is written down about an analytic sky: the coefficients of a file by their content, the turbidity in use."""

import hashlib
from importlib import resources
from pathlib import Path

import pytest

from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.config.load import load_axes
from twilight.config.sun import SunElevation
from twilight.engine import run
from twilight.scene import resolve
from twilight.scene.scene import resolved_configuration
from twilight.studies.sweep.sweep import Sweep

SUN = {"sun.elevation_deg": 30.0, "solver.name": "preetham", "texture.resolution_deg": 30.0}


def coefficients(folder: Path, text: str = "") -> Path:
    shipped = resources.files("twilight").joinpath("data/analytic/perez_preetham1999.yaml").read_text(encoding="utf-8")
    path = folder / "mine.yaml"
    path.write_text(shipped + text, encoding="utf-8")
    return path


def recorded(path: Path) -> dict:
    config = load("continental-average", SUN | {"solver.coefficients": str(path)})
    return resolved_configuration(config, SunElevation(elevation_deg=30.0))["solver"]


def test_coefficients_of_a_file_are_recorded_by_name_and_content(tmp_path):
    """A record would name a path, or not notice that the file changed."""
    path = coefficients(tmp_path)
    before = recorded(path)
    assert before["coefficients"] == "mine.yaml"
    assert before["coefficients_sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    assert recorded(coefficients(elsewhere)) == before
    assert recorded(coefficients(tmp_path, "# changed\n")) != before


def test_a_shipped_set_is_recorded_by_its_name():
    """A shipped set would be recorded as a file."""
    config = load("continental-average", SUN | {"solver.coefficients": "continental-average"})
    solver = resolved_configuration(config, SunElevation(elevation_deg=30.0))["solver"]
    assert (solver["coefficients"], solver["coefficients_sha256"]) == ("continental-average", "")


def test_other_coefficients_than_recorded_are_refused(tmp_path):
    """A record would be repeated with other coefficients."""
    path = coefficients(tmp_path)
    sha256 = recorded(path)["coefficients_sha256"]
    wanted = SUN | {"solver.coefficients": str(path), "solver.coefficients_sha256": sha256}
    assert run(resolve(load("continental-average", wanted))).radiance.min() > 0.0
    coefficients(tmp_path, "# changed\n")
    with pytest.raises(TwilightError, match=r"mine\.yaml: is not the file that solver\.coefficients_sha256 names"):
        run(resolve(load("continental-average", wanted)))


def test_a_sweep_sees_that_coefficients_changed(tmp_path):
    """A sweep would go on with results of other coefficients."""

    def keys(path: Path) -> set[str]:
        axes = load_axes("continental-average", SUN | {"solver.coefficients": str(path)})
        return {task.key for task in Sweep(axes).tasks}

    before = keys(coefficients(tmp_path))
    assert keys(coefficients(tmp_path)) == before
    assert keys(coefficients(tmp_path, "# changed\n")) != before


def test_the_turbidity_in_use_is_in_the_record():
    """A record would not say with which turbidity the sky was made."""
    asked = run(resolve(load("continental-average", SUN | {"solver.turbidity": 3.0})))
    assert asked.provenance["model"] == {"turbidity": 3.0}
    own = run(resolve(load("continental-average", SUN))).provenance["model"]
    assert 2.0 < own["turbidity"] == own["medium_turbidity"] < 6.0
