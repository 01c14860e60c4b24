"""The climate document: the air, its clouds and the ground, and nothing about the sun, the observer or the picture."""

from __future__ import annotations

from collections.abc import Iterator
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from twilight.atmosphere.profiles import AirProfile, load_profile, profile_of_levels
from twilight.base.conventions import LOWEST_GROUND_KM, ROUNDING
from twilight.base.errors import TwilightError
from twilight.base.sections import FilePath, Flag, Increasing, Integer, Number, Section, check_lengths, increase, key
from twilight.config.aerosol import Aerosol, Stratosphere
from twilight.config.air import Air, air_files

THINNEST_KM = 0.01
"""Least thickness of a cloud [km]."""
CloudKind = Literal["fog", "stratus", "altostratus", "cirrus", "noctilucent"]


class Cloud(Section):
    """A homogeneous layer of cloud, the same from horizon to horizon; what is unset is the kind's own."""

    kind: CloudKind = key(
        "stratus",
        "fog, stratus, altostratus: droplets; cirrus: hexagonal crystals with halos; noctilucent: grains of ice at "
        "83 km, lit while the sun is at -6 to -16 deg",
    )
    base_km: Number | None = key(
        None,
        "altitude above sea level where it begins; unset: fog the ground, stratus 0.5, altostratus 3, cirrus 9, "
        "noctilucent 82.4",
        unit="km",
        ge=0.0,
        le=119.0,
    )
    top_km: Number | None = key(
        None,
        "altitude where it ends; unset: above the base fog 0.2, stratus 0.5, altostratus 1, cirrus 1.5, noctilucent 1",
        unit="km",
        ge=0.0,
        le=120.0,
    )
    optical_depth: Number | None = key(
        None,
        "vertical, at 550 nm; unset: fog 5, stratus 25, altostratus 10, cirrus 1, noctilucent 1e-5",
        unit="1",
        ge=0.0,
        le=100.0,
    )
    effective_radius_um: Number | None = key(
        None,
        "of the spheres' sizes, of cirrus none; unset: fog 10.7, stratus and altostratus 7.33, noctilucent 0.05",
        unit="um",
        ge=0.01,
        le=50.0,
    )

    @model_validator(mode="after")
    def _possible(self) -> Cloud:
        base, top = self.base_km, self.top_km
        if base is not None and top is not None and top < base + THINNEST_KM * (1.0 - ROUNDING):
            raise ValueError(f"top_km, {top:g}, must be {THINNEST_KM:g} km or more above base_km, {base:g}")
        if self.kind == "cirrus" and self.effective_radius_um is not None:
            raise ValueError("effective_radius_um has no meaning for cirrus, whose crystals are OPAC's (91.7 um)")
        return self


AirProfileName = Literal[
    "tropical", "midlatitude_summer", "midlatitude_winter", "subarctic_summer", "subarctic_winter", "us_standard"
]
CLIMATE_FILES: tuple[tuple[tuple[str, ...], str, str | None], ...] = (
    (("atmosphere", "levels"), "file", None),
    (("medium",), "table", "sha256"),
    (("medium",), "phase_function", "phase_function_sha256"),
    (("aerosol", "table"), "file", "sha256"),
    (("aerosol", "table"), "phase_function", "phase_function_sha256"),
    (("ground",), "albedo_map", "albedo_map_sha256"),
    (("gases", "own"), "file", "sha256"),
)
"""Keys of a climate that name files, by section, and the keys of their SHA-256."""


def climate_files(climate: Any) -> Iterator[tuple[Any, tuple[str, ...], Any, str | None]]:
    """For each file that a climate (plain data) names: the section that holds it, its place, its key, its SHA-256's.

    Files of `air` have no SHA-256: what they held stands in the climate's other sections once they are read.
    """
    yield from air_files(climate)
    for place, name, sha256 in CLIMATE_FILES:
        section = climate
        for part in place:
            section = section.get(part) if isinstance(section, dict) else None
        if isinstance(section, dict) and isinstance(section.get(name), str) and section[name]:
            yield section, place, name, sha256


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
    coefficients: Literal["mean", "centre"] = key(
        "mean", "of a layer: their mean over it, which keeps columns, or those at its centre (Haber)"
    )

    @model_validator(mode="after")
    def _one_rule(self) -> Layers:
        b = self.boundaries_km
        if b is not None and self.equal_air_mass is not None:
            raise ValueError("takes either equal_air_mass or boundaries_km, not both")
        if b is None and self.equal_air_mass is None and self.coefficients == "centre":
            raise ValueError("coefficients: centre needs equal_air_mass or boundaries_km")
        if b is not None and (len(b) < 2 or not increase(b)):
            raise ValueError("boundaries_km must start at the ground and increase up to top_km")
        return self


LEVEL_COLUMNS = {
    "altitude_km": (LOWEST_GROUND_KM, 120.0, f"{LOWEST_GROUND_KM:g} to 120 (km)"),
    "pressure_hpa": (1e-9, 1200.0, "1e-9 to 1200 (hPa)"),
    "temperature_k": (120.0, 1000.0, "120 to 1000 (K)"),
    "water_vapour_ppm": (0.0, 2e5, "0 to 2e5"),
    "ozone_ppm": (0.0, 1e3, "0 to 1e3"),
}
"""Columns of a file of levels, and the numbers that they may hold."""


class Levels(Section):
    """The air at someone's own altitudes; between them as between those of the AFGL atmospheres."""

    file: FilePath | None = key(
        None,
        "CSV with the columns altitude_km, pressure_hpa, temperature_k, water_vapour_ppm, ozone_ppm, in place of them; "
        "relative to the folder of the climate's file",
        min_length=1,
    )
    altitude_km: Annotated[tuple[Annotated[Number, Field(ge=LOWEST_GROUND_KM, le=120.0)], ...], Increasing] = key(
        ..., "above sea level, increasing, from the ground (or below) to top_km (or above)", unit="km", min_length=2,
        max_length=500,
    )  # fmt: skip
    pressure_hpa: tuple[Annotated[Number, Field(gt=0.0, le=1200.0)], ...] = key(
        ..., "one for each altitude, decreasing", unit="hPa"
    )
    temperature_k: tuple[Annotated[Number, Field(ge=120.0, le=1000.0)], ...] = key(..., "likewise", unit="K")
    water_vapour_ppm: tuple[Annotated[Number, Field(ge=0.0, le=2e5)], ...] = key(
        ..., "molecules per million of moist air, likewise", unit="1e-6"
    )
    ozone_ppm: tuple[Annotated[Number, Field(ge=0.0, le=1e3)], ...] = key(..., "likewise", unit="1e-6")

    @model_validator(mode="before")
    @classmethod
    def _of_file(cls, value: Any) -> Any:
        """What the file holds, in place of its name: so it is recorded with a sky."""
        if not isinstance(value, dict) or not isinstance(value.get("file"), str):
            return value
        if not isfile(value["file"]):
            raise ValueError(f"file: there is no file {value['file']}")
        if len(value) > 1:
            raise ValueError("takes either file or the columns themselves, not both")
        from twilight.atmosphere.csv_columns import read_columns  # start-up: numpy

        try:
            names, rows, _ = read_columns(Path(value["file"]), LEVEL_COLUMNS)
        except TwilightError as error:
            raise ValueError(f"file: {error}") from None
        return {name: column.tolist() for name, column in zip(names, rows.T, strict=True)}

    @model_validator(mode="after")
    def _match(self) -> Levels:
        check_lengths(self, "altitude_km", "pressure_hpa", "temperature_k", "water_vapour_ppm", "ozone_ppm")
        if not increase(reversed(self.pressure_hpa)):
            raise ValueError("pressure_hpa must decrease")
        return self


class Atmosphere(Section):
    """Pressure, temperature, humidity and gas densities with altitude."""

    profile: AirProfileName = key("midlatitude_summer", "AFGL profile of pressure, temperature, air and gases")
    levels: Levels | None = key(
        None,
        "own altitudes, pressures, temperatures, humidity and ozone in place of the profile's, whose NO2 stays",
    )
    top_km: Number = key(100.0, "altitude above which there is vacuum", unit="km", ge=10.0, le=120.0)
    layers: Layers = key(Layers, "how the air is cut into layers")

    @model_validator(mode="after")
    def _up_to_the_top(self) -> Atmosphere:
        b = self.layers.boundaries_km
        if b is not None and abs(b[-1] - self.top_km) > ROUNDING * self.top_km:
            raise ValueError(f"layers.boundaries_km must end at top_km, {self.top_km:g} km, not at {b[-1]:g} km")
        if self.levels is not None and self.levels.altitude_km[-1] < self.top_km:
            highest = self.levels.altitude_km[-1]
            raise ValueError(f"levels.altitude_km must go up to top_km, {self.top_km:g} km, not to {highest:g} km")
        return self


class Ozone(Section):
    """Ozone: how much, and where it absorbs."""

    column_du: Number | None = key(
        None,
        "total column; unset: the zonal mean of the sun's place and day, without them of the profile's latitude and "
        "season (tropical 271, midlatitude summer 323, winter 339, subarctic summer 319, winter 353, US standard 331); "
        "levels of one's own have theirs",
        unit="DU",
        ge=0.0,
        le=1000.0,
    )
    day_of_year: Integer | None = key(
        None, "sets the column by season, 260 to 370 DU over the year (Haber 2005 sec. 4.3)", unit="day", ge=1, le=366
    )
    climatology: Flag = key(
        True,
        "whether an unset column is a zonal mean (McPeters et al. 2007); false: the profile's own (AFGL 1986: tropical "
        "282, midlatitude summer 334, winter 378, subarctic summer 348, winter 375, US standard 344)",
    )
    treatment: Literal["layer", "overhead_filter", "none"] = key(
        "layer", "layer: absorbs along every path; overhead_filter: on the sunlight above the top only (Haber); none"
    )

    @model_validator(mode="after")
    def _one_column(self) -> Ozone:
        if self.column_du is not None and self.day_of_year is not None:
            raise ValueError("takes either column_du or day_of_year, not both")
        return self


class WaterVapour(Section):
    """Water vapour: how much absorbs in its bands (590, 690, 720, 820, 940 nm)."""

    column_mm: Number | None = key(
        None,
        "precipitable water above the ground; 0: none absorbs; unset: the profile's own (AFGL 1986: tropical 41, "
        "midlatitude summer 29, winter 9, subarctic summer 21, winter 4, US standard 14)",
        unit="mm",
        ge=0.0,
        le=150.0,
    )


class OwnGas(Section):
    """An absorber of one's own, mixed evenly into the air."""

    file: FilePath = key(..., "CSV with wavelength_nm and cross_section_cm2 (per molecule)", min_length=1)
    column_du: Number = key(..., "its vertical column", unit="DU", ge=0.0, le=1e6)
    sha256: str | None = key(None, "the file's SHA-256; if given, another is an error", pattern="^[0-9a-f]{64}$")


class Gases(Section):
    """Absorbing gases."""

    ozone: Ozone = key(Ozone, "ozone")
    water_vapour: WaterVapour = key(WaterVapour, "water vapour")
    oxygen: Flag = key(True, "oxygen absorbs in its bands at 688 and 762 nm")
    no2: Flag = key(True, "nitrogen dioxide absorbs")
    o4: Flag = key(True, "oxygen collision pairs (O4) absorb")
    own: OwnGas | None = key(None, "one more absorber; unset: none")


class Refraction(Section):
    """The refractive index of air; it bends the sunlight."""

    model: Literal["ciddor", "haber", "none"] = key(
        "ciddor", "ciddor: Ciddor 1996 in full; haber: the closed form of Haber 2005 sec. 4.4; none: straight rays"
    )
    relative_humidity_percent: Number = key(
        0.0,
        "of all the air in haber's closed form, which lets refraction fall to (100 - this) % of that of dry air",
        unit="%",
        ge=0.0,
        le=100.0,
    )
    co2_ppm: Number = key(420.0, "carbon dioxide in the air, enters Ciddor's index", unit="ppm", ge=0.0, le=2000.0)


class Spectrum(Section):
    """A quantity over wavelength, linear in between and constant outside."""

    wavelength_nm: Annotated[tuple[Number, ...], Increasing] = key(
        (380.0, 720.0), "wavelengths, increasing", unit="nm", min_length=1, max_length=2000
    )
    albedo: tuple[Annotated[Number, Field(ge=0.0, le=1.0)], ...] = key((0.0, 0.0), "one for each wavelength", unit="1")

    @model_validator(mode="after")
    def _match(self) -> Spectrum:
        check_lengths(self, "wavelength_nm", "albedo")
        return self


def _albedo_kind(value: Any) -> str:
    return "<spectrum>" if isinstance(value, dict | Spectrum) else "<number>"


class Ground(Section):
    """The ground: a sphere at one altitude, that reflects alike in all directions (Lambert)."""

    albedo: Annotated[
        Annotated[Number, Field(ge=0.0, le=1.0), Tag("<number>")] | Annotated[Spectrum, Tag("<spectrum>")],
        Discriminator(_albedo_kind),
    ] = key(
        0.0,
        "fraction of light reflected, a number or {wavelength_nm: [...], albedo: [...]}; with albedo_map: where that "
        "has none",
        unit="1",
    )
    albedo_map: FilePath | None = key(
        None,
        "albedo by latitude and longitude: netCDF (over lat, lon and, if it likes, wavelength), or a picture of the "
        "whole Earth (PNG, JPEG, EXR; north up, 180 deg W at the left); views see it, terrain has it, its mean over "
        "the ground in sight or within 100 km lights the air; relative to the folder of the climate's file",
        min_length=1,
    )
    albedo_map_sha256: str | None = key(
        None, "the map's SHA-256; if given, another is an error", pattern="^[0-9a-f]{64}$"
    )
    altitude_km: Number = key(
        0.0,
        "above sea level, of all the land that is seen: air and gases begin there (for a peak above low land leave 0 "
        "and set observer.altitude_km)",
        unit="km",
        ge=LOWEST_GROUND_KM,
        le=9.0,
    )


class TabulatedMedium(Section):
    """Air given as a table of coefficients, one row per level and wavelength, instead of by composition."""

    table: FilePath = key("", "CSV file, relative to the folder of the climate's file", min_length=1)
    depolarisation: Number = key(0.0, "of the air's Rayleigh phase function", unit="1", ge=0.0, le=0.5)
    phase_model: Literal["henyey_greenstein", "cornette_shanks"] = key(
        "henyey_greenstein", "of the aerosol, with the table's aerosol_asymmetry as its g"
    )
    earth_radius_km: Number = key(6371.0, "radius that altitudes are above", unit="km", ge=1000.0, le=100000.0)

    sha256: str | None = key(None, "the table's SHA-256; if given, another table is an error", pattern="^[0-9a-f]{64}$")

    phase_function: FilePath | None = key(
        None,
        "CSV of the aerosol's phase function (as aerosol.table.phase_function), in place of the table's column "
        "aerosol_asymmetry",
        min_length=1,
    )
    phase_function_sha256: str | None = key(
        None, "the phase function's SHA-256; if given, another is an error", pattern="^[0-9a-f]{64}$"
    )

    @model_validator(mode="after")
    def _one_phase_function(self) -> TabulatedMedium:
        if self.phase_function is not None and "phase_model" in self.model_fields_set:
            raise ValueError("takes either phase_function (a file) or phase_model, not both")
        return self


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
    clouds: tuple[Cloud, ...] = key(
        tuple,
        "layers of cloud over the whole sky, e.g. [{kind: altostratus, optical_depth: 8}]; where they overlap they add",
        max_length=10,
    )
    ground: Ground = key(Ground, "the ground")
    air: Air | None = key(
        None,
        "files of measurements in place of parts of the climate, e.g. {sounding: munich.txt}",
    )
    medium: TabulatedMedium | None = key(None, "a tabulated medium instead of all the sections above but ground")

    @model_validator(mode="after")
    def _table_or_composition(self) -> Climate:
        if self.medium is not None:
            mixed = {"atmosphere", "gases", "refraction", "aerosol", "stratosphere", "air"} & self.model_fields_set
            mixed |= {"clouds"} if self.clouds else set()
            if mixed:
                raise ValueError(f"takes either medium (a table) or {', '.join(sorted(mixed))}, not both")
            if self.ground.altitude_km != 0.0:
                raise ValueError("ground.altitude_km has no meaning for a table: its lowest level is the ground")
            return self
        levels = self.atmosphere.levels
        if levels is not None and levels.altitude_km[0] > self.ground.altitude_km:
            raise ValueError(
                f"atmosphere.levels.altitude_km must begin at or below the ground (ground.altitude_km, "
                f"{self.ground.altitude_km:g} km), not at {levels.altitude_km[0]:g} km"
            )
        lowest = (self.atmosphere.layers.boundaries_km or (self.ground.altitude_km,))[0]
        if lowest != self.ground.altitude_km:
            raise ValueError(
                f"atmosphere.layers.boundaries_km must start at the ground (ground.altitude_km, "
                f"{self.ground.altitude_km:g} km), not at {lowest:g} km"
            )
        return self


def air_profile(climate: Climate) -> AirProfile:
    """Pressure, temperature and gases of a climate that is no table, over all altitudes that it knows."""
    levels = climate.atmosphere.levels
    if levels is None:
        return load_profile(climate.atmosphere.profile)
    return profile_of_levels(climate.atmosphere.profile, **levels.model_dump(exclude={"file"}))
