"""The models of the previews, twilight/data/preview: one for each shipped climate, fitted to `zones`.

    python benchmarks/ship_previews.py [CLIMATE ...]

Some 30 processor seconds for each climate, a third of them for the sky at the usual quality that its errors are
measured against.  Writes the models, and prints sizes and errors (95 % of directions, by the sun's elevation).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from twilight.config.library import shipped
from twilight.studies.fit.compact.build import write_model
from twilight.studies.fit.compact.preview import fit_preview

FOLDER = Path(__file__).resolve().parents[1] / "twilight" / "data" / "preview"


def main() -> None:
    for name in sys.argv[1:] or sorted(shipped("climates")):
        begin = time.process_time()
        model = fit_preview(name)
        size = write_model(model, FOLDER / f"{name}.npz")
        errors = [
            f"{low:g} to {high:g} deg {100 * error['p95']:.1f} %"
            for error in model.provenance["errors"]
            for low, high in [error["sun_elevation_deg"]]
        ]
        took = time.process_time() - begin
        print(f"{name}: {size / 1e3:.0f} kB, {took:.0f} processor s; 95 %: {', '.join(errors)}", flush=True)


if __name__ == "__main__":
    main()
