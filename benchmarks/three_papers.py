"""Claims of the three papers, measured: what docs/three-papers.md says.

    python benchmarks/three_papers.py [CLAIM ...]      writes results/three_papers.csv

Each claim is a function here.  What a claim has found is kept in out/three-papers with the version of the program, and
taken from there by a run of the same version: a run that was stopped goes on where it was.  With names these claims
alone are measured, again, and the rows of the others stay in the table if they are of the same version.
Errors are percentages over directions, "95 %" their 95th percentile.  13 processor minutes in all, of which `preset`
takes three (S = 120; every other claim of Haber's cells is of S = 36 to 72) and `bruneton_suns` five.
"""

from __future__ import annotations

import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import results
from memory import measured

from twilight.atmosphere.medium import Medium
from twilight.config import load
from twilight.engine import solve
from twilight.scene import resolve
from twilight.solvers import cells, tables, zones
from twilight.solvers.analytic import aerial
from twilight.solvers.analytic.coefficients import load_coefficients
from twilight.solvers.cells.direct_light import refracted_sun
from twilight.solvers.cells.grid import layer_of, make_layers
from twilight.studies.compare.accuracy import colour_errors
from twilight.studies.fit.truth import compute_truth, error_of
from twilight.transport.ray_profile import ray_profile
from twilight.transport.rays import OUTSIDE, sun_ray

Row = tuple[str, str]
SUNS_DEG = (10.0, 0.0, -3.0, -6.0)
AZIMUTH_DEG = (0.0, 45.0, 90.0, 180.0)
FOUND = results.ROOT / "out" / "three-papers"


def directions(elevation_deg: tuple[float, ...], azimuth_deg: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """All pairs, flat."""
    elevation, azimuth = np.meshgrid(elevation_deg, azimuth_deg, indexing="ij")
    return elevation.ravel(), azimuth.ravel()


def off(value: np.ndarray, right: np.ndarray) -> str:
    """Median and 95th percentile of the relative error."""
    error = 100.0 * np.abs(value / right - 1.0)
    return f"{np.median(error):.2g} % (median), {np.percentile(error, 95):.2g} % (95 %)"


def haber_light(azimuth_cells: int, sun: float, wavelengths: int = 8, **changes: object) -> np.ndarray:
    """Light of his system in his air in directions that are middles of rows of S = 36 and 48."""
    scene = resolve(load("haber2005", {"wavelengths.count": wavelengths}))
    settings = replace(scene.settings, azimuth_cells=azimuth_cells, **changes)  # type: ignore[arg-type]
    elevations = (5.0, 15.0, 25.0, 45.0, 85.0) if azimuth_cells == 36 else (3.75, 11.25, 26.25, 48.75, 86.25)
    return cells.prepare(scene.medium, settings).radiance(sun, *directions(elevations, AZIMUTH_DEG))


def preset() -> Iterator[Row]:
    """ "Less than two hours", "up to 100 MB of memory": a sky of the preset as the command makes it."""
    code = (
        "import resource, twilight.cli, twilight.engine, twilight.solvers.cells.solver as _;"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    env = {**os.environ, "PYTHONPATH": str(results.ROOT)}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    yield "memory of the interpreter and what it imports", f"{int(done.stdout) * 1024 / 1e6:.0f} MB"
    with tempfile.TemporaryDirectory() as folder:
        sky = ("render", "haber2005", "--output", f"{folder}/sky", "--overwrite")
        measured((*sky, "--set", "solver.azimuth_cells=12"))  # makes machine code
        n_bytes, _, _ = measured((*sky, "--set", "solver.azimuth_cells=12"))
        yield "memory of the program that draws a sky of S = 12", f"{n_bytes / 1e6:.0f} MB"
        for cells_around in (60, 72):
            _, cpu_s, _ = measured((*sky, "--set", f"solver.azimuth_cells={cells_around}"))
            yield f"processor time of a sky of S = {cells_around}", f"{cpu_s:.0f} s"
        n_bytes, cpu_s, _ = measured((*sky, "--set", "solver.max_orders=2", "--only", "h5"))
        yield (
            "memory of the program that computes a sky of S = 120 and stores it, two events",
            f"{n_bytes / 1e6:.0f} MB",
        )
        yield "processor time of that", f"{cpu_s:.0f} s"


def events() -> Iterator[Row]:
    """ "Four scattering events ... less than 1 % maximum error"; single and multiple differ by up to 20 %."""
    for sun in SUNS_DEG:
        orders = {n: haber_light(48, sun, max_orders=n) for n in (1, 4, 5, 10)}
        share = 100.0 * np.median(orders[1] / orders[10])
        yield f"sun {sun:+g}: light scattered once, of all", f"{share:.3g} % (median)"
        for n in (4, 5):
            error = 100.0 * (1.0 - orders[n] / orders[10])
            yield f"sun {sun:+g}: missing after {n} events", f"{np.median(error):.2g}, at most {error.max():.2g} %"


def shells() -> Iterator[Row]:
    """Active shells are "indistinguishable from complete-shell simulations" (S = 36)."""
    for sun in (10.0, -3.0):
        every = haber_light(36, sun, active_shell_step=1)
        for step in (2, 4):
            value = off(haber_light(36, sun, active_shell_step=step), every)
            yield f"sun {sun:+g}: every {'second' if step == 2 else 'fourth'} shell active", value


def sizes() -> Iterator[Row]:
    """How far from fine cells the cells of the other claims are."""
    for sun in (10.0, -3.0):
        e, a = directions((5.0, 15.0, 25.0, 45.0, 85.0), AZIMUTH_DEG)
        scene = resolve(load("haber2005", {"wavelengths": {"list_nm": [440.0, 550.0, 680.0]}}))
        found = {
            s: cells.prepare(scene.medium, replace(scene.settings, azimuth_cells=s)).radiance(sun, e, a)
            for s in (36, 60, 72)
        }
        for s in (36, 60):
            yield f"sun {sun:+g}: S = {s} beside S = 72", off(found[s], found[72])


def similarity() -> Iterator[Row]:
    """(1 - g) of aerosol's scattering, eq. (2), in scattering alone."""
    for sun in (10.0, -3.0):
        closed = haber_light(48, sun, reduce_extinction=True)
        yield f"sun {sun:+g}: (1 - g) in scattering alone, against extinction too", off(haber_light(48, sun), closed)


def colours() -> Iterator[Row]:
    """Eight wavelengths from 380 to 720 nm, beside forty."""
    nm = {n: np.linspace(380.0, 720.0, n) for n in (8, 40)}
    for sun in (8.0, 0.0, -3.0):
        found = colour_errors(
            haber_light(36, sun), haber_light(36, sun, 40), None, nm[8], nm[40],
            solar_spectrum="kurucz1992", observer="cie1964_10deg",
        )  # fmt: skip
        assert found is not None
        text = f"{found.ciede2000.median:.2g} (median), {found.ciede2000.largest:.2g} at most"
        yield f"sun {sun:+g}: colour difference CIEDE2000 of 8 wavelengths", text


def simplified_air() -> Iterator[Row]:
    """Air up to 35 km, and ozone as a filter on the vertical column: the default solver in continental air."""
    e, a = directions((3.0, 10.0, 25.0, 45.0, 85.0), AZIMUTH_DEG)
    suns = (5.0, 0.0, -3.0, -4.0, -6.0)
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


CLAIMS: dict[str, tuple[str, Callable[[], Iterator[Row]]]] = {
    **{one.__name__: ("Haber", one) for one in (search, events, shells, sizes, similarity, colours, simplified_air)},
    **{one.__name__: ("Bruneton", one) for one in (bruneton_transmittance, bruneton_suns, bruneton_angles)},
    **{one.__name__: ("Preetham", one) for one in (preetham_index, preetham_procedure)},
    "preset": ("Haber", preset),
}


def version_of_program() -> str:
    """The program's files as git names them, and whether they differ from that."""
    words = ["git", "rev-parse", "HEAD:twilight", "HEAD:climates"]
    done = subprocess.run(words, cwd=results.ROOT, capture_output=True, text=True, check=True)
    return " ".join([*done.stdout.split(), *results.commit().split()[2:]])


def main() -> None:
    names, version = sys.argv[1:], version_of_program()
    unknown = [name for name in names if name not in CLAIMS]
    if unknown:
        raise SystemExit(f"{unknown[0]} is no claim; there are {', '.join(CLAIMS)}")
    FOUND.mkdir(parents=True, exist_ok=True)
    known = {}
    for path in FOUND.glob("*.json"):
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["version"] == version:
            known[path.stem] = kept["rows"]
    for name in names or [name for name in CLAIMS if name not in known]:
        begun = time.process_time() + resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        rows = []
        for row in CLAIMS[name][1]():
            print(name, *row, sep="\t", flush=True)
            rows.append(row)
        spent = time.process_time() + resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - begun
        print(f"{name}: {spent:.0f} processor seconds", flush=True)
        (FOUND / f"{name}.json").write_text(json.dumps({"version": version, "rows": rows}), encoding="utf-8")
        known[name] = rows
    lines = [[CLAIMS[n][0], n, *row] for n in CLAIMS if n in known for row in known[n]]
    results.write(results.FOLDER / "three_papers.csv", ["paper", "claim", "what", "measured"], lines)


if __name__ == "__main__":
    main()
