"""`observer.view`: a picture in place of the hemisphere of the sky."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from twilight.base.errors import TwilightError
from twilight.config.base import Integer, Number, Section, key
from twilight.numerics.projections import PROJECTIONS, projection_of, shape_of, view_rays


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
