"""Profiles of the stratosphere's extinction: SAGE III/ISS, OSIRIS, and tables.

References
----------
SAGE III/ISS solar events, level 2, HDF5 (NASA/LARC/SD/ASDC, version 5.1): compound tables in `Section 5.0 -
Altitude-based Data`, `Section 6.0 - Aerosol Information` and `Section 6.1 - Aerosol Extinction profiles`, as NASA's
reader read_solar.py has them; -999 is missing.
OSIRIS on Odin, level 2 aerosol (University of Saskatchewan, version 5.07), HDF-EOS5: swath `OSIRIS\\Odin Aerosol MART`,
AerosolExtinction [km^-1] at 750 nm over Altitude [km] and scans; -9999 is missing.
"""

from __future__ import annotations

import csv
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from twilight.atmosphere.measured.parts import ExtinctionProfile, Reading
from twilight.base.errors import TwilightError
from twilight.io.air.lines import number, read_lines, reason
from twilight.io.air.place_and_time import PlaceAndTime, spoken

SAGE_MARK = "Section 6.1 - Aerosol Extinction profiles"
OSIRIS_MARK = "HDFEOS/SWATHS/OSIRIS\\Odin Aerosol MART"
OSIRIS_NM = 750.0
OSIRIS_EPOCH = datetime(1993, 1, 1, tzinfo=UTC)
"""Times of HDF-EOS5 swaths are seconds since then (TAI93)."""

MISSING = -900.0
"""Below it a number is a fill value."""

LARGEST_PER_KM = 1.0
"""Denser than any aerosol of the stratosphere: a cloud, or another unit [km^-1]."""

TABLE_COLUMN = re.compile(r"(\d+(?:\.\d+)?)\s?nm")


def hdf5_kind(path: Path) -> str:
    """`sage`, `osiris`, or `map` for any other HDF5 file."""
    import h5py  # start-up

    try:
        with h5py.File(path, "r") as file:
            return "sage" if SAGE_MARK in file else "osiris" if OSIRIS_MARK in file else "map"
    except (OSError, RuntimeError, KeyError) as error:
        raise TwilightError(f"{path}: is damaged, or no HDF5: {reason(error)}") from None


def is_table(lines: list[str]) -> bool:
    """Whether the first line that is no comment names altitudes and wavelengths: altitude_km, 520nm, ..."""
    head = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    names = [name.strip() for name in head.split(",")]
    return "altitude_km" in names and any(TABLE_COLUMN.fullmatch(name) for name in names)


def read_extinction(path: Path, kind: str, wanted: PlaceAndTime) -> Reading:
    """The profile of a file that is nearest.

    kind: `sage`, `osiris` or `table`.  Errors: TwilightError with the file and the table.
    """
    if kind == "table":
        return Reading("stratosphere", (_table(path),))
    import h5py  # start-up

    try:
        with h5py.File(path, "r") as file:
            return Reading("stratosphere", ((_sage if kind == "sage" else _osiris)(path, file, wanted),))
    except (KeyError, ValueError, IndexError, TypeError, OSError, RuntimeError, OverflowError) as error:
        raise TwilightError(f"{path}: lacks what a file of {kind.upper()} has: {reason(error)}") from None


def _cleaned(path: Path, source: str, altitude_km: np.ndarray, nm: np.ndarray, per_km: np.ndarray) -> ExtinctionProfile:
    """The altitudes that have extinction; of several channels two at least."""
    values = np.where((per_km > MISSING) & np.isfinite(per_km), per_km, np.nan)
    dense = values[(altitude_km > 8.0)]
    if dense.size and np.nanmax(np.where(np.isfinite(dense), dense, 0.0)) > LARGEST_PER_KM:
        raise TwilightError(
            f"{path}: extinction above 8 km reaches {np.nanmax(dense):.3g}; allowed is up to {LARGEST_PER_KM:g} km^-1"
        )
    order = np.argsort(nm)
    good = np.count_nonzero(values > 0.0, axis=1) >= min(2, nm.size)
    if np.count_nonzero(good) < 2:
        raise TwilightError(f"{path}: {source}: has {np.count_nonzero(good)} altitudes with extinction; needed are 2")
    return ExtinctionProfile(source, altitude_km[good], nm[order], values[good][:, order])


def _sage(path: Path, file: Any, wanted: PlaceAndTime) -> ExtinctionProfile:
    table = np.asarray(file[f"{SAGE_MARK}/Aerosol Extinction profiles"])
    about = np.asarray(file["Section 6.0 - Aerosol Information/Aerosol Information"])
    altitude = np.asarray(file["Section 5.0 - Altitude-based Data/Altitude Data"])["Geometric Altitude (km)"]
    header = np.asarray(file["Section 1.0 - File Header/Section 1.0 - File Header"])[0]
    nm = np.asarray(about["Aerosol Channels Centerline Wavelengths (nm)"], dtype=float)
    columns = [table[f"Aerosol Extinction Channel {i + 1} (km-1)"] for i in range(nm.size)]
    per_km = np.stack(columns, axis=1).astype(float)
    event, date, north, east, clock = (float(header[i]) for i in (0, 2, 3, 4, 5))
    time = datetime.strptime(f"{int(date):08d}{int(clock):06d}", "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    where = f"{north:.1f} N {east:.1f} E, {spoken(time)}{wanted.away(time, north, east)}"
    source = f"SAGE III/ISS {path.name}: event {int(event)}, {where}"
    return _cleaned(path, source, np.asarray(altitude[: len(per_km)], dtype=float), nm, per_km)


def _osiris(path: Path, file: Any, wanted: PlaceAndTime) -> ExtinctionProfile:
    swath = file[OSIRIS_MARK]
    altitude, latitude, longitude, seconds = (
        np.atleast_1d(np.asarray(swath[f"Geolocation Fields/{name}"], dtype=float))
        for name in ("Altitude", "Latitude", "Longitude", "Time")
    )
    per_km = np.asarray(swath["Data Fields/AerosolExtinction"], dtype=float)
    per_km = per_km if per_km.shape == (latitude.size, altitude.size) else per_km.T
    usable = np.count_nonzero(per_km > 0.0, axis=1) >= 2
    if per_km.shape != (latitude.size, altitude.size) or not usable.any():
        raise TwilightError(f"{path}: has no scan with extinction")
    scans = np.flatnonzero(usable)
    times = [OSIRIS_EPOCH + timedelta(seconds=float(seconds[i])) for i in scans]
    places = [(float(latitude[i]), float(longitude[i] + 180.0) % 360.0 - 180.0) for i in scans]
    if wanted.latitude_deg is not None:
        chosen = int(np.argmin([wanted.km_to(*place) or 0.0 for place in places]))
    else:
        chosen = wanted.nearest(times, path, "scans")
    i, time, (north, east) = int(scans[chosen]), times[chosen], places[chosen]
    source = f"OSIRIS {path.name}: {north:.1f} N {east:.1f} E, {spoken(time)}{wanted.away(time, north, east)}"
    return _cleaned(path, source, altitude, np.array([OSIRIS_NM]), per_km[i][:, None])


def _table(path: Path) -> ExtinctionProfile:
    lines = [(i, line) for i, line in enumerate(read_lines(path), start=1) if line.strip() and not line.startswith("#")]
    names = [name.strip() for name in next(csv.reader([lines[0][1]]))]
    channels = sorted((float(m[1]), k) for k, name in enumerate(names) if (m := TABLE_COLUMN.fullmatch(name)))
    rows = []
    for i, line in lines[1:]:
        fields = next(csv.reader([line]))
        if len(fields) != len(names):
            raise TwilightError(f"{path}: line {i}: has {len(fields)} values, the columns are {len(names)}")
        z = number(path, i, "altitude_km", fields[names.index("altitude_km")], 0.0, 120.0, "km")
        values = [
            number(path, i, names[k], fields[k], -9999.0, 10.0, "km^-1") if fields[k].strip() else np.nan
            for _, k in channels
        ]
        rows.append((z, values))
    rows.sort(key=lambda row: row[0])
    altitude = np.array([z for z, _ in rows])
    if altitude.size < 2 or np.any(np.diff(altitude) <= 0.0):
        raise TwilightError(f"{path}: has {altitude.size} rows; needed are 2 altitudes or more, each once")
    nm = np.array([w for w, _ in channels])
    return _cleaned(path, f"table {path.name}", altitude, nm, np.array([v for _, v in rows], dtype=float))
