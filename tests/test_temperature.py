"""Derivatives by the temperature of layers: against differences of solutions and of two airs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from montecarlo_media import hazy_earth

import twilight
from twilight.atmosphere.layer_changes import BENT_STEPS, Shifted, changes_of, soft_layers
from twilight.base.errors import TwilightError
from twilight.base.progress import silent
from twilight.scene import shifted as shifted_air
from twilight.solvers import zones
from twilight.solvers.zones.derivatives import differentiate
from twilight.solvers.zones.directions import near_edges
from twilight.solvers.zones.field import Field
from twilight.solvers.zones.ray_points import SpeciesMoments
from twilight.solvers.zones.solve import solve
from twilight.transport.lines import with_refraction
from twilight.transport.profile import prepare_profile
from twilight.transport.scaling import delta_scaled

EDGES_KM = np.array([0.0, 4.0, 12.0, 26.0])
SUNS_DEG = np.array([0.0, 0.0, -4.0, -4.0])
"""Elevation of the sun for each line of sight [deg]."""
ELEVATIONS_DEG = np.array([90.0, 8.0, 90.0, 8.0])
"""Elevation of each line of sight [deg]."""
FAR = 8.0
"""Change of temperature [K] of the airs that are compared."""
AT_K = 250.0
"""Temperature [K] that the hazy air has at all altitudes."""


def warmer(medium, part, kelvin):
    """The medium with what a warmer air has of one part of its optics, or of all."""
    thinner = AT_K / (AT_K + kelvin)
    scattering = thinner if part in ("scattering", "all") else 1.0
    index = thinner if part in ("index", "all") else 1.0
    # cross sections that grow by 0.2 % a kelvin
    gases = 1.0 + 0.002 * kelvin if part in ("absorption", "all") else 1.0
    return replace(
        medium,
        air_scattering_per_km=medium.air_scattering_per_km * scattering,
        absorption_per_km=medium.absorption_per_km * gases,
        refractivity=medium.refractivity * index,
    )


def log_light(solved, base, air, bent_paths):
    """ln I (questions,) of a solution for other air, along rays with the steps of the base."""
    like, scaled = (delta_scaled(m, solved.grids.scaled.degree) for m in (base, air))
    profile = prepare_profile(scaled.medium, like=like.medium)
    profile = near_edges(profile, profile)
    bent = with_refraction(profile, scaled.medium)
    beam = replace(like.medium, refractivity=scaled.medium.refractivity)
    grids = replace(
        solved.grids,
        medium=air,
        scaled=scaled,
        scattering=SpeciesMoments.of(air, scaled, solved.grids.spin2_degree),
        profile=profile,
        line_profile=bent,
        path_profile=bent if bent_paths else with_refraction(profile, like.medium),
        layout=solved.grids.layout._replace(profile=profile, beam=beam, bends=scaled.medium),
        directions=replace(solved.grids.directions, tolerance=1e-6, max_orders=30),
    )
    sunbeam = grids.sunbeam()
    field = Field(grids, sunbeam, *solve(grids, sunbeam, silent))
    asked = zip(SUNS_DEG, ELEVATIONS_DEG, strict=True)
    return np.log([field.radiance(sun, elevation, 0.0).item() for sun, elevation in asked])


@pytest.fixture(scope="module")
def medium():
    return hazy_earth(wavelength_nm=(600.0,))


@pytest.fixture(scope="module")
def solved(medium):
    return zones.prepare(medium, zones.QUALITIES["draft"], sun_elevations_deg=[0.0, -4.0])


@pytest.mark.slow
@pytest.mark.parametrize("part", ["scattering", "absorption", "index", "all"])
def test_each_part_of_the_derivative_is_the_difference_of_solutions(medium, solved, part):
    # which part is wrong if the whole is: Rayleigh scattering, cross sections, or bends of sunbeam and lines of sight
    shifted = Shifted(warmer(medium, part, 0.5), 0.5)
    found = differentiate(solved, "temperature", EDGES_KM, shifted).log_slopes(SUNS_DEG, ELEVATIONS_DEG, 0.0)[0]
    pieces, weights = soft_layers(medium, EDGES_KM)
    base = medium.on_levels(pieces)
    for layer, weight in enumerate(weights):
        light = []
        for kelvin in (FAR, -FAR):
            other = warmer(base, part, kelvin * weight[:, None])
            light.append(log_light(solved, base, other, bent_paths=False))
        slope = (light[0] - light[1]) / (2.0 * FAR)
        np.testing.assert_allclose(found[:, layer, 0], slope, rtol=5e-3, atol=5e-3 * np.abs(found).max())


@pytest.mark.slow
def test_bends_between_two_scatterings_matter_little(medium, solved):
    shifted = Shifted(warmer(medium, "all", 0.5), 0.5)
    found = differentiate(solved, "temperature", EDGES_KM, shifted).log_slopes(SUNS_DEG, ELEVATIONS_DEG, 0.0)[0]
    pieces, weights = soft_layers(medium, EDGES_KM)
    base, weight = medium.on_levels(pieces), weights[1][:, None]
    light = [log_light(solved, base, warmer(base, "all", kelvin * weight), True) for kelvin in (FAR, -FAR)]
    np.testing.assert_allclose(found[:, 1, 0], (light[0] - light[1]) / (2.0 * FAR), rtol=0.02, atol=1e-5)


@pytest.mark.slow
def test_all_layers_together_are_the_difference_of_two_airs(monkeypatch):
    # each air has grids, levels and cross sections of its own
    suns = [0.0, -4.0]
    field = twilight.solve("pure-air", wavelength_nm=[330.0], quality="draft", sun_elevation_deg=suns)
    layers = field.jacobian(suns, 90.0, 0.0, by="temperature", edges_km=[0.0, 12.0, 30.0, 60.0, 100.0]).temperature
    assert layers.attrs["units"] == "K-1"
    light = []
    for way in (FAR, -FAR):
        monkeypatch.setattr(shifted_air, "KELVIN", way)
        air = shifted_air.shifted(field.scene, "temperature", field.medium.wavelength_nm).medium
        made = zones.prepare(air, replace(zones.QUALITIES["draft"], tolerance=1e-4), sun_elevations_deg=suns)
        light.append(np.array([made.radiance(sun, 90.0, 0.0).item() for sun in suns]))
    np.testing.assert_allclose(layers.sum("altitude")[:, 0], np.log(light[0] / light[1]) / (2.0 * FAR), rtol=0.02)


def test_warmer_air_is_thinner_at_the_same_pressure():
    scene = twilight.solve("pure-air", solver="cie", wavelength_nm=[330.0, 550.0]).scene
    air = shifted_air.shifted(scene, "temperature", scene.medium.wavelength_nm)
    ratio = air.medium.air_scattering_per_km / scene.medium.air_scattering_per_km
    np.testing.assert_allclose(air.medium.refractivity / scene.medium.refractivity, ratio, rtol=1e-4)
    # T / (T + step) of temperatures from 160 to 390 K
    assert np.all((ratio > 1.0 - air.step / 160.0) & (ratio < 1.0 - air.step / 390.0))
    # ozone's Huggins bands absorb more in warmer air, as far as cross sections were measured
    assert np.all(air.medium.absorption_per_km[5:30, 0] > scene.medium.absorption_per_km[5:30, 0])
    np.testing.assert_array_equal(air.medium.aerosol_extinction_per_km, scene.medium.aerosol_extinction_per_km)


def test_soft_layers_add_up_and_move_the_air_by_their_weight(medium):
    pieces, weights = soft_layers(medium, np.array([1.0, 2.5, 6.0, 100.0]))
    base = medium.on_levels(pieces)
    z = base.altitude_km
    assert np.all((weights >= 0.0) & (weights <= 1.0))
    np.testing.assert_allclose(weights.sum(axis=0)[z > 1.5], 1.0)
    assert np.all(weights[:, z <= 0.5] == 0.0) and np.all(weights[2][z >= 7.0] == 1.0)
    shifted = Shifted(warmer(medium, "all", 1.0), 1.0)
    changes = changes_of(medium, "temperature", np.array([1.0, 2.5, 6.0, 100.0]), shifted)
    whole = np.prod([m.air_scattering_per_km / base.air_scattering_per_km for m in changes.changed], axis=0)
    np.testing.assert_allclose(whole[z > 1.5], AT_K / (AT_K + 1.0))
    assert all(np.array_equal(m.refractivity, base.refractivity) for m in changes.changed)
    less, more = changes.bent[2]
    top = z >= 7.0
    np.testing.assert_allclose((more.refractivity / less.refractivity)[top], (AT_K / (AT_K + 1.0)) ** (2 * BENT_STEPS))
    # the levels of the ramps carry the same air
    np.testing.assert_allclose(base.optical_depth("air"), medium.optical_depth("air"), rtol=1e-5)


def test_air_without_temperatures_is_refused(tmp_path):
    table = tmp_path / "air.csv"
    columns = (
        "altitude_km,wavelength_nm,air_scattering_per_km,aerosol_extinction_per_km,aerosol_single_scattering_albedo,"
        "aerosol_asymmetry,absorption_per_km,refractivity"
    )
    table.write_text(f"{columns}\n0,550,0.012,0,0,0,0,0\n50,550,0.00003,0,0,0,0,0\n")
    field = twilight.solve({"version": 1, "medium": {"table": str(table)}}, wavelength_nm=[550.0], solver="cie")
    with pytest.raises(TwilightError, match="derivatives by temperature: a medium that is a table"):
        shifted_air.shifted(field.scene, "temperature", field.medium.wavelength_nm)
