"""A picture's sky against a computed one, after one free exposure: a balance of colours, a tone curve, and the figures.

comparison = compare(photo, sky)                          # everything of the report
residual_vector(photo, simulated_sky(sky, photo))         # for a fit
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.sky import Sky
from twilight.studies.validate.photographs.picture_sky import (
    FLOOR,
    OBSERVER,
    Frame,
    PhotoSky,
    components,
    simulated_sky,
)

CHROMATICITY_SCALE = 0.01
"""Difference in u', v' that weighs as much as LOG_SCALE in ln(luminance) in ``residual_vector``."""
LOG_SCALE = 0.1
"""Difference of ln(luminance) that is one unit of ``residual_vector``."""
WHITE = 1.1
"""Stored linear light that no light reaches: somewhat beyond white."""
LEAST_SLOPE = 0.1
"""Least slope of a tone curve."""
PROFILE_HALF_WIDTH_DEG = 3.0
"""Distance from a meridian [deg] within which its profile is a mean."""


def tone_shapes(t: np.ndarray, middle: float, count: int = 3) -> np.ndarray:
    """The first shapes t, t^2, s(t) of a tone curve (`Curve`) at t (...,), (count, ...)."""
    if count < 3:
        return np.stack([t, t**2][:count])
    whole = np.exp(middle) / WHITE
    part = np.exp(np.minimum(t + middle, 0.0)) / WHITE
    return np.stack([t, t**2, np.log((1.0 - whole) / (1.0 - part)) - whole / (1.0 - whole) * t])


@dataclass(frozen=True)
class Curve:
    """A camera's tone curve: of every channel c, with t = ln c - middle, ln(light) = ln c - g1 t - g2 t^2 - g3 s(t).

    s is the shoulder by which light becomes white, -ln(1 - c / WHITE), less its value and slope in the middle: with it
    three numbers hold curves of phones and films to 1 %, where a cubic of t is off by 3 to 9 %.
    numbers: g1, g2, g3, or g1 alone: a contrast.  Monotone between the t about 0 at which the slope is `LEAST_SLOPE`;
    what is brighter, or darker, goes on straight from there.  colours: part of ln R/G and of ln B/G, about
    middle_colours, that is the picture's saturation and not the light's.
    """

    middle: float
    numbers: tuple[float, ...]
    colours: float = 0.0
    middle_colours: tuple[float, float] = (0.0, 0.0)

    @property
    def contrast(self) -> float:
        """Slope of ln(stored) over ln(light) at the middle."""
        return 1.0 / max(1.0 - self.numbers[0], LEAST_SLOPE)

    @cached_property
    def turns(self) -> tuple[float, float]:
        """Between which t the curve is monotone."""
        ends = []
        for side in (-1.0, 1.0):
            t = side * np.linspace(0.0, 8.0, 161)
            slope = 1.0 - np.gradient(self._bent(t), t)
            bad = np.flatnonzero(slope < LEAST_SLOPE)
            ends.append(float(t[max(int(bad[0]) - 1, 0)]) if bad.size else side * np.inf)
        return ends[0], ends[1]

    def _bent(self, t: np.ndarray) -> np.ndarray:
        """ln c - ln(light)."""
        return np.tensordot(self.numbers, tone_shapes(t, self.middle, len(self.numbers)), 1)

    def undo(self, xyz: np.ndarray) -> np.ndarray:
        """XYZ (..., 3) of light from XYZ of what was stored."""
        rgb = colour.xyz_to_linear_rgb(xyz, OBSERVER)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.log(np.maximum(rgb, np.maximum(FLOOR * xyz[..., 1:2], 1e-30))) - self.middle
        at = np.clip(t, *self.turns)
        light = rgb * np.exp(-self._bent(at))
        if self.colours:
            _, *beside = components(np.maximum(np.nan_to_num(xyz), 1e-30))
            for channel, ratio, middle in zip((0, 2), beside, self.middle_colours, strict=True):
                light[..., channel] *= np.exp(-self.colours * (ratio - middle))
        return light @ np.linalg.inv(spectrum.xyz_to_rgb_matrix(OBSERVER)).T


@dataclass(frozen=True, eq=False)
class Balance:
    """What brings a photograph onto the computed sky: xyz' = exposure x matrix x xyz, after its tone curve is undone.

    exposure: cd m^-2 of the simulation per unit of the photograph's Y (by the weighted mean of ln(luminance)).
    gains (3,): of red, green, blue (linear Rec. 709), luminance of white 1 as before; ones without a white balance.
    """

    exposure: float
    gains: np.ndarray
    curve: Curve | None = None

    def apply(self, xyz: np.ndarray) -> np.ndarray:
        """XYZ (..., 3) of the photograph, balanced and exposed."""
        to_rgb = spectrum.xyz_to_rgb_matrix(OBSERVER)
        matrix = np.linalg.inv(to_rgb) @ np.diag(self.gains) @ to_rgb
        return self.exposure * ((xyz if self.curve is None else self.curve.undo(xyz)) @ matrix.T)


def balance(photo: PhotoSky | Frame, simulated: PhotoSky | Frame, white_balance: bool = False) -> Balance:
    """One free exposure and, on request, one free white balance (a gain for red, green and blue).

    The gains make the weighted mean of ln(channel) the same in both, over cells where all channels are positive; the
    exposure then makes the weighted mean of ln(luminance) the same.  Errors: TwilightError where one has no colour.
    """
    weight, there = photo.solid_angle_sr, photo.counts & (simulated.xyz[..., 1] > 0)
    if not there.any():
        raise TwilightError("photo: the computed sky is black where the photograph shows clear sky")
    gains = np.ones(3)
    if white_balance:
        if not (photo.colour_known and simulated.colour_known):
            raise TwilightError("white balance: needs a colour photograph and wavelengths from 480 to 600 nm at least")
        one, other = (colour.xyz_to_linear_rgb(s.xyz, OBSERVER) for s in (photo, simulated))
        with np.errstate(invalid="ignore"):
            good = there & (one > 0).all(axis=-1) & (other > 0).all(axis=-1)
        if not good.any():
            raise TwilightError("white balance: no cell has a colour within Rec. 709 in both")
        fraction = weight[good] / weight[good].sum()
        gains = np.exp(fraction @ np.log(other[good] / one[good]))
        gains /= gains @ colour.REC709_LUMINANCE
    balanced = Balance(1.0, gains).apply(photo.xyz)[..., 1]
    with np.errstate(invalid="ignore"):
        there &= balanced > 0
    fraction = weight[there] / weight[there].sum()
    return Balance(float(np.exp(fraction @ np.log(simulated.xyz[..., 1][there] / balanced[there]))), gains)


@dataclass(frozen=True, eq=False)
class MeridianProfile:
    """Both skies along a great circle through the zenith.

    angle_deg (N,): 0 at the horizon below the sun (solar meridian) or 90 deg to its right (perpendicular), 90 in the
    zenith, 180 at the opposite horizon.  photo, simulated (N, 3): XYZ, NaN where masked.
    """

    angle_deg: np.ndarray
    photo: np.ndarray
    simulated: np.ndarray

    @property
    def log_ratio(self) -> np.ndarray:
        """ln(photograph / simulation) of the luminance, (N,)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.log(self.photo[:, 1] / self.simulated[:, 1])


@dataclass(frozen=True, eq=False)
class Comparison:
    """A photograph and a computed sky on one grid, and the figures of their difference.

    photo, simulated: as compared; ``photo_xyz`` (E, A, 3) is balanced and exposed.
    log_ratio (E, A): ln(photograph / simulation) of the luminance.
    delta_uv (E, A): distance in u', v'.
    figures: numbers of the report, JSON values.
    """

    photo: PhotoSky
    simulated: PhotoSky
    balance: Balance
    photo_xyz: np.ndarray
    log_ratio: np.ndarray
    delta_uv: np.ndarray
    solar: MeridianProfile
    perpendicular: MeridianProfile
    figures: dict[str, Any]


def compare(photo: PhotoSky, sky: Sky, *, white_balance: bool = False, curve: Curve | None = None) -> Comparison:
    """Everything that the report holds; curve: of the camera, undone first.  Errors: TwilightError as ``balance``."""
    simulated = simulated_sky(sky, photo)
    undone = photo if curve is None else replace(photo, xyz=curve.undo(photo.xyz))
    found = replace(balance(undone, simulated, white_balance), curve=curve)
    photo_xyz = found.apply(photo.xyz)
    with np.errstate(invalid="ignore", divide="ignore"):
        log_ratio = np.log(photo_xyz[..., 1] / simulated.xyz[..., 1])
    log_ratio[~np.isfinite(log_ratio)] = np.nan
    has_colour = photo.colour_known and simulated.colour_known
    difference = np.full((*log_ratio.shape, 2), np.nan)
    if has_colour:
        difference = colour.uv_of_xyz(photo_xyz) - colour.uv_of_xyz(simulated.xyz)
    delta_uv = np.hypot(difference[..., 0], difference[..., 1])
    fine = found.apply(photo.fine_xyz)
    solar, across = (meridian_profile(photo, fine, simulated.fine_xyz, azimuth) for azimuth in (0.0, 90.0))
    figures = _figures(photo, simulated, found, log_ratio, difference, (solar, across))
    return Comparison(photo, simulated, found, photo_xyz, log_ratio, delta_uv, solar, across, figures)


def meridian_profile(
    photo: PhotoSky, photo_xyz: np.ndarray, simulated_xyz: np.ndarray, azimuth_deg: float
) -> MeridianProfile:
    """Means over bins of one cell along the great circle through the zenith, at ``azimuth_deg`` from the sun.

    photo_xyz, simulated_xyz (e, a, 3) on the fine grid; only cells that are clear count, in both.
    """
    elevation = np.radians(photo.fine_elevation_deg)[:, None]
    azimuth = np.radians(photo.columns_deg - azimuth_deg)[None, :]
    off = np.degrees(np.arcsin(np.cos(elevation) * np.sin(azimuth)))
    along = np.degrees(np.arctan2(np.sin(elevation), np.cos(elevation) * np.cos(azimuth)))
    n = 2 * photo.elevation_deg.size
    use = photo.fine_valid & (np.abs(off) <= PROFILE_HALF_WIDTH_DEG) & (photo_xyz[..., 1] > 0)
    index = np.clip((along[use] / (180.0 / n)).astype(int), 0, n - 1)
    weight = np.broadcast_to(np.cos(elevation), use.shape)[use]
    total = np.bincount(index, weight, n)
    means = []
    for xyz in (photo_xyz, simulated_xyz):
        sums = np.stack([np.bincount(index, weight * xyz[use][:, c], n) for c in range(3)], axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            means.append(np.where(total[:, None] > 0, sums / total[:, None], np.nan))
    return MeridianProfile((np.arange(n) + 0.5) * 180.0 / n, means[0], means[1])


def _figures(photo, simulated, found, log_ratio, difference, profiles) -> dict[str, Any]:
    there = photo.counts & np.isfinite(log_ratio)
    weight = photo.solid_angle_sr[there]
    fraction = weight / weight.sum()
    ratio = log_ratio[there]
    other = np.log(simulated.xyz[..., 1][there])
    one = ratio + other
    one, other = one - fraction @ one, other - fraction @ other
    spread = np.sqrt((fraction @ one**2) * (fraction @ other**2))
    figures: dict[str, Any] = {
        "cells": int(there.sum()),
        "fraction_of_hemisphere": float(weight.sum() / (2 * np.pi)),
        "exposure_cd_per_m2": found.exposure,
        "white_balance_gains": [float(g) for g in found.gains],
        "luminance_rms_percent": 100 * float(np.sqrt(fraction @ ratio**2)),
        "luminance_median_percent": 100 * _quantile(np.abs(ratio), weight, 0.5),
        "luminance_p95_percent": 100 * _quantile(np.abs(ratio), weight, 0.95),
        "correlation_of_log_luminance": float(fraction @ (one * other) / spread) if spread > 0 else None,
    }
    for name, profile in zip(("solar_meridian", "perpendicular_meridian"), profiles, strict=True):
        values = profile.log_ratio[np.isfinite(profile.log_ratio)]
        figures[f"{name}_rms_percent"] = 100 * float(np.sqrt(np.mean(values**2))) if values.size else None
        figures[f"{name}_shape_rms_percent"] = 100 * float(np.std(values)) if values.size else None
    if np.isfinite(difference).any():
        du, dv = difference[there].T
        distance = np.hypot(du, dv)
        figures |= {
            "uv_distance_mean": float(fraction @ distance),
            "uv_distance_median": _quantile(distance, weight, 0.5),
            "uv_distance_p95": _quantile(distance, weight, 0.95),
            "uv_offset": [float(fraction @ du), float(fraction @ dv)],
        }
    return figures


def _quantile(values: np.ndarray, weight: np.ndarray, q: float) -> float:
    known = np.isfinite(values)
    order = np.argsort(values[known])
    total = np.cumsum(weight[known][order])
    return float(values[known][order][np.searchsorted(total, q * total[-1])])


# For a fit ------------------------------------------------------------------------------------------------------


def residual_vector(
    photo: PhotoSky | Frame,
    simulated: PhotoSky | Frame | np.ndarray,
    *,
    white_balance: bool = False,
    with_colour: bool = True,
) -> np.ndarray:
    """Residuals (n,) whose sum of squares measures how far a simulation is from a photograph.

    For every cell that counts ln(photograph / simulation) / LOG_SCALE and, with colour, the differences in u' and v' /
    CHROMATICITY_SCALE, each times the root of its fraction of the solid angle, after the free exposure (and white
    balance).  simulated: the same, or its XYZ, (E, A, 3) or (n, 3).
    """
    if isinstance(simulated, np.ndarray):
        simulated = replace(photo, xyz=simulated, colour_known=True)
    found = balance(photo, simulated, white_balance)
    there = photo.counts & (simulated.xyz[..., 1] > 0)
    one, other = found.apply(photo.xyz)[there], simulated.xyz[there]
    with np.errstate(invalid="ignore"):
        lit = one[:, 1] > 0
    one, other, weight = one[lit], other[lit], photo.solid_angle_sr[there][lit]
    root = np.sqrt(weight / weight.sum())
    parts = [root * np.log(one[:, 1] / other[:, 1]) / LOG_SCALE]
    if with_colour and photo.colour_known:
        parts += list((root[:, None] * (colour.uv_of_xyz(one) - colour.uv_of_xyz(other)) / CHROMATICITY_SCALE).T)
    return np.concatenate(parts)
