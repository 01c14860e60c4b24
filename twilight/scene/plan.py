"""What a scene leaves out because it is negligible; and figures of a medium: optical depths by part, scale heights,
horizontal refraction.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twilight import solvers
from twilight.atmosphere import bands, gases
from twilight.atmosphere.aerosols import VISIBLE_CONTRAST_DEPTH
from twilight.atmosphere.medium import Medium
from twilight.base.conventions import EARTH_RADIUS_KM, TINY
from twilight.config.climate import Climate, Gases, air_profile
from twilight.config.scene import Config
from twilight.scene.medium import climate_medium, cloud_layers, wavelengths_of
from twilight.transport.ray_profile import ray_profile
from twilight.transport.rays import OUTSIDE, sun_ray

GAS_TOLERANCE = 1e-3
"""A gas is left out where its optical depth along the longest straight path through the air, once in and once out, is
below this; the radiance then moves by a smaller fraction."""
BANDS_RADIANCE = 1e-2
"""Bands of a gas are omitted where they take a smaller fraction of every wavelength's light over `LONGEST_MASS`."""
SAID = 5e-4
"""Fraction of a wavelength's light from which on an omission names it."""
LONGEST_MASS = 40.0
"""Vertical columns that light crosses on the longest way, along the horizon (relative air mass)."""
WITHOUT_DATA_NM = (627.0, 632.0)
"""The band of oxygen at 629 nm, which the source of the others leaves out."""
SCALAR_ERROR = "scalar theory: 1 to 5 % at 440 nm, up to 17 % in single directions (docs/notes/polarisation.md)"
"""Lowest and highest median, and largest error, of benchmarks/results/polarisation.csv (docs/notes/polarisation.md)."""


@dataclass(frozen=True)
class Omission:
    """A part that is not computed: why, and by how much the radiance moves at most because of it."""

    part: str
    reason: str
    effect: str


@dataclass(frozen=True)
class Plan:
    """The climate as it will be computed, and what was left out of the one that was asked for."""

    climate: Climate
    omissions: tuple[Omission, ...]


def make_plan(config: Config, wavelength_nm: np.ndarray | None = None) -> Plan:
    """What this scene needs; everything the configuration asks for when `omit_negligible` is false.

    wavelength_nm (W,): in place of the scene's own.
    """
    climate = config.climate
    if not config.omit_negligible:
        return Plan(climate, ())
    omissions: list[Omission] = []
    own = wavelength_nm is None
    if wavelength_nm is None:
        wavelength_nm = wavelengths_of(config)
    if climate.medium is None:
        assert wavelength_nm is not None
        climate = _without_empty_aerosol(climate, omissions)
        climate = _without_weak_gases(climate, wavelength_nm, omissions)
        climate = _without_weak_bands(climate, wavelength_nm, omissions)
        aerosol = bool(climate.aerosol is not None or climate.stratosphere is not None or cloud_layers(climate))
        bends = climate.refraction.model != "none"
    else:
        medium = climate_medium(climate, wavelength_nm)
        aerosol, bends = medium.has_aerosol, medium.has_refraction
    if own and wavelength_nm is not None and (config.wavelengths is None or config.wavelengths.placed):
        omissions.append(
            Omission(
                "other wavelengths",
                f"{wavelength_nm.size} that are placed between the bands of the gases stand for the visible",
                "luminance below 0.7 %, CIEDE2000 below 0.8 at 95 % of directions; bands between them take some 0.4 % "
                "of the luminance of a low sun",
            )
        )
    if not aerosol and not any(item.part == "aerosol" for item in omissions):
        omissions.append(Omission("aerosol", "the climate has none: no Mie theory, no phase tables", "none"))
    if not bends:
        omissions.append(Omission("refraction", "the refractive index is 1: rays and sunbeam are straight", "none"))
    return Plan(climate, tuple(omissions))


def not_computed(config: Config) -> tuple[Omission, ...]:
    """What matters in this scene and is not computed all the same: polarisation, refraction where rays are straight,
    phase functions where simpler ones stand for them, what a formula does not take, and bands that the air lacks."""
    omissions = []
    name, quality, settings = config.chosen_solver
    if not hasattr(settings, "polarisation"):
        omissions.append(Omission("polarisation", f"{name} computes radiance alone", "no Q, no U"))
    elif not settings.polarisation:
        omissions.append(Omission("polarisation", f"{name} ({quality}) with solver.polarisation: false", SCALAR_ERROR))
    can = solvers.load(name).CAPABILITIES
    if can.kind == "formula":
        omissions.append(Omission("the air", f"{name} is a formula of turbidity and ground albedo", "not known"))
    elif can.straight_rays and config.climate.refraction.model != "none":
        omissions.append(Omission("refraction", f"rays of {name} are straight", "9 to 23 % at -4 deg"))
    if can.simple_phases:
        reason = f"in {name} air scatters alike in all directions and aerosol by Henyey and Greenstein's function"
        omissions.append(
            Omission("phase functions", reason, "33 % of light scattered once by air (docs/three-papers.md)")
        )
    wavelength_nm = wavelengths_of(config)
    if config.climate.medium is None and wavelength_nm is not None:
        low, high = WITHOUT_DATA_NM
        inside = [w for w in wavelength_nm if low <= w <= high]
        if inside and config.climate.gases.oxygen:
            shown = ", ".join(f"{w:g}" for w in inside)
            omissions.append(
                Omission("oxygen at 629 nm", f"SPCTRL2 has no data for this band, which holds {shown} nm", "not known")
            )
    return tuple(omissions)


def _without_weak_bands(climate: Climate, wavelength_nm: np.ndarray, omissions: list[Omission]) -> Climate:
    """Bands in which no wavelength lies."""
    column_mm = climate.gases.water_vapour.column_mm
    profile = air_profile(climate).above(climate.ground.altitude_km)
    changes: dict[str, dict[str, object]] = {
        bands.WATER_VAPOUR: {"water_vapour": climate.gases.water_vapour.model_copy(update={"column_mm": 0.0})},
        bands.OXYGEN: {"oxygen": False},
    }
    wanted = {bands.WATER_VAPOUR: column_mm != 0.0, bands.OXYGEN: climate.gases.oxygen}
    for gas in bands.GASES:
        if not wanted[gas]:
            continue
        amount = bands.amounts(gas, profile, wavelength_nm, column_mm)
        taken = 1.0 - bands.transmission(gas, LONGEST_MASS * amount)
        if taken.max() < BANDS_RADIANCE:
            inside = [f"{w:g} nm by {100 * t:.1f} %" for w, t in zip(wavelength_nm, taken, strict=True) if t >= SAID]
            effect = f"over {LONGEST_MASS:g} vertical columns {', '.join(inside)}" if inside else "none"
            omissions.append(Omission(f"bands of {gas}", "no wavelength of this scene lies in them", effect))
            climate = climate.model_copy(update={"gases": climate.gases.model_copy(update=changes[gas])})
    return climate


def _without_empty_aerosol(climate: Climate, omissions: list[Omission]) -> Climate:
    """Aerosol that is there in name only would still be put through Mie theory."""
    aerosol = climate.aerosol
    if aerosol is None:
        return climate
    background = aerosol.free_troposphere or aerosol.mineral_transported is not None
    own_stratosphere = climate.stratosphere is None and aerosol.stratosphere != "none"
    if aerosol.optical_depth_550nm == 0.0 and climate.stratosphere is None:
        omissions.append(Omission("aerosol", "aerosol.optical_depth_550nm is 0: no Mie theory", "none"))
        return climate.model_copy(update={"aerosol": None})
    if aerosol.components and not any(aerosol.components.values()) and not background and not own_stratosphere:
        omissions.append(Omission("aerosol", "all aerosol.components are 0: no Mie theory", "none"))
        return climate.model_copy(update={"aerosol": None})
    return climate


def _without_weak_gases(climate: Climate, wavelength_nm: np.ndarray, omissions: list[Omission]) -> Climate:
    weak = list(_weak_gases(climate, wavelength_nm))
    if not weak:
        return climate
    gases: Gases = climate.gases
    for gas, depth in weak:
        span = (
            f"{wavelength_nm[0]:g} to {wavelength_nm[-1]:g} nm"
            if len(wavelength_nm) > 1
            else f"{wavelength_nm[0]:g} nm"
        )
        reason = f"optical depth along the limb, in and out, is at most {depth:.1e} at {span}"
        omissions.append(Omission(gas, reason, f"below {GAS_TOLERANCE:g}" if depth > 0 else "none"))
        if gas == "ozone":
            gases = gases.model_copy(update={"ozone": gases.ozone.model_copy(update={"treatment": "none"})})
        else:
            gases = gases.model_copy(update={gas: False})
    return climate.model_copy(update={"gases": gases})


def _weak_gases(climate: Climate, wavelength_nm: np.ndarray) -> Iterator[tuple[str, float]]:
    """Gases whose absorption cannot be seen at these wavelengths, with twice their largest limb optical depth."""
    full = air_profile(climate).above(climate.ground.altitude_km)
    profile = full.at(full.altitude_km[full.altitude_km <= climate.atmosphere.top_km])
    ozone = climate.gases.ozone
    wanted = {"ozone": ozone.treatment == "layer", "no2": climate.gases.no2, "o4": climate.gases.o4}
    column = ozone.column_du if ozone.day_of_year is None else gases.seasonal_ozone_column_du(ozone.day_of_year)
    factor = {"ozone": gases.ozone_factor(full, column)}
    tables = {"ozone": "o3", "no2": "no2", "o4": "o4"}
    for gas, asked in wanted.items():
        if asked:
            absorption = gases.absorption_per_km(tables[gas], profile, wavelength_nm, factor.get(gas, 1.0))
            depth = 2.0 * float(_limb_optical_depth(profile.altitude_km, absorption))
            if depth < GAS_TOLERANCE:
                yield gas, depth


def _limb_optical_depth(altitude_km: np.ndarray, coefficient_per_km: np.ndarray) -> float:
    """Largest optical depth of a straight path that grazes the sphere at any of the altitudes, from space to space."""
    radius = EARTH_RADIUS_KM + altitude_km
    largest = np.max(coefficient_per_km, axis=1)
    depth = 0.0
    for i in range(radius.size - 1):
        distance = np.sqrt(radius[i:] ** 2 - radius[i] ** 2)
        means = 0.5 * (largest[i + 1 :] + largest[i:-1])
        depth = max(depth, 2.0 * float(np.sum(means * np.diff(distance))))
    return depth


def optical_depths(medium: Medium) -> list[tuple[str, np.ndarray]]:
    """Vertical optical depth (W,) of each part the medium was made of, and of all that is in the air together."""
    parts = medium.notes.get("optical_depth")
    if parts is None:
        names = {"air": "air", "gases": "absorption", "aerosol": "aerosol"}
        rows = [(name, medium.optical_depth(part)) for name, part in names.items()]
    else:
        rows = [(name, np.asarray(depth)) for name, depth in parts.items()]
        rows.append(("all particles", medium.optical_depth("aerosol")))
    return [*rows, ("total", medium.optical_depth("total"))]


def scale_height_km(medium: Medium, part: str) -> float:
    """Optical depth over the coefficient at the ground [km] at the middle wavelength; nan where there is none.

    part: `air` or `aerosol`.  An exponential atmosphere gives its scale height, a homogeneous layer its thickness.
    """
    middle = medium.n_wavelengths // 2
    coefficient = {"air": medium.air_scattering_per_km, "aerosol": medium.aerosol_extinction_per_km}[part][0, middle]
    return float(medium.optical_depth(part)[middle] / coefficient) if coefficient > 0 else float("nan")


def horizontal_refraction_arcmin(medium: Medium) -> np.ndarray:
    """Bending [arcmin], (W,), of a ray that reaches an observer on the ground horizontally; nan where it is trapped."""
    profile = ray_profile(medium)
    bending = np.full(medium.n_wavelengths, np.nan)
    for w in range(medium.n_wavelengths):
        value, _, status = sun_ray(profile, w, medium.bottom_km, 0.0, 0.0)
        if status == OUTSIDE:
            bending[w] = np.degrees(value) * 60.0
    return bending


def facts(medium: Medium) -> list[tuple[str, str]]:
    """What `twilight show NAME` says below the optical depths: names and values with their units."""
    rows = [("ground", f"{medium.bottom_km:g} km above sea level")] if medium.bottom_km != 0.0 else []
    rows += [("top of the air", f"{medium.top_km:g} km"), ("levels", str(np.unique(medium.altitude_km).size))]
    for part in ("air", "aerosol"):
        height = scale_height_km(medium, part)
        if np.isfinite(height):
            rows.append((f"scale height of the {part}", f"{height:.2f} km"))
    if "ozone_column_du" in medium.notes:
        column, source = medium.notes["ozone_column_du"], medium.notes["ozone_source"]
        rows.append(("ozone column", f"{column:.0f} DU ({source})" if column > 0.0 else "0 DU"))
    if "water_vapour_column_mm" in medium.notes:
        column, source = medium.notes["water_vapour_column_mm"], medium.notes["water_vapour_source"]
        rows.append(("water vapour column", f"{column:.1f} mm ({source})" if column > 0.0 else "0 mm"))
    at_550 = np.flatnonzero(medium.wavelength_nm == 550.0)
    if at_550.size and medium.has_aerosol:
        w = at_550[0]
        turbidity = 1.0 + medium.optical_depth("aerosol")[w] / max(medium.optical_depth("air")[w], 1e-300)
        seen_through = medium.air_scattering_per_km[0, w] + medium.aerosol_extinction_per_km[0, w]
        visibility = VISIBLE_CONTRAST_DEPTH / max(seen_through, TINY)
        rows.append(("turbidity at 550 nm (Preetham 1999)", f"{turbidity:.2f}"))
        rows.append(("visibility at the ground at 550 nm (Koschmieder)", f"{visibility:.0f} km"))
    for name, bottom, top in medium.notes.get("regions", ()):
        rows.append((f"particles: {name}", f"{bottom:g} to {top:g} km"))
    middle = medium.n_wavelengths // 2
    if medium.has_refraction:
        bending = horizontal_refraction_arcmin(medium)[middle]
        at = f"at {medium.wavelength_nm[middle]:g} nm"
        rows.append((f"refractive index at the ground, {at}", f"1 + {medium.refractivity[0, middle]:.4e}"))
        rows.append((f"horizontal refraction at the ground, {at}", f"{bending:.1f} arcmin"))
    else:
        rows.append(("refraction", "none"))
    albedo = medium.ground_albedo
    rows.append(
        ("albedo of the ground", " to ".join(f"{a:g}" for a in sorted({float(albedo.min()), float(albedo.max())})))
    )
    return rows
