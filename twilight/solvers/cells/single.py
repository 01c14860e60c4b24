"""Single scattering along lines of sight, with the aerosol's own phase function and the refracted beam."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.threads import in_slices
from twilight.transport.around import Directions
from twilight.transport.beam import Beam
from twilight.transport.bundle import Rays, species_share, trace_rays
from twilight.transport.lines import ALTITUDE
from twilight.transport.profile import Profile
from twilight.transport.scaling import ScaledMedium, species_phase
from twilight.transport.sunlit import scattered_once
from twilight.transport.sunlit_ray import Phases

REFERENCE_BEND_RAD = math.radians(0.5)
"""Phase functions are taken at the true and at this bent direction of the sun, and linearly between and beyond."""


def unit_vectors(elevation_deg, azimuth_deg) -> np.ndarray:
    """Directions (D, 3) in the observer's frame: z up, x towards the sun's azimuth."""
    e, a = np.radians(elevation_deg), np.radians(azimuth_deg)
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)


class Sight(NamedTuple):
    """Lines of sight from one altitude, for any sun: D directions on R rays.

    rays: straight ones, one for each elevation; share (1 + K, P, W): of each species in what their points scatter
    elevation (R,), azimuth (D,) [rad]; order (D,): of the directions by ray; row_first (R + 1,): where each ray's begin
    """

    rays: Rays
    share: np.ndarray
    elevation: np.ndarray
    azimuth: np.ndarray
    order: np.ndarray
    row_first: np.ndarray


def make_sight(
    profile: Profile, scaled: ScaledMedium, altitude_km: float, elevation_deg, azimuth_deg, fineness: float = 2.0
) -> Sight:
    """Lines of sight in directions elevation_deg, azimuth_deg (D,); `profile` is that of the scaled medium."""
    elevation, row = np.unique(np.radians(elevation_deg), return_inverse=True)
    order = np.argsort(row, kind="stable")
    rays = trace_rays(profile, np.full(elevation.size, altitude_km), np.sin(elevation), fineness, pairs=True)
    share = np.ascontiguousarray(species_share(scaled.medium, rays.place[:, ALTITUDE]))
    row_first = np.searchsorted(row[order], np.arange(elevation.size + 1))
    return Sight(rays, share, elevation, np.radians(azimuth_deg), order, row_first)


def single_scattering(
    sight: Sight,
    beam: Beam,
    medium: Medium,
    forward_share: np.ndarray,
    sun_elevation_deg: float,
    phase: np.ndarray | None = None,
) -> np.ndarray:
    """Sun-normalised radiance (D, W) [sr^-1] of light scattered once by air or by the ground in view.

    beam: of the scaled medium; medium: the unscaled one, for its phase functions and its ground
    phase (D, 1 + K, W): replaces the phase functions where it is given; it may be negative, and is not corrected for
    the bending of the beam.
    """
    sun = math.radians(sun_elevation_deg)
    order = sight.order
    if phase is None:
        elevation = sight.elevation[np.repeat(np.arange(sight.elevation.size), np.diff(sight.row_first))]
        turned = []
        for h in (sun, sun + REFERENCE_BEND_RAD):
            cosine = np.sin(elevation) * math.sin(h) + np.cos(elevation) * math.cos(h) * np.cos(sight.azimuth[order])
            turned.append(species_phase(medium, forward_share, cosine))
        value, of_sun, floor = turned[0], (turned[1] - turned[0]) / REFERENCE_BEND_RAD, 0.0
    else:
        value, of_sun, floor = phase[order], np.zeros_like(phase), -np.inf
    phases = Phases(value[None], of_sun[None], np.zeros_like(value)[None])
    directions = Directions(sight.row_first, np.cos(sight.azimuth[order]), 0.5 * math.pi - sun)
    found = np.zeros((order.size, 1, medium.n_wavelengths))
    no_other = np.zeros((order.size, medium.n_wavelengths))
    in_slices(
        lambda begin, end: scattered_once(
            beam, sight.rays, sight.share, sight.elevation, directions, phases, floor, no_other,
            medium.bottom_km, medium.ground_albedo, found, begin, end,
        ),
        sight.elevation.size,
    )  # fmt: skip
    out = np.empty_like(found[:, 0])
    out[order] = found[:, 0]
    return out
