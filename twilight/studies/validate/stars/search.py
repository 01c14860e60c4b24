"""Which way a camera points among the stars, without any guess: "lost in space".

Two bright sources and two bright stars at the same distance from each other make an attitude; of the attitudes so made
the right one puts other sources, too, where there are stars, and no wrong one does.  The method needs distances that
are right to a per cent or two, so that a guess of the focal length is tried in steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.special import bdtrc

from twilight.base.conventions import TINY
from twilight.sky.night.points import Stars
from twilight.studies.camera.model import CameraModel
from twilight.studies.validate.stars.coordinates import lifted
from twilight.studies.validate.stars.detect import Sources

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
    directions = state.camera.directions_own(sources.xy)
    limit = np.cos(within_rad) if within_rad < np.pi else -2.0
    source = np.flatnonzero(directions @ centre >= limit)  # False for NaN
    own = state.own(stars.directions)
    up = True if state.air is None else own @ np.array(state.air.zenith) > 0.0
    star = np.flatnonzero((own @ centre >= limit) & up)
    star = star[state.camera.inside(state.camera.project_own(own[star]))]
    star = star[: max(4, int(STARS_PER_SOURCE * len(source)))]
    if not len(source) or not len(star):
        return Match(np.empty(0, dtype=int), np.empty(0, dtype=int), np.empty(0))
    chord, nearest = cKDTree(own[star]).query(directions[source])
    _, back = cKDTree(directions[source]).query(own[star])
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


SEEDS = 26
"""Number of sources that pairs are made of."""
CHECKS = 30
"""Number of sources near a pair by which a hypothesis is tested."""
NEAREST_PAIR_RAD = np.radians(3.0)
"""Least distance of two seeds that make a pair."""
FARTHEST_PAIR_RAD = np.radians(35.0)
"""Largest distance of two seeds that make a pair."""
NEIGHBOURHOOD_RAD = np.radians(40.0)
"""Radius around a pair [rad] within which sources test its hypotheses."""
SCALE_UNCERTAINTY = 0.015
"""Relative uncertainty of distances in the picture: between two steps of the focal length, and by distortion."""
CHANCE_OF_A_HIT = 0.05
"""Fraction of the sky near enough to a star to count as a hit."""
DECISIVE = 6.0
"""Significance of the best hypothesis beyond which no further ones are tried."""
MAP_STEP_DEG = 0.25
"""Side of the cells of the map of the sky near stars."""
MOST_CATALOGUE = 1500
"""Brightest stars of the catalogue that pairs are compared with."""


@dataclass(frozen=True, eq=False)
class Attitude:
    """How the sky lies in the camera: own = matrix @ sky (own axes right, forward, up).

    matrix (3, 3).  significance: -log10(chance that as many checks hit stars x hypotheses tried): above 3 is as good as
    certain.  hits, checks: sources near the pair that fall on stars, and all of them.  centre (3,): middle of the pair,
    own axes.
    """

    matrix: np.ndarray
    significance: float
    hits: int
    checks: int
    centre: np.ndarray


def spread(own: np.ndarray, number: int, side_rad: float, at_most: int = 3) -> np.ndarray:
    """Indices of the first `number` directions (N, 3), with at most so many in any cell of the given side.

    Keeps lamps, a skyline or the Milky Way from being all that is used.
    """
    cells = np.floor(own / side_rad + 0.5).astype(int)
    count: dict[tuple[int, ...], int] = {}
    chosen = []
    for i, cell in enumerate(map(tuple, cells.tolist())):
        count[cell] = count.get(cell, 0) + 1
        if count[cell] <= at_most:
            chosen.append(i)
        if len(chosen) == number:
            break
    return np.array(chosen, dtype=int)


def find_attitude(own: np.ndarray, stars: Stars, picture_sr: float, sky_sr: float, error_rad: float) -> Attitude | None:
    """The best attitude, None where there are too few sources.

    own (N, 3): directions of sources in the camera's own axes, brightest first.  stars: brightest first, over sky_sr of
    sky.  picture_sr: solid angle of sky in the picture.  error_rad: of a source's direction.
    """
    if len(own) < 6 or len(stars) < 6:
        return None
    fraction = np.clip(picture_sr / sky_sr, 1e-4, 1.0)
    side = np.clip(np.sqrt(picture_sr / 12.0), np.radians(2.0), np.radians(25.0))
    listed = own[spread(own, 4 * CHECKS, side, 6)]
    seeds = listed[spread(listed, SEEDS, side, 2)]
    number = int(np.clip(3.0 * len(seeds) / fraction, 150, MOST_CATALOGUE))
    bright = stars.directions[:number]
    map_number = int(np.clip(1.5 * len(listed) / fraction, 200, len(stars)))
    near, chance = _hit_map(stars.directions[:map_number], sky_sr, error_rad)
    first, second, distance = _pairs_by_distance(bright)
    best: Attitude | None = None
    tried = 0
    pairs = combinations(range(len(seeds)), 2)
    for i, j in sorted(pairs, key=lambda pair: (pair[0] + pair[1], pair[1])):  # the brightest pairs first
        a, b = seeds[i], seeds[j]
        between = _angle(a, b)
        if not NEAREST_PAIR_RAD <= between <= FARTHEST_PAIR_RAD:
            continue
        tolerance = 1.5 * error_rad + SCALE_UNCERTAINTY * between
        low, high = np.searchsorted(distance, [between - tolerance, between + tolerance])
        if low == high:
            continue
        one, two = first[low:high], second[low:high]
        starts, ends = np.concatenate([one, two]), np.concatenate([two, one])
        matrices = _frame(a, b)[None].transpose(0, 2, 1) @ _frame(bright[starts], bright[ends])
        middle = (a + b) / np.linalg.norm(a + b)
        checks = _checks(listed, middle, a, b)
        if len(checks) < 4:
            continue
        tried += len(matrices)
        hits = _count_hits(matrices, checks, near)
        top = int(hits.argmax())
        probability = max(float(bdtrc(hits[top] - 1, len(checks), chance)), TINY) if hits[top] else 1.0
        significance = -np.log10(probability)
        if best is None or significance > best.significance:
            best = Attitude(matrices[top], significance, int(hits[top]), len(checks), middle)
        if best.significance - np.log10(tried) > DECISIVE:
            break
    return None if best is None else replace(best, significance=best.significance - np.log10(tried))


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _pairs_by_distance(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Index pairs (i < j) of all stars near enough to each other, and their distances [rad], sorted by distance."""
    pairs = cKDTree(directions).query_pairs(2.0 * np.sin(0.5 * FARTHEST_PAIR_RAD * 1.05), output_type="ndarray")
    chord = np.linalg.norm(directions[pairs[:, 0]] - directions[pairs[:, 1]], axis=1)
    distance = 2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))
    order = np.argsort(distance)
    return pairs[order, 0], pairs[order, 1], distance[order]


def _frame(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Right-handed axes (..., 3, 3) as rows: the middle of a and b, the normal of their great circle, and the third."""
    middle = a + b
    middle = middle / np.linalg.norm(middle, axis=-1, keepdims=True)
    normal = np.cross(a, b)
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.stack([middle, normal, np.cross(middle, normal)], axis=-2)


def _checks(listed: np.ndarray, middle: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The first sources of the list around the pair, without the pair itself."""
    around = (listed @ middle > np.cos(NEIGHBOURHOOD_RAD)) & (listed @ a < np.cos(1e-6)) & (listed @ b < np.cos(1e-6))
    return listed[around][:CHECKS]


def _hit_map(directions: np.ndarray, sky_sr: float, error_rad: float) -> tuple[np.ndarray, float]:
    """Cells (declination, right ascension) near enough to a star, and the fraction of the sky that they cover."""
    density = len(directions) / sky_sr
    radius = np.sqrt(CHANCE_OF_A_HIT / (np.pi * density))
    radius = np.clip(radius, min(2.5 * error_rad, np.radians(1.0)), np.radians(1.0))
    rows, columns = round(180 / MAP_STEP_DEG), round(360 / MAP_STEP_DEG)
    latitude = np.radians((np.arange(rows) + 0.5) * MAP_STEP_DEG - 90.0)[:, None]
    longitude = np.radians((np.arange(columns) + 0.5) * MAP_STEP_DEG)[None, :]
    parts = (np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude))
    cells = np.stack(np.broadcast_arrays(*parts), axis=-1)
    chord, _ = cKDTree(directions).query(cells.reshape(-1, 3), distance_upper_bound=2.0 * np.sin(0.5 * radius))
    near = np.isfinite(chord).reshape(rows, columns)
    covered = float((near * np.cos(latitude)).sum() / (columns * np.cos(latitude).sum()) * 4.0 * np.pi / sky_sr)
    return near, min(covered, 0.5)


def _count_hits(matrices: np.ndarray, checks: np.ndarray, near: np.ndarray) -> np.ndarray:
    """How many of the sources (K, 3) fall near a star under each attitude (H, 3, 3)."""
    rows, columns = near.shape
    hits = np.empty(len(matrices), dtype=int)
    for start in range(0, len(matrices), 4096):
        sky = checks @ matrices[start : start + 4096]  # own = matrix @ sky, so sky = own @ matrix
        row = ((np.arcsin(np.clip(sky[..., 2], -1.0, 1.0)) / np.pi + 0.5) * rows).astype(int)
        column = np.mod((np.arctan2(sky[..., 1], sky[..., 0]) / (2.0 * np.pi) * columns).astype(int), columns)
        hits[start : start + 4096] = near[np.minimum(row, rows - 1), column].sum(axis=-1)
    return hits
