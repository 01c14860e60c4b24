"""Claims of the three papers, measured: what docs/three-papers.md says.

    python benchmarks/three_papers.py [CLAIM ...]      writes results/three_papers.csv after every row

Each claim is a function here.  What it has found is kept in out/three-papers with the digest of the code, and taken
from there by a run of the same code: a run that was stopped goes on where it was.  With names these claims alone are
measured, again; rows of others that no kept ones of this code replace stay, with a note.
Errors are percentages over directions, "95 %" their 95th percentile.  `seconds` is the processor time of the claim up
to the row, without skies that were kept (S = 120, 8 events, 2 wavelengths: 79 s a sun; S = 92: 10; S = 72, all shells:
50).  Haber's cells are S = 72 to 120, whose shells all have cells but three at S = 72.
"""

from __future__ import annotations

import argparse
import math
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import results
from memory import measured

from twilight.atmosphere.medium import Medium
from twilight.base.digest import DISPLAY, code_digest
from twilight.config import load
from twilight.engine import solve
from twilight.scene import resolve
from twilight.solvers import cells, montecarlo, tables, zones
from twilight.solvers.analytic import aerial
from twilight.solvers.analytic.coefficients import load_coefficients
from twilight.solvers.cells.direct_light import refracted_sun
from twilight.solvers.cells.exchange import energy_ratio, full_turn
from twilight.solvers.cells.grid import layer_of, make_grid, make_layers
from twilight.solvers.cells.haber import CellsField as Field
from twilight.studies.compare.accuracy import colour_errors
from twilight.studies.fit.truth import compute_truth, error_of
from twilight.transport.ray_profile import ray_profile
from twilight.transport.rays import OUTSIDE, sun_ray

Row = tuple[str, str]
SUNS_DEG = (10.0, 0.0, -6.0)
FEW_SUNS_DEG = (10.0, -6.0)
"""Suns of what is solved again with other settings."""
ELEVATION_DEG = (5.0, 15.0, 25.0, 45.0, 85.0)
AZIMUTH_DEG = (0.0, 45.0, 90.0, 180.0)
EVENTS = 8
"""Scattering events beside which fewer are judged; one more adds less than 1e-4 in the median."""
MODULES = ("cells", "zones", "tables", "montecarlo", "analytic")
TABLE = results.FOLDER / "three_papers.csv"
KEPT = results.Kept("three-papers", code_digest(*(f"twilight.solvers.{m}" for m in MODULES), without=DISPLAY))


def directions(elevation_deg: tuple[float, ...], azimuth_deg: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """All pairs, flat."""
    elevation, azimuth = np.meshgrid(elevation_deg, azimuth_deg, indexing="ij")
    return elevation.ravel(), azimuth.ravel()


HIS = directions(ELEVATION_DEG, AZIMUTH_DEG)


def off(value: np.ndarray, right: np.ndarray) -> str:
    """Median and 95th percentile of the relative error."""
    error = 100.0 * np.abs(value / right - 1.0)
    return f"{np.median(error):.2g} % (median), {np.percentile(error, 95):.2g} % (95 %)"


def his_air(nm: tuple[float, ...], **air: object) -> Medium:
    """His air at some wavelengths; air: settings of the climate."""
    keys = {key.replace("__", "."): value for key, value in air.items()}
    return resolve(load("haber2005", {"wavelengths": {"list_nm": list(nm)}, **keys})).medium


def skies(name: str, sun: float, medium: Medium, settings: cells.CellsSettings, grid=None) -> np.ndarray:
    """Light of a field of his cells after each event, (events, 20, W), in the directions HIS; kept by name."""
    name = f"sky-{name}{sun:+g}"
    kept = KEPT.rows(name)
    if kept is None:
        field, h = Field(medium, settings, 0.0, grid=grid), math.radians(sun)
        towards = np.array([math.cos(h), 0.0, math.sin(h)])
        seen = (field.texture.radiance(*light, towards) for light in field.events(towards))
        kept = [field.texture.interpolate(sky, *HIS).tolist() for sky in seen]
        KEPT.keep(name, kept)
    return np.array(kept)


@cache
def preset_sky(sun: float) -> np.ndarray:
    """The preset at 380 and 550 nm, S = 120, after 1 to EVENTS events."""
    settings = replace(cells.QUALITIES["haber2005"], max_orders=EVENTS)
    return skies("preset", sun, his_air((380.0, 550.0)), settings)


def haber(cells_around: int, sun: float, name: str = "", medium: Medium | None = None, **changes: object) -> np.ndarray:
    """His five events at 550 nm with S cells around; name: of what is changed."""
    settings = replace(cells.QUALITIES["haber2005"], azimuth_cells=cells_around, **changes)  # type: ignore[arg-type]
    return skies(f"{cells_around}{name}", sun, medium or his_air((550.0,)), settings)[-1, :, 0]


def preset() -> Iterator[Row]:
    """ "Less than two hours", "up to 100 MB of memory": the published run as the command makes it."""
    with tempfile.TemporaryDirectory() as folder:
        sky = ("render", "haber2005", "--output", f"{folder}/sky", "--overwrite")
        small = (*sky, "--set", "solver.azimuth_cells=14")
        measured(small)  # makes machine code
        n_bytes, cpu_s, _ = measured(small)
        yield "the same command with S = 14: processor time, memory", f"{cpu_s:.0f} s, {n_bytes / 1e6:.0f} MB"
        n_bytes, cpu_s, _ = measured(sky)
        yield "S = 120, 8 wavelengths, five events: processor time, memory", f"{cpu_s:.0f} s, {n_bytes / 1e6:.0f} MB"


def events() -> Iterator[Row]:
    """ "Four scattering events ... less than 1 % maximum error"; single and multiple differ by up to 20 % (S = 120)."""
    for sun in SUNS_DEG:
        light = preset_sky(sun)
        share = 100.0 * light[0, :, 1] / light[-1, :, 1]
        yield (
            f"sun {sun:+g}: light scattered once, of all, 550 nm",
            f"{np.median(share):.3g} % (median), {share.min():.2g} to {share.max():.3g} %",
        )
        for n in (4, 5):
            error = 100.0 * (1.0 - light[n - 1] / light[-1])
            yield f"sun {sun:+g}: missing after {n} events", f"{np.median(error):.2g}, at most {error.max():.2g} %"


def own_error() -> Iterator[Row]:
    """The preset beside Monte-Carlo in his own air, 550 nm."""
    medium = his_air((550.0,))
    settings = replace(montecarlo.QUALITIES["standard"], target_stderr=0.01)
    exact = montecarlo.prepare(medium, settings)
    for sun in SUNS_DEG:
        right = exact.radiance_with_error(sun, *HIS)
        own = 100.0 * np.median(right.standard_error / right.radiance)
        error = 100.0 * (preset_sky(sun)[4, :, 1] / right.radiance[:, 0] - 1.0)
        yield (
            f"sun {sun:+g}: S = 120 beside Monte-Carlo (standard error {own:.1g} %)",
            f"{off(preset_sky(sun)[4, :, 1], right.radiance[:, 0])}; {error.mean():+.2g} % in the mean",
        )


def shells() -> Iterator[Row]:
    """Active shells are "indistinguishable from complete-shell simulations" (S = 72)."""
    for sun in FEW_SUNS_DEG[:1]:
        every = haber(72, sun, "-all", active_shell_step=1)
        for step in (2, 4):
            factor = ((72 + math.pi) / (72 - math.pi)) ** step
            value = off(haber(72, sun, f"-{step}", active_shell_step=step), every)
            yield f"sun {sun:+g}: S = 72, active shells a factor {factor:.2f} of radius apart", value
    medium = his_air((550.0,))
    for s, step in ((72, 2), (72, 4), (92, 4), (120, 4)):
        settings = replace(cells.QUALITIES["haber2005"], azimuth_cells=s, active_shell_step=step)
        field = Field(medium, settings, 0.0)
        for sun in FEW_SUNS_DEG:
            h = math.radians(sun)
            light = sum(next(field.events(np.array([math.cos(h), 0.0, math.sin(h)]))))
            ratio = energy_ratio(light @ full_turn(s), field.active)[0]
            yield f"sun {sun:+g}: S = {s}, I_all / I_active with every shell no. {step} active", f"{ratio:.2f}"


def sizes() -> Iterator[Row]:
    """How far smaller numbers of cells are from his; their volume over that of the air within R_max."""
    medium = his_air((550.0,))
    for s in (36, 60, 72, 92, 120, 180):
        grid = make_grid(s, 0.1, 0.0, 0.0, medium.top_km, medium.earth_radius_km)
        volume = s * grid.ring_volume_km3.sum() / air_volume_km3(medium)
        gaps = f"{grid.shells_without_cells.size} of {grid.n_shells} shells without cells"
        yield f"S = {s}: volume of the cells over that of the air", f"{volume:.2f}; {gaps}"
    for sun in FEW_SUNS_DEG:
        for s in (60, 72, 92):
            yield f"sun {sun:+g}: S = {s} beside S = 120", off(haber(s, sun), preset_sky(sun)[4, :, 1])


def air_volume_km3(medium: Medium) -> float:
    """Volume of the air within R_max of an observer on the ground."""
    earth, top = medium.earth_radius_km, medium.top_km
    edge = np.linspace(0.0, math.sqrt(top * (top + 2.0 * earth)), 20001)
    r = 0.5 * (edge[1:] + edge[:-1])
    highest = np.clip(((earth + top) ** 2 - earth**2 - r**2) / (2.0 * earth * r), -1.0, 1.0)
    lowest = -r / (2.0 * earth)
    return float(np.sum(2.0 * np.pi * r**2 * (highest - lowest) * np.diff(edge)))


def similarity() -> Iterator[Row]:
    """(1 - g) of aerosol's scattering, eq. (2): sections 4.6.2 and 4.5.3, and extinction (S = 92)."""
    for sun in FEW_SUNS_DEG:
        his = haber(92, sun)
        early = haber(92, sun, "-second", effective_from_event=2)
        more = 100.0 * (his / early - 1.0)
        yield f"sun {sun:+g}: from the third event (4.6.2) over from the second (4.5.3)", f"{np.median(more):+.2g} %"
        closed = haber(92, sun, "-closed", reduce_extinction=True)
        yield f"sun {sun:+g}: (1 - g) in scattering alone, against extinction too", off(his, closed)


def layers() -> Iterator[Row]:
    """ "We typically use 20-50 layers" (S = 92)."""
    for sun in (10.0, -4.0):
        few = his_air((550.0,), atmosphere__layers={"equal_air_mass": 20, "coefficients": "centre"})
        yield f"sun {sun:+g}: 20 layers beside 50", off(haber(92, sun, "-20-layers", few), haber(92, sun))


def beyond() -> Iterator[Row]:
    """Air along the circumference of the volume "we neglect": shells to 1.5 R_max (S = 92)."""
    medium = his_air((550.0,))
    settings = replace(cells.QUALITIES["haber2005"], azimuth_cells=92)
    wide = make_grid(92, 0.1, 0.0, 0.0, medium.top_km, medium.earth_radius_km, reach=1.5)
    for sun in FEW_SUNS_DEG:
        more = skies("92-beyond", sun, medium, settings, wide)[-1, :, 0]
        brighter = np.median(more / haber(92, sun))
        yield f"sun {sun:+g}: light with shells to 1.5 R_max over that to R_max", f"{brighter:.3g} times (median)"


def isotropic_air() -> Iterator[Row]:
    """ "It is safe to approximate ... scattering by air molecules as being isotropic": light scattered once."""
    for angle in (0.0, 90.0, 180.0):
        rayleigh = 0.75 * (1.0 + math.cos(math.radians(angle)) ** 2)
        yield f"isotropic over Rayleigh's, {angle:g} deg from the sun", f"{100.0 * (1.0 / rayleigh - 1.0):+.0f} %"


def shadow() -> Iterator[Row]:
    """Why light scattered once ends at -6 deg: the lowest sunlit air above the observer (straight rays)."""
    earth = 6371.0
    for sun in (-4.0, -6.0):
        yield (
            f"sun {sun:+g}: height of the Earth's shadow at the zenith",
            f"{earth * (1.0 / math.cos(math.radians(sun)) - 1.0):.1f} km",
        )


def his_field(**changes: object):
    """`zones` in his air, and its settings as of a scene."""
    keys = {key.replace("__", "."): value for key, value in changes.items()}
    base = {"solver": {"name": "zones", "quality": "draft", "polarisation": False, "bent_lines_of_sight": False}}
    return solve(resolve(load("haber2005", {**base, **keys})), (10.0, 8.0, 0.0, -3.0))


def colours() -> Iterator[Row]:
    """Eight wavelengths from 380 to 720 nm give "almost exactly the same" as sixteen (`zones` in his air)."""
    nm = {n: np.linspace(380.0, 720.0, n) for n in (8, 16, 40)}
    fields = {n: his_field(wavelengths__count=n) for n in nm}
    for sun in (8.0, 0.0, -3.0):
        light = {n: field.radiance(sun, *HIS) for n, field in fields.items()}
        for n in (16, 40):
            found = colour_errors(
                light[8], light[n], None, nm[8], nm[n], solar_spectrum="kurucz1992", observer="cie1964_10deg"
            )
            assert found is not None
            text = f"{found.ciede2000.median:.2g} (median), {found.ciede2000.largest:.2g} at most"
            yield f"sun {sun:+g}: CIEDE2000 of 8 wavelengths beside {n}", text


def details() -> Iterator[Row]:
    """ "Virtually no details are lost at 3 deg intervals": linear between them (`zones` in his air, 550 nm)."""
    field = his_field(wavelengths={"list_nm": [550.0]})
    rows, columns = np.arange(1.5, 90.0, 3.0), np.arange(0.0, 181.0, 3.0)
    for sun in (10.0, 0.0, -3.0):
        known = field.radiance(sun, *np.meshgrid(rows, columns, indexing="ij"))[..., 0]
        e, a = np.meshgrid(0.5 * (rows[1:] + rows[:-1]), 0.5 * (columns[1:] + columns[:-1]), indexing="ij")
        between = 0.25 * (known[1:, 1:] + known[:-1, 1:] + known[1:, :-1] + known[:-1, :-1])
        right = field.radiance(sun, e, a)[..., 0]
        error = 100.0 * np.abs(between / right - 1.0)
        yield f"sun {sun:+g}: in the middle of four directions", f"{off(between, right)}, {error.max():.2g} % at most"


def ground() -> Iterator[Row]:
    """ "The sky becomes brighter, but not different in color" over reflecting ground (`zones` in his air)."""
    nm = np.linspace(380.0, 720.0, 8)
    dark = his_field()
    for albedo in (0.15, 0.9):
        bright = his_field(ground__albedo=albedo)
        for sun in (10.0, -3.0):
            over, under = bright.radiance(sun, *HIS), dark.radiance(sun, *HIS)
            brighter = np.median(over[:, 3] / under[:, 3])
            as_bright = under * (over[:, 3:4] / under[:, 3:4])
            found = colour_errors(over, as_bright, None, nm, nm, solar_spectrum="kurucz1992", observer="cie1964_10deg")
            assert found is not None
            yield (
                f"sun {sun:+g}: albedo {albedo:g} beside 0",
                f"{brighter:.3g} times at {nm[3]:.0f} nm; CIEDE2000 at that brightness "
                f"{found.ciede2000.median:.2g} (median), {found.ciede2000.largest:.2g} at most",
            )


def simplified_air() -> Iterator[Row]:
    """Air up to 35 km, and ozone as a filter on the vertical column: the default solver in continental air."""
    e, a = directions((3.0, 10.0, 25.0, 45.0, 85.0), AZIMUTH_DEG)
    suns = (22.0, 8.0, 5.0, 0.0, -2.0, -4.0, -6.0)
    changes = {
        "top at 35 km": {"atmosphere.top_km": 35.0},
        "ozone a filter": {"gases.ozone.treatment": "overhead_filter"},
    }
    fields = {
        name: solve(resolve(load("continental-average", {"solver.quality": "draft", **change})), suns)
        for name, change in {"": {}, **changes}.items()
    }
    for name in changes:
        for sun in suns:
            yield f"sun {sun:+g}: {name}", off(fields[name].radiance(sun, e, a), fields[""].radiance(sun, e, a))


def search() -> Iterator[Row]:
    """ "The binary search converges in 5 to 15 steps", to 0.1 deg."""
    yield from search_in(resolve(load("haber2005", {})).medium, "his index at 80 % humidity")
    dry = resolve(load("haber2005", {"refraction.relative_humidity_percent": 0})).medium
    yield from search_in(dry, "the same index of dry air")


def search_in(medium, what: str) -> Iterator[Row]:
    """The binary search beside rays in the smooth index, and the time of a cell and wavelength."""
    layers, profile = make_layers(medium, False), ray_profile(medium)
    lifts, depths, places = [], [], []
    for altitude in (0.05, 0.5, 2.0, 5.0, 10.0, 20.0):
        for apparent in (-2.0, -1.0, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 40.0):
            radius = (medium.earth_radius_km + altitude) * (1.0 + medium.at(altitude).refractivity[3])
            bending, depth, status = sun_ray(profile, 3, altitude, radius * math.sin(math.radians(apparent)), 0.0)
            if status == OUTSIDE:
                lifts.append(bending)
                depths.append(depth)
                places.append((altitude, math.radians(apparent) - bending))
    z, sun = np.array(places).T
    refracted_sun(layers, z[:1], layer_of(layers, z[:1]), sun[:1], math.radians(0.1))
    begun = time.process_time()
    for _ in range(100):
        lift, depth, steps = refracted_sun(layers, z, layer_of(layers, z), sun, math.radians(0.1))
    each = 1e6 * (time.process_time() - begun) / (100 * lift.size)
    lit = ~np.isnan(lift[:, 3])
    error = np.degrees(np.abs(lift[lit, 3] - np.array(lifts)[lit]))
    yield f"{what}: lift by the search, off", f"{np.median(error):.2g}, at most {error.max():.2g} deg"
    tau = 100.0 * np.abs(depth[lit, 3] / np.array(depths)[lit] - 1.0)
    yield f"{what}: optical depth of that path, off", f"{np.median(tau):.2g}, at most {tau.max():.2g} %"
    yield (
        f"{what}: steps",
        f"{steps[lit].min():.0f} to {steps[lit].max():.0f}, median {np.median(steps[lit]):.0f}",
    )
    yield f"{what}: cells that it leaves in shadow, of {lit.size} lit ones", f"{(~lit).sum()}"
    yield f"{what}: processor time of one search, from Python", f"{each:.2g} us"


def without_refraction() -> Medium:
    """Continental air without refraction at 550 nm."""
    at = np.array([550.0])
    return resolve(load("continental-average", {"refraction.model": "none"}), wavelength_nm=at).medium


def bruneton_suns() -> Iterator[Row]:
    """Why his tables are off in twilight: beside `zones` in the same air, both with two orders, then with all."""
    yield from beside_zones("32 x 128 x 32 x 8 texels", {})
    yield from beside_zones("64 suns", {"scattering_mu_s": 64})
    yield from beside_zones("128 suns", {"scattering_mu_s": 128})
    yield from beside_zones("32 x 128 x 32 x 8 texels", {}, two_orders=False)


def bruneton_angles() -> Iterator[Row]:
    """The same with more angles of scattering."""
    yield from beside_zones("16 angles of scattering", {"scattering_nu": 16})
    yield from beside_zones("16 angles of scattering, 64 suns", {"scattering_nu": 16, "scattering_mu_s": 64})


def beside_zones(name: str, sizes: dict[str, int], two_orders: bool = True) -> Iterator[Row]:
    """His tables of some sizes beside `zones` in the same air."""
    medium, printed = without_refraction(), tables.QUALITIES["bruneton2008"]
    e, a = directions((2.0, 5.0, 10.0, 20.0, 40.0, 60.0, 88.0), (0.0, 30.0, 60.0, 90.0, 135.0, 180.0))
    scalar = replace(zones.QUALITIES["standard"], polarisation=False)
    if two_orders:
        printed, scalar = replace(printed, max_orders=2), replace(scalar, max_orders=2)
    field, exact = tables.prepare(medium, replace(printed, **sizes)), zones.prepare(medium, scalar)
    for sun in (30.0, 0.0, -4.0):
        made, right = field.radiance(sun, e, a), exact.radiance(sun, e, a)
        low = 100.0 * (made / right - 1.0)[e == 2.0]
        orders = "two orders" if two_orders else "his five orders beside all"
        yield f"{name}, {orders}, sun {sun:+g}", f"{off(made, right)}; at 2 deg {low.min():+.2g} to {low.max():+.2g} %"


def bruneton_transmittance() -> Iterator[Row]:
    """His T, which is of the delta-scaled air here, beside Beer's law."""
    medium = without_refraction()
    field = tables.prepare(medium, replace(tables.QUALITIES["bruneton2008"], max_orders=1))
    vertical = field.scaled.medium.optical_depth("total") / medium.optical_depth("total")
    yield "optical depth of the delta-scaled air over that of the air, straight up", f"{vertical.min():.3f}"
    altitude = np.array([0.0])
    level = field.scaled.medium.at(altitude).extinction / medium.at(altitude).extinction
    yield "the same of its extinction at the ground", f"{level.min():.3f}"
    nm = (440.0, 550.0, 680.0)
    own = resolve(load("bruneton2008", {}), wavelength_nm=np.array(nm)).medium
    made = tables.prepare(own, replace(tables.QUALITIES["bruneton2008"], max_orders=1))
    beam = [ray_profile(medium) for medium in (own, made.scaled.medium)]
    for w, each in enumerate(nm):
        depth = [sun_ray(profile, w, 0.0, 0.0, 0.0)[1] for profile in beam]
        yield f"T over Beer's law on the horizon of his own air, {each:g} nm", f"{math.exp(depth[0] - depth[1]):.3f}"


def preetham_index() -> Iterator[Row]:
    """n of air, 1.0003 as printed."""
    printed = aerial.air_scattering_per_km(np.array([440.0, 550.0]))
    real = printed * (((1.0 + 2.78e-4) ** 2 - 1.0) / ((1.0 + 3e-4) ** 2 - 1.0)) ** 2
    passed = np.exp(-50.0 * (real - printed))
    yield "air's transmittance over 50 km level, real index over printed, 440 nm", f"{passed[0]:.3g}"


def preetham_procedure() -> Iterator[Row]:
    """His published set beside skies of his air: his haze, 343 directions, suns of his range; ln of luminance."""
    own = load_coefficients("preetham1999")
    for what, orders in (("light scattered once and twice", 2), ("every order", 60)):
        settings = {"solver.quality": "draft", "solver.max_orders": orders, "ground.albedo": 0.0}
        truth = compute_truth(
            load("continental-average", settings), (2.0, 4.0, 6.0), (5.0, 30.0, 55.0, 75.0), 343, "preetham1999"
        )
        error = error_of(own, truth.skies)
        yield f"published set over skies of {what}, mean ln", f"{error.luminance_bias:+.2f}"
        yield f"shape of the distributions beside them, {what}", f"{100 * error.distribution_median:.2g} % (median)"


HABER = (search, events, own_error, shells, sizes, similarity, layers, beyond, isotropic_air, shadow, colours, details)
CLAIMS: dict[str, tuple[str, Callable[[], Iterator[Row]]]] = {
    **{one.__name__: ("Haber", one) for one in (*HABER, ground, simplified_air)},
    **{one.__name__: ("Bruneton", one) for one in (bruneton_transmittance, bruneton_suns, bruneton_angles)},
    **{one.__name__: ("Preetham", one) for one in (preetham_index, preetham_procedure)},
    "preset": ("Haber", preset),
}


def processor_s() -> float:
    """Processor time of this program and of those that it ran [s]."""
    return time.process_time() + resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime


def write(known: dict[str, list]) -> None:
    """The table of what is known; rows of other claims stay, under a note of the heading that they were made under."""
    heading, *notes = (line[2:] for line in TABLE.read_text(encoding="utf-8").splitlines() if line.startswith("# "))
    old: dict[str, list] = {}
    for row in results.read_rows(TABLE):
        old.setdefault(row["claim"], []).append([row["what"], row["measured"], row.get("seconds") or ""])
    made_by = dict.fromkeys(old, heading)
    for note in notes:
        names, _, earlier = note.removeprefix("rows of ").partition(": ")
        made_by |= dict.fromkeys(names.split(", "), earlier)
    lines = [[CLAIMS[n][0], n, *row] for n in CLAIMS for row in known.get(n) or old.get(n) or ()]
    of_heading: dict[str, list[str]] = {}
    for name in CLAIMS:
        if name in old and not known.get(name):
            of_heading.setdefault(made_by[name], []).append(name)
    results.write(TABLE, ["paper", "claim", "what", "measured", "seconds"], lines,
                  notes=[f"rows of {', '.join(names)}: {made}" for made, names in of_heading.items()],
                  command="python benchmarks/three_papers.py")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("claims", nargs="*", metavar="CLAIM", help=f"of {', '.join(CLAIMS)}; none: what is not known")
    names = parser.parse_args().claims
    if unknown := [name for name in names if name not in CLAIMS]:
        parser.error(f"{unknown[0]} is no claim; there are {', '.join(CLAIMS)}")
    known = {name: KEPT.rows(name) for name in CLAIMS}
    for name in names or [name for name in CLAIMS if known[name] is None]:
        begun, rows = processor_s(), []
        for row in CLAIMS[name][1]():
            rows.append([*row, f"{processor_s() - begun:.0f}"])
            print(name, *rows[-1], sep="\t", flush=True)
            others = {n: KEPT.rows(n) for n in CLAIMS}  # of other runs at the same time too
            write({**others, name: rows})
        KEPT.keep(name, rows)
    write({name: KEPT.rows(name) for name in CLAIMS})


if __name__ == "__main__":
    main()
