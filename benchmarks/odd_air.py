"""Odd air against the referee: python benchmarks/odd_air.py [odd] [layers] [SECONDS]

Scalar theory, one wavelength, no refraction.  `odd` writes benchmarks/odd_air.csv: air that ends at 20 km, ozone of 20
times the usual depth, aerosol of asymmetry 0.99, haze in stripes; `layers` writes benchmarks/sharp_layers.csv: single
layers from 10 m to 1 km seen from below, from inside and from above.  Each row has the referee's radiance, its standard
error, and what `zones` at draft and standard differ by, in per cent of the referee.

The referee samples until 0.5 % (layers: 1 %) or for SECONDS for each sun and observer (60).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from layered_sky import layered  # noqa: E402
from stability_media import LEVELS_KM, Air, medium_of  # noqa: E402

from twilight.atmosphere.medium import Medium  # noqa: E402
from twilight.solvers import montecarlo, zones  # noqa: E402

SUNS_DEG = (30.0, -6.0)
ELEVATION_DEG = np.array([1.0, 1.0, 5.0, 20.0, 90.0])
AZIMUTH_DEG = np.array([0.0, 180.0, 0.0, 90.0, 0.0])
COLUMNS = (
    "case,sun_elevation_deg,observer_km,elevation_deg,azimuth_deg,referee_per_sr,referee_percent,untrusted,"
    "draft_percent,standard_percent"
)


def air(levels_km: np.ndarray = LEVELS_KM, **depths: float) -> Medium:
    return medium_of(Air(**depths), levels_km=levels_km, refractivity=0.0)  # type: ignore[arg-type]


def striped() -> Medium:
    """Ten stripes of haze, 100 m each with edges, 100 m apart from 1 km on, optical depth 0.05 each."""
    edges = 1.0 + 0.1 * np.arange(20)
    levels = np.sort(np.concatenate([[0.0, 0.5], edges, edges, [4.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0, 80.0]]))
    medium = air(levels, aerosol=0.0)
    aerosol = np.zeros_like(medium.aerosol_extinction_per_km)
    for base in edges[::2]:
        first = np.flatnonzero(levels == base)[-1]
        aerosol[first : first + 2] = 0.05 / 0.1
    return replace(medium, aerosol_extinction_per_km=aerosol)


ODD: dict[str, Callable[[], Medium]] = {
    "top at 20 km": lambda: air(np.concatenate([np.arange(0.0, 10.0), np.linspace(10.0, 20.0, 6)])),
    "ozone 20 times": lambda: air(ozone=0.6),
    "asymmetry 0.99": lambda: air(aerosol=0.5, asymmetry=0.99),
    "striped haze": striped,
}

LAYERS: dict[str, tuple[float, float, float, float]] = {
    "jump, 10 m at 3 km, depth 2": (3.0, 0.01, 2.0, 0.0),
    "jump, 1 km at 3 km, depth 10": (3.0, 1.0, 10.0, 0.0),
    "ramps of 1 m, 200 m at 3 km, depth 0.5": (3.0, 0.2, 0.5, 1e-3),
    "jump, 1 km at 10 km, depth 0.01": (10.0, 1.0, 0.01, 0.0),
    "jump, 500 m at 1 km, depth 50": (1.0, 0.5, 50.0, 0.0),
    "jump, 1 km at 50 km, depth 1": (50.0, 1.0, 1.0, 0.0),
}
"""base [km], thickness [km], optical depth, ramps [km]"""


def compare(case: str, medium: Medium, altitude_km: float, elevation, azimuth, error: float, seconds: float) -> list:
    skies = []
    for quality in ("draft", "standard"):
        settings = replace(zones.QUALITIES[quality], polarisation=False)
        field = zones.prepare(medium, settings, observer_altitude_km=altitude_km, sun_elevations_deg=SUNS_DEG)
        skies.append([field.radiance(sun, elevation, azimuth)[:, 0] for sun in SUNS_DEG])
    referee = montecarlo.prepare(
        medium,
        montecarlo.MonteCarloSettings(target_stderr=error, time_limit_s=seconds, polarisation=False),
        observer_altitude_km=altitude_km,
    )
    rows = []
    for i, sun in enumerate(SUNS_DEG):
        found = referee.radiance_with_error(sun, elevation, azimuth)
        value, own = found.radiance[:, 0], found.standard_error[:, 0]
        for d in range(elevation.size):
            off = [f"{100.0 * (sky[i][d] / value[d] - 1.0):.2f}" for sky in skies]
            rows.append(
                [case, f"{sun:g}", f"{altitude_km:g}", f"{elevation[d]:g}", f"{azimuth[d]:g}", f"{value[d]:.5g}",
                 f"{100.0 * own[d] / value[d]:.2f}", int(found.untrusted[d, 0]), *off]
            )  # fmt: skip
            print(*rows[-1], sep="\t", flush=True)
    return rows


def compile_first() -> None:
    """The referee's time is not that of its compilation."""
    settings = montecarlo.MonteCarloSettings(target_stderr=None, samples=2, polarisation=False)
    field = montecarlo.prepare(air(), settings, observer_altitude_km=0.0)
    for sun in SUNS_DEG:
        field.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG)


def main(arguments: list[str]) -> None:
    compile_first()
    seconds = next((float(a) for a in arguments if a.replace(".", "").isdigit()), 60.0)
    kinds = [a for a in arguments if a in ("odd", "layers")] or ["odd", "layers"]
    if "odd" in kinds:
        rows = [
            row
            for case, medium in ODD.items()
            for row in compare(case, medium(), 0.0, ELEVATION_DEG, AZIMUTH_DEG, 0.005, seconds)
        ]
        results.write(HERE / "odd_air.csv", COLUMNS.split(","), rows)
    if "layers" in kinds:
        rows = []
        for case, (base, thickness, depth, ramp) in LAYERS.items():
            medium = layered(base, thickness, depth, ramp)
            for altitude, up in (
                (0.0, (3.0, 20.0, 90.0)),
                (base + 0.5 * thickness, (-20.0, 0.5, 20.0)),
                (base + thickness + 5.0, (-90.0, -20.0, 10.0)),
            ):
                views = np.array(up)
                rows += compare(case, medium, altitude, views, np.full(views.size, 40.0), 0.01, seconds)
        results.write(HERE / "sharp_layers.csv", COLUMNS.split(","), rows)


if __name__ == "__main__":
    main(sys.argv[1:])
