"""Ozone columns of the World Ozone and Ultraviolet Radiation Data Centre, in its extended CSV.

References
----------
WOUDC, guide.woudc.org, section 3 and `#DAILY` of TotalOzone: tables that begin with #NAME, a line of fields, and rows;
lines that begin with * are comments.  ColumnO3 in DU (matm-cm).
"""

from __future__ import annotations

import csv
from datetime import timedelta
from pathlib import Path

from twilight.atmosphere.measured.parts import OzoneColumn, Reading
from twilight.base.errors import TwilightError
from twilight.io.air.lines import moment, number, read_lines
from twilight.io.air.place_and_time import PlaceAndTime

HEAD = "#CONTENT"
Table = list[tuple[int, dict[str, str]]]


def is_woudc(lines: list[str]) -> bool:
    return any(line.strip().upper().startswith(HEAD) for line in lines[:40])


def _tables(lines: list[str]) -> dict[str, Table]:
    """Rows of each table with their line numbers; of a table that comes again the first."""
    tables: dict[str, Table] = {}
    name = ""
    fields: list[str] = []
    for i, line in enumerate(lines, start=1):
        text = line.strip()
        if not text or text.startswith("*"):
            continue
        if text.startswith("#"):
            name, fields = text[1:].split(",")[0].strip().upper(), []
            if name in tables:
                name = f"{name} again at line {i}"
            tables[name] = []
        elif name and not fields:
            fields = [field.strip() for field in next(csv.reader([text]))]
        elif name:
            values = next(csv.reader([text]))
            tables[name].append((i, dict(zip(fields, (value.strip() for value in values), strict=False))))
    return tables


def read_woudc(path: Path, wanted: PlaceAndTime) -> Reading:
    """The ozone column of the day that is nearest.

    Errors: TwilightError with the file and the line for what is not in the format.
    """
    tables = _tables(read_lines(path))
    content = tables.get("CONTENT") or [(1, {})]
    category = content[0][1].get("Category", "")
    if category != "TotalOzone" or "DAILY" not in tables:
        lacks = "" if "DAILY" in tables else " without a table #DAILY"
        raise TwilightError(
            f"{path}: line {content[0][0]}: holds `{category}`{lacks}; allowed is TotalOzone with its table #DAILY"
        )
    rows = [(i, row) for i, row in tables["DAILY"] if row.get("ColumnO3")]
    if not rows:
        raise TwilightError(f"{path}: has no row of #DAILY with a number in ColumnO3")
    # a day's mean stands for its noon
    times = [moment(path, i, row.get("Date", ""), "%Y-%m-%d") + timedelta(hours=12) for i, row in rows]
    at = wanted.nearest(times, path, "days")
    line, row = rows[at]
    column = number(path, line, "ColumnO3", row["ColumnO3"], 50.0, 700.0, "DU")
    where = next(iter(tables.get("LOCATION", [])), (0, {}))
    place = [
        number(path, where[0], name, where[1][name], -180.0, 180.0) if where[1].get(name) else None
        for name in ("Latitude", "Longitude")
    ]
    station = next(iter(tables.get("PLATFORM", [])), (0, {}))[1].get("Name", "a station without a name")
    instrument = next(iter(tables.get("INSTRUMENT", [])), (0, {}))[1].get("Name", "")
    source = f"WOUDC {path.name}: {instrument} {station}, {times[at]:%Y-%m-%d}{wanted.away(times[at], *place)}"
    return Reading("ozone", (OzoneColumn(source, column),))
