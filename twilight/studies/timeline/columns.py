"""What a timeline has columns of: a quantity of a direction or a surface, as `V@zenith`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twilight.engine.light import LightField
from twilight.engine.light_sources import Moments
from twilight.engine.surfaces import Direction, Surface, towards
from twilight.sky.quantities.measure import Quantity, check_of, quantity, unit_of


@dataclass(frozen=True)
class Column:
    """A quantity of a direction or a surface over time.

    text: as it was asked for; needs: the quantity, which the wavelengths must cover; target: what it is of.
    """

    text: str
    needs: Quantity
    target: Direction | Surface

    @property
    def unit(self) -> str:
        """Of its values."""
        return unit_of(self.needs, "surface" if isinstance(self.target, Surface) else "direction")

    @property
    def variable(self) -> str:
        """Its name in files, with its unit."""
        where = "".join(c if c.isalnum() else "_" for c in self.text.partition("@")[2])
        return f"{self.needs.variable}{'_' + where if where else ''}"

    @property
    def about(self) -> str:
        """What it is, in one line."""
        return self.needs.about

    def values(self, field: LightField, moments: Moments, sources: Sequence[str] | None = None) -> np.ndarray:
        """Its values at moments, (N,), of some sources, None: all."""
        if isinstance(self.target, Surface):
            made = field.surfaces(moments, [self.target], sources)
        else:
            made = field.directions(moments, *_angles(self.target, moments), sources)
        return self.needs.value(field.spectra(made[:, 0]))


def column(text: str) -> Column:
    """The column of a text: `QUANTITY@WHERE`; without WHERE of the zenith, or of level ground.

    Errors: TwilightError for a quantity, or what it is of, that is none.
    """
    text = text.strip()
    name, _, where = text.partition("@")
    wanted = quantity(name)
    target = towards(where or ("zenith" if wanted.of == ("direction",) else "horizontal"))
    check_of(wanted, "surface" if isinstance(target, Surface) else "direction")
    return Column(text, wanted, target)


def _angles(target: Direction, moments: Moments) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth from north (N, 1)."""
    count = len(moments.places)
    azimuth = target.azimuth_deg + (moments.sun_azimuth_deg if target.from_sun else np.zeros(count))
    return np.full((count, 1), target.elevation_deg), azimuth[:, None]
