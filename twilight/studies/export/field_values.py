"""What tables are filled with: a field's radiance, and what aerosol scattered once apart from the rest."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.transport.beam import beam_at, prepare_beam
from twilight.transport.lines import ALTITUDE, DISTANCE, new_line, trace_line, weight_by_species
from twilight.transport.profile import SUDDEN_KM, prepare_profile
from twilight.transport.scaling import delta_scaled

DELTA_SCALING_DEGREE = 20
"""Degree of the delta scaling of light that aerosol scattered once."""

JUST_DEG = 1e-3
"""How far from the horizon the directions next to it are [deg]."""

PHASE_ANGLES = 256
"""Texels of the table of the effective phase function."""

USUAL_HAZE_TOP_KM = 2.0
"""Height of the haze's top above the ground in air where extinction never falls suddenly [km]."""


@njit(cache=True, nogil=True)
def _single_scattering(profile, beam, altitude_km, elevation, azimuth, sun, out, begin, end):
    """Light that each kind of aerosol scattered once, without its phase function, out (K, S, E, A, W), for rows
    begin..end.

    profile: `Profile`; beam: `Beam`; altitude_km: the observer's; elevation (E,), azimuth (S, E, A) and sun (S,) [rad].
    """
    n_k, n_w = out.shape[0], out.shape[4]
    line = new_line(profile)
    source = np.empty((line.place.shape[0], profile.species_scattering.shape[0], n_w))
    light, sums = np.empty(n_w), np.empty((n_k, n_w))
    r = profile.earth_radius_km + altitude_km
    for e in range(begin, end):
        mu = math.sin(elevation[e])
        n, _ = trace_line(profile, altitude_km, mu, 1.0, np.bool_(True), line, math.inf)
        for p in range(n):
            weight_by_species(profile, line.place[p, ALTITUDE], line.weight[p], source[p])
        for s in range(sun.size):
            mu_s = math.sin(sun[s])
            for a in range(azimuth.shape[2]):
                nu = mu * mu_s + math.cos(elevation[e]) * math.cos(sun[s]) * math.cos(azimuth[s, e, a])
                _sum_along_line(beam, line.place, n, profile.earth_radius_km, r, mu_s, nu, source, light, sums)
                for k in range(n_k):
                    for w in range(n_w):
                        out[k, s, e, a, w] += sums[k, w]


@njit(inner=True, cache=True, makes_arrays=False)
def _sum_along_line(beam, place, n, radius_km, r, mu_s, nu, source, light, sums):
    """Light that each kind of aerosol scattered once along one line in one direction, without its phase function.

    beam: as in `_single_scattering`; place (P, 4): of the points of the line, n: number of them; radius_km, r: of the
    Earth and of the line's start; mu_s, nu: cosines of the sun's zenith angle there and of the angle from the line to
    it; source (P, 1 + K, W): what a point scatters of sunlight, first the air; light (W,): room; sums (K, W): filled.
    """
    for k in range(sums.shape[0]):
        for w in range(light.size):
            sums[k, w] = 0.0
    for p in range(n):
        altitude = place[p, ALTITUDE]
        there = (r * mu_s + place[p, DISTANCE] * nu) / (radius_km + altitude)
        beam_at(beam, altitude, min(1.0, max(-1.0, there)), light)
        for k in range(sums.shape[0]):
            for w in range(light.size):
                if light[w] > 0.0:
                    sums[k, w] += source[p, 1 + k, w] * light[w]


@dataclass
class FieldSource:
    """A solved field and its medium at the wavelengths of the tables, three for most of them, shortest first."""

    field: Any
    medium: Medium
    refracted: bool

    def __post_init__(self):
        self.scaled = delta_scaled(self.medium, DELTA_SCALING_DEGREE)
        self.beam = prepare_beam(self.scaled.medium, refraction=self.refracted)
        self.profile = prepare_profile(self.scaled.medium)
        self.phase = self._effective_phase() if self.medium.has_aerosol else None

    def _effective_phase(self) -> np.ndarray:
        """Phase function (PHASE_ANGLES, W) of all the aerosol of a column, at angles pi u^2; of the unscaled one."""
        z = np.linspace(self.medium.bottom_km, self.medium.top_km, 2000)
        at = self.medium.at(z)
        column = (at.aerosol_scattering[None] * at.aerosol_phase_fraction).sum(axis=1)
        cosine = np.cos(np.pi * np.linspace(0.0, 1.0, PHASE_ANGLES) ** 2)
        each = np.stack([phase(cosine).T for phase in self.medium.phase_functions])
        return np.einsum("kaw,kw->aw", each, column / column.sum(axis=0))

    def phase_at(self, cosine: np.ndarray) -> np.ndarray:
        """The effective phase function (..., W) as a reader finds it in its table."""
        assert self.phase is not None
        return read_phase(self.phase, cosine)

    def horizon_deg(self, altitude_km: float) -> float:
        """Apparent elevation of the horizon."""
        return self.grazing_deg(altitude_km, self.medium.bottom_km)

    def grazing_deg(self, altitude_km: float, lowest_km: float) -> float:
        """Apparent elevation of the ray that is level at an altitude, by Bouguer's invariant n r cos(elevation).

        0 for an observer below that altitude.
        """
        m, both_km = self.medium, np.array([lowest_km, altitude_km])
        n = 1.0 + (m.at(both_km).refractivity[:, 1] if self.refracted else np.zeros(2))
        r = m.earth_radius_km + both_km
        return -math.degrees(math.acos(min(1.0, n[0] * r[0] / (n[1] * r[1]))))

    def haze_top_km(self) -> float:
        """The altitude at which extinction falls most suddenly upwards: the top of the haze.

        A line of sight that passes just below it runs through hundreds of kilometres of haze, and just above it
        through none.  Without such a jump `USUAL_HAZE_TOP_KM` above the ground.
        """
        p, sharp = self.profile, self.profile.sharp_km
        if sharp.size == 0:
            return self.medium.bottom_km + USUAL_HAZE_TOP_KM
        below, above = (
            np.stack([np.interp(sharp + d, p.altitude_km, e) for e in p.extinction.T]) for d in (-SUDDEN_KM, SUDDEN_KM)
        )
        fall = np.max(below - above, axis=0)
        return float(sharp[np.argmax(fall)]) if fall.max() > 0.0 else self.medium.bottom_km + USUAL_HAZE_TOP_KM

    def radiance(self, altitude_km: float, sun_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        return self.field.radiance(sun_deg, elevation_deg, azimuth_deg, observer_altitude_km=altitude_km)

    def single_aerosol(self, altitude_km: float, elevation_deg, azimuth_deg, sun_deg) -> np.ndarray:
        """Light that aerosol scattered once [sr^-1] (S, E, A, W), of elevations (E,), azimuths (A,) and suns (S,)."""
        e, a, s = (np.radians(np.atleast_1d(v)) for v in (elevation_deg, azimuth_deg, sun_deg))
        a = np.ascontiguousarray(np.broadcast_to(a, (s.size, e.size, a.shape[-1])))
        parts = np.zeros((len(self.medium.phase_functions), *a.shape, self.medium.n_wavelengths))
        in_slices(lambda i, j: _single_scattering(self.profile, self.beam, altitude_km, e, a, s, parts, i, j), e.size)
        cosine = np.sin(e)[None, :, None] * np.sin(s)[:, None, None]
        cosine = cosine + (np.cos(e)[None, :, None] * np.cos(s)[:, None, None]) * np.cos(a)
        light = np.zeros(parts.shape[1:])
        for part, phase, f in zip(parts, self.medium.phase_functions, self.scaled.forward_fraction, strict=True):
            light += np.moveaxis(phase(cosine), 0, -1) / (1.0 - f) * part
        return light


def read_phase(table: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """A phase function (..., W) from its table (N, W) at angles pi u^2, linear in its logarithm."""
    u = np.sqrt(np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi)
    nodes = np.linspace(0.0, 1.0, table.shape[0])
    return np.stack([np.exp(np.interp(u, nodes, np.log(column))) for column in table.T], axis=-1)
