"""The OPAC aerosol database: components, humidity classes, ten types, background composition.

Source: Hess, Koepke & Schult 1998, Bull. Amer. Meteor. Soc. 79, 831 (OPAC 3.1).
"""

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from twilight.atmosphere.mie import LogNormal
from twilight.base.errors import TwilightError
from twilight.base.shipped_data import data_rows

DEFAULT_HUMIDITY_PERCENT = 80.0
"""Relative humidity of a climate that names none [%]."""

MAX_HUMIDITY_PERCENT = 99.0
"""Highest relative humidity that OPAC tabulates [%]."""

FREE_TROPOSPHERE_PER_CM3 = {"waso": 438.0, "inso": 1.24e-3, "soot": 292.0}
FREE_TROPOSPHERE_HUMIDITY_PERCENT = 50.0
"""Sea-level equivalent.  OPAC tabulates the extinction only; these numbers are the non-negative least-squares fit of
its components to that extinction at 60 wavelengths, 0.25 to 40 um, which fits at 50 % humidity and at no other class
(worst 0.5 % over 0.25 to 1 um)."""

FREE_TROPOSPHERE_TOP_KM = 12.0
"""Top of OPAC's free troposphere [km]."""

FREE_TROPOSPHERE_SCALE_HEIGHT_KM = 8.0
"""Scale height of OPAC's free troposphere [km]."""

STRATOSPHERE_PER_CM3 = {"suso": 3.0}
"""Sulphuric acid (75 %), constant with altitude: reproduces OPAC's tabulated extinction to 0.3 % over 0.25 to 1 um."""

STRATOSPHERE_TOP_KM = 35.0
"""Top of OPAC's stratospheric aerosol [km]."""

CONSTANT_SCALE_HEIGHT_KM = 99.0
"""OPAC's mark for a layer that does not change with altitude."""

BASES = ("ground", "sea_level")
"""From where heights of the boundary layer count."""


@dataclass(frozen=True)
class MineralLayer:
    """A layer of transported mineral dust (OPAC component `mitr`), constant between two altitudes.

    Give one of number_density_per_cm3 and optical_depth_550nm (of this layer alone).
    """

    bottom_km: float
    top_km: float
    number_density_per_cm3: float | None = None
    optical_depth_550nm: float | None = None

    def __post_init__(self):
        _check("mineral_transported.bottom_km", self.bottom_km, 0.0, 100.0)
        _check("mineral_transported.top_km", self.top_km, 0.0, 100.0)
        if self.top_km <= self.bottom_km:
            raise TwilightError(
                f"mineral_transported: top_km {self.top_km:g} must be above bottom_km {self.bottom_km:g}"
            )
        if (self.number_density_per_cm3 is None) == (self.optical_depth_550nm is None):
            raise TwilightError("mineral_transported: give one of number_density_per_cm3 and optical_depth_550nm")
        if self.number_density_per_cm3 is not None:
            _check("mineral_transported.number_density_per_cm3", self.number_density_per_cm3, 0.0, 1e6)
        if self.optical_depth_550nm is not None:
            _check("mineral_transported.optical_depth_550nm", self.optical_depth_550nm, 0.0, 100.0)


class BoundaryOptics(Protocol):
    """Optics of particles that are not OPAC's."""

    def optics(self, wavelength_nm, phase_function: str, name: str) -> Any:
        """A MixtureOptics at the wavelengths, at the base of the boundary layer."""


@dataclass(frozen=True)
class AerosolSpec:
    """An aerosol in OPAC's terms.

    number_density_per_cm3: particles of each OPAC component at the base, for the boundary layer; the extinction goes
        with exp(-z/scale height) from the base to boundary_layer_top_km (scale height 99 = constant).
    boundary_layer_base: `ground`, or `sea_level`: where heights of the boundary layer and the densities count from; a
        mountain stands above a part or all of a layer that counts from sea level.
    relative_humidity_percent: of the boundary layer, 0 to 99; components that take up water swell with it.
    mineral_transported: optional dust layer; the free troposphere makes room for it.
    free_troposphere: OPAC's own background from the boundary layer's top to free_troposphere_top_km, with
        exp(-z/free_troposphere_scale_height_km) counted from sea level.
    stratosphere: OPAC's own background, constant from there to 35 km; a StratosphereSpec takes its place.
    optical_depth_550nm: if given, the whole tropospheric aerosol (boundary layer, dust, free troposphere) is scaled by
        one factor until the column of all aerosol up to the medium's top has this optical depth at 550 nm.
    turbidity: in place of it (air + aerosol) / air, vertical optical depths at 550 nm (Preetham 1999 sec. 2.1)
    visibility_km: in place of it ln(1 / 0.02) over the extinction of air and aerosol at the ground at 550 nm
        (Koschmieder 1924)
    optical_depths: in place of it two or more wavelengths [nm] and the column's optical depth at each: one factor for
        each wavelength.
    phase_function: `mie`, or `henyey_greenstein` with the asymmetry from Mie.
    own: what the boundary layer holds in place of OPAC's components (see ``twilight.atmosphere.own_aerosol``).
    """

    number_density_per_cm3: Mapping[str, float]
    relative_humidity_percent: float = 80.0
    boundary_layer_top_km: float = 2.0
    scale_height_km: float = 8.0
    boundary_layer_base: str = "ground"
    mineral_transported: MineralLayer | None = None
    free_troposphere: bool = True
    free_troposphere_top_km: float = FREE_TROPOSPHERE_TOP_KM
    free_troposphere_scale_height_km: float = FREE_TROPOSPHERE_SCALE_HEIGHT_KM
    stratosphere: bool = True
    optical_depth_550nm: float | None = None
    optical_depths: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    turbidity: float | None = None
    visibility_km: float | None = None
    phase_function: str = "mie"
    own: BoundaryOptics | None = None

    def __post_init__(self):
        for component, number in self.number_density_per_cm3.items():
            check_component(component)
            _check(f"aerosol.number_density_per_cm3.{component}", number, 0.0, 1e9)
        _check("aerosol.relative_humidity_percent", self.relative_humidity_percent, 0.0, MAX_HUMIDITY_PERCENT)
        _check("aerosol.boundary_layer_top_km", self.boundary_layer_top_km, 0.0, 100.0)
        _check("aerosol.scale_height_km", self.scale_height_km, 1e-3, 1e3)
        _check("aerosol.free_troposphere_top_km", self.free_troposphere_top_km, 0.0, 100.0)
        _check("aerosol.free_troposphere_scale_height_km", self.free_troposphere_scale_height_km, 1e-3, 1e3)
        if self.optical_depth_550nm is not None:
            _check("aerosol.optical_depth_550nm", self.optical_depth_550nm, 0.0, 100.0)
        if self.boundary_layer_base not in BASES:
            raise TwilightError(
                f"aerosol.boundary_layer_base: `{self.boundary_layer_base}` is not known; "
                f"allowed are {', '.join(BASES)}"
            )
        if self.phase_function not in ("mie", "henyey_greenstein"):
            raise TwilightError(
                f"aerosol.phase_function: `{self.phase_function}` is not known; allowed are mie, henyey_greenstein"
            )

    def base_km(self, ground_km: float) -> float:
        """Altitude of the boundary layer's base [km]."""
        return ground_km if self.boundary_layer_base == "ground" else 0.0

    def boundary_layer_end_km(self, ground_km: float) -> float:
        """Altitude above which there is no boundary layer [km]."""
        return max(ground_km, self.base_km(ground_km) + self.boundary_layer_top_km)


def _check(key: str, value: float, lowest: float, highest: float) -> None:
    if not (math.isfinite(value) and lowest <= value <= highest):
        raise TwilightError(f"{key}: {value} is not possible, allowed is {lowest:g} to {highest:g}")


@dataclass(frozen=True)
class _HumidityClass:
    humidity_percent: float
    size: LogNormal
    wavelength_um: np.ndarray
    index: np.ndarray


@lru_cache(maxsize=1)
def _database() -> dict[str, list[_HumidityClass]]:
    indices: dict[tuple[str, str], list[tuple[float, complex]]] = {}
    for row in data_rows("opac/refractive_indices.csv"):
        value = complex(float(row["n_real"]), -abs(float(row["n_imag"])))
        indices.setdefault((row["component"], row["rh_percent"]), []).append((float(row["wavelength_um"]), value))
    database: dict[str, list[_HumidityClass]] = {}
    for row in data_rows("opac/size_distributions.csv"):
        size = LogNormal(*(float(row[key]) for key in ("rmod_um", "sigma_g", "rmin_um", "rmax_um")))
        spectrum = sorted(indices[row["component"], row["rh_percent"]], key=lambda pair: pair[0])
        database.setdefault(row["component"], []).append(
            _HumidityClass(
                float(row["rh_percent"]),
                size,
                np.array([w for w, _ in spectrum]),
                np.array([m for _, m in spectrum]),
            )
        )
    return database


def components() -> tuple[str, ...]:
    """Names of the OPAC components."""
    return tuple(_database())


def check_component(name: str) -> None:
    if name not in _database():
        raise TwilightError(f"aerosol component `{name}` is not known; allowed are {', '.join(components())}")


def takes_up_water(component: str) -> bool:
    return len(_database()[component]) > 1


def humidity_classes(component: str) -> tuple[float, ...]:
    """Relative humidities [%] at which OPAC tabulates a component; (0,) for one that does not take up water."""
    return tuple(c.humidity_percent for c in _database()[component])


def swollen_radius(humidity_percent: np.ndarray, radius: np.ndarray, wanted_percent: float) -> float:
    """Radius at a humidity from radii at several, the first dry (0 %).

    kappa(RH) = ((r/r_dry)^3 - 1) (1 - RH)/RH varies slowly (Petters & Kreidenweis 2007, Atmos. Chem. Phys. 7, 1961);
    its logarithm is interpolated (monotone cubic) in ln(1 - RH), and goes on linearly below the first moist class.
    """
    from scipy.interpolate import PchipInterpolator  # start-up

    if wanted_percent <= 0.0:
        return float(radius[0])
    rh = humidity_percent[1:] / 100.0
    log_kappa = np.log(((radius[1:] / radius[0]) ** 3 - 1.0) * (1.0 - rh) / rh)
    x = -np.log(1.0 - rh)
    wanted = wanted_percent / 100.0
    at = -math.log(1.0 - wanted)
    if at < x[0]:
        kappa = math.exp(log_kappa[0] + (at - x[0]) * (log_kappa[1] - log_kappa[0]) / (x[1] - x[0]))
    else:
        kappa = math.exp(PchipInterpolator(x, log_kappa)(at))
    return float(radius[0]) * (1.0 + kappa * wanted / (1.0 - wanted)) ** (1.0 / 3.0)


def particles(
    component: str, relative_humidity_percent: float, wavelength_nm, leave_out_percent: float | None = None
) -> tuple[LogNormal, np.ndarray]:
    """Size distribution and refractive index n - ik (W,) of a component at a humidity and wavelengths [nm].

    Between OPAC's humidity classes the swelling is interpolated, not the optics (``swollen_radius``), and the index
    goes linearly with the volume fraction of the dry substance, (r_dry/r)^3, as OPAC mixes it with water; in wavelength
    it is linear.

    Error between the classes: doing without one class of 70 to 98 % moves its extinction by 2.4 % at most (400 to
    800 nm, all components), without the one of 50 % by 7.3 %; both bound the error from above.
    leave_out_percent: a class to do without, for estimates of the interpolation's error.
    """
    check_component(component)
    _check("relative_humidity_percent", relative_humidity_percent, 0.0, MAX_HUMIDITY_PERCENT)
    classes = [c for c in _database()[component] if c.humidity_percent != leave_out_percent]
    wavelength_um = np.atleast_1d(np.asarray(wavelength_nm, dtype=float)) * 1e-3

    def index_of(c: _HumidityClass) -> np.ndarray:
        real = np.interp(wavelength_um, c.wavelength_um, c.index.real)
        return real + 1j * np.interp(wavelength_um, c.wavelength_um, c.index.imag)

    for c in classes:
        if len(classes) == 1 or c.humidity_percent == relative_humidity_percent:
            return c.size, index_of(c)
    humidity = np.array([c.humidity_percent for c in classes])

    def radius(name: str) -> float:
        return swollen_radius(humidity, np.array([getattr(c.size, name) for c in classes]), relative_humidity_percent)

    size = LogNormal(
        radius("median_radius_um"), classes[0].size.sigma, radius("min_radius_um"), radius("max_radius_um")
    )
    dry_radius = classes[0].size.median_radius_um
    dry_fraction = np.array([(dry_radius / c.size.median_radius_um) ** 3 for c in classes])
    fraction = (dry_radius / size.median_radius_um) ** 3
    table = np.stack([index_of(c) for c in classes])
    order = np.argsort(dry_fraction)
    index = np.array(
        [
            np.interp(fraction, dry_fraction[order], column.real[order])
            + 1j * np.interp(fraction, dry_fraction[order], column.imag[order])
            for column in table.T
        ]
    )
    return size, index


@lru_cache(maxsize=1)
def _types() -> dict[str, dict]:
    types: dict[str, dict] = {}
    for row in data_rows("opac/aerosol_layers.csv"):
        types[row["type"]] = {
            "boundary_layer_top_km": float(row["boundary_layer_top_km"]),
            "scale_height_km": float(row["boundary_layer_scale_height_km"]),
            "number_density_per_cm3": {},
        }
    for row in data_rows("opac/aerosol_types.csv"):
        types[row["type"]]["number_density_per_cm3"][row["component"]] = float(row["number_density_cm3"])
    return types


def opac_types() -> tuple[str, ...]:
    """The ten types in OPAC's order, spelt with hyphens: `continental-clean`, ..., `antarctic`."""
    return tuple(name.replace(" ", "-") for name in _types())


def opac_type(name: str, relative_humidity_percent: float = DEFAULT_HUMIDITY_PERCENT) -> AerosolSpec:
    """One of OPAC's ten types; `continental average`, `continental-average` and `continental_average` are the same."""
    types = _types()
    key = name.strip().lower().replace("-", " ").replace("_", " ")
    if key not in types:
        near = difflib.get_close_matches(key, types, n=1)
        hint = f" (did you mean `{near[0].replace(' ', '-')}`?)" if near else ""
        raise TwilightError(f"aerosol type `{name}` is not known{hint}; allowed are {', '.join(opac_types())}")
    return AerosolSpec(relative_humidity_percent=relative_humidity_percent, **types[key])


def populations() -> list[tuple[str, float]]:
    """Component and humidity of every population in the ten types (at the default) and their background."""
    pairs = {(c, FREE_TROPOSPHERE_HUMIDITY_PERCENT) for c in FREE_TROPOSPHERE_PER_CM3}
    pairs |= {(c, 0.0) for c in (*STRATOSPHERE_PER_CM3, "mitr")}
    for name in opac_types():
        pairs |= {(c, DEFAULT_HUMIDITY_PERCENT) for c in opac_type(name).number_density_per_cm3}
    return sorted({(c, rh if takes_up_water(c) else 0.0) for c, rh in pairs})
