"""Derivatives of the light of the model of clear air.

The model is smooth in its inputs, and evaluates all wavelengths at once: the medium of one wavelength and the same
with a little more of each parameter stand as wavelengths, so N derivatives cost one air of N + 1 wavelengths.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from twilight.atmosphere.layer_changes import Changes, Shifted, changes_of
from twilight.base.errors import TwilightError
from twilight.solvers.compact.air_columns import AirColumns
from twilight.solvers.compact.clear_air_field import ClearAirField
from twilight.solvers.compact.clear_air_sky import ClearAirSkies


class Derivatives:
    """Derivatives of the light of a field by N parameters."""

    def __init__(self, field: ClearAirField, changes: Changes):
        self._field, self._changes = field, changes
        self._skies: dict[float, list[ClearAirSkies]] = {}

    def log_slopes(
        self,
        sun_elevation_deg: ArrayLike,
        elevation_deg: ArrayLike,
        azimuth_deg: ArrayLike,
        *,
        observer_altitude_km: float | None = None,
    ) -> tuple[np.ndarray, None]:
        """d ln I / dp, shape of the broadcast suns and directions plus (N, W); there is no standard error."""
        suns, elevation, azimuth = np.broadcast_arrays(
            *(np.asarray(a, float) for a in (sun_elevation_deg, elevation_deg, azimuth_deg))
        )
        above_km = self._field.observer_above_km(observer_altitude_km)
        if above_km not in self._skies:
            self._skies = {above_km: [self._skies_at(w, above_km) for w in range(self._changes.base.n_wavelengths)]}
        out = np.empty((suns.size, self._changes.n, self._changes.base.n_wavelengths))
        for sun in np.unique(suns):
            here = np.flatnonzero(suns.ravel() == sun)
            where = elevation.ravel()[here], azimuth.ravel()[here]
            for w, skies in enumerate(self._skies[above_km]):
                light = np.log(skies.sky(float(sun)).light(*where, on_grid=False)[:, 0])
                out[here, :, w] = (light[:, 1:] - light[:, :1]) / self._changes.step[:, w]
        return out.reshape(*suns.shape, *out.shape[1:]), None

    def _skies_at(self, w: int, above_km: float) -> ClearAirSkies:
        """The skies of wavelength w without and with each change, each of which stands as a wavelength."""
        columns, _ = self._changes.columns(w)
        return ClearAirSkies(self._field.model, AirColumns.of(columns), above_km)


def differentiate(field: object, quantity: str, edges_km: np.ndarray, shifted: Shifted | None = None) -> Derivatives:
    """Derivatives by one of `solvers.base.DIFFERENTIATED` in the layers between edges_km (J + 1,) [km].

    shifted: as of `changes_of`
    Errors: TwilightError for the model of one climate, which has no layers, for temperature, which changes the
    refraction that all columns share, and for edges that are none.
    """
    if quantity == "temperature":
        raise TwilightError("derivatives: compact cannot differentiate by temperature; zones can")
    if not isinstance(field, ClearAirField):
        raise TwilightError("derivatives: of the compact models clear-air alone has derivatives (solver.model)")
    return Derivatives(field, changes_of(field.medium, quantity, edges_km, shifted))
