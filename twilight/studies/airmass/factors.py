"""Box air-mass factors of a solved scene, air-mass factors of a gas, and derivatives, as xarray datasets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from twilight.atmosphere.layer_changes import layer_edges
from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.config.validate import unknown
from twilight.engine import Solved
from twilight.solvers.base import DIFFERENTIATED, OF_ALL_AIR
from twilight.studies.airmass.gas_profile import GasProfile

if TYPE_CHECKING:
    from xarray import Dataset

LAYER_EDGES_KM = (0.0, 2.0, 5.0, 8.0, 11.0, 14.0, 17.0, 20.0, 23.0, 26.0, 29.0, 32.0, 36.0, 42.0, 50.0, 70.0)
"""Altitudes [km] that bound the usual layers."""
UNITS = {"temperature": "K-1", "ozone_column": "DU-1"}
"""Units of derivatives by quantities that have one."""
DIMS = ("sun_elevation", "direction", "altitude", "wavelength")
"""Dimensions of derivatives, before those of a single sun or direction are dropped."""


def usual_edges(medium: Medium) -> np.ndarray:
    """LAYER_EDGES_KM as far as they lie in the air of a medium, which begins at its ground."""
    inside = [z for z in LAYER_EDGES_KM if medium.bottom_km + 0.5 < z < medium.top_km - 0.5]
    top = min(medium.top_km, LAYER_EDGES_KM[-1])
    return np.array(sorted({medium.bottom_km, *inside, top}))


def layer_edges_of(boxes: Dataset) -> np.ndarray:
    """Altitudes (J + 1,) [km] that bound the layers of a dataset of `box_factors`."""
    return np.append(boxes["altitude_bnds"].values[:, 0], boxes["altitude_bnds"].values[-1, 1])


def box_factors(
    solved: Solved,
    sun_elevation_deg: ArrayLike,
    elevation_deg: ArrayLike,
    azimuth_deg: ArrayLike,
    *,
    edges_km: ArrayLike | None = None,
    observer_altitude_km: float | None = None,
) -> Dataset:
    """Box air-mass factors, -d ln(radiance) / d(vertical optical depth of absorption in a layer).

    Parameters
    ----------
    sun_elevation_deg
        True elevation of the sun [deg]; a list gives a dimension `sun_elevation`.
    elevation_deg, azimuth_deg
        Of the lines of sight [deg], azimuth from the sun; lists, broadcast, give a dimension `direction`.
    edges_km
        Altitudes [km] that bound the layers, increasing, within the air; None: 15 layers up to 70 km.
    observer_altitude_km
        Above sea level [km]; None: the scene's observer.

    Returns
    -------
    xarray.Dataset
        `box_air_mass_factor` over sun_elevation, direction, altitude (of the layers' middles) and wavelength, nan where
        there is no light; `standard_error` from a solver that estimates it.

    Raises
    ------
    TwilightError
        For a solver that cannot differentiate, wavelengths in bands of oxygen or water vapour, and layers outside the
        air.
    """
    request = _Request(solved, sun_elevation_deg, elevation_deg, azimuth_deg, edges_km, observer_altitude_km)
    slopes, errors = request.log_slopes("absorption")
    about = {"long_name": "box air-mass factor: -d ln(radiance) / d(vertical optical depth of the layer)", "units": "1"}
    values: dict[str, Any] = {"box_air_mass_factor": (DIMS, -slopes, about)}
    if errors is not None:
        values["standard_error"] = (DIMS, errors, {"long_name": "standard error", "units": "1"})
    return request.dataset(values)


def jacobian(
    solved: Solved,
    sun_elevation_deg: ArrayLike,
    elevation_deg: ArrayLike,
    azimuth_deg: ArrayLike,
    *,
    by: str | Sequence[str] = tuple(DIFFERENTIATED),
    edges_km: ArrayLike | None = None,
    observer_altitude_km: float | None = None,
) -> Dataset:
    """Derivatives of ln(radiance).

    Parameters
    ----------
    sun_elevation_deg, elevation_deg, azimuth_deg, edges_km, observer_altitude_km
        As of `twilight.Solved.airmass`.
    by
        One or more of absorption (vertical optical depth of a layer), aerosol_extinction (the same of aerosol, whose
        albedo and phase functions stay), aerosol_albedo (single scattering albedo in a layer), aerosol_asymmetry
        (asymmetry parameter in a layer, every phase function P becoming P (1 + eps (mu - g)), or Henyey-Greenstein's of
        the larger g), temperature [K^-1] (at every altitude pressure and the number densities of absorbing gases stay;
        air's density, refractive index and cross sections change), ozone_column [DU^-1], ground_albedo.

    Returns
    -------
    xarray.Dataset
        A variable for each quantity, over sun_elevation, direction, altitude and wavelength; ozone_column and
        ground_albedo have no altitude.

    Raises
    ------
    TwilightError
        For a quantity that the solver cannot differentiate, and as `twilight.Solved.airmass`.
    """
    quantities = [by] if isinstance(by, str) else list(by)
    for name in quantities:
        if name not in DIFFERENTIATED:
            raise TwilightError(f"by: {name} {unknown(name, DIFFERENTIATED, 'quantity')}")
    request = _Request(solved, sun_elevation_deg, elevation_deg, azimuth_deg, edges_km, observer_altitude_km)
    values: dict[str, Any] = {}
    for name in quantities:
        slopes, errors = request.log_slopes(name)
        dims: tuple[str, ...] = DIMS
        if name in OF_ALL_AIR:
            slopes, errors = slopes[..., 0, :], None if errors is None else errors[..., 0, :]
            dims = tuple(d for d in DIMS if d != "altitude")
        about = {"long_name": f"d ln(radiance) / d({DIFFERENTIATED[name]})", "units": UNITS.get(name, "1")}
        values[name] = (dims, slopes, about)
        if errors is not None:
            values[name + "_standard_error"] = (dims, errors, {**about, "long_name": "standard error"})
    return request.dataset(values)


class _Request:
    """Suns, directions and layers by which light is differentiated, and the dimensions of the derivatives."""

    def __init__(
        self,
        solved: Solved,
        sun: ArrayLike,
        elevation: ArrayLike,
        azimuth: ArrayLike,
        edges: ArrayLike | None,
        altitude: float | None,
    ):
        self.solved, self.altitude = solved, altitude
        self.edges = layer_edges(solved.medium, usual_edges(solved.medium) if edges is None else edges)
        self.suns = np.atleast_1d(np.asarray(sun, dtype=float))
        self.elevation, self.azimuth = (
            np.atleast_1d(a) for a in np.broadcast_arrays(np.asarray(elevation, float), np.asarray(azimuth, float))
        )
        if self.suns.ndim != 1 or self.elevation.ndim != 1:
            raise TwilightError("airmass: suns and directions must be numbers or lists of numbers")
        self.one_sun, self.one_direction = np.ndim(sun) == 0, np.ndim(elevation) == 0 and np.ndim(azimuth) == 0

    def log_slopes(self, quantity: str) -> tuple[np.ndarray, np.ndarray | None]:
        """Derivatives and standard errors, of DIMS."""
        return self.solved.log_slopes(
            quantity, self.edges, self.suns[:, None], self.elevation, self.azimuth, self.altitude
        )

    def dataset(self, values: dict[str, Any]) -> Dataset:
        """The values with their coordinates, without the dimension of a single sun or direction."""
        import xarray  # start-up

        degree = {"units": "degree"}
        coordinates = {
            "sun_elevation": ("sun_elevation", self.suns, {"long_name": "true elevation of the sun", **degree}),
            "elevation": ("direction", self.elevation, {"long_name": "elevation of the line of sight", **degree}),
            "azimuth": (
                "direction", self.azimuth, {"long_name": "azimuth of the line of sight from the sun", **degree}
            ),
            "altitude": (
                "altitude", 0.5 * (self.edges[1:] + self.edges[:-1]),
                {"long_name": "middle of the layer", "units": "km", "bounds": "altitude_bnds"},
            ),
            "wavelength": ("wavelength", self.solved.medium.wavelength_nm, {"units": "nm"}),
        }  # fmt: skip
        bounds = np.stack([self.edges[:-1], self.edges[1:]], axis=1)
        whole = xarray.Dataset({**values, "altitude_bnds": (("altitude", "nv"), bounds)}, coordinates)
        single = {"sun_elevation": self.one_sun, "direction": self.one_direction}
        return whole.isel({dim: 0 for dim, one in single.items() if one})


def with_gas(boxes: Dataset, gas: GasProfile) -> Dataset:
    """The dataset with the air-mass factor of a gas, its slant column, and the vertical columns of the layers.

    A = sum A_j v_j / sum v_j, v_j the vertical column of the gas in layer j; the slant column is A times the vertical
    one.  Right for a gas that absorbs weakly: A does not hold what the gas itself does to the light, unless the scene
    has it.  The standard error is an upper bound, as if all layers were off together.
    """
    edges = layer_edges_of(boxes)
    columns = gas.columns_per_cm2(edges)
    if columns.sum() <= 0.0:
        raise TwilightError(f"{gas.name}: there is none between {edges[0]:g} and {edges[-1]:g} km")
    made = boxes.copy()
    unit = {"units": "cm-2"}
    made["layer_column"] = ("altitude", columns, {"long_name": f"vertical column of {gas.name} in the layer", **unit})
    fraction = made["layer_column"] / made["layer_column"].sum()
    made["air_mass_factor"] = (made["box_air_mass_factor"] * fraction).sum("altitude", skipna=False)
    made["air_mass_factor"].attrs = {"long_name": f"air-mass factor of {gas.name}", "units": "1"}
    if "standard_error" in made:
        made["air_mass_standard_error"] = (made["standard_error"] * fraction).sum("altitude", skipna=False)
        made["air_mass_standard_error"].attrs = {"long_name": "largest standard error", "units": "1"}
    made["slant_column"] = made["air_mass_factor"] * float(columns.sum())
    made["slant_column"].attrs = {"long_name": f"slant column of {gas.name}", **unit}
    made.attrs["gas"] = gas.name
    return made
