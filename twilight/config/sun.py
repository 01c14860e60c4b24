"""The sections `sun:` of a configuration, in its four forms: an elevation, several, a time and place, an interval."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from twilight.config.base import Flag, Number, Section, key


def _moment(value: Any) -> Any:
    if not isinstance(value, str | datetime) or (isinstance(value, str) and ":" not in value):
        raise ValueError("must be a date and time such as 2003-12-08T16:00 or 2003-12-08T16:00:00+01:00")
    return value


def _zone(value: str | None) -> str | None:
    if value is None:
        return value
    from zoneinfo import ZoneInfo

    try:
        ZoneInfo(value)
    except (KeyError, ValueError, OSError):
        raise ValueError(f"must be a time zone such as Europe/Berlin or UTC, got {value!r}") from None
    return value


Moment = Annotated[datetime, BeforeValidator(_moment)]
Zone = Annotated[str | None, AfterValidator(_zone)]
Elevation = Annotated[Number, Field(ge=-90.0, le=90.0)]

DISC = "whether the sun's disc is computed too, as a layer of its own beside the sky"


class SunElevation(Section):
    """A sun at a given elevation."""

    elevation_deg: Elevation = key(
        10.0, "true (unrefracted) elevation of the disc's centre above the observer's horizontal", unit="deg"
    )
    distance_au: Number = key(1.0, "distance to the sun", unit="au", ge=0.9, le=1.1)
    disc: Flag = key(False, DISC)


class SunElevations(Section):
    """Several suns, one frame each."""

    elevations_deg: tuple[Elevation, ...] = key(
        (10.0,), "true elevations, one frame each", unit="deg", min_length=1, max_length=10000
    )
    distance_au: Number = key(1.0, "distance to the sun", unit="au", ge=0.9, le=1.1)
    disc: Flag = key(False, DISC)


class _Place(Section):
    latitude_deg: Annotated[Number, Field(ge=-90.0, le=90.0)] = Field(
        description="geographic latitude, north positive", json_schema_extra={"unit": "deg"}
    )
    longitude_deg: Annotated[Number, Field(ge=-180.0, le=360.0)] = Field(
        description="geographic longitude, east positive", json_schema_extra={"unit": "deg"}
    )
    time_zone: Zone = key(None, "for times without an offset, e.g. Europe/Berlin")
    disc: Flag = key(False, DISC)

    def aware(self, moment: datetime) -> datetime:
        """The moment with its offset or, lacking one, in `time_zone`."""
        if moment.tzinfo is not None:
            return moment
        from zoneinfo import ZoneInfo

        return moment.replace(tzinfo=ZoneInfo(self.time_zone or "UTC"))

    def _needs_zone(self, *moments: datetime) -> None:
        if self.time_zone is None and any(m.tzinfo is None for m in moments):
            raise ValueError("needs time_zone (e.g. Europe/Berlin) or a time with its offset (e.g. 16:00+01:00)")
        for moment in moments:
            try:
                there = self.aware(moment).astimezone(UTC).astimezone(self.aware(moment).tzinfo)
            except OverflowError:
                raise ValueError(f"holds a time beyond the years 1 to 9999: {moment}") from None
            if there.replace(tzinfo=None) != moment.replace(tzinfo=None):
                raise ValueError(f"holds a time that the clocks of {self.time_zone} skip: {moment}")


class SunAt(_Place):
    """The sun over a place at a time."""

    at: Moment = Field(description="date and time, e.g. 2003-12-08T16:30")

    @model_validator(mode="after")
    def _check(self) -> SunAt:
        self._needs_zone(self.at)
        return self


class SunInterval(_Place):
    """The sun over a place during an interval, one frame per step."""

    start: Moment = Field(description="date and time of the first frame")
    stop: Moment = Field(description="date and time of the last frame")
    step_minutes: Number = key(5.0, "time between frames", unit="min", gt=0.0, le=1e6)

    @model_validator(mode="after")
    def _check(self) -> SunInterval:
        self._needs_zone(self.start, self.stop)
        seconds = (self.aware(self.stop) - self.aware(self.start)).total_seconds()
        if seconds < 0:
            raise ValueError("stop must not be before start")
        if seconds / 60.0 / self.step_minutes > 10000:
            raise ValueError("asks for more than 10000 frames; take a longer step_minutes")
        return self


SUN_KEYS = {
    "elevation_deg": "<elevation>",
    "elevations_deg": "<elevations>",
    "at": "<at>",
    "start": "<interval>",
    "stop": "<interval>",
    "step_minutes": "<interval>",
    "latitude_deg": "<at>",
    "longitude_deg": "<at>",
    "time_zone": "<at>",
}
"""The first of these keys that a `sun:` section holds tells which of its four forms it is."""

_SUN_FORMS: dict[type, str] = {
    SunElevation: "<elevation>",
    SunElevations: "<elevations>",
    SunAt: "<at>",
    SunInterval: "<interval>",
}


def sun_form(value: Any) -> str:
    """Which form of the sun section `value` is, by its keys."""
    if isinstance(value, dict):
        return next((form for name, form in SUN_KEYS.items() if name in value), "<elevation>")
    return _SUN_FORMS.get(type(value), "<elevation>")


def _one_form(value: Any) -> Any:
    """Two ways of saying where the sun is contradict each other; a place alone fits every time."""
    if isinstance(value, dict):
        ways = {SUN_KEYS[name]: name for name in reversed(SUN_KEYS) if name in value and name not in _PLACE_KEYS}
        if len(ways) > 1:
            raise ValueError(f"takes only one of {', '.join(sorted(ways.values()))}")
    return value


_PLACE_KEYS = ("latitude_deg", "longitude_deg", "time_zone")

Sun = Annotated[
    Annotated[SunElevation, Tag("<elevation>")]
    | Annotated[SunElevations, Tag("<elevations>")]
    | Annotated[SunAt, Tag("<at>")]
    | Annotated[SunInterval, Tag("<interval>")],
    Discriminator(sun_form),
    BeforeValidator(_one_form),
]
