"""The climate document: the air and the ground, and nothing about the sun, the observer or the picture."""

from __future__ import annotations

import itertools
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from twilight.config.base import Flag, Integer, Number, Section, key

Profile = Literal[
    "tropical", "midlatitude_summer", "midlatitude_winter", "subarctic_summer", "subarctic_winter", "us_standard"
]
AerosolType = Literal[
    "continental_clean",
    "continental_average",
    "continental_polluted",
    "urban",
    "desert",
    "maritime_clean",
    "maritime_polluted",
    "maritime_tropical",
    "arctic",
    "antarctic",
]
Component = Literal["inso", "waso", "soot", "ssam", "sscm", "minm", "miam", "micm", "mitr", "suso"]


StratosphereKind = Literal[
    "background",
    "moderate_volcanic",
    "high_volcanic",
    "extreme_volcanic",
    "nh_midlat_low",
    "nh_midlat_typical",
    "nh_midlat_elevated",
    "nh_midlat_extreme",
    "sh_midlat_low",
    "sh_midlat_typical",
    "sh_midlat_elevated",
    "sh_midlat_extreme",
    "tropical_low",
    "tropical_typical",
    "tropical_elevated",
    "tropical_extreme",
]


class Layers(Section):
    """How the air is cut into layers; with neither key, at the levels of the profile."""

    equal_air_mass: Integer | None = key(
        None,
        "number of homogeneous layers that hold the same mass of air (Haber 2005 sec. 4.1.2)",
        unit="1",
        ge=2,
        le=500,
    )
    boundaries_km: tuple[Number, ...] | None = key(
        None, "altitudes above sea level, increasing from the ground, e.g. [0, 1, 2, 5, 10, 20, 50, 100]", unit="km"
    )

    @model_validator(mode="after")
    def _one_rule(self) -> Layers:
        b = self.boundaries_km
        if b is not None and self.equal_air_mass is not None:
            raise ValueError("takes either equal_air_mass or boundaries_km, not both")
        if b is not None and (len(b) < 2 or any(hi <= lo for lo, hi in itertools.pairwise(b))):
            raise ValueError("boundaries_km must start at the ground and increase up to top_km")
        return self


class Atmosphere(Section):
    """Pressure, temperature, humidity and gas densities with altitude."""

    profile: Profile = key("midlatitude_summer", "AFGL profile of pressure, temperature, air and gases")
    top_km: Number = key(100.0, "altitude above which there is vacuum", unit="km", ge=10.0, le=120.0)
    layers: Layers = key(Layers, "how the air is cut into layers")

    @model_validator(mode="after")
    def _up_to_the_top(self) -> Atmosphere:
        b = self.layers.boundaries_km
        if b is not None and abs(b[-1] - self.top_km) > 1e-9 * self.top_km:
            raise ValueError(f"layers.boundaries_km must end at top_km, {self.top_km:g} km, not at {b[-1]:g} km")
        return self


class Ozone(Section):
    """Ozone: how much, and where it absorbs."""

    column_du: Number | None = key(
        None,
        "total column; unset: the profile's own (AFGL 1986, means of many years: tropical 282, 15 N; midlatitude 45 N, "
        "summer 334, winter 378; subarctic 60 N, summer 348, winter 375; US standard 344)",
        unit="DU",
        ge=0.0,
        le=1000.0,
    )
    day_of_year: Integer | None = key(
        None, "sets the column by season, 260 to 370 DU over the year (Haber 2005 sec. 4.3)", unit="day", ge=1, le=366
    )
    treatment: Literal["layer", "overhead_filter", "none"] = key(
        "layer", "layer: absorbs along every path; overhead_filter: on the sunlight above the top only (Haber); none"
    )

    @model_validator(mode="after")
    def _one_column(self) -> Ozone:
        if self.column_du is not None and self.day_of_year is not None:
            raise ValueError("takes either column_du or day_of_year, not both")
        return self


class Gases(Section):
    """Absorbing gases."""

    ozone: Ozone = key(Ozone, "ozone")
    no2: Flag = key(True, "nitrogen dioxide absorbs")
    o4: Flag = key(True, "oxygen collision pairs (O4) absorb")


class Refraction(Section):
    """The refractive index of air; it bends the sunlight."""

    model: Literal["ciddor", "haber", "none"] = key(
        "ciddor", "ciddor: Ciddor 1996 in full; haber: the closed form of Haber 2005 sec. 4.4; none: straight rays"
    )
    co2_ppm: Number = key(420.0, "carbon dioxide in the air, enters Ciddor's index", unit="ppm", ge=0.0, le=2000.0)


class MineralTransported(Section):
    """A layer of desert dust carried from afar, the same at all its altitudes."""

    bottom_km: Number = key(2.0, "altitude where it begins", unit="km", ge=0.0, le=100.0)
    top_km: Number = key(5.0, "altitude where it ends", unit="km", ge=0.0, le=100.0)
    number_density_per_cm3: Number | None = key(
        None, "particles; unset: give the optical depth", unit="cm^-3", ge=0.0, le=1e6
    )
    optical_depth_550nm: Number | None = key(
        None, "of this layer alone at 550 nm; unset: give the number density", unit="1", ge=0.0, le=20.0
    )

    @model_validator(mode="after")
    def _one_amount(self) -> MineralTransported:
        if (self.number_density_per_cm3 is None) == (self.optical_depth_550nm is None):
            raise ValueError("needs either number_density_per_cm3 or optical_depth_550nm")
        if self.top_km <= self.bottom_km:
            raise ValueError("top_km must be above bottom_km")
        return self


class Aerosol(Section):
    """Particles below the stratosphere: an OPAC type, or a mixture of OPAC components, and its height profile."""

    type: AerosolType | None = key(None, "one of the ten OPAC types; unset: give components")
    components: dict[Component, Annotated[Number, Field(ge=0.0, le=1e9)]] = key(
        dict, "own mixture at the ground by OPAC component, e.g. {waso: 7000, inso: 0.4}", unit="cm^-3"
    )
    relative_humidity_percent: Number = key(
        80.0, "humidity that the particles have swollen in", unit="%", ge=0.0, le=99.0
    )
    optical_depth_550nm: Number | None = key(
        None,
        "scales the aerosol to this vertical optical depth at 550 nm; unset: as the mixture gives",
        unit="1",
        ge=0.0,
        le=20.0,
    )
    phase_function: Literal["mie", "henyey_greenstein"] = key(
        "mie", "mie: as computed; henyey_greenstein: with the asymmetry that Mie gives, in the stratosphere too"
    )
    boundary_layer_top_km: Number | None = key(
        None,
        "top of the layer that holds the mixture, above its base; unset: the type's own (2 km for own mixtures)",
        unit="km",
        gt=0.0,
        le=12.0,
    )
    scale_height_km: Number | None = key(
        None,
        "of the mixture inside that layer; unset: the type's own (8 km for own mixtures)",
        unit="km",
        gt=0.0,
        le=1000.0,
    )
    boundary_layer_base: Literal["ground", "sea_level"] = key(
        "ground",
        "where that layer's heights and densities count from: the ground at ground.altitude_km, or sea level, so that "
        "a mountain rises through it",
    )
    mineral_transported: MineralTransported | None = key(None, "a layer of transported desert dust; unset: none")
    free_troposphere: Flag = key(True, "OPAC's background between the boundary layer and 12 km")
    stratosphere: Literal["measured", "opac", "none"] = key(
        "measured",
        "measured: SAGE III/ISS, typical loading, of the profile's latitude; opac: OPAC's background, constant from 12 "
        "to 35 km, too bright in twilight; none (the section stratosphere takes its place)",
    )

    @model_validator(mode="after")
    def _one_source(self) -> Aerosol:
        if (self.type is None) == (not self.components):
            raise ValueError("needs either type (an OPAC type) or components (an own mixture)")
        return self


class Stratosphere(Section):
    """Particles of the stratosphere, in place of what aerosol.stratosphere says."""

    kind: StratosphereKind = key(
        "background",
        "loading of LOWTRAN 7 (Shettle and Fenn), or a profile measured by SAGE III/ISS by region and loading",
    )
    season: Literal["spring_summer", "fall_winter"] = key("spring_summer", "half of the year, for LOWTRAN's loadings")
    upper_atmosphere: Literal["normal", "extreme"] = key("normal", "meteoric dust above 30 km, for LOWTRAN's loadings")

    @model_validator(mode="after")
    def _measured(self) -> Stratosphere:
        if not self.kind.endswith(("background", "volcanic")):
            for name in ("season", "upper_atmosphere"):
                if getattr(self, name) != type(self).model_fields[name].default:
                    raise ValueError(f"{name} has no meaning for the measured profile {self.kind}")
        return self


class Spectrum(Section):
    """A quantity over wavelength, linear in between and constant outside."""

    wavelength_nm: tuple[Number, ...] = key(
        (380.0, 720.0), "wavelengths, increasing", unit="nm", min_length=1, max_length=2000
    )
    albedo: tuple[Annotated[Number, Field(ge=0.0, le=1.0)], ...] = key((0.0, 0.0), "one for each wavelength", unit="1")

    @model_validator(mode="after")
    def _match(self) -> Spectrum:
        w = self.wavelength_nm
        if len(w) != len(self.albedo):
            raise ValueError(f"has {len(w)} wavelength_nm but {len(self.albedo)} albedo values")
        if any(b <= a for a, b in itertools.pairwise(w)):
            raise ValueError("wavelength_nm must increase")
        return self


def _albedo_kind(value: Any) -> str:
    return "<spectrum>" if isinstance(value, dict | Spectrum) else "<number>"


class Ground(Section):
    """The ground: a sphere at one altitude, which reflects alike in all directions (Lambert)."""

    albedo: Annotated[
        Annotated[Number, Field(ge=0.0, le=1.0), Tag("<number>")] | Annotated[Spectrum, Tag("<spectrum>")],
        Discriminator(_albedo_kind),
    ] = key(0.0, "share of light reflected, a number or {wavelength_nm: [...], albedo: [...]}", unit="1")
    altitude_km: Number = key(
        0.0,
        "above sea level, of all the land that is seen: air and gases begin there (for a peak above low land leave 0 "
        "and set observer.altitude_km)",
        unit="km",
        ge=0.0,
        le=9.0,
    )


class TabulatedMedium(Section):
    """Air given as a table of coefficients, one row per level and wavelength, instead of by composition."""

    table: str = key("", "CSV file, relative to the folder of the climate's file", min_length=1)
    depolarisation: Number = key(0.0, "of the air's Rayleigh phase function", unit="1", ge=0.0, le=0.5)

    sha256: str | None = key(None, "the table's SHA-256; if given, another table is an error", pattern="^[0-9a-f]{64}$")

    @field_validator("table")
    @classmethod
    def _one_line(cls, value: str) -> str:
        if "\0" in value or "\n" in value:
            raise ValueError("must be the path of a file")
        return value


class Climate(Section):
    """The air and the ground."""

    version: Literal[1] = Field(description="version of this layout, always 1")
    name: str = key("climate", "short name, used for output folders and titles", min_length=1, max_length=100)
    description: str = key("", "one line about it", max_length=1000)
    atmosphere: Atmosphere = key(Atmosphere, "pressure, temperature, humidity and gas densities")
    gases: Gases = key(Gases, "absorbing gases")
    refraction: Refraction = key(Refraction, "refractive index of the air")
    aerosol: Aerosol | None = key(None, "particles below the stratosphere; unset: none")
    stratosphere: Stratosphere | None = key(
        None, "particles of the stratosphere; unset: what aerosol.stratosphere says, if there is any aerosol"
    )
    ground: Ground = key(Ground, "the ground")
    medium: TabulatedMedium | None = key(None, "a tabulated medium instead of all the sections above but ground")

    @model_validator(mode="after")
    def _table_or_composition(self) -> Climate:
        if self.medium is not None:
            mixed = {"atmosphere", "gases", "refraction", "aerosol", "stratosphere"} & self.model_fields_set
            if mixed:
                raise ValueError(f"takes either medium (a table) or {', '.join(sorted(mixed))}, not both")
            if self.ground.altitude_km != 0.0:
                raise ValueError("ground.altitude_km has no meaning for a table: its lowest level is the ground")
            return self
        lowest = (self.atmosphere.layers.boundaries_km or (self.ground.altitude_km,))[0]
        if lowest != self.ground.altitude_km:
            raise ValueError(
                f"atmosphere.layers.boundaries_km must start at the ground (ground.altitude_km, "
                f"{self.ground.altitude_km:g} km), not at {lowest:g} km"
            )
        return self
