"""The table of the direct sun beam against rays traced one by one, closed forms and the flux it must carry."""

import math
from dataclasses import replace

import numpy as np
import pytest
from airs import pure_air
from scipy.integrate import solve_ivp

from twilight.transport.beam import Beam, BeamNodes, beam_at, beam_at_one, prepare_beam
from twilight.transport.ray_profile import ray_profile, refractivity_at
from twilight.transport.rays import OUTSIDE, outward, sun_ray

RADIUS = 6371.0
LEVELS = np.linspace(0.0, 100.0, 51)


def hazy(refractivity=2.8e-4):
    """Air with an aerosol layer that ends at 2 km and a thinner one above: the sharpest thing in an OPAC column."""
    levels = np.sort(np.append(LEVELS, 2.0))
    upper = int(np.flatnonzero(levels == 2.0)[1])
    aerosol = np.where(np.arange(levels.size) < upper, 0.08, 0.004) * np.exp(-levels / 8.0)
    medium = pure_air(levels, refractivity)
    return replace(medium, aerosol_extinction_per_km=np.repeat(aerosol[:, None], 3, axis=1))


def look_up(beam: Beam, altitude_km, chi_deg):
    out = np.full(beam.n_wavelengths, np.nan)
    bending = beam_at(beam, altitude_km, math.cos(math.radians(chi_deg)), out)
    return out, bending


def traced(profile, w, altitude_km, chi):
    """Irradiance by a bisection for the apparent direction and a finite difference for the spreading."""
    n = 1.0 + refractivity_at(profile, w, altitude_km)
    x = (RADIUS + altitude_km) * n

    def true_angle(i):
        bending, tau, _ = sun_ray(profile, w, altitude_km, x * math.cos(i), True)
        return i + bending, tau

    low, high = max(0.0, chi - 0.06), chi
    for _ in range(55):
        middle = 0.5 * (low + high)
        if true_angle(middle)[0] > chi:
            high = middle
        else:
            low = middle
    i = 0.5 * (low + high)
    if sun_ray(profile, w, altitude_km, x * math.cos(i), False)[2] != OUTSIDE:
        return 0.0
    h = 2e-5
    widening = (true_angle(i + h)[0] - true_angle(i - h)[0]) / (2.0 * h)
    return math.exp(-true_angle(i)[1]) * n * n * math.sin(i) / math.sin(chi) / widening


def random_points(rng, count, refracting):
    for _ in range(count):
        z = 100.0 * rng.random() ** 2
        edge = math.pi / 2 + math.acos(RADIUS / (RADIUS + z)) + (0.022 if refracting else 0.0)
        yield z, edge - (0.25 * rng.random() ** 2 if rng.random() < 0.6 else (edge - 0.01) * rng.random())


@pytest.mark.parametrize("refraction", [True, False])
def test_table_against_traced_rays(refraction):
    """The table of the sunbeam would be off rays traced one by one."""
    medium = hazy()
    beam, profile = prepare_beam(medium, refraction=refraction), ray_profile(medium, refraction=refraction)
    errors = []
    for z, chi in random_points(np.random.default_rng(7), 150, refraction):
        for w in range(3):
            expected = traced(profile, w, z, chi)
            beyond = traced(profile, w, z, chi + math.radians(0.02))
            value, _ = beam_at_one(beam, z, math.cos(chi), w)
            if expected > 1e-6 and beyond > 0.0:
                errors.append(abs(value / expected - 1.0))
    assert len(errors) > 200
    assert np.median(errors) < 1e-4
    assert np.percentile(errors, 95) < 1e-3
    assert np.max(errors) < 1e-2


def test_straight_beam_is_the_transmittance_with_no_bending():
    """Straight light would bend, or lose another fraction than the column's."""
    beam = prepare_beam(pure_air(LEVELS, refractivity=0.0))
    # above the scale of the air the column is the vertical one times 1/cos
    out, bending = look_up(beam, 0.0, 0.0)
    tau = pure_air(LEVELS, refractivity=0.0).optical_depth()
    assert bending == 0.0
    assert out == pytest.approx(np.exp(-tau), rel=1e-6)
    transparent = prepare_beam(pure_air(LEVELS, refractivity=0.0, scattering=0.0))
    for z, chi in random_points(np.random.default_rng(1), 100, False):
        out, bending = look_up(transparent, z, math.degrees(chi))
        assert bending == 0.0
        assert np.all(out == pytest.approx(1.0, abs=1e-12))


def test_flux_through_spheres_inside_transparent_air():
    """The beam that enters a sphere of radius r inside the air carries F0 pi (n r)^2."""
    medium = pure_air(LEVELS, scattering=0.0)
    beam, profile = prepare_beam(medium), ray_profile(medium)
    reference = 0  # most refracted: its table is the one that is entered directly
    node, weight = np.polynomial.legendre.leggauss(200)
    for z in (0.0, 1.0, 10.0, 30.0):
        x = (RADIUS + z) * (1.0 + refractivity_at(profile, reference, z))
        edge = math.pi / 2 + sun_ray(profile, reference, z, 0.0, False)[0]
        chi = 0.5 * edge * (1.0 + node)
        pairs = [beam_at_one(beam, z, math.cos(c), reference) for c in chi]
        normal = np.array([e * math.cos(c - b) for (e, b), c in zip(pairs, chi, strict=True)])
        flux = np.sum(0.5 * edge * weight * normal * np.sin(chi)) * 2.0 * math.pi * (RADIUS + z) ** 2
        assert flux == pytest.approx(math.pi * x * x, rel=5e-5)


def test_spreading_restores_the_thin_zenith():
    """Zenith of thin air in single scattering, refracted over straight: 1.37 at -4 deg and 1.9 at -6 deg with the
    spreading of the beam, 2.26 and 4.1 without."""
    medium = pure_air(LEVELS, refractivity=2.78e-4, scattering=1e-5, wavelengths=(550.0,))
    z = np.linspace(0.0, 100.0, 2001)

    def zenith(elevation, **settings):
        beam = prepare_beam(medium, **settings)
        c = math.sin(math.radians(elevation))
        return np.trapezoid([beam_at_one(beam, h, c, 0)[0] * math.exp(-h / 8.0) for h in z], z)

    for elevation, spread, unspread in ((-4.0, 1.37, 2.26), (-6.0, 1.9, 4.1)):
        straight = zenith(elevation, refraction=False)
        assert zenith(elevation) / straight == pytest.approx(spread, rel=0.02)
        assert zenith(elevation, spreading=False) / straight == pytest.approx(unspread, rel=0.03)


def test_edge_of_the_shadow():
    """The Earth's shadow would begin elsewhere."""
    medium = pure_air(LEVELS)
    beam, profile = prepare_beam(medium), ray_profile(medium)
    for z in (0.0, 0.5, 3.0, 20.0, 80.0):
        x = (RADIUS + z) * (1.0 + refractivity_at(profile, 0, z))
        p = RADIUS * (1.0 + refractivity_at(profile, 0, 0.0))
        u = -math.sqrt(max(0.0, (x - p) * (x + p)))
        edge = math.acos(u / x) + sun_ray(profile, 0, z, u, True)[0]
        lit, _ = look_up(beam, z, math.degrees(edge) - 0.005)
        dark, _ = look_up(beam, z, math.degrees(edge) + 0.005)
        assert lit[0] > 0.0
        assert np.all(dark == 0.0)


def through_the_limb(medium, w, impact_km, altitude_km):
    """A ray of the parallel beam by Runge-Kutta steps of d/ds(n t) = grad n, which knows nothing of the invariant.

    Returns where it crosses the sphere at `altitude_km` on its way out: angle from the sun [rad], cosine of incidence,
    optical depth, and its lowest altitude [km].
    """
    scale, n0, k0 = 8.0, medium.refractivity[0, w], medium.extinction_per_km[0, w]

    def equation(_, y):
        r = math.hypot(y[0], y[1])
        thin = math.exp(-(r - RADIUS) / scale)
        n = 1.0 + n0 * thin
        g = -n0 * thin / scale / r
        return [y[2] / n, y[3] / n, g * y[0], g * y[1], k0 * thin]

    def leaves(_, y):
        return math.hypot(y[0], y[1]) - RADIUS - altitude_km if y[0] * y[2] + y[1] * y[3] > 0.0 else -1.0

    def turns(_, y):
        return y[0] * y[2] + y[1] * y[3]

    leaves.terminal = True
    start = [-1300.0, impact_km, 1.0, 0.0, 0.0]
    events = [leaves, turns]
    way = solve_ivp(equation, (0, 4000.0), start, events=events, rtol=1e-11, atol=1e-11, max_step=60.0, method="DOP853")
    x, y, tx, ty, tau = way.y[:, -1]
    r, t = math.hypot(x, y), math.hypot(tx, ty)
    lowest = math.hypot(*way.y_events[1][0][:2]) - RADIUS
    return math.atan2(y, -x), (x * tx + y * ty) / (r * t), tau, lowest


def test_irradiance_behind_the_limb_and_the_shadow_against_the_ray_equation():
    """Flux b db of a thin annulus of the beam, spread over r^2 sin(theta) dtheta cos(i), times its transmittance."""
    medium = pure_air(LEVELS)
    beam, w = prepare_beam(medium), 0  # the most refracted wavelength, at which light ends at the solid Earth
    for altitude in (20.0, 60.0):
        r = RADIUS + altitude
        for impact in (RADIUS + 6.0, RADIUS + 14.0):
            theta, cosine, tau, _ = through_the_limb(medium, w, impact, altitude)
            near, far = (through_the_limb(medium, w, impact + d, altitude)[0] for d in (-0.05, 0.05))
            expected = impact * 0.1 / (r * r * math.sin(theta) * (near - far) * cosine) * math.exp(-tau)
            found, bending = beam_at_one(beam, altitude, math.cos(theta), w)
            assert found == pytest.approx(expected, rel=3e-3)
            assert theta - bending == pytest.approx(math.pi - math.acos(cosine), abs=3e-6)
        # the ray that touches the ground
        low, high = RADIUS, RADIUS + 5.0
        for _ in range(22):
            middle = 0.5 * (low + high)
            touching = through_the_limb(medium, w, middle, altitude)
            low, high = (middle, high) if touching[3] < 0.0 else (low, middle)
        edge = touching[0]
        assert beam_at_one(beam, altitude, math.cos(edge - 2e-5), w)[0] > 0.0
        assert beam_at_one(beam, altitude, math.cos(edge + 2e-5), w)[0] == 0.0


def test_no_altitude_in_the_light_is_dark():
    """0.3 deg beyond the geometric edge the refracted sun is up at every altitude, whatever rounding does."""
    for shift in (0.0, 1e-3, 0.017, 0.31):
        levels = np.concatenate([LEVELS[:1], LEVELS[1:] + shift])
        beam = prepare_beam(pure_air(levels), nodes=BeamNodes(cosine=10, distance=8))
        for z in np.linspace(0.0, 99.9, 3000):
            chi = math.pi / 2 + math.acos(RADIUS / (RADIUS + z)) + math.radians(0.3)
            assert beam_at_one(beam, z, math.cos(chi), 0)[0] > 0.0, (shift, z)


def test_a_ray_from_within_rounding_of_a_level_is_that_from_the_level():
    """A level hit within rounding would lose its ray."""
    profile = ray_profile(hazy())
    for level in (0.0, 2.0, 20.0):
        at_level = outward(profile, 0, level, 0.0, 1e9)
        for below in (1e-16, 1e-15, 1e-14, 1e-13, 5e-13, 2e-12):
            near = outward(profile, 0, level - below, 0.0, 1e9)
            assert near[4]
            np.testing.assert_allclose(near[:3], at_level[:3], rtol=3e-6)


def test_bending_is_positive_and_largest_for_low_suns():
    """Light would bend upwards, or an ozone filter dim the zenith alone."""
    beam = prepare_beam(pure_air(LEVELS))
    bendings = [look_up(beam, 10.0, chi)[1] for chi in (0.0, 40.0, 80.0, 88.0, 90.0, 92.0, 94.0)]
    assert bendings[0] == pytest.approx(0.0, abs=1e-8)
    assert np.all(np.diff(bendings) > 0.0)
    medium = replace(pure_air(LEVELS), overhead_absorption_optical_depth=np.array([0.0, 0.1, 2.0]))
    plain, filtered = prepare_beam(pure_air(LEVELS)), prepare_beam(medium)
    for z, chi in ((0.0, 10.0), (20.0, 92.0), (500.0, 100.0)):
        a, b = look_up(plain, z, chi)[0], look_up(filtered, z, chi)[0]
        assert b == pytest.approx(a * np.exp(-np.array([0.0, 0.1, 2.0])), rel=1e-12)


def _extreme_media():
    yield pure_air([0.0, 100.0])
    yield pure_air(np.linspace(0.0, 100.0, 500))
    yield pure_air([0.0, 100.0], refractivity=0.0, scattering=0.0)
    yield pure_air(np.linspace(0.0, 35.0, 36))
    # 10 m of haze with an optical depth of 20
    levels = np.sort(np.concatenate([LEVELS, [0.5, 0.5, 0.51, 0.51]]))
    inside = np.zeros(levels.size)
    inside[np.flatnonzero((levels >= 0.5) & (levels <= 0.51))[1:3]] = 2000.0
    base = pure_air(levels)
    yield replace(base, aerosol_extinction_per_km=np.repeat(inside[:, None], 3, axis=1))
    # ozone at 300 nm: more than 100 along the beam
    base = pure_air(LEVELS)
    ozone = 0.4 * np.exp(-(((LEVELS - 22.0) / 5.0) ** 2))
    yield replace(base, absorption_per_km=np.repeat(ozone[:, None], 3, axis=1))
    # ducts: elevated and on the ground
    levels = np.array([0.0, 0.5, 0.6, 2.0, 10.0, 50.0, 100.0])
    for values in ([2.8, 2.65, 2.25, 2.0, 0.8, 0.005, 0.0], [2.8, 2.0, 1.95, 1.8, 0.8, 0.005, 0.0]):
        yield pure_air(levels, lambda z, values=values: np.interp(z, levels, 1e-4 * np.array(values)))
    # layers of constant coefficients and index
    edges = -8.0 * np.log(1.0 - np.linspace(0.0, 1.0 - math.exp(-35.0 / 8.0), 51))
    levels = np.repeat(edges, 2)[1:-1]
    levels[0] = 0.0
    middle = np.exp(-np.repeat(0.5 * (edges[1:] + edges[:-1]), 2) / 8.0)[:, None]
    yield replace(
        pure_air(levels), air_scattering_per_km=0.0115 * middle * np.ones(3), refractivity=2.8e-4 * middle * np.ones(3)
    )


@pytest.mark.parametrize("medium", list(_extreme_media()))
def test_extremes_are_finite_and_not_negative(medium):
    """Ducts, thin layers or space would make light infinite or negative."""
    beam = prepare_beam(medium)
    altitudes = [0.0, -1.0, 1e-6, 0.505, *medium.altitude_km[:20], medium.top_km, medium.top_km + 1e-6, 400.0, 36000.0]
    out = np.empty(3)
    for z in altitudes:
        for chi in (0.0, 1e-6, 60.0, 89.0, 90.0, 90.5, 91.0, 93.0, 96.0, 100.0, 115.0, 179.9999, 180.0):
            c = math.cos(math.radians(chi))
            out[:] = np.nan
            bending = beam_at(beam, z, c, out)
            assert np.all(np.isfinite(out)) and np.all(out >= 0.0) and np.all(out < 1.5)
            assert 0.0 <= bending < 0.5
            assert beam_at_one(beam, z, c, 2) == pytest.approx((out[2], bending), rel=1e-12)
    assert np.all(look_up(beam, 0.0, 180.0)[0] == 0.0)
    if medium.top_km == 100.0:
        assert np.all(look_up(beam, 1000.0, 60.0)[0] == 1.0)


@pytest.mark.parametrize("refraction", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_terms_of_a_wavelength_share_rays_and_have_the_beam_of_each_alone(refraction):
    """Two wavelengths, two terms each, that differ in absorption: the rays of a term are those of its wavelength."""
    terms = hazy().select(np.array([0, 0, 2, 2]))
    gas = np.exp(-terms.altitude_km / 2.0)[:, None] * np.array([0.0, 0.3, 0.0, 0.02])
    index = terms.refractivity * np.array([1.0, 1.0, 0.98, 0.98])
    terms = replace(terms, absorption_per_km=terms.absorption_per_km + gas, refractivity=index)
    together = prepare_beam(terms, refraction=refraction)
    for w in range(4):
        alone = prepare_beam(terms.select(np.array([w])), refraction=refraction, laid_out_for=terms)
        for z, chi in random_points(np.random.default_rng(5), 40, refraction):
            here = look_up(together, z, math.degrees(chi))[0]
            assert here[w] == look_up(alone, z, math.degrees(chi))[0][0]
    # the gas has depths of 0.6 and 0.04
    noon = look_up(together, 0.0, 0.0)[0]
    np.testing.assert_allclose(np.log(noon[::2] / noon[1::2]), [0.6, 0.04], rtol=0.01)
