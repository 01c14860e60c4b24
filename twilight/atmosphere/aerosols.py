"""Aerosol between two altitudes: its extinction, single scattering albedo and phase functions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from twilight.atmosphere import opac
from twilight.atmosphere.levels import interpolate_coefficient, vertical_integral
from twilight.atmosphere.mie import N_ANGLES, SizeDistribution, particle_optics
from twilight.base.errors import TwilightError
from twilight.numerics.phase import PhaseFunction

VISIBLE_CONTRAST_DEPTH = math.log(1.0 / 0.02)
"""Optical depth that leaves 0.02 of a contrast: 3.912 (Koschmieder 1924; Preetham 1999 sec. 2.1)."""

_REFERENCE_NM = 550.0
"""Wavelength at which optical depths of aerosol are given [nm]."""


@dataclass(frozen=True)
class AerosolRegion:
    """Aerosol between the first and the last of n altitudes, at W wavelengths, with K phase functions.

    extinction_per_km (n, W): exponential between altitudes
    single_scattering_albedo (n, W): linear between them
    phase_fraction (K, n, W): fraction of the scattering that follows each phase function, linear between them
    """

    name: str
    altitude_km: np.ndarray
    extinction_per_km: np.ndarray
    single_scattering_albedo: np.ndarray
    phase_fraction: np.ndarray
    phase_functions: tuple[PhaseFunction, ...]

    @property
    def bottom_km(self) -> float:
        return float(self.altitude_km[0])

    @property
    def top_km(self) -> float:
        return float(self.altitude_km[-1])

    def scaled(self, factor: float | np.ndarray) -> AerosolRegion:
        return replace(self, extinction_per_km=self.extinction_per_km * factor)

    def henyey_greenstein(self) -> AerosolRegion:
        """The region with Henyey-Greenstein phase functions of the same asymmetry."""
        phases = tuple(PhaseFunction.henyey_greenstein(p.asymmetry, p.name) for p in self.phase_functions)
        return replace(self, phase_functions=phases)

    def between(self, bottom_km: float, top_km: float) -> AerosolRegion | None:
        """The part of the region between two altitudes, None where there is none."""
        bottom, top = max(bottom_km, self.bottom_km), min(top_km, self.top_km)
        if top <= bottom:
            return None
        inside = self.altitude_km[(self.altitude_km > bottom) & (self.altitude_km < top)]
        z = np.concatenate([[bottom], inside, [top]])
        extinction, albedo, phase_fraction = self.at(z)
        return replace(
            self,
            altitude_km=z,
            extinction_per_km=extinction,
            single_scattering_albedo=albedo,
            phase_fraction=phase_fraction,
        )

    def at(self, altitude_km: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Extinction (Z, W) [km^-1], albedo (Z, W) and phase fractions (K, Z, W) at altitudes (Z,) [km]."""
        z = np.asarray(altitude_km, dtype=float)
        i = np.clip(np.searchsorted(self.altitude_km, z, side="right") - 1, 0, self.altitude_km.size - 2)
        f = ((z - self.altitude_km[i]) / (self.altitude_km[i + 1] - self.altitude_km[i]))[:, None]
        extinction = interpolate_coefficient(self.extinction_per_km[i], self.extinction_per_km[i + 1], f)
        albedo = self.single_scattering_albedo[i] * (1 - f) + self.single_scattering_albedo[i + 1] * f
        phase_fraction = self.phase_fraction[:, i] * (1 - f) + self.phase_fraction[:, i + 1] * f
        return extinction, albedo, phase_fraction

    def optical_depth(self, top_km: float = math.inf) -> np.ndarray:
        """Vertical optical depth (W,) up to an altitude."""
        part = self.between(-math.inf, top_km)
        if part is None:
            return np.zeros(self.extinction_per_km.shape[1])
        return vertical_integral(part.extinction_per_km, part.altitude_km)


@dataclass(frozen=True)
class MixtureOptics:
    """Optics of a mixture at W wavelengths: extinction [km^-1] (W,), albedo (W,), one phase function."""

    extinction_per_km: np.ndarray
    single_scattering_albedo: np.ndarray
    phase: PhaseFunction


def mixture_optics(
    number_density_per_cm3: Mapping[str, float],
    relative_humidity_percent: float,
    wavelength_nm,
    phase_function: str = "mie",
    name: str = "",
) -> MixtureOptics:
    """External mixture of OPAC components; the phase matrix is the mean weighted with scattering."""
    wavelength = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
    particles = [
        (number, *opac.particles(component, relative_humidity_percent, wavelength))
        for component, number in number_density_per_cm3.items()
        if number > 0.0
    ]
    return mixture_of(particles, wavelength, phase_function, name)


def mixture_of(
    particles: Iterable[tuple[float, SizeDistribution, np.ndarray]],
    wavelength: np.ndarray,
    phase_function: str = "mie",
    name: str = "",
) -> MixtureOptics:
    """External mixture of populations: number per cm^3, size distribution, refractive index n - ik (W,) of each."""
    extinction = np.zeros(wavelength.size)
    scattering = np.zeros(wavelength.size)
    forward = np.zeros(wavelength.size)
    phase = np.zeros((wavelength.size, N_ANGLES))
    elements = np.zeros((4, wavelength.size, N_ANGLES))
    for number, size, index in particles:
        optics = particle_optics(size, index, wavelength)
        extinction += number * optics.extinction_per_km
        scattering += number * optics.scattering_per_km
        forward += number * optics.scattering_per_km * optics.asymmetry
        one = (number * optics.scattering_per_km)[:, None] * np.exp(optics.log_phase)
        phase += one
        elements += one * optics.ratios
    empty = scattering <= 0.0
    weight = np.where(empty, 1.0, scattering)
    asymmetry = forward / weight
    if phase_function == "henyey_greenstein" or np.any(empty):
        mixed = PhaseFunction.henyey_greenstein(asymmetry, name)
    else:
        mixed = PhaseFunction.from_log_table(np.log(phase / weight[:, None]), name, elements / phase)
    albedo = np.where(extinction > 0.0, np.minimum(1.0, scattering / np.where(extinction > 0.0, extinction, 1.0)), 0.0)
    return MixtureOptics(extinction, albedo, mixed)


def uniform_region(
    name: str,
    optics: MixtureOptics,
    bottom_km: float,
    top_km: float,
    scale_height_km: float = math.inf,
    base_km: float = 0.0,
) -> AerosolRegion:
    """One mixture whose extinction goes with exp(-(z - base)/scale height)."""
    z = np.array([bottom_km, top_km], dtype=float)
    n_w = optics.extinction_per_km.size
    return AerosolRegion(
        name,
        z,
        np.exp((base_km - z) / scale_height_km)[:, None] * optics.extinction_per_km,
        np.broadcast_to(optics.single_scattering_albedo, (2, n_w)).copy(),
        np.ones((1, 2, n_w)),
        (optics.phase,),
    )


def tropospheric_regions(
    spec: opac.AerosolSpec,
    wavelength_nm,
    stratosphere_bottom_km: float | None = None,
    ground_km: float = 0.0,
) -> list[AerosolRegion]:
    """Boundary layer, transported dust and free troposphere of a spec above the ground, not scaled to an optical depth.

    stratosphere_bottom_km: where another stratosphere than OPAC's begins, up to which the free troposphere goes.
    """

    def optics(numbers, humidity, name):
        return mixture_optics(numbers, humidity, wavelength_nm, spec.phase_function, name)

    regions = []
    bl_top, base = spec.boundary_layer_end_km(ground_km), spec.base_km(ground_km)
    if bl_top > ground_km and (spec.own is not None or any(n > 0 for n in spec.number_density_per_cm3.values())):
        height = math.inf if spec.scale_height_km == opac.CONSTANT_SCALE_HEIGHT_KM else spec.scale_height_km
        if spec.own is not None:
            boundary = spec.own.optics(wavelength_nm, spec.phase_function, "boundary layer")
        else:
            boundary = optics(spec.number_density_per_cm3, spec.relative_humidity_percent, "boundary layer")
        regions.append(uniform_region("boundary layer", boundary, ground_km, bl_top, height, base))
    free_top = spec.free_troposphere_top_km if stratosphere_bottom_km is None else stratosphere_bottom_km
    free_intervals = [(bl_top, free_top)]
    dust = spec.mineral_transported
    if dust is not None and dust.top_km > ground_km:
        dust_bottom = max(dust.bottom_km, ground_km)
        mineral = optics({"mitr": _dust_number(dust, dust_bottom)}, 0.0, "mineral transported")
        regions.append(uniform_region("mineral transported", mineral, dust_bottom, dust.top_km))
        bottom, top = free_intervals[0]
        free_intervals = [(bottom, min(top, dust.bottom_km)), (max(bottom, dust.top_km), top)]
    if spec.free_troposphere:
        free = None
        for bottom, top in free_intervals:
            if top > bottom:
                free = free or optics(
                    opac.FREE_TROPOSPHERE_PER_CM3, opac.FREE_TROPOSPHERE_HUMIDITY_PERCENT, "free troposphere"
                )
                height = spec.free_troposphere_scale_height_km
                regions.append(uniform_region("free troposphere", free, bottom, top, height))
    return regions


def _dust_number(dust: opac.MineralLayer, bottom_km: float) -> float:
    if dust.number_density_per_cm3 is not None:
        return dust.number_density_per_cm3
    assert dust.optical_depth_550nm is not None
    per_particle = mixture_optics({"mitr": 1.0}, 0.0, _REFERENCE_NM).extinction_per_km[0]
    return dust.optical_depth_550nm / (per_particle * (dust.top_km - bottom_km))


def opac_stratosphere(spec: opac.AerosolSpec, wavelength_nm, ground_km: float = 0.0) -> list[AerosolRegion]:
    """OPAC's own stratospheric background of a spec, empty where the spec wants none."""
    if not spec.stratosphere:
        return []
    bottom = max(spec.boundary_layer_end_km(ground_km), spec.free_troposphere_top_km)
    if bottom >= opac.STRATOSPHERE_TOP_KM:
        return []
    optics = mixture_optics(opac.STRATOSPHERE_PER_CM3, 0.0, wavelength_nm, spec.phase_function, "stratosphere")
    return [uniform_region("stratosphere", optics, bottom, opac.STRATOSPHERE_TOP_KM)]


def optical_depth_at(known_nm, known_depth, wavelength_nm: np.ndarray) -> np.ndarray:
    """Optical depth (W,) at wavelengths (W,) [nm] from two or more known ones.

    A power law between neighbours, and beyond the ends that of the outermost two (Angstrom 1929).
    """
    x, y = np.log(np.asarray(known_nm, dtype=float)), np.log(np.asarray(known_depth, dtype=float))
    at = np.log(np.asarray(wavelength_nm, dtype=float))
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    return np.exp(y[i] + (at - x[i]) * (y[i + 1] - y[i]) / (x[i + 1] - x[i]))


def tropospheric_factor(
    target: np.ndarray,
    wavelength_nm: np.ndarray,
    tropospheric: Iterable[AerosolRegion],
    stratospheric: Iterable[AerosolRegion],
    top_km: float,
) -> np.ndarray:
    """Factor (W,) on the tropospheric aerosol that makes the column's optical depth the target (W,).

    wavelength_nm: of the regions.  Raises TwilightError where no factor does it.
    """
    below = sum((region.optical_depth(top_km) for region in tropospheric), np.zeros(target.size))
    above = sum((region.optical_depth(top_km) for region in stratospheric), np.zeros(target.size))
    for w in np.flatnonzero(target < above):
        raise TwilightError(
            f"{_depth_key(wavelength_nm[w])}: {target[w]:.4g} is less than the stratospheric aerosol's own "
            f"{above[w]:.4g}; allowed is {above[w]:.4g} and more, or leave out the stratospheric aerosol"
        )
    for w in np.flatnonzero((below <= 0.0) & (target > above)):
        raise TwilightError(
            f"{_depth_key(wavelength_nm[w])}: {target[w]:.4g} cannot be reached, there is no tropospheric aerosol to "
            "scale"
        )
    return np.divide(target - above, below, out=np.ones(target.size), where=below > 0.0)


def visibility_factor(
    visibility_km: float, air_per_km: float, tropospheric: Iterable[AerosolRegion], ground_km: float
) -> float:
    """Factor on the tropospheric aerosol that gives the visibility, V = ln(1 / 0.02) / extinction at the ground.

    Koschmieder 1924: a black object at V has 0.02 of its contrast with the horizon sky left.  air_per_km: scattering of
    air at the ground, of the regions' one wavelength.  Raises TwilightError where no factor does it.
    """
    lowest = [region.at(np.array([ground_km]))[0] for region in tropospheric if region.bottom_km <= ground_km]
    extinction = float(sum((values[0, 0] for values in lowest), 0.0))
    wanted = VISIBLE_CONTRAST_DEPTH / visibility_km - air_per_km
    if wanted < 0.0:
        most = VISIBLE_CONTRAST_DEPTH / air_per_km
        raise TwilightError(f"aerosol.visibility_km is {visibility_km:g}; allowed is {most:.0f}, that of pure air")
    if extinction <= 0.0:
        raise TwilightError("aerosol.visibility_km cannot be reached, there is no aerosol at the ground to scale")
    return wanted / extinction


def _depth_key(wavelength_nm: float) -> str:
    """What a message calls the optical depth at a wavelength."""
    if wavelength_nm == _REFERENCE_NM:
        return "aerosol.optical_depth_550nm"
    return f"aerosol.optical_depths at {wavelength_nm:g} nm"
