"""A night over a place: how luminous its sky is in any direction, and when objects stand out from it."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.config.scene import Config
from twilight.engine.night import levels_of
from twilight.engine.solve import Problem
from twilight.numerics import spectrum
from twilight.scene.scene import resolve
from twilight.sky.ephemeris import SunPosition, sun_position
from twilight.sky.eye_limit import MAGNITUDE_0_LUX, TYPICAL_FIELD_FACTOR, limiting_magnitude, threshold_contrast
from twilight.sky.moon import Moon
from twilight.sky.night import NightLevels, Place, night_radiance
from twilight.studies.visible.objects import Track, tracks
from twilight.transport.refracted_sight import ApparentRays, horizon_dip_deg

STEP_S = 180.0
"""Distance of the moments at which objects are looked for [s]; times are linear in between."""
LOWEST_SUN_DEG = -19.0
"""Elevation of the sun below which its own light counts no more."""
HIGHEST_SUN_OF_NIGHT_DEG = -5.0
"""Elevation of the sun below which the night's own light counts: at it the sky is 1000 times as luminous."""
ROWS = 120
"""Apparent elevations between which refraction and extinction are linear."""


class Sighting(NamedTuple):
    """While an object is seen: first and last moment, elevations [deg] of sun and object (apparent) then, and how many
    magnitudes it is brighter than the limit at best.

    """

    name: str
    first: dt.datetime
    last: dt.datetime
    sun_deg: tuple[float, float]
    elevation_deg: tuple[float, float]
    magnitude: float
    best_margin_mag: float


class Outlook(NamedTuple):
    """An object over a night: when it is seen, and by how many magnitudes at most it is brighter than the limit.

    best_margin_mag: negative for what is never seen, -inf for what stays below the horizon.
    """

    sightings: list[Sighting]
    best_margin_mag: float


@dataclass(frozen=True)
class Watch:
    """A climate's sky over a place, solved once, and an observer's eye.

    config: its climate, solver, night and observer count; latitude_deg, longitude_deg; field_factor: as of
    `twilight.sky.eye_limit`.
    Errors: TwilightError for a solver whose field does not serve every sun.
    """

    config: Config
    latitude_deg: float
    longitude_deg: float
    field_factor: float = TYPICAL_FIELD_FACTOR
    progress: Progress | None = None

    @cached_property
    def _solved(self) -> Any:
        scene = resolve(self.config)
        if not scene.capabilities.every_sun:
            raise TwilightError("visible: needs a solver whose field serves every sun, as zones or compact")
        return Problem(scene, None, cached=True).solve(self.progress)

    @cached_property
    def _weight(self) -> np.ndarray:
        return (
            spectrum.LUMINOUS_EFFICACY_LM_PER_W
            * spectrum.solar_at_visible(self.config.solar_spectrum)
            * spectrum.colour_matching_functions("cie1931_2deg")[:, 1]
        )

    def _luminous(self, factor: np.ndarray) -> np.ndarray:
        return spectrum.integrate(factor, self._solved.medium.wavelength_nm, self._weight)

    @property
    def altitude_km(self) -> float:
        """Of the observer."""
        return float(self._solved.scene.altitude_km)

    @cached_property
    def _air(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Apparent and true elevations [deg] and extinction [mag] of rays to the observer, (ROWS,) each."""
        medium = self._solved.medium
        low = -horizon_dip_deg(medium, self.altitude_km) + 1e-3
        apparent = low + (90.0 - low) * np.linspace(0.0, 1.0, ROWS) ** 2
        true, passed = ApparentRays(medium).follow(self.altitude_km, apparent, np.arange(medium.n_wavelengths))
        above = float(self._luminous(np.ones(medium.n_wavelengths)))
        with np.errstate(divide="ignore"):
            lost = -2.5 * np.log10(self._luminous(passed) / above)
        return apparent, np.maximum.accumulate(true[:, medium.n_wavelengths // 2]), lost

    def seen_at(self, true_elevation_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Apparent elevation [deg] and extinction along the refracted ray [mag]; NaN and infinite below the horizon."""
        apparent, true, lost = self._air
        e = np.asarray(true_elevation_deg, float)
        up = e >= true[0]
        shown = np.where(up, np.interp(e, true, apparent), np.nan)
        return shown, np.where(up, np.interp(np.where(up, shown, 90.0), apparent, lost), np.inf)

    def luminance(
        self,
        moment: dt.datetime,
        sun: SunPosition,
        elevation_deg: np.ndarray,
        azimuth_deg: np.ndarray,
        moon: Moon | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Luminance [cd m^-2] of the sky in apparent directions (D,), azimuths from north.

        Of twilight and night together, and of moonlight, (D,) each.
        """
        e, a = np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float)
        height, away = float(sun.elevation_deg), a - float(sun.azimuth_deg)
        e = np.maximum(e, 0.0)
        dark, moonlight = np.zeros(e.shape), np.zeros(e.shape)
        if height > LOWEST_SUN_DEG:
            dark += self._luminous(self._solved.radiance(height, e, np.mod(away, 360.0))) / float(sun.distance_au) ** 2
        if height < HIGHEST_SUN_OF_NIGHT_DEG:
            dark += self._night(moment, sun, e, away)
        if moon is not None and moon.shines:
            moonlit = self._solved.radiance(moon.elevation_deg, e, np.mod(away - moon.azimuth_deg, 360.0))
            moonlight += self._luminous(moonlit * moon.irradiance_factor(self._solved.medium.wavelength_nm))
        return dark, moonlight

    def _night(self, moment: dt.datetime, sun: SunPosition, e: np.ndarray, away: np.ndarray) -> np.ndarray:
        levels = NightLevels() if self.config.night is None else levels_of(self.config.night)
        medium = self._solved.medium
        rows, index = np.unique(e, return_inverse=True)
        columns, column = np.unique(np.mod(away, 360.0), return_inverse=True)
        radiance = night_radiance(
            medium,
            rows,
            columns,
            levels,
            sun_elevation_deg=float(sun.elevation_deg),
            sun_azimuth_deg=float(sun.azimuth_deg),
            place=Place(self.latitude_deg, self.longitude_deg, moment),
            observer_altitude_km=self.altitude_km,
        )
        return self._luminous(
            radiance[index, column] / spectrum.solar_irradiance(medium.wavelength_nm, self.config.solar_spectrum)
        )

    def limit(
        self, moment: dt.datetime, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, *, moonlight: bool = True
    ) -> np.ndarray:
        """V magnitude above the air of the faintest star seen in apparent directions (D,), NaN below the horizon."""
        sun = sun_position(moment, self.latitude_deg, self.longitude_deg, self.altitude_km)
        moon = None
        if moonlight:
            moons = tracks(["moon"], [moment], self.latitude_deg, self.longitude_deg, self.altitude_km)[0].moons
            moon = None if moons is None else moons[0]
        apparent, _, lost = self._air
        e = np.asarray(elevation_deg, float)
        background = sum(self.luminance(moment, sun, e, azimuth_deg, moon))
        dimmed = np.interp(e, apparent, lost)
        return np.where(e < apparent[0], np.nan, limiting_magnitude(background, self.field_factor) - dimmed)

    def margins(self, found: list[Track], moments: list[dt.datetime], suns: SunPosition) -> np.ndarray:
        """How many magnitudes objects are brighter than the limit, (objects, T); -inf below the horizon."""
        [moon] = tracks(["moon"], moments, self.latitude_deg, self.longitude_deg, self.altitude_km)
        assert moon.moons is not None
        seen = [self.seen_at(track.elevation_deg) for track in found]
        out = np.full((len(found), len(moments)), -np.inf)
        for k, moment in enumerate(moments):
            up = [i for i, (shown, _) in enumerate(seen) if np.isfinite(shown[k])]
            if not up:
                continue
            sun = SunPosition(*(float(np.asarray(part)[k]) for part in suns))
            where = np.array([seen[i][0][k] for i in up]), np.array([found[i].azimuth_deg[k] for i in up])
            sky, moonlight = self.luminance(moment, sun, *where, moon.moons[k])
            for i, dark, lit in zip(up, sky, moonlight, strict=True):
                # the moon's own aureole is no background to it
                background = float(dark if found[i].moons is not None else dark + lit)
                out[i, k] = self.margin(found[i], k, background, float(seen[i][1][k]))
        return out

    def margin(self, track: Track, k: int, background: float, lost_mag: float) -> float:
        at_eye = float(track.magnitude[k]) + lost_mag
        area = float(track.solid_angle_sr[k])
        if area == 0.0:
            return float(limiting_magnitude(background, self.field_factor)) - at_eye
        luminance = MAGNITUDE_0_LUX * 10.0 ** (-0.4 * at_eye) / area
        least = float(threshold_contrast(area, background, self.field_factor))
        with np.errstate(divide="ignore"):
            return float(2.5 * np.log10(luminance / background / least))

    def sightings(
        self, names: list[str], first: dt.datetime, last: dt.datetime, step_s: float = STEP_S
    ) -> dict[str, Outlook]:
        """When each object is seen between two moments."""
        count = int(np.ceil((last - first).total_seconds() / step_s)) + 1
        moments = [first + dt.timedelta(seconds=k * step_s) for k in range(count)]
        suns = sun_position(moments, self.latitude_deg, self.longitude_deg, self.altitude_km)
        where = (moments, self.latitude_deg, self.longitude_deg, self.altitude_km)
        found = tracks(names, *where)
        margins = self.margins(found, moments, suns)
        sun_deg = np.asarray(suns.elevation_deg)
        return {
            track.name: Outlook(_spans(track, moments, sun_deg, row, self.seen_at), float(row.max()))
            for track, row in zip(found, margins, strict=True)
        }


def _spans(
    track: Track, moments: list[dt.datetime], sun_deg: np.ndarray, margin: np.ndarray, seen_at: Any
) -> list[Sighting]:
    """Spans of a margin that is not negative, with ends where it crosses 0, linearly."""
    up = margin >= 0.0
    shown, _ = seen_at(track.elevation_deg)
    found = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], up, [False]]).astype(int)))
    for begin, end in edges.reshape(-1, 2):
        ends = []
        for inside, outside in ((begin, begin - 1), (end - 1, end)):
            f = 0.0
            if 0 <= outside < len(moments) and np.isfinite(margin[outside]):
                f = float(margin[inside] / (margin[inside] - margin[outside]))
            there = outside if f else inside
            step = moments[there] - moments[inside]
            height = float(shown[inside] + f * (shown[there] - shown[inside]))
            sun = float(sun_deg[inside] + f * (sun_deg[there] - sun_deg[inside]))
            ends.append((moments[inside] + f * step, sun, height))
        (first, sun_a, height_a), (last, sun_b, height_b) = ends
        best = int(begin + np.argmax(margin[begin:end]))
        sighting = Sighting(
            track.name, first, last, (sun_a, sun_b), (height_a, height_b), float(track.magnitude[best]),
            float(margin[best]),
        )  # fmt: skip
        found.append(sighting)
    return found
