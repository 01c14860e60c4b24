"""The disc of a body as the observer sees it, the sun's darkened to its limb: flattened, coloured, cut off by the air.

The disc is a layer of its own, never a part of the sky's radiance.  It holds what the refracted paths say of every
apparent elevation: from which true elevation the light of a wavelength comes, and how much of it.  Along a path
radiance over n^2 is conserved but for extinction, so the picture of the disc is that of the disc above the air, each
line of sight followed backwards; irradiance, flattening, dispersion and mirages follow from it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.polynomial.polynomial import polyval

from twilight.base.errors import TwilightError
from twilight.numerics.directions import azimuth_elevation, direction

SOLAR_RADIUS_DEG = 959.63 / 3600.0
"""Angular radius of the sun at 1 au [deg] (Auwers; IAU 1976)."""

LIMB_RANGE_NM = (300.0, 1100.0)
"""Range of the fits to limb darkening [nm]; its ends stand for wavelengths beyond."""

PIXELS_AT_ONCE = 512
"""Pixels of a picture whose points are worked on at once: it bounds memory."""

_LIMB_BANDS_NM = (372.98, 422.57)
"""Wavelengths [nm] at which one of the three fits of `_LIMB` follows on another."""
# rows: A0 .. A5; columns: constant, of 1/wavelength, of 1/wavelength^5 (wavelength in um)
_LIMB = (
    np.array(
        [
            [0.35601, -0.085217, 0.0],
            [1.11529, 0.085217, -0.001871],
            [-0.67237, 0.0, 0.003589],
            [0.18696, 0.0, -0.002415],
            [0.00038, 0.0, 0.000897],
            [0.01373, 0.0, -0.000200],
        ]
    ),
    np.array(
        [
            [0.09900, 0.010643, 0.0],
            [1.96884, -0.010643, -0.009166],
            [-2.80511, 0.0, 0.024873],
            [3.32780, 0.0, -0.029317],
            [-2.17878, 0.0, 0.018273],
            [0.58825, 0.0, -0.004663],
        ]
    ),
    np.array(
        [
            [0.75267, -0.265577, 0.0],
            [0.93874, 0.265577, -0.004095],
            [-1.89287, 0.0, 0.012582],
            [2.42234, 0.0, -0.017117],
            [-1.71150, 0.0, 0.011977],
            [0.49062, 0.0, -0.003347],
        ]
    ),
)


def limb_coefficients(wavelength_nm: np.ndarray) -> np.ndarray:
    """Coefficients (6, W) of I(mu)/I(1) = sum of A_k mu^k; mu is the cosine of the angle to the sun's surface normal.

    Neckel 2005 (Solar Physics 229, 13), closed forms fitted to Neckel and Labs 1994 (Solar Physics 153, 91), for 300 to
    1100 nm, whose ends stand beyond, and mu above 0.1; nearer to the limb they are continued.  Continuum: lines are
    darkened less.
    """
    nm = np.clip(np.atleast_1d(np.asarray(wavelength_nm, float)), *LIMB_RANGE_NM)
    um = nm / 1000.0
    powers = np.stack([np.ones_like(um), 1.0 / um, um**-5.0])
    band = np.searchsorted(_LIMB_BANDS_NM, nm)
    return np.stack([_LIMB[b] @ powers[:, i] for i, b in enumerate(band)], axis=1)


def limb_darkening(mu: np.ndarray, wavelength_nm: np.ndarray) -> np.ndarray:
    """I(mu)/I(1), shape of mu (its last axis the W wavelengths, or 1)."""
    return polyval(np.asarray(mu, float), limb_coefficients(wavelength_nm), tensor=False)


def mean_limb_darkening(wavelength_nm: np.ndarray) -> np.ndarray:
    """Mean of I(mu)/I(1) over the disc, (W,): 2 integral of I mu dmu."""
    a = limb_coefficients(wavelength_nm)
    return 2.0 * (a / (np.arange(6) + 2.0)[:, None]).sum(axis=0)


@dataclass(frozen=True, eq=False)
class Disc:
    """What the air does to the light of the sun's disc, or of another body's, H apparent elevations, W wavelengths.

    wavelength_nm (W,); elevation_deg (H,): apparent, uniform and increasing, over all of the disc's image.
    true_elevation_deg (H, W): where the light of a line of sight comes from; transmittance (H, W): times the square of
        the observer's refractive index, 0 where the line of sight meets the ground or is caught in a duct.
    body_elevation_deg: true, of the centre; radius_deg: angular, of the disc above the air.
    """

    ACROSS: ClassVar[int] = 12
    """Nodes from limb to limb of an integral over a row."""
    wavelength_nm: np.ndarray
    elevation_deg: np.ndarray
    true_elevation_deg: np.ndarray
    transmittance: np.ndarray
    body_elevation_deg: float
    radius_deg: float

    def __post_init__(self) -> None:
        shape = (self.elevation_deg.size, self.wavelength_nm.size)
        for key in ("true_elevation_deg", "transmittance"):
            value = getattr(self, key)
            if value.shape != shape or not np.isfinite(value).all():
                raise TwilightError(f"disc: {key} must have shape {shape} and be finite")

    @property
    def is_seen(self) -> bool:
        """Whether any part of the disc, lit or not, is above the horizon."""
        return bool(np.isfinite(self.edges_deg()[0]))

    def radiance(self, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Radiance over F0 [sr^-1] in apparent directions (azimuth from the sun), broadcast shape plus (W,)."""
        elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        out = np.zeros((elevation.size, self.wavelength_nm.size))
        widest = self.radius_deg / max(np.cos(np.radians(min(abs(self.body_elevation_deg) + 1.0, 89.9))), 1e-3) + 0.1
        around = np.mod(azimuth.ravel() + 180.0, 360.0) - 180.0
        low, high = self.elevation_deg[[0, -1]]
        near = np.flatnonzero((elevation.ravel() >= low) & (elevation.ravel() <= high) & (np.abs(around) <= widest))
        if near.size:
            true, passed = self.along(elevation.ravel()[near])
            out[near] = self._above_the_air(true, around[near][:, None]) * passed
        return out.reshape(*elevation.shape, self.wavelength_nm.size)

    def in_pixels(
        self, rays: np.ndarray, down: np.ndarray, right: np.ndarray, azimuth_deg: float, points: int
    ) -> Iterator[tuple[tuple[np.ndarray, np.ndarray], np.ndarray, np.ndarray]]:
        """What pixels (height, width) see of it, some at a time: their rows and columns, its radiance over F0 (N, W),
        the mean of points x points directions, and the part of each that it covers (N,).

        rays (height, width, 3): unit vectors, NaN outside the picture; down, right: from each to the next pixel's;
        azimuth_deg: of its centre, as the rays'.
        """
        if not self.is_seen:
            return
        lower, upper = self.edges_deg()
        wide = np.linalg.norm(down, axis=-1) + np.linalg.norm(right, axis=-1)
        reach = np.radians(0.5 * (upper - lower) + 1.1 * self.radius_deg) + wide
        chord = np.linalg.norm(rays - direction(azimuth_deg, 0.5 * (lower + upper)), axis=-1)
        rows, columns = np.nonzero(chord < reach)
        step = (np.arange(points) + 0.5) / points - 0.5
        for start in range(0, rows.size, PIXELS_AT_ONCE):
            pixels = rows[start : start + PIXELS_AT_ONCE], columns[start : start + PIXELS_AT_ONCE]
            ray, d, r = (each[pixels][:, None, None].astype(float) for each in (rays, down, right))
            azimuth, elevation = azimuth_elevation(ray + d * step[:, None, None] + r * step[:, None])
            light = self.radiance(elevation, azimuth - azimuth_deg)
            yield pixels, light.mean(axis=(1, 2)), (light.max(axis=-1) > 0.0).mean(axis=(1, 2))

    def dimmed(self, factor: float) -> Self:
        """The disc behind a filter."""
        return replace(self, transmittance=factor * self.transmittance)

    def irradiance_factor(self) -> np.ndarray:
        """Irradiance of the disc on a surface that faces it, over F0, (W,): the integral of its radiance."""
        rows = self.rows()
        return rows.sum(axis=0) if rows.size else np.zeros(self.wavelength_nm.size)

    def rows(self) -> np.ndarray:
        """Irradiance over F0 that each apparent elevation brings, (H, W).

        Over the azimuth by Gauss and Legendre in the angle whose sine goes from limb to limb.
        """
        node, weight = np.polynomial.legendre.leggauss(self.ACROSS)
        half = self.half_width_deg()
        angle = 0.5 * np.pi * node
        azimuth = half[..., None] * np.sin(angle)
        value = self._above_the_air(self.true_elevation_deg[..., None], azimuth, at=(slice(None), None))
        across = (value * (0.5 * np.pi * np.cos(angle) * weight)).sum(axis=-1) * np.radians(half)
        step = np.radians(self.elevation_deg[1] - self.elevation_deg[0])
        return across * self.transmittance * np.cos(np.radians(self.elevation_deg))[:, None] * step

    def half_width_deg(self) -> np.ndarray:
        """Azimuth of the limb from the sun's vertical [deg], (H, W), 0 where a line of sight misses the disc."""
        t, s, r = (np.radians(x) for x in (self.true_elevation_deg, self.body_elevation_deg, self.radius_deg))
        # cos r = cos(t - s) - cos t cos s (1 - cos a), in half angles to keep the digits
        inside = np.maximum(np.sin(r / 2) ** 2 - np.sin((t - s) / 2) ** 2, 0.0) / (np.cos(t) * np.cos(s))
        return np.degrees(2.0 * np.arcsin(np.sqrt(np.clip(inside, 0.0, 1.0))))

    def edges_deg(self) -> tuple[float, float]:
        """Lower and upper apparent edge [deg] of what is seen of the disc, at any wavelength; NaN where nothing is."""
        visible = ((self.half_width_deg() > 0.0) & (self.transmittance > 0.0)).any(axis=1)
        if not visible.any():
            return float("nan"), float("nan")
        step = 0.5 * (self.elevation_deg[1] - self.elevation_deg[0])
        where = self.elevation_deg[visible]
        return float(where[0] - step), float(where[-1] + step)

    def centroid_deg(self) -> float:
        """Apparent elevation [deg] from which its light comes in the mean of all wavelengths; NaN where none does."""
        rows = self.rows().sum(axis=1)
        return float((rows * self.elevation_deg).sum() / rows.sum()) if rows.any() else float("nan")

    def at_wavelengths(self, wavelength_nm: np.ndarray) -> Self:
        """The disc at other wavelengths, with elevations and the logarithm of the transmittance interpolated.

        Each wavelength has an edge of its own, so that colours of the edge (the green rim) need many wavelengths; what
        the air does changes slowly with the wavelength.  Beyond its range the outermost values hold.
        """
        nm = np.atleast_1d(np.asarray(wavelength_nm, float))
        i = np.clip(np.searchsorted(self.wavelength_nm, nm, side="right") - 1, 0, max(self.wavelength_nm.size - 2, 0))
        j = np.minimum(i + 1, self.wavelength_nm.size - 1)
        gap = self.wavelength_nm[j] - self.wavelength_nm[i]
        f = np.clip((nm - self.wavelength_nm[i]) / np.where(gap > 0, gap, 1.0), 0.0, 1.0)
        # n - 1 and scattering go like powers of the wavelength: linear in 1/wavelength^2 for the bending
        with np.errstate(divide="ignore", invalid="ignore"):
            squared = (self.wavelength_nm[i] ** -2.0 - nm**-2.0) / (
                self.wavelength_nm[i] ** -2.0 - self.wavelength_nm[j] ** -2.0
            )
        g = np.where(gap > 0, np.clip(np.nan_to_num(squared), 0.0, 1.0), 0.0)
        true = self.true_elevation_deg[:, i] * (1 - g) + self.true_elevation_deg[:, j] * g
        a, b = self.transmittance[:, i], self.transmittance[:, j]
        both = (a > 0) & (b > 0)
        with np.errstate(divide="ignore"):
            passed = np.exp(np.log(np.where(both, a, 1.0)) * (1 - f) + np.log(np.where(both, b, 1.0)) * f)
        return replace(self, wavelength_nm=nm, true_elevation_deg=true, transmittance=np.where(both, passed, 0.0))

    def along(self, elevation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """True elevation and transmittance (N, W) at apparent elevations (N,), between the rows."""
        step = self.elevation_deg[1] - self.elevation_deg[0]
        position = np.clip((elevation - self.elevation_deg[0]) / step, 0.0, self.elevation_deg.size - 1.0)
        low = np.minimum(position.astype(int), self.elevation_deg.size - 2)
        f = (position - low)[:, None]
        open_to = (self.transmittance[low] > 0) & (self.transmittance[low + 1] > 0)
        # an edge of what is seen lies half-way between two rows, of which one says nothing of the sky
        f = np.where(open_to, f, np.round(f))
        true, passed = (v[low] * (1 - f) + v[low + 1] * f for v in (self.true_elevation_deg, self.transmittance))
        return true, passed

    def _above_the_air(self, true_deg: np.ndarray, azimuth_deg: np.ndarray, at: tuple | None = None) -> np.ndarray:
        """Radiance over F0 [sr^-1] of the disc without air; at: index that aligns wavelengths with the arguments."""
        t, s, a, r = (np.radians(x) for x in (true_deg, self.body_elevation_deg, azimuth_deg, self.radius_deg))
        # squared half-chord to the centre, which keeps its digits
        chord = np.sin((t - s) / 2) ** 2 + np.cos(t) * np.cos(s) * np.sin(a / 2) ** 2
        sine = 4.0 * chord * (1.0 - chord) / np.sin(r) ** 2
        inside = (sine <= 1.0) & (chord < 0.5)
        mu = np.sqrt(np.clip(1.0 - sine, 0.0, 1.0))
        coefficients = limb_coefficients(self.wavelength_nm)
        norm = mean_limb_darkening(self.wavelength_nm) * np.pi * np.sin(r) ** 2
        if at is not None:
            coefficients, norm = coefficients[(slice(None), *at)], norm[at]
        return np.where(inside, polyval(mu, coefficients, tensor=False) / norm, 0.0)
