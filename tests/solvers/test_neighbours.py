"""What is computed at one wavelength does not depend on which others are asked for."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hazy_zones import QUICK, SCALAR
from stability_media import Air, medium_of

from twilight.atmosphere.grid_medium import GridMedium
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.config.load import load_climate
from twilight.engine import plan, solve
from twilight.scene import Scene
from twilight.scene.medium import climate_gas_bands, climate_medium
from twilight.solvers import zones
from twilight.solvers.zones.grids import lay_out
from twilight.transport.profile import expected_factors, prepare_profile
from twilight.transport.scaling import delta_scaled

WAVELENGTH_NM = np.array([360.0, 1000.0])
SUNS_DEG = (30.0, 0.0, -4.0, -9.0)
ELEVATION_DEG, AZIMUTH_DEG = (x.ravel() for x in np.meshgrid([0.5, 2.0, 5.0, 20.0, 60.0], [0.0, 60.0, 140.0, 180.0]))
MOST = 5e-4


def sky(medium, settings, bands=None, suns_deg=SUNS_DEG):
    """Radiance (suns, directions, W)."""
    solved = solve(Scene(medium, bands, zones, settings), suns_deg, cached=False)
    return np.array([solved.radiance(sun, ELEVATION_DEG, AZIMUTH_DEG) for sun in suns_deg])


def compare(climate, settings, wavelength_nm=WAVELENGTH_NM, most=MOST, in_bands=False, suns_deg=SUNS_DEG):
    medium = climate_medium(load_climate(climate), wavelength_nm)
    bands = climate_gas_bands(load_climate(climate), medium) if in_bands else None
    together = sky(medium, settings, bands, suns_deg)
    for w in range(medium.n_wavelengths):
        one = slice(w, w + 1)
        alone = sky(medium.select(one), settings, bands and bands.select(one), suns_deg)[..., 0]
        lit = alone > 1e-12
        moved = np.abs(together[..., w] / np.where(lit, alone, 1.0) - 1.0)[lit]
        assert moved.max() < most, f"{wavelength_nm[w]} nm: {moved.max():.2e}"


STANDARD_NM = np.array([380.0, 780.0])
FEW_ORDERS = replace(zones.QUALITIES["standard"], max_orders=3, tolerance=0.0, polarisation=False)
"""Each order sees all nodes, directions and steps."""
DARKER = {
    "band": lambda: compare("continental-average", SCALAR, np.array([720.0, 935.0]), in_bands=True),  # 20 times
    "standard": lambda: compare("urban", zones.QUALITIES["standard"], STANDARD_NM),
    "continental": lambda: compare("continental-average", FEW_ORDERS, STANDARD_NM),
    "desert": lambda: compare("desert", FEW_ORDERS, STANDARD_NM),
    "maritime": lambda: compare("maritime-tropical", FEW_ORDERS, STANDARD_NM),
    # 380 nm alone was 3.5 % off, sun at -18 deg: its lines ended behind 25 optical depths, but not beside 550 nm
    "volcanic": lambda: compare("volcanic-extreme", QUICK, np.array([380.0, 550.0]), suns_deg=(-9.0, -18.0)),
}


def test_neighbours_do_not_move_a_wavelength_on_coarse_grids():
    """In scalar theory; grids and orders are the same with polarisation, which takes longer."""
    compare("urban", SCALAR, suns_deg=(30.0, -4.0))


@pytest.mark.slow
@pytest.mark.parametrize("case", DARKER)
def test_neighbours_do_not_move_a_wavelength(case):
    """Nodes, directions, steps or the number of orders would follow another wavelength's air."""
    DARKER[case]()


def test_terms_of_a_band_have_the_nodes_of_the_air_without_it():
    """A band would need nodes of its own."""
    medium = climate_medium(load_climate("continental-average"), np.array([700.0, 762.0, 935.0]))
    bands = climate_gas_bands(load_climate("continental-average"), medium)
    wide = bands.expand(medium)
    assert wide.n_wavelengths > 9 and wide.optical_depth("absorption").max() > 10.0
    made = {}
    for name, air in (("band", wide), ("without", medium), ("unknown", replace(wide, grid_medium=None))):
        layout = lay_out(air, delta_scaled(air, 12), QUICK)
        made[name] = layout.altitude_km.size
        # the coefficients are those of the terms
        assert layout.profile.extinction.max() == pytest.approx(air.extinction_per_km.max(), rel=0.05)
    assert made["band"] == made["without"]
    # where the fixed wavelengths are not known the clearest term of each wavelength is followed
    assert made["unknown"] < 2 * made["without"]


@pytest.mark.parametrize("climate", ["urban", "desert", "maritime-tropical", "volcanic-extreme"])
def test_visible_light_is_one_block(climate):
    """Visible light would be solved in several fields."""
    medium = climate_medium(load_climate(climate), np.array([380.0, 440.0, 472.0, 548.0, 580.0, 616.0, 676.0, 720.0]))
    assert plan(Scene(medium, None, zones, zones.QUALITIES["standard"])).slices == [slice(0, 8)]


@pytest.mark.parametrize(
    "same",
    [
        lambda m: {"ground_albedo": 0.5 + 0.0 * m.ground_albedo},
        lambda m: {"name": "another", "notes": {}},
        lambda m: {"overhead_absorption_optical_depth": 0.1 + m.overhead_absorption_optical_depth},
        lambda m: {"absorption_per_km": m.absorption_per_km.copy()},
    ],
)
def test_replace_keeps_the_grid_medium_with_the_same_optics(same):
    """Otherwise another ground would change the grid in silence."""
    medium = climate_medium(load_climate("urban"), np.array([380.0, 700.0]))
    assert replace(medium, **same(medium)).at_grid_wavelengths is medium.at_grid_wavelengths is not None


@pytest.mark.parametrize(
    "other",
    [
        lambda m: {"absorption_per_km": 1.001 * m.absorption_per_km},
        lambda m: {"refractivity": 0.0 * m.refractivity},
        lambda m: {"depolarisation": 0.0 * m.depolarisation},
        lambda m: {"altitude_km": 1.01 * m.altitude_km},
        lambda m: {"earth_radius_km": 6400.0},
        lambda m: {"phase_functions": tuple(p.select(slice(None)) for p in m.phase_functions)},
    ],
)
def test_replace_drops_the_grid_medium_with_other_optics(other):
    """Otherwise the grid would be that of air which is not there."""
    medium = climate_medium(load_climate("urban"), np.array([380.0, 700.0]))
    assert replace(medium, **other(medium)).at_grid_wavelengths is None
    given = replace(medium, **other(medium), grid_medium=GridMedium.of(medium))
    assert given.at_grid_wavelengths is medium


def test_changed_air_has_grids_of_its_own():
    """Five times as much aerosol: 380 and 700 nm need other nodes than the thinner air has."""
    medium = climate_medium(load_climate("urban"), np.array([380.0, 700.0]))
    assert medium.select(slice(0, 1)).at_grid_wavelengths is medium.at_grid_wavelengths
    thicker = replace(medium, aerosol_extinction_per_km=5.0 * medium.aerosol_extinction_per_km)
    keys = zones.CAPABILITIES.spectral_groups(thicker, QUICK)
    assert keys[0] != keys[1]
    # air thicker than what the grid was made for
    stale = replace(thicker, grid_medium=GridMedium.of(medium))
    assert zones.CAPABILITIES.spectral_groups(stale, QUICK) == keys


def test_grid_medium_leaves_out_wavelengths_without_optics():
    """A table that ends would be refused."""

    def build(wavelength_nm):
        if np.any(wavelength_nm > 700.0):
            raise TwilightError("the table ends at 700 nm")
        return medium_of(Air(aerosol=1.0))

    asked = np.array([600.0, 800.0])
    assert GridMedium.on_demand(build, asked).medium is not None
    assert GridMedium.on_demand(build, asked[1:]).medium is None


def test_only_wavelengths_that_need_other_grids_are_solved_apart():
    """From 360 nm on they share their grids; ozone is thick at 300 nm, less so at 330 nm."""
    medium = climate_medium(load_climate("continental-average"), np.array([300.0, 330.0, 360.0, 450.0, 550.0, 700.0]))
    problem = plan(Scene(medium, None, zones, QUICK))
    assert problem.slices == [slice(0, 1), slice(1, 2), slice(2, 6)]
    # a file holds one field
    stored = plan(Scene(medium, None, zones, replace(QUICK, field_file="field.h5")))
    assert stored.slices == [slice(0, 6)]


def test_steps_follow_the_air_where_it_is_thicker_than_they_are_made_for():
    """Thick wavelengths would be stepped over."""
    profile = prepare_profile(medium_of(Air(aerosol=1.0), Air(aerosol=20.0)))
    assert expected_factors(profile.altitude_km, profile.extinction[:, 0]) == (4.0, 1.0)
    assert expected_factors(profile.altitude_km, profile.extinction[:, 1]) is None
    assert np.all(profile.thickest_per_km >= profile.extinction.max(axis=1))


@pytest.mark.parametrize(("thinner", "said"), [(1e-4, True), (0.1, False)])
def test_one_field_for_wavelengths_that_need_different_grids_is_said_to_be_wrong(thinner, said):
    """Haze beside thin air, in one field and by the way that keeps them apart."""
    medium = medium_of(Air(aerosol=1.0), Air(air=0.1 * thinner, aerosol=thinner), refractivity=0.0)
    coarse = replace(
        QUICK, altitude_density=0.3, zenith_density=0.3, max_orders=2, tolerance=0.0,
        polar_directions=4, degree=6, azimuth_directions=5, late_azimuth_directions=5, late_polar_directions=4,
    )  # fmt: skip
    suns = (30.0,)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always", TwilightWarning)
        zones.prepare(medium, coarse, sun_elevations_deg=suns)
    assert ["need different grids" in str(w.message) for w in warned] == [True] * said
    scene = Scene(medium, None, zones, coarse)
    assert plan(scene, suns).slices == [slice(0, 1), slice(1, 2)]
    with warnings.catch_warnings():
        warnings.simplefilter("error", TwilightWarning)
        solve(scene, suns, cached=False)
