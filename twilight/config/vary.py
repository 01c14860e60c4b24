"""The `vary:` section: which keys take which values, as axes whose product is the series; keys that are drawn."""

import hashlib
import os
import random
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from twilight.base.errors import TwilightError
from twilight.base.sections import short, unknown

LIST = "list"
DRAWS = "draws"
"""Name of the axis of the keys that are drawn, and of the key that says how often."""
DRAWING = (DRAWS, "seed", "validation")
"""Keys beside `vary` that say how keys are drawn."""
DISTRIBUTIONS = ("uniform", "log_uniform", "choice")
VALIDATION = 0.1
"""Fraction of the draws that is held out where `validation` is not set."""
SCALES = ("linear", "log")
MAX_POINTS = 100_000
"""Most points of one axis."""
LONGEST_LABEL = 60
"""Characters of the folder of one value: two of them and the name of a file stay below the 255 of file systems."""
LARGEST = 1e150
"""Largest end of a range; a whole number may be too large for a float, a ratio or difference of two floats as well."""

_FORMS = "a list, e.g. [0, 10], {from: 10, to: -18, count: 29}, or drawn, e.g. {uniform: [0.02, 0.6]}"


@dataclass(frozen=True)
class Axis:
    """One axis of a series: a dotted key with its values, or several keys that change together.

    name: the key, `list` or `draws`; points: dotted keys and values of each point; labels: for folders; held_out: the
    draws, by their index, that are for validation.
    """

    name: str
    points: tuple[dict[str, Any], ...]
    labels: tuple[str, ...]
    held_out: frozenset[int] = frozenset()


def axes_of(vary: Any, where: str, drawing: Mapping[str, Any] | None = None) -> tuple[Axis, ...]:
    """The axes of a `vary:` section; whether the keys and values are allowed is not looked at here.

    A key maps to a list of values, to a range {from, to, count, scale}, or to a distribution: {uniform: [low, high]},
    {log_uniform: [low, high]} or {choice: [values]}; `list` to mappings of keys that are taken as they are.  All keys
    with a distribution are one axis, a Latin hypercube: each distribution is cut into as many equally likely parts as
    there are draws, and every part is drawn from once.
    drawing: `draws`, `seed` (0) and `validation` (the fraction held out), where they are set
    Errors: TwilightError for any other form.
    """
    if not isinstance(vary, Mapping):
        raise TwilightError(f"{where}: vary must map dotted keys to lists, e.g. {{observer.altitude_km: [0, 10]}}")
    axes: list[Axis] = []
    drawn: dict[str, Distribution] = {}
    place = 0
    for name, value in vary.items():
        if name == LIST:
            axes.append(_listed(value, where))
        elif isinstance(value, Mapping) and not set(value).isdisjoint(DISTRIBUTIONS):
            place = place if drawn else len(axes)
            drawn[name] = _distribution(value, f"{where}: vary: {name}")
        else:
            values = _values(value, f"{where}: vary: {name}")
            axes.append(Axis(name, tuple({name: v} for v in values), tuple(label(name, v) for v in values)))
    if drawn:
        axes.insert(place, _drawn(drawn, drawing or {}, where))
    elif drawing:
        key = next(iter(drawing))
        raise TwilightError(f"{where}: {key}: nothing in vary is drawn; give a key e.g. {{uniform: [0.02, 0.6]}}")
    axes = [axis if len(set(axis.labels)) == len(axis.labels) else _told_apart(axis) for axis in axes]
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
    return _folder_name(text)


def _folder_name(text: str) -> str:
    """A text as the name of a folder; a long one ends in its hash."""
    name = re.sub(r"[^\w.=+-]+", "-", text).strip("-.") or "case"
    if len(name) <= LONGEST_LABEL:
        return name
    return f"{name[: LONGEST_LABEL - 9]}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def _told_apart(axis: Axis) -> Axis:
    """The axis, where climates' files of one name in several folders are called by these too."""
    folders = [os.path.dirname(c) if isinstance(c := point.get("climate"), str) else "" for point in axis.points]
    common = len(os.path.commonpath(map(os.path.abspath, folders)))
    labels = [
        _folder_name(f"{os.path.abspath(folder)[common:]}-{text}") if axis.labels.count(text) > 1 else text
        for text, folder in zip(axis.labels, folders, strict=True)
    ]
    return replace(axis, labels=tuple(labels))


def _values(value: Any, where: str) -> list[Any]:
    if isinstance(value, list | tuple) and value:
        if len(value) > MAX_POINTS:
            raise TwilightError(f"{where} holds {len(value)} values; allowed are lists of {MAX_POINTS} at most")
        return list(value)
    if not isinstance(value, Mapping):
        raise TwilightError(f"{where} must be one of the lists and ranges that vary takes: {_FORMS}")
    first, last, scale = _range(value, where)
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


Distribution = Callable[[float], Any]
"""The value below which a fraction of all lies, 0 to 1."""


def _distribution(value: Mapping[str, Any], where: str) -> Distribution:
    if len(value) != 1:
        raise TwilightError(f"{where} must have one distribution and nothing beside it: {', '.join(DISTRIBUTIONS)}")
    name, given = next(iter(value.items()))
    where = f"{where}.{name}"
    if name == "choice":
        if not isinstance(given, list | tuple) or not 0 < len(given) <= MAX_POINTS:
            raise TwilightError(f"{where} must be a list of 1 to {MAX_POINTS} values, e.g. [50, 70, 80]")
        return lambda fraction: given[min(int(fraction * len(given)), len(given) - 1)]
    if not isinstance(given, list | tuple) or len(given) != 2:
        raise TwilightError(f"{where} must be two numbers, the lowest and the highest, e.g. [0.02, 0.6]")
    low, high = (_number(end, where) for end in given)
    scale = "log" if name == "log_uniform" else "linear"
    if not low < high or (scale == "log" and not low > 0):
        above = " above 0" if scale == "log" else ""
        raise TwilightError(f"{where} must be two numbers{above}, the lower one first, got [{low:g}, {high:g}]")
    return lambda fraction: _between(low, high, scale, fraction)


def _drawn(drawn: Mapping[str, Distribution], drawing: Mapping[str, Any], where: str) -> Axis:
    if drawing.get(DRAWS) is None:
        raise TwilightError(f"{where}: vary: {next(iter(drawn))} is drawn; set how often, e.g. draws: 200")
    count = _whole(drawing[DRAWS], f"{where}: {DRAWS}", 1, MAX_POINTS)
    seed = _whole(drawing.get("seed", 0), f"{where}: seed", 0, 2**31 - 1)
    fraction = drawing.get("validation", VALIDATION)
    if isinstance(fraction, bool) or not isinstance(fraction, int | float) or not 0.0 <= fraction < 1.0:
        raise TwilightError(f"{where}: validation must be a number from 0 to below 1, got {fraction!r}")
    points: list[dict[str, Any]] = [{} for _ in range(count)]
    for key, distribution in drawn.items():
        # random() of a given seed is promised to stay the same; a stream of its own keeps one key's values when
        # another key is added
        stream = random.Random(f"{seed}/{key}")
        order = sorted((stream.random(), i) for i in range(count))
        for point, (_, i) in zip(points, order, strict=True):
            point[key] = distribution((i + stream.random()) / count)
    width = len(str(count - 1))
    labels = tuple(f"draw-{i:0{width}d}" for i in range(count))
    return Axis(DRAWS, tuple(points), labels, _held_out(count, fraction, seed))


def _held_out(count: int, fraction: float, seed: int) -> frozenset[int]:
    """The draws for validation: the nearest whole number of them, one at least and not all; none of a fraction of 0."""
    held = min(max(1, round(fraction * count)), count - 1) if fraction else 0
    stream = random.Random(f"{seed}/split")
    order = sorted((stream.random(), i) for i in range(count))
    return frozenset(i for _, i in order[:held])


def _check_keys(value: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in value:
        if key not in known:
            raise TwilightError(f"{where}.{key} {unknown(str(key), known)}")


def _range(value: Mapping[str, Any], where: str) -> tuple[float, float, str]:
    _check_keys(value, ("from", "to", "count", "scale", *DISTRIBUTIONS), where)
    ends = [_number(value.get(name), f"{where}.{name}") for name in ("from", "to")]
    scale = value.get("scale", "linear")
    if scale not in SCALES:
        raise TwilightError(f"{where}.scale must be one of {', '.join(SCALES)}, got {scale!r}")
    if scale == "log" and not min(ends) > 0:
        raise TwilightError(f"{where}: a log scale needs from and to above 0")
    if ends[0] == ends[1]:
        raise TwilightError(f"{where}: from and to are the same, {ends[0]:g}")
    return ends[0], ends[1], scale


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not -LARGEST <= value <= LARGEST:
        raise TwilightError(f"{where} must be a number, got {short(value)}")
    return float(value)


def _between(first: float, last: float, scale: str, fraction: float) -> float:
    """The value at a fraction of the way, rounded to 12 digits so that 0.1 stays 0.1."""
    if scale == "log":
        value = first * (last / first) ** fraction
    else:
        value = first + (last - first) * fraction
    return float(f"{value:.12g}")


def _whole(value: Any, where: str, low: int, high: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise TwilightError(f"{where} must be a whole number from {low} to {high}, got {short(value)}")
    return value
