"""Air-mass factors as a table, a netCDF file and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight.base.whole_files import whole_file, write_csv
from twilight.io.netcdf import write_netcdf
from twilight.studies.airmass.factors import layer_edges_of

if TYPE_CHECKING:
    from xarray import Dataset

DRAWN_SUNS = 6
"""Most suns whose box factors are drawn, and most airs of a table."""


def airs(found: Dataset) -> list[tuple[dict[str, Any], Dataset]]:
    """Each air of a table by what varies, with its own factors; one without names where nothing varies."""
    axes = [str(d) for d in found["air_mass_factor"].dims if d not in ("sun_elevation", "wavelength")]
    sizes = [found.sizes[axis] for axis in axes]
    places = [dict(zip(axes, index, strict=True)) for index in np.ndindex(*sizes)]
    return [({axis: found[axis].values[k] for axis, k in place.items()}, found.isel(place)) for place in places]


def evenly_spread(count: int, most: int) -> np.ndarray:
    """Indices of at most so many of `count` things, evenly spread from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int))


def rows(found: Dataset) -> tuple[list[str], list[list[str]]]:
    """(columns, rows) of the gas's factors: one row for each air, sun and wavelength."""
    known = "air_mass_standard_error" in found
    tables = airs(found)
    columns = [*tables[0][0], "sun_zenith_deg", "wavelength_nm", "air_mass_factor", "slant_column_per_cm2"]
    if known:
        columns.insert(-1, "standard_error")
    lines = []
    for named, air in tables:
        for k, sun in enumerate(air["sun_elevation"].values):
            for w, nm in enumerate(air["wavelength"].values):
                one = air.isel(sun_elevation=k, wavelength=w)
                line = [*map(_text, (*named.values(), 90.0 - sun, nm)), f"{float(one['air_mass_factor']):.4g}"]
                line += [f"{float(one['air_mass_standard_error']):.2g}"] if known else []
                lines.append([*line, f"{float(one['slant_column']):.4g}"])
    return columns, lines


def _text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float | np.number) else str(value)


def write_tables(found: Dataset, folder: Path) -> None:
    """airmass.csv: the gas's factors; boxes.csv: those of every layer; airmass.nc: all of it for xarray."""
    write_csv(folder / "airmass.csv", *rows(found))
    known = "standard_error" in found
    boxes: list[list[str]] = []
    for named, air in airs(found):
        for k, sun in enumerate(air["sun_elevation"].values):
            for w, nm in enumerate(air["wavelength"].values):
                for j, (low, high) in enumerate(air["altitude_bnds"].values):
                    factor, column = air["box_air_mass_factor"].values[k, j, w], air["layer_column"].values[j]
                    line = [*map(_text, (*named.values(), 90.0 - sun, nm, low, high)), f"{column:.6g}", f"{factor:.6g}"]
                    boxes.append([*line, f"{air['standard_error'].values[k, j, w]:.2g}"] if known else line)
    head = ["sun_zenith_deg", "wavelength_nm", "bottom_km", "top_km", "layer_column_per_cm2", "box_air_mass_factor"]
    write_csv(folder / "boxes.csv", [*airs(found)[0][0], *head, *(["standard_error"] if known else [])], boxes)
    write_netcdf(found, folder / "airmass.nc")


def draw(found: Dataset, path: Path, title: str) -> None:
    """The gas's factor over the sun's zenith angle, and box factors over altitude at some suns.

    Left: every wavelength, or some airs of a table at the first wavelength.  Right: the first air and wavelength.
    """
    from matplotlib.figure import Figure  # start-up

    figure = Figure(figsize=(10.0, 4.6), dpi=130, layout="constrained")
    left, right = figure.subplots(1, 2)
    zenith = 90.0 - found["sun_elevation"].values
    order = np.argsort(zenith)
    tables = airs(found)
    n_wavelengths = found.sizes["wavelength"] if len(tables) == 1 else 1
    lines = [(*tables[k], w) for k in evenly_spread(len(tables), DRAWN_SUNS) for w in range(n_wavelengths)]
    for named, air, w in lines:
        values, errors = air["air_mass_factor"].values[order, w], air.get("air_mass_standard_error")
        words = ", ".join(f"{name} {_text(value)}" for name, value in named.items())
        label = words or f"{found['wavelength'].values[w]:g} nm"
        if errors is None:
            left.plot(zenith[order], values, marker=".", label=label)
        else:
            left.errorbar(zenith[order], values, errors.values[order, w], marker=".", capsize=2, label=label)
    first = tables[0][1]
    left.set(xlabel="solar zenith angle [deg]", ylabel=f"air-mass factor of {found.attrs['gas']}", title=title)
    left.legend(fontsize="small")
    for number, k in enumerate(order[evenly_spread(order.size, DRAWN_SUNS)]):
        right.stairs(
            first["box_air_mass_factor"].values[k, :, 0], layer_edges_of(found),
            orientation="horizontal", baseline=None, label=f"{zenith[k]:g} deg", color=f"C{number}",
        )  # fmt: skip
    right.set(
        xlabel="box air-mass factor", ylabel="altitude [km]", title=f"at {found['wavelength'].values[0]:g} nm, by sun"
    )
    right.legend(title="zenith angle")
    with whole_file(path) as part:
        figure.savefig(part, format="png")
