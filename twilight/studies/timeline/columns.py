"""What a timeline has columns of: a quantity of a direction or a surface, as `V@zenith`, or one made of such."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from twilight.base.errors import TwilightError
from twilight.engine.light import LightField, Moments
from twilight.engine.surfaces import Surface
from twilight.engine.towards import Direction, towards
from twilight.engine.visibility import NakedEye
from twilight.sky.eye_limit import TYPICAL_FIELD_FACTOR
from twilight.sky.objects import names_of, tracks
from twilight.sky.quantities.catalogue import Quantity, check_of, quantity, unit_of
from twilight.studies.timeline.flats import Flats

CONTRAST_DEG = 5.0
"""Elevation of the contrast of dawn [deg]: above the haze of the horizon, in the dawn's arch."""
CONTRAST = "dawn_contrast"
LUMINANCE = quantity("luminance")
LIMIT = "limiting_magnitude"
MARGIN = "margin"


class Column(Protocol):
    """A row of numbers over time.

    text: as it was asked for; variable: its name in files, with its unit; about: one line; needs: quantities that the
    wavelengths must cover.
    """

    @property
    def text(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def variable(self) -> str: ...
    @property
    def about(self) -> str: ...
    @property
    def needs(self) -> Quantity: ...

    def values(self, field: LightField, moments: Moments) -> np.ndarray:
        """Its values at moments, (N,)."""


@dataclass(frozen=True)
class Setup:
    """What columns are made with besides their text: an eye's field factor (`twilight.sky.eye_limit`), and the
    telescope of flats."""

    field_factor: float = TYPICAL_FIELD_FACTOR
    flats: Flats | None = None


@dataclass(frozen=True)
class LightColumn:
    """A quantity of a direction or a surface."""

    text: str
    needs: Quantity
    target: Direction | Surface

    @property
    def unit(self) -> str:
        return unit_of(self.needs, "surface" if isinstance(self.target, Surface) else "direction")

    @property
    def variable(self) -> str:
        return _variable(self.needs.variable, self.text)

    @property
    def about(self) -> str:
        return self.needs.about

    def values(self, field: LightField, moments: Moments) -> np.ndarray:
        if isinstance(self.target, Surface):
            made = field.surfaces(moments, [self.target])
        else:
            made = field.directions(moments, *_angles(self.target, moments))
        return self.needs.value(field.spectra(made[:, 0]))


@dataclass(frozen=True)
class ContrastColumn:
    """Luminance low towards the sun over that opposite, less 1."""

    text: str = CONTRAST
    unit: str = "1"
    variable: str = CONTRAST
    about: str = f"luminance {CONTRAST_DEG:g} deg up at the sun's azimuth over that opposite, less 1"
    needs: Quantity = LUMINANCE

    def values(self, field: LightField, moments: Moments) -> np.ndarray:
        here, there = (LightColumn("", self.needs, Direction(CONTRAST_DEG, x, True)) for x in (0.0, 180.0))
        return here.values(field, moments) / there.values(field, moments) - 1.0


@dataclass(frozen=True)
class LimitColumn:
    """The faintest star that is seen in a direction."""

    text: str
    target: Direction
    field_factor: float
    unit: str = "mag"
    about: str = "V above the air of the faintest star seen with the naked eye (Crumey 2014)"
    needs: Quantity = LUMINANCE

    @property
    def variable(self) -> str:
        return _variable(LIMIT, self.text)

    def values(self, field: LightField, moments: Moments) -> np.ndarray:
        return NakedEye(field, self.field_factor).limit(moments, *_angles(self.target, moments))[:, 0]


@dataclass(frozen=True)
class MarginColumn:
    """By how much the moon, a planet or a star is brighter than the eye's limit; -inf below the horizon."""

    text: str
    name: str
    field_factor: float
    unit: str = "mag"
    needs: Quantity = LUMINANCE

    @property
    def variable(self) -> str:
        return f"margin_mag_{_word(self.name)}"

    @property
    def about(self) -> str:
        return f"magnitudes by which {self.name} is brighter than the limit of the naked eye"

    def values(self, field: LightField, moments: Moments) -> np.ndarray:
        eye, place = NakedEye(field, self.field_factor), moments.places[0]
        times = [one.time for one in moments.places]
        found = tracks([self.name], times, place.latitude_deg, place.longitude_deg, eye.altitude_km)
        return eye.margins(found, moments)[0]


@dataclass(frozen=True)
class FlatColumn:
    """Exposures of flats that have the counts wanted, or the counts of an exposure."""

    text: str
    flats: Flats
    target: Direction

    @property
    def needs(self) -> Quantity:
        photons = quantity(f"photons:{self.flats.band}")
        curve = photons.responses()[0].of_photons()
        return replace(photons, needs=(curve,), value=lambda light: light.photons(curve))

    @property
    def unit(self) -> str:
        return "s" if self.text.startswith(Flats.EXPOSURE) else "counts"

    @property
    def variable(self) -> str:
        name, _, where = self.text.partition("@")
        return _variable(f"{name}_{_word(self.flats.band)}{'_s' if self.unit == 's' else ''}", f"@{where}")

    @property
    def about(self) -> str:
        return self.flats.about(self.unit == "s")

    def values(self, field: LightField, moments: Moments) -> np.ndarray:
        photons = LightColumn("", self.needs, self.target).values(field, moments)
        return self.flats.exposures_s(photons) if self.unit == "s" else self.flats.counts(photons)


USUAL = Setup()


def column(text: str, setup: Setup = USUAL) -> Column:
    """The column of a text: `QUANTITY@WHERE`; without WHERE of the zenith, or of level ground.

    Besides the quantities of `twilight.sky.quantities`: dawn_contrast; limiting_magnitude@WHERE; margin@OBJECT, of
    `twilight.sky.objects`; flat_exposure@WHERE and flat_counts@WHERE where there is a telescope.
    Errors: TwilightError for a quantity, or what it is of, that is none.
    """
    text = text.strip()
    name, at, where = text.partition("@")
    kind = name.lower()
    if kind == CONTRAST:
        if at:
            raise TwilightError(f"quantity: {text}: {CONTRAST} has its own directions and takes no @")
        return ContrastColumn()
    if kind == MARGIN:
        found = names_of(where)
        if len(found) != 1:
            raise TwilightError(f"quantity: {text} is of several objects; one column holds one, e.g. margin@{found[0]}")
        return MarginColumn(text, found[0], setup.field_factor)
    if kind == LIMIT:
        return LimitColumn(text, _direction(text, where), setup.field_factor)
    if kind in (Flats.EXPOSURE, Flats.COUNTS):
        if setup.flats is None:
            raise TwilightError(f"quantity: {text} needs a telescope; it goes with --for flats")
        return FlatColumn(f"{kind}@{where or 'zenith'}", setup.flats, _direction(text, where))
    try:
        wanted = quantity(name)
    except TwilightError as error:
        raise TwilightError(f"{error}; columns are also {CONTRAST}, {LIMIT} and {MARGIN}@OBJECT") from None
    target = towards(where or ("zenith" if wanted.of == ("direction",) else "horizontal"))
    check_of(wanted, "surface" if isinstance(target, Surface) else "direction")
    return LightColumn(text, wanted, target)


def _direction(text: str, where: str) -> Direction:
    target = towards(where or "zenith")
    if isinstance(target, Surface):
        raise TwilightError(f"quantity: {text}: is of a direction, not of a surface")
    return target


def _angles(target: Direction, moments: Moments) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth from north (N, 1)."""
    count = len(moments.places)
    azimuth = target.azimuth_deg + (moments.sun_azimuth_deg if target.from_sun else np.zeros(count))
    return np.full((count, 1), target.elevation_deg), azimuth[:, None]


def _variable(name: str, text: str) -> str:
    where = _word(text.partition("@")[2])
    return f"{name}{'_' + where if where else ''}"


def _word(text: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in text)


def number(text: str, what: str) -> float:
    """A finite number; TwilightError for anything else."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise TwilightError(f"{what}: '{text}' is not a number")
    return value
