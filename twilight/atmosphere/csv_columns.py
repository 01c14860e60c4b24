"""CSV files of numbers in named columns, as users write them, with one sentence for whatever is wrong."""

import codecs
import csv
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from twilight.base.errors import TwilightError

MAX_ROWS = 2_000_000
"""Most rows of a table."""

MAX_BYTES = 400_000_000
"""Largest table that is read [bytes]."""

UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""How a table in UTF-16 begins, which spreadsheets call Unicode text."""

Columns = Mapping[str, tuple[float, float, str]]
"""Column -> lowest and highest value allowed, and how a message says so."""


def numbered_lines(file: Path) -> list[tuple[int, str]]:
    """The lines of a table with their numbers in the file; lines that are empty or begin with # are none of it.

    Errors: TwilightError, with the file, for one that cannot be read, is no text or larger than MAX_BYTES.
    """
    try:
        with file.open("rb") as table:
            content = table.read(MAX_BYTES + 1)  # a device could go on for ever
        if len(content) > MAX_BYTES:
            raise TwilightError(
                f"{file}: the table is larger than {MAX_BYTES // 1_000_000} MB, which is the most allowed"
            )
        text = content.decode("utf-16" if content[:2] in UTF16_MARKS else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise TwilightError(f"{file}: not a text file in UTF-8, a CSV table is expected") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise TwilightError(f"{file}: cannot read the table ({reason})") from error
    return [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]


def delimiter_of(line: str) -> str:
    """What separates the values of a table with this line in it: a semicolon, where numbers may have decimal commas, a
    tabulator, or a comma."""
    return next((mark for mark in (";", "\t") if mark in line), ",")


def as_number(text: str, delimiter: str) -> float:
    """The number of a field, with a decimal comma where commas do not separate; ValueError for any other text."""
    return float(text if delimiter == "," else text.replace(",", "."))


def read_columns(
    file: Path, columns: Columns, optional: Columns | None = None, others: bool = False
) -> tuple[list[str], np.ndarray, list[int]]:
    """Names of the columns found, rows (R, C) in that order, and the line of each row in the file.

    One header line, then one row a line; lines that begin with # are comments.  Commas separate, or semicolons or
    tabulators, with which decimals may have commas.  Columns come in any order; those of
    `optional` may be missing; others: whether there may be more, which are passed over.  Raises TwilightError, with
    file, line and column, on anything that is not allowed.
    """
    lines = numbered_lines(file)
    if not lines:
        raise TwilightError(f"{file}: the table is empty, a header with {', '.join(columns)} is expected")
    known = dict(columns) | dict(optional or {})
    delimiter = delimiter_of(lines[0][1])
    names = _header(file, *lines[0], delimiter, columns, known, others)
    if len(lines) == 1:
        raise TwilightError(f"{file}: the table has a header but no rows")
    if len(lines) - 1 > MAX_ROWS:
        raise TwilightError(f"{file}: the table has {len(lines) - 1} rows, at most {MAX_ROWS} are allowed")
    present = [name for name in known if name in names]
    order = [(name, names.index(name), known[name]) for name in present]
    rows = np.empty((len(lines) - 1, len(present)))
    for i, (number, line) in enumerate(lines[1:]):
        rows[i] = _row(file, number, line, delimiter, order, len(names))
    return present, rows, [number for number, _ in lines[1:]]


def cells_of(file: Path) -> list[tuple[int, list[str]]]:
    """The cells of every line of a table with its number in the file, as many as its first line has; decimal commas are
    points.

    Errors: TwilightError as `numbered_lines` and `fields_of`, and for a line with another number of cells.
    """
    lines = numbered_lines(file)
    delimiter = delimiter_of(lines[0][1]) if lines else ","
    rows: list[tuple[int, list[str]]] = []
    for number, line in lines:
        cells = fields_of(file, number, line, delimiter)
        if rows and len(cells) != len(rows[0][1]):
            raise TwilightError(f"{file}: line {number}: has {len(cells)} cells, the header has {len(rows[0][1])}")
        rows.append((number, cells if delimiter == "," else [cell.replace(",", ".") for cell in cells]))
    return rows


def fields_of(file: Path, number: int, line: str, delimiter: str) -> list[str]:
    """The fields of a line; TwilightError for one that is none of a CSV table."""
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=delimiter, strict=True))]
    except csv.Error as error:
        raise TwilightError(f"{file}: line {number} is not a line of a CSV table ({error})") from error


def _header(
    file: Path, number: int, line: str, delimiter: str, needed: Columns, known: Columns, others: bool
) -> list[str]:
    """The names in the file's order."""
    names = fields_of(file, number, line, delimiter)
    for column in known:
        if names.count(column) > 1 or (column in needed and column not in names):
            what = "is missing" if column not in names else "appears more than once"
            raise TwilightError(f"{file}: line {number}: column {column} {what}; needed are {', '.join(needed)}")
    for column in names:
        if not (others or column in known):
            raise TwilightError(
                f"{file}: line {number}: column `{column}` is not known; allowed are {', '.join(known)}"
            )
    return names


def _row(
    file: Path,
    number: int,
    line: str,
    delimiter: str,
    order: list[tuple[str, int, tuple[float, float, str]]],
    count: int,
) -> list[float]:
    fields = fields_of(file, number, line, delimiter)
    if len(fields) != count:
        comma = "; decimals have points where commas separate, or else semicolons separate" if delimiter == "," else ""
        raise TwilightError(f"{file}: line {number} has {len(fields)} values, expected {count}{comma}")
    values = []
    for column, position, (lowest, highest, allowed) in order:
        try:
            value = as_number(fields[position], delimiter)
        except ValueError:
            value = math.nan
        if not lowest <= value <= highest:
            raise TwilightError(
                f"{file}: line {number}: {column} is `{fields[position][:40]}`, allowed is a number from {allowed}"
            )
        values.append(value)
    return values
