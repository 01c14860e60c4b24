"""The figures of the three papers that are renderings, from the configurations by their names, on one sheet.

    python benchmarks/paper_figures.py [NAME ...]      writes docs/paper-figures.jpg

Each row is a configuration, each picture one of its cases or suns, drawn from the field in the directions of its
pixels.  Haber's are "rendered by separately mapping image intensity linearly to the output range": the brightest pixel
but 0.2 % of them is white; of haber2005-fig7 a third picture is the difference of the two on one scale, gamma 3 as in
the paper.  His cells are S = 90 here with every sixth shell active (25 processor s a picture; 120 and 4 are his).
Preetham's flat spectrum is white, as his overcast sky is grey.  What is drawn once is kept in out/paper-figures.
"""

from __future__ import annotations

import argparse

import numpy as np
import results
from PIL import Image, ImageDraw

from twilight.base.digest import DISPLAY, code_digest
from twilight.config import load_series
from twilight.engine import solve
from twilight.io.picture import view_directions
from twilight.scene import resolve
from twilight.sky import colour

HEIGHT, WIDTH = 135, 300
TEXT = 16
"""Height of a line of text [pixels]."""
HABER = {"solver.azimuth_cells": 90, "solver.active_shell_step": 6}
FIGURES: dict[str, dict] = {
    **{f"haber2005-fig{n}": HABER for n in (7, 8, 9, 10, 12)},
    "bruneton2008-fig6": {"wavelengths": {"list_nm": [440, 550, 680]}},  # his three
    "preetham1999-fig9": {},
    "preetham1999-fig10": {},
}
SPARED = 0.998
"""Part of the pixels that a linear picture shows without clipping."""
KEPT = results.Kept("paper-figures", code_digest("twilight.engine.field", "twilight.solvers.cells", without=DISPLAY))


def linear_pictures(name: str) -> list[tuple[str, np.ndarray]]:
    """Label and linear Rec. 709 [cd m^-2], (height, width, 3), of each picture; NaN outside a fisheye's circle."""
    made = []
    for case in load_series(name, FIGURES[name]):
        scene = resolve(case.config)
        view = case.config.output.views[0]
        elevation, azimuth = np.broadcast_arrays(*view_directions(view, 132 if view == "fisheye" else WIDTH))
        up = np.maximum(elevation, 0.0)
        field = None
        for sun in scene.sun_elevations_deg:
            half = len(case.name) // 2  # two keys of the same last word and value are told once
            told = case.name[:half] if case.name[:half] == case.name[half + 1 :] else case.name
            label = told.replace("_", " ") or f"sun {sun:g} deg"
            key = f"{name} {case.name} {sun:g}"
            rows = KEPT.rows(key)
            if rows is None:
                field = field or solve(scene)
                factor = field.radiance(sun, up, azimuth)
                xyz = colour.factor_to_xyz(
                    factor, scene.medium.wavelength_nm, case.config.solar_spectrum,
                    observer=case.config.output.colour_observer,
                )  # fmt: skip
                rows = colour.xyz_to_linear_rgb(xyz).tolist()
                KEPT.keep(key, rows)
            rgb = np.array(rows)
            rgb[elevation < 0.0] = np.nan
            made.append((label, rgb))
    return made


def shown(name: str, rgb: np.ndarray) -> np.ndarray:
    """Display values 0..1 of a linear picture, exposed as the paper's."""
    seen = np.nan_to_num(rgb)
    if name.startswith("haber"):
        brightest = np.nanquantile(rgb.max(axis=-1), SPARED)
        return colour.srgb_encode(np.clip(colour.into_gamut(seen) / brightest, 0.0, 1.0))
    if name.startswith("preetham"):
        seen = seen / colour.xyz_to_linear_rgb(np.ones(3))
    luminance = np.nan_to_num(rgb @ np.array([0.2126, 0.7152, 0.0722]))
    return colour.tone_map(seen, colour.auto_exposure_ev100(luminance))


def pictures(name: str) -> list[tuple[str, Image.Image]]:
    """Label and picture of each case of a configuration."""
    made = linear_pictures(name)
    found = []
    for label, rgb in made:
        display = np.where(np.isnan(rgb), 0.75, shown(name, rgb))
        found.append((label, display))
    if name == "haber2005-fig7":
        once, more = (np.nan_to_num(rgb) for _, rgb in made)
        brightest = np.quantile(more.max(axis=-1), SPARED)
        found.append(("difference, gamma 3", np.clip(np.abs(more - once) / brightest, 0.0, 1.0) ** (1.0 / 3.0)))
    return [(label, Image.fromarray(np.round(255.0 * display).astype(np.uint8))) for label, display in found]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(FIGURES)}; none: all")
    rows = []
    for name in parser.parse_args().names or FIGURES:
        rows.append((name, pictures(name)))
        print(name, flush=True)
    columns, high = max(len(found) for _, found in rows), HEIGHT + 2 * TEXT
    sheet = Image.new("RGB", (columns * (WIDTH + 6), len(rows) * high), "white")
    draw = ImageDraw.Draw(sheet)
    for i, (name, found) in enumerate(rows):
        draw.text((3, i * high + 2), name, fill="black")
        for j, (label, image) in enumerate(found):
            left = j * (WIDTH + 6) + (WIDTH - image.width) // 2
            sheet.paste(image, (left, i * high + 2 * TEXT))
            draw.text((j * (WIDTH + 6) + 3, i * high + TEXT + 1), label[: WIDTH // 6], fill="black")
    sheet.save(results.ROOT / "docs" / "paper-figures.jpg", quality=88)


if __name__ == "__main__":
    main()
