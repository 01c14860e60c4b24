"""Light that the ring of air around the Earth scatters once into its own shadow.

An observer at the distance D from the Earth's centre sees the lit air past the limb.  Over all lines of sight, by their
Bouguer's invariant p and the angle a about the Earth's centre from the sun's side,

    E / F0 = int p dp / (D^2 cos psi) int da int T beta_s P(Theta) B ds,  sin psi = p / D,

T: transmittance of the bent line to the point; B: the refracted sunbeam there; P: phase function of molecules and
aerosol at the angle Theta between the bent line and the bent beam, 0.3 to 4 deg at the moon.  The sun is a point in its
disc's middle.  Light scattered more than once is left out, and so is what the ground and clouds reflect.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.jit.kernels import njit
from twilight.numerics.phase import rayleigh_phase
from twilight.transport.beam import beam_at, prepare_beam
from twilight.transport.lines import ALTITUDE, ANGLE, COSINE, with_refraction
from twilight.transport.profile import prepare_profile
from twilight.transport.ray_bundle import species_fraction, trace_rays

EDGES_KM = (-12.0, -3.0, 0.0, 4.0, 8.0, 12.0, 16.0, 20.0, 26.0, 34.0, 50.0)
"""Apparent tangent altitudes over the ground [km] between which lines of sight lie; a last interval ends at the top."""
LINES = 4
"""Lines of sight between two edges, Gauss-Legendre."""
AROUND = 6
"""Azimuths over half the ring, evenly spaced: the other half is its mirror image."""


@njit(cache=True, nogil=True)
def _sunlight(beam, altitude_km, cos_sun_zenith, light, bending):
    """Fill light (P, W) and bending (P,) [rad] of the sunbeam.

    beam: `Beam`; altitude_km (P,): of the points; cos_sun_zenith (P,): of the true sun there
    """
    for k in range(altitude_km.size):
        bending[k] = beam_at(beam, altitude_km[k], cos_sun_zenith[k], light[k])


class SinglyScatteredLight:
    """Light scattered once behind the Earth of a medium, seen from the distance `distance_km` of its centre."""

    def __init__(self, medium: Medium, distance_km: float):
        self.medium = medium
        self._beam = prepare_beam(medium)
        top, bottom = medium.top_km, medium.bottom_km
        edges = [e for e in np.array(EDGES_KM) + bottom if e < top] + [top]
        x, w = np.polynomial.legendre.leggauss(LINES)
        tangent = np.concatenate([0.5 * (a + b + (b - a) * x) for a, b in pairwise(edges)])
        weight = np.concatenate([0.5 * (b - a) * w for a, b in pairwise(edges)])
        invariant = medium.earth_radius_km + tangent
        entry = np.arcsin(invariant / (medium.earth_radius_km + top))
        psi = np.arcsin(invariant / distance_km)
        profile = with_refraction(prepare_profile(medium), medium)
        rays = trace_rays(profile, np.full(tangent.size, top), -np.cos(entry), 1.0, pairs=True)
        line = np.repeat(np.arange(tangent.size), np.diff(rays.first))
        self._solid = (weight * invariant / (distance_km**2 * np.cos(psi)))[line]
        self._altitude = np.ascontiguousarray(rays.place[:, ALTITUDE])
        self._centric = rays.place[:, ANGLE] + (entry - psi)[line]
        self._cosine = rays.place[:, COSINE]
        self._weight = rays.weight
        self._fraction = species_fraction(medium, self._altitude)

    def irradiance(self, offset_rad: np.ndarray) -> np.ndarray:
        """Irradiance at normal incidence over that of the sun, (N, W).

        offset_rad (N,): angles between the sun's centre and the Earth's, as seen from there [rad].
        """
        azimuths = (np.arange(AROUND) + 0.5) * np.pi / AROUND
        return np.array(
            [2.0 * np.pi * np.mean([self._over_lines(d, a) for a in azimuths], axis=0) for d in np.ravel(offset_rad)]
        )

    def _over_lines(self, offset_rad: float, azimuth_rad: float) -> np.ndarray:
        """Integral over the lines of sight of one azimuth from the sun's side [rad], per radian of azimuth, (W,)."""
        sin_c, cos_c = np.sin(self._centric), np.cos(self._centric)
        # direction of the sun for the observer: along the azimuth of the line of sight, across it, and up
        along, across = np.sin(offset_rad) * np.cos(azimuth_rad), np.sin(offset_rad) * np.sin(azimuth_rad)
        up = -np.cos(offset_rad)
        cosine = up * cos_c + along * sin_c
        level = along * cos_c - up * sin_c
        light = np.empty(self._weight.shape)
        bending = np.empty(cosine.size)
        _sunlight(self._beam, self._altitude, np.ascontiguousarray(np.clip(cosine, -1.0, 1.0)), light, bending)
        sine = np.hypot(level, across)
        zenith = np.arctan2(sine, cosine) - bending
        # half angles keep the digits of small scattering angles
        view = np.arccos(np.clip(self._cosine, -1.0, 1.0))
        one_less_cos_azimuth = 1.0 - level / np.maximum(sine, 1e-300)
        haversine = np.sin(0.5 * (zenith - view)) ** 2 + 0.5 * np.sin(zenith) * np.sin(view) * one_less_cos_azimuth
        mu = 1.0 - 2.0 * haversine
        m = self.medium
        phase = self._fraction[0] * rayleigh_phase(mu[:, None], m.depolarisation)
        for k, function in enumerate(m.phase_functions):
            phase += self._fraction[1 + k] * function(mu).T
        return np.einsum("p,pw,pw,pw->w", self._solid, self._weight, phase, light)


def above(medium: Medium, top_km: float) -> Medium:
    """The air above an altitude [km] that lies between its levels."""
    levels = medium.altitude_km
    at = int(np.searchsorted(levels, top_km, side="right"))
    pieces = [np.array([z]) for z in levels]
    pieces[at] = np.array([top_km, levels[at]])
    whole = replace(medium, grid_medium=None).on_levels(pieces)
    names = ("altitude_km", "air_scattering_per_km", "absorption_per_km", "aerosol_extinction_per_km",
             "aerosol_single_scattering_albedo", "refractivity")  # fmt: skip
    cut = {name: getattr(whole, name)[at:] for name in names}
    return replace(whole, aerosol_phase_fraction=whole.aerosol_phase_fraction[:, at:], **cut)
