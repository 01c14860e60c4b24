"""The sentence of the first run."""

from __future__ import annotations

import sys

from twilight import solvers
from twilight.cli.first_run import SENTENCE, compiles_first, say_that_it_compiles

KERNEL = """
from numba import njit

@njit(cache=True)
def double(x):
    return 2.0 * x
"""


def test_a_package_compiles_first_until_a_kernel_of_it_is_kept(tmp_path, monkeypatch):
    (tmp_path / "fresh_kernels.py").write_text(KERNEL)
    monkeypatch.syspath_prepend(tmp_path)
    import fresh_kernels

    assert compiles_first("fresh_kernels")
    assert fresh_kernels.double(1.5) == 3.0
    assert not compiles_first("fresh_kernels")
    assert not compiles_first("json")  # nothing to compile


def test_the_sentence_is_said_once_at_the_first_run(tmp_path, monkeypatch, capsys):
    (tmp_path / "fresh_solver.py").write_text(KERNEL)
    monkeypatch.syspath_prepend(tmp_path)
    import fresh_solver

    monkeypatch.setitem(solvers.SOLVERS, "fresh", "fresh_solver")
    monkeypatch.setattr(solvers, "load", lambda name: sys.modules["fresh_solver"])
    say_that_it_compiles("fresh")
    assert SENTENCE in capsys.readouterr().err
    fresh_solver.double(1.0)
    say_that_it_compiles("fresh")
    assert capsys.readouterr().err == ""
