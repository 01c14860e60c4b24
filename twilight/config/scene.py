"""The configuration document: a climate seen by an observer under one or more suns, and how to compute and write it."""

from __future__ import annotations

import itertools
from datetime import UTC, datetime
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from twilight.config.base import Flag, Integer, Number, Section, key
from twilight.config.climate import Climate
from twilight.config.terrain import Terrain
from twilight.config.view import View
from twilight.formats import FORMATS, check_names


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


SolarSpectrum = Literal["astm_g173_etr", "astm_e490", "kurucz1992", "gueymard2003", "sao2010"]


PLACED_NM = (380.0, 440.0, 472.0, 548.0, 580.0, 616.0, 676.0, 720.0)
"""Eight wavelengths between the absorption bands of O4 and NO2 and on both slopes of ozone's, found by
`benchmarks/wavelengths.py`: luminance and colour from them are nearer to those from 91 than with eight equidistant ones
by a factor of four to twenty."""


class Observer(Section):
    """Where the eye is."""

    altitude_km: Number = key(
        0.0, "altitude above sea level; unset: on the ground (ground.altitude_km)", unit="km", ge=0.0, le=40000.0
    )
    view: View | None = key(
        None, "a picture in any direction, sky.view.png, e.g. {kind: perspective, elevation_deg: -20}; unset: none"
    )


class Wavelengths(Section):
    """Where the radiance is computed; unset for a tabulated medium means the table's wavelengths."""

    min_nm: Number | None = key(None, "first of `count` equidistant wavelengths; 380", unit="nm", ge=300.0, le=1000.0)
    max_nm: Number | None = key(None, "last of `count` equidistant wavelengths; 720", unit="nm", ge=300.0, le=1000.0)
    count: Integer | None = key(None, "number of equidistant wavelengths; 8", unit="1", ge=1, le=2000)
    list_nm: tuple[Annotated[Number, Field(ge=300.0, le=1000.0)], ...] | None = key(
        None,
        "the wavelengths themselves, increasing, instead of min_nm, max_nm and count; where none of the four is set, "
        "eight that are placed so that colours come out right",
        unit="nm",
        min_length=1,
        max_length=2000,
    )

    @model_validator(mode="after")
    def _check(self) -> Wavelengths:
        w = self.list_nm
        if w is not None and (self.min_nm, self.max_nm, self.count) != (None, None, None):
            raise ValueError("takes either list_nm or min_nm, max_nm and count, not both")
        if w is not None and any(b <= a for a, b in itertools.pairwise(w)):
            raise ValueError("list_nm must increase")
        low, high, count = self._equidistant
        if high < low or (count > 1 and high == low):
            raise ValueError("max_nm must be above min_nm")
        return self

    @property
    def _equidistant(self) -> tuple[float, float, int]:
        return (
            380.0 if self.min_nm is None else self.min_nm,
            720.0 if self.max_nm is None else self.max_nm,
            8 if self.count is None else self.count,
        )

    @property
    def placed(self) -> bool:
        """Whether they are the eight of `PLACED_NM`, for want of others."""
        return (self.min_nm, self.max_nm, self.count, self.list_nm) == (None, None, None, None)

    @property
    def wavelength_nm(self) -> tuple[float, ...]:
        """The wavelengths [nm]."""
        if self.list_nm is not None:
            return self.list_nm
        if self.placed:
            return PLACED_NM
        low, high, count = self._equidistant
        step = (high - low) / max(count - 1, 1)
        return tuple(low + i * step for i in range(count))


class Texture(Section):
    """The directions of the sky texture, and an optional latitude-longitude picture of its own."""

    azimuth_count: Integer = key(120, "columns over 360 deg; 120 is 3 deg", unit="1", ge=4, le=7200)
    elevation_count: Integer = key(30, "rows from the horizon to the zenith; 30 is 3 deg", unit="1", ge=2, le=1800)
    resolution_deg: Number | None = key(
        None, "sets both counts: 360 and 90 divided by it, instead of them", unit="deg", ge=0.05, le=45.0
    )
    latlong_width: Integer | None = key(
        None,
        "width of the latitude-longitude picture, computed direction by direction; unset: resampled",
        unit="1",
        ge=8,
        le=16384,
    )

    @model_validator(mode="after")
    def _check(self) -> Texture:
        step = self.resolution_deg
        if step is not None:
            if self.model_fields_set & {"azimuth_count", "elevation_count"}:
                raise ValueError("takes either resolution_deg or azimuth_count and elevation_count, not both")
            if abs(90.0 / step - round(90.0 / step)) > 1e-9:
                raise ValueError(f"resolution_deg must divide 90, as 3 or 1.5 do; got {step:g}")
        if self.latlong_width is not None and self.latlong_width % 4:
            raise ValueError(f"latlong_width must be a multiple of 4; got {self.latlong_width}")
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """(elevations, azimuths)."""
        if self.resolution_deg is None:
            return self.elevation_count, self.azimuth_count
        return round(90.0 / self.resolution_deg), 4 * round(90.0 / self.resolution_deg)


def _files(value: tuple[str, ...] | None) -> tuple[str, ...] | None:
    if value == ():
        raise ValueError("must name one file at least")
    return value if value is None else check_names(value)


class EyeTone(Section):
    """Who looks, where the pictures are as an eye sees."""

    adapted_cd_per_m2: Number | None = key(
        None, "luminance that the eye is adapted to; unset: to the picture", unit="cd m-2", ge=1e-6, le=1e5
    )
    acuity: Flag = key(True, "whether fine details are lost at low light")


class CameraTone(Section):
    """The camera, where the pictures are photographs."""

    iso: Number = key(100.0, "sensitivity", unit="1", ge=25.0, le=1e6)
    seconds: Number | None = key(None, "exposure time; unset: by the meter, 1/8000 to 30 s", unit="s", gt=0.0, le=1e5)
    f_number: Number = key(4.0, "focal length over aperture", unit="1", ge=0.5, le=64.0)
    white_balance_k: Number = key(5500.0, "colour temperature of the light that is white", unit="K", ge=1500, le=25000)
    sensor: Literal["nikon_5100", "sigma_sd_merrill"] = key("nikon_5100", "whose spectral response")
    noise: Flag = key(True, "noise of photons and of reading")


class Output(Section):
    """How the pictures look and which program they are for; the radiance in the files does not depend on it."""

    files: Annotated[tuple[str, ...] | None, AfterValidator(_files)] = key(
        None,
        f"which files are written: {', '.join(FORMATS)}; unset: all, polarisation where the light is polarised",
    )
    polariser_deg: Number | None = key(
        None,
        "axis of a polariser before the pictures and sky.rgb.exr, from the vertical of each line of sight, clockwise; "
        "unset: none",
        unit="deg",
        ge=-180.0,
        le=180.0,
    )
    target: Literal["openexr", "mitsuba", "blender", "radiance", "pbrt"] = key(
        "openexr", "whose environment map sky.rgb.exr is"
    )
    disc: Flag = key(False, "whether the sun's disc is in the environment maps; it needs sun.disc")
    width: Integer = key(1024, "of sky.rgb.exr, unless texture.latlong_width sets it", unit="pixel", ge=8, le=16384)
    spectral_width: Integer = key(256, "of sky.spectral.exr", unit="pixel", ge=8, le=16384)
    views: tuple[Literal["wide", "panorama", "fisheye"], ...] = key(
        ("wide",),
        "pictures: wide looks to the sun's side over a horizon, panorama goes all round, fisheye looks up; the "
        "first is sky.png, others sky.VIEW.png",
        min_length=1,
        max_length=3,
    )
    exposure_ev100: Number | None = key(
        None,
        "exposure of the pictures (15: sunlit, -3: deep twilight); unset: by the sky",
        unit="EV",
        ge=-60.0,
        le=60.0,
    )
    exposure: Literal["each", "series"] = key(
        "each", "where exposure_ev100 is unset: each picture by its own sky, or all of a series by the brightest"
    )
    tone_mapping: Literal["photographic", "filmic", "gamma", "eye", "camera"] = key(
        "photographic",
        "of the pictures: photographic has contrast, filmic is soft, gamma clips, eye sees as a person does at low "
        "light, camera takes a photograph",
    )
    eye: EyeTone = key(EyeTone, "of tone_mapping eye")
    camera: CameraTone = key(CameraTone, "of tone_mapping camera")
    colour_observer: Literal["cie1964_10deg", "cie1931_2deg"] = key("cie1964_10deg", "standard observer of all colours")

    @model_validator(mode="after")
    def _check(self) -> Output:
        for name in ("width", "spectral_width"):
            if getattr(self, name) % 4:
                raise ValueError(f"{name} must be a multiple of 4; got {getattr(self, name)}")
        return self


class Night(Section):
    """The moonless night sky behind the twilight; each part in units of its usual brightness, 0 leaves it out."""

    airglow: Number = key(
        1.0, "1: mean of a solar cycle; 0.7 to 1.3 from its minimum to maximum", unit="1", ge=0, le=100
    )
    starlight: Number = key(1.0, "all stars as a smooth glow, by galactic latitude", unit="1", ge=0, le=100)
    zodiacal_light: Number = key(1.0, "sunlight on interplanetary dust", unit="1", ge=0, le=100)


class Config(Section):
    """Everything that a render needs."""

    version: Literal[1] = Field(description="version of this layout, always 1")
    name: str | None = key(
        None, "short name, used for the output folder; unset: the climate's", min_length=1, max_length=100
    )
    description: str = key("", "one line about it", max_length=1000)
    climate: Climate = Field(description="name of a climate, path of its file, or the climate itself")
    sun: Sun = key(SunElevation, "elevation_deg | elevations_deg | at and place | start, stop, step_minutes and place")
    observer: Observer = key(Observer, "where the eye is")
    wavelengths: Wavelengths | None = key(
        None, "where the radiance is computed; unset: 8 from 380 to 720 nm, or those of a tabulated medium"
    )
    solar_spectrum: SolarSpectrum = key("astm_g173_etr", "irradiance of the sun on top of the atmosphere")
    solver: dict[str, Any] = key(dict, "name, quality, and any option of that solver (see `twilight solvers`)")
    night: Night | None = key(None, "airglow, starlight and zodiacal light; unset: none, {}: all as usual")
    terrain: Terrain | None = key(None, "mountains before the sky of observer.view, and their shadows; unset: none")
    texture: Texture = key(Texture, "directions")
    output: Output = key(Output, "pictures")
    leave_out: Flag = key(True, "leave out what cannot matter (see --plan)")
    vary: dict[str, Any] = key(
        dict,
        "series: dotted keys with lists, e.g. {aerosol.relative_humidity_percent: [50, 80, 95]}, or with ranges {from, "
        "to, count, scale: linear | log}; list: mappings of keys that change together; latin_hypercube: {samples, "
        "seed, ranges: {key: {from, to, scale} | [choices]}}",
    )

    @model_validator(mode="after")
    def _stands_on_the_ground(self) -> Config:
        if self.terrain is not None and self.observer.view is None:
            raise ValueError("terrain: is seen in a view alone; set observer.view, e.g. {kind: perspective}")
        ground_km = self.climate.ground.altitude_km
        if ground_km > 0.0 and "altitude_km" not in self.observer.model_fields_set:
            object.__setattr__(self, "observer", self.observer.model_copy(update={"altitude_km": ground_km}))
        elif self.observer.altitude_km < ground_km:
            raise ValueError(
                f"observer.altitude_km is {self.observer.altitude_km:g}, below the ground (ground.altitude_km, "
                f"{ground_km:g} km); both count from sea level"
            )
        return self

    @model_validator(mode="after")
    def _has_the_disc(self) -> Config:
        if self.output.disc and not self.sun.disc:
            raise ValueError("output.disc needs the sun's disc: set sun.disc to true")
        if "disc" in (self.output.files or ()) and not self.sun.disc:
            raise ValueError("output.files: disc needs the sun's disc: set sun.disc to true")
        return self

    @property
    def title(self) -> str:
        """The configuration's name, or else its climate's."""
        return self.name or self.climate.name
