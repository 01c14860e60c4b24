"""Detection on pictures whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from star_pictures import render_stars

from twilight.studies.camera import CameraModel
from twilight.studies.validate.stars.detect import background, detect

LENS = CameraModel.model_validate(
    {"projection": "equidistant", "image": {"width_px": 600, "height_px": 400}, "lens": {"focal_length_px": 300.0}}
)
PANORAMA = CameraModel.model_validate({"projection": "latlong", "image": {"width_px": 720, "height_px": 360}})


def grid(n=80, seed=5, width=600, height=400):
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(25, width - 24, 45), np.arange(25, height - 24, 45))
    xy = np.stack([x.ravel(), y.ravel()], axis=-1) + random.uniform(-3.0, 3.0, size=(x.size, 2))
    return xy[random.permutation(len(xy))[:n]]


@pytest.mark.parametrize("width_px", [0.7, 1.0, 1.8])
def test_centres_are_right_to_a_few_hundredths_of_a_pixel(width_px):
    """Star positions would limit the calibration."""
    xy = grid()
    picture = render_stars(xy, np.full(len(xy), 2.0), LENS, seed=1, width_px=width_px)
    found = detect(picture, LENS)
    distance, _ = cKDTree(found.xy).query(xy)
    assert distance.max() < 0.15 and np.sqrt(np.mean(distance**2)) < 0.06
    assert len(found) <= len(xy) + 2
    np.testing.assert_allclose(np.median(found.width_px), np.hypot(width_px, 0.29), rtol=0.1)  # pixels add 1/12


def test_positions_have_no_bias():
    """All stars would lie half a pixel to one side."""
    xy = grid()
    found = detect(render_stars(xy, np.full(len(xy), 1.0), LENS, seed=2, width_px=1.0), LENS)
    _, nearest = cKDTree(found.xy).query(xy)
    offset = found.xy[nearest] - xy
    assert np.all(np.abs(offset.mean(axis=0)) < 4.0 * offset.std(axis=0) / np.sqrt(len(xy)) + 0.005)


def test_fluxes_follow_magnitudes():
    """The brightest sources would not be the brightest stars, and matching fail."""
    xy = grid()
    magnitude = np.linspace(0.0, 4.0, len(xy))
    found = detect(render_stars(xy, magnitude, LENS, seed=3), LENS)
    _, nearest = cKDTree(found.xy).query(xy)
    scale = magnitude + 2.5 * np.log10(found.flux[nearest])
    assert np.ptp(scale) < 0.3
    assert np.all(np.diff(found.flux) <= 0)


def test_hot_pixels_are_not_stars():
    """A warm sensor's pixels would be matched as stars."""
    xy = grid()
    clean = detect(render_stars(xy, np.full(len(xy), 2.0), LENS, seed=4), LENS)
    picture = render_stars(xy, np.full(len(xy), 2.0), LENS, seed=4, hot_pixels=300)
    found = detect(picture, LENS)
    distance, _ = cKDTree(xy).query(found.xy)
    assert (distance > 1.0).sum() <= 6  # two hot pixels side by side look like a star
    assert len(found) >= len(clean) - 4


def test_noise_and_gradients_make_no_stars():
    """Skyglow towards a town would be full of stars."""
    random = np.random.default_rng(6)
    y, x = np.mgrid[:400, :600]
    sky = 200.0 + 300.0 * np.exp(-((400 - y) / 80.0)) + 0.2 * x
    assert len(detect(random.poisson(sky).astype(float), LENS)) <= 3
    assert len(detect(np.zeros((400, 600)), LENS)) == 0


def test_black_sky_of_an_8_bit_picture():
    """A JPEG whose sky is 0 and whose stars are 255 would show none."""
    xy = grid()
    picture = render_stars(xy, np.linspace(0.0, 4.0, len(xy)), LENS, seed=7, width_px=1.0)
    eight = np.clip(np.round((picture - 180.0) / 20.0), 0, 255)  # black sky, bright stars clipped
    assert np.median(eight) == 0 and (eight == 255).sum() > 20
    found = detect(eight, LENS)
    distance, _ = cKDTree(found.xy).query(xy)
    assert (distance < 0.3).mean() > 0.9
    assert len(found) < 1.3 * len(xy)


def test_values_that_are_not_numbers_do_no_harm():
    """A few NaN pixels would blank the picture around them."""
    xy = grid()
    picture = render_stars(xy, np.full(len(xy), 2.0), LENS, seed=1)
    picture[200:210, 300:310] = np.nan
    picture[100, 100] = np.inf
    far = np.hypot(*(xy - [305, 205]).T) > 60
    distance, _ = cKDTree(detect(picture, LENS).xy).query(xy[far])
    assert distance.max() < 0.3


def test_background_of_a_plane_is_the_plane():
    """Gradients of the sky would be left in the stars' fluxes."""
    y, x = np.mgrid[:200, :300].astype(np.float32)
    low, noise = background(50.0 + 0.1 * x + 0.3 * y)
    assert np.abs(low - (50.0 + 0.1 * x + 0.3 * y))[40:150, 40:240].max() < 0.01
    assert noise.shape == low.shape and (noise >= 0).all()


def test_panorama_across_its_seam_and_at_its_poles():
    """Stars on a panorama's seam would be lost or doubled, those near its poles smeared."""
    # centres of stars on the seam, at mid-latitudes, on both sides of where the polar views begin, and near the zenith
    degrees = np.array([[0.1, 20.0], [359.8, -30.0], [100.0, 48.0], [140.0, 52.0], [200.0, 75.0], [300.0, 87.0]])
    xy = np.stack([np.mod(degrees[:, 0] / 360.0, 1.0) * 720.0, (0.5 - degrees[:, 1] / 180.0) * 360.0], axis=-1)
    picture = render_stars(xy, np.full(len(xy), 0.0), PANORAMA, seed=2, width_px=0.8)
    found = detect(picture, PANORAMA)
    chord, nearest = cKDTree(PANORAMA.directions(found.xy)).query(PANORAMA.directions(xy))
    assert np.degrees(chord).max() * 60 < 6.0  # a fifth of a pixel
    assert len(set(nearest)) == len(xy) <= len(found) <= len(xy) + 1
