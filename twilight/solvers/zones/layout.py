"""Grids that all wavelengths of a field share, and spectral groups: wavelengths that need the same grids."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.grid_medium import RANGES, range_of
from twilight.atmosphere.medium import Medium
from twilight.atmosphere.refraction import ciddor_refractivity
from twilight.solvers.zones.altitudes import altitude_nodes, resolve_layers
from twilight.solvers.zones.directions import (
    FractionalTruncation,
    degree_needed,
    directions_needed,
    near_edges,
    rims_km,
    thin_layers,
    truncation_needed,
    with_degree,
)
from twilight.solvers.zones.settings import ZonesSettings
from twilight.transport.profile import Profile, expected_factors, prepare_profile, with_steps_of
from twilight.transport.scaling import ScaledMedium, delta_scaled

MAX_EXTINCTION_RATIO = 1.5
"""Extinction over the largest of a range's fixed wavelengths up to which a grid made for those serves."""

TERM_FACTORS = (2.0, 4.0)
"""Multiples of the expected extinction (`expected_extinction`) that steps along rays follow where the wavelengths are
terms of a gas's exponential sum, however strongly the darkest term absorbs."""


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


def settings_for(medium: Medium, settings: ZonesSettings, of_terms: bool = False) -> tuple[ZonesSettings, float]:
    """The settings with the degree that a medium needs, or that the ranges of its wavelengths need where it has their
    grids, and that degree with its fraction.

    of_terms: as of `lay_out`
    """
    fixed = _grid_air(medium, of_terms)
    of = medium if fixed is None else fixed
    return with_degree(settings, of), degree_needed(settings, of)


def lay_out(medium: Medium, scaled: ScaledMedium, settings: ZonesSettings, of_terms: bool = False) -> Layout:
    """Grids for all wavelengths of a medium: those of their ranges, if these serve; else made for the medium itself.

    Terms of a gas's exponential sum have the nodes and directions of the air without that gas, and steps as fine as
    TERM_FACTORS say: nodes that follow the darkest term were six times as many, and moved the light by less than nodes
    that are twice as dense move that of any wavelength; steps that follow it made each term depend on the others.

    scaled: the medium with phase functions of the degree, and settings: of `settings_for`; of_terms: the columns
    are some of the terms of bands that are interpolated over the spectrum
    """
    fixed = _grid_air(medium, of_terms)
    air = scaled if fixed is None else delta_scaled(fixed, scaled.degree)
    reference = prepare_profile(air.medium)
    of_nodes, beam = reference, scaled.medium
    if fixed is None:
        profile, clearest = reference, _clearest(medium)
        if clearest is not None:
            of_nodes = reference._replace(extinction=reference.extinction[:, clearest])
    elif of_terms or not _serves(fixed, medium).all():
        profile = with_steps_of(prepare_profile(scaled.medium), reference, TERM_FACTORS)
    else:
        profile = prepare_profile(scaled.medium, like=air.medium)
        # the most refracted wavelength of a range is its first, which need not be a fixed one
        first = RANGES[range_of(fixed.wavelength_nm[0])][0]
        there, here = ciddor_refractivity(np.array([first, fixed.wavelength_nm[0]]), 288.15, 1013.25)
        beam = replace(air.medium, refractivity=air.medium.refractivity * (there / here))
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


def spectral_groups(medium: Medium, settings: ZonesSettings) -> list[bytes]:
    """A key for each wavelength; wavelengths of one key have the grids that each would have alone.

    All the wavelengths of a field share its grids.  Wavelengths of one range have the grid of that range.  Where that
    grid is not known, or not made for such air, the grid of a field follows the wavelength that needs the finest, and
    at a low quality moves the others by per cents: only wavelengths that need the same grid share a key.  Air that is
    thicker than any that steps are made for shortens them by its own extinction: no other wavelength shares its key.
    """
    ranges, served = [range_of(w) for w in medium.wavelength_nm], serves_range(medium)
    all_wavelengths = range(medium.n_wavelengths)
    return [f"range {ranges[w]}".encode() if served[w] else _own_key(medium, settings, w) for w in all_wavelengths]


def _own_key(medium: Medium, settings: ZonesSettings, w: int) -> bytes:
    one = medium.select(slice(w, w + 1))
    scaled = delta_scaled(one, degree_needed(settings, one))
    settings = with_degree(settings, one)
    profile = prepare_profile(scaled.medium)
    nodes = _field_altitudes(medium, profile, settings.altitude_density)
    factors = expected_factors(profile.altitude_km, profile.extinction[:, 0])
    steps = f"as expected times {factors}" if factors else f"of wavelength {w}"
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


def _grid_air(medium: Medium, of_terms: bool) -> Medium | None:
    """The air at fixed wavelengths whose grids serve a medium; None where grids are made for the medium itself."""
    fixed = _fixed(medium, {range_of(w) for w in medium.wavelength_nm})
    if fixed is None or of_terms:
        return fixed
    clearest = _clearest(medium)
    return fixed if _serves(fixed, medium if clearest is None else medium.select(clearest)).all() else None


def _fixed(medium: Medium, ranges: set[int]) -> Medium | None:
    """The air at the fixed wavelengths of some ranges, None where one of them has none."""
    reference = medium.at_grid_wavelengths
    if reference is None:
        return None
    of = np.array([range_of(w) for w in reference.wavelength_nm])
    return reference.select(np.isin(of, list(ranges))) if ranges <= set(of.tolist()) else None


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
        medium.extinction_per_km <= MAX_EXTINCTION_RATIO * fixed.extinction_per_km.max(axis=1)[:, None], axis=0
    )


def _field_altitudes(medium: Medium, profile: Profile, density: float) -> np.ndarray:
    """Altitudes [km] of the nodes of a field; profile: of the scaled air."""
    nodes = altitude_nodes(medium.bottom_km, medium.top_km, profile.break_km, density, rims_km(profile, density))
    return resolve_layers(nodes, profile, density)
