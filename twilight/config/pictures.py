"""What is drawn and written: `output` (files, programs, looks), `observer.view` (a picture in place of the hemisphere)
and `terrain` (mountains in front of the sky of a view).
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from twilight.base.errors import TwilightError
from twilight.base.formats import FORMATS, check_names
from twilight.base.sections import Flag, Integer, Number, Section, key
from twilight.numerics.directions import azimuth_elevation
from twilight.numerics.projections import PROJECTIONS, projection_of, shape_of, view_rays


def _files(value: tuple[str, ...] | None) -> tuple[str, ...] | None:
    if value == ():
        raise ValueError("must name one file at least")
    return value if value is None else check_names(value)


PIXELS_AT_ONCE = 1 << 18
"""Pixels whose directions are held at once."""


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
        f"which files are written: {', '.join(FORMATS.own)}; unset: all, polarisation where the light is polarised",
    )
    polariser_deg: Number | None = key(
        None,
        "axis of a polariser before the pictures and sky.rgb.exr, from the vertical of each line of sight, clockwise; "
        "unset: none",
        unit="deg",
        ge=-180.0,
        le=180.0,
    )
    renderer: Literal["openexr", "mitsuba", "blender", "radiance", "pbrt"] = key(
        "openexr", "whose environment map sky.rgb.exr is"
    )
    disc: Flag = key(False, "whether the sun's disc is in the environment maps; it needs sun.disc")
    width: Integer = key(1024, "of sky.rgb.exr", unit="pixel", ge=8, le=16384)
    primaries: Literal["rec709", "acescg", "rec2020"] = key("rec709", "red, green and blue of sky.rgb.exr")
    exr: Literal["float", "half"] | None = key(
        None, "samples of sky.rgb.exr, 32 or 16 bits; unset: half from a width of 4096 on, where it holds the light"
    )
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


def _known(name: str) -> str:
    try:
        projection_of(name)
    except TwilightError:
        raise ValueError(f"must be one of {', '.join(PROJECTIONS)}; got {name}") from None
    return name


class View(Section):
    """A picture from the observer's place in any direction, the ground and space included."""

    kind: Annotated[str, AfterValidator(_known)] = Field(
        description=f"projection: {', '.join(PROJECTIONS)} (perspective is a pinhole camera, latlong the whole sphere)"
    )
    width: Integer = key(1024, "of the picture", unit="pixel", ge=4, le=16384)
    height: Integer | None = key(None, "of the picture; unset: as the kind has it", unit="pixel", ge=1, le=16384)
    field_of_view_deg: Number | None = key(
        None, "across the width; unset: as the kind has it", unit="deg", gt=0.0, le=360.0
    )
    azimuth_deg: Number = key(
        0.0, "of the picture's middle, clockwise from the sun's azimuth", unit="deg", ge=-360.0, le=360.0
    )
    elevation_deg: Number | None = key(
        None,
        "of the picture's middle; unset: 0, the zenith for fisheye and octahedral, 17.3 for cylinder",
        unit="deg",
        ge=-90.0,
        le=90.0,
    )
    roll_deg: Number = key(0.0, "the camera is turned clockwise about its axis", unit="deg", ge=-180.0, le=180.0)
    band_deg: tuple[Number, ...] | None = key(
        None, "elevations of the lower and upper edge of a limb strip", unit="deg", min_length=2, max_length=2
    )

    @model_validator(mode="after")
    def _check(self) -> View:
        try:
            shape_of(self.kind, self.width, self.height)
            self.model_copy(update={"width": 16, "height": None}).rays()
        except TwilightError as error:
            raise ValueError(str(error)) from None
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width) [pixels]."""
        return shape_of(self.kind, self.width, self.height)

    @property
    def extent_deg(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The least and the largest elevation, and azimuth from the sun within 0..180, of all pixels [deg]."""
        height, width = self.shape
        step = max(1, PIXELS_AT_ONCE // width)
        extents = []
        for first in range(0, height, step):
            azimuth, elevation = azimuth_elevation(self.rays((first, min(first + step, height))))
            inside = np.isfinite(elevation)
            if inside.any():
                e, a = elevation[inside], np.minimum(azimuth, 360.0 - azimuth)[inside]
                extents.append((e.min(), e.max(), a.min(), a.max()))
        low, high, left, right = np.array(extents).T
        return (float(low.min()), float(high.max())), (float(left.min()), float(right.max()))

    def rays(self, rows: tuple[int, int] | None = None) -> np.ndarray:
        """Unit vectors (height, width, 3) of the pixel centres, or of some rows, as `views.view_rays`."""
        return view_rays(
            self.kind,
            self.width,
            self.height,
            field_of_view_deg=self.field_of_view_deg,
            azimuth_deg=self.azimuth_deg,
            elevation_deg=self.elevation_deg,
            roll_deg=self.roll_deg,
            band_deg=None if self.band_deg is None else (self.band_deg[0], self.band_deg[1]),
            rows=rows,
        )


NAMES = ("ridges", "ridge", "peak", "jacksboro")


class Terrain(Section):
    """A field of heights on a square around the observer, or anywhere towards the sun."""

    heights: str = key(
        "ridges",
        "ridges (mountains by a formula), ridge (one long crest), peak (a single cone), jacksboro (hills of Tennessee, "
        "30 x 32 km, 245 to 1068 m above sea level, the north far), or the path of a .npy or GeoTIFF file with "
        "altitudes above sea level in metres, rows from the far side to the near one; a GeoTIFF with coordinates lies "
        "where it is if the sun has a time and a place, which is the observer's",
        min_length=1,
        max_length=1000,
    )
    size_km: Number = key(
        60.0, "side of the square; of a GeoTIFF and of jacksboro their own", unit="km", gt=0.1, le=3000.0
    )
    count: Integer = key(512, "points along a side, for formulas", unit="1", ge=16, le=4096)
    base_km: Number = key(0.0, "altitude of the lowest ground, for formulas", unit="km", ge=-1.0, le=10.0)
    height_km: Number = key(2.0, "of the highest point above it, for formulas", unit="km", gt=0.0, le=100.0)
    seed: Integer = key(1, "of ridges", unit="1", ge=0, le=2**31)
    distance_km: Number = key(
        0.0, "distance of the square's middle from the observer, along its azimuth", unit="km", ge=-3000.0, le=3000.0
    )
    azimuth_deg: Number = key(
        0.0, "of the square's far side, clockwise from the sun's azimuth", unit="deg", ge=-360.0, le=360.0
    )
    albedo: Number = key(0.15, "Lambertian, the same at all wavelengths", unit="1", ge=0.0, le=1.0)
    shadows: Literal["exact", "segments", "none"] = key(
        "exact",
        "of the terrain in the air: exact takes sunlight scattered once out of every dark part of a line of sight; "
        "segments cuts the total length of dark parts off one end (Bruneton and Neyret 2008, eq. 17 and 18)",
    )

    @model_validator(mode="after")
    def _whole(self) -> Terrain:
        if self.heights in NAMES or self.heights.lower().endswith((".npy", ".tif", ".tiff")):
            return self
        raise ValueError(
            f"heights must be ridges, ridge, peak, jacksboro or the path of a .npy or .tif file; got {self.heights}"
        )
