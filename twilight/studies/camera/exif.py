"""What a picture says of how it was taken (Exif, XMP), and the camera that follows from it.

Time and place give the sun; the focal length in 35 mm the field of view; compass and pitch the orientation; exposure
time, aperture and sensitivity the luminance.  By ISO 12232 a camera's sensitivity S is such that a surface of luminance

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
from datetime import UTC, datetime
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

_XMP_NUMBER = r"""(?::|\s){}\s*(?:=\s*["']|>)\s*([-+]?[0-9.]+)"""
_PITCH = ("Pitch", "GimbalPitchDegree", "PosePitchDegrees", "CameraPitch")
_ROLL = ("Roll", "GimbalRollDegree", "PoseRollDegrees", "CameraRoll")


@dataclass(frozen=True)
class Stated:
    """What a file says of its picture; None: nothing.

    moment: with its offset from UTC where that is said.  latitude_deg, longitude_deg, altitude_m.  heading_deg: of the
    optical axis, clockwise from north.  pitch_deg, roll_deg: as of `camera.model.Orientation`.  focal_35mm [mm].
    cd_per_m2: luminance of linear light 1.  size: of the picture as it was taken.  model: of the camera.
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
    model: str = ""
    anything: bool = False

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
    pitch, roll = (next((v for n in names if (v := _in_xmp(text, n)) is not None), None) for names in (_PITCH, _ROLL))
    return Stated(
        moment=_moment(main, taken, gps),
        latitude_deg=_place(gps, ExifTags.GPS.GPSLatitude, ExifTags.GPS.GPSLatitudeRef, "S", 90.0),
        longitude_deg=_place(gps, ExifTags.GPS.GPSLongitude, ExifTags.GPS.GPSLongitudeRef, "W", 180.0),
        altitude_m=_altitude(gps),
        heading_deg=None if heading is None or not 0.0 <= heading <= 360.0 else heading,
        pitch_deg=None if pitch is None or not -90.0 <= pitch <= 90.0 else pitch,
        roll_deg=None if roll is None or not -180.0 <= roll <= 180.0 else roll,
        focal_35mm=_positive(taken.get(ExifTags.Base.FocalLengthIn35mmFilm)),
        cd_per_m2=_luminance(taken),
        size=(round(width), round(height)) if width and height and width > 0 and height > 0 else None,
        model=" ".join(
            str(main.get(tag, "")).strip("\0 ") for tag in (ExifTags.Base.Make, ExifTags.Base.Model)
        ).strip(),
        anything=bool(taken or gps),
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


def _in_xmp(text: str, name: str) -> float | None:
    found = re.search(_XMP_NUMBER.format(name), text)
    return None if found is None else _number(found.group(1))


def _moment(main: Mapping[int, Any], taken: Mapping[int, Any], gps: Mapping[int, Any]) -> datetime | None:
    """When the picture was taken: by satellites in UTC, else by the camera's clock with its offset, or without one."""
    from PIL.ExifTags import GPS, Base  # start-up

    day, clock = gps.get(GPS.GPSDateStamp), gps.get(GPS.GPSTimeStamp)
    with contextlib.suppress(TypeError, ValueError, ZeroDivisionError, OverflowError):
        hour, minute, second = (float(part) for part in clock or ())
        date = datetime.strptime(str(day).strip("\0 "), "%Y:%m:%d")
        return date.replace(hour=int(hour), minute=int(minute), second=min(int(second), 59), tzinfo=UTC)
    for tags, when, offset in (
        (taken, Base.DateTimeOriginal, Base.OffsetTimeOriginal),
        (taken, Base.DateTimeDigitized, Base.OffsetTimeDigitized),
        (main, Base.DateTime, Base.OffsetTime),
    ):
        said, zone = str(tags.get(when, "")).strip("\0 "), str(taken.get(offset, "")).strip("\0 ")
        with contextlib.suppress(ValueError):
            local = datetime.strptime(said, "%Y:%m:%d %H:%M:%S")
            with contextlib.suppress(ValueError):
                return datetime.fromisoformat(local.isoformat() + zone.replace("Z", "+00:00"))
            return local
    return None


def _place(gps: Mapping[int, Any], tag: int, side: int, negative: str, most: float) -> float | None:
    try:
        degrees, minutes, seconds = (float(part) for part in gps[tag])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None
    value = degrees + minutes / 60.0 + seconds / 3600.0
    if not 0.0 <= value <= most:
        return None
    return -value if str(gps.get(side, "")).upper().startswith(negative) else value


def _altitude(gps: Mapping[int, Any]) -> float | None:
    from PIL.ExifTags import GPS  # start-up

    value = _number(gps.get(GPS.GPSAltitude))
    if value is None:
        return None
    below = gps.get(GPS.GPSAltitudeRef)
    return -value if below in (1, b"\x01", "1") else value


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
