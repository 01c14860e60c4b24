"""Claims of the three papers, measured: what docs/three-papers.md says.

    python benchmarks/three_papers.py [haber] [bruneton] [preetham]      writes benchmarks/three_papers.csv

Haber's cells are S = 48 with 8 wavelengths (S = 120 of the preset is timed by `twilight render haber2005`); 12
processor minutes in all, most of them Bruneton's tables.  Errors are percentages over
directions; "95 %" is the 95th percentile.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import results

from twilight.config import load
from twilight.scene import resolve
from twilight.solvers import cells, tables, zones
from twilight.solvers.analytic import aerial
from twilight.solvers.cells.layers import layer_of, make_layers
from twilight.solvers.cells.refraction import refracted_sun
from twilight.transport.ray_profile import ray_profile
from twilight.transport.rays import OUTSIDE, sun_ray

Row = tuple[str, str, str]
SUNS_DEG = (10.0, 0.0, -3.0, -6.0)
ELEVATION, AZIMUTH = (
    g.ravel() for g in np.meshgrid([3.75, 11.25, 26.25, 48.75, 86.25], [0.0, 45.0, 90.0, 180.0], indexing="ij")
)
"""Directions that are middles of Haber's rows."""


def off(value: np.ndarray, right: np.ndarray) -> str:
    """Median and 95th percentile of the relative error."""
    error = 100.0 * np.abs(value / right - 1.0)
    return f"{np.median(error):.2g} (median), {np.percentile(error, 95):.2g} % (95 %)"


def haber() -> Iterator[Row]:
    """His system in his air."""
    scene = resolve(load("haber2005", {"solver.azimuth_cells": 48}))
    medium, settings = scene.medium, scene.settings
    yield from search(medium, "his index at 80 % humidity")
    dry = resolve(load("haber2005", {"refraction.relative_humidity_percent": 0})).medium
    yield from search(dry, "the same index of dry air")

    def light(sun: float, **changes: object) -> np.ndarray:
        field = cells.prepare(medium, replace(settings, **changes))  # type: ignore[arg-type]
        return field.radiance(sun, ELEVATION, AZIMUTH)

    for sun in SUNS_DEG:
        orders = {n: light(sun, max_orders=n) for n in (1, 4, 5, 10)}
        share = 100.0 * np.median(orders[1] / orders[10])
        yield "Haber", f"sun {sun:+g}: light scattered once, of all", f"{share:.3g} % (median)"
        for n in (4, 5):
            error = 100.0 * (1.0 - orders[n] / orders[10])
            yield (
                "Haber",
                f"sun {sun:+g}: missing after {n} events",
                f"{np.median(error):.2g}, at most {error.max():.2g} %",
            )
    for sun in (10.0, -3.0):
        every = light(sun, active_shell_step=1)
        for step in (2, 4):
            yield "Haber", f"sun {sun:+g}: every {step}th shell active", off(light(sun, active_shell_step=step), every)
        closed = light(sun, reduce_extinction=True)
        yield "Haber", f"sun {sun:+g}: (1 - g) in scattering alone, against extinction too", off(light(sun), closed)


def search(medium, what: str) -> Iterator[Row]:
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
    begun = time.perf_counter()
    lift, depth, steps = refracted_sun(layers, z, layer_of(layers, z), sun, math.radians(0.1))
    each = 1e6 * (time.perf_counter() - begun) / lift.size
    lit = ~np.isnan(lift[:, 3])
    error = np.degrees(np.abs(lift[lit, 3] - np.array(lifts)[lit]))
    yield "Haber", f"{what}: lift by the search, off", f"{np.median(error):.2g}, at most {error.max():.2g} deg"
    tau = 100.0 * np.abs(depth[lit, 3] / np.array(depths)[lit] - 1.0)
    yield "Haber", f"{what}: optical depth of that path, off", f"{np.median(tau):.2g}, at most {tau.max():.2g} %"
    yield (
        "Haber",
        f"{what}: steps",
        f"{steps[lit].min():.0f} to {steps[lit].max():.0f}, median {np.median(steps[lit]):.0f}",
    )
    yield "Haber", f"{what}: cells that it leaves in shadow, of {lit.size} lit ones", f"{(~lit).sum()}"
    yield "Haber", f"{what}: time of one search, from Python", f"{each:.2g} us"


def bruneton() -> Iterator[Row]:
    """His tables in air without refraction, beside `zones` in the same air."""
    medium = resolve(
        load("continental-average", {"refraction.model": "none"}), wavelength_nm=np.array([450.0, 550.0, 680.0])
    ).medium
    e, a = np.meshgrid([2.0, 5.0, 10.0, 20.0, 40.0, 60.0, 88.0], [0.0, 30.0, 60.0, 90.0, 135.0, 180.0], indexing="ij")
    e, a = e.ravel(), a.ravel()
    right = zones.prepare(medium, replace(zones.QUALITIES["standard"], polarisation=False))
    for quality in ("bruneton2008", "fine"):
        field = tables.prepare(medium, tables.QUALITIES[quality])
        for sun in (30.0, 0.0, -4.0):
            made, exact = field.radiance(sun, e, a), right.radiance(sun, e, a)
            low = 100.0 * (made / exact - 1.0)[e == 2.0]
            text = f"{off(made, exact)}; at 2 deg {low.min():+.2g} to {low.max():+.2g} %"
            yield "Bruneton", f"{quality}, sun {sun:+g}, without refraction", text
        scaled = field.scaled.medium.optical_depth("total") / medium.optical_depth("total")
        yield "Bruneton", f"{quality}: optical depth of his T over Beer's", f"{scaled.min():.3f} to {scaled.max():.3f}"


def preetham() -> Iterator[Row]:
    """His index as printed."""
    printed = aerial.air_scattering_per_km(np.array([440.0, 550.0]))
    real = printed * (((1.0 + 2.78e-4) ** 2 - 1.0) / ((1.0 + 3e-4) ** 2 - 1.0)) ** 2
    passed = np.exp(-50.0 * (real - printed))
    yield "Preetham", "air's transmittance over 50 km level, real index over printed, 440 nm", f"{passed[0]:.3g}"


def main() -> None:
    made = {"haber": haber, "bruneton": bruneton, "preetham": preetham}
    rows = []
    for name in sys.argv[1:] or list(made):
        for row in made[name]():
            print("\t".join(row), flush=True)
            rows.append(list(row))
    results.write(results.ROOT / "benchmarks" / "three_papers.csv", ["paper", "what", "measured"], rows)


if __name__ == "__main__":
    main()
