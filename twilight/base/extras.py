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
    "colour": "colour-science>=0.4.6,<0.5",
    "colour_hdri": "colour-hdri>=0.2.6,<0.3",
    "OpenImageIO": "openimageio>=3,<4",
    "dask": "dask>=2025.5",
    "dask_jobqueue": "dask-jobqueue>=0.9,<1",
    "distributed": "distributed>=2025.5",
    "imageio_ffmpeg": "imageio-ffmpeg>=0.5,<1",
    "matplotlib": "matplotlib>=3.8,<4",
    "mitsuba": "mitsuba>=3.6,<4",
    "pillow_heif": "pillow-heif>=0.22,<2",
    "rasterio": "rasterio>=1.3,<2",
    "rawpy": "rawpy>=0.21,<1",
    "sasktran2": "sasktran2>=2025.10",
    "speclite": "speclite>=0.20,<2",
    "xarray": "xarray>=2025.9.1",
    "zarr": "zarr>=3.1,<4",
}
"""What pip is asked for, by the name that is imported: the extras of pyproject.toml."""


def missing(module: str, what: str, *others: str) -> TwilightError:
    """The sentence that `what` (e.g. `reading RAW files`) needs modules that are not there, with the command for it."""
    requirements = [REQUIREMENTS[name] for name in (module, *others)]
    names = ", ".join(requirement.partition(">")[0] for requirement in requirements)
    quoted = " ".join(f"'{requirement}'" for requirement in requirements)
    return TwilightError(f"{what} needs the package{'s' if others else ''} {names}: {_pip()} install {quoted}")


def require(what: str, *modules: str) -> None:
    """TwilightError where modules are not installed that `what` needs: asked before anything is computed."""
    absent = [module for module in modules if not is_installed(module)]
    if absent:
        raise missing(absent[0], what, *absent[1:])


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
