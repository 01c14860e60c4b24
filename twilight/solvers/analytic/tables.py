"""The tables that the analytic models need, read from the package once."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources

import numpy as np


@lru_cache(maxsize=8)
def table(name: str) -> tuple[tuple[str, ...], np.ndarray]:
    """Column names and values (rows, columns) of ``data/analytic/NAME.csv``; an empty cell is nan."""
    text = resources.files("twilight").joinpath(f"data/analytic/{name}.csv").read_text(encoding="utf-8")
    head, *rows = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
    values = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])
    values.flags.writeable = False
    return tuple(head), values


def column(name: str, key: str) -> np.ndarray:
    """One column of a table."""
    head, values = table(name)
    return values[:, head.index(key)]
