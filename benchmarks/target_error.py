"""Whether `--target-error` is right in air that its errors were not taken from.

    python benchmarks/target_error.py           each climate left out in turn, from results/zones_error.csv
    python benchmarks/target_error.py unseen    airs drawn at random, too: AIRS of them, about a processor minute each

Writes results/target_error.csv: for every climate, quality and range of suns the error [%] that
`twilight.solvers.zones.solver` would promise, were it to know the other climates of its kind alone (the largest of
theirs, of this range or a higher sun, times SAFETY_FACTORS), and the one that the climate has beside Monte-Carlo.

Rows of the drawn airs hold what it does promise, and the error beside quality `reference` of the same air, whose own
error is not in it (`MEASURED_ERRORS`: 0.2 to 0.8 % in continental air).  What was drawn stands in the table's notes.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import results
from montecarlo_reference import CLIMATE_DIRECTIONS_DEG, CLIMATE_SUNS_DEG, WAVELENGTHS_NM
from zones_error import CLIMATES

from twilight.atmosphere.medium import Medium
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.zones.solver import (
    LAST_DAY_DEG,
    LAST_TWILIGHT_DEG,
    MEASURED_ERRORS,
    SAFETY_FACTORS,
    expected_error,
    kind_of,
)

TABLE = results.FOLDER / "target_error.csv"
RANGES = ("day", "twilight", "deep")
COLUMNS = "climate,kind,quality,suns,beside,promised_percent,got_percent"
AIRS = 4
"""Airs that are drawn."""
SEED = 11
"""Of what is drawn."""
BASE = "continental-average"
"""Climate whose other settings a drawn air keeps."""
JUDGED = ("draft", "standard")
PARTICLES = {
    "waso": (300.0, 3e4, 1.0),
    "inso": (0.05, 1.0, 0.5),
    "soot": (100.0, 3e4, 0.5),
    "ssam": (1.0, 30.0, 0.4),
    "miam": (1.0, 60.0, 0.4),
}
"""OPAC's components in a drawn air: least and largest number [cm^-3], and how often it is there."""
PROFILES = ("tropical", "midlatitude_summer", "midlatitude_winter", "subarctic_summer", "subarctic_winter")


def place(sun_elevation_deg: float) -> int:
    """Which of RANGES a sun belongs to."""
    return 0 if sun_elevation_deg >= LAST_DAY_DEG else 1 if sun_elevation_deg >= LAST_TWILIGHT_DEG else 2


def left_out() -> list[list[str]]:
    """Rows of the thirteen climates, each beside what the others promise."""
    found: dict[tuple[str, str], list[float]] = {}
    for row in results.read_rows(results.FOLDER / "zones_error.csv"):
        errors = found.setdefault((row["quality"], row["climate"]), [0.0, 0.0, 0.0])
        k = place(float(row["sun_elevation_deg"]))
        errors[k] = max(errors[k], float(row["excess_percent"]))
    nm = np.array([450.0, 550.0, 680.0])
    kinds = {name: kind_of(climate_medium(load_climate(name), nm)) for name in CLIMATES}
    rows = []
    for quality in MEASURED_ERRORS:
        for name in CLIMATES:
            others = [e for (q, c), e in found.items() if q == quality and c != name and kinds[c] == kinds[name]]
            if not others or (quality, name) not in found:
                continue
            for k, suns in enumerate(RANGES):
                promised = SAFETY_FACTORS[kinds[name]] * max(max(e[: k + 1]) for e in others)
                got = found[quality, name][k]
                rows.append([name, kinds[name], quality, suns, "montecarlo", f"{promised:.2f}", f"{got:.2f}"])
    return rows


def drawn(rng: np.random.Generator) -> dict[str, Any]:
    """Settings of an air: its particles, their amount, heights and humidity, its profile, ozone and ground."""

    def between(low: float, high: float) -> float:
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.3g}")

    parts = {name: between(low, high) for name, (low, high, often) in PARTICLES.items() if rng.random() < often}
    return {
        "atmosphere.profile": str(rng.choice(PROFILES)),
        "aerosol.type": None,
        "aerosol.components": parts,
        "aerosol.optical_depth_550nm": between(0.05, 0.6),
        "aerosol.relative_humidity_percent": round(rng.uniform(0.0, 95.0)),
        "aerosol.boundary_layer_top_km": between(1.0, 5.0),
        "aerosol.scale_height_km": between(1.0, 8.0),
        "gases.ozone.column_du": round(rng.uniform(220.0, 480.0)),
        "ground.albedo": round(rng.uniform(0.0, 0.8), 2),
    }


def skies(medium: Medium, quality: str) -> dict[float, np.ndarray]:
    """Radiance (D, W) of every sun in the directions of the references."""
    field = zones.prepare(medium, zones.QUALITIES[quality], sun_elevations_deg=list(CLIMATE_SUNS_DEG))
    elevation, azimuth = np.array(CLIMATE_DIRECTIONS_DEG).T
    return {sun: field.radiance(sun, elevation, azimuth) for sun in CLIMATE_SUNS_DEG}


def beside_reference(name: str, medium: Medium) -> list[list[str]]:
    """Rows of an air: what is promised of it, and its errors beside quality `reference`."""
    right = skies(medium, "reference")
    rows = []
    for quality in JUDGED:
        got = [0.0, 0.0, 0.0]
        for sun, radiance in skies(medium, quality).items():
            error = results.excess(100.0 * (radiance / right[sun] - 1.0), np.zeros(1))
            got[place(sun)] = max(got[place(sun)], error)
        for k, (suns, lowest) in enumerate(zip(RANGES, (LAST_DAY_DEG, LAST_TWILIGHT_DEG, -18.0), strict=True)):
            promised = 100.0 * expected_error(quality, medium, [lowest])
            rows.append([name, kind_of(medium), quality, suns, "reference", f"{promised:.2f}", f"{got[k]:.2f}"])
    return rows


def main(arguments: list[str]) -> None:
    rows, notes = left_out(), []
    if arguments == ["unseen"]:
        rng = np.random.default_rng(SEED)
        airs = {f"drawn {k + 1}": drawn(rng) for k in range(AIRS)}
        nm = np.array(WAVELENGTHS_NM)
        for name, settings in airs.items():
            more = beside_reference(name, climate_medium(load_climate(BASE, settings), nm))
            notes.append(f"{name}: {settings}")
            rows += more
            _say(more)
            results.write(TABLE, COLUMNS.split(","), rows, notes=notes)
    else:
        _say(rows)
        lines = TABLE.read_text(encoding="utf-8").splitlines()
        notes = [line[2:] for line in lines if line.startswith("# drawn")]
        rows += [list(row.values()) for row in results.read_rows(TABLE) if row["beside"] == "reference"]
        results.write(TABLE, COLUMNS.split(","), rows, notes=notes)


def _say(rows: list[list[str]]) -> None:
    for row in rows:
        print(*row, f"{float(row[-1]) / float(row[-2]):.2f}", sep="\t", flush=True)


if __name__ == "__main__":
    results.say_help(__doc__)
    main(sys.argv[1:])
