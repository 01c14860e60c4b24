"""Tables of a field for many suns: computed sun by sun when they are needed, cached, and read between them.

All suns of a field and an observer share rows and columns, so that logarithms may be interpolated over the sun.  What
shows or measures many suns takes one `SkyTable` of some of them (:meth:`SunTables.between`), or one of any sun
(:meth:`SunTables.under`).
"""

import hashlib
from typing import Any, Protocol

import numpy as np

from twilight.base import cache
from twilight.base.digest import code_digest
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.engine.table import first_columns, first_rows, row_breaks
from twilight.scene.scene import Scene
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
"""Suns between which others stand half-way [deg]: the Earth's shadow rises with a sharp edge, in pure air above all."""

DARK_SUN_DEG = -40.0
"""Lowest sun of all [deg]."""

DEEP_STEP_DEG = 2.0
"""Distance of the suns below `LOWEST_SUN_DEG` [deg]."""

ROW_COUNT = 45
"""Rows above the last break of a table: with COLUMN_COUNT 0.02 to 0.2 % at 95 % of the directions in clear air."""

COLUMN_COUNT = 29
"""Columns of a table, from the sun to its opposite."""


AUREOLE_SUN_DEG = 30.0
"""The sun whose widened aureole is in the phase function that tables share [deg]: desert is then within 2.2 % of the
field at suns of 1 to 60 deg, with 15 deg within 2.9 %."""


def sun_nodes(lowest_deg: float = DARK_SUN_DEG, highest_deg: float = 90.0) -> np.ndarray:
    """The suns at which fields are tabulated [deg], within a range whose ends are two of them."""
    low, high = (np.arcsinh((sun - CENTRE_DEG) / WIDTH_DEG) for sun in (LOWEST_SUN_DEG, 90.0))
    close = CENTRE_DEG + WIDTH_DEG * np.sinh(np.linspace(low, high, SUN_COUNT))
    between = 0.5 * (close[1:] + close[:-1])
    between = between[(between > SHADOW_DEG[0]) & (between < SHADOW_DEG[1])]
    every = np.sort(np.concatenate([np.arange(DARK_SUN_DEG, LOWEST_SUN_DEG, DEEP_STEP_DEG), close, between]))
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


class Solved(Protocol):
    """What tables are computed from: a `Field`, which makes some itself."""

    @property
    def scene(self) -> Scene: ...
    @property
    def keys(self) -> tuple[str, ...]: ...
    @property
    def cached(self) -> bool: ...
    @property
    def sun_range_deg(self) -> tuple[float, float]: ...
    def table(self, sun_elevation_deg: float, observer_altitude_km: float | None = None, **nodes: Any) -> SkyTable: ...


class SunTables:
    """The tables of a solved field, for one observer.

    altitude_km: of the observer above sea level; None: the scene's
    rows_deg, columns_deg: nodes of the tables; None: rows of the sky, for an observer high up of the ground as well
    Errors: TwilightError for a solver whose field serves one sun alone.
    """

    def __init__(
        self,
        solved: Solved,
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
        self.suns_deg = sun_nodes(max(low, DARK_SUN_DEG), min(high, 90.0))
        if rows_deg is None:
            rows_deg = first_rows(*row_breaks(scene, self.altitude_km), ROW_COUNT)
        self.rows_deg = rows_deg
        self.columns_deg = first_columns(COLUMN_COUNT) if columns_deg is None else columns_deg
        self._made: dict[int, SkyTable] = {}
        self._key = ""
        if solved.cached:
            code = code_digest("twilight.engine.one_sun", "twilight.engine.sun_tables")
            self._key = "".join(solved.keys) + repr(self.altitude_km) + code

    def under(self, sun_elevation_deg: float) -> SkyTable:
        """The table of one sun, between its neighbours; below the lowest sun logarithms fall on straight."""
        nodes, weights = sun_weights(self.suns_deg, np.array([sun_elevation_deg]))
        used = [int(k) for k in np.unique(nodes[0][weights[0] != 0.0])]
        low, high = (int(np.clip(k, 0, self.suns_deg.size - 1)) for k in (min(used), max(used)))
        return stack([self._table(k) for k in range(low, high + 1)]).under(sun_elevation_deg)

    def missing(self, sun_elevation_deg: np.ndarray) -> int:
        """How many tables are to be computed before light is read under these suns."""
        nodes, weights = sun_weights(self.suns_deg, sun_elevation_deg)
        each = [int(k) for k in np.unique(nodes[weights != 0.0])]
        cached = (bool(self._key) and cache.find(cache.SKIES, self._name(k)) is not None for k in each)
        return sum(k not in self._made and not there for k, there in zip(each, cached, strict=True))

    def light(
        self,
        sun_elevation_deg: np.ndarray,
        elevation_deg: np.ndarray,
        azimuth_deg: np.ndarray,
        progress: Progress = silent,
    ) -> np.ndarray:
        """Light in directions (D,), each under a sun of its own (D,), (D, W); azimuths from the sun."""
        nodes, weights = sun_weights(self.suns_deg, sun_elevation_deg)
        used = np.unique(nodes[weights != 0.0])
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

    def _table(self, k: int) -> SkyTable:
        """The table of one of the suns."""
        if k not in self._made:
            name = self._name(k)
            fresh = _stored(name) if self._key else None
            if fresh is None:
                sun = float(self.suns_deg[k])
                nodes = {"rows_deg": self.rows_deg, "columns_deg": self.columns_deg}
                shared = float(np.clip(AUREOLE_SUN_DEG, *self.suns_deg[[0, -1]]))
                fresh = self.solved.table(sun, self.altitude_km, **nodes, aureole_sun_deg=shared, refine=False)
                if self._key:
                    cache.store_arrays(cache.SKIES, name, fresh.arrays())
            self._made[k] = fresh
        return self._made[k]

    def _name(self, k: int) -> str:
        nodes = f"{self.rows_deg.tolist()} {self.columns_deg.tolist()}"
        return hashlib.sha256(f"{self._key} {self.suns_deg[k]!r} {nodes}".encode()).hexdigest()


def _stored(name: str) -> SkyTable | None:
    """A table of the cache; None where there is none, or a damaged one."""
    arrays = cache.read_arrays(cache.SKIES, name)
    try:
        return None if arrays is None else SkyTable.of_arrays(arrays)
    except (ValueError, KeyError, TypeError):
        cache.discard(cache.path_of(cache.SKIES, name))
        return None
