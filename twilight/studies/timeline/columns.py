"""What a timeline has columns of: a quantity of a direction or a surface, as `V@zenith`, or one made of such."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twilight.base.errors import TwilightError
from twilight.engine.light import LightField, Moments, spectra_arguments
from twilight.engine.surfaces import Surface
from twilight.engine.towards import Direction, towards
from twilight.sky.quantities.catalogue import Quantity, check_of, quantity, unit_of
from twilight.sky.quantities.measure import Spectra

CONTRAST_DEG = 5.0
"""Elevation at which first light is looked for [deg]: above the haze of the horizon, in the dawn's arch."""
CONTRAST = "dawn_contrast"


@dataclass(frozen=True)
class Column:
    """A quantity and what it is of; text: as it was asked for."""

    text: str
    quantity: Quantity
    target: Direction | Surface

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return "1" if self.text == CONTRAST else unit_of(self.quantity, _of(self.target))

    @property
    def variable(self) -> str:
        """A name with its unit, for files."""
        if self.text == CONTRAST:
            return CONTRAST
        where = self.text.partition("@")[2]
        word = "".join(c if c.isalnum() else "_" for c in where)
        return f"{self.quantity.variable}{'_' + word if word else ''}"

    def values(self, field: LightField, moments: Moments) -> np.ndarray:
        """Its values at moments, (N,)."""
        if self.text == CONTRAST:
            here = self._of_target(field, moments, self.target)
            return here / self._of_target(field, moments, Direction(CONTRAST_DEG, 180.0, True)) - 1.0
        return self._of_target(field, moments, self.target)

    def _of_target(self, field: LightField, moments: Moments, target: Direction | Surface) -> np.ndarray:
        if isinstance(target, Surface):
            made = field.surfaces(moments, [target])
        else:
            count = len(moments.places)
            azimuth = target.azimuth_deg + (moments.sun_azimuth_deg if target.from_sun else np.zeros(count))
            made = field.directions(moments, np.full((count, 1), target.elevation_deg), azimuth[:, None])
        return self.quantity.value(Spectra(field.factor(made[:, 0]), **spectra_arguments(field)))


def column(text: str) -> Column:
    """The column of a text: `QUANTITY@WHERE`; without WHERE of the zenith, or of level ground.

    Errors: TwilightError for a quantity, or what it is of, that is none.
    """
    if text.strip() == CONTRAST:
        return Column(CONTRAST, quantity("luminance"), Direction(CONTRAST_DEG, 0.0, True))
    name, at, where = text.strip().partition("@")
    found = quantity(name)
    if not at:
        where = "zenith" if found.of == ("direction",) else "horizontal"
    target = towards(where)
    check_of(found, _of(target))
    return Column(text.strip(), found, target)


def _of(target: Direction | Surface):  # type: ignore[no-untyped-def]
    return "surface" if isinstance(target, Surface) else "direction"


def number(text: str, what: str) -> float:
    """A finite number; TwilightError for anything else."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise TwilightError(f"{what}: '{text}' is not a number")
    return value
