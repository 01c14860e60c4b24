"""The lights of a film or a page beside the sky that the sun makes: moonlight, glows of the night, stars, the beam.

Glows of a film are found at some moments, drawn once for each, mixed in between.  Moonlit channels follow from sunlit
ones: the moon's light in the air is the sun's, times a smooth spectrum.

    moonlit = f(550 nm) C sunlit,      C (4, 4) so that C see(L) = see(L f / f(550 nm)) for the spectra L of one air

f is the moon's irradiance over the sun's, see(L) the channels of a spectrum.  The spectra of one sky are few enough
that C exists: 95 % of the residuals are within 0.2 % of luminance and 0.8 % of X, Z and scotopic luminance
(`tests/show/test_moon_films.py`), so that the tables of a field serve the moon as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import timedelta
from functools import lru_cache
from typing import Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.conventions import DARK
from twilight.config.scene import Config
from twilight.config.sun import SunInterval
from twilight.engine import Field
from twilight.numerics.directions import direction
from twilight.scene.lights import levels_of, placed_moon
from twilight.show.timeline import FilmTimeline
from twilight.show.tones import Channels
from twilight.sky.disc import limb_darkening, mean_limb_darkening
from twilight.sky.lights import Luminary
from twilight.sky.moments import Moments
from twilight.sky.moon import PHASE_RANGE_DEG, Moon, disc_integral, moon_over, surface, towards_sun
from twilight.sky.night import NightLevels, Place, light
from twilight.sky.night.glows import ROWS_DEG, glow_table, glows_of, hemisphere_weights
from twilight.sky.night.points import Raster, StarSky, with_points
from twilight.sky.table import SkyTable, stack

STEP_S = 900.0
"""Largest time between two moments: the stars turn by 3.75 deg."""


@dataclass(frozen=True, eq=False)
class FilmGlows:
    """The glows of a film at K moments.

    time_s (K,): of the moments; sun_azimuth_deg (K,), from which azimuths count; table: of X, Y, Z and scotopic
    luminance [cd m^-2], a sun for each moment; stars: the brighter ones as points, whose light the table lacks, site:
    where they are seen when the film begins, None: there are none; channels (W, 4): of a radiance of 1.
    """

    time_s: np.ndarray
    sun_azimuth_deg: np.ndarray
    table: SkyTable
    channels: np.ndarray
    stars: StarSky | None = None
    site: Place | None = None

    def points(self, time_s: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Directions (N, 3) east, north, up and illuminances (N, 4) of the stars at a time of the film."""
        if self.stars is None or self.site is None:
            return None
        points = self.stars.over(replace(self.site, time=self.site.time + timedelta(seconds=time_s)))
        return direction(points.azimuth_deg, points.elevation_deg), points.irradiance @ self.channels


def glows_of_film(config: Config, medium: Medium, channels: Channels, line: FilmTimeline) -> FilmGlows | None:
    """The glows of a film, None where its configuration has no night."""
    if config.night is None:
        return None
    span, altitude_km = float(line.time_s[-1]), config.observer.altitude_km
    times = np.linspace(0.0, span, 1 + int(np.ceil(span / STEP_S)))
    elevation, azimuth = (np.interp(times, line.time_s, v) for v in (line.elevation_deg, line.azimuth_deg))
    glows, stars, site = glows_of(levels_of(config.night), medium, altitude_km), None, None
    weights = channels.of(np.diag(1.0 / channels.solar_irradiance))
    if isinstance(config.sun, SunInterval):
        site = Place(config.sun.latitude_deg, config.sun.longitude_deg, config.sun.aware(config.sun.start))
        if config.night.stars is not False:
            glows, stars = with_points(glows)
    tables = []
    for t, e, a in zip(times, elevation, azimuth, strict=True):
        place = None if site is None else replace(site, time=site.time + timedelta(seconds=float(t)))
        table = glow_table(glows, Moments.of_sun(float(e), float(a), place), medium, altitude_km)
        tables.append(replace(table, smooth=channels.of(table.smooth / channels.solar_irradiance)))
    return FilmGlows(times, azimuth, stack(tables), weights, stars, site)


class GlowPainter:
    """Draws the glows in a fixed set of directions (H, W) [deg], at any time of the film."""

    def __init__(self, glows: FilmGlows, elevation_deg: np.ndarray, azimuth_deg: np.ndarray):
        self.glows = glows
        self._raster = None if glows.stars is None else Raster(direction(azimuth_deg, elevation_deg), 1.0)

        @lru_cache(maxsize=2)
        def picture(k: int) -> np.ndarray:
            one = replace(glows.table, smooth=glows.table.smooth[k : k + 1])
            away = azimuth_deg - glows.sun_azimuth_deg[k]
            return np.nan_to_num(one.light(elevation_deg, away)).astype(np.float32)

        self._picture = picture

    def light(self, time_s: float) -> np.ndarray:
        """X, Y, Z and scotopic luminance [cd m^-2], (H, W, 4); 0 outside the picture."""
        times = self.glows.time_s
        k = int(np.clip(np.searchsorted(times, time_s, side="right") - 1, 0, max(times.size - 2, 0)))
        out = self._picture(k)
        if times.size > 1:
            fraction = float(np.clip((time_s - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0))
            out = (1.0 - fraction) * out + fraction * self._picture(k + 1)
        points = self.glows.points(time_s)
        if points is None or self._raster is None:
            return out
        out = out.copy()
        self._raster.add(out, *points)
        return out


NODES = 256
"""Elevations at which a line of the sky is held."""


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
    logs = np.log(np.maximum(channels.of(factor), DARK))
    light = np.stack([np.interp(nodes_deg, apparent, column) for column in logs.T], axis=-1)
    return refraction_deg, np.exp(light)


def night_lines(medium: Medium, altitude_km: float, nodes_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a page adds up to the glows at usual brightness.

    By elevation (N,) [deg] and for the ground, (5, N, W) and (3, W) [W m^-2 nm^-1 sr^-1]: airglow; starlight of 1 S10
    that comes through, and what is scattered of a mean of 1 S10; the same of zodiacal light that is
    1 W m^-2 nm^-1 sr^-1 at 500 nm.  The ground sends back what falls on it (airglow; of mean starlight; of mean
    zodiacal light).
    """
    airglow, *others = glows_of(NightLevels(), medium, altitude_km)
    moment = Moments.of_sun(0.0)
    rows = [airglow.on_grid(moment, nodes_deg, np.zeros(1))[:, 0]]
    passed, source = airglow.air(nodes_deg)
    for glow in others:
        rows += [passed * glow.spectra(), (1.0 - passed) * source * glow.spectra()]
    # what falls on the ground: the mean over the hemisphere of the light that arrives there
    below, above = airglow.at(medium.bottom_km), airglow.means(moment)[0] @ airglow.spectra()
    passed, source = below.air(ROWS_DEG)
    fraction = hemisphere_weights() @ (passed + (1.0 - passed) * source)
    ground = medium.ground_albedo * fraction * np.stack([above, *(glow.spectra()[0] for glow in others)])
    return np.stack(rows), ground


def zodiacal_table() -> np.ndarray:
    """Zodiacal light at 500 nm [W m^-2 nm^-1 sr^-1], (73, 37): by ecliptic longitude from the sun, 0 to 180 deg, and
    latitude, 0 to 90 deg, every 2.5 deg."""
    grid = np.meshgrid(np.linspace(0.0, 180.0, 73), np.linspace(0.0, 90.0, 37), indexing="ij")
    return light.zodiacal_500nm(*grid)


PHASES_DEG = np.array([PHASE_RANGE_DEG[0], 15.0, 40.0, PHASE_RANGE_DEG[1]])
"""Phase angles at which C is found; linear in between, for the moon reddens evenly with its phase."""
LEVEL_NM = np.array([550.0])
"""Wavelength at which the moon's irradiance over the sun's is a factor of its own [nm]."""
LEAST_SPECTRUM = 1e-25
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
        spectra = spectra[spectra.min(axis=-1) > LEAST_SPECTRUM]
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


def moons_of(config: Config, line: FilmTimeline) -> list[Moon] | None:
    """The moon of every picture, its azimuth from the sun's; None where the configuration has none.

    One that is put somewhere stands still, as seen from the sun's azimuth.
    """
    if config.moon is None:
        return None
    suns = zip(line.time_s, line.elevation_deg, line.azimuth_deg, line.distance_au, strict=True)
    sun = config.sun
    if not isinstance(sun, SunInterval):
        return [placed_moon(config.moon, float(e), float(au)) for _, e, _, au in suns]
    start, where = sun.aware(sun.start), (sun.latitude_deg, sun.longitude_deg)
    altitude_km = config.observer.altitude_km
    return [moon_over(start + timedelta(seconds=float(t)), *where, float(a), altitude_km) for t, _, a, _ in suns]


DARKENED_AT_NM = np.array([550.0])
"""Wavelength of the limb darkening of all wavelengths, as on the page of `twilight view` [nm]."""
PIECE_DEG = 0.03
"""Distance of the points of a pixel whose mean is the disc's light in it [deg]."""
PIECES = (4, 16)
"""Fewest and most points across a pixel."""


@dataclass(frozen=True)
class DiscPainter:
    """Draws the discs of luminaries.

    refraction_deg (N,), beam (N, 4): of the sun's disc at 1 au, as `show.lights.sunbeam`; horizon_deg: apparent;
    colours: of moonlight, None: there is no moon.
    """

    refraction_deg: np.ndarray
    beam: np.ndarray
    horizon_deg: float
    colours: MoonColours | None = None

    def light(
        self,
        elevation_deg: np.ndarray,
        azimuth_deg: np.ndarray,
        pixel_deg: float,
        body: Luminary,
        sun_elevation_deg: float,
    ) -> np.ndarray:
        """Channels [cd m^-2] of a disc in directions (H, W), (H, W, 4); azimuth from the sun's, as the body's.

        A pixel has the mean of its points, so that a disc smaller than it keeps its light.
        """
        light = np.zeros((*elevation_deg.shape, 4))
        with np.errstate(invalid="ignore"):
            near = np.abs(elevation_deg - body.elevation_deg) < 2.0 + pixel_deg
            near &= elevation_deg >= self.horizon_deg
        if not near.any():
            return light
        apparent, nodes = elevation_deg[near], sky_elevations(self.horizon_deg)
        true = np.radians(apparent - np.interp(apparent, nodes, self.refraction_deg))
        beam = np.exp(np.stack([np.interp(apparent, nodes, log) for log in np.log(self.beam).T], axis=-1))
        m, across = np.radians(body.elevation_deg), np.radians(azimuth_deg[near] - body.azimuth_deg)
        radius = np.sin(np.radians(body.radius_deg))
        x = np.cos(true) * np.sin(across) / radius
        y = (np.sin(true) * np.cos(m) - np.cos(true) * np.sin(m) * np.cos(across)) / radius
        facing = np.cos(true) * np.cos(m) * np.cos(across) + np.sin(true) * np.sin(m) > 0.0
        count = int(np.clip(np.ceil(pixel_deg / PIECE_DEG), *PIECES))
        step = np.radians(pixel_deg) / radius * ((np.arange(count) + 0.5) / count - 0.5)
        place = x[:, None, None] + step[:, None], y[:, None, None] + step
        if isinstance(body, Moon):
            assert self.colours is not None
            towards, phase = towards_sun(body, sun_elevation_deg), body.phase_angle_deg
            shape, whole = surface(*place, towards, phase) / disc_integral(phase), self.colours.moonlit(beam, body)
        else:
            mu = np.sqrt(np.clip(1.0 - place[0] ** 2 - place[1] ** 2, 0.0, 1.0))
            dark = limb_darkening(mu[..., None], DARKENED_AT_NM)[..., 0] / mean_limb_darkening(DARKENED_AT_NM)[0]
            shape = np.where(mu > 0.0, dark / np.pi, 0.0)
            whole = beam * body.irradiance_factor(DARKENED_AT_NM)
        light[near] = (np.where(facing, shape.mean(axis=(1, 2)), 0.0) / radius**2)[:, None] * whole
        return light
