"""Kernels: known by what they are made of, inner ones too; untested versions of numba are refused."""

import importlib
import inspect
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numba.core.caching import IndexDataCacheFile

import twilight
from twilight.base.errors import TwilightError
from twilight.jit.ahead import described, listed, signature
from twilight.jit.kernels import OLDEST_NUMBA, UNTESTED_NUMBA, check_numba, njit
from twilight.jit.machine_code import digest_of

PACKAGE = Path(twilight.__file__).parent
ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(PACKAGE.parent)}


def test_a_kernel_that_is_said_to_make_no_arrays_makes_none():
    """A kernel without reference counts that makes an array would leak it."""
    made = njit(makes_arrays=False)(lambda n: np.empty(n).size)
    with pytest.raises(numba.TypingError):
        made(3)
    assert njit()(lambda n: np.empty(n).size)(3) == 3


def made(text: str, **names: Any) -> Any:
    """The kernel `f` of a text in which these names stand for something."""
    namespace = {"njit": njit, **names}
    exec(text, namespace)
    return namespace["f"]


HALF = "@njit(inner=True)\ndef f(x): return 0.5 * x if x < 8.0 else f(0.5 * x)"
SUM = "@njit()\ndef f(x): return g(x) + SIZE"


def test_python_may_call_an_inner_kernel():
    """A test or a debugger asks it; numba itself would end the process, for it has no function for Python."""
    half = made(HALF)
    assert half(4.0) == 2.0 and half(16.0) == 2.0 and made(SUM, g=half, SIZE=1.0)(4.0) == 3.0


def test_a_kernel_is_known_by_all_that_it_is_made_of():
    """Machine code of a kernel would outlive an edit of one that it calls in another file, or of a constant there."""
    half, third = made(HALF), made(HALF.replace("0.5 * x if", "0.3 * x if"))

    def digest(text: str = SUM, **changed: Any) -> str:
        return digest_of(made(text, **{"g": half, "SIZE": 1.0} | changed))

    others = [
        {"g": third},
        {"SIZE": 2.0},
        {"text": SUM.replace("+", "-")},
        {"text": SUM.replace("njit()", "njit(fastmath={'nsz', 'contract'})")},
    ]
    assert digest() == digest() and len({digest(), *(digest(**other) for other in others)}) == 1 + len(others)


def test_the_kernels_that_are_compiled_ahead_are_there():
    """A list that names kernels of long ago would compile nothing ahead."""
    assert set(listed()) >= {"zones", "cells"}
    for entries in listed().values():
        for module, name, kinds in entries:
            kernel = getattr(importlib.import_module(module), name)
            assert len(kinds) == len(inspect.signature(kernel.py_func).parameters)
            assert [described(kind) for kind in signature(kinds)] == kinds


def test_versions_of_numba_that_were_not_tested_are_refused():
    """The vectors of `twilight.jit.simd` are made of parts of numba that change between minor versions."""
    check_numba(numba.__version__)
    check_numba("{}.{}.7rc1".format(*OLDEST_NUMBA))
    for version in ("{}.{}.0".format(*UNTESTED_NUMBA), f"{OLDEST_NUMBA[0]}.{OLDEST_NUMBA[1] - 1}.9", "1.0"):
        with pytest.raises(TwilightError, match=rf"numba {version} is installed.*pip install \"numba>="):
            check_numba(version)


def test_pyproject_allows_the_versions_of_numba_that_are_not_refused():
    """pip would install a version that is then refused."""
    oldest, untested = (".".join(map(str, one)) for one in (OLDEST_NUMBA, UNTESTED_NUMBA))
    assert f'"numba>={oldest},<{untested}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


UNTESTED = """
import sys
import numba
numba.__version__ = "99.0.0"
sys.argv = ["twilight", "render", "pure-air", "--sun-elevation", "5", "--output", "nowhere"]
from twilight.cli import main
main()
"""


def test_the_command_line_refuses_a_version_in_one_sentence(tmp_path):
    """A version that was not tested would end in a traceback, or in wrong skies."""
    done = subprocess.run(
        [sys.executable, "-c", UNTESTED], env=ENVIRONMENT, cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("twilight: numba 99.0.0 is installed")


def test_machine_code_of_types_that_have_moved_counts_as_none(tmp_path):
    """Without, a version whose types have moved would end in an ImportError beside the caches of the one before."""
    file = IndexDataCacheFile(str(tmp_path), "kernel", "stamp")
    (tmp_path / "kernel.nbi").write_bytes(pickle.dumps(file._version) + b"ctwilight.moved\nAir\n.")
    assert file._load_index() == {}
