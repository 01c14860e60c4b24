"""Algorithm 4.1: the tables of a medium, order by order."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from twilight.base.progress import Progress
from twilight.base.threads import in_slices
from twilight.solvers.tables.layers import refuse_unseen_layers
from twilight.solvers.tables.lookup import DARK
from twilight.solvers.tables.mapping import IRRADIANCE_TEXELS, MAPPINGS, TRANSMITTANCE_TEXELS, Mapping, grid
from twilight.solvers.tables.passes import (
    Incoming,
    LitGround,
    Scatterers,
    SphereQuadrature,
    Texels,
    fill_depth,
    fill_irradiance,
    fill_scattering,
    fill_single,
    fill_source,
)
from twilight.solvers.tables.settings import TablesSettings
from twilight.transport.profile import Profile, prepare_profile
from twilight.transport.ray_profile import ray_profile, screen_table
from twilight.transport.scaling import ScaledMedium, rayleigh_phase_array


@dataclass(frozen=True)
class ScatteringTables:
    """All that is precomputed.

    mapping, profile: of the texels, and of the air
    depth (r, mu, W): -ln T
    irradiance (r, mu_s, W): E of the sky over F0, without direct sunlight
    single (1 + K, r, mu_s, nu, mu, W): S of light scattered once by air and by each aerosol, without phase functions
    multiple (r, mu_s, nu, mu, W): S of light scattered more often [sr^-1]
    irradiance_by_order (orders, r, mu_s, W): the parts of irradiance
    """

    mapping: Mapping
    profile: Profile
    depth: np.ndarray
    irradiance: np.ndarray
    single: np.ndarray
    multiple: np.ndarray
    irradiance_by_order: np.ndarray


def make_mapping(settings: TablesSettings, bottom_km: float, thickness_km: float) -> Mapping:
    """The mapping of these settings for air from a radius of bottom_km up by thickness_km."""
    s = settings
    return Mapping(
        kind=MAPPINGS[s.mapping],
        bottom_km=bottom_km,
        thickness_km=thickness_km,
        mu_s_min=-0.2 if s.mapping == "bruneton2008" else float(np.sin(np.radians(s.lowest_sun_deg))),
        n_r=s.scattering_r,
        n_mu=s.scattering_mu,
        n_mu_s=s.scattering_mu_s,
        n_nu=s.scattering_nu,
        n_t_r=TRANSMITTANCE_TEXELS[0],
        n_t_mu=TRANSMITTANCE_TEXELS[1],
        n_e_r=IRRADIANCE_TEXELS[0],
        n_e_mu_s=IRRADIANCE_TEXELS[1],
        half_sines=s.scattering_angles == "half_sines",
    )


def solve(scaled: ScaledMedium, settings: TablesSettings, progress: Progress) -> ScatteringTables:
    """Fill T, then S and E order by order, until max_orders.

    Errors: TwilightError for layers that lie between two heights.
    """
    medium = scaled.medium
    profile = prepare_profile(medium)
    mapping = make_mapping(settings, medium.earth_radius_km + medium.bottom_km, medium.top_km - medium.bottom_km)
    refuse_unseen_layers(medium, mapping)
    n_w = medium.n_wavelengths
    texels = Texels(*grid(mapping))
    screen = screen_table(medium.screen, ray_profile(medium, refraction=False), 0, medium.wavelength_nm)
    depth = np.zeros((mapping.n_t_r, mapping.n_t_mu, n_w))
    progress("transmittance", 0.0)
    in_slices(partial(fill_depth, profile, mapping, depth), mapping.n_t_r)
    shape = (mapping.n_r, mapping.n_mu_s, mapping.n_nu, mapping.n_mu, n_w)
    single = np.zeros((scaled.moments.shape[0], *shape), np.float32)
    progress("single scattering", 0.05)
    fineness = settings.step_density
    in_slices(partial(fill_single, profile, mapping, depth, screen, texels, fineness, single), mapping.n_r)
    logarithmic = settings.interpolation == "logarithmic"
    directions, up_mu, up_weight = _quadrature(mapping, texels, settings)
    coefficients = medium.at(medium.bottom_km + texels.heights)
    aerosol = coefficients.aerosol_scattering[None] * coefficients.aerosol_phase_fraction
    sigma = np.ascontiguousarray(np.concatenate([coefficients.air_scattering[None], aerosol]).transpose(1, 0, 2))
    total = np.zeros(shape, np.float32)
    by_order = []
    # zero in the shadow, where logarithms would spoil what is next to it
    scatterers = Scatterers(np.ascontiguousarray(scaled.moments), sigma)
    last = Incoming(single, False, scatterers.moments)
    radiance = np.zeros((1, 0, n_w))
    lit = np.zeros((mapping.n_e_r, mapping.n_e_mu_s, n_w))
    for number in range(1, settings.max_orders + 1):
        progress(f"order of scattering {number}", 0.1 + 0.9 * (number - 1) / settings.max_orders)
        from_sky = np.zeros_like(lit)
        in_slices(
            partial(fill_irradiance, mapping, last, up_mu, up_weight, directions.azimuth, from_sky), mapping.n_e_r
        )
        by_order.append(from_sky)
        if number == settings.max_orders:
            break
        source = np.zeros(shape, np.float32)
        ground = LitGround(medium.ground_albedo, lit, number == 1)
        in_slices(
            partial(fill_source, profile, mapping, depth, screen, last, scatterers, ground, texels, directions, source),
            mapping.n_r,
        )
        source = stored(source, logarithmic)
        scattered = np.zeros(shape, np.float32)
        in_slices(
            partial(fill_scattering, profile, mapping, source, logarithmic, texels, fineness, scattered), mapping.n_r
        )
        total += scattered
        last, lit = Incoming(stored(scattered, logarithmic)[None], logarithmic, radiance), from_sky
    orders = np.stack(by_order)
    return ScatteringTables(mapping, profile, depth, orders.sum(axis=0), single, total, orders)


def stored(values: np.ndarray, logarithmic: bool) -> np.ndarray:
    """What is interpolated: the values, or their logarithms."""
    return np.log(np.maximum(values, DARK)) if logarithmic else values


def rayleigh_at(nus: np.ndarray, depolarisation: np.ndarray) -> np.ndarray:
    """Rayleigh phase function (nu, 1, W) at the texels of nu."""
    return rayleigh_phase_array(nus, depolarisation)[:, None, :]


def _quadrature(
    mapping: Mapping, texels: Texels, settings: TablesSettings
) -> tuple[SphereQuadrature, np.ndarray, np.ndarray]:
    """Gauss-Legendre below and above the horizon of every height; and mu and weights over the upper hemisphere."""
    x, w = np.polynomial.legendre.leggauss(settings.polar_directions)
    heights = texels.heights
    rho = np.sqrt(heights * (2.0 * mapping.bottom_km + heights))
    horizon = (-rho / (mapping.bottom_km + heights))[:, None]
    below, above = 0.5 * (horizon + 1.0), 0.5 * (1.0 - horizon)
    mu = np.concatenate([-1.0 + below * (1.0 + x), horizon + above * (1.0 + x)], axis=1)
    degree = settings.degree
    directions = SphereQuadrature(
        mu,
        np.concatenate([below * w, above * w], axis=1),
        (np.arange(settings.azimuth_directions) + 0.5) * np.pi / settings.azimuth_directions,
        harmonics(mu, degree),
        harmonics(texels.view, degree),
        np.array([(n, m) for m in range(degree + 1) for n in range(m, degree + 1)]).T,
    )
    return directions, 0.5 * (1.0 + x), 0.5 * w


def harmonics(mu: np.ndarray, degree: int) -> np.ndarray:
    """sqrt((l - m)!/(l + m)!) P_l^m (..., C), for m = 0..degree and within it l = m..degree."""
    out = []
    across = np.sqrt(np.maximum(0.0, 1.0 - mu * mu))
    diagonal = np.ones_like(mu)
    for m in range(degree + 1):
        if m:
            diagonal = diagonal * across * np.sqrt((2 * m - 1) / (2 * m))
        before, here = np.zeros_like(mu), diagonal
        for n in range(m, degree + 1):
            out.append(here)
            a = (2 * n + 1) / np.sqrt((n + 1) ** 2 - m * m)
            b = np.sqrt(n * n - m * m) / np.sqrt((n + 1) ** 2 - m * m)
            before, here = here, a * mu * here - b * before
    return np.stack(out, axis=-1)
