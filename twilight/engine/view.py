"""Pictures from any place: what every pixel of a view sees, the ground and space included.

A view is read from a `SkyTable` of what it shows: of the directions that lie in it, with rows as close as half a pixel
where the light needs them, breaks at the horizon and at the edges of layers below.  The pixels are made by rows when
they are asked for (`ViewRadiance.rows`), so that a picture of any size takes the memory of some of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from twilight.base.errors import TwilightError
from twilight.config.pictures import Terrain, View
from twilight.engine.field import Field
from twilight.engine.mapped_ground import Land, MappedGround, join_grounds
from twilight.engine.table import CLOSEST_ROWS_DEG, first_columns, first_rows, row_breaks
from twilight.io.rendered import ViewPixels, ViewSource
from twilight.numerics.directions import azimuth_elevation, direction
from twilight.sky.disc import Disc
from twilight.sky.lights import Luminary
from twilight.sky.night.points import Raster, StarPoints
from twilight.sky.table import SkyTable
from twilight.sky.table import join as join_tables
from twilight.solvers.base import Capabilities
from twilight.terrain.aerial_perspective import DEGREE
from twilight.terrain.heights import Standpoint, heights_of
from twilight.terrain.scene import FormulaField, SunlitAir, Viewpoint, add_terrain, check_above
from twilight.transport.beam import prepare_beam
from twilight.transport.rays import horizon_dip_deg
from twilight.transport.scaling import delta_scaled

FIRST_ROWS, FIRST_COLUMNS = 33, 25
"""Rows above the last break and columns of the whole sphere that a view is computed on first, of which it takes those
that lie in it."""
MOST_NODES = (280, 140)
"""Most rows and columns of a view."""
LEAST_APART_DEG = 1e-3
"""First rows and columns closer than this to the edge of a view are left out [deg]."""
PIECE_DEG = 0.02
"""Largest distance of the directions of a pixel whose mean is a disc's light in the pixel [deg]."""
MOST_PIECES = 24
"""Most of these directions across a pixel."""
PITCH_ROWS = 64
"""Rows of a picture in which the angle between its pixels is measured."""


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


@dataclass(frozen=True)
class ViewRadiance:
    """What a view shows, as a table; its pixels are made when they are asked for.

    table: sun-normalised radiance [sr^-1] of the directions in the view; pitch_deg: angle between pixels; azimuth_deg:
    from which the table's azimuths count, from the sun; ground: what an albedo map adds to the table, None: there is
    none.
    """

    view: View
    table: SkyTable
    pitch_deg: float
    azimuth_deg: float = 0.0
    ground: MappedGround | None = None

    @property
    def kind(self) -> str:
        """The name of the projection."""
        return self.view.kind

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width) [pixels]."""
        return self.view.shape

    def rows(self, first: int, stop: int) -> ViewPixels:
        """Some rows of the picture."""
        rays = self.view.rays((first, stop))
        azimuth, elevation = azimuth_elevation(rays)
        inside = np.isfinite(elevation)
        picture = np.full((*elevation.shape, self.table.smooth.shape[-1]), np.nan, np.float32)
        directions = elevation[inside], azimuth[inside] - self.azimuth_deg
        picture[inside] = self.table.light(*directions)
        if self.ground is not None:
            picture[inside] = np.maximum(picture[inside] + self.ground.light(*directions), 0.0)
        return ViewPixels(self.kind, rays.astype(np.float32), picture, self.pitch_deg)

    def whole(self) -> ViewPixels:
        """The picture."""
        return self.rows(0, self.shape[0])


@dataclass(frozen=True)
class ViewOfLights:
    """A view as the sum of its lights, sun-normalised [sr^-1]; its pixels are made when they are asked for.

    lit: what the luminaries light, the sun's first, each times its irradiance over the sun's; glow: of the night, seen
    before terrain as if that were the ground, None: there is none; stars: points of it, azimuths from the sun; discs:
    what puts the discs of the luminaries into pixels.
    """

    lit: tuple[tuple[ViewSource, np.ndarray | float], ...]
    glow: ViewRadiance | None = None
    stars: StarPoints | None = None
    discs: tuple[Callable[[ViewPixels], ViewPixels], ...] = ()

    @property
    def kind(self) -> str:
        """The name of the projection."""
        return self.lit[0][0].kind

    @property
    def pitch_deg(self) -> float:
        """Angle between pixels [deg]."""
        return self.lit[0][0].pitch_deg

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width) [pixels]."""
        return self.lit[0][0].shape

    def rows(self, first: int, stop: int) -> ViewPixels:
        """Some rows of the picture."""
        pixels = self.lit[0][0].rows(first, stop)
        radiance = pixels.radiance.astype(float)
        if self.glow is not None:
            glow = self.glow.rows(first, stop).radiance
            if pixels.hidden is not None:
                glow[pixels.hidden] = self.glow.table.smooth[0, 0, 0]
            radiance += glow
        if self.stars is not None:
            towards = direction(self.stars.azimuth_deg, self.stars.elevation_deg)
            raster = Raster(pixels.rays.astype(float), self.pitch_deg)
            raster.add(radiance, towards, self.stars.irradiance, pixels.hidden)
        for source, over_sun in self.lit[1:]:
            radiance += source.rows(first, stop).radiance * over_sun
        pixels = replace(pixels, radiance=radiance.astype(np.float32))
        for disc in self.discs:
            pixels = disc(pixels)
        return pixels

    def whole(self) -> ViewPixels:
        """The picture."""
        return self.rows(0, self.shape[0])


def check_view(view: View, able: Capabilities, title: str, mapped: bool = False) -> None:
    """TwilightError for a view that goes below the horizontal, where the solver cannot look, or not at ground of a map
    (mapped)."""
    if not able.looks_down and view.extent_deg[0][0] < 0.0:
        raise TwilightError(
            f"{title}: a view {view.kind} goes below the horizon, where its solver cannot look; take zones, tables, "
            "cells or montecarlo (--solver), or a panorama"
        )
    if mapped and not (able.every_sun and able.every_observer) and view.extent_deg[0][0] < 0.0:
        raise TwilightError(f"{title}: ground.albedo_map is seen with zones or tables (--solver)")


def view_radiance(
    solved: Field, view: View, body: Luminary, like: ViewRadiance | None = None, land: Land | None = None
) -> ViewRadiance:
    """What a field shows in a view under a luminary in the sun's place, its azimuth from the sun, without its disc.

    like: the same at other wavelengths, whose rows and columns are taken to begin with; land: the map of the ground
    about the observer and that light, None: there is none.
    """
    pitch = pixel_pitch_deg(view)
    rows, columns = _first_nodes(solved, view, body.azimuth_deg, pitch)
    if like is not None:
        rows, columns = like.table.elevation_deg, like.table.azimuth_deg
    table = solved.table(
        body.elevation_deg,
        rows_deg=rows,
        columns_deg=columns,
        refine=not solved.scene.capabilities.standard_error,
        closest_rows_deg=min(CLOSEST_ROWS_DEG, 0.5 * pitch),
        most=MOST_NODES,
    )
    seen_ground = land is not None and table.elevation_deg[0] < 0.0
    ground = MappedGround.of(solved, body.elevation_deg, land) if land is not None and seen_ground else None
    return ViewRadiance(view, table, pitch, body.azimuth_deg, ground)


def _first_nodes(solved: Field, view: View, azimuth_deg: float, pitch_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """The rows and columns that a view is computed on first."""
    (low, high), (left, right) = view.extent_deg
    if azimuth_deg or left < 2.0 * pitch_deg:
        left = 0.0  # where the sky is its mirror image
    if azimuth_deg or right > 180.0 - 2.0 * pitch_deg:
        right = 180.0
    altitude = solved.scene.altitude_km
    lowest, breaks = row_breaks(solved.scene, altitude)
    if low < lowest:  # from the ground, where a sky ends at the horizontal
        lowest, breaks = low, [-horizon_dip_deg(solved.medium, altitude)]
    rows, columns = first_rows(lowest, breaks, FIRST_ROWS), first_columns(FIRST_COLUMNS)
    return _between(rows, low, high), _between(columns, left, right)


def _between(nodes: np.ndarray, low: float, high: float) -> np.ndarray:
    """Those of the nodes that lie between two others, with these."""
    if high - low < LEAST_APART_DEG:
        return np.array([low])
    inside = nodes[(nodes > low + LEAST_APART_DEG) & (nodes < high - LEAST_APART_DEG)]
    return np.concatenate([[low], inside, [high]])


def join_views(views: Sequence[ViewRadiance]) -> ViewRadiance:
    """The same view at the wavelengths of all blocks."""
    grounds = [one.ground for one in views if one.ground is not None]
    ground = join_grounds(grounds) if grounds else None
    return replace(views[0], table=join_tables([one.table for one in views]), ground=ground)


def check_terrain(able: Capabilities, terrain: Terrain, altitude_km: float, standpoint: Standpoint | None) -> None:
    """TwilightError for a solver that cannot put terrain before its sky, for heights that cannot be read, and for an
    observer under the ground."""
    if not (able.finite_segments and (able.every_observer or able.kind == "formula")):
        raise TwilightError("terrain: needs finite segments for every observer: zones, tables or preetham")
    check_above(heights_of(terrain, standpoint=standpoint), altitude_km)


def landscape(
    solved: Field,
    seen: ViewPixels,
    terrain: Terrain,
    body: Luminary,
    standpoint: Standpoint | None = None,
    land: Land | None = None,
) -> ViewPixels:
    """What a field shows of a view with terrain in it.

    standpoint: of an observer whose place and sun are known, by which terrain with coordinates is laid.
    body, land: as in `view_radiance`.
    """
    altitude = solved.scene.altitude_km
    heights = heights_of(terrain, standpoint=standpoint).facing(body.azimuth_deg)
    c, s = np.cos(np.radians(body.azimuth_deg)), np.sin(np.radians(body.azimuth_deg))
    rays = seen.rays.astype(float) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    radiance, w = [], 0
    for block in solved.blocks:
        medium = block.medium
        place = Viewpoint(altitude, body.elevation_deg, block.direct(body.elevation_deg).bending_deg)
        scaled = getattr(block.field, "scaled", None) or delta_scaled(medium, DEGREE)
        beam = prepare_beam(scaled.medium)
        sky = seen.radiance[..., w : w + medium.n_wavelengths]
        w += medium.n_wavelengths
        field = FormulaField(block.field) if solved.scene.capabilities.kind == "formula" else block.field
        mapped = None if land is None else partial(_albedo, land, medium.wavelength_nm)
        with_terrain = add_terrain(
            sky, rays, heights, SunlitAir(field, medium, beam, place), terrain.albedo, terrain.shadows, mapped
        )
        radiance.append(with_terrain.radiance)
    shown = np.concatenate(radiance, axis=-1)
    return ViewPixels(seen.kind, seen.rays, shown, seen.pitch_deg, hidden=np.isfinite(with_terrain.distance_km))


def _albedo(land: Land, wavelength_nm: np.ndarray, azimuth: np.ndarray, turn: np.ndarray) -> np.ndarray:
    return land.albedo(np.degrees(azimuth), turn, wavelength_nm)


def with_disc(pixels: ViewPixels, disc: Disc, azimuth_deg: float, scale: float) -> ViewPixels:
    """The view with the disc of sun or moon before it, where no terrain stands.

    azimuth_deg: of its centre from the sun; scale: of its radiance to that over F0 at the view's distance.
    """
    rays, pitch = pixels.rays.astype(float), np.radians(pixels.pitch_deg)
    right = np.cross(rays, [0.0, 0.0, 1.0])
    right *= pitch / np.maximum(np.linalg.norm(right, axis=-1, keepdims=True), 1e-9)
    points = int(np.clip(np.ceil(pixels.pitch_deg / PIECE_DEG), 2, MOST_PIECES))
    radiance = pixels.radiance.copy()
    covered = np.zeros(pixels.shape) if pixels.sun is None else pixels.sun.copy()
    for where, light, part in disc.in_pixels(rays, np.cross(rays, right), right, azimuth_deg, points):
        open_to = np.ones(part.size) if pixels.hidden is None else ~pixels.hidden[where]
        radiance[where] += (light * scale * open_to[:, None]).astype(radiance.dtype)
        covered[where] = np.maximum(covered[where], part * open_to)
    return replace(pixels, radiance=radiance, sun=covered)
