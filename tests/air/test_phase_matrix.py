"""Phase matrices: air in closed form, spheres against an independent Mie sum, mixtures, tables."""

import numpy as np
import pytest
from scipy.special import spherical_jn, spherical_yn

from twilight.atmosphere import mie, opac
from twilight.atmosphere.aerosols import mixture_optics
from twilight.base.errors import TwilightError
from twilight.numerics.phase import PhaseFunction, rayleigh_matrix, rayleigh_phase, table_angles_rad

ANGLES_DEG = np.array([0.0, 12.0, 47.0, 90.0, 118.0, 140.0, 163.0, 180.0])


def test_the_matrix_of_air_is_that_of_a_depolarising_dipole():
    """P11 is the phase function; at a right angle light is polarised by (1 - rho)/(1 + rho) across the plane."""
    rho = 0.03
    c = np.cos(np.radians(ANGLES_DEG))
    p11, p12, p22, p33 = rayleigh_matrix.py_func(c, rho)
    np.testing.assert_allclose(p11, rayleigh_phase.py_func(c, rho), rtol=1e-14)
    np.testing.assert_allclose(p12[3] / p11[3], -(1 - rho) / (1 + rho), rtol=1e-12)
    np.testing.assert_allclose([p12[0], p12[-1]], 0.0, atol=1e-16)
    # without depolarisation fully polarised light stays so at every angle
    p11, p12, p22, p33 = rayleigh_matrix.py_func(c, 0.0)
    np.testing.assert_allclose(p22, p11, rtol=1e-14)
    np.testing.assert_allclose(p12**2 + p33**2, p11**2, rtol=1e-12)


def textbook_sphere(m: complex, x: float, angle_rad: np.ndarray) -> np.ndarray:
    """S11, S12, S33, S34 of one sphere of index n + ik by Bohren & Huffman's eq. 4.53, 4.74 and 4.77."""
    last = int(x + 4 * x ** (1 / 3) + 12)
    n = np.arange(1, last + 1)

    def psi(z):
        j, slope = spherical_jn(n, z), spherical_jn(n, z, derivative=True)
        return z * j, j + z * slope

    (p, dp), (q, dq) = psi(x), psi(m * x)
    y, slope = spherical_yn(n, x), spherical_yn(n, x, derivative=True)
    xi, dxi = p + 1j * x * y, dp + 1j * (y + x * slope)
    a = (m * q * dp - p * dq) / (m * q * dxi - xi * dq)
    b = (q * dp - m * p * dq) / (q * dxi - m * xi * dq)
    mu = np.cos(angle_rad)
    s1, s2 = np.zeros((2, mu.size), dtype=complex)
    before, here = np.zeros_like(mu), np.ones_like(mu)
    for k in n:
        tau = k * mu * here - (k + 1) * before
        factor = (2 * k + 1) / (k * (k + 1))
        s1 += factor * (a[k - 1] * here + b[k - 1] * tau)
        s2 += factor * (a[k - 1] * tau + b[k - 1] * here)
        before, here = here, ((2 * k + 1) * mu * here - (k + 1) * before) / k
    cross = s2 * s1.conj()
    one, two = np.abs(s1) ** 2, np.abs(s2) ** 2
    return np.stack([0.5 * (one + two), 0.5 * (two - one), cross.real, cross.imag])


@pytest.mark.parametrize("index", [1.5 + 0.01j, 1.33 + 0j])
def test_matrix_of_spheres_against_an_independent_mie_sum(index):
    """The matrix of spheres would differ from an independent sum of Mie's series."""
    size = mie.LogNormal(0.12, 1.4, 0.005, 0.9)
    wavelength_nm = 500.0
    nodes = np.searchsorted(np.degrees(table_angles_rad(mie.N_ANGLES)), ANGLES_DEG - 1e-9)
    angle = table_angles_rad(mie.N_ANGLES)[nodes]
    radii, weights = mie.radius_grid(size, index, wavelength_nm * 1e-3)
    total = sum(
        w * textbook_sphere(index, 2e3 * np.pi * r / wavelength_nm, angle) for r, w in zip(radii, weights, strict=True)
    )
    row = mie.compute_optics(size, index, wavelength_nm)
    ours = row[3:].reshape(4, -1)[:, nodes]
    np.testing.assert_allclose(np.exp(ours[0]) / np.exp(ours[0, 3]), total[0] / total[0, 3], rtol=1e-5)
    np.testing.assert_allclose(ours[1:], total[1:] / total[0], atol=3e-5)


@pytest.mark.parametrize("component, humidity", opac.populations())
def test_matrix_of_every_component_is_possible(component, humidity):
    """Forwards spheres change nothing, backwards they mirror; a matrix makes no light more polarised than fully."""
    size, index = opac.particles(component, humidity, [380.0, 550.0, 720.0])
    got = mie.particle_optics(size, index, [380.0, 550.0, 720.0])
    p12, p22, p33, p34 = got.ratios
    assert np.all(p22 == 1.0)
    assert np.all(p12**2 + p33**2 + p34**2 <= 1.0 + 1e-4)
    np.testing.assert_allclose(p12[:, [0, -1]], 0.0, atol=1e-4)
    np.testing.assert_allclose(p34[:, [0, -1]], 0.0, atol=1e-4)
    np.testing.assert_allclose(p33[:, 0], 1.0, atol=1e-4)
    np.testing.assert_allclose(p33[:, -1], -1.0, atol=1e-4)


def test_mixtures_average_elements_not_ratios():
    """Two components weighted with what they scatter, at every angle."""
    numbers = {"waso": 4000.0, "inso": 0.4}
    mixed = mixture_optics(numbers, 0.0, [550.0]).phase
    elements, total = np.zeros((4, mie.N_ANGLES)), np.zeros(mie.N_ANGLES)
    for name, number in numbers.items():
        size, index = opac.particles(name, 0.0, [550.0])
        one = mie.particle_optics(size, index, [550.0])
        p11 = number * one.scattering_per_km * np.exp(one.log_phase[0])
        elements += p11 * one.ratios[:, 0]
        total += p11
    np.testing.assert_allclose(mixed.ratios[:, 0], elements / total, atol=1e-12)
    assert np.ptp(mixed.ratios[0, 0]) > 0.05
    values = mixed.matrix(np.cos(table_angles_rad(mie.N_ANGLES)))
    np.testing.assert_allclose(values[1, 0], elements[0] / total * values[0, 0], atol=1e-9)
    np.testing.assert_allclose(values[0], mixed(np.cos(table_angles_rad(mie.N_ANGLES))), rtol=1e-13)


def test_tables_give_their_own_matrix_and_henyey_greenstein_has_none():
    """A table would lose its polarisation, or a formula would invent one."""
    angle = np.linspace(0.0, np.pi, 721)
    p11, p12, p22, p33 = rayleigh_matrix.py_func(np.cos(angle), 0.1)
    table = PhaseFunction.from_samples(
        angle, p11[None], p12_ratio=p12 / p11, p22_ratio=p22 / p11, p33_ratio=(p33 / p11)[None]
    )
    c = np.linspace(-1, 1, 33)
    np.testing.assert_allclose(table.matrix(c)[:, 0], rayleigh_matrix.py_func(c, 0.1), atol=2e-5)
    assert np.any(table.ratios) and np.any(table.select(slice(0, 1)).ratios)
    plain = PhaseFunction.henyey_greenstein([0.6, 0.7])
    assert not np.any(plain.ratios)
    np.testing.assert_array_equal(plain.matrix(c)[0], plain(c))
    assert not np.any(plain.matrix(c)[1:])
    assert not np.any(PhaseFunction.from_samples(angle, p11[None]).ratios)
    with pytest.raises(TwilightError, match="both p12_ratio and p33_ratio"):
        PhaseFunction.from_samples(angle, p11[None], p12_ratio=p12 / p11)
    with pytest.raises(TwilightError, match="between -1 and 1"):
        PhaseFunction.from_samples(angle, p11[None], p12_ratio=3 * p12 / p11, p33_ratio=p33 / p11)
