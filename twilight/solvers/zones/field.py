"""ZonesField: a solved medium, evaluated for any sun, observer and direction."""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from twilight.atmosphere.medium import observer_at
from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.base.threads import in_slices
from twilight.solvers.base import BareField, Convergence, check_sun
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones import lines_of_sight
from twilight.solvers.zones.angles import scattering_geometry
from twilight.solvers.zones.aureole import forward_peak, widen_peaks
from twilight.solvers.zones.grids import FieldGrids, visible_arc_deg
from twilight.solvers.zones.ray_points import LANES, block_values, make_ray_points
from twilight.solvers.zones.scattering import Solution
from twilight.solvers.zones.storage import Stored, save
from twilight.transport.azimuth_series import RayDirections, interpolate_azimuth, unique_directions
from twilight.transport.beam import Beam
from twilight.transport.lines import trace_rays, with_refraction
from twilight.transport.profile import prepare_profile
from twilight.transport.scaling import species_phase, species_polarising_phase, with_light_in_peak
from twilight.transport.sunlit import scattered_once
from twilight.transport.sunlit_ray import Phases, SunlitAir


class ZonesField(BareField):
    """The sky of one medium for any sun, observer and direction."""

    convergence: Convergence | None

    def __init__(
        self,
        grids: FieldGrids,
        beam: Beam,
        solutions: Sequence[Solution],
        convergence: Convergence | None,
        observer_altitude_km: float = 0.0,
    ):
        """solutions: one for each block of wavelengths, none of single scattering alone"""
        self.grids, self.beam, self.solutions, self.convergence = grids, beam, solutions, convergence
        self.medium, self.settings = grids.medium, grids.settings
        self.requested_settings = grids.settings
        """Those of the call: with a target error the field's own may be finer."""
        self.observer_altitude_km = observer_at(grids.medium, observer_altitude_km)
        several = grids.settings.max_orders > 1
        self.peak = forward_peak(grids.air, grids.scaled, grids.profile) if several else None
        self._cached_lines = lines_of_sight.LineCache()

    def save(self, path: str | Path) -> None:
        """Write the field to an HDF5 file, which `twilight.solvers.zones.load` reads.  Errors: TwilightError."""
        g = self.grids
        solved = Stored(
            g.medium, g.settings, self.requested_settings, g.zenith_range_deg, self.beam, self.solutions,
            self.convergence,
        )  # fmt: skip
        save(solved, path)

    @property
    def sun_range_deg(self) -> tuple[float, float]:
        """Lowest and highest sun elevation [deg] that the field was solved for, seen from its own observer."""
        return self._suns_seen_from(self.observer_altitude_km)

    def _suns_seen_from(self, observer_altitude_km: float) -> tuple[float, float]:
        first, last = self.grids.zenith_range_deg
        around = visible_arc_deg(self.medium, observer_altitude_km)
        lowest = -90.0 if last >= tuned.LAST_ZENITH_DEG else 90.0 + around - last
        return lowest, 90.0 if first <= 0.0 else 90.0 - around - first

    def _check_sun(self, sun_elevation_deg: float, observer_altitude_km: float) -> None:
        check_sun(sun_elevation_deg)
        lowest, highest = self._suns_seen_from(observer_altitude_km)
        if self.solutions and not lowest - ROUNDING <= sun_elevation_deg <= highest + ROUNDING:
            solved_for = f"{lowest:g} to {highest:g} deg" if lowest <= highest + 1e-9 else "lower observers"
            raise TwilightError(
                f"sun.elevation_deg is {sun_elevation_deg:g} and the observer at {observer_altitude_km:g} km; "
                f"the field was solved for {solved_for}"
            )

    def radiance(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], as of `solvers.base.Field`, for an observer at any altitude; looking down,
        the ground is seen through the air, lit by the sun and the sky.

        Errors: TwilightError for a sun that the field was not solved for, and an observer below the ground."""
        return self._evaluate(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km, 1)[..., 0, :]

    def inscatter(
        self,
        sun_elevation_deg: float,
        elevation_deg,
        azimuth_deg,
        distance_km,
        *,
        observer_altitude_km: float | None = None,
        peak_passes: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Radiance [sr^-1] and transmittance of segments, as of `solvers.base.SegmentField`; inf: to the end of the
        air.

        The field counts light in the narrow forward peak of aerosol as passed; where peak_passes is false, the light
        from behind that the segment scatters on within the peak is added (`scaling.with_light_in_peak`).
        Errors: TwilightError as of `radiance`, and for a distance that is not a number of 0 or more."""
        where = np.broadcast_arrays(elevation_deg, azimuth_deg, distance_km)
        elevation, azimuth, distance = (np.asarray(a, dtype=float) for a in where)
        if not np.all(distance >= 0.0):
            raise TwilightError("distance_km must be 0 or more")
        line = (sun_elevation_deg, elevation, azimuth, observer_altitude_km, 1)
        light = self._evaluate(*line, distance_km=distance)[..., 0, :]
        altitude = observer_at(self.medium, observer_altitude_km, self.observer_altitude_km)
        ends, back = np.unique(np.stack([elevation.ravel(), distance.ravel()]), axis=1, return_inverse=True)

        def passed(profile) -> np.ndarray:
            cosine = np.sin(np.radians(ends[0]))
            start = np.full(cosine.size, altitude)
            rays = trace_rays(profile, start, cosine, self.settings.line_of_sight_density, far_km=ends[1])
            return rays.passed[back.ravel()].reshape(light.shape)

        scaled = passed(self.grids.line_profile)
        if peak_passes:
            return light, scaled
        clear = prepare_profile(self.medium)
        true = passed(with_refraction(clear, self.medium) if self.settings.bent_lines_of_sight else clear)
        if np.any(true < scaled):
            light = with_light_in_peak(light, self._evaluate(*line)[..., 0, :], scaled, true)
        return light, true

    @property
    def polarised(self) -> bool:
        """Whether it was solved with polarisation."""
        return self.settings.polarisation

    def stokes(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """Sun-normalised Stokes parameters I, Q, U [sr^-1], as of `solvers.base.PolarisedField`.

        Errors: TwilightError as of `radiance`, and for a field that was solved without polarisation."""
        if not self.settings.polarisation:
            raise TwilightError("solver.polarisation is false: this field has no Stokes parameters")
        return self._evaluate(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km, 3)

    def _evaluate(
        self, sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km, n_stokes: int, *, distance_km=None
    ) -> np.ndarray:
        """The first n_stokes, 1 or 3, of I, Q, U: shape of the directions plus (n_stokes, W); up to distances, without
        the light of the ground, where they are given."""
        altitude = observer_at(self.medium, observer_altitude_km, self.observer_altitude_km)
        self._check_sun(sun_elevation_deg, altitude)
        elevation, azimuth, far = np.broadcast_arrays(
            np.asarray(elevation_deg, dtype=float),
            np.asarray(azimuth_deg, dtype=float),
            np.asarray(np.inf if distance_km is None else distance_km, dtype=float),
        )
        ends = np.stack([elevation.ravel(), far.ravel()])
        rows, row_of = np.unique(ends, axis=1, return_inverse=True)
        row_of, place, of_place = unique_directions(row_of.ravel(), azimuth.ravel())
        row_elevation = np.radians(rows[0])
        row_first = np.searchsorted(row_of, np.arange(row_elevation.size + 1))
        directions = RayDirections(row_first, np.cos(np.radians(place)), math.radians(90.0 - sun_elevation_deg))
        with_ground = distance_km is None
        density = self.settings.line_of_sight_density
        grids = self.grids
        lines = self._cached_lines.get(
            (altitude, with_ground, rows.tobytes()),
            lambda: lines_of_sight.trace_lines_of_sight(
                grids.line_profile, altitude, rows, density, with_ground, grids.layout.thin_layer
            ),
        )
        lift = lines_of_sight.sun_lift(self.beam, altitude, directions.zenith_rad)
        out = np.zeros((place.size, n_stokes, self.medium.n_wavelengths))
        for block, solution in enumerate(self.solutions):
            part = slice(block * LANES, min((block + 1) * LANES, out.shape[2]))
            several = self._multiple(lines, directions, block, solution, n_stokes)
            out[:, :, part] = several[:, :, : part.stop - part.start]
        self._add_single(lines, directions, row_elevation, row_elevation[row_of], lift, out)
        self._cached_lines.trim()
        result = out[of_place]
        if n_stokes > 1:
            # all was computed to the right of the sun; left of it the vibration leans the other way
            result[:, 2] *= np.where(np.sin(np.radians(azimuth.ravel())) < 0.0, -1.0, 1.0)[:, None]
        return result.reshape(*elevation.shape, *out.shape[1:])

    def _add_single(
        self,
        lines: lines_of_sight.LinesOfSight,
        directions: RayDirections,
        row_elevation,
        elevation,
        lift: float,
        out: np.ndarray,
    ) -> None:
        """Add light scattered once to out (D, Stokes, W), which holds the rest; directions sorted by ray, elevation
        (D,) and lift of the sun [rad]."""
        scaled = self.grids.scaled
        n_stokes, other = out.shape[1], np.ascontiguousarray(out[:, 0])
        rays, fraction = lines.pairs, lines.pairs_fraction
        cos_azimuth = directions.cos_azimuth
        sin_azimuth = np.sqrt(np.maximum(0.0, 1.0 - cos_azimuth**2))
        lift_rad, ray_lowering = lines_of_sight.lift_and_lowering(rays, row_elevation, lift)
        lowering_rad = np.repeat(ray_lowering, np.diff(directions.first))
        # the sun and the ray as they are, the sun lifted, the ray lowered
        suns = [directions.zenith_rad - lifted for lifted in (0.0, lift_rad, 0.0)]
        elevations = [elevation - lowered for lowered in (0.0, 0.0, lowering_rad)]
        cosine = np.array(
            [
                np.sin(e) * math.cos(t) + np.cos(e) * math.sin(t) * cos_azimuth
                for t, e in zip(suns, elevations, strict=True)
            ]
        )
        p11 = species_phase(self.medium, scaled.forward_fraction, cosine.ravel())
        p11 = p11.reshape(*cosine.shape, *p11.shape[1:])
        if self.peak is not None:
            widen_peaks(self.peak, scaled, self.beam, p11, cosine, lines.rays, lines.rays_fraction, directions)
        stokes = [p11]
        if n_stokes > 1:
            p12 = species_polarising_phase(self.medium, scaled.forward_fraction, cosine.ravel()).reshape(p11.shape)
            # elevations below the horizon too: sine and cosine of the zenith angle are cos e and sin e
            rotations = [
                scattering_geometry(np.sin(e), cos_azimuth, sin_azimuth, t)[1:]
                for t, e in zip(suns, elevations, strict=True)
            ]
            stokes += [p12 * np.array(part)[..., None, None] for part in zip(*rotations, strict=True)]
        unbent, lifted_sun, lowered_ray = np.stack(stokes, axis=1)
        phases = Phases(unbent, (lifted_sun - unbent) / lift_rad, (lowered_ray - unbent) / lowering_rad[:, None, None])
        air = SunlitAir(self.beam, rays, fraction, phases, 0.0, other)
        in_slices(
            partial(
                scattered_once, air, row_elevation, directions, self.medium.bottom_km, self.medium.ground_albedo, out
            ),
            row_elevation.size,
        )

    def _multiple(
        self,
        lines: lines_of_sight.LinesOfSight,
        directions: RayDirections,
        block: int,
        solution: Solution,
        n_stokes: int,
    ) -> np.ndarray:
        """Light scattered at least twice, (D, Stokes, LANES)."""
        nodes, series = self.grids.nodes, self.grids.line_series
        if block not in lines.points:
            lines.points[block] = make_ray_points(
                lines.rays, self.grids.scattering, nodes.fine_altitude_km, 1.0, series, block
            )
        points = lines.points[block]
        rays = lines.rays._replace(ground_weight=block_values(lines.rays.ground_weight, block))

        def along(where: RayDirections) -> np.ndarray:
            out = np.zeros((where.cos_azimuth.size, n_stokes, LANES))
            in_slices(
                partial(lines_of_sight.view_multiple, rays, points, where, solution.light, nodes.zenith, series, out),
                where.first.size - 1,
            )
            return out

        return interpolate_azimuth(along, directions)
