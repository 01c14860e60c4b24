"""Land below sea level, as at the Dead Sea: the air goes on downwards, and everything takes the ground there."""

from dataclasses import replace

import numpy as np
import pytest

import twilight
from twilight import solvers
from twilight.atmosphere.build import build_medium
from twilight.atmosphere.profiles import PROFILES, load_profile
from twilight.base.conventions import LOWEST_GROUND_KM
from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.scene.medium import climate_medium

DEAD_SEA_KM = -0.43


@pytest.mark.parametrize("name", PROFILES)
def test_air_goes_on_downwards(name):
    """Hydrostatic, with the lapse of the lowest layer and the same mixing ratios; above the sea nothing moves."""
    whole = load_profile(name)
    low = whole.above(DEAD_SEA_KM)
    for part in ("altitude_km", "pressure_hpa", "temperature_k", "air_per_cm3", "o3_per_cm3", "h2o_per_cm3"):
        np.testing.assert_array_equal(getattr(low, part)[1:], getattr(whole, part))
    mean_k = 0.5 * (low.temperature_k[0] + low.temperature_k[1])
    water = whole.h2o_per_cm3[0] / whole.air_per_cm3[0]
    scale_km = 8.314462618 * mean_k / ((28.9647e-3 - water * 10.95e-3) * 9.80665) / 1e3
    assert low.pressure_hpa[0] / low.pressure_hpa[1] == pytest.approx(np.exp(-DEAD_SEA_KM / scale_km), rel=1e-4)
    slope = np.diff(low.temperature_k[:3]) / np.diff(low.altitude_km[:3])
    assert slope[0] == pytest.approx(slope[1], rel=1e-9)
    assert low.o3_per_cm3[0] / low.air_per_cm3[0] == pytest.approx(whole.o3_per_cm3[0] / whole.air_per_cm3[0])
    # n = p / k T, as far as the table itself keeps to it
    law = [p.pressure_hpa[0] * 1e-4 / (1.380649e-23 * p.temperature_k[0]) / p.air_per_cm3[0] for p in (low, whole)]
    assert law[0] == pytest.approx(law[1], rel=1e-9)


def test_pressure_of_the_standard_atmosphere():
    """U.S. Standard Atmosphere 1976, dry: 1066.0 hPa at -0.43 km."""
    assert load_profile("us_standard").above(DEAD_SEA_KM).pressure_hpa[0] == pytest.approx(1066.0, abs=1.0)


def test_the_medium_begins_there():
    """Air below the sea would be cut off."""
    low, sea = (build_medium([450.0, 650.0], ground_altitude_km=z) for z in (DEAD_SEA_KM, 0.0))
    assert low.bottom_km == DEAD_SEA_KM and low.top_km == sea.top_km
    assert low.optical_depth("air")[0] / sea.optical_depth("air")[0] == pytest.approx(1.051, abs=0.003)
    for beyond in (LOWEST_GROUND_KM - 0.01, 9.1):
        with pytest.raises(TwilightError, match=r"allowed is -0.5 to 9 km"):
            build_medium([450.0], ground_altitude_km=beyond)


def test_haze_and_own_levels_below_the_sea():
    """Haze would end at sea level."""
    levels = {
        "altitude_km": [-0.45, 0.0, 5.0, 10.0, 20.0, 50.0, 100.0],
        "pressure_hpa": [1066.0, 1013.0, 540.0, 265.0, 55.0, 0.8, 3e-4],
        "temperature_k": [296.0, 293.0, 262.0, 223.0, 217.0, 270.0, 195.0],
        "water_vapour_ppm": [1.2e4, 1e4, 2e3, 1e2, 4.0, 4.0, 1.0],
        "ozone_ppm": [0.03, 0.03, 0.05, 0.1, 3.0, 3.0, 0.5],
    }
    scene = {"version": 1, "climate": "continental-average"}
    keys = {"climate.atmosphere.levels": levels, "climate.ground.altitude_km": DEAD_SEA_KM}
    config = load(scene, keys)
    assert config.observer.altitude_km == DEAD_SEA_KM
    medium = climate_medium(config.climate, np.array([550.0]))
    assert medium.bottom_km == DEAD_SEA_KM and medium.optical_depth("aerosol")[0] > 0.05
    with pytest.raises(TwilightError, match=r"from -0.5 to 120 \(km\), got -0.6"):
        load(scene, {"climate.atmosphere.levels": levels | {"altitude_km": [-0.6, *levels["altitude_km"][1:]]}})


@pytest.mark.parametrize("solver", ["compact", "preetham", pytest.param("zones", marks=pytest.mark.slow)])
def test_a_sky_of_the_dead_sea(solver):
    """Near that of the sea: a twentieth more air above it."""
    options = {"sun_elevation_deg": 5.0, "solver": solver, "wavelength_nm": [450.0, 550.0, 650.0]}
    low, sea = (
        twilight.render("pure-air", settings={"climate.ground.altitude_km": z}, **options) for z in (DEAD_SEA_KM, 0.0)
    )
    assert low.observer_altitude_km == DEAD_SEA_KM
    zenith = [sky.sun_normalised_radiance[-1].mean(axis=0) for sky in (low, sea)]
    assert np.isfinite(low.sun_normalised_radiance).all() and (np.abs(zenith[0] / zenith[1] - 1.0) < 0.06).all()
    assert solver == "preetham" or (zenith[0] != zenith[1]).all()


@pytest.mark.slow
def test_tables_and_montecarlo_see_the_dead_sea_alike():
    """A twentieth more air above it: by how much the sky changes from that of the sea does not depend on the solver."""
    small = {"scattering_r": 12, "scattering_mu": 32, "scattering_mu_s": 16, "scattering_nu": 4, "max_orders": 2}
    elevation, azimuth = np.array([3.0, 30.0, 90.0, 10.0]), np.array([0.0, 90.0, 0.0, 180.0])
    change = {}
    for name, quality, options in (("tables", "standard", small), ("montecarlo", "draft", {})):
        solver, light = solvers.load(name), []
        for z in (0.0, DEAD_SEA_KM):
            climate = load({"version": 1, "climate": "pure-air"}, {"climate.ground.altitude_km": z}).climate
            settings = replace(solver.QUALITIES[quality], **options)
            field = solver.prepare(climate_medium(climate, np.array([550.0])), settings, observer_altitude_km=z)
            light.append(np.array([field.radiance(sun, elevation, azimuth)[..., 0] for sun in (5.0, -4.0)]))
        change[name] = light[1] / light[0] - 1.0
    # draft has 5 % of noise at most, much of it the same in both
    np.testing.assert_allclose(change["tables"], change["montecarlo"], atol=0.03)
    assert (change["tables"][0, 1:] > 0.01).all()
