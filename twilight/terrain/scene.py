"""A view with terrain in it: what is seen of the ground, through the air, and the shadows that it casts in the air.

The ground is lit by the sun, where no other ground hides it, and by the sky, whose irradiance is that of the open
horizontal plane times the share of the sky that a slope faces.  Between it and the eye the air adds light and takes
some (`field.inscatter`, forward peaks counted as passed).  In the shadow of a mountain the air lacks the sun: there
sunlight scattered once is taken away, exactly or as Bruneton and Neyret 2008 do (eq. 17 and 18); light scattered more
than once stays as without mountains.  Lines of sight are straight, the sun is a point that refraction has lifted.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.errors import TwilightError
from twilight.orientation import azimuth_elevation
from twilight.terrain.heights import Heights
from twilight.terrain.march import (
    Air,
    Shadow,
    dark_parts,
    first_hits,
    height_at,
    lit_ground,
    shadow_field,
)
from twilight.threads import in_slices
from twilight.transport.beam import Beam
from twilight.transport.scaling import delta_scaled, species_phase

DEGREE = 24
"""Legendre moments beyond which the forward peak of aerosol counts as passed, as the field has it."""
FARTHEST_KM = 600.0
STEPS = 160
"""Parts of a line of sight in which shadows are looked for."""
SHADOW_POINTS = 700
"""Along a side of the shadows' grid, at most."""
ELEVATIONS, DISTANCES = 25, 12
"""Nodes of aerial perspective."""
NEAREST = 1e-3
"""The nearest of them, over the length of the line."""


BELOW_HORIZON = (1e-5, 1e-3, 4e-3, 0.01, 0.02, 0.04, 0.07, 0.11, 0.17, 0.25, 0.4, 0.6)
"""Elevations of nodes below it, in dips of the horizon; lines there are 1.00, 0.96, 0.91 ... times as long as to it."""


class Place(NamedTuple):
    """Where one looks from: altitude [km], true elevation of the sun [deg] and how far it is lifted [deg]."""

    altitude_km: float
    sun_elevation_deg: float
    bending_deg: float


class Result(NamedTuple):
    """radiance (H, W, K) [sr^-1]; distance_km (H, W): of the terrain, inf where there is none; lost (H, W, K): light
    scattered once that shadows take away; dark_km (H, W): length of the shadowed parts."""

    radiance: np.ndarray
    distance_km: np.ndarray
    lost: np.ndarray
    dark_km: np.ndarray


def add_terrain(
    sky: np.ndarray,
    rays: np.ndarray,
    heights: Heights,
    field: Any,
    medium: Medium,
    beam: Beam,
    place: Place,
    albedo: float,
    shadows: str,
) -> Result:
    """The picture `sky` (H, W, K) [sr^-1] of rays (H, W, 3) with terrain.

    field: a `SegmentField` that serves every observer; shadows: exact, segments or none.
    Errors: TwilightError where the observer is under the ground.
    """
    radius = medium.earth_radius_km
    under = height_at(heights, 0.0, 0.0)
    if under > place.altitude_km:
        raise TwilightError(
            f"observer.altitude_km is {place.altitude_km:.3f}, below the terrain there ({under:.3f} km)"
        )
    azimuth_deg, elevation_deg = azimuth_elevation(rays)
    inside = np.isfinite(elevation_deg)
    e, a = np.radians(elevation_deg[inside]), np.radians(azimuth_deg[inside])
    far = np.empty(e.size)
    in_slices(
        lambda i, j: first_hits(heights, radius, medium.bottom_km, place.altitude_km, e, a, FARTHEST_KM, far, i, j),
        e.size,
    )
    sun = np.radians(place.sun_elevation_deg + place.bending_deg)
    light = np.array(sky[inside], dtype=float)
    hit = np.isfinite(far)
    bridge = _Perspective(field, place, medium, np.degrees(e), np.degrees(a), far)
    if hit.any():
        ground = _ground_light(heights, field, medium, beam, place, sun, e[hit], a[hit], far[hit], albedo)
        near, passed = bridge.at(hit, far[hit])
        light[hit] = near + passed * ground
    lost, dark = np.zeros_like(light), np.zeros(e.size)
    if shadows != "none":
        shadow = _shadow(heights, radius, sun)
        reach = np.where(hit, far, _leaves(shadow, place.altitude_km, radius, e))
        scaled = delta_scaled(medium, DEGREE)
        true_sun = np.radians(place.sun_elevation_deg)
        cosine = np.sin(e) * np.sin(true_sun) + np.cos(e) * np.cos(true_sun) * np.cos(a)
        phase = species_phase(medium, scaled.forward_share, cosine)
        air = _air(scaled.medium)
        to_sun = np.array([np.sin(true_sun), np.cos(true_sun)])
        in_slices(
            lambda i, j: dark_parts(
                shadow, air, beam, radius, place.altitude_km, to_sun, e, a, reach, phase, STEPS, lost, dark, i, j
            ),
            e.size,
        )
        if shadows == "exact":
            light = np.maximum(light - lost, 0.0)
        else:
            light = _cut(light, bridge, hit, far, dark)
    whole = np.array(sky, dtype=np.float32)
    whole[inside] = light
    return Result(whole, _spread(inside, far), _spread(inside, lost), _spread(inside, dark))


def _spread(inside: np.ndarray, values: np.ndarray) -> np.ndarray:
    out = np.full((*inside.shape, *values.shape[1:]), np.nan)
    out[inside] = values
    return out


def _cut(light, bridge: _Perspective, hit, far, dark) -> np.ndarray:
    """Bruneton and Neyret 2008: the dark length is cut off at the ground's end (eq. 17) or, towards the sky, at the
    eye's (eq. 18)."""
    out, some = light.copy(), dark > 0.0
    ground, sky = hit & some, ~hit & some
    if ground.any():
        whole, _ = bridge.at(ground, far[ground])
        left, _ = bridge.at(ground, np.maximum(far[ground] - dark[ground], 0.0))
        out[ground] += left - whole
    if sky.any():
        out[sky] -= bridge.at(sky, dark[sky])[0]
    return np.maximum(out, 0.0)


class _Perspective:
    """Aerial perspective of a field on nodes of elevation, azimuth and distance, between them by logarithms.

    Distances are counted in the length of the line, which ends on the medium's ground or at the farthest terrain.
    """

    def __init__(self, field: Any, place: Place, medium: Medium, elevation_deg, azimuth_deg, far_km):
        self.radius_km = medium.earth_radius_km + place.altitude_km
        self.height_km = place.altitude_km - medium.bottom_km
        self.elevation, self.folded = elevation_deg, np.minimum(azimuth_deg, 360.0 - azimuth_deg)
        low, high = float(elevation_deg.min()), float(elevation_deg.max())
        # the length of a line changes ever faster towards the horizon of the medium's ground
        dip = np.degrees(np.arccos(min(1.0, (self.radius_km - self.height_km) / self.radius_km)))
        near = np.concatenate([[-1, -0.3, 0, 0.3, 1], -dip - dip * np.array(BELOW_HORIZON), [-dip + 1e-4]])
        self.e = np.unique(np.concatenate([np.linspace(low, high, ELEVATIONS), np.clip(near, low, high)]))
        first, last = float(self.folded.min()), float(self.folded.max())
        around = np.array([0, 0.5, 1, 2, 3.5, 5, 7.5, 10, 15, 20, 30, 45, 60, 80, 100, 120, 150, 180.0])
        self.a = np.unique(np.concatenate([[first, last], around[(around > first) & (around < last)]]))
        self.reach_km = max(1.0, float(far_km[np.isfinite(far_km)].max(initial=100.0)))
        self.share = np.geomspace(NEAREST, 1.0, DISTANCES)
        e, a, share = np.meshgrid(self.e, self.a, self.share, indexing="ij")
        d = share * self._length_km(e)
        light, passed = field.inscatter(
            place.sun_elevation_deg, e, a, d, observer_altitude_km=place.altitude_km, peak_passes=True
        )
        # per length: almost even close to the eye
        self.log_light = np.log(np.maximum(light, 1e-30) / d[..., None])
        self.depth = -np.log(np.maximum(passed, 1e-30)) / d[..., None]

    def _length_km(self, elevation_deg: np.ndarray) -> np.ndarray:
        down = -self.radius_km * np.sin(np.radians(elevation_deg))
        below = self.height_km * (2.0 * self.radius_km - self.height_km)
        root = np.sqrt(np.maximum(down**2 - below, 0.0))
        ground = np.where((down > 0.0) & (down**2 > below), below / np.maximum(down + root, 1e-9), np.inf)
        return np.clip(ground, 1e-3, self.reach_km)

    def at(self, which: np.ndarray, distance_km: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(light scattered in, transmittance), (D, W) each, of the lines `which` up to distances."""
        length = self._length_km(self.elevation[which])
        s = np.clip(distance_km, 1e-6, length)
        spots = [
            _between(self.e, self.elevation[which]),
            _between(self.a, self.folded[which]),
            _between(np.log(self.share), np.log(np.maximum(s / length, self.share[0]))),
        ]
        light, depth = np.zeros((2, s.size, self.log_light.shape[-1]))
        for corner in range(8):
            index, weight = [], np.ones(s.size)
            for axis, (low, share) in enumerate(spots):
                up = corner >> axis & 1
                index.append(np.minimum(low + up, self.log_light.shape[axis] - 1))
                weight = weight * (share if up else 1.0 - share)
            light += weight[:, None] * self.log_light[tuple(index)]
            depth += weight[:, None] * self.depth[tuple(index)]
        return np.exp(light) * s[:, None], np.exp(-depth * s[:, None])


def _between(nodes: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the node below and the way to the next."""
    if nodes.size == 1:
        return np.zeros(values.size, int), np.zeros(values.size)
    low = np.clip(np.searchsorted(nodes, values, side="right") - 1, 0, nodes.size - 2)
    return low, np.clip((values - nodes[low]) / (nodes[low + 1] - nodes[low]), 0.0, 1.0)


def _ground_light(heights, field, medium, beam, place: Place, sun, e, a, far, albedo: float) -> np.ndarray:
    """Radiance (D, W) of the ground where lines end."""
    radius = medium.earth_radius_km
    direct, about = np.zeros((e.size, medium.n_wavelengths)), np.zeros((e.size, 3))
    true_sun = float(np.radians(place.sun_elevation_deg))
    in_slices(
        lambda i, j: lit_ground(
            heights, beam, radius, place.altitude_km, sun, true_sun, e, a, far, direct, about, i, j
        ),
        e.size,
    )
    r = radius + place.altitude_km
    altitude = np.sqrt(r * r + far * (far + 2.0 * r * np.sin(e))) - radius
    sky = _sky_irradiance(field, place, radius, about[:, 1], np.maximum(altitude, medium.bottom_km))
    reflects = np.where(about[:, 2:] > 0.0, albedo, medium.ground_albedo)
    return reflects / np.pi * (direct + 0.5 * (1.0 + about[:, :1]) * sky)


def _sky_irradiance(field, place: Place, radius_km: float, ahead_km: np.ndarray, altitude_km: np.ndarray) -> np.ndarray:
    """Of the sky on a horizontal plane over F0, (D, W), at places so far towards the sun and so high."""
    turn = np.degrees(ahead_km / radius_km)
    suns = np.unique(np.clip(place.sun_elevation_deg + np.linspace(turn.min(), turn.max(), 3), -90.0, 90.0))
    low, high = altitude_km.min(), altitude_km.max()
    levels = np.linspace(low, high, 3) if high - low > 1e-3 else np.array([high])
    node, weight = np.polynomial.legendre.leggauss(10)
    sine = np.sqrt(0.5 * (node + 1.0))  # even in sin^2: what a horizontal plane weighs with
    azimuth = (np.arange(12) + 0.5) * 15.0
    grid = np.meshgrid(np.degrees(np.arcsin(sine)), azimuth, indexing="ij")
    logs = []
    for level in levels:
        seen = [field.radiance(float(sun), *grid, observer_altitude_km=float(level)).mean(axis=1) for sun in suns]
        logs.append(np.log(np.maximum(np.pi * (0.5 * weight) @ np.array(seen), 1e-30)))
    where = place.sun_elevation_deg + turn
    by_level = [np.stack([np.interp(where, suns, column) for column in log.T], axis=-1) for log in logs]
    i = np.clip(np.searchsorted(levels, altitude_km, side="right") - 1, 0, max(levels.size - 2, 0))
    if levels.size == 1:
        return np.exp(by_level[0])
    share = np.clip((altitude_km - levels[i]) / (levels[i + 1] - levels[i]), 0.0, 1.0)[:, None]
    stacked, row = np.stack(by_level), np.arange(i.size)
    return np.exp((1.0 - share) * stacked[i, row] + share * stacked[i + 1, row])


def _shadow(heights: Heights, radius_km: float, sun: float) -> Shadow:
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
    return Shadow(out, x[0], y[0], step, float(out.max()))


def _leaves(shadow: Shadow, altitude_km: float, radius_km: float, elevation: np.ndarray) -> np.ndarray:
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


def _air(medium: Medium) -> Air:
    step = 0.1
    altitude = np.arange(medium.bottom_km, medium.top_km + step, step)
    at = medium.at(np.minimum(altitude, medium.top_km))
    species = np.concatenate([at.air_scattering[None], at.aerosol_scattering[None] * at.aerosol_share])
    return Air(medium.bottom_km, step, np.ascontiguousarray(at.extinction), np.ascontiguousarray(species))
