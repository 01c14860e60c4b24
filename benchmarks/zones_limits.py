"""What the errors of zones at `standard` consist of where they exceed what was aimed at: steps and polar angles.

    python benchmarks/zones_limits.py                both tables
    python benchmarks/zones_limits.py steps          zones_limits.csv
    python benchmarks/zones_limits.py polar          zones_limits_polar.csv

The first: errors of `standard` against the referee's directions (benchmarks/reference) as it is, with steps of the
first event as coarse as those of the later ones, and with finer ones of these, and the processor time of the field.
The second, at 680 nm in volcanic-extreme air under suns far below the horizon: what one scattering event gets wrong, in
per cent of the light from all directions at an altitude, because of the places of the polar angles above the horizon.
`clustered`: those of `zones`, close together at the horizon; `parted`: as many, of which two lie below and the others
above the direction that touches the top of the haze, where the extinction halves at once and the glow from behind the
Earth's edge is cut off.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.zones.passes import scatter
from twilight.transport.lines import horizon_cosine

HERE = Path(__file__).parent
STANDARD = zones.QUALITIES["standard"]
DENSITIES: tuple[dict[str, float], ...] = ({"first_step_density": 0.7}, {"step_density": 1.0})
STEPS: tuple[tuple[str, tuple[float, ...], tuple[float, ...], tuple[dict[str, float], ...]], ...] = (
    ("antarctic", (450.0, 550.0, 680.0), (0.0, -4.0), ({}, *DENSITIES)),
    ("desert", (450.0, 550.0, 680.0), (0.0, -4.0, -6.0), ({}, *DENSITIES)),
    ("urban", (450.0, 550.0, 680.0), (5.0, 0.0, -9.0), ({}, *DENSITIES)),
)
"""Climate, wavelengths [nm], suns [deg], and what is changed of `standard`."""
COARSE = replace(
    STANDARD,
    polarisation=False,
    degree=12,
    polar_directions=16,
    azimuth_directions=11,
    early_events=1000,
    zenith_density=0.8,
    altitude_density=0.7,
    tolerance=5e-3,
)
"""Settings of the light that is scattered once more for the second table."""
FINE, POLAR = 120, (9, 14, 24, 40)
ZENITHS_DEG = (95.0, 100.0, 104.5)
HIGHEST_KM, HAZE_KM, BELOW_HAZE, WIDTH, EDGE_WIDTH, CENTRE = 21.0, 2.0, 2, 0.03, 0.025, 0.75


def steps() -> None:
    """zones_limits.csv"""
    rows = []
    for climate, nm, suns, changes in STEPS:
        table = results.read_numbers(HERE / "reference" / f"{climate}.csv")
        medium = climate_medium(load_climate(climate), np.array(nm))
        for change in changes:
            start = time.process_time()
            field = zones.prepare(medium, replace(STANDARD, **change), sun_elevations_deg=suns)  # type: ignore[arg-type]
            seconds = time.process_time() - start
            for sun in suns:
                some = table[(table["sun_elevation_deg"] == sun) & np.isin(table["wavelength_nm"], nm)]
                sky = field.radiance(sun, some["elevation_deg"], some["azimuth_deg"])
                sky = sky[np.arange(some.size), np.searchsorted(nm, some["wavelength_nm"])]
                error = sky / some["radiance_per_sr"] - 1.0
                own = some["standard_error_per_sr"] / some["radiance_per_sr"]
                excess = results.excess(error, own)
                numbers = (error.mean(), excess, error[np.argmax(np.abs(error))], np.median(own))
                what = " ".join(f"{name} {value:g}" for name, value in change.items()) or "standard"
                where = [climate, " ".join(f"{x:g}" for x in nm), what, f"{sun:g}"]
                rows.append([*where, *(f"{100.0 * x:.2f}" for x in numbers), f"{seconds:.0f}"])
                print(*rows[-1], sep="\t", flush=True)
    head = "climate,wavelengths_nm,settings,sun_elevation_deg,mean_percent,excess_percent,worst_percent,referee_percent"
    results.write(HERE / "zones_limits.csv", [*head.split(","), "processor_s"], rows)


def clustered(low: float, centre: float, width: float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points and weights on low..1, uniform in asinh((x - centre)/width)."""
    x, w = np.polynomial.legendre.leggauss(n)
    a, b = np.arcsinh((low - centre) / width), np.arcsinh((1.0 - centre) / width)
    t = a + (b - a) * 0.5 * (x + 1.0)
    w = w * np.cosh(t)
    return centre + width * np.sinh(t), w * ((1.0 - low) / w.sum())


def parted(low: float, edge: float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The same with BELOW_HAZE points on low..edge, uniform in the root of the distance to it: what the haze takes from
    a ray grows so."""
    x, w = np.polynomial.legendre.leggauss(BELOW_HAZE)
    root = 0.5 * (x + 1.0)
    under, share = edge - (edge - low) * root**2, w * root
    above, rest = clustered(edge, CENTRE * edge, EDGE_WIDTH, n - BELOW_HAZE)
    return np.append(under, above), np.append(share * ((edge - low) / share.sum()), rest)


def polar() -> None:
    """zones_limits_polar.csv"""
    medium = climate_medium(load_climate("volcanic-extreme"), np.array([680.0]))
    field = zones.prepare(medium, COARSE, sun_elevations_deg=(-18.0,))
    passes = field._stage(FINE, COARSE.azimuth_directions, COARSE.degree, 0)(0)
    light, angles, nodes = field.solutions[0].light, passes.angles, field.nodes
    out, ground = passes._empty(), passes.ground()
    n_polar = angles.cosine.shape[1]
    scatter(
        passes.rays.first, passes.points, passes.turning.place, light, nodes.zenith_rule, angles.series, *ground,
        n_polar, out, 0, out.shape[0],
    )  # fmt: skip
    seen = out[..., 0, 0].mean(axis=3)
    profile = field.path_profile
    horizon = horizon_cosine(profile, nodes.altitude_km)
    clear = profile.altitude_km >= HAZE_KM
    # the ground of an Earth that the haze is part of
    without = profile._replace(
        altitude_km=profile.altitude_km[clear] - HAZE_KM,
        gradient_per_km=profile.gradient_per_km[clear],
        earth_radius_km=profile.earth_radius_km + HAZE_KM,
    )
    edge = horizon_cosine(without, np.maximum(nodes.altitude_km - HAZE_KM, 0.0))
    rows = []
    for zenith in ZENITHS_DEG:
        t = int(np.argmin(np.abs(np.degrees(nodes.zenith_rad) - zenith)))
        for n in POLAR:
            for k, z in enumerate(nodes.altitude_km):
                if not HAZE_KM < z < HIGHEST_KM:
                    continue
                at, shine = angles.cosine[k, angles.below :], seen[k, angles.below :, t]
                weight = angles.weight[k]
                truth, whole = weight[angles.below :] @ shine, weight @ seen[k, :, t]
                errors = []
                for x, w in (clustered(horizon[k], CENTRE * horizon[k], WIDTH, n), parted(horizon[k], edge[k], n)):
                    found = 0.5 * w @ np.exp(np.interp(x, at, np.log(np.maximum(shine, 1e-30))))
                    errors.append(100.0 * (found - truth) / whole)
                where = (f"{np.degrees(nodes.zenith_rad[t]):.1f}", n, f"{z:.2f}")
                rows.append([*where, *(f"{round(e, 2) + 0.0:.2f}" for e in errors)])
    for n in POLAR:
        rms = [np.sqrt(np.mean([float(r[c]) ** 2 for r in rows if r[1] == n])) for c in (3, 4)]
        print(f"{n} polar angles: {rms[0]:.2f} % rms clustered, {rms[1]:.2f} % parted", flush=True)
    head = ["solar_zenith_deg", "polar_directions", "altitude_km", "clustered_percent", "parted_percent"]
    results.write(HERE / "zones_limits_polar.csv", head, rows)


if __name__ == "__main__":
    if sys.argv[1:] != ["polar"]:
        steps()
    if sys.argv[1:] != ["steps"]:
        polar()
