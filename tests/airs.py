"""Airs in closed form that tests of several parts share, and a computed field as a sky."""

from __future__ import annotations

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.phase import PhaseFunction
from twilight.sky import Sky, texture_grid

WAVELENGTH_NM = np.linspace(380.0, 720.0, 18)


def turbid(turbidity=3.0, wavelength_nm=WAVELENGTH_NM, albedo=0.2) -> Medium:
    """Exponential air and aerosol of that turbidity at 550 nm."""
    z = np.linspace(0.0, 60.0, 61)
    relative = np.asarray(wavelength_nm, float) / 550.0
    scattering = 0.0125 * np.exp(-z / 8.0)[:, None] * relative**-4.08
    aerosol = 0.0125 * 8.0 / 1.2 * (turbidity - 1.0) * np.exp(-z / 1.2)[:, None] * relative**-1.3
    # the rule between levels is exponential, so the columns are exact up to the top
    aerosol *= (1 - np.exp(-60 / 8.0)) / (1 - np.exp(-60 / 1.2))
    one = np.ones_like(scattering)
    n = relative.size
    return Medium(
        wavelength_nm=np.asarray(wavelength_nm, float),
        altitude_km=z,
        air_scattering_per_km=scattering,
        absorption_per_km=0.0 * one,
        aerosol_extinction_per_km=aerosol,
        aerosol_single_scattering_albedo=one,
        aerosol_share=one[None],
        phase_functions=(PhaseFunction.henyey_greenstein(np.full(n, 0.7)),),
        refractivity=0.0 * one,
        depolarisation=np.zeros(n),
        ground_albedo=np.full(n, albedo),
        overhead_absorption_optical_depth=np.zeros(n),
        name="test-air",
    )


def as_sky(field, sun: float, step_deg: float = 10.0) -> Sky:
    elevation, azimuth = texture_grid(step_deg)
    radiance = field.radiance(sun, elevation[:, None], azimuth)
    return Sky(field.medium.wavelength_nm, elevation, azimuth, radiance, sun_elevation_deg=sun)


def pure_air(levels, refractivity=2.8e-4, scale_km=8.0, scattering=0.0115, wavelengths=(400.0, 550.0, 700.0)):
    """Exponential air; a refractivity function of altitude may be given instead of a number."""
    levels = np.asarray(levels, dtype=float)
    wl = np.asarray(wavelengths)
    shape = (levels.size, wl.size)
    fall = np.exp(-levels / scale_km)[:, None]
    n = refractivity(levels)[:, None] * np.ones(wl.size) if callable(refractivity) else refractivity * fall
    zero = np.zeros(shape)
    return Medium(
        wl,
        levels,
        scattering * fall * (550.0 / wl) ** 4,
        zero,
        zero,
        zero,
        np.zeros((0, *shape)),
        (),
        n * (1.0 + 0.0075 * ((550.0 / wl) ** 2 - 1.0)),
        np.zeros(wl.size),
        np.zeros(wl.size),
        np.zeros(wl.size),
    )
