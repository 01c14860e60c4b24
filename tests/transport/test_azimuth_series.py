"""Light as a series in azimuth: closed forms, and light that is no such series."""

import math

import numpy as np
import pytest

from twilight.transport.azimuth_series import (
    SMOOTH,
    RayDirections,
    at_azimuth,
    cosine_series,
    interpolate_azimuth,
    unique_directions,
)


@pytest.mark.parametrize("n", [4, 16])
def test_a_short_series_is_found_and_summed_exactly(n):
    """The Fourier coefficients of a polynomial would be wrong."""
    wanted = np.random.default_rng(3).normal(size=(n + 1, 2))
    angle = np.pi * np.arange(n + 1) / n
    series = np.empty((n + 1, 2))
    cosine_series(np.cos(np.outer(angle, np.arange(n + 1))) @ wanted, n, series)
    np.testing.assert_allclose(series, wanted, atol=1e-12)
    out = np.empty(2)
    at_azimuth(series, n, math.cos(0.7), out)
    np.testing.assert_allclose(out, np.cos(0.7 * np.arange(n + 1)) @ wanted, atol=1e-12)


def sky(directions: RayDirections, asked: list[int]) -> np.ndarray:
    """Bright towards the sun, polarised; the second ray has a shadow with an edge."""
    asked.append(directions.cos_azimuth.size)
    row = np.repeat(np.arange(directions.first.size - 1), np.diff(directions.first))
    a = np.arccos(np.clip(directions.cos_azimuth, -1.0, 1.0))
    light = np.exp(3.0 * np.cos(a)) * np.where((row == 1) & (a > 1.0), 0.1, 1.0)
    return np.stack([light, 0.3 * light * np.cos(2.0 * a), 0.2 * light * np.sin(a)], axis=1)[:, :, None]


def test_smooth_light_is_evaluated_in_few_azimuths_and_a_shadow_in_all():
    """A shadow would be smoothed away, or smooth light cost every azimuth."""
    a = np.radians(np.concatenate([np.linspace(0.0, 180.0, 91), np.linspace(3.0, 177.0, 60), [20.0, 50.0]]))
    directions = RayDirections(np.array([0, 91, 151, 153]), np.cos(a), 1.0)
    asked: list[int] = []
    found = interpolate_azimuth(lambda where: sky(where, asked), directions)
    np.testing.assert_allclose(found, sky(directions, []), rtol=1e-7, atol=1e-7)
    assert asked == [2 * (SMOOTH + 1) + 2, 60]


def test_rays_of_which_none_is_smooth_are_evaluated_in_all_azimuths():
    """Rays that are not smooth would be interpolated."""
    a = np.radians(np.linspace(0.0, 180.0, 40))
    directions = RayDirections(np.array([0, 0, 40]), np.cos(a), 1.0)
    found = interpolate_azimuth(lambda where: sky(where, []), directions)
    np.testing.assert_array_equal(found, sky(directions, []))


def test_darkness_stays_dark():
    """Darkness would become light through its logarithm."""
    directions = RayDirections(np.array([0, 40]), np.cos(np.linspace(0.0, np.pi, 40)), 1.0)
    assert (interpolate_azimuth(lambda where: np.zeros((where.cos_azimuth.size, 1, 8)), directions) == 0.0).all()


def test_a_direction_and_its_mirror_image_are_one():
    """Both sides of the sun would be computed."""
    row, azimuth = np.array([2, 0, 0, 1, 0, 2]), np.array([-10.0, 350.0, 10.0, 5.0, 370.0, 190.0])
    rows, around, which = unique_directions(row, azimuth)
    assert rows.tolist() == [0, 1, 2, 2] and around.tolist() == [10.0, 5.0, 10.0, 170.0]
    np.testing.assert_array_equal(rows[which], row)
    np.testing.assert_allclose(np.cos(np.radians(around[which])), np.cos(np.radians(azimuth)))
