"""Kernels: every argument is explained, and those that have no function for Python are called by kernels alone."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numba
import numpy as np
import pytest

import twilight
from twilight.kernels import njit

PACKAGE = Path(twilight.__file__).parent
CALLERS = (PACKAGE, Path(__file__).parent, Path(__file__).parents[1] / "benchmarks")
SHARED = re.compile(r"Arguments\s+that\s+kernels\s+share:\s+`(\w+)`")
"""A file's head refers with these words to the module beside it that explains what kernels share."""


def decorator(function: ast.FunctionDef) -> str:
    """The `njit(...)` of a kernel, empty for other functions."""
    found = [ast.unparse(d) for d in function.decorator_list]
    return next((text for text in found if re.match(r"(numba\.)?njit\b", text)), "")


def trees(*folders: Path):
    for folder in folders:
        for path in sorted(folder.rglob("*.py")):
            yield path, ast.parse(path.read_text(encoding="utf-8"))


def head(path: Path) -> str:
    return ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""


def explained(name: str, text: str) -> bool:
    """Whether `name` stands in a list of arguments (`name:`, `name, other (3,) [km]:`), a tuple, a range or code marks.

    A mere word of a sentence does not count: first, out and end are words.
    """
    return re.search(rf"(?<![\w.]){name}(`|\)|,|:|=|\[|\.\.|\s\(|\s\[)|\w\.\.{name}\b", text) is not None


def test_every_argument_of_a_kernel_is_explained():
    """In its own text, in the head of its file, or where that head sends the reader."""
    counted, missing = 0, []
    for path, tree in trees(PACKAGE):
        heads = [head(path)]
        heads += [head(path.parent / f"{module}.py") for module in SHARED.findall(heads[0])]
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and decorator(node):
                names = [a.arg for a in node.args.posonlyargs + node.args.args + node.args.kwonlyargs]
                texts = [ast.get_docstring(node) or "", *heads]
                left = [name for name in names if not any(explained(name, text) for text in texts)]
                counted += len(names)
                if left:
                    missing.append(f"{path.relative_to(PACKAGE)}: {node.name}: {', '.join(left)}")
    assert counted > 1000, "kernels are not found any more"
    assert not missing, "not explained:\n" + "\n".join(missing)


def test_a_kernel_that_is_said_to_make_no_arrays_makes_none():
    made = njit(makes_arrays=False)(lambda n: np.empty(n).size)
    with pytest.raises(numba.TypingError):
        made(3)
    assert njit()(lambda n: np.empty(n).size)(3) == 3


def test_a_word_of_a_sentence_explains_nothing():
    assert not explained("first", "the first thing that is seen")
    assert explained("first", "nodes first, end") and explained("z", "z, end [km]: altitudes")


class Names(ast.NodeVisitor):
    """Every name that is used outside kernels."""

    def __init__(self) -> None:
        self.used: set[str] = set()

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        if not decorator(node):
            self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> None:
        self.used.add(node.id)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if node.attr == "py_func" and isinstance(node.value, ast.Name):
            return
        self.used.add(node.attr)
        self.generic_visit(node)


def test_kernels_without_a_function_for_python_are_called_by_kernels_alone():
    """A call from Python would end the process.  By name: a kernel shares its name with no other function in use."""
    names, inner = Names(), {}
    for path, tree in trees(*CALLERS):
        names.visit(tree)
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and "inner=True" in decorator(node):
                inner[node.name] = path
    assert len(inner) > 50, "inner kernels are not found any more"
    assert not sorted(inner.keys() & names.used)
