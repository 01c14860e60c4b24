"""The files that a render can write, by the names that a configuration (`output.files`) and `--only` give them.

A new one is two files: a module with a function of (rendered: Rendered, folder: Path, options: Options) that returns
the paths it wrote (types: `twilight.io.rendered`), and a line here that names both; its file's name goes to OF_A_SKY.
Another package adds one by an entry point of the group `twilight.formats`, whose value is `module:function`; the names
of the files are the function's attribute `files` (docs/examples/extension).
"""

from functools import cache

from twilight.base.errors import TwilightError
from twilight.base.registry import Registry

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
