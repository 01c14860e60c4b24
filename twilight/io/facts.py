"""Numbers about a sky, its sun and its observer: under which names files and datasets hold each of them.

A new one is a field of `Sky` and a line here; `sky.h5`, the headers of EXR files and the skies of datasets follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from twilight.io.labels import attributes
from twilight.sky.sky import Sky


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
    found = {fact.field: number(*filter(None, (fact.variable, fact.swept))) for fact in FACTS}
    return {field: value for field, value in found.items() if value is not None}
