"""From files of measurements to the sections of a climate.

What several files hold is taken from the one that measured it: pressure, temperature and humidity of a sounding up to
its top, of a reanalysis above, of the climate above that; optical depths of a sun photometer before a reanalysis'.
"""

import math
import warnings
from collections.abc import Iterable
from copy import deepcopy
from dataclasses import dataclass, field
from datetime import UTC
from functools import lru_cache
from os import stat
from pathlib import Path
from typing import Any

import numpy as np

from twilight.atmosphere.aerosols import optical_depth_at
from twilight.atmosphere.clouds import MAX_DEPTH
from twilight.atmosphere.measured import (
    OVERCAST,
    AerosolDepth,
    AirColumn,
    CloudWater,
    OzoneColumn,
    Reading,
    SizeDistribution,
    WaterColumn,
    climatological_column_du,
    climatology_source,
    decks,
    join,
    most_cover,
)
from twilight.atmosphere.opac import opac_type
from twilight.atmosphere.stratosphere import measured_kind
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.reading import reading as reading_file
from twilight.config.air import Air
from twilight.config.climate import Climate, air_profile
from twilight.config.scene import Config
from twilight.config.sun import SunAt, SunInterval, SunTimes
from twilight.io.air import KINDS, PlaceAndTime, read_air_file

DIGITS = 6
"""Significant digits of numbers that are written into a climate."""

BIN_WIDTH = 0.5
"""ln sigma of the narrow mode that stands for one bin of a size distribution, in bins: they add up to within 2 %."""

OWN_HEIGHT_KM = 2.0
"""Layer over which a column's particles are spread for their number density, which optical depths scale anyway."""

OWN = "the climate's own"


def place_and_time_of(config: Config) -> PlaceAndTime:
    """Place and time of the section `air`, or else of the (first) sun."""
    air, sun = config.climate.air or Air(), config.sun
    time, latitude, longitude = air.at, air.latitude_deg, air.longitude_deg
    if isinstance(sun, SunAt | SunTimes | SunInterval):
        first = sun.at if isinstance(sun, SunAt) else sun.times[0] if isinstance(sun, SunTimes) else sun.start
        time = sun.aware(first) if time is None else time
        if latitude is None:
            latitude, longitude = sun.latitude_deg, sun.longitude_deg
    return PlaceAndTime(time, latitude, longitude)


def with_measured_air(climate: Climate, wanted: PlaceAndTime) -> dict[str, Any]:
    """The climate as plain data with all that its section `air` asks for in place.

    Errors: TwilightError that names the file, the line where there is one, and what is allowed.
    """
    air = climate.air or Air()
    readings = []
    for name, path in air.files():
        reading = read(path, wanted)
        if reading.kind != name:
            raise TwilightError(f"{path}: is {KINDS[reading.kind]}; air.{name} takes {KINDS[name]}")
        readings.append(reading)
    return assemble(climate, readings, wanted)


def read(path: str, wanted: PlaceAndTime) -> Reading:
    """What a file holds; read once as long as it does not change."""
    with reading_file(path, "a file of measurements"):
        at = stat(path)
    return _read(path, at.st_mtime_ns, at.st_size, wanted)


@lru_cache(maxsize=16)
def _read(path: str, changed_ns: int, size: int, wanted: PlaceAndTime) -> Reading:
    return read_air_file(Path(path), wanted)


@dataclass
class _Assembly:
    """A climate that becomes the measured one part by part."""

    climate: Climate
    data: dict[str, Any]
    sources: dict[str, str] = field(default_factory=dict)
    not_used: list[str] = field(default_factory=list)

    def section(self, *names: str) -> dict[str, Any]:
        at = self.data
        for name in names:
            if not isinstance(at.get(name), dict):
                at[name] = {}
            at = at[name]
        return at


def assemble(climate: Climate, readings: Iterable[Reading], wanted: PlaceAndTime) -> dict[str, Any]:
    """A climate as plain data with what was read in place of its own; `air.sources` says which is which.

    Warns of what was measured far from the place and time.
    """
    if climate.medium is not None:
        raise TwilightError(f"{climate.name}: is a table of coefficients (medium), which has no air to replace")
    data = deepcopy(climate.model_dump(mode="json", exclude_unset=True))
    made = _Assembly(climate, data)
    readings = list(readings)
    for words in (words for reading in readings for words in reading.warnings):
        warnings.warn(words, TwilightWarning, stacklevel=2)
    order = {kind: i for i, kind in enumerate(("aeronet", "sounding", "reanalysis"))}
    readings = sorted(readings, key=lambda reading: order[reading.kind])
    parts = [part for reading in readings for part in reading.parts]
    # an inversion has optical depths too: better than a reanalysis', not than those measured at the same time
    at = sum(len(reading.parts) for reading in readings if reading.kind == "aeronet")
    of_sizes = [
        AerosolDepth(p.source, p.wavelength_nm, p.optical_depth) for p in parts if isinstance(p, SizeDistribution)
    ]
    parts = [*parts[:at], *of_sizes, *parts[at:]]
    made.not_used += [words for reading in readings for words in reading.not_used]

    def all_of(kind: type) -> list[Any]:
        return [part for part in parts if isinstance(part, kind)]

    _put_profile(made, all_of(AirColumn))
    _put_ozone(made, all_of(OzoneColumn), all_of(AirColumn), wanted)
    _put_water(made, all_of(WaterColumn), all_of(AirColumn))
    _put_aerosol(made, all_of(SizeDistribution), all_of(AerosolDepth))
    _put_stratosphere(made)
    _put_clouds(made, all_of(CloudWater))
    if made.not_used:
        made.sources["not used"] = "; ".join(made.not_used)
    before = climate.air.sources if climate.air is not None else {}
    data["air"] = {"sources": {**before, **made.sources}}
    return data


def _put_profile(made: _Assembly, columns: list[AirColumn]) -> None:
    own = f"{OWN}, {made.climate.atmosphere.profile if made.climate.atmosphere.levels is None else 'atmosphere.levels'}"
    around = air_profile(made.climate)
    words, humid, ozone = [own], [own], [own]
    # the outer ones first: each goes inside the ones before; a reanalysis comes last of all readings
    for column in reversed(columns):
        around = join(column, around)
        top = f"to {column.altitude_km[-1]:.3g} km {column.source}"
        words.insert(0, top)
        for gas, of in ((column.water_vapour, humid), (column.ozone, ozone)):
            if gas is not None and np.count_nonzero(np.isfinite(gas)) >= 2:
                highest = column.altitude_km[np.isfinite(gas)][-1]
                of.insert(0, f"to {highest:.3g} km {column.source}")
    for name, of in (("pressure and temperature", words), ("humidity", humid), ("ozone profile", ozone)):
        made.sources[name] = ", above ".join(of) if len(of) > 1 else of[0]
    if not columns:
        return
    part = 1e6 / around.air_per_cm3
    made.section("atmosphere")["levels"] = {
        "altitude_km": _rounded(around.altitude_km),
        "pressure_hpa": _rounded(around.pressure_hpa),
        "temperature_k": _rounded(around.temperature_k),
        "water_vapour_ppm": _rounded(around.h2o_per_cm3 * part),
        "ozone_ppm": _rounded(around.o3_per_cm3 * part),
    }


def _put_ozone(made: _Assembly, columns: list[OzoneColumn], profiles: list[AirColumn], wanted: PlaceAndTime) -> None:
    measured = any(p.ozone is not None for p in profiles)
    given = made.climate.gases.ozone
    asked = given.column_du is not None or given.day_of_year is not None or not given.climatology
    if columns:
        ozone = made.section("gases", "ozone")
        ozone.pop("day_of_year", None)
        made.sources["ozone column"] = f"{columns[0].column_du:.0f} DU, {columns[0].source}"
        ozone["column_du"] = float(f"{columns[0].column_du:.{DIGITS}g}")
        made.not_used += [f"{one.source}: ozone column, {one.column_du:.0f} DU" for one in columns[1:]]
    elif measured:
        ozone = made.section("gases", "ozone")
        ozone.pop("column_du", None)
        ozone.pop("day_of_year", None)
        made.sources["ozone column"] = "that of the ozone profile"
    elif asked or wanted.time is None or wanted.latitude_deg is None:
        made.sources["ozone column"] = f"{OWN}, {'as it asks for' if asked else 'of its profile'}"
    else:
        day = wanted.time.astimezone(UTC).timetuple().tm_yday
        column = round(climatological_column_du(wanted.latitude_deg, day), 1)
        made.sources["ozone column"] = f"{column:.0f} DU, {climatology_source(wanted.latitude_deg, day)}"
        made.section("gases", "ozone")["column_du"] = column


def _put_water(made: _Assembly, columns: list[WaterColumn], profiles: list[AirColumn]) -> None:
    measured = any(p.water_vapour is not None and np.any(np.isfinite(p.water_vapour)) for p in profiles)
    left_out = made.climate.gases.water_vapour.column_mm == 0.0
    if left_out or measured:
        if measured and not left_out and "water_vapour" in made.data.get("gases", {}):
            made.section("gases", "water_vapour").pop("column_mm", None)
        made.sources["water vapour column"] = f"{OWN}: none absorbs" if left_out else "that of the humidity"
        made.not_used += [f"{one.source}: water vapour, {one.column_mm:.0f} mm" for one in columns]
    elif columns:
        made.section("gases", "water_vapour")["column_mm"] = float(f"{columns[0].column_mm:.{DIGITS}g}")
        made.sources["water vapour column"] = f"{columns[0].column_mm:.1f} mm, {columns[0].source}"
        made.not_used += [f"{one.source}: water vapour, {one.column_mm:.0f} mm" for one in columns[1:]]
    else:
        made.sources["water vapour column"] = f"{OWN}, of its humidity"


def _put_aerosol(made: _Assembly, sizes: list[SizeDistribution], depths: list[AerosolDepth]) -> None:
    aerosol, own = made.data.get("aerosol"), f"{OWN}, {_name_of_particles(made.climate)}"
    made.sources["aerosol sizes and index"] = made.sources["aerosol optical depth"] = own
    if sizes:
        one = sizes[0]
        heights: dict[str, Any] = {}
        if made.climate.aerosol is not None and made.climate.aerosol.type is not None:
            spec = opac_type(made.climate.aerosol.type)
            heights = {"boundary_layer_top_km": spec.boundary_layer_top_km, "scale_height_km": spec.scale_height_km}
        rest = {k: v for k, v in (aerosol or {}).items() if k not in _PARTICLES}
        aerosol = made.data["aerosol"] = {**heights, **rest, "modes": _modes(one)}
        made.sources["aerosol sizes and index"] = one.source
    if not depths:
        return
    if aerosol is None:
        made.not_used += [f"{one.source}: optical depth, the climate has no aerosol to scale" for one in depths]
        return
    first, *others = depths
    nm, depth = first.wavelength_nm, first.optical_depth
    if nm.size == 1 and abs(nm[0] - 550.0) > 1.0:
        made.not_used.append(f"{first.source}: optical depth at {nm[0]:g} nm alone, without an Angstrom exponent")
        return
    for amount in ("optical_depths", "turbidity", "visibility_km"):
        aerosol.pop(amount, None)
    aerosol.pop("optical_depth_550nm", None)
    if nm.size == 1:
        aerosol["optical_depth_550nm"] = float(f"{depth[0]:.{DIGITS}g}")
    else:
        aerosol["optical_depths"] = {"wavelength_nm": _rounded(nm), "optical_depth": _rounded(depth)}
    at_550 = float(depth[0] if nm.size == 1 else optical_depth_at(nm, depth, np.array([550.0]))[0])
    channels = f"{nm.size} channels" if nm.size > 1 else "1 channel"
    made.sources["aerosol optical depth"] = f"{at_550:.3f} at 550 nm ({channels}), {first.source}"
    made.not_used += [f"{one.source}: optical depth" for one in others if one.source != first.source]


_PARTICLES = ("type", "components", "modes", "angstrom", "table", "relative_humidity_percent")
"""Keys of an aerosol that say what its particles are."""


def _name_of_particles(climate: Climate) -> str:
    aerosol = climate.aerosol
    if aerosol is None:
        return "none"
    return aerosol.type or next(name for name in _PARTICLES if getattr(aerosol, name))


def _modes(one: SizeDistribution) -> list[dict[str, Any]]:
    """A narrow log-normal mode for each bin: dV/dln r is the sum of hats in ln r, and a mode has a hat's volume.

    Of a mode with ln sigma = s and a median radius r_m (by number) the volume has its median at r_m exp(3 s^2), and is
    N 4/3 pi r_m^3 exp(4.5 s^2).
    """
    step = float(np.mean(np.diff(np.log(one.radius_um))))
    width = BIN_WIDTH * step
    index = {
        "wavelength_nm": _rounded(one.wavelength_nm),
        "real": _rounded(one.index.real),
        "imaginary": _rounded(-one.index.imag),
    }
    modes = []
    for radius, volume in zip(one.radius_um, one.volume_um3_per_um2, strict=True):
        if volume <= 0.0:
            continue
        median = radius * math.exp(-3.0 * width**2)
        per_um2 = volume * step / (4.0 / 3.0 * math.pi * median**3 * math.exp(4.5 * width**2))
        per_cm3 = per_um2 * 1e8 / (OWN_HEIGHT_KM * 1e5)
        mode = {"number_density_per_cm3": per_cm3, "median_radius_um": median, "sigma": math.exp(width)}
        modes.append({**{k: float(f"{v:.{DIGITS}g}") for k, v in mode.items()}, "refractive_index": dict(index)})
    return modes


def _put_stratosphere(made: _Assembly) -> None:
    climate = made.climate
    own: str | None = climate.stratosphere.kind if climate.stratosphere is not None else None
    if own is None and climate.aerosol is not None:
        own = {"measured": measured_kind(climate.atmosphere.profile)}.get(
            climate.aerosol.stratosphere, climate.aerosol.stratosphere
        )
    made.sources["stratospheric aerosol"] = f"{OWN}, {own or 'none'}"


def _put_clouds(made: _Assembly, waters: list[CloudWater]) -> None:
    if not waters:
        made.sources["clouds"] = f"{OWN}, {len(made.climate.clouds) or 'none'}"
        return
    one = waters[0]
    layers = decks(one)
    total = sum(layer.optical_depth for layer in layers)
    if total > MAX_DEPTH:
        raise TwilightError(
            f"{one.source}: has clouds of optical depth {total:.0f}; allowed is up to {MAX_DEPTH:g}; take a file "
            "without clouds, and set clouds in the climate"
        )
    made.data.pop("clouds", None)
    if layers:
        made.data["clouds"] = [
            {
                "kind": layer.kind,
                "base_km": round(layer.base_km, 3),
                "top_km": round(layer.top_km, 3),
                "optical_depth": float(f"{layer.optical_depth:.4g}"),
            }
            for layer in layers
        ]
    cover = f"at most {100 * most_cover(one):.0f} % of an altitude covered"
    words = ", ".join(f"{layer.kind} {layer.optical_depth:.2g}" for layer in layers) or "none"
    rule = f"from {100 * OVERCAST:.0f} % as overcast, less as clear"
    made.sources["clouds"] = f"{words} ({cover}; {rule}), {one.source}"


def _rounded(values: Any) -> list[float]:
    return [float(f"{float(value):.{DIGITS}g}") for value in values]
