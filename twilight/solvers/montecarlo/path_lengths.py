"""Path lengths in each layer of air: of chords, of legs, and of the refracted sunbeam.

Absorption that is added evenly to a layer, k [km^-1], lets exp(-k l) of the light pass whose path is l [km] long in
that layer, whatever the rest of the path: so d ln(light of a path) / dk = -l, exactly, for every path by itself.

Arguments that kernels share: `kernel`.  Here also layers: `BoxLayers`; edges (J + 1,): altitudes [km] that bound J
layers, ascending; lengths (J,) [km]: added to; factor: that lengths count with; profile:
`transport.ray_profile.RayProfile`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.jit.kernels import njit
from twilight.solvers.montecarlo.kernel import INNER
from twilight.solvers.montecarlo.rays import DIRECTION, ORIGIN, radius_and_cosine
from twilight.transport.beam import beam_at_one
from twilight.transport.ray_profile import RayProfile, refractivity_at
from twilight.transport.rays import FAR_KM, GROUND, lowest_point, outward, sun_ray

CLOSE_RAD = 1e-6
"""Distance [rad] from the true sun's direction at which the ray of the sunbeam is found."""
STEPS = 6
"""Most steps of that search."""


class BoxLayers(NamedTuple):
    """J layers between edges_km (J + 1,) [km], ascending, and the air in which sunbeams through them are followed."""

    edges_km: np.ndarray
    profile: RayProfile


@njit(inner=True, **INNER)
def add_one_side(edges, radius, square, near, far, factor, lengths):
    """Add the part of a line between two distances `near` < `far` [km] from its lowest point, on one side of it.

    radius [km]: of the Earth; square [km^2]: of the lowest point's distance from the Earth's centre.
    """
    low = math.sqrt(square + near * near) - radius
    high = math.sqrt(square + far * far) - radius
    begin = near
    for j in range(lengths.size):
        top = edges[j + 1]
        if top <= low:
            continue
        if edges[j] >= high:
            break
        if edges[j] > low:
            begin = max(near, math.sqrt(max(0.0, (radius + edges[j]) ** 2 - square)))
        end = far
        if top < high:
            end = min(far, math.sqrt(max(0.0, (radius + top) ** 2 - square)))
        lengths[j] += factor * max(0.0, end - begin)
        begin = end


@njit(inner=True, **INNER)
def add_chord(edges, radius, chord, start, end, factor, lengths):
    """Add the part from `start` to `end` [km] of a chord (9,); radius [km]: of the Earth."""
    r, mu = radius_and_cosine(chord)
    lowest = -r * mu
    square = r * r * (1.0 - mu) * (1.0 + mu)
    if start < lowest:
        add_one_side(edges, radius, square, max(0.0, lowest - end), lowest - start, factor, lengths)
    if end > lowest:
        add_one_side(edges, radius, square, max(0.0, start - lowest), end - lowest, factor, lengths)


@njit(inner=True, **INNER)
def add_leg(edges, radius, chords, number, s, factor, lengths):
    """Add a leg from its start to the distance s [km] of its chord `number`; chords (K, 9); radius [km]: Earth's."""
    for c in range(number):
        square = 0.0
        for m in range(3):
            square += (chords[c + 1, ORIGIN + m] - chords[c, ORIGIN + m]) ** 2
        add_chord(edges, radius, chords[c], 0.0, math.sqrt(square), factor, lengths)
    add_chord(edges, radius, chords[number], 0.0, s, factor, lengths)


@njit(inner=True, **INNER)
def place_on_leg(chords, last_chord, point, heading):
    """(number of the chord, distance [km] along it) of a point (3,) of a leg where it has the direction heading (3,).

    chords (K, 9), of which the leg has those up to `last_chord`; the direction is a copy of the chord's.
    """
    number = last_chord
    for c in range(last_chord):
        row = chords[c]
        if row[DIRECTION] == heading[0] and row[DIRECTION + 1] == heading[1] and row[DIRECTION + 2] == heading[2]:
            number = c
            break
    s = 0.0
    for m in range(3):
        s += (point[m] - chords[number, ORIGIN + m]) * heading[m]
    return number, max(0.0, s)


@njit(inner=True, cache=True)
def add_ray(profile, w, altitude_km, u_km, stop_km, edges, factor, lengths):
    """Add the refracted ray that goes up from `altitude_km` to `stop_km`.

    altitude_km, stop_km, u_km [km]: as of `transport.rays.outward`.
    """
    for j in range(edges.size):
        end = min(stop_km, edges[j])
        if end <= altitude_km:
            continue
        path = outward(profile, w, altitude_km, u_km, end)
        if j > 0:
            lengths[j - 1] += factor * path.length_km
        if not path.free or end >= stop_km:
            break
        altitude_km, u_km = end, path.u_km


@njit(cache=True)
def add_sunbeam(layers, beam, w, z, mu_sun, factor, lengths):
    """Add the path of the sunbeam to a point in sunlight, along its refracted ray at the wavelength w.

    z [km]: altitude of the point; mu_sun: cosine of the true sun's zenith angle there.  The apparent zenith angle i
    solves i + bending(i) = true angle, by the secant rule from the bending of the beam's tables.
    """
    edges, profile = layers.edges_km, layers.profile
    chi = math.acos(min(1.0, max(-1.0, mu_sun)))
    _, bending = beam_at_one(beam, z, mu_sun, w)
    x = (profile.radius_km + z) * (1.0 + refractivity_at(profile, w, z))
    apparent = chi - bending
    before, missed_before = 0.0, 0.0
    if bending > 0.0:
        for step in range(STEPS):
            turned, _, _ = sun_ray(profile, w, z, x * math.cos(apparent), True)
            missed = apparent + turned - chi
            if abs(missed) < CLOSE_RAD:
                break
            slope = 1.0
            if step > 0 and apparent != before:
                slope = max(0.05, (missed - missed_before) / (apparent - before))
            before, missed_before = apparent, missed
            apparent -= missed / slope
    u = x * math.cos(apparent)
    if u >= 0.0:
        add_ray(profile, w, z, u, FAR_KM, edges, factor, lengths)
        return
    lowest, status = lowest_point(profile, w, z, -u, False)
    if status == GROUND:
        lowest = profile.bottom_km[1]
    add_ray(profile, w, lowest, 0.0, z, edges, factor, lengths)
    add_ray(profile, w, lowest, 0.0, FAR_KM, edges, factor, lengths)
