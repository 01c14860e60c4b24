"""The sentence of the first run."""

from __future__ import annotations

import sys

import numpy as np
from hazy_zones import REFERENCE, SMALL

from twilight import solvers
from twilight.atmosphere.medium_table import medium_from_table
from twilight.cli.first_run import SENTENCE, compiles_first, say_that_it_compiles
from twilight.jit import precompile
from twilight.solvers import zones
from twilight.solvers.zones import precompile as zones_kernels
from twilight.solvers.zones.aureole import widen
from twilight.solvers.zones.line_integrals import view_multiple
from twilight.transport.beam import beam_at
from twilight.transport.sunlit import scattered_once

KERNEL = """
from numba import njit
from twilight.solvers.base import Capabilities

CAPABILITIES = Capabilities(precompile_module="json.tool")

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
    begun = []
    monkeypatch.setattr(precompile, "start", begun.append)
    say_that_it_compiles("fresh")
    assert SENTENCE in capsys.readouterr().err and begun == ["json.tool"]
    fresh_solver.double(1.0)
    say_that_it_compiles("fresh")
    assert capsys.readouterr().err == "" and len(begun) == 1


def test_a_second_process_is_waited_for_and_only_where_there_are_two_cores(tmp_path, monkeypatch):
    (tmp_path / "beside.py").write_text("import time, pathlib\ntime.sleep(0.5)\npathlib.Path('done').touch()\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(precompile, "cores", lambda: 1)
    assert not precompile.start("beside")
    monkeypatch.setattr(precompile, "cores", lambda: 2)
    assert precompile.start("beside") and not precompile.start("beside")
    assert not (tmp_path / "done").exists()
    precompile.wait()
    assert (tmp_path / "done").exists()
    assert precompile.start("there_is_no_such_module")
    precompile.wait()  # a process that failed leaves the work to this one
    precompile.wait()


def test_what_is_compiled_ahead_is_what_a_look_calls():
    """The types of the arguments in `zones.precompile` are those of a field: a look at one compiles nothing
    more."""
    zones_kernels.compile_evaluation()
    kernels = (beam_at, scattered_once, widen, view_multiple)
    before = [set(kernel.signatures) for kernel in kernels]
    field = zones.prepare(medium_from_table(REFERENCE / "hazy-air.csv", wavelength_nm=np.array([550.0])), SMALL)
    field.radiance(-4.0, [5.0, 40.0], [10.0, 120.0])
    assert [set(kernel.signatures) for kernel in kernels] == before
    assert all(len(signatures) == 1 for signatures in before)
