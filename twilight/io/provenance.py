"""What every file says about itself: the resolved configuration, the version, the hash, the run time."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from datetime import date, datetime
from os import PathLike, fspath
from typing import Any

import numpy as np

from twilight import __version__
from twilight.base.errors import TwilightError

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
