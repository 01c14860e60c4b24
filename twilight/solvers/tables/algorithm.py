"""Algorithm 4.1 of Bruneton and Neyret 2008: the tables of a medium, order by order; and what a user can set of them.

    T  <- transmittance                              `fill_depth`, eq. 5
    DE <- E[L0]                                      the sun itself: `LitGround.direct`, eq. 9 and 15
    DS <- S[L0]                                      `fill_single`, eq. 11
    E  <- 0,  S <- DS
    for each order that follows:
        DJ <- J[T a/pi DE + DS]                      `fill_source`, eq. 7 and 10
        DE <- E[DS]                                  `fill_irradiance`, eq. 15
        DS <- integral of T DJ along the view        `fill_scattering`, eq. 11
        E  <- E + DE,  S <- S + DS

DS of the first order stays apart by species, without phase functions (sec. 4, "Angular precision").
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.conventions import TINY
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.base.sections import option, settings
from twilight.base.threads import in_slices
from twilight.solvers.base import Cost
from twilight.solvers.tables import passes
from twilight.solvers.tables.mapping import (
    IRRADIANCE_TEXELS,
    LEAST_LIGHT,
    MAPPINGS,
    TRANSMITTANCE_TEXELS,
    Mapping,
    grid,
    texel_height_km,
)
from twilight.transport.profile import Profile, prepare_profile
from twilight.transport.ray_profile import ray_profile, screen_table
from twilight.transport.scaling import ScaledMedium, rayleigh_phase_array

MOST_UNSEEN = 0.1
"""Vertical optical depth that may be missing or too much between two heights.

The climates of the program have up to 0.05; a layer of 1 that scatters conservatively between two heights, over white
ground, makes the sky three times too bright.
"""

EDGE_KM = 1e-7
"""Distance below and above a level at which coefficients may jump [km]."""


@settings
class TablesSettings:
    """Sizes and mapping of the tables, and how they are filled."""

    mapping: Literal["bruneton2008", "bruneton2017"] = option(
        "from (r, mu, mu_s, nu) to texels: bruneton2008 (sec. 4 of the paper; it ends with the sun at -11.5 deg) or"
        " bruneton2017 (of his later code; it ends at lowest_sun_deg)",
        default="bruneton2008",
    )
    lowest_sun_deg: float = option(
        "of the mapping bruneton2017; below it tables hold their last texel", default=-30.0, ge=-89.0, le=-1.0
    )
    scattering_mu_s: int = option("texels of S", default=32, ge=4, le=1024)
    scattering_nu: int = option("texels of S", default=8, ge=2, le=256)
    interpolation: Literal["linear", "logarithmic"] = option(
        "between texels of S: linear, as on a graphics card, or logarithmic (what was scattered once, which is zero"
        " in the shadow, is linear)",
        default="linear",
    )
    max_orders: int = option("orders of scattering (5 in the paper)", default=5, ge=1, le=100)
    scattering_r: int = option("texels of S", default=32, ge=4, le=256, expert=True)
    scattering_mu: int = option("texels of S", default=128, ge=8, le=1024, expert=True)
    scattering_angles: Literal["cosines", "half_sines"] = option(
        "texels of nu: cosines, even in nu, as his mappings have them; or half_sines, even in the sine of half the "
        "scattering angle, close together towards the sun, where aerosol scatters most",
        default="cosines",
        expert=True,
    )
    degree: int = option(
        "of the Legendre series of the phase functions in the integral over incident light (delta-scaled beyond)",
        default=12,
        ge=2,
        le=32,
        expert=True,
    )
    polar_directions: int = option(
        "of that integral, per hemisphere and over half a turn", default=12, ge=2, le=64, expert=True
    )
    azimuth_directions: int = option(
        "of that integral, per hemisphere and over half a turn", default=16, ge=3, le=128, expert=True
    )
    step_density: float = option("of the points along the rays", default=1.0, ge=0.2, le=10.0, expert=True)

    def __post_init__(self):
        if self.scattering_mu % 2:
            raise TwilightError(
                f"solver.expert.scattering_mu is {self.scattering_mu}; it must be even: half looks down"
            )
        if self.degree >= self.azimuth_directions:
            raise TwilightError(
                f"solver.expert.degree is {self.degree}; azimuth_directions, {self.azimuth_directions}, is more"
            )


QUALITIES: dict[str, TablesSettings] = {
    "standard": TablesSettings(),
    "bruneton2008": TablesSettings(),
    "bruneton2017": TablesSettings(mapping="bruneton2017"),
    "fine": TablesSettings(
        mapping="bruneton2017",
        lowest_sun_deg=-24.0,
        scattering_angles="half_sines",
        interpolation="logarithmic",
        max_orders=8,
    ),
}
"""`standard` is the paper's own: 32 x 128 x 32 x 8 texels, five orders; `fine` has as many texels where they matter."""

TEXEL_DIRECTION_S = 9.6e-9
"""Processor seconds of a texel of S, an incident direction, a wavelength and an order after the first: `standard` and
`fine`, within 15 % (`benchmarks/results/compare.csv`)."""
TEXEL_BYTES = 68.0
"""Bytes of a texel and wavelength while tables are filled (ibid.)."""
DIRECTION_S = 3e-7
"""Processor seconds of a direction and wavelength (ibid.)."""


def cost(
    medium: Medium, settings: TablesSettings, sun_elevations_deg: Sequence[float] | None, observer_altitude_km: float
) -> Cost:
    """Cost of a field, from the sizes of its tables."""
    texels = settings.scattering_r * settings.scattering_mu * settings.scattering_mu_s * settings.scattering_nu
    incident = settings.polar_directions * settings.azimuth_directions
    return Cost(
        fixed_bytes=0.0,
        bytes_per_wavelength=TEXEL_BYTES * texels,
        cpu_s_per_wavelength=TEXEL_DIRECTION_S * texels * incident * (settings.max_orders - 1),
        cpu_s_per_direction=DIRECTION_S,
    )


def refuse_unseen_layers(medium: Medium, mapping: Mapping) -> None:
    """Errors: TwilightError where the air at the heights of S, taken as exponential between them, has another vertical
    optical depth than the air has."""
    bottom = medium.bottom_km
    height = bottom + np.array([texel_height_km(mapping, k, mapping.n_r) for k in range(mapping.n_r)])
    height[-1] = medium.top_km
    exponential = _optical_depth(medium, height)
    levels = np.concatenate([medium.altitude_km - EDGE_KM, medium.altitude_km + EDGE_KM, height])
    fine = np.unique(np.clip(levels, bottom, medium.top_km))
    up_to = np.cumsum(_optical_depth(medium, fine), axis=0)[np.searchsorted(fine, height[1:]) - 1]
    unseen = np.abs(np.diff(up_to, axis=0, prepend=0.0) - exponential)
    k, w = np.unravel_index(unseen.argmax(), unseen.shape)
    if unseen[k, w] > MOST_UNSEEN:
        raise TwilightError(
            f"the tables solver cannot hold this air: between {height[k]:.3g} and {height[k + 1]:.3g} km, two of its "
            f"{mapping.n_r} heights, the optical depth at {medium.wavelength_nm[w]:g} nm is off by {unseen[k, w]:.2g}; "
            f"allowed is {MOST_UNSEEN:g}; more heights (solver.expert.scattering_r) may do, solver zones does"
        )


def _optical_depth(medium: Medium, altitude_km: np.ndarray) -> np.ndarray:
    """Vertical, of every interval (Z - 1, W), of air that is exponential in it."""
    k = np.maximum(medium.at(altitude_km).extinction, TINY)
    low, high = k[:-1], k[1:]
    ratio = np.log(high / low)
    flat = np.abs(ratio) < 1e-6
    mean = np.where(flat, 0.5 * (low + high), (high - low) / np.where(flat, 1.0, ratio))
    return mean * np.diff(altitude_km)[:, None]


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
    texels = passes.Texels(*grid(mapping))
    screen = screen_table(medium.screen, ray_profile(medium, refraction=False), 0, medium.wavelength_nm)
    depth = np.zeros((mapping.n_t_r, mapping.n_t_mu, n_w))
    progress("transmittance", 0.0)
    in_slices(partial(passes.fill_depth, profile, mapping, depth), mapping.n_t_r)
    shape = (mapping.n_r, mapping.n_mu_s, mapping.n_nu, mapping.n_mu, n_w)
    single = np.zeros((scaled.moments.shape[0], *shape), np.float32)
    progress("single scattering", 0.05)
    fineness = settings.step_density
    in_slices(partial(passes.fill_single, profile, mapping, depth, screen, texels, fineness, single), mapping.n_r)
    logarithmic = settings.interpolation == "logarithmic"
    directions, up_mu, up_weight = _quadrature(mapping, texels, settings)
    coefficients = medium.at(medium.bottom_km + texels.heights)
    aerosol = coefficients.aerosol_scattering[None] * coefficients.aerosol_phase_fraction
    sigma = np.ascontiguousarray(np.concatenate([coefficients.air_scattering[None], aerosol]).transpose(1, 0, 2))
    multiple = np.zeros(shape, np.float32)
    by_order = []
    # zero in the shadow, where logarithms would spoil what is next to it
    scatterers = passes.Scatterers(np.ascontiguousarray(scaled.moments), sigma)
    delta_s = passes.Incoming(single, False, scatterers.moments)
    radiance = np.zeros((1, 0, n_w))
    delta_e = np.zeros((mapping.n_e_r, mapping.n_e_mu_s, n_w))
    for number in range(1, settings.max_orders + 1):
        progress(f"order of scattering {number}", 0.1 + 0.9 * (number - 1) / settings.max_orders)
        from_sky = np.zeros_like(delta_e)
        in_slices(
            partial(passes.fill_irradiance, mapping, delta_s, up_mu, up_weight, directions.azimuth, from_sky),
            mapping.n_e_r,
        )
        by_order.append(from_sky)
        if number == settings.max_orders:
            break
        delta_j = np.zeros(shape, np.float32)
        ground = passes.LitGround(medium.ground_albedo, delta_e, number == 1)
        in_slices(
            partial(
                passes.fill_source,
                profile,
                mapping,
                depth,
                screen,
                delta_s,
                scatterers,
                ground,
                texels,
                directions,
                delta_j,
            ),
            mapping.n_r,
        )
        delta_j = stored(delta_j, logarithmic)
        scattered = np.zeros(shape, np.float32)
        in_slices(
            partial(passes.fill_scattering, profile, mapping, delta_j, logarithmic, texels, fineness, scattered),
            mapping.n_r,
        )
        multiple += scattered
        delta_s, delta_e = passes.Incoming(stored(scattered, logarithmic)[None], logarithmic, radiance), from_sky
    orders = np.stack(by_order)
    return ScatteringTables(mapping, profile, depth, orders.sum(axis=0), single, multiple, orders)


def stored(values: np.ndarray, logarithmic: bool) -> np.ndarray:
    """What is interpolated: the values, or their logarithms."""
    return np.log(np.maximum(values, LEAST_LIGHT)) if logarithmic else values


def rayleigh_at(nus: np.ndarray, depolarisation: np.ndarray) -> np.ndarray:
    """Rayleigh phase function (nu, 1, W) at the texels of nu."""
    return rayleigh_phase_array(nus, depolarisation)[:, None, :]


def _quadrature(
    mapping: Mapping, texels: passes.Texels, settings: TablesSettings
) -> tuple[passes.SphereQuadrature, np.ndarray, np.ndarray]:
    """Gauss-Legendre below and above the horizon of every height; and mu and weights over the upper hemisphere."""
    x, w = np.polynomial.legendre.leggauss(settings.polar_directions)
    heights = texels.heights
    rho = np.sqrt(heights * (2.0 * mapping.bottom_km + heights))
    horizon = (-rho / (mapping.bottom_km + heights))[:, None]
    below, above = 0.5 * (horizon + 1.0), 0.5 * (1.0 - horizon)
    mu = np.concatenate([-1.0 + below * (1.0 + x), horizon + above * (1.0 + x)], axis=1)
    degree = settings.degree
    directions = passes.SphereQuadrature(
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
        before, current = np.zeros_like(mu), diagonal
        for n in range(m, degree + 1):
            out.append(current)
            a = (2 * n + 1) / np.sqrt((n + 1) ** 2 - m * m)
            b = np.sqrt(n * n - m * m) / np.sqrt((n + 1) ** 2 - m * m)
            before, current = current, a * mu * current - b * before
    return np.stack(out, axis=-1)
