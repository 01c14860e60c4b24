"""Sun photometers of AERONET, version 3: optical depths (AOD), and inversions with all products.

References
----------
Giles et al. 2019, Atmos. Meas. Tech. 12, 169; aeronet.gsfc.nasa.gov, Data Format of version 3: some lines of text, one
of them `AERONET Version 3;`, one line of names of columns, then a row a measurement; -999 is missing.  Optical depths:
AOD_500nm and so on, 440-870_Angstrom_Exponent, Precipitable_Water(cm), Exact_Wavelengths_of_AOD(um)_500nm.  Of
inversions (Sinyuk et al. 2020, Atmos. Meas. Tech. 13, 3375) the volume dV/dln r [um^3 um^-2] in columns named by the
radius [um], Refractive_Index-Real_Part[440nm], AOD_Extinction-Total[440nm] and so on.
"""

import csv
import re
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from twilight.atmosphere.measured import AerosolDepth, Part, Reading, SizeDistribution, WaterColumn
from twilight.base.errors import TwilightError
from twilight.io.air.lines import PlaceAndTime, moment, number, read_lines, spoken

HEAD = "AERONET Version 3"
MISSING = (-999.0, -9999.0)
BREAK = re.compile(r"<br\s*/?>\s*$", re.IGNORECASE)
"""What its web service ends lines with in a page."""
DATE = re.compile(r"Date_?\(dd:mm:yyyy\)")
TIME = re.compile(r"Time_?\(hh:mm:ss\)")
DEPTH = re.compile(r"AOD_(\d+)nm")
EXACT = "Exact_Wavelengths_of_AOD(um)_{}nm"
EXPONENT = "440-870_Angstrom_Exponent"
RADIUS = re.compile(r"\d+\.\d{6}")
BY_WAVELENGTH = re.compile(r"(.+)\[(\d+)nm\]")
REAL = "Refractive_Index-Real_Part"
IMAGINARY = "Refractive_Index-Imaginary_Part"
EXTINCTION = "AOD_Extinction-Total"
MM_PER_CM = 10.0


MOST_HEAD_LINES = 30
"""Lines within which the names of the columns stand; its web service puts more on top than its archive does."""


def is_aeronet(lines: list[str]) -> bool:
    return any(HEAD in line for line in lines[:MOST_HEAD_LINES])


@dataclass(frozen=True)
class _Row:
    """One measurement: its line, counted from 1, and its values by the names of the columns."""

    path: Path
    line: int
    values: dict[str, str]

    def get(self, name: str, low: float, high: float) -> float:
        """A number, NaN where it is missing or not given."""
        return number(self.path, self.line, name, self.values.get(name, ""), low, high, missing=MISSING)

    def time(self) -> datetime:
        day = next(value for name, value in self.values.items() if DATE.fullmatch(name))
        clock = next(value for name, value in self.values.items() if TIME.fullmatch(name))
        return moment(self.path, self.line, f"{day} {clock}", "%d:%m:%Y %H:%M:%S")

    @property
    def place(self) -> tuple[float | None, float | None]:
        angles_deg = []
        for name in ("Latitude", "Longitude"):
            value = next(
                (self.get(key, -360.0, 360.0) for key in self.values if key.startswith((f"Site_{name}", name))), np.nan
            )
            angles_deg.append(float(value) if np.isfinite(value) else None)
        return angles_deg[0], angles_deg[1]


def read_aeronet(path: Path, wanted: PlaceAndTime) -> Reading:
    """Optical depths and water, or sizes and index, of a file's nearest measurement: first in place, then in time.

    Errors: TwilightError with the file and the line for what is not in the format.
    """
    lines = [BREAK.sub("", line) for line in read_lines(path)]
    at = next((i for i, line in enumerate(lines) if DATE.search(line) and TIME.search(line)), None)
    if at is None:
        raise TwilightError(
            f"{path}: has no line with the names of the columns, among them Date(dd:mm:yyyy) and Time(hh:mm:ss)"
        )
    names = [name.strip() for name in next(csv.reader([lines[at]]))]
    inversion = any(name.startswith(REAL) for name in names) and any(RADIUS.fullmatch(name) for name in names)
    if not inversion and not any(DEPTH.fullmatch(name) for name in names):
        raise TwilightError(
            f"{path}: line {at + 1}: has no column AOD_...nm, nor radii with {REAL}[...nm]; allowed are files of "
            "AOD, and of inversions with all products (.all)"
        )
    rows = []
    for i, line in enumerate(lines[at + 1 :], start=at + 2):
        if not line.strip() or line.lstrip().startswith("<"):
            continue
        fields = next(csv.reader([line]))
        if len(fields) < len(names) - 1:
            raise TwilightError(f"{path}: line {i}: has {len(fields)} values, the columns are {len(names)}")
        values: dict[str, str] = {}
        for name, field in zip(names, fields, strict=False):
            values.setdefault(name, field)
        rows.append(_Row(path, i, values))
    usable = [(row, parts) for row in rows if (parts := (_sizes if inversion else _depths)(row))]
    if not usable:
        raise TwilightError(
            f"{path}: has no row with {'sizes, index and extinction' if inversion else 'an optical depth'}"
        )
    times, places = [row.time() for row, _ in usable], [row.place for row, _ in usable]
    chosen = wanted.nearest(times, path, "measurements", places)
    row, parts = usable[chosen]
    title = next((i for i, line in enumerate(lines[:at]) if line.startswith(HEAD)), at)
    site = lines[title + 1].strip() if title + 1 < at else ""
    site = row.values.get("AERONET_Site", row.values.get("Site", site)).strip()
    kind = "inversion" if inversion else "AOD"
    moment_and_place = times[chosen], *places[chosen]
    source = f"AERONET {kind} {path.name}: {site}, {spoken(times[chosen])}{wanted.away(*moment_and_place)}"
    sourced = tuple(replace(part, source=source) for part in parts)
    return Reading("aeronet", sourced, warnings=wanted.warnings(source, *moment_and_place))


def _depths(row: _Row) -> list[Part]:
    """The parts of a row of optical depths, without their source; empty where it has none."""
    depth_of_nm: dict[float, float] = {}
    for name in row.values:
        if (match := DEPTH.fullmatch(name)) is None:
            continue
        one = row.get(name, -0.1, 20.0)
        if np.isfinite(one) and one > 0.0:
            exact = row.get(EXACT.format(match[1]), 0.2, 5.0)
            depth_of_nm[round(1e3 * exact, 2) if np.isfinite(exact) else float(match[1])] = one
    if not depth_of_nm:
        return []
    nm, depth = np.array(sorted(depth_of_nm.items())).T
    if nm.size == 1:  # the exponent stands for a second channel
        exponent = row.get(EXPONENT, -3.0, 6.0)
        if np.isfinite(exponent):
            nm, depth = np.array([1.0, 2.0]) * nm[0], np.array([1.0, 2.0**-exponent]) * depth[0]
    parts: list[Part] = [AerosolDepth("", nm, depth)]
    water = row.get("Precipitable_Water(cm)", -0.1, 15.0)
    if np.isfinite(water) and water > 0.0:
        parts.append(WaterColumn("", MM_PER_CM * water))
    return parts


def _sizes(row: _Row) -> list[Part]:
    """The part of a row of an inversion, without its source; empty where it has none."""
    radii = [name for name in row.values if RADIUS.fullmatch(name)]
    volume = np.array([row.get(name, 0.0, 1e3) for name in radii])
    channels = sorted(
        int(match[2]) for name in row.values if (match := BY_WAVELENGTH.fullmatch(name)) and match[1] == REAL
    )
    real, imaginary, depth = (
        np.array([row.get(f"{what}[{nm}nm]", 0.0, high) for nm in channels])
        for what, high in ((REAL, 3.0), (IMAGINARY, 2.0), (EXTINCTION, 20.0))
    )
    good = np.isfinite(real) & np.isfinite(imaginary) & np.isfinite(depth) & (depth > 0.0)
    if not np.all(np.isfinite(volume)) or not np.any(volume > 0.0) or np.count_nonzero(good) < 2:
        return []
    radius = np.array([float(name) for name in radii])
    order = np.argsort(radius)
    nm = np.array(channels, dtype=float)[good]
    index = real[good] - 1j * imaginary[good]
    return [SizeDistribution("", radius[order], volume[order], nm, index, depth[good])]
