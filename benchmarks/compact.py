"""The compact sky beside the solver it was fitted to: error by elevation of the sun, size, time.

    python benchmarks/compact.py [MODEL.npz] [--quality QUALITY] [--picture FILE.png]

Writes benchmarks/compact.csv from what the fit found on skies that it was not fitted to (they are in the model's file),
the file's size, and processor times measured here.  The picture (committed as
compact.png) shows both skies of one air, and their ratio, under several suns; its zones are solved anew at the quality,
that of the model unless another is given.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import results

from twilight.config import load
from twilight.sky import colour
from twilight.solvers.compact.compact_sky import CompactSky
from twilight.studies.fit.compact.build import seconds_per_value
from twilight.studies.fit.compact.training import TrainingAir, medium_of

HERE = Path(__file__).parent
SHIPPED = HERE.parent / "twilight" / "data" / "compact" / "continental-average.npz"
SUNS_DEG = (30.0, 6.0, 1.0, -3.0, -6.0, -11.0, -17.0)
PICTURED = TrainingAir(0.14, 0.2)
WAVELENGTHS_NM = np.linspace(385.0, 735.0, 8)
STEP_DEG = 2.0


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("model", nargs="?", type=Path, default=SHIPPED)
    parser.add_argument("--quality")
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    model = CompactSky.load(options.model)
    table(model, options.model)
    if options.picture:
        picture(model, options.quality or model.provenance["quality"], options.picture)


def table(model: CompactSky, path: Path) -> None:
    """Print and write the table."""
    facts = model.provenance
    rows: list[list[Any]] = []
    for e in facts["errors_of_held_out_skies"]:
        low, high = e["sun_elevation_deg"]
        percent = [f"{100 * e[key]:.2f}" for key in ("median", "p95", "largest")]
        rows.append([f"{low:g}", f"{high:g}", e["part"], e["values"], *percent])
    value_s, grid_s, sky_s = seconds_per_value(model)
    lines = [
        f"{facts['climate']}, zones {facts['quality']}, {facts['cpu_minutes']:.1f} CPU minutes, "
        f"{path.stat().st_size / 1e6:.2f} MB",
        f"per direction and wavelength {1e9 * value_s:.0f} ns, on rows and columns {1e9 * grid_s:.0f} ns; "
        f"per sun {1e3 * sky_s:.1f} ms",
    ]
    head = ["sun_from_deg", "sun_to_deg", "directions", "values", "median_percent", "p95_percent", "largest_percent"]
    results.write(HERE / "compact.csv", head, rows, notes=lines)
    print((HERE / "compact.csv").read_text(), end="")


def picture(model: CompactSky, quality: str, path: Path) -> None:
    """Compact, zones and the ratio of their luminances for each sun, half a sky each: azimuth 0 to 180 to the right."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    from twilight.solvers import zones

    config = load(model.provenance["climate"])
    begin = time.process_time()
    field = zones.prepare(medium_of(config, PICTURED, WAVELENGTHS_NM), zones.QUALITIES[quality])
    print(f"zones {quality}: {time.process_time() - begin:.0f} s of processor time")
    rows, columns = np.arange(0.5 * STEP_DEG, 90.0, STEP_DEG), np.arange(0.0, 180.1, STEP_DEG)
    e, a = np.meshgrid(rows, columns, indexing="ij")
    figure, axes = pyplot.subplots(len(SUNS_DEG), 3, figsize=(12, 2.1 * len(SUNS_DEG)), layout="constrained")
    for sun, line in zip(SUNS_DEG, axes, strict=True):
        near = model.sky(sun, WAVELENGTHS_NM, PICTURED.optical_depth_550nm, PICTURED.ground_albedo).radiance(e, a)
        true = field.radiance(sun, e, a)
        percent = 100.0 * (near / true - 1.0)
        worst = percent.reshape(-1, percent.shape[-1])[np.abs(percent).argmax() // percent.shape[-1]]
        median, p95 = np.percentile(np.abs(percent), [50, 95])
        titles = [f"{name}, sun {sun:g}°" for name in ("compact", f"zones {quality}")]
        titles.append(f"luminance [%]; spectral median {median:.2f}, 95 % {p95:.2f}")
        draw_beside(figure, line, (near, true), WAVELENGTHS_NM, e, titles, 3.0)
        print(f"sun {sun:g}: median {median:.2f} %, 95 % {p95:.2f} %, worst {np.abs(worst).max():.1f} %")
    figure.savefig(path, dpi=80)


def draw_beside(
    figure: Any,
    axes: Sequence[Any],
    skies: tuple[np.ndarray, np.ndarray],
    wavelength_nm: np.ndarray,
    elevation_deg: np.ndarray,
    titles: Sequence[str],
    largest_percent: float,
) -> None:
    """Two skies (E, A, W), half a sky each, at the exposure of the second, and the difference of their luminances."""
    xyz = [colour.spectrum_to_xyz(sky, wavelength_nm) for sky in skies]
    ev = colour.auto_exposure_ev100(xyz[1][..., 1], np.cos(np.radians(elevation_deg)))
    half_sky: dict[str, Any] = {"origin": "lower", "extent": (0, 180, 0, 90), "aspect": "auto"}
    for axis, values in zip(axes, xyz, strict=False):
        axis.imshow(colour.tone_map(colour.xyz_to_linear_rgb(values), ev), **half_sky)
    percent = 100.0 * (xyz[0][..., 1] / xyz[1][..., 1] - 1.0)
    image = axes[2].imshow(percent, cmap="RdBu_r", vmin=-largest_percent, vmax=largest_percent, **half_sky)
    figure.colorbar(image, ax=axes[2])
    for axis, title in zip(axes, titles, strict=True):
        axis.set_title(title, fontsize=9)


if __name__ == "__main__":
    main()
