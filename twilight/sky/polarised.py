"""Methods of `Sky` that give the polarisation of its light, and how values of a sky's own grid are read anywhere."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from twilight.base.arguments import in_units
from twilight.base.errors import TwilightError
from twilight.sky.table import SkyTable


@in_units
class PolarisedSky:
    """The polarisation of a sky: what each method needs of it is declared below."""

    if TYPE_CHECKING:
        elevation_deg: np.ndarray
        azimuth_deg: np.ndarray
        sun_normalised_radiance: np.ndarray
        polarisation: np.ndarray | None

        @property
        def normalised_radiance(self) -> np.ndarray: ...

    @property
    def stokes(self) -> np.ndarray:
        """Sun-normalised Stokes parameters I, Q, U [sr^-1], (E, A, 3, W); TwilightError where Q and U are unknown."""
        return np.concatenate([self.sun_normalised_radiance[..., None, :], self._known_polarisation], axis=2)

    @property
    def _known_polarisation(self) -> np.ndarray:
        if self.polarisation is None:
            raise TwilightError(
                "this sky has no Stokes parameters: they need solver.polarisation true (solver zones or montecarlo)"
            )
        return self.polarisation

    @property
    def fractional_stokes(self) -> np.ndarray:
        """Q and U over the radiance of sun and night together, (E, A, 2, W); the night counts as unpolarised."""
        total = self.normalised_radiance[..., None, :]
        stokes = self._known_polarisation
        return np.divide(stokes, total, out=np.zeros(stokes.shape), where=~(total <= 0))

    @property
    def degree_of_linear_polarisation(self) -> np.ndarray:
        """sqrt(Q^2 + U^2) / I of sun and night together, (E, A, W)."""
        return np.linalg.norm(self.fractional_stokes, axis=2)

    @property
    def angle_of_linear_polarisation_deg(self) -> np.ndarray:
        """Angle of vibration [deg], (E, A, W), -90 to 90: from the vertical plane through the line of sight, clockwise
        for somebody who looks along it, that is towards larger azimuth."""
        q, u = np.moveaxis(self._known_polarisation, 2, 0)
        return 0.5 * np.degrees(np.arctan2(u, q))

    def through_polariser(self, angle_deg: float) -> Self:
        """The sky behind an ideal linear polariser, (I + Q cos 2t + U sin 2t) / 2, its axis at t from the vertical.

        angle_deg: as `angle_of_linear_polarisation_deg`; it is counted in every line of sight from its own vertical, as
        when the polariser is turned to each of them.  Half of the night and of the beams of sun and moon passes.
        """
        t = np.radians(2.0 * angle_deg)
        q, u = np.moveaxis(self._known_polarisation, 2, 0)
        passed = 0.5 * (self.sun_normalised_radiance + q * np.cos(t) + u * np.sin(t))
        sky: Any = self
        return replace(
            sky,
            sun_normalised_radiance=np.maximum(passed, 0.0),
            standard_error=None,
            polarisation=None,
            polarisation_error=None,
            night_radiance=None if sky.night_radiance is None else 0.5 * sky.night_radiance,
            lights={name: 0.5 * values for name, values in sky.lights.items()},
            direct_irradiance=None if sky.direct_irradiance is None else 0.5 * sky.direct_irradiance,
            disc=None if sky.disc is None else sky.disc.dimmed(0.5),
            moon=None if sky.moon is None else sky.moon.dimmed(0.5),
        )

    def sample_fractional_stokes(self, elevation_deg, azimuth_deg, part: slice = slice(None)) -> np.ndarray:
        """`fractional_stokes` in any direction, (..., 2, W), at a part of the wavelengths."""
        both = self.fractional_stokes[..., part]
        both = nearest_known(both.reshape(*both.shape[:2], -1))
        table = SkyTable.of_signed(self.elevation_deg, self.azimuth_deg, both)
        fractions = read_table(table, np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        return fractions.reshape(*fractions.shape[:-1], 2, -1)


def nearest_known(values: np.ndarray) -> np.ndarray:
    """Values (E, A, K) of a grid that goes all round, with the nearest sample's in place of nan; 0 if all are nan."""
    unknown = np.isnan(values)
    if not unknown.any():
        return values
    from scipy.ndimage import distance_transform_edt  # start-up

    values = values.copy()
    for k in np.flatnonzero(unknown.any(axis=(0, 1))):
        if unknown[..., k].all():
            values[..., k] = 0.0
            continue
        round_twice = np.concatenate([unknown[..., k]] * 3, axis=1)
        row, column = distance_transform_edt(round_twice, return_distances=False, return_indices=True)
        middle = slice(values.shape[1], 2 * values.shape[1])
        values[..., k] = values[row[:, middle], column[:, middle] % values.shape[1], k]
    return values


def read_table(table: SkyTable, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
    """Values of a table in broadcast directions, (..., K)."""
    if elevation_deg.ndim == azimuth_deg.ndim == 2 and elevation_deg.shape[1] == azimuth_deg.shape[0] == 1:
        return table.on_grid(elevation_deg[:, 0], azimuth_deg[0])
    return table.light(elevation_deg, azimuth_deg)
