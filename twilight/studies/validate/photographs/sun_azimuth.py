"""Where the sun is in a photograph of the sky: the azimuth about which a clear sky is its own mirror image.

Two things are measured.  *Symmetry*: ln(luminance) is mirrored about a trial azimuth and compared with itself where
both are clear sky; the best trial is the solar meridian or its opposite, and of the two the brighter low sky is the
sun's.  *The disc*: where the sun is up and its disc or its glare stands out, the centre of that light is taken instead,
which is more exact.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from twilight.base.errors import TwilightError
from twilight.studies.validate.photographs.mask import join_across_north, separation_deg
from twilight.studies.validate.photographs.picture_sky import PhotoSky

LEAST_OVERLAP = 0.1
"""Fraction of the clear sky that must have a mirror image for a trial azimuth to count."""
DISC_CONTRAST = 2.5
"""ln of the brightest light over the sky 5 to 8 deg away beyond which it is the sun's disc."""
DISC_NEAR_DEG = 12.0
"""Distance from the meridian of symmetry [deg] within which the disc is looked for."""
LARGEST_DISC_DEG = 1.0
"""Radius of a bright patch up to which it is the sun's disc, its bloom and a blurred edge; what is larger is an aureole
at the end of the scale [deg]."""
LARGEST_DISC_SQUARE = np.pi * LARGEST_DISC_DEG**2
"""Its area [deg^2]."""
LARGEST_PATCH_DEG = 8.0
"""Radius of such an aureole, at most; the error of one that the picture's edge cuts [deg]."""
LEAST_PATCH_DEG = 0.3
"""Radius of what is at the end of the scale, at least [deg]."""
AUREOLE_ERROR = 0.5
"""Error of the sun's elevation by the middle of an aureole, over its radius: it reaches further towards the horizon,
where the sky is brighter, than up."""
LARGEST_UNCERTAINTY_DEG = 20.0
"""Uncertainty [deg] beyond which a meridian of symmetry is refused."""


@dataclass(frozen=True)
class SunAzimuth:
    """azimuth_deg, uncertainty_deg: in the camera's azimuths, one standard deviation.  method: ``disc``, ``aureole``
    (the light about the sun is at the end of the scale) or ``symmetry``.
    elevation_deg, elevation_error_deg: apparent, of the disc or the middle of the aureole, else None.
    """

    azimuth_deg: float
    uncertainty_deg: float
    method: str
    elevation_deg: float | None = None
    elevation_error_deg: float = 0.0

    @property
    def disc_elevation_deg(self) -> float | None:
        """`true_elevation_deg` of a disc; None where none is seen."""
        return self.true_elevation_deg if self.method == "disc" else None

    @property
    def true_elevation_deg(self) -> float | None:
        """Elevation without standard refraction (Bennett 1982, J. Navigation 35, 255, eq. G: 0.07' from 0 deg up); None
        where neither disc nor aureole was found."""
        if self.elevation_deg is None:
            return None
        h = max(self.elevation_deg, -1.0)
        return self.elevation_deg - 1.0 / np.tan(np.radians(h + 7.31 / (h + 4.4))) / 60.0


def find_sun_azimuth(sky: PhotoSky, valid: np.ndarray, by_disc: bool = True) -> SunAzimuth:
    """The sun's azimuth in a photograph; valid (E, A): cells of clear sky (`mask.masked` without a sun).
    by_disc: False where what shines is known not to be the sun.

    The uncertainty of the symmetry is the scatter of what bands of elevation say one by one, at least a quarter of a
    cell.  Errors: TwilightError where too little of the sky has a mirror image, or the sky has no meridian of symmetry
    that stands out.
    """
    rows = sky.rows_deg
    above = valid & (rows[:, None] > 0)
    if not above.any():
        raise TwilightError("sun azimuth: no clear sky is left after masking; see the mask options")
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm = np.log(sky.luminance)
    bands = _bands(above)
    costs, overlaps = np.array([_mirror_cost(logarithm, above, rows, band) for band in bands]).swapaxes(0, 1)
    total = _mean_cost(costs, overlaps, _all_weight(above, rows))
    n = total.size
    if not np.isfinite(total).any():
        raise TwilightError("sun azimuth: too little of the photograph has a mirror image; give --sun-azimuth")
    best = _towards_the_light(total, logarithm, above, sky)
    symmetry = _axis_deg(sky, best + _vertex(total, best))
    scatter = _scatter(costs, overlaps, best, above, rows)
    uncertainty = float(np.hypot(scatter, 0.25 * sky.step_deg))
    contrast = np.nanmedian(total) / total[best % n]
    disc = _find_disc(sky, symmetry) if by_disc else None
    if disc is not None:
        return disc
    at_the_end = not np.isfinite(total[[(best - 1) % n, (best + 1) % n]]).all()  # a better one may lie beyond
    if contrast < 1.5 or uncertainty > LARGEST_UNCERTAINTY_DEG or n < 8 or at_the_end:
        raise TwilightError(
            f"sun azimuth: the sky has no clear meridian of symmetry (best guess {symmetry:.0f} +- {uncertainty:.0f} "
            "deg); give --sun-azimuth"
        )
    return SunAzimuth(symmetry, uncertainty, "symmetry")


def burnt_disc(sky: PhotoSky) -> SunAzimuth | None:
    """The sun by the largest round patch of the sky at the end of the picture's scale, or None."""
    there = sky.saturated & (sky.rows_deg > -1.0)[:, None]
    labels = labelled(there)
    if not labels.any():
        return None
    area = np.bincount(labels.ravel(), (np.cos(np.radians(sky.rows_deg))[:, None] * there).ravel())
    return _of_patch(sky, labels == int(area.argmax()))


def _of_patch(sky: PhotoSky, there: np.ndarray) -> SunAzimuth | None:
    """The sun in the middle of a round patch (E, A); None for one that is not round, too small or too large."""
    rows, columns = np.nonzero(there)
    n, step = sky.columns_deg.size, sky.step_deg
    offset = (columns - columns[0] + n // 2) % n - n // 2
    weight = np.cos(np.radians(sky.rows_deg[rows]))
    radius = float(step * np.sqrt(weight.sum() / np.pi))
    elevation = float(np.average(sky.rows_deg[rows], weights=weight))
    across = float(np.average(offset, weights=weight))
    azimuth = float(sky.origin_deg + sky.columns_deg[columns[0]] + step * across) % 360.0
    high, wide = np.ptp(rows) * step, np.ptp(offset) * step * np.cos(np.radians(elevation))
    if not LEAST_PATCH_DEG <= radius <= LARGEST_PATCH_DEG or max(high, wide) > 4.0 * radius + step or n < 8:
        return None
    error, disc = max(0.3 * step, 0.15 * radius), radius <= LARGEST_DISC_DEG
    upright = error if disc else AUREOLE_ERROR * radius
    beside = ndimage.binary_dilation(np.pad(there, ((0, 0), (1, 1)), mode="wrap"))[:, 1:-1]
    if np.count_nonzero(beside & ~there & ~sky.covered) * step > max(radius, 2.0 * step):
        error, disc, upright = LARGEST_PATCH_DEG, False, LARGEST_PATCH_DEG
    return SunAzimuth(azimuth, error, "disc" if disc else "aureole", elevation, upright)


def labelled(there: np.ndarray) -> np.ndarray:
    """Numbers of the connected parts (E, A), also across the first and last column; 0: none."""
    return join_across_north(ndimage.label(there, np.ones((3, 3)))[0])


def _bands(above: np.ndarray, count: int = 8) -> list[slice]:
    """Bands of rows that hold about equally many clear cells."""
    total = np.cumsum(above.sum(axis=1))
    edges = np.searchsorted(total, np.linspace(0, total[-1], count + 1)[1:-1])
    edges = np.unique(np.concatenate([[0], edges, [above.shape[0]]]))
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


def _mirror_cost(
    logarithm: np.ndarray, above: np.ndarray, rows: np.ndarray, band: slice
) -> tuple[np.ndarray, np.ndarray]:
    """For every axis k (A,): sum of squared differences between a band and its mirror image, and the weight of both.

    The mirror image about the axis k / 2 takes column j to (k - j) mod A, so all axes at half cells are exact, and the
    sums are circular convolutions: sum w (f_j - f_{k-j})^2 = 2 (w f^2 * w) - 2 (w f * w f) with w the clear cells.
    """
    w = above[band].astype(float)
    f = np.where(above[band], logarithm[band], 0.0)
    middle = f.sum() / max(w.sum(), 1.0)
    f = (f - middle) * w
    weight = np.cos(np.radians(rows[band]))[:, None]
    wt, ft, f2t = (np.fft.rfft(x, axis=1) for x in (w, f, f * f))
    n = w.shape[1]
    squares = np.fft.irfft(2 * f2t * wt - 2 * ft * ft, n, axis=1)
    pairs = np.fft.irfft(wt * wt, n, axis=1)
    return (weight * squares).sum(axis=0), (weight * pairs).sum(axis=0)


def _all_weight(above: np.ndarray, rows: np.ndarray) -> float:
    return float((above * np.cos(np.radians(rows))[:, None]).sum())


def _mean_cost(costs: np.ndarray, overlaps: np.ndarray, all_weight: float) -> np.ndarray:
    """Mean squared difference of every axis (A,), NaN where too little overlaps."""
    squares, overlap = np.sum(costs, axis=0), np.sum(overlaps, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(overlap > LEAST_OVERLAP * all_weight, squares / overlap, np.nan)
    return np.maximum(mean, 1e-9)


def _towards_the_light(total: np.ndarray, logarithm: np.ndarray, above: np.ndarray, sky: PhotoSky) -> int:
    """The best axis k: of the axes that are nearly as symmetric as the best, the one with the brightest low sky.

    An axis k is that of k / 2 and of k / 2 + A / 2, the two ends of the meridian: k runs over A values, and the end is
    chosen by the light.  Returned is k in 0..2A - 1, whose azimuth is k / 2 cells.
    """
    n = total.size
    finite = np.where(np.isfinite(total), total, np.inf)
    k = int(finite.argmin())
    rows = sky.rows_deg
    low = above & (rows[:, None] < max(30.0, float(rows[above.any(axis=1)].min()) + 10.0))
    ends = []
    for end in (k, k + n):
        axis_deg = sky.columns_deg[0] + 0.5 * end * sky.step_deg
        near = low & (separation_deg(0.0, sky.columns_deg, 0.0, axis_deg)[None, :] < 45.0)
        ends.append(logarithm[near].mean() if near.any() else -np.inf)
    return k if ends[0] >= ends[1] else k + n


def _vertex(total: np.ndarray, best: int, half_width: int = 8) -> float:
    """Where the minimum lies between the axes, by a parabola through its surroundings [axes]."""
    n = total.size
    offsets = np.arange(-half_width, half_width + 1)
    values = total[(best + offsets) % n]
    known = np.isfinite(values)
    if known.sum() < 5:
        return 0.0
    a, b, _ = np.polyfit(offsets[known], values[known], 2)
    return float(np.clip(-b / (2 * a), -half_width, half_width)) if a > 0 else 0.0


def _axis_deg(sky: PhotoSky, k: float) -> float:
    """Azimuth of the axis k in the camera's azimuths, [0, 360)."""
    return float(np.mod(sky.origin_deg + sky.columns_deg[0] + 0.5 * k * sky.step_deg, 360.0))


def _scatter(costs: np.ndarray, overlaps: np.ndarray, best: int, above: np.ndarray, rows: np.ndarray) -> float:
    """Standard deviation of the axis [deg] by the jackknife over bands of elevation."""
    found = []
    step = 360.0 / above.shape[1]
    all_weight = _all_weight(above, rows)
    for left_out in range(len(costs)):
        part = all_weight * (len(costs) - 1) / len(costs)
        total = _mean_cost(np.delete(costs, left_out, axis=0), np.delete(overlaps, left_out, axis=0), part)
        n = total.size
        near = (best + np.arange(-n // 8, n // 8 + 1)) % n
        values = np.where(np.isfinite(total[near]), total[near], np.inf)
        if not np.isfinite(values).any():
            continue
        k = near[int(values.argmin())]
        away = (k - best + n // 2) % n - n // 2 + _vertex(total, int(k))
        found.append(0.5 * step * away)
    if len(found) < 2:
        return 90.0
    m = len(found)
    return float(np.sqrt((m - 1) / m * ((found - np.mean(found)) ** 2).sum()))


def _find_disc(sky: PhotoSky, symmetry_deg: float) -> SunAzimuth | None:
    """The sun's disc, or the aureole at the end of the scale, near the meridian, or None."""
    light = np.where(np.isfinite(sky.luminance), sky.luminance, 0.0)
    light = np.where(sky.rows_deg[:, None] > -1.0, light, 0.0)
    light[sky.saturated] = light.max() * 1.5
    azimuth = sky.columns_deg + sky.origin_deg
    from_meridian = np.abs(np.mod(azimuth - symmetry_deg + 180.0, 360.0) - 180.0)
    near = np.where(from_meridian[None, :] < DISC_NEAR_DEG, light, 0.0)
    row, column = np.unravel_index(int(near.argmax()), near.shape)
    peak = near[row, column]
    labels = labelled(light >= (1.0 - 1e-6) * peak)
    level = labels == labels[row, column]
    if float((np.cos(np.radians(sky.rows_deg)) @ level).sum()) * sky.step_deg**2 > LARGEST_DISC_SQUARE:
        return _of_patch(sky, level)
    away = separation_deg(sky.rows_deg[:, None], azimuth[None, :], sky.rows_deg[row], azimuth[column])
    ring = (away > 5.0) & (away < 8.0) & (light > 0) & (sky.rows_deg[:, None] > 0)
    if not ring.any() or not np.log(peak / np.median(light[ring])) > DISC_CONTRAST:
        return None
    disc = (away < 3.0) & (light > 0.5 * peak)
    weight = light * disc * np.cos(np.radians(sky.rows_deg))[:, None]
    offset = np.mod(azimuth - azimuth[column] + 180.0, 360.0) - 180.0
    found = azimuth[column] + float((weight * offset[None, :]).sum() / weight.sum())
    elevation = float((weight * sky.rows_deg[:, None]).sum() / weight.sum())
    spread = float(np.sqrt((weight * offset[None, :] ** 2).sum() / weight.sum() - (found - azimuth[column]) ** 2))
    error = max(0.3 * sky.step_deg, 0.3 * spread)
    return SunAzimuth(float(np.mod(found, 360.0)), error, "disc", elevation, error)
