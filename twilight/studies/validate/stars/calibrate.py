"""A camera from a picture of stars: detect, search, solve, and say how sure that is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import pdtrc

from twilight.base.errors import TwilightError
from twilight.numerics.directions import orientation_angles
from twilight.sky.night.points import Stars, blended
from twilight.studies.camera.model import CameraModel
from twilight.studies.validate.stars.coordinates import StarSite, equatorial, horizontal
from twilight.studies.validate.stars.detect import Sources, detect
from twilight.studies.validate.stars.search import (
    Attitude,
    Match,
    Pose,
    ZenithRefraction,
    chance_matches,
    find_attitude,
    fit_in_brightness,
    match,
)

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


NEIGHBOURHOODS_DEG = (35.0, 55.0, 80.0, 180.0, 180.0, 180.0, 180.0)
"""Distance from the pair that gave the attitude within which stars are matched [deg], iteration by iteration."""
CLIP_SIGMA = 3.5
"""Matches farther off than this many standard deviations of the others are dropped."""
SMALLEST_RADIUS_PX = 0.7
"""Smallest radius of matching [pixel]: centres of faint stars err by a few tenths of a pixel."""
LEAST_MATCHES = 5
"""Stars that a solution needs."""
FREE_FROM = {"focal_length": (6, 0.0), "principal_point": (16, 55.0), "k1": (16, 55.0), "k2": (30, 80.0)}
"""Matches and neighbourhood [deg] from which on a parameter is free."""
FREE_FROM_LATER = (60, 180.0)
"""Matches and neighbourhood [deg] from which on the higher coefficients of distortion are free."""
PRINCIPAL_POINT_FRACTION = 0.03
"""Width of the prior of the principal point, as a fraction of the picture's width.  A prior holds near the guess what
the stars do not tell; it counts as much as one star that is one sigma off."""
DISTORTION_SCALE = 0.3
"""Width of the prior of the coefficients of distortion."""


@dataclass(frozen=True, eq=False)
class CameraSolution:
    """A solved camera.

    pairs: sources with a star within the last search radius; of them refused_brightness were too bright or too faint,
    and refused_distance too far off for the scatter of the others.  chance_matches: what to expect by accident.
    free: names of the lens parameters that were solved.  standard_errors: of the three angles of the attitude [rad]
    about right, forward and up, and then of `free` in their order (principal_point stands for two).
    """

    state: Pose
    match: Match
    rms_rad: float
    median_rad: float
    pairs: int
    refused_brightness: int
    refused_distance: int
    chance_matches: float
    free: tuple[str, ...]
    standard_errors: np.ndarray


def with_lens(
    camera: CameraModel, focal_length_px: float, principal_point_px: np.ndarray,
    distortion: np.ndarray | tuple[float, ...],
) -> CameraModel:  # fmt: skip
    """The camera with these instead of its own focal length (in whatever form), principal point and distortion."""
    data = camera.model_dump()
    for name in ("focal_length_mm", "sensor_width_mm", "field_of_view_deg"):
        data["lens"].pop(name)
    data["lens"] |= {
        "focal_length_px": float(focal_length_px),
        "principal_point_px": tuple(float(v) for v in principal_point_px),
        "distortion": tuple(float(v) for v in distortion),
    }
    return CameraModel.model_validate(data)


def refine(
    state: Pose, sources: Sources, stars: Stars, centre: np.ndarray, error_rad: float, orders: int
) -> CameraSolution | None:
    """Match and solve, from the neighbourhood of a direction (3,), own axes, to the whole picture; None if it fails.

    sources, stars: brightest first; stars in the frame of `state`.  error_rad: first and largest radius of matching.
    orders: how many coefficients of distortion may be solved.
    """
    radius = sigma = error_rad
    for turn, neighbourhood_deg in enumerate(NEIGHBOURHOODS_DEG):
        near = match(state, sources, stars, radius, centre, np.radians(neighbourhood_deg))
        used = near.take(fit_in_brightness(near, sources, stars))
        if len(used) < LEAST_MATCHES:
            return None
        free = _free(state.camera, len(used), neighbourhood_deg, orders)
        state, _ = _least_squares(state, sources, stars, used, free, sigma)
        distance = _distances(state, sources, stars, used)
        # sigma of one axis: the median of a Rayleigh distribution is 1.18 of it
        sigma = max(float(np.median(distance)) / 1.18, 0.02 / state.camera.focal_length_px)
        if turn < len(NEIGHBOURHOODS_DEG) - 1:
            # while the neighbourhood grows, what is not solved yet bends its outskirts
            growth = 2.0 if neighbourhood_deg < 180.0 else 1.0
            smallest = SMALLEST_RADIUS_PX / state.camera.focal_length_px
            radius = float(np.clip(growth * CLIP_SIGMA * sigma, min(smallest, error_rad), error_rad))
    close = distance <= CLIP_SIGMA * sigma
    final = used.take(close)
    if len(final) < LEAST_MATCHES:
        return None
    state, errors = _least_squares(state, sources, stars, final, free, sigma)
    distance = _distances(state, sources, stars, final)
    return CameraSolution(
        state=state,
        match=replace(final, distance=distance),
        rms_rad=float(np.sqrt(np.mean(distance**2))),
        median_rad=float(np.median(distance)),
        pairs=len(near),
        refused_brightness=len(near) - len(used),
        refused_distance=int((~close).sum()),
        chance_matches=chance_matches(state, sources, stars, CLIP_SIGMA * sigma),
        free=free,
        standard_errors=errors,
    )


def _free(camera: CameraModel, matches: int, neighbourhood_deg: float, orders: int) -> tuple[str, ...]:
    """Names of the lens parameters that so many matches over such a neighbourhood can tell."""
    if camera.projection == "latlong":
        return ()
    names = ["focal_length", "principal_point", *(f"k{n}" for n in range(1, orders + 1))]
    able = []
    for name in names:
        least_matches, least_deg = FREE_FROM.get(name, FREE_FROM_LATER)
        if matches >= least_matches and neighbourhood_deg >= least_deg:
            able.append(name)
    return tuple(able)


def _distances(state: Pose, sources: Sources, stars: Stars, pairs: Match) -> np.ndarray:
    """Angles [rad] (N,) between sources and their stars; pi where a source is outside what the lens can show."""
    directions = state.camera.directions_own(sources.xy[pairs.source])
    own = state.own(stars.directions[pairs.star])
    angle = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(directions - own, axis=1), 0.0, 1.0))
    return np.where(np.isnan(angle), np.pi, angle)


def _least_squares(
    state: Pose, sources: Sources, stars: Stars, pairs: Match, free: tuple[str, ...], sigma_rad: float
) -> tuple[Pose, np.ndarray]:
    """The state that brings the stars nearest to their sources, and the standard errors of what was free."""
    guess = state.camera
    panorama = guess.projection == "latlong"
    focal, centre = guess.focal_length_px, guess.principal_point_px
    orders = max([int(name[1:]) for name in free if name[0] == "k"], default=0)
    first_k = np.zeros(max(orders, len(guess.lens.distortion)))
    first_k[: len(guess.lens.distortion)] = guess.lens.distortion
    xy, sky = sources.xy[pairs.source], stars.directions[pairs.star]
    width = guess.image.width_px
    # rows of a panorama are stretched by 1 / cos(latitude)
    across = np.sin(np.pi * xy[:, 1] / guess.image.height_px) if panorama else 1.0
    scale_px = sigma_rad * focal

    def unpack(x: np.ndarray) -> Pose:
        matrix = Rotation.from_rotvec(x[:3]).as_matrix() @ state.matrix
        if panorama:
            return replace(state, matrix=matrix)
        rest = list(x[3:])
        f = focal * np.exp(rest.pop(0)) if "focal_length" in free else focal
        c = centre + width * np.array([rest.pop(0), rest.pop(0)]) if "principal_point" in free else centre
        k = first_k.copy()
        k[: len(rest)] += rest
        return replace(state, matrix=matrix, camera=with_lens(guess, f, c, k))

    def residuals(x: np.ndarray) -> np.ndarray:
        off = unpack(x).project(sky) - xy
        if panorama:
            off[:, 0] = (np.mod(off[:, 0] + 0.5 * width, width) - 0.5 * width) * across
        off = np.where(np.isnan(off), 20.0 * scale_px, off) / scale_px
        prior = x[3:].copy()
        if "focal_length" in free:
            prior = prior[1:]
        widths = [PRINCIPAL_POINT_FRACTION] * (2 * ("principal_point" in free)) + [DISTORTION_SCALE] * orders
        return np.concatenate([off.ravel(), prior / np.array(widths)]) if widths else off.ravel()

    number = 3 + ("focal_length" in free) + 2 * ("principal_point" in free) + orders
    solved = least_squares(residuals, np.zeros(number), loss="soft_l1", x_scale="jac", max_nfev=60)
    off = residuals(solved.x)[: 2 * len(xy)]
    variance = float((off**2).sum() / max(1, off.size - number))
    errors = np.sqrt(np.diag(np.linalg.pinv(solved.jac.T @ solved.jac)) * variance)
    return unpack(solved.x), errors
