"""Aerosol of the stratosphere: LOWTRAN's models and what SAGE II measured."""

import numpy as np
import pytest

from twilight.atmosphere.build import build_medium
from twilight.atmosphere.opac import opac_type
from twilight.atmosphere.stratosphere import (
    LOWTRAN_KINDS,
    SAGE_WAVELENGTH_NM,
    StratosphereSpec,
    sage_extinction_per_km,
    sage_scenarios,
)
from twilight.base.shipped_data import data_file


@pytest.mark.parametrize("kind", LOWTRAN_KINDS)
@pytest.mark.parametrize("season", ["fall_winter", "spring_summer"])
def test_lowtran_stratosphere(kind, season):
    """A volcanic stratosphere would have another column than LOWTRAN's table, or stand beside OPAC's."""
    spec = StratosphereSpec(kind, season)
    medium = build_medium([550.0], aerosol=opac_type("continental clean"), stratosphere=spec)
    parts = medium.notes["optical_depth"]
    assert "stratosphere" not in parts  # OPAC's own is replaced
    column = {"background": "bast", "moderate_volcanic": "vumo", "high_volcanic": "hivu", "extreme_volcanic": "exvu"}
    text = data_file("stratosphere/lowtran_extinction_550nm.csv").read_text(encoding="utf-8")
    published = np.genfromtxt(text.splitlines(), delimiter=",", names=True)
    extinction = published[column[kind] + {"fall_winter": "fw", "spring_summer": "ss"}[season]]
    used = (published["z_km"] >= 11) & (published["z_km"] <= 30)
    by_hand = np.trapezoid(extinction[used], published["z_km"][used])
    assert parts[f"stratosphere ({kind})"][0] == pytest.approx(by_hand, rel=0.08)  # there linear, here exponential
    assert 1e-4 < parts["upper atmosphere"][0] < 1e-3
    assert medium.notes["regions"][1] == ("free troposphere", 2.0, 11.0)
    # 30 km: meteoric dust takes over at the same extinction at 550 nm
    i = int(np.flatnonzero(medium.altitude_km == 30.0)[0])
    assert medium.aerosol_extinction_per_km[i] == pytest.approx(medium.aerosol_extinction_per_km[i + 1], rel=1e-6)
    assert medium.at([60.0]).aerosol_extinction[0, 0] > 0


def test_lowtran_options():
    """Age and upper atmosphere of LOWTRAN's aerosol would do nothing."""

    def depth(**options):
        spec = StratosphereSpec("high_volcanic", **options)
        return build_medium([400.0, 550.0, 700.0], stratosphere=spec)

    fresh, aged = depth(), depth(optics="aged_volcanic")
    assert fresh.optical_depth("aerosol")[1] == pytest.approx(aged.optical_depth("aerosol")[1], rel=1e-9)
    assert aged.optical_depth("aerosol")[0] > fresh.optical_depth("aerosol")[0]
    i = int(np.flatnonzero(aged.altitude_km == 18.0)[0])
    albedo = aged.aerosol_single_scattering_albedo[i, 1]
    assert albedo == pytest.approx(1 - 0.05272, abs=1e-9)
    extreme = depth(upper_atmosphere="extreme").notes["optical_depth"]["upper atmosphere"][1]
    assert extreme > 3 * fresh.notes["optical_depth"]["upper atmosphere"][1]


def test_measured_stratosphere():
    """A measured profile would have another column, place or decay above its top."""
    assert len(sage_scenarios()) == 12
    medium = build_medium(
        [550.0], aerosol=opac_type("continental clean"), stratosphere=StratosphereSpec("nh_midlat_typical")
    )
    name = "stratosphere (nh_midlat_typical)"
    assert medium.notes["optical_depth"][name][0] == pytest.approx(0.0055, abs=0.0005)
    assert ("free troposphere", 2.0, 16.5) in medium.notes["regions"]
    np.testing.assert_allclose(medium.aerosol_phase_fraction.sum(axis=0), 1.0, rtol=1e-12)
    # above the observed top it falls with the scenario's scale height, 2.8 km
    at = medium.at([31.0, 33.8]).aerosol_extinction[:, 0]
    assert at[0] / at[1] == pytest.approx(np.e, rel=1e-6)


def test_measured_spectrum_interpolation():
    """A bad channel of a measured spectrum would reach its neighbours."""
    wavelength = np.array([300.0, 384.0, 500.0, 1021.0, 1000.0])
    power_law = (SAGE_WAVELENGTH_NM / 550.0) ** -1.7
    got = sage_extinction_per_km(power_law[None, :], wavelength)[0]
    np.testing.assert_allclose(got, (wavelength / 550.0) ** -1.7, rtol=1e-9)
    holes = power_law.copy()
    holes[[0, 3]] = np.nan, -1e-5
    got = sage_extinction_per_km(holes[None, :], wavelength)[0]
    np.testing.assert_allclose(got, (wavelength / 550.0) ** -1.7, rtol=1e-9)


def test_stratosphere_without_troposphere():
    """A stratosphere alone would bring aerosol into the troposphere."""
    medium = build_medium([550.0], stratosphere=StratosphereSpec("background"))
    assert medium.at([5.0]).aerosol_extinction[0, 0] == 0
    assert medium.at([15.0]).aerosol_extinction[0, 0] > 0
