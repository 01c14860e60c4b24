"""Tables and picture of an eclipse of the moon."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twilight.base.whole_files import whole_file, write_csv
from twilight.numerics import spectrum
from twilight.studies.eclipse.circumstances import Eclipse
from twilight.studies.eclipse.light import ShadowLight, magnitudes

PIXELS = 480
DECADES = 6.0
"""Of brightness that the picture shows, each one step of grey."""
DRAWN_NM = (450.0, 550.0, 600.0, 680.0)
"""Wavelengths whose irradiance is drawn, the nearest that there are."""


def write(lights: dict[str, ShadowLight], eclipse: Eclipse, wavelength_nm: np.ndarray, folder: Path) -> list[str]:
    """shadow.csv, light-curve.csv, eclipse.png into a folder that exists; returns their names."""
    rows = [
        [name, f"{np.degrees(offset):.5f}", f"{offset * light.distance_km:.1f}",
         *(f"{value:.5g}" for value in (visual, *irradiance, *scattered))]
        for name, light in lights.items()
        for offset, visual, irradiance, scattered in zip(
            light.offset_rad, light.visual, light.irradiance, light.scattered, strict=True
        )
    ]  # fmt: skip
    spectra = [f"{kind}_{w:g}_nm" for kind in ("irradiance", "scattered") for w in wavelength_nm]
    note = "irradiance at normal incidence over that without the Earth; scattered: the part of it that air scattered"
    write_csv(folder / "shadow.csv", ["climate", "offset_deg", "distance_from_axis_km", "visual", *spectra], rows, note)
    curves = np.array([magnitudes(light, eclipse.moon) for light in lights.values()])
    write_csv(
        folder / "light-curve.csv",
        ["time_utc", "offset_deg", *(f"visual_magnitude_{name}" for name in lights)],
        [
            [moment.isoformat(timespec="seconds"), f"{np.degrees(offset):.5f}", *(f"{m:.3f}" for m in row)]
            for moment, offset, row in zip(eclipse.moments, eclipse.moon.offset_rad, curves.T, strict=True)
        ],
    )
    draw(lights, eclipse, wavelength_nm, folder / "eclipse.png")
    return ["shadow.csv", "light-curve.csv", "eclipse.png"]


def colours(light: ShadowLight, wavelength_nm: np.ndarray) -> np.ndarray:
    """Colours (N, 3) of a white surface in the shadow, for a screen: their own chromaticity, brightness by decades."""
    weight = spectrum.colour_matching_functions("cie1931_2deg") * spectrum.solar_at_visible()[:, None]
    xyz = spectrum.integrate(light.irradiance, wavelength_nm, weight)
    white = weight.sum(axis=0)
    linear = (xyz / white * np.array([0.95047, 1.0, 1.08883])) @ spectrum.xyz_to_rgb_matrix("cie1931_2deg").T
    linear = np.maximum(linear, 0.0)
    brightness = np.clip(1.0 + np.log10(np.maximum(light.visual, 10.0**-DECADES)) / DECADES, 0.0, 1.0)
    chroma = linear / np.maximum(linear.max(axis=1, keepdims=True), 1e-300)
    return chroma ** (1.0 / 2.2) * (0.12 + 0.88 * brightness[:, None])


def draw(lights: dict[str, ShadowLight], eclipse: Eclipse, wavelength_nm: np.ndarray, path: Path) -> None:
    """PNG: the shadow to scale with the moon in it, its light against the distance from the axis, the light curve."""
    import matplotlib  # start-up
    from matplotlib import dates, patches
    from matplotlib.figure import Figure

    name, light = next(iter(lights.items()))
    moon = eclipse.moon
    k = int(np.argmin(moon.offset_rad))
    edge = 1.05 * float(moon.penumbra_rad[k])
    grid = np.linspace(-edge, edge, PIXELS)
    away = np.hypot(*np.meshgrid(grid, grid))
    table = colours(light, wavelength_nm)
    image = np.stack([np.interp(away, light.offset_rad, table[:, c]) for c in range(3)], axis=-1)
    deg = np.degrees(edge)
    with matplotlib.rc_context({"font.size": 10, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(14.5, 4.6), layout="constrained")
        shadow, across, curve = figure.subplots(1, 3)
        shadow.imshow(image, extent=(deg, -deg, -deg, deg), origin="lower", interpolation="bilinear")
        for time in eclipse.contacts.values():
            n = int(np.argmin([abs((m - time).total_seconds()) for m in eclipse.moments]))
            at = np.degrees(moon.offset_rad[n]) * np.array([np.sin(moon.position_rad[n]), np.cos(moon.position_rad[n])])
            radius = np.degrees(moon.moon_radius_rad[n])
            shadow.add_patch(patches.Circle(tuple(at), radius, fill=False, color="w", lw=0.8))
        shadow.set(
            xlim=(deg, -deg), ylim=(-deg, deg), xlabel="east of the axis [deg]", ylabel="north of the axis [deg]"
        )
        shadow.set_title(f"{name}, a step of grey for each factor of ten", fontsize=10)
        for want, colour in zip(DRAWN_NM, ("#0072B2", "#009E73", "#E69F00", "#D55E00"), strict=True):
            w = int(np.argmin(np.abs(wavelength_nm - want)))
            offset_deg = np.degrees(light.offset_rad)
            across.semilogy(offset_deg, light.irradiance[:, w], color=colour, label=f"{wavelength_nm[w]:g} nm")
            across.semilogy(offset_deg, light.scattered[:, w], color=colour, ls=":", lw=1.0)
        for value, text in ((moon.umbra_rad[k], "umbra"), (moon.penumbra_rad[k], "penumbra")):
            across.axvline(float(np.degrees(value)), color="0.7", lw=0.8)
            across.text(float(np.degrees(value)), 1e-7, text, rotation=90, fontsize=8, ha="right")
        across.set(xlabel="from the axis [deg]", ylabel="irradiance over that without the Earth")
        across.set(xlim=(0.0, deg), ylim=(1e-8, 2.0))
        across.set_title(f"{name}; dotted: light scattered by the air", fontsize=10)
        across.legend(frameon=False, fontsize=8)
        for label, one in lights.items():
            curve.plot(eclipse.moments, magnitudes(one, moon), label=label)
        curve.invert_yaxis()
        curve.xaxis.set_major_formatter(dates.DateFormatter("%H:%M"))
        curve.set(xlabel=f"{eclipse.contacts['greatest']:%Y-%m-%d} UTC", ylabel="visual magnitude of the moon")
        curve.legend(frameon=False, fontsize=8)
        with whole_file(path) as temporary:
            figure.savefig(temporary, dpi=120)
