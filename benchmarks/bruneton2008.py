"""The tables of Bruneton and Neyret 2008 against `zones` in the same air, and the CIE clear sky (fig. 6 and 7).

    python benchmarks/bruneton2008.py error     # bruneton2008_error.csv
    python benchmarks/bruneton2008.py cie       # bruneton2008_cie.csv, ../docs/bruneton2008.png

error: his air (climates/bruneton2008.yaml, nothing refracted) at 550 nm; radiance of the sky from the ground on a grid
of directions, by his mapping and sizes, with logarithmic interpolation, with the mapping of his code of 2017, and with
a finer axis of the sun, each against `zones` in percent: signed median, and the 95th percentile without sign.
cie: luminance over that of the zenith against CIE standard sky 12, for his two aerosols.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from results import write

from twilight.atmosphere.medium import Medium
from twilight.config import load_climate
from twilight.phase import PhaseFunction
from twilight.scene.medium import climate_medium
from twilight.solvers import load
from twilight.spectrum import LUMINOUS_EFFICACY_LM_PER_W, colour_matching_functions, integrate, solar_at_visible

HERE = Path(__file__).parent
SUNS_DEG = (30.0, 10.0, 5.0, 0.0, -3.0, -6.0, -9.0, -12.0, -15.0, -18.0)
ELEVATION = np.array([1.0, 3.0, 6.0, 10.0, 15.0, 25.0, 40.0, 60.0, 80.0, 90.0])
AZIMUTH = np.array([0.0, 15.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0])
AEROSOLS = {"fig. 6": (2.0e-2, 0.76), "fig. 7": (2.2e-2, 0.73)}
"""Scattering at the ground [km^-1] and g; 0.9 of the extinction."""
CIE_SUNS_DEG = (70.0, 50.0, 30.0, 15.0, 5.0)


def air(wavelength_nm, scattering: float = 0.02, g: float = 0.76) -> Medium:
    """His air with another aerosol at the ground."""
    medium = climate_medium(load_climate("bruneton2008"), np.asarray(wavelength_nm))
    phase = (PhaseFunction.cornette_shanks(np.full(medium.n_wavelengths, g)),)
    factor = scattering / 0.02
    return replace(medium, aerosol_extinction_per_km=factor * medium.aerosol_extinction_per_km, phase_functions=phase)


def error() -> None:
    medium = air([550.0])
    grid = np.meshgrid(ELEVATION, AZIMUTH, indexing="ij")
    zones = load("zones")
    truth = zones.prepare(medium, replace(zones.QUALITIES["standard"], polarisation=False))
    exact = {sun: truth.radiance(sun, *grid)[..., 0] for sun in SUNS_DEG}
    tables = load("tables")
    standard = tables.QUALITIES["standard"]
    variants = {
        "his": standard,
        "his, half floats": replace(standard, storage="float16"),
        "his, logarithmic": replace(standard, interpolation="logarithmic"),
        "2017": tables.QUALITIES["bruneton2017"],
        "2017, 128 suns, logarithmic": replace(
            tables.QUALITIES["bruneton2017"], scattering_mu_s=128, interpolation="logarithmic"
        ),
    }
    rows = []
    for name, settings in variants.items():
        begin = time.process_time()
        field = tables.prepare(medium, settings)
        seconds = time.process_time() - begin
        for sun in SUNS_DEG:
            off = 100.0 * (field.radiance(sun, *grid)[..., 0] / exact[sun] - 1.0)
            zenith = off[-1].mean()
            row = [f"{np.median(off):.2f}", f"{np.quantile(np.abs(off), 0.95):.2f}", f"{zenith:.2f}"]
            rows.append([name, f"{field.stored_bytes / 1e6:.1f}", f"{seconds:.1f}", f"{sun:g}", *row])
            print(*rows[-1], flush=True)
    columns = ("tables", "megabytes", "cpu_s", "sun_deg", "median_percent", "p95_percent", "zenith_percent")
    notes = ["550 nm, his air; against zones standard in 80 directions; median and zenith are signed"]
    write(HERE / "bruneton2008_error.csv", columns, rows, notes=notes)


def luminance(field, medium, sun: float, elevation, azimuth) -> np.ndarray:
    seen = field.radiance(sun, elevation, azimuth)
    weight = LUMINOUS_EFFICACY_LM_PER_W * colour_matching_functions("cie1931_2deg")[:, 1]
    return integrate(seen, medium.wavelength_nm, weight * solar_at_visible("astm_g173_etr", 1.0))


def cie() -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    wavelength = [440.0, 550.0, 680.0]
    standard = load("cie")
    figure, panels = pyplot.subplots(1, 2, figsize=(11, 4.2), layout="constrained", sharey=True)
    rows = []
    grid = np.meshgrid(np.arange(2.5, 90.0, 5.0), np.arange(0.0, 181.0, 10.0), indexing="ij")
    for panel, (name, (scattering, g)) in zip(panels, AEROSOLS.items(), strict=True):
        medium = air(wavelength, scattering, g)
        field = load("tables").prepare(medium)
        reference = standard.prepare(medium, replace(standard.QUALITIES["standard"], sky_type=12, turbidity=3.0))
        for colour, sun in enumerate(CIE_SUNS_DEG):
            at_zenith = luminance(field, medium, sun, 90.0, 0.0)
            ours = luminance(field, medium, sun, *grid) / at_zenith
            theirs = reference.relative_luminance(sun, *grid)
            weight = np.cos(np.radians(grid[0]))
            ratio = np.log(ours / theirs)
            low = grid[0] < 10.0
            rows.append(
                [
                    name,
                    f"{90.0 - sun:g}",
                    f"{100 * (np.exp(np.sqrt(np.average(ratio[~low] ** 2, weights=weight[~low]))) - 1):.1f}",
                    f"{100 * (np.exp(np.average(ratio[~low], weights=weight[~low])) - 1):+.1f}",
                    f"{100 * (np.exp(np.average(ratio[low], weights=weight[low])) - 1):+.1f}",
                ]
            )
            print(*rows[-1], flush=True)
            along = np.linspace(-88.0, 88.0, 177)  # angle from the zenith, towards the sun positive
            where = 90.0 - np.abs(along), np.where(along >= 0.0, 0.0, 180.0)
            label = f"sun {90.0 - sun:g} deg from the zenith"
            panel.plot(along, luminance(field, medium, sun, *where) / at_zenith, color=f"C{colour}", label=label)
            panel.plot(along, reference.relative_luminance(sun, *where), color=f"C{colour}", ls=":")
        panel.set(yscale="log", ylim=(0.3, 60), xlabel="angle from the zenith towards the sun [deg]")
        panel.set_title(f"{name}: aerosol {scattering * 1e-3:.1e} m$^{{-1}}$, g {g:g}; dotted: CIE sky 12", fontsize=9)
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("luminance over that of the zenith")
    panels[0].legend(fontsize=7)
    figure.savefig(HERE.parent / "docs" / "bruneton2008.png", dpi=100)
    columns = ("aerosol", "sun_zenith_deg", "rms_percent", "mean_percent", "mean_below_10deg_percent")
    notes = [
        "luminance over that of the zenith, tables standard over CIE standard sky 12, weighted by solid angle;",
        "rms and mean of the logarithm above 10 deg, and the mean below 10 deg, which the paper finds too bright",
    ]
    write(HERE / "bruneton2008_cie.csv", columns, rows, notes=notes)


if __name__ == "__main__":
    {"error": error, "cie": cie}[sys.argv[1]]()
