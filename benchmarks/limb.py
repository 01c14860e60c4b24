"""The limb beside another program: I, Q and U of light scattered once, and I of all light, by `zones` and by sasktran2.

    python benchmarks/limb.py      writes limb.csv

The same coefficients and phase matrices; straight light in both, because sasktran2 is used without refraction.  Light
scattered more than once is compared without polarisation, by successive orders in sasktran2.
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
from twilight.studies.limb.geometry import LimbGeometry, limb_elevation_deg, limb_geometry

WAVELENGTHS_NM = np.array([350.0, 470.0, 675.0])
CLIMATES = ("pure-air", "continental-average")
SUNS = ((60.0, 90.0), (30.0, 30.0), (10.0, 150.0), (2.0, 60.0))
"""Elevation of the sun at the middle tangent point and azimuth of the line from it [deg]."""
SUNS_OF_ALL_LIGHT = ((50.0, 90.0), (20.0, 60.0))
"""The same, by day, where all light is compared."""
HIGHEST_OF_ALL_LIGHT_KM = 60.0
"""Highest tangent altitude where all light is compared."""
TANGENT_KM = np.arange(10.0, 81.0, 10.0)
"""Tangent altitudes of the lines of sight."""
MIDDLE_KM = 40.0
"""Tangent altitude at which the sun has the elevation of SUNS."""
OBSERVER_KM = 200.0
"""Altitude of the observer: above the air."""
OURS = replace(zones.QUALITIES["draft"], refraction=False, bent_lines_of_sight=False, bent_paths=False, max_orders=1)
THEIRS = sasktran2.Sasktran2Settings(single_step_km=0.05, single_growth=0.01, polarisation=True)
ALL_OF_OURS = replace(
    zones.QUALITIES["draft"], refraction=False, bent_lines_of_sight=False, bent_paths=False, polarisation=False
)
ALL_OF_THEIRS = replace(
    THEIRS, threads=1, polarisation=False, multiple_step_km=0.5, zenith_step_deg=2.0, source_growth=0.1, incoming=302,
    outgoing=302, streams=32,
)  # fmt: skip
"""Successive orders with 25 altitudes of the source and solar zenith angles 2 deg apart.  Layers of 1 km in place of
0.5 km move the light of 675 nm at 20 km, in the stratosphere's aerosol, by 0.6 %."""


def scan(medium: Medium, sun_deg: float, azimuth_deg: float) -> LimbGeometry:
    """One observer's lines of sight at one moment: sasktran2 refers Q and U to the vertical of the mean of its suns."""
    middle = limb_geometry(medium, np.array([MIDDLE_KM]), OBSERVER_KM, sun_deg, azimuth_deg)
    elevation = limb_elevation_deg(medium, TANGENT_KM, OBSERVER_KM)
    return LimbGeometry(elevation, *(np.full(TANGENT_KM.size, float(v[0])) for v in middle[1:]))


def by_zones(medium: Medium, lines: list[LimbGeometry]) -> np.ndarray:
    """I, Q and U (suns, lines, 3, W) of light scattered once."""
    suns = [float(x.sun_elevation_deg[0]) for x in lines]
    field = zones.prepare(medium, OURS, observer_altitude_km=OBSERVER_KM, sun_elevations_deg=suns)
    return np.array(
        [field.stokes(sun, x.elevation_deg, float(x.azimuth_deg[0])) for sun, x in zip(suns, lines, strict=True)]
    )


def by_sasktran2(
    medium: Medium, lines: list[LimbGeometry], settings: sasktran2.Sasktran2Settings = THEIRS, single: int = 1
) -> np.ndarray:
    """Stokes parameters (suns, lines, 1 or 3, W) by sasktran2: of light scattered once, or of all other light."""
    angles = [[x.sun_elevation_deg, x.elevation_deg, x.azimuth_deg] for x in lines]
    return np.array([sasktran2._engine(medium, settings, a, OBSERVER_KM, single=single) for a in angles])


def all_by_zones(medium: Medium, lines: list[LimbGeometry]) -> np.ndarray:
    """I (suns, lines, 1, W) of all light."""
    suns = [float(x.sun_elevation_deg[0]) for x in lines]
    field = zones.prepare(medium, ALL_OF_OURS, observer_altitude_km=OBSERVER_KM, sun_elevations_deg=suns)
    asked = zip(suns, lines, strict=True)
    return np.array([field.radiance(sun, x.elevation_deg, float(x.azimuth_deg[0])) for sun, x in asked])[:, :, None]


def all_by_sasktran2(medium: Medium, lines: list[LimbGeometry]) -> tuple[np.ndarray, np.ndarray]:
    """I (suns, lines, 1, W) of all light by sasktran2, and the part of it that is scattered once."""
    once, more = (by_sasktran2(medium, lines, ALL_OF_THEIRS, single) for single in (1, 0))
    return once + more, once


def rows_of(
    climate: str, which: str, suns: tuple[tuple[float, float], ...], ours: np.ndarray, theirs: np.ndarray,
    once: np.ndarray,
) -> list[list[str]]:  # fmt: skip
    """Rows of the table, of Stokes parameters (suns, lines, 1 or 3, W), whose differences are summed up on the way."""
    off = 100.0 * (ours - theirs) / theirs[:, :, :1]
    rows = []
    for n, (sun, azimuth) in enumerate(suns):
        for k, tangent in enumerate(TANGENT_KM[: theirs.shape[1]]):
            for w, nm in enumerate(WAVELENGTHS_NM):
                more = f"{100.0 * (1.0 - once[n, k, 0, w] / theirs[n, k, 0, w]):.1f}" if which == "all" else "0"
                numbers = [f"{theirs[n, k, 0, w]:.5g}", more, *(f"{v:.3f}" for v in off[n, k, :, w])]
                place = [climate, which, f"{sun:g}", f"{azimuth:g}", f"{tangent:g}", f"{nm:g}"]
                rows.append([*place, *numbers, *[""] * (3 - theirs.shape[2])])
    size = np.abs(off).transpose(2, 0, 1, 3).reshape(theirs.shape[2], -1)
    print(f"{climate}, {which}: I, Q, U [% of I], median {np.median(size, axis=1)}, largest {size.max(axis=1)}")
    return rows


def main() -> None:
    rows = []
    for climate in CLIMATES:
        air = climate_medium(load_climate(climate), WAVELENGTHS_NM)
        medium = replace(air, refractivity=0.0 * air.refractivity, grid_medium=None)
        lines = [scan(medium, *sun) for sun in SUNS]
        theirs = by_sasktran2(medium, lines)
        rows += rows_of(climate, "once", SUNS, by_zones(medium, lines), theirs, theirs)
        n = np.count_nonzero(TANGENT_KM <= HIGHEST_OF_ALL_LIGHT_KM)
        lines = [LimbGeometry(*(v[:n] for v in scan(medium, *sun))) for sun in SUNS_OF_ALL_LIGHT]
        theirs, once = all_by_sasktran2(medium, lines)
        rows += rows_of(climate, "all", SUNS_OF_ALL_LIGHT, all_by_zones(medium, lines), theirs, once)
    columns = ["climate", "scattered", "sun_elevation_deg", "azimuth_deg", "tangent_km", "wavelength_nm",
               "sasktran2_per_sr", "scattered_more_than_once_percent", "difference_i_percent",
               "difference_q_percent_of_i", "difference_u_percent_of_i"]  # fmt: skip
    notes = ["scattered: light scattered once, or all of it; differences: zones less sasktran2"]
    results.write(Path(__file__).with_name("limb.csv"), columns, rows, notes=notes)


if __name__ == "__main__":
    main()
