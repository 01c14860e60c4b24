"""From a description of the air to a Medium, as it is or in layers: Haber's equal air masses, or free boundaries."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twilight.atmosphere import aerosols, gases
from twilight.atmosphere.aerosols import AerosolRegion
from twilight.atmosphere.clouds import CloudLayer, check_layers
from twilight.atmosphere.levels import vertical_integral
from twilight.atmosphere.medium import Medium
from twilight.atmosphere.opac import AerosolSpec
from twilight.atmosphere.profiles import PROFILE_TOP_KM, AirProfile, load_profile
from twilight.atmosphere.stratosphere import StratosphereSpec
from twilight.base.conventions import LOWEST_GROUND_KM, ROUNDING
from twilight.base.errors import TwilightError

MIN_TOP_KM = 10.0
"""Lowest top of the air that is allowed [km]."""
MAX_GROUND_KM = 9.0
"""Highest ground that is allowed [km]."""
OZONE_TREATMENTS = ("layer", "overhead_filter", "none")
"""Where ozone absorbs: in its layer, as a filter above the air, nowhere."""
REFRACTION_MODELS = ("ciddor", "haber", "none")
"""Ciddor 1996, Haber's closed form, n = 1."""


@dataclass(frozen=True)
class AirParts:
    """What an atmosphere is made of.

    profile: one of ``profiles.PROFILES``, or the air itself.
    top_km: 10 to 120; what is above is left out.
    ground_altitude_km: -0.5 to 9 above sea level; the medium begins there, with the profile's state at that altitude.
    layers: None gives coefficients that go continuously through the profile's own altitudes; otherwise they are
        constant in each layer, with the layer's mean.
    ozone_column_du: from the ground to 120 km; or from the day of the year (northern hemisphere, Haber 2005
        sec. 4.3); None for both keeps the profile's own above the ground.
    ozone_treatment: `layer` absorbs where the ozone is; `overhead_filter` puts the whole column into
        ``Medium.overhead_absorption_optical_depth``; `none` leaves ozone out.
    no2, o4: absorption by nitrogen dioxide and by pairs of oxygen molecules; own_gas: file and column [DU] of another.
    aerosol, stratosphere: None for none; a StratosphereSpec replaces the stratospheric part of the AerosolSpec.
    clouds: layers around the whole globe; where some overlap their coefficients add.
    refraction: `ciddor` (with the profile's temperature, pressure and humidity), `haber` (his closed form with
        haber_humidity, 0 to 1, everywhere), `none`.
    ground_albedo: Lambertian, one number or one per wavelength.
    """

    profile: str | AirProfile = "midlatitude_summer"
    top_km: float = 100.0
    ground_altitude_km: float = 0.0
    layers: EqualAirMass | Boundaries | None = None
    ozone_column_du: float | None = None
    ozone_day_of_year: float | None = None
    ozone_treatment: str = "layer"
    no2: bool = True
    o4: bool = True
    own_gas: tuple[str, float] | None = None
    aerosol: AerosolSpec | None = None
    stratosphere: StratosphereSpec | None = None
    clouds: tuple[CloudLayer, ...] = ()
    refraction: str = "ciddor"
    co2_ppm: float = 420.0
    haber_humidity: float = 0.0
    ground_albedo: Any = 0.0
    name: str = ""


def build_medium(wavelength_nm: Any, **parts: Any) -> Medium:
    """The optical medium of an atmosphere at W wavelengths (280 to 1000 nm, increasing); parts: of `AirParts`.

    Medium.notes holds `optical_depth` by part (each a list over wavelengths), `ozone_column_du`, `ozone_source` (in
    words), `profile`, `regions` (name, bottom, top) and `aerosol_factor`.  Raises TwilightError on anything that is not
    possible.
    """
    made = AirParts(**parts)
    top_km, co2_ppm = made.top_km, made.co2_ppm
    wavelength = gases.check_wavelengths(wavelength_nm)
    if not (math.isfinite(top_km) and MIN_TOP_KM <= top_km <= PROFILE_TOP_KM):
        raise TwilightError(f"top_km: {top_km} is not possible, allowed is {MIN_TOP_KM:g} to {PROFILE_TOP_KM:g} km")
    if not (math.isfinite(co2_ppm) and 0.0 <= co2_ppm <= 1e5):
        raise TwilightError(f"co2_ppm: {co2_ppm} is not possible, allowed is 0 to 100000 ppm")
    albedo = check_ground_albedo(made.ground_albedo, wavelength.size)
    if not (math.isfinite(made.ground_altitude_km) and LOWEST_GROUND_KM <= made.ground_altitude_km <= MAX_GROUND_KM):
        raise TwilightError(
            f"ground.altitude_km: {made.ground_altitude_km} is not possible, allowed is {LOWEST_GROUND_KM:g} to "
            f"{MAX_GROUND_KM:g} km"
        )
    ground_km = float(made.ground_altitude_km)
    full = (load_profile(made.profile) if isinstance(made.profile, str) else made.profile).above(ground_km)
    ozone_factor = gases.ozone_factor(full, _ozone_column(made.ozone_column_du, made.ozone_day_of_year))
    check_layers(made.clouds, ground_km, top_km)
    regions, aerosol_factor = _aerosol_regions(
        made.aerosol, made.stratosphere, wavelength, (ground_km, top_km), full, co2_ppm
    )
    regions += [layer.region(wavelength) for layer in made.clouds]

    altitude, upper_side = _levels(full.altitude_km, regions, top_km)
    state = full.at(altitude)
    air = state.air_per_cm3[:, None] * gases.cross_section_cm2(wavelength, co2_ppm) * 1e5
    parts, overhead = _gas_absorption(full, state, wavelength, made.ozone_treatment, ozone_factor, made.no2, made.o4)
    if made.own_gas is not None:
        parts["own"] = gases.own_absorption_per_km(*made.own_gas, full, state, wavelength)
    extinction, scattering, phase_fraction, phases = _aerosol_levels(regions, altitude, upper_side, wavelength.size)
    medium = Medium(
        wavelength_nm=wavelength,
        altitude_km=altitude,
        air_scattering_per_km=air,
        absorption_per_km=sum(parts.values(), np.zeros_like(air)),
        aerosol_extinction_per_km=extinction,
        aerosol_single_scattering_albedo=np.minimum(
            1.0, np.divide(scattering, extinction, out=np.zeros_like(scattering), where=extinction > 0)
        ),
        aerosol_phase_fraction=phase_fraction,
        phase_functions=phases,
        refractivity=_refractivity(made.refraction, state, wavelength, co2_ppm, made.haber_humidity),
        depolarisation=gases.depolarisation(wavelength, co2_ppm),
        ground_albedo=albedo,
        overhead_absorption_optical_depth=overhead,
        name=made.name,
    )
    depths = {"air": medium.optical_depth("air")}
    depths |= {gas: vertical_integral(a, altitude) for gas, a in parts.items()}
    for region in regions:
        depths[region.name] = depths.get(region.name, np.zeros(wavelength.size)) + region.optical_depth(top_km)
    if np.any(overhead > 0):
        depths["ozone overhead"] = overhead
    notes = {
        "profile": full.name,
        "ozone_source": _ozone_source(full.source, made.ozone_column_du, made.ozone_day_of_year),
        "ozone_column_du": 0.0 if made.ozone_treatment == "none" else full.ozone_column_du * ozone_factor,
        "optical_depth": {key: value.tolist() for key, value in depths.items()},
        "regions": [(region.name, region.bottom_km, min(region.top_km, top_km)) for region in regions],
        "aerosol_factor": aerosol_factor,
    }
    if made.layers is not None:
        medium = layered(medium, made.layers.boundaries_km(top_km, ground_km), made.layers.coefficients)
    return replace(medium, notes=notes)


def check_ground_albedo(ground_albedo, n_wavelengths: int) -> np.ndarray:
    """The albedo at each of W wavelengths; raises TwilightError unless it is one number or W numbers from 0 to 1."""
    albedo = np.asarray(ground_albedo, dtype=float)
    if albedo.ndim > 1 or albedo.size not in (1, n_wavelengths):
        raise TwilightError(f"ground albedo has {albedo.size} values, allowed is 1 or {n_wavelengths} (wavelengths)")
    if not np.all((albedo >= 0) & (albedo <= 1)):
        raise TwilightError("ground albedo must be between 0 and 1")
    return np.broadcast_to(albedo.ravel(), (n_wavelengths,)).astype(float)


def _ozone_column(column_du: float | None, day_of_year: float | None) -> float | None:
    if day_of_year is None:
        return column_du
    if column_du is not None:
        raise TwilightError("give one of ozone_column_du and ozone_day_of_year, not both")
    return gases.seasonal_ozone_column_du(day_of_year)


def _ozone_source(profile_source: str, column_du: float | None, day_of_year: float | None) -> str:
    """Where the ozone column comes from, in words."""
    if column_du is not None:
        return "as asked for"
    if day_of_year is not None:
        return f"day {day_of_year:g} of the year, northern midlatitudes"
    return profile_source


def _aerosol_regions(
    aerosol: AerosolSpec | None,
    stratosphere: StratosphereSpec | None,
    wavelength: np.ndarray,
    span_km: tuple[float, float],
    full: AirProfile,
    co2_ppm: float,
) -> tuple[list[AerosolRegion], float | np.ndarray]:
    """Regions between ground and top, and the factor on the tropospheric ones, one for all wavelengths or (W,)."""
    ground_km, top_km = span_km
    bottom_km = 0.0 if stratosphere is None else stratosphere.bottom_km
    if aerosol is not None:
        bottom_km = max(bottom_km, aerosol.boundary_layer_end_km(ground_km))

    def tropospheric(w) -> list[AerosolRegion]:
        own_stratosphere_km = None if stratosphere is None else bottom_km
        if aerosol is None:
            return []
        return aerosols.tropospheric_regions(aerosol, w, own_stratosphere_km, ground_km)

    def stratospheric(w) -> list[AerosolRegion]:
        if stratosphere is not None:
            cut = [region.between(bottom_km, math.inf) for region in stratosphere.regions(w)]
            regions = [region for region in cut if region is not None]
            formula = aerosol is not None and aerosol.phase_function == "henyey_greenstein"
            return [region.henyey_greenstein() for region in regions] if formula else regions
        return [] if aerosol is None else aerosols.opac_stratosphere(aerosol, w, ground_km)

    below, above = tropospheric(wavelength), stratospheric(wavelength)
    factor: float | np.ndarray = 1.0
    at_550 = np.array([550.0])
    if aerosol is not None and aerosol.visibility_km is not None:
        air = gases.cross_section_cm2(at_550, co2_ppm) * full.at(ground_km).air_per_cm3 * 1e5
        factor = aerosols.visibility_factor(aerosol.visibility_km, float(air[0]), tropospheric(at_550), ground_km)
    elif aerosol is not None and (aerosol.optical_depth_550nm is not None or aerosol.turbidity is not None):
        wanted = aerosol.optical_depth_550nm or 0.0
        if aerosol.turbidity is not None:
            below_top = full.at(np.append(full.altitude_km[full.altitude_km < top_km], top_km))
            air = gases.cross_section_cm2(at_550, co2_ppm) * below_top.column_per_cm2(below_top.air_per_cm3)
            wanted = (aerosol.turbidity - 1.0) * float(air[0])
        of_550 = aerosols.tropospheric_factor(
            np.array([wanted]), at_550, tropospheric(at_550), stratospheric(at_550), top_km
        )
        factor = float(of_550[0])
    elif aerosol is not None and aerosol.optical_depths is not None:
        depth = aerosols.optical_depth_at(*aerosol.optical_depths, wavelength)
        factor = aerosols.tropospheric_factor(depth, wavelength, below, above, top_km)
    scaled = [region.scaled(factor) for region in below] if np.any(factor) else []
    return [region for region in scaled + above if region.bottom_km < top_km], factor


def _levels(profile_km: np.ndarray, regions: list[AerosolRegion], top_km: float) -> tuple[np.ndarray, np.ndarray]:
    """Altitudes of the levels, and for each whether it stands for the air above it (of two equal ones the second)."""
    inner = [profile_km] + [region.altitude_km for region in regions]
    z = np.unique(np.concatenate(inner))
    z = np.append(z[(z >= profile_km[0]) & (z < top_km)], top_km)
    jumps = np.unique([edge for region in regions for edge in (region.bottom_km, region.top_km)])
    jumps = jumps[(jumps > profile_km[0]) & (jumps < top_km)]
    altitude = np.sort(np.concatenate([z, jumps]))
    upper_side = np.append(np.diff(altitude) > 0, False)
    return altitude, upper_side


def _gas_absorption(
    full: AirProfile,
    state: AirProfile,
    wavelength: np.ndarray,
    treatment: str,
    ozone_factor: float,
    no2: bool,
    o4: bool,
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Absorption coefficients (L, W) by gas, and the overhead optical depth (W,)."""
    if treatment not in OZONE_TREATMENTS:
        raise TwilightError(f"ozone_treatment: `{treatment}` is not known; allowed are {', '.join(OZONE_TREATMENTS)}")
    parts = {}
    overhead = np.zeros(wavelength.size)
    if treatment == "layer":
        parts["ozone"] = gases.absorption_per_km("o3", state, wavelength, ozone_factor)
    elif treatment == "overhead_filter":
        overhead = gases.overhead_ozone_optical_depth(full, wavelength, ozone_factor)
    if no2:
        parts["no2"] = gases.absorption_per_km("no2", state, wavelength)
    if o4:
        parts["o4"] = gases.absorption_per_km("o4", state, wavelength)
    return parts, overhead


def _aerosol_levels(
    regions: list[AerosolRegion], altitude: np.ndarray, upper_side: np.ndarray, n_wavelengths: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple]:
    """Extinction and scattering (L, W), phase fractions (K, L, W) and the K phase functions of all regions together."""
    shape = (altitude.size, n_wavelengths)
    extinction, scattering = np.zeros(shape), np.zeros(shape)
    phases: list = []
    by_phase: list[np.ndarray] = []
    slots: dict[int, int] = {}
    for region in regions:
        above = upper_side & (altitude >= region.bottom_km) & (altitude < region.top_km)
        below = ~upper_side & (altitude > region.bottom_km) & (altitude <= region.top_km)
        inside = above | below
        ext, albedo, phase_fraction = region.at(altitude[inside])
        extinction[inside] += ext
        scattering[inside] += ext * albedo
        for k, phase in enumerate(region.phase_functions):
            slot = slots.setdefault(id(phase), len(phases))
            if slot == len(phases):
                phases.append(phase)
                by_phase.append(np.zeros(shape))
            by_phase[slot][inside] += phase_fraction[k] * ext * albedo
    if not phases:
        return extinction, scattering, np.zeros((0, *shape)), ()
    stacked = np.stack(by_phase)
    total = stacked.sum(axis=0)
    phase_fraction = np.divide(stacked, total, out=np.zeros_like(stacked), where=total > 0)
    phase_fraction[0] = np.where(total > 0, phase_fraction[0], 1.0)
    return extinction, scattering, phase_fraction, tuple(phases)


def _refractivity(
    model: str, state: AirProfile, wavelength: np.ndarray, co2_ppm: float, haber_humidity: float
) -> np.ndarray:
    if model not in REFRACTION_MODELS:
        raise TwilightError(f"refraction: `{model}` is not known; allowed are {', '.join(REFRACTION_MODELS)}")
    if model == "none":
        return np.zeros((state.altitude_km.size, wavelength.size))
    if model == "haber":
        return gases.haber_refractivity(wavelength[None, :], state.altitude_km[:, None], haber_humidity)
    return gases.ciddor_refractivity(
        wavelength[None, :],
        state.temperature_k[:, None],
        state.pressure_hpa[:, None],
        state.water_vapour_pressure_hpa[:, None],
        co2_ppm,
    )


HABER_SCALE_HEIGHT_KM = 8.0
"""Scale height of the air that divides the atmosphere into layers (Haber 2005 sec. 4.1.2)."""
MAX_LAYERS = 2000
"""Most layers that are allowed."""


@dataclass(frozen=True)
class EqualAirMass:
    """N layers of equal air mass, for an exponential atmosphere of scale height 8 km (Haber 2005 sec. 4.1.2)."""

    count: int
    coefficients: str = "mean"

    def boundaries_km(self, top_km: float, ground_km: float = 0.0) -> np.ndarray:
        """Boundaries ground = H_0 < ... < H_N = top: H_{i+1} = -8 ln(exp(-H_i/8) - M/8), M the mass of a layer."""
        if not 1 <= self.count <= MAX_LAYERS:
            raise TwilightError(f"layers.count: {self.count} is not possible, allowed is 1 to {MAX_LAYERS}")
        fraction = np.arange(self.count + 1) / self.count
        depth = (top_km - ground_km) / HABER_SCALE_HEIGHT_KM
        heights = ground_km - HABER_SCALE_HEIGHT_KM * np.log1p(fraction * math.expm1(-depth))
        heights[0], heights[-1] = ground_km, top_km
        return heights


@dataclass(frozen=True)
class Boundaries:
    """Layers between given altitudes [km]; the first is the ground and the last the top of the atmosphere."""

    altitude_km: tuple[float, ...]
    coefficients: str = "mean"

    def boundaries_km(self, top_km: float, ground_km: float = 0.0) -> np.ndarray:
        z = np.asarray(self.altitude_km, dtype=float)
        if z.ndim != 1 or not 2 <= z.size <= MAX_LAYERS + 1 or not np.all(np.isfinite(z)) or np.any(np.diff(z) <= 0):
            raise TwilightError(
                f"layers.boundaries_km must be 2 to {MAX_LAYERS + 1} altitudes, each above the one before"
            )
        if z[0] != ground_km or not math.isclose(z[-1], top_km, rel_tol=ROUNDING):
            raise TwilightError(
                f"layers.boundaries_km must begin at {ground_km:g} and end at the top of the air, {top_km:g} km, "
                f"not {z[0]:g} and {z[-1]:g}"
            )
        return z


def layered(medium: Medium, boundaries_km: np.ndarray, coefficients: str = "mean") -> Medium:
    """The medium with constant coefficients in each layer: the layer's mean, or what they are at its centre.

    Means change no column: extinction and absorption are averaged over altitude, the albedo with the extinction as
    weight and the phase fractions with the scattering.  Each inner boundary is two levels.  Refractivity has no jumps:
    it keeps its values at the boundaries and goes smoothly between them.
    """
    z = np.asarray(boundaries_km, dtype=float)
    if coefficients == "centre":
        return _at_centres(medium, z)
    inner = medium.altitude_km[(medium.altitude_km > z[0]) & (medium.altitude_km < z[-1])]
    edges = np.unique(np.concatenate([z, inner]))
    layer = np.searchsorted(z, 0.5 * (edges[1:] + edges[:-1])) - 1
    x, w = np.polynomial.legendre.leggauss(6)
    thickness = np.diff(edges)
    points = edges[:-1, None] + 0.5 * thickness[:, None] * (1 + x)
    weight = (0.5 * thickness[:, None] * w / np.diff(z)[layer][:, None])[..., None]
    at = medium.at(points)
    n = z.size - 1

    def mean(values: np.ndarray) -> np.ndarray:
        out = np.zeros((n, medium.n_wavelengths))
        np.add.at(out, layer, np.sum(values * weight, axis=1))
        return np.repeat(out, 2, axis=0)

    extinction = mean(at.aerosol_extinction)
    scattering = mean(at.aerosol_scattering)
    albedo = np.where(extinction > 0, np.minimum(1.0, scattering / np.where(extinction > 0, extinction, 1.0)), 0.0)
    fractions = [
        np.where(
            scattering > 0,
            mean(fraction * at.aerosol_scattering) / np.where(scattering > 0, scattering, 1.0),
            1.0 if k == 0 else 0.0,
        )
        for k, fraction in enumerate(at.aerosol_phase_fraction)
    ]
    doubled = np.repeat(z, 2)[1:-1]
    return replace(
        medium,
        altitude_km=doubled,
        air_scattering_per_km=mean(at.air_scattering),
        absorption_per_km=mean(at.absorption),
        aerosol_extinction_per_km=extinction,
        aerosol_single_scattering_albedo=albedo,
        aerosol_phase_fraction=np.stack(fractions) if fractions else np.zeros((0, doubled.size, medium.n_wavelengths)),
        refractivity=medium.at(doubled).refractivity,
    )


def _at_centres(medium: Medium, z: np.ndarray) -> Medium:
    """The medium with the coefficients of the centre of each layer (Haber 2005 sec. 4.1.2: z_i at H*_i)."""
    at = medium.at(0.5 * (z[1:] + z[:-1]))
    doubled = np.repeat(z, 2)[1:-1]
    both = [np.repeat(a, 2, axis=-2) for a in at]
    return replace(
        medium,
        altitude_km=doubled,
        air_scattering_per_km=both[0],
        absorption_per_km=both[1],
        aerosol_extinction_per_km=both[2],
        aerosol_single_scattering_albedo=both[3],
        aerosol_phase_fraction=both[4],
        refractivity=medium.at(doubled).refractivity,
    )
