"""The tables of a field that a page draws from.

    light = exp(sky) + P(scattering angle) exp(aureole)        X, Y, Z and scotopic luminance [cd m^-2] at 1 au

The axes are those of the layout `twilight` (`twilight.studies.export.sky_tables`) but for the rows of the sky, which
begin anew at the ray that grazes the top of the haze, where light has a kink that is next to a step (`rows_above`);
one more row, beyond the zenith, lets a cubic through it have no kink there.  P is the phase function of the column's
aerosol in each channel.  aureole holds what aerosol scattered once, and a fraction of the rest, so that its logarithm
does not fall without end in the shadow.  A coarser table holds the field at its wavelengths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twilight.base.progress import Progress
from twilight.studies.export import sky_tables
from twilight.studies.export.field_values import JUST_DEG, FieldSource, read_phase
from twilight.viewer.colours import CHANNELS, Channels

REST_IN_AUREOLE = 0.01
"""Fraction of the light scattered more often that aureole holds."""
LARGEST_FRACTION_ONCE = 0.98
"""Largest fraction of all light that light scattered once by aerosol may be, so that something is left for `sky`."""
DARK = 1e-30
"""Least light, whose logarithm is taken [cd m^-2]."""


@dataclass(frozen=True)
class ViewerTableSizes:
    """Texels of each axis; every second is one of the spectral table, so that all are odd numbers."""

    suns: int = 97
    haze: int = 12
    """Steps, an even number, from the horizon to the ray that grazes the top of the haze, from where `sky` is."""
    sky: int = 33
    ground: int = 21
    azimuths: int = 25
    limb: int = 41
    """Above the air alone, in place of `sky`."""


def rows_above(low: float, haze: float, high: float, steps: int, rows: int, power: float) -> np.ndarray:
    """Places (steps + rows,) of lines of sight from the horizon `low` by the top of the haze to `high`.

    low + (haze - low) sin^2(pi/2 v)    v = 0, 1/steps ... : light goes on evenly at the horizon, and has a root of
                                        the distance below the top of the haze
    haze + (high - haze) u^power        u = 0 to 1 over `rows`
    """
    below = low + (haze - low) * np.sin(0.5 * np.pi * np.arange(steps) / max(steps, 1)) ** 2
    return np.concatenate([below, haze + (high - haze) * np.linspace(0.0, 1.0, rows) ** power])


def elevation_rows(horizon_deg: float, haze_deg: float, sizes: ViewerTableSizes) -> np.ndarray:
    """Elevations [deg] of the rows: ground from the nadir, sky from the horizon, one beyond the zenith (> 90)."""
    below = sky_tables.elevation_nodes(horizon_deg, sizes.ground, sizes.sky)[: sizes.ground]
    above = rows_above(horizon_deg, haze_deg, 90.0, sizes.haze, sizes.sky, 2.0)
    beyond = haze_deg + (90.0 - haze_deg) * (sizes.sky / (sizes.sky - 1)) ** 2
    return np.concatenate([below, np.maximum(above, horizon_deg + JUST_DEG), [beyond]])


@dataclass(frozen=True)
class ViewerTables:
    """sky, aureole (4, altitude, sun, row, azimuth) [cd m^-2]; spectrum (W, altitude, sun, row, azimuth) [sr^-1] at
    every second texel without the row beyond the zenith; phase (256, 4); horizon_deg, haze_deg (altitude,): apparent
    elevations of the horizon and of the ray that grazes the top of the haze.

    aureole and phase are None in air without aerosol.
    """

    sky: np.ndarray
    aureole: np.ndarray | None
    spectrum: np.ndarray
    phase: np.ndarray | None
    horizon_deg: np.ndarray
    haze_deg: np.ndarray


def fill(
    source: FieldSource,
    channels: Channels,
    altitudes_km: tuple[float, ...],
    sizes: ViewerTableSizes,
    progress: Progress,
    suns_deg: np.ndarray | None = None,
) -> ViewerTables:
    """The tables of a field, seen from altitudes above sea level.

    suns_deg: some of `sky_tables.sun_nodes(sizes.suns)`, in order; None: all.  The spectral table has every second.
    """
    suns = sky_tables.sun_nodes(sizes.suns) if suns_deg is None else suns_deg
    azimuths = sky_tables.azimuth_nodes(sizes.azimuths)
    rows, haze_km = sizes.ground + sizes.haze + sizes.sky + 1, source.haze_top_km()
    shape = (CHANNELS, len(altitudes_km), suns.size, rows, sizes.azimuths)
    sky = np.empty(shape)
    aureole = None if source.phase is None else np.empty(shape)
    phase = None if source.phase is None else channels.of(source.phase) / channels.of(np.ones_like(source.phase))
    coarse, horizons, hazes = [], [], []
    for i, altitude in enumerate(altitudes_km):
        horizon = source.horizon_deg(altitude)
        horizons.append(horizon)
        hazes.append(source.grazing_deg(altitude, haze_km))
        row = elevation_rows(horizon, hazes[-1], sizes)
        elevation, azimuth = np.meshgrid(row, azimuths, indexing="ij")
        # beyond the zenith: the same direction named from the other side
        over = elevation > 90.0
        azimuth = np.where(over, 180.0 - azimuth, azimuth)
        elevation = np.where(over, 180.0 - elevation, elevation)
        spectra = np.empty((suns.size, *elevation.shape, channels.wavelength_nm.size))
        for j, sun in enumerate(suns):
            spectra[j] = source.radiance(altitude, float(sun), elevation, azimuth)
            progress(f"{altitude:g} km", (i + 0.9 * (j + 1) / suns.size) / len(altitudes_km))
        light = np.maximum(channels.of(spectra), DARK)
        every_second_row = every_second(sizes.ground, sizes.haze + sizes.sky)
        coarse.append(np.maximum(spectra[::2][:, every_second_row][:, :, ::2], DARK))
        if aureole is not None and phase is not None:
            once = _once_scattered(source, channels, altitude, row, azimuths, suns)
            once = np.minimum(once, LARGEST_FRACTION_ONCE * light)
            # below the haze's top one row's fraction may differ too much from the next's for a cubic: all stays in sky
            once[:, sizes.ground : sizes.ground + sizes.haze] = 0.0
            once += REST_IN_AUREOLE * (light - once)
            cosine = scattering_cosine(elevation, azimuth, suns)
            aureole[:, i] = np.moveaxis(once / read_phase(phase, cosine), -1, 0)
            light = light - once
        sky[:, i] = np.moveaxis(light, -1, 0)
        progress(f"{altitude:g} km", (i + 1) / len(altitudes_km))
    spectrum = np.moveaxis(np.stack(coarse), -1, 0)
    return ViewerTables(sky, aureole, spectrum, phase, np.array(horizons), np.array(hazes))


def every_second(ground: int, above: int) -> np.ndarray:
    """Rows of the spectral table: every second one of those of the ground, and of those above the horizon."""
    return np.concatenate([np.arange(0, ground, 2), ground + np.arange(0, above, 2)])


def _once_scattered(source: FieldSource, channels: Channels, altitude: float, row, azimuths, suns) -> np.ndarray:
    """What aerosol scattered once (S, E, A, 4); the row beyond the zenith is seen from the other side."""
    inside = source.single_aerosol(altitude, row[:-1], azimuths, suns)
    beyond = source.single_aerosol(altitude, 180.0 - row[-1:], 180.0 - azimuths, suns)
    return channels.of(np.concatenate([inside, beyond], axis=1))


def scattering_cosine(elevation: np.ndarray, azimuth: np.ndarray, suns: np.ndarray) -> np.ndarray:
    """(S, ...) of directions (...) and suns (S,) [deg]."""
    e, a, s = np.radians(elevation), np.radians(azimuth), np.radians(suns)[:, None, None]
    return np.sin(s) * np.sin(e) + np.cos(s) * np.cos(e) * np.cos(a)
