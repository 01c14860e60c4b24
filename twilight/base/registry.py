"""What the program has by name, and what other packages add by entry points."""

from collections.abc import Iterator, Mapping, MutableMapping
from functools import cached_property
from importlib import import_module
from typing import Any

from twilight.base.errors import TwilightError


class Registry(MutableMapping[str, str]):
    """Where each thing is found, by its name: `module`, or `module:object`.

    The entry points of other packages are read when a name is asked for that the program does not have itself, or all
    names are.  group: of entry points, e.g. twilight.solvers; own: what comes with the program."""

    def __init__(self, group: str, own: Mapping[str, str]):
        self.group, self.own = group, dict(own)

    @cached_property
    def others(self) -> dict[str, str]:
        """What other packages add.  Errors: TwilightError for a name that is there twice."""
        from importlib.metadata import entry_points  # start-up: most runs need the program's own alone

        found: dict[str, str] = {}
        for point in entry_points(group=self.group):
            package = point.dist.name if point.dist is not None else point.value
            if point.name in self.own or found.get(point.name, point.value) != point.value:
                raise TwilightError(f"{package}: its entry point {point.name} of {self.group} has a name that is taken")
            found[point.name] = point.value
        return found

    def load(self, name: str) -> Any:
        """The module or object of a name.

        Errors: KeyError for a name that is not there; TwilightError where another package's cannot be imported.
        """
        where = self[name]
        module, _, attribute = where.partition(":")
        try:
            found = import_module(module)
            return getattr(found, attribute) if attribute else found
        except (ImportError, AttributeError) as error:
            if name in self.own:
                raise
            raise TwilightError(f"{name}: the entry point {where} of {self.group} cannot be loaded: {error}") from error

    def __getitem__(self, name: str) -> str:
        return self.own[name] if name in self.own else self.others[name]

    def __setitem__(self, name: str, where: str) -> None:
        self.own[name] = where

    def __delitem__(self, name: str) -> None:
        del self.own[name]

    def __iter__(self) -> Iterator[str]:
        return iter((*self.own, *self.others))

    def __len__(self) -> int:
        return len(self.own) + len(self.others)
