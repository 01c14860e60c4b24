"""The tables of Bruneton and Neyret 2008 in their own air: their errors from noon to night, and the CIE clear sky.

    python benchmarks/bruneton2008.py error     # bruneton2008_error.csv, bruneton2008_horizon.csv
    python benchmarks/bruneton2008.py picture   # ../docs/bruneton2008-tables.png from both
    python benchmarks/bruneton2008.py cie       # bruneton2008_cie.csv, ../docs/bruneton2008-cie.png (fig. 6 and 7)

error: his air (climates/bruneton2008.yaml, nothing refracted) at 550 nm, seen from the ground in random directions; how
far the solver `tables` and tables filled with exact values are from `zones`, and `zones` from the reference solution.
cie: luminance over that of the zenith against CIE standard sky 12, for his two aerosols.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import results
from results import write
from tables import directions

from twilight.atmosphere.medium import Medium
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
from twilight.solvers.montecarlo import MonteCarloSettings
from twilight.solvers.tables.mapping import BRUNETON_2008, Mapping, sun_cosine
from twilight.studies.export import bruneton, sky_tables
from twilight.studies.export.field_values import FieldSource

HERE = Path(__file__).parent
SUNS_DEG = (30.3, 10.3, 5.2, 2.1, 0.2, -2.1, -4.2, -6.1, -9.1, -12.1, -15.1, -17.9)
DIRECTIONS, REFERENCE_DIRECTIONS = 400, 24
GREEN = 1
HORIZON_KM, HORIZON_SUN_DEG = 2.0, 10.3
AEROSOLS = {"fig. 6": (2.0e-2, 0.76), "fig. 7": (2.2e-2, 0.73)}
"""Scattering at the ground [km^-1] and g; 0.9 of the extinction."""
CIE_SUNS_DEG = (70.0, 50.0, 30.0, 15.0, 5.0)


def air(wavelength_nm, scattering: float = 0.02, g: float = 0.76) -> Medium:
    """His air with another aerosol at the ground."""
    medium = climate_medium(load_climate("bruneton2008"), np.asarray(wavelength_nm))
    phase = (PhaseFunction.cornette_shanks(np.full(medium.n_wavelengths, g)),)
    factor = scattering / 0.02
    return replace(medium, aerosol_extinction_per_km=factor * medium.aerosol_extinction_per_km, phase_functions=phase)


def mapping_2017() -> Mapping:
    """That of his later code, around his air."""
    return bruneton.make_mapping(6360.0, 6420.0)


def mapping_2008() -> Mapping:
    return mapping_2017()._replace(kind=BRUNETON_2008, mu_s_min=-0.2)


class Errors:
    """Rows of the table: what reads the sky at a sun, against zones."""

    def __init__(self):
        # the last is the zenith
        self.where = tuple(
            np.append(angles, last) for angles, last in zip(directions(DIRECTIONS), (90.0, 0.0), strict=True)
        )
        medium = air([440.0, 550.0, 680.0])
        zones = load("zones")
        self.truth = zones.prepare(medium, replace(zones.QUALITIES["standard"], polarisation=False))
        self.source = FieldSource(self.truth, medium, False)
        self.exact = {sun: self.truth.radiance(sun, *self.where)[..., GREEN] for sun in SUNS_DEG}
        self.rows: list[list[str]] = []

    def add(self, name: str, size: int, seconds: float, read: Callable[[float], np.ndarray]) -> None:
        for sun in SUNS_DEG:
            off = 100.0 * (read(sun) / self.exact[sun] - 1.0)
            row = [f"{np.median(off[:-1]):.2f}", f"{np.quantile(np.abs(off[:-1]), 0.95):.2f}", f"{off[-1]:.2f}"]
            self.rows.append([name, f"{size / 1e6:.1f}", f"{seconds:.1f}", f"{sun:g}", *row])
            print(*self.rows[-1], flush=True)

    def reference(self) -> None:
        """The truth itself, in some of the directions, against Monte-Carlo."""
        field = load("montecarlo").prepare(air([550.0]), MonteCarloSettings(target_stderr=0.004, polarisation=False))
        some = tuple(np.append(angles[:REFERENCE_DIRECTIONS], angles[-1]) for angles in self.where)
        for sun in SUNS_DEG:
            found = field.radiance(sun, *some)[..., 0]
            exact = np.append(self.exact[sun][:REFERENCE_DIRECTIONS], self.exact[sun][-1])
            off = 100.0 * (exact / found - 1.0)
            row = [f"{np.median(off[:-1]):.2f}", f"{np.quantile(np.abs(off[:-1]), 0.95):.2f}", f"{off[-1]:.2f}"]
            self.rows.append(["zones against montecarlo", "", "", f"{sun:g}", *row])
            print(*self.rows[-1], flush=True)


def error() -> None:
    table = Errors()
    table.reference()
    filled(table)
    solved(table)
    columns = ("tables", "megabytes", "cpu_s", "sun_deg", "median_percent", "p95_percent", "zenith_percent")
    notes = [
        f"550 nm, his air; against zones standard in {DIRECTIONS} directions above 0.3 deg; median and zenith signed",
        "solved: the solver tables; exact: texels hold what zones has; cpu_s: to solve, or to fill the lowest row of r",
        f"zones against montecarlo: in {REFERENCE_DIRECTIONS} of the directions, to 0.4 % standard error each",
    ]
    write(HERE / "bruneton2008_error.csv", columns, table.rows, notes=notes)


def filled(table: Errors) -> None:
    """Texels filled with exact values: what mapping, packing and half floats alone do; and the horizon."""
    kinds = {"2008": mapping_2008(), "2017": mapping_2017()}
    kinds["2017, 128 suns"] = kinds["2017"]._replace(n_mu_s=128)
    for name, mapping in kinds.items():
        start = time.process_time()
        made = bruneton.fill(
            table.source, np.ones(3), mapping=mapping, scale=1.0, facts={}, progress=lambda doing, share: None, rows=1
        )
        seconds, size = time.process_time() - start, sum(4 * part.size for part in made.rgba().values())

        def read(sun: float, of: bruneton.BrunetonTables, **how) -> np.ndarray:
            return bruneton.sky_radiance(of, 0.0, sun, *table.where, **how)[:, GREEN]

        table.add(f"exact, {name}", size, seconds, lambda sun, of=made: read(sun, of))
        if name in ("2008", "2017"):
            for scale in (1.0, 4096.0):
                half = replace(made, scattering=(made.scattering * scale).astype(np.float16).astype(float) / scale)
                words = f"exact, {name}, half floats" + (f" x {scale:g}" if scale > 1.0 else "")
                table.add(words, size // 2, seconds, lambda sun, of=half: read(sun, of))
        table.add(f"exact, {name}, logarithmic", size, seconds, lambda sun, of=made: read(sun, of, logarithmic=True))
    start = time.process_time()
    ours = sky_tables.fill(
        table.source, replace(sky_tables.SkyTableSizes(), altitude_km=(0.0,)), {}, lambda doing, share: None
    )
    size = len(sky_tables.SkyTableSizes().altitude_km) * ours.n_bytes
    seconds = time.process_time() - start
    table.add("exact, twilight", size, seconds, lambda sun: ours.radiance(sun, *table.where)[:, GREEN])
    horizon(table)


def horizon(table: Errors) -> None:
    """Light scattered in along lines about the horizon, at 2 km: exact and by his tables; and what a table of mu does
    that does not jump there."""
    mapping = mapping_2008()
    dip = math.degrees(math.acos(6360.0 / (6360.0 + HORIZON_KM)))
    elevation = -dip + np.arange(-1.5, 1.5001, 0.05) + 1e-4
    exact = table.truth.inscatter(
        HORIZON_SUN_DEG, elevation, 90.0, distances(elevation, HORIZON_KM), observer_altitude_km=HORIZON_KM,
        peak_passes=True,
    )[0][:, GREEN]  # fmt: skip
    tables = load("tables")
    solved = tables.prepare(air([550.0]), replace(tables.QUALITIES["standard"], max_orders=5))
    rays = solved._rays(HORIZON_SUN_DEG, elevation, np.full(elevation.size, 90.0), HORIZON_KM)
    theirs = solved.inscattered(rays)[:, 0]
    # the same number of texels, even in the elevation, across the horizon
    even = np.linspace(-90.0, 90.0, mapping.n_mu)
    light = table.truth.inscatter(
        HORIZON_SUN_DEG, even, 90.0, distances(even, HORIZON_KM), observer_altitude_km=HORIZON_KM, peak_passes=True
    )[0][:, GREEN]
    smooth = np.interp(elevation, even, light)
    lines = zip(elevation + dip, exact, theirs, smooth, strict=True)
    rows = [[f"{e:.2f}", *(f"{v:.5f}" for v in values)] for e, *values in lines]
    columns = ("from_horizon_deg", "zones_per_sr", "bruneton2008_per_sr", "even_texels_per_sr")
    notes = [
        f"550 nm, his air, from {HORIZON_KM:g} km, sun {HORIZON_SUN_DEG:g} deg, 90 deg beside it; without the ground"
    ]
    write(HERE / "bruneton2008_horizon.csv", columns, rows, notes=notes)


def distances(elevation_deg: np.ndarray, altitude_km: float) -> np.ndarray:
    """To the ground or out of the air [km]."""
    r, mu = 6360.0 + altitude_km, np.sin(np.radians(elevation_deg))
    under = (r * mu) ** 2 - (r * r - 6360.0**2)
    over = np.sqrt((r * mu) ** 2 + 6420.0**2 - r * r) - r * mu
    return np.where((mu < 0.0) & (under > 0.0), -r * mu - np.sqrt(np.maximum(under, 0.0)), over)


def solved(table: Errors) -> None:
    """The solver, which fills its tables from each other."""
    tables, medium = load("tables"), air([550.0])
    standard = tables.QUALITIES["standard"]
    later = tables.QUALITIES["bruneton2017"]
    variants = {
        "solved, 2008": standard,
        "solved, 2017": later,
        "solved, 2017, 128 suns, logarithmic": replace(later, scattering_mu_s=128, interpolation="logarithmic"),
    }
    for name, settings in variants.items():
        begin = time.process_time()
        field = tables.prepare(medium, settings)
        seconds = time.process_time() - begin
        table.add(name, field.stored_bytes, seconds, lambda sun, of=field: of.radiance(sun, *table.where)[..., 0])


def picture() -> None:
    from matplotlib import pyplot

    rows = results.read_rows(HERE / "bruneton2008_error.csv")
    figure, panels = pyplot.subplots(1, 3, figsize=(14, 4.4), layout="constrained")
    shown = {
        "solved, 2008": ("solved as in the paper", "C3", "-"),
        "solved, 2017, 128 suns, logarithmic": ("solved, 128 suns, logarithms", "C1", "-"),
        "exact, 2008": ("his texels, exact values", "C3", ":"),
        "exact, 2017": ("of his code of 2017, exact", "C0", ":"),
        "exact, 2017, 128 suns, logarithmic": ("the same, 128 suns, logarithms", "C0", "--"),
        "exact, twilight": ("layout twilight", "C2", "-"),
        "zones against montecarlo": ("zones against montecarlo", "0.5", "-"),
    }
    for name, (label, colour, line) in shown.items():
        points = [(float(row["sun_deg"]), float(row["p95_percent"])) for row in rows if row["tables"] == name]
        panels[0].plot(*zip(*points, strict=True), color=colour, ls=line, marker=".", label=label)
    panels[0].set(yscale="log", ylim=(0.1, 1e4), xlim=(31, -19), xlabel="elevation of the sun [deg]")
    panels[0].set_ylabel("error, 95th percentile of the sky [%]")
    panels[0].legend(fontsize=7)
    for name, mapping, colour in (
        ("2008", mapping_2008(), "C3"),
        ("2017", mapping_2017(), "C0"),
    ):
        suns = np.degrees(np.arcsin([sun_cosine(mapping, j) for j in range(mapping.n_mu_s)]))
        panels[1].plot(suns[1:], np.diff(suns), color=colour, marker=".", label=f"his of {name}: {suns.size} texels")
    suns = sky_tables.sun_nodes(sky_tables.SkyTableSizes().suns)
    panels[1].plot(suns[1:], np.diff(suns), color="C2", marker=".", label=f"layout twilight: {suns.size} texels")
    panels[1].set(yscale="log", xlim=(31, -31), xlabel="elevation of the sun [deg]")
    panels[1].set_ylabel("from one texel to the next [deg]")
    panels[1].legend(fontsize=7)
    lines = results.read_numbers(HERE / "bruneton2008_horizon.csv")
    for key, label, style in (
        ("zones_per_sr", "zones", "k-"),
        ("bruneton2008_per_sr", "his tables", "C3--"),
        ("even_texels_per_sr", "128 even texels across the horizon", "C1:"),
    ):
        panels[2].plot(lines["from_horizon_deg"], lines[key], style, label=label)
    panels[2].set(xlabel="elevation from the horizon [deg]", ylabel=r"scattered in [sr$^{-1}$]")
    panels[2].set_title(f"from {HORIZON_KM:g} km, sun {HORIZON_SUN_DEG:g} deg", fontsize=9)
    panels[2].legend(fontsize=7)
    for panel in panels:
        panel.grid(alpha=0.3)
    figure.savefig(HERE.parent / "docs" / "bruneton2008-tables.png", dpi=90)


def luminance(field, medium, sun: float, elevation, azimuth) -> np.ndarray:
    seen = field.radiance(sun, elevation, azimuth)
    weight = LUMINOUS_EFFICACY_LM_PER_W * colour_matching_functions("cie1931_2deg")[:, 1]
    return integrate(seen, medium.wavelength_nm, weight * solar_at_visible("astm_g173_etr", 1.0))


def cie() -> None:
    from matplotlib import pyplot

    wavelength = [440.0, 550.0, 680.0]
    standard = load("cie")
    figure, panels = pyplot.subplots(1, 2, figsize=(11, 4.2), layout="constrained", sharey=True)
    rows = []
    grid = np.meshgrid(np.arange(2.5, 90.0, 5.0), np.arange(0.0, 181.0, 10.0), indexing="ij")
    for panel, (name, (scattering, g)) in zip(panels, AEROSOLS.items(), strict=True):
        medium = air(wavelength, scattering, g)
        begin = time.process_time()
        field = load("tables").prepare(medium, load("tables").QUALITIES["bruneton2008"])
        cost = [f"{field.stored_bytes / 1e6:.1f}", f"{time.process_time() - begin:.0f}"]
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
                    *cost,
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
    figure.savefig(HERE.parent / "docs" / "bruneton2008-cie.png", dpi=90)
    columns = (
        "aerosol",
        "sun_zenith_deg",
        "rms_percent",
        "mean_percent",
        "mean_below_10deg_percent",
        "megabytes",
        "cpu_s",
    )
    notes = [
        "luminance over that of the zenith, tables as in the paper over CIE standard sky 12, weighted by solid angle;",
        "rms and mean of the logarithm above 10 deg, and the mean below 10 deg, which the paper finds too bright;",
        "three wavelengths, five orders; cpu_s to fill the tables",
    ]
    write(HERE / "bruneton2008_cie.csv", columns, rows, notes=notes)


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    {"error": error, "picture": picture, "cie": cie}[sys.argv[1]]()
