"""Sentences of solvers name their options as a configuration has them."""

import ast
import re
from pathlib import Path

import pytest

import twilight
from twilight import solvers
from twilight.config.solver import option_names

FOLDER = Path(twilight.__file__).parent / "solvers"


def texts(path):
    """The pieces of text in a module that are no docstrings, with their lines."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose:
            yield node.lineno, node.value


@pytest.mark.parametrize("name", [n for n, module in solvers.SOLVERS.items() if module.startswith("twilight.")])
def test_an_option_for_experts_is_called_so(name):
    """Said while a field is prepared, `solver.NAME` would be refused by the next run."""
    modules = solvers.SOLVERS[name].split(".")[2:]
    place = FOLDER / modules[0]
    paths = sorted(place.rglob("*.py")) if place.is_dir() and modules[0] != "analytic" else []
    paths += [p for p in [FOLDER.joinpath(*modules).with_suffix(".py")] if p.is_file()]
    assert paths
    common, expert = option_names(solvers.load(name).QUALITIES["standard"])
    for path in paths:
        for line, text in texts(path):
            for word in re.findall(r"\bsolver\.(\w+)", text):
                assert word not in expert, f"{path.name}:{line}: solver.{word} is solver.expert.{word}"
            for word in re.findall(r"\bsolver\.expert\.(\w+)", text):
                assert word in expert and word not in common, f"{path.name}:{line}: solver.{word} is no expert's"
