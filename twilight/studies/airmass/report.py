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
"""Most suns whose box factors are drawn."""


def rows(found: Dataset) -> tuple[list[str], list[list[str]]]:
    """(columns, rows) of the gas's factors: one row for each sun and wavelength."""
    errors = found.get("air_mass_standard_error")
    columns = ["sun_zenith_deg", "wavelength_nm", "air_mass_factor"]
    columns += ["standard_error"] if errors is not None else []
    columns += ["slant_column_per_cm2"]
    lines = []
    for k, sun in enumerate(found["sun_elevation"].values):
        for w, nm in enumerate(found["wavelength"].values):
            line = [f"{90.0 - sun:g}", f"{nm:g}", f"{found['air_mass_factor'].values[k, w]:.4g}"]
            line += [f"{errors.values[k, w]:.2g}"] if errors is not None else []
            lines.append([*line, f"{found['slant_column'].values[k, w]:.4g}"])
    return columns, lines


def write_tables(found: Dataset, folder: Path) -> None:
    """airmass.csv: the gas's factors; boxes.csv: those of every layer; airmass.nc: all of it for xarray."""
    columns, lines = rows(found)
    write_csv(folder / "airmass.csv", columns, lines)
    errors = found.get("standard_error")
    head = ["sun_zenith_deg", "wavelength_nm", "bottom_km", "top_km", "layer_column_per_cm2", "box_air_mass_factor"]
    boxes: list[list[Any]] = []
    for k, sun in enumerate(found["sun_elevation"].values):
        for w, nm in enumerate(found["wavelength"].values):
            for j, (low, high) in enumerate(found["altitude_bnds"].values):
                factor, column = found["box_air_mass_factor"].values[k, j, w], found["layer_column"].values[j]
                line = [f"{90.0 - sun:g}", f"{nm:g}", f"{low:g}", f"{high:g}", f"{column:.6g}", f"{factor:.6g}"]
                boxes.append([*line, f"{errors.values[k, j, w]:.2g}"] if errors is not None else line)
    write_csv(folder / "boxes.csv", [*head, "standard_error"] if errors is not None else head, boxes)
    interruptible_h5netcdf()
    with whole_file(folder / "airmass.nc") as part:
        found.to_netcdf(part, engine="h5netcdf")


def draw(found: Dataset, path: Path, title: str) -> None:
    """The gas's factor over the sun's zenith angle at each wavelength, and box factors over altitude at some suns."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # start-up
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.6), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    zenith = 90.0 - found["sun_elevation"].values
    order = np.argsort(zenith)
    errors = found.get("air_mass_standard_error")
    for w, nm in enumerate(found["wavelength"].values):
        values = found["air_mass_factor"].values[order, w]
        if errors is None:
            left.plot(zenith[order], values, marker=".", label=f"{nm:g} nm")
        else:
            left.errorbar(zenith[order], values, errors.values[order, w], marker=".", capsize=2, label=f"{nm:g} nm")
    left.set(xlabel="solar zenith angle [deg]", ylabel=f"air-mass factor of {found.attrs['gas']}", title=title)
    left.legend()
    chosen = order[np.unique(np.linspace(0, order.size - 1, min(DRAWN_SUNS, order.size)).round().astype(int))]
    for number, k in enumerate(chosen):
        factors = found["box_air_mass_factor"].values[k, :, 0]
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
