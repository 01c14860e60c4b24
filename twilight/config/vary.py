"""The `vary:` section: which keys take which values, as axes whose product is the series; keys that are drawn."""

import hashlib
import os
import random
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, create_model, model_validator

from twilight.base.errors import TwilightError
from twilight.base.sections import Integer, ModelT, Number, Origins, Section, increase, key, unknown, validate

LIST = "list"
DRAWS = "draws"
"""Name of the axis of the keys that are drawn, and of the key that says how often."""
MAX_POINTS = 100_000
"""Most points of one axis."""
LONGEST_LABEL = 60
"""Characters of the folder of one value: two of them and the name of a file stay below the 255 of file systems."""
LARGEST = 1e150
"""Largest end of a range: a ratio or difference of two larger ones may be too large for a float."""

_FORMS = "a list, e.g. [0, 10], {from: 10, to: -18, count: 29}, or drawn, e.g. {uniform: [0.02, 0.6]}"
_End = Annotated[Number, Field(ge=-LARGEST, le=LARGEST)]


class _Range(Section):
    """Values between two, but for the key `from`, which is no name of Python."""

    to: _End = key(..., "the last value")
    count: Integer = key(..., "values, the ends among them", unit="1", ge=2, le=MAX_POINTS)
    scale: Literal["linear", "log"] = key("linear", "what is equally spaced: values, or their logarithms")

    @model_validator(mode="after")
    def _possible(self) -> "_Range":
        first = getattr(self, "from")
        if self.scale == "log" and not min(first, self.to) > 0:
            raise ValueError("a log scale needs from and to above 0")
        if first == self.to:
            raise ValueError(f"from and to are the same, {first:g}")
        return self

    def values(self) -> list[float]:
        """All of them."""
        ends, logarithmic = (getattr(self, "from"), self.to), self.scale == "log"
        return [_between(*ends, logarithmic, i / (self.count - 1)) for i in range(self.count)]


_FROM: Any = {"from": (_End, key(..., "the first value"))}
Range = create_model("Range", __base__=_Range, **_FROM)


class Distribution(Section):
    """What a key is drawn from: one of these."""

    uniform: tuple[_End, _End] | None = key(None, "lowest and highest of equally likely numbers")
    log_uniform: tuple[_End, _End] | None = key(None, "the same of numbers whose logarithms are equally likely")
    choice: tuple[Any, ...] | None = key(None, "equally likely values", min_length=1, max_length=MAX_POINTS)

    @model_validator(mode="after")
    def _one(self) -> "Distribution":
        if len(self.model_fields_set) != 1 or all(getattr(self, name) is None for name in self.model_fields_set):
            raise ValueError(f"must have one distribution and nothing beside it: {', '.join(type(self).model_fields)}")
        for name in ("uniform", "log_uniform"):
            ends = getattr(self, name)
            if ends and not (increase(ends) and (name == "uniform" or ends[0] > 0)):
                above = " above 0" if name == "log_uniform" else ""
                raise ValueError(
                    f"{name} must be two numbers{above}, the lower one first, got [{ends[0]:g}, {ends[1]:g}]"
                )
        return self

    def at(self, fraction: float) -> Any:
        """The value below which a fraction of all lies, 0 to 1."""
        if self.choice is not None:
            return self.choice[min(int(fraction * len(self.choice)), len(self.choice) - 1)]
        ends = self.uniform or self.log_uniform
        assert ends is not None  # one of the three is there
        low, high = ends
        return _between(low, high, self.log_uniform is not None, fraction)


class Drawing(Section):
    """How keys are drawn: keys of a configuration beside `vary`."""

    draws: Integer | None = key(
        None, "how often the keys of vary that are drawn are drawn", unit="1", ge=1, le=MAX_POINTS
    )
    seed: Integer = key(0, "of the draws", unit="1", ge=0, le=2**31 - 1)
    validation: Number = key(0.1, "fraction of the draws that a sweep marks for validation", unit="1", ge=0.0, lt=1.0)


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


def axes_of(vary: Any, where: str, drawing: Mapping[str, Any]) -> tuple[Axis, ...]:
    """The axes of a `vary:` section; whether the keys and values are allowed is not looked at here.

    A key maps to a list of values, to a range {from, to, count, scale}, or to a distribution: {uniform: [low, high]},
    {log_uniform: [low, high]} or {choice: [values]}; `list` to mappings of keys that are taken as they are.  All keys
    with a distribution are one axis, a Latin hypercube: each distribution is cut into as many equally likely parts as
    there are draws, and every part is drawn from once.
    drawing: keys of `Drawing`, where they are set
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
        elif isinstance(value, Mapping) and not set(value).isdisjoint(Distribution.model_fields):
            place = place if drawn else len(axes)
            drawn[name] = _of(Distribution, value, f"{where}: vary: {name}")
        else:
            values = _values(value, f"{where}: vary: {name}")
            axes.append(Axis(name, tuple({name: v} for v in values), tuple(label(name, v) for v in values)))
    if drawn:
        axes.insert(place, _drawn(drawn, _of(Drawing, drawing, where), where))
    elif drawing:
        raise TwilightError(
            f"{where}: {next(iter(drawing))}: nothing in vary is drawn; give a key e.g. {{uniform: [0.02, 0.6]}}"
        )
    axes = [axis if len(set(axis.labels)) == len(axis.labels) else _told_apart(axis) for axis in axes]
    for axis in axes:
        if len(set(axis.labels)) < len(axis.labels):
            raise TwilightError(f"{where}: vary lists the same value twice ({axis.name})")
    seen: dict[str, str] = {}
    for axis in axes:
        for name in dict.fromkeys(k for point in axis.points for k in point):
            if name in seen:
                raise TwilightError(f"{where}: vary sets {name} twice, in {seen[name]} and in {axis.name}")
            seen[name] = axis.name
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
    for name in value:
        if name not in Range.model_fields:
            allowed = [*Range.model_fields, *Distribution.model_fields]
            raise TwilightError(f"{where}: {name} {unknown(str(name), allowed)}")
    return _of(Range, value, where).values()


def _of(model: type[ModelT], value: Mapping[str, Any], where: str) -> ModelT:
    return validate(model, value, Origins({(): where}))


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


def _drawn(drawn: Mapping[str, Distribution], drawing: Drawing, where: str) -> Axis:
    count = drawing.draws
    if count is None:
        raise TwilightError(f"{where}: vary: {next(iter(drawn))} is drawn; set how often, e.g. draws: 200")
    points: list[dict[str, Any]] = [{} for _ in range(count)]
    for name, distribution in drawn.items():
        # random() of a given seed is promised to stay the same; a stream of its own keeps one key's values when
        # another key is added
        stream = random.Random(f"{drawing.seed}/{name}")
        order = sorted((stream.random(), i) for i in range(count))
        for point, (_, i) in zip(points, order, strict=True):
            point[name] = distribution.at((i + stream.random()) / count)
    width = len(str(count - 1))
    labels = tuple(f"draw-{i:0{width}d}" for i in range(count))
    return Axis(DRAWS, tuple(points), labels, _held_out(count, drawing.validation, drawing.seed))


def _held_out(count: int, fraction: float, seed: int) -> frozenset[int]:
    """The draws for validation: the nearest whole number of them, one at least and not all; none of a fraction of 0."""
    held = min(max(1, round(fraction * count)), count - 1) if fraction else 0
    stream = random.Random(f"{seed}/split")
    order = sorted((stream.random(), i) for i in range(count))
    return frozenset(i for _, i in order[:held])


def _between(first: float, last: float, logarithmic: bool, fraction: float) -> float:
    """The value at a fraction of the way, rounded to 12 digits so that 0.1 stays 0.1."""
    if logarithmic:
        value = first * (last / first) ** fraction
    else:
        value = first + (last - first) * fraction
    return float(f"{value:.12g}")
