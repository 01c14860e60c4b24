"""prepare and Field: the zones solver behind the interface that all solvers share."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.errors import TwilightError
from twilight.progress import Progress, silent
from twilight.solvers.base import BareField, Convergence, observer_at
from twilight.solvers.zones.alike import lay_out, settings_for
from twilight.solvers.zones.aureole import forward_peak, widen_peaks
from twilight.solvers.zones.grid import Series, make_angles, zenith_nodes
from twilight.solvers.zones.orders import solve_orders
from twilight.solvers.zones.paths import (
    LANES,
    Scattering,
    lanes_of,
    make_points,
    make_turning,
)
from twilight.solvers.zones.polarised import rotated
from twilight.solvers.zones.reach import LAST_ZENITH_DEG, reach_deg
from twilight.solvers.zones.settings import ZonesSettings
from twilight.solvers.zones.sights import KeptLines, LinesOfSight, make_lines
from twilight.solvers.zones.solution import Nodes, Passes, Solution
from twilight.solvers.zones.storage import Stored, save
from twilight.solvers.zones.sunlight import make_sunlight
from twilight.solvers.zones.view import reference_turns, sun_lift, view_multiple
from twilight.solvers.zones.water import place_of_cosine, reflection, surface_of, view_sunlit_water
from twilight.threads import in_slices
from twilight.transport.around import Directions, once_each, smooth_around
from twilight.transport.beam import Beam, prepare_beam
from twilight.transport.bundle import trace_rays
from twilight.transport.lines import ANGLE, horizon_cosine, with_refraction
from twilight.transport.matrix_moments import matrix_moments
from twilight.transport.profile import prepare_profile
from twilight.transport.scaling import delta_scaled, species_phase, species_polarising_phase
from twilight.transport.sunlit import scattered_once
from twilight.transport.sunlit_ray import Phases

THICK_PER_DEGREE = 2
"""Polar angles a side for each degree of the light in thick white air: fewer let through 3 to 5 % too much of it."""
SLOW_DEPTH = 2.0
"""Optical depth of scattering, each share times 1 - g, beyond which light is not followed event by event."""


class Field(BareField):
    """The sky of one medium for any sun, observer and direction."""

    def __init__(
        self,
        medium: Medium,
        settings: ZonesSettings,
        observer_altitude_km: float = 0.0,
        progress: Progress | None = None,
        *,
        zenith_range_deg: tuple[float, float] = (0.0, LAST_ZENITH_DEG),
        solved: tuple[Beam, list[Solution], Convergence | None] | None = None,
    ):
        """Solve the field, or take a solution that is there: (sunbeam, solutions, convergence)."""
        self.medium, self.settings = medium, settings
        self.asked = settings
        """The settings that were asked for: with a target error those that it took may be finer."""
        self.observer_altitude_km = observer_at(medium, observer_altitude_km)
        self.zenith_range_deg = zenith_range_deg
        self._sights = KeptLines()
        tell = progress or silent
        of_air = settings_for(medium, settings)
        self.scaled = delta_scaled(medium, of_air.degree)
        matrix = matrix_moments(medium, self.scaled.forward_share, max(2, self._pattern_degree))
        self.scattering = Scattering(self.scaled.medium, self.scaled.moments, matrix)
        layout = lay_out(medium, self.scaled, of_air)
        tell("sunbeam", 0.0)
        if solved is None:
            d = settings.beam_density
            self.beam = prepare_beam(
                self.scaled.medium,
                refraction=settings.refraction,
                altitude_nodes_per_scale=8.0 * d,
                limb_nodes_per_scale=12.0 * d,
                cosine_nodes=round(40 * d),
                distance_nodes=max(8, round(12 * d)),
                guess_nodes=round(48 * d),
                laid_out_for=layout.beam,
            )
        else:
            self.beam = solved[0]
        self.profile, altitude = layout.profile, layout.altitude_km
        self.directions = layout.directions
        """The settings with the degree and as many directions and harmonics as this air needs."""
        self._thin_layer = layout.thin_layer
        several = settings.max_events > 1
        self.peak = forward_peak(medium, self.scaled, self.profile) if several else None
        bent = with_refraction(self.profile, layout.bends)
        self.sight_profile = bent if settings.bent_lines_of_sight else self.profile
        self.path_profile = bent if settings.bent_paths else self.profile
        zenith = zenith_nodes(*zenith_range_deg, settings.zenith_density)
        self.nodes = Nodes.of(altitude, zenith, self.profile.sharp_km)
        self.convergence: Convergence | None = None
        self.solutions: list[Solution] = []
        if solved is not None:
            _, self.solutions, self.convergence = solved
        elif settings.max_events > 1:
            self._solve(tell)
        tell("field", 1.0)

    def save(self, path: str | Path) -> None:
        """Write the field to an HDF5 file; `twilight.solvers.zones.load` reads it.

        Errors: TwilightError where the file cannot be written.
        """
        solved = Stored(
            self.medium, self.settings, self.asked, self.zenith_range_deg, self.beam, self.solutions, self.convergence
        )
        save(solved, path)

    @property
    def sun_range_deg(self) -> tuple[float, float]:
        """Lowest and highest sun elevation [deg] that the field was solved for, seen from its own observer."""
        return self._suns_seen_from(self.observer_altitude_km)

    def _suns_seen_from(self, observer_altitude_km: float) -> tuple[float, float]:
        first, last = self.zenith_range_deg
        around = reach_deg(self.medium, observer_altitude_km)
        lowest = -90.0 if last >= LAST_ZENITH_DEG else 90.0 + around - last
        return lowest, 90.0 if first <= 0.0 else 90.0 - around - first

    def _check_sun(self, sun_elevation_deg: float, observer_altitude_km: float) -> None:
        if not -90.0 <= sun_elevation_deg <= 90.0:
            raise TwilightError(f"sun.elevation_deg is {sun_elevation_deg:g}; allowed is -90 to 90")
        lowest, highest = self._suns_seen_from(observer_altitude_km)
        if self.solutions and not lowest - 1e-9 <= sun_elevation_deg <= highest + 1e-9:
            solved_for = f"{lowest:g} to {highest:g} deg" if lowest <= highest + 1e-9 else "lower observers"
            raise TwilightError(
                f"sun.elevation_deg is {sun_elevation_deg:g} and the observer at {observer_altitude_km:g} km; "
                f"the field was solved for {solved_for}"
            )

    def _solve(self, tell: Progress) -> None:
        s = self.directions
        tell("rays", 0.05)
        early = self._stage(s.polar_directions, s.azimuth_directions, s.degree, self._pattern_degree)
        late_patterns = s.late_polarisation_degree if s.polarisation else 0
        late = self._stage(s.late_polar_directions, s.late_azimuth_directions, s.late_degree, late_patterns)
        # made where there is thick white air only
        polar = max(s.late_polar_directions, THICK_PER_DEGREE * s.late_degree)
        thick_stage = cache(lambda: self._stage(polar, s.late_azimuth_directions, s.late_degree, late_patterns))

        def thick(block: int) -> Passes:
            return thick_stage()(block)

        sunlight = make_sunlight(self.beam, self.nodes.altitude_km, self.profile.break_km)
        n_blocks = -(-self.medium.n_wavelengths // LANES)
        slow = self._reduced_depth() > SLOW_DEPTH
        for block in range(n_blocks):

            def report(event: int, residual: float, block: int = block) -> None:
                tell(f"scattering event {event}", 0.1 + 0.9 * (block + min(0.95, event / 12)) / n_blocks)

            self.solutions.append(
                solve_orders(
                    early(block), late(block), partial(thick, block), lanes_of(slow, block) > 0.0,
                    s.early_events, sunlight, s.max_events, s.tolerance, report,
                )
            )  # fmt: skip
        self.convergence = Convergence(max(s.events for s in self.solutions), max(s.residual for s in self.solutions))

    def _reduced_depth(self) -> np.ndarray:
        """Vertical optical depth (W,) of scattering that turns light around: each share of it times 1 - g."""
        turned = self.profile.species_scattering * (1.0 - self.scaled.moments[:, 1])[:, None]
        return np.trapezoid(turned.sum(axis=0), self.profile.altitude_km, axis=0)

    def _stage(self, polar: int, around: int, degree: int, pattern_degree: int) -> Callable[[int], Passes]:
        """What orders of scattering need at one number of directions, harmonics and patterns, for each block of
        wavelengths."""
        n = self.nodes
        horizon = horizon_cosine(self.path_profile, n.altitude_km)
        angles = make_angles(horizon, polar, around, degree, pattern_degree)
        start = np.repeat(n.altitude_km, angles.cosine.shape[1])
        rays = trace_rays(self.path_profile, start, angles.cosine.ravel(), self.settings.step_density)
        # air with nothing in it has no points along its rays
        longest = float(max(rays.place[:, ANGLE].max(initial=1e-6), rays.ground_angle_rad.max(initial=0.0)))
        turning = make_turning(n.zenith_rad, angles.azimuth, n.fine_rad, longest)
        scattering = self.scattering._replace(chi=self.scattering.chi[:, : degree + 1])
        # as many as the first light of the early events can have
        orders = self.directions.degree + 1
        above = angles.cosine[0, angles.below :]

        def of(block: int) -> Passes:
            points = make_points(rays, scattering, n.fine_altitude_km, turning.step_rad, angles.series, block)
            water = None
            if self.medium.has_water:
                surface = surface_of(self.medium, lanes_of(np.arange(self.medium.n_wavelengths), block).astype(int))
                water = reflection(above, orders, 3 if self.settings.polarisation else 1, *surface)
            return Passes(
                n, angles, rays, points, turning, self.medium, scattering, self.scaled.forward_share, block, water,
                self.path_profile, self.settings.first_step_density,
            )  # fmt: skip

        return of

    @property
    def _pattern_degree(self) -> int:
        return self.settings.polarisation_degree if self.settings.polarisation else 0

    def radiance(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """Sun-normalised radiance [sr^-1], shape of the directions plus (W,); angles in degrees, azimuth from the sun.

        Directions may look down: then the Lambertian ground is seen through the air, lit by the sun and the sky.

        Errors: TwilightError for a sun that the field was not solved for and an observer below the ground.
        """
        return self._look(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km, 1)[..., 0, :]

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
        """As `SegmentField.inscatter`: (sun-normalised radiance [sr^-1], transmittance), directions plus (W,) each.

        The field counts light in the narrow forward peak of aerosol as passed (`peak_passes`).  Otherwise what the
        segment takes out of the light behind it and scatters on in that peak is added: (1 - T / T_scaled) times what
        the whole line brings less what the segment does, the light behind it taken as even across the peak.

        Errors: as `radiance`, and TwilightError for a distance that is not a number of 0 or more.
        """
        where = np.broadcast_arrays(elevation_deg, azimuth_deg, distance_km)
        elevation, azimuth, distance = (np.asarray(a, dtype=float) for a in where)
        if not np.all(distance >= 0.0):
            raise TwilightError("distance_km must be 0 or more")
        question = (sun_elevation_deg, elevation, azimuth, observer_altitude_km, 1)
        light = self._look(*question, distance_km=distance)[..., 0, :]
        altitude = observer_at(self.medium, observer_altitude_km, self.observer_altitude_km)
        ends, back = np.unique(np.stack([elevation.ravel(), distance.ravel()]), axis=1, return_inverse=True)

        def passed(profile) -> np.ndarray:
            cosine = np.sin(np.radians(ends[0]))
            start = np.full(cosine.size, altitude)
            rays = trace_rays(profile, start, cosine, self.settings.sight_density, far_km=ends[1])
            return rays.passed[back.ravel()].reshape(light.shape)

        scaled = passed(self.sight_profile)
        if peak_passes:
            return light, scaled
        clear = prepare_profile(self.medium)
        true = passed(with_refraction(clear, self.medium) if self.settings.bent_lines_of_sight else clear)
        lost = np.where(scaled > 0.0, 1.0 - true / np.where(scaled > 0.0, scaled, 1.0), 0.0)
        if lost.any():
            behind = self._look(*question)[..., 0, :] - light
            light = light + np.maximum(lost, 0.0) * np.maximum(behind, 0.0)
        return light, true

    @property
    def polarised(self) -> bool:
        """Whether it was solved with polarisation."""
        return self.settings.polarisation

    def stokes(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """Sun-normalised Stokes parameters I, Q, U [sr^-1], shape of the directions plus (3, W); angles in degrees.

        They refer to the vertical plane through the line of sight, in the zenith that of the azimuth given.  Q > 0:
        light vibrates in that plane.  U > 0: for somebody who looks along the line, the vibration leans from the
        vertical to the right, to larger azimuth; azimuth from the sun, clockwise seen from above.

        Errors: as `radiance`, and TwilightError for a field that was solved without polarisation.
        """
        if not self.settings.polarisation:
            raise TwilightError("solver.polarisation is false: this field has no Stokes parameters")
        return self._look(sun_elevation_deg, elevation_deg, azimuth_deg, observer_altitude_km, 3)

    def _look(
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
        row_of, place, of_place = once_each(row_of.ravel(), azimuth.ravel())
        row_elevation = np.radians(rows[0])
        row_first = np.searchsorted(row_of, np.arange(row_elevation.size + 1))
        directions = Directions(row_first, np.cos(np.radians(place)), math.radians(90.0 - sun_elevation_deg))
        with_ground = distance_km is None
        density = self.settings.sight_density
        sights = self._sights.get(
            (altitude, with_ground, rows.tobytes()),
            lambda: make_lines(
                self.sight_profile, self.scaled.medium, altitude, rows, density, with_ground, self._thin_layer
            ),
        )
        lift = sun_lift(self.beam, altitude, directions.zenith_rad)
        out = np.zeros((place.size, n_stokes, self.medium.n_wavelengths))
        for block, solution in enumerate(self.solutions):
            part = slice(block * LANES, min((block + 1) * LANES, out.shape[2]))
            seen = self._multiple(sights, directions, block, solution, n_stokes)
            out[:, :, part] = seen[:, :, : part.stop - part.start]
        self._add_single(sights, directions, row_elevation, row_elevation[row_of], lift, out)
        self._sights.trim()
        result = out[of_place]
        if n_stokes > 1:
            # all was computed to the right of the sun; left of it the vibration leans the other way
            result[:, 2] *= np.where(np.sin(np.radians(azimuth.ravel())) < 0.0, -1.0, 1.0)[:, None]
        return result.reshape(*elevation.shape, *out.shape[1:])

    def _add_single(
        self, sights: LinesOfSight, directions: Directions, row_elevation, elevation, lift: float, out: np.ndarray
    ) -> None:
        """Add light scattered once to out (D, Stokes, W), which holds the rest; directions sorted by ray, elevation
        (D,) and lift of the sun [rad]."""
        n_stokes, other = out.shape[1], np.ascontiguousarray(out[:, 0])
        rays, share = sights.pairs, sights.pairs_share
        cos_azimuth = directions.cos_azimuth
        sin_azimuth = np.sqrt(np.maximum(0.0, 1.0 - cos_azimuth**2))
        of_sun, of_rays = reference_turns(rays, row_elevation, lift)
        of_ray = np.repeat(of_rays, np.diff(directions.first))
        # the sun and the ray as they are, the sun lifted, the ray lowered
        suns = [directions.zenith_rad - lifted for lifted in (0.0, of_sun, 0.0)]
        seen = [elevation - lowered for lowered in (0.0, 0.0, of_ray)]
        cosine = np.array(
            [np.sin(e) * math.cos(t) + np.cos(e) * math.sin(t) * cos_azimuth for t, e in zip(suns, seen, strict=True)]
        )
        p11 = species_phase(self.medium, self.scaled.forward_share, cosine.ravel())
        p11 = p11.reshape(*cosine.shape, *p11.shape[1:])
        if self.peak is not None:
            widen_peaks(self.peak, self.scaled, self.beam, p11, cosine, sights.rays, sights.rays_share, directions)
        stokes = [p11]
        if n_stokes > 1:
            p12 = species_polarising_phase(self.medium, self.scaled.forward_share, cosine.ravel()).reshape(p11.shape)
            # elevations below the horizon too: sine and cosine of the zenith angle are cos e and sin e
            turned = [rotated(np.sin(e), cos_azimuth, sin_azimuth, t)[1:] for t, e in zip(suns, seen, strict=True)]
            stokes += [p12 * np.array(part)[..., None, None] for part in zip(*turned, strict=True)]
        plain, lifted_sun, lowered_ray = np.stack(stokes, axis=1)
        phases = Phases(plain, (lifted_sun - plain) / of_sun, (lowered_ray - plain) / of_ray[:, None, None])
        in_slices(
            lambda begin, end: scattered_once(
                self.beam, rays, share, row_elevation, directions, phases, 0.0, other, self.medium.bottom_km,
                self.medium.ground_albedo, out, begin, end,
            ),
            row_elevation.size,
        )  # fmt: skip
        if self.medium.has_water:
            surface = surface_of(self.medium, np.arange(self.medium.n_wavelengths))
            in_slices(
                lambda begin, end: view_sunlit_water(
                    self.beam, rays, directions, surface, self.medium.bottom_km, out, begin, end
                ),
                row_elevation.size,
            )

    def _multiple(
        self, sights: LinesOfSight, directions: Directions, block: int, solution: Solution, n_stokes: int
    ) -> np.ndarray:
        """Light scattered at least twice, (D, Stokes, LANES)."""
        n, rays = self.nodes, sights.rays
        s = self.directions
        series = Series.of(s.degree, self._pattern_degree, s.azimuth_directions)
        if block not in sights.points:
            sights.points[block] = make_points(rays, self.scattering, n.fine_altitude_km, 1.0, series, block)
        points = sights.points[block]
        ground_weight = lanes_of(rays.ground_weight, block)
        ground_place = place_of_cosine(-rays.ground_cosine)

        def along(where: Directions) -> np.ndarray:
            out = np.zeros((where.cos_azimuth.size, n_stokes, LANES))
            in_slices(
                lambda begin, end: view_multiple(
                    rays.first, rays.place, points, where, n.fine_rad, n.zenith_rad, solution.light, n.zenith_rule,
                    series, ground_weight, rays.ground_angle_rad, ground_place, out, begin, end,
                ),
                where.first.size - 1,
            )  # fmt: skip
            return out

        return smooth_around(along, directions)
