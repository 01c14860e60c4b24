"""An error budget of Haber's method: from the published system to the field, one thing at a time.

    python benchmarks/haber_budget.py [STEP ...]      writes results/haber_budget.csv after every row

Radiances at 550 nm in continental-average air, in the 26 directions of its Monte-Carlo reference, beside which errors
are (in the rows that say so beside scalar `zones` in the same air).  Every step keeps what those above it changed, but
for those that are marked "aside".  `processor_s` is of one sky.  Rows are kept in out/haber-budget with the digest of
the code; with names of steps (parts of them) these alone are computed.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import results

from twilight.atmosphere.medium import Medium
from twilight.base.digest import DISPLAY, code_digest
from twilight.config import load
from twilight.numerics.phase import rayleigh_phase
from twilight.scene import resolve
from twilight.solvers import cells, zones
from twilight.solvers.cells.direct_light import sunlit
from twilight.solvers.cells.exchange import exchange
from twilight.solvers.cells.haber import Field

SUNS_DEG = (10.0, 0.0, -4.0, -6.0, -9.0)
NM = 550.0
CLIMATE = "continental-average"
KEPT = results.Kept("haber-budget", code_digest("twilight.solvers.cells", "twilight.solvers.zones", without=DISPLAY))
COLUMNS = ("step", "cells_around", "sun_elevation_deg", "beside", "median_percent", "p95_percent", "mean_percent",
           "processor_s")  # fmt: skip
RAYLEIGH_G = math.sqrt(0.1)
"""Asymmetry of the two Henyey-Greenstein functions, g and -g, whose mean has the second moment of Rayleigh's function;
the fourth is 0.01 in place of 0."""
EIGHTS = replace(cells.QUALITIES["haber2005"], azimuth_cells=92)
"""His settings at the size of most steps."""


class OwnPhases(Field):
    """His cells with Rayleigh's and the aerosol's own phase function where light scattered once is seen, and Rayleigh's
    where it is scattered again (aerosol's light goes on by Henyey and Greenstein's, as his)."""

    def radiance(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        h = math.radians(sun_elevation_deg)
        sun = np.array([math.cos(h), 0.0, math.sin(h)])
        *_, light = self.events(sun)
        filtered = np.exp(-self.medium.overhead_absorption_optical_depth)
        once = sunlit(self.layers, self.rings, sun, self.tolerance, filtered)
        sky = self.texture.radiance(*light, sun) - self.texture.radiance(*once, sun) + self._once(*once, sun)
        return self.texture.interpolate(sky, np.asarray(elevation_deg), np.asarray(azimuth_deg))

    def _once(self, air: np.ndarray, aerosol: np.ndarray, sun: np.ndarray) -> np.ndarray:
        """Light scattered once, (S/2, H, W), by the air's and the aerosol's own functions."""
        texture, rows = self.texture, self.grid.ring_row
        azimuth = np.pi * np.arange(air.shape[2]) / (air.shape[2] - 1)
        e = texture.elevation[:, None]
        cosine = (np.cos(e) * np.cos(azimuth) * sun[0] + np.sin(e) * sun[2])[rows]
        fraction = self.medium.at(self.rings.altitude).aerosol_phase_fraction
        out = np.zeros((texture.elevation.size, azimuth.size, air.shape[1]))
        for w in range(air.shape[1]):
            by_air = rayleigh_phase.py_func(cosine, self.medium.depolarisation[w])
            by_aerosol = np.zeros_like(cosine)
            for phase, part in zip(self.medium.phase_functions, fraction, strict=True):
                by_aerosol += part[:, w, None] * phase(cosine)[..., w]
            light = (air[:, w] * by_air + aerosol[:, w] * by_aerosol) * texture.weight[:, w, None]
            np.add.at(out[:, :, w], rows, light)
        return out

    def one_pass(self, layers, sent, forward, sun) -> np.ndarray:
        if forward is None:
            return super().one_pass(layers, sent, forward, sun)
        none = np.zeros_like(sent)
        mean = exchange(layers, self.active_rings, none, forward, sun)
        for g in (RAYLEIGH_G, -RAYLEIGH_G):
            as_air = layers._replace(asymmetry=np.full_like(layers.asymmetry, g))
            mean += exchange(as_air, self.active_rings, none, 0.5 * sent, sun)
        return mean


@dataclass(frozen=True)
class Step:
    """name; climate and the keys that differ from it; settings of the cells; their class."""

    name: str
    keys: dict[str, Any] = field(default_factory=dict)
    settings: cells.CellsSettings = EIGHTS
    kind: type[Field] = Field
    climate: str = CLIMATE


LOW = {"atmosphere.top_km": 35.0}
FILTER = {"gases.ozone.treatment": "overhead_filter"}
SECOND = replace(EIGHTS, effective_from_event=2)
CLOSED = replace(EIGHTS, reduce_extinction=True)
ALL_EVENTS = replace(CLOSED, max_orders=20, tolerance=1e-3)
DENSE = replace(CLOSED, active_shell_step=2)


def sized(s: int, step: int = 4) -> cells.CellsSettings:
    return replace(CLOSED, azimuth_cells=s, active_shell_step=step)


STEPS = (
    Step("as published, in his air", settings=cells.QUALITIES["haber2005"], climate="haber2005"),
    Step("S = 92 in place of 120", climate="haber2005"),
    Step("air, aerosol and ground of the climate", {**LOW, **FILTER}),
    Step("top at 100 km", FILTER),
    Step("ozone as a layer"),
    Step("own phase functions at the first event", kind=OwnPhases),
    Step("aside: (1 - g) from the second event on (4.5.3)", settings=SECOND, kind=OwnPhases),
    Step("(1 - g) in extinction too", settings=CLOSED, kind=OwnPhases),
    Step("aside: the same from the second event on", settings=replace(SECOND, reduce_extinction=True), kind=OwnPhases),
    Step("aside: events until one adds 0.1 %", settings=ALL_EVENTS, kind=OwnPhases),
    Step("aside: every second shell active", settings=DENSE, kind=OwnPhases),
    Step("aside: S = 62", settings=sized(62), kind=OwnPhases),
    Step("S = 120", settings=sized(120), kind=OwnPhases),
    Step("S = 180, every sixth shell active", settings=sized(180, 6), kind=OwnPhases),
)
FEW_SUNS = {"S = 180, every sixth shell active": (10.0, -4.0), "aside: every second shell active": (10.0, -4.0)}
"""Steps that are dear, and their suns."""


def air_of(climate: str, keys: dict[str, Any]) -> Medium:
    return resolve(load(climate, {"wavelengths": {"list_nm": [NM]}, **keys})).medium


def reference(sun: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(elevation, azimuth, radiance) of the reference at NM."""
    table = results.read_numbers(results.FOLDER / "reference" / f"{CLIMATE}.csv")
    some = table[(table["sun_elevation_deg"] == sun) & (table["wavelength_nm"] == NM)]
    return some["elevation_deg"], some["azimuth_deg"], some["radiance_per_sr"]


def errors(value: np.ndarray, right: np.ndarray) -> list[str]:
    """Median, 95th percentile and mean of the relative error [%]."""
    error = 100.0 * (value / right - 1.0)
    size = np.abs(error)
    return [f"{v:.3g}" for v in (np.median(size), np.percentile(size, 95), error.mean())]


def file_name(name: str) -> str:
    """A name without spaces and signs."""
    return "".join(c if c.isalnum() else "-" for c in name)


def kept(name: str, sun: float, compute: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    """(radiance, processor seconds) of a sky, kept by name."""
    name = file_name(f"{name} {sun:g}")
    rows = KEPT.rows(name)
    if rows is None:
        begun = time.process_time()
        light = compute()
        rows = [light.tolist(), time.process_time() - begun]
        KEPT.keep(name, rows)
    return np.array(rows[0]), rows[1]


def in_cells(step: Step, sun: float, elevation: np.ndarray, azimuth: np.ndarray, orders: int = 0):
    """A sky of a step; orders: of its events, 0 for all."""
    settings = replace(step.settings, max_orders=orders) if orders else step.settings

    def compute() -> np.ndarray:
        made = step.kind(air_of(step.climate, step.keys), settings, 0.0)
        return made.radiance(sun, elevation, azimuth)[:, 0]

    return kept(f"{step.name}{orders or ''}", sun, compute)


def in_zones(sun: float, elevation: np.ndarray, azimuth: np.ndarray, polarised: bool, orders: int = 0):
    """The same of `zones`, whose field serves every sun: of one here, as the cells' are."""
    settings = replace(zones.QUALITIES["standard"], polarisation=polarised)
    settings = replace(settings, max_orders=orders) if orders else settings

    def compute() -> np.ndarray:
        made = zones.prepare(air_of(CLIMATE, {}), settings, sun_elevations_deg=[sun])
        return made.radiance(sun, elevation, azimuth)[:, 0]

    return kept(f"zones-{polarised}-{orders}", sun, compute)


def rows_of(step: Step) -> list[list[str]]:
    """The rows of a step, one for each sun."""
    rows = []
    for sun in FEW_SUNS.get(step.name, SUNS_DEG):
        elevation, azimuth, right = reference(sun)
        light, spent = in_cells(step, sun, elevation, azimuth)
        rows.append([step.name, str(step.settings.azimuth_cells), f"{sun:g}", "montecarlo", *errors(light, right),
                     f"{spent:.1f}"])  # fmt: skip
        print(*rows[-1], sep="\t", flush=True)
    return rows


def rest() -> list[list[str]]:
    """What is left when polarisation is left out on both sides, and where: light scattered once, and more than once."""
    rows, last = [], next(step for step in STEPS if step.name == "S = 120")
    fine = replace(last, name="S = 360, light scattered once", settings=sized(360))
    for sun in SUNS_DEG:
        elevation, azimuth, right = reference(sun)
        light, spent = in_cells(last, sun, elevation, azimuth)
        once, _ = in_cells(last, sun, elevation, azimuth, 1)
        finer, finer_s = in_cells(fine, sun, elevation, azimuth, 1)
        scalar, scalar_s = in_zones(sun, elevation, azimuth, False)
        scalar_once, _ = in_zones(sun, elevation, azimuth, False, 1)
        polarised, polarised_s = in_zones(sun, elevation, azimuth, True)
        for name, size, beside, a, b, s in (
            ("beside scalar theory", "120", "scalar zones", light, scalar, spent),
            ("of that, light scattered once", "120", "scalar zones", once, scalar_once, spent),
            ("aside: the same at S = 360", "360", "scalar zones", finer, scalar_once, finer_s),
            ("light scattered more than once", "120", "scalar zones", light - once, scalar - scalar_once, spent),
            ("scalar zones", "", "montecarlo", scalar, right, scalar_s),
            ("zones", "", "montecarlo", polarised, right, polarised_s),
        ):
            rows.append([name, size, f"{sun:g}", beside, *errors(a, b), f"{s:.1f}"])
            print(*rows[-1], sep="\t", flush=True)
    return sorted(rows, key=lambda row: [r[0] for r in rows].index(row[0]))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("steps", nargs="*", metavar="STEP", help="parts of the names of steps; none: all")
    wanted = parser.parse_args().steps
    parts = {step.name: lambda step=step: rows_of(step) for step in STEPS} | {"rest": rest}
    for name, compute in parts.items():
        if not wanted or any(part in name for part in wanted):
            KEPT.keep(f"rows-{file_name(name)}", compute())
        known = [row for n in parts for row in KEPT.rows(f"rows-{file_name(n)}") or ()]
        results.write(results.FOLDER / "haber_budget.csv", COLUMNS, known, command="python benchmarks/haber_budget.py")


if __name__ == "__main__":
    main()
