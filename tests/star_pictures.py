"""Pictures of stars whose truth is known: to test a calibration, and to see what a camera could reach."""

import numpy as np
from scipy.special import ndtr

from twilight.studies.camera.model import CameraModel


def render_stars(
    xy: np.ndarray,
    magnitude: np.ndarray,
    camera: CameraModel,
    *,
    seed: int,
    width_px: float = 0.8,
    electrons_at_mag_0: float = 2e5,
    sky_electrons: float = 100.0,
    read_noise_electrons: float = 4.0,
    hot_pixels: int = 0,
    false_stars: int = 0,
) -> np.ndarray:
    """A picture (height, width) in electrons: Gaussian stars over a sky, with the noise of photons and of reading out.

    xy (N, 2), magnitude (N,): of the stars; NaN positions are left out.  width_px: standard deviation of a star's
    image.  hot_pixels: single bright pixels.  false_stars: sources of the same shape at random places, as bright as
    the stars drawn.  In a latitude-longitude picture a star is round in the sky, and wide in a row near a pole.
    """
    random = np.random.default_rng(seed)
    height, width = camera.image.height_px, camera.image.width_px
    inside = camera.inside(xy)
    xy, magnitude = xy[inside], magnitude[inside]
    if false_stars:
        places = random.uniform(0.0, [width, height], size=(false_stars, 2))
        xy = np.concatenate([xy, places])
        magnitude = np.concatenate([magnitude, random.choice(magnitude, size=false_stars)])
    light = np.full((height, width), sky_electrons)
    panorama = camera.projection == "latlong"
    for (x, y), m in zip(xy, magnitude, strict=True):
        stretch = 1.0 / max(np.sin(np.pi * y / height), 1e-3) if panorama else 1.0
        rows = _fractions(y, width_px, height, wrap=False)
        columns = _fractions(x, width_px * stretch, width, wrap=panorama)
        # counts of a panorama are per solid angle, as if each pixel were exposed for the same time per steradian
        light[rows[0][:, None], columns[0][None, :]] += (
            electrons_at_mag_0 * 10.0 ** (-0.4 * m) * stretch * rows[1][:, None] * columns[1][None, :]
        )
    light = random.poisson(light) + random.normal(0.0, read_noise_electrons, size=light.shape)
    for _ in range(hot_pixels):
        light[random.integers(height), random.integers(width)] += random.uniform(500.0, 20000.0)
    return light


def _fractions(centre: float, sigma: float, size: int, wrap: bool) -> tuple[np.ndarray, np.ndarray]:
    """Pixels within five sigma, and the fraction of a Gaussian's light that falls on each, in one dimension."""
    half_width = int(np.ceil(min(5.0 * sigma, size / 2 - 1))) + 1
    first = int(np.floor(centre)) - half_width
    edges = np.arange(first, first + 2 * half_width + 2)
    fraction = np.diff(ndtr((edges - centre) / sigma))
    pixels = edges[:-1]
    if wrap:
        pixels, index = np.unique(np.mod(pixels, size), return_index=True)
        return pixels, fraction[index]
    inside = (pixels >= 0) & (pixels < size)
    return pixels[inside], fraction[inside]
