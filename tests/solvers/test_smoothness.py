"""The sky has no flicker: one small step of anything differs little from the mean of its neighbours."""

from dataclasses import replace

import numpy as np
import pytest
from airs import turbid
from hazy_zones import QUICK

from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers.zones import grids, prepare
from twilight.solvers.zones.air_needs import truncation_needed
from twilight.solvers.zones.settings import QUALITIES
from twilight.transport.scaling import delta_scaled

WAVELENGTH_NM = np.array([300.0, 400.0, 550.0, 760.0, 900.0, 1000.0])
ELEVATION_DEG = np.array([1.0, 5.0, 20.0, 90.0, 20.0, 2.0])
AZIMUTH_DEG = np.array([0.0, 0.0, 30.0, 0.0, 180.0, 180.0])
LEAST = 2e-3


def air(turbidity=3.0, wavelength_nm=WAVELENGTH_NM):
    """Turbid air that bends light."""
    medium = turbid(turbidity, wavelength_nm)
    index = 2.8e-4 * np.exp(-medium.altitude_km / 8.0)[:, None]
    return replace(medium, refractivity=index * np.ones(medium.n_wavelengths))


def flicker(skies) -> float:
    """Largest fraction by which a sky differs from the mean of those before and after."""
    skies = np.array(skies)
    return float(np.max(np.abs(skies[1:-1] / (0.5 * (skies[:-2] + skies[2:])) - 1.0)))


FEW_ORDERS = replace(QUICK, max_orders=4, tolerance=0.0)
"""Flicker comes from where nodes, points and directions stand, and every order sees them."""


@pytest.fixture(scope="module", params=[FEW_ORDERS, pytest.param(QUICK, marks=pytest.mark.slow)], ids=["few", "all"])
def field(request):
    """Of few orders, and of all: light of late orders has directions of its own."""
    return prepare(air(wavelength_nm=WAVELENGTH_NM[[0, 2, 5]]), request.param)


@pytest.mark.parametrize("sun", [-0.7, -1.5, -4.5, -9.0])
def test_as_the_sun_moves(field, sun):
    """A film would flicker; at -0.56 the sun sets."""
    assert flicker([field.radiance(sun + 0.01 * k, ELEVATION_DEG, AZIMUTH_DEG) for k in range(24)]) < LEAST


@pytest.mark.parametrize("altitude_km", [0.05, 1.0, 11.0])
def test_as_the_observer_rises(field, altitude_km):
    """A film that rises would flicker."""
    steps = [altitude_km + 0.01 * k for k in range(24)]
    assert flicker([field.radiance(-4.0, ELEVATION_DEG, AZIMUTH_DEG, observer_altitude_km=z) for z in steps]) < LEAST


@pytest.mark.parametrize("azimuth_deg", [0.0, 180.0])
def test_as_the_view_rises(field, azimuth_deg):
    """A picture would have bands."""
    for start in (0.5, 5.0):
        assert flicker(field.radiance(-4.0, start + 0.01 * np.arange(100), azimuth_deg)) < LEAST


@pytest.mark.parametrize(
    ("what", "settings"),
    [
        ("optical depth", replace(FEW_ORDERS, max_orders=3)),
        pytest.param("optical depth", QUICK, marks=pytest.mark.slow),
        pytest.param("wavelength", QUICK, marks=pytest.mark.slow),
    ],
)
def test_as_the_air_changes(what, settings):
    """The number of orders, or what is added for the rest of them, would jump from one air to the next."""
    skies = []
    some = WAVELENGTH_NM[[0, 2, 4]]
    for k in range(3):
        medium = air(3.0 + 0.01 * k, some) if what == "optical depth" else air(3.0, some + 0.5 * k)
        solved = prepare(medium, settings)
        skies.append([solved.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG) for sun in (30.0, -2.0, -5.0)])
    assert flicker(skies) < LEAST


SUNS_DEG = (10.0, 0.0, -4.0, -8.0, -14.0)
STANDARD_FEW_ORDERS = replace(QUALITIES["standard"], max_orders=4, tolerance=0.0)
"""Two orders with the early directions and two with the late ones."""


def humid(name, relative_humidity_percent, wavelength_nm):
    """The medium of a climate with another humidity of its aerosol."""
    climate = load_climate(name)
    aerosol = climate.aerosol.model_copy(update={"relative_humidity_percent": relative_humidity_percent})
    return climate_medium(climate.model_copy(update={"aerosol": aerosol}), np.array(wavelength_nm))


def continental(relative_humidity_percent):
    """The field of `standard` in the climate continental-average at a humidity."""
    medium = humid("continental-average", relative_humidity_percent, WAVELENGTH_NM[[1, 2, 5]])
    return prepare(medium, STANDARD_FEW_ORDERS)


@pytest.fixture(scope="module")
def climate_field():
    """One field for all suns and observers."""
    return continental(75.0)


@pytest.mark.slow
@pytest.mark.parametrize("sun", np.arange(-12.0, 0.0, 1.0))
def test_as_the_sun_moves_through_twilight(climate_field, sun):
    """The picture of a film would jump where the sun passes a node, or the Earth's shadow an altitude of the field."""
    assert flicker([climate_field.radiance(sun + 0.01 * k, ELEVATION_DEG, AZIMUTH_DEG) for k in range(101)]) < LEAST


@pytest.mark.slow
def test_as_humidity_changes(climate_field):
    """Nodes in altitude and angle would jump from one air to the next."""
    skies = [
        [field.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG) for sun in (30.0, -2.0, -5.0)]
        for field in (climate_field, continental(75.1), continental(75.2))
    ]
    assert flicker(skies) < LEAST


@pytest.mark.slow
def test_as_the_observer_rises_through_a_climate(climate_field):
    """The sky would jump where an observer passes a level of the air (11 and 12 km) or a node of the field."""
    heights = np.arange(10.8, 12.2, 0.01)
    skies = [climate_field.radiance(-4.0, ELEVATION_DEG, AZIMUTH_DEG, observer_altitude_km=z) for z in heights]
    assert flicker(skies) < LEAST


def test_one_more_term_of_a_series_comes_in_without_a_step(monkeypatch):
    """Air that just needs the next degree or azimuthal order would differ from air that just does not: by up to 3 % in
    deep twilight, when terms came in whole."""
    medium = climate_medium(load_climate("maritime-clean"), np.array([450.0, 700.0]))
    few = replace(FEW_ORDERS, altitude_density=0.3, zenith_density=0.3, degree=14)

    def sky(part):
        def truncated(*air):
            return truncation_needed(*air)._replace(
                azimuthal_orders=14.0 + part, late_degree=9.0 + part, late_azimuthal_orders=8.0 + part
            )

        for name, needs in (("degree_needed", lambda *air: 16.0 + part), ("truncation_needed", truncated)):
            monkeypatch.setattr(f"twilight.solvers.zones.air_needs.{name}", needs)
            monkeypatch.setattr(grids, name, needs)
        solved = prepare(medium, few)
        return np.array([solved.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG) for sun in (10.0, -2.0, -8.0)])

    whole, more, one_more = (sky(part) for part in (0.0, 0.01, 1.0))
    # the terms count
    assert np.abs(one_more / whole - 1.0).max() > 5e-3
    assert np.abs(more / whole - 1.0).max() < LEAST


def test_what_the_air_needs_follows_its_humidity():
    """Terms would come in whole: each by 1 where the humidity changes by one per cent."""
    standard = QUALITIES["standard"]
    needed = []
    for percent in (52.0, 52.8, 53.6, 60.0, 60.8, 61.6):
        medium = humid("maritime-clean", percent, [450.0])
        settings, degree = grids.settings_for(medium, standard)
        needed.append([degree, *grids.lay_out(medium, delta_scaled(medium, degree), settings).truncation])
    bend = np.diff(np.reshape(needed, (2, 3, 4)), n=2, axis=1)
    assert np.abs(bend).max() < 0.05
    assert np.all(np.array(needed[-1]) > np.array(needed[0]) + 0.2)


def maritime(relative_humidity_percent):
    """The field of maritime-clean at a humidity, on few nodes with the directions of `standard`."""
    medium = humid("maritime-clean", relative_humidity_percent, [450.0, 550.0, 700.0])
    few = replace(QUALITIES["standard"], altitude_density=0.5, zenith_density=0.6, step_density=0.4, tolerance=1e-2)
    return prepare(medium, few)


@pytest.mark.slow
@pytest.mark.parametrize("percent", [(52.0, 52.8, 53.6, 54.4), (13.0, 13.7, 14.4, 15.1)])
def test_as_humidity_makes_particles_coarser(percent):
    """Directions, degrees and azimuths jumped with humidity: by 1.9 % at a sun of -8 deg, 3 % at -14 deg."""
    skies = [[field.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG) for sun in SUNS_DEG] for field in map(maritime, percent)]
    assert flicker(skies) < LEAST
