"""The medium that comes out: columns, jumps, layers, scaling."""

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twilight.atmosphere import gases, opac, profiles
from twilight.atmosphere.aerosols import mixture_optics
from twilight.atmosphere.build import Boundaries, EqualAirMass, build_medium
from twilight.atmosphere.opac import AerosolSpec, MineralLayer, opac_type, opac_types
from twilight.base.errors import TwilightError

DATA = Path(__file__).parents[1] / "data"

HESS_1998_COLUMN = {
    "continental-clean": 0.064, "continental-average": 0.151, "continental-polluted": 0.327, "urban": 0.643,
    "desert": 0.286, "maritime-clean": 0.096, "maritime-polluted": 0.117, "maritime-tropical": 0.056, "arctic": 0.063,
    "antarctic": 0.072,
}  # fmt: skip
"""Column optical depth at 550 nm and 80 % humidity (Hess et al. 1998, table 5)."""

HESS_1998_ALBEDO_ASYMMETRY = (
    (0.972, 0.709), (0.925, 0.703), (0.892, 0.698), (0.817, 0.689), (0.888, 0.729), (0.997, 0.772), (0.975, 0.756),
    (0.998, 0.774), (0.887, 0.721), (1.000, 0.784),
)  # fmt: skip
"""Single scattering albedo and asymmetry of the ten types, same conditions (Hess et al. 1998, table 4)."""

W = np.array([380.0, 550.0, 720.0 - 340.0 / 7])


@pytest.fixture(scope="module")
def average():
    return build_medium(W, aerosol=opac_type("continental average"))


def test_column_optical_depth_of_the_ten_types():
    """A type's aerosol column would not be the one that OPAC publishes."""
    assert opac_types() == tuple(HESS_1998_COLUMN)
    for name, expected in HESS_1998_COLUMN.items():
        medium = build_medium([550.0], aerosol=opac_type(name), refraction="none")
        assert medium.optical_depth("aerosol")[0] == pytest.approx(expected, abs=1e-3), name


def test_albedo_and_asymmetry_of_the_ten_types():
    """A type's albedo or asymmetry would not be the one that OPAC publishes."""
    for name, (albedo, asymmetry) in zip(opac_types(), HESS_1998_ALBEDO_ASYMMETRY, strict=True):
        got = mixture_optics(opac_type(name).number_density_per_cm3, 80.0, [550.0])
        assert got.single_scattering_albedo[0] == pytest.approx(albedo, abs=1e-3), name
        assert got.phase.asymmetry[0] == pytest.approx(asymmetry, abs=1.1e-3), name


def test_spellings_of_a_type():
    """One type would be known by one spelling alone."""
    assert opac_type("Maritime Clean") == opac_type("maritime-clean") == opac_type("maritime_clean")


def test_background_extinction_against_opac():
    """The mixtures for free troposphere, stratosphere and dust have OPAC's tabulated extinction."""
    with (DATA / "opac_background_extinction.csv").open() as file:
        row = next(r for r in csv.DictReader(file) if float(r["wavelength_um"]) == 0.55)
    for numbers, humidity, key in (
        (opac.FREE_TROPOSPHERE_PER_CM3, opac.FREE_TROPOSPHERE_HUMIDITY_PERCENT, "free_troposphere_ext_per_km"),
        (opac.STRATOSPHERE_PER_CM3, 0.0, "stratosphere_ext_per_km"),
        ({"mitr": 1.0}, 0.0, "mineral_transported_ext_per_km"),
    ):
        got = mixture_optics(numbers, humidity, [550.0])
        assert got.extinction_per_km[0] == pytest.approx(float(row[key]), rel=4e-3)


def test_pure_air_columns():
    """Air without aerosol would have other optical depths than its gases."""
    medium = build_medium(W, profile="us_standard", co2_ppm=360, ozone_column_du=300)
    profile = profiles.load_profile("us_standard").at(np.linspace(0, 100, 3001))
    air = gases.cross_section_cm2(W, 360) * profile.column_per_cm2(profile.air_per_cm3)
    np.testing.assert_allclose(medium.optical_depth("air"), air, rtol=1e-6)
    depth = medium.notes["optical_depth"]
    assert set(depth) == {"air", "ozone", "no2", "o4"}
    parts = np.sum([depth[key] for key in ("ozone", "no2", "o4")], axis=0)
    # the sum of three gases goes exponentially between levels, each by itself: they differ a little
    np.testing.assert_allclose(medium.optical_depth("absorption"), parts, rtol=2e-3)
    assert not medium.has_aerosol and medium.phase_functions == ()
    np.testing.assert_allclose(medium.depolarisation, gases.depolarisation(W, 360))


def test_ozone_column_is_what_was_asked_for():
    """The ozone column asked for would not arrive in the absorption."""
    own = build_medium([602.0], no2=False, o4=False)
    twice = build_medium([602.0], no2=False, o4=False, ozone_column_du=2 * own.notes["ozone_column_du"])
    assert twice.optical_depth("absorption")[0] == pytest.approx(2 * own.optical_depth("absorption")[0], rel=1e-9)
    assert own.notes["ozone_column_du"] == pytest.approx(334, abs=1)
    spring = build_medium([602.0], ozone_day_of_year=95)
    assert spring.notes["ozone_column_du"] == pytest.approx(370.0)
    # 300 DU x 5.1e-21 cm^2 at the Chappuis peak, by hand
    three = build_medium([602.0], no2=False, o4=False, ozone_column_du=300)
    assert three.optical_depth("absorption")[0] == pytest.approx(300 * 2.6868e16 * 5.13e-21, rel=0.01)


def test_ozone_treatments():
    """Ozone would absorb twice, or not at all, as a layer, a filter above the air, or left out."""
    layer = build_medium([602.0], no2=False, o4=False, top_km=120)
    overhead = build_medium([602.0], no2=False, o4=False, top_km=35, ozone_treatment="overhead_filter")
    none = build_medium([602.0], no2=False, o4=False, ozone_treatment="none")
    assert np.all(overhead.absorption_per_km == 0) and np.all(none.absorption_per_km == 0)
    assert none.overhead_absorption_optical_depth[0] == 0 and none.notes["ozone_column_du"] == 0
    assert overhead.overhead_absorption_optical_depth[0] == pytest.approx(
        layer.optical_depth("absorption")[0], rel=1e-9
    )
    assert layer.overhead_absorption_optical_depth[0] == 0


def test_gases_can_be_left_out():
    """NO2 or O4 would absorb though left out, or absorb another amount than their cross sections."""
    all_gases = build_medium([477.0]).optical_depth("absorption")[0]
    without_o4 = build_medium([477.0], o4=False).optical_depth("absorption")[0]
    without_no2 = build_medium([477.0], no2=False).optical_depth("absorption")[0]
    assert 0 < without_o4 < all_gases and 0 < without_no2 < all_gases
    # O2-O2 peak at 477 nm, 6.6e-46 (Thalman & Volkamer 2013): the square of the oxygen density over all altitudes
    fine = profiles.load_profile("midlatitude_summer").at(np.linspace(0, 100, 10001))
    pairs = np.trapezoid((0.2095 * fine.air_per_cm3) ** 2, fine.altitude_km) * 1e5
    assert all_gases - without_o4 == pytest.approx(pairs * 6.6e-46, rel=0.05)


def test_jumps_are_doubled_levels(average):
    """The edges of aerosol layers would be smeared."""
    z = average.altitude_km
    repeated = z[1:][np.diff(z) == 0]
    np.testing.assert_array_equal(repeated, [2.0, 12.0, 35.0])
    i = int(np.flatnonzero(z == 12.0)[0])
    below, above = average.aerosol_extinction_per_km[i], average.aerosol_extinction_per_km[i + 1]
    assert np.all(below > above) and np.all(above > 0)
    np.testing.assert_array_equal(average.air_scattering_per_km[i], average.air_scattering_per_km[i + 1])
    np.testing.assert_array_equal(average.refractivity[i], average.refractivity[i + 1])
    top = int(np.flatnonzero(z == 35.0)[1])
    assert np.all(average.aerosol_extinction_per_km[top:] == 0)
    np.testing.assert_allclose(average.aerosol_phase_fraction.sum(axis=0), 1.0, rtol=1e-12)
    assert [p.name for p in average.phase_functions] == ["boundary layer", "free troposphere", "stratosphere"]
    inside = (z > 2.0) & (z < 12.0)
    assert np.all(average.aerosol_phase_fraction[1][inside] == 1.0)


def test_aerosol_falls_with_its_scale_height():
    """Aerosol would not fall by e over its scale height, or not stay constant where OPAC says so."""
    medium = build_medium([550.0], aerosol=opac_type("desert"), refraction="none")
    at = medium.at([0.0, 1.0, 3.7]).aerosol_extinction[:, 0]
    np.testing.assert_allclose(at / at[0], np.exp(-np.array([0.0, 1.0, 3.7]) / 2.0), rtol=1e-10)
    arctic = build_medium([550.0], aerosol=opac_type("arctic"), refraction="none")
    at = arctic.at([0.0, 1.9]).aerosol_extinction[:, 0]
    assert at[0] == at[1]


def test_thin_haze_keeps_its_optical_depth():
    """A layer of 10 m is resolved by its own two levels."""
    spec = AerosolSpec({"soot": 1e6}, boundary_layer_top_km=0.01, free_troposphere=False, stratosphere=False)
    medium = build_medium([550.0], aerosol=spec, refraction="none")
    one = mixture_optics({"soot": 1e6}, 80.0, [550.0]).extinction_per_km[0]
    assert medium.optical_depth("aerosol")[0] == pytest.approx(one * 0.01, rel=1e-3)


def test_mineral_layer_takes_the_place_of_the_free_troposphere():
    """Dust and the background would stand in the same air, or dust would have another optical depth."""
    dust = MineralLayer(3.0, 5.0, optical_depth_550nm=0.2)
    spec = AerosolSpec({"soot": 8300.0}, mineral_transported=dust)
    medium = build_medium([550.0], aerosol=spec, refraction="none")
    assert medium.notes["optical_depth"]["mineral transported"][0] == pytest.approx(0.2, rel=1e-9)
    at = medium.at([2.5, 3.5, 4.9, 5.1]).aerosol_extinction[:, 0]
    assert at[1] == pytest.approx(0.1, rel=1e-9) and at[2] == pytest.approx(0.1, rel=1e-9)
    free = mixture_optics(opac.FREE_TROPOSPHERE_PER_CM3, 50.0, [550.0]).extinction_per_km[0]
    np.testing.assert_allclose(at[[0, 3]], free * np.exp(-np.array([2.5, 5.1]) / 8), rtol=1e-9)
    by_number = MineralLayer(3.0, 5.0, number_density_per_cm3=11.0)
    spec = AerosolSpec({"soot": 8300.0}, mineral_transported=by_number)
    medium = build_medium([550.0], aerosol=spec, refraction="none")
    assert medium.at([4.0]).aerosol_extinction[0, 0] == pytest.approx(11 * 0.00586, rel=5e-3)


@pytest.mark.parametrize("target", [0.02, 0.3, 20.0])
def test_optical_depth_scaling(target):
    """The optical depth asked for would not be that of the column, or the stratosphere would be scaled too."""
    spec = opac_type("continental average")
    scaled = AerosolSpec(**{**spec.__dict__, "optical_depth_550nm": target})
    medium = build_medium(W, aerosol=scaled, refraction="none")
    assert medium.optical_depth("aerosol")[1] == pytest.approx(target, rel=1e-9)
    plain = build_medium(W, aerosol=spec, refraction="none")
    factor = medium.notes["aerosol_factor"]
    for part in ("boundary layer", "free troposphere"):
        ratio = np.array(medium.notes["optical_depth"][part]) / plain.notes["optical_depth"][part]
        np.testing.assert_allclose(ratio, factor, rtol=1e-9)
    assert medium.notes["optical_depth"]["stratosphere"] == plain.notes["optical_depth"]["stratosphere"]


def test_optical_depth_that_cannot_be_reached():
    """An impossible optical depth would be scaled to nonsense."""
    spec = opac_type("continental average").__dict__
    with pytest.raises(TwilightError, match=r"0\.001 is less than the stratospheric"):
        build_medium([550.0], aerosol=AerosolSpec(**{**spec, "optical_depth_550nm": 0.001}))
    empty = AerosolSpec({}, free_troposphere=False, optical_depth_550nm=0.5)
    with pytest.raises(TwilightError, match="cannot be reached"):
        build_medium([550.0], aerosol=empty)
    nothing = AerosolSpec(**{**spec, "optical_depth_550nm": 0.0, "stratosphere": False})
    medium = build_medium([550.0], aerosol=nothing)
    assert not medium.has_aerosol and medium.phase_functions == ()


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 500), st.floats(10, 120))
def test_equal_air_mass_layers(count, top_km):
    """Every layer holds the same integral of exp(-h/8), and the boundaries follow Haber's recursion."""
    z = EqualAirMass(count).boundaries_km(top_km)
    assert z[0] == 0 and z[-1] == top_km and z.size == count + 1 and np.all(np.diff(z) > 0)
    mass = 8 * (np.exp(-z[:-1] / 8) - np.exp(-z[1:] / 8))
    total = 8 * (1 - np.exp(-top_km / 8))
    np.testing.assert_allclose(mass, total / count, rtol=1e-8)
    following = -8 * np.log(np.exp(-z[:-2] / 8) - total / count / 8)
    np.testing.assert_allclose(z[1:-1], following, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("layers", [EqualAirMass(1), EqualAirMass(50), Boundaries((0.0, 0.5, 3.0, 50.0, 100.0))])
def test_layers_keep_every_column(layers, average):
    """Homogeneous layers would change a column."""
    medium = build_medium(W, aerosol=opac_type("continental average"), layers=layers)
    z = medium.altitude_km
    assert z.size == 2 * (np.unique(z).size - 1)
    for part in ("air", "absorption", "aerosol"):
        np.testing.assert_allclose(medium.optical_depth(part), average.optical_depth(part), rtol=1e-10)
    # constant inside a layer, and scattering kept too
    np.testing.assert_array_equal(medium.air_scattering_per_km[::2], medium.air_scattering_per_km[1::2])
    thickness = np.diff(z)[:, None]
    scattering = (medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo)[:-1] * thickness
    fine = average.refined(0.02)
    reference = fine.aerosol_extinction_per_km * fine.aerosol_single_scattering_albedo
    reference = 0.5 * (reference[1:] + reference[:-1]) * np.diff(fine.altitude_km)[:, None]
    np.testing.assert_allclose(scattering.sum(axis=0), reference.sum(axis=0), rtol=1e-3)
    np.testing.assert_allclose(medium.aerosol_phase_fraction.sum(axis=0), 1.0, rtol=1e-12)
    # refractivity has no jumps
    np.testing.assert_array_equal(medium.refractivity[1:-1:2], medium.refractivity[2::2])
    np.testing.assert_allclose(medium.refractivity[0], average.refractivity[0], rtol=1e-12)
    assert medium.notes == average.notes


def test_many_layers_tend_to_the_continuous_medium(average):
    """Many layers would not converge to the continuous air."""
    medium = build_medium(
        W, aerosol=opac_type("continental average"), layers=Boundaries(tuple(np.arange(0, 100.05, 0.1)))
    )
    z = np.array([0.55, 1.25, 7.35, 20.05, 34.95, 60.05])
    a, b = medium.at(z), average.at(z)
    np.testing.assert_allclose(a.aerosol_extinction, b.aerosol_extinction, rtol=1e-4)
    np.testing.assert_allclose(a.air_scattering, b.air_scattering, rtol=1e-4)
    np.testing.assert_allclose(a.aerosol_albedo[:5], b.aerosol_albedo[:5], rtol=1e-9)


@pytest.mark.parametrize("top_km", [10.0, 35.0, 61.7, 120.0])
def test_any_top(top_km):
    """Air cut at another altitude would not end there."""
    medium = build_medium(W, aerosol=opac_type("continental average"), top_km=top_km)
    assert medium.top_km == top_km and medium.bottom_km == 0
    full = build_medium(W, aerosol=opac_type("continental average"), top_km=120.0)
    z = np.linspace(0, top_km, 57)
    np.testing.assert_allclose(medium.at(z[:-1]).extinction, full.at(z[:-1]).extinction, rtol=1e-3)


def test_refraction_models():
    """A refraction model would have another index at the ground than published."""
    ciddor, haber, none = (build_medium([550.0], refraction=r) for r in ("ciddor", "haber", "none"))
    # dry air, 15 C, 1013.25 hPa: 2.78e-4 at 550 nm; here 21 C and humid
    assert ciddor.refractivity[0, 0] == pytest.approx(2.72e-4, rel=0.01)
    assert haber.refractivity[0, 0] == pytest.approx(2.78e-4, rel=0.01)
    assert not none.has_refraction
    scale = ciddor.refractivity[:, 0] / ciddor.air_scattering_per_km[:, 0]
    low = ciddor.altitude_km < 80
    np.testing.assert_allclose(scale[low], scale[0], rtol=0.02)


def test_henyey_greenstein_instead_of_mie(average):
    """The formula in place of Mie's phase functions would have another asymmetry."""
    spec = AerosolSpec(**{**opac_type("continental average").__dict__, "phase_function": "henyey_greenstein"})
    medium = build_medium(W, aerosol=spec)
    assert all(p.kind == 0 for p in medium.phase_functions)
    for a, b in zip(medium.phase_functions, average.phase_functions, strict=True):
        np.testing.assert_allclose(a.asymmetry, b.asymmetry, atol=1e-4)


def test_ground_albedo():
    """One number for the ground would not count at all wavelengths, or an impossible one would."""
    assert np.all(build_medium(W, ground_albedo=0.3).ground_albedo == 0.3)
    np.testing.assert_array_equal(build_medium(W, ground_albedo=[0.1, 0.2, 0.3]).ground_albedo, [0.1, 0.2, 0.3])
