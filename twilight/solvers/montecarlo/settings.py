"""Settings of the Monte-Carlo solver and its quality ladder."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.sections import option, settings
from twilight.solvers.base import Cost
from twilight.solvers.montecarlo.leg import LegOptions
from twilight.solvers.montecarlo.paths import WalkOptions

ALL_ORDERS = 1_000_000_000
"""Highest order of scattering where `max_orders` is None."""
FIRST_LEG_SAG_KM = 1e-4
"""Largest distance [km] of the chords of a line of sight from the refracted ray."""
LATER_LEG_SAG_KM = 2e-3
"""Largest distance [km] of the chords of later legs from the refracted ray: 1/4000 of the scale height of air."""


@settings
class MonteCarloSettings:
    """What is computed, when a run stops, and how paths are sampled; sampling changes the noise and never the mean."""

    target_stderr: float | None = option(
        "relative standard error of each pixel and wavelength; null: `samples` alone decides. What is known to no "
        "better than 0.1 has no value",
        default=0.01,
        ge=1e-6,
        le=0.1,
    )
    samples: int = option(
        "samples per pixel and wavelength where there is no target; a sample is a line of sight with "
        "`paths_per_sample` paths that go on from it",
        default=64,
        ge=2,
        le=10**12,
    )
    time_limit_s: float | None = option(
        "time [s] of one call after which no sample is begun; `prepare` improves the importance function no "
        "more after the same time. Two samples of each arm are taken in any case; where they are too few to know the "
        "light, it has no value (nan, with a warning). null: no limit",
        default=None,
        ge=0.0,
        le=1e12,
    )
    max_orders: int | None = option(
        "highest order of scattering (a reflection by the ground counts as one); null: all of them",
        default=None,
        ge=1,
        le=ALL_ORDERS,
    )
    polarisation: bool = option(
        "carry Stokes vectors (I, Q, U) from event to event; false: scalar theory, which is off by up to 10-20 % in"
        " single directions of blue twilight. 'isotropic_after_first' is scalar theory in any case",
        default=True,
    )
    spectrum: Literal["solved", "carried"] = option(
        "solved: every wavelength is sampled. carried: of many, or of terms of gas bands, eight to 24 are sampled, "
        "and the fitted model of clear air carries their light, with its standard error, to the others",
        default="solved",
        expert=True,
    )
    seed: int = option("any integer; names the random numbers", default=1, ge=0, le=2**63 - 1)
    max_samples: int = option(
        "most samples of one pixel and wavelength", default=1_000_000, ge=2, le=10**12, expert=True
    )
    approximation: Literal["none", "isotropic_after_first"] = option(
        "'none', or 'isotropic_after_first' (Haber 2005 sec. 4.5.3): light scattered once scatters again "
        "isotropically, in air whose aerosol is reduced by similarity, and is seen through air reduced by the third"
        " Legendre moment",
        default="none",
        expert=True,
    )
    refraction: bool = option("bend the direct sunlight", default=True, expert=True)
    spreading: bool = option("let bending thin the direct sunlight out", default=True, expert=True)
    bent_lines_of_sight: bool = option(
        "directions asked for are apparent ones, and every leg of a path follows the refracted ray; without "
        "`refraction` lines are straight in any case",
        default=True,
        expert=True,
    )
    chunk_samples: int = option("samples per stream of random numbers", default=256, ge=1, le=2**31, expert=True)
    pilot_samples: int = option(
        "samples of each of two arms from which the other arm's number is set", default=8, ge=2, le=2**31, expert=True
    )
    paths_per_sample: int = option(
        "stratified paths that go on from one line of sight", default=8, ge=1, le=4096, expert=True
    )
    importance_sweeps: int = option(
        "iterations of the importance function with its own source; 0: no importance function",
        default=3,
        ge=0,
        le=50,
        expert=True,
    )
    importance_point_fraction: float = option(
        "fraction of the events whose point on the leg is drawn in proportion to the importance function",
        default=0.95,
        ge=0.0,
        le=0.99,
        expert=True,
    )
    importance_direction_fraction: float = option(
        "fraction of the candidate directions that are drawn in proportion to the importance function",
        default=0.9,
        ge=0.0,
        le=0.99,
        expert=True,
    )
    direction_candidates: int = option(
        "candidate directions after an event, of which one is taken", default=6, ge=1, le=1000, expert=True
    )
    roulette_threshold: float = option(
        "a path may end by chance (Russian roulette) where the light expected of it is below this fraction of what "
        "one path stands for at the line of sight; 0: neither roulette nor splitting",
        default=0.3,
        ge=0.0,
        le=100.0,
        expert=True,
    )
    splitting_rate: float = option(
        "paths that go on from a later leg whose expected light is what one path stands for at the line of sight",
        default=1.0,
        ge=0.01,
        le=100.0,
        expert=True,
    )
    control_variate: bool = option(
        "take the importance function for the light beyond each leg and sample the difference",
        default=True,
        expert=True,
    )
    first_leg_step_km: float = option(
        "largest length [km] and largest optical depth of the pieces of a line of sight",
        default=10.0,
        ge=0.1,
        le=1000.0,
        expert=True,
    )
    first_leg_step_depth: float = option(
        "largest length [km] and largest optical depth of the pieces of a line of sight",
        default=0.2,
        ge=0.01,
        le=1.0,
        expert=True,
    )
    later_leg_step_km: float = option(
        "largest length [km] and largest optical depth of the pieces of later legs",
        default=40.0,
        ge=0.1,
        le=1000.0,
        expert=True,
    )
    later_leg_step_depth: float = option(
        "largest length [km] and largest optical depth of the pieces of later legs",
        default=0.7,
        ge=0.01,
        le=1.0,
        expert=True,
    )
    exact_beam_fraction: float = option(
        "fraction of the look-ups in the table of sunlight that are corrected by the exact value",
        default=0.0625,
        ge=0.001,
        le=1.0,
        expert=True,
    )

    @property
    def polarised(self) -> bool:
        """Whether paths carry Stokes vectors: `polarisation`, and scattering that is not taken for isotropic."""
        return self.polarisation and self.approximation == "none"

    def walk(self, has_refraction: bool) -> WalkOptions:
        """The options of paths that kernels take, in air with or without refraction."""
        bent = has_refraction and self.refraction and self.bent_lines_of_sight
        polarised = self.polarised
        return WalkOptions(
            LegOptions(self.first_leg_step_km, self.first_leg_step_depth, FIRST_LEG_SAG_KM, bent, polarised, False),
            LegOptions(self.later_leg_step_km, self.later_leg_step_depth, LATER_LEG_SAG_KM, bent, polarised, True),
            self.paths_per_sample,
            self.importance_point_fraction,
            self.importance_direction_fraction,
            self.direction_candidates,
            self.roulette_threshold,
            self.splitting_rate,
            self.control_variate and self.max_orders is None and self.importance_sweeps > 0,
            ALL_ORDERS if self.max_orders is None else self.max_orders,
        )


def carried(settings: MonteCarloSettings) -> bool:
    """Whether the fitted model may carry light over the spectrum: it was asked for, and has all orders and physics."""
    if settings.spectrum != "carried":
        return False
    left_out = [
        key for key in ("polarisation", "refraction", "spreading", "bent_lines_of_sight") if not getattr(settings, key)
    ]
    if settings.max_orders is not None or settings.approximation != "none" or left_out:
        raise TwilightError(
            "solver.expert.spectrum: carried takes all orders of scattering and all physics, as the model has; leave "
            "max_orders, approximation, polarisation, refraction, spreading and bent_lines_of_sight as they are"
        )
    return True


QUALITIES = {
    "draft": MonteCarloSettings(target_stderr=0.05, polarisation=False),
    "standard": MonteCarloSettings(target_stderr=0.01),
    "reference": MonteCarloSettings(target_stderr=0.003),
}


SUN_DEG = (-12.0, -9.0, -6.0, -4.0, 0.0, 5.0, 30.0)
"""Suns of `benchmarks/results/compare.csv`, rows of `standard`."""
TO_ONE_PERCENT_S = (0.187, 0.131, 0.059, 0.028, 0.022, 0.017, 0.0091)
"""Processor seconds to 1 % in a direction and wavelength, the mean over a sky and eight wavelengths (ibid.)."""
SAMPLE_S = (227e-6, 241e-6, 211e-6, 159e-6, 162e-6, 153e-6, 121e-6)
"""Processor seconds of a sample of PATHS paths (`benchmarks/results/montecarlo_speed.csv`)."""
PATHS = 8
PREPARE_S = 3.0
"""Processor seconds of the importance function of a wavelength with SWEEPS sweeps (ibid.)."""
SWEEPS = 3
WAVELENGTH_BYTES = 1.3e7
"""Bytes of a wavelength: eight take 98 MiB (`benchmarks/results/compare.csv`)."""


def cost(
    medium: Medium,
    settings: MonteCarloSettings,
    sun_elevations_deg: Sequence[float] | None,
    observer_altitude_km: float,
) -> Cost:
    """Cost of a field under the mean of these suns, None: of the darkest; measured in `continental-average`."""
    suns = SUN_DEG[:1] if sun_elevations_deg is None else tuple(sun_elevations_deg)
    sample = np.interp(suns, SUN_DEG, SAMPLE_S) * settings.paths_per_sample / PATHS
    pilots = 2.0 * settings.pilot_samples
    samples = np.full(len(suns), max(float(settings.samples), pilots))
    if settings.target_stderr is not None:
        wanted = np.exp(np.interp(suns, SUN_DEG, np.log(TO_ONE_PERCENT_S))) * (0.01 / settings.target_stderr) ** 2
        samples = np.minimum(pilots + wanted / sample, max(float(settings.max_samples), pilots))
    return Cost(
        fixed_bytes=0.0,
        bytes_per_wavelength=WAVELENGTH_BYTES,
        cpu_s_per_wavelength=PREPARE_S * settings.importance_sweeps / SWEEPS,
        cpu_s_per_direction=float(np.mean(samples * sample)),
    )
