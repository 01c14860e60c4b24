"""Light at the texels of Bruneton's mapping, at a seventh of which the field itself is evaluated.

Singly scattered light has the sharp features, the shadow of the Earth, the horizon and the sun's surroundings, and is
summed for every texel (:mod:`twilight.studies.export.single_scattering`).  The field's radiance less that light is
smooth: it is taken at some texels of r and mu and interpolated to the others (monotone cubics of Fritsch and Carlson),
so that at those texels the light is the field's to the last digit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy.interpolate import PchipInterpolator

from twilight.solvers.tables.mapping import Mapping, grid, possible_nus
from twilight.studies.export.field_values import JUST_DEG, FieldSource
from twilight.studies.export.single_scattering import SingleScattering, SinglyScattered

SAME_COSINE = 1e-12
"""Cosines this near to 1 or -1 stand for one direction."""
ROWS = (*range(9), 10, 12, 14, 17, 20, 23, 26, 29, 31)
"""Texels of r, of 32, at which the field is evaluated, beside those next to sharp edges of layers."""
GROUND_ROWS = (0, 1, 3, 8, 20, 30, 40, 45, 50, 55, 57, 60, 62, 63)
"""Texels of mu at which the field is evaluated, of the 64 that end on the ground: close together at both ends."""
SKY_ROWS = (0, 1, 2, 3, 5, 8, 14, 20, 25, 30, 35, 40, 45, 50, 52, 54, 55, 56, 57, 58, 59, 60, 61, 62, 63)
"""The same of the 64 that end on the top: close together from 10 down to the horizon, where twilight is sharpest."""
LEAST_LIGHT = 0.02
"""Least light of an interpolated texel, as a fraction of what was scattered once there."""
IRRADIANCE_STEP = 3
"""Of the texels of mu_s of E by day one of as many is summed."""
DAY_MU_S = 0.25
"""The cosine of the sun's zenith angle from which E is smooth enough for that, and interpolated to the others."""


def texel_light(
    source: FieldSource, mapping: Mapping, rows: int, progress: Callable[[float], None]
) -> Iterator[tuple[np.ndarray, np.ndarray, SinglyScattered]]:
    """(nu (S, M, N), light (S, M, N, W) over F0, singly scattered light) of each of the first `rows` texels of r.

    light: radiance less that of the ground in view, at the texels of mu_s, mu and nu.
    progress: called with the fraction that is done.
    """
    heights, view, sun, nus = grid(mapping)
    many = SingleScattering(source.medium, source.scaled, source.beam)
    suns_deg = np.degrees(np.arcsin(sun))
    evaluated, half = _evaluated_rows(source, mapping, heights, rows), mapping.n_mu // 2
    places = [half * k + np.array(_evaluated(some, half)) for k, some in enumerate((GROUND_ROWS, SKY_ROWS))]
    every = np.concatenate(places)
    seen = []
    rest = np.zeros((len(evaluated), mapping.n_mu_s, every.size, mapping.n_nu, source.medium.n_wavelengths))
    for i in range(rows):
        elevation_deg, azimuth_deg, nu = _directions(source, mapping, heights[i], view[i], sun, nus)
        altitude = source.medium.bottom_km + heights[i]
        once = many(altitude, np.radians(elevation_deg), np.radians(azimuth_deg), np.arcsin(sun))
        seen.append((nu, once))
        if i in evaluated:
            # lines that end on the ground have no length there
            skipped = places[0].size if heights[i] == 0.0 else 0
            at = every[skipped:]
            for j in range(sun.size):
                light = source.inscattered(altitude, suns_deg[j], elevation_deg[at, None], azimuth_deg[j, at])
                rest[evaluated.index(i), j, skipped:] = light - once.total[j, at]
                progress((i + (j + 1) / sun.size) / rows)
    if len(evaluated) < rows:
        rest = PchipInterpolator(evaluated, rest, axis=0)(np.arange(rows))
    for (nu, once), part in zip(seen, rest, strict=True):
        smooth = np.empty_like(once.total)
        for place in places:
            first = half * (place[0] // half)
            values = part[:, np.searchsorted(every, place)]
            smooth[:, first : first + half] = PchipInterpolator(place, values, axis=1)(np.arange(first, first + half))
        yield nu, np.maximum(once.total + smooth, LEAST_LIGHT * once.total), once


def _evaluated(some: tuple[int, ...], count: int) -> list[int]:
    """The texels, of `count`, at which the field is evaluated: `some`, or all where `some` are of another number."""
    return list(some) if some[-1] + 1 == count else list(range(count))


def _evaluated_rows(source: FieldSource, mapping: Mapping, heights: np.ndarray, rows: int) -> list[int]:
    """Texels of r at which the field is evaluated, the first and the last of the rows among them."""
    edges = np.searchsorted(heights, source.profile.sharp_km - source.medium.bottom_km)
    beside = {int(i) for edge in edges for i in (edge - 1, edge)}
    chosen = {i for i in (*_evaluated(ROWS, mapping.n_r), *beside) if 0 <= i < rows}
    return sorted(chosen | {rows - 1})


def _directions(
    source: FieldSource, mapping: Mapping, height: float, view: np.ndarray, sun: np.ndarray, nus: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevations (M,), azimuths (S, M, N) [deg] and nu of the texels of one height, each moved to its own side of the
    apparent horizon."""
    ground = 2 * np.arange(mapping.n_mu) < mapping.n_mu
    elevation = np.degrees(np.arcsin(view))
    horizon = source.horizon_deg(source.medium.bottom_km + height)
    elevation = np.where(ground, np.minimum(elevation, horizon - JUST_DEG), np.maximum(elevation, horizon + JUST_DEG))
    level = (view * sun[:, None])[..., None]
    across = np.sqrt(np.maximum(0.0, (1.0 - view**2) * (1.0 - sun[:, None] ** 2)))[..., None]
    nu = possible_nus(view, sun, nus)
    cosine = np.divide(nu - level, across, out=np.ones_like(nu), where=across > 1e-9)
    # all cosines at an end are one direction, which is evaluated once
    cosine = np.where(np.abs(cosine) > 1.0 - SAME_COSINE, np.sign(cosine), cosine)
    return elevation, np.degrees(np.arccos(cosine)), nu


def sky_irradiance(source: FieldSource, mapping: Mapping, rows: int) -> np.ndarray:
    """E of the sky (r, mu_s, W) over F0, on a horizontal plane that looks up; of the first `rows` texels of r."""
    x, w = np.polynomial.legendre.leggauss(10)
    mu, weight = 0.5 * (1.0 + x), 0.5 * w
    azimuth = (np.arange(8) + 0.5) * 22.5
    directions = np.meshgrid(np.degrees(np.arcsin(mu)), azimuth, indexing="ij")
    count = mapping.n_e_mu_s
    suns = np.linspace(-1.0, 1.0, count)
    up = np.flatnonzero(suns > mapping.mu_s_min)
    day = up[suns[up] >= DAY_MU_S]
    chosen_suns = np.unique(np.concatenate([up[suns[up] < DAY_MU_S], day[::IRRADIANCE_STEP], day[-1:]]))
    found = np.empty((rows, chosen_suns.size, source.medium.n_wavelengths))
    for i in range(rows):
        altitude = source.medium.bottom_km + mapping.thickness_km * i / (mapping.n_e_r - 1)
        for j, k in enumerate(chosen_suns):
            seen = source.radiance(altitude, math.degrees(math.asin(suns[k])), *directions)
            found[i, j] = np.einsum("maw,m->w", seen, weight * mu) * 2.0 * np.pi / azimuth.size
    out = np.zeros((mapping.n_e_r, count, found.shape[-1]))
    out[:rows, up] = PchipInterpolator(chosen_suns, found, axis=1)(up)
    return out
