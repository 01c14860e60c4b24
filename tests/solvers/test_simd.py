"""Eight wavelengths as one value: arithmetic is that of numpy."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.errors import TypingError
from one_order import one_order

from twilight.jit.kernels import njit
from twilight.jit.simd import LANES, broadcast, exp, load, maximum, store


@njit()
def _exponentials(x, out):
    for i in range(x.shape[0]):
        store(out, i, exp(load(x, i)))


@njit()
def _sum(a, b, factor, least, out):
    total = broadcast(factor)
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            total += factor * load(a, (i, j)) * load(b, (i, j)) - load(b, (i, j)) * factor
    store(out, (), maximum(total, least))


def test_exponentials_are_right_and_end_where_float32_does():
    """Light would be wrong in its seventh digit, or infinite."""
    x = np.linspace(-86.9, 88.0, LANES * 20_000).astype(np.float32).reshape(-1, LANES)
    out = np.empty_like(x)
    _exponentials(x, out)
    np.testing.assert_allclose(out, np.exp(x.astype(float)), rtol=1.5e-7)
    edge = np.array([[-1e4, -90.0, -0.0, 0.0, 1e-8, 90.0, 1e4, -1e-8]], np.float32)
    _exponentials(edge, out[:1])
    assert (out[0, :2] == 0.0).all() and np.isfinite(out[0]).all() and out[0, 5] == out[0, 6] > 1e38
    np.testing.assert_array_equal(out[0, [2, 3, 4, 7]], 1.0)


def test_sums_of_products_over_rows_of_arrays():
    """Eight wavelengths at once would not be eight times one."""
    a, b = np.random.default_rng(1).normal(size=(2, 5, 6, LANES)).astype(np.float32)
    out = np.empty(LANES, np.float32)
    _sum(a, b, np.float32(2.0), np.float32(1.0), out)
    wanted = 2.0 + (2.0 * a.astype(float) * b - 2.0 * b).sum(axis=(0, 1))
    np.testing.assert_allclose(out, np.maximum(wanted, 1.0), rtol=1e-5, atol=1e-5)
    assert (wanted < 1.0).any() and (wanted > 1.0).any()


@pytest.mark.parametrize(
    "rows", [np.zeros((4, LANES)), np.zeros((4, 4, LANES), np.float32), np.zeros((LANES, 4), np.float32).T]
)
def test_only_rows_of_float32_in_c_order_are_read(rows):
    """A vector would be read across rows of another layout."""
    with pytest.raises(TypingError):
        _exponentials(rows, np.zeros((4, LANES), np.float32))


def test_the_same_where_nothing_is_compiled():
    """NUMBA_DISABLE_JIT=1, for debuggers: arrays of numpy stand for the vectors."""
    tests = ("test_exponentials_are_right_and_end_where_float32_does", "test_sums_of_products_over_rows_of_arrays")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *(f"{__file__}::{name}" for name in tests)],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0 and done.stdout.startswith(".."), done.stdout


@pytest.mark.slow
def test_an_order_of_scattering_is_the_same_where_nothing_is_compiled(tmp_path):
    """A debugger would see other numbers than those that users get."""
    path = tmp_path / "order.npz"
    tests = Path(__file__).parents[1]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(tests.parent)}
    subprocess.run([sys.executable, str(tests / "one_order.py"), str(path)], env=environment, check=True)
    for compiled, plain in zip(one_order(), np.load(path).values(), strict=True):
        np.testing.assert_allclose(plain, compiled, rtol=1e-5, atol=1e-5 * np.abs(compiled).max())
