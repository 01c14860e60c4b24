"""Which sun each picture of a film has, and when.

How bright each picture of a film is: one exposure for all, a camera that meters, an eye that adapts.
"""

from dataclasses import dataclass
from datetime import timedelta

import numpy as np

from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.config.scene import Config
from twilight.config.sun import SunAt, SunElevation, SunInterval, SunTimes
from twilight.io.view import DARKEST_FRACTION
from twilight.sky.colour import HIGHLIGHTS_OVER_MEAN, auto_exposure_ev100
from twilight.sky.ephemeris import sun_position

SUNSET_DEG = (6.0, -12.0)
"""Elevations of the sun at the film's begin and end [deg] where neither is said: golden hour to nautical dusk."""
FALL_DEG_PER_S = 15.0 / 3600.0
"""How fast the sun moves where there is no place: straight up or down, as over the equator at an equinox."""
LOWEST_DEG = -18.0
"""Lowest sun of a film without night and moon [deg]: the end of astronomical twilight."""
MOST_FRAMES = 100_000
"""Frames of one film."""


@dataclass(frozen=True)
class FilmTimeline:
    """time_s: of the sky, since the film began; elevation_deg: true; azimuth_deg: from the same zero; (N,) each."""

    time_s: np.ndarray
    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    distance_au: np.ndarray

    def __len__(self) -> int:
        return self.time_s.size


@dataclass(frozen=True)
class Pace:
    """How a film goes through the sky.

    speed: seconds of the sky in a second of the film; frames: number of pictures, which then says the speed.
    from_deg, to_deg: true elevations in place of the configuration's; with one sun and neither of them, `SUNSET_DEG`.
    """

    speed: float = 300.0
    frames_per_second: float = 25.0
    from_deg: float | None = None
    to_deg: float | None = None
    frames: int | None = None

    @property
    def step_s(self) -> float:
        """Seconds of the sky from picture to picture."""
        return self.speed / self.frames_per_second

    def times(self, span_s: float) -> np.ndarray:
        """Times of the pictures [s] in a span of the sky."""
        if self.frames is not None:
            return np.linspace(0.0, span_s, self.frames)
        count = int(span_s / self.step_s + ROUNDING) + 1
        if not 2 <= count <= MOST_FRAMES:
            raise TwilightError(
                f"--speed, --frames-per-second: {span_s:g} s of sky at {self.step_s:g} s a picture are {count} "
                f"pictures; a film has 2 to {MOST_FRAMES}"
            )
        return np.arange(count) * self.step_s


def timeline(config: Config, pace: Pace) -> FilmTimeline:
    """The suns of a film: from one elevation to another, or along the configuration's sequence or time span.

    Azimuths are counted from north where there is a place, else from the sun.  Errors: TwilightError for what makes no
    film.
    """
    from_deg, to_deg = pace.from_deg, pace.to_deg
    sun = config.sun
    if isinstance(sun, SunAt | SunTimes | SunInterval):
        if from_deg is not None or to_deg is not None:
            raise TwilightError("--from, --to: the configuration has a time; sun.start and sun.stop say what is shown")
        if not isinstance(sun, SunInterval):
            raise TwilightError("sun: single moments make no film; it needs sun.start and sun.stop")
        return _over_a_place(config, sun, pace)
    path = [sun.elevation_deg] if isinstance(sun, SunElevation) else list(sun.elevations_deg)
    if isinstance(sun, SunElevation) or from_deg is not None or to_deg is not None:
        ends = SUNSET_DEG if isinstance(sun, SunElevation) else (path[0], path[-1])
        path = [ends[0] if from_deg is None else from_deg, ends[1] if to_deg is None else to_deg]
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(path)))])
    if way[-1] == 0.0:
        raise TwilightError(
            f"the film begins and ends at {path[0]:g} deg; a film needs a sun that moves (--from, --to)"
        )
    time = pace.times(way[-1] / FALL_DEG_PER_S)
    elevation = np.interp(time * FALL_DEG_PER_S, way, path)
    return _checked(config, FilmTimeline(time, elevation, np.zeros(time.size), np.full(time.size, sun.distance_au)))


def _over_a_place(config: Config, sun: SunInterval, pace: Pace) -> FilmTimeline:
    start, stop = sun.aware(sun.start), sun.aware(sun.stop)
    time = pace.times(stop.timestamp() - start.timestamp())
    altitude_km = config.observer.altitude_km
    positions = [
        sun_position(start + timedelta(seconds=float(t)), sun.latitude_deg, sun.longitude_deg, altitude_km)
        for t in time
    ]
    columns = np.array([(float(p.elevation_deg), float(p.azimuth_deg), float(p.distance_au)) for p in positions]).T
    return _checked(config, FilmTimeline(time, columns[0], np.degrees(np.unwrap(np.radians(columns[1]))), columns[2]))


def _checked(config: Config, line: FilmTimeline) -> FilmTimeline:
    low, high = float(line.elevation_deg.min()), float(line.elevation_deg.max())
    if high > 90.0 or (low < LOWEST_DEG and config.night is None and config.moon is None):
        raise TwilightError(
            f"the sun goes from {high:g} to {low:g} deg in this film; {LOWEST_DEG:g} to 90 deg is what can be drawn "
            "without night and moon"
        )
    return line


CAMERA_S = 1.0
"""Seconds of the film, standard deviation, over which a camera's exposure is smoothed."""


def meter(light: np.ndarray, highlights_over_mean: float = HIGHLIGHTS_OVER_MEAN) -> tuple[float, float]:
    """(exposure value at ISO 100 as `io.view` meters it, log-mean luminance [cd m^-2]) of a picture (H, W, 4) without
    the sun's disc; 0 is left out."""
    lit_pixels = light[..., 1][light[..., 1] > 0.0]
    if not lit_pixels.size:
        return auto_exposure_ev100(lit_pixels), 1e-6
    lit = lit_pixels[lit_pixels >= DARKEST_FRACTION * np.quantile(lit_pixels, 0.995)]
    return auto_exposure_ev100(lit, None, highlights_over_mean), float(np.exp(np.log(lit_pixels).mean()))


def smoothed(metered: np.ndarray, frames_per_second: float) -> np.ndarray:
    """A camera's exposure values (N,) from metered ones: a mean over the pictures before and after, so that it does not
    lag and a straight line stays one to its ends."""
    values = np.asarray(metered, float)
    sigma = CAMERA_S * frames_per_second
    radius = min(int(3.0 * sigma), values.size - 1)
    if radius < 1:
        return values.copy()
    weight = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return np.convolve(np.pad(values, radius, "reflect", reflect_type="odd"), weight / weight.sum(), "valid")
