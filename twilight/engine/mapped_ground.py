"""Ground of an albedo map in a view: what it sends up beyond ground of the one albedo of the medium.

    L = L_1 + (A - A_1) T E / pi

with A the map's albedo where the line of sight meets the ground, A_1 and L_1 albedo and light of the uniform ground, E
the irradiance of level ground there by sun and sky, and T the transmittance of the line, forward peaks of aerosol
counted as passed.  So what the ground sends into the air is that of A_1 for all light but that of the line itself.
Lines and their ends are refracted; the Earth is a sphere, places on it geographic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.conventions import DARK
from twilight.engine.field import Field
from twilight.numerics.spectrum import hermite_weights
from twilight.scene.scene import Scene
from twilight.terrain.aerial_perspective import DEGREE
from twilight.terrain.heights import Standpoint
from twilight.terrain.scene import sky_irradiance
from twilight.transport.lines import horizon_cosine, trace_rays, with_refraction
from twilight.transport.profile import Profile, prepare_profile
from twilight.transport.scaling import delta_scaled

if TYPE_CHECKING:
    from twilight.io.albedo_map import AlbedoMap

LINES = 400
"""Lines of sight from straight down to the horizon, whose ends and transmittance are interpolated."""
SUNS_DEG = 2.0
"""Most distance of the suns of which E is computed [deg]."""
DARK_DEG = -20.0
"""Sun below which the ground is dark [deg]."""


@dataclass(frozen=True, eq=False)
class Land:
    """A map about an observer; place: with the azimuth of the sun (or the moon) from which directions count."""

    map: AlbedoMap
    place: Standpoint

    def albedo(self, azimuth_deg: np.ndarray, turn: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
        """(D, W) at places in directions (D,) from the sun, as far as an angle about the Earth's centre (D,) [rad]; NaN
        where the map has none."""
        here, bearing = np.radians(self.place.latitude_deg), np.radians(azimuth_deg + self.place.sun_azimuth_deg)
        north = np.cos(here) * np.sin(turn) * np.cos(bearing) + np.sin(here) * np.cos(turn)
        east = np.sin(turn) * np.sin(bearing)
        ahead = np.cos(here) * np.cos(turn) - np.sin(here) * np.sin(turn) * np.cos(bearing)
        longitude_deg = self.place.longitude_deg + np.degrees(np.arctan2(east, ahead))
        return self.map.at(np.degrees(np.arcsin(np.clip(north, -1.0, 1.0))), longitude_deg, wavelength_nm)


def land_of(scene: Scene, place: Standpoint | None) -> Land | None:
    """The map of a scene about its observer; None where it has none."""
    path = scene.configuration.climate.ground.albedo_map
    if path is None or place is None:
        return None
    from twilight.io.albedo_map import read_albedo_map  # start-up

    return Land(read_albedo_map(path), place)


@dataclass(frozen=True, eq=False)
class MappedGround:
    """The light of a map's ground under one sun, beyond that of uniform ground.

    wavelength_nm, albedo (W,): of the uniform ground; horizon_cosine: of the elevation of the refracted horizon; turn
    (N,) [rad], log_passed (N, W): ends and transmittance of lines at `_nodes`; suns_deg (S,), log_light (S, W): E / pi.
    """

    land: Land
    wavelength_nm: np.ndarray
    albedo: np.ndarray
    sun_elevation_deg: float
    horizon_cosine: float
    turn: np.ndarray
    log_passed: np.ndarray
    suns_deg: np.ndarray
    log_light: np.ndarray

    @classmethod
    def of(cls, solved: Field, sun_elevation_deg: float, land: Land) -> MappedGround:
        """Of a field that serves every sun and observer."""
        medium, altitude = solved.medium, solved.scene.altitude_km
        horizon = float(np.sqrt(1.0 - horizon_cosine(_lines_of(medium), np.array([altitude]))[0] ** 2))
        sine = -np.sqrt(1.0 - (horizon * np.sqrt(1.0 - _nodes() ** 2)) ** 2)
        start = np.full(sine.size, altitude)

        def passed(part: Medium) -> np.ndarray:
            return trace_rays(_lines_of(part), start, sine, 1.0).passed

        lines = trace_rays(_lines_of(medium), start, sine, 1.0)
        meets = int(np.argmax(lines.ground_weight.any(axis=1)))  # a step may take the first ones past the horizon
        turn = lines.ground_angle_rad
        turn[:meets] = turn[meets]
        reach = float(np.degrees(turn[0]))
        low, high = max(sun_elevation_deg - reach, DARK_DEG), sun_elevation_deg + reach
        suns = np.unique(np.minimum(np.arange(np.floor(low), max(high, low) + SUNS_DEG, SUNS_DEG), 90.0))
        light = [
            sky_irradiance(solved, float(sun), medium.bottom_km) + solved.disc_irradiance(float(sun), medium.bottom_km)
            for sun in suns
        ]
        return cls(
            land, medium.wavelength_nm, medium.ground_albedo, sun_elevation_deg, horizon, turn,
            np.log(np.maximum(solved.of_terms(passed), DARK)), suns,
            np.log(np.maximum(np.array(light) / np.pi, DARK)),
        )  # fmt: skip

    def light(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """What the map adds (D, W) [sr^-1] in directions (D,), azimuth from the sun; 0 above the horizon."""
        out = np.zeros((elevation_deg.size, self.albedo.size))
        e, a = np.radians(elevation_deg), np.radians(azimuth_deg)
        down = np.flatnonzero((e < 0.0) & (np.cos(e) < self.horizon_cosine))
        if not down.size:
            return out
        e, a = e[down], a[down]
        nodes, weights = hermite_weights(_nodes(), np.sqrt(1.0 - (np.cos(e) / self.horizon_cosine) ** 2))
        turn = (weights * self.turn[nodes]).sum(axis=1)
        passed = np.exp(np.einsum("dk,dkw->dw", weights, self.log_passed[nodes]))
        sun = np.radians(self.sun_elevation_deg)
        sine = np.sin(sun) * np.cos(turn) + np.cos(sun) * np.sin(turn) * np.cos(a)
        local_deg = np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0)))
        nodes, weights = hermite_weights(self.suns_deg, local_deg)
        shines = np.exp(np.einsum("dk,dkw->dw", weights, self.log_light[nodes]))
        shines[local_deg < DARK_DEG] = 0.0
        albedo = self.land.albedo(np.degrees(a), turn, self.wavelength_nm)
        out[down] = np.nan_to_num(albedo - self.albedo) * passed * shines
        return out


def join_grounds(grounds: Sequence[MappedGround]) -> MappedGround:
    """The same ground at the wavelengths of all blocks."""
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(one, name) for one in grounds], axis=-1)
        for name in ("wavelength_nm", "albedo", "log_passed", "log_light")
    }
    return replace(grounds[0], **joined)


def _nodes() -> np.ndarray:
    """sqrt(1 - (cos(elevation) / cos(that of the horizon))^2) of lines from the horizon to straight down: about the
    cosine of the zenith angle under which they meet the ground."""
    return np.linspace(1e-3, 1.0, LINES) ** 2


def _lines_of(medium: Medium) -> Profile:
    scaled = delta_scaled(medium, DEGREE).medium
    return with_refraction(prepare_profile(scaled), medium)
