"""The solver compact: `prepare`, the interface of all solvers, and the field of a file fitted to one climate."""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.solvers.base import BareField
from twilight.solvers.compact.checks import checked_directions, checked_observer, rows_and_columns
from twilight.solvers.compact.clear_air import ClearAirModel
from twilight.solvers.compact.clear_air_field import ClearAirField
from twilight.solvers.compact.compact_sky import CompactSky, CompactSkyError
from twilight.solvers.compact.recognise import recognise

SHIPPED = Path(__file__).resolve().parents[2] / "data" / "compact"
"""Folder of the models that come with the package."""

HIGHEST_OBSERVER_KM = 0.1
"""Altitude above the ground [km] up to which models of one climate give the sky seen from the ground."""

CLEAR_AIR = "clear-air"
"""Name of the model of all clear air."""


@dataclass(frozen=True)
class CompactSettings:
    """polarisation: the Stokes parameters Q and U too, where the model has them: that of clear air has
    model: clear-air, the model of all clear air; continental-average, which is that climate alone; or the file that
        `twilight fit compact` wrote for a climate
    model_sha256: of that file, hexadecimal, where it must be that one; empty: any
    """

    polarisation: bool = True
    model: str = CLEAR_AIR
    model_sha256: str = ""


QUALITIES: dict[str, CompactSettings] = {"standard": CompactSettings()}


def _path(model: str) -> Path:
    """The file of a model, given by its name or path; TwilightError where there is none."""
    shipped = sorted(path.stem for path in SHIPPED.glob("*.npz"))
    if model in shipped:
        return SHIPPED / f"{model}.npz"
    path = Path(model)
    if not path.is_file():
        raise TwilightError(
            f"solver.model: there is no compact model {model}; allowed is {', '.join(shipped)}, or the file that "
            "`twilight fit compact CLIMATE --output FILE.npz` wrote"
        )
    return path


def _sha256(path: Path) -> str:
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise TwilightError(f"solver.model: {path}: cannot be read: {error.strerror or error}") from None


@functools.lru_cache(maxsize=1)
def _clear_air_model(path: Path) -> ClearAirModel:
    return ClearAirModel.load(path)


@functools.lru_cache(maxsize=4)
def _climate_model(path: Path, sha256: str) -> CompactSky:
    """The model of a file, cached as long as the file is the same."""
    try:
        return CompactSky.load(path)
    except CompactSkyError as error:
        raise TwilightError(f"solver.model: {error}") from None


def recorded(settings: CompactSettings) -> CompactSettings:
    """The settings for the record in files: the model's file by its name and the SHA-256 of its content."""
    path = _path(settings.model)
    name = settings.model if path.parent == SHIPPED else path.name
    return replace(settings, model=name, model_sha256=_sha256(path))


def prepare(
    medium: Medium,
    settings: CompactSettings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> ClimateField | ClearAirField:
    """The skies of a medium whose air is that of the model.

    Errors: TwilightError for a model that cannot be read, an observer higher than it knows, and a medium of other air
    or beyond the loads, ozone columns and wavelengths of the model.
    """
    settings = settings or QUALITIES["standard"]
    path = _path(settings.model)
    if settings.model_sha256 and settings.model_sha256 != _sha256(path):
        raise TwilightError(f"solver.model: {path.name} is not the file that solver.model_sha256 names")
    if settings.model == CLEAR_AIR:
        return ClearAirField(medium, _clear_air_model(path), observer_altitude_km, settings.polarisation)
    checked_observer(medium, observer_altitude_km, HIGHEST_OBSERVER_KM)
    return ClimateField(medium, _climate_model(path, _sha256(path)), path.stem)


class ClimateField(BareField):
    """The skies of one aerosol load, ozone column and ground, for any sun from the zenith to the end of twilight."""

    def __init__(self, medium: Medium, model: CompactSky, name: str):
        self.medium, self.model = medium, model
        self.air = recognise(medium, model, name)
        ozone = model.ozone_reference_du if self.air.ozone_column_du is None else self.air.ozone_column_du
        self.facts = {"aerosol_optical_depth_550nm": self.air.optical_depth_550nm, "ozone_column_du": ozone}

    def radiance(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], shape of the directions plus (W,); angles in degrees, azimuth from the sun.

        Errors: TwilightError for a sun or a direction that the model does not have: -18 to 90 deg, 0 to 90 deg; and for
        another observer than one on the ground.
        """
        checked_observer(self.medium, observer_altitude_km, HIGHEST_OBSERVER_KM)
        suns = self.model.sun_elevation_deg
        elevation, azimuth = checked_directions(sun_elevation_deg, suns, elevation_deg, azimuth_deg)
        sky = self.model.sky(
            sun_elevation_deg,
            self.medium.wavelength_nm,
            self.air.optical_depth_550nm,
            self.medium.ground_albedo,
            self.air.ozone_column_du,
        )
        grid = rows_and_columns(elevation, azimuth)
        return sky.radiance(elevation, azimuth) if grid is None else sky.on_grid(*grid)
