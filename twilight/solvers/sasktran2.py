"""sasktran2 (University of Saskatchewan) as a solver: the same coefficients, phase functions, ground and geometry.

It is here to be compared with, along straight rays: once the sun is low, its refracted beam, which does not spread, is
worse than straight light.  What makes it right in twilight, each found by comparison with the Monte-Carlo
reference solution:

- Single and multiple scattering are computed by two engines and added.  Single scattering is exact in its phase
  function, but takes the sunlight to be linear in each layer: it needs layers of 20 m at the ground.  Multiple
  scattering on that grid would cost ten times more than it gains.
- The engine of multiple scattering interpolates sunlight in a table whose altitudes it takes to be evenly spaced
  (SolarTransmissionTable, gridspacing::constant): with other altitudes and one Stokes component its answer is garbage.
  So they are evenly spaced here.
- The source is linear in the cosine of the solar zenith angle, on evenly spaced values that cover the lines of sight,
  and constant beyond them.
- A jump of a coefficient is a layer of 1 m, or on an evenly spaced grid the mean of both sides.
"""

from __future__ import annotations

import os

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.base.extras import missing
from twilight.base.progress import Progress
from twilight.base.sections import option, settings
from twilight.solvers.base import ALL_WAVELENGTHS, BareField, Capabilities
from twilight.transport.scaling import matrix_moments

JUMP_KM = 1e-3
"""Thickness of the layer that stands for a jump of a coefficient [km]."""

CAPABILITIES = Capabilities(
    looks_down=False, straight_rays=True, wavelengths_at_once=ALL_WAVELENGTHS, package="sasktran2"
)
"""All wavelengths are done at once: most of the time goes into geometry, which they share."""


@settings
class Sasktran2Settings:
    """A configuration of sasktran2; the defaults need about 4.5 GB, `draft` about one."""

    polarisation: bool = option("three Stokes parameters, at several times the cost", default=False)
    zenith_step_deg: float = option(
        "between the solar zenith angles of the source, near 90 deg (they are even in the cosine and cover the "
        "lines of sight)",
        default=0.5,
        ge=0.05,
        le=90.0,
    )
    incoming: int = option(
        "directions at a source point (orders of Lebedev's rules: 110, 302, 770)", default=302, ge=6, le=5810
    )
    outgoing: int = option(
        "directions at a source point (orders of Lebedev's rules: 110, 302, 770)", default=110, ge=6, le=5810
    )
    streams: int = option(
        "terms of the phase function in multiple scattering (with delta-M scaling)", default=16, ge=2, le=128
    )
    threads: int = option("that it uses; 0: all there are", default=0, ge=0, le=1024)
    single_step_km: float = option(
        "layers for single scattering: thickness at the ground, growth with altitude",
        default=0.02,
        ge=1e-3,
        le=10.0,
        expert=True,
    )
    single_growth: float = option(
        "layers for single scattering: thickness at the ground, growth with altitude",
        default=0.05,
        ge=1e-3,
        le=1.0,
        expert=True,
    )
    multiple_step_km: float = option(
        "layers for multiple scattering, evenly spaced", default=1.0, ge=1e-2, le=10.0, expert=True
    )
    source_step_km: float = option(
        "as for single scattering, of the points where the diffuse source is computed",
        default=1.0,
        ge=1e-2,
        le=10.0,
        expert=True,
    )
    source_growth: float = option(
        "as for single scattering, of the points where the diffuse source is computed",
        default=0.3,
        ge=1e-3,
        le=1.0,
        expert=True,
    )
    moments: int = option("terms of the phase function in single scattering", default=513, ge=3, le=10_000, expert=True)
    tolerance: float = option(
        "relative residual at which the iteration stops", default=1e-4, ge=1e-12, le=1.0, expert=True
    )


QUALITIES: dict[str, Sasktran2Settings] = {
    "draft": Sasktran2Settings(zenith_step_deg=1.0, incoming=110),
    "standard": Sasktran2Settings(),
}


def prepare(
    medium: Medium,
    settings: Sasktran2Settings | None = None,
    *,
    observer_altitude_km: float = 0.0,
    progress: Progress | None = None,
) -> SasktranField:
    """Nothing is computed yet: sasktran2 solves anew for every sun.

    Raises TwilightError where sasktran2 is not installed and for an observer above the air or below the ground.
    """
    return SasktranField(medium, settings or QUALITIES["standard"], observer_altitude_km)


class SasktranField(BareField):
    """The sky of one medium without refraction, seen from within the air."""

    def __init__(self, medium: Medium, settings: Sasktran2Settings, observer_altitude_km: float):
        try:
            import sasktran2  # noqa: F401  # optional
        except ImportError:
            raise missing("sasktran2", "the solver sasktran2") from None
        if not medium.bottom_km <= observer_altitude_km < medium.top_km:
            raise TwilightError(
                f"observer.altitude_km is {observer_altitude_km:g}; the sasktran2 solver allows {medium.bottom_km:g} "
                f"to {medium.top_km:g}"
            )
        self.medium, self.settings, self.observer_altitude_km = medium, settings, observer_altitude_km

    def radiance(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], shape of the directions plus (W,); angles in degrees, azimuth from the sun.

        Errors: TwilightError for directions below the horizontal and for what sasktran2 itself refuses.
        """
        return self._evaluate(sun_elevation_deg, elevation_deg, azimuth_deg)[..., 0, :]

    @property
    def polarised(self) -> bool:
        """Whether it computes three Stokes parameters."""
        return self.settings.polarisation

    def stokes(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        """Sun-normalised I, Q, U [sr^-1], shape of the directions plus (3, W), in the signs of
        `twilight.base.conventions`.

        Errors: as `radiance`, and TwilightError where solver.polarisation is false.
        """
        if not self.settings.polarisation:
            raise TwilightError("solver.polarisation is false: this field has no Stokes parameters")
        return self._evaluate(sun_elevation_deg, elevation_deg, azimuth_deg)

    def _evaluate(self, sun_elevation_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        if np.any(elevation < 0.0):
            raise TwilightError("the sasktran2 solver looks up only: elevations must not be below 0 deg")
        rays = [elevation.ravel(), azimuth.ravel()]
        more = float(sun_elevation_deg), rays, self.observer_altitude_km
        try:
            parts = [_engine(self.medium, self.settings, *more, single) for single in (1, 0)]
        except (RuntimeError, ValueError) as error:
            raise TwilightError(f"sasktran2: {error}") from None
        light = (parts[0] + parts[1]) * np.exp(-self.medium.overhead_absorption_optical_depth)
        return light.reshape(*elevation.shape, *parts[0].shape[1:])


def levels(medium: Medium, start_km: float, growth: float) -> np.ndarray:
    """Altitudes [km] from the ground to the top, growing; a jump is enclosed by two levels JUMP_KM apart."""
    bottom, top = medium.bottom_km, medium.top_km
    if growth == 0.0:
        return np.linspace(bottom, top, round((top - bottom) / start_km) + 1)
    z, top = medium.altitude_km - bottom, top - bottom
    stops = [*z[:-1][np.diff(z) == 0], top]
    out = [0.0]
    for stop in stops:
        end = stop if stop == top else stop - JUMP_KM
        start = out[-1]
        # z + start/growth grows by the factor 1 + growth in each layer
        count = np.log((growth * end + start_km) / (growth * start + start_km)) / np.log1p(growth)
        ratio = np.linspace(0.0, 1.0, max(1, round(count)) + 1)[1:]
        offset = start_km / growth
        out.extend((start + offset) * ((end + offset) / (start + offset)) ** ratio - offset)
        if stop != top:
            out.append(stop)
    return bottom + np.array(out)


def source_altitudes(medium: Medium, start_km: float, growth: float) -> np.ndarray:
    """Middles of layers that grow with altitude [km]; jumps do not matter to the source's interpolation."""
    count = round(np.log1p(growth * (medium.top_km - medium.bottom_km) / start_km) / np.log1p(growth))
    offset = start_km / growth
    edges = offset * ((medium.top_km - medium.bottom_km) / offset + 1.0) ** np.linspace(0.0, 1.0, count + 1) - offset
    return medium.bottom_km + 0.5 * (edges[1:] + edges[:-1])


def optics(
    medium: Medium, altitude_km: np.ndarray, n_moments: int, polarised: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Extinction [m^-1], single scattering albedo (L, W) and (2l+1) chi_l (n_moments, L, W) at the altitudes.

    polarised: the moments are (4 n_moments, L, W), of every degree those of P11, P22, P33 and P12 in turn.  On a jump
    the mean of both sides, which keeps the column; elsewhere both sides are the same.
    """
    each = 4 if polarised else 1
    factor = 2.0 * np.arange(n_moments)[:, None] + 1.0
    species = np.zeros((1 + len(medium.phase_functions), each * n_moments, medium.n_wavelengths))
    species[0, 0] = 1.0
    species[0, 2 * each] = (1.0 - medium.depolarisation) / (2.0 + medium.depolarisation)
    for k, phase in enumerate(medium.phase_functions):
        species[1 + k, ::each] = factor * phase.legendre_moments(n_moments - 1).T
    if polarised:
        whole = np.zeros((len(medium.phase_functions), medium.n_wavelengths))
        matrix = matrix_moments(medium, whole, n_moments - 1)
        # sasktran2 counts P12 with the other sign
        for k, part in ((1, matrix.even), (2, matrix.odd), (3, -matrix.b)):
            species[:, k::4] = factor * part
    air, aerosols = species[0], species[1:]
    shape = (altitude_km.size, medium.n_wavelengths)
    extinction, scattering, moments = np.zeros(shape), np.zeros(shape), np.zeros((each * n_moments, *shape))
    thin = ROUNDING
    for z in (altitude_km - thin, altitude_km + thin):
        at = medium.at(np.clip(z, medium.bottom_km, medium.top_km))
        extinction = extinction + 0.5 * at.extinction
        scattering = scattering + 0.5 * (at.air_scattering + at.aerosol_scattering)
        moments = moments + 0.5 * at.air_scattering * air[:, None, :]
        for part, aerosol in zip(at.aerosol_phase_fraction, aerosols, strict=True):
            moments = moments + 0.5 * at.aerosol_scattering * part * aerosol[:, None, :]
    return extinction / 1000.0, scattering / extinction, moments / scattering


def _zenith_count(medium: Medium, step_deg: float, sun_elevation_deg: float, rays: list[np.ndarray]) -> int:
    """Solar zenith angles that are a step apart where the sun is at the horizon, over all lines of sight."""
    sun, (elevation, azimuth) = np.radians(sun_elevation_deg), np.radians(rays)
    ratio = (medium.earth_radius_km + medium.bottom_km) / (medium.earth_radius_km + medium.top_km)
    arc_rad = np.arccos(ratio * np.cos(elevation)) - elevation  # from the observer to where a line of sight leaves
    cosine = np.sin(sun) * np.cos(arc_rad) + np.cos(sun) * np.sin(arc_rad) * np.cos(azimuth)
    span = max(cosine.max(), np.sin(sun)) - min(cosine.min(), np.sin(sun))
    return 1 + max(1, round(span / np.radians(step_deg)))


def _engine(
    medium: Medium,
    s: Sasktran2Settings,
    sun_elevation_deg: float,
    rays: list[np.ndarray],
    altitude_km: float,
    single: int,
) -> np.ndarray:
    """I, or I, Q and U where polarised, (rays, 1 or 3, W), of single or of multiple scattering."""
    import sasktran2 as sk  # optional

    config = sk.Config()
    config.num_threads = s.threads or len(os.sched_getaffinity(0))
    config.threading_model = sk.ThreadingModel.Source
    config.single_scatter_source = sk.SingleScatterSource.Exact if single else sk.SingleScatterSource.NoSource
    if not single:
        config.multiple_scatter_source = sk.MultipleScatterSource.SuccessiveOrders
    config.delta_m_scaling = True
    config.num_streams = s.streams
    config.num_singlescatter_moments = s.moments if single else s.streams + 1
    config.num_successive_orders_incoming = s.incoming
    config.num_successive_orders_outgoing = s.outgoing
    config.successive_orders_relative_tolerance = s.tolerance
    config.num_successive_orders_iterations = 200
    sources = source_altitudes(medium, s.source_step_km, s.source_growth)
    config.successive_orders_altitude_grid_m = 1000.0 * sources
    config.num_stokes = 3 if s.polarisation else 1
    z = levels(medium, s.single_step_km, s.single_growth) if single else levels(medium, s.multiple_step_km, 0.0)
    config.num_sza = _zenith_count(medium, s.zenith_step_deg, sun_elevation_deg, rays)
    elevation, azimuth = rays
    geometry = sk.Geometry1D(
        np.cos(np.radians(90.0 - sun_elevation_deg)),
        0.0,
        1000.0 * medium.earth_radius_km,
        1000.0 * z,
        sk.InterpolationMethod.LinearInterpolation,
        sk.GeometryType.Spherical,
    )
    viewing = sk.ViewingGeometry()
    cos_zenith = np.sin(np.radians(sun_elevation_deg))
    for e, a in zip(elevation, azimuth, strict=True):
        viewing.add_ray(
            sk.SolarAnglesObserverLocation(cos_zenith, np.radians(a), np.sin(np.radians(e)), 1000.0 * altitude_km)
        )
    atmosphere = sk.Atmosphere(geometry, config, wavelengths_nm=medium.wavelength_nm, calculate_derivatives=False)
    extinction, albedo, moments = optics(medium, z, config.num_singlescatter_moments, s.polarisation)
    atmosphere["air"] = sk.constituent.Manual(extinction, albedo, moments)
    atmosphere["ground"] = sk.constituent.LambertianSurface(medium.ground_albedo.copy(), medium.wavelength_nm.copy())
    answer = sk.Engine(config, geometry, viewing).calculate_radiance(atmosphere)
    found = answer["radiance"].values[:, : elevation.size, : 3 if s.polarisation else 1].transpose(1, 2, 0)
    # its azimuths grow to the other side
    return found * np.array([1.0, 1.0, -1.0])[: found.shape[1], None]
