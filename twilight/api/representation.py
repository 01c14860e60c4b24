"""Representations of a sky: in a notebook, as a plot, in a browser, as a dataset of xarray's.

Methods of `Sky` and `SkySeries` that draw and write are attached here, because their module may not import from rooms
above it; `twilight.api` imports this module first.

Figures: a sheet of a series' pictures, and the profile of a climate.
"""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np

from twilight.api.arguments import PlotOptions
from twilight.base.errors import TwilightError
from twilight.base.extras import require
from twilight.base.reading import first_line
from twilight.base.whole_files import save_figure, whole_file
from twilight.io.labels import attributes
from twilight.io.netcdf import check_self_contained, interruptible_h5netcdf, read_sky, sky_to_dataset
from twilight.io.picture import SHAPES, label_of, render_view, to_bytes, view_directions, width_of
from twilight.io.series import series_to_dataset
from twilight.sky.comparison import SkyComparison
from twilight.sky.series import SkySeries
from twilight.sky.sky import Sky

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from twilight.show.page import Page

__all__ = ["Sky", "SkySeries", "facts", "html", "open_dataset", "plot", "read_sky"]

_NOTEBOOK_WIDTH = 480
"""Width of the picture of a sky in a notebook [pixel]."""


def html(self: Sky) -> str:
    """A picture of the sky and its figures, for notebooks."""
    from PIL import Image  # start-up

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
    pairs = [("climate", str(climate["name"]))] if climate.get("name") else []
    if sky.time is not None:
        pairs.append(("time", sky.time.isoformat()))
    zenith = f"{sky.luminance_at(90.0):.4g} cd m^-2"
    if sky.covers("V"):
        zenith += f" ({sky.magnitude():.2f} V mag arcsec^-2)"
    return [
        *pairs,
        ("sun elevation (true)", f"{sky.sun_elevation_deg:.2f} deg"),
        ("zenith luminance", zenith),
        ("illuminance of the sky", f"{sky.illuminance_lux():.4g} lx"),
    ]


def plot(self: Sky, projection: str = "wide", ax: Axes | None = None, **options: Unpack[PlotOptions]) -> Figure:
    """Draw the sky with matplotlib.

    Parameters
    ----------
    projection
        `wide`, or one of those of `render --projection`: `perspective`, `cylinder`, `fisheye`, `latlong`, `panorama`,
        `octahedral`, `cube`, `limb`.  Below the horizon is the lit ground without the air before it, which `render`
        computes.
    ax
        Axes to draw into; None: those of a new figure.
    **options
        azimuth_deg: from the sun, of the middle of the picture, of a fisheye that of its lower edge (180: the Belt of
        Venus); width [pixel], exposure [EV100 or auto], tone_mapping, observer (of colour).

    Returns
    -------
    matplotlib.figure.Figure
        The figure, whose `savefig` writes it; its `axes` hold the picture.

    Raises
    ------
    TwilightError
        For an argument that is not allowed, in one sentence.

    Warns
    -----
    TwilightWarning
        Where the wavelengths are too few for colours.
    """
    require("plot", "matplotlib")
    _check_plot(projection, ax, options)
    picture, _ = render_view(self, view=projection, **options)
    ax = ax or _axes(picture.shape)
    ax.imshow(_bytes(picture))
    ax.set_axis_off()
    ax.set_title(label_of(self), fontsize="small")
    return ax.figure  # type: ignore[return-value]


def _check_plot(projection: object, ax: object, options: Mapping[str, object]) -> None:
    """TwilightError for arguments of `plot` that are none."""
    if not isinstance(projection, str) or projection not in SHAPES:
        raise TwilightError(f"plot: projection {projection!r} is not known, choose one of {', '.join(SHAPES)}")
    if ax is not None and not hasattr(ax, "imshow"):
        raise TwilightError(f"plot: ax must be axes of matplotlib's, got {ax!r}")
    known = PlotOptions.__optional_keys__
    for name, value in options.items():
        if name not in known:
            raise TwilightError(f"plot: {name} is no argument; allowed are projection, ax, {', '.join(sorted(known))}")
        number = isinstance(value, int | float | np.number) and np.isfinite(value)
        if name == "azimuth_deg" and not number:
            raise TwilightError(f"plot: azimuth_deg must be a finite number, got {value!r}")
        if name == "width" and not (value is None or (number and value == int(value) and value >= 4)):  # type: ignore[arg-type, call-overload, operator]
            raise TwilightError(f"plot: width must be a whole number of pixels, 4 or more, got {value!r}")


def plot_comparison(
    self: SkyComparison[Sky],
    projection: str = "fisheye",
    ax: Axes | None = None,
    wavelength_nm: float | None = None,
    width: int | None = None,
) -> Figure:
    """Draw a difference or a ratio of skies with matplotlib: blue where the first is darker, red where it is brighter.

    Parameters
    ----------
    projection
        As of `Sky.plot`.
    ax
        Axes to draw into; None: those of a new figure.
    wavelength_nm
        Of the radiance that is compared [nm], one of the skies' own; None: the luminance is.
    width
        Of the picture [pixel].

    Returns
    -------
    matplotlib.figure.Figure
        The figure; its second axes hold the scale.

    Raises
    ------
    TwilightError
        For a wavelength that the skies do not have.
    """
    require("plot", "matplotlib")
    from matplotlib.colors import LogNorm, Normalize  # optional

    elevation, azimuth = view_directions(projection, width or width_of(projection))
    lower = float(self.first.elevation_edges_deg[0])
    values, what, unit = _compared(self, np.fmax(elevation, lower), np.nan_to_num(azimuth), wavelength_nm)
    values = np.where(np.broadcast_to(elevation >= lower, values.shape), values, np.nan)
    norm: Normalize
    if self.kind == "difference":
        largest = float(np.nanmax(np.abs(values), initial=0.0)) or 1.0
        norm, label = Normalize(-largest, largest), f"difference of {what} [{unit}]"
    else:
        valid = values[np.isfinite(values) & (values > 0.0)]
        largest = max(1.001, float(np.exp(np.abs(np.log(valid)).max(initial=0.0))))
        norm, label = LogNorm(1.0 / largest, largest), f"ratio of {what}"
    ax = ax or _axes(values.shape)
    image = ax.imshow(values, cmap="RdBu_r", norm=norm)
    ax.set_axis_off()
    word = "minus" if self.kind == "difference" else "over"
    ax.set_title(f"{label_of(self.first)}\n{word} {label_of(self.second)}", fontsize="small")
    scale = ax.figure.colorbar(image, ax=ax, label=label, shrink=0.8)
    if self.kind == "ratio":
        for which in (scale.ax.yaxis.set_major_formatter, scale.ax.yaxis.set_minor_formatter):
            which("{x:g}")
    return ax.figure  # type: ignore[return-value]


def _compared(
    self: SkyComparison[Sky], elevation: np.ndarray, azimuth: np.ndarray, wavelength_nm: float | None
) -> tuple[np.ndarray, str, str]:
    """Values (height, width) in directions, what they are of, and the unit of that."""

    def seen(sky: Sky) -> np.ndarray:
        values = sky.luminance() if index is None else sky.radiance[..., index]
        return sky.smooth(values[..., None], elevation, azimuth)[..., 0]

    index, what, unit = None, "luminance", "cd m$^{-2}$"
    if wavelength_nm is not None:
        known = self.first.wavelength_nm
        index = int(np.abs(known - wavelength_nm).argmin())
        if abs(known[index] - wavelength_nm) > 1e-6:
            raise TwilightError(
                f"wavelength_nm: {wavelength_nm:g} is none of the skies' ({', '.join(f'{w:g}' for w in known)})"
            )
        what, unit = f"radiance at {wavelength_nm:g} nm", "W m$^{-2}$ sr$^{-1}$ nm$^{-1}$"
    return self.of(seen(self.first), seen(self.second)), what, unit


def comparison_to_xarray(self: SkyComparison[Sky]) -> xarray.Dataset:
    """`radiance` and `luminance` of the comparison as a dataset of xarray's."""
    require("to_xarray", "xarray")
    import xarray  # optional

    grid = ("elevation", "azimuth", "wavelength")
    values = {"radiance": (grid, self.radiance), "luminance": (grid[:2], self.luminance())}
    axes = (self.first.elevation_deg, self.first.azimuth_deg, self.first.wavelength_nm)

    def about(name: str) -> dict[str, str]:
        unit = attributes(name)["units"] if self.kind == "difference" else "1"
        return {"long_name": f"{self.kind} of {attributes(name)['long_name']}", "units": unit}

    return xarray.Dataset(
        {name: (dims, array, about(name)) for name, (dims, array) in values.items()},
        {name: (name, axis, attributes(name)) for name, axis in zip(grid, axes, strict=True)},
        {
            "title": f"{self.kind} of two skies, suns at {self.first.sun_elevation_deg:g} and "
            f"{self.second.sun_elevation_deg:g} degrees"
        },
    )


def _axes(shape: tuple[int, ...]) -> Axes:
    """Axes of a new figure for a picture of a shape."""
    from matplotlib import pyplot  # optional

    height, width = shape[:2]
    return pyplot.subplots(figsize=(9.0, 9.0 * height / width + 0.4) if width > height else (6.0, 6.0))[1]


def _bytes(picture: np.ndarray) -> np.ndarray:
    return to_bytes(np.nan_to_num(picture, nan=1.0))


def view(self: Sky) -> Page:
    """The sky in a browser.

    Returns
    -------
    twilight.show.Page
        A page that a notebook shows and whose `save(path)` writes it as HTML.
    """
    from twilight.show.skies import view_sky  # start-up

    return view_sky(self)


def to_xarray(self: Sky) -> xarray.Dataset:
    """The sky as a dataset of xarray's, with the variables of sky.h5 and the accessor `.sky`."""
    require("to_xarray", "xarray")
    import twilight.api.accessor  # noqa: F401 - optional; registers `.sky`

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
    require("to_xarray", "xarray")
    import twilight.api.accessor  # noqa: F401 - optional; registers `.sky`

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
    require("open_dataset", "xarray")
    import xarray  # optional

    import twilight.api.accessor  # noqa: F401 - optional; registers `.sky`

    if not Path(path).exists():
        raise TwilightError(f"{path}: no such file")
    try:
        if Path(path).is_dir():
            return xarray.open_zarr(path)
        interruptible_h5netcdf()
        check_self_contained(path)
        return xarray.open_dataset(path, engine="h5netcdf")
    except (OSError, ValueError, KeyError) as error:
        raise TwilightError(f"{path}: is neither a sky.h5, a series.nc nor a sweep ({first_line(error)})") from None


SkyComparison.plot = plot_comparison  # type: ignore[method-assign, assignment]
SkyComparison.to_xarray = comparison_to_xarray  # type: ignore[method-assign, assignment]
Sky.plot = plot  # type: ignore[method-assign, assignment]
Sky.view = view  # type: ignore[method-assign]
Sky.to_xarray = to_xarray  # type: ignore[method-assign]
Sky._repr_html_ = html  # type: ignore[method-assign]
SkySeries.to_xarray = series_to_xarray  # type: ignore[method-assign]


MAX_SHEET_PIXELS = 6000
"""Longest side of a contact sheet [pixels]."""


def contact_sheet(pictures: Sequence[tuple[str, Path]], path: Path) -> None:
    """One PNG with all pictures of a series in reading order, each with its label below.

    Pictures are scaled down together where the sheet would be wider or higher than 6000 pixels.
    Errors: TwilightError when a picture cannot be read or the sheet not be written.
    """
    from PIL import Image, ImageDraw, ImageFont  # start-up

    try:
        images = [Image.open(file).convert("RGB") for _, file in pictures]
    except OSError as error:
        raise TwilightError(f"{path}: the pictures of the series cannot be read: {error}") from None
    width, height = max(i.width for i in images), max(i.height for i in images)
    columns = max(1, round(math.sqrt(len(images) * height / width * 1.6)))
    rows = math.ceil(len(images) / columns)
    margin = 8
    size = max(12, width // 28)  # legible where the sheet is looked at whole
    line = round(1.5 * size)
    scale = min(
        1.0, MAX_SHEET_PIXELS / (columns * (width + margin)), MAX_SHEET_PIXELS / (rows * (height + line + margin))
    )
    width, height = max(1, int(width * scale)), max(1, int(height * scale))
    font = ImageFont.load_default(max(10, round(size * scale)))
    sheet = Image.new("RGB", (columns * (width + margin) + margin, rows * (height + line + margin) + margin), "black")
    draw = ImageDraw.Draw(sheet)
    for i, ((label, _), image) in enumerate(zip(pictures, images, strict=True)):
        x = margin + i % columns * (width + margin)
        y = margin + i // columns * (height + line + margin)
        sheet.paste(image.resize((width, height), Image.Resampling.LANCZOS), (x, y))
        draw.text((x, y + height + 2), label, fill="white", font=font)
    with whole_file(path) as temporary:
        sheet.save(temporary)


def profile_figure(
    title: str, altitude_km: np.ndarray, coefficients_per_km: Mapping[str, np.ndarray], wavelength_nm: float, path: Path
) -> None:
    """PNG of extinction coefficients [km^-1] against altitude [km] at one wavelength, one line for each part (Z,)."""
    require(f"{path}: a figure", "matplotlib")
    from matplotlib.figure import Figure  # optional

    figure = Figure(figsize=(6, 7), layout="constrained")
    axes = figure.subplots()
    values = np.concatenate([c[c > 0] for c in coefficients_per_km.values()] or [np.ones(1)])
    smallest, largest = float(values.min(initial=1.0)), float(values.max(initial=0.0)) or 1.0
    for name, coefficient in coefficients_per_km.items():
        axes.plot(np.where(coefficient > 0, coefficient, np.nan), altitude_km, label=name)
    axes.set(
        xscale="log",
        xlim=(max(1e-8 * largest, smallest / 3), 3 * largest),
        ylim=(0, altitude_km[-1]),
        xlabel=f"extinction at {wavelength_nm:g} nm [km$^{{-1}}$]",
        ylabel="altitude [km]",
        title=title,
    )
    axes.grid(alpha=0.3)
    axes.legend()
    save_figure(path, figure, 120)
