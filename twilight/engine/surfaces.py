"""Directions and surfaces, and the light that a field gives them under thousands of suns.

A hemisphere of lines of sight is computed once for each sun of `SunTables`; its integrals over surfaces are smooth in
the sun's elevation, without an aureole, so that thousands of moments need no further directions.  Between nodes of the
sun logarithms are read.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from twilight.base import cache
from twilight.base.arguments import in_units
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, silent
from twilight.engine.field import Field
from twilight.engine.sun_tables import SunTables
from twilight.engine.sunbeam import disc_strips
from twilight.numerics import spectrum
from twilight.numerics.directions import HEMISPHERE_COLUMNS, whole_hemisphere
from twilight.numerics.spectrum import hermite_weights
from twilight.sky.disc import SOLAR_RADIUS_DEG
from twilight.sky.night import NightLevels
from twilight.sky.table import sun_weights

GRAMMAR = (
    "zenith, ELEVATION/AZIMUTH of a direction (azimuth from north, or sun, sun+90 ...), horizontal, "
    "plane:TILT/AZIMUTH, sphere or cylinder"
)
"""What may be asked for, for errors and help."""
_ANGLES = re.compile(r"(?P<height>[-+]?\d+(?:\.\d+)?)/(?P<sun>sun)?(?P<azimuth>[-+]?\d+(?:\.\d+)?)?")
"""Elevation of a direction or tilt of a plane, and azimuth; in lower case."""
TURN_DEG = 10.0
"""Distance of the azimuths of a plane's normal from the sun at which its light is held [deg]."""
HIGHEST_SUN_DEG = 75.0
"""Highest sun whose zenith is read between suns: nearer to it the zenith has a part of the aureole."""
DARKEST = 1e-30
"""Radiance [sr^-1] or irradiance over F0 that stands for none in logarithms."""
DISC_NODES = 160
"""Suns at which the beam is computed, from the first ray that arrives to the zenith, by the cube of their number."""
FEW_LINES = 100
"""Lines of sight up to which they are computed one by one, for each sun whose table or hemisphere is missing."""
FEW_SUNS = 2
"""Moments up to which they are, for each of these suns."""
ZENITH_DEG = 90.0 - 1e-9
"""Elevation from which on a direction is the zenith, whatever its azimuth [deg]."""


@in_units
@dataclass(frozen=True)
class Surface:
    """A surface.

    kind: plane; sphere, whose light is the fluence (actinic flux), the integral of the radiance over all directions;
    cylinder: the mean of all vertical planes.
    tilt_deg: of a plane, 0 level and facing up, 90 vertical, 180 facing down; azimuth_deg: of the plane's normal, from
    north, or from the sun where from_sun is true.
    """

    kind: Literal["plane", "sphere", "cylinder"] = "plane"
    tilt_deg: float = 0.0
    azimuth_deg: float = 0.0
    from_sun: bool = False

    def __post_init__(self) -> None:
        if self.kind not in ("plane", "sphere", "cylinder"):
            raise TwilightError(f"surface: '{self.kind}' is not known; plane, sphere and cylinder are")
        if not (0.0 <= self.tilt_deg <= 180.0 and np.isfinite(self.azimuth_deg)):
            raise TwilightError(f"surface: tilt_deg is {self.tilt_deg:g}; allowed is 0 (level) to 180 (facing down)")

    @staticmethod
    def horizontal() -> Surface:
        """Level, facing up."""
        return Surface()

    def view(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, sun_azimuth_deg: np.ndarray) -> np.ndarray:
        """Irradiance over the radiance and solid angle of directions (N, D), azimuths from north, (N, D).

        plane: max(0, cosine of the angle to its normal); sphere: 1; cylinder: cos(elevation) / pi.
        """
        e = np.radians(elevation_deg)
        if self.kind == "sphere":
            return np.ones_like(e)
        if self.kind == "cylinder":
            return np.cos(e) / np.pi
        tilt = np.radians(self.tilt_deg)
        normal = self.azimuth_deg + (sun_azimuth_deg[:, None] if self.from_sun else 0.0)
        cosine = np.sin(e) * np.cos(tilt) + np.cos(e) * np.sin(tilt) * np.cos(np.radians(azimuth_deg - normal))
        return np.maximum(cosine, 0.0)

    @property
    def ground_view(self) -> float:
        """Irradiance by ground of radiance 1 that fills the lower hemisphere [sr]."""
        if self.kind == "sphere":
            return 2.0 * np.pi
        if self.kind == "cylinder":
            return 0.5 * np.pi
        return 0.5 * np.pi * (1.0 - float(np.cos(np.radians(self.tilt_deg))))

    @property
    def sky_view(self) -> float:
        """Irradiance by a sky of radiance 1 all over [sr]."""
        if self.kind == "plane":
            return np.pi - self.ground_view
        return self.ground_view

    @property
    def turns(self) -> bool:
        """Whether it matters where its normal points to."""
        return self.kind == "plane" and 0.0 < self.tilt_deg < 180.0


@in_units
@dataclass(frozen=True)
class Direction:
    """A line of sight: elevation_deg 0 to 90; azimuth_deg from north, or from the sun where from_sun is true."""

    elevation_deg: float
    azimuth_deg: float = 0.0
    from_sun: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.elevation_deg <= 90.0:
            raise TwilightError(f"direction: elevation_deg is {self.elevation_deg:g}; allowed is 0 to 90")


def towards(text: str) -> Direction | Surface:
    """The direction or the surface of a text; TwilightError for one that is neither."""
    word = text.strip().lower()
    if word == "zenith":
        return Direction(90.0)
    if word == "horizontal":
        return Surface.horizontal()
    if word in ("sphere", "cylinder"):
        return Surface(word)  # type: ignore[arg-type]
    kind, colon, angles = word.partition(":")
    match = _ANGLES.fullmatch(angles if colon and kind == "plane" else word)
    if match is None or not (match["sun"] or match["azimuth"]):
        raise TwilightError(f"towards: '{text}' is none of {GRAMMAR}")
    angles_of = float(match["height"]), float(match["azimuth"] or 0.0), bool(match["sun"])
    return Surface("plane", *angles_of) if colon else Direction(*angles_of)


class OverSuns:
    """Sky light of a solved field on surfaces and in the zenith, for the scene's observer; suns_deg: of `SunTables`."""

    def __init__(self, solved: Field, suns_deg: np.ndarray):
        self._solved, self._suns_deg = solved, suns_deg
        self._lines: dict[int, np.ndarray] = {}
        self._surfaces: dict[tuple[str, float], np.ndarray] = {}
        self._key = ""
        if solved.cached:
            self._key = f"hemisphere {''.join(solved.keys)} {solved.scene.altitude_km!r}"

    def fill(self, sun_elevation_deg: np.ndarray, progress: Progress = silent) -> None:
        """Compute what light under these suns is read from."""
        used = self._used(*sun_weights(self._suns_deg, sun_elevation_deg))
        for n, k in enumerate(used):
            progress(f"sun {self._suns_deg[k]:+.1f} deg", n / used.size)
            self._lines_of(int(k))

    def missing(self, sun_elevation_deg: np.ndarray) -> int:
        """How many hemispheres are to be computed before light is read under these suns."""
        used = self._used(*sun_weights(self._suns_deg, sun_elevation_deg))
        return sum(k not in self._lines and cache.find(cache.SKIES, self._name(int(k))) is None for k in used)

    def zenith(self, sun_elevation_deg: np.ndarray) -> np.ndarray:
        """Sun-normalised radiance [sr^-1] of the zenith under suns (N,), up to HIGHEST_SUN_DEG, (N, W)."""
        nodes, weights = sun_weights(self._suns_deg, sun_elevation_deg)
        used = self._used(nodes, weights)
        light = np.log(np.maximum([self._lines_of(int(k))[-1] for k in used], DARKEST))
        place = np.minimum(np.searchsorted(used, nodes), used.size - 1)
        return np.exp(np.einsum("nk,nkw->nw", weights, light[place]))

    def surface(self, surface: Surface, sun_elevation_deg: np.ndarray, normal_from_sun_deg: np.ndarray) -> np.ndarray:
        """Irradiance of a surface by the sky over F0 (N, W) under suns (N,), its normal (N,) deg from them."""
        nodes, weights = sun_weights(self._suns_deg, sun_elevation_deg)
        key = (surface.kind, surface.tilt_deg)
        if key not in self._surfaces:
            shape = (self._suns_deg.size, _turns(surface).size, self._solved.medium.n_wavelengths)
            self._surfaces[key] = np.full(shape, np.nan)
        table = self._surfaces[key]
        for k in self._used(nodes, weights):
            if np.isnan(table[k, 0, 0]):
                table[k] = np.log(np.maximum(self._integrated(surface, int(k)), DARKEST))
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
        elevation, azimuth, solid = (x[None] for x in whole_hemisphere(float(self._suns_deg[k])))
        turned = [Surface(surface.kind, surface.tilt_deg, float(a)) for a in _turns(surface)]
        weight = np.concatenate([one.view(elevation, azimuth, np.zeros(1)) * solid for one in turned])
        half = weight.shape[1] // 2
        return (weight[:, :half] + weight[:, half:]) @ self._lines_of(k)[:-1]

    def _used(self, nodes: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return np.unique(nodes[weights != 0.0])

    def _lines_of(self, k: int) -> np.ndarray:
        """Radiance (D + 1, W) of one half of `whole_hemisphere`, and of the zenith, under one of the suns."""
        if k not in self._lines:
            sun = float(self._suns_deg[k])
            name = self._name(k)
            stored = _stored(name, self._solved.medium.n_wavelengths) if self._key else None
            if stored is None:
                elevation, azimuth, _ = whole_hemisphere(sun)
                rows, columns = np.append(np.unique(elevation), 90.0), azimuth[:HEMISPHERE_COLUMNS]
                grid = self._solved.radiance(sun, rows[:, None], columns)
                # one line is enough for the zenith
                computed = np.concatenate([grid[:-1].reshape(-1, grid.shape[-1]), grid[-1, :1]]).astype(np.float32)
                if self._key:
                    cache.store_arrays(cache.SKIES, name, {"lines": computed})
                stored = computed
            self._lines[k] = stored.astype(float)
        return self._lines[k]

    def _name(self, k: int) -> str:
        return hashlib.sha256(f"{self._key} {float(self._suns_deg[k])!r}".encode()).hexdigest()


def _turns(surface: Surface) -> np.ndarray:
    """Azimuths of a surface's normal from the sun at which its light is held [deg]."""
    return np.arange(0.0, 180.5, TURN_DEG) if surface.turns else np.zeros(1)


def _stored(name: str, wavelengths: int) -> np.ndarray | None:
    """Lines of the cache; None where there are none, or damaged ones."""
    lines = (cache.read_arrays(cache.SKIES, name) or {}).get("lines", np.zeros(0))
    if lines.ndim != 2 or lines.shape[1] != wavelengths or not np.isfinite(lines).all():
        cache.discard(cache.path_of(cache.SKIES, name))
        return None
    return lines


class DiscOverSuns:
    """The beam at the scene's observer, from nodes of the sun, for the strips of its disc."""

    def __init__(self, solved: Field):
        dark, lit = -40.0, 1.0
        while lit - dark > 1e-6:  # the lowest ray that arrives
            middle = 0.5 * (dark + lit)
            reached = solved.direct(middle).irradiance.any()
            dark, lit = (dark, middle) if reached else (middle, lit)
        self._first_deg = lit
        self._true_deg = lit + (90.0 - lit) * np.linspace(0.0, 1.0, DISC_NODES) ** 3
        beams = [solved.direct(float(e)) for e in self._true_deg]
        self._log = np.log(np.maximum([one.irradiance for one in beams], DARKEST**10))
        self._bending_deg = np.array([one.bending_deg for one in beams])

    def strips(self, sun_elevation_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Apparent elevations [deg] (N, S) of the strips of the discs of suns (N,), and their irradiances at normal
        incidence over F0 (N, S, W); 0 in the dark."""
        offset, fraction = disc_strips()
        true = sun_elevation_deg[:, None] + SOLAR_RADIUS_DEG * offset
        irradiance, bending = self.beam(true.ravel())
        shape = true.shape
        return true + bending.reshape(shape), irradiance.reshape(*shape, -1) * fraction[:, None]

    def beam(self, true_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Irradiance at normal incidence over F0 (T, W) at true elevations (T,) [deg], and the bending (T,) [deg]."""
        lit = np.flatnonzero(true_deg >= self._first_deg)
        irradiance = np.zeros((true_deg.size, self._log.shape[1]))
        bending = np.zeros(true_deg.size)
        # beyond the zenith the disc comes down on the other side
        at = np.where(true_deg > 90.0, 180.0 - true_deg, true_deg)[lit]
        nodes, weights = hermite_weights(self._true_deg, at)
        ends = self._log[nodes[:, 1]], self._log[nodes[:, 2]]
        value = np.einsum("tk,tkw->tw", weights, self._log[nodes])
        irradiance[lit] = np.exp(np.clip(value, np.minimum(*ends), np.maximum(*ends)))
        bending[lit] = (weights * self._bending_deg[nodes]).sum(axis=1)
        return irradiance, bending


@dataclass(frozen=True, eq=False)
class ManySuns:
    """A solved field that answers for directions and surfaces under many suns.

    solved: of a solver whose field serves every sun; levels: of the night, None for none.
    """

    solved: Field
    levels: NightLevels | None = None

    @property
    def wavelength_nm(self) -> np.ndarray:
        """Wavelengths [nm], (W,)."""
        return self.solved.medium.wavelength_nm

    @cached_property
    def solar_irradiance(self) -> np.ndarray:
        """Of the sun at 1 au [W m^-2 nm^-1], mean over each wavelength's bin, (W,)."""
        return spectrum.solar_irradiance(self.wavelength_nm, self.solved.solar_spectrum)

    @cached_property
    def tables(self) -> SunTables:
        """The sky for many suns."""
        return SunTables(self.solved)

    @cached_property
    def over_suns(self) -> OverSuns:
        """What surfaces and the zenith have of it."""
        return OverSuns(self.solved, self.tables.suns_deg)

    @cached_property
    def disc(self) -> DiscOverSuns:
        """The sun's beam."""
        return DiscOverSuns(self.solved)

    def sky(self, sun_elevation_deg: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], (N, D, W), of N suns (N,) and D directions of each (N, D), 0 to 90 deg high,
        azimuths from the sun.

        Where few lines of sight are asked for, each is computed; the zenith and others are read from tables.
        """
        suns = np.broadcast_to(sun_elevation_deg[:, None], elevation_deg.shape)
        out = np.zeros((*elevation_deg.shape, self.wavelength_nm.size))
        zenith = (elevation_deg >= ZENITH_DEG) & (suns <= HIGHEST_SUN_DEG)
        for some, source in ((zenith, self.over_suns), (~zenith, self.tables)):
            if not some.any():
                continue
            missing = source.missing(suns[some]) if self.tables.suns_deg[0] <= suns[some].min() else 0
            asked = np.flatnonzero(some.any(axis=1))
            if some.sum() <= FEW_LINES * missing and asked.size <= FEW_SUNS * missing:
                for n in asked:
                    e, a = elevation_deg[n, some[n]], azimuth_deg[n, some[n]]
                    out[n, some[n]] = self.solved.radiance(float(sun_elevation_deg[n]), e, a)
            elif source is self.tables:
                out[some] = self.tables.light(suns[some], elevation_deg[some], azimuth_deg[some])
            else:
                out[some] = self.over_suns.zenith(suns[some])
        return out
