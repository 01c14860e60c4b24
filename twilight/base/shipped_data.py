"""Tables of numbers that come with the package, below twilight/data."""

import csv
from importlib import resources
from importlib.resources.abc import Traversable

import numpy as np


def data_file(path: str) -> Traversable:
    """A file of the folder twilight/data, e.g. `gases/no2_vandaele1998.csv`."""
    return resources.files("twilight").joinpath("data", *path.split("/"))


def data_rows(path: str) -> list[dict[str, str]]:
    """Rows of a CSV file of twilight/data, by the names of its columns; lines that begin with # are comments."""
    lines = data_file(path).read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def data_numbers(path: str) -> tuple[tuple[str, ...], np.ndarray]:
    """Column names and numbers (rows, columns) of a CSV file of twilight/data.

    Lines that begin with # are comments; an empty cell is NaN.
    """
    text = data_file(path).read_text(encoding="utf-8")
    head, *rows = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
    values = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])
    values.flags.writeable = False
    return tuple(head), values
