"""From an attitude that is about right to a camera: matching and robust least squares in turn."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from twilight.sky.night.points import Stars
from twilight.studies.camera.model import CameraModel
from twilight.studies.validate.stars.detect import Sources
from twilight.studies.validate.stars.search import Match, Pose, chance_matches, fit_in_brightness, match

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
