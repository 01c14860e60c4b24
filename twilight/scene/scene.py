"""`Scene`: medium, solver, suns, observer, screen and moon, resolved once from a configuration.

The engine and the studies take nothing else.  `resolved_configuration` is what files hold: every default is written
out, and rendering it gives the same sky.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight import solvers
from twilight.base.conventions import EARTH_RADIUS_KM
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.threads import one_blas_thread
from twilight.config.climate import Spectrum, climate_files
from twilight.config.measured import place_and_time_of
from twilight.config.scene import Config, Observer
from twilight.config.solver import complete_solver
from twilight.config.sun import SunAt, SunElevation, SunElevations
from twilight.config.vary import Drawing
from twilight.scene.lights import SceneLights, lights_of
from twilight.scene.medium import (
    check_sha256,
    climate_gas_bands,
    climate_medium,
    name_by_content,
    planning_medium,
    wavelengths_of,
)
from twilight.scene.plan import Omission, make_plan
from twilight.scene.suns import SceneSun, suns_of
from twilight.scene.usual import completed, screen_of, usual_horizon, with_usual_ozone

if TYPE_CHECKING:
    import numpy as np

    from twilight.atmosphere.bands import GasBands
    from twilight.atmosphere.medium import Medium
    from twilight.solvers.base import Capabilities, Solver


MAP_MEAN_KM = 100.0
"""Least distance from the observer up to which the mean of an albedo map is taken [km]."""


def _with_mean_of_map(config: Config) -> Config:
    """The configuration with the mean of `ground.albedo_map` for its albedo: over the ground in sight, or within
    MAP_MEAN_KM; as it is, with a warning, where it has no place.

    Errors: TwilightError for a file that is no map.
    """
    ground, sun = config.climate.ground, config.sun
    if ground.albedo_map is None:
        return config
    if isinstance(sun, SunElevation | SunElevations):  # without a view, or `Config` refuses it
        warnings.warn(
            "ground.albedo_map: the sun has no place, so that the ground has ground.albedo everywhere",
            TwilightWarning, stacklevel=2,
        )  # fmt: skip
        return config
    check_sha256(ground.albedo_map, ground.albedo_map_sha256, "ground.albedo_map_sha256")
    from twilight.io.albedo_map import read_albedo_map  # start-up

    mapped = read_albedo_map(ground.albedo_map)
    above_km = max(config.observer.altitude_km - ground.altitude_km, 0.0)
    in_sight = np.arccos(EARTH_RADIUS_KM / (EARTH_RADIUS_KM + above_km))
    radius_deg = float(np.degrees(max(in_sight, MAP_MEAN_KM / EARTH_RADIUS_KM)))
    mean = mapped.mean(sun.latitude_deg, sun.longitude_deg, radius_deg)
    if np.isnan(mean).any():
        warnings.warn(
            f"{ground.albedo_map}: holds nothing within {radius_deg:.3g} deg of the observer: the air is lit by "
            "ground.albedo",
            TwilightWarning, stacklevel=2,
        )  # fmt: skip
        return config
    nm = mapped.wavelength_nm
    albedo = Spectrum(wavelength_nm=tuple(nm.tolist()), albedo=tuple(mean.tolist())) if nm.size > 1 else float(mean[0])
    lit = ground.model_copy(update={"albedo": albedo})
    return config.model_copy(update={"climate": config.climate.model_copy(update={"ground": lit})})


def resolved_configuration(config: Config, section: SunElevation | SunAt) -> dict[str, Any]:
    """The configuration of one frame with every default written out, as JSON values; rendering it gives the frame.

    Tables of the climate are named by their files' names and the SHA-256 of their content, not by where they were.
    """
    config = completed(config)
    one = config.model_copy(update={"sun": section})
    data = one.model_dump(mode="json", exclude_none=True, exclude={"vary", *Drawing.model_fields})
    data["solver"] = complete_solver(config.solver)
    assert config.horizon is not None
    data["horizon"] = config.horizon.name or data["horizon"]
    rows, columns = config.texture.shape
    data["texture"] = {"elevation_count": rows, "azimuth_count": columns} if config.texture.plain else {}
    wavelength_nm = wavelengths_of(config)
    if wavelength_nm is not None:
        data["wavelengths"] = {"list_nm": wavelength_nm.tolist()}
    name_by_content(data["climate"])
    for holder, _, name, _ in climate_files(data["climate"]):
        holder[name] = Path(holder[name]).name
    if config.climate.medium is not None:
        for key in ("atmosphere", "gases", "refraction"):
            data["climate"].pop(key)
    return data


@dataclass(frozen=True)
class Scene:
    """The air and the ground, how light in them is solved, the suns and the observer.

    medium: at all wavelengths, over its ground; bands: exponential sums of the gases' bands, solved in place of the
        medium's wavelengths, None: there are none
    solver: a module as `twilight.solvers.load` gives it; settings: one of its `QUALITIES`, perhaps with options
        replaced
    suns: of the configuration; a field that is asked for other suns takes no notice of them
    observer: altitude above sea level [km] (unset: on the ground), and the view of a camera
    title: what errors call the scene; omissions: what the plan of the scene left out of the medium
    config: the configuration that was resolved, from which skies take their directions, night, terrain and record; None
        for a scene that was put together by hand, which has a field but no frames"""

    medium: Medium
    bands: GasBands | None
    solver: Solver
    settings: Any
    suns: tuple[SceneSun, ...] = ()
    observer: Observer = field(default_factory=Observer)
    title: str = ""
    omissions: tuple[Omission, ...] = ()
    config: Config | None = None

    def __post_init__(self) -> None:
        if self.medium.screen is not None and not self.capabilities.screen:
            raise TwilightError(
                f"horizon.screen: the solver {self.solver_name} knows nothing beyond the horizon; zones, montecarlo, "
                "tables and compact do"
            )

    @property
    def solver_name(self) -> str:
        """The solver's name."""
        return self.solver.__name__.rpartition(".")[2]

    @property
    def capabilities(self) -> Capabilities:
        """What the solver declares."""
        return self.solver.CAPABILITIES

    @property
    def altitude_km(self) -> float:
        """Altitude of the observer above sea level [km]."""
        unset = "altitude_km" not in self.observer.model_fields_set
        return self.medium.bottom_km if unset else self.observer.altitude_km

    @property
    def configuration(self) -> Config:
        """The configuration that was resolved; TwilightError for a scene that was put together by hand."""
        if self.config is None:
            raise TwilightError(f"{self.title or 'scene'}: has no configuration, which says what a sky holds")
        return self.config

    @property
    def sun_elevations_deg(self) -> tuple[float, ...]:
        """True elevations of the suns [deg]."""
        return tuple(sun.elevation_deg for sun in self.suns)

    def lights(self, sun: SceneSun) -> SceneLights:
        """What shines at the moment of one of the suns, and what does not, with the reason."""
        return lights_of(self.configuration, self.medium, self.altitude_km, sun)


@one_blas_thread()
def resolve(
    config: Config,
    *,
    wavelength_nm: np.ndarray | None = None,
    solver: tuple[Solver, Any] | None = None,
    for_plan: bool = False,
) -> Scene:
    """The scene of a configuration: its climate without what its plan omits, its solver, its suns and its observer.

    wavelength_nm (W,) [nm], solver (a module and its settings): in place of the configuration's own; for_plan: whether
    only the cost of the scene is wanted: its air is then about right, and there at once (`planning_medium`).
    Errors: TwilightError for whatever in the configuration cannot be computed.
    """
    if solver is None:
        name, _, settings = config.chosen_solver
        solver = solvers.load(name), settings
    config = _with_mean_of_map(config)
    climate, ozone_source = with_usual_ozone(config.climate, place_and_time_of(config))
    horizon = usual_horizon(config, solver[0])
    config = config.model_copy(update={"climate": climate, "horizon": horizon})
    plan = make_plan(config, wavelength_nm)
    wanted_nm = wavelengths_of(config) if wavelength_nm is None else wavelength_nm
    quick = for_plan and plan.climate.medium is None and wanted_nm is not None
    medium = (planning_medium if quick else climate_medium)(plan.climate, wanted_nm)  # type: ignore[arg-type]
    medium = replace(medium, screen=screen_of(horizon))
    if ozone_source is not None:
        medium = replace(medium, notes={**medium.notes, "ozone_source": ozone_source})
    return Scene(
        medium,
        None if solver[0].CAPABILITIES.kind == "formula" else climate_gas_bands(plan.climate, medium, for_plan),
        *solver,
        tuple(suns_of(config)),
        # unset, a climate without a ground of its own has its observer at sea level
        config.observer.model_copy(update={"altitude_km": config.observer.altitude_km}),
        config.title,
        plan.omissions,
        config,
    )
