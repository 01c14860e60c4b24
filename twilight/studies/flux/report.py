"""What `twilight fluxes` writes: fluxes.nc, fluxes.csv and fluxes.png."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twilight.base.whole_files import whole_file, write_csv
from twilight.io.netcdf import write_netcdf

if TYPE_CHECKING:
    import xarray

BROADBAND = ("direct_down", "diffuse_down", "direct_up", "diffuse_up", "net", "actinic")
"""Spectral quantities whose integrals over the wavelengths the table has [W m^-2]."""
RANGE_DRAWN = 1e-9
"""Least fraction of the largest value of a panel that is drawn."""


def table(dataset: xarray.Dataset) -> tuple[list[str], list[list[float]]]:
    """Column names and rows, one for each sun and altitude; integrals are over the dataset's wavelengths."""
    integrals = {
        f"{name}_w_per_m2": (dataset[name] * dataset["wavelength_width"]).sum("wavelength").values for name in BROADBAND
    }
    if "heating_rate" in dataset:
        integrals["heating_rate_k_per_day"] = dataset["heating_rate"].values
    integrals |= {f"{name}_per_s": dataset[name].values for name in dataset.data_vars if str(name).startswith("j_")}
    suns, altitudes = dataset["sun_elevation"].values, dataset["altitude"].values
    rows = [
        [float(sun), float(altitude), *(float(value[s, z]) for value in integrals.values())]
        for s, sun in enumerate(suns)
        for z, altitude in enumerate(altitudes)
    ]
    return ["sun_elevation_deg", "altitude_km", *integrals], rows


def write(dataset: xarray.Dataset, folder: Path) -> list[str]:
    """Write the files into a folder that exists; returns their names.

    Errors: TwilightError where a file cannot be written.
    """
    write_netcdf(dataset, folder / "fluxes.nc")
    columns, rows = table(dataset)
    write_csv(folder / "fluxes.csv", columns, [[f"{value:.6g}" for value in row] for row in rows])
    draw(dataset, folder / "fluxes.png")
    return ["fluxes.nc", "fluxes.csv", "fluxes.png"]


def draw(dataset: xarray.Dataset, path: Path) -> None:
    """PNG: against altitude, or of a single altitude against the sun: net irradiance, actinic flux, rates."""
    import matplotlib  # start-up
    from matplotlib.figure import Figure

    columns, rows = table(dataset)
    values = np.array(rows)
    at = {name: values[:, i] for i, name in enumerate(columns)}
    several = dataset.sizes["altitude"] > 1
    along, across = ("altitude_km", "sun_elevation_deg") if several else ("sun_elevation_deg", "altitude_km")
    panels = {
        "net irradiance [W m$^{-2}$]": "net_w_per_m2",
        "actinic flux [W m$^{-2}$]": "actinic_w_per_m2",
        "heating rate [K day$^{-1}$]": "heating_rate_k_per_day",
        "J(NO$_2$) [s$^{-1}$]": "j_no2_per_s",
        "J(O$_3$, O($^1$D)) [s$^{-1}$]": "j_o3_o1d_per_s",
        "J(NO$_3$, NO$_2$) [s$^{-1}$]": "j_no3_no2_per_s",
    }
    wanted = {label: name for label, name in panels.items() if name in at}
    lines = np.unique(at[across])[::-1]
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.9, lines.size))
    with matplotlib.rc_context({"font.size": 10, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(3.0 * len(wanted) + 0.6, 4.2), layout="constrained")
        axes = np.atleast_1d(figure.subplots(1, len(wanted)))
        for panel, (label, name) in zip(axes, wanted.items(), strict=True):
            for line, colour in zip(lines, colours, strict=True):
                some = at[across] == line
                x, y = at[name][some], at[along][some]
                if not several:
                    x, y = y, x
                text = f"sun {line:+g} deg" if several else f"{line:g} km"
                panel.plot(x, y, color=colour, marker=".", label=text)
            top = np.abs(at[name]).max()
            small = np.abs(at[name][at[name] != 0.0]).min(initial=top)
            if small < 0.03 * top and np.all(at[name] >= 0.0):
                (panel.set_xscale if several else panel.set_yscale)("log")
                (panel.set_xlim if several else panel.set_ylim)(max(0.5 * small, RANGE_DRAWN * top), 2.0 * top)
            panel.grid(color="0.9", linewidth=0.8)
            (panel.set_xlabel if several else panel.set_ylabel)(label)
        if several:
            axes[0].set_ylabel("altitude [km]")
        else:
            axes[0].set_xlabel("true elevation of the sun [deg]")
        axes[0].legend(frameon=False, fontsize=8)
        nm = dataset["wavelength"].values
        figure.suptitle(f"{dataset.attrs['title']}, {nm[0]:g} to {nm[-1]:g} nm", fontsize=11)
        with whole_file(path) as temporary:
            figure.savefig(temporary, dpi=130)
