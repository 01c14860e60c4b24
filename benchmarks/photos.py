"""Three panoramas against computed skies: estimated air, side-by-side pictures, figures.

    python benchmarks/photos.py FOLDER_OF_PHOTOS [--output docs/photos] [--only NAME]
    python benchmarks/photos.py FOLDER_OF_PHOTOS --all [MORE_PANORAMAS...]   # also phone_*.csv and holdout_*.csv, anew

The photographs are Poly Haven's, CC0, 1024 x 512, linear: kiara_1_dawn_1k.hdr, pmndrs_sunset.hdr (also known as
venice_sunset) and rooitou_park_1k.hdr.  Their white balance and scale are not known, so both are free.  The air is not
known either: the aerosol, ozone, the ground's albedo and the sun are found (`twilight.estimate`).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import results

import twilight
from twilight.studies.validate.photographs.comparison import compare
from twilight.studies.validate.photographs.figure import write_figure
from twilight.studies.validate.photographs.intervals import Estimated
from twilight.studies.validate.photographs.report import LOW_SUN_DEG

HERE = Path(__file__).parent
PICTURE_CELL_DEG = 2.0
"""Side of the cells of the pictures [deg]."""
PHOTOS = {
    "kiara_1_dawn": "kiara_1_dawn_1k.hdr",
    "pmndrs_sunset": "pmndrs_sunset.hdr",
    "rooitou_park": "rooitou_park_1k.hdr",
}
HOLD_OUTS = (("holdout", ["evenings"]), ("holdout", ["drawn"]))
COLUMNS = (
    *("luminance_median_percent", "luminance_rms_percent", "luminance_p95_percent"),
    *("solar_meridian_rms_percent", "perpendicular_meridian_rms_percent", "correlation_of_log_luminance"),
    *("uv_distance_median", "uv_distance_p95"),
)


def main() -> None:
    """Measure, and write the tables and pictures."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("photos", type=Path)
    arguments.add_argument("--output", type=Path, default=HERE.parent / "docs" / "photos")
    arguments.add_argument("--only", choices=sorted(PHOTOS))
    arguments.add_argument("--all", type=Path, nargs="*", metavar="MORE_PANORAMAS")
    given = arguments.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    for name in PHOTOS if given.only is None else (given.only,):
        rows = one(name, given.photos / PHOTOS[name], given.output)
        columns = ["photograph", "quantity", "value", "low_68", "high_68", "low_95", "high_95", "told"]
        results.write(given.output / f"{name}.csv", columns, rows)
    if given.all is not None:
        for table in [*results.FOLDER.glob("phone_*.csv"), *results.FOLDER.glob("holdout_*.csv")]:
            table.unlink()  # they go on where they are
        panoramas = ["panoramas", given.photos, *given.all]
        for script, words in (("phone", []), ("phone", ["--evenings"]), ("holdout", panoramas), *HOLD_OUTS):
            subprocess.run([sys.executable, HERE / f"{script}.py", *words], check=True)


def words(p: Estimated) -> str:
    """A parameter in a line of the picture."""
    unit = "" if p.unit == "1" else f" {p.unit}"
    return f"{p.name} {p.value:.3g}, {p.low:.3g} to {p.high:.3g}{unit}" if p.constrained else f"{p.name}: not told"


def one(name: str, file: Path, output: Path) -> list[list]:
    """Estimate, compare and draw one panorama; rows of its table."""
    begin = time.process_time()
    found = twilight.estimate(file, white_balance=True)
    rows = [[name, "processor_time_s", f"{time.process_time() - begin:.1f}", *[""] * 5]]
    begin = time.process_time()
    twilight.estimate(file, white_balance=True, sun_elevation_deg=found.sun_elevation_deg)
    rows.append([name, "processor_time_s, sun known", f"{time.process_time() - begin:.1f}", *[""] * 5])
    if found.sun_elevation_deg < LOW_SUN_DEG:
        sun = {"sun_elevation_deg": found.sun_elevation_deg, "types": [found.best.aerosol_type]}
        for horizon in ("clean", "typical"):
            other = twilight.estimate(file, white_balance=True, settings={"horizon": horizon}, **sun)
            told = (("misfit", other.best.misfit), ("aerosol", other.parameters["aerosol"].value))
            rows += [[name, f"{what}, sun known, horizon {horizon}", f"{v:.4g}", *[""] * 5] for what, v in told]
    for p in found.best.parameters:
        interval = (f"{x:.4g}" for x in (p.low, p.high, p.low_95, p.high_95))
        rows.append([name, p.name, f"{p.value:.4g}", *interval, p.constrained])
    facts = [("aerosol_type", found.best.aerosol_type), ("misfit", f"{found.best.misfit:.4g}")]
    facts += [
        ("sun_elevation_deg", f"{found.sun_elevation_deg:.4g}"),
        ("sun_azimuth_deg", f"{found.sun_azimuth_deg:.4g}"),
    ]
    sky = found.sky
    fine = replace(found.photograph, cell_deg=PICTURE_CELL_DEG, min_elevation_deg=0.0, glare_deg=6.0)
    seen = fine.seen(found.sun_azimuth_deg, sky.apparent_sun_elevation_deg)
    for white_balance in (False, True):
        compared = compare(seen, sky, white_balance=white_balance)
        kind = "white balance free" if white_balance else "as it is"
        facts += [(f"{key}, {kind}", f"{compared.figures[key]:.4g}") for key in COLUMNS]
    facts += [(f"masked, {cause}", f"{part:.4g}") for cause, part in seen.taken.items()]
    rows += [[name, what, value, *[""] * 5] for what, value in facts]
    lines = (
        f"sun {found.sun_elevation_deg:+.2f} deg; {found.best.aerosol_type}",
        *found.about,
        *map(words, found.best.parameters),
    )
    title = f"{name} (Poly Haven, CC0)"
    write_figure(output / f"{name}.png", compared, title=title, lines=lines)
    for row in rows:
        print(*row, flush=True)
    return rows


if __name__ == "__main__":
    main()
