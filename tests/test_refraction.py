"""Refractivity against Ciddor's own tables; bent rays against an independent integration of the ray equation."""

import math

import numpy as np
import pytest
from airs import pure_air
from bent_rays import find_sun_path, trace_ray
from scipy.integrate import solve_ivp

from twilight.atmosphere.refraction import ciddor_refractivity, haber_refractivity
from twilight.base.errors import TwilightError

RADIUS = 6371.0


@pytest.mark.parametrize(
    ("celsius", "kpa", "expected"),
    [(20, 80, 21458.0), (20, 100, 26824.4), (20, 120, 32191.6), (10, 100, 27774.7), (30, 100, 25937.2)],
)
def test_dry_air_of_ciddor_table_1(celsius, kpa, expected):
    """The index of dry air would not be Ciddor's."""
    value = ciddor_refractivity(633.0, celsius + 273.15, kpa * 10.0, 0.0, 450.0)
    assert value * 1e8 == pytest.approx(expected, abs=0.06)


@pytest.mark.parametrize(
    ("celsius", "pascal", "vapour", "co2", "expected"),
    [
        (19.526, 102094.8, 1065, 510, 27392.9),
        (19.173, 102993.0, 641, 450, 27682.4),
        (19.188, 102918.8, 706, 450, 27658.7),
        (19.532, 103603.2, 986, 600, 27802.0),
        (19.534, 103599.2, 951, 610, 27802.2),
    ],
)
def test_moist_air_of_ciddor_table_2(celsius, pascal, vapour, co2, expected):
    """The index of moist air would not be Ciddor's."""
    value = ciddor_refractivity(633.0, celsius + 273.15, pascal / 100.0, vapour / 100.0, co2)
    assert value * 1e8 == pytest.approx(expected, abs=0.1)


def saturation_vapour_pressure_hpa(t):
    """Of water over liquid water at t [K]: Ciddor 1996, after Davis 1992."""
    return 0.01 * math.exp(1.2378847e-5 * t**2 - 1.9121316e-2 * t + 33.93711047 - 6.3431645e3 / t)


@pytest.mark.parametrize(
    ("celsius", "kpa", "humidity", "expected"),
    [
        (20, 80, 0.75, 21394.0),
        (20, 120, 0.75, 32127.8),
        (40, 120, 0.75, 29941.8),
        (50, 80, 1.0, 19058.4),
        (50, 120, 1.0, 28792.4),
    ],
)
def test_extreme_air_of_ciddor_table_3(celsius, kpa, humidity, expected):
    """The index of hot and humid air would not be Ciddor's."""
    t = celsius + 273.15
    value = ciddor_refractivity(633.0, t, kpa * 10.0, humidity * saturation_vapour_pressure_hpa(t), 450.0)
    assert value * 1e8 == pytest.approx(expected, abs=0.1)


def test_ciddor_broadcasts_and_vanishes_with_pressure():
    """Vacuum would refract."""
    n = ciddor_refractivity(
        np.array([400.0, 700.0]), np.array([[220.0], [288.0], [250.0]]), np.array([[10.0], [1013.0], [0.0]])
    )
    assert n.shape == (3, 2)
    assert np.all(n[2] == 0.0)
    assert np.all(n[:2, 0] > n[:2, 1])
    # far from saturation the refractivity is proportional to density
    assert n[0, 0] / n[1, 0] == pytest.approx(10.0 / 1013.0 * 288.0 / 220.0, rel=1e-3)


def test_haber_formula_limits():
    """Haber's closed form would not have the limits that his paper states."""
    # dry, on the ground: Ciddor's standard air (15 C, 1013.25 hPa)
    wl = np.array([380.0, 550.0, 720.0])
    assert haber_refractivity(wl, 0.0) == pytest.approx(ciddor_refractivity(wl, 288.15, 1013.25, 0.0, 450.0), rel=1e-12)
    assert haber_refractivity(wl, 8.0) / haber_refractivity(wl, 0.0) == pytest.approx(math.exp(-1.0), rel=1e-12)
    # saturated: water vapour at 20 C and 13.33 hPa
    wet = haber_refractivity(wl, 0.0, 1.0)
    s = (1e3 / wl) ** 2
    assert wet == pytest.approx(1.022e-8 * (295.235 + 2.6422 * s - 0.03238 * s**2 + 0.004028 * s**3), rel=1e-12)
    mixed = haber_refractivity(wl, 0.0, 0.5)
    assert mixed == pytest.approx(0.5 * (wet + haber_refractivity(wl, 0.0)), rel=1e-12)


def test_bad_air_is_refused():
    """The index of impossible air would be computed."""
    with pytest.raises(TwilightError, match="wavelength_nm"):
        ciddor_refractivity(150.0, 288.0, 1013.0)
    with pytest.raises(TwilightError, match="pressure_hpa"):
        ciddor_refractivity(500.0, 288.0, 10.0, 11.0)
    with pytest.raises(TwilightError, match="relative_humidity"):
        haber_refractivity(500.0, 0.0, 1.5)


def standard_refractivity(z):
    """n - 1 at 550 nm of an atmosphere that cools by 6.5 K/km from 288.15 K to 11 km, then is isothermal."""
    t = np.where(z < 11.0, 288.15 - 6.5 * z, 216.65)
    p = np.where(z < 11.0, 1013.25 * (1.0 - 6.5 * np.minimum(z, 11.0) / 288.15) ** 5.2559, 0.0)
    p = np.where(z >= 11.0, 226.32 * np.exp(-(z - 11.0) / 6.3416), p)
    return ciddor_refractivity(550.0, t, p)


def test_horizontal_refraction_at_sea_level():
    """The sun on the horizon would not be lifted by about half a degree."""
    levels = np.concatenate([np.arange(0, 30, 0.5), np.arange(30, 101, 2.0)])
    # the sun seen exactly on the horizon
    path = trace_ray(pure_air(levels, standard_refractivity), 0.0, 90.0, wavelength=1)
    bending = path.geocentric_angle_deg[-1] + path.zenith_deg[-1] - 90.0
    assert 29.0 < bending * 60.0 < 35.0
    found = find_sun_path(pure_air(levels, standard_refractivity), 0.0, 90.0 + bending - 1e-4)
    assert found.apparent_zenith_deg[1] == pytest.approx(90.0, abs=2e-4)


@pytest.mark.parametrize(("altitude", "zenith"), [(0.0, 90.0), (30.0, 94.5), (10.0, 70.0), (20.0, 91.0), (5.0, 100.0)])
def test_traced_ray_against_the_ray_equation(altitude, zenith):
    """d/ds(n t) = grad n in Cartesian coordinates by a Runge-Kutta code that knows nothing of the invariant."""
    scale, k = 8.0, 1
    medium = pure_air(np.linspace(0.0, 100.0, 51), scale_km=scale)
    n0 = medium.refractivity[0, k]
    path = trace_ray(medium, altitude, zenith, wavelength=k, n_points=41)
    assert path.hits_ground == (altitude == 5.0)

    def n_of(r):
        return 1.0 + n0 * np.exp(-(r - RADIUS) / scale)

    def equation(_, y):
        r = math.hypot(y[0], y[1])
        n = n_of(r)
        g = -(n - 1.0) / scale / r
        return [y[2] / n, y[3] / n, g * y[0], g * y[1]]

    n, a = n_of(RADIUS + altitude), math.radians(zenith)
    start = [0.0, RADIUS + altitude, n * math.sin(a), n * math.cos(a)]
    s = path.length_km
    x, y, tx, ty = solve_ivp(equation, (0, s[-1]), start, t_eval=s, rtol=1e-13, atol=1e-12, method="DOP853").y
    invariant = np.abs(x * ty - y * tx)
    assert np.ptp(invariant) < 1e-10 * invariant[0]
    own = n_of(RADIUS + path.altitude_km) * (RADIUS + path.altitude_km) * np.sin(np.radians(path.zenith_deg))
    assert np.max(np.abs(own - invariant)) < 1e-10 * invariant[0]
    assert np.hypot(x, y) - RADIUS == pytest.approx(path.altitude_km, abs=5e-5)
    assert np.degrees(np.arctan2(x, y)) == pytest.approx(path.geocentric_angle_deg, abs=1e-6)


@pytest.mark.parametrize("chi", [0.0, 30.0, 88.0, 90.0, 93.0])
def test_without_refractivity_everything_is_straight(chi):
    """Rays would bend in air with n = 1."""
    medium = pure_air(np.linspace(0.0, 100.0, 21), refractivity=0.0)
    z = 20.0
    path = find_sun_path(medium, z, chi)
    assert np.all(path.bending_deg == 0.0)
    assert np.all(path.apparent_zenith_deg == pytest.approx(chi, abs=1e-12))
    ray = trace_ray(medium, z, chi, n_points=11)
    a = math.radians(chi)
    x = ray.length_km * math.sin(a)
    y = RADIUS + z + ray.length_km * math.cos(a)
    assert np.hypot(x, y) == pytest.approx(RADIUS + ray.altitude_km, rel=1e-12)
    assert np.arctan2(x, y) == pytest.approx(np.radians(ray.geocentric_angle_deg), abs=1e-12)


def test_optical_depth_of_a_grazing_ray_against_quadrature():
    """The optical depth of a grazing ray would be off."""
    from scipy.integrate import quad

    medium = pure_air(np.linspace(0.0, 100.0, 21))
    n0, k0, k = medium.refractivity[0, 1], medium.air_scattering_per_km[0, 1], 1
    p = RADIUS * (1.0 + n0)

    def integrand(v):
        z = v * v
        n = n0 * math.exp(-z / 8.0)
        dx = z * (1.0 + n) + n0 * math.expm1(-z / 8.0) * RADIUS
        x = p + dx
        return 2.0 * v * x / math.sqrt(dx * (x + p)) * k0 * math.exp(-z / 8.0)

    expected = quad(integrand, 1e-9, 10.0, epsabs=1e-12, epsrel=1e-12, limit=200)[0]
    path = trace_ray(medium, 0.0, 90.0, wavelength=k)
    assert path.optical_depth[-1] == pytest.approx(expected, rel=1e-7)


def test_sun_path_iterations_tolerance_and_shadow():
    """Haber's binary search would miss its tolerance, or light the Earth's shadow."""
    medium = pure_air(np.linspace(0.0, 100.0, 51))
    fine = find_sun_path(medium, 5.0, 91.0)
    coarse = find_sun_path(medium, 5.0, 91.0, tolerance_deg=0.1)
    assert np.all(coarse.iterations == 5)  # 2 deg halved to below 0.1 deg
    assert np.all(np.abs(coarse.bending_deg - fine.bending_deg) <= 0.1)
    assert np.all(fine.apparent_zenith_deg + fine.bending_deg == pytest.approx(91.0, abs=1e-5))
    assert np.all(np.diff(fine.bending_deg) < 0.0)  # blue is bent most
    assert not np.any(fine.in_shadow) and not np.any(fine.bounded)
    dark = find_sun_path(medium, 0.0, 91.0)
    assert np.all(dark.in_shadow) and np.all(np.isinf(dark.optical_depth))
    lit = find_sun_path(medium, 0.0, 90.6)
    assert not np.any(lit.in_shadow)
    assert np.all(find_sun_path(medium, 0.0, 180.0).in_shadow)
    assert np.all(find_sun_path(medium, 0.0, 0.0).bending_deg == 0.0)


def test_duct_is_bounded():
    """dn/dh = -4e-4/km below -1/r = -1.57e-4/km between 0.5 and 0.6 km: finite answers, no endless loop."""
    levels = np.array([0.0, 0.5, 0.6, 2.0, 10.0, 50.0, 100.0])
    values = np.array([2.8e-4, 2.65e-4, 2.25e-4, 2.0e-4, 8.0e-5, 5.0e-7, 0.0])
    medium = pure_air(levels, lambda z: np.interp(z, levels, values))
    for altitude in (0.0, 0.3, 0.55, 0.6, 1.0, 20.0):
        for chi in (0.0, 60.0, 89.0, 89.9, 90.0, 90.3, 91.0, 95.0, 180.0):
            path = find_sun_path(medium, altitude, chi)
            assert np.all(np.isfinite(path.bending_deg)) and np.all(path.iterations <= 80)
            assert np.all(path.bending_deg >= 0.0)
            assert np.all((path.optical_depth >= 0.0) | path.in_shadow)
    with pytest.raises(TwilightError, match="duct"):
        trace_ray(medium, 0.55, 90.0)


def test_bad_geometry_is_refused():
    """A sun or altitude that cannot be would be traced."""
    medium = pure_air([0.0, 100.0])
    with pytest.raises(TwilightError, match="sun_zenith_deg"):
        find_sun_path(medium, 0.0, 190.0)
    with pytest.raises(TwilightError, match="altitude_km"):
        find_sun_path(medium, -1.0, 10.0)
    with pytest.raises(TwilightError, match="altitude_km"):
        trace_ray(medium, 200.0, 10.0)
