"""A sky as an eye sees it: between day vision and night vision, with what twilight takes of colour and sharpness.

- Mesopic luminance after CIE 191:2010: m = 0.7670 + 0.3334 log10(L_mes), 0..1, L_mes a mean of photopic and scotopic
  luminance with the weights m and (1 - m) V'(555 nm); valid from 0.005 to 5 cd m^-2, day vision above, night vision
  below.  Adaptation is local: a sky changes little over tens of degrees.
- Brightness: the display shows the mesopic luminance in multiples of the threshold of an eye that is adapted to the
  mean (by logarithm) of the picture: thresholds of cones and rods of Ferwerda et al. 1996 (SIGGRAPH, eqs. 1 and 2; 1e-6
  to 1e4 cd m^-2), mixed by m in the logarithm.
- Colour: the rods' fraction (1 - m) V'(555 nm) of the mesopic luminance is grey with a shift to blue, the chromaticity
  (0.25, 0.25) of Jensen et al. 2000 (Night rendering, UUCS-00-016).
- Acuity: details finer than Shlaer's 1937 limit in the fit of Ward Larson et al. 1997 (IEEE TVCG 3, 291) are gone.
- Adaptation in time (`adapt`): the pigments' recovery, 110 s for cones and 400 s for rods (Pattanaik et al. 2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.tone import Light, Shot, to_display, weights_at_1nm

SCOTOPIC_EFFICACY_LM_PER_W = 1700.06
"""Luminous efficacy at the maximum of V'(lambda), 683 lm/W at 555.016 nm (CIE 018:2019)."""
MESOPIC_RATIO = 683.0 / 1699.0
"""V'(555 nm) as CIE 191:2010 has it."""
DISPLAY_WHITE_CD_PER_M2 = 100.0
"""Luminance of white on a display."""
DISPLAY_ADAPTATION_CD_PER_M2 = 27.0
"""What a picture at the meter's 1.5 times middle grey adapts its viewer to."""
NIGHT_BLUE_XY = (0.25, 0.25)
"""Chromaticity of what rods alone see (Jensen et al. 2000)."""
MESOPIC_OFFSET = 0.7670
"""m at 1 cd m^-2 (CIE 191:2010)."""
MESOPIC_PER_DECADE = 0.3334
"""Change of m for a factor of ten in luminance (CIE 191:2010)."""
NEWTON_STEPS = 6
"""Newton steps for the equation of m: m is within 1e-15 for scotopic over photopic light 0.5 to 6, 0.005 at 0.1."""
CONES_S = 110.0
"""Time constant of the dark adaptation of cones [s] (Pattanaik et al. 2000)."""
RODS_S = 400.0
"""Time constant of the dark adaptation of rods [s] (Pattanaik et al. 2000)."""
DAY_CD_PER_M2 = 5.0
"""Luminance above which an adapted eye has day vision alone, and the time constant of cones (CIE 191:2010)."""
NIGHT_CD_PER_M2 = 0.005
"""Luminance below which an adapted eye has night vision alone, and the time constant of rods (CIE 191:2010)."""
SIGMA_CYCLES = float(np.sqrt(2.0 * np.log(2.0)) / (2.0 * np.pi))
"""Standard deviation of the blur times the finest grating that is seen: half of that grating's contrast is left."""


@lru_cache(maxsize=1)
def scotopic_efficiency() -> np.ndarray:
    """V'(lambda) of the CIE 1951 scotopic observer at ``spectrum.VISIBLE_NM``, (471,), from colour-science."""
    from colour import SDS_LEFS  # start-up

    found = SDS_LEFS["CIE 1951 Scotopic Standard Observer"]
    return np.interp(spectrum.VISIBLE_NM, found.wavelengths, found.values, left=0.0, right=0.0)


def adaptation_coefficient(photopic: np.ndarray, scotopic: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """m of CIE 191:2010 (0: night vision, 1: day vision) and the mesopic luminance [cd m^-2] for luminances of one
    shape; photopic and scotopic [cd m^-2]."""
    p, s = np.maximum(np.asarray(photopic, float), 1e-12), np.maximum(np.asarray(scotopic, float), 1e-12)
    m = np.full(np.broadcast_shapes(p.shape, s.shape), 0.5)
    for _ in range(NEWTON_STEPS):
        light, weight = m * p + (1.0 - m) * s * MESOPIC_RATIO, m + (1.0 - m) * MESOPIC_RATIO
        found = np.clip(MESOPIC_OFFSET + MESOPIC_PER_DECADE * np.log10(light / weight), 0.0, 1.0)
        slope = MESOPIC_PER_DECADE / np.log(10.0) * ((p - s * MESOPIC_RATIO) / light - (1.0 - MESOPIC_RATIO) / weight)
        inside = (found > 0.0) & (found < 1.0)
        m = np.clip(m + (found - m) / np.where(inside, np.maximum(1.0 - slope, 0.5), 1.0), 0.0, 1.0)
    return m, (m * p + (1.0 - m) * s * MESOPIC_RATIO) / (m + (1.0 - m) * MESOPIC_RATIO)


def cone_threshold(luminance: np.ndarray | float) -> np.ndarray:
    """Smallest visible step [cd m^-2] for cones adapted to a photopic luminance, Ferwerda et al. 1996 eq. 1."""
    x = np.log10(np.maximum(luminance, 1e-12))
    middle = np.maximum(0.249 * x + 0.65, 0.0) ** 2.7 - 0.72
    return 10.0 ** np.select([x <= -2.6, x >= 1.9], [-0.72, x - 1.255], middle)


def rod_threshold(luminance: np.ndarray | float) -> np.ndarray:
    """Smallest visible step [cd m^-2] for rods adapted to a luminance, both scotopic, Ferwerda et al. 1996 eq. 2."""
    x = np.log10(np.maximum(luminance, 1e-12))
    middle = np.maximum(0.405 * x + 1.6, 0.0) ** 2.18 - 2.86
    return 10.0 ** np.select([x <= -3.94, x >= -1.44], [-2.86, x - 0.395], middle)


def display_gain(photopic: np.ndarray | float, scotopic: np.ndarray | float) -> np.ndarray:
    """Luminance on the display over mesopic luminance, for an eye adapted to these luminances [cd m^-2].

    A step that is just seen there is one that is just seen on the display: the threshold of cones adapted to the
    display over that of cones and rods in the sky, mixed by m of CIE 191 in the logarithm.
    """
    adapted, _ = adaptation_coefficient(np.asarray(photopic), np.asarray(scotopic))
    shown = cone_threshold(DISPLAY_ADAPTATION_CD_PER_M2)
    return (shown / cone_threshold(photopic)) ** adapted * (shown / rod_threshold(scotopic)) ** (1.0 - adapted)


def acuity_cycles_per_deg(luminance: np.ndarray | float) -> np.ndarray:
    """Finest grating that is seen [cycles/deg] at an adaptation luminance [cd m^-2], Ward Larson et al. 1997 eq. 14."""
    return 17.25 * np.arctan(1.4 * np.log10(np.maximum(luminance, 1e-6)) + 0.35) + 25.72


def adapt(time_s: np.ndarray, luminance: np.ndarray, start: float | None = None) -> np.ndarray:
    """Luminance [cd m^-2] that an eye is adapted to at each of the times, given what it looked at, both (N,).

    The logarithm follows with the time constant of cones above 5 and of rods below 0.005 cd m^-2 where it gets darker,
    at once where it gets brighter.  start: of the adaptation, None: to the first luminance.
    """
    t, light = np.asarray(time_s, float), np.log(np.maximum(np.asarray(luminance, float), 1e-12))
    state = light[0] if start is None else float(np.log(start))
    out = np.empty(t.size)
    for i in range(t.size):
        if i:
            span = np.log(DAY_CD_PER_M2 / NIGHT_CD_PER_M2)
            fraction = float(np.clip((state - np.log(NIGHT_CD_PER_M2)) / span, 0.0, 1.0))
            slow = RODS_S * (CONES_S / RODS_S) ** fraction
            follow = -np.expm1(-(t[i] - t[i - 1]) / slow)
            state = light[i] if light[i] > state else state + follow * (light[i] - state)
        out[i] = state
    return np.exp(out)


def night_blue() -> np.ndarray:
    """X, Y, Z of `NIGHT_BLUE_XY` with Y = 1."""
    x, y = NIGHT_BLUE_XY
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


@dataclass(frozen=True)
class Eye:
    """adapted_cd_per_m2: what the eye is adapted to, None: the picture; acuity: whether fine details are lost."""

    highlights_over_mean: ClassVar[float] = colour.HIGHLIGHTS_OVER_MEAN
    observer: str = colour.DEFAULT_OBSERVER
    adapted_cd_per_m2: float | None = None
    acuity: bool = True

    def see(self, factor: np.ndarray, wavelength_nm: np.ndarray, light: Light) -> np.ndarray:
        """X, Y, Z as ``colour.factor_to_xyz`` and the scotopic luminance [cd m^-2]."""
        xyz = colour.factor_to_xyz(factor, wavelength_nm, light.solar_spectrum, light.distance_au, self.observer)
        weight = SCOTOPIC_EFFICACY_LM_PER_W * scotopic_efficiency() * weights_at_1nm(light)
        night = np.maximum(spectrum.integrate(factor, wavelength_nm, weight), 0.0)
        return np.concatenate([xyz, night[..., None]], axis=-1)

    def develop(self, seen: np.ndarray, shot: Shot) -> tuple[np.ndarray, dict[str, float | str]]:
        photopic, scotopic = seen[..., 1], seen[..., 3]
        day, night = _log_mean(photopic), _log_mean(scotopic)
        if self.adapted_cd_per_m2 is not None:
            day, night = self.adapted_cd_per_m2, self.adapted_cd_per_m2 * night / day
        fraction, mesopic = adaptation_coefficient(photopic, scotopic)
        adapted, _ = adaptation_coefficient(np.array(day), np.array(night))
        gain = display_gain(day, night)
        from_cones = fraction * photopic
        coloured = from_cones / np.maximum(from_cones + (1.0 - fraction) * scotopic * MESOPIC_RATIO, 1e-300)
        hue = seen[..., :3] / np.maximum(photopic, 1e-300)[..., None]
        mixed = coloured[..., None] * hue + (1.0 - coloured[..., None]) * night_blue()
        linear = colour.xyz_to_linear_rgb(gain * mesopic[..., None] * mixed) / DISPLAY_WHITE_CD_PER_M2
        finest = float(acuity_cycles_per_deg(day))
        if self.acuity and shot.pixel_deg > 0.0:
            from scipy.ndimage import gaussian_filter1d  # start-up

            for axis in (0, 1):
                linear = gaussian_filter1d(linear, SIGMA_CYCLES / finest / shot.pixel_deg, axis, mode="nearest")
        return to_display(linear), {
            "adapted_photopic_cd_per_m2": day,
            "adapted_scotopic_cd_per_m2": night,
            "adaptation_coefficient": float(adapted),
            "mean_mesopic_cd_per_m2": _log_mean(mesopic),
            "acuity_cycles_per_deg": finest,
        }


def _log_mean(luminance: np.ndarray) -> float:
    light = luminance[np.isfinite(luminance) & (luminance > 0.0)]
    return float(np.exp(np.log(light).mean())) if light.size else 1e-6
