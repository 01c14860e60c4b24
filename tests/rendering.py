"""What the tests of the command line share: a solver cheap enough to run often, its climate, and a call."""

import sys
import types

import numpy as np
import pytest
from typer.testing import CliRunner

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.sections import option, settings
from twilight.cli.app import app
from twilight.io import picture
from twilight.solvers.base import BareField, Capabilities

SHEETS = {"contact-sheet.png", "series.csv", "series.nc", "skies.jsonl"}
FILES = {"sky.png", "sky.rgb.exr", "sky.spectral.exr", "sky.h5", "sun.json", "sky.usda"}
TABLE = "altitude_km,wavelength_nm,air_scattering_per_km,aerosol_extinction_per_km,aerosol_single_scattering_albedo,"
TABLE += "aerosol_asymmetry,absorption_per_km,refractivity\n"
TABLE_NM = (420, 495, 570, 645)
SMALL = ["texture={azimuth_count: 36, elevation_count: 9}", "output.width=64", "output.spectral_width=32"]


@settings
class PlainSettings:
    brightness: float = option("of the sky above the horizon towards the sun [sr^-1]", default=0.01)
    fail_at_deg: float = option("a sun that cannot be computed", default=99.0)


class PlainField(BareField):
    """A sky that falls off with the angle from the sun's azimuth; its level is the medium's air at the ground."""

    def __init__(self, medium, settings, altitude_km):
        self.medium, self.settings, self.altitude_km = medium, settings, altitude_km

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        if sun_elevation_deg == self.settings.fail_at_deg:
            raise TwilightError(f"plain: a sun at {sun_elevation_deg} deg cannot be computed")
        level = self.settings.brightness * 10 ** (sun_elevation_deg / 10.0) * self.medium.air_scattering_per_km[0]
        shape = (2.0 + np.cos(np.radians(azimuth_deg))) * (1.0 + np.cos(np.radians(elevation_deg)))
        return shape[..., None] * level


@pytest.fixture
def plain(monkeypatch):
    """A registered solver `plain`; `calls` lists what `prepare` was asked for.  Pictures have a tenth of the pixels."""
    module = types.ModuleType("plain_solver")
    module.calls = []

    def prepare(medium, settings, *, observer_altitude_km=0.0, progress=None):
        module.calls.append((medium.wavelength_nm.tolist(), observer_altitude_km))
        if progress is not None:
            progress("half", 0.5)
        return PlainField(medium, settings, observer_altitude_km)

    module.prepare = prepare
    module.CAPABILITIES = Capabilities()
    module.QUALITIES = {"standard": PlainSettings(), "bright": PlainSettings(brightness=0.1)}
    monkeypatch.setitem(sys.modules, "plain_solver", module)
    monkeypatch.setitem(solvers.SOLVERS, "plain", "plain_solver")
    monkeypatch.setattr(solvers, "DEFAULT", "plain")
    for view, width in picture.DEFAULT_WIDTH.items():
        monkeypatch.setitem(picture.DEFAULT_WIDTH, view, width // 12 * 4)
    return module


@pytest.fixture
def table(tmp_path):
    """The tabulated climate of the interface between programs, two levels."""
    rows = [
        f"{z},{w},{1e-2 * s * (500 / w) ** 4},{5e-2 * s},0.9,0.7,0,0\n"
        for z, s in ((0, 1), (60, 1e-3))
        for w in TABLE_NM
    ]
    (tmp_path / "t1.csv").write_text(TABLE + "".join(rows))
    path = tmp_path / "T1.yaml"
    path.write_text("version: 1\nname: T1\nmedium: {table: t1.csv}\nground: {albedo: 0.0}\n")
    return path


def call(command, *arguments):
    """Run a command; renders are small unless a test says otherwise."""
    small = (
        [word for key in SMALL for word in ("--set", key)]
        if command == "render" and "texture={}" not in arguments
        else []
    )
    result = CliRunner().invoke(app, [command, *(str(a) for a in arguments), *small])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result
