"""Cells: the grid, the exact mode, energy, extremes; Haber's own system is in test_cells_haber."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from energy_media import ODD, odd_medium
from exact_sunbeam import scattered_once

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.numerics.phase import PhaseFunction
from twilight.solvers import cells
from twilight.solvers.cells import CellsSettings
from twilight.solvers.cells.grid import make_grid, outer_radius_km, shell_radii
from twilight.transport.scaling import delta_scaled

COARSE = CellsSettings(
    azimuth_cells=24,
    degree=4,
    polar_directions=3,
    azimuth_directions=10,
    azimuth_nodes=20,
    node_density=0.5,
)
COARSEST = replace(
    COARSE, azimuth_cells=16, degree=2, polar_directions=2, azimuth_directions=6, azimuth_nodes=12, node_density=0.4
)


def air(
    *,
    scattering=0.02,
    aerosol=0.1,
    albedo=0.95,
    asymmetry=0.7,
    absorption=0.0,
    refractivity=2.8e-4,
    ground=0.0,
    top=60.0,
) -> Medium:
    """Two wavelengths of exponential air, 8 km, with aerosol of 1.5 km scale height."""
    z = np.concatenate([np.arange(0.0, 10.0, 1.0), np.linspace(10.0, top, 26)])
    one = np.ones((z.size, 2)) * np.array([1.0, 0.6])
    return Medium(
        wavelength_nm=np.array([450.0, 600.0]),
        altitude_km=z,
        air_scattering_per_km=scattering * np.exp(-z / 8.0)[:, None] * one,
        absorption_per_km=absorption * np.exp(-z / 8.0)[:, None] * one,
        aerosol_extinction_per_km=aerosol * np.exp(-z / 1.5)[:, None] * one,
        aerosol_single_scattering_albedo=np.full(one.shape, albedo),
        aerosol_phase_fraction=np.ones((1, *one.shape)),
        phase_functions=(PhaseFunction.henyey_greenstein([asymmetry, asymmetry]),),
        refractivity=refractivity * np.exp(-z / 8.0)[:, None] * np.ones_like(one),
        depolarisation=np.zeros(2),
        ground_albedo=np.full(2, ground),
        overhead_absorption_optical_depth=np.zeros(2),
        name="test",
    )


@pytest.fixture(scope="module")
def plain_field():
    return cells.prepare(air(), COARSEST)


# --- grid ---


@pytest.mark.parametrize(("azimuth_cells", "shells"), [(72, 101), (180, 252)])
def test_shell_counts_of_the_paper(azimuth_cells, shells):
    """Shells would not follow the paper's rule: 101 at S = 72, 252 at S = 180."""
    outer = outer_radius_km(35.0, 0.0, 6371.0)
    assert outer == pytest.approx(669.0, abs=1.0)
    radii = shell_radii(azimuth_cells, 0.1, outer)
    assert radii.size - 1 == shells
    assert radii[-1] >= outer
    # a shell is as thick as the mean arc of its two edges is long; the last one reaches the outer radius
    arc = 2 * np.pi / azimuth_cells * 0.5 * (radii[1:] + radii[:-1])
    np.testing.assert_allclose(np.diff(radii)[:-1], arc[:-1], rtol=1e-12)


def test_cells_fill_a_sphere_that_lies_in_the_air():
    """Cells would overlap or leave gaps, and their light would be counted twice or lost."""
    grid = make_grid(36, 1.0, 30.0, 0.0, 60.0, 6371.0)
    inside = grid.shell_radius_km[grid.ring_shell + 1] < 29.0
    edge = grid.shell_radius_km[grid.shell_radius_km < 29.0][-1]
    volume = grid.ring_volume_km3[inside].sum() * grid.azimuth_cells
    assert volume == pytest.approx(4 / 3 * np.pi * (edge**3 - 1.0), rel=1e-12)


def test_cells_are_those_whose_centre_is_in_the_air():
    """Cells below the ground or above the air would scatter light."""
    grid = make_grid(120, 0.1, 0.0, 0.0, 100.0, 6371.0)
    assert grid.ring_altitude_km.min() > 0.0
    assert grid.ring_altitude_km.max() < 100.0
    assert np.any(grid.ring_elevation < 0.0)  # cells below the horizontal take part


def test_observer_above_the_air_is_refused():
    """An observer in orbit would get a sky made for the ground."""
    with pytest.raises(TwilightError, match=r"observer\.altitude_km is 80"):
        cells.prepare(air(), COARSE, observer_altitude_km=80.0)


# --- single scattering ---


def test_single_scattering_is_the_line_integral():
    """Single scattering would differ from quadrature of its own equation."""
    medium = air(refractivity=0.0, asymmetry=0.6, absorption=0.003)
    field = cells.prepare(medium, replace(COARSE, multiple_scattering="none"))
    for elevation, azimuth in ((3.0, 0.0), (30.0, 100.0), (85.0, 180.0)):
        got = field.radiance(12.0, elevation, azimuth)[0]
        assert got == pytest.approx(scattered_once(medium, 0.0, elevation, azimuth, 12.0), rel=2e-3)


@pytest.mark.slow
def test_refraction_off_is_refractivity_zero():
    """`refraction: false` would leave some refraction."""
    straight = cells.prepare(air(refractivity=0.0), COARSEST).radiance(-3.0, [5.0, 60.0], [10.0, 90.0])
    off = cells.prepare(air(), replace(COARSEST, refraction=False)).radiance(-3.0, [5.0, 60.0], [10.0, 90.0])
    np.testing.assert_allclose(off, straight, rtol=1e-12)


def test_refraction_brightens_twilight(plain_field):
    """Beam bending or its spreading would have the wrong sign."""
    straight = cells.prepare(air(), replace(COARSEST, refraction=False)).radiance(-4.0, 90.0, 0.0)
    bent = plain_field.radiance(-4.0, 90.0, 0.0)
    assert np.all(bent / straight > 1.03)
    assert np.all(bent / straight < 1.3)


# --- exact mode ---


WHITE = ("conservative air over a white ground", "a conservative layer over a white ground")


@pytest.mark.parametrize(
    "medium",
    [
        lambda: air(albedo=1.0, ground=1.0, refractivity=0.0),
        lambda: odd_medium(*(ODD[name] for name in WHITE), refractivity=0.0),
    ],
    ids=["exponential", "a layer with edges"],
)
def test_uniform_light_in_a_white_box_stays_uniform(medium):
    """Conservative air over a ground as bright as the light in it: whatever ends on the ground sees 1 everywhere."""
    field = cells.prepare(medium(), COARSE)
    o = field.multiple.ordinates
    shape = (o.synthesis.shape[0], o.nodes.altitude_km.size, o.n_azimuth, 2)
    out = np.zeros(shape, np.float32)
    o._pass(np.zeros(shape, np.float32), np.zeros(shape[1:], np.float32), out)
    # steep rays end on the ground under every node; the steps' quadrature is what is missing
    steep = np.repeat(o.directions.cosine, o.directions.azimuth.size) < -0.4
    inside = o.nodes.x_km < 500.0
    np.testing.assert_allclose(out[steep][:, inside], 1.0, rtol=1e-3)
    assert out.max() < 1.0 + 1e-3


def test_delta_scaling_keeps_what_is_not_forward():
    """Scaling would take light that is not scattered forward."""
    medium = air(asymmetry=0.8)
    for degree in (0, 2, 6):
        scaled = delta_scaled(medium, degree).medium
        scattering = scaled.aerosol_extinction_per_km * scaled.aerosol_single_scattering_albedo
        original = medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo
        np.testing.assert_allclose(scattering, original * (1 - 0.8 ** (degree + 1)), rtol=1e-12)


def test_left_and_right_are_the_same_and_azimuth_is_periodic(plain_field):
    """The sky would not be its own mirror image about the sun's vertical."""
    expected = plain_field.radiance(5.0, 30.0, [40.0, 170.0])
    for azimuth in ([-40.0, 190.0], [400.0, -190.0]):
        np.testing.assert_allclose(plain_field.radiance(5.0, 30.0, azimuth), expected, rtol=1e-10)


def test_ground_is_seen_at_the_wavelengths_that_reach_it():
    """A first wavelength at which the air is black must not hide the ground from the others."""
    clear = air(ground=0.5)
    black = clear.absorption_per_km.copy()
    black[:, 0] = 10.0 * np.exp(-clear.altitude_km / 8.0)
    half = replace(clear, absorption_per_km=black)
    expected = cells.prepare(clear, COARSEST).radiance(30.0, 60.0, 90.0)[1]
    got = cells.prepare(half, COARSEST).radiance(30.0, 60.0, 90.0)[1]
    assert got == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_more_ground_more_light_more_absorber_less():
    """A sign of the ground or of absorption would be wrong."""
    light = [
        cells.prepare(medium, COARSE).radiance(20.0, [10.0, 50.0, 90.0], 70.0)
        for medium in (air(ground=0.0), air(ground=0.3), air(ground=1.0))
    ]
    assert np.all(light[0] < light[1])
    assert np.all(light[1] < light[2])
    darker = cells.prepare(air(absorption=0.01), COARSE).radiance(20.0, [10.0, 50.0, 90.0], 70.0)
    assert np.all(darker < light[0])


@pytest.mark.slow
def test_scattering_is_followed_until_it_converges():
    """The tolerance would end the orders too early."""
    field = cells.prepare(air(albedo=1.0, aerosol=0.4, ground=0.9), COARSE)
    radiance = field.radiance(30.0, [10.0, 80.0], 90.0)
    assert field.convergence.residual < COARSE.tolerance
    loose = cells.prepare(air(albedo=1.0, aerosol=0.4, ground=0.9), replace(COARSE, tolerance=1e-5))
    np.testing.assert_allclose(radiance, loose.radiance(30.0, [10.0, 80.0], 90.0), rtol=2e-3)
    assert loose.convergence.orders > field.convergence.orders


def test_one_thread_and_two_are_bit_identical():
    """The number of threads would change the sky."""
    before = numba.get_num_threads()
    results = []
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            results.append(cells.prepare(air(), COARSEST).radiance(-2.0, [5.0, 40.0], [0.0, 120.0]))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(results[0], results[1])


@pytest.mark.parametrize(
    "medium",
    [
        {"aerosol": 13.0},
        {"asymmetry": 0.98},
        {"asymmetry": 0.0},
        {"albedo": 0.0},
        {"albedo": 1.0, "ground": 1.0},
        {"scattering": 0.0, "aerosol": 0.0},
        {"absorption": 10.0},
        {"scattering": 1e-9},
    ],
)
@pytest.mark.parametrize("mode", ["exact", "isotropic"])
def test_extreme_air_is_finite_and_not_negative(medium, mode):
    """Extreme air would give NaN, infinity or negative light."""
    settings = replace(COARSEST, multiple_scattering=mode, azimuth_cells=16, max_orders=5)
    field = cells.prepare(air(**medium), settings)
    for sun in (0.0, -40.0):
        radiance = field.radiance(sun, [0.0, 1.0, 45.0, 90.0], [0.0, 0.0, 180.0, 0.0])
        assert np.all(np.isfinite(radiance))
        assert np.all(radiance >= 0.0)


@pytest.fixture(scope="module")
def by_day(plain_field):
    return plain_field.radiance(5.0, [0.0, 45.0, 90.0], 180.0)


@pytest.mark.parametrize("sun", [90.0, -6.0, -18.0, -90.0])
def test_every_sun_is_finite_and_darker_than_day(plain_field, by_day, sun):
    """A sun far below the horizon would give NaN or light."""
    radiance = plain_field.radiance(sun, [0.0, 45.0, 90.0], 180.0)
    assert np.all(np.isfinite(radiance))
    assert np.all(radiance >= 0.0)
    if sun < 0.0:
        assert np.all(radiance < by_day)


@pytest.mark.parametrize("altitude", [0.0, 8.0, 50.0])
def test_observer_altitudes(altitude):
    """An observer above the ground would see NaN, negative light, or no ground."""
    field = cells.prepare(air(ground=0.3), COARSEST, observer_altitude_km=altitude)
    radiance = field.radiance(10.0, [-90.0, -20.0, 0.0, 20.0, 90.0], 90.0)
    assert np.all(np.isfinite(radiance))
    assert np.all(radiance >= 0.0)
    assert np.all(radiance[0] > 0.0)  # the ground is seen
