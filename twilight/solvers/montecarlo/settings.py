"""Settings of the Monte-Carlo solver and its quality ladder."""

from __future__ import annotations

from dataclasses import dataclass, fields

from twilight.errors import TwilightError
from twilight.solvers.montecarlo.paths import Walk
from twilight.solvers.montecarlo.pieces import Cuts

NO_CUT = 1_000_000_000
FIRST_SAG_KM, LATER_SAG_KM = 1e-4, 2e-3
"""How far the chords of a bent leg may leave the ray: 2e-3 km is a part in 4000 of the scale height of air."""
APPROXIMATIONS = ("none", "isotropic_after_first")


@dataclass(frozen=True)
class MonteCarloSettings:
    """What to compute, when to stop, and how to steer; the last group changes the noise and never the mean.

    target_stderr: relative standard error of each pixel and wavelength; None: `samples` alone decides.
    samples: samples per pixel and wavelength when there is no target; one sample is one first leg with `sub_paths`
        continuations.
    max_samples: most samples spent on one pixel and wavelength.
    time_limit_s: begin no more samples after this time, in one call; `prepare` leaves the coarse field as it is after
        the same time again.  Two samples of each arm are taken in any case, and a result says whether it is complete.
        None: no limit.
    max_orders: highest scattering order (a ground reflection counts as one); None: all of them.
    approximation: "none", or "isotropic_after_first" (Haber 2005 sec. 4.5.3): light scattered once scatters again
        isotropically, in air whose aerosol is reduced by similarity, and is seen through air reduced by the third
        Legendre moment.
    refraction: bend the direct beam.
    spreading: let bending thin the beam out.
    bent_lines_of_sight: directions asked for are apparent ones, and every leg of a path follows the refracted ray.  It
        needs `refraction` (without it lines are straight).
    polarisation: carry Stokes vectors (I, Q, U) from event to event; False: scalar theory, which is off by up to
        10-20 % in single directions of blue twilight.  "isotropic_after_first" is scalar theory in any case.
    seed: any integer; changes the noise.
    chunk_samples: samples per random stream; changes the noise.
    pilot_samples: samples of each of two arms from which the other arm's count is set.

    Steering:
    sub_paths: stratified continuations of one first leg.
    steering_sweeps: passes of the coarse field (0: none at all).
    steered_fraction: share of the events whose place on the leg is drawn with the coarse field.
    table_fraction: share of the candidate directions that are drawn from the coarse field's light.
    candidates: directions of which one is taken.
    roulette: a path whose expected contribution falls below this share of a continuation's of the first leg may end;
        0 switches that and splitting off.
    continuation: paths that go on from a later leg that is worth one continuation of the first.
    coarse_control: replace the light beyond each leg by the coarse field's and sample the difference.
    first_length_km, first_depth: most length [km] and most optical depth of the pieces that the first leg is cut into.
    later_length_km, later_depth: most length [km] and most optical depth of the pieces of later legs.
    check_rate: share of the rough look-ups of the sun that are corrected.
    """

    target_stderr: float | None = 0.01
    samples: int = 64
    max_samples: int = 1_000_000
    time_limit_s: float | None = None
    max_orders: int | None = None
    approximation: str = "none"
    refraction: bool = True
    spreading: bool = True
    bent_lines_of_sight: bool = True
    polarisation: bool = True
    seed: int = 1
    chunk_samples: int = 256
    pilot_samples: int = 8
    # steering
    sub_paths: int = 8
    steering_sweeps: int = 3
    steered_fraction: float = 0.95
    table_fraction: float = 0.9
    candidates: int = 6
    roulette: float = 0.3
    continuation: float = 1.0
    coarse_control: bool = True
    first_length_km: float = 10.0
    first_depth: float = 0.2
    later_length_km: float = 40.0
    later_depth: float = 0.7
    check_rate: float = 0.0625

    def __post_init__(self):
        limits = {
            "target_stderr": (1e-6, 1.0),
            "samples": (2, 10**12),
            "max_samples": (2, 10**12),
            "time_limit_s": (0.0, 1e12),
            "max_orders": (1, NO_CUT),
            "seed": (0, 2**63 - 1),
            "chunk_samples": (1, 2**31),
            "pilot_samples": (2, 2**31),
            "sub_paths": (1, 4096),
            "steering_sweeps": (0, 50),
            "steered_fraction": (0.0, 0.99),
            "table_fraction": (0.0, 0.99),
            "candidates": (1, 1000),
            "roulette": (0.0, 100.0),
            "continuation": (0.01, 100.0),
            "first_length_km": (0.1, 1000.0),
            "first_depth": (0.01, 1.0),
            "later_length_km": (0.1, 1000.0),
            "later_depth": (0.01, 1.0),
            "check_rate": (0.001, 1.0),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise TwilightError(f"montecarlo setting {name} must be between {low:g} and {high:g}, not {value}")
        if self.approximation not in APPROXIMATIONS:
            raise TwilightError(
                f"montecarlo setting approximation must be one of {', '.join(APPROXIMATIONS)}, not {self.approximation}"
            )

    @property
    def polarised(self) -> bool:
        """Whether paths carry Stokes vectors: `polarisation`, and events that are not taken for isotropic."""
        return self.polarisation and self.approximation == "none"

    def walk(self, has_refraction: bool) -> Walk:
        """The part that kernels take, in air with or without refraction."""
        bent = has_refraction and self.refraction and self.bent_lines_of_sight
        polarised = self.polarised
        return Walk(
            Cuts(self.first_length_km, self.first_depth, FIRST_SAG_KM, bent, polarised, False),
            Cuts(self.later_length_km, self.later_depth, LATER_SAG_KM, bent, polarised, True),
            self.sub_paths,
            self.steered_fraction,
            self.table_fraction,
            self.candidates,
            self.roulette,
            self.continuation,
            self.coarse_control and self.max_orders is None and self.steering_sweeps > 0,
            NO_CUT if self.max_orders is None else self.max_orders,
        )

    def as_dict(self) -> dict:
        """Plain values, for provenance."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


QUALITIES = {
    "draft": MonteCarloSettings(target_stderr=0.05, polarisation=False),
    "standard": MonteCarloSettings(target_stderr=0.01),
    "reference": MonteCarloSettings(target_stderr=0.003),
}
