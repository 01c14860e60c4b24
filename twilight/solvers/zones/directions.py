"""How many degrees, directions and harmonics the air's phase functions need: more beside coarse particles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.solvers.zones.settings import ZonesSettings
from twilight.transport.bundle import species_share
from twilight.transport.profile import Profile
from twilight.transport.scaling import ScaledMedium

EARLY_MOMENT, LATE_MOMENT = 0.03, 0.1
"""A phase moment of the air's mixture below the first needs no order in azimuth of its own in the first events, one
below the second no degree in the later ones."""
AROUND_STEP, LATE_STEP = (4, 2), (3, 1)
"""Directions and degrees grow by the first at once, where more than the second are missing: wavelengths whose needs are
nearly the same share them, and none moves its neighbours."""
MOST_IN_PEAK, DEGREE_STEP = 0.055, 4
"""Share of the scattering, anywhere in the air, that may count as not scattered because it goes into the forward peak;
the degree of the series grows by the second until it does."""
POLAR_MOMENT = 0.05
"""Where the degree grows, there are as many polar angles a side as phase moments exceed this: light scattered once
close to the sun is as narrow, and 14 angles made the zenith 10 % too bright at an asymmetry of 0.9, 32 % at 0.95."""
THICK_HAZE = 5.0
"""Vertical scattering optical depth beyond which it does not grow: light is nearly isotropic there, and polar angles
for low degrees let through 2 to 3 % less of it when they are given high ones."""
ALOFT_KM, ALOFT_DEPTH, ALOFT_MOMENT = 10.0, 0.04, 0.04
"""Where particles above the first scatter with more than the second, a volcano's, red light of deep twilight has gone
through ten events, each of which sees a line on the horizon: the later ones follow moments down to the third."""
SEEN = 0.01
"""Share of the largest scattering coefficient below which air does not count."""
THIN_KM, THIN_DEPTH, STANDS_OUT = 2.0, 0.1, 1.5
"""A layer between two sharp edges less than the first apart, with an optical depth of scattering of more than the
second and coefficients the third times those of the layers beside it, is a thin one.  One that stands on the ground is
not: nothing shines in from below, nor leaks along it."""
THIN_POLAR, THIN_MOMENT = 10, 6e-3
"""Polar angles a side in the later events where there is one, and what there stands for LATE_MOMENT."""
NEAREST, FARTHER = (3e-3, 0.5), 1.25
"""Steps end this share of a thin layer's thickness from its edges, and at shares that grow by that factor."""


def with_degree(settings: ZonesSettings, medium: Medium) -> ZonesSettings:
    """The settings with the degree of the Legendre series that this air needs, at least the one asked for.

    Light in the peak that delta scaling takes away goes on as it was.  Low over the horizon that is wrong: light passes
    many optical depths of haze there, and the peak moves some into it from the brighter sky within the peak's width.
    Of degree 20 the peak has 1 to 2 % of what continental and urban air scatters and 6 to 8 % beside dust and sea salt,
    where red light 1 deg above a sun on the horizon is then 6 % too dark; so there the degree grows up to
    settings.coarse_degree, and with it the polar angles of the first events.

    medium: as it is, before scaling
    """
    most = max(settings.degree, settings.coarse_degree)
    if most == settings.degree or not medium.has_aerosol:
        return settings
    beyond = np.stack([phase.legendre_moments(most + 1).T for phase in medium.phase_functions])
    of_aerosol = medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo
    scattering = medium.air_scattering_per_km + of_aerosol
    counts = (scattering > 0.0) & (scattering >= SEEN * scattering.max(axis=0))
    if np.trapezoid(scattering, medium.altitude_km, axis=0).max() > THICK_HAZE:
        return settings
    share = np.where(counts, of_aerosol / np.where(counts, scattering, 1.0), 0.0)

    def in_peak(degree: int) -> float:
        return float((share * np.einsum("klw,kw->lw", medium.aerosol_share, beyond[:, degree + 1])).max())

    degree = settings.degree
    while degree < most and in_peak(degree) > MOST_IN_PEAK:
        degree = min(degree + DEGREE_STEP, most)
    if degree == settings.degree:
        return settings
    taken = in_peak(degree)
    left = [(in_peak(lower - 1) - taken) / (1.0 - taken) for lower in range(degree + 1)]
    polar = _grown(settings.polar_directions, sum(moment > POLAR_MOMENT for moment in left), AROUND_STEP)
    return replace(settings, degree=degree, polar_directions=polar)


def needed(settings: ZonesSettings, scaled: ScaledMedium, profile: Profile) -> ZonesSettings:
    """The settings with the directions and harmonics that this air needs, which are at least those asked for.

    The harmonics of order m in azimuth that scattering sends towards the horizon have the size of its phase moment of
    degree m, and equal azimuths tell fewer orders apart than there are of them.  So there are as many in the first
    events as moments of the mixture of air and particles anywhere exceed EARLY_MOMENT: 11 do for the molecules and the
    fine particles of continental and urban air; dust and sea salt, whose moments fall slowly, need about 17 or light up
    to 15 deg above the horizon is 1 to 2 % off below a low sun.  The later events, taken with fewer harmonics, follow
    moments down to LATE_MOMENT, for light that dust sends forward several times is 1 to 3 % of the red of deep
    twilight, and down to ALOFT_MOMENT under a volcano's layer; they take as many polar angles a side and azimuths as
    that degree.  Beside a thin layer they take THIN_POLAR polar angles at least: four below the horizon saw such a
    layer from above 6 % too bright.  They follow moments down to THIN_MOMENT there, since light that comes along the
    layer is no smooth one: what of it turns into the zenith is 22 % too little with degree 6 at an asymmetry of 0.7.

    scaled: the air and its phase moments; profile: of the scaled air
    """
    z = profile.altitude_km
    scattering = profile.species_scattering.sum(axis=0)
    counts = scattering >= SEEN * scattering.max(axis=0)
    share = np.where(counts, species_share(scaled.medium, z), 0.0)
    moments = np.einsum("kzw,klw->lzw", share, scaled.moments).max(axis=(1, 2))
    degrees = moments.size
    around = min(_grown(settings.azimuth_directions, int(np.sum(moments > EARLY_MOMENT)), AROUND_STEP), degrees)
    thin = thin_layers(profile)[0].size > 0
    aloft = np.where(z[:, None] >= ALOFT_KM, profile.species_scattering[1:].sum(axis=0), 0.0)
    layered = np.trapezoid(aloft, z, axis=0).max() > ALOFT_DEPTH
    least = THIN_MOMENT if thin else ALOFT_MOMENT if layered else LATE_MOMENT
    late = min(_grown(settings.late_degree, int(np.sum(moments > least)), LATE_STEP), settings.degree)
    out = replace(settings, azimuth_directions=max(settings.azimuth_directions, around))
    if late > settings.late_degree:
        out = replace(
            out,
            late_degree=late,
            late_polar_directions=max(settings.late_polar_directions, late),
            late_azimuth_directions=min(out.azimuth_directions, max(settings.late_azimuth_directions, late)),
        )
    if thin:
        out = replace(out, late_polar_directions=max(out.late_polar_directions, THIN_POLAR))
    return out


def near_edges(profile: Profile, of: Profile) -> Profile:
    """The same air, in which steps along rays end close to the edges of thin layers.

    A sun one degree above the layer's horizon lights its outermost fiftieth of an optical depth, less than a step is
    long, and all the light that leaks along the layer comes from there: with the usual steps the zenith is 5 % too
    dark.

    of: the air whose thin layers count
    """
    share = np.geomspace(*NEAREST, 1 + round(np.log(NEAREST[1] / NEAREST[0]) / np.log(FARTHER)))
    stops = [np.append(base + share * (top - base), top - share * (top - base)) for base, top in thin_layers(of)[0]]
    return profile._replace(stop_km=np.unique(np.concatenate([profile.stop_km, *stops]))) if stops else profile


def thin_layers(profile: Profile) -> tuple[np.ndarray, np.ndarray]:
    """Bases and tops [km] (N, 2) and largest optical depths of scattering (N,) of the thin layers.

    profile: of the scaled air
    """
    z, per_km = profile.altitude_km, profile.scattering
    through = np.insert(np.cumsum(0.5 * np.diff(z)[:, None] * (per_km[1:] + per_km[:-1]), axis=0), 0, 0.0, axis=0)
    edges = np.concatenate([z[:1], profile.sharp_km, z[-1:]])
    width = np.diff(edges)
    depth = np.diff([np.interp(edges, z, column) for column in through.T], axis=1)
    mean = np.pad(depth / width, ((0, 0), (1, 1)))
    stands_out = mean[:, 1:-1] > STANDS_OUT * np.maximum(mean[:, :-2], mean[:, 2:])
    thin = np.any((width < THIN_KM) & (depth > THIN_DEPTH) & stands_out & (edges[:-1] > z[0]), axis=0)
    return np.stack([edges[:-1], edges[1:]], axis=-1)[thin], depth.max(axis=0)[thin]


def _grown(least: int, wanted: int, step: tuple[int, int]) -> int:
    """The least, and so many steps more that no more than the second of `step` are missing."""
    return least + step[0] * max(0, -(-(wanted - step[1] - least) // step[0]))
