"""`horizon`: what lies beyond the horizon and takes sunbeams on their way: clouds, haze, mountains."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from twilight.config.base import Number, Section, increase, key


class HorizonClouds(Section):
    """Clouds beyond the horizon, as a part of the grazing beams that they stop."""

    cover: Number = key(0.7, "part of the beams far below the cloud tops that is stopped", unit="1", ge=0.0, le=1.0)
    top_km: Number = key(9.0, "mean altitude of the cloud tops", unit="km", ge=0.0, le=40.0)
    top_spread_km: Number = key(1.5, "standard deviation of that altitude", unit="km", ge=0.0, le=10.0)
    from_km: Number = key(
        150.0, "distance from the observer at which they begin; nearer it is clear", unit="km", ge=0.0, le=2000.0
    )


class Skyline(Section):
    """Mountains, or a dense bank of clouds, across the sun's azimuth."""

    height_km: Number = key(2.0, "of the skyline above sea level", unit="km", ge=0.0, le=100.0)
    distance_km: Number = key(100.0, "from the observer", unit="km", ge=0.0, le=2000.0)


class HorizonScreen(Section):
    """Which part of the direct sunbeams passes: a table by altitude, clouds, or a skyline; one of the three."""

    heights_km: tuple[Annotated[Number, Field(ge=-1.0, le=200.0)], ...] | None = key(
        None, "least altitudes of a beam on its way, increasing", unit="km", min_length=1, max_length=1000
    )
    transmission: tuple[Annotated[Number, Field(ge=0.0, le=1.0)], ...] | None = key(
        None,
        "part of the light that passes at each of heights_km; linear between, beyond them as at the ends",
        unit="1",
        min_length=1,
        max_length=1000,
    )
    from_km: Number = key(
        0.0, "with heights_km: distance from the observer at which they begin to count", unit="km", ge=0.0, le=2000.0
    )
    angstrom_exponent: Number = key(
        0.0,
        "with heights_km or clouds: how -ln(transmission) falls with wavelength, from the values given, which are "
        "those at 550 nm; 0 is grey (clouds), 1 to 2 haze and smoke",
        unit="1",
        ge=-1.0,
        le=5.0,
    )
    clouds: HorizonClouds | None = key(None, "clouds beyond the horizon; {}: 0.7 cover up to about 9 km")
    skyline: Skyline | None = key(None, "mountains or a dense bank of clouds")

    @model_validator(mode="after")
    def _one(self) -> HorizonScreen:
        table = self.heights_km is not None or self.transmission is not None
        if [table, self.clouds is not None, self.skyline is not None].count(True) != 1:
            raise ValueError("takes one of heights_km with transmission, clouds, and skyline")
        if table and (self.heights_km is None or self.transmission is None):
            raise ValueError("needs both heights_km and transmission")
        if self.heights_km is not None and self.transmission is not None:
            if len(self.heights_km) != len(self.transmission):
                raise ValueError(
                    f"heights_km has {len(self.heights_km)} values and transmission {len(self.transmission)}; they "
                    "must be as many"
                )
            if not increase(self.heights_km):
                raise ValueError("heights_km must increase")
        elif "from_km" in self.model_fields_set:
            raise ValueError("from_km belongs to heights_km; clouds have their own")
        if self.skyline is not None and self.angstrom_exponent != 0.0:
            raise ValueError("angstrom_exponent belongs to heights_km and clouds; a skyline is opaque")
        return self


TYPICAL = {"heights_km": [8.0, 9.5], "transmission": [0.15, 1.0], "from_km": 300.0}
"""`horizon: typical`: the screen with which three recorded evenings (Spitschan et al. 2016) have the change of 650/550
and 450/550 nm from their sensor's day within 15 % in the median from 0 to -6 deg, the zenith 0.10 mag fainter at most;
single evenings are 0.8 to 1.5 and 0.6 to 1.15 times off (docs/validation.md)."""


class Horizon(Section):
    """What lies beyond the horizon; `typical` in place of the section: the screen of `TYPICAL`."""

    screen: HorizonScreen | None = key(
        None, "what takes sunbeams on their way: heights_km and transmission | clouds | skyline; unset: nothing"
    )

    @model_validator(mode="before")
    @classmethod
    def _preset(cls, value: Any) -> Any:
        if isinstance(value, str):
            if value != "typical":
                raise ValueError(f"must be typical, or a section with a screen, got {value!r}")
            return {"screen": TYPICAL}
        return value
