"""The sun's direct light: the beam at an observer, and the disc, whose every part is refracted by itself."""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.bands import GasBands
from twilight.atmosphere.medium import Medium
from twilight.atmosphere.screen import Screen
from twilight.sky.disc import SOLAR_RADIUS_DEG, Disc
from twilight.sky.lights import Luminary
from twilight.transport.beam import Beam, beam_at, prepare_beam
from twilight.transport.ground_sun import GroundSun
from twilight.transport.ray_profile import passing_at, ray_profile, refractivity_at
from twilight.transport.rays import ApparentRays

DISC_STRIPS = 12
"""Horizontal strips of the sun's disc."""
ROW_DEG = 1.0 / 1200.0
"""Distance of the rows of a disc: 3 arc seconds, a tenth of what the eye resolves."""
_SEARCH_DEG = 0.01
"""Distance of the elevations among which the disc's upper and lower edge are sought [deg]."""
_LIFTED_DEG = 5.0
"""Largest refraction of the sun that is looked for [deg]: no air of a climate lifts the sun by more."""


class Direct(NamedTuple):
    """Irradiance of the beam at normal incidence over F0 (W,), 0 in the shadow, and how far it is bent [deg]."""

    irradiance: np.ndarray
    bending_deg: float


def join_direct(parts: Sequence[Direct]) -> Direct:
    """The direct light at all wavelengths from that of each block."""
    return Direct(np.concatenate([one.irradiance for one in parts]), parts[-1].bending_deg)


class Sunbeam:
    """Direct sunlight in a medium; its tables are made for the first sun that can reach an observer.

    numpy_only: sunlight on the ground is found by quadrature in numpy, without tables and without compiled code.
    """

    DARK_BELOW_HORIZON_DEG = 2.0
    """Depth of the sun below the horizon beyond which no direct light arrives: refraction lifts the sun by 1.2 deg at
    most, down and up again (Haber 2005 sec. 4.4: below 2)."""

    def __init__(self, medium: Medium, numpy_only: bool = False):
        self.medium, self._numpy_only = medium, numpy_only

    def at(self, sun_elevation_deg: float, altitude_km: float) -> Direct:
        """The direct light of a sun at true elevation, for an observer at an altitude."""
        ground_km = self.medium.bottom_km
        out = np.zeros(self.medium.n_wavelengths)
        if not self.reaches(sun_elevation_deg, altitude_km):
            return Direct(out, 0.0)
        if self._numpy_only and altitude_km <= ground_km:
            return Direct(*self._ground.at(sun_elevation_deg))
        bending = beam_at(self.beam, float(altitude_km), np.sin(np.radians(sun_elevation_deg)), out)
        return Direct(out, float(np.degrees(bending)) if out.any() else 0.0)

    def reaches(self, sun_elevation_deg: float, altitude_km: float) -> bool:
        """Whether the sun may reach an observer at an altitude; False only where no refraction lifts it that far."""
        radius, ground_km = self.medium.earth_radius_km, self.medium.bottom_km
        dip_deg = float(np.degrees(np.arccos((radius + ground_km) / (radius + max(altitude_km, ground_km)))))
        return sun_elevation_deg >= -dip_deg - self.DARK_BELOW_HORIZON_DEG

    def strips(self, sun_elevation_deg: float, altitude_km: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Apparent elevations [deg] of the disc's strips (S,), and irradiances at normal incidence over F0 if all the
        disc were of each (S, W); None where the sun is down."""
        if not self.reaches(sun_elevation_deg + SOLAR_RADIUS_DEG, altitude_km):
            return None
        offsets, _ = disc_strips()
        elevation, out = np.zeros(DISC_STRIPS), np.zeros((DISC_STRIPS, self.medium.n_wavelengths))
        for s, offset in enumerate(offsets):
            true = np.radians(sun_elevation_deg + SOLAR_RADIUS_DEG * offset)
            elevation[s] = np.degrees(true + beam_at(self.beam, altitude_km, np.sin(true), out[s]))
        return elevation, out

    @cached_property
    def beam(self) -> Beam:
        """The tables themselves."""
        return prepare_beam(self.medium)

    @cached_property
    def _ground(self) -> GroundSun:
        return GroundSun(self.medium)


def disc_strips(count: int = DISC_STRIPS) -> tuple[np.ndarray, np.ndarray]:
    """Heights of strips above the disc's centre, over its radius, and fractions of its area.

    Nodes of Gauss and Chebyshev's second kind: strips of a disc weigh by their chord.
    """
    k = np.arange(1, count + 1) * np.pi / (count + 1)
    return np.cos(k), 2.0 / (count + 1) * np.sin(k) ** 2


def make_disc(medium: Medium, body: Luminary, altitude_km: float, bands: GasBands | None = None) -> Disc:
    """The disc of the sun or of another body in its place, seen from an altitude [km], at the wavelengths of a medium.

    bands: of gases, which take from its light too.
    All images count: where layers of air bend several lines of sight to one point of the disc it is seen several times.
    """
    rays = ApparentRays(medium)
    centre, radius = float(body.elevation_deg), float(body.radius_deg)
    low, high = centre - radius - 0.1, min(90.0, centre + radius + _LIFTED_DEG)
    scan = np.arange(max(low, -90.0), high + _SEARCH_DEG, _SEARCH_DEG)
    scan = scan[scan <= 90.0]
    n = medium.refractivity[0]
    extremes = np.unique([int(np.argmin(n)), int(np.argmax(n))])
    true, passed = rays.follow(altitude_km, scan, extremes)
    hits = ((np.abs(true - centre) < radius + 5 * _SEARCH_DEG) & (passed > 0.0)).any(axis=1)
    if hits.any():
        first, last = scan[hits][[0, -1]] + np.array([-2.0, 2.0]) * _SEARCH_DEG
    else:  # below the horizon: rows that hold nothing
        first, last = centre, centre + 2 * ROW_DEG
    count = int(np.ceil((last - first) / ROW_DEG))
    rows = np.minimum(first + (np.arange(count) + 0.5) * ROW_DEG, 90.0)
    true, passed = follow_rows(medium, altitude_km, rows, bands)
    if not hits.any():
        passed[:] = 0.0
    return Disc(medium.wavelength_nm, rows, true, passed, centre, radius)


def follow_rows(
    medium: Medium, altitude_km: float, rows_deg: np.ndarray, bands: GasBands | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """True elevations [deg] and transmittances (H, W) of rays that arrive under apparent elevations (H,) [deg]."""
    if bands is None:
        true, passed = ApparentRays(medium).follow(altitude_km, rows_deg, np.arange(medium.n_wavelengths))
    else:
        true, passed = ApparentRays(bands.expand(medium)).follow(
            altitude_km, rows_deg, np.arange(bands.wavelength_index.size)
        )
        true, passed = true[:, np.unique(bands.wavelength_index, return_index=True)[1]], bands.sum_terms(passed)
    if medium.screen is not None:
        passed *= _screened(medium, medium.screen, max(altitude_km, medium.bottom_km), rows_deg)
    return true, passed


def _screened(medium: Medium, screen: Screen, altitude_km: float, rows_deg: np.ndarray) -> np.ndarray:
    """What a screen beyond the horizon lets pass (H, W) of rays that arrive under apparent elevations (H,) [deg]."""
    profile, elevation = ray_profile(medium), np.radians(rows_deg)
    transmission = []
    for w in range(medium.n_wavelengths):
        x = (profile.radius_km + altitude_km) * (1.0 + refractivity_at(profile, w, altitude_km))
        nm = medium.wavelength_nm[w]
        transmission.append(passing_at(screen, profile, w, nm, x * np.cos(elevation), x * np.sin(elevation)))
    return np.stack(transmission, axis=1)
