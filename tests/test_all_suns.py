"""Energy and reciprocity at once: air that absorbs nothing is as bright as the light around it.

A line of sight followed backwards ends in space after any number of events if nothing absorbs, so what all suns send
along it, integrated over their directions, is the radiance that surrounds the Earth: 1, of which the line's
transmittance comes straight.  A solver that loses light, makes some, or scatters it unlike its mirror image, misses 1.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from energy_media import ODD, odd_medium
from layered_sky import depth_to_space

from twilight.phase import PhaseFunction
from twilight.solvers import zones

WHITE = ("white air over a white ground", "a white layer over a white ground")
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


def from_all_suns(look, medium, altitude_km, elevation_deg, points=(4, 4)):
    """(what comes along each line of sight from all suns (D, W), the variance of it (D, W)).

    look(sun, elevation (D, 1), azimuth (A,)) gives radiance and its variance (D, A, W).
    """
    sun, sun_weight = gauss(SUN_EDGES_DEG, points[0])
    azimuth, azimuth_weight = gauss(AZIMUTH_EDGES_DEG, points[1])
    total = np.zeros((elevation_deg.size, medium.n_wavelengths))
    variance = np.zeros_like(total)
    for s, w in zip(sun, np.radians(sun_weight) * np.cos(np.radians(sun)), strict=True):
        weight = w * 2.0 * np.radians(azimuth_weight)[:, None]
        radiance, spread = look(s, elevation_deg[:, None], azimuth)
        total += (radiance * weight).sum(axis=1)
        variance += (spread * weight**2).sum(axis=1)
    radius = medium.earth_radius_km + altitude_km
    for w in range(medium.n_wavelengths):
        one = medium.select(slice(w, w + 1))
        for d, e in enumerate(np.radians(elevation_deg)):
            total[d, w] += np.exp(-depth_to_space(one, radius, np.sin(e)))
    return total, variance


def deterministic(field, **more):
    return lambda s, e, a: (field.radiance(s, e, a, **more), np.zeros((e.size, a.size, field.medium.n_wavelengths)))


def test_zones():
    """At draft 1.7e-3 at worst, from above a layer, 7e-4 from the ground."""
    medium = white_air()
    settings = replace(zones.QUALITIES["draft"], max_events=200, tolerance=1e-3, polarisation=False)
    field = zones.prepare(medium, settings)
    for altitude, elevations in (
        (0.0, ELEVATION_DEG),
        (INSIDE_KM, np.append(ELEVATION_DEG, DOWN_DEG)),
        (60.0, DOWN_DEG),
    ):
        found, _ = from_all_suns(deterministic(field, observer_altitude_km=altitude), medium, altitude, elevations)
        np.testing.assert_allclose(found, 1.0, atol=2.5e-3)
