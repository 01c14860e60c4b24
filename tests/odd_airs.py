"""Air, sun, observer and directions drawn from all that the program permits: what `benchmarks/odd_air.py` tries.

A number names a case: `drawn(number)` makes it again.  Depths are vertical optical depths.
"""

from dataclasses import dataclass

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import PhaseFunction
from twilight.transport.rays import horizon_dip_deg

LEVELS = (2, 500)
"""Fewest and most altitudes that are drawn; those of a thin layer come on top."""
LAYERS_ODDS = 0.25
"""Part of the airs that consist of uniform layers with jumps between them."""
THIN_ODDS = 0.35
"""Part of the airs with a layer of aerosol besides, 10 m to 1 km thick."""
MOST_DEPTH = 20.0
"""Most aerosol."""
MOST_ASYMMETRY = 0.98
"""Largest asymmetry parameter of Henyey and Greenstein's phase function."""
DUCT_ODDS = 0.1
"""Part of the refracting airs with a duct over the ground."""
DUCT = 4e-5
"""Fall of the index through the duct, faster than 1 / radius."""
DUCT_KM = 0.1
"""Depth of the duct [km]."""
LOWEST_KM, ORBIT_KM = -0.43, 400.0
"""Shore of the Dead Sea, and an orbit [km]."""


@dataclass(frozen=True)
class OddAir:
    """A case: what was drawn in words, the medium (W = 1), the observer [km], the sun and the directions (D,) [deg]."""

    what: str
    medium: Medium
    altitude_km: float
    sun_deg: float
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between two others, each factor as likely as the others."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def pick(rng: np.random.Generator, *choices: tuple[float, float]) -> float:
    """One of some numbers, each with its odds."""
    value, odds = np.transpose(choices)
    return float(rng.choice(value, p=odds))


def drawn_air(rng: np.random.Generator, bottom_km: float) -> tuple[str, Medium]:
    """What was drawn, and the medium."""
    nm = rng.uniform(300.0, 1000.0)
    top_km = pick(rng, (20.0, 0.1), (80.0, 0.45), (100.0, 0.45))
    layers = rng.random() < LAYERS_ODDS
    place = np.linspace(0.0, 1.0, round(log_uniform(rng, *LEVELS))) ** rng.choice([1.0, 2.0])
    edges = bottom_km + (top_km - bottom_km) * place
    jumps = set(edges[1:-1]) if layers else set()
    aerosol = pick(rng, (0.0, 0.2), (log_uniform(rng, 1e-3, MOST_DEPTH), 0.6), (rng.uniform(0.0, MOST_DEPTH), 0.2))
    asymmetry = pick(rng, (0.0, 0.1), (MOST_ASYMMETRY, 0.1), (rng.uniform(0.0, MOST_ASYMMETRY), 0.8))
    albedo = pick(rng, (0.0, 0.05), (1.0, 0.25), (rng.uniform(0.0, 1.0), 0.2), (rng.uniform(0.8, 1.0), 0.5))
    ozone = pick(rng, (0.0, 0.3), (log_uniform(rng, 1e-3, 3.0), 0.7))
    ground = pick(rng, (0.0, 0.25), (1.0, 0.25), (rng.uniform(0.0, 1.0), 0.5))
    refractivity = pick(rng, (0.0, 0.25), (2.8e-4, 0.75))
    what = [f"{nm:.0f} nm", f"{edges.size} {'edges of layers' if layers else 'levels'} to {top_km:g} km"]
    what += [
        f"aerosol {aerosol:.3g} g {asymmetry:.3g} albedo {albedo:.3g}",
        f"ozone {ozone:.2g}",
        f"ground {ground:.2g}",
    ]
    thin = None
    if rng.random() < THIN_ODDS:
        base = bottom_km + pick(rng, (0.0, 0.2), (rng.uniform(0.0, 15.0), 0.8))
        thin = base, base + log_uniform(rng, 0.01, 1.0), log_uniform(rng, 0.003, 2.0)
        edges = np.unique([*edges, *thin[:2]])
        jumps |= {edge for edge in thin[:2] if edge > bottom_km}
        what.append(f"layer {1000.0 * (thin[1] - thin[0]):.0f} m at {base:.2f} km depth {thin[2]:.2g}")
    duct = refractivity > 0.0 and rng.random() < DUCT_ODDS
    if duct:
        edges = np.unique([*edges, bottom_km + DUCT_KM])
        what.append("duct")
    elif refractivity == 0.0:
        what.append("no refraction")
    # levels, twice where there is a jump; an altitude within the same layer; where profiles are read
    z = np.repeat(edges, [2 if edge in jumps else 1 for edge in edges])
    down, up = np.diff(z, prepend=z[0]), np.diff(z, append=z[-1])
    beside = z + 0.5 * np.where(down == 0.0, up, np.where(up == 0.0, -down, 0.0))
    at = np.where(layers, beside, z)

    def column(shape: np.ndarray, depth: float) -> np.ndarray:
        return (shape * depth / np.sum(0.5 * (shape[1:] + shape[:-1]) * np.diff(z)))[:, None]

    height_km = log_uniform(rng, 0.5, 3.0)
    extinction = column(np.exp(-(at - bottom_km) / height_km), aerosol)
    if thin is not None:
        extinction[(beside > thin[0]) & (beside < thin[1])] += thin[2] / (thin[1] - thin[0])
    index = refractivity * np.exp(-z / 8.0)
    if duct:
        index[z == bottom_km] = index[z == bottom_km + DUCT_KM][0] + DUCT
    return ", ".join(what), Medium(
        wavelength_nm=np.array([nm]),
        altitude_km=z,
        air_scattering_per_km=column(np.exp(-at / 8.0), 0.00877 * (nm / 1000.0) ** -4.05),
        absorption_per_km=column(np.exp(-(((at - 22.0) / 6.0) ** 2)), ozone),
        aerosol_extinction_per_km=extinction,
        aerosol_single_scattering_albedo=np.full((z.size, 1), albedo),
        aerosol_phase_fraction=np.ones((1, z.size, 1)),
        phase_functions=(PhaseFunction.henyey_greenstein([asymmetry]),),
        refractivity=index[:, None],
        depolarisation=np.array([0.03]),
        ground_albedo=np.array([ground]),
        overhead_absorption_optical_depth=np.zeros(1),
        name="odd",
    )


def drawn(number: int) -> OddAir:
    """The case of a number."""
    rng = np.random.default_rng([65, number])
    bottom_km = pick(rng, (LOWEST_KM, 0.15), (0.0, 0.75), (rng.uniform(0.0, 4.0), 0.1))
    what, medium = drawn_air(rng, bottom_km)
    return seen(rng, what, medium)


def seen(rng: np.random.Generator, what: str, medium: Medium) -> OddAir:
    """A medium with an observer, a sun and directions drawn."""
    bottom_km = medium.bottom_km
    low, high = bottom_km + rng.uniform(0.0, 12.0), rng.uniform(12.0, 100.0)
    altitude_km = pick(rng, (bottom_km, 0.5), (low, 0.25), (high, 0.15), (ORBIT_KM, 0.1))
    radius = medium.earth_radius_km
    geometric = -float(np.degrees(np.arccos((radius + bottom_km) / (radius + altitude_km))))
    dip = horizon_dip_deg(medium, altitude_km)
    twilight, day = rng.uniform(-18.0, 0.0), rng.uniform(0.0, 90.0)
    sun = pick(rng, (twilight, 0.5), (day, 0.3), (90.0, 0.05), (0.0, 0.05), (geometric, 0.05), (-dip, 0.05))
    if altitude_km > bottom_km:
        elevation = np.array([20.0, -dip + 0.5, -dip - 2.0, -90.0])
    else:
        elevation = np.array([90.0, 20.0, 5.0, 1.0])
    azimuth = np.array([0.0, 90.0, 180.0, rng.uniform(5.0, 60.0)])
    at = f"{altitude_km:.3g} km, sun {sun:.4g} deg"
    return OddAir(f"{what}, {at}", medium, altitude_km, sun, elevation, azimuth)
