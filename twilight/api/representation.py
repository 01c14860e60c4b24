"""How a sky shows itself: in a notebook, as a plot, in a browser, as a dataset of xarray's.

`Sky` and `SkySeries` stand in a room below those that draw and write; their methods are attached here, at the end, and
every public way to a sky (`twilight.__getattr__`) leads through this module.
"""

from __future__ import annotations

import base64
import io
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight.io.netcdf import read_sky
from twilight.sky.series import SkySeries
from twilight.sky.sky import Sky

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from twilight.viewer import Page

__all__ = ["Sky", "SkySeries", "facts", "html", "open_dataset", "plot", "read_sky"]

_NOTEBOOK_WIDTH = 480
"""Width of the picture of a sky in a notebook [pixel]."""


def html(self: Sky) -> str:
    """A picture of the sky and its figures, for notebooks."""
    from PIL import Image  # start-up

    from twilight.io.picture import render_view

    picture, _ = render_view(self, width=_NOTEBOOK_WIDTH)
    stream = io.BytesIO()
    Image.fromarray(_bytes(picture)).save(stream, "PNG")
    image = base64.b64encode(stream.getvalue()).decode()
    rows = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th><td style='text-align:left'>{escape(value)}</td></tr>"
        for name, value in facts(self)
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


def plot(self: Sky, projection: str = "wide", ax: Axes | None = None, **options: Any) -> Figure:
    """Draw the sky with matplotlib.

    Parameters
    ----------
    projection
        `wide`, `panorama` or `fisheye`.
    ax
        Axes to draw into; None: those of a new figure.
    **options
        width [pixel], exposure [EV100], tone_mapping, observer (of colour): of `twilight.io.picture.render_view`.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, whose `savefig` writes it; its `axes` hold the picture.
    """
    from matplotlib import pyplot  # start-up

    from twilight.io.picture import label_of, render_view

    picture, _ = render_view(self, view=projection, **options)
    if ax is None:
        height, width = picture.shape[:2]
        _, ax = pyplot.subplots(figsize=(9.0, 9.0 * height / width) if width > height else (6.0, 6.0))
    ax.imshow(_bytes(picture))
    ax.set_axis_off()
    ax.set_title(label_of(self), fontsize="small")
    return ax.figure  # type: ignore[return-value]


def _bytes(picture: np.ndarray) -> np.ndarray:
    from twilight.io.eight_bit import to_bytes

    return to_bytes(np.nan_to_num(picture, nan=1.0))


def view(self: Sky) -> Page:
    """The sky in a browser.

    Returns
    -------
    twilight.viewer.Page
        A page that a notebook shows and whose `save(path)` writes it as HTML.
    """
    from twilight.viewer import view_sky  # start-up

    return view_sky(self)


def to_xarray(self: Sky) -> xarray.Dataset:
    """The sky as a dataset of xarray's, with the variables of sky.h5 and the accessor `.sky`."""
    import twilight.api.accessor  # noqa: F401 - start-up; registers `.sky`
    from twilight.io.netcdf import sky_to_dataset

    return sky_to_dataset(self)


def series_to_xarray(self: SkySeries) -> xarray.Dataset:
    """All skies as one dataset of xarray's, with the accessor `.sky`.

    Returns
    -------
    xarray.Dataset
        Along `time` (UTC) where the skies know theirs, else along `sun_elevation_deg`.

    Raises
    ------
    TwilightError
        For skies on different grids.
    """
    import twilight.api.accessor  # noqa: F401 - start-up; registers `.sky`
    from twilight.io.series import series_to_dataset

    return series_to_dataset(self)


def open_dataset(path: str) -> xarray.Dataset:
    """What `twilight` wrote, as a lazy dataset of xarray's with the accessor `.sky`.

    Parameters
    ----------
    path
        A sky.h5, a series.nc, or the folder of a sweep (.zarr).

    Raises
    ------
    TwilightError
        For what is not there, or is neither.
    """
    from pathlib import Path

    import xarray  # start-up

    import twilight.api.accessor  # noqa: F401 - registers `.sky`
    from twilight.base.errors import TwilightError
    from twilight.base.reading import first_line

    if not Path(path).exists():
        raise TwilightError(f"{path}: no such file")
    try:
        if Path(path).is_dir():
            return xarray.open_zarr(path)
        return xarray.open_dataset(path, engine="h5netcdf")
    except (OSError, ValueError, KeyError) as error:
        raise TwilightError(f"{path}: is neither a sky.h5, a series.nc nor a sweep ({first_line(error)})") from None


Sky.plot = plot  # type: ignore[method-assign]
Sky.view = view  # type: ignore[method-assign]
Sky.to_xarray = to_xarray  # type: ignore[method-assign]
Sky._repr_html_ = html  # type: ignore[method-assign]
SkySeries.to_xarray = series_to_xarray  # type: ignore[method-assign]
