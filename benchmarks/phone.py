"""Do the intervals of `twilight.estimate` hold?  Pictures of known air through a simulated phone.

    python benchmarks/phone.py [--count 50] [--summary]      # phone_pictures.csv, row by row; resumes

Each picture: a place, a time and an air drawn at random, its sky behind the horizon `typical` by
the solver zones (which is not what the fit takes), seen by a phone held 3 to 25 deg above the horizontal, tilted by up
to 4 deg, over dark hills of up to 2 deg; its lens darkens the corners by up to 8 %; noise of 1.5 % a pixel; gains of
10 % between the colours; a tone curve with 0.85 to 1.35 times the contrast and a shoulder; sRGB in 8 bits, JPEG of
quality 92.  Its Exif says time, place, altitude, heading (5 deg off), focal length in 35 mm (a whole number) and
exposure (40 % off).  ln of the optical depth is drawn alike within the bounds of the fit; ozone and albedo about what
is usual at the place (`usual`), with the spread that nature has.
`evening` draws six pictures, 16 minutes apart, from a sun of 3 to 6 deg to one below -3 deg, on a tripod.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import results
from PIL import ExifTags, Image

import twilight
from twilight.atmosphere.measured import climatological_column_du
from twilight.numerics import spectrum
from twilight.sky import colour
from twilight.sky.ephemeris import SunPosition, sun_position
from twilight.studies.camera import CameraModel
from twilight.studies.camera.exif import FULL_FRAME_MM, LENS_TRANSMISSION, MIDDLE_GREY
from twilight.studies.validate.photographs.air import ALBEDO_ERROR, OZONE_DU
from twilight.studies.validate.photographs.intervals import LARGEST_MISFIT

WIDTH, HEIGHT = 640, 480
FIRST_EVENING = 3
"""Number of the first that is judged: those before set `fit.SERIES_INFLATED`."""
PER_EVENING = 6
"""Pictures of an evening."""
BETWEEN = timedelta(minutes=16)
"""Time between two of them."""
TYPES = ("continental_average", "maritime_clean", "desert", "urban")
COLUMNS = (
    *("picture", "sun_elevation_deg", "parameter", "truth", "value", "low_68", "high_68", "low_95", "high_95"),
    *("told", "misfit", "amplitude", "processor_time_s"),
)


def moment(random: np.random.Generator) -> tuple[datetime, tuple[float, float], SunPosition]:
    """When and where a picture is taken, with the sun from -4 to 25 deg."""
    while True:
        place = float(random.uniform(-50.0, 60.0)), float(random.uniform(-180.0, 180.0))
        when = datetime(2024, 1, 1, tzinfo=UTC) + timedelta(minutes=int(random.integers(0, 366 * 1440)))
        sun = sun_position(when, *place, 0.0)
        if -4.0 < sun.elevation_deg < 25.0:
            return when, place, sun


def usual(random: np.random.Generator, when: datetime, latitude_deg: float) -> dict[str, float]:
    """Ozone [DU] and albedo of a place and time: normal about the zonal mean and about farmland's."""
    column_du = climatological_column_du(latitude_deg, when.timetuple().tm_yday) + OZONE_DU * random.standard_normal()
    albedo = 0.0
    while not 0.01 < albedo < 0.59:
        albedo = 0.15 + ALBEDO_ERROR * random.standard_normal()
    return {"ozone": float(np.clip(column_du, 201.0, 449.0)), "albedo": float(albedo)}


def solved(
    number: int, when: datetime, latitude_deg: float, suns_deg: list[float]
) -> tuple[dict[str, float], str, twilight.Field]:
    """What an air holds, the type of its aerosol, and its field for some suns."""
    random = np.random.default_rng(number)
    truth = {"aerosol": float(np.exp(random.uniform(np.log(0.03), np.log(0.6))))}
    truth |= usual(random, when, latitude_deg)
    kind = TYPES[number % 4]
    settings = {
        "aerosol.type": kind,
        "aerosol.optical_depth_550nm": truth["aerosol"],
        "gases.ozone.column_du": truth["ozone"],
        "ground.albedo": truth["albedo"],
        "horizon": "typical",
    }
    suns = [float(sun) for sun in suns_deg]
    field = twilight.solve("continental-average", sun_elevation_deg=suns, quality="draft", settings=settings)
    return truth, kind, field


def draw(index: int, folder: Path) -> tuple[Path, dict[str, float], str, float]:
    """A picture's file, what its air holds, the type of its aerosol, and the sun's elevation [deg]."""
    random = np.random.default_rng(1000 + index)
    when, place, sun = moment(random)
    truth, kind, field = solved(index, when, place[0], [sun.elevation_deg])
    sky = field.sky(float(sun.elevation_deg))
    heading = float(sun.azimuth_deg + random.uniform(-25.0, 25.0)) % 360.0
    focal_mm = float(random.uniform(22.0, 28.0))
    camera = held(heading, focal_mm, random)
    rgb = seen(sky, camera, float(sun.azimuth_deg), random)
    scale = 0.8 / float(np.percentile(rgb.max(axis=-1), 98))
    path = folder / f"phone-{index:02d}.jpg"
    Image.fromarray(developed(rgb * scale, random)).save(
        path, quality=92, exif=exif(when, place, heading + random.normal(0.0, 5.0), focal_mm, 1.0 / scale, random)
    )
    return path, truth, kind, float(sun.elevation_deg)


def evening(number: int, folder: Path) -> tuple[list[Path], dict[str, float], str]:
    """The pictures of an evening, what its air holds, and the type of its aerosol."""
    random = np.random.default_rng(5000 + number)
    while True:
        first, place, _ = moment(random)
        times = [first + k * BETWEEN for k in range(PER_EVENING)]
        suns = [sun_position(when, *place, 0.0) for when in times]
        if 3.0 < suns[0].elevation_deg < 6.0 and -9.0 < suns[-1].elevation_deg < -3.0:
            break
    truth, kind, field = solved(2000 + number, first, place[0], [sun.elevation_deg for sun in suns])
    heading = float(suns[2].azimuth_deg + random.uniform(-15.0, 15.0)) % 360.0
    focal_mm, compass_deg, paths = float(random.uniform(22.0, 28.0)), heading + random.normal(0.0, 5.0), []
    camera = held(heading, focal_mm, random)
    for when, sun in zip(times, suns, strict=True):
        alike = [np.random.default_rng([number, k]) for k in range(3)]  # lens, curve and exposure of one phone
        rgb = seen(field.sky(float(sun.elevation_deg)), camera, float(sun.azimuth_deg), alike[0])
        scale = 0.8 / float(np.percentile(rgb.max(axis=-1), 98))
        paths.append(folder / f"evening-{number:02d}-{len(paths)}.jpg")
        about = exif(when, place, compass_deg, focal_mm, 1.0 / scale, alike[2])
        Image.fromarray(developed(rgb * scale, alike[1])).save(paths[-1], quality=92, exif=about)
    return paths, truth, kind


def held(heading: float, focal_mm: float, random: np.random.Generator) -> CameraModel:
    """A camera as it is held."""
    width = 2.0 * np.degrees(np.arctan(0.5 * WIDTH / (focal_mm / FULL_FRAME_MM * np.hypot(WIDTH, HEIGHT))))
    held = {"azimuth_deg": heading, "elevation_deg": float(random.uniform(3.0, 25.0))}
    return CameraModel.model_validate(
        {
            "projection": "perspective",
            "image": {"width_px": WIDTH, "height_px": HEIGHT},
            "lens": {"field_of_view_deg": float(width)},
            "orientation": held | {"roll_deg": float(random.uniform(-4.0, 4.0))},
        }
    )


def seen(sky: twilight.Sky, camera: CameraModel, sun_azimuth_deg: float, random: np.random.Generator) -> np.ndarray:
    """Light (H, W, 3) in cd m^-2 of Rec. 709: sky, disc and hills."""
    azimuth, elevation = camera.azimuth_elevation(camera.pixel_centres())
    relative = np.radians(azimuth - sun_azimuth_deg)
    a, b = random.uniform(0.0, 2.0 * np.pi, 2)
    hills = random.uniform(0.2, 1.0) * (1.0 + 0.5 * np.sin(9.0 * relative + a) + 0.5 * np.sin(23.0 * relative + b))
    up = elevation > hills
    rgb = np.zeros((*elevation.shape, 3))
    to_rgb = spectrum.xyz_to_rgb_matrix("cie1931_2deg")
    factor = sky.sample(elevation[up], azimuth[up] - sun_azimuth_deg)
    rgb[up] = colour.sky_to_xyz(sky, factor, observer="cie1931_2deg") @ to_rgb.T
    level = float(np.median(rgb[up]))
    ground = random.uniform(0.02, 0.08) * np.array([1.2, 1.0, 0.7]) * level
    rgb[~up] = ground * random.uniform(0.6, 1.4, (int((~up).sum()), 1))
    apparent = sky.sun_elevation_deg if sky.apparent_sun_elevation_deg is None else sky.apparent_sun_elevation_deg
    e, s = np.radians(elevation), np.radians(apparent)
    away = np.degrees(np.arccos(np.sin(e) * np.sin(s) + np.cos(e) * np.cos(s) * np.cos(relative)))
    rgb[up & (away < 0.4)] = 1e3 * level
    off = camera.angle_off_axis(camera.pixel_centres())
    return rgb * (1.0 - random.uniform(0.0, 0.08) * (off / off.max())[..., None] ** 2)


def developed(rgb: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """8 bits (H, W, 3) as the phone makes them."""
    light = np.maximum(rgb, 0.0) * np.exp(random.normal(0.0, 0.1, 3) * (1.0, 0.0, 1.0))
    light = np.maximum(light * (1.0 + 0.015 * random.standard_normal(light.shape)), 1e-6)
    contrast = random.uniform(0.85, 1.35)
    toned = MIDDLE_GREY * (light / MIDDLE_GREY) ** contrast
    shoulder = random.uniform(1.2, 3.0)
    toned = toned / (1.0 + (toned / 1.05) ** shoulder) ** (1.0 / shoulder)
    return np.round(255.0 * np.clip(colour.srgb_encode(toned), 0.0, 1.0)).astype(np.uint8)


def exif(
    when: datetime,
    place: tuple[float, float],
    heading: float,
    focal_mm: float,
    cd_per_m2: float,
    random: np.random.Generator,
) -> Image.Exif:
    """What the phone says of a picture whose linear light 1 is a luminance."""
    made, base, gps = Image.Exif(), ExifTags.Base, ExifTags.GPS
    product = 10.0 * 1.8**2 / (LENS_TRANSMISSION * MIDDLE_GREY * cd_per_m2 * np.exp(random.normal(0.0, 0.35)))
    made.get_ifd(ExifTags.IFD.Exif).update(
        {
            base.FocalLengthIn35mmFilm: round(focal_mm),
            base.ExposureTime: product / 50.0,
            base.FNumber: 1.8,
            base.ISOSpeedRatings: 50,
        }
    )
    sides = ("N" if place[0] >= 0.0 else "S", "E" if place[1] >= 0.0 else "W")
    made.get_ifd(ExifTags.IFD.GPSInfo).update(
        {
            gps.GPSLatitudeRef: sides[0],
            gps.GPSLatitude: (abs(place[0]), 0.0, 0.0),
            gps.GPSLongitudeRef: sides[1],
            gps.GPSLongitude: (abs(place[1]), 0.0, 0.0),
            gps.GPSDateStamp: when.strftime("%Y:%m:%d"),
            gps.GPSTimeStamp: (float(when.hour), float(when.minute), 0.0),
            gps.GPSImgDirection: float(heading % 360.0),
            gps.GPSAltitude: 0.0,
        }
    )
    return made


def one(index: int) -> list[list[str]]:
    """Rows of a picture."""
    with tempfile.TemporaryDirectory() as folder:
        picture, truth, kind, elevation = draw(index, Path(folder))
        begin = time.process_time()
        found = twilight.estimate(picture, types=[kind], settings={"aerosol.type": kind})
        seconds = time.process_time() - begin
    return rows_of([str(index), f"{elevation:.2f}"], found, truth, seconds)


def rows_of(head: list[str], found: Any, truth: dict[str, float], seconds: float) -> list[list[str]]:
    """A row for each parameter of an estimate whose truth is known, after the same head."""
    rows = []
    for name, p in found.parameters.items():
        if name in truth:
            numbers = (truth[name], p.value, p.low, p.high, p.low_95, p.high_95)
            last = (f"{found.best.misfit:.3g}", f"{found.best.amplitude:g}", f"{seconds:.1f}")
            rows.append([*head, name, *(f"{x:.4g}" for x in numbers), str(p.constrained), *last])
    return rows


def summary(rows: list[list[str]]) -> list[str]:
    """How often intervals hold, all parameters and each; a picture whose fit does not fit, and says so, has none."""
    fitted = [row for row in rows if float(row[10]) <= LARGEST_MISFIT]
    lines = [f"{len({row[0] for row in rows})} pictures, {len({row[0] for row in fitted})} of them are fitted"]
    for name in ("all", "told", "aerosol", "ozone", "albedo"):
        chosen = [row for row in fitted if name in ("all", row[2]) or (name == "told" and row[9] == "True")]
        if chosen:
            t, _, a, b, c, d = np.array([row[3:9] for row in chosen], float).T
            held, held_95 = np.mean((a <= t) & (t <= b)), np.mean((c <= t) & (t <= d))
            lines.append(f"{name}: {len(chosen)} values, 68 % hold {held:.0%}, 95 % hold {held_95:.0%}")
    return lines


def main() -> None:
    """Draw and fit what the table lacks."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--count", type=int, default=50)
    arguments.add_argument("--first", type=int, default=0)
    arguments.add_argument("--table", type=Path, default=results.FOLDER / "phone_pictures.csv")
    arguments.add_argument("--summary", action="store_true")
    given = arguments.parse_args()
    rows = results.kept(given.table)
    for index in () if given.summary else range(given.first, given.first + given.count):
        if not any(row[0] == str(index) for row in rows):
            rows += one(index)
            results.write(given.table, COLUMNS, rows, notes=summary(rows), command="python benchmarks/phone.py")
            for row in rows[-3:]:
                print(*row, flush=True)
    print(*summary(rows), sep="\n")


if __name__ == "__main__":
    main()
