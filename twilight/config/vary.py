"""The `vary:` section: which keys take which values, as axes whose product is the series."""

from __future__ import annotations

import random
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twilight.base.errors import TwilightError
from twilight.config.validate import unknown

LIST = "list"
LATIN_HYPERCUBE = "latin_hypercube"
SCALES = ("linear", "log")
MAX_POINTS = 100_000
"""Most points of one axis."""
LARGEST = 1e150
"""Largest end of a range; a whole number may be too large for a float, a ratio or difference of two floats as well."""

_FORMS = "a list, e.g. [0, 10], or {from: 10, to: -18, count: 29}"


@dataclass(frozen=True)
class Axis:
    """One axis of a series: a dotted key with its values, or several keys that change together.

    name: the key, `list` or `latin_hypercube`; points: dotted keys and values of each point; labels: for folders.
    """

    name: str
    points: tuple[dict[str, Any], ...]
    labels: tuple[str, ...]


def axes_of(vary: Any, where: str) -> tuple[Axis, ...]:
    """The axes of a `vary:` section; whether the keys and values are allowed is not looked at here.

    A key maps to a list of values or to a range {from, to, count, scale}; `list` to mappings of keys that are taken as
    they are; `latin_hypercube` to {samples, seed, ranges}, where each key's range {from, to, scale} or list of choices
    is cut into as many equal parts as there are samples, and every part is drawn from once.
    Errors: TwilightError for any other form.
    """
    if not isinstance(vary, Mapping):
        raise TwilightError(f"{where}: vary must map dotted keys to lists, e.g. {{observer.altitude_km: [0, 10]}}")
    axes = []
    for name, value in vary.items():
        if name == LIST:
            axes.append(_listed(value, where))
        elif name == LATIN_HYPERCUBE:
            axes.append(_hypercube(value, where))
        else:
            values = _values(value, f"{where}: vary: {name}")
            axes.append(Axis(name, tuple({name: v} for v in values), tuple(label(name, v) for v in values)))
    for axis in axes:
        if len(set(axis.labels)) < len(axis.labels):
            raise TwilightError(f"{where}: vary lists the same value twice ({axis.name})")
    seen: dict[str, str] = {}
    for axis in axes:
        for key in dict.fromkeys(k for point in axis.points for k in point):
            if key in seen:
                raise TwilightError(f"{where}: vary sets {key} twice, in {seen[key]} and in {axis.name}")
            seen[key] = axis.name
    return tuple(axes)


def label(name: str, value: Any) -> str:
    """A folder's name: `continental-average`, `relative_humidity_percent=80`."""
    if name == "climate":
        text = Path(value).stem if isinstance(value, str) else "climate"
        if isinstance(value, Mapping):
            text = str(value.get("name", text))
    elif isinstance(value, dict):
        text = "_".join(label(k, v) for k, v in value.items())
    else:
        text = f"{name.rsplit('.', 1)[-1]}={value}"
    return re.sub(r"[^\w.=+-]+", "-", text).strip("-.") or "case"


def _values(value: Any, where: str) -> list[Any]:
    if isinstance(value, list | tuple) and value:
        if len(value) > MAX_POINTS:
            raise TwilightError(f"{where} holds {len(value)} values; allowed are lists of {MAX_POINTS} at most")
        return list(value)
    if not isinstance(value, Mapping):
        raise TwilightError(f"{where} must be one of the lists and ranges that vary takes: {_FORMS}")
    first, last, scale = _range(value, where, ("count",))
    count = _whole(value.get("count"), f"{where}.count", 2, MAX_POINTS)
    return [_between(first, last, scale, i / (count - 1)) for i in range(count)]


def _listed(value: Any, where: str) -> Axis:
    where = f"{where}: vary: {LIST}"
    if not isinstance(value, list | tuple) or not value or not all(isinstance(v, Mapping) and v for v in value):
        raise TwilightError(
            f"{where} must be a list of mappings of dotted keys, e.g. [{{climate: urban, ground.albedo: 0.2}}]"
        )
    if len(value) > MAX_POINTS:
        raise TwilightError(f"{where} holds {len(value)} scenes; allowed are {MAX_POINTS} at most")
    keys = set(value[0])
    for i, point in enumerate(value):
        if set(point) != keys:
            odd = sorted(keys ^ set(point))[0]
            raise TwilightError(
                f"{where}[{i}] must have the same keys as the first scene; {odd} is in one of them only"
            )
    points = tuple(dict(point) for point in value)
    return Axis(LIST, points, tuple("_".join(label(k, v) for k, v in point.items()) for point in points))


def _hypercube(value: Any, where: str) -> Axis:
    where = f"{where}: vary: {LATIN_HYPERCUBE}"
    if not isinstance(value, Mapping):
        raise TwilightError(f"{where} must be a mapping with the keys samples, seed, ranges")
    _check_keys(value, ("samples", "seed", "ranges"), where)
    samples = _whole(value.get("samples"), f"{where}.samples", 1, MAX_POINTS)
    seed = _whole(value.get("seed", 0), f"{where}.seed", 0, 2**31 - 1)
    ranges = value.get("ranges")
    if not isinstance(ranges, Mapping) or not ranges:
        raise TwilightError(f"{where}.ranges must map dotted keys to {{from, to, scale}} or to lists of choices")
    points: list[dict[str, Any]] = [{} for _ in range(samples)]
    for key, spread in ranges.items():
        # random() of a given seed is promised to stay the same; a stream of its own keeps one key's values when
        # another key is added
        stream = random.Random(f"{seed}/{key}")
        order = sorted((stream.random(), i) for i in range(samples))
        fractions = [(i + stream.random()) / samples for _, i in order]
        if isinstance(spread, list | tuple) and spread:
            drawn = [spread[min(int(fraction * len(spread)), len(spread) - 1)] for fraction in fractions]
        elif isinstance(spread, Mapping):
            first, last, scale = _range(spread, f"{where}.ranges: {key}")
            drawn = [_between(first, last, scale, fraction) for fraction in fractions]
        else:
            raise TwilightError(f"{where}.ranges: {key} must be {{from, to, scale}} or a list of choices")
        for point, value_drawn in zip(points, drawn, strict=True):
            point[key] = value_drawn
    width = len(str(samples - 1))
    return Axis(LATIN_HYPERCUBE, tuple(points), tuple(f"sample-{i:0{width}d}" for i in range(samples)))


def _check_keys(value: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in value:
        if key not in known:
            raise TwilightError(f"{where}.{key} {unknown(str(key), known)}")


def _range(value: Mapping[str, Any], where: str, more: tuple[str, ...] = ()) -> tuple[float, float, str]:
    _check_keys(value, ("from", "to", *more, "scale"), where)
    ends = []
    for name in ("from", "to"):
        end = value.get(name)
        if isinstance(end, bool) or not isinstance(end, int | float) or not -LARGEST <= end <= LARGEST:
            raise TwilightError(f"{where}.{name} must be a number, got {end!r}")
        ends.append(float(end))
    scale = value.get("scale", "linear")
    if scale not in SCALES:
        raise TwilightError(f"{where}.scale must be one of {', '.join(SCALES)}, got {scale!r}")
    if scale == "log" and not min(ends) > 0:
        raise TwilightError(f"{where}: a log scale needs from and to above 0")
    if ends[0] == ends[1]:
        raise TwilightError(f"{where}: from and to are the same, {ends[0]:g}")
    return ends[0], ends[1], scale


def _between(first: float, last: float, scale: str, fraction: float) -> float:
    """The value at a fraction of the way, rounded to 12 digits so that 0.1 stays 0.1."""
    if scale == "log":
        value = first * (last / first) ** fraction
    else:
        value = first + (last - first) * fraction
    return float(f"{value:.12g}")


def _whole(value: Any, where: str, low: int, high: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise TwilightError(f"{where} must be a whole number from {low} to {high}, got {value!r}")
    return value
