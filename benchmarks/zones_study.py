"""What polar angles lose of smooth light in `zones`: python benchmarks/zones_study.py

For all types of aerosol half a kilometre above the ground: what is missing (negative) or too much after one scattering
into an elevation, over the mean of all elevations, of light from above the horizon that is uniform or falls by e within
a cosine of 0.3 from it: by the weights of the polar angles alone, and by the analysis of `zones`, which takes smooth
light out first.  Writes benchmarks/zones_study_quadrature.csv.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import results

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.zones.grid import even_harmonics, make_angles
from twilight.transport.ray_bundle import species_fraction
from twilight.transport.scaling import delta_scaled

HERE = Path(__file__).parent
STANDARD = zones.QUALITIES["standard"]
COLOURS_NM = (450.0, 550.0, 680.0)
TYPES = (
    *("antarctic", "arctic", "continental-average", "continental-clean", "continental-polluted"),
    *("desert", "maritime-clean", "maritime-polluted", "maritime-tropical", "urban"),
)
"""Of aerosol (OPAC), by the climates of these names."""
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


if __name__ == "__main__":
    quadrature()
