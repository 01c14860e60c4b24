"""`zones` below clouds beside the reference solution, and what a cloud costs.

    python benchmarks/clouds.py reference [SECONDS]     clouds_reference.csv
    python benchmarks/clouds.py                         clouds.csv
    python benchmarks/clouds.py times                   clouds_times.csv
    python benchmarks/clouds.py plane                   clouds_plane.csv

Average land air with a deck of stratus from 0.5 to 1 km, or noctilucent clouds, at 550 nm.  `reference` samples every
sun for SECONDS (20).  `clouds.csv` has the difference of each quality from it in per cent; `times` the processor
seconds of fields for all suns at the placed wavelengths.  Under decks of depth 10 and more the reference solution needs
hours: there doubling and adding judges, `plane`: a deck of stratus alone, 1 km thick on a ground without curvature,
light at 550 nm without polarisation.  Its rows are fluxes over F0 (direct light included), and radiances that are
azimuthal means, which delta scaling leaves as they are under thick decks alone.
"""

from __future__ import annotations

import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.atmosphere.clouds import KINDS, CloudLayer
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightWarning
from twilight.config.load import load_climate
from twilight.config.scene import Wavelengths
from twilight.engine.hemisphere import hemisphere
from twilight.scene.medium import climate_medium
from twilight.solvers import montecarlo, zones

HERE = Path(__file__).parent
DEPTHS = (0.1, 1.0)
SUNS_DEG = (60.0, 10.0, -4.0, -12.0)
BELOW = ((90.0, 0.0), (30.0, 0.0), (30.0, 180.0), (10.0, 90.0))
"""Elevation and azimuth [deg] of views from the ground."""
REFERENCE_COLUMNS = "case,sun_elevation_deg,elevation_deg,azimuth_deg,reference_per_sr,reference_percent,untrusted"
QUALITIES = ("draft", "standard")
PLANE_DEPTHS = (0.1, 1.0, 10.0, 100.0)
PLANE_SUNS_DEG = (60.0, 20.0)
STREAMS = 32
"""Cosines of each hemisphere of doubling and adding."""


def medium_of(cloud: dict | None, wavelength_nm: np.ndarray) -> Medium:
    clouds = {"clouds": [cloud]} if cloud else {}
    climate = load_climate("continental-average")
    return climate_medium(type(climate).model_validate(climate.model_dump(exclude_unset=True) | clouds), wavelength_nm)


CASES: dict[str, tuple[dict, tuple[float, ...]]] = {
    **{f"stratus of depth {depth:g}": ({"kind": "stratus", "optical_depth": depth}, SUNS_DEG) for depth in DEPTHS},
    "noctilucent clouds": ({"kind": "noctilucent"}, (-10.0,)),
}


def reference(seconds: float) -> None:
    rows = []
    for case, (cloud, suns) in CASES.items():
        medium = medium_of(cloud, np.array([550.0]))
        elevation, azimuth = np.array(BELOW).T
        settings = montecarlo.MonteCarloSettings(target_stderr=0.005, time_limit_s=seconds)
        field = montecarlo.prepare(medium, settings)
        for sun in suns:
            found = field.radiance_with_error(sun, elevation, azimuth)
            for d in range(elevation.size):
                value, error = found.radiance[d, 0], found.standard_error[d, 0]
                where = (sun, elevation[d], azimuth[d])
                row = [case, *(f"{x:g}" for x in where), f"{value:.5g}", f"{100.0 * error / value:.2f}"]
                rows.append([*row, int(found.untrusted[d, 0])])
                print(*rows[-1], sep="\t", flush=True)
    results.write(HERE / "clouds_reference.csv", REFERENCE_COLUMNS.split(","), rows)


def compare() -> None:
    truth = results.read_rows(HERE / "clouds_reference.csv")
    rows = []
    for case, (cloud, suns) in CASES.items():
        medium = medium_of(cloud, np.array([550.0]))
        own = [row for row in truth if row["case"] == case]
        off = {}
        for quality in QUALITIES:
            settings = zones.QUALITIES[quality]
            field = zones.prepare(medium, settings, sun_elevations_deg=suns)
            off[quality] = []
            for row in own:
                sun, elevation, azimuth = (
                    float(row[key]) for key in ("sun_elevation_deg", "elevation_deg", "azimuth_deg")
                )
                value = field.radiance(sun, elevation, azimuth)[0]
                off[quality].append(100.0 * (value / float(row["reference_per_sr"]) - 1.0))
        for k, row in enumerate(own):
            rows.append([*row.values(), *(f"{off[quality][k]:.2f}" for quality in QUALITIES)])
            print(*rows[-1], sep="\t", flush=True)
    columns = [*REFERENCE_COLUMNS.split(","), *(f"{quality}_percent" for quality in QUALITIES)]
    results.write(HERE / "clouds.csv", columns, rows)


def times() -> None:
    wavelength_nm = np.array(Wavelengths().wavelength_nm)
    rows = []
    for quality in QUALITIES:
        clear = 0.0
        for depth in (None, 1.0, 25.0):
            cloud = None if depth is None else {"kind": "stratus", "optical_depth": depth}
            medium = medium_of(cloud, wavelength_nm)
            zones.prepare(medium, replace(zones.QUALITIES[quality], max_orders=8), sun_elevations_deg=(60.0,))
            start = time.process_time()
            field = zones.prepare(medium, zones.QUALITIES[quality])
            seconds = time.process_time() - start
            clear = clear or seconds
            size = field.grids.nodes.altitude_km.size
            rows.append([quality, depth or 0, f"{seconds:.1f}", f"{seconds / clear:.1f}", size])
            print(*rows[-1], sep="\t", flush=True)
    results.write(
        HERE / "clouds_times.csv", ["quality", "optical_depth", "processor_s", "over_clear", "altitudes"], rows
    )


def plane() -> None:
    """Fluxes and mean radiances of decks beside doubling and adding (`tests/plane_parallel.py`), by both qualities."""
    sys.path.insert(0, str(HERE.parent / "tests"))
    from montecarlo_media import slab
    from plane_parallel import Slabs

    phase = CloudLayer("stratus", 0.0, 1.0, 1.0, KINDS["stratus"].effective_radius_um).region(550.0).phase_functions[0]
    chi = phase.legendre_moments(2 * STREAMS)[0]
    f = chi[-1]
    azimuth = (np.arange(8) + 0.5) * 22.5
    rows = []
    for depth in PLANE_DEPTHS:
        fields = [
            zones.prepare(
                slab(depth, 1.0, phase, radius_km=2e5),
                replace(zones.QUALITIES[quality], polarisation=False, refraction=False),
                sun_elevations_deg=PLANE_SUNS_DEG,
            )
            for quality in QUALITIES
        ]
        for sun in PLANE_SUNS_DEG:
            sine = float(np.sin(np.radians(sun)))
            truth = Slabs([(depth * (1.0 - f), 1.0, (chi[:-1] - f) / (1.0 - f))], 0.0, sine, STREAMS)
            inner = truth.cosine[:STREAMS]
            weight = 0.5 * np.polynomial.legendre.leggauss(STREAMS)[1]

            def means(field: zones.Field, cosine: np.ndarray, side: float, sun: float = sun) -> np.ndarray:
                question = (sun, np.degrees(np.arcsin(side * cosine))[:, None], azimuth)
                return field.radiance(*question, observer_altitude_km=0.0 if side > 0.0 else 1.0)[..., 0].mean(axis=1)

            wanted = {"flux below": truth.flux_down[1], "flux above": truth.flux_up[0]}
            found: list[dict[str, float]] = []
            for field in fields:
                elevation, around, over = hemisphere(sun, 96, 64)
                found.append({
                    "flux below": sine * np.exp(-depth / sine) + over @ field.radiance(sun, elevation, around)[:, 0],
                    "flux above": 2.0 * np.pi * (weight * inner) @ means(field, inner, -1.0),
                })  # fmt: skip
            if depth >= 10.0:
                for cosine in (1.0, 0.7, 0.4, 0.2):
                    k = int(np.abs(truth.cosine - cosine).argmin())
                    name = f"at {np.degrees(np.arcsin(truth.cosine[k])):.0f} deg"
                    wanted[f"radiance below {name}"] = truth.down[1, k]
                    wanted[f"radiance above {name}"] = truth.up[0, k]
                    for field, into in zip(fields, found, strict=True):
                        into[f"radiance below {name}"] = means(field, truth.cosine[k : k + 1], 1.0)[0]
                        into[f"radiance above {name}"] = means(field, truth.cosine[k : k + 1], -1.0)[0]
            for what, value in wanted.items():
                off = [f"{100.0 * (one[what] / value - 1.0):.2f}" for one in found]
                rows.append([f"{depth:g}", f"{sun:g}", what, f"{value:.5g}", *off])
                print(*rows[-1], sep="\t", flush=True)
    columns = ["optical_depth", "sun_elevation_deg", "quantity", "reference", *(f"{q}_percent" for q in QUALITIES)]
    results.write(HERE / "clouds_plane.csv", columns, rows)


def main(arguments: list[str]) -> None:
    warnings.simplefilter("ignore", TwilightWarning)
    if arguments[:1] == ["reference"]:
        reference(float(arguments[1]) if len(arguments) > 1 else 20.0)
    elif arguments[:1] == ["times"]:
        times()
    elif arguments[:1] == ["plane"]:
        plane()
    else:
        compare()


if __name__ == "__main__":
    main(sys.argv[1:])
