"""`Registry`: what the program has by name, and what other packages add by entry points.

The files that a render can write, by the names that a configuration (`output.files`) and `--only` give them.  A new one
is two files: a module with a function of (rendered: Rendered, folder: Path, options: Options) that returns the paths it
wrote (types: `twilight.io.rendered`), and a line here that names both; its file's name goes to OF_A_SKY.  Another
package adds one by an entry point of the group `twilight.formats`, whose value is `module:function`; the names of the
files are the function's attribute `files` (docs/examples/extension).
"""

from collections.abc import Iterator, Mapping, MutableMapping
from functools import cache, cached_property
from importlib import import_module
from typing import Any

from twilight.base.errors import TwilightError


class Registry(MutableMapping[str, str]):
    """Where each thing is found, by its name: `module`, or `module:object`.

    The entry points of other packages are read when a name is asked for that the program does not have itself, or all
    names are.

    Parameters
    ----------
    group
        The group of entry points, e.g. twilight.solvers.
    own
        What comes with the program.
    """

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


FORMATS = Registry(
    "twilight.formats",
    {
        "png": "twilight.io.picture:write_pictures",
        "rgb": "twilight.io.environment_files:write_rgb",
        "spectral": "twilight.io.environment_files:write_spectral",
        "h5": "twilight.io.netcdf:write_h5",
        "polarisation": "twilight.io.picture:write_polarisation",
        "sun": "twilight.io.lamps:write_sun",
        "moon": "twilight.io.lamps:write_moon",
        "disc": "twilight.io.sun_picture:write_picture",
        "view": "twilight.io.view:write_view",
    },
)
OF_A_SKY = (
    "sky.png", "sky.wide.png", "sky.panorama.png", "sky.fisheye.png", "sky.luminance.json", "sky.rgb.exr",
    "sky.rgb.hdr", "sky.spectral.exr", "sky.h5", "sky.polarisation.png", "sun.json", "sky.usda", "moon.json", "sun.png",
    "sky.view.png", "sky.view.exr",
)  # fmt: skip
"""Names of all files that the program's own formats write."""
WHERE_POLARISED = ("polarisation",)
"""Files that are written by themselves for polarised skies alone."""
WHERE_DISC = ("disc",)
"""Files that are written by themselves for skies that know the sun's disc."""
WHERE_MOON = ("moon",)
"""Files that are written by themselves for skies that know the moon."""
WITH_VIEW = ("h5", "view", "sun")
"""Files that are written by themselves where the observer has a view, and nothing else is."""


@cache
def file_names() -> tuple[str, ...]:
    """Names of all files that a render may write, other packages' among them; a render knows its own by them."""
    return (*OF_A_SKY, *(file for name in FORMATS.others for file in _files_of(name)))


def _files_of(name: str) -> tuple[str, ...]:
    """The names of the files of another package's format."""
    files = getattr(FORMATS.load(name), "files", ())
    if isinstance(files, str) or not files or not all(isinstance(file, str) for file in files):
        raise TwilightError(f"{name}: {FORMATS[name]} lacks the attribute files, the names of what it writes")
    return tuple(files)


def check_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names; ValueError with a sentence for one that no file has, and for one that is given twice."""
    for name in names:
        if name not in FORMATS:
            raise ValueError(f"holds {name!r}, which is not a file of a render; allowed are {', '.join(FORMATS)}")
    if len(set(names)) < len(names):
        raise ValueError("lists the same file twice")
    return names
