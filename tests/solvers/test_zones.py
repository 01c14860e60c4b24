"""The zones solver against the reference solution, other solvers, conservation laws and itself."""

import os
import re
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest
from hazy_zones import AZIMUTH, ELEVATION, REFERENCE, read_table
from hazy_zones import SCALAR as SMALL

from twilight.atmosphere.medium_table import medium_from_table
from twilight.base.errors import TwilightError
from twilight.config.load import load
from twilight.scene import resolve
from twilight.solvers import zones
from twilight.solvers.zones.angles import cubic_refinement, even_harmonics, make_angles, zenith_nodes
from twilight.solvers.zones.scattering import normalised
from twilight.transport.beam import beam_at

MIDDLE = replace(
    zones.QUALITIES["standard"], degree=8, azimuth_directions=9, polar_directions=10, late_degree=5,
    late_azimuth_directions=6, altitude_density=0.7, zenith_density=0.7, polarisation=False,
    bent_lines_of_sight=False, bent_paths=False,
)  # fmt: skip


@pytest.fixture(scope="module")
def hazy():
    return medium_from_table(REFERENCE / "hazy-air.csv")


@pytest.fixture(scope="module")
def middle(hazy):
    return zones.prepare(hazy, MIDDLE)


@pytest.fixture(scope="module")
def small(hazy):
    return zones.prepare(hazy, SMALL)


def test_every_tuned_number_is_used_and_names_a_test():
    """A number that nothing reads, or that no test covers, would stay in the table for ever."""
    tests = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parents[1].rglob("test_*.py"))
    room = Path(zones.__file__).parent
    code = "".join(path.read_text(encoding="utf-8") for path in room.glob("*.py") if path.name != "constants.py")
    rows = zones.tuned_numbers()
    assert len(rows) > 50
    for row in rows:
        assert f"def {row.test}(" in tests, row.name
        assert re.search(rf"\btuned\.{row.name}\b", code), row.name


@pytest.mark.parametrize(
    ("air", "kinds"),
    [
        ("pure-air", {"any"}),
        ("desert", {"any", "aerosol", "dust, sea salt", "top of dust"}),
        ("volcanic-extreme", {"any", "aerosol", "dust, sea salt", "layered", "volcanic layer"}),
    ],
)
def test_tuned_numbers_act_in_their_own_air(air, kinds):
    """A scar of one climate would be told of, or act, in another."""
    scene = resolve(load(air), solver=(zones, zones.QUALITIES["standard"]))
    assert zones.kinds_met(scene.medium, scene.settings) == kinds
    assert kinds <= {row.air for row in zones.tuned_numbers()}


def test_harmonics_are_orthonormal_and_moments_of_a_harmonic_are_its_own():
    """A moment would hold light of another degree."""
    x, w = np.polynomial.legendre.leggauss(24)
    polar = even_harmonics(x, 8, 8)
    angles = make_angles(np.array([0.0, -0.1]), 24, 10, 8)
    around = np.cos(angles.order * angles.azimuth[:, None])
    basis = polar[:, None] * around[None]
    gram = np.einsum("i,iac,iad->cd", 0.5 * w, basis, basis) / angles.azimuth.size
    np.testing.assert_allclose(gram, np.eye(angles.order.size), atol=1e-12)
    for k in range(2):
        own = even_harmonics(angles.cosine[k], 8, 8)[:, None] * around[None]
        np.testing.assert_allclose(
            np.einsum("cia,iad->cd", angles.analysis[k], own), np.eye(angles.order.size), atol=5e-3
        )
        np.testing.assert_allclose(angles.weight.sum(axis=1), 1.0)


def test_cubic_refinement_is_exact_for_cubics_and_does_not_look_across_breaks():
    """Light would be interpolated across an edge of the air."""
    x = np.array([0.0, 1.0, 1.5, 3.0, 4.0, 5.0, 7.0])
    fine, node, weight = cubic_refinement(x, 3)
    np.testing.assert_allclose((weight * (x**3 - x)[node]).sum(axis=1), fine**3 - fine, atol=1e-12)
    bent = np.where(x < 3.0, 0.0, x - 3.0)
    fine, node, weight = cubic_refinement(x, 4, np.array([3.0]))
    np.testing.assert_allclose((weight * bent[node]).sum(axis=1), np.maximum(fine - 3.0, 0.0), atol=1e-12)


def test_zenith_nodes_cover_the_range_and_are_closest_at_the_terminator():
    """Twilight would be interpolated over too wide intervals."""
    nodes = zenith_nodes(0.0, 132.0, 1.0)
    assert nodes[0] == 0.0 and nodes[-1] >= 132.0
    steps = np.diff(nodes)
    assert 88.0 < nodes[np.argmin(steps)] < 100.0
    part = zenith_nodes(60.0, 132.0, 1.0)
    assert part[0] <= 60.0 and set(part) <= set(nodes)


@pytest.mark.parametrize(("sun", "most", "usual"), [(30.0, 1e-5, 1e-6), (-3.0, 1e-3, 1e-4), (-8.0, 1e-3, 1e-4)])
def test_a_sky_from_few_azimuths_is_that_of_every_direction(small, sun, most, usual):
    """One direction at a time is followed by itself.  In twilight that alone is rough to some 1e-4."""
    elevation, azimuth = np.array([3.0, 30.0]), np.arange(0.0, 181.0, 4.0)
    sky = small.radiance(sun, elevation[:, None], azimuth)
    alone = np.stack([small.radiance(sun, elevation, a) for a in azimuth], axis=1)
    wrong = np.abs(sky / alone - 1.0)
    assert wrong.max() < most and np.median(wrong) < usual


def test_lines_of_sight_are_cached_for_the_next_sun_and_no_longer_than_they_may(small, monkeypatch):
    """A second sun would trace all lines again, or the cache would grow without bound."""
    where = (np.array([5.0, 40.0]), np.array([10.0, 100.0]))
    first = small.radiance(10.0, *where)
    cached = small._cached_lines._cached
    before = len(cached)
    np.testing.assert_array_equal(small.radiance(10.0, *where), first)
    small.radiance(3.0, *where)
    assert len(cached) == before
    monkeypatch.setattr("twilight.solvers.zones.lines_of_sight.MAX_CACHE_BYTES", 0)
    small.radiance(3.0, 20.0, 10.0)
    assert not cached
    np.testing.assert_array_equal(small.radiance(10.0, *where), first)


@pytest.mark.parametrize(
    ("sun", "median", "high"), [(30.0, 0.6, 2.0), (5.0, 0.6, 2.5), (-4.0, 0.8, 2.5), (-9.0, 1.2, 4.0)]
)
def test_the_sky_is_that_of_the_reference_solution(middle, sun, median, high):
    """At reduced settings; benchmarks/results/zones_error.csv has the errors of the qualities."""
    table = read_table(REFERENCE / "hazy-air-albedo-0.csv")
    some = table[table["sun_elevation_deg"] == sun]
    place = np.searchsorted(middle.medium.wavelength_nm, some["wavelength_nm"])
    ours = middle.radiance(sun, some["elevation_deg"], some["azimuth_deg"])[np.arange(some.size), place]
    error = 100.0 * np.abs(ours / some["radiance_per_sr"] - 1.0)
    assert np.median(error) < median
    assert np.percentile(error, 95) < high


def test_energy_that_enters_a_sphere_leaves_it_where_nothing_absorbs(hazy):
    """The net flux through every sphere is 0 over a white ground: direct light in, scattered light out."""
    medium = replace(
        hazy,
        absorption_per_km=np.zeros_like(hazy.absorption_per_km),
        aerosol_single_scattering_albedo=np.ones_like(hazy.aerosol_single_scattering_albedo),
        ground_albedo=np.ones_like(hazy.ground_albedo),
    )
    field = zones.prepare(medium, replace(MIDDLE, refraction=False, max_orders=200, tolerance=1e-4))
    solution, nodes = field.solutions[0], field.grids.nodes
    mu, w = np.polynomial.legendre.leggauss(200)
    zenith = np.arccos(mu)
    light = np.empty(medium.n_wavelengths)
    for altitude in (0.0, 2.0, 10.0, 40.0):
        k = int(np.argmin(np.abs(nodes.fine_altitude_km - altitude)))
        # order 1 in degree, 0 in azimuth: the second harmonic is sqrt(3) cos(zenith angle)
        mean = np.exp(solution.light.log_mean[k])
        down = 4.0 * np.pi * mean * solution.light.ratio[k, :, 1] / np.sqrt(3.0)
        down = nodes.refine_zenith(down[:, :3])
        diffuse = np.stack([np.interp(zenith, nodes.zenith.fine_rad, row) for row in down.T], axis=1)
        direct = np.zeros_like(diffuse)
        for j, cosine in enumerate(mu):
            beam_at(field.beam, nodes.fine_altitude_km[k], cosine, light)
            direct[j] = light * cosine
        net = 0.5 * (w[:, None] * (diffuse + direct)).sum(axis=0)
        entering = 0.5 * (w[:, None] * np.maximum(direct, 0.0)).sum(axis=0)
        assert np.all(np.abs(net) < 4e-3 * entering), (altitude, net / entering)


def test_without_refraction_bent_and_straight_lines_are_the_same(hazy):
    """Bent lines would not end in straight ones as the refractive index tends to 1."""
    straight_air = replace(hazy, refractivity=np.zeros_like(hazy.refractivity))
    one, other = (
        zones.prepare(straight_air, replace(SMALL, bent_lines_of_sight=bent, bent_paths=bent)).radiance(
            -2.0, ELEVATION, AZIMUTH
        )
        for bent in (True, False)
    )
    np.testing.assert_array_equal(one, other)


def test_a_bent_line_sees_what_a_straight_one_sees_half_a_degree_lower(hazy):
    """Lines of sight would bend by the wrong angle or to the wrong side."""
    bent = zones.prepare(hazy, replace(SMALL, max_orders=1, bent_lines_of_sight=True))
    straight = zones.prepare(hazy, replace(SMALL, max_orders=1, bent_lines_of_sight=False))
    azimuth = np.zeros(3)
    seen = bent.radiance(-3.0, np.array([0.5, 1.0, 10.0]), azimuth)
    high = straight.radiance(-3.0, np.array([0.5, 1.0, 10.0]), azimuth)
    # far from the horizon refraction of the line does not matter
    np.testing.assert_allclose(seen[2], high[2], rtol=0.02)
    assert np.all(np.abs(seen[0] / high[0] - 1.0) > 0.01)


def test_one_field_serves_observers_on_the_ground_in_the_air_and_in_orbit(hazy, small):
    """A field would be right for the observer it was made for alone."""
    for altitude in (8.0, 99.9):
        there = zones.prepare(hazy, SMALL, observer_altitude_km=altitude)
        np.testing.assert_array_equal(
            there.radiance(-4.0, ELEVATION, AZIMUTH),
            small.radiance(-4.0, ELEVATION, AZIMUTH, observer_altitude_km=altitude),
        )
    # the dip of the horizon from 400 km is 19.9 deg: the limb, the ground, and nothing above
    sky = small.radiance(10.0, np.array([-90.0, -45.0, -19.0, -5.0, 30.0]), 20.0, observer_altitude_km=400.0)
    assert np.all(sky[:3] > 0.0) and np.all(sky[3:] == 0.0)
    assert np.all(np.isfinite(small.radiance(90.0, np.array([-90.0, -30.0]), 0.0, observer_altitude_km=36000.0)))


def test_deep_night_is_finite_and_darker_and_darker(small):
    """Logarithms of vanishing light would give NaN or a floor."""
    sky = np.stack([small.radiance(sun, ELEVATION, AZIMUTH) for sun in (-6.0, -12.0, -18.0, -25.0, -40.0, -90.0)])
    assert np.all(np.isfinite(sky)) and np.all(sky >= 0.0)
    assert np.all(np.diff(sky.mean(axis=1), axis=0)[:4] < 0.0)


def test_only_the_zenith_range_that_the_suns_need_is_solved(hazy, small):
    """A scene's suns would be solved with all others, or with too few nodes."""
    for sun in (-8.0, 25.0):
        part = zones.prepare(hazy, SMALL, sun_elevations_deg=[sun])
        assert part.grids.nodes.zenith.nodes_rad.size < small.grids.nodes.zenith.nodes_rad.size
        np.testing.assert_allclose(
            part.radiance(sun, ELEVATION, AZIMUTH), small.radiance(sun, ELEVATION, AZIMUTH), rtol=2e-3
        )
    with pytest.raises(TwilightError, match=r"sun.elevation_deg is -10 and .* the field was solved for 25 to 25 deg"):
        part.radiance(-10.0, 10.0, 0.0)


def test_a_field_is_saved_and_loaded(hazy, small, tmp_path):
    """A file would give another sky than the field, or hide that it is broken."""
    path = tmp_path / "field.h5"
    small.save(path)
    assert os.listdir(tmp_path) == ["field.h5"]
    again = zones.load(path)
    np.testing.assert_array_equal(again.radiance(-5.0, ELEVATION, AZIMUTH), small.radiance(-5.0, ELEVATION, AZIMUTH))
    assert again.convergence == small.convergence
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(TwilightError, match=r"field\.h5: is not a whole field"):
        zones.load(path)
    with pytest.raises(TwilightError, match="there is no such file"):
        zones.load(tmp_path / "none.h5")
    with pytest.raises(TwilightError, match="the folder does not exist"):
        small.save(tmp_path / "no" / "field.h5")


def test_a_field_file_is_used_where_it_holds_this_very_field(hazy, tmp_path, monkeypatch):
    """The field of another air would be taken from a file."""
    path = tmp_path / "field.h5"
    settings = replace(SMALL, field_file=str(path))
    first = zones.prepare(hazy, settings).radiance(-5.0, ELEVATION, AZIMUTH)
    made = path.stat().st_mtime_ns
    monkeypatch.setattr("twilight.solvers.zones.solver.solve", lambda *_: pytest.fail("it was solved again"))
    np.testing.assert_array_equal(
        zones.prepare(hazy, settings, sun_elevations_deg=[-5.0]).radiance(-5.0, ELEVATION, AZIMUTH), first
    )
    assert path.stat().st_mtime_ns == made
    monkeypatch.undo()
    brighter = replace(hazy, ground_albedo=np.full(3, 0.5))
    assert np.all(zones.prepare(brighter, settings).radiance(-5.0, ELEVATION, AZIMUTH) > first)
    assert path.stat().st_mtime_ns > made


def test_one_thread_gives_the_same_bits_as_two(hazy, small):
    """The number of threads would change the sky."""
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        one = zones.prepare(hazy, SMALL).radiance(-4.0, ELEVATION, AZIMUTH)
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(one, small.radiance(-4.0, ELEVATION, AZIMUTH))


def test_wavelengths_in_blocks_do_not_know_of_each_other(hazy, small):
    """A wavelength would change with those beside it."""
    many = hazy.select(np.array([0, 0, 0, 1, 1, 1, 2, 2, 2, 2]))
    sky = zones.prepare(many, SMALL).radiance(-4.0, ELEVATION, AZIMUTH)
    # the steps along a line follow the darkest and the clearest wavelength, which are the same here
    np.testing.assert_allclose(sky[:, [0, 3, 9]], small.radiance(-4.0, ELEVATION, AZIMUTH), rtol=1e-4)


def test_no_light_is_isotropic_and_tiny():
    """Moments would be divided by a mean of zero."""
    log_mean, ratio = normalised(np.zeros((1, 1, 8)), np.zeros((1, 1, 3, 8)))
    assert np.all(np.isfinite(log_mean)) and np.all(ratio[:, :, 0] == 1.0) and np.all(ratio[:, :, 1:] == 0.0)


def test_suns_and_observers_out_of_range_are_named(hazy, small):
    """Impossible suns would be computed."""
    with pytest.raises(TwilightError, match=r"observer\.altitude_km is -1"):
        zones.prepare(hazy, SMALL, observer_altitude_km=-1.0)
    with pytest.raises(TwilightError, match=r"sun\.elevation_deg is 91"):
        small.radiance(91.0, 0.0, 0.0)


@pytest.mark.slow
def test_refinement_converges(hazy):
    """Each doubling of all densities brings the sky closer to the finest."""
    suns = (10.0, 0.0, -4.0, -9.0, -15.0)

    def sky(density):
        settings = replace(MIDDLE, altitude_density=density, zenith_density=density, step_density=0.6 * density)
        field = zones.prepare(hazy, settings)
        return np.stack([field.radiance(sun, ELEVATION, AZIMUTH) for sun in suns])

    finest = sky(2.4)
    errors = [np.percentile(np.abs(sky(d) / finest - 1.0), 95, axis=(1, 2)) for d in (0.5, 0.9, 1.6)]
    assert np.all(np.diff(errors, axis=0) < 0.0)
    assert np.all(errors[-1] < 0.01)
