"""What the errors of zones beside coarse particles consist of.

    python benchmarks/coarse_particles.py                both tables
    python benchmarks/coarse_particles.py quadrature     the second

Writes benchmarks/coarse_particles.csv, of `desert` with the sun at 5, 0, -6 and -18 deg, per direction and wavelength:
the error of `standard` against benchmarks/reference/desert.csv with the referee's own, and by how much settings change
the radiance, one at a time, on fewer altitudes and solar zenith angles than those of `standard` (`NODES`).

Writes benchmarks/coarse_particles_quadrature.csv, of all types of aerosol half a kilometre above the ground: what is
missing (negative) or too much after one scattering into an elevation, in shares of the mean over the elevations, of
light from above the horizon that is even or falls by e within a cosine of 0.3 from it.  By the weights of the polar
angles alone, and by the analysis that `zones` uses, which takes smooth light out first.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.zones.grid import even_harmonics, make_angles
from twilight.transport.bundle import species_share
from twilight.transport.scaling import delta_scaled

HERE = Path(__file__).parent
SUNS_DEG = (5.0, 0.0, -6.0, -18.0)
STANDARD = zones.QUALITIES["standard"]
NODES = {"altitude_density": 0.5, "zenith_density": 0.6, "tolerance": 1e-2}
CHANGES: dict[str, dict[str, float]] = {
    "coarse_degree_20": {"coarse_degree": 20},
    "coarse_degree_28": {"coarse_degree": 28},
    "coarse_degree_48": {"coarse_degree": 48},
    "polar_directions_24": {"polar_directions": 24},
    "early_events_6": {"early_events": 6},
    "step_density_1.4": {"step_density": 1.4},
}
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
QUADRATURES = ((20, 14), (32, 14), (32, 20))
"""degree and polar_directions of `standard`, in most air and beside coarse particles, and of `reference`."""
SKIES: dict[str, Callable[[np.ndarray], np.ndarray]] = {"even": np.ones_like, "falling": lambda x: np.exp(-x / 0.3)}
"""Light by the cosine of the zenith angle, above the horizon."""
ELEVATIONS_DEG = (1.0, 6.0, 20.0, 45.0, 60.0, 75.0, 82.0, 90.0)
WAVELENGTHS_NM = (450.0, 550.0, 680.0)
ABOVE_GROUND_KM = 0.5


def skies() -> None:
    """coarse_particles.csv"""
    table = results.read_numbers(HERE / "reference" / "desert.csv")
    table = table[np.isin(table["sun_elevation_deg"], SUNS_DEG)]
    wavelength_nm = np.unique(table["wavelength_nm"])
    medium = climate_medium(load_climate("desert"), wavelength_nm)
    place = np.searchsorted(wavelength_nm, table["wavelength_nm"])

    def radiance(settings: zones.ZonesSettings) -> np.ndarray:
        field = zones.prepare(medium, settings, sun_elevations_deg=SUNS_DEG)
        out = np.empty(table.size)
        for sun in SUNS_DEG:
            of = table["sun_elevation_deg"] == sun
            sky = field.radiance(sun, table["elevation_deg"][of], table["azimuth_deg"][of])
            out[of] = sky[np.arange(sky.shape[0]), place[of]]
        print("solved", flush=True)
        return out

    truth, own = table["radiance_per_sr"], table["standard_error_per_sr"]
    columns = [100.0 * (radiance(STANDARD) / truth - 1.0), 100.0 * own / truth]
    coarse = replace(STANDARD, **NODES)
    base = radiance(coarse)
    columns += [100.0 * (radiance(replace(coarse, **change)) / base - 1.0) for change in CHANGES.values()]
    keys = ("sun_elevation_deg", "elevation_deg", "azimuth_deg", "wavelength_nm")
    rows = [
        [*(f"{row[key]:g}" for key in keys), *(f"{round(column[i], 2) + 0.0:.2f}" for column in columns)]
        for i, row in enumerate(table)
    ]
    header = [*keys, "error_percent", "referee_percent", *(f"{name}_changes_percent" for name in CHANGES)]
    results.write(HERE / "coarse_particles.csv", header, rows)


def quadrature() -> None:
    """coarse_particles_quadrature.csv"""
    rows = []
    x, w = np.polynomial.legendre.leggauss(2000)
    fine, fine_weight = 0.5 * (x + 1.0), 0.25 * w
    for name in TYPES:
        medium = climate_medium(load_climate(name), np.array(WAVELENGTHS_NM))
        for degree, polar in QUADRATURES:
            scaled = delta_scaled(medium, degree)
            share = species_share(scaled.medium, np.array([medium.bottom_km + ABOVE_GROUND_KM]))[1:, 0]
            aerosol = np.einsum("kw,klw->lw", share / share.sum(axis=0), scaled.moments[1:])
            # level with the ground, whose horizon is at 90 deg
            angles = make_angles(np.array([0.0]), polar, STANDARD.azimuth_directions, degree)
            cosine, weight = angles.cosine[0], angles.weight[0]
            same = angles.analysis[0][angles.order == 0].sum(axis=2)
            seen = even_harmonics(np.sin(np.radians(ELEVATIONS_DEG)), degree, 0)
            for light, sky in SKIES.items():
                truth = (fine_weight * sky(fine)) @ even_harmonics(fine, degree, 0)
                at_angles = np.where(cosine > 0.0, sky(cosine), 0.0)
                by_weights = (weight * at_angles) @ even_harmonics(cosine, degree, 0)
                found = [np.einsum("el,l,lw->ew", seen, m, aerosol) for m in (truth, by_weights, same @ at_angles)]
                errors = [100.0 * (part - found[0]) / found[0].mean() for part in found[1:]]
                for i, elevation in enumerate(ELEVATIONS_DEG):
                    numbers = [f"{round(v, 2) + 0.0:.2f}" for v in np.concatenate([part[i] for part in errors])]
                    rows.append([name, degree, polar, light, f"{elevation:g}", *numbers])
    header = ["climate", "degree", "polar_directions", "light", "elevation_deg"]
    header += [f"{how}_percent_{nm:g}nm" for how in ("weights", "analysis") for nm in WAVELENGTHS_NM]
    results.write(HERE / "coarse_particles_quadrature.csv", header, rows)


if __name__ == "__main__":
    quadrature()
    print("quadrature", flush=True)
    if sys.argv[1:] != ["quadrature"]:
        skies()
