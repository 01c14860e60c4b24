"""The layout of CalcMySky, whose tables are behind Stellarium's sky (`calcmysky`).

    params.atmo                              its description of the atmosphere, version 6
    multiple-scattering-xyzw.f32             X, Y, Z and scotopic luminance [cd m^-2] over VZA, cos of the scattering
    single-scattering/aerosols-xyzw.f32      angle, SZA and altitude; what aerosol scattered once stands without its
                                             phase function, everything else in the first
    transmittance-wlset0.f32 ...             optical depth to the top over VZA and altitude, four wavelengths a file
    irradiance-wlset0.f32 ...                of a horizontal plane [W m^-2 nm^-1] over SZA and altitude, sun and sky
    light-pollution-xyzw.f32                 zeros

A .f32 file is its sizes in uint16 and then float32, RGBA, little-endian, the first size fastest.  Axes are those of
`solvers.tables.mapping` (bruneton2017) down to the sun in the nadir.  Texels are read from tables of the layout
`twilight` in the same four luminances, at more altitudes, with the errors of that layout; below its lowest sun they
stay as they are there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.errors import TwilightError
from twilight.export import own
from twilight.export.values import Source, read_phase
from twilight.solvers.tables.mapping import BRUNETON_2017, Mapping, grid
from twilight.solvers.tables.passes import fill_depth
from twilight.spectrum import colour_matching_functions, integrate
from twilight.tone.eye import scotopic_efficiency
from twilight.transport.profile import prepare_profile

WAVELENGTHS_NM = tuple(float(v) for v in np.linspace(360.0, 830.0, 16))
"""Four to a file of transmittance or irradiance."""
ALTITUDES_KM = (0.0, 0.5, 2.0, 5.0, 10.0, 20.0, 40.0)
"""Of the tables that texels are read from, and the top of the air."""
PHOTOPIC_LM_PER_W, SCOTOPIC_LM_PER_W = 683.002, 1700.13
"""Of the program."""
PHASE_NODES, DENSITY_NODES = 64, 48
SECTION_UM2 = 0.05
"""Nominal cross section of the aerosol at 1 um; with it the number density is whatever gives the extinction."""
SOURCE = own.Sizes()
OTHER_KEYS = {
    "eclipsed scattering texture size for relative azimuth": 32,
    "eclipsed scattering texture size for VZA": 128,
    "eclipsed double scattering texture size for relative azimuth": 16,
    "eclipsed double scattering texture size for VZA": 128,
    "eclipsed double scattering texture size for SZA": 16,
    "eclipsed double scattering number of azimuth pairs to sample": 2,
    "eclipsed double scattering number of elevation pairs to sample": 10,
    "light pollution angular integration points": 200,
    "transmittance integration points": 500,
    "radial integration points": 50,
    "angular integration points": 512,
    "angular integration points for eclipse": 512,
    "scattering orders": 4,
    "Earth-Sun distance": "1 AU",
    "Earth-Moon distance": "384400 km",
}
"""What the program wants to be told and these tables have no part in."""


@dataclass(frozen=True)
class Sizes:
    """Texels of the scattering tables, and of transmittance (VZA, altitude) and irradiance (SZA)."""

    vza: int = 128
    dot: int = 16
    sza: int = 128
    altitude: int = 64
    transmittance_vza: int = 256
    transmittance_altitude: int = 64
    irradiance_sza: int = 64

    def mapping(self, source: Source) -> Mapping:
        m = source.medium
        return Mapping(
            BRUNETON_2017, m.earth_radius_km + m.bottom_km, m.top_km - m.bottom_km, -1.0,
            self.altitude, self.vza, self.sza, self.dot, self.transmittance_altitude, self.transmittance_vza, 2,
            self.irradiance_sza,
        )  # fmt: skip


class Luminances:
    """A source whose radiance has the program's four channels, in reverse order, without the ground in view."""

    channels = 4

    def __init__(self, source: Source, solar_irradiance: np.ndarray, solar_at_visible: np.ndarray):
        """solar_irradiance (W,) at the source's wavelengths, solar_at_visible (471,) from 360 nm [W m^-2 nm^-1]."""
        self.source, self.solar = source, solar_irradiance
        cones = PHOTOPIC_LM_PER_W * colour_matching_functions("cie1931_2deg")
        weight = np.concatenate([cones, SCOTOPIC_LM_PER_W * scotopic_efficiency()[:, None]], axis=1)
        self._weight = weight * solar_at_visible[:, None]
        assert source.phase is not None
        # achromatic there: the mean over Y, at nodes of the shader
        share = self._weight[:, 1]
        fine = self._of(source.phase, share) / share.sum()
        nodes = np.exp(np.interp(np.linspace(0.0, 1.0, PHASE_NODES), np.linspace(0.0, 1.0, fine.size), np.log(fine)))
        self.phase: np.ndarray | None = np.repeat(nodes[:, None], 4, axis=1)

    def _of(self, factor: np.ndarray, weight: np.ndarray) -> np.ndarray:
        return integrate(np.maximum(factor, 0.0), self.source.medium.wavelength_nm, weight)

    @property
    def bottom_km(self) -> float:
        return self.source.bottom_km

    def horizon_deg(self, altitude_km: float) -> float:
        return self.source.horizon_deg(altitude_km)

    def radiance(self, altitude_km: float, sun_deg: float, elevation_deg, azimuth_deg) -> np.ndarray:
        seen = self.source.inscattered(altitude_km, sun_deg, elevation_deg, azimuth_deg)
        return self._of(seen, self._weight)[..., ::-1]

    def single_aerosol(self, altitude_km: float, elevation_deg, azimuth_deg, sun_deg) -> tuple[np.ndarray, np.ndarray]:
        with_phase, without = self.source.single_aerosol(altitude_km, elevation_deg, azimuth_deg, sun_deg)
        return self._of(with_phase, self._weight)[..., ::-1], self._of(without, self._weight)[..., ::-1]

    def phase_at(self, cosine: np.ndarray) -> np.ndarray:
        assert self.phase is not None
        return read_phase(self.phase, cosine)


def check(medium: Medium) -> None:
    """Raise TwilightError for air that the layout does not hold."""
    if not medium.has_aerosol:
        raise TwilightError(
            f"--layout calcmysky: its tables keep aerosol apart and {medium.name or 'the air'} has none"
        )


def fill(
    source: Source,
    solar_irradiance: np.ndarray,
    solar_at_visible: np.ndarray,
    *,
    facts: dict,
    progress: Callable[[str, float], None],
    sizes: Sizes | None = None,
    source_sizes: own.Sizes = SOURCE,
) -> dict[str, bytes]:
    """Name and content of every file.

    solar_irradiance (W,) at the source's wavelengths, which are evenly spaced and a multiple of four.
    Errors: TwilightError for air without aerosol.
    """
    sizes = sizes or Sizes()
    medium = source.medium
    check(medium)
    mapping = sizes.mapping(source)
    light = Luminances(source, solar_irradiance, solar_at_visible)
    inner = [medium.bottom_km + z for z in ALTITUDES_KM if z < 0.9 * mapping.thickness_km]
    altitudes = (*inner, medium.top_km)
    between = replace(source_sizes, altitude_km=altitudes)
    made = own.fill(light, between, {}, lambda doing, share: progress(doing, 0.8 * share))
    rest, once = texels(made, mapping, lambda share: progress("texels", 0.8 + 0.15 * share))
    dims = (sizes.vza, sizes.dot, sizes.sza, sizes.altitude)
    out: dict[str, bytes] = {
        "params.atmo": description(source, light, sizes, facts).encode(),
        "multiple-scattering-xyzw.f32": texture(rest, dims),
        "single-scattering/aerosols-xyzw.f32": texture(once, dims),
        "light-pollution-xyzw.f32": texture(np.zeros((sizes.altitude, sizes.vza, 4)), (sizes.vza, sizes.altitude)),
    }
    depth = np.zeros((mapping.n_t_r, mapping.n_t_mu, medium.n_wavelengths))
    fill_depth(prepare_profile(medium), mapping, depth, 0, mapping.n_t_r)
    ground = irradiance(source, sizes.irradiance_sza) * solar_irradiance
    for k in range(medium.n_wavelengths // 4):
        four = slice(4 * k, 4 * k + 4)
        out[f"transmittance-wlset{k}.f32"] = texture(
            depth[..., four], (sizes.transmittance_vza, sizes.transmittance_altitude)
        )
        out[f"irradiance-wlset{k}.f32"] = texture(ground[..., four], (sizes.irradiance_sza, 2))
    return out


def texture(values: np.ndarray, sizes: tuple[int, ...]) -> bytes:
    """A .f32 file of values (last size, ..., first size, 4)."""
    assert values.shape == (*sizes[::-1], 4)
    return np.array(sizes, "<u2").tobytes() + np.ascontiguousarray(values, "<f4").tobytes()


def texels(tables: own.SkyTables, mapping: Mapping, progress: Callable[[float], None]) -> tuple[np.ndarray, np.ndarray]:
    """(everything else, what aerosol scattered once without its phase function), each (altitude, SZA, dot, VZA, 4)."""
    assert tables.aureole is not None
    heights, view, sun, nus = grid(mapping)
    shape = (heights.size, sun.size, nus.size, mapping.n_mu, 4)
    rest, once = np.empty(shape, np.float32), np.empty(shape, np.float32)
    header = tables.header
    roots = np.sqrt(np.array(header["altitude_km"]) - header["ground_km"])
    n_ground, n_sky = header["texels"]["ground"], header["texels"]["sky"]
    ground = 2 * np.arange(mapping.n_mu) < mapping.n_mu
    least = np.where(ground, 0, n_ground)
    most = np.where(ground, n_ground, n_ground + n_sky) - 2
    low, high = own.sun_position(header["lowest_sun_deg"]), own.sun_position(90.0)
    suns = np.maximum(np.degrees(np.arcsin(sun)), header["lowest_sun_deg"])
    at_sun = (own.sun_position(suns) - low) / (high - low) * (tables.sky.shape[1] - 1)
    by_sun = [np.moveaxis(_between(np.moveaxis(t, 1, 0), at_sun), 0, 1) for t in (tables.sky, tables.aureole)]
    for k, height in enumerate(heights):
        at = np.array([np.interp(math.sqrt(height), roots, np.arange(roots.size))])
        horizon = _between(np.array(header["horizon_deg"]), at)[0]
        elevation = np.degrees(np.arcsin(view[k]))
        u = np.where(ground, (horizon - elevation) / (90.0 + horizon), (elevation - horizon) / (90.0 - horizon))
        u = np.sqrt(np.clip(u, 0.0, 1.0))
        row = np.where(ground, (1.0 - u) * (n_ground - 1), n_ground + u * (n_sky - 1))
        azimuth = _azimuth_position(view[k], sun, nus, tables.sky.shape[3])
        for part, table in zip((rest, once), by_sun, strict=True):
            rows = np.moveaxis(_between(np.moveaxis(_between(table, at)[0], 1, 0), row, least, most), 0, 1)
            i = np.clip(azimuth.astype(int), 0, rows.shape[2] - 2)
            near, far = (np.take_along_axis(rows, (i + n)[..., None], axis=2) for n in (0, 1))
            part[k] = np.exp(near + (far - near) * (azimuth - i)[..., None]).swapaxes(1, 2)
        progress((k + 1) / heights.size)
    return rest, once


def _between(table: np.ndarray, position: np.ndarray, least=0, most=None) -> np.ndarray:
    """Linear interpolation along the first axis; the lower neighbours lie from least to most."""
    i = np.clip(position.astype(int), least, table.shape[0] - 2 if most is None else most)
    f = (position - i).reshape(-1, *[1] * (table.ndim - 1))
    return table[i] * (1.0 - f) + table[i + 1] * f


def _azimuth_position(view: np.ndarray, sun: np.ndarray, nus: np.ndarray, count: int) -> np.ndarray:
    """Positions (SZA, VZA, dot) on the axis of azimuth of the layout `twilight`; impossible angles at its ends."""
    level = (view * sun[:, None])[..., None]
    across = np.sqrt(np.maximum(0.0, (1.0 - view**2) * (1.0 - sun[:, None] ** 2)))[..., None]
    cosine = np.divide(nus - level, across, out=np.ones((*level.shape[:2], nus.size)), where=across > 1e-9)
    azimuth = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return (azimuth / 180.0) ** (1.0 / own.AZIMUTH_POWER) * (count - 1)


def irradiance(source: Source, count: int) -> np.ndarray:
    """Over F0 (altitude 2, SZA, W), of a plane on the ground, by what a white one reflects, and at the top."""
    mu_s = np.linspace(-1.0, 1.0, count)
    out = np.zeros((2, count, source.medium.n_wavelengths))
    albedo = source.medium.ground_albedo
    seen = source.ground(np.degrees(np.arcsin(mu_s)))
    out[0] = np.pi * np.divide(seen, albedo, out=np.zeros_like(seen), where=albedo > 0.0)
    out[1] = np.maximum(mu_s, 0.0)[:, None]
    return out


def description(source: Source, light: Luminances, sizes: Sizes, facts: dict) -> str:
    """params.atmo.  Its constituents are for the shaders; the tables are not made from them."""
    medium, nm = source.medium, source.medium.wavelength_nm
    thickness = medium.top_km - medium.bottom_km
    heights = np.linspace(0.0, 1.0, DENSITY_NODES) ** 2 * thickness
    at = medium.at(medium.bottom_km + heights)
    keys = {
        "wavelengths": f"min={nm[0]:g}nm,max={nm[-1]:g}nm,count={nm.size}",
        "solar irradiance at TOA": _numbers(light.solar),
        "ground albedo": _numbers(medium.ground_albedo),
        "light pollution relative radiance": _numbers(np.zeros(nm.size)),
        "transmittance texture size for VZA": sizes.transmittance_vza,
        "transmittance texture size for altitude": sizes.transmittance_altitude,
        "irradiance texture size for SZA": sizes.irradiance_sza,
        "irradiance texture size for altitude": 2,
        "scattering texture size for VZA": sizes.vza,
        "scattering texture size for dot(view,sun)": sizes.dot,
        "scattering texture size for SZA": sizes.sza,
        "scattering texture size for altitude": sizes.altitude,
        **OTHER_KEYS,
        "light pollution texture size for VZA": sizes.vza,
        "light pollution texture size for altitude": sizes.altitude,
        "Earth radius": f"{medium.earth_radius_km + medium.bottom_km:.6f} km",
        "atmosphere height": f"{thickness:.6f} km",
    }
    made_by = ", ".join(f"{key} {facts[key]}" for key in ("program", "climate", "solver", "quality") if key in facts)
    lines = [
        "version: 6",
        "no eclipsed double scattering textures",
        f"# {made_by}",
        "# The textures hold a solved sky; the constituents below describe its air for the shaders alone.",
        *(f"{key}: {value}" for key, value in keys.items()),
    ]
    extinction = np.maximum(at.aerosol_extinction, 1e-30)
    green = int(np.argmin(np.abs(nm - 550.0)))
    slope = float(np.clip(-np.polyfit(np.log(nm), np.log(extinction[0]), 1)[0], -10.0, 10.0))
    section_m2 = SECTION_UM2 * 1e-12 * (nm[green] / 1000.0) ** -slope
    assert light.phase is not None
    logs = ", ".join(f"{v:.6e}" for v in np.log(light.phase[:, 0]))
    lines += [
        'Scatterer "aerosols":',
        "{",
        "    number density:",
        *_density(heights, extinction[:, green] * 1e-3 / section_m2),
        "    phase function:",
        "    ```",
        f"        const float node[{PHASE_NODES}] = float[{PHASE_NODES}]({logs});",
        f"        float u = sqrt(acos(clamp(dotViewSun, -1.0, 1.0)) / PI) * {PHASE_NODES - 1}.0;",
        f"        int i = min(int(u), {PHASE_NODES - 2});",
        "        return vec4(exp(mix(node[i], node[i + 1], u - float(i))));",
        "    ```",
        f"    cross section at 1 um: {SECTION_UM2:.3f} um^2",
        f"    angstrom exponent: {slope:.4f}",
        f"    single scattering albedo: {_numbers(np.clip(at.aerosol_albedo[0], 0.0, 1.0))}",
        "    phase function type: achromatic",
        "}",
    ]
    for name, part in (("molecules", at.air_scattering), ("gases", at.absorption)):
        # where the strongest wavelength is at its most
        level, strongest = np.unravel_index(np.argmax(part), part.shape)
        if part[level, strongest] > 0.0:
            lines += [
                f'Absorber "{name}":',
                "{",
                "    number density:",
                *_density(heights, part[:, strongest] / part[level, strongest]),
                f"    cross section: {_numbers(part[level] * 1e-3)}",
                "}",
            ]
    return "\n".join(lines) + "\n"


def _density(heights_km: np.ndarray, density: np.ndarray) -> list[str]:
    """Lines of GLSL that return a density at `altitude` [m], its logarithm linear between heights thickness u^2."""
    logs = np.log(np.maximum(density, 1e-20 * density.max()))
    count = heights_km.size
    return [
        "    ```",
        f"        const float node[{count}] = float[{count}]({', '.join(f'{v:.6e}' for v in logs)});",
        f"        float u = sqrt(clamp(altitude / {heights_km[-1] * 1000.0:.3f}, 0.0, 1.0)) * {count - 1}.0;",
        f"        int i = min(int(u), {count - 2});",
        "        return exp(mix(node[i], node[i + 1], u - float(i)));",
        "    ```",
    ]


def _numbers(values: np.ndarray) -> str:
    return ",".join(f"{v:.7g}" for v in values)


__all__ = ["WAVELENGTHS_NM", "Luminances", "Sizes", "check", "description", "fill", "texels", "texture"]
