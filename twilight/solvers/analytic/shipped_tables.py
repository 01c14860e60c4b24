"""Tables of the formulae, from data/analytic, read once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from twilight.base.shipped_data import data_numbers


@lru_cache(maxsize=8)
def table(name: str) -> tuple[tuple[str, ...], np.ndarray]:
    """Column names and values (rows, columns) of a table; an empty cell is NaN."""
    return data_numbers(f"analytic/{name}.csv")


def column(name: str, key: str) -> np.ndarray:
    """One column of a table."""
    head, values = table(name)
    return values[:, head.index(key)]
