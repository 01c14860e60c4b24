"""Bands of water vapour and oxygen: the source's transmissions, the exponential sums, and what solvers make of them."""

from dataclasses import replace

import numpy as np
import pytest
from hazy_zones import SCALAR

from twilight import solvers
from twilight.atmosphere import bands
from twilight.atmosphere.bands import OXYGEN, WATER_VAPOUR, GasBands
from twilight.atmosphere.profiles import PROFILES, load_profile
from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.engine import solve
from twilight.engine.sunbeam import Sunbeam, make_disc
from twilight.scene import resolve
from twilight.scene.plan import _limb_optical_depth, make_plan
from twilight.sky.lights import Sun
from twilight.solvers.base import BareField, Capabilities

pytestmark = pytest.mark.usefixtures("coarse_draft")

MASSES = np.array([1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0])
WATER_MM = 20.0
DIRECT_ERROR = 0.02
SPCTRL2 = {
    (WATER_VAPOUR, 724.4): (0.86138, 0.82963, 0.80335, 0.76043, 0.72547, 0.66947, 0.62491, 0.58767),
    (WATER_VAPOUR, 816.0): (0.89007, 0.86426, 0.84275, 0.80728, 0.77808, 0.73067, 0.69232, 0.65982),
    (WATER_VAPOUR, 937.0): (0.44026, 0.35865, 0.30082, 0.22282, 0.17225, 0.11100, 0.07615, 0.05440),
    (OXYGEN, 690.0): (0.94501, 0.93122, 0.91959, 0.90015, 0.88383, 0.85671, 0.83413, 0.81450),
    (OXYGEN, 762.5): (0.70296, 0.64362, 0.59675, 0.52448, 0.46953, 0.38869, 0.33054, 0.28605),
    (OXYGEN, 767.5): (0.91265, 0.89169, 0.87412, 0.84498, 0.82078, 0.78109, 0.74860, 0.72076),
}
"""Transmission of the direct beam by the gas alone at MASSES, 20 mm of water, 1013 hPa: `pvlib.spectrum.spectrl2` of
pvlib 0.16.1, its beam over the extraterrestrial one, with water over without, and without over that of Rayleigh."""
ELEVATION_DEG, AZIMUTH_DEG = np.array([4.0, 25.0, 80.0]), np.array([0.0, 120.0, 60.0])


def of_terms(gas, amount, mass):
    weight, depth = bands.terms(gas, float(amount))
    return float(np.dot(weight, np.exp(-np.multiply(depth, mass))))


def scene(nm, climate="pure-air", **settings):
    return load(climate, {"wavelengths.list_nm": list(nm), **settings})


def zones_draft(config, suns):
    return solve(resolve(config, solver=(solvers.load("zones"), replace(SCALAR, max_orders=3))), suns, cached=False)


NO_BANDS = {"gases.oxygen": False, "gases.water_vapour.column_mm": 0.0}


def direct_of(config):
    """The engine's direct beam at its only wavelength, as a function of the sun's elevation, without a field."""
    made = resolve(config)
    wide = made.medium if made.bands is None else made.bands.expand(made.medium)
    beam = Sunbeam(wide)

    def at(sun):
        values = beam.at(sun, 0.0).irradiance
        return float((values if made.bands is None else made.bands.sum_terms(values))[0])

    return at


@pytest.mark.parametrize(("gas", "nm"), SPCTRL2)
def test_the_terms_give_the_direct_beam_of_spectrl2(gas, nm):
    """The direct beam in a band would not be that of SPCTRL2."""
    factor = {WATER_VAPOUR: 0.1 * WATER_MM, OXYGEN: 1.0}[gas]
    amount = bands.coefficient(gas, np.array([nm]))[0] * factor
    found = [of_terms(gas, amount, mass) for mass in MASSES]
    np.testing.assert_allclose(found, SPCTRL2[gas, nm], rtol=0.5 * DIRECT_ERROR)


@pytest.mark.parametrize("column_mm", [5.0, *(pytest.param(mm, marks=pytest.mark.slow) for mm in (0.3, 50.0, 150.0))])
def test_weights_are_a_mixture_for_every_column_and_the_fit_holds(column_mm):
    """For some column the weights would be negative, or the exponential sum worse than stated."""
    nm = np.arange(580.0, 1001.0, 3.0)
    for gas, amount in ((WATER_VAPOUR, 0.1 * column_mm), (OXYGEN, 1.0)):
        for x in bands.coefficient(gas, nm) * amount:
            weight, depth = map(np.array, bands.terms(gas, float(x)))
            assert weight.sum() == pytest.approx(1.0, abs=1e-12) and (weight >= 0.0).all() and (depth >= 0.0).all()
            assert weight.size <= bands.MOST_TERMS
            for mass in (1.0, 3.0, 10.0):
                assert of_terms(gas, x, mass) == pytest.approx(bands.transmission(gas, mass * x), rel=DIRECT_ERROR)
            # longer ways, and shorter ones of an observer in the air: of all the light
            for mass in (0.1, 40.0):
                assert of_terms(gas, x, mass) == pytest.approx(float(bands.transmission(gas, mass * x)), abs=0.01)


def test_little_of_a_gas_absorbs_after_beer():
    """A thin column would not absorb in proportion to its amount."""
    for gas in bands.GASES:
        amount = 1e-6 / bands.SATURATION[gas]
        assert -np.log(bands.transmission(gas, amount)) == pytest.approx(bands.STRENGTH[gas] * amount, rel=1e-5)
        # enough to see over 40 columns, too little to saturate
        amount = 3e-3 / bands.SATURATION[gas]
        if 1.0 - bands.transmission(gas, 40.0 * amount) > bands.WEAK:
            weight, depth = map(np.array, bands.terms(gas, amount))
            assert np.dot(weight, depth) == pytest.approx(bands.STRENGTH[gas] * amount, rel=0.1)


def test_bands_end_where_the_source_has_none():
    """Bands would absorb at wavelengths where the source has no absorption."""
    clear = np.concatenate([np.arange(300.0, 587.9), np.arange(598.1, 680.0), [755.0, 773.0]])
    assert np.all(bands.coefficient(OXYGEN, clear) == 0.0)
    assert np.all(bands.coefficient(WATER_VAPOUR, clear[clear < 680.0]) == 0.0)
    assert bands.coefficient(WATER_VAPOUR, np.array([593.0, 823.7])).tolist() == [0.075, 2.5]
    assert bands.coefficient(OXYGEN, np.array([690.0, 762.5, 765.0])).tolist() == [0.15, 4.0, pytest.approx(2.175)]


@pytest.mark.parametrize(("nm", "gas"), [(762.5, OXYGEN), (820.0, WATER_VAPOUR), (940.0, WATER_VAPOUR)])
def test_the_sunbeam_of_the_engine_follows_the_source(nm, gas):
    """At equal amounts: the scaled absorber that the beam crosses, by a quadrature of its own along a straight line."""
    straight = {"refraction.model": "none"}
    with_bands = direct_of(scene([nm], **straight))
    without = direct_of(scene([nm], **straight, **NO_BANDS))
    profile = load_profile("midlatitude_summer")
    amount = float(bands.amounts(gas, profile, np.array([nm]), None)[0])
    _, p, t = next(row for row in reversed(bands.PRESSURE_SCALING[gas]) if row[0] <= nm)
    z = np.linspace(0.0, 100.0, 40001)
    air = profile.at(z)
    density = air.h2o_per_cm3 if gas == WATER_VAPOUR else air.air_per_cm3
    density = density * air.pressure_hpa**p / air.temperature_k**t
    for sun in (90.0, 30.0, 10.0, 5.5):
        horizontal = 6371.0 * np.cos(np.radians(sun)) / (6371.0 + z)
        mass = np.trapezoid(density / np.sqrt(1.0 - horizontal**2), z) / np.trapezoid(density, z)
        found = with_bands(sun) / without(sun)
        assert found == pytest.approx(float(bands.transmission(gas, mass * amount)), rel=DIRECT_ERROR)


def test_the_suns_disc_has_the_bands_too():
    """The disc would shine in a band as if there were none."""
    made = [resolve(scene([550.0, 762.5], **more)) for more in ({}, NO_BANDS)]
    wet, dry = (make_disc(p.medium, Sun(8.0), 0.0, bands=p.bands).transmittance for p in made)
    lit = dry[:, 1] > 0.0
    beam = direct_of(scene([762.5]))(8.0) / direct_of(scene([762.5], **NO_BANDS))(8.0)
    assert np.median(wet[lit, 1] / dry[lit, 1]) == pytest.approx(beam, rel=0.01)  # over half a degree
    np.testing.assert_allclose(wet[lit, 0], dry[lit, 0], rtol=1e-6)


class GreyField(BareField):
    """Light after one grey way through the absorption."""

    def __init__(self, medium):
        self.medium = medium

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        e = np.asarray(elevation_deg, dtype=float)
        return np.exp(-self.medium.optical_depth("absorption")) * (1.0 + e[..., None])


class GreySolver:
    CAPABILITIES = Capabilities(wavelengths_at_once=6)

    def __init__(self):
        self.asked = []

    def prepare(self, medium, settings=None, *, observer_altitude_km=0.0, progress=None):
        self.asked.append(medium.wavelength_nm.tolist())
        return GreyField(medium)


def test_terms_come_back_as_wavelengths_in_blocks_of_their_own():
    """Terms would be summed into another wavelength, or share a block with others."""
    solver = GreySolver()
    nm = [550.0, 762.5, 820.0, 860.0]
    made = replace(resolve(scene(nm, horizon="clean")), solver=solver, settings=None)
    term_counts = made.bands.term_counts
    assert term_counts[0] == 1 and term_counts[3] == 1 and 3 <= term_counts[1] <= 5 and 3 <= term_counts[2] <= 5
    found = solve(made, cached=False).radiance(10.0, [0.0, 1.0], [0.0, 0.0])
    assert found.shape == (2, 4)
    assert all(len(part) <= 6 and len(set(part)) == 1 for part in solver.asked)
    assert [part[0] for part in solver.asked] == nm
    clear = np.exp(-made.medium.optical_depth("absorption"))
    gone = [1.0, 1.0, 1.0, 1.0]
    for w, gas in ((1, OXYGEN), (2, WATER_VAPOUR)):
        amount = bands.amounts(gas, load_profile("midlatitude_summer"), np.array([nm[w]]), None)[0]
        gone[w] = float(bands.transmission(gas, amount))
    np.testing.assert_allclose(found[0], clear * gone, rtol=0.01)
    np.testing.assert_allclose(found[1], 2.0 * found[0], rtol=1e-12)


def test_bands_that_are_no_mixture_are_refused():
    """Weights that do not sum to 1 would be taken."""
    with pytest.raises(TwilightError, match="sum to 1"):
        GasBands(np.array([0, 0]), np.array([0.5, 0.6]), np.zeros((2, 2)))


def test_the_column_of_a_term_is_its_optical_depth_in_layers_too():
    """The absorption of a term would not integrate to its optical depth."""
    for more in ({}, {"atmosphere.layers.equal_air_mass": 12}, {"ground.altitude_km": 3.0}):
        made = resolve(scene([762.5, 820.0], **more))
        wide = made.bands.expand(made.medium)
        gained = wide.optical_depth("absorption") - made.medium.optical_depth("absorption")[made.bands.wavelength_index]
        profile = load_profile("midlatitude_summer").above(more.get("ground.altitude_km", 0.0))
        expected = []
        for gas, nm in ((OXYGEN, 762.5), (WATER_VAPOUR, 820.0)):
            expected += bands.terms(gas, float(bands.amounts(gas, profile, np.array([nm]), None)[0]))[1]
        np.testing.assert_allclose(gained, expected, rtol=2e-3)


def test_columns_of_the_profiles_are_those_that_the_key_names():
    """The manual would state other columns of water than the profiles have."""
    from twilight.config.climate import WaterVapour

    said = WaterVapour.model_fields["column_mm"].description
    names = ("tropical", "summer", "winter", "summer", "winter", "standard")
    for name, profile in zip(names, PROFILES, strict=True):
        assert f"{name} {bands.water_column_mm(load_profile(profile)):.0f}" in said


def test_more_water_is_darker_and_neighbours_stay_as_they_are():
    """More water would not darken its band, or move wavelengths beside it."""
    suns, found = [8.0], []
    for column in (0.0, 20.0, 60.0):
        solved = zones_draft(scene([780.0, 823.7], **{"gases.water_vapour.column_mm": column}), suns)
        found.append(solved.radiance(8.0, ELEVATION_DEG, AZIMUTH_DEG))
    light = np.array(found)
    assert (np.diff(light[:, :, 1], axis=0) < 0.0).all() and (light > 0.0).all()
    assert (light[-1, :, 1] / light[0, :, 1] < 0.75).all()
    np.testing.assert_allclose(light[:2, :, 0], np.broadcast_to(light[0, :, 0], light[:2, :, 0].shape), rtol=0.02)


def test_the_plan_leaves_out_bands_that_do_not_matter():
    """Bands would cost time in scenes that do not see them, or be left out where they matter: a default column was up
    to 274 % too bright."""

    def parts(config):
        return {item.part: item for item in make_plan(config).omissions}

    placed = parts(load("continental-average"))
    assert "no wavelength of this scene lies in them" in placed["bands of water vapour"].reason
    assert "756 nm by 0.7 %" in placed["bands of water vapour"].effect
    assert placed["bands of oxygen"].effect == "none"
    assert "bands of water vapour" not in parts(load("continental-average", {"gases.water_vapour.column_mm": 100.0}))
    assert resolve(load("continental-average", {"wavelengths.list_nm": [400.0, 550.0]})).bands is None
    between = parts(scene([400.0, 550.0]))
    assert "no wavelength of this scene lies in them" in between["bands of oxygen"].reason
    inside = parts(scene([762.0, 823.0]))
    assert not {"bands of oxygen", "bands of water vapour"} & inside.keys()
    everything = scene([762.0, 823.0], omit_negligible=False)
    assert resolve(everything).bands.term_counts.max() > 2
    formula = load("continental-average", {"wavelengths.list_nm": [500.0, 720.0]})
    preetham = solvers.load("preetham")
    assert resolve(formula, solver=(preetham, preetham.QUALITIES["standard"])).bands is None


def test_the_far_ultraviolet_is_finite_behind_a_wall_of_ozone():
    """300 nm through ozone would be NaN."""
    config = scene([300.0, 305.0, 320.0, 340.0])
    solved = zones_draft(config, (10.0, -4.0))
    medium = solved.medium
    assert _limb_optical_depth(medium.altitude_km, medium.absorption_per_km) > 100.0
    for sun in (10.0, -4.0):
        light = solved.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG)
        assert np.isfinite(light).all() and (light[:, 1:] > 0.0).all()
        assert (np.diff(light, axis=1) > 0.0).all()  # towards 340 nm more and more


@pytest.mark.slow
@pytest.mark.parametrize("nm", [762.0, 820.0])
def test_zones_and_montecarlo_agree_in_a_band(nm):
    """By day and in twilight, scalar: every term is an ordinary absorption, so the codes differ as elsewhere."""
    zones, montecarlo = solvers.load("zones"), solvers.load("montecarlo")
    config = scene([nm], "continental-average")
    suns = (30.0, -4.0)
    by_zones = replace(zones.QUALITIES["standard"], polarisation=False)
    # so many samples, not a target: the darkest terms, which weigh nothing, would never reach one
    by_chance = replace(montecarlo.QUALITIES["draft"], samples=400, target_stderr=None)
    one = solve(resolve(config, solver=(zones, by_zones)), suns, cached=False)
    other = solve(resolve(config, solver=(montecarlo, by_chance)), suns, cached=False)
    for sun in suns:
        light = one.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG)
        truth, error = other.radiance_with_error(sun, ELEVATION_DEG, AZIMUTH_DEG)
        assert (np.abs(light - truth) < 0.03 * truth + 3.0 * error).all()


@pytest.mark.slow
def test_energy_in_a_band_is_not_more_than_what_the_terms_bring():
    """Black ground under clean air: what reaches it grows with less absorber, and stays below what comes in."""
    suns = [40.0]
    elevation, azimuth = np.meshgrid(np.arange(2.5, 90.0, 5.0), np.arange(7.5, 180.0, 15.0), indexing="ij")
    solid = np.cos(np.radians(elevation)) * np.radians(5.0) * np.radians(15.0) * 2.0
    totals = []
    for column in (60.0, 20.0, 0.0):
        solved = zones_draft(scene([823.7], **{"gases.water_vapour.column_mm": column}), suns)
        sky = solved.radiance(40.0, elevation, azimuth)[..., 0]
        flux = np.sum(sky * np.sin(np.radians(elevation)) * solid)
        totals.append(flux + solved.direct(40.0).irradiance[0] * np.sin(np.radians(40.0)))
    assert totals[0] < totals[1] < totals[2] < np.sin(np.radians(40.0))
