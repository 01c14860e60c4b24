"""A camera from a picture of stars: detect, search, solve, and say how sure that is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np
from scipy.special import pdtrc

from twilight.base.errors import TwilightError
from twilight.numerics.directions import orientation_angles
from twilight.sky.night.points import Stars, blended
from twilight.studies.camera.model import CameraModel
from twilight.studies.validate.stars.coordinates import StarSite, equatorial, horizontal
from twilight.studies.validate.stars.detect import Sources, detect
from twilight.studies.validate.stars.search import Attitude, Pose, ZenithRefraction, find_attitude
from twilight.studies.validate.stars.solve import CameraSolution, refine, with_lens

FOCAL_STEPS = (1.0, 0.97, 1.03, 0.94, 1.06, 0.91, 1.09)
"""Fractions of the guessed focal length that are tried, in this order."""
SURE = 8.0
"""Significance of an `Attitude` from which on the search ends."""
LIKELY = 1.0
"""Significance from which on an attitude is worth solving."""
RESOLUTION_PX = 1.5
"""Distance of stars below which they are one source [pixel]."""
FIRST_RADIUS_RAD = np.radians(1.0)
"""Radius of matching before anything is solved [rad]."""
LOWEST_SIN = np.sin(np.radians(2.0))
"""Sine of the elevation over a known horizon below which sources and stars are left to the landscape."""
LARGEST_CHANCE = 1e-6
"""Largest chance of as many accidental matches as were found with which a solution is accepted."""
SOURCES_IN_SEARCH = 300
"""Brightest sources that the search of the attitude uses."""


@dataclass(frozen=True)
class SkyOrientation:
    """The point of the sky overhead: its right ascension is the local sidereal time, its declination the latitude."""

    local_sidereal_time_h: float
    latitude_deg: float


@dataclass(frozen=True, eq=False)
class Calibration:
    """A solved camera, and what it was solved from.

    sources and stars are what `fit.match` counts in; stars are in east, north, up (with place and time, refracted) or
    in the mean equator and equinox of `year`.  orientation: of the sky; with place and time None.
    """

    camera: CameraModel
    fit: CameraSolution
    attitude: Attitude
    sources: Sources
    stars: Stars
    year: float
    orientation: SkyOrientation | None

    @property
    def pointing_error_arcmin(self) -> float:
        """Formal standard error of the attitude, the root of the mean square of its three angles."""
        return float(np.degrees(np.sqrt(np.mean(self.fit.standard_errors[:3] ** 2))) * 60.0)

    @property
    def visible(self) -> np.ndarray:
        """Which stars (N,) fall into the picture, and above the horizon."""
        state = self.fit.state
        own = state.own(self.stars.directions)
        up = np.ones(len(own), dtype=bool) if state.air is None else own @ np.array(state.air.zenith) > LOWEST_SIN
        return self.camera.inside(state.camera.project_own(own)) & up

    @property
    def magnitude_zero(self) -> float:
        """Magnitude of a source of flux 1, by the stars matched."""
        pairs = self.fit.match
        return float(np.median(self.stars.magnitude[pairs.star] + 2.5 * np.log10(self.sources.flux[pairs.source])))

    def facts(self) -> dict[str, Any]:
        """Figures of the calibration as plain values, for a file."""
        fit = self.fit
        facts: dict[str, Any] = {
            "method": "stars, Hipparcos",
            "sources": len(self.sources),
            "matched": len(fit.match),
            "matches_expected_by_chance": round(fit.chance_matches, 1),
            "refused_by_distance": fit.refused_distance,
            "refused_by_brightness": fit.refused_brightness,
            "residual_rms_arcmin": round(float(np.degrees(fit.rms_rad)) * 60.0, 3),
            "residual_median_arcmin": round(float(np.degrees(fit.median_rad)) * 60.0, 3),
            "pointing_standard_error_arcmin": round(self.pointing_error_arcmin, 3),
            "solved": ["orientation", *fit.free],
        }
        if self.orientation is not None:
            facts["local_sidereal_time_h"] = round(self.orientation.local_sidereal_time_h, 4)
            facts["latitude_deg"] = round(self.orientation.latitude_deg, 3)
            facts["equinox"] = self.year
        return facts


def calibrate(
    picture: np.ndarray,
    guess: CameraModel,
    place: StarSite | None = None,
    moment: datetime | None = None,
    *,
    year: float = 2020.0,
    orders: int = 2,
    threshold: float = 5.0,
    pressure_hpa: float = 1013.25,
    temperature_c: float = 10.0,
) -> Calibration:
    """The camera of a night picture (height, width[, 3]) of linear light, from a guess of it.

    guess: projection and size must be right, the focal length to 10 %, the principal point to 3 % of the width.  Its
    orientation is not used with place and moment (with time zone).  Without them the sky's orientation is solved
    against the fixed stars, and elevation and roll of the guess say where the zenith is.
    year: Julian year of positions and equinox where the moment is unknown.  orders: coefficients of distortion to
    solve, 0 to 4.  threshold: of detection, in standard deviations of the noise.

    Errors: TwilightError where the picture does not fit the guess, shows too few stars, or no orientation fits.
    """
    image = guess.image
    if picture.shape[:2] != (image.height_px, image.width_px):
        raise TwilightError(
            f"the picture has {picture.shape[1]} x {picture.shape[0]} pixels, but the camera says "
            f"{image.width_px} x {image.height_px} (image.width_px, image.height_px)"
        )
    if (place is None) != (moment is None):
        raise TwilightError("place and time of a picture are given together, or neither")
    zenith = guess.axes @ np.array([0.0, 0.0, 1.0])
    air = None
    if place is not None and moment is not None:
        stars, sky_sr = horizontal(place, moment, pressure_hpa, temperature_c), 2.0 * np.pi
    else:
        stars, sky_sr = equatorial(year), 4.0 * np.pi
        air = ZenithRefraction((float(zenith[0]), float(zenith[1]), float(zenith[2])), pressure_hpa, temperature_c)
    stars = blended(stars, RESOLUTION_PX / guess.focal_length_px)
    sources = detect(picture, guess, threshold)
    if guess.projection == "latlong":
        sources = sources.take(guess.directions_own(sources.xy) @ zenith > LOWEST_SIN)
    searched = _search(sources, guess, stars, sky_sr, air)
    if searched is None:
        raise TwilightError(
            f"no orientation of the sky fits the {len(sources)} star-like sources of the picture; check projection, "
            "focal length (to 10 %), lens.mirrored"
            f"{', place and time' if air is None else ''}, and that it shows at least some ten stars"
        )
    attitude, camera = searched
    radius = min(FIRST_RADIUS_RAD, 0.03 * image.width_px / camera.focal_length_px)
    fit = refine(Pose(attitude.matrix, camera, air), sources, stars, attitude.centre, radius, orders)
    if fit is None or not _beyond_chance(fit):
        raise TwilightError(
            f"the {len(sources)} star-like sources of the picture fit no orientation of the sky better than by chance"
        )
    return _finish(fit, attitude, sources, stars, zenith, year if moment is None else moment.year)


def _search(
    sources: Sources, guess: CameraModel, stars: Stars, sky_sr: float, air: ZenithRefraction | None
) -> tuple[Attitude, CameraModel] | None:
    """The best attitude over the steps of the focal length, with the camera of that step."""
    # above the local noise, not in light: clouds, lamps and a bright skyline are noisy places
    first = np.argsort(-sources.signal_to_noise, kind="stable")[:SOURCES_IN_SEARCH]
    xy = sources.xy[first]
    panorama = guess.projection == "latlong"
    best: tuple[Attitude, CameraModel] | None = None
    for step in (1.0,) if panorama else FOCAL_STEPS:
        camera = guess
        if not panorama:
            focal_px = step * guess.focal_length_px
            camera = with_lens(guess, focal_px, guess.principal_point_px, guess.lens.distortion)
        own = camera.directions_own(xy)
        own = own[np.isfinite(own).all(axis=1)]
        pixel = 1.0 / camera.focal_length_px
        attitude = find_attitude(own, stars, _solid_angle(camera), sky_sr, max(0.5 * pixel, np.radians(0.1)))
        if attitude is not None and (best is None or attitude.significance > best[0].significance):
            best = attitude, camera
            if attitude.significance > SURE:
                break
    return best if best is not None and best[0].significance > LIKELY else None


def _solid_angle(camera: CameraModel) -> float:
    """Solid angle of the picture [sr], at most of a half space; by counting evenly spread directions."""
    if camera.projection == "latlong":
        return 2.0 * np.pi
    n = 20000
    up = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    longitude = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(n)
    flat = np.sqrt(1.0 - up**2)
    even = np.stack([flat * np.cos(longitude), flat * np.sin(longitude), up], axis=-1)
    fraction = camera.inside(camera.project_own(even)).mean()
    return float(min(4.0 * np.pi * fraction, 2.0 * np.pi))


def _beyond_chance(fit: CameraSolution) -> bool:
    return bool(pdtrc(len(fit.match) - 1, max(fit.chance_matches, 0.5)) < LARGEST_CHANCE)


def _finish(
    fit: CameraSolution, attitude: Attitude, sources: Sources, stars: Stars, zenith: np.ndarray, year: float
) -> Calibration:
    """The camera with its orientation and the figures of the fit."""
    matrix = fit.state.matrix
    orientation = None
    axes = matrix
    if fit.state.air is not None:
        overhead = matrix.T @ zenith
        east = np.cross([0.0, 0.0, 1.0], overhead)
        east /= np.linalg.norm(east)
        axes = matrix @ np.stack([east, np.cross(overhead, east), overhead], axis=-1)
        orientation = SkyOrientation(
            float(np.degrees(np.arctan2(overhead[1], overhead[0])) / 15.0 % 24.0),
            float(np.degrees(np.arcsin(np.clip(overhead[2], -1.0, 1.0)))),
        )
    azimuth, elevation, roll = (round(angle, 7) + 0.0 for angle in orientation_angles(axes))
    solved = Calibration(fit.state.camera, fit, attitude, sources, stars, float(year), orientation)
    data = fit.state.camera.model_dump()
    data["orientation"] = {"azimuth_deg": azimuth, "elevation_deg": elevation, "roll_deg": roll}
    data["calibration"] = solved.facts()
    return replace(solved, camera=CameraModel.model_validate(data))
