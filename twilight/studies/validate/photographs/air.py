"""The skies of airs that photographs are fitted with: some fifteen by the solver `compact`, and what lies between them.

Of the first aerosol type the optical depth stands at all of its nodes, and each other parameter at its outer values
beside one of these.  Of another type one air is computed, at the best values of the first: what the type changes there
it changes everywhere, until a fit has come near enough for an air of its own.

Every sky is ln(XYZ) on rows that crowd at the horizon, as a cubic spline, so that a camera may be turned under it.
Between the airs it is a local cubic in the (transformed) optical depth and in the sun's elevation, plus for each other
parameter the parabola of its change.  So a trial is a weighted sum of splines, asked for a picture's directions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.clear_air.entry import ClearAir, skies
from twilight.config.load import load
from twilight.config.scene import PLACED_NM, Config
from twilight.numerics import spectrum
from twilight.scene.medium import climate_medium
from twilight.scene.usual import screen_of, usual_horizon
from twilight.sky import colour
from twilight.studies.validate.photographs.picture_sky import OBSERVER

WAVELENGTH_NM = np.array(PLACED_NM)
"""Wavelengths of the skies [nm]."""

SUN_DEG: tuple[float, float] = (-18.0, 90.0)
"""Suns that the solver knows [deg]."""

ROWS = np.linspace(0.0, 1.0, 19)
"""Rows of a sky: roots of their elevations over 90 deg."""
HEIGHT_STEP_KM = 0.02
"""Step of the aerosol's profile above a camera [km]; halving it moves no depth by 0.1 %."""
COLUMNS_DEG = np.arange(-30.0, 211.0, 7.5)
"""Columns of a sky, azimuths from the sun [deg]: beyond 0 and 180 its mirror images."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of the climate: the key it sets, its nodes (the first and last bound it), and its scale.

    Between nodes it is interpolated in ``scaled``, ln for an optical depth.  usual: what it is before a picture is
    seen, and the standard error of that; None: anything between the bounds alike.  source: of that, in words.
    """

    name: str
    key: str
    unit: str
    nodes: tuple[float, ...]
    logarithmic: bool = False
    usual: tuple[float, float] | None = None
    source: str = ""

    def scaled(self, value: Any) -> Any:
        """The value in which it is interpolated and fitted."""
        return np.log(value) if self.logarithmic else np.asarray(value, float)

    def value(self, scaled: Any) -> Any:
        """The inverse of ``scaled``."""
        return np.exp(scaled) if self.logarithmic else np.asarray(scaled, float)


AEROSOL = Parameter("aerosol", "aerosol.optical_depth_550nm", "1", (0.02, 0.07, 0.24, 0.8), logarithmic=True)
OTHERS = (
    Parameter("ozone", "gases.ozone.column_du", "DU", (200.0, 320.0, 450.0)),
    Parameter("albedo", "ground.albedo", "1", (0.0, 0.25, 0.6)),
)
"""What may be estimated besides the aerosol."""
OZONE_DU = 30.0
"""Standard deviation of the ozone of a day about the zonal mean of its place and season [DU]."""
OZONE_ANYWHERE_DU = 50.0
"""The same of a place and day that are not known: zonal means from 60 S to 60 N differ by 40 over the year [DU]."""
ALBEDO_ERROR = 0.15
"""Standard deviation of the albedo of a landscape about that of its climate: forest 0.1, sand 0.3, patches of snow."""
ALTITUDE_KM = 0.28
"""Mean altitude at which people are, distributed exponentially: a median of 194 m and a third below 100 m (Cohen and
Small 1998, PNAS 95, 14009) [km]."""
SUN = "sun"
"""Name of the parameter that is the sun's elevation."""


@dataclass(frozen=True)
class Design:
    """Which airs are computed: the aerosol first, the others varied about it; nodes: for each air all values.

    beside: at which of the aerosol's nodes the others are varied; None: they are not.
    """

    others: tuple[Parameter, ...]
    beside: int | None = 1

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (AEROSOL, *self.others)

    @property
    def nodes(self) -> list[dict[str, float]]:
        middle = {p.name: p.nodes[1] for p in self.others}
        rows = [{AEROSOL.name: value, **middle} for value in AEROSOL.nodes]
        if self.beside is not None:
            for p in self.others:
                for outer in (p.nodes[0], p.nodes[2]):
                    rows.append({AEROSOL.name: AEROSOL.nodes[self.beside], **middle, p.name: outer})
        return rows

    def weights(self, values: Mapping[str, Any]) -> np.ndarray:
        """Weights (..., M) of the nodes whose sum of ln(XYZ) is that of an air between them; values (...)."""
        x, target = AEROSOL.scaled(np.array(AEROSOL.nodes)), AEROSOL.scaled(np.asarray(values[AEROSOL.name], float))
        n = len(AEROSOL.nodes)
        out = np.zeros((*target.shape, len(self.nodes)))
        out[..., :n] = spectrum.hermite_matrix(x, target.ravel()).reshape(*target.shape, n)
        node = n
        for p in self.others if self.beside is not None else ():
            a, b, c = p.scaled(np.array(p.nodes))
            q = p.scaled(values[p.name])
            outer = ((q - b) * (q - c) / ((a - b) * (a - c)), (q - a) * (q - b) / ((c - a) * (c - b)))
            for weight in outer:
                out[..., node] += weight
                out[..., self.beside] -= weight
                node += 1
        return out


@dataclass(frozen=True, eq=False)
class Skies:
    """Skies of one aerosol type under one sun or several.

    sun_elevations_deg (S,): true; splines (M, S, rows, columns, 3): coefficients, of the design's airs, of ln(XYZ) in
        cd m^-2.  error: of these skies, in ln(luminance), at 95 % of the directions.
    """

    design: Design
    aerosol_type: str
    sun_elevations_deg: np.ndarray
    splines: np.ndarray
    error: float = 0.0

    def of_air(self, values: Mapping[str, float]) -> np.ndarray:
        """The splines (S, rows, columns, 3) of an air of the design."""
        return np.tensordot(self.design.weights(values), self.splines, 1)

    def of_sun(self, of_air: np.ndarray, sun_elevation_deg: float) -> np.ndarray:
        """The spline (rows, columns, 3) under one sun of those of an air."""
        suns = self.sun_elevations_deg
        if suns.size == 1:
            return of_air[0]
        return np.tensordot(spectrum.hermite_matrix(suns, np.array([sun_elevation_deg]))[0], of_air, 1)


def spline(log_xyz: np.ndarray) -> np.ndarray:
    """Coefficients (..., rows, columns, 3) of ln(XYZ) on the rows and columns of `Airs.log_xyz`."""
    pad = int(np.count_nonzero(COLUMNS_DEG < 0.0))
    whole = np.concatenate([log_xyz[..., pad:0:-1, :], log_xyz, log_xyz[..., -2 : -2 - pad : -1, :]], axis=-2)
    for axis, nodes in ((-2, COLUMNS_DEG), (-3, ROWS)):
        whole = np.moveaxis(make_interp_spline(nodes, np.moveaxis(whole, axis, 0), 3).c, 0, axis)
    return whole


_ROW_KNOTS = make_interp_spline(ROWS, ROWS, 3).t
_COLUMN_KNOTS = make_interp_spline(COLUMNS_DEG, COLUMNS_DEG, 3).t


def towards(coefficients: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
    """ln(XYZ) (n, 3) of a spline in directions (n,), azimuths from the sun; as at the horizon below it."""
    row = np.sqrt(np.clip(elevation_deg, 0.0, 90.0) / 90.0)
    column = np.abs(np.mod(azimuth_deg + 180.0, 360.0) - 180.0)
    down = BSpline.design_matrix(row, _ROW_KNOTS, 3).toarray()
    across = BSpline.design_matrix(column, _COLUMN_KNOTS, 3).toarray()
    partial = (down @ coefficients.reshape(ROWS.size, -1)).reshape(row.size, COLUMNS_DEG.size, 3)
    return np.einsum("nac,na->nc", partial, across)


class Airs:
    """The airs of a scene by `compact`, each solved once, whatever suns and directions are asked for.

    base: all that a design does not set.
    Errors: TwilightError for a scene without aerosol, and for an air that the solver does not know.
    """

    def __init__(self, base: Config, design: Design, progress: Progress = silent):
        if base.climate.medium is not None or base.climate.aerosol is None:
            raise TwilightError(f"{base.title}: has no aerosol to estimate; name a climate that has")
        if base.climate.clouds:
            raise TwilightError(f"{base.title}: has clouds, and clear sky is estimated; name a climate without")
        self.base, self.design, self.progress = base, design, progress
        self._airs: dict[tuple, ClearAir] = {}
        self._errors: dict[int, float] = {}
        self._splines: dict[tuple[tuple, float], np.ndarray] = {}

    def log_xyz(
        self, aerosol_type: str, values: Mapping[str, float], sun: float, elevation: np.ndarray, azimuth: np.ndarray
    ) -> np.ndarray:
        """ln(XYZ) (..., 3) of an air in directions [deg], azimuths from the sun.

        Errors: TwilightError for a sky that is black there.
        """
        return self._log_xyz(self._air(aerosol_type, values), sun, elevation, azimuth)

    def behind_nothing(
        self, aerosol_type: str, values: Mapping[str, float], sun: float, elevation: np.ndarray, azimuth: np.ndarray
    ) -> np.ndarray:
        """The same behind a clean horizon."""
        medium = replace(self._air(aerosol_type, values).medium, screen=None)
        return self._log_xyz(ClearAir(medium), sun, elevation, azimuth)

    def _log_xyz(self, air: ClearAir, sun: float, elevation: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        altitude_km = max(air.medium.bottom_km, self.base.observer.altitude_km)
        seen = skies([air], [float(sun)], np.clip(elevation, 0.0, 90.0), azimuth, [altitude_km])
        self._errors[id(air)] = float(seen.relative_error[0, 0, 0])
        xyz = colour.factor_to_xyz(seen.radiance[0, 0, 0], WAVELENGTH_NM, self.base.solar_spectrum, observer=OBSERVER)
        if not (xyz > 0.0).all():
            raise TwilightError("estimate: a computed sky is black where the photograph shows clear sky")
        return np.log(xyz)

    def splines(self, aerosol_type: str, values: Mapping[str, float], suns: Sequence[float]) -> np.ndarray:
        """Coefficients (S, rows, columns, 3) of the skies of an air under some suns."""
        air = self._key(aerosol_type, values)
        columns = COLUMNS_DEG[(COLUMNS_DEG >= 0.0) & (COLUMNS_DEG <= 180.0)]
        where = np.meshgrid(90.0 * ROWS**2, columns, indexing="ij")
        for sun in suns:
            if (air, sun) not in self._splines:
                self._splines[air, sun] = spline(self.log_xyz(aerosol_type, values, sun, *where))
        return np.array([self._splines[air, sun] for sun in suns])

    def _key(self, aerosol_type: str, values: Mapping[str, float]) -> tuple:
        return (aerosol_type, *(round(values[p.name], 9) for p in self.design.parameters))

    def _air(self, aerosol_type: str, values: Mapping[str, float]) -> ClearAir:
        key = self._key(aerosol_type, values)
        if key not in self._airs:
            shown = ", ".join(f"{p.name} {values[p.name]:.3g}" for p in self.design.parameters)
            self.progress(f"air {len(self._airs) + 1}: {aerosol_type}, {shown}", min(0.95, len(self._airs) / 24))
            config = with_settings(self.base, climate_settings(self.design, values, aerosol_type))
            medium = replace(climate_medium(config.climate, WAVELENGTH_NM), screen=screen_of(usual_horizon(config)))
            self._airs[key] = ClearAir(medium)
        return self._airs[key]

    def first(self, aerosol_type: str, suns: Sequence[float], depth: float | None = None) -> Skies:
        """The skies of the type that all others are told from; depth: of aerosol near which the rest is varied."""
        beside = None
        if depth is not None:
            beside = int(np.argmin(np.abs(np.log(AEROSOL.nodes) - np.log(depth))))
        design = Design(self.design.others, beside)
        splines = [self.splines(aerosol_type, node, suns) for node in design.nodes]
        return Skies(design, aerosol_type, np.array(suns), np.array(splines), self.error)

    def like(self, first: Skies, aerosol_type: str, values: Mapping[str, float]) -> Skies:
        """The skies of another type: those of the first, changed as one air is by the type."""
        suns = first.sun_elevations_deg.tolist()
        one, other = (self.splines(name, values, suns) for name in (first.aerosol_type, aerosol_type))
        return Skies(first.design, aerosol_type, first.sun_elevations_deg, first.splines + (other - one), self.error)

    def lifted_ln(self, aerosol_type: str, count: int) -> np.ndarray:
        """ln of the aerosol's depth from the ground up over that above a camera (N,), for altitudes as people's are."""
        height = -ALTITUDE_KM * np.log(1.0 - (np.arange(count) + 0.5) / count)
        config = with_settings(self.base, {"aerosol.type": aerosol_type})
        return -np.log(aerosol_above(config, max(config.climate.ground.altitude_km, 0.0) + height))

    @property
    def error(self) -> float:
        """Relative error that the solver says of the skies asked for last."""
        return max(self._errors.values())


def aerosol_above(config: Config, altitude_km: np.ndarray | float) -> np.ndarray:
    """Aerosol optical depth at 550 nm above altitudes [km], as a fraction of that from the ground up."""
    medium = climate_medium(config.climate, np.array([550.0]))
    z = np.linspace(medium.bottom_km, medium.top_km, round((medium.top_km - medium.bottom_km) / HEIGHT_STEP_KM) + 1)
    extinction = medium.at(z).aerosol_extinction[:, 0]
    below = np.append(0.0, np.cumsum(0.5 * np.diff(z) * (extinction[1:] + extinction[:-1])))
    return 1.0 - np.interp(altitude_km, z, below) / below[-1]


def climate_settings(design: Design, values: Mapping[str, float], aerosol_type: str) -> dict[str, Any]:
    """Dotted keys of a climate of the design."""
    settings: dict[str, Any] = {"aerosol.type": aerosol_type}
    for parameter in design.parameters:
        if parameter.name in values:
            settings[parameter.key] = float(values[parameter.name])
    return settings


def with_settings(base: Config, settings: Mapping[str, Any]) -> Config:
    """The configuration with dotted keys set."""
    data = base.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    if "gases.ozone.column_du" in settings:
        data["climate"].get("gases", {}).get("ozone", {}).pop("day_of_year", None)
    if "aerosol.type" in settings:
        data["climate"].get("aerosol", {}).pop("components", None)
    return load(data, settings)
