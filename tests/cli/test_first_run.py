"""The sentence of the first run."""

import sys

from twilight import solvers
from twilight.cli.compiling import SENTENCE, announce_compiling, must_compile

KERNEL = """
from twilight.jit.kernels import njit

@njit(cache=True)
def double(x):
    return 2.0 * x
"""


def test_a_package_must_be_compiled_until_machine_code_of_a_kernel_is_cached(tmp_path, monkeypatch):
    """A first run would compile for a minute without a word."""
    (tmp_path / "fresh_kernels.py").write_text(KERNEL)
    monkeypatch.syspath_prepend(tmp_path)
    import fresh_kernels

    assert must_compile("fresh_kernels")
    assert fresh_kernels.double(1.5) == 3.0
    assert not must_compile("fresh_kernels")
    assert not must_compile("json")  # nothing to compile


def test_the_sentence_is_said_once_at_the_first_run(tmp_path, monkeypatch, capsys):
    """Every run would say that it compiles."""
    (tmp_path / "fresh_solver.py").write_text(KERNEL)
    monkeypatch.syspath_prepend(tmp_path)
    import fresh_solver

    monkeypatch.setitem(solvers.SOLVERS, "fresh", "fresh_solver")
    monkeypatch.setattr(solvers, "load", lambda name: sys.modules["fresh_solver"])
    announce_compiling("fresh")
    assert SENTENCE in capsys.readouterr().err
    fresh_solver.double(1.0)
    announce_compiling("fresh")
    assert capsys.readouterr().err == ""
