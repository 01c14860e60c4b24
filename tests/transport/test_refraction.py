"""Refractivity against Ciddor's own tables; bent rays against an independent integration of the ray equation."""

import math

import numpy as np
import pytest
from airs import pure_air
from bent_rays import trace_ray
from scipy.integrate import solve_ivp

from twilight.atmosphere.gases import ciddor_refractivity, haber_refractivity
from twilight.base.errors import TwilightError
from twilight.transport.ray_profile import ray_profile, refractivity_at
from twilight.transport.rays import TRAPPED, sun_ray

RADIUS = 6371.0


def saturation_vapour_pressure_hpa(celsius):
    """Of water over liquid water: Ciddor 1996, after Davis 1992."""
    t = celsius + 273.15
    return 0.01 * math.exp(1.2378847e-5 * t**2 - 1.9121316e-2 * t + 33.93711047 - 6.3431645e3 / t)


DRY = [(20, 800, 21458.0), (20, 1000, 26824.4), (20, 1200, 32191.6), (10, 1000, 27774.7), (30, 1000, 25937.2)]
"""Ciddor's table 1: temperature [C], pressure [hPa], 1e8 (n - 1) at 633 nm and 450 ppm of carbon dioxide."""
MOIST = [
    (19.526, 1020.948, 10.65, 510, 27392.9),
    (19.173, 1029.930, 6.41, 450, 27682.4),
    (19.188, 1029.188, 7.06, 450, 27658.7),
    (19.532, 1036.032, 9.86, 600, 27802.0),
    (19.534, 1035.992, 9.51, 610, 27802.2),
]
"""His table 2: temperature [C], pressure and vapour pressure [hPa], carbon dioxide [ppm], 1e8 (n - 1)."""
EXTREME = [(20, 800, 0.75, 21394.0), (20, 1200, 0.75, 32127.8), (40, 1200, 0.75, 29941.8), (50, 800, 1.0, 19058.4),
           (50, 1200, 1.0, 28792.4)]  # fmt: skip
"""His table 3: temperature [C], pressure [hPa], relative humidity, 1e8 (n - 1) at 450 ppm of carbon dioxide."""


@pytest.mark.parametrize(
    ("celsius", "hpa", "vapour_hpa", "co2", "expected", "tolerance"),
    [
        *((c, p, 0.0, 450, n, 0.06) for c, p, n in DRY),
        *((*row, 0.1) for row in MOIST),
        *((c, p, rh * saturation_vapour_pressure_hpa(c), 450, n, 0.1) for c, p, rh, n in EXTREME),
    ],
)
def test_air_of_ciddors_tables(celsius, hpa, vapour_hpa, co2, expected, tolerance):
    """The index of dry, moist or hot and humid air would not be Ciddor's."""
    value = ciddor_refractivity(633.0, celsius + 273.15, hpa, vapour_hpa, co2)
    assert value * 1e8 == pytest.approx(expected, abs=tolerance)


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
    path = trace_ray(pure_air(levels, standard_refractivity), 0.0, 90.0, wavelength=1)
    bending = path.geocentric_angle_deg[-1] + path.zenith_deg[-1] - 90.0
    assert 29.0 < bending * 60.0 < 35.0


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
    assert sun_ray(ray_profile(medium), 1, z, (RADIUS + z) * math.cos(math.radians(chi)), False)[0] == 0.0
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


def test_duct_is_bounded():
    """dn/dh = -4e-4/km below -1/r = -1.57e-4/km between 0.5 and 0.6 km: finite answers, no endless loop."""
    levels = np.array([0.0, 0.5, 0.6, 2.0, 10.0, 50.0, 100.0])
    values = np.array([2.8e-4, 2.65e-4, 2.25e-4, 2.0e-4, 8.0e-5, 5.0e-7, 0.0])
    medium = pure_air(levels, lambda z: np.interp(z, levels, values))
    profile = ray_profile(medium)
    for altitude in (0.0, 0.3, 0.55, 0.6, 1.0, 20.0):
        x = (RADIUS + altitude) * (1.0 + refractivity_at(profile, 1, altitude))
        for zenith in (0.0, 60.0, 89.0, 89.9, 90.0, 90.3, 91.0, 95.0, 180.0):
            bending, depth, _ = sun_ray(profile, 1, altitude, x * math.cos(math.radians(zenith)), False)
            assert 0.0 <= bending < math.pi and 0.0 <= depth < 100.0
    assert sun_ray(profile, 1, 0.55, 0.0, False)[2] == TRAPPED
