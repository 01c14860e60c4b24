"""Two parts of the errors of `zones`: the quadrature over polar angles, and a layer at 50 km after sunset.

    python benchmarks/zones_study.py quadrature         zones_study_quadrature.csv
    python benchmarks/zones_study.py layer              zones_study_layer.csv
    python benchmarks/zones_study.py layer-reference    zones_study_layer_reference.csv

`quadrature`: for all types of aerosol half a kilometre above the ground, what is missing (negative) or too much after
one scattering into an elevation, over the mean of all elevations, of light from above the horizon that is uniform or
falls by e within a cosine of 0.3 from it: by the weights of the polar angles alone, and by the analysis of `zones`,
which takes smooth light out first.

`layer`: a conservative layer of HG 0.7, 1 km thick, of optical depth 1, at 50 km, above air of optical depth 0.1 and
black ground; scalar theory, no refraction, sun at -6 deg, seen from the ground: `zones` beside the mean of the seeds of
`layer-reference`, the standard error of that mean, and the chi square of the seeds about it.  `layer-reference` samples
SEEDS seeds for SEED_S seconds each.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from layered_sky import layered  # noqa: E402

from twilight.base.errors import TwilightWarning  # noqa: E402
from twilight.config.load import load_climate  # noqa: E402
from twilight.scene.medium import climate_medium  # noqa: E402
from twilight.solvers import montecarlo, zones  # noqa: E402
from twilight.solvers.zones.grid import even_harmonics, make_angles  # noqa: E402
from twilight.transport.ray_bundle import species_fraction  # noqa: E402
from twilight.transport.scaling import delta_scaled  # noqa: E402

STANDARD = zones.QUALITIES["standard"]
COLOURS_NM = (450.0, 550.0, 680.0)


TYPES = (
    "antarctic",
    "arctic",
    "continental-average",
    "continental-clean",
    "continental-polluted",
    "desert",
    "maritime-clean",
    "maritime-polluted",
    "maritime-tropical",
    "urban",
)
REFERENCE = zones.QUALITIES["reference"]
QUADRATURES = (
    (STANDARD.degree, STANDARD.polar_directions),
    (STANDARD.max_degree, STANDARD.polar_directions),
    (REFERENCE.max_degree, REFERENCE.polar_directions),
)
"""degree and polar_directions of `standard`, in most air and beside coarse particles, of `reference` there."""
SKIES: dict[str, Callable[[np.ndarray], np.ndarray]] = {"uniform": np.ones_like, "falling": lambda x: np.exp(-x / 0.3)}
"""Radiance by the cosine of the zenith angle, above the horizon."""
ELEVATIONS_DEG = (1.0, 6.0, 20.0, 45.0, 60.0, 75.0, 82.0, 90.0)
ABOVE_GROUND_KM = 0.5
LAYER = (50.0, 1.0, 1.0)
"""Base [km], thickness [km] and optical depth of the layer."""
LAYER_SUN_DEG = -6.0
LAYER_ELEVATION_DEG, LAYER_AZIMUTH_DEG = np.array([20.0, 90.0]), np.array([40.0, 40.0])
SEEDS, SEED_S = 4, 110.0
SEEDS_TABLE = HERE / "zones_study_layer_reference.csv"


def quadrature() -> None:
    """zones_study_quadrature.csv"""
    rows = []
    x, w = np.polynomial.legendre.leggauss(2000)
    fine, fine_weight = 0.5 * (x + 1.0), 0.25 * w
    for name in TYPES:
        medium = climate_medium(load_climate(name), np.array(COLOURS_NM))
        for degree, polar in QUADRATURES:
            scaled = delta_scaled(medium, degree)
            fraction = species_fraction(scaled.medium, np.array([medium.bottom_km + ABOVE_GROUND_KM]))[1:, 0]
            aerosol = np.einsum("kw,klw->lw", fraction / fraction.sum(axis=0), scaled.moments[1:])
            # level with the ground, whose horizon is at 90 deg
            angles = make_angles(np.array([0.0]), polar, STANDARD.azimuth_directions, degree)
            cosine, weight = angles.cosine[0], angles.weight[0]
            all_round = angles.analysis[0][angles.order == 0].sum(axis=2)
            seen = even_harmonics(np.sin(np.radians(ELEVATIONS_DEG)), degree, 0)
            for light, sky in SKIES.items():
                truth = (fine_weight * sky(fine)) @ even_harmonics(fine, degree, 0)
                at_angles = np.where(cosine > 0.0, sky(cosine), 0.0)
                by_weights = (weight * at_angles) @ even_harmonics(cosine, degree, 0)
                found = [np.einsum("el,l,lw->ew", seen, m, aerosol) for m in (truth, by_weights, all_round @ at_angles)]
                errors = [100.0 * (part - found[0]) / found[0].mean() for part in found[1:]]
                for i, elevation in enumerate(ELEVATIONS_DEG):
                    numbers = [f"{round(v, 2) + 0.0:.2f}" for v in np.concatenate([part[i] for part in errors])]
                    rows.append([name, degree, polar, light, f"{elevation:g}", *numbers])
    columns = ["climate", "degree", "polar_directions", "light", "elevation_deg"]
    columns += [f"{how}_percent_{nm:g}nm" for how in ("weights", "analysis") for nm in COLOURS_NM]
    results.write(HERE / "zones_study_quadrature.csv", columns, rows)


def layer_reference() -> None:
    """zones_study_layer_reference.csv"""
    medium, rows = layered(*LAYER), []
    for seed in range(1, SEEDS + 1):
        sampled = montecarlo.MonteCarloSettings(target_stderr=1e-3, time_limit_s=SEED_S, polarisation=False, seed=seed)
        field = montecarlo.prepare(medium, sampled, observer_altitude_km=0.0)
        found = field.radiance_with_error(LAYER_SUN_DEG, LAYER_ELEVATION_DEG, LAYER_AZIMUTH_DEG)
        for d, elevation in enumerate(LAYER_ELEVATION_DEG):
            value, own = found.radiance[d, 0], found.standard_error[d, 0]
            percent = f"{100.0 * own / value:.2f}"
            rows.append([seed, f"{elevation:g}", f"{value:.5g}", percent, int(found.untrusted[d, 0])])
            print(*rows[-1], sep="\t", flush=True)
    columns = ["seed", "elevation_deg", "radiance_per_sr", "standard_error_percent", "untrusted"]
    results.write(SEEDS_TABLE, columns, rows)


def layer() -> None:
    """zones_study_layer.csv"""
    skies, rows = [], []
    for quality in ("draft", "standard"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TwilightWarning)
            scalar = replace(zones.QUALITIES[quality], polarisation=False)
            field = zones.prepare(layered(*LAYER), scalar, sun_elevations_deg=[LAYER_SUN_DEG])
        skies.append(field.radiance(LAYER_SUN_DEG, LAYER_ELEVATION_DEG, LAYER_AZIMUTH_DEG)[:, 0])
    for d, elevation in enumerate(LAYER_ELEVATION_DEG):
        of = [row for row in results.read_rows(SEEDS_TABLE) if float(row["elevation_deg"]) == elevation]
        value = np.array([float(row["radiance_per_sr"]) for row in of])
        own = 0.01 * value * np.array([float(row["standard_error_percent"]) for row in of])
        mean, error = value.mean(), np.sqrt(np.sum(own**2)) / value.size
        chi_square = np.sum(((value - mean) / own) ** 2)
        off = [f"{100.0 * (sky[d] / mean - 1.0):.1f}" for sky in skies]
        seeds = [f"{mean:.4g}", f"{100.0 * error / mean:.2f}", f"{chi_square:.1f}", value.size - 1]
        rows.append([f"{elevation:g}", *seeds, *off])
        print(*rows[-1], sep="\t", flush=True)
    columns = "elevation_deg,reference_per_sr,reference_percent,chi_square,freedom,draft_percent,standard_percent"
    results.write(HERE / "zones_study_layer.csv", columns.split(","), rows)


STUDIES = {"quadrature": quadrature, "layer": layer, "layer-reference": layer_reference}

if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1] not in STUDIES:
        raise SystemExit(f"python benchmarks/zones_study.py {'|'.join(STUDIES)}")
    STUDIES[sys.argv[1]]()
