"""What the air asks of the grids of a field: degrees, directions, harmonics and altitudes.

More beside coarse particles, below a volcano's layer, at rims of haze and in thin layers.

Node altitudes are graded from the ground, with one at every jump, closer where air is layered or thick.  All tuned
numbers are in `constants`.
"""

import math
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.conventions import DARK
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones.settings import ZonesSettings
from twilight.transport.lines import species_fraction
from twilight.transport.profile import Profile
from twilight.transport.scaling import ScaledMedium


class FractionalTruncation(NamedTuple):
    """Numbers of terms of the series that describe light and its scattering, which follow the air without steps.

    A series truncated at 20.3 has the terms up to 20 as they are, and the next one with the weight 0.3.  So one more
    term comes in with a weight that grows from 0: were it there all at once, the air in which it is and the air in
    which it just is not would have skies up to 3 % apart.

    azimuthal_orders, late_azimuthal_orders: numbers of them in the early and the later orders of scattering
    late_degree: of the later orders of scattering
    """

    azimuthal_orders: float
    late_degree: float
    late_azimuthal_orders: float


def taper(terms: np.ndarray, number: float) -> np.ndarray:
    """Weights of terms, counted from 0, in a series truncated to a number of them that may have a fraction."""
    return np.clip(number - terms, 0.0, 1.0)


def degree_needed(settings: ZonesSettings, medium: Medium) -> float:
    """The degree of the Legendre series that this air needs, at least settings.degree; a fraction as of `delta_scaled`.

    Light in the peak that delta scaling takes away goes on as it was.  Low over the horizon that is wrong: light passes
    many optical depths of haze there, and the peak moves some into it from the brighter sky within the peak's width.
    Of degree 20 the peak has 1 to 2 % of what continental and urban air scatters and 6 to 8 % beside dust and sea salt,
    where red light 1 deg above a sun on the horizon is then 6 % too dark; so there the degree grows up to
    settings.max_degree.  Below a volcano's layer it is ALOFT_DEGREE at least.

    medium: as it is, before scaling
    """
    most = max(settings.degree, settings.max_degree)
    if most == settings.degree or not medium.has_aerosol:
        return settings.degree
    layered = _volcanic_fraction(medium.altitude_km, _scattered_by_aerosol(medium))
    least = settings.degree + layered * max(0, min(tuned.ALOFT_DEGREE, most) - settings.degree)
    scattering = medium.air_scattering_per_km + _scattered_by_aerosol(medium)
    grows = _haze_fraction(medium.altitude_km, scattering)
    peak = _peak_fractions(medium, most)[settings.degree :]
    large = np.flatnonzero(peak > tuned.MAX_PEAK_FRACTION)
    if not grows or not large.size:
        return least
    last = int(large[-1])
    enough = float(last)
    if last + 1 < peak.size:
        enough += float((peak[last] - tuned.MAX_PEAK_FRACTION) / (peak[last] - peak[last + 1]))
    return max(least, settings.degree + float(grows) * enough)


def with_degree(settings: ZonesSettings, medium: Medium) -> ZonesSettings:
    """The settings with the degree that this air needs (`degree_needed`), the polar angles of the early orders that go
    with it, the nodes in altitude that a volcano's layer needs, and the solar zenith angles that a sharp peak needs:
    what it sends 15 deg from the sun turns with the sun faster than cubics between nodes for other air follow.

    medium: as it is, before scaling
    """
    if medium.has_aerosol:
        density = settings.altitude_density
        volcanic = _volcanic_fraction(medium.altitude_km, _scattered_by_aerosol(medium))
        grown = density * (1.0 + (tuned.ALOFT_DENSITY - 1.0) * volcanic)
        settings = replace(settings, altitude_density=max(density, min(grown, 1.0)))
    needed = degree_needed(settings, medium)
    degree = math.ceil(needed)
    if degree == settings.degree:
        return settings
    peak = _peak_fractions(medium, degree)
    removed = float(peak[degree])
    least_peak, peak_of_all = tuned.PEAKED_FRACTIONS
    beyond = float(np.interp(needed, np.arange(degree + 1), peak))  # of a fraction of a degree too: without a step
    sharp = float(np.clip((beyond - least_peak) / (peak_of_all - least_peak), 0.0, 1.0))
    zeniths = settings.zenith_density * (1.0 + (tuned.PEAKED_ZENITHS - 1.0) * sharp)
    left = np.append(1.0, (peak[:degree] - removed) / (1.0 - removed))
    least = settings.polar_directions
    grown = least + tuned.POLAR_GROWTH * max(0.0, _exceeding(left, tuned.POLAR_MOMENT) - least)
    polar = max(least, math.ceil(min(grown, _exceeding(left, tuned.LEAST_POLAR_MOMENT))))
    return replace(settings, degree=degree, polar_directions=polar, zenith_density=zeniths)


def _scattered_by_aerosol(medium: Medium) -> np.ndarray:
    return medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo


def _peak_fractions(medium: Medium, highest: int) -> np.ndarray:
    """Largest fraction of the scattering, anywhere in the air, in the peak beyond each degree from 0 to highest."""
    beyond = np.stack([phase.legendre_moments(highest + 1).T for phase in medium.phase_functions])
    of_aerosol = _scattered_by_aerosol(medium)
    scattering = medium.air_scattering_per_km + of_aerosol
    counts = (scattering > 0.0) & (scattering >= tuned.NEGLIGIBLE_FRACTION * scattering.max(axis=0))
    fraction = np.where(counts, of_aerosol / np.where(counts, scattering, 1.0), 0.0)
    return np.array(
        [
            (fraction * np.einsum("klw,kw->lw", medium.aerosol_phase_fraction, beyond[:, degree + 1])).max()
            for degree in range(highest + 1)
        ]
    )


def truncation_needed(settings: ZonesSettings, scaled: ScaledMedium, profile: Profile) -> FractionalTruncation:
    """How many azimuthal orders and what late degree this air needs, at least those asked for.

    Azimuthal order m of what is scattered towards the horizon has the size of phase moment m, and equal azimuths tell
    fewer orders apart than there are of them.  So the early orders of scattering have as many azimuths as moments of
    the mixture, anywhere in the air, exceed EARLY_MOMENT: 11 do for molecules and fine particles; dust and sea salt,
    whose moments fall slowly, need about 17, or light up to 15 deg above the horizon is 1 to 2 % off below a low sun.

    The later orders of scattering follow moments down to LATE_MOMENT (light that dust sends forward several times is 1
    to 3 % of the red of deep twilight), ALOFT_MOMENT below a volcano's layer, THIN_MOMENT beside a thin layer, along
    which light comes sharply.

    scaled: the air and its phase moments; profile: of the scaled air
    """
    z = profile.altitude_km
    scattering = profile.species_scattering.sum(axis=0)
    counts = scattering >= tuned.NEGLIGIBLE_FRACTION * scattering.max(axis=0)
    fraction = np.where(counts, species_fraction(profile, z), 0.0)
    moments = np.einsum("kzw,klw->lzw", fraction, scaled.moments).max(axis=(1, 2))
    orders = _grown(settings.azimuth_directions, _exceeding(moments, tuned.EARLY_MOMENT), tuned.AZIMUTH_SLACK)
    orders = max(settings.azimuth_directions, min(orders, moments.size))
    layered = _volcanic_fraction(z, profile.species_scattering[1:].sum(axis=0))
    thin = bool(np.any(thin_layers(profile)[0][:, 0] >= tuned.LEAK_KM))
    least = tuned.THIN_MOMENT if thin else tuned.LATE_MOMENT ** (1.0 - layered) * tuned.ALOFT_MOMENT**layered
    wanted = _grown(settings.late_degree, _exceeding(moments, least), tuned.LATE_SLACK) - settings.late_degree
    grows = max(_haze_fraction(z, profile.species_scattering.sum(axis=0)), layered, float(thin))
    late = min(settings.late_degree + grows * wanted, settings.degree)
    if late <= settings.late_degree:
        return FractionalTruncation(orders, settings.late_degree, settings.late_azimuth_directions)
    return FractionalTruncation(orders, late, max(settings.late_azimuth_directions, min(orders, late)))


def _volcanic_fraction(altitude_km: np.ndarray, scattering_per_km: np.ndarray) -> float:
    """0 where the particles above ALOFT_KM do not count as a volcano's, 1 where they do; scattering_per_km (N, W)."""
    aloft = np.where(altitude_km[:, None] >= tuned.ALOFT_KM, scattering_per_km, 0.0)
    # what reaches up from below is no layer of its own
    haze = [tuned.ALOFT_TAIL_KM * np.interp(tuned.ALOFT_KM, altitude_km, column) for column in scattering_per_km.T]
    depth = (np.trapezoid(aloft, altitude_km, axis=0) - haze).max()
    return float(np.clip((depth - tuned.LEAST_ALOFT_DEPTH) / (tuned.ALOFT_DEPTH - tuned.LEAST_ALOFT_DEPTH), 0.0, 1.0))


def _haze_fraction(altitude_km: np.ndarray, scattering_per_km: np.ndarray) -> float:
    """1 where all wavelengths of scattering_per_km (N, W) have depths below HAZE_DEPTH, 0 above THICK_HAZE_DEPTH."""
    depth = np.trapezoid(scattering_per_km, altitude_km, axis=0).max()
    return float(np.clip((tuned.THICK_HAZE_DEPTH - depth) / (tuned.THICK_HAZE_DEPTH - tuned.HAZE_DEPTH), 0.0, 1.0))


def reduced_depth(scaled: ScaledMedium, profile: Profile) -> np.ndarray:
    """Vertical optical depth of scattering (W,), that of each species times 1 - g; profile: of the scaled air."""
    reduced = profile.species_scattering * (1.0 - scaled.moments[:, 1])[:, None]
    return np.trapezoid(reduced.sum(axis=0), profile.altitude_km, axis=0)


def directions_needed(settings: ZonesSettings, scaled: ScaledMedium, profile: Profile) -> ZonesSettings:
    """The settings with the directions and harmonics that the `truncation_needed` in the same air asks for.

    The later orders have at least as many polar angles a side as their degree; beside a thin layer THIN_POLAR, in thick
    air DECK_POLAR.
    """
    series = truncation_needed(settings, scaled, profile)
    late = math.ceil(series.late_degree)
    polar = max(settings.late_polar_directions, late)
    if thin_layers(profile)[0].size:
        polar = max(polar, tuned.THIN_POLAR)
    if tuned.DECK_DEPTH < reduced_depth(scaled, profile).max() <= tuned.SLOW_DEPTH:
        polar = max(polar, tuned.DECK_POLAR)
    more = tuned.RIM_POLAR if rims_km(profile, settings.altitude_density).size else 0
    return replace(
        settings,
        polar_directions=settings.polar_directions + more,
        azimuth_directions=math.ceil(series.azimuthal_orders),
        late_degree=late,
        late_polar_directions=polar,
        late_azimuth_directions=math.ceil(series.late_azimuthal_orders),
    )


def near_edges(profile: Profile, of: Profile) -> Profile:
    """The same air, in which steps along rays end close to the edges of thin layers.

    A sun one degree above the layer's horizon lights its outermost fiftieth of an optical depth, less than a step is
    long, and all the light that leaks along the layer comes from there: with the usual steps the zenith is 5 % too
    dark.

    of: the air whose thin layers count
    """
    stops = []
    for base, top in thin_layers(of)[0]:
        growth = tuned.EDGE_GROWTH if base >= tuned.LEAK_KM else tuned.LOW_EDGE_GROWTH
        fraction = np.geomspace(tuned.EDGE_FRACTION, 0.5, 1 + round(np.log(0.5 / tuned.EDGE_FRACTION) / np.log(growth)))
        stops.append(np.append(base + fraction * (top - base), top - fraction * (top - base)))
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
    stands_out = mean[:, 1:-1] > tuned.THIN_CONTRAST * np.maximum(mean[:, :-2], mean[:, 2:])
    thin = np.any((width < tuned.THIN_KM) & (depth > tuned.THIN_DEPTH) & stands_out & (edges[:-1] > z[0]), axis=0)
    return np.stack([edges[:-1], edges[1:]], axis=-1)[thin], depth.max(axis=0)[thin]


def rims_km(profile: Profile, altitude_density: float) -> np.ndarray:
    """Altitudes [km] (R,) of the rims of haze: high tops of it, where seen from above the glow of twilight ends.

    Over dust the light of deep twilight jumps there by a factor of 2 to 30.

    profile: of the scaled air; altitude_density: of the settings, none below RIM_DENSITY
    """
    if altitude_density < tuned.RIM_DENSITY:
        return np.empty(0)
    z, edges = profile.altitude_km, profile.sharp_km
    below, above = (
        np.array([np.interp(edges + d, z, c) for c in profile.extinction.T])
        for d in (-tuned.BESIDE_KM, tuned.BESIDE_KM)
    )
    return edges[(edges >= tuned.RIM_KM) & np.any(below - above > tuned.RIM_DROP_PER_KM, axis=0)]


def _exceeding(moments: np.ndarray, least: float) -> float:
    """How many moments (L,) there are before they fall below `least` for good, with the fraction of the way on which
    they do."""
    # a later moment may be larger than one before
    falling = np.append(np.maximum.accumulate(moments[::-1])[::-1], 0.0)
    n = int(np.sum(falling > least))
    return 0.0 if n == 0 else n - 1 + float((falling[n - 1] - least) / (falling[n - 1] - falling[n]))


def _grown(least: int, wanted: float, slack: int) -> float:
    """What is wanted, but no more than least where at most slack are missing; twice as steep from there on."""
    return max(least, min(least + 2.0 * (wanted - slack - least), wanted))


def altitude_nodes(
    bottom_km: float, top_km: float, jumps_km: np.ndarray, density: float, rims_km: np.ndarray | None = None
) -> np.ndarray:
    """Altitudes [km] with spacing (LOWEST_STEP_KM + STEP_GROWTH x height)/density, closer above rims of haze, and one
    at every jump."""
    edges = [bottom_km, *jumps_km, top_km]
    out = [bottom_km]
    for a, b in pairwise(edges):
        rough = [a]
        near = tuned.RIM_STEP_KM if rims_km is not None and np.any(rims_km <= a) else np.inf
        while rough[-1] < b:
            z = rough[-1]
            rough.append(z + min(tuned.LOWEST_STEP_KM + tuned.STEP_GROWTH * (z - bottom_km), near + z - a) / density)
        # the same grading, stretched to end at b
        out.extend(a + (np.array(rough[1:-1]) - a) * (b - a) / (rough[-1] - a))
        out.append(b)  # to the last digit: `cubic_refinement` finds it by its value
    return np.array(out)


def resolve_layers(altitude_km: np.ndarray, profile: Profile, density: float) -> np.ndarray:
    """The altitudes [km] and more where the air is layered more finely than they are apart."""
    levels = profile.altitude_km

    def extinction(z: np.ndarray) -> np.ndarray:
        return np.array([np.interp(z, levels, column) for column in profile.extinction.T])

    step = np.diff(levels)[:, None]
    through = np.insert(
        np.cumsum(0.5 * step * (profile.extinction[1:] + profile.extinction[:-1]), axis=0), 0, 0, axis=0
    )
    before = out = np.asarray(altitude_km, dtype=float)
    for _ in range(tuned.MAX_HALVINGS):
        step = np.diff(out)
        middle = out[:-1] + 0.5 * step
        # just inside the ends, which may be jumps
        nudge = np.minimum(1e-6, 1e-3 * step)
        low, mid, high = (np.maximum(extinction(z), DARK) for z in (out[:-1] + nudge, middle, out[1:] - nudge))
        depth = step * (low + 4.0 * mid + high) / 6.0
        bend = np.abs(np.log(mid / np.sqrt(low * high)))
        above = np.array([np.interp(middle, levels, column[-1] - column) for column in through.T])
        deep = np.maximum(0.0, np.minimum(above, through[-1][:, None] - above) - tuned.EDGE_DEPTH)
        widest = (
            tuned.MAX_INTERVAL_DEPTH * np.minimum(1.0 + tuned.DEPTH_GROWTH * deep, tuned.MAX_DEPTH_GROWTH) / density
        )
        coarse = (depth > widest) | (
            (bend > tuned.MAX_LOG_EXTINCTION_BEND / density**2) & (depth > tuned.STRAIGHT_DEPTH / density)
        )
        if not coarse.any(axis=0).any():
            break
        out = np.sort(np.append(out, middle[coarse.any(axis=0)]))
    whole = np.diff(before)[np.searchsorted(before, out[:-1], side="right") - 1]
    return _graded(out) if np.any(np.diff(out) < tuned.LAYERED_FRACTION * whole) else out


def _graded(altitude_km: np.ndarray) -> np.ndarray:
    """The altitudes [km] and more, so that intervals beside each other differ by no more than MAX_INTERVAL_RATIO.

    A wide interval is cut near its narrow neighbour, so that what is left of it is not much narrower than the next one:
    cut in halves, each would have the next one cut, and so on up to the top of the air.
    """
    out, ratio = altitude_km, tuned.MAX_INTERVAL_RATIO
    while True:
        step = np.diff(out)
        below, above = np.append(np.inf, step[:-1]), np.append(step[1:], np.inf)
        beside = np.minimum(below, above)
        coarse = step > ratio * beside
        if not coarse.any():
            return out
        piece = np.minimum(ratio * beside, step / (1.0 + ratio))
        cut = np.where(below <= above, out[:-1] + piece, out[1:] - piece)
        out = np.sort(np.append(out, cut[coarse]))
