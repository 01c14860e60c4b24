"""Options of solvers: the first ones right under `solver`, the others under `solver.expert`, alike everywhere."""

from __future__ import annotations

from dataclasses import fields

import pytest

from twilight import solvers
from twilight.base.errors import TwilightError
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


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"solver.degree": 7}, r"solver\.degree is an option for experts: write solver\.expert\.degree"),
        ({"solver.expert.max_orders": 3}, r"expert\.max_orders stands among the first: write solver\.max_orders"),
        ({"solver.expert.degrees": 7}, r"solver\.expert\.degrees is not a key of zones; did you mean degree\?"),
        ({"solver.expert": 7}, r"solver\.expert must be a mapping of options of zones, got 7"),
        ({"solver.expert.degree": "many"}, r"solver\.expert\.degree must be a whole number from 2 to 48, got 'many'"),
        (
            {"solver.expert.degree": 1},
            r"setting solver.expert.degree: solver\.expert\.degree must be .* from 2 to 48, got 1",
        ),
        ({"solver.name": "cie", "solver.turbid": 3}, r"solver\.turbid is not a key of cie; did you mean turbidity\?"),
    ],
)
def test_a_slip_says_where_the_option_stands(settings, says):
    with pytest.raises(TwilightError, match=says):
        load("urban", settings)


def test_the_record_can_be_read_again():
    """A file's record would be refused as a configuration."""
    config = load("urban", {"solver.expert.tolerance": 0.02, "sun.elevation_deg": 3})
    record = resolved_configuration(config, config.sun)
    assert record["solver"]["expert"]["tolerance"] == 0.02 and "tolerance" not in record["solver"]
    assert load(record).chosen_solver == config.chosen_solver
    assert complete_solver(record["solver"]) == record["solver"]
