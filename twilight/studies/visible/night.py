"""When stars, planets and the moon stand out from the sky of a night."""

from __future__ import annotations

import datetime as dt
from typing import Any, NamedTuple

import numpy as np

from twilight.engine.visibility import NakedEye
from twilight.sky.objects import Track, tracks

STEP_S = 180.0
"""Time between the moments at which margins are computed [s]; they are linear in between."""


class Sighting(NamedTuple):
    """While an object is seen: first and last moment, elevations [deg] of sun and object (apparent) then, and how many
    magnitudes it is brighter than the limit at best.
    """

    name: str
    first: dt.datetime
    last: dt.datetime
    sun_deg: tuple[float, float]
    elevation_deg: tuple[float, float]
    magnitude: float
    best_margin_mag: float


class Outlook(NamedTuple):
    """An object over a night: when it is seen, and by how many magnitudes at most it is brighter than the limit.

    best_margin_mag: negative for what is never seen, -inf for what stays below the horizon.
    """

    sightings: list[Sighting]
    best_margin_mag: float


def sightings(
    eye: NakedEye,
    latitude_deg: float,
    longitude_deg: float,
    names: list[str],
    first: dt.datetime,
    last: dt.datetime,
    step_s: float = STEP_S,
) -> dict[str, Outlook]:
    """When each object of `twilight.sky.objects.names_of` is seen between two moments."""
    count = int(np.ceil((last - first).total_seconds() / step_s)) + 1
    times = [first + dt.timedelta(seconds=k * step_s) for k in range(count)]
    moments = eye.moments(latitude_deg, longitude_deg, times)
    found = tracks(names, times, latitude_deg, longitude_deg, eye.altitude_km)
    margins = eye.margins(found, moments)
    sun_deg = moments.sun_elevation_deg
    return {
        track.name: Outlook(_spans(track, times, sun_deg, row, eye.seen_at), float(row.max()))
        for track, row in zip(found, margins, strict=True)
    }


def _spans(
    track: Track, moments: list[dt.datetime], sun_deg: np.ndarray, margin: np.ndarray, seen_at: Any
) -> list[Sighting]:
    """Spans of a margin that is not negative, with ends where it crosses 0, linearly."""
    up = margin >= 0.0
    apparent_deg, _ = seen_at(track.elevation_deg)
    found = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], up, [False]]).astype(int)))
    for begin, end in edges.reshape(-1, 2):
        ends = []
        for inside, outside in ((begin, begin - 1), (end - 1, end)):
            f = 0.0
            if 0 <= outside < len(moments) and np.isfinite(margin[outside]):
                f = float(margin[inside] / (margin[inside] - margin[outside]))
            there = outside if f else inside
            step = moments[there] - moments[inside]
            height = float(apparent_deg[inside] + f * (apparent_deg[there] - apparent_deg[inside]))
            sun = float(sun_deg[inside] + f * (sun_deg[there] - sun_deg[inside]))
            ends.append((moments[inside] + f * step, sun, height))
        (first, sun_a, height_a), (last, sun_b, height_b) = ends
        best = int(begin + np.argmax(margin[begin:end]))
        brightest = float(track.magnitude[best]), float(margin[best])
        found.append(Sighting(track.name, first, last, (sun_a, sun_b), (height_a, height_b), *brightest))
    return found
