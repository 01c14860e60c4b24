"""The air of a place: humidity, heights, a measured column joined with a climate's air, the usual ozone, own levels."""

from dataclasses import replace

import numpy as np
import pytest

from twilight.atmosphere import measured
from twilight.atmosphere.aerosols import optical_depth_at
from twilight.atmosphere.measured import FADE_KM, AirColumn, climatological_column_du, climatology_source, join
from twilight.atmosphere.profiles import PROFILES, load_profile
from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.config.climate import air_profile
from twilight.scene.medium import climate_medium


def column_of(name, top_km, **more):
    """The lower part of an AFGL atmosphere as if it had been measured."""
    a = load_profile(name)
    inside = a.altitude_km <= top_km
    air = a.air_per_cm3[inside]
    gases = {"water_vapour": a.h2o_per_cm3[inside] / air, "ozone": a.o3_per_cm3[inside] / air}
    columns = {"pressure_hpa": a.pressure_hpa[inside], "temperature_k": a.temperature_k[inside], **gases, **more}
    return AirColumn(f"{name} to {top_km} km", a.altitude_km[inside], **columns)


@pytest.mark.parametrize("top_km", [12.0, 31.0, 47.5])
def test_a_climates_own_column_joined_with_it_changes_nothing(top_km):
    """Joining would change the air that it joins."""
    air = load_profile("midlatitude_summer")
    joined = join(column_of("midlatitude_summer", top_km), air)
    there = air.at(joined.altitude_km)
    np.testing.assert_allclose(joined.pressure_hpa, there.pressure_hpa, rtol=1e-4)
    # a polygon between AFGL's altitudes, the program's cubic at the levels that are added below 4 km; n = p / (k T)
    np.testing.assert_allclose(joined.temperature_k, there.temperature_k, rtol=5e-4)
    np.testing.assert_allclose(joined.air_per_cm3, there.air_per_cm3, rtol=1e-3)
    assert joined.ozone_column_du == pytest.approx(air.ozone_column_du, rel=1e-3)


@pytest.mark.parametrize("name", PROFILES)
def test_above_a_measurement_pressure_goes_on_hydrostatically_and_without_a_step(name):
    """Air above a sounding would have a step."""
    top, other = 30.0, load_profile("tropical" if name != "tropical" else "subarctic_winter")
    joined = join(column_of(name, top, ozone=None), other)
    z, outer = joined.altitude_km, other.at(joined.altitude_km)
    # d ln p / dz times T is that of the air around: g and the molar mass are the same in both
    fine = np.arange(31.0, 119.0, 0.25)
    a, b = joined.at(fine), other.at(fine)
    slope = np.gradient(np.log(a.pressure_hpa), fine) * a.temperature_k
    wanted = np.gradient(np.log(b.pressure_hpa), fine) * b.temperature_k
    # to what the program's cubics between levels 2.5 and 5 km apart leave
    assert np.sqrt(np.mean((slope / wanted - 1.0) ** 2)) < 0.02
    far = z >= top + FADE_KM
    np.testing.assert_allclose(joined.temperature_k[far], outer.temperature_k[far], rtol=1e-9)
    ratio = joined.pressure_hpa / outer.pressure_hpa
    np.testing.assert_allclose(ratio[far], ratio[-1], rtol=1e-3)
    at_top = joined.at([top - 0.01, top + 0.01])
    assert at_top.pressure_hpa[1] / at_top.pressure_hpa[0] == pytest.approx(1.0, abs=0.005)
    np.testing.assert_allclose(joined.o3_per_cm3, outer.o3_per_cm3, rtol=1e-9)  # not measured: the climate's


def test_a_fine_sounding_is_smoothed_and_keeps_its_mass():
    """A sounding's noise would bend light, or its mass be lost."""
    rng = np.random.default_rng(1)
    z = np.arange(0.1, 28.0, 0.01)
    around = load_profile("us_standard")
    there = around.at(z)
    noisy = there.temperature_k + rng.normal(0.0, 1.0, z.size)
    joined = join(AirColumn("fine", z, there.pressure_hpa, noisy), around)
    inside = (joined.altitude_km > 0.1) & (joined.altitude_km < 28.0)
    wanted = around.at(joined.altitude_km)
    assert np.max(np.abs(joined.temperature_k - wanted.temperature_k)[inside]) < 0.7
    np.testing.assert_allclose(joined.pressure_hpa[inside], wanted.pressure_hpa[inside], rtol=1e-3)


def test_below_the_lowest_altitude_air_goes_on_hydrostatically():
    """Below a mountain's sounding air would be missing."""
    around = load_profile("us_standard")
    full = column_of("us_standard", 30.0)
    cut = AirColumn("from 2 km", *(a[2:] for a in (full.altitude_km, full.pressure_hpa, full.temperature_k)))
    joined = join(cut, around)
    assert joined.pressure_hpa[0] == pytest.approx(1013.0, rel=2e-3)  # the standard atmosphere falls by 6.5 K/km too
    assert joined.temperature_k[0] == pytest.approx(288.2, abs=0.2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"temperature_k": lambda t: t - 273.15}, "do not belong together"),
        ({"pressure_hpa": lambda p: p[::-1]}, "pressure fall"),
        ({"temperature_k": lambda t: t * 1.2}, "units"),
    ],
)
def test_what_cannot_be_air_is_refused(change, words):
    """Celsius would be taken for kelvin."""
    column = column_of("us_standard", 30.0)
    broken = replace(column, **{key: f(getattr(column, key)) for key, f in change.items()})
    with pytest.raises(TwilightError, match=words):
        join(broken, load_profile("us_standard"))


def test_humidity_in_its_measures():
    # WMO-No. 8: 6.112 hPa at 0 C, 23.4 hPa at 20 C; the triple point of water is at 6.117 hPa (Guildner et al. 1976)
    """Dew point, humidity or mixing ratio would be converted wrongly."""
    assert measured.saturation_pressure_hpa(273.15) == pytest.approx(6.112)
    assert measured.saturation_pressure_hpa(293.15) == pytest.approx(23.39, rel=3e-3)
    # over water, Goff and Gratch 1946
    assert measured.saturation_pressure_hpa(233.15) == pytest.approx(0.1902, rel=0.01)
    # a row of a sounding (02963, 10 April 2006): 992 hPa, 1.6 C, dew point 0.8 C, 94 %, 4.11 g/kg
    x = measured.from_dew_point(273.15 + 0.8, 992.0)
    assert 100.0 * x * 992.0 / measured.saturation_pressure_hpa(273.15 + 1.6) == pytest.approx(94.0, abs=0.6)
    assert 1e3 * measured.EPSILON * x / (1.0 - x) == pytest.approx(4.11, rel=0.01)
    saturated = measured.from_relative_humidity(100.0, 280.0, 900.0)
    assert saturated == pytest.approx(measured.from_dew_point(280.0, 900.0))
    q = 0.01
    r = q / (1.0 - q)  # mixing ratio
    x = measured.from_specific_humidity(q)
    assert x == pytest.approx(r / (measured.EPSILON + r))
    assert measured.virtual_temperature_k(300.0, x) == pytest.approx(300.0 * (1.0 + 0.608 * q), rel=2e-4)
    # 1 ppm by volume of ozone is 1.657 ppm by mass of dry air
    assert measured.ozone_from_mass_mixing_ratio(1.657e-6, 0.0) == pytest.approx(1e-6, rel=1e-3)


def test_geopotential_height():
    # US Standard Atmosphere 1976, table I (45 deg): geometric 30 and 80 km are 29.859 and 79.006 km of geopotential
    """Heights would be off by the fall of gravity."""
    np.testing.assert_allclose(measured.geometric_km([29.859, 79.006], 45.5425), [30.0, 80.0], atol=0.02)
    assert measured.gravity_at_sea_level(0.0) == pytest.approx(9.7803, abs=1e-4)  # WGS 84
    assert measured.gravity_at_sea_level(90.0) == pytest.approx(9.8322, abs=1e-4)
    z = np.array([0.0, 1.0, 10.0, 50.0])
    np.testing.assert_allclose(measured.geometric_km(measured.geopotential_km(z, 12.0), 12.0), z, atol=1e-9)
    # gravity is less at the equator
    assert measured.geometric_km(30.0, 0.0) - measured.geometric_km(30.0, 90.0) > 0.1


def van_heuklon_du(latitude, longitude, day):
    """Another published formula: van Heuklon 1979, Solar Energy 22, 63; it knows no ozone hole."""
    a, b, c, f, h = (150.0, 1.28, 40.0, -30.0, 3.0) if latitude >= 0.0 else (100.0, 1.5, 30.0, 152.625, 2.0)
    shift = (20.0 if longitude > 0.0 else 0.0) if latitude >= 0.0 else -75.0
    wave = c * np.sin(np.radians(0.9865 * (day + f))) + 20.0 * np.sin(np.radians(h * (longitude + shift)))
    return 235.0 + (a + wave) * np.sin(np.radians(b * latitude)) ** 2


def test_usual_ozone():
    """The usual ozone of a place would be off other published formulas and means."""
    column, days, latitudes = climatological_column_du, (15, 105, 196, 288), np.arange(-55.0, 60.0, 5.0)
    # two other programs have the formula so: 36 N, 122 W, day 185 (Moss Landing, 1997); London, June (R. Wilson, 2015)
    assert van_heuklon_du(36.0, -122.0, 185) == pytest.approx(321.2, abs=0.05)
    assert van_heuklon_du(51.5, -0.1, 166) == pytest.approx(383.85882587, abs=1e-6)
    around = np.arange(-180.0, 180.0, 5.0)
    formula = np.array([[np.mean([van_heuklon_du(x, lon, d) for lon in around]) for d in days] for x in latitudes])
    table = np.array([[column(x, d) for d in days] for x in latitudes])
    assert abs(np.mean(table - formula)) < 10.0 and np.sqrt(np.mean((table - formula) ** 2)) < 30.0
    # the globe's mean of the nineties is 2 to 3 % below 300 DU (Fioletov et al. 2002)
    fine = np.arange(-89.0, 90.0, 2.0)
    means = [np.mean([column(x, d) for d in range(8, 366, 30)]) for x in fine]
    assert np.average(means, weights=np.cos(np.radians(fine))) == pytest.approx(292.0, abs=6.0)
    assert all(240.0 < column(x, d) < 285.0 for x in (-10, 0, 10) for d in days)  # the tropics hardly change
    assert column(60.0, 80) > column(60.0, 290) + 70.0  # northern spring and autumn
    assert column(-85.0, 288) < 160.0 < 250.0 < column(-85.0, 15)  # the ozone hole
    # it repeats, without a step at New Year; the poles are those of 85 deg
    assert column(50.0, 0.5) == pytest.approx(column(50.0, 365.75)) and column(90.0, 100) == column(85.0, 100)
    # subtropics of the south-western United States through the year: the 285 DU of the dark site, not 334
    assert np.mean([column(33.5, d) for d in range(1, 366, 7)]) == pytest.approx(295.0, abs=15.0)
    assert "McPeters" in climatology_source(52.5, 172)


LEVELS = {
    "altitude_km": [0, 5, 10, 20, 50, 100],
    "pressure_hpa": [1013, 540, 265, 55, 0.8, 3e-4],
    "temperature_k": [288, 256, 223, 217, 271, 195],
    "water_vapour_ppm": [7000, 1000, 50, 4, 5, 1],
    "ozone_ppm": [0.03, 0.05, 0.1, 3, 2, 0.3],
}


def levels(**changes):
    return {"version": 1, "name": "own", "atmosphere": {"levels": {**LEVELS, **changes}}}


def test_levels_are_the_air():
    """A climate's own levels would be changed."""
    climate = load(levels()).climate
    air = air_profile(climate)
    assert air.air_per_cm3[0] == pytest.approx(2.547e19, rel=2e-3)  # Loschmidt at 15 C
    assert air.o3_per_cm3[3] / air.air_per_cm3[3] == pytest.approx(3e-6)
    medium = climate_medium(climate, np.array([550.0]))
    assert medium.notes["ozone_source"] == "atmosphere.levels"
    assert medium.notes["ozone_column_du"] == pytest.approx(air.ozone_column_du)
    doubled = load(levels(water_vapour_ppm=[2 * x for x in LEVELS["water_vapour_ppm"]])).climate
    notes = climate_medium(doubled, np.array([550.0])).notes
    assert notes["water_vapour_column_mm"] == pytest.approx(2 * medium.notes["water_vapour_column_mm"])


def test_optical_depths_at_several_wavelengths_are_met():
    """Measured haze would not be met at its wavelengths."""
    nm, depth = [340.0, 440.0, 500.0, 675.0, 870.0, 1020.0], [0.40, 0.28, 0.23, 0.14, 0.10, 0.085]
    spectrum = {"wavelength_nm": nm, "optical_depth": depth}
    climate = load("continental-average", {"aerosol.optical_depths": spectrum}).climate
    wavelength = np.array([300.0, 340.0, 440.0, 550.0, 675.0, 1000.0])
    medium = climate_medium(climate, wavelength)
    np.testing.assert_allclose(medium.optical_depth("aerosol"), optical_depth_at(nm, depth, wavelength), rtol=1e-9)
    # a power law of its own exponent between and beyond
    exponent = np.log(0.5) / np.log(870.0 / 440.0)
    at_1740 = optical_depth_at([440.0, 870.0], [0.2, 0.1], np.array([1740.0]))[0]
    assert at_1740 == pytest.approx(0.1 * (1740.0 / 870.0) ** exponent)
    plain = climate_medium(load("continental-average").climate, wavelength)
    np.testing.assert_allclose(
        medium.aerosol_single_scattering_albedo[0], plain.aerosol_single_scattering_albedo[0], rtol=1e-12
    )
    with pytest.raises(TwilightError, match="optical_depths at 1000 nm"):
        thin = {"wavelength_nm": [440.0, 1020.0], "optical_depth": [0.05, 0.0005]}
        climate_medium(load("continental-average", {"aerosol.optical_depths": thin}).climate, wavelength)
    with pytest.raises(TwilightError, match="not both"):
        load("continental-average", {"aerosol.optical_depths": spectrum, "aerosol.optical_depth_550nm": 0.1})


def test_the_extinction_of_the_stratosphere_as_levels():
    """A measured stratosphere would have another depth or colour."""
    from twilight.atmosphere.stratosphere import SAGE_WAVELENGTH_NM, _sage

    rows = _sage()["nh_midlat_typical"]
    good = np.all(np.isfinite(rows) & (rows > 0), axis=1)
    given = {
        "altitude_km": rows[good, 0].tolist(),
        "wavelength_nm": SAGE_WAVELENGTH_NM.tolist(),
        "extinction_per_km": rows[good, 2:].tolist(),
    }
    wavelength = np.array([400.0, 550.0, 750.0, 900.0])

    def depth(**more):
        section = {"kind": "nh_midlat_typical", **more}
        return climate_medium(load("pure-air", {"stratosphere": section}).climate, wavelength).optical_depth("aerosol")

    own = depth()
    np.testing.assert_allclose(depth(levels=given), own, rtol=0.02)  # rows with a missing channel are not in `given`
    # one channel: the droplets' spectrum (Mie) is that of the nine channels to their noise
    at_756 = list(SAGE_WAVELENGTH_NM).index(756.0)
    column = [[row[at_756]] for row in given["extinction_per_km"]]
    from_one = depth(levels={**given, "wavelength_nm": [756.0], "extinction_per_km": column})
    assert from_one[2] == pytest.approx(own[2], rel=0.02)
    np.testing.assert_allclose(from_one, own, rtol=0.3)
    with pytest.raises(TwilightError, match="droplets"):
        load("pure-air", {"stratosphere": {"kind": "background", "levels": given}})
