"""`terrain`: mountains in front of the sky of a view."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from twilight.config.base import Integer, Number, Section, key

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
