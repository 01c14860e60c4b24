"""`Scene`: all that is computed, resolved once from a configuration; the engine and the studies take nothing else."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.config.scene import Config, Observer
from twilight.scene.horizon import screen_of
from twilight.scene.medium import climate_gas_bands, climate_medium, planning_medium, wavelengths_of
from twilight.scene.plan import Omission, make_plan
from twilight.scene.suns import SceneSun, suns_of

if TYPE_CHECKING:
    import numpy as np

    from twilight.atmosphere.bands import GasBands
    from twilight.atmosphere.medium import Medium
    from twilight.solvers.base import Capabilities, Solver


@dataclass(frozen=True)
class Scene:
    """The air and the ground, how light in them is solved, the suns and the observer.

    Parameters
    ----------
    medium
        Optical coefficients at all wavelengths, over their ground.
    bands
        Exponential sums of the gases' bands, solved in place of the medium's wavelengths; None: there are none.
    solver
        A module as `twilight.solvers.load` gives it.
    settings
        One of the solver's `QUALITIES`, perhaps with options replaced.
    suns
        The suns of the configuration; a field that is asked for other suns takes no notice of them.
    observer
        Altitude above sea level [km] (unset: on the ground), and the view of a camera.
    title
        What errors call the scene.
    omissions
        What the plan of the scene left out of the medium.
    config
        The configuration that was resolved, from which skies take their directions, night, terrain and record; None
        for a scene that was put together by hand, which has a field but no frames.
    """

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
                f"horizon.screen: the solver {self.solver_name} knows nothing beyond the horizon; zones, montecarlo "
                "and tables do"
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
    plan = make_plan(config, wavelength_nm)
    wanted_nm = wavelengths_of(config) if wavelength_nm is None else wavelength_nm
    quick = for_plan and plan.climate.medium is None and wanted_nm is not None
    medium = (planning_medium if quick else climate_medium)(plan.climate, wanted_nm)  # type: ignore[arg-type]
    screen = screen_of(config.horizon)
    if screen is not None:
        medium = replace(medium, screen=screen)
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
