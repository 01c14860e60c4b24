"""Whether `--target-error` is right in air that its errors were not taken from: each climate in turn left out.

    python benchmarks/target_error.py     from benchmarks/zones_error.csv, in a second

Writes benchmarks/target_error.csv: for every climate, quality and range of suns the error [%] that
`twilight.solvers.zones.target` would promise, were it to know the other climates of its kind alone (the largest of
theirs, of this range or a higher sun, times UNSEEN), and the one that the climate has beside Monte-Carlo.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import results
from zones_error import CLIMATES

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers.zones.target import LAST_DAY_DEG, LAST_TWILIGHT_DEG, MEASURED, UNSEEN, kind_of

HERE = Path(__file__).parent
RANGES = ("day", "twilight", "deep")
COLUMNS = "climate,kind,quality,suns,promised_percent,got_percent"


def main() -> None:
    found: dict[tuple[str, str], list[float]] = {}
    for row in results.read_rows(HERE / "zones_error.csv"):
        errors = found.setdefault((row["quality"], row["climate"]), [0.0, 0.0, 0.0])
        sun = float(row["sun_elevation_deg"])
        place = 0 if sun >= LAST_DAY_DEG else 1 if sun >= LAST_TWILIGHT_DEG else 2
        errors[place] = max(errors[place], float(row["excess_percent"]))
    nm = np.array([450.0, 550.0, 680.0])
    kinds = {name: kind_of(climate_medium(load_climate(name), nm)) for name in CLIMATES}
    rows = []
    for quality in MEASURED:
        for name in CLIMATES:
            others = [e for (q, c), e in found.items() if q == quality and c != name and kinds[c] == kinds[name]]
            if not others or (quality, name) not in found:
                continue
            for k, suns in enumerate(RANGES):
                promised = UNSEEN[kinds[name]] * max(max(e[: k + 1]) for e in others)
                got = found[quality, name][k]
                rows.append([name, kinds[name], quality, suns, f"{promised:.2f}", f"{got:.2f}"])
                print(*rows[-1], f"{got / promised:.2f}", sep="\t")
    results.write(HERE / "target_error.csv", COLUMNS.split(","), rows)


if __name__ == "__main__":
    main()
