"""Monte-Carlo, Stokes vectors: published polarised radiances of flat layers, single scattering by hand, the ground.

Published radiances of the intercomparison IPRT (Emde et al. 2015) are in tests/data/iprt.
"""

from dataclasses import replace

import iprt
import numpy as np
import pytest
from montecarlo_media import assert_all_agree, hazy_earth

from twilight.base.errors import TwilightError
from twilight.solvers.montecarlo import MonteCarloSettings, prepare

FIXED = MonteCarloSettings(target_stderr=None, samples=1500)
SYSTEMATIC = 5e-4
"""Relative error of I that is not noise: tables of the beam, and a planet that is not quite flat."""
# depolarisation, sza, saa, vza, vaa, then the published I, Q, U with all orders: cases A1 (bottom), A2 (bottom, top)
A1 = [
    (0.03, 30.0, 0.0, 60.0, 30.0, 7.70467e-2, -5.36905e-3, 1.06249e-2),
    (0.1, 30.0, 65.0, 60.0, 30.0, 7.45508e-2, -4.27321e-3, -1.05782e-2),
]
A2 = [
    (0.03, 50.0, 0.0, 40.0, 90.0, 1.36007e-2, 3.06181e-3, 4.62481e-3),
    (0.03, 50.0, 0.0, 140.0, 30.0, 6.30839e-2, -4.91790e-3, 5.05621e-3),
]


def molecular_slab(depth, depolarisation, ground=0.0):
    """A conservative layer of air 1 km thick."""
    return iprt.layered([0.0, 1.0], [depth], [0.0], depolarisation, ground)


def stokes(field, altitude_km, sza, saa, vza, vaa):
    """`StokesResult` for the angles of the tables [deg]."""
    here = replace(field, observer_altitude_km=altitude_km)
    return here.stokes_with_error(90.0 - np.asarray(sza), 90.0 - np.asarray(vza), np.asarray(vaa) - np.asarray(saa))


def check(results, truth, noise=None):
    """z-tests of all I, Q, U together; truth (N, 3), noise (N, 3) its standard deviation."""
    value = np.concatenate([r.stokes[..., 0].reshape(-1, 3) for r in results])
    error = np.concatenate([r.standard_error[..., 0].reshape(-1, 3) for r in results])
    truth = np.asarray(truth)
    error = np.hypot(error, SYSTEMATIC * truth[:, :1])
    if noise is not None:
        error = np.hypot(error, noise)
    assert_all_agree(value, error, truth)


def test_published_stokes_vectors():
    """A dozen figures of Emde et al. 2015: fails if a sign, a rotation or P12 is wrong."""
    results, truth = [], []
    for ground, depth, rows in ((0.0, 0.5, A1), (0.3, 0.1, A2)):
        for depolarisation, sza, saa, vza, vaa, *published in rows:
            field = prepare(molecular_slab(depth, depolarisation, ground), FIXED)
            results.append(stokes(field, 0.0 if vza < 90.0 else 1.0, sza, saa, vza, vaa))
            truth.append(published)
    # noise is a part in 300 of I, so that the sign and the third digit of Q and U are tested
    assert max((r.standard_error / r.stokes[0]).max() for r in results) < 5e-3
    check(results, truth)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "depolarisation"), [("a1", 0.0), ("a1", 0.1), ("a2", 0.03), ("b1", 0.03), ("b2", 0.03)]
)
def test_intercomparison_tables(case, depolarisation):
    """60 to 80 directions of IPRT A1, A2, B1, B2: fails if a component is off by more than the noise of the mean."""
    rows = iprt.results(case)
    rows = rows[rows["depol"] == depolarisation]
    medium = iprt.medium(case, depolarisation)
    # a whole atmosphere is flat on a larger planet
    field = prepare(replace(medium, earth_radius_km=2e7 if case[0] == "b" else 2e6), replace(FIXED, samples=400))
    found, truth, noise, error = [], [], [], []
    for altitude_km, vza in sorted({(float(r["altitude_km"]), float(r["vza_deg"])) for r in rows}):
        here = rows[(rows["altitude_km"] == altitude_km) & (rows["vza_deg"] == vza)]
        r = stokes(field, altitude_km, *(here[k] for k in ("sza_deg", "saa_deg", "vza_deg", "vaa_deg")))
        found.append(r.stokes[..., 0])
        truth.append(np.stack([here[k] for k in "IQU"], axis=-1))
        noise.append(np.stack([here[f"{k}_std"] for k in "IQU"], axis=-1))
        # an estimate that is low by chance has a small error by the same chance: all azimuths share their mean square
        own = np.sqrt(np.mean(r.standard_error[..., 0] ** 2 / truth[-1][:, :1] ** 2, axis=0))
        error.append(own * truth[-1][:, :1])
    found, truth, noise, error = (np.concatenate(part) for part in (found, truth, noise, error))
    error = np.sqrt(error**2 + noise**2)
    assert error.shape[0] >= 60
    # no component is off as a whole by more than the systematic error and the noise of the mean
    weight = 1.0 / error**2
    mean = np.sum(weight * (found - truth), axis=0) / np.sum(weight, axis=0)
    systematic = SYSTEMATIC * np.sum(weight * truth[:, :1], axis=0) / np.sum(weight, axis=0)
    assert np.all(np.abs(mean) < systematic + 4.0 / np.sqrt(np.sum(weight, axis=0))), mean / systematic
    # and the scatter over directions is not more than the stated errors, the allowance for systematic ones among them
    # (which makes chi square per value less than 1 where it is the larger part), nor are these a comfortable guess
    z = (found - truth) / np.sqrt(error**2 + (SYSTEMATIC * truth[:, :1]) ** 2)
    chi_square, spread = (z**2).mean(axis=0), (z**2).std(axis=0) / np.sqrt(z.shape[0])
    assert np.all((chi_square > 0.4) & (chi_square < 1.06 + 4.0 * spread)), chi_square
    assert np.all((np.abs(z) > 4.0).mean(axis=0) < 3e-3), (np.abs(z) > 4.0).mean(axis=0)


def rayleigh_by_hand(depolarisation, sza, vza, vaa):
    """I, Q, U of unpolarised light scattered once by air, over its P11: from the vibration normal to the plane."""
    s, v, a = np.radians([sza, vza, vaa])
    sun = np.array([np.sin(s), 0.0, np.cos(s)])
    view = np.array([np.sin(v) * np.cos(a), np.sin(v) * np.sin(a), np.cos(v)])
    cosine = sun @ view
    delta = (1 - depolarisation) / (1 + depolarisation / 2)
    p11 = 0.75 * delta * (1 + cosine**2) + 1 - delta
    degree = 0.75 * delta * (1 - cosine**2) / p11
    normal = np.cross(sun, view)
    normal /= np.linalg.norm(normal)
    up = np.array([-np.cos(v) * np.cos(a), -np.cos(v) * np.sin(a), np.sin(v)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    chi = np.arctan2(normal @ right, normal @ up)
    return np.array([1.0, degree * np.cos(2 * chi), degree * np.sin(2 * chi)])


@pytest.mark.parametrize(("vza", "vaa"), [(0.0, 40.0), (60.0, 30.0), (80.0, 200.0), (30.0, 0.0), (30.0001, 0.0)])
def test_single_scattering_by_air(vza, vaa):
    """Against the vibration normal to the scattering plane: fails if the reference turns wrongly, or at the zenith."""
    field = prepare(molecular_slab(0.1, 0.03), replace(FIXED, samples=4, max_orders=1, importance_sweeps=0))
    r = stokes(field, 0.0, 30.0, 0.0, vza, vaa)
    assert np.all(r.standard_error == 0.0)
    if (vza, vaa) == (30.0, 0.0):
        # towards the sun nothing is polarised
        np.testing.assert_allclose(r.stokes[1:, 0] / r.stokes[0, 0], 0.0, atol=1e-12)
    else:
        np.testing.assert_allclose(r.stokes[:, 0] / r.stokes[0, 0], rayleigh_by_hand(0.03, 30.0, vza, vaa), atol=2e-6)


def test_ground_alone_is_unpolarised():
    """Bright Lambertian ground under almost no air: fails if its matrix keeps Q or U."""
    field = prepare(molecular_slab(1e-6, 0.03, 0.5), replace(FIXED, samples=16))
    r = stokes(field, 1.0, 50.0, 0.0, [120.0, 180.0], 70.0)
    assert np.all(np.abs(r.stokes[:, 1:, 0]) < 1e-5 * r.stokes[:, :1, 0])


@pytest.fixture(scope="module")
def earth():
    return prepare(hazy_earth(), replace(FIXED, samples=200))


def test_mirror_images(earth):
    """Left and right of the sun I, Q are the same and U changes its sign: fails if a rotation has the wrong sense."""
    # in the sun's plane U is 0
    right = earth.stokes_with_error(5.0, 40.0, [70.0, 180.0])
    left = earth.stokes_with_error(5.0, 40.0, [-70.0, -180.0])
    error = np.hypot(right.standard_error, left.standard_error)
    mirror = np.array([1.0, 1.0, -1.0])[:, None]
    assert_all_agree(right.stokes[0], error[0], mirror * left.stokes[0])
    assert abs(right.stokes[1, 2, 0]) < 4 * right.standard_error[1, 2, 0]
    assert abs(right.stokes[0, 2, 0]) > 10 * right.standard_error[0, 2, 0]


def test_radiance_is_the_first_component(earth):
    """Radiance would be of other samples, the zenith not turn, or Q = U = 0 be handed out as computed."""
    question = (-5.0, [30.0, 90.0], [20.0, 0.0])
    whole = earth.stokes_with_error(*question)
    np.testing.assert_array_equal(earth.radiance(*question), whole.stokes[..., 0, :])
    np.testing.assert_array_equal(earth.radiance_with_error(*question).standard_error, whole.standard_error[..., 0, :])
    assert whole.stokes.shape == (2, 3, 1)
    a = earth.stokes_with_error(-3.0, 90.0, 0.0)
    b = earth.stokes_with_error(-3.0, 90.0, 45.0)
    error = np.hypot(a.standard_error, b.standard_error)[1:, 0]
    assert_all_agree([b.stokes[1, 0], b.stokes[2, 0]], error[::-1], [-a.stokes[2, 0], a.stokes[1, 0]])
    settings = replace(FIXED, polarisation=False, importance_sweeps=0)
    with pytest.raises(TwilightError, match="without polarisation"):
        prepare(hazy_earth(), settings).stokes(10.0, 20.0, 0.0)
