"""Pictures from any place: what every pixel of a view sees, the ground and space included.

A view is computed on rows and columns of directions that are as fine as its pixels where the light changes fast (at the
horizon, which refraction moves, about the sun, along the ground by geocentric angle) and coarser elsewhere, and read
from there by the logarithm, linearly.  The light is its own mirror image about the sun's vertical.  The pixels are made
by rows when they are asked for (`ViewRadiance.rows`), so that a picture of any size takes the memory of some of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twilight.base.conventions import EARTH_RADIUS_KM
from twilight.base.errors import TwilightError
from twilight.config.terrain import Terrain
from twilight.config.view import View
from twilight.engine.answer import join
from twilight.engine.block import Block
from twilight.engine.moon import MoonLight, with_moon
from twilight.engine.night import NightLight
from twilight.engine.sunbeam import Direct
from twilight.io.rendered import ViewPixels
from twilight.numerics.orientation import azimuth_elevation, direction
from twilight.sky.disc import SOLAR_RADIUS_DEG
from twilight.solvers.base import Capabilities
from twilight.terrain.aerial_perspective import DEGREE
from twilight.terrain.heights import Standpoint, heights_of
from twilight.terrain.scene import Viewpoint, add_terrain, check_above
from twilight.transport.beam import prepare_beam
from twilight.transport.scaling import delta_scaled

GROWTH = 0.06
"""Growth of the steps between nodes per distance from where the nodes are finest."""
LARGEST_STEP_DEG = 2.0
"""Largest step between nodes [deg]."""
COARSEST_DEG = 0.5
"""Largest distance of elevations at the horizon [deg], however coarse the pixels are."""
HORIZON_BAND_DEG = (-0.15, 0.6)
"""Elevations from the horizon of straight lines [deg] to which refraction may move it; steps there are a pixel."""
GROUND_STEP_DEG = 0.5
"""Step of the geocentric angle along the ground [deg], by which the solar zenith angle changes there."""
AUREOLE_STEP_DEG = 0.2
"""Smallest step about the sun [deg], which the light of the aureole needs."""
DARK = 1e-30
"""Radiance [sr^-1] that stands for none where logarithms are interpolated."""
PIXELS_AT_ONCE = 1 << 18
"""Pixels whose directions are held at once."""
PITCH_ROWS = 64
"""Rows of a picture in which the angle between its pixels is measured."""


def graded_nodes(
    centre: float, finest: float, low: float, high: float, largest: float = LARGEST_STEP_DEG
) -> np.ndarray:
    """Places from low to high, `finest` apart at the centre and farther apart away from it."""
    offsets = [0.0]
    while offsets[-1] < max(high - centre, centre - low):
        offsets.append(offsets[-1] + min(max(finest, GROWTH * offsets[-1]), largest))
    places = centre + np.concatenate([-np.array(offsets[:0:-1]), offsets])
    return places[(places > low) & (places < high)]


def elevation_nodes(
    low: float, high: float, pitch: float, altitude_km: float, ground_radius_km: float, sun_elevation_deg: float
) -> np.ndarray:
    """Elevations (E,) [deg] from low to high for pixels `pitch` deg apart, seen from an altitude above the ground."""
    r = ground_radius_km
    dip = float(np.degrees(np.arccos(r / (r + altitude_km))))
    below, above = HORIZON_BAND_DEG
    parts = [
        np.array([low, high]),
        graded_nodes(-dip + below, pitch, low, -dip + below),
        np.arange(-dip + below, -dip + above, pitch),
        graded_nodes(-dip + above, pitch, -dip + above, high),
    ]
    if low < sun_elevation_deg < high:
        parts.append(graded_nodes(sun_elevation_deg, max(pitch, AUREOLE_STEP_DEG), low, high))
    psi = np.radians(np.arange(0.0, dip, GROUND_STEP_DEG))
    parts.append(np.degrees(np.arctan2(r * np.cos(psi) - (r + altitude_km), r * np.sin(psi))))
    nodes = np.unique(np.concatenate(parts))
    nodes = nodes[(nodes >= low) & (nodes <= high)]
    apart = [nodes[0]]
    for node in nodes[1:]:
        if node - apart[-1] > 0.3 * pitch:
            apart.append(node)
    return np.array([*apart, high]) if apart[-1] < high else np.array(apart)


def azimuth_nodes(low: float, high: float, pitch: float, altitude_km: float) -> np.ndarray:
    """Azimuths (A,) [deg] from the sun, within 0..180; finer for observers who see far along the ground."""
    largest = 2.0 if altitude_km < 100.0 else 1.0
    inner = graded_nodes(0.0, max(pitch, AUREOLE_STEP_DEG), low, high, largest)
    return np.unique(np.concatenate([[low], inner, [high]])) if high > low else np.array([low])


def pixel_pitch_deg(view: View) -> float:
    """Angle between neighbouring pixels [deg]: the medians across and down the picture, the smaller one."""
    height, _ = view.shape
    across, down = [], []
    for row in np.unique(np.linspace(0, max(height - 2, 0), PITCH_ROWS).astype(int)):
        rays = view.rays((row, min(row + 2, height)))
        across.append(np.linalg.norm(np.diff(rays, axis=1), axis=-1).ravel())
        down.append(np.linalg.norm(np.diff(rays, axis=0), axis=-1).ravel())
    steps = [np.concatenate(part) for part in (across, down)]
    return float(np.degrees(min(np.nanmedian(part) for part in steps if np.isfinite(part).any())))


def most_nodes(view: View, altitude_km: float) -> int:
    """Most directions that a view is computed on, from an altitude above the ground: those of the whole sphere."""
    pitch = pixel_pitch_deg(view)
    e = elevation_nodes(-90.0, 90.0, min(pitch, COARSEST_DEG), altitude_km, EARTH_RADIUS_KM, 0.0)
    return e.size * azimuth_nodes(0.0, 180.0, pitch, altitude_km).size


@dataclass(frozen=True)
class ViewRadiance:
    """What a view shows, on nodes; its pixels are made when they are asked for.

    elevation_deg (E,), azimuth_deg (A,): the nodes, azimuths from the sun within 0..180; radiance (E, A, W):
    sun-normalised [sr^-1]; pitch_deg: angle between pixels; direct: the sun's light at the observer, None: no disc;
    night: in the same unit, None: there is none; light_azimuth_deg: from which the nodes' azimuths count, from the sun;
    moon: the same view under the moon alone, and its light, None: there is none.
    """

    view: View
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    radiance: np.ndarray
    pitch_deg: float
    sun_elevation_deg: float
    direct: Direct | None = None
    night: NightLight | None = None
    light_azimuth_deg: float = 0.0
    moon: tuple[ViewRadiance, MoonLight] | None = None

    @property
    def kind(self) -> str:
        """The name of the projection."""
        return self.view.kind

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width) [pixels]."""
        return self.view.shape

    def rows(self, first: int, stop: int) -> ViewPixels:
        """Some rows of the picture, with the sun's disc where `direct` is known."""
        rays = self.view.rays((first, stop))
        azimuth, elevation = azimuth_elevation(rays)
        inside = np.isfinite(elevation)
        away = np.mod(azimuth - self.light_azimuth_deg, 360.0)
        folded = np.minimum(away, 360.0 - away)[inside]
        picture = np.full((*elevation.shape, self.radiance.shape[-1]), np.nan, np.float32)
        picture[inside] = interpolate(self.elevation_deg, self.azimuth_deg, self.radiance, elevation[inside], folded)
        seen = ViewPixels(self.kind, rays.astype(np.float32), picture, self.pitch_deg)
        if self.night is not None:
            seen = with_night(seen, self.night)
        if self.moon is not None:
            by_moon, light = self.moon
            seen = with_moon(seen, by_moon.rows(first, stop).radiance, light)
        return seen if self.direct is None else with_sun(seen, self.direct, self.sun_elevation_deg)

    def whole(self) -> ViewPixels:
        """The picture."""
        return self.rows(0, self.shape[0])


def check_view(view: View, able: Capabilities, title: str) -> None:
    """TwilightError for a view that goes below the horizontal, where the solver cannot look."""
    if not able.looks_down and _extent(view)[0][0] < 0.0:
        raise TwilightError(
            f"{title}: a view {view.kind} goes below the horizon, where its solver cannot look; take zones, tables, "
            "cells or montecarlo (--solver), or a panorama"
        )


def view_radiance(block: Block, view: View, sun_elevation_deg: float, light_azimuth_deg: float = 0.0) -> ViewRadiance:
    """What a block of wavelengths shows in a view, without the sun's disc.

    light_azimuth_deg: from the sun, of a second light that stands at `sun_elevation_deg` in its place.
    """
    (low, high), (left, right) = _extent(view)
    if light_azimuth_deg:
        left, right = 0.0, 180.0
    pitch = pixel_pitch_deg(view)
    medium = block.medium
    above_ground = block.scene.altitude_km - medium.bottom_km
    radius = medium.earth_radius_km + medium.bottom_km
    e = elevation_nodes(low, high, min(pitch, COARSEST_DEG), above_ground, radius, sun_elevation_deg)
    a = azimuth_nodes(left, right, pitch, above_ground)
    rows = e.size if block.capabilities.standard_error else block.rows_at_once(a.size)
    parts = [
        block.answer(sun_elevation_deg, *np.meshgrid(e[k : k + rows], a, indexing="ij")) for k in range(0, e.size, rows)
    ]
    radiance = join(parts, axis=0).radiance
    return ViewRadiance(view, e, a, radiance, pitch, sun_elevation_deg, light_azimuth_deg=light_azimuth_deg)


def join_views(views: Sequence[ViewRadiance], direct: Direct | None) -> ViewRadiance:
    """The same view at the wavelengths of all blocks, and the sun's disc in it."""
    return replace(views[0], radiance=np.concatenate([one.radiance for one in views], axis=-1), direct=direct)


def _extent(view: View) -> tuple[tuple[float, float], tuple[float, float]]:
    """The least and the largest elevation, and azimuth from the sun within 0..180, of all pixels [deg]."""
    height, width = view.shape
    step = max(1, PIXELS_AT_ONCE // width)
    found = []
    for first in range(0, height, step):
        azimuth, elevation = azimuth_elevation(view.rays((first, min(first + step, height))))
        inside = np.isfinite(elevation)
        if inside.any():
            e, a = elevation[inside], np.minimum(azimuth, 360.0 - azimuth)[inside]
            found.append((e.min(), e.max(), a.min(), a.max()))
    low, high, left, right = np.array(found).T
    return (float(low.min()), float(high.max())), (float(left.min()), float(right.max()))


def check_terrain(able: Capabilities, terrain: Terrain, altitude_km: float, standpoint: Standpoint | None) -> None:
    """TwilightError for a solver that cannot put terrain before its sky, for heights that cannot be read, and for an
    observer under the ground."""
    if not (able.finite_segments and able.every_observer and able.kind != "formula"):
        raise TwilightError("terrain: needs a solver with finite segments and every observer: zones or tables")
    check_above(heights_of(terrain, standpoint=standpoint), altitude_km)


def landscape(
    block: Block,
    seen: ViewPixels,
    terrain: Terrain,
    sun_elevation_deg: float,
    standpoint: Standpoint | None = None,
    light_azimuth_deg: float = 0.0,
) -> ViewPixels:
    """What a block of wavelengths shows of a view with terrain in it.

    standpoint: of an observer whose place and sun are known, by which terrain with coordinates is laid.
    light_azimuth_deg: as in `view_radiance`.
    """
    medium, altitude = block.medium, block.scene.altitude_km
    place = Viewpoint(altitude, sun_elevation_deg, block.direct(sun_elevation_deg).bending_deg)
    scaled = getattr(block.field, "scaled", None) or delta_scaled(medium, DEGREE)
    beam = prepare_beam(scaled.medium)
    heights = heights_of(terrain, standpoint=standpoint).facing(light_azimuth_deg)
    c, s = np.cos(np.radians(light_azimuth_deg)), np.sin(np.radians(light_azimuth_deg))
    rays = seen.rays.astype(float) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    made = add_terrain(seen.radiance, rays, heights, block.field, medium, beam, place, terrain.albedo, terrain.shadows)
    return ViewPixels(seen.kind, seen.rays, made.radiance, seen.pitch_deg, hidden=np.isfinite(made.distance_km))


def interpolate(e: np.ndarray, a: np.ndarray, values: np.ndarray, elevation: np.ndarray, azimuth: np.ndarray):
    """Values (E, A, W) at directions (D,): linear in the logarithm, (D, W) float32."""
    logarithm = np.log(np.maximum(values, DARK)).astype(np.float32)
    i = np.clip(np.searchsorted(e, elevation, side="right") - 1, 0, max(e.size - 2, 0))
    j = np.clip(np.searchsorted(a, azimuth, side="right") - 1, 0, max(a.size - 2, 0))
    i1, j1 = np.minimum(i + 1, e.size - 1), np.minimum(j + 1, a.size - 1)
    f = np.where(i1 > i, (elevation - e[i]) / np.where(i1 > i, e[i1] - e[i], 1.0), 0.0).astype(np.float32)[:, None]
    g = np.where(j1 > j, (azimuth - a[j]) / np.where(j1 > j, a[j1] - a[j], 1.0), 0.0).astype(np.float32)[:, None]
    out = (1 - f) * ((1 - g) * logarithm[i, j] + g * logarithm[i, j1])
    out += f * ((1 - g) * logarithm[i1, j] + g * logarithm[i1, j1])
    np.exp(out, out=out)
    out[out <= 2 * DARK] = 0.0
    return out


def with_night(seen: ViewPixels, night: NightLight) -> ViewPixels:
    """The view with the night's light behind and in the air; terrain in it is lit as the ground is."""
    lit = night.seen_by(seen.rays.astype(float), seen.pitch_deg, seen.hidden)
    return replace(seen, radiance=(seen.radiance + lit).astype(np.float32))


def with_sun(seen: ViewPixels, direct: Direct, sun_elevation_deg: float) -> ViewPixels:
    """The view with the sun's disc where its light arrives: everywhere as bright as its mean, its edge one pixel wide.

    direct: at the observer; the disc stands where refraction lifts its centre to, and is round.
    """
    if not direct.irradiance.any():
        return seen
    sun = direction(0.0, sun_elevation_deg + direct.bending_deg)
    off_axis = np.degrees(2.0 * np.arcsin(np.minimum(1.0, 0.5 * np.linalg.norm(seen.rays - sun, axis=-1))))
    fraction = np.clip((SOLAR_RADIUS_DEG - off_axis) / seen.pitch_deg + 0.5, 0.0, 1.0)
    if seen.hidden is not None:
        fraction = np.where(seen.hidden, 0.0, fraction)
    solid_angle = 2.0 * np.pi * (1.0 - np.cos(np.radians(SOLAR_RADIUS_DEG)))
    covered = np.nan_to_num(fraction)
    disc = covered[..., None] * (direct.irradiance / solid_angle)
    covered = covered if seen.sun is None else np.maximum(seen.sun, covered)
    return replace(seen, radiance=(seen.radiance + disc).astype(np.float32), sun=covered)
