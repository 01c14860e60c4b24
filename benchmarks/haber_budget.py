"""An error budget of Haber's method: from the published system to the field, one thing at a time.

    python benchmarks/haber_budget.py [STEP ...]      writes results/haber_budget.csv after every row

Radiances at 550 nm in continental-average air, in the 26 directions of its Monte-Carlo reference, beside which errors
are (in the rows that say so beside scalar `zones` in the same air).  Every step keeps what those above it changed, but
for those that are marked "aside".  `processor_s` is of one sky.  Rows are kept in out/haber-budget with the digest of
the code; with names of steps (parts of them) these alone are computed.
"""

from __future__ import annotations

import argparse
import hashlib
import time
from collections.abc import Sequence
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
from twilight.solvers.cells.grid import Layers
from twilight.solvers.cells.haber import CellsField as Field

SUNS_DEG = (10.0, 0.0, -4.0, -6.0, -9.0)
NM = 550.0
CLIMATE = "continental-average"
KEPT = results.Kept("haber-budget", code_digest("twilight.solvers.cells", "twilight.solvers.zones", without=DISPLAY))
COLUMNS = ("step", "cells_around", "sun_elevation_deg", "beside", "median_percent", "p95_percent", "mean_percent",
           "processor_s")  # fmt: skip
SPECTRAL = ("air", "aerosol", "extinction", "later_scattering", "later_extinction", "asymmetry", "refractivity")
"""Fields of `Layers` with an axis of wavelengths."""
HIS = replace(cells.QUALITIES["haber2005"], azimuth_cells=92)
"""His settings at the size of most steps."""


class SideBySide(Field):
    """His cells at one wavelength under several suns, which share the paths of the passes: the light of each sun stands
    in the place of a wavelength."""

    def __init__(self, medium: Medium, settings: cells.CellsSettings, suns_deg: Sequence[float]):
        super().__init__(medium.select(np.zeros(len(suns_deg), int)), settings, 0.0)
        h = np.radians(suns_deg)
        self.suns = np.stack([np.cos(h), np.zeros_like(h), np.sin(h)], axis=1)

    def skies(self) -> dict[str, np.ndarray]:
        """Textures (suns, S/2, H): of his method; the same with Rayleigh's and the aerosol's own phase functions where
        light scattered once is seen; and of light scattered once alone, his and by these functions."""
        seen = self.events(self.suns[0])
        once = [light.copy() for light in next(seen)]
        *_, light = [once, *seen]
        skies, first = self._textures(*light), self._textures(*once)
        own = np.stack([self._once(k, *once) for k in range(len(self.suns))])
        return {"his": skies, "own": skies - first + own, "once": first, "own once": own}

    def first_event(self, sun, filtered) -> tuple[np.ndarray, np.ndarray]:
        each = [sunlit(self._at(self.layers, 0), self.rings, s, self.tolerance, filtered[:1]) for s in self.suns]
        air, aerosol = (np.concatenate(parts, axis=1) for parts in zip(*each, strict=True))
        return air, aerosol

    def first_of_ground(self, sun, filtered) -> np.ndarray | None:
        each = [super(SideBySide, self).first_of_ground(s, filtered) for s in self.suns]
        if each[0] is None:
            return None
        return np.stack([light[:, k] for k, light in enumerate(each)], axis=1)

    def one_pass(self, layers, sent, forward, sun) -> np.ndarray:
        if forward is None:
            return super().one_pass(layers, sent, None, sun)
        one = self._at(layers, 0)
        each = [
            exchange(one, self.active_rings, sent[:, k : k + 1].copy(), forward[:, k : k + 1].copy(), s)
            for k, s in enumerate(self.suns)
        ]
        return np.concatenate(each, axis=1)

    def _at(self, layers: Layers, k: int) -> Layers:
        """The layers at one of the wavelengths."""
        here = {name: np.ascontiguousarray(getattr(layers, name)[:, k : k + 1]) for name in SPECTRAL}
        return layers._replace(**here)

    def _textures(self, isotropic: np.ndarray, aerosol: np.ndarray) -> np.ndarray:
        return np.stack([self.texture.radiance(isotropic, aerosol, s)[:, :, k] for k, s in enumerate(self.suns)])

    def _once(self, k: int, air: np.ndarray, aerosol: np.ndarray) -> np.ndarray:
        """Light scattered once under a sun, (S/2, H), by the air's and the aerosol's own functions."""
        texture, rows, sun = self.texture, self.grid.ring_row, self.suns[k]
        azimuth = np.pi * np.arange(air.shape[2]) / (air.shape[2] - 1)
        e = texture.elevation[:, None]
        cosine = (np.cos(e) * np.cos(azimuth) * sun[0] + np.sin(e) * sun[2])[rows]
        fraction = self.medium.at(self.rings.altitude).aerosol_phase_fraction
        by_aerosol = np.zeros_like(cosine)
        for phase, part in zip(self.medium.phase_functions, fraction, strict=True):
            by_aerosol += part[:, k, None] * phase(cosine)[k]
        by_air = rayleigh_phase.py_func(cosine, self.medium.depolarisation[k])
        out = np.zeros((texture.elevation.size, azimuth.size))
        np.add.at(out, rows, (air[:, k] * by_air + aerosol[:, k] * by_aerosol) * texture.weight[:, k, None])
        return out


@dataclass(frozen=True)
class Step:
    """name; keys that differ from those of a climate; settings of the cells; own: with the phase functions of the air
    and the aerosol where light scattered once is seen; suns [deg]."""

    name: str
    keys: dict[str, Any] = field(default_factory=dict)
    settings: cells.CellsSettings = HIS
    climate: str = CLIMATE
    own: bool = False
    suns: tuple[float, ...] = SUNS_DEG


LOW = {"atmosphere.top_km": 35.0}
FILTER = {"gases.ozone.treatment": "overhead_filter"}
CLOSED = replace(HIS, reduce_extinction=True)
FEW = (10.0, -4.0)
"""Suns of steps that are dear."""

STEPS = (
    Step("as published, in his air", settings=cells.QUALITIES["haber2005"], climate="haber2005"),
    Step("S = 92 in place of 120", climate="haber2005"),
    Step("air, aerosol and ground of the climate", {**LOW, **FILTER}),
    Step("top at 100 km", FILTER),
    Step("ozone as a layer"),
    Step("own phase functions where light scattered once is seen", own=True),
    Step("aside: (1 - g) from the second event on (4.5.3)", settings=replace(HIS, effective_from_event=2), own=True),
    Step("(1 - g) in extinction too", settings=CLOSED, own=True),
    Step("aside: S = 62", settings=replace(CLOSED, azimuth_cells=62), own=True),
    Step("aside: S = 62, every shell active", settings=replace(CLOSED, azimuth_cells=62, active_shell_step=1),
         own=True, suns=FEW),
    Step("S = 120", settings=replace(CLOSED, azimuth_cells=120), own=True),
    Step("S = 180, every sixth shell active", settings=replace(CLOSED, azimuth_cells=180, active_shell_step=6),
         own=True, suns=FEW[1:]),
)  # fmt: skip


def air_of(climate: str, keys: dict[str, Any]) -> Medium:
    return resolve(load(climate, {"wavelengths": {"list_nm": [NM]}, **keys})).medium


def reference(sun: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(elevation, azimuth, radiance) of the reference at NM."""
    table = results.read_numbers(results.FOLDER / "reference" / f"{CLIMATE}.csv")
    some = table[(table["sun_elevation_deg"] == sun) & (table["wavelength_nm"] == NM)]
    return some["elevation_deg"], some["azimuth_deg"], some["radiance_per_sr"]


def errors(value: np.ndarray, right: np.ndarray, whole: np.ndarray | None = None) -> list[str]:
    """Median, 95th percentile and mean of the error over all light [%]; None: that is `right`."""
    error = 100.0 * (value - right) / (right if whole is None else whole)
    size = np.abs(error)
    return [f"{v:.3g}" for v in (np.median(size), np.percentile(size, 95), error.mean())]


def file_name(name: str) -> str:
    """A name without spaces and signs."""
    return "".join(c if c.isalnum() else "-" for c in name)


def in_cells(step: Step, settings: cells.CellsSettings | None = None) -> tuple[dict[str, np.ndarray], float]:
    """Radiances (suns, 26) of `SideBySide.skies` and processor seconds of a sky, kept; steps that differ in what
    is seen of it alone share them."""
    settings = settings or step.settings
    name = hashlib.sha256(f"{step.climate} {step.keys} {settings} {step.suns}".encode()).hexdigest()[:16]
    found = KEPT.rows(name)
    if found is None:
        begun = time.process_time()
        made = SideBySide(air_of(step.climate, step.keys), settings, step.suns)
        seen = {}
        for what, skies in made.skies().items():
            of_suns = zip(step.suns, skies, strict=True)
            seen[what] = [made.texture.interpolate(sky[..., None], *reference(sun)[:2])[:, 0] for sun, sky in of_suns]
        found = [
            {what: np.array(light).tolist() for what, light in seen.items()},
            (time.process_time() - begun) / len(step.suns),
        ]
        KEPT.keep(name, found)
    return {what: np.array(light) for what, light in found[0].items()}, found[1]


def in_zones(polarised: bool, orders: int = 0) -> tuple[np.ndarray, float]:
    """The same of a field of `zones`."""
    found = KEPT.rows(f"zones-{polarised}-{orders}")
    if found is None:
        begun = time.process_time()
        settings = replace(zones.QUALITIES["standard"], polarisation=polarised)
        settings = replace(settings, max_orders=orders) if orders else settings
        made = zones.prepare(air_of(CLIMATE, {}), settings, sun_elevations_deg=SUNS_DEG)
        light = [made.radiance(sun, *reference(sun)[:2])[:, 0].tolist() for sun in SUNS_DEG]
        found = [light, (time.process_time() - begun) / len(SUNS_DEG)]
        KEPT.keep(f"zones-{polarised}-{orders}", found)
    return np.array(found[0]), found[1]


def rows_of(step: Step) -> list[list[str]]:
    """The rows of a step, one for each sun."""
    light, spent = in_cells(step)
    s = str(step.settings.azimuth_cells)
    return [
        [step.name, s, f"{sun:g}", "montecarlo", *errors(one, reference(sun)[2]), f"{spent:.1f}"]
        for sun, one in zip(step.suns, light["own" if step.own else "his"], strict=True)
    ]


def rest() -> list[list[str]]:
    """What is left when polarisation is left out on both sides, and where: light scattered once, and more than once."""
    last = next(step for step in STEPS if step.name == "(1 - g) in extinction too")
    light, spent = in_cells(last)
    fine, fine_s = in_cells(last, replace(last.settings, azimuth_cells=180, max_orders=1))
    # errors of parts are over all light
    (scalar, scalar_s), (scalar_once, _), (whole, whole_s) = in_zones(False), in_zones(False, 1), in_zones(True)
    exact = np.array([reference(sun)[2] for sun in SUNS_DEG])
    parts = (
        ("beside scalar theory", "92", "scalar zones", light["own"], scalar, spent),
        ("of that, light scattered once", "92", "scalar zones", light["own once"], scalar_once, spent),
        ("aside: the same at S = 180", "180", "scalar zones", fine["own once"], scalar_once, fine_s),
        ("of that, light scattered more than once", "92", "scalar zones", light["own"] - light["own once"],
         scalar - scalar_once, spent),
        ("scalar zones", "", "montecarlo", scalar, exact, scalar_s),
        ("zones", "", "montecarlo", whole, exact, whole_s),
    )  # fmt: skip
    return [
        [
            name,
            size,
            f"{sun:g}",
            beside,
            *errors(a[k], b[k], None if beside == "montecarlo" else scalar[k]),
            f"{seconds:.1f}",
        ]
        for name, size, beside, a, b, seconds in parts
        for k, sun in enumerate(SUNS_DEG)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("steps", nargs="*", metavar="STEP", help="parts of the names of steps; none: all")
    wanted = parser.parse_args().steps
    parts = {step.name: lambda step=step: rows_of(step) for step in STEPS} | {"rest": rest}
    for name, compute in parts.items():
        if not wanted or any(part in name for part in wanted):
            KEPT.keep(f"rows-{file_name(name)}", compute())
            for row in KEPT.rows(f"rows-{file_name(name)}") or ():
                print(*row, sep="\t", flush=True)
        known = [row for n in parts for row in KEPT.rows(f"rows-{file_name(n)}") or ()]
        results.write(results.FOLDER / "haber_budget.csv", COLUMNS, known, command="python benchmarks/haber_budget.py")


if __name__ == "__main__":
    main()
