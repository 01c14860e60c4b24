"""How a sky shows itself: in a notebook, as a plot, as a dataset of xarray's with words of its own."""

from __future__ import annotations

import base64
import io
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from twilight.sky import Sky

_NOTEBOOK_WIDTH = 480


def html(sky: Sky) -> str:
    """A picture of the sky and its figures, for notebooks."""
    from PIL import Image

    from twilight.io.picture import render_view

    picture, _ = render_view(sky, width=_NOTEBOOK_WIDTH)
    stream = io.BytesIO()
    Image.fromarray(_bytes(picture)).save(stream, "PNG")
    image = base64.b64encode(stream.getvalue()).decode()
    rows = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th><td style='text-align:left'>{escape(value)}</td></tr>"
        for name, value in facts(sky)
    )
    return f'<img alt="the sky" src="data:image/png;base64,{image}"/><table>{rows}</table>'


def facts(sky: Sky) -> list[tuple[str, str]]:
    """Name and value of the figures that say which sky this is and how bright, as text with units."""
    climate = (sky.provenance.get("configuration") or {}).get("climate") or {}
    found = [("climate", str(climate["name"]))] if climate.get("name") else []
    if sky.time is not None:
        found.append(("time", sky.time.isoformat()))
    zenith = sky.luminance_at(90.0)
    return [
        *found,
        ("sun elevation (true)", f"{sky.sun_elevation_deg:.2f} deg"),
        ("zenith luminance", f"{zenith:.4g} cd m^-2 ({sky.magnitude():.2f} V mag arcsec^-2)"),
        ("illuminance of the sky", f"{sky.illuminance_lux():.4g} lx"),
    ]


def plot(sky: Sky, projection: str = "wide", ax: Any = None, **options: Any) -> Any:
    """Draw the sky into matplotlib's axes (made where none are given) and return them.

    projection: wide, panorama or fisheye; options: width, exposure, tone_mapping, observer of `io.picture.render_view`.
    """
    from matplotlib import pyplot

    from twilight.io.picture import label_of, render_view

    picture, _ = render_view(sky, view=projection, **options)
    if ax is None:
        height, width = picture.shape[:2]
        _, ax = pyplot.subplots(figsize=(9.0, 9.0 * height / width) if width > height else (6.0, 6.0))
    ax.imshow(_bytes(picture))
    ax.set_axis_off()
    ax.set_title(label_of(sky), fontsize="small")
    return ax


def _bytes(picture: np.ndarray) -> np.ndarray:
    from twilight.io.eight_bit import to_bytes

    return to_bytes(np.nan_to_num(picture, nan=1.0))


def dataset(sky: Sky) -> Any:
    """The sky as an `xarray.Dataset`, as in sky.h5, with the accessor `.sky`."""
    import twilight.accessor  # noqa: F401 - registers it
    from twilight.io.netcdf import sky_to_dataset

    return sky_to_dataset(sky)
