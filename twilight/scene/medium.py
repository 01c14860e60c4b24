"""From a climate document to the medium that solvers take."""

import hashlib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from twilight.atmosphere import bands, own_aerosol
from twilight.atmosphere.bands import GasBands, water_column_mm
from twilight.atmosphere.build import Boundaries, EqualAirMass, build_medium
from twilight.atmosphere.clouds import KINDS, CloudLayer
from twilight.atmosphere.grid_medium import GridMedium, fixed_wavelengths
from twilight.atmosphere.medium import Medium
from twilight.atmosphere.medium_table import medium_from_table
from twilight.atmosphere.opac import AerosolSpec, MineralLayer, opac_type
from twilight.atmosphere.own_aerosol import OwnAerosol
from twilight.atmosphere.shipped_optics import WAVELENGTHS_NM
from twilight.atmosphere.stratosphere import ExtinctionLevels, StratosphereSpec, measured_kind
from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.config.aerosol import Aerosol
from twilight.config.climate import THINNEST_KM, Climate, Ground, Spectrum, TabulatedMedium, air_profile, climate_files
from twilight.config.scene import Config, Wavelengths


def wavelengths_of(config: Config) -> np.ndarray | None:
    """The wavelengths [nm] of a render, (W,); None for a tabulated medium that is to keep its own."""
    if config.wavelengths is None and config.climate.medium is not None:
        return None
    return np.array((config.wavelengths or Wavelengths()).wavelength_nm)


def climate_medium(climate: Climate, wavelength_nm: np.ndarray | None) -> Medium:
    """The optical medium of a climate at the given wavelengths [nm].

    wavelength_nm may be None for a tabulated medium only, and then means the table's wavelengths.  All but a tabulated
    medium know their air at fixed wavelengths, by which solvers lay out their grids (`Medium.grid_medium`).
    Errors: TwilightError for what the data do not cover, and for a table that is not what its SHA-256 says.
    """
    if climate.medium is not None:
        return _with_ground(_tabulated(climate, climate.medium, wavelength_nm), climate.ground)
    assert wavelength_nm is not None

    medium = _with_ground(built_medium(climate, wavelength_nm), climate.ground)
    grid_medium = GridMedium.on_demand(partial(built_medium, climate), fixed_wavelengths(medium.wavelength_nm))
    return replace(medium, grid_medium=grid_medium)


def planning_medium(climate: Climate, wavelength_nm: np.ndarray) -> Medium:
    """About the medium of a climate, within a second at any number of wavelengths, to say what a solution costs.

    The air of every wavelength is that of the nearest one whose aerosol optics come with the program.
    Errors: as `climate_medium`.
    """
    shipped = np.sort(WAVELENGTHS_NM)

    def nearest(wanted_nm: np.ndarray) -> Medium:
        place, back = np.unique(np.abs(wanted_nm[:, None] - shipped).argmin(axis=1), return_inverse=True)
        return replace(built_medium(climate, shipped[place]).select(back), wavelength_nm=wanted_nm)

    medium = _with_ground(nearest(np.asarray(wavelength_nm, dtype=float)), climate.ground)
    return replace(medium, grid_medium=GridMedium.on_demand(nearest, fixed_wavelengths(medium.wavelength_nm)))


def built_medium(climate: Climate, wavelength_nm: np.ndarray) -> Medium:
    """The air of a climate that is no table, over black ground."""
    layers: EqualAirMass | Boundaries | None = None
    if climate.atmosphere.layers.equal_air_mass is not None:
        layers = EqualAirMass(climate.atmosphere.layers.equal_air_mass, climate.atmosphere.layers.coefficients)
    elif climate.atmosphere.layers.boundaries_km is not None:
        layers = Boundaries(climate.atmosphere.layers.boundaries_km, climate.atmosphere.layers.coefficients)
    medium = build_medium(
        wavelength_nm,
        profile=air_profile(climate),
        top_km=climate.atmosphere.top_km,
        ground_altitude_km=climate.ground.altitude_km,
        layers=layers,
        ozone_column_du=climate.gases.ozone.column_du,
        ozone_day_of_year=climate.gases.ozone.day_of_year,
        ozone_treatment=climate.gases.ozone.treatment,
        no2=climate.gases.no2,
        o4=climate.gases.o4,
        own_gas=None if (own := climate.gases.own) is None else (own.file, own.column_du),
        aerosol=None if climate.aerosol is None else aerosol_spec(climate.aerosol),
        stratosphere=stratosphere_spec(climate),
        clouds=cloud_layers(climate),
        refraction=climate.refraction.model,
        co2_ppm=climate.refraction.co2_ppm,
        haber_humidity=climate.refraction.relative_humidity_percent / 100.0,
        name=climate.name,
    )
    column_mm = climate.gases.water_vapour.column_mm
    source = "as asked for"
    if column_mm is None:
        full = air_profile(climate).above(climate.ground.altitude_km)
        column_mm, source = water_column_mm(full), full.source
    water = {"water_vapour_column_mm": column_mm, "water_vapour_source": source}
    return replace(medium, notes={**medium.notes, **water})


def climate_gas_bands(climate: Climate, medium: Medium, for_plan: bool = False) -> GasBands | None:
    """The bands of water vapour and oxygen in a medium of the climate; None where it has none at its wavelengths.

    for_plan: about as many terms as they have, at once.
    """
    if climate.medium is not None:
        return None
    column_mm = climate.gases.water_vapour.column_mm
    wanted = {bands.WATER_VAPOUR: column_mm != 0.0, bands.OXYGEN: climate.gases.oxygen}
    layers = climate.atmosphere.layers
    return bands.make_gas_bands(
        medium,
        air_profile(climate),
        tuple(gas for gas, absorbs in wanted.items() if absorbs),
        column_mm,
        layers=layers.equal_air_mass is not None or layers.boundaries_km is not None,
        for_plan=for_plan,
    )


def aerosol_spec(aerosol: Aerosol) -> AerosolSpec:
    """The aerosol in OPAC's terms; heights that the climate leaves unset are the type's own."""
    if aerosol.modes or aerosol.angstrom is not None or aerosol.table is not None:
        spec = AerosolSpec({}, own=_own_aerosol(aerosol))
    elif aerosol.type is not None:
        spec = opac_type(aerosol.type, aerosol.relative_humidity_percent)
    else:
        spec = AerosolSpec({str(k): v for k, v in aerosol.components.items()}, aerosol.relative_humidity_percent)
    dust, depths = aerosol.mineral_transported, aerosol.optical_depths
    changes: dict[str, Any] = {
        "free_troposphere": aerosol.free_troposphere,
        "stratosphere": aerosol.stratosphere == "opac" and aerosol.optical_depth_550nm != 0.0,
        "optical_depth_550nm": aerosol.optical_depth_550nm,
        "turbidity": aerosol.turbidity,
        "visibility_km": aerosol.visibility_km,
        "optical_depths": None if depths is None else (depths.wavelength_nm, depths.optical_depth),
        "phase_function": aerosol.phase_function,
        "boundary_layer_base": aerosol.boundary_layer_base,
        "mineral_transported": None if dust is None else MineralLayer(**dust.model_dump()),
    }
    for name in ("boundary_layer_top_km", "scale_height_km"):
        if getattr(aerosol, name) is not None:
            changes[name] = getattr(aerosol, name)
    return replace(spec, **changes)


def _own_aerosol(aerosol: Aerosol) -> OwnAerosol:
    if aerosol.angstrom is not None:
        return own_aerosol.AngstromLaw(**aerosol.angstrom.model_dump())
    if aerosol.table is not None:
        table = aerosol.table
        check_sha256(table.file, table.sha256, "aerosol.table.sha256")
        if table.phase_function is not None:
            check_sha256(table.phase_function, table.phase_function_sha256, "aerosol.table.phase_function_sha256")
        return own_aerosol.OpticsFile(table.file, table.phase_function)
    modes = []
    for mode in aerosol.modes:
        index = mode.refractive_index
        values = tuple(complex(n, -k) for n, k in zip(index.real, index.imaginary, strict=True))
        amounts = (mode.number_density_per_cm3, mode.median_radius_um, mode.sigma)
        modes.append(
            own_aerosol.SizeMode(*amounts, index.wavelength_nm, values, mode.min_radius_um, mode.max_radius_um)
        )
    return own_aerosol.SizeModes(tuple(modes))


def stratosphere_spec(climate: Climate) -> StratosphereSpec | None:
    """The stratospheric aerosol of the climate; None where there is none, or OPAC's own."""
    if climate.stratosphere is not None:
        levels = climate.stratosphere.levels
        of_levels = None if levels is None else ExtinctionLevels(**levels.model_dump())
        return StratosphereSpec(**climate.stratosphere.model_dump(exclude={"levels"}), levels=of_levels)
    aerosol = climate.aerosol
    if aerosol is None or aerosol.stratosphere != "measured" or aerosol.optical_depth_550nm == 0.0:
        return None
    return StratosphereSpec(measured_kind(climate.atmosphere.profile))


def cloud_layers(climate: Climate) -> tuple[CloudLayer, ...]:
    """The clouds of a climate, with what it leaves unset; those of optical depth 0 are left out.

    Errors: TwilightError for a cloud whose top is not above its base.
    """
    layers = []
    for cloud in climate.clouds:
        kind = KINDS[cloud.kind]
        base, top, depth, radius = cloud.base_km, cloud.top_km, cloud.optical_depth, cloud.effective_radius_um
        if base is None:
            base = climate.ground.altitude_km if kind.base_km is None else kind.base_km
            if top is not None and kind.base_km is not None:
                base = min(base, top - kind.thickness_km)
        top = base + kind.thickness_km if top is None else top
        if top < base + THINNEST_KM * (1.0 - ROUNDING) or base < 0.0:
            raise TwilightError(
                f"clouds: {cloud.kind} cannot end at {top:g} km, which is not {THINNEST_KM:g} km above its base at "
                f"{base:g} km; give base_km too"
            )
        layer = CloudLayer(
            cloud.kind,
            base,
            top,
            kind.optical_depth if depth is None else depth,
            kind.effective_radius_um if radius is None else radius,
        )
        if layer.optical_depth > 0.0:
            layers.append(layer)
    return tuple(layers)


def ground_albedo(ground: Ground, wavelength_nm: np.ndarray) -> np.ndarray:
    """Albedo of the ground at the wavelengths, (W,)."""
    if isinstance(ground.albedo, Spectrum):
        return np.interp(wavelength_nm, ground.albedo.wavelength_nm, ground.albedo.albedo)
    return np.full(len(wavelength_nm), ground.albedo)


def table_sha256(path: str | Path) -> str:
    """SHA-256 of a table's content, hexadecimal; TwilightError when it cannot be read."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise TwilightError(f"{path}: cannot be read: {error.strerror}") from None


def check_sha256(path: str, wanted: str | None, name: str) -> None:
    """TwilightError where a file is not the one that the climate means."""
    if wanted is not None and (digest := table_sha256(path)) != wanted:
        raise TwilightError(f"{path}: is not the table of this climate: {name} is {wanted}, not {digest}")


def name_by_content(climate: dict[str, Any]) -> None:
    """Give each file that a climate (plain data, changed in place) names the SHA-256 of its content."""
    for section, _, name, sha256 in climate_files(climate):
        if sha256 is not None:
            section[sha256] = table_sha256(section[name])


def _tabulated(climate: Climate, table: TabulatedMedium, wavelength_nm: np.ndarray | None) -> Medium:
    check_sha256(table.table, table.sha256, "medium.sha256")
    if table.phase_function is not None:
        check_sha256(table.phase_function, table.phase_function_sha256, "medium.phase_function_sha256")
    return medium_from_table(
        table.table,
        depolarisation=table.depolarisation,
        wavelength_nm=wavelength_nm,
        phase_function=table.phase_function,
        phase_model=table.phase_model,
        earth_radius_km=table.earth_radius_km,
        name=climate.name,
    )


def _with_ground(medium: Medium, ground: Ground) -> Medium:
    """The medium over the climate's ground."""
    albedo = ground_albedo(ground, medium.wavelength_nm)
    return replace(medium, ground_albedo=albedo)
