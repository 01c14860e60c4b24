"""Reading a YAML document written by a person: YAML 1.2 scalars, no surprises, one sentence when it is wrong."""

import math
import re
from pathlib import Path
from typing import Any

import yaml

from twilight.base.errors import TwilightError
from twilight.base.reading import read_text
from twilight.base.sections import dotted

MAX_BYTES = 1_000_000
"""A document is a page of text; anything longer is a mistake."""


class _Loader(yaml.SafeLoader):
    """SafeLoader with the scalars of YAML 1.2: `16:00` and `2003-12-08` stay text, `no` is not false, 1e-3 a number."""

    yaml_implicit_resolvers: dict = {}  # noqa: RUF012 - PyYAML's own protocol

    def compose_node(self, parent, index):
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()
            raise yaml.composer.ComposerError(None, None, "aliases (*name) are not allowed", event.start_mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node, deep=False):
        seen: dict[str, Any] = {}
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise yaml.constructor.ConstructorError(None, None, f"key {key!r} must be text", key_node.start_mark)
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key} is given twice (first on line {seen[key]})", key_node.start_mark
                )
            seen[key] = key_node.start_mark.line + 1
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver("tag:yaml.org,2002:null", re.compile(r"^(?:~|null|Null|NULL|)$"), ["~", "n", "N", ""])
_Loader.add_implicit_resolver("tag:yaml.org,2002:bool", re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"), None)
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", re.compile(r"^[-+]?(?:0|[1-9][0-9]*)$"), None)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^(?:[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN))$"),
    None,
)


def parse_yaml(text: str, source: str) -> Any:
    """The plain data in `text`; `source` names it in errors.

    Errors: TwilightError for invalid YAML (with line and column), a key given twice, aliases, keys that are not text,
    numbers that are not finite, or nesting deeper than any document of ours.
    """
    try:
        data = yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{source}:{mark.line + 1}:{mark.column + 1}" if mark else source
        raise TwilightError(f"{where}: not valid YAML: {error.problem or error.context}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise TwilightError(f"{source}: not valid YAML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise TwilightError(f"{source}: not valid YAML: nested too deeply") from None
    _refuse_infinite(data, source, ())
    return data


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file; TwilightError when it cannot be read, is too long, or is not a mapping."""
    data = parse_yaml(read_text(path, MAX_BYTES), str(path))
    if not isinstance(data, dict):
        raise TwilightError(f"{path}: must hold keys and values such as `version: 1`")
    return data


def _refuse_infinite(data: Any, source: str, path: tuple) -> None:
    if isinstance(data, float) and not math.isfinite(data):
        raise TwilightError(f"{source}: {dotted(path)} must be a finite number")
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        _refuse_infinite(value, source, (*path, key))
