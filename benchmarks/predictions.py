"""Predictions of skies whose measurements nobody here has seen: python benchmarks/predictions.py arm|desi

`arm`: zenith radiance of the dusk of 2024-02-08 at the ARM site in Oklahoma, with every solver that can, to
arm_prediction.csv, a row as it is made; resumes.  The air is published whole (36.6 N, 97.5 W, 0.32 km): 970.6 hPa,
water 8.43 mm, ozone 300 DU; aerosol of optical depth 0.0418 at 464 nm, single scattering albedo 0.904, asymmetry 0.347;
ground albedo 0.070.  Asked for is the radiance of the zenith at 464.02 nm, unpolarised, with the sun at -6, -7 and -8
deg (true elevation of the disc's centre).  What is not published is varied: the aerosol's height, the exponent of its
spectrum (which says nothing at 464 nm but through the optical depth at 550 nm that the program is told), stratosphere,
profile of the air, and a screen beyond the horizon.

`desi`: spectra of the moonless zenith in deep twilight at Kitt Peak (32.0 N, 2.1 km) in 2021 and 2022, for DESI's
public sky spectra (DR1), by `zones`, to desi_prediction.csv: what the sun adds, the night left out, means over 10 nm,
for every month with its zonal mean of ozone, between two columns.  The interval holds what is not known of such
evenings, each thing's effect on ln radiance added in quadrature: haze, stratosphere (Hunga Tonga), screen, NO2, ozone's
distance from the zonal mean, snow."""

from __future__ import annotations

import argparse
import time
from datetime import UTC, datetime
from typing import Any

import numpy as np
import results

import twilight
from twilight.atmosphere.measured import climatological_column_du
from twilight.config import load
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
CLEAN = {"horizon": "clean"}
CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "aerosol within 1 km": (climate(boundary_layer_top_km=1.0), CLEAN),
    "aerosol up to 12 km, scale height 4 km": (climate(boundary_layer_top_km=12.0, scale_height_km=4.0), CLEAN),
    "exponent 2": (climate(2.0), CLEAN),
    "stratosphere: low": (climate() | {"stratosphere": {"kind": "nh_midlat_low"}}, CLEAN),
    "stratosphere: elevated": (climate() | {"stratosphere": {"kind": "nh_midlat_elevated"}}, CLEAN),
    "profile: midlatitude_summer": (climate() | {"atmosphere": {"profile": "midlatitude_summer"}}, CLEAN),
    "ozone 291 DU": (climate() | {"gases": GASES | {"ozone": {"column_du": 291.0}}}, CLEAN),
    "ozone 309 DU": (climate() | {"gases": GASES | {"ozone": {"column_du": 309.0}}}, CLEAN),
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


def arm(only: str | None = None) -> None:
    """Compute what the table of the ARM site lacks; only: a solver, or a case."""
    every = [("as published", solver, climate(), CLEAN, chosen) for solver, chosen in SOLVERS.items()]
    every += [(case, "zones", *air, SOLVERS["zones"]) for case, air in CASES.items()]
    rows = results.kept(TABLE)
    for case, solver, air, beside, chosen in every:
        if any(row[:2] == [case, solver] for row in rows) or (only is not None and only not in (case, solver)):
            continue
        rows += [[case, solver, *row] for row in predict(air, beside, solver, chosen)]
        results.write(TABLE, COLUMNS, rows, notes=(f"zenith at {WAVELENGTH_NM} nm, scaled to {DISTANCE_AU} au",))
        for row in rows[-len(SUNS_DEG) :]:
            print(*row, flush=True)


DESI_TABLE = results.FOLDER / "desi_prediction.csv"
DESI_NM = (
    *(360.0, 380.0, 400.0, 430.0, 450.0, 500.0, 530.0, 560.0, 600.0),
    *(650.0, 700.0, 750.0, 800.0, 860.0, 980.0),
)
"""Between strong bands of water and oxygen, but for 700 and 980 nm at their feet."""
DESI_SUNS_DEG = (-12.0, -13.0, -14.0, -15.0, -16.0, -17.0, -18.0)
DESI_REFERENCE = (DESI_SUNS_DEG.index(-14.0), DESI_NM.index(500.0))
"""To which light is relative: the sun at -14 deg, and 500 nm."""
KITT_PEAK_KM = 2.1
KITT_PEAK_DEG = 32.0
HAZE = 0.015
"""Optical depth of aerosol above Kitt Peak at 550 nm: between `mountain` and OPAC's 0.021 above that altitude."""
MONTHS_DU = [
    round(float(np.mean([climatological_column_du(KITT_PEAK_DEG, day) for day in range(first, first + 30)])))
    for first in range(1, 361, 30)
]
"""Zonal means of ozone at Kitt Peak by month [DU]."""
MEAN_DU = 300.0
OZONE_SCATTER_DU = 15.0
"""By which an evening's ozone is taken to be away from the zonal mean of its month [DU]."""


def kitt_peak(**sections: Any) -> dict[str, Any]:
    """`mountain` at Kitt Peak's altitude with MEAN_DU of ozone; sections are merged into its own."""
    air = load("mountain").climate.model_dump(mode="json", exclude_unset=True)
    air["ground"]["altitude_km"], air["aerosol"]["optical_depth_550nm"] = KITT_PEAK_KM, HAZE
    air["gases"] = {"ozone": {"column_du": MEAN_DU}}
    for name, section in sections.items():
        air[name] = air.get(name, {}) | section
    return air | {"version": 1, "name": "kitt-peak"}


def cloudier(**other: Any) -> dict[str, Any]:
    """A screen beyond the horizon."""
    return {"screen": {"heights_km": [8.0, 9.5], "transmission": [0.15, 1.0], "from_km": 300.0} | other}


UNKNOWN: dict[str, tuple[tuple[dict[str, Any], Any], ...]] = {
    "haze 0.008 to 0.04": (
        (kitt_peak(aerosol={"optical_depth_550nm": 0.008}), "typical"),
        (kitt_peak(aerosol={"optical_depth_550nm": 0.04}), "typical"),
    ),
    "stratosphere": (
        (kitt_peak(stratosphere={"kind": "nh_midlat_low"}), "typical"),
        (kitt_peak(stratosphere={"kind": "nh_midlat_elevated"}), "typical"),
    ),
    "screen": ((kitt_peak(), "clean"), (kitt_peak(), cloudier(heights_km=[11.0, 12.5]))),
    "NO2": ((kitt_peak(gases={"ozone": {"column_du": MEAN_DU}, "no2": False}), "typical"),),
    "snow": ((kitt_peak(ground={"albedo": 0.5}), "typical"),),
}
"""What is not known of an evening, and its ends; the central case is `typical` in `kitt_peak()`."""


def desi_light(air: dict[str, Any], horizon: Any) -> np.ndarray:
    """ln of the sun-normalised radiance of the zenith, (S, W)."""
    document = {"version": 1, "climate": air, "horizon": horizon}
    field = twilight.solve(document, solver="zones", wavelength_nm=list(DESI_NM), settings={"solver.quality": "draft"})
    return np.log([field.radiance(sun, np.array([90.0]), np.array([0.0]))[0] for sun in DESI_SUNS_DEG])


def desi() -> None:
    """Compute the table for DESI."""
    begin = time.process_time()
    nm = np.array(DESI_NM)
    middle = desi_light(kitt_peak(), "typical")
    less, more = (
        desi_light(kitt_peak(gases={"ozone": {"column_du": column}}), "typical")
        for column in (min(MONTHS_DU), max(MONTHS_DU))
    )
    per_du = (more - less) / (max(MONTHS_DU) - min(MONTHS_DU))
    ends = {what: [desi_light(*end) - middle for end in cases] for what, cases in UNKNOWN.items()}
    ends["ozone"] = [OZONE_SCATTER_DU * per_du, -OZONE_SCATTER_DU * per_du]
    solar = np.log(np.mean([solar_irradiance(nm + offset) for offset in range(-5, 6)], axis=0))
    sun0, green = DESI_REFERENCE

    def relative(light: np.ndarray) -> dict[str, np.ndarray]:
        """ln of light over that of -14 deg and 500 nm, over -14 deg, and over 500 nm."""
        return {
            "over_both": light - light[sun0, green],
            "over_sun_14": light - light[sun0],
            "over_500nm": light - light[:, [green]],
        }

    spread: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    notes = []
    for kind in relative(middle):
        moves = {what: np.array([relative(one)[kind] for one in moved]) for what, moved in ends.items()}
        up = np.sqrt(sum(np.max(np.maximum(one, 0.0), axis=0) ** 2 for one in moves.values()))
        down = np.sqrt(sum(np.max(np.maximum(-one, 0.0), axis=0) ** 2 for one in moves.values()))
        spread[kind] = up, down
        largest = ", ".join(f"{what} {100 * np.median(np.abs(one).max(axis=0)):.1f}" for what, one in moves.items())
        notes.append(f"{kind}: median of what each moves [%]: {largest}")
    rows = []
    for month, column in enumerate(MONTHS_DU, 1):
        made = relative(middle + (column - MEAN_DU) * per_du + solar)
        for s, sun in enumerate(DESI_SUNS_DEG):
            for w, wavelength in enumerate(DESI_NM):
                row = [month, column, f"{sun:g}", f"{wavelength:g}"]
                for kind, value in made.items():
                    up, down = spread[kind]
                    ln = value[s, w]
                    row += [f"{np.exp(x):.4g}" for x in (ln, ln - down[s, w], ln + up[s, w])]
                rows.append(row)
    named = [f"{kind}{end}" for kind in spread for end in ("", "_least", "_most")]
    notes = [
        f"made on {datetime.now(UTC):%Y-%m-%d} in {time.process_time() - begin:.0f} s of processor time",
        "what the sun adds to the zenith of Kitt Peak; least and most: each unknown by one standard deviation or so",
        *notes,
    ]
    results.write(DESI_TABLE, ("month", "ozone_du", "sun_elevation_deg", "wavelength_nm", *named), rows, notes=notes)
    for note in notes:
        print(note)


def main() -> None:
    """Compute one of the predictions."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("which", choices=("arm", "desi"))
    arguments.add_argument("--only", help="arm: a solver, or a case")
    given = arguments.parse_args()
    arm(given.only) if given.which == "arm" else desi()


if __name__ == "__main__":
    main()
