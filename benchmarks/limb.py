"""The limb beside another program: I, Q and U of light scattered once, by `zones` and by sasktran2.

    python benchmarks/limb.py      writes limb.csv

The same coefficients and phase matrices; straight light in both, because sasktran2 is used without refraction.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.atmosphere.medium import Medium
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import sasktran2, zones
from twilight.studies.limb.sight import Sights, limb_elevation_deg, sights

WAVELENGTHS_NM = np.array([350.0, 470.0, 675.0])
CLIMATES = ("pure-air", "continental-average")
SUNS = ((60.0, 90.0), (30.0, 30.0), (10.0, 150.0), (2.0, 60.0))
"""Elevation of the sun at the middle tangent point and azimuth of the line from it [deg]."""
TANGENT_KM = np.arange(10.0, 81.0, 10.0)
"""Tangent altitudes of the lines of sight."""
MIDDLE_KM = 40.0
"""Tangent altitude at which the sun has the elevation of SUNS."""
OBSERVER_KM = 200.0
"""Altitude of the observer: above the air."""
OURS = replace(zones.QUALITIES["draft"], refraction=False, bent_lines_of_sight=False, bent_paths=False, max_orders=1)
THEIRS = sasktran2.Sasktran2Settings(single_step_km=0.05, single_growth=0.01, polarisation=True)


def scan(medium: Medium, sun_deg: float, azimuth_deg: float) -> Sights:
    """One observer's lines of sight at one moment: sasktran2 refers Q and U to the vertical of the mean of its suns."""
    middle = sights(medium, np.array([MIDDLE_KM]), OBSERVER_KM, sun_deg, azimuth_deg)
    elevation = limb_elevation_deg(medium, TANGENT_KM, OBSERVER_KM)
    return Sights(elevation, *(np.full(TANGENT_KM.size, float(v[0])) for v in middle[1:]))


def by_zones(medium: Medium, lines: list[Sights]) -> np.ndarray:
    """I, Q and U (suns, lines, 3, W) of light scattered once."""
    suns = [float(x.sun_elevation_deg[0]) for x in lines]
    field = zones.prepare(medium, OURS, observer_altitude_km=OBSERVER_KM, sun_elevations_deg=suns)
    return np.array(
        [field.stokes(sun, x.elevation_deg, float(x.azimuth_deg[0])) for sun, x in zip(suns, lines, strict=True)]
    )


def by_sasktran2(medium: Medium, lines: list[Sights]) -> np.ndarray:
    """The same by sasktran2."""
    return np.array(
        [
            sasktran2._engine(
                medium, THEIRS, [x.sun_elevation_deg, x.elevation_deg, x.azimuth_deg], OBSERVER_KM, single=1
            )
            for x in lines
        ]
    )


def main() -> None:
    rows = []
    for climate in CLIMATES:
        air = climate_medium(load_climate(climate), WAVELENGTHS_NM)
        medium = replace(air, refractivity=0.0 * air.refractivity, grid_medium=None)
        lines = [scan(medium, *sun) for sun in SUNS]
        ours, theirs = by_zones(medium, lines), by_sasktran2(medium, lines)
        off = 100.0 * (ours - theirs) / theirs[:, :, :1]
        for n, (sun, azimuth) in enumerate(SUNS):
            for k, tangent in enumerate(TANGENT_KM):
                for w, nm in enumerate(WAVELENGTHS_NM):
                    numbers = [f"{theirs[n, k, 0, w]:.5g}", *(f"{v:.3f}" for v in off[n, k, :, w])]
                    rows.append([climate, f"{sun:g}", f"{azimuth:g}", f"{tangent:g}", f"{nm:g}", *numbers])
        size = np.abs(off).transpose(2, 0, 1, 3).reshape(3, -1)
        print(f"{climate}: I, Q, U [% of I], median {np.median(size, axis=1)}, largest {size.max(axis=1)}")
    columns = ["climate", "sun_elevation_deg", "azimuth_deg", "tangent_km", "wavelength_nm", "sasktran2_per_sr",
               "difference_i_percent", "difference_q_percent_of_i", "difference_u_percent_of_i"]  # fmt: skip
    results.write(Path(__file__).with_name("limb.csv"), columns, rows, notes=["differences: zones less sasktran2"])


if __name__ == "__main__":
    main()
