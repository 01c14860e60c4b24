"""Soundings by balloon: the lists of the University of Wyoming, and the archive IGRA, version 2.

References
----------
University of Wyoming, weather.uwyo.edu/upperair/sounding.html, `TEXT:LIST`: eleven columns of seven characters,
PRES (hPa), HGHT (m, geopotential), TEMP (C), DWPT (C), RELH (%), ..., blank where missing; below them the station's.
Since 2024 also in HTML with another title and a table of the station below, and as `CSV`: a row a level with time,
place, pressure_hPa, geopotential height_m, temperature_C, dew point temperature_C, relative humidity_%.
Durre et al. 2016, Integrated Global Radiosonde Archive, version 2, NOAA NCEI, `igra2-data-format.txt`: a header that
begins with #, then one record a level at fixed columns; -9999 missing, -8888 removed by quality control.
"""

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from twilight.atmosphere import measured
from twilight.atmosphere.measured import AirColumn, Reading
from twilight.base.errors import TwilightError
from twilight.io.air.lines import PlaceAndTime, moment, number, read_lines, spoken

WYOMING_HEAD = re.compile(r"^\s*PRES\s+HGHT\s+TEMP\s+DWPT\s+RELH")
WYOMING_COLUMNS = (("PRES", 0.001, 1100.0, "hPa"), ("HGHT", -500.0, 80000.0, "m"), ("TEMP", -130.0, 60.0, "C"),
                   ("DWPT", -180.0, 60.0, "C"), ("RELH", 0.0, 130.0, "%"))  # fmt: skip
WYOMING_WIDTH = 7
WYOMING_TITLE = re.compile(r"(.*?)\s*Observations (?:for Station (.*?) )?at (\d{2}) ?(?:Z|UTC) (\d{1,2} \w{3} \d{4})")
WYOMING_TIME = re.compile(r"Observation time:\s*(\d{6}/\d{4})")
WYOMING_PLACE = re.compile(r"Station (latitude|longitude):?\s*(-?[\d.]+)", re.IGNORECASE)

CSV_TIME = ("time", "latitude", "longitude")
CSV_COLUMNS = {
    "pressure_hPa": (0.001, 1100.0), "geopotential height_m": (-500.0, 80000.0), "temperature_C": (-130.0, 60.0),
    "dew point temperature_C": (-180.0, 60.0), "relative humidity_%": (0.0, 130.0),
}  # fmt: skip
"""Columns of Wyoming's CSV that are used, and the numbers that they may hold."""
CSV_MISSING = (-9999.0, -999.0)
"""Numbers that stand for a missing one."""
MOST_HEAD_LINES = 30
"""Lines within which a file's first header stands: notes may be on top."""
MOST_LEVELS = 300
"""Levels that are kept of an ascent that has more (a row a second), evenly in ln(p)."""

IGRA_HEAD = re.compile(r"^#[A-Z]{2}[A-Z0-9]{9} \d{4} \d\d \d\d \d\d ")
IGRA_MISSING = (-9999.0, -8888.0)
HOURS_MISSING = 99


@dataclass
class _Sounding:
    """One ascent: when and where it was, and its rows of p [hPa], H [m] (NaN: not given), T [K], e / p (NaN)."""

    station: str
    time: datetime
    latitude_deg: float | None
    longitude_deg: float | None
    rows: list[tuple[float, float, float, float]]


def is_wyoming(lines: list[str]) -> bool:
    return any(WYOMING_HEAD.match(line) for line in lines)


def is_wyoming_csv(lines: list[str]) -> bool:
    return _csv_head(lines) is not None


def _csv_head(lines: list[str]) -> int | None:
    """The line with the names of the columns."""
    for i, line in enumerate(lines[:MOST_HEAD_LINES]):
        if {"time", "pressure_hPa", "temperature_C"} <= {name.strip() for name in line.split(",")}:
            return i
    return None


def is_igra(lines: list[str]) -> bool:
    return any(IGRA_HEAD.match(line) for line in lines[:MOST_HEAD_LINES])


def read_sounding(path: Path, wanted: PlaceAndTime) -> Reading:
    """The sounding of a file that is nearest: first in place, then in time.

    Errors: TwilightError with the file and the line for what is not in the format.
    """
    lines = read_lines(path)
    if is_igra(lines):
        soundings = list(_igra(path, lines, wanted))
    else:
        soundings = [_wyoming_csv(path, lines)] if is_wyoming_csv(lines) else list(_wyoming(path, lines))
    places = [(s.latitude_deg, s.longitude_deg) for s in soundings]
    sounding = soundings[wanted.nearest([s.time for s in soundings], path, "soundings", places)]
    moment_and_place = sounding.time, sounding.latitude_deg, sounding.longitude_deg
    source = f"sounding {path.name}: {sounding.station}, {spoken(sounding.time)}{wanted.away(*moment_and_place)}"
    rows = np.array(sorted(sounding.rows, key=lambda row: -row[0])).reshape(-1, 4)
    rows = rows[np.concatenate([[True], np.diff(rows[:, 0]) < 0.0])] if len(rows) else rows
    if len(rows) > MOST_LEVELS:
        even = np.linspace(np.log(rows[0, 0]), np.log(rows[-1, 0]), MOST_LEVELS)
        rows = rows[np.unique(np.searchsorted(-np.log(rows[:, 0]), -even).clip(0, len(rows) - 1))]
    latitude = sounding.latitude_deg if sounding.latitude_deg is not None else wanted.latitude_deg
    pressure, height, temperature, water = rows.T
    at = 45.0 if latitude is None else latitude
    column = column_of(path, source, pressure, height, temperature, water, at)
    return Reading("sounding", (column,), warnings=wanted.warnings(source, *moment_and_place))


def column_of(
    path: Path,
    source: str,
    pressure_hpa: np.ndarray,
    height_m: np.ndarray,
    temperature_k: np.ndarray,
    water_vapour: np.ndarray,
    latitude_deg: float,
) -> AirColumn:
    """A column of air from rows of falling pressure; heights (geopotential) that lack are found hydrostatically."""
    known = np.isfinite(height_m)
    if np.count_nonzero(known) < 1 or pressure_hpa.size < 3:
        raise TwilightError(
            f"{path}: {source}: has {pressure_hpa.size} levels with pressure and temperature and "
            f"{np.count_nonzero(known)} heights; needed are 3 levels and a height"
        )
    virtual = measured.virtual_temperature_k(temperature_k, np.where(np.isfinite(water_vapour), water_vapour, 0.0))
    metres = -np.diff(np.log(pressure_hpa)) * 0.5 * (virtual[1:] + virtual[:-1])
    metres *= measured.GAS_CONSTANT / (measured.MOLAR_MASS_DRY * measured.STANDARD_GRAVITY)
    course = np.concatenate([[0.0], np.cumsum(metres)])
    error = np.interp(course, course[known], (height_m - course)[known])  # what is known is met
    z = measured.geometric_km(1e-3 * (course + error), latitude_deg)
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(z)) > 0.0])  # rounded to metres, two may be one
    return AirColumn(source, z[keep], pressure_hpa[keep], temperature_k[keep], water_vapour[keep])


def _wyoming(path: Path, lines: list[str]) -> Iterator[_Sounding]:
    heads = [i for i, line in enumerate(lines) if WYOMING_HEAD.match(line)]
    for head, end in zip(heads, [*heads[1:], len(lines)], strict=True):
        before = [" ".join(re.sub(r"<[^>]*>", " ", line).split()) for line in lines[max(0, head - 12) : head]]
        after = " ".join(re.sub(r"<[^>]*>", " ", line) for line in lines[head:end])
        title = next((match for line in reversed(before) if (match := WYOMING_TITLE.search(line))), None)
        if title is not None:
            time = moment(path, head + 1, f"{title[3]} {title[4]}", "%H %d %b %Y")
            station = title[1] or title[2] or "a station without a name"
        elif (said := WYOMING_TIME.search(after)) is not None:
            time, station = moment(path, head + 1, said[1], "%y%m%d/%H%M"), "a station without a name"
        else:
            raise TwilightError(
                f"{path}: line {head + 1}: the sounding has no time; expected is a title above it such as `10868 "
                "Muenchen Observations at 12Z 21 Jun 2026`, or `Observation time: 260621/1200` below it"
            )
        place = {name.lower(): float(value) for name, value in WYOMING_PLACE.findall(after)}
        rows = list(_wyoming_rows(path, lines, head, end))
        yield _Sounding(station, time, place.get("latitude"), place.get("longitude"), rows)


def _wyoming_rows(path: Path, lines: list[str], head: int, end: int) -> Iterator[tuple[float, float, float, float]]:
    begin = head + 2
    if begin < end and lines[begin].lstrip().startswith("---"):
        begin += 1
    for i in range(begin, end):
        line = lines[i]
        if not line.strip() or "<" in line or line.lstrip().startswith("---") or "Station" in line:
            return
        fields = [line[k * WYOMING_WIDTH : (k + 1) * WYOMING_WIDTH] for k in range(len(WYOMING_COLUMNS))]
        value = [
            number(path, i + 1, name, text, low, high, unit) if text.strip() else np.nan
            for text, (name, low, high, unit) in zip(fields, WYOMING_COLUMNS, strict=True)
        ]
        row = _row(*value)
        if row is not None:
            yield row


def _row(
    pressure: float, height: float, celsius: float, dew_point: float, humidity: float
) -> tuple[float, float, float, float] | None:
    """A level as `_Sounding` has it; None where it lacks pressure or temperature."""
    if not (np.isfinite(pressure) and np.isfinite(celsius)):
        return None
    kelvin, water = celsius + 273.15, np.nan
    if np.isfinite(dew_point):
        water = float(measured.from_dew_point(dew_point + 273.15, pressure))
    elif np.isfinite(humidity):
        water = float(measured.from_relative_humidity(humidity, kelvin, pressure))
    return pressure, height, kelvin, water


def _wyoming_csv(path: Path, lines: list[str]) -> _Sounding:
    """The ascent of a CSV file, at the time and place of its first row."""
    head = _csv_head(lines) or 0
    reader = csv.reader(lines[head:])
    names = [name.strip() for name in next(reader)]
    rows: list[tuple[float, float, float, float]] = []
    first: dict[str, str] | None = None
    at = head + 2
    for i, fields in enumerate(reader, start=at):
        if not any(field.strip() for field in fields):
            continue
        if len(fields) != len(names):
            raise TwilightError(f"{path}: line {i}: has {len(fields)} values, the columns are {len(names)}")
        values = {name: field.strip() for name, field in zip(names, fields, strict=True)}
        first, at = first or values, at if first else i
        row = _row(*(
            number(path, i, name, values.get(name, ""), *span, missing=CSV_MISSING)
            for name, span in CSV_COLUMNS.items()
        ))  # fmt: skip
        if row is not None:
            rows.append(row)
    if first is None:
        raise TwilightError(f"{path}: has the names of columns and no row below them")
    place = [number(path, at, n, first[n], -360.0, 360.0, "deg") if first.get(n) else None for n in CSV_TIME[1:]]
    time = moment(path, at, first["time"], "%Y-%m-%d %H:%M:%S")
    return _Sounding("a station without a name", time, place[0], place[1], rows)


def _igra(path: Path, lines: list[str], wanted: PlaceAndTime) -> Iterator[_Sounding]:
    """The soundings within a day of the time that is wanted, or else the nearest one; all where no time is."""
    heads = []
    i = next((i for i, line in enumerate(lines) if IGRA_HEAD.match(line)), 0)
    while i < len(lines):
        line = lines[i]
        if not line.strip():
            i += 1
            continue
        if IGRA_HEAD.match(line) is None:
            raise TwilightError(
                f"{path}: line {i + 1}: `{line[:40]}` is no header of a sounding, which begins as #USM00072201 2026 06 "
                "21 12"
            )
        count = int(number(path, i + 1, "NUMLEV (columns 33 to 36)", line[32:36], 0, 99999))
        if i + count >= len(lines) + (count == 0):
            raise TwilightError(
                f"{path}: line {i + 1}: says {count} levels follow, and the file ends after {len(lines) - i - 1}"
            )
        hour = int(number(path, i + 1, "HOUR (columns 25 to 26)", line[24:26], 0, HOURS_MISSING))
        time = moment(path, i + 1, line[13:23], "%Y %m %d")
        release = line[27:31]
        if hour != HOURS_MISSING:
            time = time.replace(hour=min(hour, 23))
        elif release[:2].isdigit() and int(release[:2]) < 24:
            time = time.replace(hour=int(release[:2]))
        heads.append((i, count, time))
        i += count + 1
    if wanted.time is not None and heads:
        heads = [heads[wanted.nearest([time for _, _, time in heads], path, "soundings")]]
    for at, count, time in heads:
        line = lines[at]
        latitude = number(path, at + 1, "LAT (columns 56 to 62)", line[55:62], -900000, 900000) * 1e-4
        longitude = number(path, at + 1, "LON (columns 64 to 71)", line[63:71], -1800000, 1800000) * 1e-4
        rows = [row for k in range(at + 1, at + 1 + count) if (row := _igra_row(path, k + 1, lines[k])) is not None]
        yield _Sounding(f"IGRA {line[1:12]}", time, latitude, longitude, rows)


def _igra_row(path: Path, line_number: int, line: str) -> tuple[float, float, float, float] | None:
    def field(name: str, first: int, last: int, low: float, high: float) -> float:
        called = f"{name} (columns {first} to {last})"
        return number(path, line_number, called, line[first - 1 : last], low, high, missing=IGRA_MISSING)

    pressure = field("PRESS", 10, 15, 1, 120000) / 100.0
    height = field("GPH", 17, 21, -1000, 99999)
    celsius = field("TEMP", 23, 27, -1300, 600) / 10.0
    humidity = field("RH", 29, 33, 0, 1300) / 10.0
    depression = field("DPDP", 35, 39, 0, 1500) / 10.0
    if not (np.isfinite(pressure) and np.isfinite(celsius)):
        return None
    kelvin, water = celsius + 273.15, np.nan
    if np.isfinite(humidity):
        water = float(measured.from_relative_humidity(humidity, kelvin, pressure))
    elif np.isfinite(depression):
        water = float(measured.from_dew_point(kelvin - depression, pressure))
    return pressure, height, kelvin, water
