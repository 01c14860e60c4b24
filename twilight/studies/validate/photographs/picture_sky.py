"""The sky of a picture: its colours on the texture of a computed one, in cells of elevation and azimuth from the sun.

A photograph has no spectrum, so both skies become XYZ (CIE 1931, which camera profiles are made for): luminance in the
photograph's own scale and chromaticity, NaN where masked.  A cell of the photograph is the mean of its clear fine
cells, and the computed sky is averaged over the very same ones, so a cell half behind a tree compares like with like.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.sky import Sky
from twilight.studies.validate.photographs.mask import Mask
from twilight.studies.validate.photographs.panorama import Panorama

OBSERVER = "cie1931_2deg"
LEAST_CLEAR_FRACTION = 0.5
"""A cell counts where at least this fraction of its fine cells is clear sky."""
LEAST_CELLS = 20
"""Cells of clear sky that a comparison needs."""
HIGHLIGHT = 0.7
"""Stored linear light, 218 of 255 in sRGB, from which on a channel's curve is too flat to be undone."""


@dataclass(frozen=True, eq=False)
class PhotoSky:
    """The colours of a sky on its texture, NaN where not known: a photograph, or a sky seen through its mask.

    elevation_deg (E,), azimuth_deg (A,): cell centres, azimuths relative to the sun.
    xyz (E, A, 3): luminance in Y, in the photograph's scale (or cd m^-2 for a computed sky).
    solid_angle_sr (E, A): of the clear part of every cell, 0 where it does not count.
    fine_xyz (e, a, 3), fine_valid (e, a), fine_elevation_deg (e,), fine_azimuth_deg (a,): the same above the horizon on
        the fine grid, not masked, and where that is clear sky.
    panorama, mask: what they were made from, from a little below the horizon up.
    colour_known: False for a grey photograph.
    """

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    xyz: np.ndarray
    solid_angle_sr: np.ndarray
    fine_xyz: np.ndarray
    fine_valid: np.ndarray
    fine_elevation_deg: np.ndarray
    fine_azimuth_deg: np.ndarray
    panorama: Panorama
    mask: Mask
    colour_known: bool = True

    @property
    def counts(self) -> np.ndarray:
        """(E, A): the cell takes part in the comparison."""
        return self.solid_angle_sr > 0


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of a photograph that stand for equal parts of its clear sky; what is compared of them is as of `PhotoSky`.

    elevation_deg, azimuth_deg (n,): middle of the clear part of each, azimuth from the sun.
    xyz (n, 3), solid_angle_sr (n,).  spread_deg (2, n): standard deviations of elevation and azimuth over it.
    """

    elevation_deg: np.ndarray
    azimuth_deg: np.ndarray
    xyz: np.ndarray
    solid_angle_sr: np.ndarray
    colour_known: bool = True
    spread_deg: np.ndarray | float = 0.0

    @property
    def counts(self) -> np.ndarray:
        """(n,): the cell takes part in the comparison."""
        return self.solid_angle_sr > 0

    def below_white(self) -> Cells:
        """Those whose channels are below HIGHLIGHT, or in the darker half: of the rest a camera's curve says little."""
        brightest = colour.xyz_to_linear_rgb(self.xyz, OBSERVER).max(axis=-1)
        keep = brightest < max(HIGHLIGHT, float(np.median(brightest)))
        spread = self.spread_deg if np.ndim(self.spread_deg) == 0 else np.asarray(self.spread_deg)[:, keep]
        arrays = {key: getattr(self, key)[keep] for key in ("elevation_deg", "azimuth_deg", "xyz", "solid_angle_sr")}
        return replace(self, spread_deg=spread, **arrays)

    @classmethod
    def of(cls, photo: PhotoSky, most: int) -> Cells:
        """At most so many of the cells that count, spread evenly over the clear sky."""
        rows, columns = photo.fine_elevation_deg, photo.fine_azimuth_deg
        shape = photo.fine_valid.shape
        middle = np.stack([np.broadcast_to(rows[:, None], shape), np.broadcast_to(columns, shape)], axis=-1)
        k = rows.size // photo.elevation_deg.size
        both = np.concatenate([middle, middle**2], axis=-1)
        where, _ = _average(both, photo.fine_valid, rows, k, 90.0 / rows.size)
        weight = photo.solid_angle_sr[photo.counts]
        chosen = np.arange(weight.size)
        if weight.size > most:
            passed = np.cumsum(weight)
            chosen = np.unique(np.searchsorted(passed, (np.arange(most) + 0.5) / most * passed[-1]))
            weight = np.full(weight.size, passed[-1] / chosen.size)
        e, a, *squares = where[photo.counts][chosen].T
        spread = np.sqrt(np.maximum(np.array(squares) - np.array([e, a]) ** 2, 0.0))
        return cls(e, a, photo.xyz[photo.counts][chosen], weight[chosen], photo.colour_known, spread)


def photo_sky(panorama: Panorama, mask: Mask, cell_deg: float) -> PhotoSky:
    """A panorama whose origin is the sun's azimuth, averaged over the clear fine cells of every cell.

    mask: on the panorama's grid (``mask.make_mask``).  Errors: TwilightError where hardly any sky is left.
    """
    above = panorama.elevation_deg > 0
    to_xyz = np.linalg.inv(spectrum.xyz_to_rgb_matrix(OBSERVER))
    fine = panorama.rgb[above] @ to_xyz.T
    with np.errstate(invalid="ignore"):
        clear = mask.valid[above] & (fine[..., 1] > 0)
    k = round(cell_deg / panorama.step_deg)
    rows = panorama.elevation_deg[above]
    xyz, solid_angle = _average(fine, clear, rows, k, panorama.step_deg)
    if (solid_angle > 0).sum() < LEAST_CELLS:
        raise TwilightError(
            f"photo: only {(solid_angle > 0).sum()} cells of {cell_deg:g} deg hold clear sky after masking, and "
            f"{LEAST_CELLS} are needed; see the mask options"
        )
    return PhotoSky(
        elevation_deg=rows.reshape(-1, k).mean(axis=1),
        azimuth_deg=np.arange(panorama.azimuth_deg.size // k) * cell_deg,
        xyz=xyz,
        solid_angle_sr=solid_angle,
        fine_xyz=fine,
        fine_valid=clear,
        fine_elevation_deg=rows,
        fine_azimuth_deg=panorama.azimuth_deg,
        panorama=panorama,
        mask=mask,
        colour_known=not panorama.grey,
    )


def simulated_sky(sky: Sky, photo: PhotoSky) -> PhotoSky:
    """The computed sky on the grid of a photograph, averaged over the same clear fine cells; Y in cd m^-2."""
    fine, averaged = seen_as(photo, sky, colour.sky_to_xyz(sky, observer=OBSERVER))
    return replace(photo, xyz=averaged, fine_xyz=fine, colour_known=colour.colour_is_defined(sky.wavelength_nm))


def seen_as(photo: PhotoSky, sky: Sky, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """XYZ, of one sky or more, on the grid of ``sky`` taken to the fine grid (e, a, N) and the cells (E, A, N) of a
    photograph."""
    rows, columns = photo.fine_elevation_deg, photo.fine_azimuth_deg
    fine = np.asarray(sky.smooth(xyz, rows[:, None], columns[None, :]), float)
    k = rows.size // photo.elevation_deg.size
    averaged, _ = _average(fine, photo.fine_valid, rows, k, 90.0 / rows.size)
    return fine, averaged


def _average(
    fine: np.ndarray, clear: np.ndarray, rows_deg: np.ndarray, k: int, step_deg: float
) -> tuple[np.ndarray, np.ndarray]:
    """Means (E, A, N) over clear fine cells (e, a, N) by solid angle, NaN where too few; their solid angle (E, A)."""
    weight = clear * np.cos(np.radians(rows_deg))[:, None]
    e, a = fine.shape[0] // k, fine.shape[1] // k
    total = np.where(clear[..., None], fine, 0.0) * weight[..., None]
    total = total.reshape(e, k, a, k, -1).sum(axis=(1, 3))
    weights = weight.reshape(e, k, a, k).sum(axis=(1, 3))
    enough = clear.reshape(e, k, a, k).mean(axis=(1, 3)) >= LEAST_CLEAR_FRACTION
    with np.errstate(divide="ignore", invalid="ignore"):
        xyz = np.where(enough[..., None], total / weights[..., None], np.nan)
    return xyz, np.where(enough, weights, 0.0) * np.radians(step_deg) ** 2
