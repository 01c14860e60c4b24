"""Error and processor time of settings of `zones` on one scene."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twilight.base.peak_memory import forget_peak, peak_mib
from twilight.base.progress import Progress, silent
from twilight.config.scene import Config
from twilight.engine.solve import Problem
from twilight.scene import resolve
from twilight.scene.medium import climate_medium, wavelengths_of
from twilight.solvers import zones
from twilight.solvers.zones.settings import QUALITIES, ZonesSettings
from twilight.solvers.zones.target import LAST_DAY_DEG, LAST_TWILIGHT_DEG, at_quality
from twilight.studies.compare.reference_solution import ReferenceSolution

NORMAL_95 = 1.96
"""Multiple of the root mean square that 95 % of normally distributed errors stay below."""
ELEVATION_DEG = (1.0, 2.0, 4.0, 10.0, 20.0, 35.0, 60.0, 85.0)
"""Directions [deg] in which a scene without a table of references is judged; towards the horizon errors grow."""
AZIMUTH_DEG = (0.0, 15.0, 45.0, 90.0, 135.0, 180.0)
"""Their azimuths from the sun [deg]."""
SUN_ELEVATIONS_DEG = (30.0, 10.0, 5.0, 0.0, -4.0, -6.0, -9.0, -12.0, -18.0)
"""Suns [deg] at which a scene is judged that names none; its field then serves every sun."""
ALLOWED = (1.0, 5.0 / 3.0, 2.5)
"""Factors of errors that weigh the same: with the sun above LAST_DAY_DEG, down to LAST_TWILIGHT_DEG, and below.  The
lower the sun, the less light there is, and the larger the noise of stored references."""
MAX_WAVELENGTHS = 8
"""Most wavelengths of a scene that are solved: as many as a field takes at once."""


@dataclass(frozen=True)
class Measurement:
    """Settings on a scene: processor seconds of its field, error [%] of each sun's sky, and the most memory [MiB] that
    the process held meanwhile (on Linux; elsewhere in all its life)."""

    processor_s: float
    error_percent: Mapping[float, float]
    peak_mib: float = math.nan

    @property
    def worst_percent(self) -> float:
        """Largest error of a sun [%], each over the factor of ALLOWED for that sun."""
        return max(error / allowed(sun) for sun, error in self.error_percent.items())


@dataclass(frozen=True)
class ZonesScene:
    """A scene of `zones`, and the radiances by which settings are judged.

    suns: those that the field is made for; None: every sun
    physics: the scene's own settings, from which come those that are not searched
    """

    name: str
    config: Config
    wavelength_nm: np.ndarray
    suns: tuple[float, ...] | None
    references: Mapping[float, ReferenceSolution]
    physics: ZonesSettings

    @staticmethod
    def of_table(name: str, config: Config, references: Mapping[float, ReferenceSolution], suns) -> ZonesScene:
        """Judged by stored references, at their wavelengths and in their directions."""
        wavelength_nm = next(iter(references.values())).wavelength_nm
        return ZonesScene(name, config, wavelength_nm, suns, references, config.chosen_solver.settings)

    @staticmethod
    def of_scene(name: str, config: Config, suns: tuple[float, ...] | None, progress: Progress) -> ZonesScene:
        """Judged by quality `reference` of `zones`: what settings leave out, not what is wrong with the method."""
        physics = config.chosen_solver.settings
        nm = wavelengths_of(config)
        if nm is None:  # those of a tabulated medium
            nm = climate_medium(config.climate, None).wavelength_nm
        nm = nm[np.unique(np.linspace(0, nm.size - 1, MAX_WAVELENGTHS).round().astype(int))]
        problem = _problem(config, nm, at_quality(physics, "reference"), suns)
        solved = problem.solve(progress)
        e, a = (x.ravel() for x in np.meshgrid(ELEVATION_DEG, AZIMUTH_DEG, indexing="ij"))
        found = {}
        for sun in suns or SUN_ELEVATIONS_DEG:
            radiance = solved.radiance(sun, e, a)
            found[sun] = ReferenceSolution(e, a, nm, radiance, np.zeros_like(radiance))
        return ZonesScene(name, config, nm, suns, found, physics)

    def measure(self, settings: ZonesSettings, progress: Progress = silent) -> Measurement:
        """Solve the field and judge every sun's sky; the first call in a process compiles, and its time counts it."""
        problem = _problem(self.config, self.wavelength_nm, settings, self.suns)
        forget_peak()
        start = time.process_time()
        solved = problem.solve(progress)
        seconds = time.process_time() - start
        error = {}
        for sun, right in self.references.items():
            radiance = solved.radiance(sun, right.elevation_deg, right.azimuth_deg)
            error[sun] = excess_percent(radiance, right)
        return Measurement(seconds, error, peak_mib())

    def warm_up(self) -> None:
        """Solve a field of few nodes, so that nothing is compiled while the clock runs."""
        few = replace(at_quality(self.physics, "draft"), altitude_density=0.3, zenith_density=0.4)
        self.measure(few)


def allowed(sun_elevation_deg: float) -> float:
    """The entry of ALLOWED for a sun."""
    if sun_elevation_deg >= LAST_DAY_DEG:
        return ALLOWED[0]
    return ALLOWED[1] if sun_elevation_deg >= LAST_TWILIGHT_DEG else ALLOWED[2]


def excess_percent(radiance: np.ndarray, right: ReferenceSolution) -> float:
    """Size [%] that 95 % of normally distributed errors would stay below, of the errors' root mean square.

    The reference's own standard errors are taken out of it.  radiance: (D, W), as the reference's.
    """
    lit = right.radiance > 0.0
    scale = np.where(lit, right.radiance, 1.0)
    error, own = (radiance / scale - 1.0)[lit], (right.standard_error / scale)[lit]
    if not error.size:
        return 0.0
    return 100.0 * NORMAL_95 * float(np.sqrt(max(0.0, float(np.mean(error**2 - own**2)))))


def _problem(config: Config, wavelength_nm: np.ndarray, settings: ZonesSettings, suns) -> Problem:
    return Problem(resolve(config, wavelength_nm=wavelength_nm, solver=(zones, settings)), suns)


def qualities(physics: ZonesSettings) -> dict[str, ZonesSettings]:
    """The qualities that a user can name, with a scene's own physics."""
    return {name: at_quality(physics, name) for name in QUALITIES}
