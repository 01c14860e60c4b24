"""Packages that are not installed with the program, and the sentence that says how to install one."""

from __future__ import annotations

import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

from twilight.base.errors import TwilightError

REQUIREMENTS = {
    "astropy": "astropy>=6.1,<9",
    "cfgrib": "cfgrib>=0.9.15,<0.10",
    "colour_hdri": "colour-hdri>=0.2.6,<0.3",
    "OpenImageIO": "openimageio>=3,<4",
    "dask_jobqueue": "dask-jobqueue>=0.9,<1",
    "imageio_ffmpeg": "imageio-ffmpeg>=0.5,<1",
    "mitsuba": "mitsuba>=3.6,<4",
    "pillow_heif": "pillow-heif>=0.22,<2",
    "rasterio": "rasterio>=1.3,<2",
    "rawpy": "rawpy>=0.21,<1",
    "sasktran2": "sasktran2>=2025.10",
    "speclite": "speclite>=0.20,<2",
}
"""What pip is asked for, by the name that is imported: the extras of pyproject.toml."""


def missing(module: str, what: str) -> TwilightError:
    """The sentence that `what` (e.g. `reading RAW files`) needs a module that is not there, with the command for it."""
    requirement = REQUIREMENTS[module]
    name = requirement.partition(">")[0]
    return TwilightError(f"{what} needs the package {name}: {_pip()} install '{requirement}'")


def is_installed(module: str) -> bool:
    """Whether a module can be imported, without importing it."""
    try:
        return find_spec(module) is not None
    except ValueError:  # sys.modules holds None in its place
        return False


def _pip() -> str:
    """The pip of this Python: `pip` where the shell finds that one, else by its path."""
    found = shutil.which("pip")
    if found is not None and Path(found).parent == Path(sys.executable).parent:
        return "pip"
    return f"{sys.executable} -m pip"
