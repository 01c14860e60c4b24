"""Eight wavelengths as one value: arithmetic is that of numpy."""

import numpy as np
import pytest
from numba.core.errors import TypingError

from twilight.kernels import njit
from twilight.lanes import LANES, at_least, exp, read, same, write


@njit()
def _exponentials(x, out):
    for i in range(x.shape[0]):
        write(out, i, exp(read(x, i)))


@njit()
def _sum(a, b, factor, least, out):
    total = same(factor)
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            total += factor * read(a, (i, j)) * read(b, (i, j)) - read(b, (i, j)) * factor
    write(out, (), at_least(total, least))


def test_exponentials_are_right_and_end_where_float32_does():
    x = np.linspace(-86.9, 88.0, LANES * 20_000).astype(np.float32).reshape(-1, LANES)
    out = np.empty_like(x)
    _exponentials(x, out)
    np.testing.assert_allclose(out, np.exp(x.astype(float)), rtol=1.5e-7)
    edge = np.array([[-1e4, -90.0, -0.0, 0.0, 1e-8, 90.0, 1e4, -1e-8]], np.float32)
    _exponentials(edge, out[:1])
    assert (out[0, :2] == 0.0).all() and np.isfinite(out[0]).all() and out[0, 5] == out[0, 6] > 1e38
    np.testing.assert_array_equal(out[0, [2, 3, 4, 7]], 1.0)


def test_sums_of_products_over_rows_of_arrays():
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
    with pytest.raises(TypingError):
        _exponentials(rows, np.zeros((4, LANES), np.float32))
