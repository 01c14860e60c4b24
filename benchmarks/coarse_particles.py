"""What the errors of zones beside coarse particles consist of: python benchmarks/coarse_particles.py

Writes benchmarks/coarse_particles.csv, of `desert` with the sun at 5 and -6 deg, per direction and wavelength: the
error of `standard` against benchmarks/reference/desert.csv with the referee's own, and by how much settings change the
radiance, one at a time.  Changes are taken on fewer altitudes and solar zenith angles than `standard` has (`NODES`).

Writes benchmarks/coarse_particles_quadrature.csv, of all types of aerosol half a kilometre above the ground: what
share of light that is the same all around is missing (negative) or too much after one scattering into an elevation,
because the sum over the polar angles is not the integral of a phase function cut at `degree`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.zones.grid import make_angles
from twilight.transport.bundle import species_share
from twilight.transport.scaling import delta_scaled

HERE = Path(__file__).parent
SUNS_DEG = (5.0, -6.0)
STANDARD = zones.QUALITIES["standard"]
NODES = {"altitude_density": 0.5, "zenith_density": 0.6, "tolerance": 1e-2}
CHANGES: dict[str, dict[str, int]] = {
    "azimuth_directions_21": {"azimuth_directions": 21},
    "polar_directions_24": {"polar_directions": 24},
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
QUADRATURES = ((20, 14), (20, 24), (32, 18), (32, 32))
"""degree and polar_directions; the first are those of `standard`, the third of `reference`."""
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
    for name in TYPES:
        medium = climate_medium(load_climate(name), np.array(WAVELENGTHS_NM))
        for degree, polar in QUADRATURES:
            scaled = delta_scaled(medium, degree)
            share = species_share(scaled.medium, np.array([medium.bottom_km + ABOVE_GROUND_KM]))[1:, 0]
            aerosol = np.einsum("kw,klw->lw", share / share.sum(axis=0), scaled.moments[1:])
            # level with the ground, whose horizon is at 90 deg
            angles = make_angles(np.array([0.0]), polar, STANDARD.azimuth_directions, degree)
            cosine, weight = angles.cosine[0], angles.weight[0]
            of_light = weight @ np.polynomial.legendre.legvander(cosine, degree)
            seen = np.polynomial.legendre.legvander(np.sin(np.radians(ELEVATIONS_DEG)), degree)
            total = np.einsum("el,l,lw->ew", seen * (2 * np.arange(degree + 1) + 1), of_light, aerosol)
            for elevation, of_wavelength in zip(ELEVATIONS_DEG, 100.0 * (total - 1.0), strict=True):
                rows.append(
                    [name, degree, polar, f"{elevation:g}", *(f"{round(x, 2) + 0.0:.2f}" for x in of_wavelength)]
                )
    header = ["climate", "degree", "polar_directions", "elevation_deg"]
    header += [f"percent_{nm:g}nm" for nm in WAVELENGTHS_NM]
    results.write(HERE / "coarse_particles_quadrature.csv", header, rows)


if __name__ == "__main__":
    quadrature()
    print("quadrature", flush=True)
    skies()
