"""The sun's disc in pictures and environment maps, and ``sun.png``, its close-up."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twilight import colour
from twilight.disc import Disc
from twilight.io.environment import ground_factor, pixel_of, pixel_solid_angle
from twilight.io.rendered import Options, Rendered
from twilight.sky import Sky
from twilight.tone import Film, Light, Shot, film_of

COLOUR_STEP_NM = 10.0
"""Every wavelength has an edge of the disc of its own: colours need more of them than the sky."""
_NODES = 24
"""Points of a row, from limb to limb, whose light is given to the pixels of a map."""

CLOSE_UP_DEG = 0.8
"""Field of ``sun.png``, from side to side."""
CLOSE_UP_PIXELS = 400


def _fine(disc: Disc) -> Disc:
    """The disc at wavelengths close enough for its colours, where those of the sky are far apart."""
    nm = disc.wavelength_nm
    if nm.size == 1 or np.diff(nm).max() <= COLOUR_STEP_NM:
        return disc
    return disc.at_wavelengths(np.linspace(nm[0], nm[-1], int(np.ceil((nm[-1] - nm[0]) / COLOUR_STEP_NM)) + 1))


def _xyz(sky: Sky, disc: Disc, factor: np.ndarray, observer: str) -> np.ndarray:
    return colour.factor_to_xyz(factor, disc.wavelength_nm, sky.solar_spectrum, sky.distance_au, observer)


def add_to_map_xyz(sky: Sky, picture: np.ndarray, target: str, width: int, observer: str) -> None:
    """Add the light of the disc to an environment map (height, width, 3) of XYZ [cd m^-2]."""
    if sky.disc is None:
        return
    disc = _fine(sky.disc)
    elevation, azimuth, light = _pieces(disc)
    if light.size:
        _give(sky, picture, target, width, elevation, azimuth, _xyz(sky, disc, light, observer))


def add_to_map_factor(sky: Sky, picture: np.ndarray, target: str, width: int) -> None:
    """Add the light of the disc to an environment map (height, width, W) of radiance over F0 [sr^-1]."""
    if sky.disc is not None:
        elevation, azimuth, light = _pieces(sky.disc)
        if light.size:
            _give(sky, picture, target, width, elevation, azimuth, light)


def _pieces(disc: Disc) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elevation, azimuth from the sun [deg] and irradiance over F0 (N, W) of small pieces of the disc's image.

    The pieces of all wavelengths are those of the widest one; their light sums to `Disc.irradiance_factor`.
    """
    rows = disc.rows()
    keep = rows.any(axis=1)
    if not keep.any():
        return np.zeros(0), np.zeros(0), np.zeros((0, disc.wavelength_nm.size))
    elevation, rows = disc.elevation_deg[keep], rows[keep]
    half = disc.half_width_deg()[keep].max(axis=1)
    node = (np.arange(_NODES) + 0.5) / _NODES * 2.0 - 1.0
    azimuth = half[:, None] * node
    share = disc.radiance(elevation[:, None], azimuth)
    total = share.sum(axis=1, keepdims=True)
    # a wavelength whose disc is narrower than the distance of the points has its light in the middle
    middle = np.full((1, _NODES, 1), 1.0 / _NODES)
    share = np.where(total > 0.0, share / np.where(total > 0.0, total, 1.0), middle)
    light = rows[:, None, :] * share
    return np.repeat(elevation, _NODES), azimuth.ravel(), light.reshape(-1, light.shape[-1])


def _give(
    sky: Sky,
    picture: np.ndarray,
    target: str,
    width: int,
    elevation: np.ndarray,
    azimuth: np.ndarray,
    light: np.ndarray,
) -> None:
    """Give light (N, K) to the pixels that it comes from, as radiance: the map keeps its sum."""
    row, column = pixel_of(target, width, elevation, azimuth + (sky.sun_azimuth_deg or 0.0))
    np.add.at(picture, (row, column), light / pixel_solid_angle(target, width)[row, column, None])


def add_to_picture(
    sky: Sky,
    picture: np.ndarray,
    elevation_deg: np.ndarray,
    azimuth_deg: np.ndarray,
    film: Film,
    points: int = 8,
) -> None:
    """Add the disc to a picture (height, width, K) of a film's channels, whose pixels look in directions from the sun.

    elevation_deg, azimuth_deg: broadcast to (height, width).  Each pixel holds the mean of points x points.
    """
    if sky.disc is None or not sky.disc.is_seen:
        return
    elevation, azimuth = np.broadcast_arrays(elevation_deg, azimuth_deg)
    lower, upper = sky.disc.edges_deg()
    down, right = _steps(elevation, azimuth)
    around = np.mod(azimuth + 180.0, 360.0) - 180.0
    margin = 2.0 * np.nanmax(np.abs(down))
    reach = 2.0 * sky.disc.half_width_deg().max() + 2.0 * np.nanmax(np.abs(right))
    near = (elevation > lower - margin) & (elevation < upper + margin) & (np.abs(around) < reach)
    if not near.any():
        return
    disc = _fine(sky.disc)
    offset = (np.arange(points) + 0.5) / points - 0.5
    where = np.nonzero(near)
    e = elevation[where][:, None, None] + down[where][:, None, None] * offset[:, None]
    a = around[where][:, None, None] + right[where][:, None, None] * offset[None, :]
    e, a = np.broadcast_arrays(e, a)
    for start in range(0, e.shape[0], 512):
        part = slice(start, start + 512)
        light = disc.radiance(e[part], a[part]).mean(axis=(1, 2))
        picture[where[0][part], where[1][part]] += film.see(light, disc.wavelength_nm, light_of(sky))


def _steps(elevation: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Change of elevation from a row to the next and of azimuth from a column to the next [deg]."""
    turn = np.mod(np.diff(azimuth, axis=1, append=azimuth[:, :1]) + 180.0, 360.0) - 180.0
    turn[:, -1] = turn[:, -2]
    return np.gradient(elevation, axis=0), turn


def light_of(sky: Sky) -> Light:
    """What the spectra of a sky are multiplied by."""
    return Light(sky.solar_spectrum, sky.distance_au)


def close_up(sky: Sky, film: Film) -> tuple[np.ndarray, float]:
    """A film's channels of a square of 0.8 deg around the disc (pixels, pixels, K), and its middle's elevation [deg].

    The sky is that of the disc's surroundings, and below the horizon the ground; without a disc in sight the square
    stands on the horizon.
    """
    assert sky.disc is not None
    lower, upper = sky.disc.edges_deg()
    middle = 0.5 * (lower + upper) if np.isfinite(lower) else 0.5 * CLOSE_UP_DEG
    offset = ((np.arange(CLOSE_UP_PIXELS) + 0.5) / CLOSE_UP_PIXELS - 0.5) * CLOSE_UP_DEG
    elevation = (middle - offset)[:, None]
    azimuth = offset[None, :] / np.cos(np.radians(middle))
    seen = film.see(sky.normalised_radiance, sky.wavelength_nm, light_of(sky))
    lowest = max(float(sky.elevation_edges_deg[0]), -dip_deg(sky))
    picture = sky.smooth(seen, np.clip(elevation, lowest, 90.0), azimuth).astype(float)
    picture[elevation[:, 0] < -dip_deg(sky)] = film.see(ground_factor(sky), sky.wavelength_nm, light_of(sky))
    add_to_picture(sky, picture, elevation, azimuth, film, points=2)
    return picture, float(middle)


def dip_deg(sky: Sky) -> float:
    """Dip of the horizon [deg] of a smooth Earth without refraction."""
    from twilight.conventions import EARTH_RADIUS_KM

    return float(np.degrees(np.arccos(EARTH_RADIUS_KM / (EARTH_RADIUS_KM + max(sky.observer_altitude_km, 0.0)))))


def write_picture(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sun.png``: the disc alone fills the picture, exposed for itself."""
    from twilight.errors import TwilightError
    from twilight.io.picture import save_png

    sky = rendered.seen
    if sky.disc is None:
        raise TwilightError("output.files: disc needs sun.disc: true")
    film = film_of(options.tone_mapping, options.observer, options.tone_settings)
    picture, middle = close_up(sky, film)
    luminance = picture[..., 1]
    bright = luminance[luminance > 0.02 * luminance.max()]
    key = float(np.exp(np.log(bright).mean())) if bright.size else 1e-6
    ev100 = float(np.log2(key / (3.0 * colour.GREY_LUMINANCE_AT_EV100_0)))
    display, _ = film.develop(picture, Shot(ev100, CLOSE_UP_DEG / CLOSE_UP_PIXELS))
    facts = {
        "field_deg": f"{CLOSE_UP_DEG:g}",
        "middle_elevation_deg": f"{middle:.6g}",
        "exposure_ev100": f"{ev100:.6g}",
    }
    return [save_png(display, folder / "sun.png", sky, facts)]
