"""From light to a picture: curves of luminance and colour, `eye` as a person sees it, `camera` as one takes it.

A tone says what it measures of a spectrum (``see``, a linear functional with K channels, the second of them luminance
[cd m^-2]) and makes a picture of a field of these (``develop``).

The camera:
- Exposure: an area of luminance L gives the sensor H = 0.65 L t / N^2 lx s (ISO 12232: lens of 90 %, 10 deg off axis),
  which is saturated at 78 lx s / S; the meter (ISO 2720, K = 12.5) puts its mean at 0.104 of that.
- Spectral responses: measured by the NPL, as colour-science ships them (380 to 780 nm).
- White balance: the channels are equal for a black body (below 4000 K) or CIE daylight of a temperature; the matrix to
  Rec. 709 is that of least squares over the 24 patches of the ColorChecker (Ohta 1997) under that light.
- Noise: of photons and of reading, EMVA 1288 (release 4.0) model, with the full well of a full-frame sensor, 60 000
  electrons at ISO 100, 3 electrons of reading and 0.1 electrons/s of dark current.

The eye, between day vision and night vision:
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

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Protocol

import numpy as np

from twilight.base.conventions import LEAST_LUMINANCE, TINY
from twilight.base.errors import TwilightError, check_known
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.quantities.measure import MESOPIC_RATIO, adaptation_coefficient
from twilight.sky.quantities.responses import SCOTOPIC_EFFICACY_LM_PER_W, scotopic_efficiency

NAMES = (*colour.TONE_MAPPINGS, "eye", "camera")


@dataclass(frozen=True)
class Light:
    """What multiplies sun-normalised spectra: the solar spectrum, by name, and the distance to the sun [au]."""

    solar_spectrum: str
    distance_au: float


@dataclass(frozen=True)
class Shot:
    """What a picture is of: its exposure value at ISO 100 by the meter (or by hand), the size of a pixel [deg], and its
    number in a film, whose pictures have different noise."""

    ev100: float
    pixel_deg: float
    number: int = 0


class Tone(Protocol):
    """How light becomes a picture.

    highlights_over_mean: how far over the log-mean of a picture the meter lets its highlights go.
    """

    highlights_over_mean: ClassVar[float]

    def see(self, factor: np.ndarray, wavelength_nm: np.ndarray, light: Light) -> np.ndarray:
        """Channels (..., K) of sun-normalised spectra (..., W); the second is luminance [cd m^-2]."""
        ...

    def develop(self, seen: np.ndarray, shot: Shot) -> tuple[np.ndarray, dict[str, float | str]]:
        """Display values 0..1 (height, width, 3) of a field of channels, and what was set or found, by name."""
        ...


@dataclass(frozen=True)
class CurveTone:
    """The curves of ``colour.tone_map``."""

    highlights_over_mean: ClassVar[float] = colour.HIGHLIGHTS_OVER_MEAN
    tone_mapping: str = colour.DEFAULT_TONE_MAPPING
    observer: str = colour.DEFAULT_OBSERVER

    def see(self, factor: np.ndarray, wavelength_nm: np.ndarray, light: Light) -> np.ndarray:
        return colour.factor_to_xyz(factor, wavelength_nm, light.solar_spectrum, light.distance_au, self.observer)

    def develop(self, seen: np.ndarray, shot: Shot) -> tuple[np.ndarray, dict[str, float | str]]:
        return colour.tone_map(colour.xyz_to_linear_rgb(seen[..., :3]), shot.ev100, self.tone_mapping), {}


def tone_of(name: str, observer: str, settings: Mapping[str, Mapping[str, Any]] | None = None) -> Tone:
    """The tone of a name; settings: of ``eye`` and ``camera``, as the sections of a configuration have them."""
    given = dict((settings or {}).get(name) or {})
    if name == "eye":
        return Eye(observer=observer, **given)
    if name == "camera":
        return Camera(**given)
    check_known("tone_mapping", name, NAMES)
    return CurveTone(name, observer)


def to_display(linear: np.ndarray, white: float = np.inf) -> np.ndarray:
    """Linear RGB to display values 0..1: into the gamut, ``colour.photographic`` with its white, sRGB encoding."""
    return colour.srgb_encode(colour.photographic(colour.into_gamut(linear), white))


def scotopic_weights(light: Light) -> np.ndarray:
    """Weights (G,) of a radiance over F0 in scotopic luminance [cd m^-2]."""
    return SCOTOPIC_EFFICACY_LM_PER_W * scotopic_efficiency() * weights_at_1nm(light)


def weights_at_1nm(light: Light) -> np.ndarray:
    """Solar irradiance [W m^-2 nm^-1] at ``spectrum.VISIBLE_NM``, (471,)."""
    return spectrum.solar_at_visible(light.solar_spectrum, light.distance_au)


SENSORS = {"nikon_5100": "Nikon 5100 (NPL)", "sigma_sd_merrill": "Sigma SDMerill (NPL)"}
"""Names here and in colour-science."""
EXPOSURE_Q = 0.65
"""Exposure H [lx s] over L t / N^2 [cd s m^-2]: a lens of 90 %, 10 deg off its axis (ISO 12232)."""
SATURATION_LX_S = 78.0
"""Exposure that saturates a sensor at ISO 1 [lx s] (ISO 12232)."""
METERED = EXPOSURE_Q * 12.5 / SATURATION_LX_S
"""Fraction of saturation that the meter gives the mean luminance (ISO 2720, K = 12.5 cd s m^-2)."""
FULL_WELL_ELECTRONS = 60_000.0
"""Electrons of a saturated pixel at ISO 100: a full-frame sensor."""
READ_NOISE_ELECTRONS = 3.0
"""Standard deviation of reading a pixel [electrons]: a full-frame sensor."""
DARK_ELECTRONS_PER_S = 0.1
"""Dark current of a pixel [electrons / s]: a full-frame sensor."""
FASTEST_S = 1.0 / 8000.0
"""Shortest exposure time that the meter chooses [s], as full-frame cameras have it."""
SLOWEST_S = 30.0
"""Longest exposure time that the meter chooses [s], as full-frame cameras have it."""
SATURATED_LINEAR = colour.MIDDLE_GREY / METERED
"""What a saturated sensor is on the scale of the curve, where the metered mean is middle grey; it is shown white."""
FADING_FROM = 0.7
"""Fraction of saturation from which colours fade, to be gone where their largest channel is saturated: the ratios of
channels of which one is clipped are no colour, and were fringes of false hue (cyan and magenta) around highlights."""


@lru_cache(maxsize=8)
def sensor_response(sensor: str) -> np.ndarray:
    """Response of red, green and blue at ``spectrum.VISIBLE_NM``, (471, 3), 0 where it was not measured."""
    return np.stack([spectrum.at_visible(f"{sensor} {channel}") for channel in ("red", "green", "blue")], axis=1)


def illuminant(kelvin: float) -> np.ndarray:
    """Relative spectrum of a black body below 4000 K and of CIE daylight above at ``spectrum.VISIBLE_NM``, (471,).

    Errors: TwilightError outside 1500 to 25 000 K.
    """
    if not 1500.0 <= kelvin <= 25000.0:
        raise TwilightError(f"output.camera.white_balance_k: {kelvin:g} K must be between 1500 and 25000")
    if kelvin < 4000.0:
        metre = spectrum.VISIBLE_NM * 1e-9
        return metre**-5.0 / np.expm1(1.438777e-2 / (metre * kelvin)) / 1e30
    return spectrum.daylight(kelvin)


@lru_cache(maxsize=8)
def balance(sensor: str, kelvin: float) -> tuple[np.ndarray, np.ndarray]:
    """Gains (3,) and matrix (3, 3): raw times gains is the luminance of white light [cd m^-2 for W m^-2 sr^-1], and
    the matrix takes balanced raw values to linear Rec. 709; white stays white."""
    response, light = sensor_response(sensor), illuminant(kelvin)
    matching = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.colour_matching_functions("cie1931_2deg")
    white = light @ matching
    gains = white[1] / (light @ response)
    patches = [spectrum.colour_spectrum(f"patch {k + 1}") for k in range(24)]
    reflectance = np.stack([np.interp(spectrum.VISIBLE_NM, *patch) for patch in patches])
    raw = (reflectance * light) @ response * gains / white[1]
    xyz = (reflectance * light) @ matching / white[1]
    to_rgb = spectrum.xyz_to_rgb_matrix("cie1931_2deg")
    d65 = np.linalg.inv(to_rgb) @ np.ones(3)
    rgb = xyz @ _bradford(white / white[1], d65).T @ to_rgb.T
    # rows that sum to 1: white stays white; least squares over the two differences that are left
    free = raw[:, 1:] - raw[:, :1]
    solved = np.linalg.lstsq(free, rgb - raw[:, :1], rcond=None)[0].T
    matrix = np.column_stack([1.0 - solved.sum(axis=1), solved])
    return gains, matrix


def _bradford(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    cone = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
    return np.linalg.inv(cone) @ np.diag((cone @ target) / (cone @ source)) @ cone


def _rolled_off(signal: np.ndarray) -> np.ndarray:
    """Balanced signals (..., 3), 1 = saturated, clipped, with colours that fade to white as they saturate."""
    clipped = np.clip(signal, 0.0, 1.0)
    largest = clipped.max(axis=-1, keepdims=True)
    t = np.clip((largest - FADING_FROM) / (1.0 - FADING_FROM), 0.0, 1.0)
    faded = t * t * (3.0 - 2.0 * t)
    return clipped + faded * (largest - clipped)


@dataclass(frozen=True)
class Camera:
    """iso, f_number; seconds, None: by the meter; white_balance_k [K]; sensor: of ``SENSORS``; noise: whether it has.

    A pixel of the picture is one of the sensor.
    """

    highlights_over_mean: ClassVar[float] = 4.0  # then at 0.62 of saturation: the twilight arch keeps its colours
    iso: float = 100.0
    seconds: float | None = None
    f_number: float = 4.0
    white_balance_k: float = 5500.0
    sensor: str = "nikon_5100"
    noise: bool = True

    def see(self, factor: np.ndarray, wavelength_nm: np.ndarray, light: Light) -> np.ndarray:
        """Balanced red, luminance, balanced green and blue: what white light of that luminance would give [cd m^-2].

        Errors: TwilightError where the wavelengths do not reach from blue to red.
        """
        if not colour.colour_is_defined(np.asarray(wavelength_nm)):
            raise TwilightError("output.tone_mapping: camera needs wavelengths from 480 nm or less to 600 nm or more")
        colour.warn_of_wrong_colour(wavelength_nm)
        gains, _ = balance(self.sensor, self.white_balance_k)
        luminance = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.colour_matching_functions("cie1931_2deg")[:, 1:2]
        red, green, blue = (sensor_response(self.sensor) * gains).T[..., None]
        weight = np.concatenate([red, luminance, green, blue], axis=1) * weights_at_1nm(light)[:, None]
        return np.maximum(spectrum.integrate(factor, wavelength_nm, weight), 0.0)

    def develop(self, seen: np.ndarray, shot: Shot) -> tuple[np.ndarray, dict[str, float | str]]:
        seconds = self.seconds
        if seconds is None:
            seconds = float(np.clip(self.f_number**2 / 2.0**shot.ev100 * 100.0 / self.iso, FASTEST_S, SLOWEST_S))
        signal = seen[..., [0, 2, 3]] * (EXPOSURE_Q * seconds / self.f_number**2 * self.iso / SATURATION_LX_S)
        signal = np.nan_to_num(signal)
        if self.noise:
            signal = self._with_noise(signal, seconds, shot.number)
        _, matrix = balance(self.sensor, self.white_balance_k)
        linear = _rolled_off(signal) @ matrix.T * SATURATED_LINEAR
        return to_display(linear, SATURATED_LINEAR), {
            "iso": self.iso,
            "seconds": seconds,
            "f_number": self.f_number,
            "white_balance_k": self.white_balance_k,
            "sensor": SENSORS[self.sensor],
            "exposure_ev100": float(np.log2(self.f_number**2 / seconds * 100.0 / self.iso)),
        }

    def _with_noise(self, signal: np.ndarray, seconds: float, number: int = 0) -> np.ndarray:
        """The same noise every time for one number of a picture: equal skies give equal pictures."""
        well = FULL_WELL_ELECTRONS * 100.0 / self.iso
        dark = DARK_ELECTRONS_PER_S * seconds
        random = np.random.default_rng([20101, number])
        electrons = random.poisson(np.minimum(signal, 4.0) * well + dark) - dark
        return (electrons + random.normal(0.0, READ_NOISE_ELECTRONS, signal.shape)) / well


DISPLAY_WHITE_CD_PER_M2 = 100.0
"""Luminance of white on a display."""
DISPLAY_ADAPTATION_CD_PER_M2 = 27.0
"""What a picture at the meter's 1.5 times middle grey adapts its viewer to."""
NIGHT_BLUE_XY = (0.25, 0.25)
"""Chromaticity of what rods alone see (Jensen et al. 2000)."""
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


def cone_threshold(luminance: np.ndarray | float) -> np.ndarray:
    """Smallest visible step [cd m^-2] for cones adapted to a photopic luminance, Ferwerda et al. 1996 eq. 1."""
    x = np.log10(np.maximum(luminance, LEAST_LUMINANCE))
    middle = np.maximum(0.249 * x + 0.65, 0.0) ** 2.7 - 0.72
    return 10.0 ** np.select([x <= -2.6, x >= 1.9], [-0.72, x - 1.255], middle)


def rod_threshold(luminance: np.ndarray | float) -> np.ndarray:
    """Smallest visible step [cd m^-2] for rods adapted to a luminance, both scotopic, Ferwerda et al. 1996 eq. 2."""
    x = np.log10(np.maximum(luminance, LEAST_LUMINANCE))
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
    t, light = np.asarray(time_s, float), np.log(np.maximum(np.asarray(luminance, float), LEAST_LUMINANCE))
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
        night = np.maximum(spectrum.integrate(factor, wavelength_nm, scotopic_weights(light)), 0.0)
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
        coloured = from_cones / np.maximum(from_cones + (1.0 - fraction) * scotopic * MESOPIC_RATIO, TINY)
        hue = seen[..., :3] / np.maximum(photopic, TINY)[..., None]
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
