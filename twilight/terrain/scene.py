"""A view with terrain in it: what is seen of the ground, through the air, and the shadows that it casts in the air.

The ground is lit by the sun, where no other ground hides it, and by the sky, whose irradiance is that of the open
horizontal plane times the fraction of the sky over a slope.  Between the ground and the eye the air adds light and
takes some (`field.inscatter`, forward peaks counted as passed).  The added light has two parts,

    L = M + sum over species s of p_s(angle to the sun) G_s,

G_s the sunlight that reaches the species along the line and would reach the eye (`march.sunlight_on_lines`), M all
light scattered more than once: both change little between neighbouring lines, where p_s has a peak at the sun.  In the
shadow of a mountain G_s falls to its lit fraction, which is never below 0, and M stays as without mountains.  For
comparison shadows can be cut off as Bruneton and Neyret 2008 do (eq. 17 and 18).  Lines of sight are straight, the sun
is a point that refraction has lifted.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.conventions import DARK, ROUNDING
from twilight.base.errors import TwilightError
from twilight.base.threads import in_slices
from twilight.numerics.directions import azimuth_elevation
from twilight.terrain.aerial_perspective import AerialPerspective, sunlit_air
from twilight.terrain.heights import Heights
from twilight.terrain.march import (
    Lines,
    ShadowGrid,
    SunlightSums,
    first_hits,
    height_at,
    lit_ground,
    shadow_field,
    sunlight_on_lines,
)
from twilight.transport.beam import Beam, beam_at
from twilight.transport.scaling import species_phase

FARTHEST_KM = 600.0
"""Longest line of sight to terrain [km]."""
STEPS = 160
"""Parts of a line of sight in which shadows are looked for."""
SHADOW_POINTS = 700
"""Most points along a side of the shadows' grid."""
LINES_AT_ONCE = 1 << 16
"""Pixels whose air is computed at one time, which bounds the memory of large pictures."""


class Viewpoint(NamedTuple):
    """The observer's altitude [km], the sun's true elevation there [deg] and its lift by refraction [deg]."""

    altitude_km: float
    sun_elevation_deg: float
    bending_deg: float

    @property
    def sun_rad(self) -> float:
        """Apparent elevation of the sun [rad]."""
        return float(np.radians(self.sun_elevation_deg + self.bending_deg))


class SunlitAir(NamedTuple):
    """Air under one sun: its field, a `SegmentField` that serves every observer or a `FormulaField`, whose sun lights
    the ground; its medium, the sunbeam in it, and who sees it."""

    field: Any
    medium: Medium
    beam: Beam
    place: Viewpoint


class FormulaField:
    """The field of a formula, over a flat ground and with one sky for every altitude, as `add_terrain` takes it.

    Below the ground that the formula is for there is no air: a line ends where it meets that.
    """

    def __init__(self, field: Any):
        self.field = field
        self.sunlight = field.sunlight

    def radiance(self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float):
        """As `Field.radiance` of :mod:`twilight.solvers.base`."""
        return self.field.radiance(sun_elevation_deg, elevation_deg, azimuth_deg)

    def inscatter(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, distance_km, *, observer_altitude_km: float,
        peak_passes: bool,
    ):  # fmt: skip
        """As `SegmentField.inscatter` of the same."""
        down = np.maximum(-np.sin(np.radians(elevation_deg)), 1e-12)
        end = np.minimum(distance_km, (1.0 - ROUNDING) * self.field.height_km / down)
        return self.field.inscatter(sun_elevation_deg, elevation_deg, azimuth_deg, end)


class TerrainView(NamedTuple):
    """radiance (H, W, K) [sr^-1]; distance_km (H, W): of the terrain, inf where there is none."""

    radiance: np.ndarray
    distance_km: np.ndarray


def add_terrain(
    sky: np.ndarray,
    rays: np.ndarray,
    heights: Heights,
    lit: SunlitAir,
    albedo: float,
    shadows: str,
    mapped: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> TerrainView:
    """The picture `sky` (H, W, K) [sr^-1] of rays (H, W, 3) with terrain.

    shadows: exact, segments or none; mapped: albedo (D, K) in directions from the sun, as far as an angle about the
    Earth's centre, (D,) [rad] each, NaN where it is `albedo`, or outside of the heights the medium's.
    Errors: TwilightError where the observer is under the ground.
    """
    medium, place = lit.medium, lit.place
    radius = medium.earth_radius_km
    check_above(heights, place.altitude_km)
    azimuth_deg, elevation_deg = azimuth_elevation(rays)
    inside = np.isfinite(elevation_deg)
    e, a = np.radians(elevation_deg[inside]), np.radians(azimuth_deg[inside])
    far = np.empty(e.size)
    straight = Lines(radius, place.altitude_km, e, a, np.full(e.size, FARTHEST_KM))
    in_slices(lambda i, j: first_hits(heights, medium.bottom_km, straight, far, i, j), e.size)
    lines = _Lines(heights, lit, albedo, shadows, mapped, e, a, far)
    light = np.array(sky[inside], dtype=np.float32)
    for start in range(0, e.size, LINES_AT_ONCE):
        part = slice(start, start + LINES_AT_ONCE)
        light[part] = lines.radiance(part, light[part].astype(float))
    whole = np.array(sky, dtype=np.float32)
    whole[inside] = light
    distance = np.full(inside.shape, np.nan)
    distance[inside] = far
    return TerrainView(whole, distance)


def check_above(heights: Heights, altitude_km: float) -> None:
    """TwilightError where an observer is under the ground."""
    under = height_at(heights, 0.0, 0.0)
    if under > altitude_km:
        raise TwilightError(f"observer.altitude_km is {altitude_km:.3f}, below the terrain there ({under:.3f} km)")


class _Lines:
    """All lines of sight of a picture: elevation, azimuth (D,) [rad], far (D,) [km] of the ground, inf for the sky."""

    def __init__(self, heights: Heights, lit: SunlitAir, albedo: float, shadows: str, mapped, e, a, far):
        field, medium, beam, place = lit
        self.heights, self.medium, self.beam, self.place = heights, medium, beam, place
        self.albedo, self.shadows, self.mapped, self.sun = albedo, shadows, mapped, place.sun_rad
        self.e, self.a, self.far = e, a, far
        self.radius = medium.earth_radius_km
        self.true_sun = float(np.radians(place.sun_elevation_deg))
        self.air, self.forward_fraction = sunlit_air(field, medium)
        self.aerial = AerialPerspective(lit, self.air, self.forward_fraction, np.degrees(e), np.degrees(a), far)
        self.shadow = None if shadows == "none" else _shadow(heights, self.radius, self.sun)
        hit = np.isfinite(far)
        sunward_km, altitude_km = _ends(self.radius, place.altitude_km, e[hit], a[hit], far[hit])
        self.sun_factor = self._sun_factor(field)
        self.sky = None
        if hit.any():
            self.sky = _SkyIrradiance(field, place, self.radius, medium.bottom_km, sunward_km, altitude_km)

    def _sun_factor(self, field: Any) -> np.ndarray:
        """Sunlight of a formula over that of the beam at the observer, (W,); 1 for other fields."""
        light = np.ones(self.medium.n_wavelengths)
        if not hasattr(field, "sunlight"):
            return light
        beam_at(self.beam, self.place.altitude_km, np.sin(self.true_sun), light)
        own = field.sunlight(self.place.sun_elevation_deg)
        return np.divide(own, light, out=np.zeros_like(own), where=light > 0.0)

    def radiance(self, part: slice, light: np.ndarray) -> np.ndarray:
        """Radiance (D, W) of some lines; light (D, W): of the sky behind."""
        e, a, far = self.e[part], self.a[part], self.far[part]
        hit = np.isfinite(far)
        lit = np.ones((e.size, len(self.forward_fraction) + 1, light.shape[1]))
        phase, dark = self._phase(e, a), np.zeros(e.size)
        taken = np.zeros_like(light)
        if self.shadow is not None:
            lit, taken, dark = self._shaded(e, a, far, phase)
        exact = self.shadows == "exact"
        if hit.any():
            air, passed = self.aerial.at(e[hit], a[hit], far[hit], phase[hit], lit[hit] if exact else None)
            if self.shadows == "segments":
                near = np.maximum(far[hit] - dark[hit], 0.0)
                air = np.maximum(self.aerial.at(e[hit], a[hit], near, phase[hit])[0], 0.0)
            light[hit] = air + passed * self._ground(e[hit], a[hit], far[hit])
        if exact:
            light[~hit] = np.maximum(light[~hit] - taken[~hit], 0.0)
        elif self.shadows == "segments":
            some = ~hit & (dark > 0.0)
            if some.any():
                light[some] -= self.aerial.at(e[some], a[some], dark[some], phase[some])[0]
                light[some] = np.maximum(light[some], 0.0)
        return light

    def _phase(self, e: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Phase functions (D, S, W) [sr^-1] at the angles from the sun where it is seen."""
        cosine = np.sin(e) * np.sin(self.sun) + np.cos(e) * np.cos(self.sun) * np.cos(a)
        return species_phase(self.medium, self.forward_fraction, np.clip(cosine, -1.0, 1.0))

    def _shaded(self, e, a, far, phase) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(lit fraction (D, S, W) of the sunlight on lines, light (D, W) that shadows take away, dark length (D,))."""
        assert self.shadow is not None
        shape = (e.size, self.air.scattering.shape[0], self.medium.n_wavelengths)
        sums = SunlightSums(np.zeros(shape), np.zeros(shape), np.zeros(e.size), STEPS, False)
        end = np.where(np.isfinite(far), far, _leaves(self.shadow, self.place.altitude_km, self.radius, e))
        to_sun = np.array([np.sin(self.true_sun), np.cos(self.true_sun)])
        lines = Lines(self.radius, self.place.altitude_km, e, a, end)
        about = self.shadow, self.air, self.beam
        in_slices(lambda i, j: sunlight_on_lines(*about, lines, to_sun, sums, i, j), e.size)
        lit = 1.0 - np.divide(sums.dark, sums.whole, out=np.zeros(shape), where=sums.whole > 0.0)
        return np.maximum(lit, 0.0), (phase * sums.dark).sum(axis=1), sums.length

    def _ground(self, e: np.ndarray, a: np.ndarray, far: np.ndarray) -> np.ndarray:
        """Radiance (D, W) of the ground where lines end."""
        assert self.sky is not None
        direct, about = np.zeros((e.size, self.medium.n_wavelengths)), np.zeros((e.size, 3))
        lines, suns = Lines(self.radius, self.place.altitude_km, e, a, far), (self.sun, self.true_sun)
        in_slices(lambda i, j: lit_ground(self.heights, self.beam, lines, *suns, direct, about, i, j), e.size)
        sky = self.sky.at(*_ends(self.radius, self.place.altitude_km, e, a, far))
        reflects = np.where(about[:, 2:] > 0.0, self.albedo, self.medium.ground_albedo)
        if self.mapped is not None:
            turn = np.arctan2(far * np.cos(e), self.radius + self.place.altitude_km + far * np.sin(e))
            found = self.mapped(a, turn)
            reflects = np.where(np.isnan(found), reflects, found)
        return reflects / np.pi * (direct * self.sun_factor + 0.5 * (1.0 + about[:, :1]) * sky)


def _ends(radius_km: float, altitude_km: float, e, a, far) -> tuple[np.ndarray, np.ndarray]:
    """(distance along the ground towards the sun [km], altitude [km]) of the ends of lines."""
    r = radius_km + altitude_km
    along = radius_km * np.arctan2(far * np.cos(e), r + far * np.sin(e))
    return along * np.cos(a), np.sqrt(r * r + far * (far + 2.0 * r * np.sin(e))) - radius_km


def sky_irradiance(field: Any, sun_elevation_deg: float, altitude_km: float) -> np.ndarray:
    """Irradiance (W,) of the sky on a horizontal plane over F0."""
    node, weight = np.polynomial.legendre.leggauss(10)
    sine = np.sqrt(0.5 * (node + 1.0))  # even in sin^2: what a horizontal plane weighs with
    azimuth = (np.arange(12) + 0.5) * 15.0
    grid = np.meshgrid(np.degrees(np.arcsin(sine)), azimuth, indexing="ij")
    seen = field.radiance(sun_elevation_deg, *grid, observer_altitude_km=altitude_km).mean(axis=1)
    return np.asarray(np.pi * (0.5 * weight) @ seen)


class _SkyIrradiance:
    """Irradiance of the sky on a horizontal plane over F0, at places so far towards the sun and so high."""

    def __init__(self, field: Any, place: Viewpoint, radius_km: float, bottom_km: float, sunward_km, altitude_km):
        self.sun_deg, self.radius_km, self.bottom_km = place.sun_elevation_deg, radius_km, bottom_km
        turn = np.degrees(sunward_km / radius_km)
        self.suns = np.unique(np.clip(self.sun_deg + np.linspace(turn.min(), turn.max(), 3), -90.0, 90.0))
        low, high = max(altitude_km.min(), bottom_km), max(altitude_km.max(), bottom_km)
        self.levels = np.linspace(low, high, 3) if high - low > 1e-3 else np.array([high])
        self.logs = []
        for level in self.levels:
            irradiances = [sky_irradiance(field, float(s), float(level)) for s in self.suns]
            self.logs.append(np.log(np.maximum(irradiances, DARK)))

    def at(self, sunward_km: np.ndarray, altitude_km: np.ndarray) -> np.ndarray:
        """(D, W)."""
        where, levels = self.sun_deg + np.degrees(sunward_km / self.radius_km), self.levels
        by_level = [np.stack([np.interp(where, self.suns, c) for c in log.T], axis=-1) for log in self.logs]
        if levels.size == 1:
            return np.exp(by_level[0])
        altitude = np.clip(altitude_km, levels[0], levels[-1])
        i = np.clip(np.searchsorted(levels, altitude, side="right") - 1, 0, levels.size - 2)
        fraction = ((altitude - levels[i]) / (levels[i + 1] - levels[i]))[:, None]
        stacked, row = np.stack(by_level), np.arange(i.size)
        return np.exp((1.0 - fraction) * stacked[i, row] + fraction * stacked[i + 1, row])


def _shadow(heights: Heights, radius_km: float, sun: float) -> ShadowGrid:
    """The terrain's shadow over the square that it covers and what lies behind it, as far as it is above the ground."""
    rows, columns = heights.altitude_km.shape
    size = 0.5 * np.hypot(rows * heights.step_y_km, columns * heights.step_x_km)
    middle = heights.low_y_km + 0.5 * (rows - 1) * heights.step_y_km
    # over a low sun the Earth falls away under the edge of the shadow, which then leaves the air
    tail = min(0.5 * FARTHEST_KM, 2.5 * heights.highest_km / max(np.tan(sun), 0.01) + 20.0)
    centre_x, centre_y = heights.sin_turn * middle, heights.cos_turn * middle
    low_x, high_x = centre_x - size, centre_x + size
    low_y, high_y = centre_y - size - tail, centre_y + size
    step = max(max(high_x - low_x, high_y - low_y) / SHADOW_POINTS, 0.5 * min(heights.step_x_km, heights.step_y_km))
    x, y = np.arange(low_x, high_x + step, step), np.arange(low_y, high_y + step, step)
    out = np.empty((y.size, x.size))
    in_slices(lambda i, j: shadow_field(heights, radius_km, sun, x, y, out, i, j), y.size)
    return ShadowGrid(out, x[0], y[0], step, float(out.max()))


def _leaves(shadow: ShadowGrid, altitude_km: float, radius_km: float, elevation: np.ndarray) -> np.ndarray:
    """Distance [km] at which lines are above every shadow, at most across its grid."""
    rows, columns = shadow.altitude_km.shape
    most = float(np.hypot(shadow.low_x_km, shadow.low_y_km) + np.hypot(rows, columns) * shadow.step_km)
    rise = max(shadow.highest_km - altitude_km, 0.0)
    sine, r = np.sin(elevation), radius_km + altitude_km
    up = rise * (2.0 * r + rise) / (np.sqrt((r * sine) ** 2 + rise * (2.0 * r + rise)) + r * sine + 1e-9)
    ground = np.where(
        (sine < 0.0) & ((r * sine) ** 2 > altitude_km * (2.0 * radius_km + altitude_km)),
        -r * sine - np.sqrt(np.maximum((r * sine) ** 2 - altitude_km * (2.0 * radius_km + altitude_km), 0.0)),
        np.inf,
    )
    return np.maximum(np.minimum(np.minimum(up, ground), min(most, FARTHEST_KM)), 1e-3)
