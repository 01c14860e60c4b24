"""Neutral points and the degree of polarisation: on a made-up sky, and on that of clear air."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from hazy_zones import REFERENCE, SMALL

from twilight.atmosphere.medium_table import medium_from_table
from twilight.solvers import zones

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from neutral_points import degree_of_polarisation, neutral_points, zenith_polarisation


class MadeUp:
    """Q > 0 within 12.3 deg of the sun above it, 9 deg below it, and within 21.7 deg of the antisolar point."""

    def __init__(self, above=12.3, below=9.0, opposite=21.7):
        self.limits = above, below, opposite

    def stokes(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        along = np.where(np.asarray(azimuth_deg) > 90.0, 180.0 - np.asarray(elevation_deg), elevation_deg)
        above, below, opposite = self.limits
        from_sun = along - sun_elevation_deg
        near = np.where(from_sun >= 0.0, 1.0 - from_sun / above, 1.0 + from_sun / below)
        far = 1.0 - (180.0 + sun_elevation_deg - along) / opposite
        q = np.maximum(np.maximum(near, far), -1.0)[:, None]
        return np.stack([np.full_like(q, 2.0), q, np.zeros_like(q)], axis=1)


def test_neutral_points_are_found_where_q_changes_its_sign():
    points = neutral_points(MadeUp(), 30.0)
    np.testing.assert_allclose([points.babinet_deg, points.brewster_deg], [[12.3], [9.0]], atol=0.05)
    assert np.isnan(points.arago_deg).all()  # it is below the horizon with the sun at 30 deg
    points = neutral_points(MadeUp(), 0.0)
    np.testing.assert_allclose([points.babinet_deg, points.arago_deg], [[12.3], [21.7]], atol=0.05)
    assert np.isnan(points.brewster_deg).all()


def test_degree_of_polarisation():
    stokes = np.array([[2.0, 0.0], [0.6, 0.0], [-0.8, 0.0]])
    np.testing.assert_allclose(degree_of_polarisation(stokes), [0.5, 0.0])


def test_neutral_points_of_clear_air_are_where_they_are_seen():
    """Babinet's and Arago's points are about 20 deg from the sun and the antisolar point at sunset (Coulson 1988)."""
    field = zones.prepare(medium_from_table(REFERENCE / "pure-air.csv"), SMALL)
    points = neutral_points(field, 0.0)
    assert np.all((points.arago_deg > 12.0) & (points.arago_deg < 28.0))
    assert np.all((points.babinet_deg > 10.0) & (points.babinet_deg < 25.0))
    # more scattering in the blue pushes them apart
    assert points.arago_deg[0] > points.arago_deg[-1]
    zenith = zenith_polarisation(field, 0.0)
    assert zenith.shape == (field.medium.n_wavelengths,)
    assert np.all((zenith > 0.6) & (zenith < 0.97))
    assert zenith_polarisation(field, 60.0).max() == pytest.approx(0.12, abs=0.05)
