"""Airs in closed form that tests of several parts share, scenes of fields in closed form, and fields as skies."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from toy_sky import texture_grid

from twilight.atmosphere.medium import Medium
from twilight.config.scene import Observer
from twilight.numerics.phase import PhaseFunction
from twilight.scene import Scene
from twilight.sky.sky import Sky
from twilight.solvers.base import Capabilities

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
        wavelength_nm=np.asarray(wavelength_nm, float), altitude_km=z, air_scattering_per_km=scattering,
        absorption_per_km=0.0 * one, aerosol_extinction_per_km=aerosol, aerosol_single_scattering_albedo=one,
        aerosol_phase_fraction=one[None], phase_functions=(PhaseFunction.henyey_greenstein(np.full(n, 0.7)),),
        refractivity=0.0 * one, depolarisation=np.zeros(n), ground_albedo=np.full(n, albedo),
        overhead_absorption_optical_depth=np.zeros(n), name="test-air",
    )  # fmt: skip


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
        wl, levels, scattering * fall * (550.0 / wl) ** 4, zero, zero, zero, np.zeros((0, *shape)), (),
        n * (1.0 + 0.0075 * ((550.0 / wl) ** 2 - 1.0)), np.zeros(wl.size), np.zeros(wl.size), np.zeros(wl.size),
    )  # fmt: skip


def on_levels(medium: Medium, altitude_km, values_at_km=None, **changes) -> Medium:
    """The medium's values at other levels [km]; values_at_km: take those of other altitudes; changes: fields of it."""
    at = medium.at(altitude_km if values_at_km is None else values_at_km)
    return replace(
        medium,
        **{
            "altitude_km": altitude_km,
            "air_scattering_per_km": at.air_scattering,
            "absorption_per_km": at.absorption,
            "aerosol_extinction_per_km": at.aerosol_extinction,
            "aerosol_single_scattering_albedo": at.aerosol_albedo,
            "aerosol_phase_fraction": at.aerosol_phase_fraction,
            "refractivity": at.refractivity,
            **changes,
        },
    )


def scene_of_field(field, *, every_observer=True) -> Scene:
    """The scene of a solver whose field is there: of `field.medium`, for any sun, without refraction."""
    solver = SimpleNamespace(
        __name__=type(field).__name__.lower(),
        CAPABILITIES=Capabilities(every_sun=True, every_observer=every_observer),
        QUALITIES={},
        prepare=lambda medium, settings, **options: field,
    )
    settings = SimpleNamespace(refraction=False)
    return Scene(field.medium, None, solver, settings, (), Observer(altitude_km=0.0), type(field).__name__.lower())
