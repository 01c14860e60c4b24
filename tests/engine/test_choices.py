"""What `--plan` says of the error of a scene by each quality, beside its time."""

import math

import pytest

from twilight.config import load
from twilight.engine.choices import choices
from twilight.scene import resolve
from twilight.solvers.zones.solver import MEASURED_ERRORS, SAFETY_FACTORS


def of(name, **settings):
    scene = resolve(load(name, {key.replace("__", "."): value for key, value in settings.items()}), for_plan=True)
    return {f"{one.solver} {one.quality}": one for one in choices(scene)}


@pytest.mark.parametrize(("sun", "part"), [(-4.0, "day"), (-10.0, "twilight"), (-18.0, "deep")])
def test_errors_are_those_behind_target_error(sun, part):
    """A user would decide by another table than `--target-error`, or by that of another sun."""
    found = of("continental-average", sun__elevation_deg=sun)
    for quality, errors in MEASURED_ERRORS.items():
        largest = max(errors["fine"][: errors["fine"]._fields.index(part) + 1])
        assert found[f"zones {quality}"].error == pytest.approx(0.01 * SAFETY_FACTORS["fine"] * largest)
    assert [one.chosen for one in found.values()] == [False, True, False, False]
    model, slower = found["compact standard"], found["zones reference"]
    assert 1e-3 < model.error < 0.08
    assert model.cost.cpu_s < found["zones draft"].cost.cpu_s < slower.cost.cpu_s


def test_what_was_not_measured_has_no_error():
    """An overcast sky, scalar theory or grids of one's own would be promised the errors of clear air."""
    overcast = of("overcast-stratus", sun__elevation_deg=30.0)
    assert all(one.error == math.inf for name, one in overcast.items() if name.startswith("zones"))
    assert "without clouds" in overcast["compact standard"].reason
    scalar = of("pure-air", sun__elevation_deg=5.0, solver={"name": "zones", "polarisation": False})
    assert all(one.error == math.inf for name, one in scalar.items() if name.startswith("zones"))
    own = of("pure-air", sun__elevation_deg=5.0, solver={"name": "zones", "expert": {"degree": 12}})
    assert own["zones standard"].error == math.inf and own["zones draft"].error < 0.05
    assert of("haber2005")["cells draft"].error is None


def test_a_target_has_a_row_of_its_own():
    """The quality that a target takes would be told as that of the configuration."""
    found = of("pure-air", sun__elevation_deg=5.0, solver={"name": "zones", "target_error": 0.03})
    assert found["zones to 0.03"].chosen and not found["zones standard"].chosen
    assert found["zones to 0.03"].error == found["zones draft"].error <= 0.03
