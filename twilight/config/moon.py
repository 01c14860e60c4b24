"""The section `moon:`, a second sun, from place and time or where it is put."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from twilight.base.sections import Number, Section, key


class MoonSection(Section):
    """The moon, whose light in the air is that of a sun in its place, times its irradiance over the sun's."""

    elevation_deg: Annotated[Number, Field(ge=-90.0, le=90.0)] | None = key(
        None, "true elevation of its centre; unset: from the place and time of the sun", unit="deg"
    )
    azimuth_deg: Number | None = key(
        None, "clockwise from the sun's azimuth; 180 where elevation_deg is set", unit="deg", ge=-360.0, le=360.0
    )
    phase_angle_deg: Number | None = key(
        None,
        "angle between sun and observer at the moon: 0 full, 90 half, 180 new; unset: as sun and moon stand",
        unit="deg",
        ge=0.0,
        le=180.0,
    )
    distance_km: Number | None = key(
        None, "distance from the observer; 384400 where elevation_deg is set", unit="km", ge=350000.0, le=410000.0
    )

    @model_validator(mode="after")
    def _check(self) -> MoonSection:
        if self.elevation_deg is None and self.model_fields_set - {"elevation_deg"}:
            name = sorted(self.model_fields_set - {"elevation_deg"})[0]
            raise ValueError(f"{name} needs elevation_deg beside it; without it the moon stands where the time says")
        return self
