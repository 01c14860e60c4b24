"""A constraint of astroplan's: targets in a sky that is dark enough.  Needs `pip install astroplan`."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC
from typing import TYPE_CHECKING

import numpy as np

from twilight.api.arguments import config_of
from twilight.api.types import SceneLike
from twilight.base.extras import is_installed, missing
from twilight.engine.light import moments_at
from twilight.engine.light_setup import field_for
from twilight.sky.quantities.catalogue import check_of, quantity

if TYPE_CHECKING:
    from astroplan import Observer
    from astropy.coordinates import SkyCoord
    from astropy.time import Time

if not is_installed("astroplan"):
    raise missing("astroplan", "twilight.api.planning")

from astroplan import Constraint

__all__ = ["SkyBrightnessConstraint"]


class SkyBrightnessConstraint(Constraint):
    """The sky at the target is as faint as a magnitude, or fainter; below the horizon no target is observable.

    Parameters
    ----------
    faintness
        Least surface brightness [mag arcsec^-2], e.g. 20.5.
    band
        As of `twilight.light`.
    climate, quality, settings
        As of `twilight.light`.

    Examples
    --------
    >>> constraints = [SkyBrightnessConstraint(20.5, "r"), AltitudeConstraint(30 * u.deg)]
    """

    def __init__(
        self,
        faintness: float,
        band: str = "V",
        climate: SceneLike = "continental-average",
        quality: str | None = None,
        settings: Mapping[str, object] | None = None,
    ):
        self.faintness, self._quantity = float(faintness), quantity(band)
        check_of(self._quantity, "direction")
        self._config = config_of(climate, quality=quality, settings=settings)

    def compute_constraint(self, times: Time, observer: Observer, targets: SkyCoord) -> np.ndarray:
        """Whether it holds, of the shape that astroplan asks for: targets and times."""
        seen = observer.altaz(times, targets)
        elevation, azimuth = np.broadcast_arrays(seen.alt.deg, seen.az.deg)
        when = np.broadcast_to(times.utc.to_datetime(), elevation.shape)
        moments = [moment.replace(tzinfo=UTC) for moment in when.ravel()]
        place = observer.location.to_geodetic()
        count = len(moments)
        field = field_for(self._config, [self._quantity])
        at = moments_at([float(place.lat.deg)] * count, [float(place.lon.deg)] * count, moments)
        up = elevation.ravel() >= 0.0
        lines = np.where(up, elevation.ravel(), 0.0)[:, None], azimuth.ravel()[:, None]
        radiance = field.directions(at, *lines)[:, 0]
        found = self._quantity.value(field.spectra(radiance))
        return (up & (found >= self.faintness)).reshape(elevation.shape)
