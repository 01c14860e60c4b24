"""Monte-Carlo, single scattering, against quadratures that share only the medium (and once the beam table)."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from exact_sunbeam import ExactSunbeam
from montecarlo_media import assert_all_agree, hazy_earth
from scipy.optimize import bisect

from twilight.solvers.montecarlo import MonteCarloSettings, prepare
from twilight.transport.beam import beam_at_one

SINGLE = MonteCarloSettings(target_stderr=None, samples=4, max_orders=1, importance_sweeps=0, bent_lines_of_sight=False)


def line(medium, height, elevation_deg, extra=(), cell_km=2.0):
    """Points along a line of sight: nodes and weights [km], altitudes, and whether it ends on the ground.

    extra: distances [km] at which cells end besides.
    """
    r0 = medium.earth_radius_km
    r, sine = r0 + height, np.sin(np.radians(elevation_deg))
    top = r0 + medium.top_km

    def crossings(radius):
        d = (r * sine) ** 2 - (r - radius) * (r + radius)
        return (-r * sine - np.sqrt(d), -r * sine + np.sqrt(d)) if d >= 0 else (np.nan, np.nan)

    start, end = max(0.0, crossings(top)[0]), crossings(top)[1]
    ground = crossings(r0)[0]
    lands = bool(ground >= 0)
    if lands:
        end = ground
    # every kink of the medium is an edge, so Gauss-Legendre converges; between them cells of at most cell_km
    marks = [start, end, -r * sine, *extra]
    for z in np.unique(medium.altitude_km):
        marks += list(crossings(r0 + z))
    marks = np.unique([m for m in marks if start <= m <= end])
    edges = np.concatenate([np.linspace(a, b, 2 + int((b - a) / cell_km))[:-1] for a, b in pairwise(marks)])
    edges = np.append(edges, end)
    x, w = np.polynomial.legendre.leggauss(4)
    half = 0.5 * np.diff(edges)
    s = (0.5 * (edges[1:] + edges[:-1]))[:, None] + half[:, None] * x
    z = np.sqrt(r * r + s * s + 2 * r * s * sine) - r0
    return s, half[:, None] * w, np.clip(z, 0.0, medium.top_km), lands, end


def depth_along(medium, s, weight, z):
    """Optical depth from the start of the line to every node (running integral by cells, W = 1)."""
    k = medium.at(z).extinction[..., 0]
    whole = np.concatenate([[0.0], np.cumsum((k * weight).sum(axis=1))])
    # inside a cell: integrate the cubic through its four nodes
    x = np.polynomial.legendre.leggauss(4)[0]
    power = np.linalg.inv(np.vander(x, increasing=True))
    to_node = np.array([[(xi ** (m + 1) - (-1.0) ** (m + 1)) / (m + 1) for m in range(4)] for xi in x])
    inside = k @ (to_node @ power).T * 0.5 * weight.sum(axis=1, keepdims=True)
    return whole[:-1, None] + inside, whole[-1]


def straight_beam(exact, z, cos_sun):
    """Transmittance to the sun along straight rays, and no bending."""
    return np.exp(-exact.straight_depth(z.ravel(), cos_sun.ravel())).reshape(z.shape), 0.0 * z


def bent_beam(beam, z, cos_sun):
    """Irradiance over F0 and bending, one point after the other."""
    found = np.array([beam_at_one(beam, *one, 0) for one in zip(z.ravel(), cos_sun.ravel(), strict=True)])
    return tuple(column.reshape(z.shape) for column in found.T)


def single_scattering(medium, height, sun_deg, elevation_deg, azimuth_deg, beam):
    """L/F0 [sr^-1] by quadrature; `beam(z, cos_sun)` gives irradiance and bending of arrays."""
    e, a, h = np.radians([elevation_deg, azimuth_deg, sun_deg])
    d = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    sun = np.array([np.cos(h), 0.0, np.sin(h)])
    start = np.array([0.0, 0.0, medium.earth_radius_km + height])

    def towards_sun(x):
        """Irradiance (...) at distances [km], the sunlight's apparent direction and the vertical (..., 3)."""
        point = start + np.asarray(x)[..., None] * d
        r = np.linalg.norm(point, axis=-1)
        up = point / r[..., None]
        cos_sun = up @ sun
        irradiance, bending = (one[..., None] for one in beam(r - medium.earth_radius_km, cos_sun))
        across = (up - cos_sun[..., None] * sun) / np.sqrt(1 - cos_sun[..., None] ** 2)
        return irradiance[..., 0], np.cos(bending) * sun + np.sin(bending) * across, up

    # a cell ends where the shadow does: without that one node decides the third digit
    s, weight, z, lands, end = line(medium, height, elevation_deg)
    lit = towards_sun(s.ravel())[0] > 0.0
    edges = [
        bisect(lambda x: (towards_sun(x)[0] > 0.0) - 0.5, s.ravel()[i], s.ravel()[i + 1], xtol=1e-9)
        for i in np.flatnonzero(lit[1:] != lit[:-1])
    ]
    s, weight, z, lands, end = line(medium, height, elevation_deg, edges)
    depth, whole = depth_along(medium, s, weight, z)
    rho = medium.depolarisation[0]
    irradiance, apparent, _ = towards_sun(s)
    mu = np.clip(apparent @ d, -1, 1)
    c = medium.at(z)
    source = c.air_scattering[..., 0] * 3 / (8 * np.pi * (2 + rho)) * ((1 + rho) + (1 - rho) * mu**2)
    source += c.aerosol_scattering[..., 0] * medium.phase_functions[0](mu)[0]
    total = (weight * np.exp(-depth) * source * irradiance).sum()
    if lands:
        irradiance, apparent, up = towards_sun(end)
        total += np.exp(-whole) * medium.ground_albedo[0] / np.pi * irradiance * max(0.0, apparent @ up)
    return float(total)


VIEWS = [  # observer altitude, sun, elevation, azimuth
    (0.0, 40.0, 40.0, 12.0),
    (0.0, 5.0, 2.0, 30.0),
    (0.0, -4.0, 20.0, 0.0),
    (10.0, -2.0, -5.0, 60.0),
    (400.0, 20.0, -60.0, 90.0),
]


def compare(medium, refraction, beam):
    """0.1 % for every view; single scattering is a quadrature, without noise."""
    field = prepare(medium, replace(SINGLE, refraction=refraction))
    value, error, truth = [], [], []
    for height, sun, elevation, azimuth in VIEWS:
        r = replace(field, observer_altitude_km=height).radiance_with_error(sun, elevation, azimuth)
        value.append(r.radiance[0])
        error.append(r.standard_error[0])
        truth.append(single_scattering(medium, height, sun, elevation, azimuth, beam(field)))
    value, error, truth = map(np.array, (value, error, truth))
    assert np.all(error == 0)
    np.testing.assert_array_less(np.abs(value / truth - 1), 1e-3)


def test_single_scattering_straight():
    """Along straight lines: fails if the quadrature of the line of sight misses an edge of light or air."""
    medium = hazy_earth(refractivity=0.0)
    exact = ExactSunbeam(medium)
    compare(medium, False, lambda field: lambda z, c: straight_beam(exact, z, c))


def test_single_scattering_refracted():
    """With the refracted beam: fails if sunlight's bending or spreading is applied wrongly."""
    compare(hazy_earth(), True, lambda field: lambda z, c: bent_beam(field.sun.beam, z, c))


def test_refraction_brightens_twilight():
    """Bent sunlight reaches farther: fails if refraction has the wrong sign."""
    # at -4 deg the refracted beam adds 9 % in the zenith; here single scattering alone
    views = (-4.0, 90.0, 0.0)
    bent = prepare(hazy_earth(), SINGLE).radiance(*views)
    straight = prepare(hazy_earth(), replace(SINGLE, refraction=False)).radiance(*views)
    assert 1.02 < bent[0] / straight[0] < 1.3


@pytest.mark.parametrize("target", [0.012, pytest.param(0.006, marks=pytest.mark.slow)])
def test_table_phase_equals_formula(target):
    """A tabulated phase function gives the light of its formula: fails if the tables are off."""
    settings, view = MonteCarloSettings(target_stderr=target), (10.0, 25.0, [0.0, 120.0])
    a = prepare(hazy_earth(), settings).radiance_with_error(*view)
    b = prepare(hazy_earth(table_phase=True), replace(settings, seed=7)).radiance_with_error(*view)
    assert_all_agree(a.radiance, np.hypot(a.standard_error, b.standard_error), b.radiance)


def test_a_sun_overhead_lights_the_air_below_as_one_beside_the_zenith():
    """At 90 deg exactly its light came from wherever rounding sent it, at times straight ahead: 33 times too much."""
    medium = hazy_earth(ground=0.0)
    field = prepare(medium, SINGLE, observer_altitude_km=medium.top_km + 1.0)
    overhead, beside = (field.radiance(sun, -90.0, 0.0)[..., 0].item() for sun in (90.0, 89.99))
    assert overhead == pytest.approx(beside, rel=1e-3)
