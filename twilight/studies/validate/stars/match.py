"""Which source is which star, once it is known about where stars fall."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from twilight.sky.night.points import Stars
from twilight.studies.camera.model import CameraModel
from twilight.studies.validate.stars.detect import Sources
from twilight.studies.validate.stars.refraction import lifted

STARS_PER_SOURCE = 1.5
"""Brightest stars in the picture that are compared with sources, for each source."""
LARGEST_MAGNITUDE_ERROR = 2.0
"""Error of a source's brightness beyond which its match is refused [mag]; extinction and vignetting stay below."""
ENOUGH_FOR_BRIGHTNESS = 8
"""Matches from which on their brightness is compared too."""
CHANCE_ROTATIONS = 8
"""Rotations of the sky by which accidental matches are counted."""


@dataclass(frozen=True)
class ZenithRefraction:
    """The refraction where the zenith is known in the camera's own axes only."""

    zenith: tuple[float, float, float]
    pressure_hpa: float
    temperature_c: float


@dataclass(frozen=True, eq=False)
class Pose:
    """own = refraction(matrix @ sky), and the camera (its orientation is not used)."""

    matrix: np.ndarray
    camera: CameraModel
    air: ZenithRefraction | None = None

    def own(self, sky: np.ndarray) -> np.ndarray:
        """Directions (N, 3) of the sky in the camera's own axes, refracted."""
        own = sky @ self.matrix.T
        if self.air is None:
            return own
        return lifted(own, np.array(self.air.zenith), self.air.pressure_hpa, self.air.temperature_c)

    def project(self, sky: np.ndarray) -> np.ndarray:
        """Pixel positions (N, 2) of directions of the sky (N, 3), NaN outside."""
        return self.camera.project_own(self.own(sky))


@dataclass(frozen=True, eq=False)
class Match:
    """Indices of sources and of the stars that they are, with the distance [rad] between them."""

    source: np.ndarray
    star: np.ndarray
    distance: np.ndarray

    def __len__(self) -> int:
        return len(self.source)

    def take(self, chosen: np.ndarray) -> Match:
        """The pairs of these indices, or where this mask is true."""
        return Match(self.source[chosen], self.star[chosen], self.distance[chosen])


def match(
    state: Pose, sources: Sources, stars: Stars, radius_rad: float, centre: np.ndarray, within_rad: float
) -> Match:
    """Pairs that are each other's nearest, within the radius, up to `within_rad` from a direction (3,), own axes.

    As many of the brightest stars in the picture are compared as there may be among the sources: STARS_PER_SOURCE each.
    """
    found = state.camera.directions_own(sources.xy)
    limit = np.cos(within_rad) if within_rad < np.pi else -2.0
    source = np.flatnonzero(found @ centre >= limit)  # False for NaN
    own = state.own(stars.directions)
    up = True if state.air is None else own @ np.array(state.air.zenith) > 0.0
    star = np.flatnonzero((own @ centre >= limit) & up)
    star = star[state.camera.inside(state.camera.project_own(own[star]))]
    star = star[: max(4, int(STARS_PER_SOURCE * len(source)))]
    if not len(source) or not len(star):
        return Match(np.empty(0, dtype=int), np.empty(0, dtype=int), np.empty(0))
    chord, nearest = cKDTree(own[star]).query(found[source])
    _, back = cKDTree(found[source]).query(own[star])
    distance = 2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))
    mutual = (back[nearest] == np.arange(len(source))) & (distance <= radius_rad)
    return Match(source[mutual], star[nearest[mutual]], distance[mutual])


def fit_in_brightness(pairs: Match, sources: Sources, stars: Stars) -> np.ndarray:
    """Which pairs (N,) have a source about as bright as the star; all, where there are too few to know the scale."""
    if len(pairs) < ENOUGH_FOR_BRIGHTNESS:
        return np.ones(len(pairs), dtype=bool)
    difference = stars.magnitude[pairs.star] + 2.5 * np.log10(sources.flux[pairs.source])
    return np.abs(difference - np.median(difference)) <= LARGEST_MAGNITUDE_ERROR


def chance_matches(state: Pose, sources: Sources, stars: Stars, radius_rad: float) -> float:
    """How many pairs pass the same tests where the sky is turned away by 4 to 12 deg: matches to expect by accident."""
    random = np.random.default_rng(7)
    counts = []
    for _ in range(CHANCE_ROTATIONS):
        axis = random.normal(size=3)
        rotation = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.radians(random.uniform(4.0, 12.0)))
        turned = replace(state, matrix=rotation.as_matrix() @ state.matrix)
        pairs = match(turned, sources, stars, radius_rad, np.zeros(3), np.pi)
        counts.append(int(fit_in_brightness(pairs, sources, stars).sum()))
    return float(np.mean(counts))
