"""What limits the zones solver below a thick stratospheric layer: python benchmarks/zones_volcano.py

Writes benchmarks/zones_volcano.csv: by how much the radiance moves when one setting of `draft` (scalar light, 550 nm,
volcanic-extreme air) is made finer and all others stay, in per cent, in seven directions.
"""

from __future__ import annotations

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


if __name__ == "__main__":
    main()
