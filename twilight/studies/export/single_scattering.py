"""Single scattering along very many lines of sight: the sunbeam is looked up in a table of E/F0.

The texels of foreign layouts are a million directions whose points lie at altitudes and under suns of their own.  A
look-up of :mod:`twilight.transport.beam`, right to parts in a thousand, costs ten times what a table of E/F0 costs that
is linear between nodes so close together.  Its suns begin at the edge of the Earth's shadow of each altitude, which no
interpolation crosses.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.transport.beam import Beam, beam_at, lit_at
from twilight.transport.lines import ALTITUDE, DISTANCE, new_line, trace_line, weight_by_species
from twilight.transport.profile import Profile, prepare_profile
from twilight.transport.scaling import ScaledMedium, species_phase

ALTITUDES = 385
"""Altitudes of the table of sunlight, even in the root of the height above the ground."""
COSINES = 769
"""Suns of the table of sunlight, from the edge of the shadow to the zenith, even in the root of the cosine's rise."""


class SunlightTable(NamedTuple):
    """E/F0 of the direct beam, light (Z, C, W), at heights (top - bottom) (i / (Z - 1))^2 above bottom_km and under
    suns of the cosine edge + (1 - edge) (k / (C - 1))^2, edge (Z,)."""

    bottom_km: float
    top_km: float
    edge: np.ndarray
    light: np.ndarray


@njit(cache=True, nogil=True)
def _fill(beam, table, begin, end):
    """Nodes begin..end of the altitudes of `table`, a `SunlightTable`, from `beam`."""
    n_z, n_c, n_w = table.light.shape
    out = np.empty(n_w)
    for i in range(begin, end):
        z = table.bottom_km + (table.top_km - table.bottom_km) * (i / (n_z - 1)) ** 2
        dark, lit = -1.0, 1.0
        for _ in range(40):
            middle = 0.5 * (dark + lit)
            if lit_at(beam, z, middle):
                lit = middle
            else:
                dark = middle
        table.edge[i] = lit
        for k in range(n_c):
            beam_at(beam, z, min(1.0, lit + (1.0 - lit) * (k / (n_c - 1)) ** 2), out)
            table.light[i, k] = out


@njit(cache=True, nogil=True)
def _sums(profile, table, altitude_km, elevation, azimuth, sun, out, begin, end):
    """Light that species scattered once, without phase functions, out (1 + K, S, E, A, W), for rows begin..end.

    profile: `Profile`; table: `SunlightTable`; altitude_km: the observer's; elevation (E,), azimuth (S, E, A), sun (S,)
    [rad].  Equal azimuths that follow each other are summed once.
    """
    bottom, top, edge, light = table
    n_z, n_c, n_w = light.shape
    n_k = out.shape[0]
    line = new_line(profile)
    room = line.place.shape[0]
    source = np.empty((room, n_k, n_w))
    node, part, least, per_rise = np.empty(room, np.int64), np.empty(room), np.empty(room), np.empty(room)
    sums = np.empty((n_k, n_w))
    r = profile.earth_radius_km + altitude_km
    for e in range(begin, end):
        mu = math.sin(elevation[e])
        n, _ = trace_line(profile, altitude_km, mu, 1.0, np.bool_(True), line, math.inf)
        for p in range(n):
            z = line.place[p, ALTITUDE]
            weight_by_species(profile, z, line.weight[p], source[p])
            position = math.sqrt(min(1.0, max(0.0, (z - bottom) / (top - bottom)))) * (n_z - 1)
            i = min(n_z - 2, int(position))
            node[p], part[p] = i, position - i
            least[p] = edge[i] + (position - i) * (edge[i + 1] - edge[i])
            per_rise[p] = 1.0 / (1.0 - least[p])
        for s in range(sun.size):
            mu_s = math.sin(sun[s])
            for a in range(azimuth.shape[2]):
                if a == 0 or azimuth[s, e, a] != azimuth[s, e, a - 1]:
                    nu = mu * mu_s + math.cos(elevation[e]) * math.cos(sun[s]) * math.cos(azimuth[s, e, a])
                    sums[:] = 0.0
                    for p in range(n):
                        there = r * mu_s + line.place[p, DISTANCE] * nu
                        there /= profile.earth_radius_km + line.place[p, ALTITUDE]
                        rise = (there - least[p]) * per_rise[p]
                        if rise < 0.0:
                            continue
                        position = math.sqrt(min(1.0, rise)) * (n_c - 1)
                        c = min(n_c - 2, int(position))
                        right, up, i = position - c, part[p], node[p]
                        w00, w01 = (1.0 - up) * (1.0 - right), (1.0 - up) * right
                        w10, w11 = up * (1.0 - right), up * right
                        for w in range(n_w):
                            lit = w00 * light[i, c, w] + w01 * light[i, c + 1, w]
                            lit += w10 * light[i + 1, c, w] + w11 * light[i + 1, c + 1, w]
                            for k in range(n_k):
                                sums[k, w] += source[p, k, w] * lit
                for k in range(n_k):
                    for w in range(n_w):
                        out[k, s, e, a, w] = sums[k, w]


class SinglyScattered(NamedTuple):
    """air, bare (S, E, A, W): what air, and what all aerosol scattered once, without phase functions.

    aerosol, total (S, E, A, W): what aerosol, and what all species scattered once [sr^-1].
    """

    air: np.ndarray
    bare: np.ndarray
    aerosol: np.ndarray
    total: np.ndarray


class SingleScattering:
    """Single scattering in one medium, for whole grids of directions and suns."""

    def __init__(self, medium: Medium, scaled: ScaledMedium, beam: Beam):
        """medium: before scaling, for its phase functions; beam: of the scaled medium"""
        self.medium, self.scaled = medium, scaled
        self.profile: Profile = prepare_profile(scaled.medium)
        light = np.zeros((ALTITUDES, COSINES, medium.n_wavelengths), np.float32)
        self.sunlight = SunlightTable(medium.bottom_km, medium.top_km, np.zeros(ALTITUDES), light)
        in_slices(lambda begin, end: _fill(beam, self.sunlight, begin, end), ALTITUDES)

    def __call__(
        self, altitude_km: float, elevation: np.ndarray, azimuth: np.ndarray, sun: np.ndarray
    ) -> SinglyScattered:
        """Light seen from an altitude in directions of elevations (E,) and azimuths (S, E, A), suns (S,) [rad]."""
        n_k = self.scaled.moments.shape[0]
        parts = np.zeros((n_k, *azimuth.shape, self.medium.n_wavelengths))
        in_slices(
            lambda i, j: _sums(self.profile, self.sunlight, altitude_km, elevation, azimuth, sun, parts, i, j),
            elevation.size,
        )
        s, e = sun[:, None, None], elevation[None, :, None]
        cosine = np.sin(e) * np.sin(s) + np.cos(e) * np.cos(s) * np.cos(azimuth)
        phase = species_phase(self.medium, self.scaled.forward_fraction, cosine.ravel())
        phase = phase.reshape(*cosine.shape, n_k, -1)
        aerosol = sum((phase[..., k, :] * parts[k] for k in range(1, n_k)), np.zeros(parts.shape[1:]))
        return SinglyScattered(parts[0], parts[1:].sum(axis=0), aerosol, aerosol + phase[..., 0, :] * parts[0])
