"""What a user may set: sections of documents and settings of solvers, as pydantic's models, and the one sentence that
pydantic's findings become, which names file, key and what is allowed.

A key says its default, its help, its unit and its limits in one place; validation, ranges, `twilight show` and the JSON
schema read them there.
"""

import functools
import itertools
import types
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Annotated, Any, Literal, TypeVar, Union, dataclass_transform, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict, Tag, ValidationError
from pydantic.dataclasses import dataclass as pydantic_dataclass
from pydantic.fields import FieldInfo

from twilight.base.errors import TwilightError

ModelT = TypeVar("ModelT", bound=BaseModel)
SettingsT = TypeVar("SettingsT")
Number = Annotated[float, Strict()]
"""A number, not text that looks like one and not true or false."""
Integer = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]


def one_line(path: str) -> str:
    """The path of a file; ValueError for what cannot be one."""
    if "\0" in path or "\n" in path:
        raise ValueError("must be the path of a file")
    return path


FilePath = Annotated[str, AfterValidator(one_line)]


def increase(values: Iterable[Any]) -> bool:
    """Whether each of the values is larger than the one before."""
    return all(a < b for a, b in itertools.pairwise(values))


def _increasing(values: tuple[Any, ...]) -> tuple[Any, ...]:
    if not increase(values):
        raise ValueError("must increase")
    return values


Increasing = AfterValidator(_increasing)
"""Annotates a list each of whose values is larger than the one before."""


def check_lengths(section: Any, first: str, *others: str) -> None:
    """ValueError where lists of a section are not as long as its first one."""
    for name in others:
        if len(getattr(section, name)) != len(getattr(section, first)):
            lengths = len(getattr(section, first)), len(getattr(section, name))
            raise ValueError(f"has {lengths[0]} {first} but {lengths[1]} {name}; they must be as many")


class Section(BaseModel):
    """One mapping of a document: frozen, without unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)


def key(default: Any, help: str, *, unit: str = "", **limits: Any) -> Any:
    """A key of a section: its default, its unit, one line of help, and limits such as `ge`, `le`, `min_length`.

    Without a unit (text, switches, choices, sections) pass none; a pure number has the unit "1".
    """
    made = {"default_factory": default} if callable(default) else {"default": default}
    return Field(**made, description=help, json_schema_extra={"unit": unit} if unit else None, **limits)


def option(help: str, *, default: Any, expert: bool = False, **limits: Any) -> Any:
    """An option of a solver: what it is for, its default, and limits such as `ge`, `le`.

    expert: it stands under `solver.expert`, not right under `solver`.
    """
    return Field(default=default, description=help, json_schema_extra={"expert": True} if expert else None, **limits)


def option_fields(settings: Any) -> Mapping[str, FieldInfo]:
    """The options of a solver's settings, or of their class, in their order."""
    return settings.__pydantic_fields__


def option_name(settings: Any, name: str) -> str:
    """An option as a configuration has it: `solver.max_orders`, `solver.expert.degree`."""
    extra = option_fields(settings)[name].json_schema_extra
    return f"solver.expert.{name}" if isinstance(extra, dict) and extra.get("expert") else f"solver.{name}"


@dataclass_transform(frozen_default=True, field_specifiers=(option,))
def settings(cls: type[SettingsT]) -> type[SettingsT]:
    """The class as a frozen dataclass of options, which refuses a value out of range.

    Errors: TwilightError with one sentence that names the option, `solver.NAME`, and what is allowed; a
    `__post_init__` raises its own.
    """
    made: Any = pydantic_dataclass(
        cls, frozen=True, config=ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
    )
    init = made.__init__

    @functools.wraps(init)
    def checked(self: Any, *args: Any, **options: Any) -> None:
        try:
            init(self, *args, **options)
        except ValidationError as error:
            raise TwilightError(_of_option(made, error.errors(include_url=False)[0])) from None

    made.__init__ = checked
    return made


def _of_option(made: Any, found: Any) -> str:
    """The sentence of an option that pydantic refuses."""
    name = str(found["loc"][0])
    info = option_fields(made).get(name)
    if info is None:
        return f"solver.{name} {unknown(name, option_fields(made))}"
    return f"{option_name(made, name)} must be {allowed(info.annotation, info.metadata)}, got {short(found['input'])}"


def dotted(path: tuple) -> str:
    """`aerosol.components.waso`, `wavelengths.list_nm[2]`."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


@dataclass(frozen=True)
class Origins:
    """Which file, or which command-line option, each part of a document came from.

    `of` maps a key path to where it was read; the longest path that fits wins.  Inside a climate's own file its keys
    are at the top level, so `hidden` paths are left out of what is shown.
    """

    of: Mapping[tuple, str] = field(default_factory=dict)
    hidden: frozenset[tuple] = frozenset()

    def describe(self, path: tuple) -> tuple[str, tuple]:
        """(where, the key path as it is written there)."""
        for length in range(len(path), -1, -1):
            head = path[:length]
            if head in self.of:
                cut = max((len(h) for h in self.hidden if head[: len(h)] == h), default=0)
                return self.of[head], path[cut:]
        return "configuration", path


def validate(model: type[ModelT], data: Any, origins: Origins) -> ModelT:
    """`data` as a `model`; TwilightError with the first thing that is wrong (unknown keys first)."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        found = error.errors(include_url=False)
    # a list whose only entry is wrong counts as too short as well
    inside = {e["loc"][:n] for e in found for n in range(len(e["loc"]))}
    found = [e for e in found if e["type"] != "too_short" or e["loc"] not in inside]
    found.sort(key=lambda e: e["type"] != "extra_forbidden")
    sentences = []
    for e in found:
        loc = tuple(part for part in e["loc"] if not _is_tag(part))
        where, shown = origins.describe(tuple(part for part in loc if part != "[key]"))
        text = f"{where}: {_without_repeated_key(where, _sentence(model, e, shown))}"
        if text not in sentences:
            sentences.append(text)
    more = f" ({len(sentences) - 1} more after this)" if len(sentences) > 1 else ""
    raise TwilightError(sentences[0] + more)


def _without_repeated_key(where: str, sentence: str) -> str:
    """The sentence without the key at its head that the option before it is named after: `--at: at: ...`."""
    key, colon, rest = sentence.partition(": ")
    return rest if colon and where == f"--{key.rpartition('.')[2].replace('_', '-')}" else sentence


def unknown(name: str, known: Iterable[str], what: str = "key") -> str:
    """`x is not a key; did you mean y? Allowed are ...`; without the question where nothing is like it."""
    from difflib import get_close_matches  # start-up

    names = [str(k) for k in known]
    near = get_close_matches(name, names, n=1)
    hint = f"; did you mean {near[0].rsplit('.', 1)[-1]}?" if near else ";"
    return f"is not a {what}{hint} allowed {'are' if len(names) > 1 else 'is'} {', '.join(sorted(names))}"


def allowed(annotation: Any, metadata: Iterable[Any] = (), unit: str = "") -> str:
    """What a value may be, in words: `a number from 0 to 99 (%)`, `one of ciddor, haber, none`."""
    metadata = list(metadata)
    origin = get_origin(annotation)
    if origin is Annotated:
        inner, *extra = get_args(annotation)
        return allowed(inner, [*metadata, *_flat(extra)], unit)
    if origin in (Union, types.UnionType):
        return " or ".join("null" if a is type(None) else allowed(a, metadata, unit) for a in get_args(annotation))
    if origin is Literal:
        values = [str(v) for v in get_args(annotation)]
        return values[0] if len(values) == 1 else f"one of {', '.join(values)}"
    if origin in (tuple, list):
        return f"a list, each {allowed(get_args(annotation)[0], (), unit)}"
    if origin is dict:
        keys, values = get_args(annotation)
        if values is Any:
            return "a mapping of keys and values"
        return f"a mapping with keys {allowed(keys)} and values {allowed(values, (), unit)}"
    if _is_section(annotation):
        return f"a mapping with the keys {', '.join(annotation.model_fields)}"
    nouns = {
        bool: "true or false",
        int: "a whole number",
        float: "a number",
        str: "text",
        datetime: "a date and time such as 2003-12-08T16:00",
    }
    noun = nouns.get(annotation, "a value" if annotation is Any else getattr(annotation, "__name__", str(annotation)))
    return noun + _limits(metadata) + (f" ({unit})" if unit and unit != "1" else "")


def _limits(metadata: list[Any]) -> str:
    bound = {name: getattr(m, name) for m in metadata for name in ("ge", "gt", "le", "lt") if hasattr(m, name)}
    said = {name: str(value) if isinstance(value, int) else f"{value:g}" for name, value in bound.items()}
    low = said["ge"] if "ge" in said else f"above {said['gt']}" if "gt" in said else ""
    high = said["le"] if "le" in said else f"below {said['lt']}" if "lt" in said else ""
    if "ge" in bound and high:
        return f" from {low} to {high}"
    if low and high:
        return f" {low} and up to {high}"
    return f" of at least {low}" if "ge" in bound else f" of at most {high}" if high else f" {low}" if low else ""


def _flat(metadata: Iterable[Any]) -> list[Any]:
    return [m for item in metadata for m in (item.metadata if isinstance(item, FieldInfo) else [item])]


def _is_tag(part: Any) -> bool:
    return isinstance(part, str) and part.startswith("<") and part.endswith(">")


def _sentence(model: type[BaseModel], error: Any, shown: tuple) -> str:
    name = dotted(shown) or "the document"
    kind = error["type"]
    if kind == "model_type" and not shown:
        return f"must hold keys and values, got {short(error['input'])}"
    if kind == "extra_forbidden":
        owner = _section(model, error["loc"][:-1])
        return f"{name} {unknown(str(error['loc'][-1]), owner.model_fields if owner else ())}"
    if error["loc"] and error["loc"][-1] == "[key]":
        choices = str(error.get("ctx", {}).get("expected", "")).replace(" or ", ", ").replace("'", "").split(", ")
        return f"{name} {unknown(str(error['input']), choices)}"
    field_info = _field(model, error["loc"])
    help_text = f" ({field_info.description})" if field_info is not None and field_info.description else ""
    if kind == "missing":
        return f"{name} is missing{help_text}"
    if kind == "value_error":
        text = str(error["ctx"]["error"])
        owner = _section(model, error["loc"])
        begins_with_a_key = owner is not None and text.split()[0].split(".")[0].rstrip(":,") in owner.model_fields
        return f"{name}{'.' if begins_with_a_key else ' '}{text}" if shown else text
    if kind.endswith(("too_short", "too_long")):
        limits = {k: v for k, v in error["ctx"].items() if k in ("min_length", "max_length")}
        bound = " and ".join(f"{'at least' if k == 'min_length' else 'at most'} {v}" for k, v in limits.items())
        things = "character" if kind.startswith("string") else "value"
        things += "" if set(limits.values()) == {1} else "s"
        return f"{name} must hold {bound} {things}, got {len(error['input'])}"
    sections = [m for m in _members(field_info.annotation) if _is_section(m)] if field_info else []
    if help_text and len(sections) > 1:
        return f"{name} must be a mapping{help_text}, got {short(error['input'])}"
    if field_info is None:
        return f"{name}: {error['msg'][0].lower()}{error['msg'][1:]}, got {short(error['input'])}"
    extra = field_info.json_schema_extra
    unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
    value_type = _entry(field_info.annotation) if name.endswith("]") or _is_entry(error["loc"], field_info) else None
    text = allowed(value_type or field_info.annotation, field_info.metadata if value_type is None else (), unit)
    return f"{name} must be {text}, got {short(error['input'])}"


def _is_section(annotation: Any) -> bool:
    bare = _bare(annotation)
    return isinstance(bare, type) and issubclass(bare, BaseModel)


def _is_entry(loc: tuple, field_info: FieldInfo) -> bool:
    """Whether `loc` ends at an entry of a mapping such as `components`, not at the mapping."""
    holders = [a for a in _members(field_info.annotation) if get_origin(a) is dict]
    return bool(holders) and loc[-1] in _keys(holders[0])


def _keys(mapping: Any) -> tuple:
    return get_args(get_args(mapping)[0])


def _entry(annotation: Any) -> Any:
    """The type of the entries of a list or mapping, None for anything else."""
    for member in map(_bare, _members(annotation)):
        if get_origin(member) in (tuple, dict):
            return get_args(member)[1 if get_origin(member) is dict else 0]
    return None


def short(value: Any) -> str:
    text = "null" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _field(model: type[BaseModel], loc: tuple) -> FieldInfo | None:
    """The field that holds the value at `loc`; for an entry of a list or mapping, the field of that list or mapping."""
    parts = [p for p in loc if not _is_tag(p) and p != "[key]"]
    for length in range(len(parts), 0, -1):
        if isinstance(parts[length - 1], str):
            position = [i for i, p in enumerate(loc) if p is parts[length - 1]][-1]
            owner = _section(model, loc[:position])
            if owner is not None and parts[length - 1] in owner.model_fields:
                return owner.model_fields[str(parts[length - 1])]
    return None


def _section(model: type[BaseModel], loc: tuple) -> type[BaseModel] | None:
    """The model at `loc`, where tags of unions such as `<elevation>` choose among their members."""
    current: Any = model
    for part in loc:
        members = list(_members(current))
        if _is_tag(part):
            current = next((a for a in members if part in _tags(a)), None)
        elif isinstance(part, int):
            lists = (get_args(a)[0] for a in map(_bare, members) if get_origin(a) in (tuple, list))
            current = next(lists, None)
        else:
            owners = [m.model_fields for m in map(_bare, members) if _is_section(m)]
            current = next((fields[part].annotation for fields in owners if part in fields), None)
        if current is None:
            return None
    return next((m for m in map(_bare, _members(current)) if _is_section(m)), None)


def _members(annotation: Any) -> Iterable[Any]:
    """The members of a union, the annotation itself otherwise; `Annotated` around a member is kept for its tag."""
    bare = _bare(annotation)
    return get_args(bare) if get_origin(bare) in (Union, types.UnionType) else (annotation,)


def _bare(annotation: Any) -> Any:
    return get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation


def _tags(annotation: Any) -> list[str]:
    metadata = get_args(annotation)[1:] if get_origin(annotation) is Annotated else ()
    return [str(m.tag) for m in metadata if isinstance(m, Tag)]
