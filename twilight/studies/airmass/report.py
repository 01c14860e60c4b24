"""Air-mass factors as a table, a netCDF file and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight.base.whole_files import whole_file, write_csv
from twilight.io.netcdf import interruptible_h5netcdf

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


def rows(found: Dataset) -> tuple[list[str], list[list[str]]]:
    """(columns, rows) of the gas's factors: one row for each air, sun and wavelength."""
    known = "air_mass_standard_error" in found
    tables = airs(found)
    columns = [*tables[0][0], "sun_zenith_deg", "wavelength_nm", "air_mass_factor"]
    columns += ["standard_error"] if known else []
    columns += ["slant_column_per_cm2"]
    lines = []
    for named, air in tables:
        for k, sun in enumerate(air["sun_elevation"].values):
            for w, nm in enumerate(air["wavelength"].values):
                one = air.isel(sun_elevation=k, wavelength=w)
                line = [
                    *map(_text, named.values()),
                    f"{90.0 - sun:g}",
                    f"{nm:g}",
                    f"{float(one['air_mass_factor']):.4g}",
                ]
                line += [f"{float(one['air_mass_standard_error']):.2g}"] if known else []
                lines.append([*line, f"{float(one['slant_column']):.4g}"])
    return columns, lines


def _text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float | np.number) else str(value)


def write_tables(found: Dataset, folder: Path) -> None:
    """airmass.csv: the gas's factors; boxes.csv: those of every layer; airmass.nc: all of it for xarray."""
    columns, lines = rows(found)
    write_csv(folder / "airmass.csv", columns, lines)
    known = "standard_error" in found
    head = ["sun_zenith_deg", "wavelength_nm", "bottom_km", "top_km", "layer_column_per_cm2", "box_air_mass_factor"]
    boxes: list[list[Any]] = []
    for named, air in airs(found):
        names = [_text(value) for value in named.values()]
        for k, sun in enumerate(air["sun_elevation"].values):
            for w, nm in enumerate(air["wavelength"].values):
                for j, (low, high) in enumerate(air["altitude_bnds"].values):
                    factor, column = air["box_air_mass_factor"].values[k, j, w], air["layer_column"].values[j]
                    line = [
                        *names,
                        f"{90.0 - sun:g}",
                        f"{nm:g}",
                        f"{low:g}",
                        f"{high:g}",
                        f"{column:.6g}",
                        f"{factor:.6g}",
                    ]
                    boxes.append([*line, f"{air['standard_error'].values[k, j, w]:.2g}"] if known else line)
    head = [*airs(found)[0][0], *head]
    write_csv(folder / "boxes.csv", [*head, "standard_error"] if known else head, boxes)
    interruptible_h5netcdf()
    with whole_file(folder / "airmass.nc") as part:
        found.to_netcdf(part, engine="h5netcdf")


def draw(found: Dataset, path: Path, title: str) -> None:
    """The gas's factor over the sun's zenith angle, and box factors over altitude at some suns.

    The left holds every wavelength, or some airs of a table at the first one; the right the first air at the first one.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # start-up
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.6), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    zenith = 90.0 - found["sun_elevation"].values
    order = np.argsort(zenith)
    tables = airs(found)
    some = np.unique(np.linspace(0, len(tables) - 1, min(DRAWN_SUNS, len(tables))).round().astype(int))
    n_wavelengths = found.sizes["wavelength"] if len(tables) == 1 else 1
    lines = [(*tables[k], w) for k in some for w in range(n_wavelengths)]
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
    chosen = order[np.unique(np.linspace(0, order.size - 1, min(DRAWN_SUNS, order.size)).round().astype(int))]
    for number, k in enumerate(chosen):
        factors = first["box_air_mass_factor"].values[k, :, 0]
        right.stairs(
            factors, np.append(found["altitude_bnds"].values[:, 0], found["altitude_bnds"].values[-1, 1]),
            orientation="horizontal", baseline=None, label=f"{zenith[k]:g} deg", color=f"C{number}",
        )  # fmt: skip
    right.set(
        xlabel="box air-mass factor", ylabel="altitude [km]", title=f"at {found['wavelength'].values[0]:g} nm, by sun"
    )
    right.legend(title="zenith angle")
    with whole_file(path) as part:
        figure.savefig(part, format="png")
