"""Polarised light in the zones solver: harmonics against brute force, published Stokes vectors, symmetries, limits."""

from dataclasses import replace
from pathlib import Path

import iprt
import numpy as np
import pytest
from hazy_zones import AZIMUTH, ELEVATION, REFERENCE, SMALL, read_table

from twilight.atmosphere.medium_table import medium_from_table
from twilight.base.errors import TwilightError
from twilight.numerics.phase import rayleigh_matrix
from twilight.solvers import zones
from twilight.solvers.zones.angles import (
    even_harmonics,
    make_angles,
    scattering_geometry,
    spin2_degrees_and_orders,
    spin2_harmonics,
)
from twilight.transport.scaling import wigner_d

STRAIGHT = replace(zones.QUALITIES["standard"], refraction=False, bent_lines_of_sight=False, bent_paths=False)


def frame(cosine, azimuth):
    """Directions and, normal to them, the unit vectors upwards and to the right, each (..., 3)."""
    sine = np.sqrt(1.0 - cosine**2)
    level = np.zeros_like(azimuth)
    return (
        np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], -1),
        np.stack([-cosine * np.cos(azimuth), -cosine * np.sin(azimuth), sine], -1),
        np.stack([-np.sin(azimuth), np.cos(azimuth), level], -1),
    )


def scattered_by_rotations(matrix, field, weight, here, there) -> np.ndarray:
    """I, Q, U that a phase matrix sends `there` from a field (3, N) in directions `here`, by geometry alone.

    The incoming light is turned into the scattering plane, multiplied, and turned into the vertical plane.
    """
    (d, v, h), (d0, v0, h0) = here, there
    p11, p12, p22, p33 = matrix(d @ d0)
    square = (v @ d0) ** 2 + (h @ d0) ** 2
    c, s = (v @ d0) / np.sqrt(square), (h @ d0) / np.sqrt(square)
    q = field[1] * (c * c - s * s) + field[2] * 2 * s * c
    u = field[2] * (c * c - s * s) - field[1] * 2 * s * c
    across = -s[:, None] * v + c[:, None] * h
    c0, s0 = (d @ v0) / np.sqrt(square), (d @ h0) / np.sqrt(square)
    across0 = -s0[:, None] * v0 + c0[:, None] * h0
    # the vector in the plane is turned round on the way, the one across the plane stays as it is
    u_out = -p33 * u * np.sign(np.sum(across * across0, axis=1))
    i_out, q_out = p11 * field[0] + p12 * q, p12 * field[0] + p22 * q
    cos_two, sin_two = c0 * c0 - s0 * s0, 2 * s0 * c0
    return np.array(
        [
            np.sum(weight * i_out),
            np.sum(weight * (q_out * cos_two - u_out * sin_two)),
            np.sum(weight * (q_out * sin_two + u_out * cos_two)),
        ]
    )


def test_scattering_keeps_every_spin2_harmonic_and_multiplies_it_by_a_moment():
    """All rules at the head of `angles`, signs included, for a matrix of random moments and for air."""
    degree = 5
    x, w = np.polynomial.legendre.leggauss(24)
    around = np.arange(32) * 2 * np.pi / 32
    mu, azimuth = (g.ravel() for g in np.meshgrid(x, around, indexing="ij"))
    weight = np.repeat(w, 32) * 2 * np.pi / 32
    here = frame(mu, azimuth)
    mu0, azimuth0 = np.array(0.37), np.array(0.9)
    there = frame(mu0, azimuth0)
    chi, b, even, odd = np.random.default_rng(1).normal(size=(4, degree + 1))
    b[:2] = even[:2] = odd[:2] = 0.0
    norm = (2 * np.arange(degree + 1) + 1) / (4 * np.pi)

    def random_matrix(c):
        p11, p12 = (np.tensordot(norm * a, wigner_d(degree, 0, n, c), 1) for a, n in ((chi, 0), (b, 2)))
        total = np.tensordot(norm * (even + odd), wigner_d(degree, 2, 2, c), 1)
        difference = np.tensordot(norm * (even - odd), wigner_d(degree, 2, -2, c), 1)
        return p11, p12, 0.5 * (total + difference), 0.5 * (total - difference)

    delta = (1.0 - 0.03) / (1.0 + 0.015)
    of_air = np.zeros((4, degree + 1))
    of_air[:, 2] = 0.1 * delta, -3.0 / (5.0 * np.sqrt(6.0)) * delta, 0.6 * delta, 0.0
    of_air[0, 0] = 1.0
    deg, order = spin2_degrees_and_orders(degree, degree)
    harmonics = [(n, m) for m in range(degree + 1) for n in range(m, degree + 1)]
    for matrix, (chi_l, b_l, even_l, odd_l) in (
        (random_matrix, (chi, b, even, odd)),
        (lambda c: rayleigh_matrix.py_func(c, 0.03), of_air),
    ):
        for k, (n, m) in enumerate(zip(deg, order, strict=True)):
            y, (e, o) = (
                even_harmonics(mu, degree, degree)[:, harmonics.index((n, m))],
                spin2_harmonics(mu, degree, degree),
            )
            y0 = even_harmonics(mu0[None], degree, degree)[0, harmonics.index((n, m))] * np.cos(m * azimuth0)
            e0, o0 = (part[0, k] for part in spin2_harmonics(mu0[None], degree, degree))
            cos, sin = np.cos(m * azimuth), np.sin(m * azimuth)
            cos0, sin0 = np.cos(m * azimuth0), np.sin(m * azimuth0)
            none = 0 * mu
            for field, expected in (
                ([y * cos, none, none], [chi_l[n] * y0, b_l[n] * e0 * cos0, b_l[n] * o0 * sin0]),
                ([none, e[:, k] * cos, o[:, k] * sin], [b_l[n] * y0, even_l[n] * e0 * cos0, even_l[n] * o0 * sin0]),
                ([none, o[:, k] * cos, e[:, k] * sin], [0.0, odd_l[n] * o0 * cos0, odd_l[n] * e0 * sin0]),
            ):
                got = scattered_by_rotations(matrix, np.array(field), weight, here, there)
                np.testing.assert_allclose(got, expected, atol=1e-12)


def test_moments_of_a_spin2_harmonic_are_its_own():
    """A spin-2 moment would hold light of another degree."""
    angles = make_angles(np.array([0.0, -0.1]), 24, 10, 8, 6)
    n = angles.spin2_degree.size
    assert n == spin2_degrees_and_orders(6, 6)[0].size
    even, odd = spin2_harmonics(angles.cosine[1], 6, 6)
    cos, sin = (f(angles.spin2_order[:, None] * angles.azimuth) for f in (np.cos, np.sin))
    q = np.concatenate([even.T[:, :, None] * cos[:, None], odd.T[:, :, None] * cos[:, None]])
    u = np.concatenate([odd.T[:, :, None] * sin[:, None], even.T[:, :, None] * sin[:, None]])
    gram = np.einsum("cma,dma->cd", angles.spin2_analysis[1][:, 0], q)
    gram += np.einsum("cma,dma->cd", angles.spin2_analysis[1][:, 1], u)
    # B of order 0 does not exist
    present = np.concatenate([np.ones(n), angles.spin2_order > 0])
    np.testing.assert_allclose(gram, np.diag(present), atol=5e-3)


def test_sunlight_scattered_once_vibrates_across_the_plane_of_scattering():
    """Degree and angle in closed form, all over the sky, in the zenith, on the sun and opposite to it."""
    pure = medium_from_table(REFERENCE / "pure-air.csv")
    field = zones.prepare(pure, replace(STRAIGHT, max_orders=1))
    elevation = np.append(ELEVATION, [90.0, 90.0, 20.0, 20.001])
    azimuth = np.append(AZIMUTH, [0.0, -70.0, 0.0, -1.0])
    for sun in (20.0, -4.0):
        stokes = field.stokes(sun, elevation, azimuth)
        s = np.array([np.cos(np.radians(sun)), 0.0, np.sin(np.radians(sun))])
        e, a = np.radians(elevation), np.radians(azimuth)
        d, v, h = frame(np.sin(e), a)
        p11, p12, _, _ = rayleigh_matrix.py_func((d @ s)[:, None], pure.depolarisation)
        square = np.maximum((v @ s) ** 2 + (h @ s) ** 2, 1e-30)
        for k, turn in ((1, (v @ s) ** 2 - (h @ s) ** 2), (2, 2.0 * (v @ s) * (h @ s))):
            expected = p12 / p11 * (turn / square)[:, None]
            lit = stokes[:, 0] > 0
            assert lit.mean() > 0.7
            np.testing.assert_allclose((stokes[:, k] / np.where(lit, stokes[:, 0], 1.0))[lit], expected[lit], atol=1e-6)


def compare_with_iprt(case: str, rows: np.ndarray, depolarisation: float):
    """Relative errors of I, and errors of Q/I and U/I, at rows of a case, (rows, 3)."""
    air = iprt.medium(case, depolarisation)
    field = zones.prepare(air, STRAIGHT)
    out = np.empty((rows.size, 3))
    for altitude in np.unique(rows["altitude_km"]):
        here = rows["altitude_km"] == altitude
        some = rows[here]
        got = field.stokes(
            90.0 - some["sza_deg"][0],
            90.0 - some["vza_deg"],
            iprt.azimuth_from_sun_deg(some),
            observer_altitude_km=float(altitude),
        )[:, :, 0]
        out[here] = np.stack(
            [
                got[:, 0] / some["I"] - 1.0,
                *(got[:, k] / got[:, 0] - some[n] / some["I"] for k, n in ((1, "Q"), (2, "U"))),
            ],
            axis=1,
        )
    return out


IPRT_I = 6e-3
"""Relative error of I that is allowed: the steps of `standard` in an optical depth of 0.5 are seen in it."""
IPRT_QU = 2.5e-3
"""Error of Q/I and U/I that is allowed."""


@pytest.mark.parametrize(("case", "depolarisation"), [("a1", 0.03), ("a1", 0.1), ("a2", 0.03)])
def test_published_stokes_vectors_of_a_layer_of_air(case, depolarisation):
    """A dozen directions of IPRT, from below and above, over a black and over a Lambertian ground."""
    rows = iprt.results(case)
    rows = rows[np.isclose(rows["depol"], depolarisation)]
    error = np.abs(compare_with_iprt(case, rows[:: rows.size // 12], depolarisation))
    assert error[:, 0].max() < IPRT_I
    assert error[:, 1:].max() < IPRT_QU


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "depolarisation"), [("a1", 0.0), ("a1", 0.03), ("a1", 0.1), ("a2", 0.03), ("b1", 0.03), ("b2", 0.03)]
)
def test_published_stokes_vectors(case, depolarisation):
    """60 to 80 directions of each case of IPRT: I, Q or U would be off somewhere, or in layers that absorb."""
    rows = iprt.results(case)
    rows = rows[np.isclose(rows["depol"], depolarisation)]
    error = np.abs(compare_with_iprt(case, rows, depolarisation))
    assert np.median(error[:, 0]) < 0.6 * IPRT_I and error[:, 0].max() < IPRT_I
    assert np.percentile(error[:, 1:], 95) < 0.75 * IPRT_QU and error[:, 1:].max() < IPRT_QU


@pytest.fixture(scope="module")
def air():
    return medium_from_table(REFERENCE / "hazy-air.csv")


@pytest.fixture(scope="module")
def small(air):
    return zones.prepare(air, SMALL)


def test_left_and_right_of_the_sun_are_mirror_images_and_the_zenith_has_one_light(small):
    """U would have the same sign on both sides, or the zenith two lights."""
    right, left = small.stokes(5.0, ELEVATION, AZIMUTH), small.stokes(5.0, ELEVATION, -AZIMUTH)
    np.testing.assert_allclose(left * np.array([1.0, 1.0, -1.0])[:, None], right, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(small.radiance(5.0, ELEVATION, AZIMUTH), right[:, 0], rtol=1e-6)
    azimuth = np.array([0.0, 30.0, 90.0, 215.0])
    zenith = small.stokes(5.0, np.full(4, 90.0), azimuth)
    np.testing.assert_allclose(zenith[:, 0], zenith[:1, 0].repeat(4, axis=0), rtol=1e-5)
    # across the plane through the sun, whatever vertical plane it is counted from
    two = 2.0 * np.radians(azimuth)[:, None]
    np.testing.assert_allclose(zenith[:, 1], zenith[0, 1] * np.cos(two), atol=1e-5 * zenith[0, 0].max())
    np.testing.assert_allclose(zenith[:, 2], zenith[0, 1] * np.sin(two), atol=1e-5 * zenith[0, 0].max())
    assert np.all(zenith[0, 1] < -0.3 * zenith[0, 0])


def test_a_sun_in_the_zenith_polarises_along_circles(small):
    """Light would vibrate in a plane that the symmetry forbids."""
    stokes = small.stokes(90.0, np.full(6, 25.0), np.linspace(0.0, 300.0, 6))
    np.testing.assert_allclose(stokes[:, 0], stokes[:1, 0].repeat(6, axis=0), rtol=1e-4)
    np.testing.assert_allclose(stokes[:, 2], 0.0, atol=1e-4 * stokes[:, 0].max())
    assert np.all(stokes[:, 1] < 0.0)


def test_henyey_greenstein_aerosol_without_air_leaves_light_unpolarised(air):
    """Particles without polarisation would polarise."""
    bare = replace(air, air_scattering_per_km=np.zeros_like(air.air_scattering_per_km))
    assert not any(np.any(phase.ratios) for phase in bare.phase_functions)
    stokes = zones.prepare(bare, SMALL, sun_elevations_deg=[10.0]).stokes(10.0, ELEVATION, AZIMUTH)
    assert stokes[:, 0].min() > 0.0
    np.testing.assert_allclose(stokes[:, 1:], 0.0, atol=1e-9 * stokes[:, 0].max())


def test_no_light_is_more_polarised_than_fully(small):
    """Q and U would exceed I."""
    for sun in (60.0, 5.0, -4.0, -9.0):
        stokes = small.stokes(sun, ELEVATION, AZIMUTH)
        assert np.all(np.hypot(stokes[:, 1], stokes[:, 2]) < stokes[:, 0])


def test_a_scalar_field_has_no_stokes_parameters(air):
    """A scalar field would answer with zeros."""
    field = zones.prepare(air, replace(SMALL, polarisation=False, max_orders=1))
    with pytest.raises(TwilightError, match=r"solver\.polarisation is false"):
        field.stokes(10.0, 20.0, 30.0)
    with pytest.raises(TwilightError, match="polarisation_degree"):
        replace(SMALL, polarisation_degree=20)


def test_standard_is_the_polarised_reference_within_its_noise():
    """I, Q, U of clear refracted air from Monte-Carlo with every leg bent (benchmarks/polarisation.py stored)."""
    table = read_table(Path(__file__).parents[1] / "data" / "stokes_pure_air.csv")
    suns = np.unique(table["sun_elevation_deg"])
    medium = medium_from_table(REFERENCE / "pure-air.csv")
    field = zones.prepare(medium, zones.QUALITIES["standard"], sun_elevations_deg=suns)
    for sun in suns:
        some = table[table["sun_elevation_deg"] == sun]
        place = np.searchsorted(field.medium.wavelength_nm, some["wavelength_nm"])
        ours = field.stokes(sun, some["elevation_deg"], some["azimuth_deg"])[np.arange(some.size), :, place]
        noise = np.median(some["i_error"] / some["i"])
        error = ours[:, 0] / some["i"] - 1.0
        assert abs(error.mean()) < 3e-3
        assert np.sqrt(np.mean(error**2)) < 3e-3 + 1.5 * noise
        for k, name in ((1, "q"), (2, "u")):
            z = (ours[:, k] / ours[:, 0] - some[name] / some["i"]) * some["i"] / some[name + "_error"]
            # 45 values: chi square per value of noise alone is below 1.5 in 98 of 100 tables
            assert np.mean(z**2) < 2.0


def test_rotation_where_sun_and_line_of_sight_are_one():
    """Towards the sun the scattering plane would be NaN."""
    along, cos_two, sin_two = scattering_geometry(np.array([0.5, -0.5]), np.array([1.0, -1.0]), np.zeros(2), np.pi / 3)
    np.testing.assert_allclose(along, [1.0, -1.0], atol=1e-12)
    np.testing.assert_array_equal([cos_two, sin_two], np.zeros((2, 2)))
