"""Clouds: their optics beside published tables, their layers in the air, and what a climate may say of them."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hazy_zones import QUICK
from montecarlo_media import slab

from twilight.atmosphere.clouds import CloudLayer, cirrus_optics, refractive_index
from twilight.atmosphere.mie import Gamma, compute_optics
from twilight.config.load import load_climate
from twilight.numerics.phase import TABLE, PhaseFunction
from twilight.scene.medium import climate_medium, cloud_layers
from twilight.scene.plan import facts
from twilight.solvers import zones

C1_SERIES = np.array(
    [1.0, 2.544, 3.883, 4.568, 5.235, 5.887, 6.457, 7.177, 7.859, 8.494, 9.286, 9.856, 10.615, 11.229, 11.851, 12.503,
     13.058, 13.626, 14.209, 14.66, 15.231, 15.641, 16.126, 16.539, 16.934, 17.325, 17.673, 17.999, 18.329]
)  # fmt: skip
"""(2 l + 1) chi_l of cloud C.1: Garcia & Siewert 1985, Transp. Theory Stat. Phys. 14, 437, table 17, from l = 0."""

STRATUS = {
    0.5: 260.3, 1.0: 138.4, 2.0: 21.9, 5.0: 1.63, 10.0: 0.638, 20.0: 0.333, 60.0: 0.0215, 90.0: 0.00254, 142.0: 0.0252,
    160.0: 0.0106,
}  # fmt: skip
"""Phase function [sr^-1] of OPAC's continental stratus at 550 nm by scattering angle [deg] (Hess et al. 1998)."""


def test_droplets_are_those_of_cloud_c1():
    """The whole size distribution would be wrong: moments are published to 0.1 %, at 700 nm with an index of 1.33."""
    row = compute_optics(Gamma(6.0, 1.0 / 9.0), 1.33 + 0j, 700.0)
    phase = PhaseFunction(TABLE, np.zeros(1), row[None, 3:516])
    chi = phase.legendre_moments(28)[0]
    np.testing.assert_allclose((2 * np.arange(29) + 1) * chi, C1_SERIES, rtol=1e-3)
    assert row[2] == pytest.approx(C1_SERIES[1] / 3.0, rel=1e-3)


def test_a_thick_cloud_c1_has_its_published_fluxes():
    """Depth 64, nothing absorbed, sun overhead (Garcia & Siewert 1985, tables 19 and 20): flux 2.66174 up and 0.479851
    down for a beam of pi, and the radiance of the zenith 0.19523 and at 60 deg from it 0.13199."""
    row = compute_optics(Gamma(6.0, 1.0 / 9.0), 1.33 + 0j, 700.0)
    phase = PhaseFunction(TABLE, row[2:3], row[None, 3:516])
    medium = slab(64.0, 1.0, phase, radius_km=2e5)
    settings = replace(QUICK, polar_directions=14, late_degree=7, late_polar_directions=7, late_azimuth_directions=7)
    field = zones.prepare(medium, settings, sun_elevations_deg=[90.0])
    mu, weight = np.polynomial.legendre.leggauss(12)
    mu, weight = 0.5 * (mu + 1.0), 0.5 * weight
    down, up = (
        2.0
        * np.pi**2
        * (weight * mu)
        @ field.radiance(90.0, sign * np.degrees(np.arcsin(mu)), 0.0, observer_altitude_km=z)
        for sign, z in ((1.0, 0.0), (-1.0, 1.0))
    )
    zenith = np.pi * field.radiance(90.0, np.array([90.0, 30.0]), 0.0)[:, 0]
    np.testing.assert_allclose([down[0], up[0], *zenith], [0.479851, 2.66174, 0.19523, 0.13199], rtol=0.03)


def test_a_gamma_distribution_has_the_radius_and_variance_that_it_says():
    """Radii would mean something else."""
    r = np.geomspace(0.01, 100.0, 20001)
    dn = Gamma(6.0, 0.1).density(np.log(r)) * np.gradient(np.log(r))
    area = np.sum(r**2 * dn)
    assert np.sum(dn) == pytest.approx(1.0, abs=1e-4)
    assert np.sum(r**3 * dn) / area == pytest.approx(6.0, rel=1e-4)
    assert np.sum((r - 6.0) ** 2 * r**2 * dn) / (36.0 * area) == pytest.approx(0.1, rel=1e-3)


def test_stratus_scatters_as_opac_says():
    """OPAC's droplets have another distribution of the same effective radius: within 5 %, rainbow and corona too."""
    row = compute_optics(Gamma(7.33, 1.0 / 9.0), refractive_index("water", 550.0), 550.0)
    phase = PhaseFunction(TABLE, np.zeros(1), row[None, 3:516])
    own = phase(np.cos(np.radians(list(STRATUS))))[0]
    np.testing.assert_allclose(own, list(STRATUS.values()), rtol=0.05)


def test_cirrus_has_its_halos():
    """OPAC's asymmetry of 0.778, 0.783, 0.789, its jump from 0.036 to 0.45 sr^-1 at 21 deg, and the one at 46 deg."""
    optics = cirrus_optics(np.array([400.0, 550.0, 780.0]))
    np.testing.assert_allclose(optics.phase.asymmetry, [0.778, 0.783, 0.789], atol=0.008)
    inside, halo, between, outer = optics.phase(np.cos(np.radians([20.0, 22.0, 44.0, 48.0])))[1]
    assert 10.0 < halo / inside < 15.0 and 2.0 < outer / between < 2.5
    assert np.all(optics.phase.ratios == 0.0)
    beyond = cirrus_optics(np.array([300.0, 1000.0]))
    assert np.all(np.isfinite(beyond.phase.log_table)) and np.all(beyond.single_scattering_albedo == 1.0)


def test_a_hundred_grains_of_50_nm_are_the_default_noctilucent_cloud():
    """Depth of 1 km by Rayleigh's law: the grains are small, and blue light is scattered ten times more than red."""
    grain = compute_optics(Gamma(0.05, 1.0 / 9.0), refractive_index("ice", 550.0), 550.0)
    assert 100.0 * grain[0] == pytest.approx(1e-5, rel=0.1)
    k = CloudLayer("noctilucent", 82.4, 83.4, 1e-5, 0.05).region([380.0, 550.0, 720.0]).extinction_per_km
    np.testing.assert_allclose(k[:, 1], 1e-5, rtol=1e-9)
    assert 8.0 < k[0, 0] / k[0, 2] < 14.0


def climate_of(tmp_path, clouds: str, more: str = ""):
    path = tmp_path / "cloudy.yaml"
    path.write_text(f"version: 1\nname: cloudy\nclouds: {clouds}\n{more}")
    return load_climate(path)


def test_layers_stand_where_they_are_and_add_up(tmp_path):
    """Clouds would be thicker or thinner than they say, or the air below them other than without."""
    w = np.array([450.0, 550.0])
    clear = climate_medium(climate_of(tmp_path, "[]"), w)
    clouds = (
        "[{kind: stratus, optical_depth: 4}, {kind: cirrus}, "
        "{kind: altostratus, base_km: 0.8, top_km: 2, optical_depth: 3}]"
    )
    cloudy = climate_medium(climate_of(tmp_path, clouds), w)
    np.testing.assert_allclose(cloudy.optical_depth("aerosol")[1], 8.0, rtol=1e-9)
    np.testing.assert_allclose(cloudy.optical_depth("air"), clear.optical_depth("air"), rtol=1e-6)
    extinction = cloudy.at([0.4, 0.7, 0.9, 1.5, 5.0, 9.5]).aerosol_extinction[:, 1]
    np.testing.assert_allclose(extinction, [0.0, 8.0, 10.5, 2.5, 0.0, 1.0 / 1.5], rtol=1e-9)
    assert ("particles: stratus cloud", "0.5 to 1 km") in facts(cloudy)


def test_fog_stands_on_high_ground_and_nothing_has_no_optics(tmp_path):
    """Fog would hang below a mountain, and a cloud of depth 0 would cost."""
    climate = climate_of(tmp_path, "[{kind: fog}, {kind: stratus, optical_depth: 0}]", "ground: {altitude_km: 1.6}")
    assert [(layer.base_km, round(layer.top_km, 6)) for layer in cloud_layers(climate)] == [(1.6, 1.8)]


def test_the_sky_through_cirrus_has_a_halo_and_no_rings(tmp_path):
    """Crystals scatter into a peak of a tenth of a degree, whose series ends in rings of tens of per cent."""
    medium = climate_medium(climate_of(tmp_path, "[{kind: cirrus, optical_depth: 0.5}]"), np.array([550.0]))
    settings = replace(zones.QUALITIES["draft"], polarisation=False, zenith_density=0.5, altitude_density=0.35)
    field = zones.prepare(medium, settings, sun_elevations_deg=[25.0])
    away = np.arange(2.0, 21.0)
    near = field.radiance(25.0, 25.0 + away, 0.0)[:, 0]
    assert np.all(near[1:] < 1.06 * near[:-1])
    inside, halo, outside = field.radiance(25.0, 25.0 + np.array([20.0, 22.5, 32.0]), 0.0)[:, 0]
    assert halo > 2.0 * inside and halo > 2.0 * outside


def test_near_the_sun_cirrus_is_as_small_angles_say():
    """The aureole of ice crystals would be too bright or too dark: 12 to 29 % where moments beyond the truncated degree
    that exceed the forward fraction, as halos have them, were cut.

    Light that is deflected little has crossed the depth t / cos once, however often it was scattered: all orders are
    e^-t sum (2l+1)/4pi (e^(t chi_l) - 1) P_l.
    """
    phase, depth = cirrus_optics(np.array([550.0])).phase, 0.5
    away = np.array([0.3, 0.6, 1.0, 2.0, 3.0, 5.0])
    cosine, degree = np.cos(np.radians(away)), 3000
    chi, n = phase.legendre_moments(degree)[0], np.arange(degree + 1)
    fading = np.sin(0.5 * np.pi * np.minimum(1.0, 2.0 - 2.0 * n / degree)) ** 2
    series = fading * (2 * n + 1) / (4.0 * np.pi) * (np.exp(depth * chi) - 1.0 - depth * chi)
    expected = depth * phase(cosine)[0] + np.polynomial.legendre.legval(cosine, series)
    settings = replace(zones.QUALITIES["draft"], polarisation=False, refraction=False)
    field = zones.prepare(slab(depth, 1.0, phase, radius_km=2e5), settings, sun_elevations_deg=[90.0])
    found = field.radiance(90.0, 90.0 - away, 0.0)[:, 0]
    np.testing.assert_allclose(found, np.exp(-depth) * expected, rtol=0.025)


def test_decks_are_near_doubling_and_adding():
    """The table that docs quote would say otherwise (`python benchmarks/clouds.py`)."""
    lines = (Path(__file__).parents[2] / "benchmarks" / "results" / "clouds_plane.csv").read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert {float(row["optical_depth"]) for row in rows} == {0.1, 1.0, 10.0, 100.0}
    for quality, most in (("draft", 4.5), ("standard", 3.0)):
        worst = max(rows, key=lambda row: abs(float(row[f"{quality}_percent"])))
        assert abs(float(worst[f"{quality}_percent"])) < most, worst
