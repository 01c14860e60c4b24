"""Text files of measurements, line by line, and which of several measurements is nearest to a place and time."""

import math
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from twilight.base.conventions import EARTH_RADIUS_KM
from twilight.base.errors import TwilightError
from twilight.base.reading import reading

MAX_BYTES = 400_000_000
"""Largest file of text that is read."""


NO_CONTENT = "__MACOSX/"
"""What one system puts into zip archives beside the files."""
UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
GZIP = b"\x1f\x8b"
"""First bytes of a gzip file."""
NOT_MEASURED = ("", "nan", "n/a", "na", "null", "none", "m", "-", "--", "//", "///", "////")
"""Words that stand for a missing number, in lower case."""


def read_bytes(path: Path, count: int = -1) -> bytes:
    """The first bytes of a file, -1: all; of the one file in a zip archive where it is one."""
    with reading(path, "a file that can be read"):
        if path.stat().st_size > MAX_BYTES:
            raise TwilightError(f"{path}: is larger than {MAX_BYTES // 1_000_000} MB, which is the most allowed")
        if not zipfile.is_zipfile(path):
            with open(path, "rb") as file:
                return file.read(count)
        with zipfile.ZipFile(path) as archive:
            members = [
                info for info in archive.infolist() if not info.is_dir() and not info.filename.startswith(NO_CONTENT)
            ]
            if len(members) != 1 or members[0].file_size > MAX_BYTES:
                names = ", ".join(info.filename for info in members[:4]) + ", ..." * (len(members) > 4)
                raise TwilightError(
                    f"{path}: holds {len(members)} files ({names}); allowed is one of {MAX_BYTES // 1_000_000} MB at "
                    "most: unpack it and give them one by one"
                )
            with archive.open(members[0]) as file:
                return file.read(count)


def read_lines(path: Path) -> list[str]:
    """The lines of a text; letters outside UTF-8 (names of stations) are read as Latin-1."""
    content = read_bytes(path)
    try:
        text = content.decode("utf-16" if content[:2] in UTF16_MARKS else "utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    return text.splitlines()


def number(
    path: Path,
    line: int,
    name: str,
    text: str,
    low: float,
    high: float,
    unit: str = "",
    missing: tuple[float, ...] = (),
) -> float:
    """A number of a line (counted from 1), NaN for one of `missing` and, where there are such, for a word of that.

    Errors: TwilightError with the file, the line and what is allowed.
    """
    if missing and text.strip().lower() in NOT_MEASURED:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if value in missing:
        return math.nan
    if not low <= value <= high:
        unit = f" {unit}" if unit else ""
        raise TwilightError(
            f"{path}: line {line}: {name} is `{text.strip()[:40]}`, allowed is a number from {low:g} to {high:g}{unit}"
        )
    return value


def moment(path: Path, line: int, text: str, layout: str) -> datetime:
    """A time in UTC, in a layout of `strptime`; TwilightError with the file and the line."""
    try:
        return datetime.strptime(text.strip(), layout).replace(tzinfo=UTC)
    except ValueError:
        example = f"{datetime(2026, 6, 21, 12):{layout}}"
        raise TwilightError(f"{path}: line {line}: `{text.strip()[:60]}` is no time such as {example}") from None


FAR_KM, FAR_HOURS = 300.0, 12.0
"""What was measured farther away than this is warned of: weather is another there and then."""
SAME_PLACE_KM = 1.0
"""Places that are nearer to each other are one."""


@dataclass(frozen=True)
class PlaceAndTime:
    """A time (aware) and a place [deg], north and east positive; None where not given."""

    time: datetime | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None

    def hours_to(self, time: datetime | None) -> float | None:
        """How far another time is away [h], later positive; None where one is not known."""
        if self.time is None or time is None:
            return None
        return (time - self.time).total_seconds() / 3600.0

    def km_to(self, latitude_deg: float | None, longitude_deg: float | None) -> float | None:
        """Distance to another place [km]; None where one is not known."""
        if None in (self.latitude_deg, self.longitude_deg, latitude_deg, longitude_deg):
            return None
        a, b = math.radians(self.latitude_deg), math.radians(latitude_deg)  # type: ignore[arg-type]
        half = math.radians(longitude_deg - self.longitude_deg) / 2.0  # type: ignore[operator]
        chord = math.sin((b - a) / 2.0) ** 2 + math.cos(a) * math.cos(b) * math.sin(half) ** 2
        return 2.0 * EARTH_RADIUS_KM * math.asin(min(1.0, math.sqrt(chord)))

    def away(self, time: datetime | None, latitude_deg: float | None = None, longitude_deg: float | None = None) -> str:
        """`, 85 km and 2.3 h away`; nothing for what is not known."""
        km, hours = self.km_to(latitude_deg, longitude_deg), self.hours_to(time)
        parts = [] if km is None else [f"{km:.0f} km"]
        if hours is not None:
            parts.append(f"{abs(hours):.1f} h" if abs(hours) < 100.0 else f"{abs(hours) / 24.0:.0f} days")
        return f", {' and '.join(parts)} away" if parts else ""

    def warnings(
        self, source: str, time: datetime | None, latitude_deg: float | None = None, longitude_deg: float | None = None
    ) -> tuple[str, ...]:
        """A sentence where what was measured there and then is far away; source: words on what, where and when."""
        km, hours = self.km_to(latitude_deg, longitude_deg), self.hours_to(time)
        far = [f"more than {FAR_KM:g} km"] * (km is not None and km > FAR_KM)
        far += [f"more than {FAR_HOURS:g} h"] * (hours is not None and abs(hours) > FAR_HOURS)
        return (f"{source}: is {' and '.join(far)} from the place and time that it stands for",) if far else ()

    def nearest(
        self,
        times: Sequence[datetime],
        file: object,
        what: str,
        places: Sequence[tuple[float | None, float | None]] | None = None,
    ) -> int:
        """Which of several is nearest: first in place, where they have one [deg], then in time.

        Errors: TwilightError where there are several places, or several times at it, and none is asked for.
        """
        index = list(range(len(times)))
        if places is not None and (known := [i for i in index if None not in places[i]]):
            first = places[known[0]]
            if self.latitude_deg is not None:
                km = {i: self.km_to(*places[i]) or 0.0 for i in known}
                index = [i for i in known if km[i] <= min(km.values()) + SAME_PLACE_KM]
            elif any((PlaceAndTime(None, *first).km_to(*places[i]) or 0.0) > SAME_PLACE_KM for i in known):
                raise TwilightError(
                    f"{file}: holds {what} of several places; say where by air.latitude_deg and air.longitude_deg, "
                    "--latitude and --longitude, or the sun's"
                )
        if self.time is None:
            if len(index) > 1:
                moments = [times[i] for i in index]
                raise TwilightError(
                    f"{file}: holds {len(moments)} {what}, from {spoken(min(moments))} to {spoken(max(moments))}; say "
                    "which by its time (air.at, --at, or the sun's)"
                )
            return index[0]
        return min(index, key=lambda i: abs((times[i] - self.time).total_seconds()))  # type: ignore[operator]

    def place(self, file: object) -> tuple[float, float]:
        """Latitude and longitude [deg]; TwilightError where they are not given."""
        if self.latitude_deg is None or self.longitude_deg is None:
            raise TwilightError(
                f"{file}: holds a map; say where by air.latitude_deg and air.longitude_deg, --latitude and "
                "--longitude, or the sun's"
            )
        return self.latitude_deg, self.longitude_deg


def spoken(time: datetime) -> str:
    """`2026-06-21 12:00 UTC`."""
    return f"{time.astimezone(UTC):%Y-%m-%d %H:%M} UTC"
