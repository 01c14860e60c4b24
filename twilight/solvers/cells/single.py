"""Single scattering along lines of sight, with the aerosol's own phase function and the refracted beam."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.threads import in_slices
from twilight.transport.azimuth_series import RayDirections
from twilight.transport.beam import Beam
from twilight.transport.lines import ALTITUDE, RayBundle, species_fraction, trace_rays
from twilight.transport.profile import Profile
from twilight.transport.scaling import ScaledMedium, species_phase
from twilight.transport.sunlit import scattered_once
from twilight.transport.sunlit_ray import Phases, SunlitAir

REFERENCE_BEND_RAD = math.radians(0.5)
"""Lift of the sun [rad] at which phase functions are taken a second time; they are linear in the lift."""


def unit_vectors(elevation_deg, azimuth_deg) -> np.ndarray:
    """Directions (D, 3) in the observer's frame: z up, x towards the sun's azimuth."""
    e, a = np.radians(elevation_deg), np.radians(azimuth_deg)
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)


class StraightLines(NamedTuple):
    """Lines of sight from one altitude, for any sun: D directions on R rays.

    rays: straight ones, one for each elevation; fraction (1 + K, P, W): of each species in what their points scatter
    elevation (R,), azimuth (D,) [rad]; order (D,): of the directions by ray; row_first (R + 1,): where each ray's begin
    """

    rays: RayBundle
    fraction: np.ndarray
    elevation: np.ndarray
    azimuth: np.ndarray
    order: np.ndarray
    row_first: np.ndarray


def make_straight_lines(
    profile: Profile, scaled: ScaledMedium, altitude_km: float, elevation_deg, azimuth_deg, fineness: float = 2.0
) -> StraightLines:
    """Lines of sight in directions elevation_deg, azimuth_deg (D,); `profile` is that of the scaled medium."""
    elevation, row = np.unique(np.radians(elevation_deg), return_inverse=True)
    order = np.argsort(row, kind="stable")
    rays = trace_rays(profile, np.full(elevation.size, altitude_km), np.sin(elevation), fineness, pairs=True)
    fraction = np.ascontiguousarray(species_fraction(scaled.medium, rays.place[:, ALTITUDE]))
    row_first = np.searchsorted(row[order], np.arange(elevation.size + 1))
    return StraightLines(rays, fraction, elevation, np.radians(azimuth_deg), order, row_first)


def single_scattering(
    lines: StraightLines,
    beam: Beam,
    medium: Medium,
    forward_fraction: np.ndarray,
    sun_elevation_deg: float,
    phase: np.ndarray | None = None,
) -> np.ndarray:
    """Sun-normalised radiance (D, W) [sr^-1] of light scattered once by air or by the ground in view.

    beam: of the scaled medium; medium: the unscaled one, for its phase functions and its ground
    phase (D, 1 + K, W): replaces the phase functions where it is given; it may be negative, and is not corrected for
    the bending of the beam.
    """
    sun = math.radians(sun_elevation_deg)
    order = lines.order
    if phase is None:
        elevation = lines.elevation[np.repeat(np.arange(lines.elevation.size), np.diff(lines.row_first))]
        turned = []
        for h in (sun, sun + REFERENCE_BEND_RAD):
            cosine = np.sin(elevation) * math.sin(h) + np.cos(elevation) * math.cos(h) * np.cos(lines.azimuth[order])
            turned.append(species_phase(medium, forward_fraction, cosine))
        value, of_sun, floor = turned[0], (turned[1] - turned[0]) / REFERENCE_BEND_RAD, 0.0
    else:
        value, of_sun, floor = phase[order], np.zeros_like(phase), -np.inf
    phases = Phases(value[None], of_sun[None], np.zeros_like(value)[None])
    directions = RayDirections(lines.row_first, np.cos(lines.azimuth[order]), 0.5 * math.pi - sun)
    found = np.zeros((order.size, 1, medium.n_wavelengths))
    no_other = np.zeros((order.size, medium.n_wavelengths))
    air = SunlitAir(beam, lines.rays, lines.fraction, phases, floor, no_other)
    in_slices(
        lambda begin, end: scattered_once(
            air, lines.elevation, directions, medium.bottom_km, medium.ground_albedo, found, begin, end
        ),
        lines.elevation.size,
    )
    out = np.empty_like(found[:, 0])
    out[order] = found[:, 0]
    return out
