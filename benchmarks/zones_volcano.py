"""What limits the zones solver below a thick stratospheric layer.

    python benchmarks/zones_volcano.py        zones_volcano.csv
    python benchmarks/zones_volcano.py red    zones_volcano_red.csv

The first: by how much the radiance moves when one setting of `draft` (scalar light, 550 nm, volcanic-extreme air) is
made finer and all others stay, in per cent, in seven directions.  The second: errors of `standard` at one wavelength in
volcanic-stratosphere air beside the referee's 26 directions, and with some of its settings finer.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import results

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones

SUNS_DEG = (0.0, -12.0, -18.0)
ELEVATION_DEG = np.array([1.0, 6.0, 27.0, 90.0, 1.5, 45.0, 10.0])
AZIMUTH_DEG = np.array([0.0, 0.0, 0.0, 0.0, 90.0, 90.0, 180.0])
BASE = replace(zones.QUALITIES["draft"], polarisation=False)
FINER = (
    ("altitude_density", 1.0),
    ("altitude_density", 2.0),
    ("zenith_density", 1.2),
    ("polar_directions", 16),
    ("degree", 20),
    ("step_density", 0.8),
)


RED_SUNS_DEG = (-12.0, -18.0)
RED: tuple[tuple[float, dict[str, float]], ...] = (
    *((nm, {}) for nm in (450.0, 550.0, 680.0)),
    *((680.0, {"polar_directions": n}) for n in (12, 16, 20, 32, 40)),
    *(
        (680.0, {"polar_directions": 32, name: n})
        for name, n in (("altitude_density", 2.0), ("azimuth_directions", 20))
    ),
    *((680.0, {"polar_directions": 32, name: n}) for name, n in (("step_density", 2.0), ("early_events", 8))),
)
"""Wavelength [nm] and what is changed of `standard`."""


def sky(settings: zones.ZonesSettings) -> np.ndarray:
    """Radiance (suns, directions)."""
    medium = climate_medium(load_climate("volcanic-extreme"), np.array([550.0]))
    field = zones.prepare(medium, settings, sun_elevations_deg=SUNS_DEG)
    return np.stack([field.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG)[:, 0] for sun in SUNS_DEG])


def main() -> None:
    base = sky(BASE)
    rows = []
    for setting, value in FINER:
        for sun, moved in zip(SUNS_DEG, 100.0 * (sky(replace(BASE, **{setting: value})) / base - 1.0), strict=True):
            rows.append([setting, f"{value:g}", f"{sun:g}", f"{moved.mean():.2f}", *(f"{x:.2f}" for x in moved)])
            print(*rows[-1], sep="\t", flush=True)
    where = [f"at_{e:g}_{a:g}" for e, a in zip(ELEVATION_DEG, AZIMUTH_DEG, strict=True)]
    head = ["setting", "value", "sun_elevation_deg", "mean_percent", *where]
    results.write(Path(__file__).parent / "zones_volcano.csv", head, rows)


def red() -> None:
    here = Path(__file__).parent
    table = results.read_numbers(here / "reference" / "volcanic-stratosphere.csv")
    rows = []
    for nm, changes in RED:
        medium = climate_medium(load_climate("volcanic-stratosphere"), np.array([nm]))
        settings = replace(zones.QUALITIES["standard"], **changes)  # type: ignore[arg-type]
        field = zones.prepare(medium, settings, sun_elevations_deg=RED_SUNS_DEG)
        for sun in RED_SUNS_DEG:
            some = table[(table["sun_elevation_deg"] == sun) & (table["wavelength_nm"] == nm)]
            error = (
                field.radiance(sun, some["elevation_deg"], some["azimuth_deg"])[:, 0] / some["radiance_per_sr"] - 1.0
            )
            own = some["standard_error_per_sr"] / some["radiance_per_sr"]
            excess = results.excess(error, own)
            what = " ".join(f"{name} {value:g}" for name, value in changes.items())
            worst = error[np.argmax(np.abs(error))]
            numbers = (f"{100.0 * x:.2f}" for x in (error.mean(), excess, worst, np.median(own)))
            rows.append([f"{nm:g}", what or "standard", f"{sun:g}", *numbers])
            print(*rows[-1], sep="\t", flush=True)
    head = "wavelength_nm,settings,sun_elevation_deg,mean_percent,excess_percent,worst_percent,referee_percent"
    results.write(here / "zones_volcano_red.csv", head.split(","), rows)


if __name__ == "__main__":
    red() if sys.argv[1:] == ["red"] else main()
