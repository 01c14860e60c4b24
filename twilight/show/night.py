"""The night's light in a film: found at some moments, drawn once for each, mixed in between.

Moonlit channels of sunlit ones: the moon's light in the air is the sun's, times a smooth spectrum.

    moonlit = f(550 nm) C sunlit,      C (4, 4) so that C see(L) = see(L f / f(550 nm)) for the spectra L of one air

f is the moon's irradiance over the sun's, see(L) the channels of a spectrum.  The spectra of one sky are few enough
that C exists: 95 % of the residuals are within 0.2 % of luminance and 0.8 % of X, Z and scotopic luminance
(`tests/show/test_moon_films.py`), so that the tables of a field serve the moon as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from typing import Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.config.scene import Config
from twilight.config.sun import SunInterval
from twilight.engine import Field
from twilight.engine.night import NightLight, levels_of, night_light, star_sky, without_points
from twilight.numerics.directions import direction
from twilight.numerics.spectrum import wavelength_bounds
from twilight.show.timeline import FilmTimeline
from twilight.show.tones import Channels
from twilight.sky.moon import PHASE_RANGE_DEG, Moon
from twilight.sky.night import Place, light
from twilight.sky.night.points import Raster, StarSky
from twilight.sky.night.world import veil

STEP_S = 900.0
"""Largest time between two moments: the stars turn by 3.75 deg."""


@dataclass(frozen=True, eq=False)
class MovingStars:
    """The brighter stars as points over a place: sky, what the air does to them; channels (W, 4), X, Y, Z and scotopic
    luminance of a radiance of 1 at each wavelength; place: with the time of the film's beginning."""

    sky: StarSky
    channels: np.ndarray
    place: Place

    def at(self, time_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Directions (N, 3) east, north, up and illuminances (N, 4) at a time of the film."""
        points = self.sky.over(replace(self.place, time=self.place.time + timedelta(seconds=time_s)))
        return direction(points.azimuth_deg, points.elevation_deg), points.irradiance @ self.channels

    def arrays(self) -> dict[str, np.ndarray]:
        """As `from_arrays` takes them."""
        sky, place = self.sky, self.place
        return {
            "stars_rows": np.stack([sky.apparent_deg, sky.true_deg]),
            "stars_passed": sky.passed,
            "stars_wavelength_nm": sky.wavelength_nm,
            "stars_channels": self.channels,
            "stars_place": np.array([sky.level, place.latitude_deg, place.longitude_deg, place.time.timestamp()]),
        }

    @classmethod
    def from_arrays(cls, cached: dict[str, np.ndarray]) -> MovingStars:
        """What `arrays` gave."""
        level, latitude, longitude, begin = (float(v) for v in cached["stars_place"])
        apparent, true = cached["stars_rows"]
        sky = StarSky(apparent, true, cached["stars_passed"], cached["stars_wavelength_nm"], level)
        return cls(sky, cached["stars_channels"], Place(latitude, longitude, datetime.fromtimestamp(begin, UTC)))


@dataclass(frozen=True)
class Nights:
    """time_s (K,): of the moments; sun_azimuth_deg (K,), from which the azimuths of `lights` count.

    lights: X, Y, Z and scotopic luminance [cd m^-2]; stars: those that are points, whose light `lights` lack.
    """

    time_s: np.ndarray
    sun_azimuth_deg: np.ndarray
    lights: tuple[NightLight, ...]
    stars: MovingStars | None = None

    def arrays(self) -> dict[str, np.ndarray]:
        """As `from_arrays` takes them."""
        return {
            "night_time_s": self.time_s,
            "night_sun_azimuth_deg": self.sun_azimuth_deg,
            "night_elevation_deg": self.lights[0].elevation_deg,
            "night_azimuth_deg": self.lights[0].azimuth_deg,
            "night_radiance": np.stack([one.radiance for one in self.lights]),
            "night_ground": np.stack([one.ground for one in self.lights]),
            **({} if self.stars is None else self.stars.arrays()),
        }

    @classmethod
    def from_arrays(cls, cached: dict[str, np.ndarray]) -> Nights:
        """What `arrays` gave."""
        axes = cached["night_elevation_deg"], cached["night_azimuth_deg"]
        pairs = zip(cached["night_radiance"], cached["night_ground"], strict=True)
        lights = tuple(NightLight(*axes, r, g) for r, g in pairs)
        stars = MovingStars.from_arrays(cached) if "stars_place" in cached else None
        return cls(cached["night_time_s"], cached["night_sun_azimuth_deg"], lights, stars)


def nights_of(config: Config, medium: Medium, channels: Channels, line: FilmTimeline) -> Nights | None:
    """The nights of a film, None where its configuration has none."""
    if config.night is None:
        return None
    span = float(line.time_s[-1])
    times = np.linspace(0.0, span, 1 + int(np.ceil(span / STEP_S)))
    elevation, azimuth = (np.interp(times, line.time_s, v) for v in (line.elevation_deg, line.azimuth_deg))
    levels, stars, lights, site = levels_of(config.night), None, [], None
    if isinstance(config.sun, SunInterval):
        site = Place(config.sun.latitude_deg, config.sun.longitude_deg, config.sun.aware(config.sun.start))
        sky = star_sky(config.night, medium, config.observer.altitude_km)
        if sky is not None:
            levels = without_points(levels)
            stars = MovingStars(sky, channels.of(np.diag(1.0 / channels.solar_irradiance)), site)
    for t, e, a in zip(times, elevation, azimuth, strict=True):
        place = None if site is None else replace(site, time=site.time + timedelta(seconds=float(t)))
        night = night_light(
            medium,
            levels,
            config.observer.altitude_km,
            sun_elevation_deg=float(e),
            sun_azimuth_deg=None if place is None else float(a),
            place=place,
        )
        radiance, ground = (channels.of(v / channels.solar_irradiance) for v in (night.radiance, night.ground))
        lights.append(NightLight(night.elevation_deg, night.azimuth_deg, radiance, ground))
    return Nights(times, azimuth, tuple(lights), stars)


class NightPainter:
    """Draws the night in a fixed set of directions (H, W) [deg], at any time of the film."""

    def __init__(self, nights: Nights, elevation_deg: np.ndarray, azimuth_deg: np.ndarray):
        self.nights = nights
        self._raster = None if nights.stars is None else Raster(direction(azimuth_deg, elevation_deg), 1.0)

        @lru_cache(maxsize=2)
        def picture(k: int) -> np.ndarray:
            away = azimuth_deg - nights.sun_azimuth_deg[k]
            return np.nan_to_num(nights.lights[k].at(elevation_deg, away)).astype(np.float32)

        self._picture = picture

    def light(self, time_s: float) -> np.ndarray:
        """X, Y, Z and scotopic luminance [cd m^-2], (H, W, 4); 0 outside the picture."""
        out = self._glow(time_s)
        if self.nights.stars is None or self._raster is None:
            return out
        out = out.copy()
        self._raster.add(out, *self.nights.stars.at(time_s))
        return out

    def _glow(self, time_s: float) -> np.ndarray:
        times = self.nights.time_s
        k = int(np.clip(np.searchsorted(times, time_s, side="right") - 1, 0, max(times.size - 2, 0)))
        if times.size == 1:
            return self._picture(0)
        fraction = float(np.clip((time_s - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0))
        return (1.0 - fraction) * self._picture(k) + fraction * self._picture(k + 1)


NODES = 256
"""Elevations at which a line of the sky is held."""
MEAN_ROWS_DEG = (np.arange(30) + 0.5) * 3.0
"""Elevations of the directions over which light that falls from above is averaged [deg]."""


def sky_elevations(horizon_deg: float) -> np.ndarray:
    """Elevations [deg] of the nodes, closer towards the horizon."""
    return horizon_deg + (90.0 - horizon_deg) * np.linspace(0.0, 1.0, NODES) ** 2


def sunbeam(
    solved: Field, channels: Channels, altitude_km: float, nodes_deg: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Refraction and light of the sun's disc at apparent elevations (N,) [deg], from the horizon up.

    Returns: apparent less true elevation of a point of the disc [deg] (N,), and what the whole disc would give there at
    normal incidence, X, Y, Z and scotopic [lx], (N, 4).
    """
    horizon_deg = float(nodes_deg[0])
    steps = np.arange(horizon_deg - 1.5, horizon_deg + 2.0, 0.01), np.arange(horizon_deg + 2.0, 90.0, 0.1)
    suns = [(e, solved.direct(float(e), altitude_km)) for e in (*steps[0], *steps[1], 90.0)]
    visible = [(e, one) for e, one in suns if one.irradiance.any()]
    true = np.array([e for e, _ in visible])
    apparent = true + np.array([one.bending_deg for _, one in visible])
    factor = np.stack([one.irradiance for _, one in visible])
    refraction_deg = np.interp(nodes_deg, apparent, apparent - true)
    logs = np.log(np.maximum(channels.of(factor), 1e-30))
    light = np.stack([np.interp(nodes_deg, apparent, column) for column in logs.T], axis=-1)
    return refraction_deg, np.exp(light)


def night(medium: Medium, altitude_km: float, nodes_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The parts of the night's light at usual brightness, as `night.night_radiance` has it.

    By elevation (N,) [deg] and for the ground, (5, N, W) and (3, W) [W m^-2 nm^-1 sr^-1]: airglow; starlight of 1 S10
    that comes through, and what is scattered of a mean of 1 S10; the same of zodiacal light that is
    1 W m^-2 nm^-1 sr^-1 at 500 nm.  The ground sends back what falls on it (airglow; of mean starlight; of mean
    zodiacal light).
    """
    wavelength_nm, nodes = medium.wavelength_nm, nodes_deg
    zenith = light.airglow_zenith(wavelength_bounds(wavelength_nm))

    def glow(elevation: np.ndarray) -> np.ndarray:
        rows = zip(light.airglow_layers(), zenith, strict=True)
        return sum(light.van_rhijn(elevation, layer, altitude_km)[:, None] * radiance for layer, radiance in rows)

    air = veil(medium, nodes, altitude_km)
    t, scattered = air.transmittance, (1.0 - air.transmittance) * air.source
    weight = np.sin(2 * np.radians(MEAN_ROWS_DEG))
    mean = (weight / weight.sum()) @ glow(MEAN_ROWS_DEG)
    stars = light.S10_550NM * light.solar_shape(wavelength_nm, 550.0)
    zodiac = light.solar_shape(wavelength_nm, 500.0) * light.zodiacal_colour(wavelength_nm)
    rows = np.stack([glow(nodes) * t + mean * scattered, t * stars, scattered * stars, t * zodiac, scattered * zodiac])
    # what falls on the ground: the mean over the hemisphere of the light that arrives there
    below = veil(medium, MEAN_ROWS_DEG, medium.bottom_km)
    fraction = (weight / weight.sum()) @ (below.transmittance + (1.0 - below.transmittance) * below.source)
    ground = medium.ground_albedo * fraction * np.stack([mean, stars, zodiac])
    return rows, ground


def zodiacal_table() -> np.ndarray:
    """Zodiacal light at 500 nm [W m^-2 nm^-1 sr^-1], (73, 37): by ecliptic longitude from the sun, 0 to 180 deg, and
    latitude, 0 to 90 deg, every 2.5 deg."""
    grid = np.meshgrid(np.linspace(0.0, 180.0, 73), np.linspace(0.0, 90.0, 37), indexing="ij")
    return light.zodiacal_500nm(*grid)


PHASES_DEG = np.array([PHASE_RANGE_DEG[0], 15.0, 40.0, PHASE_RANGE_DEG[1]])
"""Phase angles at which C is found; linear in between, for the moon reddens evenly with its phase."""
LEVEL_NM = np.array([550.0])
"""Wavelength at which the moon's irradiance over the sun's is a factor of its own [nm]."""
DARK = 1e-25
"""Spectra are left out whose light is less than this [sr^-1]."""
LEVEL_PHASES_DEG = np.concatenate([[0.0, 1.55, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20], np.arange(25.0, 181.0, 5.0)])
"""Phase angles at which a page has the moon's light; its logarithm is linear in between."""


def reddening(wavelength_nm: np.ndarray, phase_angle_deg: float) -> np.ndarray:
    """f / f(550 nm), (W,)."""
    moon = Moon(0.0, 0.0, phase_angle_deg)
    return moon.reflectance(wavelength_nm) / moon.reflectance(LEVEL_NM)


def page_header() -> dict[str, Any]:
    """What `web/moon.js` needs of every moon: ln f(550 nm) at mean distances, phase unknown, waxing and waning."""
    moons = [[Moon(0.0, 0.0, float(g), waxing=w) for g in LEVEL_PHASES_DEG] for w in (None, True, False)]
    rows = [[float(np.log(moon.irradiance_factor(LEVEL_NM)[0])) for moon in row] for row in moons]
    return {"phase_deg": LEVEL_PHASES_DEG.tolist(), "log_level": rows, "colours_at_deg": PHASES_DEG.tolist()}


@dataclass(frozen=True, eq=False)
class MoonColours:
    """matrices (K, 4, 4): C at `PHASES_DEG`."""

    matrices: np.ndarray

    @classmethod
    def of(cls, spectra: np.ndarray, channels: Channels) -> MoonColours:
        """From spectra (..., W) of an air over the sun's irradiance [sr^-1]: least squares of relative residuals."""
        spectra = spectra.reshape(-1, spectra.shape[-1])
        spectra = spectra[spectra.min(axis=-1) > DARK]
        sunlit, skies = channels.of(spectra), []
        for phase in PHASES_DEG:
            moonlit = channels.of(spectra * reddening(channels.wavelength_nm, float(phase)))
            rows = [
                np.linalg.lstsq(sunlit / moonlit[:, c : c + 1], np.ones(len(sunlit)), rcond=None)[0]
                for c in range(moonlit.shape[-1])
            ]
            skies.append(np.stack(rows))
        return cls(np.stack(skies))

    def page_header(self, wavelength_nm: np.ndarray) -> dict[str, Any]:
        """What `web/moon.js` needs of a field: matrices by columns, and f / f(550 nm) at its wavelengths."""
        return {
            "moon_colours": self.matrices.transpose(0, 2, 1).reshape(PHASES_DEG.size, -1).tolist(),
            "moon_spectrum": [reddening(wavelength_nm, float(g)).tolist() for g in PHASES_DEG],
        }

    def moonlit(self, sunlit: np.ndarray, moon: Moon) -> np.ndarray:
        """Channels (..., 4) under the moon from those under the sun in its place at 1 au."""
        phase = np.clip(moon.phase_angle_deg, *PHASES_DEG[[0, -1]])
        k = min(int(np.searchsorted(PHASES_DEG, phase, side="right")) - 1, PHASES_DEG.size - 2)
        t = (phase - PHASES_DEG[k]) / (PHASES_DEG[k + 1] - PHASES_DEG[k])
        matrix = (1.0 - t) * self.matrices[k] + t * self.matrices[k + 1]
        return np.maximum(sunlit @ (matrix.T * moon.irradiance_factor(LEVEL_NM)[0]), 0.0)
