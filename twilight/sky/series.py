"""`SkySeries`: skies of several suns in their order, computed one by one when they are asked for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.arguments import in_units
from twilight.base.errors import TwilightError
from twilight.sky.sky import Sky

if TYPE_CHECKING:
    import xarray


@in_units
class SkySeries(Sequence[Sky]):
    """Skies of several suns in their order.

    A sky is computed when it is first asked for, with those before it, and kept.  `len`, indices, slices and loops are
    those of a list; a slice is a series too.

    Parameters
    ----------
    skies
        The skies, or what computes them one after the other.
    sun_elevation_deg
        True elevations of the suns [deg], (S,), where they are known before the skies are computed; None: by the skies.
    times
        When the skies are seen, with offsets; None: not known, or by the skies.
    """

    def __init__(
        self,
        skies: Iterable[Sky],
        sun_elevation_deg: ArrayLike | None = None,
        times: Sequence[datetime] | None = None,
    ):
        self._made: list[Sky] = []
        if sun_elevation_deg is None:
            self._made = list(skies)
            skies = ()
            sun_elevation_deg = [sky.sun_elevation_deg for sky in self._made]
            known = [sky.time for sky in self._made if sky.time is not None]
            times = known if known and len(known) == len(self._made) else None
        self._rest = iter(skies)
        self._error: TwilightError | None = None
        self.sun_elevation_deg = np.array(sun_elevation_deg, float)
        self.times = None if times is None else tuple(times)

    def __reduce__(self) -> tuple[Any, ...]:
        """What another process makes the series of: its skies, which are computed for it."""
        return SkySeries, (list(self), self.sun_elevation_deg, self.times)

    def __len__(self) -> int:
        return self.sun_elevation_deg.size

    def __repr__(self) -> str:
        """One line: how many skies, under which suns, and how many of them are computed."""
        sun = self.sun_elevation_deg
        if not len(self):
            return "<SkySeries: no skies>"
        when = "" if self.times is None else f", {self.times[0].isoformat()} to {self.times[-1].isoformat()}"
        many = "1 sky" if len(self) == 1 else f"{len(self)} skies"
        return f"<SkySeries: {many}, sun at {sun[0]:+.2f} to {sun[-1]:+.2f} deg{when}; {len(self._made)} computed>"

    @overload
    def __getitem__(self, index: int) -> Sky: ...
    @overload
    def __getitem__(self, index: slice) -> SkySeries: ...

    def __getitem__(self, index: int | slice) -> Sky | SkySeries:
        if isinstance(index, slice):
            chosen = range(len(self))[index]
            times = None if self.times is None else [self.times[i] for i in chosen]
            return SkySeries((self[i] for i in chosen), self.sun_elevation_deg[index], times)
        return self._sky(range(len(self))[index])

    def __iter__(self) -> Iterator[Sky]:
        return (self._sky(i) for i in range(len(self)))

    def _sky(self, index: int) -> Sky:
        """The sky of an index from 0, computed with those before it where it is not there."""
        if self._error is not None and index >= len(self._made):
            raise self._error
        try:
            while index >= len(self._made):
                self._made.append(next(self._rest))
        except TwilightError as error:
            self._error = error
            raise
        except StopIteration:
            raise TwilightError("the computation of this series was interrupted; render it again") from None
        return self._made[index]

    def magnitude(
        self, band: Any = "V", elevation_deg: float = 90.0, azimuth_deg: float = 0.0, system: str | None = None
    ) -> np.ndarray:
        """`Sky.magnitude` of every sky [mag arcsec^-2], (S,)."""
        return np.array([sky.magnitude(band, elevation_deg, azimuth_deg, system) for sky in self])

    def radiance_in(self, response: Any, elevation_deg: float = 90.0, azimuth_deg: float = 0.0) -> np.ndarray:
        """`Sky.radiance_in` of every sky [W m^-2 sr^-1], (S,)."""
        return np.array([sky.radiance_in(response, elevation_deg, azimuth_deg) for sky in self])

    def illuminance_lux(self, horizontal: bool = True, direct: bool = False, eye: str = "photopic") -> np.ndarray:
        """`Sky.illuminance_lux` of every sky [lx], (S,)."""
        return np.array([sky.illuminance_lux(horizontal, direct, eye) for sky in self])

    def measure(self, name: str, *direction_deg: float, **options: Any) -> np.ndarray:
        """`Sky.measure` of every sky, (S,)."""
        return np.array([sky.measure(name, *direction_deg, **options) for sky in self])

    if TYPE_CHECKING:  # what reads and writes files stands above this room: `twilight.api.representation` attaches it

        def to_xarray(self) -> xarray.Dataset: ...
