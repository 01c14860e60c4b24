"""What a picture says of how it was taken (Exif, XMP), and the camera that follows from it.

Time and place give the sun; the focal length in 35 mm the field of view; compass and pitch the orientation; exposure
time, aperture and sensitivity the luminance.  What cannot be, lacks its reference or contradicts another statement is
not taken, and `Stated.doubts` says so: a receiver without a fix, 0 N 0 E, a date of another count of weeks, a fix older
than the exposure.  By ISO 12232 a camera's sensitivity S is such that a surface of luminance

    L = 10 lx s N^2 / (0.65 t S)

comes out as 118 of 255 in sRGB (standard output sensitivity; 0.65 is the usual transmission of a lens), N being the
aperture and t the exposure time.  Cameras keep that to a third of a stop, and phones lift shadows: `LUMINANCE_LN`.
"""

import contextlib
import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from twilight.base.errors import TwilightError
from twilight.studies.camera.model import CameraModel, ImageSize, Lens, Orientation

FULL_FRAME_MM = math.hypot(36.0, 24.0)
"""Diagonal of the picture that focal lengths "in 35 mm" are for (CIPA DCG-001) [mm]."""
MIDDLE_GREY = 0.18
"""Linear light of 118 of 255 in sRGB."""
LENS_TRANSMISSION = 0.65
"""q of ISO 12232, with which exposures are computed from the scene's luminance."""
LUMINANCE_LN = 0.4
"""Standard error of ln(luminance) by exposure time, aperture and sensitivity: a factor of 1.5."""
ANGLE_ERROR_DEG = 1.5
"""Standard error of a phone's own pitch and roll [deg]."""
COMPASS_ERROR_DEG = 10.0
"""Standard error of a phone's compass, magnetic declination not undone [deg]."""
LARGEST_CROP = 0.02
"""Difference of the proportions from those of the sensor beyond which a picture has been cut, and its field of view is
not what the focal length says."""

ALTITUDE_M = (-450.0, 15e3)
"""Altitudes above the sea from which skies are photographed [m]: the Dead Sea, an airliner."""
FIX_AGREES = timedelta(minutes=2)
"""Difference of the receiver's time from the camera's up to which they are one."""
FROM_SOLAR_TIME = timedelta(hours=4)
"""Difference of a zone's time from that of the sun, at most: 3.5 hours in the west of China, in summer 3 in Spain."""
OLDEST_FIX = timedelta(days=1)
"""Age of a fix beyond which its place is not that of the picture."""
WEEKS_COUNTED = timedelta(weeks=1024)
"""After so many weeks the satellites' count begins again, and old receivers take that for the past."""
FROM_NADIR_DEG = 45.0
"""Camera:Pitch from which on it is counted from the nadir, as Pix4D defines it; a camera that really looked further
down shows no sky."""

_XMP_NUMBER = r"""(?::|\s){}\s*(?:=\s*["']|>)\s*([-+]?[0-9.]+)"""
_PITCH = ("GimbalPitchDegree", "PosePitchDegrees", "CameraPitch")
_ROLL = ("GimbalRollDegree", "PoseRollDegrees", "CameraRoll", "Roll")
_DATE = re.compile(r"(\d{4})[:/-](\d\d)[:/-](\d\d)[ T](\d\d):(\d\d)(?::(\d\d)(?:[.,]\d*)?)?\s*(Z|[+-]\d\d:?\d\d)?")
"""Exif's date and time, also as ISO 8601 writes it, with parts of a second and with an offset."""


@dataclass(frozen=True)
class Stated:
    """What a file says of its picture; None: nothing.

    moment: with its offset from UTC where that is said.  latitude_deg, longitude_deg, altitude_m.  heading_deg: of the
    optical axis, clockwise from north.  pitch_deg, roll_deg: as of `camera.model.Orientation`.  focal_35mm [mm].
    cd_per_m2: luminance of linear light 1.  size: of the picture as it was taken.  doubts: sentences on what was said
    and is not taken.
    """

    moment: datetime | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_m: float | None = None
    heading_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    focal_35mm: float | None = None
    cd_per_m2: float | None = None
    size: tuple[int, int] | None = None
    anything: bool = False
    doubts: tuple[str, ...] = ()

    @property
    def sun(self) -> dict[str, Any] | None:
        """The section `sun` of a scene by place and time; None where the file does not say both, and the offset."""
        if self.latitude_deg is None or self.longitude_deg is None or self.moment is None:
            return None
        if self.moment.tzinfo is None:
            return None
        place = {"latitude_deg": self.latitude_deg, "longitude_deg": self.longitude_deg}
        return {"at": self.moment.isoformat(), **place}

    def camera(self, path: Path, width_px: int, height_px: int, field_of_view_deg: float | None) -> CameraModel:
        """The camera of an upright picture of that size; field_of_view_deg: across its width, in place of what the
        file says.

        Its orientation has an elevation only where the file says one.  Errors: TwilightError that asks for what lacks.
        """
        if field_of_view_deg is None:
            if self.focal_35mm is None:
                nothing = "" if self.anything else ", and nothing else of how it was taken (a screenshot, or sent on)"
                raise TwilightError(
                    f"{path}: is {width_px} x {height_px}, no panorama of the whole sphere (twice as wide as high), "
                    f"and its file does not say the focal length in 35 mm{nothing}; give its width in degrees "
                    "(--field-of-view), or its camera (--camera)"
                )
            if self.size is not None:
                long, short = max(self.size), min(self.size)
                if abs(long / short / (max(width_px, height_px) / min(width_px, height_px)) - 1.0) > LARGEST_CROP:
                    raise TwilightError(
                        f"{path}: was taken as {self.size[0]} x {self.size[1]} and is {width_px} x {height_px}: it has "
                        "been cut, so that its focal length does not say its field of view; give --field-of-view"
                    )
            focal_px = self.focal_35mm / FULL_FRAME_MM * math.hypot(width_px, height_px)
            field_of_view_deg = 2.0 * math.degrees(math.atan(0.5 * width_px / focal_px))
        if not 1.0 <= field_of_view_deg < 170.0:
            raise TwilightError(f"{path}: a field of view of {field_of_view_deg:.3g} deg; allowed is 1 to 170")
        angles = {"elevation_deg": self.pitch_deg, "roll_deg": self.roll_deg}
        known = {name: value for name, value in angles.items() if value is not None}
        return CameraModel(
            projection="perspective",
            image=ImageSize(width_px=width_px, height_px=height_px),
            lens=Lens(field_of_view_deg=field_of_view_deg),
            orientation=Orientation(azimuth_deg=self.heading_deg, **known),
            response="srgb",
        )


STATES_NOTHING = Stated()


def read_stated(path: str | Path) -> Stated:
    """What a JPEG, PNG, TIFF, HEIF or RAW file says of its picture; nothing for any other, or one that is damaged."""
    from PIL import ExifTags, Image  # start-up

    path = Path(path)
    with contextlib.suppress(ImportError):
        import pillow_heif  # optional

        pillow_heif.register_heif_opener()
    try:
        with warnings.catch_warnings(), Image.open(path) as image:
            warnings.simplefilter("ignore")
            exif = image.getexif()
            main, taken = dict(exif), dict(exif.get_ifd(ExifTags.IFD.Exif))
            gps = dict(exif.get_ifd(ExifTags.IFD.GPSInfo))
            xmp = image.info.get("xmp", b"") or image.info.get("XML:com.adobe.xmp", "")
    except (OSError, ValueError, SyntaxError, TypeError, KeyError, Image.DecompressionBombError):
        return STATES_NOTHING
    text = xmp.decode("utf-8", "replace") if isinstance(xmp, bytes) else str(xmp)
    width, height = (_number(taken.get(tag)) for tag in (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight))
    heading = _number(gps.get(ExifTags.GPS.GPSImgDirection))
    doubts: list[str] = []
    clock = _clock(main, taken, doubts)
    latitude, longitude, altitude, fix = _fix(gps, doubts)
    moment, place_holds = _agreed(clock, fix, longitude, doubts)
    if not place_holds:
        latitude = longitude = altitude = None
    roll = _in_xmp(text, _ROLL)
    return Stated(
        moment=moment,
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_m=altitude,
        heading_deg=None if heading is None or not 0.0 <= heading <= 360.0 else heading,
        pitch_deg=_pitch(text, doubts),
        roll_deg=None if roll is None or not -180.0 <= roll <= 180.0 else roll,
        focal_35mm=_positive(taken.get(ExifTags.Base.FocalLengthIn35mmFilm)),
        cd_per_m2=_luminance(taken),
        size=(round(width), round(height)) if width and height and width > 0 and height > 0 else None,
        anything=bool(taken or gps),
        doubts=tuple(doubts),
    )


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) else None


def _positive(value: Any) -> float | None:
    number = _number(value)
    return number if number is not None and number > 0.0 else None


def _in_xmp(text: str, names: tuple[str, ...]) -> float | None:
    for name in names:
        found = re.search(_XMP_NUMBER.format(name), text)
        if found is not None and (number := _number(found.group(1))) is not None:
            return number
    return None


def _pitch(text: str, doubts: list[str]) -> float | None:
    """Angle of the optical axis above the horizontal [deg]."""
    level, pitch = _in_xmp(text, _PITCH), _in_xmp(text, ("Pitch",))
    if pitch is not None and pitch >= FROM_NADIR_DEG and (level is None or abs(pitch - 90.0 - level) < 1.0):
        doubts.append(f"Camera:Pitch {pitch:g} is counted from the nadir: {pitch - 90.0:+.1f} deg from the horizontal")
        pitch -= 90.0
    if level is not None and pitch is not None and abs(pitch - level) >= 1.0:
        doubts.append(f"says two pitches, {level:g} and {pitch:g} deg; neither is taken")
        return None
    pitch = pitch if level is None else level
    return None if pitch is None or not -90.0 <= pitch <= 90.0 else pitch


def _clock(main: Mapping[int, Any], taken: Mapping[int, Any], doubts: list[str]) -> datetime | None:
    """When the picture was taken by the camera's clock, with its offset where that is said."""
    from PIL.ExifTags import Base  # start-up

    for tags, when, zone in (
        (taken, Base.DateTimeOriginal, Base.OffsetTimeOriginal),
        (taken, Base.DateTimeDigitized, Base.OffsetTimeDigitized),
        (main, Base.DateTime, Base.OffsetTime),
    ):
        said, offset = (str(value).strip("\0 ") for value in (tags.get(when, ""), taken.get(zone, "")))
        if not re.search("[1-9]", said):
            continue  # of an unknown date Exif has blanks or zeros
        found = _DATE.fullmatch(said)
        with contextlib.suppress(ValueError):
            *parts, own = found.groups() if found else ()
            year, month, day, hour, minute, second = (int(part or 0) for part in parts)
            local = datetime(year, month, day, hour, minute, min(second, 59))
            if own and re.fullmatch(r"Z|[+-]\d\d:?\d\d", offset) and _aware(local, own) != _aware(local, offset):
                doubts.append(f"says two offsets from UTC, {own} and {offset}: {own}, beside its time, is taken")
            with contextlib.suppress(ValueError):
                return _aware(local, own or offset)
            return local
        doubts.append(f"its time {said[:40]!r} is not read: no date and time of Exif")
    return None


def _aware(local: datetime, offset: str) -> datetime:
    return datetime.fromisoformat(local.isoformat() + offset.replace("Z", "+00:00"))


def _fix(gps: Mapping[int, Any], doubts: list[str]) -> tuple[float | None, float | None, float | None, datetime | None]:
    """Latitude, longitude [deg], altitude [m] and time of the receiver's fix."""
    from PIL.ExifTags import GPS  # start-up

    if str(gps.get(GPS.GPSStatus, "A")).strip("\0 ").upper().startswith("V"):
        doubts.append("its receiver had no fix (GPSStatus V): place, altitude and satellites' time are not taken")
        return None, None, None, None
    latitude = _place(gps, GPS.GPSLatitude, GPS.GPSLatitudeRef, "NS", 90.0, doubts)
    longitude = _place(gps, GPS.GPSLongitude, GPS.GPSLongitudeRef, "EW", 180.0, doubts)
    altitude = _altitude(gps, doubts)
    if latitude == 0.0 and longitude == 0.0:
        doubts.append("says 0 N 0 E, which stands for a place that is not known: it is not taken")
        latitude = longitude = altitude = None
    day, clock, time = str(gps.get(GPS.GPSDateStamp, "")).strip("\0 "), gps.get(GPS.GPSTimeStamp), None
    with contextlib.suppress(TypeError, ValueError, ZeroDivisionError, OverflowError):
        hour, minute, second = (float(part) for part in clock or ())
        date = datetime.strptime(day.replace("-", ":"), "%Y:%m:%d").replace(tzinfo=UTC)
        time = date.replace(hour=int(hour), minute=int(minute), second=min(int(second), 59))
    return latitude, longitude, altitude, time


def _agreed(
    clock: datetime | None, fix: datetime | None, longitude_deg: float | None, doubts: list[str]
) -> tuple[datetime | None, bool]:
    """The time by satellites, else by the camera's clock; whether the place of the fix is that of the picture."""
    if clock is None or fix is None:
        return (clock if fix is None else fix), True
    zoned, day = clock.tzinfo is not None, timedelta(days=1)
    between = clock.replace(tzinfo=clock.tzinfo or UTC) - fix
    # a clock without an offset is local time, 12 hours behind UTC to 14 before it, and near that of the sun
    early, late = (-FIX_AGREES, FIX_AGREES) if zoned else (timedelta(hours=-12.1), timedelta(hours=14.1))
    off = timedelta() if zoned or longitude_deg is None else between - timedelta(hours=longitude_deg / 15.0)
    if early <= between <= late and abs((off + day / 2) % day - day / 2) <= FROM_SOLAR_TIME:
        return fix, True
    turns = round(between / WEEKS_COUNTED)
    rest, taken = between - turns * WEEKS_COUNTED, f"the camera's, {clock.isoformat()}, is taken"
    if turns and early - OLDEST_FIX <= rest <= late + OLDEST_FIX:
        doubts.append(f"GPS says {fix:%Y-%m-%d}, {turns} x 1024 weeks beside the camera: weeks counted anew; {taken}")
        return clock if zoned or not early <= rest <= late else fix + turns * WEEKS_COUNTED, True
    side = "before" if between > timedelta() else "after"
    hours = f"{abs(between) / timedelta(hours=1):.1f} hours {side} the camera's"
    holds = abs(between) <= OLDEST_FIX + max(abs(early), abs(late))
    place = "" if holds else ", and its place is not"
    doubts.append(f"GPS has a time {hours}, a fix older than the exposure or a wrong clock: {taken}{place}")
    return clock, holds


def _place(gps: Mapping[int, Any], tag: int, side: int, sides: str, most: float, doubts: list[str]) -> float | None:
    value = math.nan
    with contextlib.suppress(TypeError, ValueError, ZeroDivisionError):
        degrees, minutes, seconds = (float(part) for part in gps.get(tag) or ())
        value = degrees + minutes / 60.0 + seconds / 3600.0
    if not 0.0 <= value <= most:
        if tag in gps:
            doubts.append(f"its place is not taken: 0 to {most:g} deg {sides[0]} or {sides[1]} is not {gps[tag]!s:.40}")
        return None
    said = str(gps.get(side, "")).strip("\0 ").upper()[:1]
    if said not in tuple(sides):
        doubts.append(f"says {value:.4g} deg without {sides[0]} or {sides[1]}: its place is not taken")
        return None
    return -value if said == sides[1] else value


def _altitude(gps: Mapping[int, Any], doubts: list[str]) -> float | None:
    from PIL.ExifTags import GPS  # start-up

    value = _number(gps.get(GPS.GPSAltitude))
    if value is None:
        return None
    value = -value if gps.get(GPS.GPSAltitudeRef) in (1, 3, b"\x01", b"\x03", "1") else value
    if not ALTITUDE_M[0] <= value <= ALTITUDE_M[1]:
        doubts.append(f"says an altitude of {value:g} m, from which no sky is photographed: it is not taken")
        return None
    return value


def _luminance(taken: Mapping[int, Any]) -> float | None:
    """Luminance [cd m^-2] of linear light 1; None where time, aperture or sensitivity is not said."""
    from PIL.ExifTags import Base  # start-up

    sensitivity = taken.get(Base.ISOSpeedRatings)
    if isinstance(sensitivity, tuple):
        sensitivity = sensitivity[0] if sensitivity else None
    seconds, aperture, iso = (
        _positive(value) for value in (taken.get(Base.ExposureTime), taken.get(Base.FNumber), sensitivity)
    )
    if seconds is None or aperture is None or iso is None:
        return None
    return 10.0 * aperture**2 / (LENS_TRANSMISSION * seconds * iso) / MIDDLE_GREY
