"""A pytest plugin: which assertions stand close to their bound.

    PYTHONPATH=tests pytest -p margins -o enable_assertion_pass_hook=true tests/files/test_lines.py

ends with a line for every comparison of two numbers, `pytest.approx` and `assert_allclose` that uses up more
than 1/1.5 of what it allows: the fraction, the test and the bound.  Bounds on counts and on equality have none.
"""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

NEAR = 1.0 / 1.5
_NUMBER = r"(?:np\.float\d+\()?(-?\d+\.?\d*(?:e[+-]?\d+)?)\)?"
_COMPARED = re.compile(rf"^{_NUMBER} (<=|<|>=|>) {_NUMBER}(?:$|\n| )")
_largest: dict[tuple[str, str], float] = {}
_running = [""]


def _note(fraction: float, bound: str) -> None:
    key = _running[0], bound
    _largest[key] = max(_largest.get(key, 0.0), fraction)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    _running[0] = item.nodeid.partition("[")[0]
    yield


def pytest_assertion_pass(orig, expl):
    frame = sys._getframe(1)
    while Path(frame.f_code.co_filename).parent.name in ("pluggy", "assertion") and frame.f_back is not None:
        frame = frame.f_back
    found = _COMPARED.match(expl)
    if found and Path(frame.f_code.co_filename).parent == Path(__file__).parent:  # hypothesis asserts too
        a, b = float(found[1]), float(found[3])
        if a > 0.0 and b > 0.0 and not (a.is_integer() and b.is_integer()):
            _note(a / b if found[2][0] == "<" else b / a, f"assert {orig[:70]}")


def _allclose(real):
    def assert_allclose(actual, desired, rtol=1e-7, atol=0.0, **more):
        real(actual, desired, rtol=rtol, atol=atol, **more)
        x, y = np.broadcast_arrays(np.asarray(actual, float), np.asarray(desired, float))
        allowed = atol + rtol * np.abs(y)
        known = (allowed > 0.0) & np.isfinite(x) & np.isfinite(y)
        if known.any():
            _note(float(np.max(np.abs(x - y)[known] / allowed[known])), f"assert_allclose rtol={rtol:g} atol={atol:g}")

    return assert_allclose


def _approx(real):
    def equal(self, actual):
        same = real(self, actual)
        if isinstance(actual, float | np.floating) and same and self.tolerance > 0.0:
            _note(float(abs(actual - self.expected) / self.tolerance), f"approx to {self.tolerance:.3g}")
        return same

    return equal


np.testing.assert_allclose = _allclose(np.testing.assert_allclose)
_scalar = type(pytest.approx(1.0))
_scalar.__eq__ = _approx(_scalar.__eq__)


def pytest_terminal_summary(terminalreporter):
    near = [(fraction, *key) for key, fraction in _largest.items() if NEAR < fraction <= 1.0]
    for fraction, test, bound in sorted(near, key=lambda row: row[1:]):
        terminalreporter.write_line(f"{fraction:.2f}  {test}  {bound}")
