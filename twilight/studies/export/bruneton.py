"""The layouts of Bruneton's code of 2017 (`bruneton2017`) and of @takram/three-atmosphere (`takram`).

    transmittance 256 x 64 (mu, r), irradiance 64 x 16 (mu_s, r), scattering 256 x 128 x 32: x = nu index * 32 + mu_s
    index, y = mu, z = r; RGBA, headerless, little-endian

Their shaders read `C P_R(nu) + M P_M(nu)`, with C the RGB of scattering and M from its alpha, the red of it, as
C (M_r / C_r) (beta_R,r / beta_M,r) (beta_M / beta_R); in aerial perspective, not in the sky, they fade M out where mu_s
falls from 0.01 to 0.  Above that alpha is what aerosol scattered once without its phase function, below 0; C is such
that the sum is the field's radiance at the texel.

@takram/three-atmosphere reads two more textures of the size of scattering where they are there: single Mie scattering
in all three colours, and C of what was scattered more than once (with all else that is not light that air scattered
once), which it does not dim in the shadows of mountains and clouds.  Its other file format is OpenEXR: the slices of r
below each other and the whole upside down.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import ArrayLike

from twilight.base.errors import TwilightError
from twilight.numerics.spectrum import (
    LUMINOUS_EFFICACY_LM_PER_W,
    VISIBLE_NM,
    colour_matching_functions,
    solar_at_visible,
    xyz_to_rgb_matrix,
)
from twilight.sky.disc import SOLAR_RADIUS_DEG
from twilight.solvers.tables.lookup import optical_depth_to_top
from twilight.solvers.tables.mapping import BRUNETON_2017, Mapping, grid
from twilight.solvers.tables.passes import fill_depth, read
from twilight.solvers.tables.solve import stored
from twilight.studies.export.field_values import FieldSource
from twilight.studies.export.texel_light import sky_irradiance, texel_light
from twilight.transport.profile import Profile, prepare_profile

LARGEST_HALF = 65504.0
"""Largest number of a half float."""
OBSERVER = "cie1931_2deg"
"""Colour matching functions of Rec. 709."""
SKY_EXPONENT = -3.0
"""Of the wavelength, by which skylight differs from sunlight (Bruneton 2017)."""
FADED_MU_S = 0.01
"""The shaders fade single Mie scattering out of aerial perspective below this."""
MOST_SINGLE = 0.9
"""Largest fraction of red light that may be left to what aerosol scattered once."""


def luminance_factors(wavelength_nm: ArrayLike, exponent: float) -> np.ndarray:
    """Linear Rec. 709 [cd m^-2] over radiance [W m^-2 sr^-1 nm^-1] at its wavelength, for red, green and blue (3,).

    The spectrum beside each of them is taken as that of the sun times a power of the wavelength, as in the function
    ComputeSpectralRadianceToLuminanceFactors of Bruneton's code.
    """
    responses = colour_matching_functions(OBSERVER) @ xyz_to_rgb_matrix(OBSERVER).T  # (N, 3)
    sun = solar_at_visible()
    return np.array(
        [
            LUMINOUS_EFFICACY_LM_PER_W
            * np.sum(response * sun / np.interp(centre, VISIBLE_NM, sun) * (VISIBLE_NM / centre) ** exponent)
            for response, centre in zip(responses.T, np.asarray(wavelength_nm, dtype=float), strict=True)
        ]
    )


def make_mapping(bottom_km: float, top_km: float) -> Mapping:
    """The sizes of both layouts; mu_s down to the cosine of 120 deg."""
    return Mapping(BRUNETON_2017, bottom_km, top_km - bottom_km, -0.5, 32, 128, 32, 8, 64, 256, 16, 64)


def phase_of(g: float, nu: np.ndarray) -> np.ndarray:
    """The Mie phase function of both shaders: Cornette and Shanks."""
    k = 3.0 / (8.0 * math.pi) * (1.0 - g * g) / (2.0 + g * g)
    return k * (1.0 + nu**2) / ((1.0 - g) ** 2 + 2.0 * g * (1.0 - nu)) ** 1.5


@dataclass(frozen=True)
class BrunetonTables:
    """scattering (r, mu_s, nu, mu, 4), transmittance (r, mu, 3), irradiance (r, mu_s, 3): red, green, blue first.

    single_mie (r, mu_s, nu, mu, 3): what aerosol scattered once at every wavelength; None: it follows from alpha.
    higher_order (r, mu_s, nu, mu, 3): RGB of scattering less what air scattered once; None: it is not apart.
    All but transmittance hold the sun's irradiance above the air times `scale`.
    """

    mapping: Mapping
    constants: dict
    scattering: np.ndarray
    transmittance: np.ndarray
    irradiance: np.ndarray
    single_mie: np.ndarray | None = None
    higher_order: np.ndarray | None = None

    def rgba(self) -> dict[str, np.ndarray]:
        """The textures as they are laid out, (z, y, x, 4) or (y, x, 4)."""
        out = {
            "transmittance": _with_alpha(self.transmittance),
            "scattering": _volume(self.scattering),
            "irradiance": _with_alpha(self.irradiance),
        }
        more = {"single_mie_scattering": self.single_mie, "higher_order_scattering": self.higher_order}
        return out | {name: _volume(_with_alpha(texels)) for name, texels in more.items() if texels is not None}

    def files(self, suffix: str, half: bool) -> dict[str, bytes]:
        """Name and content of every file; the suffix `exr` is OpenEXR.

        Errors: TwilightError where half floats cannot hold the largest value.
        """
        out = {"tables.json": (json.dumps(self.constants, indent=1) + "\n").encode()}
        for name, texture in self.rgba().items():
            if half and np.max(texture) > LARGEST_HALF:
                raise TwilightError(
                    f"--scale: {name} reaches {np.max(texture):.3g} with it, half floats hold up to {LARGEST_HALF:g}"
                )
            numbers = np.ascontiguousarray(texture, "<f2" if half else "<f4")
            out[f"{name}.{suffix}"] = _open_exr(numbers) if suffix == "exr" else numbers.tobytes()
        return out


def _open_exr(texture: np.ndarray) -> bytes:
    """An OpenEXR file of a texture (z, y, x, 4) or (y, x, 4): slices below each other, the last row first."""
    import OpenEXR  # start-up

    rows = np.ascontiguousarray(texture.reshape(-1, *texture.shape[-2:])[::-1])
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with TemporaryDirectory() as folder, OpenEXR.File(header, {"RGBA": rows}) as file:
        path = Path(folder) / "texture.exr"
        file.write(str(path))
        return path.read_bytes()


def _with_alpha(texture: np.ndarray) -> np.ndarray:
    return np.concatenate([texture, np.ones((*texture.shape[:-1], 1))], axis=-1)


def _volume(texture: np.ndarray) -> np.ndarray:
    r, mu_s, nu, mu, _ = texture.shape
    return texture.transpose(0, 3, 2, 1, 4).reshape(r, mu, nu * mu_s, 4)


def fill(
    source: FieldSource,
    solar_irradiance: np.ndarray,
    *,
    mapping: Mapping,
    scale: float,
    facts: dict,
    progress: Callable[[str, float], None],
    rows: int = 32,
    separate: bool = False,
    higher_order: bool = False,
) -> BrunetonTables:
    """The tables of a field; solar_irradiance (3,) [W m^-2 nm^-1], shortest wavelength first.

    mapping: as `make_mapping` has it; heights above its ground stay what they are.  rows: how many of the rows of r are
    filled, from the ground up.  separate: with `single_mie`; higher_order: with that.
    """
    medium = source.medium
    heights, _, sun, _ = grid(mapping)
    if heights[-1] > medium.top_km - medium.bottom_km + 1e-6:
        raise TwilightError(
            f"--layout: its air reaches up to {heights[-1]:g} km, that of the climate to {medium.top_km:g} km"
        )
    rows = min(rows, mapping.n_r)
    scattering = np.zeros((mapping.n_r, mapping.n_mu_s, mapping.n_nu, mapping.n_mu, 4))
    single = np.zeros((*scattering.shape[:-1], 3))
    more = np.zeros_like(single) if higher_order else None
    g = _asymmetry(source)
    at = medium.at(medium.bottom_km)
    beta_r, beta_m = at.air_scattering, at.aerosol_scattering
    ratio = (beta_m / beta_m[-1]) * (beta_r[-1] / beta_r) if source.phase is not None else np.zeros(3)
    lit = sun >= FADED_MU_S
    for i, (nu, light, once) in enumerate(
        texel_light(source, mapping, rows, lambda x: progress("scattering", 0.9 * x))
    ):
        # what aerosol scattered once, with and without its phase functions
        true, bare = (np.where(lit[:, None, None, None], part, 0.0) for part in (once.aerosol, once.bare))
        for j in range(mapping.n_mu_s):
            packed = _packed(light[j], nu[j], true[j], bare[j], g, None if separate else ratio)
            scattering[i, j], single[i, j] = (part.transpose(1, 0, 2) for part in packed)
        if more is not None:
            more[i] = np.maximum(scattering[i, ..., :3] - once.air[..., ::-1].swapaxes(1, 2), 0.0)
    scattering *= np.append(solar_irradiance[::-1], solar_irradiance[-1]) * scale
    single *= solar_irradiance[::-1] * scale
    if more is not None:
        more *= solar_irradiance[::-1] * scale
    depth = np.zeros((mapping.n_t_r, mapping.n_t_mu, 3))
    fill_depth(_unscaled(source, mapping.bottom_km), mapping, depth, 0, mapping.n_t_r)
    progress("irradiance", 0.95)
    irradiance = sky_irradiance(source, mapping, min(rows, mapping.n_e_r))[..., ::-1] * solar_irradiance[::-1] * scale
    volume = {"size": [mapping.n_nu * mapping.n_mu_s, mapping.n_mu, mapping.n_r], "axes": ["nu, mu_s", "mu", "r"]}
    textures = {
        "transmittance": {"size": [mapping.n_t_mu, mapping.n_t_r], "axes": ["mu", "r"]},
        "irradiance": {"size": [mapping.n_e_mu_s, mapping.n_e_r], "axes": ["mu_s", "r"]},
        "scattering": volume,
        **({"single_mie_scattering": volume} if separate else {}),
        **({"higher_order_scattering": volume} if higher_order else {}),
    }
    centres = medium.wavelength_nm[::-1]
    constants = {
        **facts,
        "bottom_radius_km": mapping.bottom_km,
        "top_radius_km": mapping.bottom_km + mapping.thickness_km,
        "mu_s_min": mapping.mu_s_min,
        "mie_phase_function_g": g,
        "rayleigh_scattering_per_km": beta_r[::-1].tolist(),
        "mie_scattering_per_km": beta_m[::-1].tolist(),
        "solar_irradiance": solar_irradiance[::-1].tolist(),
        "ground_albedo": medium.ground_albedo[::-1].tolist(),
        "sun_angular_radius_rad": math.radians(SOLAR_RADIUS_DEG),
        "sky_radiance_to_luminance": (luminance_factors(centres, SKY_EXPONENT) / scale).tolist(),
        "sun_radiance_to_luminance": luminance_factors(centres, 0.0).tolist(),
        "scale": scale,
        "textures": textures,
    }
    transmittance = np.exp(-depth)[..., ::-1]
    return BrunetonTables(mapping, constants, scattering, transmittance, irradiance, single if separate else None, more)


def sky_radiance(
    tables: BrunetonTables, height_km: float, sun_deg: float, elevation_deg, azimuth_deg, *, shadow_km: float = 0.0
) -> np.ndarray:
    """What the shaders make of it (D, 3), with `scale` divided out: W m^-2 sr^-1 nm^-1 of red, green and blue.

    shadow_km: length of the first part of the lines of sight, none of which ends on the ground within it, that lies in
    a mountain's shadow (eq. 18): light that air scattered once and that aerosol scattered once does not come from
    there, and the rest does where `higher_order` is there.
    """
    c, m = tables.constants, tables.mapping
    e, a, s = np.radians(elevation_deg), np.radians(azimuth_deg), math.radians(sun_deg)
    mu, mu_s = np.sin(e), np.full(np.shape(e), math.sin(s))
    nu = mu * mu_s + np.cos(e) * math.cos(s) * np.cos(a)
    r = m.bottom_km + height_km
    rho = math.sqrt(height_km * (2 * m.bottom_km + height_km))
    ground = mu < -rho / r
    there = np.sqrt(r * r + shadow_km * (2.0 * r * mu + shadow_km))
    height = np.clip(there - m.bottom_km, 0.0, m.thickness_km) if shadow_km else np.full(mu.size, height_km)
    passed = _passed(tables, np.full(mu.size, height_km), mu) if shadow_km else 1.0
    mu, mu_s = (r * mu + shadow_km) / there, (r * mu_s + shadow_km * nu) / there
    if shadow_km:
        passed = passed / _passed(tables, height, mu)

    def texels(table: np.ndarray) -> np.ndarray:
        out = np.zeros((mu.size, table.shape[-1]))
        held = stored(np.ascontiguousarray(table, np.float32), False)
        read(m, held, False, height, mu, mu_s, nu, ground, out, 0, mu.size)
        return out

    out = texels(tables.scattering)
    beta_r, beta_m = np.array(c["rayleigh_scattering_per_km"]), np.array(c["mie_scattering_per_km"])
    rest, red = out[:, :3], out[:, :1]
    single = np.zeros((mu.size, 3))
    if tables.single_mie is not None:
        single = texels(tables.single_mie)
    elif beta_m[0] > 0.0:
        fraction = np.divide(out[:, 3:], red, out=np.zeros_like(red), where=red > 0.0)
        single = rest * fraction * (beta_r[0] / beta_m[0]) * (beta_m / beta_r)
    if tables.higher_order is None:
        rest = rest * passed
    else:
        more = texels(tables.higher_order)
        rest = (rest - more) * passed + more
    single = single * passed
    rayleigh = 3.0 / (16.0 * math.pi) * (1.0 + nu**2)
    total = rest * rayleigh[:, None] + single * phase_of(c["mie_phase_function_g"], nu)[:, None]
    return total / c["scale"]


def _passed(tables: BrunetonTables, height_km: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """Transmittance (D, 3) to the top, from heights and cosines (D,)."""
    depth = -np.log(np.maximum(tables.transmittance, 1e-30))
    out = np.zeros((mu.size, 3))
    for d in range(mu.size):
        optical_depth_to_top(tables.mapping, depth, height_km[d], mu[d], out[d])
    return np.exp(-out)


def _asymmetry(source: FieldSource) -> float:
    """g of the shaders' phase function that comes nearest to the column's at 10 to 60 deg, in the logarithm."""
    if source.phase is None:
        return 0.8
    cosine = np.cos(np.radians(np.linspace(10.0, 60.0, 51)))
    wanted = np.log(source.phase_at(cosine)).mean(axis=-1)
    candidates = np.linspace(0.3, 0.9, 121)
    errors = [np.mean((np.log(phase_of(g, cosine)) - wanted) ** 2) for g in candidates]
    return float(candidates[int(np.argmin(errors))])


def _unscaled(source: FieldSource, bottom_km: float) -> Profile:
    """The air without delta scaling, around a ground of that radius."""
    return prepare_profile(source.medium)._replace(earth_radius_km=bottom_km - source.medium.bottom_km)


def _packed(
    light: np.ndarray, nu: np.ndarray, true: np.ndarray, bare: np.ndarray, g: float, ratio: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """RGBA (mu, nu, 4) of light (mu, nu, W), over F0, and what aerosol scattered once (mu, nu, 3).

    nu (mu, nu); true, bare (mu, nu, W): what aerosol scattered once, with and without its phase functions, 0 where it
    is not apart.  ratio (W,): by which the shaders find `bare` from alpha; None: they read it from its own texture.
    """
    rayleigh = 3.0 / (16.0 * math.pi) * (1.0 + nu**2)[..., None]
    out = np.zeros((*nu.shape, 4))
    mie = phase_of(g, nu)[..., None]
    # towards the sun the aerosol's peak is not the shaders': it would be smeared over the 44 deg to the next texel
    towards = nu > 0.99
    light = np.where(towards[..., None], np.maximum(light - true, 0.0) + mie * bare, light)
    bare = np.minimum(bare, MOST_SINGLE * light / mie)
    red = bare[..., -1]
    out[..., 3] = red
    if ratio is None:
        out[..., :3] = ((light - mie * bare) / rayleigh)[..., ::-1]
        return out, bare[..., ::-1]
    rest = (light[..., -1] - mie[..., 0] * red) / rayleigh[..., 0]
    fraction = np.divide(red, rest, out=np.zeros_like(red), where=rest > 0.0)[..., None]
    out[..., :3] = (light / (rayleigh + mie * fraction * ratio))[..., ::-1]
    return out, bare[..., ::-1]
