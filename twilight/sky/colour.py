"""From spectra to XYZ, linear sRGB and a picture on a screen, on colour-science's observers and matrices."""

import warnings
from weakref import WeakKeyDictionary

import numpy as np

from twilight.base.conventions import TINY
from twilight.base.errors import TwilightWarning, check_known
from twilight.numerics import spectrum
from twilight.sky.sky import Sky

DEFAULT_OBSERVER = "cie1964_10deg"
"""The sky fills more than 4 deg of the field of view, for which the 10 deg observer is meant."""

TONE_MAPPINGS: tuple[str, ...] = ("photographic", "filmic", "gamma")
DEFAULT_TONE_MAPPING = "photographic"

MIDDLE_GREY = 0.18
"""Reflectance of middle grey."""
GREY_LUMINANCE_AT_EV100_0 = 0.125
"""Luminance [cd m^-2] that an exposure meter (ISO 2720, K = 12.5) puts on middle grey at EV100 = 0."""

METERED_GREYS = 1.5
"""Multiples of middle grey on which the meter puts the log-mean luminance of a sky: a lawn is grey, a sky is not."""
HIGHLIGHT_QUANTILE = 0.995
"""Quantile of the luminance that counts as its highlights."""
HIGHLIGHTS_OVER_MEAN = 16.0
"""Highlights over the log-mean luminance beyond which the meter lowers the exposure."""

REC709_LUMINANCE = np.array([0.2126390059, 0.7151686788, 0.0721923154])
"""Y of the Rec. 709 primaries with a D65 white (ITU-R BT.709, full precision)."""

_CACHED_XYZ: WeakKeyDictionary[Sky, dict[str, np.ndarray]] = WeakKeyDictionary()
"""XYZ of a sky's grid by observer: several files are made from the same."""

_COLOUR_NEEDS_NM = (480.0, 600.0)
"""Range [nm] that samples must cover for a colour to be reported."""
_COLOUR_RIGHT_NM = (440.0, 640.0)
"""Range [nm] in which a colour needs samples no farther apart than `_COLOUR_STEP_NM`.  Of 300 random choices of 3 to 8
wavelengths under suns from 5 to -9 deg those that keep both rules were at most 0.011 in u', v' from 41 wavelengths (of
95 % of the sky), the others 0.038 in the median."""
_COLOUR_STEP_NM = 78.0
"""Largest distance of neighbouring wavelengths [nm] for a colour."""


def check_observer(observer: str) -> None:
    """Raise TwilightError for an observer that does not exist."""
    check_known("observer", observer, spectrum.OBSERVERS)


def colour_is_defined(wavelength_nm: np.ndarray) -> bool:
    """Whether the sampled wavelengths reach from blue (480 nm) to red (600 nm), so that a colour means something."""
    wavelength = np.asarray(wavelength_nm)
    return bool(wavelength[0] <= _COLOUR_NEEDS_NM[0] and wavelength[-1] >= _COLOUR_NEEDS_NM[1])


def warn_of_wrong_colour(wavelength_nm: np.ndarray) -> None:
    """A TwilightWarning where a picture of these wavelengths has no colours, or wrong ones."""
    wavelength = np.asarray(wavelength_nm, float)
    low, high = _COLOUR_RIGHT_NM
    between = wavelength[np.searchsorted(wavelength, low, "right") - 1 : np.searchsorted(wavelength, high) + 1]
    if wavelength[0] <= low and wavelength[-1] >= high and np.diff(between).max() <= _COLOUR_STEP_NM:
        return
    what = "wrong ones (twilight is purple)" if colour_is_defined(wavelength) else "a grey picture"
    these = f"the {wavelength.size} from {wavelength[0]:g} to {wavelength[-1]:g} nm give"
    if wavelength.size == 1:
        these = f"{wavelength[0]:g} nm alone gives"
    warnings.warn(
        f"colours need 5 wavelengths or more, e.g. 420, 490, 560, 630 and 700 nm: from {low:g} nm or less to "
        f"{high:g} nm or more, at most {_COLOUR_STEP_NM:g} nm apart; {these} {what}",
        TwilightWarning,
        stacklevel=3,
    )


def colour_note(sky: Sky, observer: str = DEFAULT_OBSERVER) -> str:
    """One sentence on what the colours of this sky are."""
    if colour_is_defined(sky.wavelength_nm):
        return f"linear Rec. 709 from {sky.wavelength_nm.size} wavelengths, observer {observer}"
    low, high = sky.wavelength_nm[[0, -1]]
    return (
        f"grey: {low:g} to {high:g} nm do not reach from {_COLOUR_NEEDS_NM[0]:g} to {_COLOUR_NEEDS_NM[1]:g} nm, "
        "so the colour is not defined and only the brightness is shown"
    )


def uv_of_xyz(xyz: np.ndarray) -> np.ndarray:
    """CIE 1976 u', v' (..., 2) of XYZ (..., 3); NaN for black."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([4.0 * xyz[..., 0], 9.0 * xyz[..., 1]], axis=-1) / (xyz @ np.array([1.0, 15.0, 3.0]))[..., None]


def uv_of_xy(x, y) -> np.ndarray:
    """CIE 1976 u', v' (..., 2) of the chromaticities x and y."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    return uv_of_xyz(np.stack([x, y, 1.0 - x - y], axis=-1))


def spectrum_to_xyz(
    factor: np.ndarray,
    wavelength_nm: np.ndarray,
    *,
    solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM,
    distance_au: float = 1.0,
    observer: str = DEFAULT_OBSERVER,
) -> np.ndarray:
    """Absolute XYZ (..., 3) of sun-normalised spectra (..., W): 683 lm/W x integral of factor x sun x observer.

    Y is in cd m^-2 for a radiance factor [sr^-1]; with ``cie1931_2deg`` it is the luminance.  The factor is taken to
    1 nm by ``spectrum.expand``, then multiplied by the solar spectrum at 1 nm.
    """
    weight = spectrum.LUMINOUS_EFFICACY_LM_PER_W * spectrum.colour_matching_functions(observer)
    weight = weight * spectrum.solar_at_visible(solar_spectrum, distance_au)[:, None]
    return spectrum.integrate(factor, wavelength_nm, weight)


def xyz_to_linear_rgb(xyz: np.ndarray, observer: str = "cie1931_2deg") -> np.ndarray:
    """Linear Rec. 709 (D65) in the units of Y, (..., 3).  Colours outside the gamut keep their negative values."""
    return np.asarray(xyz) @ spectrum.xyz_to_rgb_matrix(observer).T


def sky_to_xyz(sky: Sky, factor: np.ndarray | None = None, observer: str = DEFAULT_OBSERVER) -> np.ndarray:
    """XYZ as Rec. 709 means them: Y is the luminance [cd m^-2], the chromaticity is as the observer sees it, (..., 3).

    For ``factor`` (..., W) with the wavelengths and the sun of the sky; None = its normalised_radiance.  The XYZ of
    the 10 deg observer are adapted to the white of the 2 deg observer (``spectrum.xyz_to_rgb_matrix``) and scaled: its
    own Y is some 10 % above the luminance, for V(lambda) belongs to 2 deg.  Where ``colour_is_defined`` says no, the
    chromaticity is that of D65, grey.  ``xyz_to_linear_rgb`` with its default takes the result.  The XYZ of a sky's own
    grid are cached as long as the sky lives, and must not be written to.
    """
    if factor is None:
        cached = _CACHED_XYZ.setdefault(sky, {})
        if observer not in cached:
            cached[observer] = sky_to_xyz(sky, sky.normalised_radiance, observer)
            cached[observer].flags.writeable = False
        return cached[observer]
    return factor_to_xyz(factor, sky.wavelength_nm, sky.solar_spectrum, sky.distance_au, observer)


def xyz_weights(solar_spectrum: str, distance_au: float, observer: str) -> tuple[np.ndarray, np.ndarray]:
    """Weights (G, 4) at VISIBLE_NM of an observer's X, Y, Z and of luminance, and the matrix (3, 3) from the first
    three to X, Y, Z of 2 deg, which are then made as bright as the luminance says."""
    two_deg = spectrum.colour_matching_functions("cie1931_2deg")[:, 1:2]
    functions = np.concatenate([spectrum.colour_matching_functions(observer), two_deg], axis=1)
    sun = spectrum.solar_at_visible(solar_spectrum, distance_au)[:, None]
    to_xyz = np.linalg.inv(spectrum.xyz_to_rgb_matrix("cie1931_2deg"))
    return spectrum.LUMINOUS_EFFICACY_LM_PER_W * functions * sun, (to_xyz @ spectrum.xyz_to_rgb_matrix(observer)).T


def factor_to_xyz(
    factor: np.ndarray,
    wavelength_nm: np.ndarray,
    solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM,
    distance_au: float = 1.0,
    observer: str = DEFAULT_OBSERVER,
) -> np.ndarray:
    """XYZ (..., 3) as ``sky_to_xyz`` of sun-normalised spectra (..., W) at any wavelengths.

    Warns: TwilightWarning where the wavelengths are too few for a colour.
    """
    warn_of_wrong_colour(wavelength_nm)
    weights, to_two_deg = xyz_weights(solar_spectrum, distance_au, observer)
    xyzv = spectrum.integrate(factor, wavelength_nm, weights)
    luminance = np.maximum(xyzv[..., 3:4], 0.0)
    to_xyz = np.linalg.inv(spectrum.xyz_to_rgb_matrix("cie1931_2deg"))
    if not colour_is_defined(wavelength_nm):
        return luminance * (to_xyz @ np.ones(3))
    xyz = np.maximum(xyzv[..., :3] @ to_two_deg, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(xyz[..., 1:2] > 0, xyz * (luminance / xyz[..., 1:2]), 0.0)


def sky_to_linear_rgb(sky: Sky, factor: np.ndarray | None = None, observer: str = DEFAULT_OBSERVER) -> np.ndarray:
    """Linear Rec. 709 of ``sky_to_xyz`` [cd m^-2], (..., 3)."""
    return xyz_to_linear_rgb(sky_to_xyz(sky, factor, observer))


# Exposure and tone mapping --------------------------------------------------------------------------------------


def auto_exposure_ev100(
    luminance: np.ndarray,
    solid_angle: np.ndarray | None = None,
    highlights_over_mean: float = HIGHLIGHTS_OVER_MEAN,
) -> float:
    """Exposure value at ISO 100 that suits a sky: its log-mean luminance at 1.5 times middle grey, highlights held.

    luminance [cd m^-2] and weights of one shape; zeros are left out; an all black sky gives the exposure of 1e-6
    cd m^-2.  Where the brightest 0.5 % by weight exceed ``highlights_over_mean`` times the log-mean the exposure is
    reduced, by as much as they do: the colours of the twilight arch matter more than the dark rest.
    """
    light = np.asarray(luminance, float).ravel()
    weight = np.ones(light.shape) if solid_angle is None else np.asarray(solid_angle, float).ravel()
    keep = (light > 0) & (weight > 0) & np.isfinite(light)
    key = 1e-6
    if keep.any():
        light, weight = light[keep], weight[keep]
        order = np.argsort(light)
        fraction = np.cumsum(weight[order]) / weight.sum()
        bright = light[order][min(np.searchsorted(fraction, HIGHLIGHT_QUANTILE), light.size - 1)]
        key = max(float(np.exp(np.average(np.log(light), weights=weight))), bright / highlights_over_mean)
    return float(np.log2(key / (METERED_GREYS * GREY_LUMINANCE_AT_EV100_0)))


def expose(rgb: np.ndarray, ev100: float) -> np.ndarray:
    """Scale linear RGB [cd m^-2] so that the luminance metered at ``ev100`` becomes middle grey, 0.18."""
    return np.asarray(rgb) * (MIDDLE_GREY / (GREY_LUMINANCE_AT_EV100_0 * 2.0**ev100))


def into_gamut(rgb: np.ndarray, luminance: np.ndarray = REC709_LUMINANCE) -> np.ndarray:
    """Move colours with a negative channel towards the grey of the same luminance until no channel is negative.

    luminance (3,): of red, green and blue.
    """
    outside = _over_channels(np.minimum, rgb) < 0
    if not outside.any():
        return rgb
    mapped = rgb.copy()
    mapped[outside] = _towards_grey(rgb[outside], luminance)
    return mapped


def _over_channels(pick: np.ufunc, rgb: np.ndarray) -> np.ndarray:
    """The least or the largest channel (...): several times as fast as a reduction of so short an axis."""
    return pick(pick(rgb[..., 0], rgb[..., 1]), rgb[..., 2])


def _towards_grey(rgb: np.ndarray, luminance: np.ndarray = REC709_LUMINANCE) -> np.ndarray:
    grey = np.maximum(rgb @ luminance, 0.0)[..., None]
    lowest = rgb.min(axis=-1, keepdims=True)
    return np.maximum(grey + grey / (grey - lowest) * (rgb - grey), 0.0)


PHOTOGRAPHIC_CONTRAST = 1.25
"""Slope of the photographic curve at middle grey, log over log: that of a picture meant for a screen."""
PHOTOGRAPHIC_SATURATION = 1.15
"""How much farther from the grey of their luminance colours are after the curve."""
PHOTOGRAPHIC_EACH_CHANNEL = 1.0 / 3.0
"""Part of the curve that is taken of every channel by itself, which pales highlights; the rest keeps their hue."""
BURNT_OUT_STOPS = (2.6, 7.0)
"""Base-2 logarithm of the largest channel, 1 = white, between which colours burn out: brighter than any sky, and where
the sun's disc by day is."""
BURNT_OUT_LEAK = 0.2
"""Part of the largest channel's excess that the others get where colours have burnt out: light in one layer of a film
that is not of its colour."""


def photographic(linear: np.ndarray, white: float = np.inf) -> np.ndarray:
    """The curve of a photograph, linear RGB (..., 3) in and out: y = u (1 + c u / w^2) / (u + c), u = x^n, w = white^n.

    n = 1.25, and c keeps middle grey, 0.18.  ``white`` (inf: no value) is shown as 1; a sensor has such a value, beyond
    which it sees nothing.  A third of the curve on every channel, which pales highlights as film does, two thirds on
    the largest channel with the ratios kept, which keeps their hue; then colours 1.15 times as far from the grey of
    their luminance.  From 6 to 128 times white, where no sky is but the sun's disc, the part of the curve on every
    channel grows to all: it burns out.
    """
    x = np.maximum(np.asarray(linear, float), 0.0)
    largest = np.maximum(_over_channels(np.maximum, x), TINY)[..., None]
    each, leaking = PHOTOGRAPHIC_EACH_CHANNEL, x
    low, high = BURNT_OUT_STOPS
    if largest.size and largest.max() > 2.0**low:
        t = np.clip((np.log2(largest) - low) / (high - low), 0.0, 1.0)
        burnt = t * t * (3.0 - 2.0 * t)
        each = PHOTOGRAPHIC_EACH_CHANNEL + (1.0 - PHOTOGRAPHIC_EACH_CHANNEL) * burnt
        leaking = x + BURNT_OUT_LEAK * t * (largest - x)
    mixed = each * _sigmoid(leaking, white) + x * ((1.0 - each) * _sigmoid(largest, white) / largest)
    grey = (mixed @ REC709_LUMINANCE)[..., None]
    return np.clip(grey + PHOTOGRAPHIC_SATURATION * (mixed - grey), 0.0, None)


def _sigmoid(x: np.ndarray, white: float) -> np.ndarray:
    grey, per_white = MIDDLE_GREY**PHOTOGRAPHIC_CONTRAST, white ** (-2.0 * PHOTOGRAPHIC_CONTRAST)
    c = (1.0 - MIDDLE_GREY) * grey / (MIDDLE_GREY - grey * grey * per_white)
    with np.errstate(over="ignore", divide="ignore"):
        u = np.minimum(x, white) ** PHOTOGRAPHIC_CONTRAST
        return (1.0 + c * per_white * u) / (1.0 + c / u)


def filmic(linear: np.ndarray) -> np.ndarray:
    """A film-like curve, linear RGB (..., 3) in and out: y = 1 - 1 / (1 + x + x^2 / 2).

    Slope 1 in the shadows, middle grey nearly kept (0.18 -> 0.164), a long shoulder (1 -> 0.6, 4 -> 0.92).  The mean of
    the curve on every channel, which takes highlights to white as film does, and of the curve on the largest channel
    with the ratios kept, which keeps their hue: the twilight arch stays coloured.
    """
    x = np.maximum(np.asarray(linear, float), 0.0)
    largest = x.max(axis=-1, keepdims=True)
    return 0.5 * _shoulder(x) + 0.5 * x * (_shoulder(largest) / np.maximum(largest, TINY))


def _shoulder(x: np.ndarray) -> np.ndarray:
    return 1.0 - 1.0 / (1.0 + x + 0.5 * x * x)


def srgb_encode(linear: np.ndarray) -> np.ndarray:
    """The sRGB transfer curve (IEC 61966-2-1), values clipped to 0..1."""
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-12) ** (1 / 2.4) - 0.055)


_CURVES = {"photographic": photographic, "filmic": filmic}


PIXELS_AT_ONCE = 65536
"""Pixels that `tone_map` works on at the same time: 1.5 MB in double precision, which a processor caches."""


def tone_map(rgb: np.ndarray, ev100: float, tone_mapping: str = DEFAULT_TONE_MAPPING) -> np.ndarray:
    """Linear RGB [cd m^-2] to display values 0..1: exposure, gamut, curve (one of two, or none), sRGB encoding.

    ``gamma`` has no curve: what exceeds 1 after exposure is clipped.  Raises TwilightError for another name.
    """
    check_known("tone_mapping", tone_mapping, TONE_MAPPINGS)
    rgb = np.asarray(rgb)
    flat = rgb.reshape(-1, 3)
    shown = np.empty(flat.shape)
    for first in range(0, len(flat), PIXELS_AT_ONCE):  # each step has copies of its own
        linear = into_gamut(expose(flat[first : first + PIXELS_AT_ONCE], ev100))
        curved = _CURVES[tone_mapping](linear) if tone_mapping in _CURVES else linear
        shown[first : first + PIXELS_AT_ONCE] = srgb_encode(curved)
    return shown.reshape(rgb.shape)
