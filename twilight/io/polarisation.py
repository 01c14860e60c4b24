"""``sky.polarisation.png``: degree and angle of linear polarisation of the whole sky."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twilight.io.picture import view_directions
from twilight.io.provenance import provenance_fields
from twilight.io.rendered import Options, Rendered
from twilight.io.whole import whole_file
from twilight.sky import Sky

WIDTH = 480
WAVELENGTH_NM = 550.0


def polarisation_maps(sky: Sky, width: int = WIDTH) -> tuple[np.ndarray, np.ndarray, float]:
    """Degree and angle [deg] of linear polarisation as fisheye pictures (``io.picture.view_directions``), (width,
    width) each, NaN outside the circle; and their wavelength [nm], the sky's nearest to 550.

    Errors: TwilightError for a sky without Stokes parameters.
    """
    elevation, azimuth = view_directions("fisheye", width)
    w = int(np.argmin(np.abs(sky.wavelength_nm - WAVELENGTH_NM)))
    above = elevation >= 0.0
    q, u = np.moveaxis(sky.sample_polarised_share(elevation[above], azimuth[above])[..., w], -1, 0)
    degree, angle = np.full(above.shape, np.nan), np.full(above.shape, np.nan)
    degree[above], angle[above] = np.hypot(q, u), 0.5 * np.degrees(np.arctan2(u, q))
    return degree, angle, float(sky.wavelength_nm[w])


def write_polarisation_png(sky: Sky, path: str | Path) -> Path:
    """Draw the whole sky, the zenith in the middle and the sun's azimuth at the bottom: degree, and angle of vibration.

    Whole or not at all.  Errors: TwilightError for a sky without Stokes parameters.
    """
    from matplotlib.figure import Figure

    degree, angle, wavelength = polarisation_maps(sky)
    figure = Figure(figsize=(9.6, 4.6), dpi=100, layout="constrained")
    left, right = figure.subplots(1, 2)
    shown = (
        (left, degree, "viridis", (0.0, 1.0), "degree of linear polarisation"),
        (right, angle, "twilight", (-90.0, 90.0), "angle of vibration from the vertical, clockwise [deg]"),
    )
    for axes, values, colours, (low, high), title in shown:
        picture = axes.imshow(values, cmap=colours, vmin=low, vmax=high, interpolation="nearest")
        figure.colorbar(picture, ax=axes, shrink=0.85)
        axes.set_title(title, fontsize=10)
        axes.axis("off")
    figure.suptitle(f"sun at {sky.sun_elevation_deg:g} deg (its azimuth below), {wavelength:g} nm", fontsize=10)
    texts = {name: str(value) for name, value in provenance_fields(sky.provenance).items()}
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", metadata={"Software": "twilight", **texts})
    return Path(path)


def write(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sky.polarisation.png``."""
    return [write_polarisation_png(rendered.fine, folder / "sky.polarisation.png")]
