"""Three panoramas against computed skies: estimated air, side-by-side pictures, figures.

    python benchmarks/photos.py FOLDER_OF_PHOTOS [--library DIR] [--output docs/photos]

The photographs are Poly Haven's, CC0, 1024 x 512, linear: kiara_1_dawn_1k.hdr, pmndrs_sunset.hdr (also known as
venice_sunset) and rooitou_park_1k.hdr.  Their white balance and scale are not known, so both are free.  The air is not
known either: the aerosol's optical depth, ozone and the ground's albedo are fitted (`twilight validate estimate`), for
kiara the sun's elevation too.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import results
from twilight.studies.validate.photographs.library import (
    OTHERS,
    SUN,
    Design,
    climate_settings,
    make_library,
    with_settings,
)

from twilight.config import load
from twilight.engine import run
from twilight.scene import resolve
from twilight.sky.colour import sky_to_xyz
from twilight.studies.validate.photographs.estimate import estimate, sentences
from twilight.studies.validate.photographs.figure import write_figure
from twilight.studies.validate.photographs.photo import OBSERVER, compare
from twilight.studies.validate.photographs.photograph import read_photograph

HERE = Path(__file__).parent / "photos"
DESIGN = Design(tuple(p for p in OTHERS if p.name in ("ozone", "albedo")))
TYPE = "continental_average"
CELL_DEG = 3.0
"""Side of the cells that photographs are averaged to where the air is sought [deg]."""
PICTURE_CELL_DEG = 2.0
"""Side of the cells of the pictures [deg]."""
PHOTOS = {  # file, lowest and highest sun [deg] of the search
    "kiara_1_dawn": ("kiara_1_dawn_1k.hdr", -6.0, -2.0),
    "pmndrs_sunset": ("pmndrs_sunset.hdr", 3.0, 3.0),
    "rooitou_park": ("rooitou_park_1k.hdr", 10.4, 10.4),
}
COLUMNS = (
    *("luminance_median_percent", "luminance_rms_percent", "luminance_p95_percent"),
    *("solar_meridian_rms_percent", "perpendicular_meridian_rms_percent", "correlation_of_log_luminance"),
    *("uv_distance_median", "uv_distance_p95"),
    *("ciede2000_median", "ciede2000_p95", "ciede2000_colour_median", "ciede2000_colour_p95"),
)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("photos", type=Path)
    arguments.add_argument("--library", type=Path, default=Path("out/photos-library"))
    arguments.add_argument("--output", type=Path, default=HERE.parents[1] / "docs" / "photos")
    arguments.add_argument("--only", choices=sorted(PHOTOS))
    given = arguments.parse_args()
    for folder in (given.library, given.output):
        folder.mkdir(parents=True, exist_ok=True)
    base = load(HERE / "base.scene.yaml")
    for name in PHOTOS if given.only is None else (given.only,):
        low, high = PHOTOS[name][1:]
        library = make_library(
            base,
            DESIGN,
            TYPE,
            [low] if low == high else [float(sun) for sun in np.arange(low, high + 0.5)],
            CELL_DEG,
            file=given.library / f"{name}_{TYPE}.npz",
            progress=lambda doing, fraction: print(doing, flush=True),
        )
        print(f"emulated: {library.luminance_error:.4f} in ln(luminance), {library.chromaticity_error:.5f} in u', v'")
        rows = one(name, given.photos, base, library, given.output)
        results.write(
            given.output / f"{name}.csv",
            ["photograph", "quantity", "value", "standard_error", "low", "high", "constrained"],
            rows,
        )


def one(name: str, photos: Path, base, library, output: Path) -> list[list]:
    """Estimate, compare and draw one panorama; rows of its table."""
    file, low, _ = PHOTOS[name]
    shot = read_photograph(photos / file, None, cell_deg=CELL_DEG, min_elevation_deg=3.0, glare_deg=10.0)
    sun = shot.sun
    print(name, sun, flush=True)
    photo = shot.seen(sun.azimuth_deg, float(library.apparent_elevations_deg.mean())).sky

    def scene(values, cell_deg):
        settings = climate_settings(DESIGN, values, TYPE) | {"texture": {"resolution_deg": cell_deg}}
        return with_settings(base, settings | {"sun": {"elevation_deg": values.get(SUN, low)}})

    found = estimate(
        photo,
        [library],
        white_balance=True,
        refine=lambda _, values: sky_to_xyz(run(resolve(scene(values, CELL_DEG))), observer=OBSERVER),
        progress=lambda doing, fraction: print(doing, flush=True),
    )
    best = found[0]
    rows = [
        [name, p.name, f"{p.value:.4g}", f"{p.standard_error:.2g}", f"{p.low:.4g}", f"{p.high:.4g}", p.constrained]
        for p in best.parameters
    ]
    rows.append([name, "misfit", f"{best.misfit:.4g}", "", "", "", ""])
    sky = run(resolve(scene(best.values, PICTURE_CELL_DEG)))
    fine = replace(shot, cell_deg=PICTURE_CELL_DEG, min_elevation_deg=0.0, glare_deg=6.0)
    seen = fine.seen(sun.azimuth_deg, sky.apparent_sun_elevation_deg)
    for white_balance in (False, True):
        compared = compare(seen.sky, sky, white_balance=white_balance)
        kind = "white balance free" if white_balance else "as it is"
        rows += [[name, f"{key}, {kind}", f"{compared.figures[key]:.4g}", "", "", "", ""] for key in COLUMNS]
    rows += [[name, f"masked, {cause}", f"{part:.4g}", "", "", "", ""] for cause, part in seen.mask.taken.items()]
    rows.append([name, "sun_azimuth_deg", f"{sun.azimuth_deg:.4g}", f"{sun.uncertainty_deg:.2g}", "", "", sun.method])
    lines = [f"sun {sky.sun_elevation_deg:+.2f} deg; continental aerosol (OPAC average); fitted:"]
    for p in best.parameters:
        unit = "" if p.unit == "1" else f" {p.unit}"
        lines.append(
            f"  {p.name} {p.value:.3g} +- {p.standard_error:.2g}{unit}{'' if p.constrained else ' (not constrained)'}"
        )
    title = f"{name} (Poly Haven, CC0)"
    write_figure(output / f"{name}.png", compared, seen.panorama, seen.mask, title=title, lines=tuple(lines))
    for row in rows:
        print(*row, flush=True)
    for sentence in sentences(found):
        print(sentence, flush=True)
    return rows


if __name__ == "__main__":
    main()
