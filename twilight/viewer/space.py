"""The tables of a field above the air, where a line of sight is given by its place past the Earth.

An observer above the air sees along a line what any other one on it does.  A line is named by its impact parameter p
(its least distance from the Earth's centre were the air not there) and by the sun's elevation and azimuth at its foot:
where it is nearest to the Earth, or meets the sphere of the grazing ray.  There the terminator stands at the same sun
for all lines, so that tables over the foot's sun stay smooth where the Earth's edge is half lit.

    ground    angle of the line to the vertical at its foot, 90 (1 - u^2) deg
    limb      p from p_h, of the ray that grazes the ground (by Bouguer's invariant), by that of the ray that grazes the
              top of the haze to r_top, as `tables.rows_above` has it with a power of 1.5

u from 0 to 1 over the rows; suns and azimuths are those of the other tables.

The air ends at the radius r_top.  With a scale height H a line that passes s below has erf(sqrt(s / H)) of the light
that it would have were the air to go on, a root of s whose logarithm no table can hold: the limb is stored over

    edge(s) = sqrt(1 - exp(-4 s / (pi H)))

which is that function within 0.7 %, and the page multiplies by it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RectBivariateSpline

from twilight.base.progress import Progress
from twilight.studies.export import sky_tables
from twilight.studies.export.field_values import JUST_DEG, FieldSource, read_phase
from twilight.viewer.colours import Channels
from twilight.viewer.lines import NODES
from twilight.viewer.tables import (
    DARK,
    LARGEST_FRACTION_ONCE,
    REST_IN_AUREOLE,
    ViewerTables,
    ViewerTableSizes,
    every_second,
    rows_above,
    scattering_cosine,
)

LIMB_POWER = 1.5
"""Power with which rows stand closer together at the top of the haze."""
TOP_EDGE_KM = 4.7
"""pi H / 4 of `edge`, H = 6 km as of the air at 80 to 100 km."""
LINES_TO_KM = 300.0
"""Height above the grazing ray up to which the sun's beam and the night's light are listed: over all airglow."""
ABOVE_AIRGLOW_KM = 320.0
"""Height of the observer for whom the night's light above the air is listed: over all airglow."""
ENTRY_LOWEST_SUN_DEG = -33.0
"""Lowest sun for which the field is evaluated where a line enters the air; splines give the suns of its foot."""
ENTRY_SUNS = 97
"""Suns of that evaluation."""
ENTRY_AZIMUTHS = 33
"""Azimuths of that evaluation."""
SUNS_AT_ONCE = 24
"""Suns for which the field is evaluated together, which bounds the memory."""


@dataclass(frozen=True)
class Geometry:
    """Lines of sight past one planet [km]: p of the rays that graze the ground and the top of the haze, the radius of
    the top of the air, and its altitude above sea level."""

    grazing_km: float
    haze_km: float
    top_radius_km: float
    top_km: float

    @classmethod
    def of(cls, source: FieldSource) -> Geometry:
        """Geometry of the medium of a field."""
        medium = source.medium
        radius = medium.earth_radius_km + medium.top_km
        lowest = medium.bottom_km, source.haze_top_km()
        grazing, haze = (radius * math.cos(math.radians(source.grazing_deg(medium.top_km, z))) for z in lowest)
        return cls(grazing, haze, radius, medium.top_km)

    def rows(self, sizes: ViewerTableSizes) -> tuple[np.ndarray, np.ndarray]:
        """(elevation at the top of the air, angle from there to the foot) (rows,) [deg].

        Ground from the nadir up, then limb from the horizon up.
        """
        foot = 90.0 * (1.0 - np.linspace(1.0, 0.0, sizes.ground) ** 2)
        ground = self.grazing_km * np.sin(np.radians(foot))
        limb = rows_above(self.grazing_km, self.haze_km, self.top_radius_km, sizes.haze, sizes.limb, LIMB_POWER)
        elevation = -np.degrees(np.arccos(np.concatenate([ground, limb]) / self.top_radius_km))
        elevation[sizes.ground - 1] -= JUST_DEG
        elevation[sizes.ground] += JUST_DEG
        elevation[-1] = -0.02  # a line that is in the air at all
        central_angle_deg = np.concatenate([foot - (90.0 + elevation[: sizes.ground]), -elevation[sizes.ground :]])
        return elevation, np.maximum(central_angle_deg, 0.0)

    def edge(self, elevation_deg: np.ndarray) -> np.ndarray:
        """Fraction of the light of lines (rows,) by their elevations at the top of the air that its end leaves."""
        below_km = self.top_radius_km * (1.0 - np.cos(np.radians(elevation_deg)))
        return np.sqrt(-np.expm1(-below_km / TOP_EDGE_KM))

    def line_elevations(self, radius_km: float) -> np.ndarray:
        """Elevations (NODES,) [deg] of lines by their height above the grazing ray, LINES_TO_KM x^1.5, seen from a
        distance from the Earth's centre; positive where they pass above it."""
        p = self.grazing_km + LINES_TO_KM * np.linspace(0.0, 1.0, NODES) ** LIMB_POWER
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
    source: FieldSource, channels: Channels, sizes: ViewerTableSizes, progress: Progress
) -> tuple[ViewerTables, Geometry]:
    """The tables of a field above the air, with one altitude, and the lines that they are over.

    `ViewerTables.spectrum` has every second texel; horizon_deg is the one at the top of the air.
    """
    geometry = Geometry.of(source)
    top = geometry.top_km
    rows, central_angle_deg = geometry.rows(sizes)
    places = np.linspace(_sun_place(ENTRY_LOWEST_SUN_DEG), _sun_place(90.0), ENTRY_SUNS)
    suns = np.clip(sky_tables.SUN_CENTRE_DEG + sky_tables.SUN_WIDTH_DEG * np.sinh(places), ENTRY_LOWEST_SUN_DEG, 90.0)
    azimuths = np.linspace(0.0, 180.0, ENTRY_AZIMUTHS)
    elevation, azimuth = np.meshgrid(rows, azimuths, indexing="ij")
    spectra = np.empty((suns.size, rows.size, azimuths.size, channels.wavelength_nm.size))
    for j, sun in enumerate(suns):
        spectra[j] = source.radiance(top, float(sun), elevation, azimuth)
        progress("above the air", 0.8 * (j + 1) / suns.size)
    edge = np.where(np.arange(rows.size) < sizes.ground, 1.0, geometry.edge(rows))[:, None, None]
    spectra /= edge
    light = np.maximum(channels.of(spectra), DARK)
    aureole = phase = None
    if source.phase is not None:
        phase = channels.of(source.phase) / channels.of(np.ones_like(source.phase))
        once = np.empty_like(light)
        for first in range(0, suns.size, SUNS_AT_ONCE):
            part = slice(first, first + SUNS_AT_ONCE)
            once[part] = channels.of(source.single_aerosol(top, rows, azimuths, suns[part])) / edge
        once = np.minimum(once, LARGEST_FRACTION_ONCE * light)
        once += REST_IN_AUREOLE * (light - once)
        aureole = once / read_phase(phase, scattering_cosine(elevation, azimuth, suns))
        light = light - once
    foot_suns, foot_azimuths = sky_tables.sun_nodes(sizes.suns), sky_tables.azimuth_nodes(sizes.azimuths)

    def at_feet(values: np.ndarray, every_second_row: np.ndarray, step: int) -> np.ndarray:
        """(C, 1, foot's sun, row, azimuth) of values (S, E, A, C) where lines enter: splines of their logarithms."""
        s, a = np.meshgrid(foot_suns[::step], foot_azimuths[::step], indexing="ij")
        out = np.empty((values.shape[-1], 1, s.shape[0], every_second_row.size, s.shape[1]))
        for r, row in enumerate(every_second_row):
            sun, away = at_entry(s, a, float(central_angle_deg[row]))
            place = _sun_place(np.maximum(sun, ENTRY_LOWEST_SUN_DEG))
            for c in range(values.shape[-1]):
                log = np.log(np.maximum(values[:, row, :, c], DARK))
                out[c, 0, :, r] = np.exp(RectBivariateSpline(places, azimuths, log).ev(place, away))
        return out

    every = np.arange(rows.size)
    made = ViewerTables(
        at_feet(light, every, 1),
        None if aureole is None else at_feet(aureole, every, 1),
        at_feet(spectra, every_second(sizes.ground, sizes.haze + sizes.limb), 2),
        phase,
        np.array([source.horizon_deg(top)]),
        np.array([source.grazing_deg(top, source.haze_top_km())]),
    )
    progress("above the air", 1.0)
    return made, geometry


def _sun_place(elevation_deg):
    return np.arcsinh((elevation_deg - sky_tables.SUN_CENTRE_DEG) / sky_tables.SUN_WIDTH_DEG)
