"""The tables of Bruneton and Neyret 2008 in their own air beside the CIE clear sky: python benchmarks/bruneton2008.py

Luminance over that of the zenith against CIE standard sky 12, for their two aerosols (fig. 6 and 7 of the paper).
Writes results/bruneton2008_cie.csv and docs/bruneton2008-cie.png.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import results

from twilight.atmosphere.medium import Medium
from twilight.base.whole_files import save_figure
from twilight.config import load_climate
from twilight.numerics.phase import PhaseFunction
from twilight.numerics.spectrum import (
    LUMINOUS_EFFICACY_LM_PER_W,
    colour_matching_functions,
    integrate,
    solar_at_visible,
)
from twilight.scene.medium import climate_medium
from twilight.solvers import load

AEROSOLS = {"fig. 6": (2.0e-2, 0.76), "fig. 7": (2.2e-2, 0.73)}
"""Scattering at the ground [km^-1] and g; 0.9 of the extinction."""
CIE_SUNS_DEG = (70.0, 50.0, 30.0, 15.0, 5.0)


def air(wavelength_nm, scattering: float = 0.02, g: float = 0.76) -> Medium:
    """His air with another aerosol at the ground."""
    medium = climate_medium(load_climate("bruneton2008"), np.asarray(wavelength_nm))
    phase = (PhaseFunction.cornette_shanks(np.full(medium.n_wavelengths, g)),)
    factor = scattering / 0.02
    return replace(medium, aerosol_extinction_per_km=factor * medium.aerosol_extinction_per_km, phase_functions=phase)


def luminance(field, medium, sun: float, elevation, azimuth) -> np.ndarray:
    seen = field.radiance(sun, elevation, azimuth)
    weight = LUMINOUS_EFFICACY_LM_PER_W * colour_matching_functions("cie1931_2deg")[:, 1]
    return integrate(seen, medium.wavelength_nm, weight * solar_at_visible("astm_g173_etr", 1.0))


def cie() -> None:
    from matplotlib.figure import Figure

    wavelength = [440.0, 550.0, 680.0]
    standard = load("cie")
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    rows = []
    grid = np.meshgrid(np.arange(2.5, 90.0, 5.0), np.arange(0.0, 181.0, 10.0), indexing="ij")
    for panel, (name, (scattering, g)) in zip(panels, AEROSOLS.items(), strict=True):
        medium = air(wavelength, scattering, g)
        field = load("tables").prepare(medium, load("tables").QUALITIES["bruneton2008"])
        reference = standard.prepare(medium, replace(standard.QUALITIES["standard"], sky_type=12, turbidity=3.0))
        for colour, sun in enumerate(CIE_SUNS_DEG):
            at_zenith = luminance(field, medium, sun, 90.0, 0.0)
            ours = luminance(field, medium, sun, *grid) / at_zenith
            theirs = reference.relative_luminance(sun, *grid)
            weight = np.cos(np.radians(grid[0]))
            ratio = np.log(ours / theirs)
            low = grid[0] < 10.0
            high, near = (100.0 * (np.exp(np.average(ratio[w], weights=weight[w])) - 1.0) for w in (~low, low))
            rms = 100.0 * (np.exp(np.sqrt(np.average(ratio[~low] ** 2, weights=weight[~low]))) - 1.0)
            rows.append([name, f"{90.0 - sun:g}", f"{rms:.1f}", f"{high:+.1f}", f"{near:+.1f}"])
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
    save_figure(results.ROOT / "docs" / "bruneton2008-cie.png", figure, 90)
    columns = "aerosol sun_zenith_deg rms_percent mean_percent mean_below_10deg_percent".split()
    notes = [
        "luminance over that of the zenith, tables as in the paper over CIE standard sky 12, weighted by solid angle;",
        "rms and mean of the logarithm above 10 deg, and the mean below 10 deg, which the paper finds too bright;",
        "three wavelengths, five orders",
    ]
    results.write(results.FOLDER / "bruneton2008_cie.csv", columns, rows, notes=notes)


if __name__ == "__main__":
    results.say_help(__doc__)
    cie()
