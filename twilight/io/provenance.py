"""Provenance of every file (resolved configuration, version, hash, run time), names of a sky's numbers.

A new number about a sky is a field of `Sky` and an entry of `FACTS`; `sky.h5`, EXR headers and datasets follow.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from datetime import date, datetime
from os import PathLike, fspath
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from twilight import __version__
from twilight.base.errors import TwilightError
from twilight.io.labels import attributes
from twilight.sky.sky import Sky

PREFIX = "twilight"
"""Names of our own attributes in image files start with this."""


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (datetime, date)):
        return value.isoformat()
    if isinstance(value, PathLike):
        return fspath(value)
    raise TwilightError(f"provenance: a value of type {type(value).__name__} cannot be written as JSON")


def to_json(value: Any) -> str:
    """JSON text with keys in order; numpy values, dates and paths become plain.  TwilightError for anything else."""
    return json.dumps(value, sort_keys=True, default=_plain, ensure_ascii=False)


def configuration_hash(configuration: Any) -> str:
    """SHA-256 of the configuration's JSON text, hexadecimal."""
    return hashlib.sha256(to_json(configuration).encode()).hexdigest()


def differences(a: Any, b: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any, Any]]:
    """The keys in which two documents of plain values differ, with both values; None: the key is not there."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in dict.fromkeys([*a, *b]):
            yield from differences(a.get(key), b.get(key), (*path, key))
    elif a != b:
        yield path, a, b


def provenance_fields(provenance: dict) -> dict[str, str | float]:
    """The fields that every file carries, from ``Sky.provenance``.

    twilight_version, configuration (JSON), configuration_hash, run_time_s (where known) and provenance (JSON of all
    else).  A hash that is not given is that of the configuration.
    """
    rest = dict(provenance)
    configuration = rest.pop("configuration", {})
    fields: dict[str, str | float] = {
        "twilight_version": str(rest.pop("version", __version__)),
        "configuration": to_json(configuration),
        "configuration_hash": str(rest.pop("hash", configuration_hash(configuration))),
    }
    if "run_time_s" in rest:
        fields["run_time_s"] = float(rest.pop("run_time_s"))
    fields["provenance"] = to_json(rest)
    return fields


def provenance_from_fields(fields: dict) -> dict:
    """The inverse of ``provenance_fields``; absent fields are left out."""
    provenance = json.loads(fields.get("provenance", "{}"))
    if "configuration" in fields:
        provenance["configuration"] = json.loads(fields["configuration"])
    for key, field in (("version", "twilight_version"), ("hash", "configuration_hash")):
        if field in fields:
            provenance[key] = str(fields[field])
    if "run_time_s" in fields:
        provenance["run_time_s"] = float(fields["run_time_s"])
    return provenance


class Fact(NamedTuple):
    """One number.

    field: of `Sky`; variable: of `sky.h5` and of datasets, which `labels` describes; more: its other attributes;
    swept: what a sweep over the key calls its coordinate; header: attribute of EXR files, which holds `header_per`
    times the number.
    """

    field: str
    variable: str
    more: Mapping[str, str] = MappingProxyType({})
    swept: str | None = None
    header: str | None = None
    header_per: float = 1.0


FACTS = (
    Fact("sun_elevation_deg", "solar_elevation_angle"),
    Fact("apparent_sun_elevation_deg", "apparent_solar_elevation_angle"),
    Fact("sun_azimuth_deg", "solar_azimuth_angle"),
    Fact("distance_au", "earth_sun_distance"),
    Fact(
        "observer_altitude_km",
        "observer_altitude",
        {"positive": "up"},
        swept="observer_altitude_km",
        header="altitude",
        header_per=1000.0,
    ),
    Fact("latitude_deg", "latitude", swept="sun_latitude_deg", header="latitude"),
    Fact("longitude_deg", "longitude", swept="sun_longitude_deg", header="longitude"),
)


def coordinates_of(sky: Sky) -> dict[str, tuple[tuple[()], float, dict[str, str]]]:
    """The facts that a sky knows, as scalar coordinates of a dataset."""
    return {
        fact.variable: ((), value, attributes(fact.variable) | {**fact.more})
        for fact in FACTS
        if (value := getattr(sky, fact.field)) is not None
    }


def header_of(sky: Sky) -> dict[str, float]:
    """The facts that a sky knows and EXR has attributes for."""
    return {
        fact.header: float(value * fact.header_per)
        for fact in FACTS
        if fact.header and (value := getattr(sky, fact.field)) is not None
    }


def fields_from(number: Callable[..., float | None]) -> dict[str, Any]:
    """Fields of `Sky` as a file or dataset knows them; `number` gives what stands under one of some names, or None."""
    fields = {fact.field: number(*filter(None, (fact.variable, fact.swept))) for fact in FACTS}
    return {field: value for field, value in fields.items() if value is not None}
