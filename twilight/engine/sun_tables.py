"""A field under many suns: tables, hemispheres of lines of sight and beams, computed when they are needed and cached.

All suns of a field and an observer share rows and columns, so that logarithms may be interpolated over the sun.  What
shows or measures many suns takes one `SkyTable` of some of them (:meth:`SunTables.between`), or one of any sun
(:meth:`SunTables.under`).  Integrals over surfaces are smooth in the sun's elevation, without an aureole: they are
read from a hemisphere of lines of sight for each sun, so that thousands of moments need no further directions.
"""

from __future__ import annotations

import hashlib
from functools import cached_property
from typing import Any

import numpy as np

from twilight.base import cache
from twilight.base.conventions import DARK, TINY
from twilight.base.digest import code_digest
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.engine.sunbeam import disc_strips
from twilight.engine.table import shared_columns, shared_rows, shows_shadow
from twilight.numerics.directions import HEMISPHERE_COLUMNS, whole_hemisphere
from twilight.numerics.spectrum import hermite_weights
from twilight.scene.scene import Scene
from twilight.sky.disc import SOLAR_RADIUS_DEG
from twilight.sky.lights import Luminary
from twilight.sky.surfaces import Surface
from twilight.sky.table import SkyTable, stack, sun_weights

SUN_COUNT = 97
"""Suns from `LOWEST_SUN_DEG` to the zenith, close together about `CENTRE_DEG`."""

LOWEST_SUN_DEG = -20.0
"""Lowest of these suns [deg]; below it stand others `DEEP_STEP_DEG` apart down to `DARK_SUN_DEG`."""

CENTRE_DEG = -8.0
"""Where these suns are closest, 0.37 deg apart [deg]."""

WIDTH_DEG = 8.0
"""Distance from `CENTRE_DEG` over which they stay close [deg]."""

SHADOW_DEG = (-3.2, 1.2)
"""Suns between which others stand half-way [deg]: the Earth's shadow rises with a sharp edge."""

EDGE_DEG = (-3.2, -0.5)
"""Suns between which others stand closer in air without aerosol [deg]: the edge is a factor of 2 within 0.1 deg of
elevation at -1 deg, and smooth at -3."""

EDGE_STEP = 0.05 / 1.2**2
"""Distance of those suns over the square of their elevation [deg^-1]: so the edge widens."""

LEAST_EDGE_STEP_DEG = 0.03
"""Their least distance [deg]."""

MOST_EDGE_STEP_DEG = 0.18
"""Their largest distance [deg]."""

DARK_SUN_DEG = -40.0
"""Lowest sun of all [deg]."""

DEEP_STEP_DEG = 2.0
"""Distance of the suns below `LOWEST_SUN_DEG` [deg]."""

ROW_COUNT = 45
"""Rows above the last break of a table: with COLUMN_COUNT 0.02 to 0.2 % at 95 % of the directions in clear air."""

COLUMN_COUNT = 31
"""Columns of a table, from the sun to its opposite."""


AUREOLE_SUN_DEG = 30.0
"""The sun whose widened aureole is in the phase function that tables share [deg]: desert is then within 2.2 % of the
field at suns of 1 to 60 deg, with 15 deg within 2.9 %."""


def sun_nodes(lowest_deg: float = DARK_SUN_DEG, highest_deg: float = 90.0, shadow: bool = False) -> np.ndarray:
    """The suns at which fields are tabulated [deg], within a range whose ends are two of them; shadow: whether the
    Earth's shadow has a sharp edge."""
    low, high = (np.arcsinh((sun - CENTRE_DEG) / WIDTH_DEG) for sun in (LOWEST_SUN_DEG, 90.0))
    close = CENTRE_DEG + WIDTH_DEG * np.sinh(np.linspace(low, high, SUN_COUNT))
    between = 0.5 * (close[1:] + close[:-1])
    between = between[(between > SHADOW_DEG[0]) & (between < SHADOW_DEG[1])]
    every = np.sort(np.concatenate([np.arange(DARK_SUN_DEG, LOWEST_SUN_DEG, DEEP_STEP_DEG), close, between]))
    if shadow:
        edge = [EDGE_DEG[0]]
        while edge[-1] < EDGE_DEG[1]:
            step = np.clip(EDGE_STEP * edge[-1] ** 2, LEAST_EDGE_STEP_DEG, MOST_EDGE_STEP_DEG)
            edge.append(edge[-1] + float(step))
        every = np.sort(np.concatenate([every[(every < edge[0]) | (every > edge[-1])], edge]))
    inside = every[(every > lowest_deg + 1e-6) & (every < highest_deg - 1e-6)]
    return np.concatenate([[lowest_deg], inside, [highest_deg]])


def suns_between(low_deg: float, high_deg: float, nodes_deg: np.ndarray | None = None) -> np.ndarray:
    """Those of `sun_nodes`, or of others, that suns from low_deg to high_deg are read from."""
    nodes = sun_nodes() if nodes_deg is None else nodes_deg
    first = max(0, int(np.searchsorted(nodes, low_deg, "right")) - 2)
    return nodes[first : int(np.searchsorted(nodes, high_deg)) + 2]


def check_serves_every_sun(scene: Scene) -> None:
    """TwilightError for a solver whose field serves one sun alone."""
    if not scene.capabilities.every_sun or scene.capabilities.standard_error:
        raise TwilightError(
            f"this needs a solver whose field serves every sun, as zones and compact, not {scene.solver_name}"
        )


TURN_DEG = 10.0
"""Distance of the azimuths of a plane's normal from the sun at which its light is held [deg]."""
HIGHEST_SUN_DEG = 75.0
"""Highest sun whose zenith is read between suns: nearer to it the zenith has a part of the aureole."""
DISC_NODES = 160
"""Suns at which the beam is computed, from the first ray that arrives to the zenith, by the cube of their number."""
FEW_LINES = 100
"""Lines of sight up to which they are computed one by one, for each sun whose table or hemisphere is missing."""
FEW_SUNS = 2
"""Moments up to which they are, for each of these suns."""
ZENITH_DEG = 90.0 - 1e-9
"""Elevation from which on a direction is the zenith, whatever its azimuth [deg]."""


class SunTables:
    """The tables of a solved `Field`, for one observer.

    altitude_km: of the observer above sea level; None: the scene's
    rows_deg, columns_deg: nodes of the tables; None: rows of the sky, for an observer high up of the ground as well
    Errors: TwilightError for a solver whose field serves one sun alone.
    """

    def __init__(
        self,
        solved: Any,
        altitude_km: float | None = None,
        *,
        rows_deg: np.ndarray | None = None,
        columns_deg: np.ndarray | None = None,
    ):
        scene = solved.scene
        check_serves_every_sun(scene)
        self.solved = solved
        self.altitude_km = scene.altitude_km if altitude_km is None else altitude_km
        low, high = solved.sun_range_deg
        self.suns_deg = sun_nodes(max(low, DARK_SUN_DEG), min(high, 90.0), shows_shadow(scene))
        self.rows_deg = shared_rows(scene, self.altitude_km, ROW_COUNT) if rows_deg is None else rows_deg
        self.columns_deg = shared_columns(COLUMN_COUNT) if columns_deg is None else columns_deg
        self._made: dict[int, SkyTable] = {}
        self._lines: dict[int, np.ndarray] = {}
        self._surfaces: dict[tuple[str, float], np.ndarray] = {}
        self._key = ""
        if solved.cached:
            code = code_digest("twilight.engine.one_sun", "twilight.engine.sun_tables")
            self._key = "".join(solved.keys) + repr(self.altitude_km) + code

    def under(self, sun_elevation_deg: float) -> SkyTable:
        """The table of one sun, between its neighbours; below the lowest sun logarithms fall on straight."""
        nodes, weights = sun_weights(self.suns_deg, np.array([sun_elevation_deg]))
        used = [int(k) for k in _used(nodes[0], weights[0])]
        low, high = (int(np.clip(k, 0, self.suns_deg.size - 1)) for k in (min(used), max(used)))
        return stack([self._table(k) for k in range(low, high + 1)]).under(sun_elevation_deg)

    def missing(self, sun_elevation_deg: np.ndarray, *, lines: bool = False) -> int:
        """How many tables, or hemispheres of lines, are to be computed before light is read under these suns."""
        held = self._lines if lines else self._made
        each = [int(k) for k in _used(*sun_weights(self.suns_deg, sun_elevation_deg)) if k not in held]
        if not self._key:
            return len(each)
        return sum(cache.find(cache.SKIES, self._name(k, lines)) is None for k in each)

    def light(
        self,
        sun_elevation_deg: np.ndarray,
        elevation_deg: np.ndarray,
        azimuth_deg: np.ndarray,
        progress: Progress = silent,
    ) -> np.ndarray:
        """Light in directions (D,), each under a sun of its own (D,), (D, W); azimuths from the sun."""
        nodes, weights = sun_weights(self.suns_deg, sun_elevation_deg)
        used = _used(nodes, weights)
        tables = []
        for n, k in enumerate(used):
            progress(f"sun {self.suns_deg[k]:+.1f} deg", n / used.size)
            tables.append(self._table(int(k)))
        place = np.minimum(np.searchsorted(used, nodes), used.size - 1)
        return stack(tables).light_under((place, weights), sun_elevation_deg, elevation_deg, azimuth_deg)

    def between(self, low_deg: float, high_deg: float, progress: Progress = silent) -> SkyTable:
        """The table of all suns that those from low_deg to high_deg are read from."""
        wanted = suns_between(low_deg, high_deg, self.suns_deg)
        first = int(np.searchsorted(self.suns_deg, wanted[0]))
        stop = first + wanted.size
        tables = []
        for k in range(first, stop):
            words = f"sun {k + 1 - first} of {stop - first}, {self.suns_deg[k]:+.1f} deg"
            progress(words, (k - first) / (stop - first))
            tables.append(self._table(k))
        return stack(tables)

    def sky(self, sun_elevation_deg: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], (N, D, W), of N suns (N,) and D directions of each (N, D), 0 to 90 deg high,
        azimuths from the sun.

        Where few lines of sight are asked for, each is computed; the zenith and others are read from tables.
        """
        suns = np.broadcast_to(sun_elevation_deg[:, None], elevation_deg.shape)
        out = np.zeros((*elevation_deg.shape, self.solved.medium.n_wavelengths))
        zenith = (elevation_deg >= ZENITH_DEG) & (suns <= HIGHEST_SUN_DEG)
        for some, lines in ((zenith, True), (~zenith, False)):
            if not some.any():
                continue
            missing = self.missing(suns[some], lines=lines) if self.suns_deg[0] <= suns[some].min() else 0
            asked = np.flatnonzero(some.any(axis=1))
            if some.sum() <= FEW_LINES * missing and asked.size <= FEW_SUNS * missing:
                for n in asked:
                    e, a = elevation_deg[n, some[n]], azimuth_deg[n, some[n]]
                    out[n, some[n]] = self.solved.radiance(float(sun_elevation_deg[n]), e, a)
            elif lines:
                out[some] = self.zenith(suns[some])
            else:
                out[some] = self.light(suns[some], elevation_deg[some], azimuth_deg[some])
        return out

    def fill(self, sun_elevation_deg: np.ndarray, progress: Progress = silent) -> None:
        """Compute the hemispheres that light under these suns is read from."""
        used = _used(*sun_weights(self.suns_deg, sun_elevation_deg))
        for n, k in enumerate(used):
            progress(f"sun {self.suns_deg[k]:+.1f} deg", n / used.size)
            self._lines_of(int(k))

    def zenith(self, sun_elevation_deg: np.ndarray) -> np.ndarray:
        """Sun-normalised radiance [sr^-1] of the zenith under suns (N,), up to HIGHEST_SUN_DEG, (N, W)."""
        nodes, weights = sun_weights(self.suns_deg, sun_elevation_deg)
        used = _used(nodes, weights)
        light = np.log(np.maximum([self._lines_of(int(k))[-1] for k in used], DARK))
        place = np.minimum(np.searchsorted(used, nodes), used.size - 1)
        return np.exp(np.einsum("nk,nkw->nw", weights, light[place]))

    def surface(self, surface: Surface, sun_elevation_deg: np.ndarray, normal_from_sun_deg: np.ndarray) -> np.ndarray:
        """Irradiance of a surface by the sky over F0 (N, W) under suns (N,), its normal (N,) deg from them."""
        nodes, weights = sun_weights(self.suns_deg, sun_elevation_deg)
        key = (surface.kind, surface.tilt_deg)
        if key not in self._surfaces:
            shape = (self.suns_deg.size, _turns(surface).size, self.solved.medium.n_wavelengths)
            self._surfaces[key] = np.full(shape, np.nan)
        table = self._surfaces[key]
        for k in _used(nodes, weights):
            if np.isnan(table[k, 0, 0]):
                table[k] = np.log(np.maximum(self._integrated(surface, int(k)), DARK))
        heaviest = np.abs(weights).argmax(axis=1)[:, None]
        nodes = np.where(weights != 0.0, nodes, np.take_along_axis(nodes, heaviest, axis=1))
        if table.shape[1] == 1:
            return np.exp(np.einsum("nk,nkw->nw", weights, table[nodes, 0]))
        around = np.abs((normal_from_sun_deg + 180.0) % 360.0 - 180.0)
        columns, across = hermite_weights(np.arange(-TURN_DEG, 180.0 + 1.5 * TURN_DEG, TURN_DEG), around)
        # normals beyond the sun and its opposite are mirror images
        last = table.shape[1] - 1
        columns = last - np.abs(last - np.abs(columns - 1))
        nodes_light = table[nodes[:, :, None], columns[:, None, :]]
        return np.exp(np.einsum("nk,nj,nkjw->nw", weights, across, nodes_light))

    def _integrated(self, surface: Surface, k: int) -> np.ndarray:
        """Irradiance over F0 under one of the suns, (A, W), by the azimuth of the normal."""
        elevation, azimuth, solid = (x[None] for x in whole_hemisphere(float(self.suns_deg[k])))
        turned = [Surface(surface.kind, surface.tilt_deg, float(a)) for a in _turns(surface)]
        weight = np.concatenate([one.view(elevation, azimuth, np.zeros(1)) * solid for one in turned])
        half = weight.shape[1] // 2
        return (weight[:, :half] + weight[:, half:]) @ self._lines_of(k)[:-1]

    def beam(self, true_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Irradiance at normal incidence over F0 (T, W) at true elevations (T,) [deg], and the bending (T,) [deg]."""
        suns, logs, bendings = self._beams
        lit = np.flatnonzero(true_deg >= suns[0])
        irradiance, bending = np.zeros((true_deg.size, logs.shape[1])), np.zeros(true_deg.size)
        # beyond the zenith the disc comes down on the other side
        at = np.where(true_deg > 90.0, 180.0 - true_deg, true_deg)[lit]
        nodes, weights = hermite_weights(suns, at)
        ends = logs[nodes[:, 1]], logs[nodes[:, 2]]
        value = np.einsum("tk,tkw->tw", weights, logs[nodes])
        irradiance[lit] = np.exp(np.clip(value, np.minimum(*ends), np.maximum(*ends)))
        bending[lit] = (weights * bendings[nodes]).sum(axis=1)
        return irradiance, bending

    def strips(self, body: Luminary) -> tuple[np.ndarray, np.ndarray]:
        """Apparent elevations [deg] (N, S) of the strips of the discs of a body at N moments, and their irradiances at
        normal incidence over F0 (N, S, W); 0 in the dark."""
        offset, fraction = disc_strips(body.strips)
        true = body.elevation_deg[:, None] + SOLAR_RADIUS_DEG * offset
        irradiance, bending = self.beam(true.ravel())
        return true + bending.reshape(true.shape), irradiance.reshape(*true.shape, -1) * fraction[:, None]

    @cached_property
    def _beams(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Suns (K,) from the first ray that arrives to the zenith [deg], ln of the beam (K, W), bending (K,) [deg]."""
        dark, lit = -40.0, 1.0
        while lit - dark > 1e-6:  # the lowest ray that arrives
            middle = 0.5 * (dark + lit)
            reached = self.solved.direct(middle).irradiance.any()
            dark, lit = (dark, middle) if reached else (middle, lit)
        suns = lit + (90.0 - lit) * np.linspace(0.0, 1.0, DISC_NODES) ** 3
        beams = [self.solved.direct(float(e)) for e in suns]
        logs = np.log(np.maximum([one.irradiance for one in beams], TINY))
        return suns, logs, np.array([one.bending_deg for one in beams])

    def _table(self, k: int) -> SkyTable:
        """The table of one of the suns."""
        if k not in self._made:
            sun = float(self.suns_deg[k])

            def filled() -> dict[str, np.ndarray]:
                nodes = {"rows_deg": self.rows_deg, "columns_deg": self.columns_deg}
                shared = float(np.clip(AUREOLE_SUN_DEG, *self.suns_deg[[0, -1]]))
                table = self.solved.table(sun, self.altitude_km, **nodes, aureole_sun_deg=shared, refine=False)
                return table.arrays()

            self._made[k] = cache.of_skies(self._name(k), filled, SkyTable.of_arrays)
        return self._made[k]

    def _lines_of(self, k: int) -> np.ndarray:
        """Radiance (D + 1, W) of one half of `whole_hemisphere`, and of the zenith, under one of the suns."""
        if k not in self._lines:
            sun, count = float(self.suns_deg[k]), self.solved.medium.n_wavelengths

            def computed() -> dict[str, np.ndarray]:
                elevation, azimuth, _ = whole_hemisphere(sun)
                rows, columns = np.append(np.unique(elevation), 90.0), azimuth[:HEMISPHERE_COLUMNS]
                grid = self.solved.radiance(sun, rows[:, None], columns)
                # one line is enough for the zenith
                lines = np.concatenate([grid[:-1].reshape(-1, grid.shape[-1]), grid[-1, :1]])
                return {"lines": lines.astype(np.float32)}

            def read(arrays: dict[str, np.ndarray]) -> np.ndarray:
                lines = arrays["lines"]
                if lines.ndim != 2 or lines.shape[1] != count or not np.isfinite(lines).all():
                    raise ValueError("not the lines of this field")
                return lines.astype(float)

            self._lines[k] = cache.of_skies(self._name(k, lines=True), computed, read)
        return self._lines[k]

    def _name(self, k: int, lines: bool = False) -> str:
        if not self._key:
            return ""
        if lines:
            about = f"hemisphere {''.join(self.solved.keys)} {self.altitude_km!r} {float(self.suns_deg[k])!r}"
        else:
            about = f"{self._key} {self.suns_deg[k]!r} {self.rows_deg.tolist()} {self.columns_deg.tolist()}"
        return hashlib.sha256(about.encode()).hexdigest()


def _used(nodes: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The suns that have a weight."""
    return np.unique(nodes[weights != 0.0])


def _turns(surface: Surface) -> np.ndarray:
    """Azimuths of a surface's normal from the sun at which its light is held [deg]."""
    return np.arange(0.0, 180.5, TURN_DEG) if surface.turns else np.zeros(1)
