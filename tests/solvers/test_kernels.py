"""Kernels: every argument is explained, inner ones refuse calls from Python, untested versions of numba are refused."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.caching import IndexDataCacheFile

import twilight
from twilight.base.errors import TwilightError
from twilight.jit.kernels import OLDEST_NUMBA, UNTESTED_NUMBA, check_numba, njit

PACKAGE = Path(twilight.__file__).parent
ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(PACKAGE.parent)}


def test_a_kernel_that_is_said_to_make_no_arrays_makes_none():
    """A kernel without reference counts that makes an array would leak it."""
    made = njit(makes_arrays=False)(lambda n: np.empty(n).size)
    with pytest.raises(numba.TypingError):
        made(3)
    assert njit()(lambda n: np.empty(n).size)(3) == 3


INNER = """
from twilight.jit.kernels import njit

@njit(inner=True)
def half(x):
    "Of a number."
    return 0.5 * x if x < 8.0 else half(0.5 * x)

@njit()
def quarter(x):
    return 0.5 * half(x)

assert quarter(4.0) == 1.0 and quarter(16.0) == 1.0 and half.py_func(4.0) == 2.0 and half.__doc__ == "Of a number."
half(4.0)
"""


def test_python_cannot_call_an_inner_kernel():
    """numba itself would end the process, for such a kernel has no function for Python."""
    done = subprocess.run([sys.executable, "-c", INNER], env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 1 and done.stderr.splitlines()[-1].startswith("TypeError: half is an inner kernel")


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
