"""Solvers at their qualities: by the names that a command gives, and in a configuration."""

from collections.abc import Sequence
from dataclasses import dataclass

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.base.sections import unknown
from twilight.config.scene import Config
from twilight.config.solver import choose_solver


@dataclass(frozen=True)
class SolverPreset:
    """A solver at one of its qualities."""

    solver: str
    quality: str

    @property
    def name(self) -> str:
        return f"{self.solver} {self.quality}"


def solver_presets(names: Sequence[str] | None, where: str = "--solvers") -> list[SolverPreset]:
    """The presets that names such as `cells` or `cells:draft` stand for; None: all of all installed solvers.

    Errors: TwilightError for a solver or quality that does not exist.
    """
    presets: list[SolverPreset] = []
    for name in names or solvers.installed():
        solver, colon, quality = (part.strip() for part in name.partition(":"))
        if solver not in solvers.SOLVERS:
            raise TwilightError(f"{where}: {solver} {unknown(solver, solvers.SOLVERS, 'solver')}")
        qualities = list(solvers.load(solver).QUALITIES)
        if colon and quality not in qualities:
            raise TwilightError(f"{where}: {quality} {unknown(quality, qualities, f'quality of {solver}')}")
        presets += [SolverPreset(solver, q) for q in ([quality] if colon else qualities)]
    return list(dict.fromkeys(presets))


def with_preset(config: Config, preset: SolverPreset) -> Config:
    """The configuration with the solver of a preset; options of its `solver` section stay if that is the solver which
    the section names."""
    own = config.solver.get("name", solvers.DEFAULT) == preset.solver
    section = {**(config.solver if own else {}), "name": preset.solver, "quality": preset.quality}
    choose_solver(section)
    return config.model_copy(update={"solver": section})
