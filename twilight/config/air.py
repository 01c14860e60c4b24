"""The section `air:` of a climate: files of measurements that the air of a place and date is taken from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import field_validator, model_validator

from twilight.base.sections import Number, Section, key, one_line
from twilight.config.sun import Moment

AIR_FILES = ("sounding", "reanalysis", "aeronet")
"""Keys that name a file, or a list of files."""

Files = str | tuple[str, ...] | None


class Air(Section):
    """Files that pressure, temperature, gases and particles are taken from; the rest is as the climate has it.

    What they hold becomes atmosphere.levels, gases, clouds, and aerosol.optical_depths or modes.
    """

    sounding: Files = key(
        None, "file (or a list of files): University of Wyoming's list or CSV, IGRA version 2", min_length=1
    )
    reanalysis: Files = key(
        None, "ERA5, CAMS or MERRA-2 in netCDF or GRIB: t, q, o3, z on pressure levels; aod550, tco3", min_length=1
    )
    aeronet: Files = key(None, "AERONET version 3: optical depths, or an inversion with all products", min_length=1)
    at: Moment | None = key(None, "date and time with its offset, 2026-06-21T21:45+02:00; unset: the (first) sun's")
    latitude_deg: Number | None = key(None, "north positive; unset: the sun's place", unit="deg", ge=-90.0, le=90.0)
    longitude_deg: Number | None = key(None, "east positive; unset: the sun's place", unit="deg", ge=-360.0, le=360.0)
    sources: dict[str, str] = key(dict, "where each part of the air is from; written by the program")

    @field_validator(*AIR_FILES)
    @classmethod
    def _are_paths(cls, value: Files) -> Files:
        for path in (value,) if isinstance(value, str) else value or ():
            one_line(path)
        return value

    @model_validator(mode="after")
    def _check(self) -> Air:
        if self.at is not None and self.at.tzinfo is None:
            raise ValueError("at needs its offset, e.g. 2026-06-21T21:45+02:00")
        if (self.latitude_deg is None) != (self.longitude_deg is None):
            raise ValueError("needs both latitude_deg and longitude_deg, or neither")
        return self

    def files(self) -> Iterator[tuple[str, str]]:
        """Key and path of each file."""
        for name in AIR_FILES:
            value = getattr(self, name)
            for path in (value,) if isinstance(value, str) else value or ():
                yield name, path

    @property
    def asks(self) -> bool:
        """Whether anything is still to be taken from files."""
        return any(getattr(self, name) for name in AIR_FILES)


def air_files(climate: Any) -> Iterator[tuple[Any, tuple[str, ...], Any, None]]:
    """As `climate_files`, for the files of `air` (plain data), which have no SHA-256."""
    air = climate.get("air") if isinstance(climate, dict) else None
    if not isinstance(air, dict):
        return
    for name in AIR_FILES:
        value = air.get(name)
        if isinstance(value, str) and value:
            yield air, ("air",), name, None
        elif isinstance(value, list | tuple):
            for i, path in enumerate(value):
                if isinstance(path, str) and path:
                    yield value, ("air", name), i, None
