"""Maps over time: reanalyses (ERA5, CAMS, MERRA-2) in netCDF or GRIB.

Quantities are known by their names: ECMWF's short names (ERA5 and CAMS from the Copernicus data stores, and what cfgrib
makes of GRIB), and MERRA-2's (Bosilovich et al. 2016, GMAO Office Note 9).  In place and time they are interpolated
linearly where there are neighbours on both sides; a map of one time or one point is taken as it is.

References
----------
Copernicus Climate Change Service, ERA5 hourly data on pressure levels: t (K), q (kg/kg), r (%), o3 (kg/kg of moist
air), z (m^2 s^-2), pressure_level or level (hPa), valid_time or time.  Copernicus Atmosphere Monitoring Service, EAC4:
go3, aod469 to aod1240, gtco3 (kg m^-2).  MERRA-2: T, QV, RH, O3 (kg/kg), H (m), lev (hPa); TOTEXTTAU, TOTANGSTR, TO3
(DU), TQV.
"""

from __future__ import annotations

import logging
import warnings
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from twilight.atmosphere import measured
from twilight.atmosphere import measured as air
from twilight.atmosphere.profiles import MOLECULES_PER_CM2_PER_DU
from twilight.base.errors import TwilightError
from twilight.base.extras import missing, require
from twilight.base.reading import reading
from twilight.io.air.grid_points import between, by_valid_time, dimension, weighted
from twilight.io.air.lines import PlaceAndTime, spoken

COORDINATES = {
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon"),
    "time": ("valid_time", "time"),
    "pressure": ("pressure_level", "isobaricInhPa", "isobaricInPa", "level", "lev", "plev"),
}
"""What each coordinate is called."""
STANDARD_NAMES = {"pressure": "air_pressure"}
"""What a coordinate of any other name says that it is (CF conventions), where that is not our own word."""
HPA = {"hpa": 1.0, "hectopascal": 1.0, "hectopascals": 1.0, "mbar": 1.0, "mb": 1.0, "millibar": 1.0, "millibars": 1.0,
       "": 1.0, "pa": 0.01, "pascal": 0.01, "pascals": 0.01, "kpa": 10.0, "bar": 1000.0}  # fmt: skip
"""Units of pressure [hPa], in lower case."""

TEMPERATURE = ("t", "T")
"""Names of the variables in the files: temperature [K]."""
HEIGHT_M = ("H", "gh")
"""Geopotential height [m]."""
GEOPOTENTIAL = ("z",)
"""Geopotential [m^2 s^-2]."""
SPECIFIC_HUMIDITY = ("q", "QV")
"""kg of water vapour in a kg of air."""
RELATIVE_HUMIDITY = ("r", "RH")
"""Over water [%], or of MERRA-2 1."""
OZONE_MASS = ("o3", "go3", "O3")
"""kg of ozone in a kg of air."""
OZONE_DU = ("TO3",)
"""Ozone column [DU]."""
OZONE_KG = ("tco3", "gtco3")
"""Ozone column [kg m^-2]."""
WATER_KG = ("tcwv", "TQV")
"""Column of water vapour [kg m^-2]."""
DEPTHS = {"aod469": 469.0, "aod550": 550.0, "aod670": 670.0, "aod865": 865.0, "aod1240": 1240.0}
"""Optical depths of CAMS by wavelength [nm]."""
MERRA_DEPTH = "TOTEXTTAU"
"""Optical depth of aerosol at 550 nm."""
MERRA_EXPONENT = "TOTANGSTR"
"""Its Angstrom exponent between 470 and 870 nm."""
MERRA_NM = (470.0, 550.0, 870.0)
"""Wavelengths that stand for these two [nm]; without the exponent 550 nm alone."""

COVER = ("cc", "CLOUD")
"""Fraction of cloud on the pressure levels."""
LIQUID = ("clwc", "QL")
"""kg of cloud water in a kg of air."""
ICE = ("ciwc", "QI")
"""kg of cloud ice in a kg of air."""

CLOUDS = (*COVER, *LIQUID, *ICE, "tcc", "CLDTOT")
AEROSOL_MASSES = ("aermr", "DU0", "SS0", "BCPH", "OCPH", "SO4")
KG_PER_DU = MOLECULES_PER_CM2_PER_DU * 1e4 * measured.MOLAR_MASS_OZONE / 6.02214076e23
"""kg of ozone on a square metre in one Dobson unit, 2.1415e-5."""

SURFACE_HPA = (("sp", 1e-2), ("PS", 1e-2))
"""Pressure on the ground, and what makes hPa of it."""
MODEL_LEVELS = ("hybrid", "model_level", "model_level_number", "lev_model", "bottom_top")
USED = (
    *TEMPERATURE, *HEIGHT_M, *GEOPOTENTIAL, *SPECIFIC_HUMIDITY, *RELATIVE_HUMIDITY, *OZONE_MASS, *OZONE_DU, *OZONE_KG,
    *WATER_KG, *DEPTHS, MERRA_DEPTH, MERRA_EXPONENT, *COVER, *LIQUID, *ICE,
)  # fmt: skip
"""All variables that are used."""


def read_gridded(path: Path, content: str, wanted: PlaceAndTime) -> air.Reading:
    """What a map holds at a place and time.

    content: `netcdf`, `netcdf3` or `grib`.  Errors: TwilightError with the file and the variable.
    """
    datasets = [by_valid_time(one) for one in _open(path, content)]
    columns: dict[str, Any] = {}
    warned: set[str] = set()
    profiles: list[tuple[np.ndarray, dict[str, np.ndarray]]] = []
    said: set[str] = set()
    name = ""
    try:
        with reading(path, "the map that its names promise"):  # values are read only now
            for data in datasets:
                name = name or _name(data)
                found, levels, where, single, there = _at_the_place(path, data, wanted)
                said.add(where)
                warned |= set(wanted.warnings(f"{name or 'map'} {path.name}: {where}", single, *there))
                on_levels = {key: value for key, value in found.items() if np.ndim(value)}
                columns |= {key: value for key, value in found.items() if key not in on_levels}
                if levels is not None:
                    profiles.append((levels, on_levels))
    finally:
        for data in datasets:
            data.close()
    # GRIB may have some fields at fewer levels than others: NaN where one has none
    pressure_hpa = np.unique(np.concatenate([np.zeros(0), *(levels for levels, _ in profiles)]))
    for levels, on_levels in profiles:
        for key, value in on_levels.items():
            columns[key] = np.full_like(pressure_hpa, np.nan)
            columns[key][np.searchsorted(pressure_hpa, levels)] = value
    source = f"{name or 'map'} {path.name}: {', '.join(sorted(said))}"
    parts: list[air.Part] = []
    if any(one in columns for one in TEMPERATURE) and pressure_hpa.size:
        parts.append(_air(path, source, pressure_hpa, columns, wanted))
        parts += _clouds(source, pressure_hpa, columns, wanted)
    elif name_of := [one for one in TEMPERATURE if one in columns]:
        raise TwilightError(f"{path}: {name_of[0]} is that of one level; download it on the pressure levels")
    parts += _amounts(path, source, columns)
    if not parts:
        raise TwilightError(
            f"{path}: has none of the variables that are used: t, q, o3 and z (ERA5, CAMS), T, QV, O3 and H (MERRA-2) "
            "on pressure levels, aod550, TOTEXTTAU, tcwv, tco3, gtco3, TO3"
        )
    left = [one for one in columns if one in CLOUDS or one.startswith(AEROSOL_MASSES)]
    words = []
    has_clouds = any(isinstance(part, air.CloudWater) for part in parts)
    if clouds := [one for one in left if one in CLOUDS and not has_clouds]:
        words.append(f"clouds ({', '.join(clouds)})")
    if masses := [one for one in left if one not in CLOUDS]:
        words.append(f"mixing ratios of aerosol ({', '.join(masses)})")
    return air.Reading("reanalysis", tuple(parts), tuple(f"{source}: {w}" for w in words), tuple(sorted(warned)))


def _open(path: Path, content: str) -> list[Any]:
    """The datasets of a file: GRIB may hold several that share no coordinates."""
    require(f"{path}: air in netCDF or GRIB", "xarray")
    import xarray  # optional

    with reading(path, f"a complete {'GRIB' if content == 'grib' else 'netCDF'} file"):
        if content == "grib":
            try:
                import cfgrib  # optional
            except ImportError:
                raise missing("cfgrib", f"{path}: GRIB") from None
            log = logging.getLogger("cfgrib")  # it prints tracebacks of damaged messages, and raises as well
            level = log.level
            log.setLevel(logging.CRITICAL + 1)
            try:
                with warnings.catch_warnings():  # of xarray, about what cfgrib asks it
                    warnings.simplefilter("ignore", FutureWarning)
                    return list(cfgrib.open_datasets(str(path), backend_kwargs={"indexpath": ""}))
            finally:
                log.setLevel(level)
        engine = "h5netcdf" if content == "netcdf" else "scipy"
        options = {"phony_dims": "sort"} if content == "netcdf" else {}
        return [xarray.open_dataset(path, engine=engine, backend_kwargs=options)]


def _name(data: Any) -> str:
    """What the file calls itself."""
    for key in ("title", "Title", "LongName", "source", "institution", "GRIB_centreDescription"):
        if isinstance(data.attrs.get(key), str) and data.attrs[key].strip():
            return " ".join(data.attrs[key].split())[:60]
    return ""


def _coordinate(data: Any, kind: str) -> str | None:
    known = next((name for name in COORDINATES[kind] if name in data.variables), None)
    standard = STANDARD_NAMES.get(kind, kind)
    return known or next((str(n) for n in data.coords if data[n].attrs.get("standard_name") == standard), None)


def _at_the_place(
    path: Path, data: Any, wanted: PlaceAndTime
) -> tuple[dict[str, Any], np.ndarray | None, str, datetime | None, tuple[float | None, float | None]]:
    """Values of all variables at the place and time, by pressure where they have it; the pressures; where; the time of
    a map that has a single one; and the place [deg] that a map with a single latitude or longitude stands for."""
    single = None
    words = []
    latitude, longitude = (_coordinate(data, kind) for kind in ("latitude", "longitude"))
    if latitude is None or longitude is None:
        raise TwilightError(
            f"{path}: has no latitude and longitude; allowed are maps over {', '.join(COORDINATES['latitude'])} and "
            f"{', '.join(COORDINATES['longitude'])}"
        )
    weights: list[tuple[str, list[tuple[int, float]]]] = []
    lat = np.atleast_1d(data[latitude].values).astype(float)
    lon = np.atleast_1d(data[longitude].values).astype(float)
    if lat.ndim != 1 or lon.ndim != 1:
        raise TwilightError(
            f"{path}: {latitude} and {longitude} must be one-dimensional; other projections are not read"
        )
    on_map: tuple[float | None, float | None] = (None, None)
    if lat.size * lon.size > 1 or wanted.latitude_deg is not None:
        there = wanted.place(path)
        weights.append((dimension(data, latitude), between(path, latitude, lat, there[0], "deg")))
        weights.append((dimension(data, longitude), between(path, longitude, lon, there[1], "deg", turn=360.0)))
        on_map = float(lat[0]) if lat.size == 1 else there[0], float(lon[0]) if lon.size == 1 else there[1]
        words.append(f"{on_map[0]:g} N {on_map[1]:g} E")
    time = _coordinate(data, "time")
    if time is not None:
        stamps = np.atleast_1d(data[time].values)
        if stamps.size > 1 and not np.issubdtype(stamps.dtype, np.datetime64):
            raise TwilightError(
                f"{path}: {time} is no time of the usual calendar; allowed are numbers with units such as `hours since "
                "1900-01-01`"
            )
        if np.issubdtype(stamps.dtype, np.datetime64) and stamps.ndim == 1:
            seconds = stamps.astype("datetime64[ms]").astype(np.int64) / 1000.0
            if seconds.size > 1:
                moments = [datetime.fromtimestamp(s, UTC) for s in seconds]
                wanted.nearest(moments, path, "times")  # a sentence where no time is asked for
                assert wanted.time is not None
                weights.append((dimension(data, time), between(path, time, seconds, wanted.time.timestamp(), "s")))
                words.append(spoken(wanted.time))
            else:
                weights += [(dimension(data, time), [(0, 1.0)])] if data[time].dims else []
                single = datetime.fromtimestamp(float(seconds[0]), UTC)
                words.append(spoken(single) + wanted.away(single))
    pressure = _coordinate(data, "pressure")
    levels = None
    if pressure is not None:
        levels = np.atleast_1d(data[pressure].values).astype(float)
        unit = str(data[pressure].attrs.get("units", "hPa")).strip()
        if unit.lower() not in HPA:
            raise TwilightError(f"{path}: {pressure} is in {unit!r}; allowed are hPa, Pa, kPa, mbar")
        levels = levels * HPA[unit.lower()]
    variables: dict[str, Any] = {}
    for name in data.data_vars:
        variable = data[name]
        if not np.issubdtype(variable.dtype, np.number):
            continue
        value = weighted(variable, weights).squeeze()
        on_levels = value.ndim == 1 and pressure is not None and value.dims == data[pressure].dims
        if value.ndim == 0:
            variables[str(name)] = float(value)
        elif on_levels:
            variables[str(name)] = np.asarray(value.values, dtype=float)
        elif str(name) in USED:
            raise TwilightError(f"{path}: {name} {_too_many(value, data, pressure)}")
    return variables, levels, " ".join(words), single, on_map


def _too_many(value: Any, data: Any, pressure: str | None) -> str:
    """What is said of a variable that is more than a number or a profile at a place and time."""
    known = set() if pressure is None else set(data[pressure].dims)
    others = [str(dim) for dim in value.dims if dim not in known]
    if any(dim in MODEL_LEVELS for dim in others):
        return f"is on model levels ({others[0]}); download it on pressure levels"
    if pressure is None and len(others) == 1:
        return (
            f"has the dimension {others[0]} at a place and time; pressure levels are known by its name "
            f"({', '.join(COORDINATES['pressure'])}) or by its standard_name air_pressure"
        )
    sizes = ", ".join(f"{dim} ({value.sizes[dim]} of them)" for dim in others)
    return (
        f"still has the dimension{'s' * (len(others) > 1)} {sizes} at a place and time; choose one of each first, for "
        f"example with xarray: data.isel({others[0]}=0).to_netcdf(...)"
    )


def _one(columns: dict[str, Any], names: tuple[str, ...]) -> Any:
    return next((columns[name] for name in names if name in columns), None)


def _height_m(columns: dict[str, Any]) -> Any:
    """Geopotential height of the pressure levels [m], None where the file has none."""
    height, geopotential = _one(columns, HEIGHT_M), _one(columns, GEOPOTENTIAL)
    return geopotential / measured.STANDARD_GRAVITY if height is None and geopotential is not None else height


def _air(
    path: Path, source: str, pressure_hpa: np.ndarray, columns: dict[str, Any], wanted: PlaceAndTime
) -> air.AirColumn:
    """Pressure levels as a column of air at geometric altitudes."""
    temperature = np.asarray(_one(columns, TEMPERATURE), dtype=float)
    height_m = _height_m(columns)
    if height_m is None:
        raise TwilightError(
            f"{path}: has temperature and no altitude of the pressure levels; download z (geopotential) too, or H, gh "
            "(height)"
        )
    q, r, o3 = _one(columns, SPECIFIC_HUMIDITY), _one(columns, RELATIVE_HUMIDITY), _one(columns, OZONE_MASS)
    water = None
    if q is not None:
        water = measured.from_specific_humidity(np.maximum(np.asarray(q), 0.0))
    elif r is not None:
        percent = np.maximum(np.asarray(r), 0.0) * (100.0 if np.nanmax(r) <= 2.0 else 1.0)  # MERRA-2 has fractions
        water = measured.from_relative_humidity(percent, temperature, pressure_hpa)
    if np.ndim(height_m) == 0:  # of the ground alone
        height_m = _from_the_ground(path, float(height_m), pressure_hpa, temperature, water, columns)
    height = np.asarray(height_m, dtype=float)
    _check_ranges(path, pressure_hpa, temperature, height, q, o3)
    good = np.isfinite(temperature) & np.isfinite(height) & (temperature > 0.0) & (pressure_hpa > 0.0)
    if not good.any():
        raise TwilightError(f"{path}: has no temperature and altitude at the place and time")
    order = np.flatnonzero(good)[np.argsort(-pressure_hpa[good])]
    _check_hydrostatic(path, pressure_hpa[order], temperature[order], height[order])
    ozone = None
    if o3 is not None:
        ozone = measured.ozone_from_mass_mixing_ratio(np.maximum(o3, 0.0), 0.0 if water is None else water)
    latitude = 45.0 if wanted.latitude_deg is None else wanted.latitude_deg
    z = measured.geometric_km(1e-3 * height, latitude)
    return air.AirColumn(
        source,
        z[order],
        pressure_hpa[order],
        temperature[order],
        None if water is None else water[order],
        None if ozone is None else ozone[order],
    )


def _check_hydrostatic(path: Path, pressure_hpa: np.ndarray, temperature_k: np.ndarray, height_m: np.ndarray) -> None:
    """TwilightError for pressures and heights that are not of one air, as where one of them is in another unit."""
    metres = -np.diff(np.log(pressure_hpa)) * 0.5 * (temperature_k[1:] + temperature_k[:-1])
    expected = float(metres.sum()) * measured.GAS_CONSTANT / (measured.MOLAR_MASS_DRY * measured.STANDARD_GRAVITY)
    thickness_m = float(height_m[-1] - height_m[0])
    if expected > 0.0 and not 0.8 <= thickness_m / expected <= 1.25:
        raise TwilightError(
            f"{path}: has {1e-3 * thickness_m:.3g} km of air between {pressure_hpa[0]:g} and {pressure_hpa[-1]:g} hPa, "
            f"which its temperatures make {1e-3 * expected:.3g} km: z (geopotential) must be in m2 s-2, H and gh in m"
        )


def _check_ranges(
    path: Path, pressure_hpa: np.ndarray, temperature_k: np.ndarray, height_m: np.ndarray, q: Any, o3: Any
) -> None:
    """TwilightError for numbers that no air has, as those in other units."""
    for name, values, low, high, unit in (
        ("pressure", pressure_hpa, 0.0, 1200.0, "hPa (or say in its units that it is in Pa)"),
        ("temperature", temperature_k, 100.0, 1000.0, "K"),
        ("height of the pressure levels", height_m, -2000.0, 120e3, "m"),
        ("specific humidity", q, -0.01, 0.1, "kg in a kg of air"),
        ("ozone", o3, -1e-4, 1e-3, "kg in a kg of air"),
    ):
        if values is None:
            continue
        known = np.asarray(values)[np.isfinite(values)]
        if known.size and not low <= known.min() <= known.max() <= high:
            raise TwilightError(
                f"{path}: its {name} goes from {known.min():g} to {known.max():g}; allowed is {low:g} to {high:g} "
                f"{unit}"
            )


def _from_the_ground(
    path: Path,
    ground_m: float,
    pressure_hpa: np.ndarray,
    temperature_k: np.ndarray,
    water: np.ndarray | None,
    columns: dict[str, Any],
) -> np.ndarray:
    """Geopotential heights [m] of the levels by the hydrostatic equation, from the pressure on the ground."""
    on_ground = next((columns[name] * factor for name, factor in SURFACE_HPA if name in columns), None)
    if on_ground is None or np.ndim(on_ground) or not np.isfinite(on_ground):
        raise TwilightError(
            f"{path}: its altitude (z) is that of the ground alone; download z (geopotential) on the pressure levels "
            "too, or sp (surface pressure) to integrate from"
        )
    known = np.isfinite(temperature_k) & (pressure_hpa > 0.0)
    virtual = measured.virtual_temperature_k(temperature_k, 0.0 if water is None else np.nan_to_num(water))[known]
    x = -np.log(pressure_hpa[known])
    order = np.argsort(x)
    x, virtual = x[order], virtual[order]
    metres = np.diff(x) * 0.5 * (virtual[1:] + virtual[:-1])
    metres *= measured.GAS_CONSTANT / (measured.MOLAR_MASS_DRY * measured.STANDARD_GRAVITY)
    course = np.concatenate([[0.0], np.cumsum(metres)])
    start = float(np.interp(-np.log(on_ground), x, course))
    if -np.log(on_ground) < x[0]:  # the ground lies below all levels
        scale_m = virtual[0] * measured.GAS_CONSTANT / (measured.MOLAR_MASS_DRY * measured.STANDARD_GRAVITY)
        start = float((-np.log(on_ground) - x[0]) * scale_m)
    height = np.full(pressure_hpa.shape, np.nan)
    height[np.flatnonzero(known)[order]] = ground_m + course - start
    return height


def _clouds(source: str, pressure_hpa: np.ndarray, columns: dict[str, Any], wanted: PlaceAndTime) -> list[air.Part]:
    """Water and ice of the clouds, each pressure level for the air half way to its neighbours."""
    cover, liquid, ice = (_one(columns, names) for names in (COVER, LIQUID, ICE))
    height = _height_m(columns)
    if cover is None or (liquid is None and ice is None) or np.ndim(cover) == 0 or np.ndim(height) == 0:
        return []
    liquid, ice = (np.zeros_like(pressure_hpa) if water is None else water for water in (liquid, ice))
    rows = np.stack([pressure_hpa, height, cover, liquid, ice])
    rows = rows[:, np.all(np.isfinite(rows), axis=0)]
    p, h, cc, water, frozen = rows[:, np.argsort(-rows[0])]
    if p.size < 2:
        return []
    z = measured.geometric_km(1e-3 * h, 45.0 if wanted.latitude_deg is None else wanted.latitude_deg)
    edge_p, edge_z = (np.concatenate([[x[0]], 0.5 * (x[1:] + x[:-1]), [x[-1]]]) for x in (p, z))
    kg_of_air = -100.0 * np.diff(edge_p) / measured.STANDARD_GRAVITY
    water, frozen = (np.maximum(one, 0.0) * kg_of_air for one in (water, frozen))
    return [air.CloudWater(source, edge_z[:-1], edge_z[1:], cc, water, frozen)]


def _amounts(path: Path, source: str, columns: dict[str, Any]) -> list[air.Part]:
    """Vertical columns: ozone, water, optical depths."""
    parts: list[air.Part] = []
    du, kg = _one(columns, OZONE_DU), _one(columns, OZONE_KG)
    if du is None and kg is not None:
        du = kg / KG_PER_DU
    if du is not None:
        if not (np.ndim(du) == 0 and 50.0 <= du <= 700.0):
            raise TwilightError(f"{path}: the ozone column at the place is {du}, allowed is a number from 50 to 700 DU")
        parts.append(air.OzoneColumn(source, float(du)))
    water = _one(columns, WATER_KG)
    if water is not None and np.isfinite(water) and water > 0.0:
        parts.append(air.WaterColumn(source, float(water)))  # 1 kg on a square metre is 1 mm
    depths = {nm: columns[name] for name, nm in DEPTHS.items() if np.isfinite(columns.get(name, np.nan))}
    if MERRA_DEPTH in columns and np.isfinite(columns[MERRA_DEPTH]):
        exponent = columns.get(MERRA_EXPONENT, np.nan)
        nm = MERRA_NM if np.isfinite(exponent) else MERRA_NM[1:2]
        depths = {w: columns[MERRA_DEPTH] * ((w / MERRA_NM[1]) ** -exponent if len(nm) > 1 else 1.0) for w in nm}
    if depths := {nm: depth for nm, depth in sorted(depths.items()) if depth > 0.0}:
        parts.append(air.AerosolDepth(source, np.array([*depths]), np.array([*depths.values()])))
    return parts
