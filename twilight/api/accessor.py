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
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack

import numpy as np
import xarray
from numpy.typing import ArrayLike

from twilight.api.arguments import PlotOptions
from twilight.base.arguments import in_units, plain
from twilight.base.conventions import ROUNDING
from twilight.base.errors import TwilightError
from twilight.io.labels import attributes
from twilight.io.netcdf import sky_of
from twilight.numerics.spectrum import DEFAULT_SOLAR_SPECTRUM, solar_irradiance
from twilight.sky.quantities.measure import quantity, unit_of
from twilight.sky.quantities.responses import ResponseLike, response
from twilight.sky.quantities.sky_light import luminance
from twilight.sky.sky import Sky
from twilight.sky.table import SkyTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GRID = ("elevation", "azimuth", "wavelength")
_RADIANCE = "sun_normalised_radiance"
_Q = (f"{_RADIANCE}_q", "standard_error_q")
_U = (f"{_RADIANCE}_u", "standard_error_u")
"""Stokes parameters Q and U over F0, and their standard errors."""
_DERIVED = ("degree_of_linear_polarisation", "angle_of_linear_polarisation")


@xarray.register_dataset_accessor("sky")
@in_units
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
        where = _Grid.of(chosen)

        def grid(name: str) -> np.ndarray | None:
            if name not in chosen or np.isnan(chosen[name]).all():
                return None
            if chosen[name].dims == ("wavelength",):
                return chosen[name].values.astype(float)
            return where.whole(chosen[name].transpose(*_GRID).values)

        def one(*names: str) -> float | None:
            number = next((float(chosen[name]) for name in names if name in chosen), None)
            return None if number is None or np.isnan(number) else number

        def stokes(q: str, u: str) -> np.ndarray | None:
            both = grid(q), grid(u)
            if both[0] is None or both[1] is None:
                return None
            sign = 1.0 if "error" in u else np.where(where.mirrored, -1.0, 1.0)[:, None]
            return np.stack([both[0], both[1] * sign], axis=2).astype(float)

        if grid(_RADIANCE) is None:
            raise TwilightError(".sky.scene: this scene holds no radiance")
        sky = sky_of((chosen.wavelength.values, where.elevation, where.azimuth), grid, stokes, one, dict(chosen.attrs))
        made: dict[str, Any] = {"sun_normalised_radiance": sky.sun_normalised_radiance.astype(float)}
        if (bending := one("solar_bending")) is not None:
            made["apparent_sun_elevation_deg"] = sky.sun_elevation_deg + bending
        if "sweep_hash" in chosen.attrs:
            made["provenance"] = sky.provenance | {"sweep_hash": chosen.attrs["sweep_hash"]}
        return replace(sky, **made)

    def interp(
        self,
        elevation: ArrayLike | xarray.DataArray | None = None,
        azimuth: ArrayLike | xarray.DataArray | None = None,
        **others: Any,
    ) -> xarray.Dataset:
        """What the dataset holds in any direction, by the rule of a sky's table (`Sky.sample`), on the whole sphere.

        Parameters
        ----------
        elevation, azimuth
            Directions [deg], azimuths beyond 360 and below 0 too: numbers, arrays that span a grid, or DataArrays,
            whose dimensions are then those of the result.  None: those of the dataset.
        **others
            Other coordinates and options (wavelength, time, method ...), as of `Dataset.interp`, linear.

        Returns
        -------
        xarray.Dataset
            What the dataset holds, in these directions; NaN for elevations below the sky.
        """
        data = self._dataset.interp(**others) if others else self._dataset
        if elevation is None and azimuth is None:
            return data
        given = {"elevation": elevation, "azimuth": azimuth}
        wanted = {name: _coordinate(name, data[name] if v is None else v) for name, v in given.items()}
        towards = _Towards(data, wanted["elevation"], wanted["azimuth"])
        kept = data.drop_vars(["elevation_bnds", "azimuth_bnds", *_DERIVED], errors="ignore")
        result = kept.drop_dims(["elevation", "azimuth"])
        result = result.assign({str(n): towards.read(v) for n, v in kept.data_vars.items() if _over_sky(v)})
        for name, values in wanted.items():
            attrs = {k: v for k, v in self._dataset[name].attrs.items() if k != "bounds"}
            result = result.assign_coords({name: values.assign_attrs(attrs)})
        if azimuth is not None:
            result.attrs.pop("azimuth_count", None)
        return _with_polarisation(result.assign_attrs({k: v for k, v in data.attrs.items() if k in result.attrs}))

    def luminance(self) -> xarray.DataArray:
        """Luminance [cd m^-2] in every direction of the dataset."""
        return self._each("luminance", _Samples.luminance, "cd m-2", "luminance of the sky", _GRID[:2])

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
        asked = quantity(name)
        unit, where = unit_of(asked, "surface" if elevation_deg is None else "direction"), (elevation_deg, azimuth_deg)
        return self._each(
            asked.variable, lambda sky: sky.measure(name, *where, horizontal=horizontal), unit, asked.about
        )

    def plot(self, projection: str = "wide", ax: Axes | None = None, **options: Unpack[PlotOptions]) -> Figure:
        """Draw the one sky that is left (`Sky.plot`)."""
        return self.scene().plot(projection, ax, **options)

    def _each(
        self, name: str, figure: Callable[[Any], ArrayLike], unit: str, about: str, dims: tuple[str, ...] = ()
    ) -> xarray.DataArray:
        """A figure of every sky, or of every sample of it along dims."""
        data = self._dataset
        where = None if dims else _Grid.of(data)
        spectrum = str(data.attrs.get("solar_spectrum", DEFAULT_SOLAR_SPECTRUM))
        night = [data["night_radiance"]] if "night_radiance" in data else []

        def one(radiance: np.ndarray, distance_au: float, sun_elevation_deg: float, *night: np.ndarray) -> np.ndarray:
            if np.isnan(radiance).any():
                return np.full(radiance.shape[: len(dims)], np.nan)
            samples = _Samples(data.wavelength.values, spectrum, float(distance_au), radiance, *night)
            if where is None:
                return np.asarray(figure(samples), float)
            sky = Sky(
                wavelength_nm=samples.wavelength_nm,
                elevation_deg=where.elevation,
                azimuth_deg=where.azimuth,
                sun_normalised_radiance=where.whole(radiance),
                sun_elevation_deg=float(sun_elevation_deg),
                distance_au=samples.distance_au,
                solar_spectrum=spectrum,
                night_radiance=where.whole(night[0]) if night else None,
            )
            return np.asarray(figure(sky), float)

        result = xarray.apply_ufunc(
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
            dask_gufunc_kwargs={"allow_rechunk": True},
        )
        return result.rename(name).assign_attrs(units=unit, long_name=about)


def _coordinate(name: str, values: Any) -> xarray.DataArray:
    """Angles as a DataArray: numbers without a dimension, arrays along their own name."""
    numbers = np.asarray(plain(values, name, "deg"), float)
    if isinstance(values, xarray.DataArray):
        return xarray.DataArray(numbers, dims=values.dims)
    return xarray.DataArray(numbers, dims=[name] if numbers.ndim else [])


def _over_sky(values: xarray.DataArray) -> bool:
    return {"elevation", "azimuth"} <= set(values.dims) and values.dtype.kind == "f"


class _Towards:
    """Directions in which the variables of a dataset are read."""

    def __init__(self, data: xarray.Dataset, elevation: xarray.DataArray, azimuth: xarray.DataArray):
        both = xarray.broadcast(elevation, azimuth)
        self._dims, self._shape = [str(d) for d in both[0].dims], both[0].shape
        self._sizes = dict(zip(self._dims, self._shape, strict=True))
        self._elevation, self._turn = both[0].values.ravel(), both[1].values.ravel()
        self._grid = _Grid.of(data)
        first = self._grid.elevation[:2]
        low = 0.0 if first.size > 1 and 0.0 < first[0] <= first[1] - first[0] else float(first[0])
        self._outside = ~((self._elevation >= low) & (self._elevation <= 90.0))

    def read(self, values: xarray.DataArray) -> xarray.DataArray:
        """A variable in these directions; NaN where a sky is NaN, and below its lower edge."""
        signed = values.name in (*_Q, *_U) and "error" not in str(values.name)
        flips = values.name == _U[0]

        def one(skies: np.ndarray) -> np.ndarray:
            rows, columns = self._grid.elevation, self._grid.azimuth
            whole = self._grid.whole(np.moveaxis(skies.reshape(-1, *skies.shape[-2:]), 0, 2))
            if flips:
                whole = np.where(self._grid.mirrored[:, None], -whole, whole)
            out = np.full((self._elevation.size, whole.shape[2]), np.nan)
            negative, positive = (whole < 0.0).any(axis=(0, 1)) | signed, (whole > 0.0).all(axis=(0, 1))
            kinds = (positive & ~negative, SkyTable.of_samples), (negative, SkyTable.of_signed)
            for which, table in (*kinds, (~positive & ~negative, SkyTable.of_samples)):
                if which.any():
                    sky_table = table(rows, columns, whole[..., which])
                    out[:, which] = sky_table.light(self._elevation, self._turn)
            out[self._outside] = np.nan
            return out.T.reshape((*skies.shape[:-2], *self._shape)).astype(skies.dtype)

        result = xarray.apply_ufunc(
            one,
            values.drop_vars(["elevation", "azimuth"], errors="ignore"),
            input_core_dims=[["elevation", "azimuth"]],
            output_core_dims=[self._dims],
            exclude_dims={"elevation", "azimuth"},
            dask="parallelized",
            output_dtypes=[values.dtype],
            dask_gufunc_kwargs={"output_sizes": self._sizes, "allow_rechunk": True},
        )
        order = [d for old in values.dims for d in (self._dims if old == "elevation" else [old])]
        others = [str(d) for d in order if d in self._dims or d not in ("elevation", "azimuth")]
        return result.transpose(*dict.fromkeys(others)).assign_attrs(values.attrs)


def _with_polarisation(dataset: xarray.Dataset) -> xarray.Dataset:
    """Degree and angle of the polarisation, of Q and U that were interpolated."""
    q, u = _Q[0], _U[0]
    if q in dataset and u in dataset and "radiance" in dataset:
        total = dataset["radiance"] / dataset["solar_irradiance"]
        derived: Any = (np.hypot(dataset[q], dataset[u]) / total, 0.5 * np.degrees(np.arctan2(dataset[u], dataset[q])))
        for name, values in zip(_DERIVED, derived, strict=True):
            dataset[name] = values.assign_attrs(attributes(name))
    return dataset


class _Samples(NamedTuple):
    """Samples of a sky in directions (E, A, W) that need not be the whole of it."""

    wavelength_nm: np.ndarray
    solar_spectrum: str
    distance_au: float
    radiance: np.ndarray
    night: np.ndarray | float = 0.0

    def luminance(self) -> np.ndarray:
        """Luminance [cd m^-2], (E, A)."""
        sun = solar_irradiance(self.wavelength_nm, self.solar_spectrum, self.distance_au)
        return luminance(self.radiance + self.night / sun, self.wavelength_nm, self.solar_spectrum, self.distance_au)


class _Grid(NamedTuple):
    """The directions of the whole sky that a dataset holds.

    elevation (E,), azimuth (A,): increasing, azimuths within 0 to 360 [deg]; row (E,), column (A,): of the dataset;
    mirrored (A,): columns that are those of the other side of the sun.
    """

    elevation: np.ndarray
    azimuth: np.ndarray
    row: np.ndarray
    column: np.ndarray
    mirrored: np.ndarray

    def whole(self, values: np.ndarray) -> np.ndarray:
        """Values of the dataset, (E', A', ...), in all directions, (E, A, ...)."""
        return values[self.row[:, None], self.column]

    @classmethod
    def of(cls, data: xarray.Dataset) -> _Grid:
        """That of a dataset with azimuths from any direction on, a half sky (`azimuth_count`) or rows downwards.

        Errors: TwilightError for a part of a sky, which says nothing of the rest.
        """
        elevation, turn = (_coordinate(n, data[n]).values for n in _GRID[:2])
        row = np.argsort(elevation, kind="stable")
        low, high = _edges(data, "elevation", elevation, 180.0)
        if low > 1e-6 or high < 90.0 - 1e-6:
            raise TwilightError(f".sky: the dataset holds elevations from {low:g} to {high:g} deg, a part of its sky")
        if "azimuth_count" in data.attrs:
            count = int(data.attrs["azimuth_count"])
            azimuth = np.arange(count) * (360.0 / count)
            apart = [np.abs((azimuth[:, None] - sign * turn + 180.0) % 360.0 - 180.0) for sign in (1.0, -1.0)]
            nearest = np.minimum(*apart)
            column = nearest.argmin(axis=1)
            mirrored = apart[0][range(count), column] > apart[1][range(count), column] + ROUNDING
            covered = 360.0 * (nearest.min(axis=1) < 1e-3).mean()
        else:
            azimuth, column = np.unique(turn % 360.0, return_index=True)
            mirrored = np.zeros(azimuth.size, bool)
            low, high = _edges(data, "azimuth", turn, 360.0)
            covered = high - low
        if covered < 360.0 - 1e-3:
            raise TwilightError(f".sky: the dataset's azimuths cover {covered:.3g} of 360 deg, a part of its sky")
        return cls(elevation[row], azimuth, row, column, mirrored)


def _edges(data: xarray.Dataset, name: str, values: np.ndarray, most: float) -> tuple[float, float]:
    """From where to where directions [deg] cover the sky: from the lowest edge by the sum of all bins; where a dataset
    has no bounds, azimuths with a gap of twice the others end there, and equal steps half a step beyond the last."""
    bounds = data.get(f"{name}_bnds")
    if bounds is None and name == "azimuth":
        gaps = np.sort(np.diff(np.sort(values), append=values.min() + 360.0))
        return 0.0, 360.0 - (gaps[-1] if values.size < 3 or gaps[-1] > 1.9 * gaps[-2] else 0.0)
    if bounds is None:
        steps = np.diff(np.sort(values))
        equal = values.size == 1 or float(np.ptp(steps)) < 1e-6
        half = 0.5 * float(steps[0]) if steps.size else 0.0
        return (values.min() - half, values.max() + half) if equal else (min(0.0, values.min()), 90.0)
    edges = bounds.isel({d: 0 for d in bounds.dims if d not in (name, "nv")}).transpose(name, "nv").values
    widths = np.abs(np.diff(edges)[:, 0])
    apart = np.abs((values - edges.mean(axis=1) + 0.5 * most) % most - 0.5 * most)
    if (outside := apart > widths + 1e-6).any():
        raise TwilightError(f".sky: {name} {values[outside][0]:g} deg is outside {name}_bnds; are its angles degrees?")
    return float(edges.min()), float(edges.min() + widths.sum())
