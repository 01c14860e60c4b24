"""The skies of airs that a photograph is fitted with: some fifteen by the solver `compact`, and what lies between them.

Of the first aerosol type the optical depth stands at all of its nodes, and each other parameter at its outer values
beside one of these.  Of another type one air is computed, at the best values of the first: what the type changes there
it changes everywhere, until a fit has come near enough for an air of its own.

Between the nodes ln(XYZ) of a direction is a local cubic in the (transformed) optical depth and in the sun's elevation,
plus for each other parameter the parabola of its change.  So a trial is a weighted sum of skies, and costs one product.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.config.load import load
from twilight.config.scene import PLACED_NM, Config
from twilight.numerics import spectrum
from twilight.scene.medium import climate_medium
from twilight.sky import colour
from twilight.solvers import compact
from twilight.studies.validate.photographs.photo import OBSERVER, Cells

WAVELENGTH_NM = np.array(PLACED_NM)
"""Wavelengths of the skies [nm]."""

SUN_DEG: tuple[float, float] = (-18.0, 90.0)
"""Suns that the solver knows [deg]."""

COLOUR_ERROR = 0.1
"""Error in u', v' over the solver's relative error: a difference of 1 % between red and blue moves u', v' by 0.001."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of the climate: the key it sets, its nodes (the first and last bound it), and its scale.

    Between nodes it is interpolated in ``scaled``, ln for an optical depth.  beside: at which of the aerosol's nodes it
    is varied.
    """

    name: str
    key: str
    unit: str
    nodes: tuple[float, ...]
    logarithmic: bool = False
    beside: int = 1

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
SUN = "sun"
"""Name of the parameter that is the sun's elevation."""


@dataclass(frozen=True)
class Design:
    """Which airs are computed: the aerosol first, the others varied about it; nodes: for each air all values."""

    others: tuple[Parameter, ...]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (AEROSOL, *self.others)

    @property
    def nodes(self) -> list[dict[str, float]]:
        middle = {p.name: p.nodes[1] for p in self.others}
        rows = [{AEROSOL.name: value, **middle} for value in AEROSOL.nodes]
        for p in self.others:
            for outer in (p.nodes[0], p.nodes[2]):
                rows.append({AEROSOL.name: AEROSOL.nodes[p.beside], **middle, p.name: outer})
        return rows

    def weights(self, values: Mapping[str, float]) -> np.ndarray:
        """Weights (M,) of the nodes whose sum of ln(XYZ) is that of an air between them."""
        x, target = AEROSOL.scaled(np.array(AEROSOL.nodes)), float(AEROSOL.scaled(values[AEROSOL.name]))
        n = len(AEROSOL.nodes)
        out = np.zeros(len(self.nodes))
        out[:n] = spectrum.hermite_matrix(x, np.array([target]))[0]
        node = n
        for p in self.others:
            a, b, c = p.scaled(np.array(p.nodes))
            q = float(p.scaled(values[p.name]))
            outer = ((q - b) * (q - c) / ((a - b) * (a - c)), (q - a) * (q - b) / ((c - a) * (c - b)))
            for weight in outer:
                out[node] += weight
                out[p.beside] -= weight
                node += 1
        return out


@dataclass(frozen=True, eq=False)
class Skies:
    """Skies of one aerosol type under one sun or several, in the directions of a photograph's cells.

    sun_elevations_deg (S,): true; log_xyz (M, S, n, 3): of the design's airs, ln of cd m^-2.
    luminance_error, chromaticity_error: of these skies, in ln(luminance) and in u', v'.
    """

    design: Design
    aerosol_type: str
    sun_elevations_deg: np.ndarray
    log_xyz: np.ndarray
    luminance_error: float = 0.0
    chromaticity_error: float = 0.0

    def weights(self, values: Mapping[str, float]) -> np.ndarray:
        """Weights (M x S,) of all skies; ``values`` holds every parameter of the design, and ``sun`` [deg]."""
        air = self.design.weights(values)
        if self.sun_elevations_deg.size == 1:
            return air
        sun = spectrum.hermite_matrix(self.sun_elevations_deg, np.array([values[SUN]]))[0]
        return np.outer(air, sun).ravel()


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
        self._fields: dict[tuple, compact.Field] = {}
        self._cells: Cells | None = None
        self._skies: dict[tuple[compact.Field, float], np.ndarray] = {}

    def log_xyz(
        self, aerosol_type: str, values: Mapping[str, float], suns: Sequence[float], cells: Cells
    ) -> np.ndarray:
        """ln(XYZ) (S, n, 3) of an air in the cells of a photograph.

        Errors: TwilightError for a sky that is black there.
        """
        field = self._field(aerosol_type, values)
        if cells is not self._cells:
            self._cells, self._skies = cells, {}
        where = (np.clip(cells.elevation_deg, 0.0, 90.0), cells.azimuth_deg)
        for sun in suns:
            if (field, sun) not in self._skies:
                self._skies[field, sun] = field.radiance(float(sun), *where)
        factor = np.array([self._skies[field, sun] for sun in suns])
        xyz = colour.factor_to_xyz(factor, WAVELENGTH_NM, self.base.solar_spectrum, observer=OBSERVER)
        if not (xyz > 0.0).all():
            raise TwilightError("estimate: a computed sky is black where the photograph shows clear sky")
        return np.log(xyz)

    def _field(self, aerosol_type: str, values: Mapping[str, float]) -> compact.Field:
        key = (aerosol_type, *(round(values[p.name], 9) for p in self.design.parameters))
        if key not in self._fields:
            shown = ", ".join(f"{p.name} {values[p.name]:.3g}" for p in self.design.parameters)
            self.progress(f"air {len(self._fields) + 1}: {aerosol_type}, {shown}", min(0.95, len(self._fields) / 24))
            config = with_settings(self.base, climate_settings(self.design, values, aerosol_type))
            medium = climate_medium(config.climate, WAVELENGTH_NM)
            self._fields[key] = compact.prepare(
                medium,
                compact.CompactSettings(polarisation=False),
                observer_altitude_km=max(medium.bottom_km, self.base.observer.altitude_km),
            )
        return self._fields[key]

    def first(self, aerosol_type: str, suns: Sequence[float], cells: Cells) -> Skies:
        """The skies of the type that all others are told from."""
        skies = [self.log_xyz(aerosol_type, node, suns, cells) for node in self.design.nodes]
        return Skies(self.design, aerosol_type, np.array(suns), np.array(skies), *self._errors())

    def like(self, first: Skies, aerosol_type: str, values: Mapping[str, float], cells: Cells) -> Skies:
        """The skies of another type: those of the first, changed as one air is by the type."""
        suns = first.sun_elevations_deg.tolist()
        one, other = (self.log_xyz(name, values, suns, cells) for name in (first.aerosol_type, aerosol_type))
        made = first.log_xyz + (other - one)
        return Skies(self.design, aerosol_type, first.sun_elevations_deg, made, *self._errors())

    def _errors(self) -> tuple[float, float]:
        """Relative error of the luminance and error in u', v' that the solver says of the skies asked for last."""
        made = [field.convergence for field in self._fields.values()]
        error = max(float(one.error) for one in made if one is not None and one.error is not None)
        return error, COLOUR_ERROR * error


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
