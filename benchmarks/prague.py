"""Files of the Prague Sky Model: their error against the field that made them, their size and their time.

    python benchmarks/prague.py

Writes results/prague.csv: for suns on the file's nodes and half-way between them, relative errors over the sky (uniform
in solid angle, above 0.3 deg; and towards the afterglow, to 10 deg of elevation and 40 deg of azimuth from the sun), in
percent, read back by `prague_reader`, which tests hold to the
published reader.  And docs/prague.png: a sky of the file beside the field's.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
import results
from prague_reader import PragueSky

from twilight.base.progress import silent
from twilight.base.whole_files import save_figure
from twilight.engine import solve
from twilight.scene import resolve
from twilight.studies.export.prague import SUN_DEG, PragueMaker
from twilight.studies.export.prague_air import airs_of, channel_nodes
from twilight.studies.export.prague_file import PragueAxes, write_prague
from twilight.studies.export.prague_sky import SAFETY_M

CLIMATE = "continental-average"
VISIBILITY_KM = 51.0
ALBEDO = 0.15
QUALITY = "draft"
CHANNELS = 3
START_NM = 440.0
NODES = 1
SUNS_DEG = (60.0, 27.5, 5.0, 1.25, 0.0, -2.1, -4.0, -6.125, -9.0, -10.125, -12.125, -15.0, -17.875)
GLOW_HIGH_DEG = 10.0
GLOW_WIDE_DEG = 40.0
DIRECTIONS = 400
WIDTH_NM = 40.0
LAYOUT = {"visibilities": 5, "albedos": 2, "channels": 11}


def main() -> None:
    """Measure and write the table."""
    airs, albedo = airs_of([CLIMATE], (VISIBILITY_KM,)), np.array([ALBEDO])
    axes = PragueAxes(
        np.array([a.visibility_km for a in airs]), albedo, np.array([SAFETY_M]), np.array(SUN_DEG), CHANNELS,
        START_NM, WIDTH_NM,
    )  # fmt: skip
    nodes = channel_nodes(CHANNELS, START_NM, WIDTH_NM, NODES)
    fields: dict[tuple[int, int], object] = {}

    def field_of(v: int, b: int, progress: object) -> object:
        scene = resolve(airs[v].config(float(albedo[b]), QUALITY), wavelength_nm=nodes.wavelength_nm)
        fields[v, b] = solve(scene, cached=False)
        return fields[v, b]

    begin = time.process_time()
    made = PragueMaker(axes, nodes, 9, False).make(field_of, silent)
    spent = time.process_time() - begin
    with tempfile.TemporaryDirectory() as folder:
        size = write_prague(Path(folder) / "sky.dat", made)
        sky = PragueSky.load(Path(folder) / "sky.dat")
    random = np.random.default_rng(1)
    e, a = np.degrees(np.arcsin(random.uniform(0.005, 1.0, DIRECTIONS))), random.uniform(0.0, 180.0, DIRECTIONS)
    e = np.append(e, random.uniform(0.3, GLOW_HIGH_DEG, DIRECTIONS))
    a = np.append(a, random.uniform(0.0, GLOW_WIDE_DEG, DIRECTIONS))
    rows = []
    for sun in SUNS_DEG:
        off = []
        for (v, b), field in fields.items():
            exact = nodes.mean(field.radiance(sun, e, a))
            for c in range(CHANNELS):
                air = {"visibility_km": float(axes.visibility_km[v]), "albedo": float(albedo[b])}
                found = sky.radiance(sun, e, a, START_NM + WIDTH_NM * (c + 0.5), **air)
                off.append(100.0 * (found / exact[:, c] - 1.0))
        over, glow = np.abs(off)[:, :DIRECTIONS], np.abs(off)[:, DIRECTIONS:]
        found = [*np.percentile(over, (50, 95)), np.percentile(over, 95, axis=1).max()]
        rows.append([sun, *(f"{x:.2f}" for x in (*found, np.percentile(glow, 95), glow.max()))])
        print(*rows[-1], flush=True)
    count = axes.shape[0] * axes.shape[1] * axes.shape[4]
    whole = LAYOUT["visibilities"] * LAYOUT["albedos"] * LAYOUT["channels"]
    notes = [
        f"{CLIMATE}, zones {QUALITY}, {axes.shape} of (air, albedo, altitude, sun, channel)",
        f"{size} bytes and {spent:.0f} s of processor time for {count} of the ground layout's {whole} visibilities x "
        f"albedos x channels: by proportion {size * whole / count / 1e6:.0f} MB and {spent * whole / count:.0f} s",
    ]
    columns = ["sun_elevation_deg", "median_percent", "p95_percent", "p95_of_worst_channel_percent"]
    columns += ["afterglow_p95_percent", "afterglow_largest_percent"]
    results.write(results.FOLDER / "prague.csv", columns, rows, notes=notes)
    picture(fields[0, 0], sky, nodes, axes, results.ROOT / "docs" / "prague.png")


def picture(field, sky: PragueSky, nodes, axes: PragueAxes, path: Path) -> None:
    """The sky of the file, of the field, and their ratio, at two suns in the middle channel."""
    from matplotlib.figure import Figure

    e, a = np.meshgrid(np.linspace(89.7, 0.3, 60), np.linspace(0.0, 180.0, 60), indexing="ij")
    channel, air = axes.channels // 3, {"visibility_km": float(axes.visibility_km[0]), "albedo": float(axes.albedo[0])}
    nm = axes.start_nm + axes.width_nm * (channel + 0.5)
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    panels = figure.subplots(2, 3)
    for row, sun in zip(panels, (-4.0, -12.125), strict=True):
        exact = nodes.mean(field.radiance(sun, e, a))[..., channel]
        found = sky.radiance(sun, e, a, nm, **air)
        edges = {"extent": (0, 180, 0, 90), "aspect": "auto"}
        for panel, values, title in zip(row, (exact, found), ("zones", "the file"), strict=False):
            shown = panel.imshow(np.log10(values), vmin=np.log10(exact.min()), vmax=np.log10(exact.max()), **edges)
            panel.set_title(f"{title}, sun {sun:g} deg, {nm:g} nm", fontsize=9)
        figure.colorbar(shown, ax=row[1], label="log10 of W m-2 sr-1 nm-1")
        shown = row[2].imshow(100 * (found / exact - 1), vmin=-5, vmax=5, cmap="RdBu_r", **edges)
        row[2].set_title("difference [%]", fontsize=9)
        figure.colorbar(shown, ax=row[2])
    figure.supxlabel("azimuth from the sun [deg]", fontsize=9)
    figure.supylabel("elevation [deg]", fontsize=9)
    save_figure(path, figure, 90)


if __name__ == "__main__":
    results.say_help(__doc__)
    main()
