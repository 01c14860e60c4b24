"""Haber's system, `cells`: each step against its equation or an independent way to it."""

import math
import warnings
from dataclasses import replace

import numba
import numpy as np
import pytest
from hazy_zones import SCALAR
from scipy.integrate import quad

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.numerics.phase import PhaseFunction
from twilight.solvers import cells, zones
from twilight.solvers.cells import QUALITIES
from twilight.solvers.cells.direct_light import MAX_STEPS, refracted_sun, trace_to_space
from twilight.solvers.cells.exchange import BLOCKS, exchange, full_turn, pair_capture, rounds_of_blocks, sphere_capture
from twilight.solvers.cells.grid import layer_of, make_grid, make_layers, outer_radius_km, path_depth, shell_radii
from twilight.transport.ray_profile import ray_profile
from twilight.transport.rays import OUTSIDE, sun_ray
from twilight.transport.steps import altitude_along, distance_to_sphere

pytestmark = pytest.mark.filterwarnings("ignore:solver.azimuth_cells")

HABER = replace(QUALITIES["haber2005"], azimuth_cells=24)
SUN = np.array([math.cos(0.3), 0.0, math.sin(0.3)])


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


# --- cells (4.1.3) ---


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


@pytest.mark.parametrize("top", [35.0, 60.0, 100.0])
@pytest.mark.parametrize("quality", list(QUALITIES))
def test_every_shell_of_a_quality_has_cells(quality, top):
    """Air far from the observer would have no cell, and its light would be missing (S = 60 from 395 km on)."""
    grid = make_grid(QUALITIES[quality].azimuth_cells, 0.1, 0.0, 0.0, top, 6371.0)
    assert not grid.shells_without_cells.size


def test_shells_without_cells_are_told():
    """Light of a small S would be taken for his: from 400 km on no cell has its centre in air up to 35 km."""
    with pytest.warns(
        TwilightWarning, match=r"azimuth_cells 36: 4 of 50 shells .* the first 313 km away.*draft \(66\)"
    ):
        cells.prepare(air(top=35.0), replace(HABER, azimuth_cells=36))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cells.prepare(air(top=35.0), QUALITIES["draft"])


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
        cells.prepare(air(), HABER, observer_altitude_km=80.0)


# --- layers (4.1.2, eq. 3 and 4) ---


@pytest.mark.parametrize(("start", "cosine", "length"), [(0.0, 1.0, 20.0), (5.0, 0.1, 60.0), (6.0, -0.03, 250.0)])
def test_depth_of_a_path_is_the_integral_of_extinction(start, cosine, length):
    """Eq. (4) would miss a layer, or count one twice where a path dips and rises."""
    medium = air(top=35.0)
    layers = make_layers(medium, False)

    def extinction(s, w):
        return medium.at(altitude_along(start, cosine, s, 6371.0)).extinction[w]

    end = altitude_along(start, cosine, length, 6371.0)
    first, last = layer_of(layers, np.array([start, end]))
    got = np.empty(2)
    square, climb = start * (2 * 6371.0 + start), (6371.0 + start) * cosine
    assert path_depth(layers, layers.extinction, first, last, square, climb, length, got)
    expected = [quad(extinction, 0.0, length, args=(w,), limit=200, epsrel=1e-6)[0] for w in (0, 1)]
    np.testing.assert_allclose(got, expected, rtol=1e-2)  # of constant layers with up to e^0.4 from one to the next


def test_a_path_through_the_ground_is_none():
    """Cells beyond the horizon would light each other through the Earth."""
    layers = make_layers(air(top=35.0), False)
    assert not path_depth(layers, layers.extinction, 0, 0, 1.0 * (2 * 6371 + 1.0), -6372 * 0.02, 300.0, np.empty(2))


# --- the refracted path to the sun (4.4) ---


@pytest.mark.parametrize("altitude", [0.0, 4.0, 20.0])
def test_binary_search_finds_the_exact_path_to_its_tolerance(altitude):
    """The sun would be sought in a wrong direction: lift and depth are those of rays in the smooth index."""
    medium = air(aerosol=0.0, top=60.0)
    layers, profile = make_layers(medium, False), ray_profile(medium)
    layer = layer_of(layers, np.array([altitude]))
    for apparent in (-1.0, 0.3, 1.0, 5.0, 40.0):
        radius = (6371.0 + altitude) * (1.0 + medium.at(altitude).refractivity[0])
        bending, depth, status = sun_ray(profile, 0, altitude, radius * math.sin(math.radians(apparent)), 0.0)
        if status != OUTSIDE:
            continue
        sun = np.array([math.radians(apparent) - bending])
        lift, found, steps = refracted_sun(layers, np.array([altitude]), layer, sun, math.radians(0.1))
        assert lift[0, 0] == pytest.approx(bending, abs=math.radians(0.13))
        assert found[0, 0] == pytest.approx(depth, rel=0.06)
        assert steps.max() <= 15
        # the search without its tolerance; what is left is that of layers
        lift, found, steps = refracted_sun(layers, np.array([altitude]), layer, sun, 1e-6)
        assert lift[0, 0] == pytest.approx(bending, rel=0.15)
        assert found[0, 0] == pytest.approx(depth, rel=0.01 if apparent > 0.0 else 0.1)  # layers make it jump
        assert steps.max() <= MAX_STEPS


def test_no_path_ends_the_search():
    """A sun under the horizon, or air that keeps its rays, would hang the search or light the shadow."""
    duct = air(refractivity=2e-2, top=35.0)
    for medium in (air(top=35.0), duct):
        layers = make_layers(medium, False)
        z = np.array([0.0, 0.5, 10.0, 34.0])
        for sun in (-0.35, -1.5):
            lift, _, steps = refracted_sun(layers, z, layer_of(layers, z), np.full(4, sun), math.radians(0.1))
            assert np.all(np.isnan(lift)) and steps.max() <= MAX_STEPS


def test_without_refraction_the_path_is_straight():
    """Layers without an index would bend light."""
    layers = make_layers(air(refractivity=0.0, top=35.0), False)
    sine, first = math.sin(math.radians(-1.0)), int(layer_of(layers, np.array(3.0)))
    deflection, depth = trace_to_space(layers, 0, 3.0, first, math.radians(-1.0))
    assert deflection == pytest.approx(0.0, abs=1e-12)
    length = distance_to_sphere(3.0, sine, 35.0, 6371.0)
    got = np.empty(2)
    last = layers.air.shape[0] - 1
    assert path_depth(layers, layers.extinction, first, last, 3.0 * (2 * 6371.0 + 3.0), 6374.0 * sine, length, got)
    assert depth == pytest.approx(got[0], rel=1e-9)


# --- scattering events (4.5, 4.6, eq. 1, 2 and 5) ---


def test_air_scatters_to_all_sides_alike_in_the_first_event():
    """Rayleigh's function would be in the preset: his pure air sends as much forward as sideways."""
    thin = air(scattering=1e-6, aerosol=0.0, top=35.0, refractivity=0.0)
    light = cells.prepare(thin, replace(HABER, max_orders=1)).radiance(40.0, 40.0, [0.0, 90.0, 180.0])
    np.testing.assert_allclose(light, np.broadcast_to(light[0], light.shape), rtol=1e-3)


def test_aerosol_follows_henyey_and_greenstein_once():
    """Eq. (1) would be left out, or be of the wrong angle."""
    thin = air(scattering=0.0, aerosol=1e-6, asymmetry=0.6, top=35.0, refractivity=0.0)
    elevation = np.radians([37.5, 67.5])  # middles of rows
    light = cells.prepare(thin, replace(HABER, max_orders=1)).radiance(37.5, np.degrees(elevation), [90.0, 180.0])
    cosine = np.sin(elevation) * math.sin(elevation[0])
    cosine += np.cos(elevation) * math.cos(elevation[0]) * np.array([0.0, -1.0])
    phase = (1 - 0.36) / (1.36 - 1.2 * cosine) ** 1.5
    expected = phase[0] / phase[1] * math.sin(elevation[1]) / math.sin(elevation[0])
    np.testing.assert_allclose(light[0] / light[1], expected, rtol=0.05)  # cells along a line are few


def test_single_scattering_is_the_sum_over_the_line_of_sight():
    """A factor would be lost between a cell's power and the radiance that reaches the observer."""
    medium = air(scattering=0.01, aerosol=0.0, top=35.0, refractivity=0.0)
    fine = replace(HABER, azimuth_cells=72, max_orders=1)
    got = cells.prepare(medium, fine).radiance(50.0, 47.5, 0.0)
    sine, sun = math.sin(math.radians(47.5)), math.sin(math.radians(50.0))
    for w, scattering in enumerate((0.01, 0.006)):

        def along(s, k=scattering):
            z = altitude_along(0.0, sine, s, 6371.0)
            above = k * 8.0 * (math.exp(-z / 8.0) - math.exp(-35.0 / 8.0)) / sun
            below = k * 8.0 * (1.0 - math.exp(-z / 8.0)) / sine
            return k * math.exp(-z / 8.0) * math.exp(-above - below) / (4.0 * math.pi)

        expected = quad(along, 0.0, distance_to_sphere(0.0, sine, 35.0, 6371.0))[0]
        assert got[w] == pytest.approx(expected, rel=0.02)


@pytest.fixture(scope="module")
def few_cells():
    """A field of some 20 rings of 8 cells."""
    return cells.prepare(
        air(top=30.0, aerosol=0.05), replace(HABER, azimuth_cells=8, inner_radius_km=5.0, active_shell_step=1)
    )


def test_savings_change_nothing(few_cells):
    """Ring reuse, mirror images or the way back would change the light that they are to save: all pairs one by one."""
    field, s = few_cells, 8
    rings, layers = field.rings, field.layers
    rng = np.random.default_rng(3)
    power, forward = rng.uniform(size=(2, rings.radius.size, 2, 5))
    got = exchange(layers, rings, power, forward, SUN)
    fold = [0, 1, 2, 3, 4, 3, 2, 1]
    depth, there, back, way = np.empty(2), np.empty(2), np.empty(2), np.empty(3)
    expected = np.zeros_like(got)
    for source in range(rings.radius.size):
        g = layers.asymmetry[rings.layer[source]]
        for target in range(rings.radius.size):
            for a in range(s):
                for u in range(5):
                    same = (target, u) == (source, a)
                    turn = 0.0 if same else 2 * np.pi * (u - a) / s
                    pair_capture(layers, layers.extinction, rings, (target, source, turn), depth, there, back, way)
                    angle = 2 * np.pi * a / s
                    x = math.cos(angle) * way[0] - math.sin(angle) * way[1]
                    cosine = -(x * SUN[0] + way[2] * SUN[2])
                    phase = 1.0 if same else (1 - g**2) / (1 + g**2 - 2 * g * cosine) ** 1.5
                    sent = power[source, :, fold[a]] + phase * forward[source, :, fold[a]]
                    expected[target, :, u] += there * sent
    np.testing.assert_allclose(got, expected, rtol=2e-5)  # the phase function is in single precision


def test_every_pair_of_blocks_comes_once():
    """Light between two rings would be left out or counted twice, or two threads would write to one ring."""
    own, *games = rounds_of_blocks(BLOCKS)
    pairs = {tuple(sorted(pair)) for one in games for pair in one.tolist()}
    assert len(pairs) == sum(map(len, games)) == BLOCKS * (BLOCKS - 1) // 2
    assert own.tolist() == [[b, b] for b in range(BLOCKS)]
    for one in games:
        assert sorted(one.ravel()) == list(range(BLOCKS))


def test_sphere_capture_limits():
    """A thin cell would not capture its optical depth, or a black one not all."""
    assert sphere_capture(1e-9) == pytest.approx(0.75e-9, rel=1e-6)
    assert sphere_capture(0.02) == pytest.approx(sphere_capture(0.0200001), rel=1e-4)  # series meets closed form
    assert sphere_capture(1e3) == pytest.approx(1.0, abs=1e-3)


def test_cells_extinguish_what_the_air_does():
    """A factor of eq. (5), such as 4 pi, would be lost.

    Near the observer, where cells are small, the sum over all cells is what rays through the air lose.
    """
    field = cells.prepare(air(top=35.0, aerosol=0.05), replace(HABER, azimuth_cells=24, active_shell_step=1))
    rings, layers = field.rings, field.layers
    around = full_turn(24)
    cosine, weight = np.polynomial.legendre.leggauss(32)
    for ring in np.nonzero(rings.radius < 0.6)[0][::7]:
        power = np.zeros((rings.radius.size, 2, 13))
        power[ring] = 1.0
        found = (exchange(layers, rings, power) * around).sum(axis=(0, 2)) / 24
        h, exact, depth = rings.altitude[ring], np.zeros(2), np.empty(2)
        for c, w in zip(cosine, weight, strict=True):
            length = distance_to_sphere(h, c, 0.0, 6371.0) if c < 0.0 else -1.0
            end = 0 if length >= 0.0 else layers.air.shape[0] - 1
            length = length if length >= 0.0 else distance_to_sphere(h, c, 35.0, 6371.0)
            start = (rings.layer[ring], end, h * (2 * 6371.0 + h), (6371.0 + h) * c)
            assert path_depth(layers, layers.later_extinction, *start, length * (1.0 - 1e-9), depth)
            exact += 0.5 * w * (1.0 - np.exp(-depth))
        np.testing.assert_allclose(found, exact, rtol=0.06)


@pytest.mark.parametrize(("sun", "azimuth_cells"), [(10.0, 24), (-3.0, 36)])
def test_light_does_not_depend_on_how_many_shells_are_active(sun, azimuth_cells):
    """Without I_all / I_active light scattered twice or more would fall as 1 / step (0.85, 0.48, 0.33 of `zones`)."""
    medium = air(aerosol=0.05, top=35.0)
    elevation, azimuth = np.array([8.0, 23.0, 53.0, 83.0]), np.array([0.0, 60.0, 120.0, 180.0])

    def more_than_once(step):
        settings = replace(HABER, azimuth_cells=azimuth_cells, active_shell_step=step)
        fields = [cells.prepare(medium, replace(settings, max_orders=n)) for n in (1, 5)]
        once, all_orders = (field.radiance(sun, elevation, azimuth) for field in fields)
        return all_orders - once

    every = more_than_once(1)
    for step, within in ((2, 0.15), (4, 0.3)):
        np.testing.assert_allclose(more_than_once(step), every, rtol=within)


def test_effective_scattering_is_less_by_g():
    """Eq. (2): scattering falls by g, and extinction with it only where that is asked for."""
    medium = air(asymmetry=0.7, albedo=1.0)
    as_published, closed = make_layers(medium, False), make_layers(medium, True)
    np.testing.assert_allclose(as_published.later_scattering, as_published.air + 0.3 * as_published.aerosol)
    np.testing.assert_array_equal(as_published.later_extinction, as_published.extinction)
    np.testing.assert_allclose(closed.later_extinction, closed.later_scattering, rtol=1e-12)


def test_effective_scattering_begins_with_the_third_event():
    """Eq. (2) would count in I_2, which section 4.6.2 makes by eq. (5) as printed; an option reads section 4.5.3."""
    medium = air(aerosol=0.3, top=35.0)
    settings = replace(HABER, azimuth_cells=26)
    printed, earlier = (
        cells.prepare(medium, replace(settings, effective_from_event=event, reduce_extinction=True)) for event in (3, 2)
    )
    second, third = printed.layers_of(2), printed.layers_of(3)
    np.testing.assert_array_equal(second.later_scattering, second.air + second.aerosol)
    np.testing.assert_array_equal(second.later_extinction, second.extinction)
    assert third is printed.layers and earlier.layers_of(2) is earlier.layers
    light = [
        cells.prepare(medium, replace(settings, max_orders=2, effective_from_event=event)).radiance(20.0, 30.0, 90.0)
        - cells.prepare(medium, replace(settings, max_orders=1)).radiance(20.0, 30.0, 90.0)
        for event in (3, 2)
    ]
    # what is scattered in the second event, between all of air's and (1 - g) of the aerosol's
    low = light[1] / light[0]
    assert np.all((low > 0.3) & (low < 0.9))


# --- the texture (4.7) and the whole ---


@pytest.fixture(scope="module")
def field():
    return cells.prepare(air(top=35.0), HABER)


def test_sky_is_its_own_mirror_image_and_whole_at_the_zenith(field):
    """The interpolation would have an edge at the zenith or the sun's vertical."""
    light = field.radiance(12.0, 30.0, [40.0, -40.0, 320.0])
    np.testing.assert_allclose(light, np.broadcast_to(light[0], light.shape), rtol=1e-12)
    around = field.radiance(12.0, 90.0, [0.0, 45.0, 135.0, 180.0])
    assert np.ptp(around, axis=0).max() / around.mean() < 0.1
    np.testing.assert_allclose(field.radiance(12.0, 89.999, 0.0), field.radiance(12.0, 89.999, 180.0), rtol=1e-3)


def test_threads_do_not_change_the_light():
    """Sums would depend on who came first."""
    before, made = numba.get_num_threads(), []
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            made.append(cells.prepare(air(), replace(HABER, azimuth_cells=16)).radiance(-2.0, [5.0, 40.0], 30.0))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(made[0], made[1])


def test_more_ground_more_light():
    """Light of the ground would be lost or come back with a wrong factor: the gain is that of `zones`."""
    gain = []
    for solver, settings in ((cells, replace(HABER, azimuth_cells=36)), (zones, SCALAR)):
        white, dark = (solver.prepare(air(ground=albedo), settings).radiance(30.0, 60.0, 90.0) for albedo in (0.8, 0.0))
        gain.append(white / dark)
    np.testing.assert_allclose(gain[0], gain[1], rtol=0.2)


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
def test_extreme_air_is_finite_and_not_negative(medium):
    """Extreme air would give NaN, infinity or negative light."""
    field = cells.prepare(air(**medium), replace(HABER, azimuth_cells=16))
    for sun in (0.0, -40.0):
        radiance = field.radiance(sun, [0.0, 1.0, 45.0, 90.0], [0.0, 0.0, 180.0, 0.0])
        assert np.all(np.isfinite(radiance))
        assert np.all(radiance >= 0.0)


@pytest.mark.parametrize("sun", [90.0, 0.0, -6.0, -18.0, -90.0])
@pytest.mark.parametrize("altitude", [0.0, 8.0, 30.0])
def test_every_sun_and_observer_is_finite(sun, altitude):
    """A sun or an observer would give NaN or negative light."""
    field = cells.prepare(air(ground=0.3, top=35.0), replace(HABER, azimuth_cells=12), observer_altitude_km=altitude)
    light = field.radiance(sun, [-90.0, -20.0, 0.0, 20.0, 90.0], 90.0)
    assert np.all(np.isfinite(light)) and np.all(light >= 0.0)
