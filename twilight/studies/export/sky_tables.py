"""The layout `twilight`: logarithms of radiance over sun, elevation and azimuth, single aerosol scattering apart.

    radiance = exp(sky) + P(scattering angle) exp(aureole)

P is the phase function of the column's aerosol.  Axes, with u from 0 to 1 over the texels of each:

    sun elevation   -8 + 8 sinh(t), t uniform from the lowest to the highest sun
    elevation       sky: e_h + (90 - e_h) u^2; ground: e_h - (90 + e_h) u^2, e_h the apparent horizon at the altitude
    azimuth         180 u^1.5, from the sun
    altitude        as listed, linear in the square root of its height above ground_km in between

Files hold little-endian float32, RGB: azimuth fastest, then elevation (ground from the nadir, then sky from the
horizon), sun, altitude.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from twilight.base.errors import TwilightError
from twilight.studies.export.field_values import JUST_DEG, FieldSource, read_phase

SUN_CENTRE_DEG = -8.0
"""Elevation of the sun where texels are closest [deg]."""

SUN_WIDTH_DEG = 8.0
"""Distance from SUN_CENTRE_DEG over which texels stay close [deg]."""

LOWEST_SUN_DEG = -20.0
"""Lowest elevation of the sun in the tables [deg]."""

AZIMUTH_POWER = 1.5
"""Azimuth from the sun goes with this power of the texel."""

FAINT = 1e-5
"""Fraction of the rest below which the aureole is not followed into the shadow."""


@dataclass(frozen=True)
class SkyTableSizes:
    """Texels of each axis, and the altitudes of the observer [km]."""

    suns: int = 112
    sky: int = 36
    ground: int = 12
    azimuths: int = 24
    altitude_km: tuple[float, ...] = (0.0, 2.0, 10.0, 30.0, 100.0)


def altitudes_of(bottom_km: float, top_km: float) -> tuple[float, ...]:
    """Altitudes of the observer [km] between the ground and the top of the air."""
    inner = tuple(bottom_km + z for z in SkyTableSizes().altitude_km[:-1] if bottom_km + z < 0.9 * top_km)
    return (*inner, top_km)


def sun_coordinate(elevation_deg):
    """Elevations of the sun [deg] as they run evenly along the texels, in no unit."""
    return np.arcsinh((elevation_deg - SUN_CENTRE_DEG) / SUN_WIDTH_DEG)


def sun_nodes(count: int) -> np.ndarray:
    """Elevations of the sun [deg] of the texels."""
    low, high = sun_coordinate(LOWEST_SUN_DEG), sun_coordinate(90.0)
    return np.minimum(90.0, SUN_CENTRE_DEG + SUN_WIDTH_DEG * np.sinh(np.linspace(low, high, count)))


def elevation_nodes(horizon_deg: float, ground: int, sky: int) -> np.ndarray:
    """Elevations [deg] of the texels: of the ground from the nadir up, then of the sky from the horizon up."""
    below = horizon_deg - (90.0 + horizon_deg) * np.linspace(1.0, 0.0, ground) ** 2
    above = horizon_deg + (90.0 - horizon_deg) * np.linspace(0.0, 1.0, sky) ** 2
    below[-1] -= JUST_DEG
    above[0] += JUST_DEG
    return np.concatenate([below, above])


def azimuth_nodes(count: int) -> np.ndarray:
    """Azimuths from the sun [deg] of the texels."""
    return 180.0 * np.linspace(0.0, 1.0, count) ** AZIMUTH_POWER


@dataclass(frozen=True)
class SkyTables:
    """sky, aureole (altitude, sun, elevation, azimuth, W): logarithms; phase (N, W); horizon_deg (altitude,).

    W: red, green, blue.  aureole and phase are None in air without aerosol.
    """

    header: dict
    sky: np.ndarray
    aureole: np.ndarray | None
    phase: np.ndarray | None

    def radiance(
        self, sun_elevation_deg: float, elevation_deg, azimuth_deg, *, observer_altitude_km: float = 0.0
    ) -> np.ndarray:
        """Sun-normalised radiance [sr^-1] of red, green and blue, read as the shader does: shape of the directions + 3.

        Errors: TwilightError for a sun below the tables' lowest or an altitude outside them.
        """
        h = self.header
        low = h["lowest_sun_deg"]
        altitudes = np.array(h["altitude_km"])
        if not low <= sun_elevation_deg <= 90.0:
            raise TwilightError(f"sun.elevation_deg is {sun_elevation_deg:g}; the tables hold {low:g} to 90")
        if not altitudes[0] <= observer_altitude_km <= altitudes[-1]:
            raise TwilightError(
                f"observer.altitude_km is {observer_altitude_km:g}; the tables hold {altitudes[0]:g} to "
                f"{altitudes[-1]:g}"
            )
        elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        e, a = elevation.ravel(), np.abs((azimuth.ravel() + 180.0) % 360.0 - 180.0)
        t, first_t, last_t = (sun_coordinate(v) for v in (sun_elevation_deg, low, 90.0))
        n_sun, n_azimuth = self.sky.shape[1], self.sky.shape[3]
        s = float((t - first_t) / (last_t - first_t)) * (n_sun - 1)
        z = (a / 180.0) ** (1.0 / AZIMUTH_POWER) * (n_azimuth - 1)
        roots = np.sqrt(altitudes - h["ground_km"])
        where = float(np.interp(math.sqrt(observer_altitude_km - h["ground_km"]), roots, np.arange(roots.size)))
        first = min(int(where), max(0, roots.size - 2))
        above = where - first
        horizon = np.interp(where, np.arange(roots.size), h["horizon_deg"])
        channels = self.sky.shape[-1]
        total = np.zeros((2, e.size, channels))
        up = e >= horizon
        n_ground = h["texels"]["ground"]
        for i, weight in ((first, 1.0 - above), (first + 1, above)):
            if weight == 0.0:
                continue
            u = np.sqrt(np.clip(np.where(up, (e - horizon) / (90 - horizon), (horizon - e) / (90 + horizon)), 0, 1))
            y = np.where(up, n_ground + u * (h["texels"]["sky"] - 1), (1.0 - u) * (n_ground - 1))
            for k, table in enumerate((self.sky, self.aureole)):
                if table is not None:
                    total[k] += weight * _trilinear(table[i], s, y, z, np.where(up, n_ground, 0), n_ground)
        out = np.exp(total[0])
        if self.phase is not None:
            sun = math.radians(sun_elevation_deg)
            cosine = np.sin(np.radians(e)) * math.sin(sun) + np.cos(np.radians(e)) * math.cos(sun) * np.cos(
                np.radians(a)
            )
            out += read_phase(self.phase, cosine) * np.exp(total[1])
        return out.reshape(*elevation.shape, channels)

    @property
    def n_bytes(self) -> int:
        """Size of the files but the header."""
        return sum(t.astype(np.float32).nbytes for t in (self.sky, self.aureole, self.phase) if t is not None)

    def files(self) -> dict[str, bytes]:
        """Name and content of every file; sky.glsl reads the others."""
        out = {"sky.json": (json.dumps(self.header, indent=1) + "\n").encode()}
        out["sky.glsl"] = resources.files("twilight").joinpath("viewer", "web", "sky.glsl").read_bytes()
        for name, table in (("sky.bin", self.sky), ("aureole.bin", self.aureole), ("phase.bin", self.phase)):
            if table is not None:
                out[name] = np.ascontiguousarray(table, "<f4").tobytes()
        return out


def _trilinear(table: np.ndarray, s: float, y: np.ndarray, z: np.ndarray, first: np.ndarray, n_ground: int):
    """(D, W) of one altitude; elevations do not mix ground and sky."""
    i = min(int(s), table.shape[0] - 2)
    last = np.where(first > 0, table.shape[1], n_ground) - 2
    j = np.clip(y.astype(int), first, last)
    k = np.clip(z.astype(int), 0, table.shape[2] - 2)
    out = np.zeros((y.size, table.shape[3]))
    for di, wi in ((0, i + 1 - s), (1, s - i)):
        for dj, wj in ((0, j + 1 - y), (1, y - j)):
            for dk, wk in ((0, k + 1 - z), (1, z - k)):
                out += (wi * wj * wk)[:, None] * table[i + di, j + dj, k + dk]
    return out


def fill(source: FieldSource, sizes: SkyTableSizes, facts: dict, progress: Callable[[str, float], None]) -> SkyTables:
    """The tables of a field.  facts go into the header."""
    suns, azimuths = sun_nodes(sizes.suns), azimuth_nodes(sizes.azimuths)
    shape = (len(sizes.altitude_km), sizes.suns, sizes.ground + sizes.sky, sizes.azimuths, source.medium.n_wavelengths)
    sky, aureole = np.empty(shape), np.zeros(shape)
    horizons = []
    for i, altitude in enumerate(sizes.altitude_km):
        horizon = source.horizon_deg(altitude)
        horizons.append(horizon)
        elevation = elevation_nodes(horizon, sizes.ground, sizes.sky)
        grid = np.meshgrid(elevation, azimuths, indexing="ij")
        for j, sun in enumerate(suns):
            sky[i, j] = source.radiance(altitude, float(sun), *grid)[..., ::-1]
            progress(f"altitude {altitude:g} km", (i + (j + 1) / suns.size) / shape[0])
        if source.phase is not None:
            light = source.single_aerosol(altitude, elevation, azimuths, suns)[..., ::-1]
            e, s = np.radians(elevation), np.radians(suns)[:, None, None]
            cosine = np.sin(s) * np.sin(e)[:, None] + np.cos(s) * np.cos(e)[:, None] * np.cos(np.radians(azimuths))
            # what is taken out must leave something to take a logarithm of
            light = np.minimum(light, 0.98 * sky[i])
            phase = source.phase_at(cosine)[..., ::-1]
            sky[i] -= light
            aureole[i] = np.maximum(light, FAINT * sky[i]) / phase
    header = {
        **facts,
        "layout": "twilight",
        "version": 1,
        "texels": {"sun": sizes.suns, "ground": sizes.ground, "sky": sizes.sky, "azimuth": sizes.azimuths},
        "altitude_km": list(sizes.altitude_km),
        "ground_km": source.medium.bottom_km,
        "horizon_deg": horizons,
        "lowest_sun_deg": LOWEST_SUN_DEG,
        "phase_angles": 0 if source.phase is None else source.phase.shape[0],
        "axes": (__doc__ or "").partition("from 0 to 1 over the texels of each:")[2].strip(),
        "quantity": "natural logarithm of radiance over the sun's irradiance above the air [sr^-1]; RGB, float32",
    }
    sky = np.log(np.maximum(sky, 1e-30)).astype(np.float32)
    if source.phase is None:
        return SkyTables(header, sky, None, None)
    return SkyTables(
        header, sky, np.log(np.maximum(aureole, 1e-35)).astype(np.float32), source.phase[:, ::-1].astype(np.float32)
    )


def load(folder: str | Path) -> SkyTables:
    """The tables of a folder.

    Errors: TwilightError for a folder that does not hold them whole.
    """
    folder = Path(folder)
    try:
        header = json.loads((folder / "sky.json").read_text(encoding="utf-8"))
        if header["layout"] != "twilight" or header["version"] != 1:
            raise TwilightError(
                f"{folder}/sky.json: layout {header['layout']} {header['version']}, expected twilight 1"
            )
        n = header["texels"]
        if not header["ground_km"] <= header["altitude_km"][0]:
            raise TwilightError(f"{folder}/sky.json: altitude_km begins below ground_km, {header['ground_km']:g}")
        shape = (len(header["altitude_km"]), n["sun"], n["ground"] + n["sky"], n["azimuth"], 3)
        sky = np.fromfile(folder / "sky.bin", "<f4").reshape(shape)
        if not header["phase_angles"]:
            return SkyTables(header, sky, None, None)
        aureole = np.fromfile(folder / "aureole.bin", "<f4").reshape(shape)
        phase = np.fromfile(folder / "phase.bin", "<f4").reshape(header["phase_angles"], 3)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise TwilightError(f"{folder}: does not hold whole tables ({error})") from None
    return SkyTables(header, sky, aureole, phase)
