"""The aerosol and stratosphere of a climate document."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from twilight.base.sections import FilePath, Flag, Increasing, Number, Section, check_lengths, key

AerosolType = Literal[
    "continental_clean", "continental_average", "continental_polluted", "urban", "desert",
    "maritime_clean", "maritime_polluted", "maritime_tropical", "arctic", "antarctic",
]  # fmt: skip
Component = Literal["inso", "waso", "soot", "ssam", "sscm", "minm", "miam", "micm", "mitr", "suso"]
StratosphereKind = Literal[
    "background", "moderate_volcanic", "high_volcanic", "extreme_volcanic",
    "nh_midlat_low", "nh_midlat_typical", "nh_midlat_elevated", "nh_midlat_extreme",
    "sh_midlat_low", "sh_midlat_typical", "sh_midlat_elevated", "sh_midlat_extreme",
    "tropical_low", "tropical_typical", "tropical_elevated", "tropical_extreme",
]  # fmt: skip
AEROSOL_AMOUNTS = ("optical_depth_550nm", "optical_depths", "turbidity", "visibility_km")
AEROSOL_SOURCES = ("type", "components", "modes", "angstrom", "table")


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


class RefractiveIndex(Section):
    """Refractive index of the particles, for all wavelengths or at some; linear in between and constant outside."""

    wavelength_nm: Annotated[tuple[Number, ...], Increasing] = key(
        (550.0,), "wavelengths, increasing", unit="nm", min_length=1, max_length=2000
    )
    real: tuple[Annotated[Number, Field(gt=0.0, le=10.0)], ...] = key(
        (1.45,), "one for each wavelength", unit="1", min_length=1, max_length=2000
    )
    imaginary: tuple[Annotated[Number, Field(ge=0.0, le=10.0)], ...] = key(
        (0.0,), "absorption, one for each wavelength", unit="1", min_length=1, max_length=2000
    )

    @model_validator(mode="after")
    def _match(self) -> RefractiveIndex:
        check_lengths(self, "wavelength_nm", "real", "imaginary")
        return self


class Mode(Section):
    """Spheres of a log-normal size distribution."""

    number_density_per_cm3: Number = key(1000.0, "particles at the base of the layer", unit="cm^-3", ge=0.0, le=1e9)
    median_radius_um: Number = key(0.1, "median of the radii (by number)", unit="um", ge=1e-3, le=50.0)
    sigma: Number = key(1.8, "geometric standard deviation of the radii", unit="1", ge=1.05, le=5.0)
    min_radius_um: Number | None = key(
        None, "smaller ones are left out; unset: those without effect", unit="um", ge=1e-4, le=100.0
    )
    max_radius_um: Number | None = key(
        None, "larger ones are left out; unset: those without effect", unit="um", ge=1e-3, le=100.0
    )
    refractive_index: RefractiveIndex = key(RefractiveIndex, "of the particles")

    @model_validator(mode="after")
    def _in_order(self) -> Mode:
        if self.min_radius_um is not None and self.max_radius_um is not None:
            if self.min_radius_um >= self.max_radius_um:
                raise ValueError("max_radius_um must be above min_radius_um")
        return self


class Angstrom(Section):
    """Extinction as a power of the wavelength; its amount is aerosol.optical_depth_550nm."""

    exponent: Number = key(1.3, "extinction goes with wavelength^-exponent", unit="1", ge=-2.0, le=5.0)
    single_scattering_albedo: Number = key(0.95, "at all wavelengths", unit="1", ge=0.0, le=1.0)
    asymmetry: Number = key(
        0.65, "of the Henyey-Greenstein phase function, at all wavelengths", unit="1", gt=-1.0, lt=1.0
    )


class OpticsTable(Section):
    """The optics of the particles from files; paths are relative to the folder of the climate's file."""

    file: FilePath = key(
        "",
        "CSV with wavelength_nm, extinction_per_km (at the base of the layer), single_scattering_albedo, and asymmetry "
        "unless phase_function is given",
        min_length=1,
    )
    phase_function: FilePath | None = key(
        None,
        "CSV with wavelength_nm, angle_deg, phase_per_sr, and for polarised light p12_ratio, p33_ratio (p22_ratio, "
        "p34_ratio); unset: Henyey-Greenstein",
        min_length=1,
    )
    sha256: str | None = key(None, "the file's SHA-256; if given, another is an error", pattern="^[0-9a-f]{64}$")
    phase_function_sha256: str | None = key(
        None, "the phase function's SHA-256; if given, another is an error", pattern="^[0-9a-f]{64}$"
    )


class OpticalDepths(Section):
    """The optical depth of all aerosol at some wavelengths: a power law between two, and beyond the outermost."""

    wavelength_nm: Annotated[tuple[Annotated[Number, Field(ge=200.0, le=5000.0)], ...], Increasing] = key(
        ..., "wavelengths, increasing", unit="nm", min_length=2, max_length=100
    )
    optical_depth: tuple[Annotated[Number, Field(gt=0.0, le=20.0)], ...] = key(
        ..., "one for each wavelength", unit="1", min_length=2, max_length=100
    )

    @model_validator(mode="after")
    def _match(self) -> OpticalDepths:
        check_lengths(self, "wavelength_nm", "optical_depth")
        return self


class Aerosol(Section):
    """Particles below the stratosphere: an OPAC type, OPAC components, or one's own particles, and their heights."""

    type: AerosolType | None = key(None, "one of the ten OPAC types; unset: give components, modes, angstrom or table")
    components: dict[Component, Annotated[Number, Field(ge=0.0, le=1e9)]] = key(
        dict, "own mixture at the ground by OPAC component, e.g. {waso: 7000, inso: 0.4}", unit="cm^-3"
    )
    modes: tuple[Mode, ...] = key(
        tuple, "own spheres: sizes and refractive index, e.g. [{median_radius_um: 0.1, sigma: 1.6}]", max_length=40
    )
    angstrom: Angstrom | None = key(None, "own power law of the wavelength, with albedo and asymmetry")
    table: OpticsTable | None = key(None, "own tables of extinction, albedo and phase function")
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
    optical_depths: OpticalDepths | None = key(
        None,
        "in place of optical_depth_550nm, at several wavelengths: scales the extinction at each; e.g. {wavelength_nm: "
        "[440, 870], optical_depth: [0.2, 0.08]}",
    )
    turbidity: Number | None = key(
        None,
        "in place of optical_depth_550nm: (air + aerosol) / air, vertical optical depths at 550 nm (Preetham 1999 sec. "
        "2.1); 2 clear, 6 hazy",
        unit="1",
        ge=1.0,
        le=200.0,
    )
    visibility_km: Number | None = key(
        None,
        "in place of optical_depth_550nm: ln(1 / 0.02) over the extinction of air and aerosol at the ground at 550 nm "
        "(Koschmieder 1924, contrast 0.02)",
        unit="km",
        ge=0.2,
        le=330.0,
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
        given = [name for name in AEROSOL_SOURCES if getattr(self, name)]
        if len(given) != 1:
            raise ValueError(f"needs one of {', '.join(AEROSOL_SOURCES)}, got {' and '.join(given) or 'none'}")
        if given[0] in ("modes", "angstrom", "table") and "relative_humidity_percent" in self.model_fields_set:
            raise ValueError(f"relative_humidity_percent has no meaning for {given[0]}: only OPAC's particles swell")
        amounts = [name for name in AEROSOL_AMOUNTS if getattr(self, name) is not None]
        if len(amounts) > 1:
            raise ValueError(f"takes either {' or '.join(amounts)}, not both")
        if self.angstrom is not None and not amounts:
            raise ValueError("angstrom needs optical_depth_550nm, which says how much there is")
        return self


class StratosphereLevels(Section):
    """A measured profile of the stratosphere's extinction; above it the extinction falls as that of `kind` does."""

    altitude_km: Annotated[tuple[Number, ...], Increasing] = key(
        ..., "above sea level, increasing", unit="km", min_length=2, max_length=500
    )
    wavelength_nm: Annotated[tuple[Annotated[Number, Field(ge=300.0, le=2000.0)], ...], Increasing] = key(
        ..., "increasing; of a single one the droplets give the spectrum", unit="nm", min_length=1, max_length=50
    )
    extinction_per_km: tuple[tuple[Annotated[Number, Field(gt=0.0, le=10.0)], ...], ...] = key(
        ..., "for each altitude a list with one number for each wavelength", unit="km^-1"
    )
    median_radius_um: tuple[Annotated[Number, Field(ge=0.02, le=0.5)], ...] | None = key(
        None, "of the droplets, one for each altitude (log-normal, mode width 1.6); unset: that of `kind`", unit="um"
    )

    @model_validator(mode="after")
    def _match(self) -> StratosphereLevels:
        if len(self.extinction_per_km) != len(self.altitude_km) or any(
            len(row) != len(self.wavelength_nm) for row in self.extinction_per_km
        ):
            raise ValueError("extinction_per_km must hold a list for each altitude, with a number for each wavelength")
        if self.median_radius_um is not None:
            check_lengths(self, "altitude_km", "median_radius_um")
        return self


class Stratosphere(Section):
    """Particles of the stratosphere, in place of what aerosol.stratosphere says."""

    kind: StratosphereKind = key(
        "background",
        "loading of LOWTRAN 7 (Shettle and Fenn), or a profile measured by SAGE III/ISS by region and loading",
    )
    season: Literal["spring_summer", "fall_winter"] = key("spring_summer", "half of the year, for LOWTRAN's loadings")
    upper_atmosphere: Literal["normal", "extreme"] = key("normal", "meteoric dust above 30 km, for LOWTRAN's loadings")

    levels: StratosphereLevels | None = key(
        None, "a measured profile in place of that of `kind`, which must be one of SAGE III/ISS and gives what it lacks"
    )

    @model_validator(mode="after")
    def _measured(self) -> Stratosphere:
        if self.levels is not None and self.kind.endswith(("background", "volcanic")):
            raise ValueError(f"levels needs a kind with droplets, such as nh_midlat_typical, not {self.kind}")
        if not self.kind.endswith(("background", "volcanic")):
            for name in ("season", "upper_atmosphere"):
                if getattr(self, name) != type(self).model_fields[name].default:
                    raise ValueError(f"{name} has no meaning for the measured profile {self.kind}")
        return self
