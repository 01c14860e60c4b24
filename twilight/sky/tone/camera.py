"""A sky as a digital camera takes it: exposure, white balance, the sensor's spectral response, and its noise.

- Exposure: an area of luminance L gives the sensor H = 0.65 L t / N^2 lx s (ISO 12232: lens of 90 %, 10 deg off axis),
  which is saturated at 78 lx s / S; the meter (ISO 2720, K = 12.5) puts its mean at 0.104 of that.
- Spectral responses: measured by the NPL, as colour-science ships them (380 to 780 nm).
- White balance: the channels are equal for a black body (below 4000 K) or CIE daylight of a temperature; the matrix to
  Rec. 709 is that of least squares over the 24 patches of the ColorChecker (Ohta 1997) under that light.
- Noise: of photons and of reading, EMVA 1288 (release 4.0) model, with the full well of a full-frame sensor, 60 000
  electrons at ISO 100, 3 electrons of reading and 0.1 electrons/s of dark current.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.tone import Light, Shot, to_display, weights_at_1nm

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
    from colour import MSDS_CAMERA_SENSITIVITIES  # start-up

    found = MSDS_CAMERA_SENSITIVITIES[SENSORS[sensor]]
    columns = [np.interp(spectrum.VISIBLE_NM, found.wavelengths, c, left=0.0, right=0.0) for c in found.values.T]
    return np.stack(columns, axis=1)


def illuminant(kelvin: float) -> np.ndarray:
    """Relative spectrum of a black body below 4000 K and of CIE daylight above at ``spectrum.VISIBLE_NM``, (471,).

    Errors: TwilightError outside 1500 to 25 000 K.
    """
    if not 1500.0 <= kelvin <= 25000.0:
        raise TwilightError(f"output.camera.white_balance_k: {kelvin:g} K must be between 1500 and 25000")
    if kelvin < 4000.0:
        metre = spectrum.VISIBLE_NM * 1e-9
        return metre**-5.0 / np.expm1(1.438777e-2 / (metre * kelvin)) / 1e30
    from colour import sd_CIE_illuminant_D_series  # start-up
    from colour.temperature import CCT_to_xy_CIE_D  # start-up

    daylight = sd_CIE_illuminant_D_series(CCT_to_xy_CIE_D(kelvin))
    return np.interp(spectrum.VISIBLE_NM, daylight.wavelengths, daylight.values)


@lru_cache(maxsize=8)
def balance(sensor: str, kelvin: float) -> tuple[np.ndarray, np.ndarray]:
    """Gains (3,) and matrix (3, 3): raw times gains is the luminance of white light [cd m^-2 for W m^-2 sr^-1], and
    the matrix takes balanced raw values to linear Rec. 709; white stays white."""
    from colour import SDS_COLOURCHECKERS  # start-up

    response, light = sensor_response(sensor), illuminant(kelvin)
    matching = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.colour_matching_functions("cie1931_2deg")
    white = light @ matching
    gains = white[1] / (light @ response)
    patches = SDS_COLOURCHECKERS["ColorChecker N Ohta"].values()
    reflectance = np.stack([np.interp(spectrum.VISIBLE_NM, p.wavelengths, p.values) for p in patches])
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
