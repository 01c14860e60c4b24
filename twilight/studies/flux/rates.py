"""What light does to the air: heating rates and photolysis frequencies, from actinic fluxes.

    dT/dt = sum over wavelengths of absorbed light / (rho c_p),  rho = p / (R_d T)
    J     = sum over 1 nm of sigma phi A lambda / (h c)

The actinic flux A over the solar spectrum is smooth in wavelength: it is interpolated to 1 nm in its logarithm
(`spectrum.expand`), then multiplied with the solar spectrum and the cross sections at 1 nm.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from twilight.atmosphere.photolysis import REACTIONS, effective_cross_section
from twilight.atmosphere.profiles import PROFILE_TOP_KM, AirProfile
from twilight.base.errors import TwilightError
from twilight.numerics import spectrum
from twilight.scene.medium import air_profile
from twilight.scene.scene import Scene

if TYPE_CHECKING:
    import xarray

PLANCK_TIMES_LIGHT_J_NM = 6.62607015e-34 * 299792458.0 * 1e9
"""h c [J nm] (SI 2019)."""
DRY_AIR_J_PER_KG_K = 287.05
"""Gas constant of dry air R_d."""
HEAT_CAPACITY_J_PER_KG_K = 1004.7
"""c_p of dry air, 7/2 R_d."""
SECONDS_PER_DAY = 86400.0


def air_of(scene: Scene, altitude_km: np.ndarray) -> AirProfile:
    """Pressure and temperature of a scene's profile at altitudes [km].

    Errors: TwilightError for a tabulated medium, which has none, and above the profile.
    """
    climate = scene.configuration.climate
    if climate.medium is not None:
        raise TwilightError(f"{scene.title}: medium.table has no temperatures, which heating and photolysis need")
    if np.max(altitude_km) > PROFILE_TOP_KM:
        raise TwilightError(
            f"altitude_km is {np.max(altitude_km):g}; temperatures, which heating and photolysis need, end at "
            f"{PROFILE_TOP_KM:g} km"
        )
    return air_profile(climate).at(altitude_km)


def heating_rates(fluxes: xarray.Dataset, air: AirProfile) -> xarray.DataArray:
    """Heating by the light of the dataset's wavelengths [K day^-1], over sun_elevation and altitude.

    Parameters
    ----------
    fluxes
        As `studies.flux.fluxes` makes it.
    air
        Pressure and temperature at its altitudes.
    """
    density = 100.0 * air.pressure_hpa / (DRY_AIR_J_PER_KG_K * air.temperature_k)
    absorbed = (fluxes["absorbed"] * fluxes["wavelength_width"]).sum("wavelength")
    rate = absorbed * SECONDS_PER_DAY / (HEAT_CAPACITY_J_PER_KG_K * density)[None, :]
    nm = fluxes["wavelength"].values
    return rate.assign_attrs(units="K d-1", long_name=f"heating rate by light of {nm[0]:g} to {nm[-1]:g} nm")


def covered(wavelength_nm: np.ndarray) -> tuple[str, ...]:
    """The reactions whose light lies within the wavelengths [nm]."""
    first, last = float(wavelength_nm[0]), float(wavelength_nm[-1])
    return tuple(name for name, r in REACTIONS.items() if first <= r.first_nm and r.last_nm <= last)


def photolysis_frequencies(
    fluxes: xarray.Dataset, temperature_k: np.ndarray, reactions: Sequence[str] | None = None
) -> xarray.Dataset:
    """Photolysis frequencies J [s^-1], over sun_elevation and altitude, by the names of REACTIONS with `j_` before.

    Parameters
    ----------
    fluxes
        As `studies.flux.fluxes` makes it.
    temperature_k : (Z,)
        Of the air at its altitudes.
    reactions
        Names; None: all whose light lies within the wavelengths.

    Raises
    ------
    TwilightError
        For a reaction that is not known, or whose light goes beyond the wavelengths; the sentence says to where.
    """
    import xarray  # start-up

    nm = fluxes["wavelength"].values
    wanted = covered(nm) if reactions is None else tuple(reactions)
    for name in wanted:
        if name not in REACTIONS:
            raise TwilightError(f"reaction: {name} is not known; allowed are {', '.join(REACTIONS)}")
        if name not in covered(nm):
            r = REACTIONS[name]
            raise TwilightError(
                f"reaction {name} ({r.equation}) needs wavelengths from {r.first_nm:g} nm or less to {r.last_nm:g} nm "
                f"or more; these go from {nm[0]:g} to {nm[-1]:g} nm"
            )
    grid, solar = spectrum.solar_spectrum(fluxes.attrs["solar_spectrum"])
    inside = (grid >= nm[0]) & (grid <= nm[-1])
    fine_nm = grid[inside]
    factor = fluxes["actinic"].values / fluxes["solar_irradiance"].values
    # W m^-2 nm^-1 into photons cm^-2 s^-1 nm^-1
    photons = 1e-4 * solar[inside] / fluxes.attrs["distance_au"] ** 2 * fine_nm / PLANCK_TIMES_LIGHT_J_NM
    actinic = spectrum.expand(factor, nm, fine_nm) * photons
    axes = ("sun_elevation", "altitude")
    found = {}
    for name in wanted:
        weight = effective_cross_section(name, fine_nm, temperature_k)
        value = np.einsum("szw,zw->sz", actinic, weight)
        attributes = {"units": "s-1", "long_name": f"photolysis frequency of {REACTIONS[name].equation}"}
        found[f"j_{name}"] = (axes, value, attributes)
    return xarray.Dataset(found, {key: fluxes[key] for key in axes})
