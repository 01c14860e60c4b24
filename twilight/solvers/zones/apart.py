"""Wavelengths that need different grids: a field for each group of them, seen as one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.solvers.base import BareField, Convergence
from twilight.solvers.zones.alike import alike
from twilight.solvers.zones.field import Field
from twilight.solvers.zones.settings import ZonesSettings


def groups(medium: Medium, settings: ZonesSettings) -> list[np.ndarray]:
    """Places of the wavelengths that share a field, group by group, in the sequence of their first ones.

    One moves another by per cents where both take the grids that either needs: `alike` says which need the same.  A
    wavelength that is there several times is one of a gas's bands, whose lanes stay together; a file holds one field.
    """
    count = medium.n_wavelengths
    if count == 1 or settings.field_file or np.unique(medium.wavelength_nm).size < count:
        return [np.arange(count)]
    places: dict[bytes, list[int]] = {}
    for w, key in enumerate(alike(medium, settings)):
        places.setdefault(key, []).append(w)
    return [np.array(some) for some in places.values()]


@dataclass(frozen=True)
class Part:
    """A field, and the places of its wavelengths (N,) in those that were asked for."""

    lanes: np.ndarray
    field: Field


class FieldsApart(BareField):
    """What a `Field` answers, from several of them."""

    def __init__(self, medium: Medium, settings: ZonesSettings, parts: list[Part]) -> None:
        self.medium, self.settings, self.parts = medium, settings, parts
        known = [part.field.convergence for part in parts if part.field.convergence is not None]
        if known:
            errors = [c.error for c in known if c.error is not None]
            events, residual = max(c.events for c in known), max(c.residual for c in known)
            self.convergence = Convergence(events, residual, max(errors) if errors else None)

    @property
    def observer_altitude_km(self) -> float:
        """Where the fields are seen from if they are not told otherwise."""
        return self.parts[0].field.observer_altitude_km

    @property
    def sun_range_deg(self) -> tuple[float, float]:
        """As of `Field`: it follows from the medium's levels, which all share."""
        return self.parts[0].field.sun_range_deg

    @property
    def polarised(self) -> bool:
        """Whether they were solved with polarisation."""
        return self.settings.polarisation

    def _merged(self, answer: Callable[[Field], np.ndarray]) -> np.ndarray:
        """Answers with a last axis of wavelengths, put together."""
        found = [answer(part.field) for part in self.parts]
        out = np.empty((*found[0].shape[:-1], self.medium.n_wavelengths))
        for part, values in zip(self.parts, found, strict=True):
            out[..., part.lanes] = values
        return out

    def radiance(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """As `Field.radiance`."""
        where = (sun_elevation_deg, elevation_deg, azimuth_deg)
        return self._merged(lambda field: field.radiance(*where, observer_altitude_km=observer_altitude_km))

    def stokes(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float | None = None
    ) -> np.ndarray:
        """As `Field.stokes`."""
        where = (sun_elevation_deg, elevation_deg, azimuth_deg)
        return self._merged(lambda field: field.stokes(*where, observer_altitude_km=observer_altitude_km))

    def inscatter(
        self,
        sun_elevation_deg: float,
        elevation_deg,
        azimuth_deg,
        distance_km,
        *,
        observer_altitude_km: float | None = None,
        peak_passes: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """As `Field.inscatter`."""
        both = self._merged(
            lambda field: np.stack(
                field.inscatter(
                    sun_elevation_deg, elevation_deg, azimuth_deg, distance_km,
                    observer_altitude_km=observer_altitude_km, peak_passes=peak_passes,
                )
            )
        )  # fmt: skip
        return both[0], both[1]
