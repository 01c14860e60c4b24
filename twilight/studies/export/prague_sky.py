"""What a reader of the Prague Sky Model makes of its file: angles, interpolation, products.

A viewpoint is taken 50 m above where it is, on a sphere of 6378 km.  The direction of view v is corrected so that the
horizon lies at 90 deg from the zenith z: v + z sin(dip).  PragueAngles:

    gamma   between v and the sun, uncorrected
    zero    between the corrected v and the zenith
    shadow  between the corrected v and the direction 90 deg above the sun in its vertical

Radiance is max(0, sum of sun(gamma) zenith(alpha)) emphasis(zero), with alpha the shadow angle for a sun below the
horizon and zero above it; all three go linearly between breaks, and radiance linearly between visibilities, albedos,
altitudes and elevations of the sun.  Channels are steps.  Transmittance is the square of factors of the place that is
looked at, linear in its altitude and in its distance along the ground.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twilight.studies.export.prague_file import PragueFile, PragueTerms, read_prague

RADIUS_M = 6_378_000.0
"""Radius of the reader's sphere."""
SAFETY_M = 50.0
"""What the reader adds to the altitude of a viewpoint."""
TOP_M = 100_000.0
"""Altitude of the edge of the air."""
EDGE_M = 1_571_524.413613
"""Largest distance to the edge of the air along the ground."""


class PragueAngles(NamedTuple):
    """The angles gamma, zero and shadow [rad] of directions, each of their shape."""

    gamma: np.ndarray
    zero: np.ndarray
    shadow: np.ndarray


def horizon_sine(altitude_m: float) -> float:
    """Sine of the dip of the horizon from an altitude, the reader's 50 m included."""
    r = RADIUS_M + altitude_m
    return math.sqrt(r * r - RADIUS_M * RADIUS_M) / r


def angles_of(sun_deg: float, elevation_deg: ArrayLike, azimuth_deg: ArrayLike, altitude_m: float) -> PragueAngles:
    """PragueAngles of directions [deg], azimuth from the sun, seen from `altitude_m`, the reader's 50 m included."""
    e, a = np.radians(elevation_deg), np.radians(azimuth_deg)
    s = math.radians(sun_deg)
    across, up = np.cos(e) * np.cos(a), np.sin(e)
    corrected = up + horizon_sine(altitude_m)
    length = np.sqrt(np.cos(e) ** 2 + corrected**2)

    def angle(cosine: np.ndarray) -> np.ndarray:
        return np.arccos(np.clip(cosine, -1.0, 1.0))

    return PragueAngles(
        angle(across * math.cos(s) + up * math.sin(s)),
        angle(corrected / length),
        angle((corrected * math.cos(s) - across * math.sin(s)) / length),
    )


def elevation_of(zero_deg: ArrayLike, altitude_m: float) -> np.ndarray:
    """Elevation [deg] of the direction whose corrected zenith angle is `zero_deg`."""
    zero = np.radians(zero_deg)
    return 90.0 - np.degrees(zero + np.arcsin(horizon_sine(altitude_m) * np.sin(zero)))


def index_and_fraction(value: ArrayLike, breaks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the break below a value, clamped to the breaks, and the fraction of the way to the next."""
    clamped = np.clip(value, breaks[0], breaks[-1])
    index = np.minimum(np.searchsorted(breaks, clamped, side="right") - 1, max(len(breaks) - 2, 0))
    if len(breaks) == 1:
        return index, np.zeros(np.shape(clamped))
    return index, (clamped - breaks[index]) / (breaks[index + 1] - breaks[index])


@dataclass(frozen=True)
class PragueSky:
    """A file, evaluated as the published reader does."""

    file: PragueFile

    @classmethod
    def load(cls, path: str | Path) -> PragueSky:
        """Of a path.  Errors: as `read_prague`."""
        return cls(read_prague(path))

    def radiance(
        self,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike,
        azimuth_deg: ArrayLike,
        wavelength_nm: float,
        *,
        visibility_km: float,
        albedo: float,
        observer_altitude_m: float = 0.0,
    ) -> np.ndarray:
        """Radiance of the sky [W m^-2 sr^-1 nm^-1] in directions [deg], azimuth from the sun; 0 outside the channels.

        observer_altitude_m counts from the ground.
        """
        state = (visibility_km, albedo, observer_altitude_m + SAFETY_M, sun_elevation_deg)
        angles = angles_of(sun_elevation_deg, elevation_deg, azimuth_deg, state[2])
        alpha = angles.shadow if sun_elevation_deg < 0.0 else angles.zero
        return self._mixed(self.file.radiance, state, wavelength_nm, angles, alpha)

    def polarisation(
        self,
        sun_elevation_deg: float,
        elevation_deg: ArrayLike,
        azimuth_deg: ArrayLike,
        wavelength_nm: float,
        *,
        visibility_km: float,
        albedo: float,
        observer_altitude_m: float = 0.0,
    ) -> np.ndarray:
        """Degree of polarisation across the plane through sun and view, below 0 along it; arguments as `radiance`."""
        assert self.file.polarisation is not None
        state = (visibility_km, albedo, observer_altitude_m + SAFETY_M, sun_elevation_deg)
        angles = angles_of(sun_elevation_deg, elevation_deg, azimuth_deg, state[2])
        return -self._mixed(self.file.polarisation, state, wavelength_nm, angles, angles.zero)

    def _mixed(
        self, terms: PragueTerms, state: Sequence[float], wavelength_nm: float, angles: PragueAngles, alpha: np.ndarray
    ) -> np.ndarray:
        axes = self.file.axes
        channel = math.floor((wavelength_nm - axes.start_nm) / axes.width_nm)
        out = np.zeros(np.shape(alpha))
        if not 0 <= channel < axes.channels:
            return out
        places = [
            index_and_fraction(value, axis)
            for value, axis in zip(
                state, (axes.visibility_km, axes.albedo, axes.altitude_m, axes.elevation_deg), strict=True
            )
        ]
        for corner in itertools.product((0, 1), repeat=4):
            weight = math.prod(float(f) if c else 1.0 - float(f) for c, (_, f) in zip(corner, places, strict=True))
            if weight > 0.0:
                index = tuple(int(i) + c for c, (i, _) in zip(corner, places, strict=True))
                out += weight * evaluated(terms, terms.records[(*index, channel)], angles, alpha)
        return out

    def transmittance(
        self,
        elevation_deg: float,
        wavelength_nm: float,
        distance_m: float = math.inf,
        *,
        visibility_km: float,
        observer_altitude_m: float = 0.0,
    ) -> float:
        """Transmittance of the air along a direction [deg] up to a distance or to the edge of the air."""
        axes, stored = self.file.axes, self.file.transmittance
        channel = math.floor((wavelength_nm - axes.start_nm) / axes.width_nm)
        if not 0 <= channel < axes.channels:
            return 0.0
        altitude = observer_altitude_m + SAFETY_M
        place = _place(elevation_deg, distance_m, altitude, *stored.factors.shape[1:3])
        total = 0.0
        (v, of_v), (h, of_h) = (
            index_and_fraction(visibility_km, stored.visibility_km),
            index_and_fraction(altitude, stored.altitude_m),
        )
        for dv, dh in itertools.product((0, 1), repeat=2):
            weight = float((of_v if dv else 1.0 - of_v) * (of_h if dh else 1.0 - of_h))
            if weight > 0.0:
                weights = stored.weights[v + dv, h + dh, channel].astype(float)
                roots = stored.factors[h + dh].astype(float) @ weights
                total += weight * _bilinear(roots, place)
        return total * total


def evaluated(terms: PragueTerms, record: np.void, angles: PragueAngles, alpha: np.ndarray) -> np.ndarray:
    """The sum of products of one record at angles [rad]; of radiance with the emphasis, not below 0."""
    (g, of_g), (a, of_a) = (
        index_and_fraction(angles.gamma, terms.sun_break_rad),
        index_and_fraction(alpha, terms.zenith_break_rad),
    )
    sun, zenith = record["term"]["sun"].astype(float), record["term"]["zenith"].astype(float)
    if "scale" in record["term"].dtype.names:
        zenith /= record["term"]["scale"][:, None]
    rows = sun[:, g] * (1.0 - of_g) + sun[:, g + 1] * of_g
    columns = zenith[:, a] * (1.0 - of_a) + zenith[:, a + 1] * of_a
    total = (rows * columns).sum(axis=0)
    if not terms.emphasis_break_rad.size:
        return total
    e, of_e = index_and_fraction(angles.zero, terms.emphasis_break_rad)
    emphasis = record["emphasis"].astype(float)
    return np.maximum(total * (emphasis[e] * (1.0 - of_e) + emphasis[e + 1] * of_e), 0.0)


# Transmittance ----------------------------------------------------------------------------------------------------


def altitude_nodes_m(count: int) -> np.ndarray:
    """Altitudes of the places that factors of the transmittance are given for; the last one is the edge of the air."""
    return TOP_M * np.append((np.arange(count - 1) / count) ** 3, 1.0)


def distance_nodes_m(count: int) -> np.ndarray:
    """Distances along the ground of those places."""
    return EDGE_M * (np.arange(count) / count) ** 4


def _place(elevation_deg: float, distance_m: float, altitude_m: float, distances: int, altitudes: int):
    """(index, fraction) along the distances and along the altitudes of what is looked at."""
    across, up = math.cos(math.radians(elevation_deg)), math.sin(math.radians(elevation_deg))
    start = RADIUS_M + altitude_m

    def meets(radius: float) -> float:
        inside = (start * up) ** 2 - start * start + radius * radius
        if inside <= 0.0:
            return -1.0
        near, far = -start * up - math.sqrt(inside), -start * up + math.sqrt(inside)
        return near if near > 0.0 else far

    length = meets(RADIUS_M)
    length = min(distance_m, meets(RADIUS_M + TOP_M) if length < 0.0 else length)
    x, y = across * length, up * length + start
    r = math.hypot(x, y)
    high = min(max((r - RADIUS_M) / TOP_M, 0.0), 1.0) ** (1.0 / 3.0)
    far = min(math.acos(min(1.0, y / r)) * RADIUS_M / EDGE_M, 1.0) ** 0.25
    return _step(far, distances, 4), _step(high, altitudes, 3)


def _step(value: float, count: int, power: int) -> tuple[int, float]:
    index = min(int(value * count), count - 1)
    if index == count - 1:
        return index, 0.0
    low, high = (index / count) ** power, ((index + 1) / count) ** power
    return index, min(max((value**power - low) / (high - low), 0.0), 1.0)


def _bilinear(roots: np.ndarray, place: tuple[tuple[int, float], tuple[int, float]]) -> float:
    (d, of_d), (a, of_a) = place
    line = roots[d] if of_d == 0.0 else (1.0 - of_d) * roots[d] + of_d * roots[d + 1]
    low = max(float(line[a]), 0.0)
    return low if of_a == 0.0 else (1.0 - of_a) * low + of_a * max(float(line[a + 1]), 0.0)
