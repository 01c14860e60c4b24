"""Single scattering along lines of sight, with the aerosol's own phase function and the refracted beam."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from twilight.atmosphere.medium import Medium
from twilight.geometry import altitude_along
from twilight.threads import in_slices
from twilight.transport.beam import Beam, beam_at
from twilight.transport.march import GAUSS_HIGH, GAUSS_LOW, MAX_STEPS, march, step_transmission
from twilight.transport.profile import Profile
from twilight.transport.scaling import species_phase

REFERENCE_BEND_RAD = math.radians(0.5)
"""Phase functions are taken at the true and at this bent direction of the sun, and linearly between and beyond."""


def unit_vectors(elevation_deg, azimuth_deg) -> np.ndarray:
    """Directions (D, 3) in the observer's frame: z up, x towards the sun's azimuth."""
    e, a = np.radians(elevation_deg), np.radians(azimuth_deg)
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)


def single_scattering(
    profile: Profile,
    jumps: np.ndarray,
    beam: Beam,
    medium: Medium,
    forward_share: np.ndarray,
    observer_altitude_km: float,
    sun_elevation_deg: float,
    directions: np.ndarray,
    fineness: float = 2.0,
    phase: np.ndarray | None = None,
) -> np.ndarray:
    """Sun-normalised radiance (D, W) [sr^-1] of light scattered once by air or by the ground in view.

    medium: the unscaled one, for its phase functions; profile and beam: of the scaled one.  phase (D, 1 + K, W)
    replaces
    the phase functions where it is given; it is then not corrected for the bending of the beam.
    """
    h = math.radians(sun_elevation_deg)
    sun = np.array([math.cos(h), 0.0, math.sin(h)])
    bent = np.array([math.cos(h + REFERENCE_BEND_RAD), 0.0, math.sin(h + REFERENCE_BEND_RAD)])
    if phase is None:
        straight_phase = species_phase(medium, forward_share, directions @ sun)
        slope = (species_phase(medium, forward_share, directions @ bent) - straight_phase) / REFERENCE_BEND_RAD
        floor = 0.0
    else:
        straight_phase, slope, floor = phase, np.zeros_like(phase), -np.inf
    out = np.zeros((directions.shape[0], medium.n_wavelengths))
    directions = np.ascontiguousarray(directions)
    in_slices(
        lambda begin, end: _single(
            profile, jumps, beam, straight_phase, slope, floor, medium.ground_albedo, observer_altitude_km, sun,
            directions, fineness, out, begin, end,
        ),
        directions.shape[0],
    )  # fmt: skip
    return out


@njit(cache=True, nogil=True)
def _single(
    profile,
    jumps,
    beam,
    phase,
    phase_slope,
    phase_floor,
    ground_albedo,
    altitude0,
    sun,
    directions,
    fineness,
    out,
    begin,
    end,
):
    n_wavelengths = profile.extinction.shape[1]
    n_species = phase.shape[1]
    radius = profile.earth_radius_km
    rho0 = radius + altitude0
    for d in range(begin, end):
        edges = np.empty(MAX_STEPS + 2)
        depth = np.empty(n_wavelengths)
        passed = np.zeros(n_wavelengths)
        light = np.empty(n_wavelengths)
        levels = np.empty(2, np.int64)
        fractions = np.empty(2)
        dx, dz = directions[d, 0], directions[d, 2]
        n, hits = march(profile, jumps, altitude0, dz, fineness, edges)
        for k in range(n):
            s0 = edges[k]
            length = edges[k + 1] - s0
            s_low = s0 + GAUSS_LOW * length
            s_high = s0 + GAUSS_HIGH * length
            z_low = altitude_along(altitude0, dz, s_low, radius)
            z_high = altitude_along(altitude0, dz, s_high, radius)
            step_transmission(profile, z_low, z_high, length, levels, fractions, depth)
            for g in range(2):
                s = s_low if g == 0 else s_high
                z = z_low if g == 0 else z_high
                part = GAUSS_LOW if g == 0 else GAUSS_HIGH
                i, f = levels[g], fractions[g]
                c_sun = (s * dx * sun[0] + (rho0 + s * dz) * sun[2]) / (radius + z)
                bend = beam_at(beam, z, c_sun, light)
                for w in range(n_wavelengths):
                    if light[w] > 0.0:
                        source = 0.0
                        for c in range(n_species):
                            sigma = (
                                profile.species_scattering[c, i, w] * (1 - f)
                                + profile.species_scattering[c, i + 1, w] * f
                            )
                            source += sigma * max(phase_floor, phase[d, c, w] + bend * phase_slope[d, c, w])
                        out[d, w] += 0.5 * length * math.exp(-passed[w] - part * depth[w]) * light[w] * source
            for w in range(n_wavelengths):
                passed[w] += depth[w]
        if hits:
            s = edges[n]
            c_sun = (s * dx * sun[0] + (rho0 + s * dz) * sun[2]) / (radius + profile.altitude_km[0])
            bend = beam_at(beam, profile.altitude_km[0], c_sun, light)
            c_apparent = math.cos(max(0.0, math.acos(min(1.0, max(-1.0, c_sun))) - bend))
            for w in range(n_wavelengths):
                out[d, w] += math.exp(-passed[w]) * ground_albedo[w] / math.pi * light[w] * max(0.0, c_apparent)
