"""The configuration document: a climate seen by an observer under one or more suns, and how to compute and write it.

`horizon` is what lies beyond the horizon and takes sunbeams on their way: clouds, haze, mountains.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from twilight.base.conventions import LOWEST_GROUND_KM, ROUNDING
from twilight.base.sections import Flag, Increasing, Integer, Number, Section, check_lengths, key
from twilight.config.climate import Climate
from twilight.config.moon import MoonSection
from twilight.config.pictures import Output, Terrain, View
from twilight.config.solver import ChosenSolver, SolverOptions, choose_solver
from twilight.config.sun import Sun, SunElevation, SunElevations, with_moment_of_horizon
from twilight.config.vary import Drawing


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

    heights_km: Annotated[tuple[Annotated[Number, Field(ge=-1.0, le=200.0)], ...], Increasing] | None = key(
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
            check_lengths(self, "heights_km", "transmission")
        elif "from_km" in self.model_fields_set:
            raise ValueError("from_km belongs to heights_km; clouds have their own")
        if self.skyline is not None and self.angstrom_exponent != 0.0:
            raise ValueError("angstrom_exponent belongs to heights_km and clouds; a skyline is opaque")
        return self


TYPICAL: dict[str, Any] = {"heights_km": [8.0, 9.5], "transmission": [0.15, 1.0], "from_km": 300.0}
"""`horizon: typical`: clouds and haze far beyond the horizon, as three recorded evenings have them (Spitschan et al.
2016).  A joint fit to these, a meter of the zenith and the zenith in deep twilight allows 7 to 12 km, 0 to 0.65 and 0
to 450 km (68 %; benchmarks/usual_screen.py), and holds this screen."""


class Horizon(Section):
    """What lies beyond the horizon; in place of the section `typical`, the screen of `TYPICAL`, or `clean`, nothing."""

    screen: HorizonScreen | None = key(
        None, "what takes sunbeams on their way: heights_km and transmission | clouds | skyline; unset: nothing"
    )

    @model_validator(mode="before")
    @classmethod
    def _preset(cls, value: Any) -> Any:
        if isinstance(value, str):
            if value not in ("typical", "clean"):
                raise ValueError(f"must be typical, clean, or a section with a screen, got {value!r}")
            return {"screen": TYPICAL} if value == "typical" else {}
        return value

    @property
    def name(self) -> str | None:
        """`typical` or `clean`; None for another screen."""
        return next((name for name in ("typical", "clean") if self == Horizon.model_validate(name)), None)


SolarSpectrum = Literal["astm_g173_etr", "astm_e490", "kurucz1992", "gueymard2003", "sao2010"]
PLACED_NM = (380.0, 440.0, 472.0, 548.0, 580.0, 616.0, 676.0, 756.0)
"""Eight wavelengths outside the bands of water vapour, oxygen, O4 and NO2 and on both slopes of ozone's, found by
`benchmarks/wavelengths.py`: luminance and colour from them are nearer to those from 91 than with eight equidistant ones
by a factor of four to twenty."""


class Observer(Section):
    """Where the eye is."""

    altitude_km: Number = key(
        0.0,
        "altitude above sea level; unset: on the ground (ground.altitude_km)",
        unit="km",
        ge=LOWEST_GROUND_KM,
        le=40000.0,
    )
    view: View | None = key(
        None, "a picture in any direction, sky.view.png, e.g. {kind: perspective, elevation_deg: -20}; unset: none"
    )


class Wavelengths(Section):
    """Where the radiance is computed; unset for a tabulated medium means the table's wavelengths."""

    min_nm: Number | None = key(None, "first of `count` equidistant wavelengths; 380", unit="nm", ge=280.0, le=1000.0)
    max_nm: Number | None = key(None, "last of `count` equidistant wavelengths; 720", unit="nm", ge=280.0, le=1000.0)
    count: Integer | None = key(None, "number of equidistant wavelengths; 8", unit="1", ge=1, le=2000)
    list_nm: Annotated[tuple[Annotated[Number, Field(ge=280.0, le=1000.0)], ...], Increasing] | None = key(
        None,
        "the wavelengths themselves, increasing, instead of min_nm, max_nm and count; where none of the four is set, "
        "eight that are placed so that colours come out right",
        unit="nm",
        min_length=1,
        max_length=2000,
    )

    @model_validator(mode="after")
    def _check(self) -> Wavelengths:
        w = self.list_nm
        if w is not None and (self.min_nm, self.max_nm, self.count) != (None, None, None):
            raise ValueError("takes either list_nm or min_nm, max_nm and count, not both")
        low, high, count = self._equidistant
        if high < low or (count > 1 and high == low):
            raise ValueError("max_nm must be above min_nm")
        return self

    @property
    def _equidistant(self) -> tuple[float, float, int]:
        return (
            380.0 if self.min_nm is None else self.min_nm,
            720.0 if self.max_nm is None else self.max_nm,
            8 if self.count is None else self.count,
        )

    @property
    def placed(self) -> bool:
        """Whether they are the eight of `PLACED_NM`, for want of others."""
        return (self.min_nm, self.max_nm, self.count, self.list_nm) == (None, None, None, None)

    @property
    def wavelength_nm(self) -> tuple[float, ...]:
        """The wavelengths [nm]."""
        if self.list_nm is not None:
            return self.list_nm
        if self.placed:
            return PLACED_NM
        low, high, count = self._equidistant
        step = (high - low) / max(count - 1, 1)
        return tuple(low + i * step for i in range(count))


class Texture(Section):
    """Directions of plain samples of the sky, in place of rows and columns that lie as close as its light needs."""

    azimuth_count: Integer | None = key(
        None, "columns over 360 deg; unset: as light needs, 120 in sweeps and of montecarlo", unit="1", ge=4, le=7200
    )
    elevation_count: Integer | None = key(
        None, "rows to the zenith; unset: as light needs, 30 in sweeps and of montecarlo", unit="1", ge=2, le=1800
    )
    resolution_deg: Number | None = key(
        None, "sets both counts: 360 and 90 divided by it, instead of them", unit="deg", ge=0.05, le=45.0
    )

    @model_validator(mode="after")
    def _check(self) -> Texture:
        step = self.resolution_deg
        if step is not None:
            if self.azimuth_count is not None or self.elevation_count is not None:
                raise ValueError("takes either resolution_deg or azimuth_count and elevation_count, not both")
            if abs(90.0 / step - round(90.0 / step)) > ROUNDING:
                raise ValueError(f"resolution_deg must divide 90, as 3 or 1.5 do; got {step:g}")
        return self

    @property
    def plain(self) -> bool:
        """Whether an equal grid of samples was asked for."""
        return (self.resolution_deg, self.azimuth_count, self.elevation_count) != (None, None, None)

    @property
    def shape(self) -> tuple[int, int]:
        """(elevations, azimuths) of the equal grid."""
        if self.resolution_deg is None:
            return self.elevation_count or 30, self.azimuth_count or 120
        return round(90.0 / self.resolution_deg), 4 * round(90.0 / self.resolution_deg)


class LightPollutionSection(Section):
    """The light of lamps in the air: a level that is known, not computed, brighter at the horizon (Garstang 1989)."""

    zenith_mag_per_arcsec2: Number | None = key(
        None, "V brightness of the zenith with the natural sky (22.0) in it", unit="mag arcsec^-2", ge=14.0, le=22.0
    )
    bortle_class: Integer | None = key(
        None, "class of Bortle 2001 in its place: 1 natural, 4 at the edge of a town, 9 in a city", unit="1", ge=1, le=9
    )

    @model_validator(mode="after")
    def _check(self) -> LightPollutionSection:
        if (self.zenith_mag_per_arcsec2 is None) == (self.bortle_class is None):
            raise ValueError("takes one of zenith_mag_per_arcsec2 and bortle_class")
        return self

    @property
    def zenith_mag(self) -> float:
        """Brightness of the zenith [V mag arcsec^-2]."""
        from twilight.sky.night.world import bortle_zenith_mag  # start-up

        if self.zenith_mag_per_arcsec2 is not None:
            return self.zenith_mag_per_arcsec2
        return bortle_zenith_mag(self.bortle_class or 1)


class Night(Section):
    """The moonless night sky behind the twilight; each part in units of its usual brightness, 0 leaves it out."""

    airglow: Number = key(
        1.0, "1: mean of a solar cycle; 0.7 to 1.3 from its minimum to maximum", unit="1", ge=0, le=100
    )
    starlight: Number = key(1.0, "all stars as a smooth glow, by galactic latitude", unit="1", ge=0, le=100)
    zodiacal_light: Number = key(1.0, "sunlight on interplanetary dust", unit="1", ge=0, le=100)
    light_pollution: LightPollutionSection | None = key(
        None, "zenith_mag_per_arcsec2 or bortle_class of the place, all around the same; unset: none"
    )
    stars: Flag | None = key(
        None, "views and films draw the 8948 brighter stars as points; unset: where place and time are known"
    )


_DRAWING: Any = Drawing.model_fields


class Config(Section):
    """Everything that a render needs."""

    version: Literal[1] = Field(description="version of this layout, always 1")
    name: str | None = key(
        None, "short name, used for the output folder; unset: the climate's", min_length=1, max_length=100
    )
    description: str = key("", "one line about it", max_length=1000)
    climate: Climate = Field(description="name of a climate, path of its file, or the climate itself")
    sun: Sun = key(
        SunElevation,
        "elevation_deg | elevations_deg | at and place | times and place | start, stop, step_minutes and place",
    )
    observer: Observer = key(Observer, "where the eye is")
    wavelengths: Wavelengths | None = key(
        None, "where the radiance is computed; unset: 8 from 380 to 756 nm, or those of a tabulated medium"
    )
    solar_spectrum: SolarSpectrum = key("astm_g173_etr", "irradiance of the sun on top of the atmosphere")
    solver: Annotated[dict[str, Any], SolverOptions()] = key(
        dict, "name, quality, and any option of that solver (see `twilight show solvers`)"
    )
    night: Night | None = key(None, "airglow, starlight and zodiacal light; unset: none, {}: all as usual")
    moon: MoonSection | None = key(
        None,
        "the moon, its light in the air and its disc; unset: none, {}: where the place and time of the sun have it",
    )
    terrain: Terrain | None = key(None, "mountains before the sky of observer.view, and their shadows; unset: none")
    horizon: Horizon | None = key(
        None,
        "what lies beyond the horizon and takes sunbeams on their way: typical | clean | a section; unset: typical, "
        "but clean where the solver takes no screen or the climate is a table",
    )
    texture: Texture = key(Texture, "directions")
    output: Output = key(Output, "pictures")
    omit_negligible: Flag = key(True, "leave out what cannot matter (see --plan)")
    vary: dict[str, Any] = key(
        dict,
        "series: dotted keys with lists, e.g. {aerosol.relative_humidity_percent: [50, 80, 95]}, or with ranges {from, "
        "to, count, scale: linear | log}; list: mappings of keys that change together; drawn, all together: {uniform: "
        "[low, high]}, {log_uniform: [low, high]} or {choice: [values]}",
    )
    draws: Integer | None = _DRAWING["draws"]
    seed: Integer = _DRAWING["seed"]
    validation: Number = _DRAWING["validation"]

    @model_validator(mode="before")
    @classmethod
    def _sets_behind_the_horizon(cls, data: Any) -> Any:
        """Sunrise and sunset for an observer above the sea, whose horizon dips, become their moments."""
        return with_moment_of_horizon(data)

    @model_validator(mode="after")
    def _lies_in_sunlight(self) -> Config:
        if self.wavelengths is None or self.wavelengths.placed:
            return self
        from twilight.numerics.spectrum import solar_spectrum  # start-up

        nm, (grid, _) = self.wavelengths.wavelength_nm, solar_spectrum(self.solar_spectrum)
        low, high = grid[0] - 0.5, grid[-1] + 0.5
        if not low <= nm[0] <= nm[-1] <= high:
            bad = nm[0] if nm[0] < low else nm[-1]
            raise ValueError(
                f"wavelengths: {bad:g} nm is outside the solar spectrum; solar_spectrum {self.solar_spectrum} goes "
                f"from {low:g} to {high:g} nm"
            )
        return self

    @model_validator(mode="after")
    def _stands_on_the_ground(self) -> Config:
        if self.terrain is not None and self.observer.view is None:
            raise ValueError("terrain: is seen in a view alone; set observer.view, e.g. {kind: perspective}")
        ground_km = self.climate.ground.altitude_km
        if ground_km != 0.0 and "altitude_km" not in self.observer.model_fields_set:
            object.__setattr__(self, "observer", self.observer.model_copy(update={"altitude_km": ground_km}))
        elif self.observer.altitude_km < ground_km:
            raise ValueError(
                f"observer.altitude_km is {self.observer.altitude_km:g}, below the ground (ground.altitude_km, "
                f"{ground_km:g} km); both count from sea level; set both where land lies below it"
            )
        return self

    @model_validator(mode="after")
    def _lies_on_the_map(self) -> Config:
        if self.climate.ground.albedo_map is None:
            return self
        if self.observer.view is not None and isinstance(self.sun, SunElevation | SunElevations):
            raise ValueError(
                "ground.albedo_map: needs to know which ground is seen: give the sun a time and a place (sun.at, "
                "sun.latitude_deg, sun.longitude_deg)"
            )
        if self.terrain is not None and "albedo" in self.terrain.model_fields_set:
            raise ValueError("terrain.albedo: ground.albedo_map says what the terrain reflects; leave one of them out")
        return self

    @model_validator(mode="after")
    def _is_near_the_lamps(self) -> Config:
        if self.night is not None and self.night.light_pollution is not None:
            above_km = self.observer.altitude_km - self.climate.ground.altitude_km
            if above_km > 1.0:
                raise ValueError(
                    f"night.light_pollution: is known for observers on the ground, not {above_km:g} km above it"
                )
        return self

    @model_validator(mode="after")
    def _knows_the_moon(self) -> Config:
        if self.moon is None:
            return self
        timeless = isinstance(self.sun, SunElevation | SunElevations)
        if timeless and self.moon.elevation_deg is None:
            raise ValueError("moon: needs a place and a time (sun.at, latitude_deg, longitude_deg), or elevation_deg")
        if not timeless and self.moon.elevation_deg is not None:
            raise ValueError("moon: stands where the place and time of the sun have it; leave out elevation_deg")
        return self

    @model_validator(mode="after")
    def _has_the_disc(self) -> Config:
        if self.output.disc and not self.sun.disc and self.moon is None:
            raise ValueError("output.disc needs a disc: set sun.disc to true, or add moon: {}")
        if "disc" in (self.output.files or ()) and not self.sun.disc:
            raise ValueError("output.files: disc needs the sun's disc: set sun.disc to true")
        if "moon" in (self.output.files or ()) and self.moon is None:
            raise ValueError("output.files: moon needs the moon: add moon: {}")
        return self

    @property
    def chosen_solver(self) -> ChosenSolver:
        """The solver with its settings; TwilightError where the section names what does not exist."""
        return choose_solver(self.solver)

    @property
    def title(self) -> str:
        """The configuration's name, or else its climate's."""
        return self.name or self.climate.name
