"""Air and gases: profiles, Rayleigh scattering, absorption cross sections."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twilight.atmosphere import gases, profiles
from twilight.base.errors import TwilightError

OZONE_COLUMNS_DU = {
    "tropical": 282, "midlatitude_summer": 334, "midlatitude_winter": 378, "subarctic_summer": 348,
    "subarctic_winter": 375, "us_standard": 344,
}  # fmt: skip


@pytest.mark.parametrize("name", profiles.PROFILES)
def test_profile_ozone_column_and_ideal_gas(name):
    """A profile would not be AFGL's air: its ozone, the gas law, the weight of its column."""
    profile = profiles.load_profile(name)
    assert profile.ozone_column_du == pytest.approx(OZONE_COLUMNS_DU[name], abs=1.0)
    pressure = profile.air_per_cm3 * 1e6 * profiles.BOLTZMANN_J_PER_K * profile.temperature_k * 1e-2
    low = profile.altitude_km <= 100
    np.testing.assert_allclose(pressure[low], profile.pressure_hpa[low], rtol=0.01)
    # mass of the column carries the pressure at the ground: m g N = p, within humidity and g(z)
    mass = profile.column_per_cm2(profile.air_per_cm3) * 1e4 * 28.96 * 1.66054e-27
    assert mass * 9.79 == pytest.approx(profile.pressure_hpa[0] * 100, rel=0.01)


def test_profile_between_altitudes():
    """Density between levels would not follow air that cools evenly, or columns would change with the levels."""
    profile = profiles.load_profile("us-standard")
    between = profile.at(4.5)
    # air that cools by 6.5 K/km: density goes like T^4.256, so its logarithm bends by -4.256 (6.5/T)^2 per km^2
    bend = 4.256 * (6.5 / between.temperature_k[0]) ** 2
    straight = np.sqrt(profile.air_per_cm3[4] * profile.air_per_cm3[5])
    assert between.air_per_cm3[0] == pytest.approx(straight * (1.0 + bend / 8.0), rel=3e-5)
    assert between.temperature_k[0] == pytest.approx(0.5 * (profile.temperature_k[4] + profile.temperature_k[5]))
    same = profile.at(profile.altitude_km)
    np.testing.assert_allclose(same.o3_per_cm3, profile.o3_per_cm3, rtol=1e-12)
    # splitting the levels keeps the column
    finer = profile.at(np.linspace(0, 120, 2401))
    assert finer.ozone_column_du == pytest.approx(profile.ozone_column_du, rel=1e-10)


def test_profile_humidity():
    """Vapour pressure and humidity would not be those of the published profile."""
    profile = profiles.load_profile("midlatitude_summer")
    assert profile.water_vapour_pressure_hpa[0] == pytest.approx(19.06, abs=0.05)
    assert profile.relative_humidity[0] == pytest.approx(0.766, abs=0.01)  # AFGL-TR-86-0110: 75.7 %
    assert np.all((profile.relative_humidity >= 0) & (profile.relative_humidity <= 1))


@pytest.mark.parametrize(
    "call, text",
    [
        (lambda: profiles.load_profile("midlatitude"), "midlatitude_summer"),
        (lambda: profiles.load_profile("us_standard").at(121.0), "120"),
    ],
)
def test_profile_errors(call, text):
    """A wrong name or altitude would not say what is allowed."""
    with pytest.raises(TwilightError, match=text):
        call()


def bodhaine_fit_cm2(wavelength_nm):
    """Bodhaine et al. 1999 eq. 29: their own fit to the cross section at 360 ppm CO2, 0.01 % from 250 to 850 nm."""
    x = (np.asarray(wavelength_nm) * 1e-3) ** 2
    return 1e-28 * (1.0455996 - 341.29061 / x - 0.90230850 * x) / (1 + 0.0027059889 / x - 85.968563 * x)


def test_rayleigh_cross_section_against_published_fit():
    """Rayleigh scattering would be off Bodhaine's own fit (eq. 29), or off 0.0971 at sea level (eq. 30)."""
    wavelength = np.arange(300.0, 851.0, 10.0)
    ratio = gases.cross_section_cm2(wavelength, co2_ppm=360) / bodhaine_fit_cm2(wavelength)
    np.testing.assert_allclose(ratio, 1.0, atol=1.5e-4)
    profile = profiles.load_profile("us_standard")
    depth = gases.cross_section_cm2(550.0, 360.0) * profile.column_per_cm2(profile.air_per_cm3)
    assert depth == pytest.approx(0.0971, rel=2e-3)


def test_king_factor_and_depolarisation():
    """Depolarisation would contradict the King factor, or carbon dioxide would not count."""
    wavelength = np.array([300.0, 550.0, 1000.0])
    f, rho = gases.king_factor(wavelength), gases.depolarisation(wavelength)
    np.testing.assert_allclose((6 + 3 * rho) / (6 - 7 * rho), f, rtol=1e-12)
    assert f[1] == pytest.approx(1.0487, abs=5e-4)  # Bodhaine et al. 1999 table 2 at 550 nm (360 ppm)
    assert np.all(np.diff(rho) < 0)
    assert np.all(np.diff(gases.cross_section_cm2(wavelength)) < 0)
    # more CO2 scatters more: 0.54 per unit of volume in n - 1, about twice that in the cross section
    ratio = gases.cross_section_cm2(550.0, 1300) / gases.cross_section_cm2(550.0, 300)
    assert ratio == pytest.approx(1 + 2 * 0.54e-3, abs=2e-4)


def test_cross_sections_are_clean():
    """No value below 0, and no peak above the literature: O3 4.0e-18 (280 nm), NO2 7.3e-19, O2-O2 1.4e-45."""
    wavelength = np.arange(280.0, 1000.5, 0.5)
    temperature = np.arange(180.0, 320.0, 10.0)
    for gas, peak in (("o3", 4.0e-18), ("no2", 7.3e-19), ("o4", 1.4e-45)):
        values = gases.cross_section(gas, wavelength, temperature)
        assert values.shape == (temperature.size, wavelength.size)
        assert values.min() >= 0.0
        assert 0.9 * peak < values.max() < peak
    between_bands = gases.cross_section("o4", [400.0, 420.0, 500.0], 250.0)
    assert np.all(between_bands == 0)


def test_ozone_cross_section_known_values():
    """Chappuis peak 5.1e-21 at 602 nm (Serdyuchenko et al. 2014); exact at the nodes, linear between temperatures."""
    assert gases.cross_section("o3", 602.0, 223.0)[0, 0] == pytest.approx(5.15e-21, rel=0.01)
    node = gases.cross_section("o3", 330.0, [203.0, 208.0, 213.0])[:, 0]
    assert node[1] == pytest.approx(0.5 * (node[0] + node[2]), rel=1e-12)
    outside = gases.cross_section("o3", 330.0, [150.0, 193.0, 293.0, 350.0])[:, 0]
    assert outside[0] == outside[1] and outside[2] == outside[3]


def test_ozone_in_the_ultraviolet():
    """Against JPL 06-2 (Sander et al. 2006), means of 4 nm wide intervals; no step where one table follows another."""
    jpl = {(283.7, 293.0): 2.82e-18, (287.8, 293.0): 1.84e-18, (292.0, 293.0): 1.13e-18, (296.3, 293.0): 6.51e-19}
    for (nm, kelvin), published in jpl.items():
        mean = gases.cross_section("o3", np.linspace(nm - 2.0, nm + 2.0, 9), kelvin).mean()
        assert mean == pytest.approx(published, rel=0.03), nm
    around = gases.cross_section("o3", [299.0, 300.0, 301.0, 302.0, 303.0], 243.0)[0]
    assert np.all(np.abs(np.diff(np.log(around)) + 0.14) < 0.06)


@given(st.floats(1, 366.99))
def test_seasonal_ozone_stays_in_habers_range(day):
    """A day of the year would give ozone outside 260 to 370 DU."""
    assert 260.0 <= gases.seasonal_ozone_column_du(day) <= 370.0


def test_seasonal_ozone_is_largest_in_spring():
    """The ozone maximum would lie in another season."""
    assert gases.seasonal_ozone_column_du(95) == pytest.approx(370.0)
    assert gases.seasonal_ozone_column_du(278) == pytest.approx(260.0, abs=0.01)
    with pytest.raises(TwilightError, match="1 to 366"):
        gases.seasonal_ozone_column_du(0)


@pytest.mark.parametrize("bad", [[279.0, 500.0], [500.0, 1001.0], [], [500.0, np.nan], [500.0, 400.0]])
def test_wavelengths_outside_the_data(bad):
    """Wavelengths without optical data, or not increasing, would be computed."""
    with pytest.raises(TwilightError, match="wavelength_nm"):
        gases.check_wavelengths(bad)


def test_a_gas_of_ones_own_has_its_column_and_cross_section(tmp_path):
    """An absorber that the program does not have could not be in the air."""
    from twilight.base.errors import TwilightError
    from twilight.config import load_climate
    from twilight.scene.medium import climate_medium

    (tmp_path / "so2.csv").write_text("wavelength_nm,cross_section_cm2\n300,4e-20\n400,2e-20\n700,0\n")
    nm = np.array([350.0, 450.0, 650.0])
    for ground in (0.0, 2.0):
        plain = load_climate("pure-air", {"ground.altitude_km": ground})
        more = {"gases.own": {"file": str(tmp_path / "so2.csv"), "column_du": 50}, "ground.altitude_km": ground}
        made = climate_medium(load_climate("pure-air", more), nm)
        added = made.optical_depth("absorption") - climate_medium(plain, nm).optical_depth("absorption")
        right = 50 * 2.68678e16 * np.interp(nm, [300, 400, 700], [4e-20, 2e-20, 0])
        np.testing.assert_allclose(added, right, atol=2e-5)  # of the rule between levels
    with pytest.raises(TwilightError, match="has 300 to 700 nm, asked for are 400 to 800 nm"):
        climate_medium(load_climate("pure-air", more), np.array([400.0, 800.0]))
