"""Options of solvers: the first ones right under `solver`, the others under `solver.expert`, alike everywhere."""

import re
from dataclasses import fields, replace

import pytest

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.sections import option_fields, option_name
from twilight.config import load
from twilight.config.solver import complete_solver, option_names
from twilight.scene.scene import resolved_configuration

MOST_FIRST = 6


@pytest.mark.parametrize("name", solvers.SOLVERS.own)
def test_at_most_six_options_stand_first_and_each_stands_once(name):
    """More would hide the few that a user may want to set."""
    settings = solvers.load(name).QUALITIES["standard"]
    first, expert = option_names(settings)
    assert len(first) <= MOST_FIRST and sorted([*first, *expert]) == sorted(f.name for f in fields(settings))


def test_options_for_experts_are_set_under_expert():
    """They are read from there, and from nowhere else."""
    chosen = load("urban", {"solver.expert.tolerance": 0.02, "solver.max_orders": 3}).chosen_solver
    assert (chosen.settings.tolerance, chosen.settings.max_orders) == (0.02, 3)
    document = {"version": 1, "climate": "urban", "solver": {"quality": "draft", "expert": {"tolerance": 0.02}}}
    assert load(document).chosen_solver.settings.tolerance == 0.02


@pytest.mark.parametrize("name", solvers.SOLVERS.own)
def test_an_option_beyond_its_limits_is_named(name):
    """Impossible settings would end in a traceback of numpy."""
    preset = solvers.load(name).QUALITIES["standard"]
    for option, info in option_fields(preset).items():
        assert len(info.description) > 5, option
        limits = {key: getattr(m, key) for m in info.metadata for key in ("ge", "le") if hasattr(m, key)}
        beyond = [value + (1 if key == "le" else -1) for key, value in limits.items()]
        for value in beyond or [object()]:
            with pytest.raises(TwilightError, match=rf"^{re.escape(option_name(preset, option))} must be .*, got "):
                replace(preset, **{option: value})


def test_the_record_can_be_read_again():
    """A file's record would be refused as a configuration."""
    config = load("urban", {"solver.expert.tolerance": 0.02, "sun.elevation_deg": 3})
    record = resolved_configuration(config, config.sun)
    assert record["solver"]["expert"]["tolerance"] == 0.02 and "tolerance" not in record["solver"]
    assert load(record).chosen_solver == config.chosen_solver
    assert complete_solver(record["solver"]) == record["solver"]
