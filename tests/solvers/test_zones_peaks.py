"""Sharp things in the zones solver: the glow around the sun and thin layers."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hazy_zones import QUICK, REFERENCE, read_table
from stability_media import Air, medium_of

from twilight.base.errors import TwilightWarning
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.zones.air_needs import altitude_nodes, resolve_layers, with_degree
from twilight.solvers.zones.aureole import forward_peak
from twilight.solvers.zones.constants import HIGHEST_DEGREE
from twilight.transport.profile import prepare_profile
from twilight.transport.scaling import delta_scaled

WAVELENGTH_NM = np.array([450.0, 650.0])
COARSE = replace(QUICK, zenith_density=0.4, beam_density=0.4, tolerance=3e-2)


@pytest.fixture(scope="module")
def desert():
    return climate_medium(load_climate("desert"), WAVELENGTH_NM)


def test_the_glow_does_not_depend_on_how_much_of_the_peak_is_scaled_away(desert):
    """The aureole would depend on the degree of the series."""
    elevation, azimuth = np.array([20.5, 21.0, 22.0, 24.0, 20.0]), np.array([0.0, 0.0, 0.0, 0.0, 3.0])
    sky = {}
    for degree in (8, 32):
        settings = replace(
            COARSE, degree=degree, max_degree=degree, azimuth_directions=degree + 1,
            polar_directions=max(9, degree // 2),
        )  # fmt: skip
        field = zones.prepare(desert, settings, sun_elevations_deg=[20.0])
        sky[degree] = field.radiance(20.0, elevation, azimuth)
        field.peak = None
        sky[-degree] = field.radiance(20.0, elevation, azimuth)
    with_it, without = (np.abs(sky[s * 8] / sky[s * 32] - 1.0).max() for s in (1, -1))
    assert with_it < 0.03
    assert without > 2.0 * with_it


@pytest.mark.slow
def test_red_light_beside_a_sun_on_the_horizon_needs_a_higher_degree_in_dust(desert):
    """What the peak moves into the dark horizon from the sky above it is lost where too much of it is scaled away.

    The reference solution (benchmarks/results/reference) at 550 and 680 nm, 1 deg above a sun at 0 deg; with few
    nodes, and without polarisation, the limit of high degrees is 1.5 and 1.9 % too dark.
    """
    medium = climate_medium(load_climate("desert"), np.array([550.0, 680.0]))
    table = read_table(REFERENCE / "desert.csv")
    here = (table["sun_elevation_deg"] == 0.0) & (table["elevation_deg"] == 1.0) & (table["azimuth_deg"] == 0.0)
    truth = [table["radiance_per_sr"][here & (table["wavelength_nm"] == nm)].item() for nm in medium.wavelength_nm]
    error = {}
    for most in (20, 32):
        settings = replace(
            zones.QUALITIES["standard"], max_degree=most, altitude_density=0.5, zenith_density=0.5,
            tolerance=2e-2, polarisation=False, step_density=1.0,
        )  # fmt: skip
        field = zones.prepare(medium, settings, sun_elevations_deg=[0.0])
        assert field.grids.directions.degree == most
        error[most] = 100.0 * (field.radiance(0.0, 1.0, 0.0) / truth - 1.0)
    assert error[20][1] < -4.5 and np.abs(error[32]).max() < 3.5, error
    assert np.all(error[32] > error[20] + [0.6, 2.0])


def test_ordinary_air_keeps_its_degree(desert):
    """Ordinary air would pay for degrees that dust needs."""
    standard = zones.QUALITIES["standard"]
    for climate in ("pure-air", "continental-average", "urban", "antarctic"):
        assert with_degree(standard, climate_medium(load_climate(climate), WAVELENGTH_NM)) == standard
    assert with_degree(standard, desert).degree == standard.max_degree
    asked = replace(standard, degree=40)
    assert with_degree(asked, desert) == asked


def test_polar_angles_grow_with_the_degree():
    """A sun at 30 deg in aerosol of asymmetry 0.95, two orders: the zenith. 9 polar angles lose a quarter of it."""
    medium = medium_of(Air(aerosol=0.5, asymmetry=0.95), refractivity=0.0)
    few = replace(
        QUICK, polarisation=False, max_orders=2, tolerance=0.0, altitude_density=0.3,
        zenith_density=0.5,
    )  # fmt: skip
    assert with_degree(few, medium).degree == 20 and with_degree(few, medium).polar_directions == 20
    seen = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TwilightWarning)  # two orders, and a very forward aerosol
        for polar, degree in ((9, 12), (9, 20), (32, 20)):
            settings = replace(few, polar_directions=polar, degree=degree)
            field = zones.prepare(medium, settings, sun_elevations_deg=[30.0])
            seen[polar, degree] = field.radiance(30.0, 90.0, 0.0)[0]
    assert seen[9, 12] == pytest.approx(seen[32, 20], rel=0.012)
    assert seen[9, 20] == pytest.approx(0.75 * seen[32, 20], rel=0.05)


def test_peaks_keep_what_the_series_has_left_out(desert):
    """The peak and the series together would not be the phase function."""
    scaled = delta_scaled(desert, 12)
    peak = forward_peak(desert, scaled, prepare_profile(scaled.medium))
    f = scaled.forward_fraction
    for k, phase in enumerate(desert.phase_functions):
        chi = phase.legendre_moments(HIGHEST_DEGREE).T
        ours = np.zeros_like(chi)
        ours[:13] = (1.0 - f[k]) * scaled.moments[1 + k]
        assert np.allclose(ours + f[k] * peak.moments[:, k], chi, atol=2e-3)
    column = np.trapezoid(peak.profile.extinction, peak.profile.altitude_km, axis=0)
    whole, rest = (
        np.trapezoid(prepare_profile(m).extinction, prepare_profile(m).altitude_km, axis=0)
        for m in (desert, scaled.medium)
    )
    assert np.allclose(column, whole - rest, rtol=1e-3)


def test_air_without_aerosol_has_no_peak():
    """Molecules would get a forward peak."""
    air = climate_medium(load_climate("pure-air"), WAVELENGTH_NM)
    assert zones.prepare(air, replace(COARSE, degree=6, late_degree=5, azimuth_directions=7)).peak is None


def test_altitudes_are_close_together_where_the_air_is_layered():
    """A layer between two nodes would be missed."""
    air = prepare_profile(climate_medium(load_climate("volcanic-extreme"), WAVELENGTH_NM))
    even = altitude_nodes(0.0, 100.0, np.array([]), 1.0)
    nodes = resolve_layers(even, air, 1.0)
    assert np.isin(even, nodes).all()
    layer = (nodes > 19.0) & (nodes < 22.0)
    assert np.diff(nodes[layer]).max() < 0.6
    above = nodes > 45.0
    assert above.sum() <= 2 * (even > 45.0).sum()


def test_a_thin_layer_is_seen_whatever_the_steps_are():
    """A step along a line of sight would jump over a thin layer."""
    air = climate_medium(load_climate("volcanic-extreme"), WAVELENGTH_NM)
    sky = [
        zones.prepare(air, replace(COARSE, max_orders=1, line_of_sight_density=density)).radiance(
            0.0, np.array([5.0, 30.0, 88.0]), 90.0
        )
        for density in (1.0, 3.0)
    ]
    assert np.allclose(sky[0], sky[1], rtol=0.012)


def test_a_peak_that_cannot_be_followed_is_reported(desert):
    """Asymmetry 0.95, optical depth 0.5: `standard` is up to 5 % off; the coarsest types of OPAC give no warning."""
    few = {"max_orders": 2, "tolerance": 0.0, "polarisation": False}
    sharp = medium_of(Air(aerosol=0.5, asymmetry=0.95))
    with pytest.warns(TwilightWarning, match=r"asymmetry 0.95 .*here the depth is 0.5"):
        zones.prepare(sharp, replace(COARSE, **few), sun_elevations_deg=[30.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        zones.prepare(desert, replace(COARSE, **few), sun_elevations_deg=[30.0])
