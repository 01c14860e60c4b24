"""Energy and reciprocity of every solver at once: air that absorbs nothing is as bright as the light around it.

A line of sight followed backwards ends in space after any number of scatterings if nothing absorbs, so what all suns
send along it, integrated over their directions, is the radiance that surrounds the Earth: 1, of which the line's
transmittance comes straight.  A solver that loses light, makes some, or scatters it unlike its mirror image, misses 1.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from energy_media import ODD, odd_medium
from exact_sunbeam import ExactSunbeam

from twilight.base.errors import TwilightError
from twilight.numerics.phase import PhaseFunction
from twilight.solvers import montecarlo, tables, zones
from twilight.solvers.montecarlo import chunks
from twilight.solvers.tables.algorithm import TablesSettings, make_mapping, refuse_unseen_layers

WHITE = ("conservative air over a white ground", "a conservative layer over a white ground")
ELEVATION_DEG = np.array([3.0, 20.0, 75.0])
DOWN_DEG = np.array([-90.0, -30.0])
INSIDE_KM = 3.2
"""In the layer between 3 and 3.5 km."""


def white_air(asymmetry=0.5):
    """Two wavelengths; straight lines."""
    medium = odd_medium(*(ODD[name] for name in WHITE), refractivity=0.0)
    return replace(medium, phase_functions=(PhaseFunction.henyey_greenstein([asymmetry] * 2),))


def gauss(edges, n) -> tuple[np.ndarray, np.ndarray]:
    x, w = np.polynomial.legendre.leggauss(n)
    pieces = [(0.5 * (a + b + (b - a) * x), 0.5 * (b - a) * w) for a, b in pairwise(edges)]
    return tuple(np.concatenate(part) for part in zip(*pieces, strict=True))


SUN_EDGES_DEG = (-90.0, -20.0, -10.0, -5.0, -2.0, 0.0, 2.0, 6.0, 20.0, 50.0, 90.0)
AZIMUTH_EDGES_DEG = (0.0, 15.0, 60.0, 180.0)


def from_all_suns(evaluate, medium, altitude_km, elevation_deg, points=(4, 4)):
    """(what comes along each line of sight from all suns (D, W), the variance of it (D, W)).

    evaluate(sun, elevation (D, 1), azimuth (A,)) gives radiance and its variance (D, A, W).
    """
    sun, sun_weight = gauss(SUN_EDGES_DEG, points[0])
    azimuth, azimuth_weight = gauss(AZIMUTH_EDGES_DEG, points[1])
    total = np.zeros((elevation_deg.size, medium.n_wavelengths))
    variance = np.zeros_like(total)
    for s, w in zip(sun, np.radians(sun_weight) * np.cos(np.radians(sun)), strict=True):
        weight = w * 2.0 * np.radians(azimuth_weight)[:, None]
        radiance, spread = evaluate(s, elevation_deg[:, None], azimuth)
        total += (radiance * weight).sum(axis=1)
        variance += (spread * weight**2).sum(axis=1)
    sine = np.sin(np.radians(elevation_deg))
    for w in range(medium.n_wavelengths):
        exact = ExactSunbeam(medium, wavelength=w)
        total[:, w] += np.exp(-exact.straight_depth(np.full(sine.size, altitude_km), sine))
    return total, variance


def deterministic(field, **more):
    return lambda s, e, a: (field.radiance(s, e, a, **more), np.zeros((e.size, a.size, field.medium.n_wavelengths)))


@pytest.mark.slow
def test_zones():
    """At worst 1.7e-3, through the layer at 75 deg; in air alone within 1e-3."""
    medium = white_air()
    settings = replace(zones.QUALITIES["draft"], max_orders=200, tolerance=1e-3, polarisation=False)
    field = zones.prepare(medium, settings)
    for altitude, elevations in (
        (0.0, ELEVATION_DEG),
        (INSIDE_KM, np.append(ELEVATION_DEG, DOWN_DEG)),
        (60.0, DOWN_DEG),
    ):
        found, _ = from_all_suns(deterministic(field, observer_altitude_km=altitude), medium, altitude, elevations)
        np.testing.assert_allclose(found, 1.0, atol=2.5e-3)


@pytest.mark.slow
def test_montecarlo(monkeypatch):
    """Within its stated errors, 0.15 to 0.4 % in air alone and 0.7 to 1.5 % with a layer: single suns have so few paths
    that their values would not be given, the sum over all of them has enough."""
    unknown = chunks.Tally.unknown
    monkeypatch.setattr(chunks.Tally, "unknown", lambda self: np.zeros_like(unknown(self)))
    medium = white_air()
    settings = montecarlo.MonteCarloSettings(target_stderr=None, samples=8, polarisation=False)
    field = montecarlo.prepare(medium, settings, observer_altitude_km=0.0)

    def evaluate(s, e, a):
        found = field.radiance_with_error(s, e, a)
        return found.radiance, found.standard_error**2

    found, variance = from_all_suns(evaluate, medium, 0.0, ELEVATION_DEG)
    error = np.sqrt(variance)
    assert error.max() < 0.02
    assert np.all(np.abs(found - 1.0) < 4.0 * error + 5e-4)


COARSE_TABLES = replace(
    tables.QUALITIES["standard"], scattering_mu=96, scattering_nu=6, polar_directions=8, azimuth_directions=10,
    degree=6, max_orders=15,
)  # fmt: skip


@pytest.mark.slow
def test_tables():
    """After 15 orders; the paper's 5 keep 85 to 98 % of the light in this air."""
    medium = white_air().select(slice(0, 1))
    field = tables.prepare(medium, COARSE_TABLES)
    found, _ = from_all_suns(deterministic(field), medium, 0.0, ELEVATION_DEG)
    np.testing.assert_allclose(found, 1.0, atol=0.03)


def test_tables_refuse_a_layer_between_two_heights():
    """One that makes the sky three times too bright; air without it is taken."""
    smooth, medium = (white_air().select(slice(w, w + 1)) for w in (0, 1))
    refuse_unseen_layers(smooth, make_mapping(TablesSettings(), smooth.earth_radius_km, smooth.top_km))
    with pytest.raises(TwilightError, match=r"between 3.07 and 4.01 km.* off by 0.5;"):
        tables.prepare(medium, tables.QUALITIES["standard"])
