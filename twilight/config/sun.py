"""The section `sun:` in its five forms: an elevation, several, a place at a time, at times, over an interval."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from twilight.base.conventions import YEARS
from twilight.base.errors import TwilightError
from twilight.base.sections import Flag, Number, Section, increase, key


def _moment(value: Any) -> Any:
    """The end of a day (24:00) and a leap second (:60) are the moments that follow them, as ISO 8601 has them."""
    if isinstance(value, str) and (found := _CARRIED.fullmatch(value.strip())) is not None:
        date, hour, minute, second, rest = found.groups(default="")
        try:
            moment = datetime.fromisoformat(date)
            moment += timedelta(hours=int(hour), minutes=int(minute), seconds=int(second or 0))
        except (ValueError, OverflowError):
            raise ValueError(f"holds a date that the calendar does not have: {value}") from None
        return moment.isoformat() + rest
    if not isinstance(value, str | datetime) or (isinstance(value, str) and ":" not in value):
        raise ValueError("must be a date and time such as 2003-12-08T16:00 or 2003-12-08T16:00:00+01:00")
    return value


def _zone(value: str | None) -> str | None:
    if value is None:
        return value
    from zoneinfo import ZoneInfo  # start-up

    try:
        ZoneInfo(value)
    except (KeyError, ValueError, OSError):
        raise ValueError(f"must be a time zone such as Europe/Berlin or UTC, got {value!r}") from None
    return value


_CARRIED = re.compile(
    r"(\d{4}-\d{2}-\d{2})[T ](24(?=:00(?::00)?(?:\D|$))|[01]\d(?=:..:60)|2[0-3](?=:..:60)):([0-5]\d)(?::(00|60))?"
    r"(?:\.0+)?(Z|[+-]\d{2}:?\d{2})?"
)
"""A time at the end of a day or in a leap second."""


def _longitude(value: Any) -> Any:
    """A longitude of up to two turns as the same one from -180 to 180 deg."""
    if isinstance(value, int | float) and not isinstance(value, bool) and 180.0 < abs(value) <= 720.0 and value != 360:
        return value if 180.0 < value <= 360.0 else (value + 180.0) % 360.0 - 180.0
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
    longitude_deg: Annotated[Number, Field(ge=-180.0, le=360.0), BeforeValidator(_longitude)] = Field(
        description="geographic longitude, east positive", json_schema_extra={"unit": "deg"}
    )
    time_zone: Zone = key(None, "for times without an offset, e.g. Europe/Berlin")
    disc: Flag = key(False, DISC)

    def aware(self, moment: datetime) -> datetime:
        """The moment with its offset or, lacking one, in `time_zone`."""
        if moment.tzinfo is not None:
            return moment
        from zoneinfo import ZoneInfo  # start-up

        return moment.replace(tzinfo=ZoneInfo(self.time_zone or "UTC"))

    def _needs_zone(self, *moments: datetime) -> None:
        if self.time_zone is None and any(m.tzinfo is None for m in moments):
            raise ValueError("needs time_zone (e.g. Europe/Berlin) or a time with its offset (e.g. 16:00+01:00)")
        for moment in moments:
            try:
                there = self.aware(moment).astimezone(UTC).astimezone(self.aware(moment).tzinfo)
            except OverflowError:
                raise ValueError(f"holds a time outside the years {YEARS[0]} to {YEARS[1]}: {moment}") from None
            if not YEARS[0] <= moment.year <= YEARS[1]:
                raise ValueError(f"holds a time outside the years {YEARS[0]} to {YEARS[1]}: {moment}")
            if there.replace(tzinfo=None) != moment.replace(tzinfo=None):
                raise ValueError(f"holds a time that the clocks of {self.time_zone} skip: {moment}")


class SunAt(_Place):
    """The sun over a place at a time."""

    at: Moment = Field(
        description="date and time, e.g. 2003-12-08T16:30, or a twilight, e.g. 2003-12-08 civil dusk, or dusk -4"
    )

    @model_validator(mode="before")
    @classmethod
    def _twilight(cls, value: Any) -> Any:
        """A twilight's name becomes its moment at the place."""
        if not isinstance(value, dict) or not isinstance(value.get("at"), str) or ":" in value["at"]:
            return value
        if not all(isinstance(value.get(name), int | float) for name in ("latitude_deg", "longitude_deg")):
            return value
        from twilight.sky.twilight_times import time_of  # start-up

        place = float(value["latitude_deg"]), float(_longitude(value["longitude_deg"]))
        try:
            return {**value, "at": time_of(value["at"], *place, value.get("time_zone")).isoformat()}
        except TwilightError as error:
            raise ValueError(str(error)) from None

    @model_validator(mode="after")
    def _check(self) -> SunAt:
        self._needs_zone(self.at)
        return self


def with_moment_of_horizon(data: Any) -> Any:
    """A configuration as plain data whose `sun.at` names sunrise or sunset with their moment, for an observer above the
    sea; any other as it is."""
    if not (isinstance(data, dict) and isinstance(data.get("sun"), dict) and isinstance(data.get("observer"), dict)):
        return data
    sun, altitude_km = data["sun"], data["observer"].get("altitude_km")
    at, place = sun.get("at"), (sun.get("latitude_deg"), sun.get("longitude_deg"))
    if not (isinstance(at, str) and at.strip().lower().endswith(("sunrise", "sunset"))):
        return data
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in (*place, altitude_km)):
        return data
    from twilight.sky.twilight_times import time_of  # start-up: pvlib takes pandas

    try:
        moment = time_of(at, place[0], _longitude(place[1]), sun.get("time_zone"), altitude_km)
    except TwilightError:
        return data  # the section says what is wrong
    return {**data, "sun": {**sun, "at": moment.isoformat()}}


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


class SunTimes(_Place):
    """The sun over a place at several times, one frame each."""

    times: tuple[Moment, ...] = key(
        ..., "dates and times in their order, one frame each, at any distance from each other", min_length=1,
        max_length=10000,
    )  # fmt: skip

    @model_validator(mode="after")
    def _check(self) -> SunTimes:
        self._needs_zone(*self.times)
        if not increase(map(self.aware, self.times)):
            raise ValueError("times must be in their order, each once")
        return self


SUN_KEYS = {
    "elevation_deg": "<elevation>",
    "elevations_deg": "<elevations>",
    "at": "<at>",
    "times": "<times>",
    "start": "<interval>",
    "stop": "<interval>",
    "step_minutes": "<interval>",
    "latitude_deg": "<at>",
    "longitude_deg": "<at>",
    "time_zone": "<at>",
}
"""The first of these keys that a `sun:` section holds tells which of its five forms it is."""
_SUN_FORMS: dict[type, str] = {
    SunElevation: "<elevation>",
    SunElevations: "<elevations>",
    SunAt: "<at>",
    SunTimes: "<times>",
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
    | Annotated[SunTimes, Tag("<times>")]
    | Annotated[SunInterval, Tag("<interval>")],
    Discriminator(sun_form),
    BeforeValidator(_one_form),
]
