"""Stratospheric aerosol: LOWTRAN's background and volcanic loadings, and profiles measured by SAGE III/ISS."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from twilight.atmosphere import opac
from twilight.atmosphere.aerosols import AerosolRegion
from twilight.atmosphere.mie import LogNormal, particle_optics
from twilight.atmosphere.profiles import PROFILE_TOP_KM
from twilight.base.errors import TwilightError
from twilight.base.shipped_data import data_rows
from twilight.numerics.phase import PhaseFunction

LOWTRAN_KINDS = {
    "background": ("bast", "background_stratospheric"),
    "moderate_volcanic": ("vumo", "aged_volcanic"),
    "high_volcanic": ("hivu", "fresh_volcanic"),
    "extreme_volcanic": ("exvu", "fresh_volcanic"),
}
"""Loading -> column of the extinction table, spectral optics that LOWTRAN 7 pairs with it by default."""

SEASONS = {"fall_winter": "fw", "spring_summer": "ss"}
"""Season -> letters of its columns in LOWTRAN's tables."""

UPPER_ATMOSPHERES = {
    ("background", "normal"): "upnatm",
    ("background", "extreme"): "exupat",
    ("volcanic", "normal"): "vutono",
    ("volcanic", "extreme"): "vutoex",
}
"""Above 30 km: the column that continues the stratosphere below it, each starts at its extinction at 30 km."""

SAGE_WAVELENGTH_NM = np.array([384.0, 448.0, 520.0, 601.0, 676.0, 756.0, 869.0, 1021.0, 1543.0])
"""Channels of SAGE III/ISS [nm]."""

SAGE_MODE_WIDTH = 1.6
"""Geometric standard deviation of the droplets' radii that the retrieval assumes."""

SAGE_RADII_UM = np.geomspace(0.045, 0.225, 6)
"""Median radii at which the droplets' optics are computed; all retrieved ones lie between."""


@dataclass(frozen=True)
class ExtinctionLevels:
    """A measured profile of extinction.

    altitude_km: (n,), increasing; wavelength_nm: (c,), increasing; extinction_per_km: n rows of c, positive.
    median_radius_um: (n,), of the droplets; None: that of the scenario at the altitude.
    """

    altitude_km: tuple[float, ...]
    wavelength_nm: tuple[float, ...]
    extinction_per_km: tuple[tuple[float, ...], ...]
    median_radius_um: tuple[float, ...] | None = None


@dataclass(frozen=True)
class StratosphereSpec:
    """Stratospheric aerosol that takes the place of OPAC's own.

    kind: `background`, `moderate_volcanic`, `high_volcanic`, `extreme_volcanic` (LOWTRAN 7, Shettle & Fenn), or the
        name of a SAGE III/ISS scenario such as `nh_midlat_typical` (see ``sage_scenarios``).
    season: `fall_winter` or `spring_summer`; LOWTRAN kinds only.
    optics: spectral optics of a LOWTRAN loading, one of `background_stratospheric`, `aged_volcanic`,
        `fresh_volcanic`; None takes the usual one of the loading.
    upper_atmosphere: meteoric dust above 30 km, `normal` or `extreme`; LOWTRAN kinds only.
    levels: extinction in place of the scenario's, which then gives radii that the levels lack, and the decay above.
    """

    kind: str = "background"
    season: str = "spring_summer"
    optics: str | None = None
    upper_atmosphere: str = "normal"
    levels: ExtinctionLevels | None = None

    def __post_init__(self):
        if self.kind not in LOWTRAN_KINDS and self.kind not in sage_scenarios():
            allowed = ", ".join((*LOWTRAN_KINDS, *sage_scenarios()))
            raise TwilightError(f"stratosphere.kind: `{self.kind}` is not known; allowed are {allowed}")
        _check_choice("season", self.season, tuple(SEASONS))
        _check_choice("upper_atmosphere", self.upper_atmosphere, ("normal", "extreme"))
        if self.optics is not None:
            _check_choice("optics", self.optics, tuple(k for k in _lowtran_optics() if k != "meteoric_dust"))
        if self.kind not in LOWTRAN_KINDS:
            for key in ("season", "optics", "upper_atmosphere"):
                if getattr(self, key) != getattr(StratosphereSpec, key):
                    raise TwilightError(f"stratosphere.{key}: has no meaning for the measured profile `{self.kind}`")
        elif self.levels is not None:
            raise TwilightError(
                f"stratosphere.kind: `{self.kind}` has no droplets for stratosphere.levels; allowed are "
                f"{', '.join(sage_scenarios())}"
            )

    @property
    def bottom_km(self) -> float:
        """Where this aerosol begins; below is the free troposphere."""
        if self.kind in LOWTRAN_KINDS:
            z, extinction = self._lowtran_stratosphere()
            return float(z[extinction > 0][0])
        return float(_sage()[self.kind][0, 0] if self.levels is None else self.levels.altitude_km[0])

    def _lowtran_stratosphere(self) -> tuple[np.ndarray, np.ndarray]:
        column, _ = LOWTRAN_KINDS[self.kind]
        table = _lowtran_extinction()
        return table["z_km"], table[column + SEASONS[self.season]]

    def regions(self, wavelength_nm) -> list[AerosolRegion]:
        """The aerosol at W wavelengths [nm]."""
        wavelength = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
        if self.kind in LOWTRAN_KINDS:
            return self._lowtran_regions(wavelength)
        return [_sage_region(self.kind, tuple(wavelength.tolist()), self.levels)]

    def _lowtran_regions(self, wavelength: np.ndarray) -> list[AerosolRegion]:
        z, extinction = self._lowtran_stratosphere()
        inside = extinction > 0
        kind = self.optics or LOWTRAN_KINDS[self.kind][1]
        name = f"stratosphere ({self.kind})"
        stratosphere = _lowtran_region(name, z[inside], extinction[inside], kind, wavelength)
        volcanic = "background" if self.kind == "background" else "volcanic"
        above = _lowtran_extinction()[UPPER_ATMOSPHERES[volcanic, self.upper_atmosphere]]
        inside = above > 0
        upper = _lowtran_region("upper atmosphere", z[inside], above[inside], "meteoric_dust", wavelength)
        return [stratosphere, upper]


def _check_choice(key: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise TwilightError(f"stratosphere.{key}: `{value}` is not known; allowed are {', '.join(allowed)}")


@lru_cache(maxsize=1)
def _lowtran_extinction() -> dict[str, np.ndarray]:
    rows = data_rows("stratosphere/lowtran_extinction_550nm.csv")
    return {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}


@lru_cache(maxsize=1)
def _lowtran_optics() -> dict[str, np.ndarray]:
    """Kind -> rows of wavelength [nm], extinction and absorption relative to extinction at 550 nm, asymmetry."""
    kinds: dict[str, list[list[float]]] = {}
    for row in data_rows("stratosphere/lowtran_optics.csv"):
        numbers = [float(row["wavelength_um"]) * 1e3] + [float(row[k]) for k in ("ext_norm", "abs_norm", "asymmetry_g")]
        kinds.setdefault(row["kind"], []).append(numbers)
    return {kind: np.array(rows) for kind, rows in kinds.items()}


def _lowtran_region(
    name: str, z: np.ndarray, extinction_550: np.ndarray, kind: str, wavelength: np.ndarray
) -> AerosolRegion:
    """Extinction log-log in wavelength, absorption and asymmetry linear; phase function Henyey-Greenstein.

    LOWTRAN documents the asymmetry only, not the phase function.
    """
    nm, extinction, absorption, asymmetry = _lowtran_optics()[kind].T
    ratio = np.exp(np.interp(np.log(wavelength), np.log(nm), np.log(extinction)))
    albedo = np.clip(1.0 - np.interp(wavelength, nm, absorption) / ratio, 0.0, 1.0)
    return AerosolRegion(
        name,
        z,
        extinction_550[:, None] * ratio,
        np.broadcast_to(albedo, (z.size, wavelength.size)).copy(),
        np.ones((1, z.size, wavelength.size)),
        (PhaseFunction.henyey_greenstein(np.interp(wavelength, nm, asymmetry), name),),
    )


@lru_cache(maxsize=1)
def _sage() -> dict[str, np.ndarray]:
    """Scenario -> rows of altitude [km], median radius [nm], extinction [km^-1] at the nine wavelengths."""
    scenarios: dict[str, list[list[float]]] = {}
    for row in data_rows("stratosphere/sage3iss_profiles.csv"):
        numbers = [float(value) for key, value in row.items() if key != "scenario"]
        scenarios.setdefault(row["scenario"], []).append(numbers)
    return {name: np.array(rows) for name, rows in scenarios.items()}


@lru_cache(maxsize=1)
def _sage_upper_scale_heights() -> dict[str, float]:
    return {
        row["scenario"]: float(row["upper_scale_height_km"]) for row in data_rows("stratosphere/sage3iss_scenarios.csv")
    }


def sage_scenarios() -> tuple[str, ...]:
    """Names of the twelve measured profiles: latitude band and loading."""
    return tuple(_sage())


def measured_kind(profile: str) -> str:
    """The measured profile, of typical loading, of the latitude of an AFGL profile (which are of the northern half).

    There are three bands: the subarctic profiles take the midlatitudes'.
    """
    return "tropical_typical" if profile == "tropical" else "nh_midlat_typical"


def droplets(median_radius_um: float) -> LogNormal:
    """Size distribution of the measured droplets."""
    return LogNormal(median_radius_um, SAGE_MODE_WIDTH, median_radius_um / 50.0, median_radius_um * 50.0)


def sage_extinction_per_km(
    measured: np.ndarray, wavelength_nm: np.ndarray, channel_nm: np.ndarray = SAGE_WAVELENGTH_NM
) -> np.ndarray:
    """Extinction (n, W) from n rows at two or more channels, log-log in wavelength.

    A channel that is missing or not positive (noise of the retrieval) is bridged; beyond the outermost good channel
    the spectrum goes on with the power law fitted to the row.
    """
    out = np.empty((measured.shape[0], wavelength_nm.size))
    log_w = np.log(wavelength_nm)
    for i, row in enumerate(measured):
        good = np.isfinite(row) & (row > 0)
        x, y = np.log(channel_nm[good]), np.log(row[good])
        slope = np.polyfit(x, y, 1)[0]
        beyond = slope * (np.minimum(log_w - x[0], 0.0) + np.maximum(log_w - x[-1], 0.0))
        out[i] = np.exp(np.interp(log_w, x, y) + beyond)
    return out


@lru_cache(maxsize=4)
def _sage_region(
    scenario: str, wavelength_nm: tuple[float, ...], levels: ExtinctionLevels | None = None
) -> AerosolRegion:
    """A measured profile, the scenario's or `levels`; above it the extinction falls with the scenario's scale height.

    Levels of one wavelength get their spectrum from the droplets (Mie theory).

    Droplets of 75 % sulphuric acid (OPAC's index), log-normal with mode width 1.6 and the retrieved median radius.
    Phase functions are computed at fixed radii and mixed, linearly in the logarithm of the radius: half way between
    two the asymmetry is off by 0.004 at most and the phase function by 4 % at its worst angle (400 to 800 nm).
    """
    rows, wavelength = _sage()[scenario], np.array(wavelength_nm)
    z, radius_um = rows[:, 0], rows[:, 1] * 1e-3
    channel_nm, measured = SAGE_WAVELENGTH_NM, rows[:, 2:]
    if levels is not None:
        own_z = np.array(levels.altitude_km)
        radius_um = np.interp(own_z, z, radius_um)
        if levels.median_radius_um is not None:
            radius_um = np.array(levels.median_radius_um)
        z, channel_nm, measured = own_z, np.array(levels.wavelength_nm), np.array(levels.extinction_per_km)
    radius_um = np.clip(radius_um, SAGE_RADII_UM[0], SAGE_RADII_UM[-1])
    single = channel_nm.size == 1
    extinction = measured if single else sage_extinction_per_km(measured, wavelength, channel_nm)
    decay = np.exp(-(PROFILE_TOP_KM - z[-1]) / _sage_upper_scale_heights()[scenario])
    z = np.append(z, PROFILE_TOP_KM)
    radius_um = np.append(radius_um, radius_um[-1])
    extinction = np.vstack([extinction, extinction[-1] * decay])
    position = np.interp(np.log(radius_um), np.log(SAGE_RADII_UM), np.arange(SAGE_RADII_UM.size))
    weight = np.maximum(0.0, 1.0 - np.abs(position[None, :] - np.arange(SAGE_RADII_UM.size)[:, None]))
    used = np.any(weight > 0.0, axis=1)
    weight = weight[used]
    phases, albedos, spectra = [], [], []
    _, index = opac.particles("suso", 0.0, wavelength)
    _, index_of_channel = opac.particles("suso", 0.0, channel_nm)
    for radius in SAGE_RADII_UM[used]:
        optics = particle_optics(droplets(float(radius)), index, wavelength)
        # through the exponential: its rounding is part of the numbers that are published
        log_phase = np.log(np.exp(optics.log_phase))
        phases.append(PhaseFunction.from_log_table(log_phase, f"sulphate {1e3 * radius:.0f} nm", optics.ratios))
        albedos.append(np.minimum(1.0, optics.scattering_per_km / optics.extinction_per_km))
        if single:
            of_channel = particle_optics(droplets(float(radius)), index_of_channel, channel_nm).extinction_per_km[0]
            spectra.append(optics.extinction_per_km / of_channel)
    if single:
        extinction = extinction * np.exp(np.einsum("kn,kw->nw", weight, np.log(spectra)))
    phase_fraction = np.repeat(weight[:, :, None], wavelength.size, axis=2)
    albedo = np.einsum("kn,kw->nw", weight, np.stack(albedos))
    name = scenario if levels is None else "measured"
    return AerosolRegion(
        f"stratosphere ({name})", z, extinction, np.minimum(1.0, albedo), phase_fraction, tuple(phases)
    )
