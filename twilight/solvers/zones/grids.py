"""Grids of a field, which all its wavelengths share, and spectral groups: wavelengths that need the same grids.

Solving and evaluating a field share the scaled air, its nodes, the profiles that rays go through, and the zenith range:
the solar zenith angles that the suns and observers of a scene need.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.gases import ciddor_refractivity
from twilight.atmosphere.grid_medium import RANGES, range_of
from twilight.atmosphere.medium import Medium
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones.air_needs import (
    FractionalTruncation,
    altitude_nodes,
    degree_needed,
    directions_needed,
    near_edges,
    resolve_layers,
    rims_km,
    thin_layers,
    truncation_needed,
    with_degree,
)
from twilight.solvers.zones.angles import Truncation, cubic_refinement, zenith_nodes
from twilight.solvers.zones.aureole import forward_peak
from twilight.solvers.zones.next_order import ZenithGrid
from twilight.solvers.zones.ray_points import SpeciesMoments
from twilight.solvers.zones.settings import ZonesSettings
from twilight.solvers.zones.small_jumps import without_small_jumps
from twilight.transport.beam import Beam, BeamNodes, prepare_beam
from twilight.transport.lines import with_refraction
from twilight.transport.profile import Profile, expected_factors, prepare_profile, with_steps_of
from twilight.transport.scaling import ScaledMedium, delta_scaled


def visible_arc_deg(medium: Medium, observer_altitude_km: float) -> float:
    """Arc around the Earth from an observer [deg] within which the field is needed.

    It ends where the top of the air sinks below the horizon, and a margin beyond.  Light that comes from beyond is
    scattered below the horizon of all that is seen: leaving it out moves the sky by less than 5e-4, in twilight by less
    than 1e-4.
    """
    ground = medium.earth_radius_km + medium.bottom_km

    def dip_deg(altitude_km: float) -> float:
        return math.degrees(math.acos(ground / max(ground, medium.earth_radius_km + altitude_km)))

    return dip_deg(medium.top_km) + dip_deg(max(observer_altitude_km, tuned.MIN_OBSERVER_KM)) + tuned.MARGIN_DEG


def zenith_range(
    medium: Medium, sun_elevations_deg: Sequence[float] | None, observer_altitude_km: float
) -> tuple[float, float]:
    """Solar zenith angles [deg] that a scene with these suns needs; all of them where None is given."""
    if sun_elevations_deg is None:
        return 0.0, tuned.LAST_ZENITH_DEG
    around = visible_arc_deg(medium, observer_altitude_km)
    lowest, highest = float(np.min(sun_elevations_deg)), float(np.max(sun_elevations_deg))
    return min(max(0.0, 90.0 - highest - around), tuned.BRIGHT_ZENITH_DEG), min(
        tuned.LAST_ZENITH_DEG, 90.0 - lowest + around
    )


@dataclass(frozen=True)
class FieldNodes:
    """Where the field is solved: altitude_km (Z,) and solar zenith angles, with finer grids to which it is interpolated
    by cubics and between which it is linear, fine_altitude_km (Z',) and that of `zenith`.

    altitude_rule: node, weight (Z', 4) of those cubics in altitude, as in `ZenithGrid`
    """

    altitude_km: np.ndarray
    fine_altitude_km: np.ndarray
    altitude_rule: tuple[np.ndarray, np.ndarray]
    zenith: ZenithGrid

    @staticmethod
    def of(altitude_km: np.ndarray, zenith_deg: np.ndarray, jumps_km: np.ndarray) -> FieldNodes:
        zenith = np.radians(zenith_deg)
        fine, node, weight = cubic_refinement(zenith, tuned.FINE_PER_INTERVAL)
        fine_km, node_km, weight_km = cubic_refinement(altitude_km, tuned.FINE_PER_INTERVAL, jumps_km)
        grid = ZenithGrid(zenith, fine, node, weight.astype(np.float32), tuned.FINE_PER_INTERVAL)
        return FieldNodes(altitude_km, fine_km, (node_km, weight_km.astype(np.float32)), grid)

    def refine_zenith(self, values: np.ndarray) -> np.ndarray:
        """Values (T, ...) on the fine grid of solar zenith angles."""
        return _interpolated((self.zenith.node, self.zenith.weight), values)

    def refine_altitude(self, log_mean: np.ndarray, ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Logarithms (Z, T, LANES) and relative moments (Z, T, C, LANES) on the fine grid of altitudes.

        A cubic through logarithms that differ by tens, in air that is black, would swing from order to order: it stays
        near its interval's ends.
        """
        log_fine = _interpolated(self.altitude_rule, log_mean)
        interval = np.minimum(np.arange(log_fine.shape[0]) // tuned.FINE_PER_INTERVAL, log_mean.shape[0] - 2)
        low, high = log_mean[interval], log_mean[interval + 1]
        slack = np.float32(tuned.MAX_OVERSHOOT) * (np.float32(1.0) + np.abs(high - low))
        np.clip(log_fine, np.minimum(low, high) - slack, np.maximum(low, high) + slack, out=log_fine)
        return log_fine, _interpolated(self.altitude_rule, ratio)


def _interpolated(rule: tuple[np.ndarray, np.ndarray], values: np.ndarray) -> np.ndarray:
    node, weight = rule
    flat = np.asarray(values, np.float32).reshape(values.shape[0], -1)
    out = np.zeros((node.shape[0], flat.shape[1]), np.float32)
    for j in range(4):
        out += weight[:, j, None] * flat[node[:, j]]
    return out.reshape(-1, *values.shape[1:])


class Layout(NamedTuple):
    """Grids of a field.

    profile: the scaled air, with the steps of its rays; altitude_km (Z,): of the nodes; directions: the settings with
    as many directions and harmonics as this air needs; truncation: of their series; beam: the medium that the tables of
    the sunbeam are laid out for; bends: the medium whose refractive index bends rays; thin_layer: whether there is one,
    of `thin_layers`; rims_km (R,): of `rims_km`
    """

    profile: Profile
    altitude_km: np.ndarray
    directions: ZonesSettings
    truncation: FractionalTruncation
    beam: Medium
    bends: Medium
    thin_layer: bool
    rims_km: np.ndarray


def settings_for(medium: Medium, settings: ZonesSettings) -> tuple[ZonesSettings, float]:
    """The settings with the degree that a medium needs, or that the ranges of its wavelengths need where it has their
    grids, and that degree with its fraction.

    """
    fixed = _grid_air(medium)
    of = medium if fixed is None else fixed
    return with_degree(settings, of), degree_needed(settings, of)


def lay_out(medium: Medium, scaled: ScaledMedium, settings: ZonesSettings) -> Layout:
    """Grids for all wavelengths of a medium: those of their ranges, if these serve; else made for the medium itself.

    Terms of a gas's exponential sum have the nodes and directions of the air without that gas, and steps as fine as
    TERM_FACTORS say: nodes that follow the darkest term were six times as many, and moved the light by less than nodes
    that are twice as dense move that of any wavelength; steps that follow it made each term depend on the others.

    scaled: the medium with phase functions of the degree, and settings: of `settings_for`
    """
    fixed = _grid_air(medium)
    air = scaled if fixed is None else delta_scaled(fixed, scaled.degree)
    reference = prepare_profile(air.medium)
    of_nodes, beam = reference, scaled.medium
    if fixed is None:
        profile, clearest = reference, _clearest(medium)
        if clearest is not None:
            of_nodes = reference._replace(extinction=reference.extinction[:, clearest])
    else:
        profile, beam = _steps(medium, scaled, fixed)
    return Layout(
        near_edges(profile, reference),
        _field_altitudes(medium, of_nodes, settings.altitude_density),
        directions_needed(settings, air, reference),
        truncation_needed(settings, air, reference),
        beam,
        medium if fixed is None else fixed,
        thin_layers(reference)[0].size > 0,
        rims_km(reference, settings.altitude_density),
    )


def _steps(medium: Medium, scaled: ScaledMedium, fixed: Medium) -> tuple[Profile, Medium]:
    """The scaled air with the steps of its rays, and the medium that tables of its sunbeam are laid out for.

    fixed: the air at the fixed wavelengths of its ranges
    """
    air = delta_scaled(fixed, scaled.degree).medium
    if not _serves(fixed, medium).all():
        steps = prepare_profile(air)
        return with_steps_of(prepare_profile(scaled.medium), steps, tuned.TERM_FACTORS), scaled.medium
    # the most refracted wavelength of a range is its first, which need not be a fixed one
    first = RANGES[range_of(fixed.wavelength_nm[0])][0]
    at_first, at_fixed = ciddor_refractivity(np.array([first, fixed.wavelength_nm[0]]), 288.15, 1013.25)
    beam = replace(air, refractivity=air.refractivity * (at_first / at_fixed))
    return prepare_profile(scaled.medium, like=air), beam


def spectral_groups(medium: Medium, settings: ZonesSettings) -> list[bytes]:
    """A key for each wavelength; wavelengths of one key have the grids that each would have alone.

    All the wavelengths of a field share its grids.  Wavelengths of one range have the grid of that range.  Where that
    grid is not known, or not made for such air, the grid of a field follows the wavelength that needs the finest, and
    at a low quality moves the others by per cents: only wavelengths that need the same grid share a key.  Air that is
    thicker than any that steps are made for shortens them by its own extinction: only wavelengths of the very same
    share its key.
    """
    medium = without_small_jumps(medium)
    ranges, served = [range_of(w) for w in medium.wavelength_nm], serves_range(medium)
    all_wavelengths = range(medium.n_wavelengths)
    return [f"range {ranges[w]}".encode() if served[w] else _own_key(medium, settings, w) for w in all_wavelengths]


def _own_key(medium: Medium, settings: ZonesSettings, w: int) -> bytes:
    alone = medium.select(slice(w, w + 1))
    scaled = delta_scaled(alone, degree_needed(settings, alone))
    settings = with_degree(settings, alone)
    profile = prepare_profile(scaled.medium)
    nodes = _field_altitudes(medium, profile, settings.altitude_density)
    factors = expected_factors(profile.altitude_km, profile.extinction[:, 0])
    steps = f"as expected times {factors}" if factors else hashlib.sha256(profile.extinction.tobytes()).hexdigest()
    directions = str(directions_needed(settings, scaled, profile))
    return steps.encode() + directions.encode() + nodes.tobytes() + near_edges(profile, profile).stop_km.tobytes()


def has_terms(medium: Medium) -> bool:
    """Whether some columns are terms of exponential sums, which repeat their wavelength."""
    return np.unique(medium.wavelength_nm).size < medium.n_wavelengths


def serves_range(medium: Medium) -> np.ndarray:
    """Whether the grid of its range serves each wavelength of a medium that knows its air at fixed ones, (W,)."""
    ranges = np.array([range_of(w) for w in medium.wavelength_nm])
    served = np.zeros(ranges.size, bool)
    for r in np.unique(ranges):
        fixed, of = _fixed(medium, {int(r)}), ranges == r
        if fixed is not None:
            served[of] = _serves(fixed, medium)[of]
    return served


def _grid_air(medium: Medium) -> Medium | None:
    """The air at fixed wavelengths whose grids serve a medium; None where grids are made for the medium itself."""
    fixed, clearest = _fixed(medium, {range_of(w) for w in medium.wavelength_nm}), _clearest(medium)
    if fixed is None:
        return None
    return fixed if _serves(fixed, medium if clearest is None else medium.select(clearest)).all() else None


def _fixed(medium: Medium, ranges: set[int]) -> Medium | None:
    """The air at the fixed wavelengths of some ranges, None where one of them has none."""
    known = medium.at_grid_wavelengths
    if known is None or not ranges <= {range_of(w) for w in known.wavelength_nm}:
        return None
    return known.select(np.isin([range_of(w) for w in known.wavelength_nm], list(ranges)))


def _clearest(medium: Medium) -> np.ndarray | None:
    """Index of the term of the exponential sum that absorbs least, for every wavelength; None for a medium without
    terms.

    Terms repeat their wavelength (:mod:`twilight.atmosphere.bands`).
    """
    if not has_terms(medium):
        return None
    nm, place = np.unique(medium.wavelength_nm, return_inverse=True)
    order = np.lexsort((medium.optical_depth("absorption"), place))
    return order[np.searchsorted(place[order], np.arange(nm.size))]


def _serves(fixed: Medium, medium: Medium) -> np.ndarray:
    """Whether a grid made for `fixed` serves each wavelength of a medium, (W,)."""
    if not np.array_equal(fixed.altitude_km, medium.altitude_km):
        return np.zeros(medium.n_wavelengths, bool)
    return np.all(
        medium.extinction_per_km <= tuned.MAX_EXTINCTION_RATIO * fixed.extinction_per_km.max(axis=1)[:, None], axis=0
    )


def _field_altitudes(medium: Medium, profile: Profile, density: float) -> np.ndarray:
    """Altitudes [km] of the nodes of a field; profile: of the scaled air."""
    nodes = altitude_nodes(medium.bottom_km, medium.top_km, profile.break_km, density, rims_km(profile, density))
    return resolve_layers(nodes, profile, density)


def _spin2_degree(settings: ZonesSettings) -> int:
    return settings.polarisation_degree if settings.polarisation else 0


@dataclass(frozen=True)
class FieldGrids:
    """Grids of a field.

    medium: before scaling; air: the same without small jumps; settings: of the field; directions: the settings with the
    degree and as many directions and harmonics as this air needs; zenith_range_deg: of the sun
    scaled, scattering: the delta-scaled air and the moments of its phase matrices
    profile: of the scaled air, along straight rays; line_profile, path_profile: through which lines of sight and rays
    between two scatterings go, bent where the settings say so; nodes: of the field; layout: of `lay_out`
    """

    medium: Medium
    air: Medium
    settings: ZonesSettings
    directions: ZonesSettings
    zenith_range_deg: tuple[float, float]
    scaled: ScaledMedium
    scattering: SpeciesMoments
    profile: Profile
    line_profile: Profile
    path_profile: Profile
    nodes: FieldNodes
    layout: Layout

    @staticmethod
    def of(medium: Medium, settings: ZonesSettings, zenith_range_deg: tuple[float, float]) -> FieldGrids:
        """Grids for a medium under settings."""
        air = without_small_jumps(medium)
        of_air, degree = settings_for(air, settings)
        scaled = delta_scaled(air, degree)
        layout = lay_out(air, scaled, of_air)
        bent = with_refraction(layout.profile, layout.bends)
        zenith = zenith_nodes(*zenith_range_deg, of_air.zenith_density)
        return FieldGrids(
            medium,
            air,
            settings,
            layout.directions,
            zenith_range_deg,
            scaled,
            SpeciesMoments.of(air, scaled, layout.profile, _spin2_degree(settings)),
            layout.profile,
            bent if settings.bent_lines_of_sight else layout.profile,
            bent if settings.bent_paths else layout.profile,
            FieldNodes.of(layout.altitude_km, zenith, layout.profile.sharp_km),
            layout,
        )

    @property
    def spin2_degree(self) -> int:
        """Degree of the spin-2 harmonics of Q and U, 0 without polarisation."""
        return _spin2_degree(self.settings)

    @property
    def line_series(self) -> Truncation:
        """Harmonics in which lines of sight see the light."""
        s = self.directions
        return Truncation.of(s.degree, self.spin2_degree, s.azimuth_directions)

    def sunbeam(self) -> Beam:
        """Tables of the sunbeam in the scaled air."""
        d = self.settings.beam_density
        nodes = BeamNodes(
            tuned.ALTITUDE_NODES_PER_SCALE * d,
            tuned.LIMB_NODES_PER_SCALE * d,
            round(tuned.COSINE_NODES * d),
            max(tuned.MIN_DISTANCE_NODES, round(tuned.DISTANCE_NODES * d)),
            round(tuned.GUESS_NODES * d),
        )
        return prepare_beam(
            self.scaled.medium, refraction=self.settings.refraction, nodes=nodes, laid_out_for=self.layout.beam
        )


def kinds_met(medium: Medium, settings: ZonesSettings) -> set[str]:
    """The kinds of air of the table of tuned numbers (`constants`) that a medium is at these settings: the numbers of
    other kinds change nothing in its grids.

    medium: of the terms, where gases have bands
    """
    medium = without_small_jumps(medium)
    grown, degree = settings_for(medium, settings)
    scaled = delta_scaled(medium, degree)
    layout = lay_out(medium, scaled, grown)
    density = grown.altitude_density
    reference = prepare_profile(delta_scaled(layout.bends, degree).medium)
    plain = altitude_nodes(medium.bottom_km, medium.top_km, reference.break_km, density, layout.rims_km)
    z = medium.altitude_km
    aerosol = medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo
    aloft = np.where(z[:, None] >= tuned.ALOFT_KM, aerosol, 0.0)
    scattering = medium.air_scattering_per_km + aerosol
    peak = forward_peak(medium, scaled, reference)
    met = {
        tuned.PARTICLES: medium.has_aerosol,
        tuned.COARSE: degree > settings.degree or layout.truncation.azimuthal_orders > settings.azimuth_directions,
        tuned.PEAKED: grown.polar_directions > settings.polar_directions,
        tuned.VOLCANO: np.trapezoid(aloft, z, axis=0).max() > tuned.LEAST_ALOFT_DEPTH,
        tuned.CLOUD: np.trapezoid(scattering, z, axis=0).max() > tuned.HAZE_DEPTH,
        tuned.RIM: layout.rims_km.size > 0,
        tuned.THIN: layout.thin_layer,
        tuned.LAYERED: layout.altitude_km.size > plain.size,
        tuned.ICE: peak is not None and peak.end.size > tuned.HIGHEST_DEGREE + 1,
        tuned.BANDS: has_terms(medium),
    }
    return {tuned.ANY, *(kind for kind, there in met.items() if there)}
