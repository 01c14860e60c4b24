"""Small media for the tests of the Monte-Carlo solver, and what several of those tests compute."""

import numpy as np
from scipy.stats import norm

from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import PhaseFunction

# Legendre coefficients (2 l + 1) chi_l, l = 1..82, of the Haze-L phase function: Garcia & Siewert 1985, Table 10
HAZE_L = [
    2.41260, 3.23047, 3.37296, 3.23150, 2.89350, 2.49594, 2.11361, 1.74812, 1.44692, 1.17714, 0.96643, 0.78237,
    0.64114, 0.51966, 0.42563, 0.34688, 0.28351, 0.23317, 0.18963, 0.15788, 0.12739, 0.10762, 0.08597, 0.07381,
    0.05828, 0.05089, 0.03971, 0.03524, 0.02720, 0.02451, 0.01874, 0.01711, 0.01298, 0.01198, 0.00904, 0.00841,
    0.00634, 0.00592, 0.00446, 0.00418, 0.00316, 0.00296, 0.00225, 0.00210, 0.00160, 0.00150, 0.00115, 0.00107,
    0.00082, 0.00077, 0.00059, 0.00055, 0.00043, 0.00040, 0.00031, 0.00029, 0.00023, 0.00021, 0.00017, 0.00015,
    0.00012, 0.00011, 0.00009, 0.00008, 0.00006, 0.00006, 0.00005, 0.00004, 0.00004, 0.00003, 0.00003, 0.00002,
    0.00002, 0.00002, 0.00001, 0.00001, 0.00001, 0.00001, 0.00001, 0.00001, 0.00001, 0.00001,
]  # fmt: skip


def haze_l() -> PhaseFunction:
    """The Haze-L phase function as a table."""
    angle = np.pi * np.linspace(0.0, 1.0, 4001) ** 2
    series = np.concatenate([[1.0], HAZE_L]) / (4 * np.pi)
    return PhaseFunction.from_samples(angle, np.polynomial.legendre.legval(np.cos(angle), series)[None], n_nodes=1025)


def slab(depth, albedo, phase=None, ground=0.0, radius_km=2e6) -> Medium:
    """A uniform layer 1 km thick on a planet so large that it is flat; `phase` None scatters like air."""
    one = np.ones((2, 1))
    air = one * depth * albedo if phase is None else 0 * one
    return Medium(
        wavelength_nm=np.array([500.0]),
        altitude_km=np.array([0.0, 1.0]),
        air_scattering_per_km=air,
        absorption_per_km=one * depth * (1 - albedo) if phase is None else 0 * one,
        aerosol_extinction_per_km=0 * one if phase is None else one * depth,
        aerosol_single_scattering_albedo=one * albedo,
        aerosol_phase_fraction=np.zeros((0, 2, 1)) if phase is None else one[None],
        phase_functions=() if phase is None else (phase,),
        refractivity=0 * one,
        depolarisation=np.zeros(1),
        ground_albedo=np.full(1, ground),
        overhead_absorption_optical_depth=np.zeros(1),
        earth_radius_km=radius_km,
    )


def hazy_earth(ground=0.3, wavelength_nm=(550.0,), refractivity=2.7e-4, table_phase=False) -> Medium:
    """Air, an ozone layer and a hazy boundary layer with a jump at its top, over a grey ground."""
    w = np.array(wavelength_nm)
    z = np.array([0.0, 1.0, 2.0, 2.0, 4.0, 8.0, 12.0, 18.0, 22.0, 26.0, 35.0, 50.0, 70.0, 100.0])
    one = np.ones((z.size, w.size))
    air = 0.0121 * (550.0 / w) ** 4.1 * np.exp(-z / 8.0)[:, None]
    haze = np.where(np.arange(z.size) < 3, 0.08, 0.006)[:, None] * np.exp(-z / 3.0)[:, None] * one
    ozone = 0.0024 * np.exp(-(((z - 22.0) / 6.0) ** 2))[:, None] * one
    phase = PhaseFunction.henyey_greenstein(np.full(w.size, 0.7))
    if table_phase:
        angle = np.pi * np.linspace(0.0, 1.0, 513) ** 2
        phase = PhaseFunction.from_samples(angle, phase(np.cos(angle)))
    return Medium(
        wavelength_nm=w, altitude_km=z, air_scattering_per_km=air, absorption_per_km=ozone,
        aerosol_extinction_per_km=haze, aerosol_single_scattering_albedo=0.92 * one, aerosol_phase_fraction=one[None],
        phase_functions=(phase,), refractivity=refractivity * np.exp(-z / 8.0)[:, None] * one,
        depolarisation=np.full(w.size, 0.03), ground_albedo=np.full(w.size, ground),
        overhead_absorption_optical_depth=np.zeros(w.size),
    )  # fmt: skip


def assert_all_agree(value, error, truth, significance=0.01):
    """z-tests of many values at once: the largest |z| must be likely among so many (Sidak)."""
    z = (np.ravel(value) - np.ravel(truth)) / np.ravel(error)
    worst = np.argmax(np.abs(z))
    p_single = 2 * norm.sf(abs(z[worst]))
    p_family = -np.expm1(z.size * np.log1p(-p_single))
    ratio = np.ravel(value)[worst] / np.ravel(np.broadcast_to(truth, np.shape(value)))[worst]
    assert p_family > significance, f"z = {z[worst]:.2f} at {worst} of {z.size}, ratio {ratio:.4f}, p = {p_family:.2g}"
