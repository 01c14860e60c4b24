"""The Prague Sky Model's file from solved fields: for every air, albedo, altitude and sun a sum of products.

A field of all suns makes the skies of an air over a ground.  Below -2 deg it is evaluated for every second sun of the
file, and the logarithm of radiance goes as a cubic spline between them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from twilight.base.progress import Progress, part_of
from twilight.studies.export.prague_air import ChannelNodes
from twilight.studies.export.prague_file import (
    PragueAxes,
    PragueFile,
    PragueTerms,
    polarisation_record,
    radiance_record,
)
from twilight.studies.export.prague_fit import (
    LinearBasis,
    alternate,
    at_directions,
    first_guess,
    linear_basis,
    solve_half,
)
from twilight.studies.export.prague_sky import SAFETY_M, PragueAngles, angles_of, elevation_of, index_and_fraction
from twilight.studies.export.prague_transmittance import transmittance_of, transmittance_roots

JUST_DEG = 1e-3
"""How far from the horizon the directions next to it are [deg]."""


def _numbers(text: str) -> np.ndarray:
    return np.array(text.split(), dtype=float)


SUN_DEG = (
    *np.arange(-18.0, 0.25, 0.25).tolist(),
    *(0.5, 1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 30, 37, 45, 55, 65, 75, 82, 90),
)
"""Elevations of the sun in a file [deg]."""
EVERY_SUN_DEG = -2.0
"""Elevation of the sun [deg] below which the field is evaluated for every second sun of the file."""

EMPHASIS_DEG = 90.0 - _numbers(
    "90 81 72 64 56 48 40 33 27 22 18 15 12.5 10 8 6 4.5 3.5 2.7 2 1.4 1 0.75 0.5 0.35 0.2269"
)
"""Breaks of the emphasis: zenith angles [deg], down to the horizon of a viewpoint on the ground."""
GAMMA_DEG = _numbers(
    "0 0.5 1 1.5 2 3 4 5 6.5 8 10 12.5 15 18 21 25 30 35 40 46 52 58 65 72 79 86 93 100 107 114 121 128 135 "
    "142 149 156 162 168 172 176 180"
)
"""Breaks of the angle from the sun."""
ALPHA_DEG = _numbers(
    "0 9 18 26 34 41 48 54 60 65 69 72 75 78 80 82 83.5 85 86 87 88 89 89.78 91 92.5 94 96 98 100 102 105 108.5"
)
"""Breaks of the zenith angle, or below the horizon of the shadow angle."""
_AZIMUTH_DEG = _numbers(
    "0 0.4 0.8 1.3 2 3 4 5 6.5 8 10 12.5 15 18 22 26 31 37 44 52 61 70 80 90 100 110 120 130 139 148 156 163 "
    "169 174 178 180"
)
_AROUND_DEG = (0, 0.25, 0.6, 1, 1.5, 2.2, 3, 4, 5.5, 7, 9, 12, 15)
"""Distances in height from a sun above the horizon at which its aureole is evaluated."""
FIRST_STEPS = 40
"""Rounds of the least squares of the first sun, which begin from nothing."""
STEPS = 5
"""Rounds of the least squares of every other sun, which begin from the sun before."""
ZENITH_SIZE = 1000.0
"""Largest stored value of a function of the zenith angle: half floats keep 11 bits up to 65504."""


@dataclass(frozen=True)
class PragueMaker:
    """axes: of the file; nodes: wavelengths of its channels; rank: products of each sky; polarised: with Q and U."""

    axes: PragueAxes
    nodes: ChannelNodes
    rank: int
    polarised: bool

    def make(self, field_of: Callable[[int, int, Progress], Any], progress: Progress) -> PragueFile:
        """The file; field_of(visibility, albedo, progress): a `Solved` by the indices of its air and its ground."""
        axes, terms = self.axes, (len(GAMMA_DEG), len(ALPHA_DEG))
        sky = np.zeros(axes.shape, radiance_record(self.rank, *terms, len(EMPHASIS_DEG)))
        pol = np.zeros(axes.shape, polarisation_record(self.rank, *terms)) if self.polarised else None
        roots: list[np.ndarray] = []
        count = axes.shape[0] * axes.shape[1]
        for done in range(count):
            v, b = divmod(done, axes.shape[1])
            where = f"visibility {axes.visibility_km[v]:g} km, albedo {axes.albedo[b]:g}"
            field = field_of(v, b, part_of(progress, done / count, 0.3 / count, f"{where}:"))
            if b == 0:
                roots.append(transmittance_roots(field, axes.altitude_m, self.nodes))
            for h, altitude in enumerate(axes.altitude_m):
                progress(where, (done + 0.3 + 0.7 * h / axes.shape[2]) / count)
                self._altitude(field, altitude, sky[v, b, h], None if pol is None else pol[v, b, h])
            del field
        breaks = np.radians(GAMMA_DEG), np.radians(ALPHA_DEG)
        return PragueFile(
            axes,
            PragueTerms(*breaks, np.radians(EMPHASIS_DEG), sky),
            transmittance_of(roots, axes.altitude_m, axes.visibility_km),
            None if pol is None else PragueTerms(*breaks, np.empty(0), pol),
        )

    def _altitude(self, field: Any, altitude_m: float, sky: np.ndarray, pol: np.ndarray | None) -> None:
        """Fill the records (S, C) of one viewpoint."""
        skies = _Skies(field, self, altitude_m)
        start = [first_guess(len(GAMMA_DEG), len(ALPHA_DEG), self.axes.channels, self.rank)] * 2
        for s, sun in enumerate(self.axes.elevation_deg):
            zero_deg, light, degree = skies.at(float(sun))
            e, a = np.meshgrid(elevation_of(zero_deg, altitude_m), _with_midpoints(_AZIMUTH_DEG), indexing="ij")
            angles = PragueAngles(*(angle.ravel() for angle in angles_of(float(sun), e, a, altitude_m)))
            gamma, zero = _basis(angles.gamma, GAMMA_DEG), _basis(angles.zero, ALPHA_DEG)
            alpha = _basis(angles.shadow, ALPHA_DEG) if sun < 0.0 else zero
            steps = FIRST_STEPS if s == 0 else STEPS
            emphasis, level = _emphasis(zero_deg, light)
            i, of_i = index_and_fraction(angles.zero, np.radians(EMPHASIS_DEG))
            stressed = emphasis[:, i] * (1.0 - of_i) + emphasis[:, i + 1] * of_i
            target = light.reshape(-1, light.shape[-1]).T / (level[:, None] * stressed)
            start[0] = alternate(gamma, alpha, target, target**-2, start[0], steps)
            _store(sky[s], start[0], emphasis, level, gamma, alpha, target)
            if pol is not None and degree is not None:
                wanted = degree.reshape(-1, degree.shape[-1]).T
                start[1] = alternate(gamma, zero, wanted, np.ones_like(wanted), start[1], steps)
                for name, values in zip(("sun", "zenith"), start[1], strict=True):
                    pol[s]["term"][name] = values.swapaxes(1, 2)


def _basis(angle_rad: np.ndarray, breaks_deg: np.ndarray) -> LinearBasis:
    return linear_basis(*index_and_fraction(angle_rad, np.radians(breaks_deg)), len(breaks_deg))


def _emphasis(zero_deg: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rounded means over the azimuth (C, E) beside the largest, which is the level (C,), of light (rows, A, C)."""
    mean = np.log(light).mean(axis=1)
    order = np.argsort(zero_deg)
    found = np.stack([np.interp(EMPHASIS_DEG, zero_deg[order], column[order]) for column in mean.T])
    top = found.max(axis=1)
    return np.exp(found - top[:, None]).astype(np.float16).astype(float), np.exp(top)


def _store(
    records: np.ndarray,
    found: tuple[np.ndarray, np.ndarray],
    emphasis: np.ndarray,
    level: np.ndarray,
    gamma: LinearBasis,
    alpha: LinearBasis,
    target: np.ndarray,
) -> None:
    """One sky in all channels (C,) as half floats; functions of the zenith angle are fitted to the rounded others."""
    sun = found[0].astype(np.float16).astype(float)
    zenith = solve_half(alpha, at_directions(gamma, sun), target, target**-2, found[1])
    size = ZENITH_SIZE / np.maximum(np.abs(zenith).max(axis=1), 1e-300)
    records["term"]["sun"] = sun.swapaxes(1, 2)
    records["term"]["scale"] = size / level[:, None]
    records["term"]["zenith"] = (zenith * size[:, None]).swapaxes(1, 2)
    records["emphasis"] = emphasis


class _Skies:
    """The skies of one field from one altitude."""

    def __init__(self, field: Any, maker: PragueMaker, altitude_m: float):
        self.field, self.maker, self.altitude_m = field, maker, altitude_m
        self.altitude_km = field.medium.bottom_km + 1e-3 * (altitude_m - SAFETY_M)
        suns = [float(s) for s in maker.axes.elevation_deg if s < EVERY_SUN_DEG]
        every_second = suns[::2] if len(suns) % 2 else [*suns[::2], suns[-1]]
        self._low = set(suns) if len(suns) >= 8 else set()
        anchors = [*every_second, *(float(s) for s in maker.axes.elevation_deg if EVERY_SUN_DEG <= s <= 0.0)]
        self._splines: list[CubicSpline] = []
        if self._low:
            evaluated = [self._evaluate(sun, EMPHASIS_DEG) for sun in anchors]
            self._splines = [CubicSpline(anchors, np.array(one)) for one in zip(*evaluated, strict=True)]

    def at(self, sun: float) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Zenith angles [deg] of the rows, mean radiance (rows, A, C) of each channel and, if polarised, polarisation.

        Rows and azimuths half-way between those at which the field is evaluated are on cubic splines: there must be
        several times as many directions as unknowns, or the sum of products goes astray between them.
        """
        zero_deg = EMPHASIS_DEG
        if sun > 0.0:
            around = 90.0 - sun + np.concatenate([_AROUND_DEG, np.negative(_AROUND_DEG)])
            zero_deg = np.union1d(EMPHASIS_DEG, around[(around >= 0.0) & (around <= EMPHASIS_DEG[-1])])
        if sun in self._low:
            found = [spline(sun) for spline in self._splines]
        else:
            found = self._evaluate(sun, zero_deg)
        fine = [
            CubicSpline(
                zero_deg, CubicSpline(_AZIMUTH_DEG, one, axis=1, bc_type="clamped")(_with_midpoints(_AZIMUTH_DEG))
            )(_with_midpoints(zero_deg))
            for one in found
        ]
        return _with_midpoints(zero_deg), np.exp(fine[0]), fine[1] if len(fine) > 1 else None

    def _evaluate(self, sun: float, zero_deg: np.ndarray) -> list[np.ndarray]:
        """Logarithm of the field's radiance (rows, A, C) and, if polarised, its polarisation along the sun's plane.

        Directions below the horizon's refracted image have the sky just above it.
        """
        lowest = _horizon_deg(self.field.medium, self.altitude_km) + JUST_DEG
        elevation = np.clip(elevation_of(zero_deg, self.altitude_m), lowest, 90.0)
        e, a = np.meshgrid(elevation, _AZIMUTH_DEG, indexing="ij")
        nodes = self.maker.nodes
        if not self.maker.polarised:
            light = nodes.mean(self.field.radiance(sun, e, a, self.altitude_km))
            return [np.log(np.maximum(light, 1e-30))]
        stokes = nodes.mean(self.field.stokes(sun, e, a, self.altitude_km))
        light = np.maximum(stokes[..., 0, :], 1e-30)
        return [np.log(light), along_scattering(sun, e, a, stokes[..., 1, :], stokes[..., 2, :]) / light]


def along_scattering(sun_deg: float, elevation_deg, azimuth_deg, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Q (..., C) for the plane through sun and view, of Q and U for the vertical plane; directions (...) [deg].

    The tangent of the sphere towards the sun stands at an angle t from the vertical, clockwise where the sun is to the
    right as seen along the line of sight; turning the frame by t gives Q cos 2t + U sin 2t.
    """
    e, a, s = np.radians(elevation_deg), np.radians(azimuth_deg), np.radians(sun_deg)
    right = -np.cos(s) * np.sin(a)  # the sun's azimuth from the view's is -a, clockwise
    up = np.sin(s) * np.cos(e) - np.cos(s) * np.sin(e) * np.cos(a)
    turn = 2.0 * np.arctan2(right, up)[..., None]
    return q * np.cos(turn) + u * np.sin(turn)


def _with_midpoints(values: np.ndarray) -> np.ndarray:
    """The values and the middles between them."""
    return np.sort(np.concatenate([values, 0.5 * (values[1:] + values[:-1])]))


def _horizon_deg(medium: Any, altitude_km: float) -> float:
    """Apparent elevation of the horizon, by Bouguer's invariant."""
    both = np.array([medium.bottom_km, altitude_km])
    n = 1.0 + medium.at(both).refractivity[:, 0]
    r = medium.earth_radius_km + both
    return -float(np.degrees(np.arccos(min(1.0, n[0] * r[0] / (n[1] * r[1])))))
