"""The accessor `.sky` of xarray's datasets: the words of `Sky` on one sky, a sequence of them, or a whole sweep.

import twilight.api.accessor, xarray
ds = xarray.open_zarr("sweep.zarr")
ds.sky.magnitude("V", elevation_deg=90)            # over all dimensions of the sweep, lazily
ds.sky.illuminance_lux()
ds.sel(sun_elevation_deg=-4).sky.scene()           # one scene as a `Sky`
ds.sky.interp(elevation=20, azimuth=358.5)         # between the last azimuth and the first
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import xarray
from numpy.typing import ArrayLike

from twilight.api.representation import Sky, plot
from twilight.api.types import PlotOptions
from twilight.base.errors import TwilightError
from twilight.io.facts import fields_from
from twilight.io.labels import attributes
from twilight.io.provenance import provenance_from_fields
from twilight.sky.quantities.catalogue import quantity, unit_of
from twilight.sky.quantities.responses import ResponseLike, response

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GRID = ("elevation", "azimuth", "wavelength")
_RADIANCE = "sun_normalised_radiance"
_Q = (f"{_RADIANCE}_q", "standard_error_q")
_U = (f"{_RADIANCE}_u", "standard_error_u")
"""Stokes parameters Q and U over F0, and their standard errors."""
_DERIVED = ("degree_of_linear_polarisation", "angle_of_linear_polarisation")
_DEFAULT_SPECTRUM = "astm_g173_etr"


@xarray.register_dataset_accessor("sky")
class SkyAccessor:
    """`.sky` of a dataset that holds `sun_normalised_radiance` over elevation, azimuth, wavelength and any others.

    Half skies (a sweep's, azimuth 0 to 180 deg) stand for whole ones.  Results keep all other dimensions and are as
    lazy as the dataset; scenes that were not computed are NaN.
    """

    def __init__(self, dataset: xarray.Dataset):
        self._dataset = dataset
        if _RADIANCE not in dataset or not set(_GRID) <= set(dataset[_RADIANCE].dims):
            raise TwilightError(f".sky: the dataset has no {_RADIANCE} over {', '.join(_GRID)}")

    @property
    def dims(self) -> tuple[str, ...]:
        """The dimensions along which there are several skies."""
        return tuple(str(d) for d in self._dataset[_RADIANCE].dims if d not in _GRID)

    def scene(self, **indexers: Any) -> Sky:
        """The one sky that is left after `.sel(**indexers)`, both halves, with all that the dataset knows of it.

        Errors: TwilightError where more than one is left, or where it is not computed or was refused.
        """
        chosen = self._dataset.sel(**indexers) if indexers else self._dataset
        left = [str(d) for d in chosen[_RADIANCE].dims if d not in _GRID and chosen.sizes[d] != 1]
        if left:
            raise TwilightError(f".sky.scene: takes one scene; select also along {', '.join(left)}")
        chosen = chosen.squeeze([d for d in chosen[_RADIANCE].dims if d not in _GRID])
        if int(chosen.get("status", 1)) != 1:
            refused = int(chosen["status"]) == 2
            raise TwilightError(
                f".sky.scene: this scene {'was refused by its solver' if refused else 'is not computed yet'}"
            )
        azimuth, column = _whole(chosen)

        def grid(name: str) -> np.ndarray | None:
            if name not in chosen or np.isnan(chosen[name]).all():
                return None
            return chosen[name].transpose(*_GRID).values[:, column]

        def one(*names: str) -> float | None:
            found = next((float(chosen[name]) for name in names if name in chosen), None)
            return None if found is None or np.isnan(found) else found

        def stokes(q: str, u: str) -> np.ndarray | None:
            both = grid(q), grid(u)
            if both[0] is None or both[1] is None:
                return None
            mirrored = (azimuth > 180.0) & (chosen.azimuth.values[column] <= 180.0)
            sign = 1.0 if "error" in u else np.where(mirrored, -1.0, 1.0)[:, None]
            return np.stack([both[0], both[1] * sign], axis=2).astype(float)

        radiance = grid(_RADIANCE)
        if radiance is None:
            raise TwilightError(".sky.scene: this scene holds no radiance")
        facts, bending = fields_from(one), one("solar_bending")
        if bending is not None:
            facts["apparent_sun_elevation_deg"] = facts["sun_elevation_deg"] + bending
        provenance = provenance_from_fields(chosen.attrs)
        if "sweep_hash" in chosen.attrs:
            provenance["sweep_hash"] = chosen.attrs["sweep_hash"]
        direct = "direct_irradiance_factor"
        return Sky(
            wavelength_nm=chosen.wavelength.values,
            elevation_deg=chosen.elevation.values,
            azimuth_deg=azimuth,
            sun_normalised_radiance=radiance.astype(float),
            ground_albedo=chosen["surface_albedo"].values if "surface_albedo" in chosen else None,
            standard_error=grid("standard_error"),
            polarisation=stokes(_Q[0], _U[0]),
            polarisation_error=stokes(_Q[1], _U[1]),
            direct_irradiance=chosen[direct].values.astype(float) if direct in chosen else None,
            solar_spectrum=str(chosen.attrs.get("solar_spectrum", _DEFAULT_SPECTRUM)),
            night_radiance=grid("night_radiance"),
            provenance=provenance,
            **facts,
        )

    def interp(
        self,
        elevation: ArrayLike | xarray.DataArray | None = None,
        azimuth: ArrayLike | xarray.DataArray | None = None,
        **others: Any,
    ) -> xarray.Dataset:
        """`Dataset.interp`, linear, on the sphere: azimuths go round, elevations reach from the horizon to the zenith.

        Parameters
        ----------
        elevation, azimuth
            Directions [deg], azimuths beyond 360 and below 0 too: numbers, arrays that span a grid, or DataArrays,
            whose dimensions are then those of the result.  None: those of the dataset.
        **others
            Other coordinates and options (wavelength, time, method ...), as of `Dataset.interp`.

        Returns
        -------
        xarray.Dataset
            What the dataset holds, in these directions; NaN for elevations below the sky.
        """
        wanted: dict[str, Any] = {}
        data = self._dataset
        if elevation is not None or azimuth is not None:
            data = _sphere(data)
            wanted["elevation"] = self._dataset.elevation if elevation is None else elevation
            wanted["azimuth"] = np.mod(self._dataset.azimuth if azimuth is None else azimuth, 360.0)
        made = data.interp(**wanted, **others)
        if azimuth is not None:
            asked = np.broadcast_to(azimuth, made["azimuth"].shape)
            made = made.assign_coords(azimuth=made["azimuth"].copy(data=asked))
            made.attrs.pop("azimuth_count", None)
        made["azimuth"].attrs = dict(self._dataset.azimuth.attrs)
        made["elevation"].attrs = {k: v for k, v in self._dataset.elevation.attrs.items() if k != "bounds"}
        return _with_polarisation(made) if wanted else made

    def luminance(self) -> xarray.DataArray:
        """Luminance [cd m^-2] in every direction of the dataset."""
        count = self._dataset.sizes["azimuth"]
        dims = ("elevation", "azimuth")
        return self._each("luminance", lambda sky: sky.luminance()[:, :count], "cd m-2", "luminance of the sky", dims)

    def luminance_at(self, elevation_deg: float = 90.0, azimuth_deg: float = 0.0) -> xarray.DataArray:
        """Luminance [cd m^-2] in one direction; azimuth relative to the sun."""
        about = f"luminance at elevation {elevation_deg:g} deg"
        return self._each("luminance", lambda sky: sky.luminance_at(elevation_deg, azimuth_deg), "cd m-2", about)

    def magnitude(
        self, band: ResponseLike = "V", elevation_deg: float = 90.0, azimuth_deg: float = 0.0, system: str | None = None
    ) -> xarray.DataArray:
        """Surface brightness [mag arcsec^-2] in one direction, `Sky.magnitude`; azimuth relative to the sun."""
        where, about = (elevation_deg, azimuth_deg), f"surface brightness in {response(band).name}"
        return self._each("magnitude", lambda sky: sky.magnitude(band, *where, system), "mag arcsec-2", about)

    def radiance_in(
        self, response: ResponseLike, elevation_deg: float = 90.0, azimuth_deg: float = 0.0
    ) -> xarray.DataArray:
        """Radiance within a response [W m^-2 sr^-1], `Sky.radiance_in`."""
        where, about = (elevation_deg, azimuth_deg), "radiance within a response"
        return self._each("radiance_in", lambda sky: sky.radiance_in(response, *where), "W m-2 sr-1", about)

    def illuminance_lux(self, horizontal: bool = True, eye: str = "photopic") -> xarray.DataArray:
        """Illuminance of the ground by the sky alone [lx], or of a sphere; eye: as of `Sky.illuminance_lux`."""
        about = "illuminance by the sky"
        return self._each("illuminance", lambda sky: sky.illuminance_lux(horizontal, eye=eye), "lx", about)

    def measure(
        self, name: str, elevation_deg: float | None = None, azimuth_deg: float = 0.0, *, horizontal: bool = True
    ) -> xarray.DataArray:
        """Any quantity of a direction, or of the sky's light on a plane or sphere: `Sky.measure`."""
        found = quantity(name)
        unit, where = unit_of(found, "surface" if elevation_deg is None else "direction"), (elevation_deg, azimuth_deg)
        return self._each(
            found.variable, lambda sky: sky.measure(name, *where, horizontal=horizontal), unit, found.about
        )

    def plot(self, projection: str = "wide", ax: Axes | None = None, **options: Unpack[PlotOptions]) -> Figure:
        """Draw the one sky that is left (`Sky.plot`)."""
        return plot(self.scene(), projection, ax, **options)

    def _each(
        self, name: str, figure: Callable[[Sky], ArrayLike], unit: str, about: str, dims: tuple[str, ...] = ()
    ) -> xarray.DataArray:
        """A figure of every sky."""
        data = self._dataset
        azimuth, column = _whole(data)
        spectrum = str(data.attrs.get("solar_spectrum", _DEFAULT_SPECTRUM))
        night = [data["night_radiance"]] if "night_radiance" in data else []

        def one(radiance: np.ndarray, distance_au: float, sun_elevation_deg: float, *night: np.ndarray) -> np.ndarray:
            if np.isnan(radiance).any():
                return np.full(radiance.shape[: len(dims)], np.nan)
            sky = Sky(
                wavelength_nm=data.wavelength.values,
                elevation_deg=data.elevation.values,
                azimuth_deg=azimuth,
                sun_normalised_radiance=radiance[:, column],
                sun_elevation_deg=float(sun_elevation_deg),
                distance_au=float(distance_au),
                solar_spectrum=spectrum,
                night_radiance=night[0][:, column] if night else None,
            )
            return np.asarray(figure(sky), float)

        made = xarray.apply_ufunc(
            one,
            data[_RADIANCE],
            data["earth_sun_distance"] if "earth_sun_distance" in data else 1.0,
            data["solar_elevation_angle"],
            *night,
            input_core_dims=[list(_GRID), [], [], *([list(_GRID)] if night else [])],
            output_core_dims=[list(dims)],
            vectorize=True,
            dask="parallelized",
            output_dtypes=[float],
        )
        return made.rename(name).assign_attrs(units=unit, long_name=about)


def _sphere(data: xarray.Dataset) -> xarray.Dataset:
    """The dataset with all azimuths, another column on either side, and rows at the lower edge and in the zenith.

    The zenith is the mean of the last row, of Q and U each column turned to azimuth 0, as in
    `interpolation.interpolate_stokes`.
    """
    azimuth, column = _whole(data)
    mirrored = (azimuth > 180.0) & (data.azimuth.values[column] <= 180.0)
    whole = data.drop_vars(["elevation_bnds"], errors="ignore").isel(azimuth=column).assign_coords(azimuth=azimuth)
    for name in _U:
        if name in whole:
            whole[name] = whole[name] * xarray.DataArray(np.where(mirrored, -1.0, 1.0), dims="azimuth")
    rows = data.elevation.values
    parts = [whole]
    if rows[-1] < 90.0:
        parts.append(_zenith(whole))
    if rows.size > 1 and 0.0 < rows[0] <= rows[1] - rows[0]:
        parts.insert(0, _edge(whole, rows[0] / (rows[1] - rows[0])))
    closed = xarray.concat([_directed(part) for part in parts], "elevation")
    around = [closed.isel(azimuth=[-1]), closed, closed.isel(azimuth=[0])]
    columns = np.concatenate([azimuth[-1:] - 360.0, azimuth, azimuth[:1] + 360.0])
    closed = xarray.concat(around, "azimuth").assign_coords(azimuth=columns)
    rest = whole.drop_vars([*closed.data_vars, "elevation", "azimuth"])
    return rest.drop_dims(["elevation", "azimuth"], errors="ignore").merge(closed).assign_attrs(data.attrs)


def _directed(data: xarray.Dataset) -> xarray.Dataset:
    """The variables over elevation and azimuth that may be interpolated."""
    names = [n for n, v in data.data_vars.items() if {"elevation", "azimuth"} <= set(v.dims) and n not in _DERIVED]
    return data[names].drop_vars([n for n in data.coords if n not in data.dims])


def _edge(whole: xarray.Dataset, fraction: float) -> xarray.Dataset:
    """A row at 0 deg, a fraction of the rows' distance below the lowest: by the logarithm as `Sky.sample`, Q and U
    linearly."""
    first, second = (_directed(whole).isel(elevation=[i]).assign_coords(elevation=[0.0]) for i in (0, 1))

    def on(values: xarray.DataArray) -> xarray.DataArray:
        other = second[values.name]
        if values.name in (_Q[0], _U[0]):
            return values + fraction * (values - other)
        with np.errstate(divide="ignore", invalid="ignore"):
            return xarray.where((values > 0.0) & (other > 0.0), values * (values / other) ** fraction, values)

    return first.map(on)


def _zenith(whole: xarray.Dataset) -> xarray.Dataset:
    """A row in the zenith."""
    top = _directed(whole).isel(elevation=[-1]).assign_coords(elevation=[90.0])
    made = top.map(lambda values: values.mean("azimuth").broadcast_like(values))
    turn = np.exp(2j * np.radians(top.azimuth))
    for q, u in zip(_Q, _U, strict=True):
        if q in top and u in top and "error" not in q:
            polarised = ((top[q] + 1j * top[u]) / turn).mean("azimuth") * turn
            made[q], made[u] = polarised.real, polarised.imag
    return made.map(lambda values: values.transpose(*top[values.name].dims))


def _with_polarisation(made: xarray.Dataset) -> xarray.Dataset:
    """Degree and angle of the polarisation, of Q and U that were interpolated."""
    q, u = _Q[0], _U[0]
    if q in made and u in made and "radiance" in made:
        total = made["radiance"] / made["solar_irradiance"]
        derived: Any = (np.hypot(made[q], made[u]) / total, 0.5 * np.degrees(np.arctan2(made[u], made[q])))
        for name, values in zip(_DERIVED, derived, strict=True):
            made[name] = values.assign_attrs(attributes(name))
    return made


def _whole(data: xarray.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Azimuths over the whole circle [deg], and the column of the dataset that each one is in."""
    here = data.azimuth.values
    if "azimuth_count" not in data.attrs:
        return here, np.arange(here.size)
    count = int(data.attrs["azimuth_count"])
    azimuth = np.arange(count) * (360.0 / count)
    return azimuth, np.abs(np.minimum(azimuth, 360.0 - azimuth)[:, None] - here).argmin(axis=1)
