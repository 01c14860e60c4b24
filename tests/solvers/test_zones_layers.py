"""The field of zones above, in and below layers: where its altitudes stand, and what they give."""

import math
import warnings
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hazy_zones import QUICK
from layered_sky import layered
from plane_parallel import RAYLEIGH, Slabs, henyey_greenstein

from twilight.base.errors import TwilightWarning
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.zones.air_needs import altitude_nodes, near_edges, resolve_layers
from twilight.solvers.zones.constants import MAX_INTERVAL_RATIO
from twilight.solvers.zones.first_order import make_sunlight
from twilight.transport.beam import beam_at, prepare_beam
from twilight.transport.lines import ALTITUDE, trace_rays
from twilight.transport.profile import prepare_profile

WAVELENGTH_NM = np.array([550.0])
STANDARD = zones.QUALITIES["standard"]
SCALAR = replace(QUICK, polarisation=False)
COARSE = replace(SCALAR, zenith_density=0.5, polar_directions=6, degree=8, azimuth_directions=7)
ELEVATION_DEG = np.array([1.0, 6.0, 27.0, 90.0, 45.0, 10.0])
AZIMUTH_DEG = np.array([0.0, 0.0, 0.0, 0.0, 90.0, 180.0])


def nodes_of(climate, density=1.0):
    profile = prepare_profile(climate_medium(load_climate(climate), WAVELENGTH_NM))
    even = altitude_nodes(0.0, 100.0, profile.break_km, density)
    return even, resolve_layers(even, profile, density), profile


def test_altitudes_grow_apart_slowly_beside_a_layer_and_are_as_they_were_elsewhere():
    """A cubic would swing beyond a layer's edges."""
    even, nodes, _ = nodes_of("volcanic-extreme")
    assert np.isin(even, nodes).all()
    step = np.diff(nodes)
    assert np.abs(np.diff(np.log(step))).max() <= math.log(MAX_INTERVAL_RATIO)
    even, nodes, _ = nodes_of("continental-average")
    assert np.array_equal(even, nodes)


def test_a_level_at_which_only_the_kind_of_aerosol_changes_is_no_bend_of_its_light():
    """Nodes would be spent where light does not bend."""
    _, _, profile = nodes_of("volcanic-extreme")
    assert np.array_equal(profile.break_km, [2.0, 11.0, 30.0])
    assert np.array_equal(profile.sharp_km, [2.0, 11.0])


def test_sunlight_between_the_altitudes_of_its_table():
    """A grazing beam through a volcanic layer between rows: 2.2 % off at worst, 54 % with rows 0.5 km apart."""
    medium = climate_medium(load_climate("volcanic-extreme"), WAVELENGTH_NM)
    _, nodes, profile = nodes_of("volcanic-extreme")
    beam = prepare_beam(medium, refraction=False)
    table = make_sunlight(beam, nodes, profile.break_km)
    errors, last = [], table.log_light.shape[1] - 1
    for k in np.flatnonzero((table.altitude_km > 17.0) & (table.altitude_km < 24.0)):
        edge = 0.5 * (table.edge_rad[k] + table.edge_rad[k + 1])
        j = round(last * math.sqrt((edge - 0.5 * math.pi) / table.span_rad))
        angle = edge - table.span_rad * (j / last) ** 2
        exact = np.empty(1)
        beam_at(beam, 0.5 * (table.altitude_km[k] + table.altitude_km[k + 1]), math.cos(angle), exact)
        errors.append(math.exp(0.5 * (table.log_light[k, j, 0] + table.log_light[k + 1, j, 0])) / exact[0] - 1.0)
    assert np.abs(errors).max() < 0.04


@pytest.mark.slow
def test_light_under_a_volcanic_layer_has_settled():
    """`standard` has altitude_density 1.  Twice as dense moved the sky by up to 9 % at -18 and 5 % at -12 deg."""
    medium = climate_medium(load_climate("volcanic-extreme"), WAVELENGTH_NM)
    suns, bounds = (0.0, -12.0, -18.0), (0.003, 0.006, 0.015)
    coarse = replace(COARSE, max_degree=8, late_degree=4)
    skies = []
    for density in (1.0, 2.0):
        field = zones.prepare(medium, replace(coarse, altitude_density=density), sun_elevations_deg=suns)
        skies.append([field.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG)[:, 0] for sun in suns])
    moved = np.abs(np.array(skies[0]) / np.array(skies[1]) - 1.0).max(axis=1)
    assert np.all(moved < bounds)


def test_steps_of_the_first_order_resolve_the_edge_of_the_shadow():
    """The sun at -4 deg over the haze of `antarctic`, 10 km high: with steps of the density of later orders all light
    scattered several times moved together."""
    medium = climate_medium(load_climate("antarctic"), WAVELENGTH_NM)
    coarse = replace(COARSE, step_density=STANDARD.step_density)
    skies = []
    for density in (4.0, STANDARD.first_order_step_density, STANDARD.step_density):
        field = zones.prepare(medium, replace(coarse, first_order_step_density=density), sun_elevations_deg=[-4.0])
        skies.append(field.radiance(-4.0, ELEVATION_DEG, AZIMUTH_DEG)[:, 0])
    settled, rough = (np.abs(sky / skies[0] - 1.0).max() for sky in skies[1:])
    assert settled < 0.003 < rough


@pytest.mark.parametrize(
    ("base_km", "depth", "sun_deg", "n_warnings"),
    [(50.0, 1.0, -6.0, 1), (50.0, 1.0, 30.0, 0), (50.0, 0.01, -6.0, 0), (3.0, 1.0, -6.0, 0)],
)
def test_a_high_thin_layer_after_sunset_is_said_to_be_uncertain(base_km, depth, sun_deg, n_warnings):
    """In one sentence; whether there is one does not hang on how finely the field is solved."""
    few = replace(SCALAR, max_orders=2, tolerance=0.0, altitude_density=0.3, zenith_density=0.3, polar_directions=4)
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always", TwilightWarning)
        zones.prepare(layered(base_km, 1.0, depth), few, sun_elevations_deg=[sun_deg])
    assert len(given) == n_warnings
    assert all(f"at {base_km:g} km: with the sun below the horizon" in str(w.message) for w in given)


@pytest.mark.parametrize(
    ("layer", "quality", "allowed"),
    [
        ((3.0, 0.01, 2.0), "draft", 0.03),
        ((50.0, 1.0, 1.0), "draft", 0.02),
        pytest.param((3.0, 0.01, 2.0), "standard", 0.015, marks=pytest.mark.slow),
        pytest.param((50.0, 1.0, 1.0), "standard", 0.025, marks=pytest.mark.slow),
    ],
)
def test_a_thin_layer_from_above_and_from_below(layer, quality, allowed):
    """Straight down and in the zenith, sun at 30 deg, against plane-parallel doubling and adding, without air in the
    layer.  Four polar angles below the horizon, and harmonics lost in thick air, made it up to 9 % too dark from above.
    """
    base, thickness, depth = layer
    top = base + thickness
    levels = [100.0, top + 5.0, top]
    air = [0.1 * (np.exp(-low / 8.0) - np.exp(-high / 8.0)) for high, low in pairwise(levels)]
    below = (0.1 * (1.0 - np.exp(-base / 8.0)), 1.0, RAYLEIGH)
    layers = [*((d, 1.0, RAYLEIGH) for d in air), (depth, 1.0, henyey_greenstein(0.7)), below]
    streams = 24
    truth = Slabs(layers, 0.0, 0.5, streams)
    settings = replace(zones.QUALITIES[quality], polarisation=False)
    field = zones.prepare(layered(*layer), settings, observer_altitude_km=top + 5.0, sun_elevations_deg=[30.0])
    down = field.radiance(30.0, [-90.0], [40.0])[0, 0]
    up = field.radiance(30.0, [90.0], [40.0], observer_altitude_km=0.0)[0, 0]
    np.testing.assert_allclose([down, up], [truth.up[1][streams], truth.down[-1][streams]], rtol=allowed)


def test_light_of_a_low_sun_in_a_thin_layer_is_not_stepped_over():
    """Light that enters 1 deg above the layer, e^(-t / sin 1 deg) at optical depth t from its top, along the vertical
    and along slanted lines: e^-t dt is known in closed form.  With the usual steps up to 85 % of it were missed."""
    base, thickness, depth = 50.0, 1.0, 1.0
    usual = prepare_profile(layered(base, thickness, depth))
    worst = []
    for profile in (usual, near_edges(usual, usual)):
        off = []
        for up in (0.2, 0.5, 1.0):
            start, path = np.array([base + thickness + 1.0]), 1.0 / up
            rays = trace_rays(profile, start, np.array([-up]), STANDARD.step_density)
            z = rays.place[:, ALTITUDE]
            inside = (z > base) & (z < base + thickness)
            lit = np.exp(-(base + thickness - z[inside]) / math.sin(math.radians(1.0)))
            slope = path + 1.0 / math.sin(math.radians(1.0))
            off.append(float((rays.weight[inside, 0] * lit).sum()) / (path / slope) - 1.0)
        worst.append(np.abs(off).max())
    assert worst[0] > 0.3
    assert worst[1] < 0.02


@pytest.mark.slow
def test_light_leaks_along_a_high_layer_after_sunset():
    """Against the mean of four seeds of `montecarlo`, 110 s each at this sun: standard errors of 1.4 and 1.6 %."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TwilightWarning)
        field = zones.prepare(layered(50.0, 1.0, 1.0), SCALAR, sun_elevations_deg=[-6.0])
    found = field.radiance(-6.0, [20.0, 90.0], [40.0, 40.0])[:, 0]
    np.testing.assert_allclose(found, [4.80e-5, 5.17e-6], rtol=0.06)
