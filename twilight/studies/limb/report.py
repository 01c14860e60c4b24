"""What `twilight limb` writes: a table, a netCDF file and a picture, of limb radiance or of an occultation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight.base.whole_files import whole_file, write_csv
from twilight.io.netcdf import write_netcdf
from twilight.studies.airmass.factors import layer_edges_of
from twilight.studies.airmass.report import evenly_spread
from twilight.studies.limb.limb import TANGENT

if TYPE_CHECKING:
    from xarray import Dataset

COLUMNS = {
    "sun_normalised_radiance": "sun_normalised_radiance_per_sr",
    "standard_error": "standard_error_per_sr",
    "radiance": "radiance_w_per_m2_sr_nm",
    "transmittance": "transmittance",
    "bending": "bending_deg",
    "beam_spreading": "beam_spreading",
    "irradiance": "irradiance_over_sunlight",
}
"""Columns of the table, those that there are."""
RAYS_DRAWN = 6
"""Most lines of sight whose box air-mass factors are drawn."""


def table(found: Dataset) -> tuple[list[str], list[list[str]]]:
    """(columns, rows), a row for each line of sight and wavelength."""
    there = [name for name in COLUMNS if name in found]
    bent = found["tangent_altitude"].values
    rows = [
        [f"{apparent:g}", f"{bent[k, w]:.4f}", f"{nm:g}", *(f"{found[name].values[k, w]:.6g}" for name in there)]
        for k, apparent in enumerate(found[TANGENT].values)
        for w, nm in enumerate(found["wavelength"].values)
    ]
    head = ["apparent_tangent_altitude_km", "tangent_altitude_km", "wavelength_nm"]
    return [*head, *(COLUMNS[name] for name in there)], rows


def write(found: Dataset, folder: Path, stem: str) -> list[str]:
    """STEM.csv, STEM.nc and STEM.png, and boxes.csv of air-mass factors, into a folder that exists; returns names."""
    write_csv(folder / f"{stem}.csv", *table(found))
    files = [f"{stem}.csv", f"{stem}.nc", f"{stem}.png"]
    if "box_air_mass_factor" in found:
        boxes = [
            [f"{z:g}", f"{nm:g}", f"{low:g}", f"{high:g}", f"{found['box_air_mass_factor'].values[k, j, w]:.6g}"]
            for k, z in enumerate(found[TANGENT].values)
            for w, nm in enumerate(found["wavelength"].values)
            for j, (low, high) in enumerate(found["altitude_bnds"].values)
        ]
        head = ["apparent_tangent_altitude_km", "wavelength_nm", "bottom_km", "top_km", "box_air_mass_factor"]
        write_csv(folder / "boxes.csv", head, boxes)
        files.insert(1, "boxes.csv")
    write_netcdf(found, folder / f"{stem}.nc")
    draw(found, folder / f"{stem}.png")
    return files


def draw(found: Dataset, path: Path) -> None:
    """PNG: radiance, colour ratios and air-mass factors, or transmittance, bending and spreading, against altitude."""
    from matplotlib.figure import Figure  # start-up

    panels = _occultation_panels(found) if "transmittance" in found else _limb_panels(found)
    figure = Figure(figsize=(4.2 * len(panels) + 0.6, 4.6), dpi=130, layout="constrained")
    for axes, panel in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels, strict=True):
        for label, x, y, colour in panel["lines"]:
            axes.plot(x, y, marker=".", label=label, color=colour)
        for label, values, edges in panel.get("stairs", []):
            axes.stairs(values, edges, orientation="horizontal", baseline=None, label=label)
        axes.set(xlabel=panel["x"], ylabel=panel.get("y", "apparent tangent altitude [km]"))
        if panel.get("log"):
            axes.set_xscale("log")
        axes.grid(color="0.9", linewidth=0.8)
        axes.legend(frameon=False, fontsize=8, title=panel.get("legend"))
    figure.suptitle(_title(found), fontsize=11)
    with whole_file(path) as part:
        figure.savefig(part, format="png")


def _title(found: Dataset) -> str:
    facts = found.attrs
    text = f"{facts['title']}, from {facts['observer_altitude_km']:g} km"
    if "tangent_point_sun_elevation_deg" not in facts:
        return text
    sun, azimuth = facts["tangent_point_sun_elevation_deg"], facts["tangent_point_azimuth_deg"]
    return f"{text}, sun {sun:+g} deg at the tangent point, {azimuth:g} deg from it"


def _of_wavelengths(found: Dataset, values: np.ndarray) -> list[tuple[str, np.ndarray, np.ndarray, str]]:
    altitude = found[TANGENT].values
    return [(f"{nm:g} nm", values[:, w], altitude, f"C{w}") for w, nm in enumerate(found["wavelength"].values)]


def _limb_panels(found: Dataset) -> list[dict[str, Any]]:
    light = found["sun_normalised_radiance"].values
    light = np.where(light > 0.0, light, np.nan)
    panels: list[dict[str, Any]] = [
        {"lines": _of_wavelengths(found, light), "x": "sun-normalised radiance [sr$^{-1}$]", "log": True}
    ]
    nm = found["wavelength"].values
    if nm.size > 1:
        ratio = _of_wavelengths(found, light / light[:, :1])[1:]
        panels.append({"lines": ratio, "x": f"colour ratio: radiance over that at {nm[0]:g} nm"})
    if "box_air_mass_factor" in found:
        edges = layer_edges_of(found)
        stairs = [
            (f"{found[TANGENT].values[k]:g} km", found["box_air_mass_factor"].values[k, :, 0], edges)
            for k in evenly_spread(found.sizes[TANGENT], RAYS_DRAWN)
        ]
        about = {"x": f"box air-mass factor at {nm[0]:g} nm", "y": "altitude [km]", "legend": "tangent altitude"}
        panels.append({"lines": [], "stairs": stairs, **about})
    return panels


def _occultation_panels(found: Dataset) -> list[dict[str, Any]]:
    unit = {"transmittance": "transmittance", "beam_spreading": "beam spreading", "bending": "bending [deg]"}
    return [
        {"lines": _of_wavelengths(found, found[name].values), "x": label, "log": name == "bending"}
        for name, label in unit.items()
    ]
