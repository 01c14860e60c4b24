"""Errors of radiance and colour, with the reference solution's own noise taken out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from twilight.base.conventions import TINY
from twilight.numerics import spectrum
from twilight.sky.colour import MIDDLE_GREY, colour_is_defined, spectrum_to_xyz

_PERTURBATIONS = 40
"""Draws of the reference solution's noise from which the noise of colours is found."""


@dataclass(frozen=True)
class ErrorQuantiles:
    """Median, 95th percentile and largest of the absolute errors, and the mean of the signed ones.

    noise_*: the part of the three quantiles that the noise of the reference solution alone would give; it is already
    taken out of them."""

    median: float
    p95: float
    largest: float
    mean: float
    noise_median: float
    noise_p95: float
    noise_largest: float


def radiance_errors(value: np.ndarray, reference: np.ndarray, standard_error: np.ndarray) -> ErrorQuantiles | None:
    """Relative errors [%] of radiances against a reference with standard errors, arrays of one shape.

    Directions where the reference is black have no relative error and are left out; None where none is left.

    Each of the three quantiles q becomes sqrt(q^2 - n^2), n being what normal noise of the given standard errors would
    give by itself; 0 where n is the larger.  This is exact for errors that are normal themselves; an error that is the
    same everywhere comes out too large at the upper end, by 1.64 standard errors of the reference at most for p95.
    """
    value, reference, standard_error = (np.asarray(a, float).ravel() for a in (value, reference, standard_error))
    lit = reference > 0
    if not lit.any():
        return None
    relative = 100.0 * (value[lit] / reference[lit] - 1.0)
    sigma = 100.0 * standard_error[lit] / reference[lit]
    noise = (noise_quantile(sigma, 0.5), noise_quantile(sigma, 0.95), noise_largest(sigma))
    size = np.abs(relative)
    quantiles = (np.median(size), np.percentile(size, 95), size.max())
    return _without_noise(quantiles, noise, float(relative.mean()))


def noise_quantile(sigma: np.ndarray, fraction: float) -> float:
    """The size that a fraction of normal deviations with the standard deviations sigma (D,) does not exceed."""
    return _bisect(sigma, lambda x: float(np.mean(_probability_below(x, sigma))), fraction)


def noise_largest(sigma: np.ndarray) -> float:
    """Median of the largest of the deviations."""
    return _bisect(sigma, lambda x: float(np.prod(_probability_below(x, sigma))), 0.5)


def _probability_below(x: float, sigma: np.ndarray) -> np.ndarray:
    """Probability that a normal deviation is below x in size."""
    return np.where(sigma > 0, erf(x / np.where(sigma > 0, sigma * np.sqrt(2.0), 1.0)), 1.0)


def _bisect(sigma: np.ndarray, probability, wanted: float) -> float:
    low, high = 0.0, 20.0 * float(sigma.max(initial=0.0))
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if probability(middle) < wanted else (low, middle)
    return high


def _without_noise(
    quantiles: tuple[float, float, float], noise: tuple[float, float, float], mean: float
) -> ErrorQuantiles:
    median, p95, largest = (float(np.sqrt(max(f**2 - n**2, 0.0))) for f, n in zip(quantiles, noise, strict=True))
    return ErrorQuantiles(median, p95, largest, mean, *noise)


@dataclass(frozen=True)
class ColourErrors:
    """CIEDE2000 and relative error of the luminance [%], each as in :class:`ErrorQuantiles`."""

    ciede2000: ErrorQuantiles
    luminance: ErrorQuantiles


def colour_errors(
    value: np.ndarray,
    reference: np.ndarray,
    standard_error: np.ndarray | None,
    wavelength_nm: np.ndarray,
    reference_wavelength_nm: np.ndarray | None = None,
    *,
    solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM,
    observer: str = "cie1964_10deg",
) -> ColourErrors | None:
    """Errors of the colours of spectra (D, W) against reference spectra (D, W'); None where colour is not defined.

    White is D65 at 1/0.18 of the reference sky's log-mean luminance, the exposure of a picture; luminance is that of
    the 2 deg observer.
    """
    there = wavelength_nm if reference_wavelength_nm is None else reference_wavelength_nm
    lit = (reference > 0).all(axis=1)
    if not (colour_is_defined(wavelength_nm) and colour_is_defined(there) and lit.any()):
        return None
    value, reference = value[lit], reference[lit]
    error = np.zeros_like(reference) if standard_error is None else standard_error[lit]

    def luminance(factor: np.ndarray, at_nm: np.ndarray) -> np.ndarray:
        xyz = spectrum_to_xyz(factor, at_nm, solar_spectrum=solar_spectrum, observer="cie1931_2deg")
        return np.maximum(xyz[..., 1], TINY)

    y = luminance(reference, there)
    white_cd_per_m2 = float(np.exp(np.mean(np.log(y)))) / MIDDLE_GREY

    def lab(factor: np.ndarray, at_nm: np.ndarray) -> np.ndarray:
        xyz = spectrum_to_xyz(factor, at_nm, solar_spectrum=solar_spectrum, observer=observer)
        return _lab(xyz / white_cd_per_m2, observer)

    right = lab(reference, there)
    difference = _ciede2000(lab(value, wavelength_nm), right)
    relative = luminance(value, wavelength_nm) / y - 1.0
    draws = _noisy_draws(reference, error) if error.any() else []
    shifts = np.array([_ciede2000(lab(draw, there), right) for draw in draws]).reshape(-1, y.size)
    sigma = np.std([luminance(draw, there) / y for draw in draws], axis=0) if draws else np.zeros(y.size)
    return ColourErrors(
        _distance_errors(difference, shifts),
        radiance_errors(1.0 + relative, np.ones_like(relative), sigma) or _NO_ERROR,
    )


_NO_ERROR = ErrorQuantiles(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def _noisy_draws(reference: np.ndarray, error: np.ndarray) -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    scale = error / reference
    return [reference * np.maximum(1.0 + scale * rng.standard_normal(scale.shape), 1e-3) for _ in range(_PERTURBATIONS)]


def _distance_errors(difference: np.ndarray, shifts: np.ndarray) -> ErrorQuantiles:
    noise = (0.0, 0.0, 0.0)
    if shifts.size:
        noise = (float(np.median(shifts)), float(np.percentile(shifts, 95)), float(np.median(shifts.max(axis=1))))
    quantiles = (np.median(difference), np.percentile(difference, 95), difference.max())
    return _without_noise(quantiles, noise, float(difference.mean()))


def _lab(xyz: np.ndarray, observer: str) -> np.ndarray:
    import colour  # optional

    return colour.XYZ_to_Lab(xyz, colour.CCS_ILLUMINANTS[spectrum.OBSERVERS[observer]]["D65"])


def _ciede2000(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    import colour  # optional

    return colour.delta_E(a, b, method="CIE 2000")
