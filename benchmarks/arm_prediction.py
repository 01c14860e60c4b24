"""A prediction: zenith radiance of the dusk of 2024-02-08 at the ARM site in Oklahoma, with every solver that can.

    python benchmarks/arm_prediction.py [--only NAME]      # writes arm_prediction.csv, a row as it is made; resumes

The air is published whole (36.6 N, 97.5 W, 0.32 km): 970.6 hPa, water 8.43 mm, ozone 300 DU; aerosol of optical depth
0.0418 at 464 nm, single scattering albedo 0.904, asymmetry 0.347; ground albedo 0.070.  Asked for is the radiance of
the zenith at 464.02 nm, unpolarised, with the sun at -6, -7 and -8 deg (true elevation of the disc's centre).  What is
not published is varied: the aerosol's height, the exponent of its spectrum (which says nothing at 464 nm but through
the optical depth at 550 nm that the program is told), stratosphere, profile of the air, and a screen beyond the
horizon."""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
import results

import twilight
from twilight.numerics.spectrum import solar_irradiance

TABLE = results.FOLDER / "arm_prediction.csv"
WAVELENGTH_NM = 464.02
SUNS_DEG = (-6.0, -7.0, -8.0)
DISTANCE_AU = 0.98645
"""From the Earth to the sun on 2024-02-09 0 h UTC."""
EXPONENT = 1.0
DEPTH_464 = 0.0418
GROUND_KM = 0.378
"""Where the AFGL winter has the published pressure, 58 m above the site; at 0.32 km it has 0.7 % more air [km]."""
COLUMNS = ("case", "solver", "sun_elevation_deg", "radiance_mw_per_m2_nm_sr", "standard_error", "processor_time_s")


def climate(exponent: float = EXPONENT, **aerosol: Any) -> dict[str, Any]:
    """The published air; the optical depth is of everything, so that the free troposphere's background is left out."""
    depth = DEPTH_464 * (550.0 / 464.0) ** -exponent
    own = {"exponent": exponent, "single_scattering_albedo": 0.904, "asymmetry": 0.347}
    return {
        "version": 1,
        "name": "arm-2024-02-08",
        "atmosphere": {"profile": "midlatitude_winter"},
        "gases": {"ozone": {"column_du": 300.0}, "water_vapour": {"column_mm": 8.43}},
        "aerosol": {"angstrom": own, "optical_depth_550nm": depth, "free_troposphere": False, **aerosol},
        "ground": {"albedo": 0.07, "altitude_km": GROUND_KM},
    }


SOLVERS: dict[str, dict[str, Any]] = {
    "zones": {"solver.quality": "standard"},
    "tables": {"solver.quality": "standard"},
    "montecarlo": {"solver.quality": "standard"},
}
"""Settings of every solver that can; compact has no aerosol of so small an asymmetry."""
GASES = {"water_vapour": {"column_mm": 8.43}}
CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "aerosol within 1 km": (climate(boundary_layer_top_km=1.0), {}),
    "aerosol up to 12 km, scale height 4 km": (climate(boundary_layer_top_km=12.0, scale_height_km=4.0), {}),
    "exponent 2": (climate(2.0), {}),
    "stratosphere: low": (climate() | {"stratosphere": {"kind": "nh_midlat_low"}}, {}),
    "stratosphere: elevated": (climate() | {"stratosphere": {"kind": "nh_midlat_elevated"}}, {}),
    "profile: midlatitude_summer": (climate() | {"atmosphere": {"profile": "midlatitude_summer"}}, {}),
    "ozone 291 DU": (climate() | {"gases": GASES | {"ozone": {"column_du": 291.0}}}, {}),
    "ozone 309 DU": (climate() | {"gases": GASES | {"ozone": {"column_du": 309.0}}}, {}),
    "horizon: typical": (climate(), {"horizon": "typical"}),
}
"""What is not published, by zones: a climate, and what lies beyond it."""


def predict(air: dict[str, Any], beside: dict[str, Any], solver: str, chosen: dict[str, Any]) -> list[list[str]]:
    """Sun, radiance [mW m^-2 nm^-1 sr^-1] and its standard error where the solver is random, and processor time."""
    begin = time.process_time()
    field = twilight.solve(
        {"version": 1, "climate": air, **beside}, solver=solver, wavelength_nm=[WAVELENGTH_NM], settings=chosen
    )
    light = 1e3 * float(solar_irradiance(np.array([WAVELENGTH_NM]))[0]) / DISTANCE_AU**2
    made = []
    for sun in SUNS_DEG:
        factor = float(np.squeeze(field.radiance(sun, np.array([90.0]), np.array([0.0]))))
        said = f"{0.01 * light * factor:.2g}" if solver == "montecarlo" else ""  # `standard` asks for 1 %
        made.append([f"{sun:g}", f"{light * factor:.5g}", said])
    return [[*row, f"{time.process_time() - begin:.1f}"] for row in made]


def main() -> None:
    """Compute what the table lacks."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--only", help="a solver, or a case")
    only = arguments.parse_args().only
    every = [("as published", solver, climate(), {}, chosen) for solver, chosen in SOLVERS.items()]
    every += [(case, "zones", *air, SOLVERS["zones"]) for case, air in CASES.items()]
    rows = results.kept(TABLE)
    for case, solver, air, beside, chosen in every:
        if any(row[:2] == [case, solver] for row in rows) or (only is not None and only not in (case, solver)):
            continue
        rows += [[case, solver, *row] for row in predict(air, beside, solver, chosen)]
        results.write(TABLE, COLUMNS, rows, notes=(f"zenith at {WAVELENGTH_NM} nm, scaled to {DISTANCE_AU} au",))
        for row in rows[-len(SUNS_DEG) :]:
            print(*row, flush=True)


if __name__ == "__main__":
    main()
