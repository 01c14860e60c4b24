"""The tables of a field above the air, where a line of sight is given by its place past the Earth.

An observer above the air sees along a line what any other one on it does.  A line is named by its impact parameter p
(its least distance from the Earth's centre were the air not there) and by the sun's elevation and azimuth at its foot:
where it is nearest to the Earth, or meets the sphere of the grazing ray.  There the terminator stands at the same sun
for all lines, so that tables over the foot's sun stay smooth where the Earth's edge is half lit.

    ground    place: angle of the line to the vertical at its foot [deg]
    limb      place: 90 + (p - p_h) / km, p_h of the ray that grazes the ground (by Bouguer's invariant); from p_h by
              the rays that graze the top of the haze and the next layer's edge to r_top

Rows are at the fractions of each part that `page.PageNodes` has; suns are those of the other tables.

The air ends at the radius r_top.  With a scale height H a line that passes s below has erf(sqrt(s / H)) of the light
that it would have were the air to go on, a root of s whose logarithm no table can hold: the limb is stored over

    edge(s) = sqrt(1 - exp(-4 s / (pi H)))

which is that function within 0.7 %, and the page multiplies by it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from twilight.base.conventions import TINY_SINGLE
from twilight.base.progress import Progress, part_of
from twilight.engine import Field
from twilight.engine.sun_tables import LOWEST_SUN_DEG, SunTables, suns_between
from twilight.engine.table import first_columns
from twilight.numerics.spectrum import hermite_weights
from twilight.show.lights import NODES
from twilight.show.page import PageNodes, between_edges, haze_top_km
from twilight.show.tones import Channels, padded_columns
from twilight.sky.table import SkyTable
from twilight.transport.rays import horizon_dip_deg
from twilight.transport.scattered_once import faint_edges

LINE_POWER = 1.5
"""Power with which nodes of the lines above the air stand closer together at the horizon."""
TOP_EDGE_KM = 4.7
"""pi H / 4 of `edge`, H = 6 km as of the air at 80 to 100 km."""
LINES_TO_KM = 300.0
"""Height above the grazing ray up to which the sun's beam and the night's light are listed: over all airglow."""
ABOVE_AIRGLOW_KM = 320.0
"""Height of the observer for whom the night's light above the air is listed: over all airglow."""
ENTRY_LOWEST_SUN_DEG = -33.0
"""Lowest sun for which the field is evaluated where a line enters the air; the suns of its foot are read from those."""
ENTRY_COLUMNS = 33
"""Azimuths of that evaluation, from the sun to its opposite."""
LAST_ROW_DEG = -0.02
"""Elevation of the highest line at the top of the air, which is in the air at all [deg]."""


@dataclass(frozen=True)
class Geometry:
    """Lines of sight past one planet [km]: p of the rays that graze the ground, the top of the haze and the edge of a
    layer above it, the radius of the top of the air, and its altitude above sea level."""

    grazing_km: float
    haze_km: float
    layer_km: float
    top_radius_km: float
    top_km: float

    @classmethod
    def of(cls, solved: Field) -> Geometry:
        """Geometry of the medium of a field."""
        medium, haze_km = solved.medium, haze_top_km(solved)
        radius = medium.earth_radius_km + medium.top_km
        above = (float(z) for z in faint_edges(medium) if haze_km + 1.0 < z < medium.top_km - 1.0)
        layer_km = next(above, haze_km + 0.15 * (medium.top_km - haze_km))
        dips = (horizon_dip_deg(medium, medium.top_km, z) for z in (medium.bottom_km, haze_km, layer_km))
        ground, haze, layer = (radius * math.cos(math.radians(dip)) for dip in dips)
        return cls(ground, haze, layer, radius, medium.top_km)

    def rows(self, nodes: PageNodes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(place, elevation at the top of the air [deg], angle from there to the foot [deg]) (rows,).

        Ground from the nadir up, then limb from the horizon up.
        """
        above = (p - self.grazing_km for p in (self.haze_km, self.layer_km, self.top_radius_km))
        place = between_edges(nodes.rises(space=True), [0.0, 90.0, *(90.0 + km for km in above)])
        ground = np.arange(place.size) < nodes.space[0]
        foot = np.minimum(place, 90.0)
        p = np.where(ground, self.grazing_km * np.sin(np.radians(foot)), self.grazing_km + place - 90.0)
        elevation = -np.degrees(np.arccos(np.minimum(p / self.top_radius_km, 1.0)))
        elevation[-1] = LAST_ROW_DEG
        central_angle_deg = np.where(ground, foot - (90.0 + elevation), -elevation)
        return place, elevation, np.maximum(central_angle_deg, 0.0)

    def edge(self, elevation_deg: np.ndarray) -> np.ndarray:
        """Fraction of the light of lines (rows,) by their elevations at the top of the air that its end leaves."""
        below_km = self.top_radius_km * (1.0 - np.cos(np.radians(elevation_deg)))
        return np.sqrt(-np.expm1(-below_km / TOP_EDGE_KM))

    def line_elevations(self, radius_km: float) -> np.ndarray:
        """Elevations (NODES,) [deg] of lines by their height above the grazing ray, LINES_TO_KM x^1.5, seen from a
        distance from the Earth's centre; positive where they pass above it."""
        p = self.grazing_km + LINES_TO_KM * np.linspace(0.0, 1.0, NODES) ** LINE_POWER
        below = -np.degrees(np.arccos(np.minimum(1.0, p / radius_km)))
        return np.where(p < radius_km, below, 1.0 + p - radius_km)


def at_entry(
    foot_sun_deg: np.ndarray, foot_azimuth_deg: np.ndarray, central_angle_deg: float
) -> tuple[np.ndarray, np.ndarray]:
    """The sun's elevation and azimuth from the line [deg] a geocentric angle before the foot."""
    s, a, psi = np.radians(foot_sun_deg), np.radians(foot_azimuth_deg), math.radians(central_angle_deg)
    along, across, up = np.cos(s) * np.cos(a), np.cos(s) * np.sin(a), np.sin(s)
    elevation = np.arcsin(np.clip(math.cos(psi) * up - math.sin(psi) * along, -1.0, 1.0))
    return np.degrees(elevation), np.degrees(np.arctan2(across, math.cos(psi) * along + math.sin(psi) * up))


def fill_space(
    solved: Field, channels: Channels, nodes: PageNodes, progress: Progress
) -> tuple[SkyTable, SkyTable, Geometry]:
    """Tables above the air by the sun at the foot, whose rows are places: of channels, and of the light at the field's
    wavelengths at every second node, not split; and the lines that they are over."""
    geometry = Geometry.of(solved)
    place, elevation, central_angle_deg = geometry.rows(nodes)
    entry = SunTables(solved, geometry.top_km, rows_deg=elevation, columns_deg=first_columns(ENTRY_COLUMNS))
    entering = entry.between(ENTRY_LOWEST_SUN_DEG, 90.0, part_of(progress, 0.0, 0.9, "above the air"))
    edge, columns = geometry.edge(elevation), nodes.columns_deg(space=True)
    edge[: nodes.space[0]] = 1.0
    filled = _at_feet(entering.seen(channels.of), columns, edge, central_angle_deg)
    rows = nodes.every_second_row(space=True)
    light = np.log(np.maximum(entering.light_at_nodes(), TINY_SINGLE))
    whole = replace(entering, smooth=light, aureole=None, log_phase=None)
    spectra = _at_feet(whole, columns[::2], edge, central_angle_deg)
    suns = every_second(spectra.sun_elevation_deg.size)
    coarse = replace(
        spectra,
        sun_elevation_deg=spectra.sun_elevation_deg[suns],
        elevation_deg=place[rows],
        smooth=spectra.smooth[suns][:, rows],
    )
    return replace(filled, elevation_deg=place), coarse, geometry


def every_second(count: int) -> np.ndarray:
    """Every second of a number of nodes, and the last one."""
    return np.unique(np.append(np.arange(0, count, 2), count - 1))


def _at_feet(table: SkyTable, columns_deg: np.ndarray, edge: np.ndarray, central_angle_deg: np.ndarray) -> SkyTable:
    """A table over the suns where lines enter the air as one over suns and azimuths of their feet, by its own rule."""
    suns = suns_between(LOWEST_SUN_DEG, 90.0, table.sun_elevation_deg)
    s, a = np.meshgrid(suns, columns_deg, indexing="ij")
    places, column = padded_columns(table.azimuth_deg)

    def moved(layer: np.ndarray | None) -> np.ndarray | None:
        if layer is None:
            return None
        out = np.empty((suns.size, layer.shape[1], columns_deg.size, layer.shape[3]), np.float32)
        for r, turned in enumerate(central_angle_deg):
            sun, away = at_entry(s, a, float(turned))
            i, u = hermite_weights(table.sun_elevation_deg, sun.ravel())
            j, v = hermite_weights(places, np.abs(away).ravel())
            weight = (u[:, :, None] * v[:, None, :])[..., None]
            read = (weight * layer[i[:, :, None], r, column[j][:, None, :]]).sum(axis=(1, 2))
            out[:, r] = read.reshape(*s.shape, -1) - np.log(edge[r])
        return out

    smooth = moved(table.smooth)
    assert smooth is not None
    return replace(
        table,
        sun_elevation_deg=suns,
        apparent_sun_deg=suns,
        azimuth_deg=columns_deg,
        smooth=smooth,
        aureole=moved(table.aureole),
    )
