"""Tables of the page over one axis: the sun's beam and the night's light by elevation; and the zodiacal light."""

from __future__ import annotations

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.engine import Field
from twilight.numerics.spectrum import wavelength_bounds
from twilight.sky.night import light
from twilight.sky.night.world import veil
from twilight.viewer.colours import Channels

NODES = 256
"""Elevations at which a line of the sky is held."""
MEAN_ROWS_DEG = (np.arange(30) + 0.5) * 3.0
"""Elevations of the directions over which light that falls from above is averaged [deg]."""


def sky_elevations(horizon_deg: float) -> np.ndarray:
    """Elevations [deg] of the nodes, closer towards the horizon."""
    return horizon_deg + (90.0 - horizon_deg) * np.linspace(0.0, 1.0, NODES) ** 2


def sunbeam(
    solved: Field, channels: Channels, altitude_km: float, nodes_deg: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Refraction and light of the sun's disc at apparent elevations (N,) [deg], from the horizon up.

    Returns: apparent less true elevation of a point of the disc [deg] (N,), and what the whole disc would give there at
    normal incidence, X, Y, Z and scotopic [lx], (N, 4).
    """
    horizon_deg = float(nodes_deg[0])
    steps = np.arange(horizon_deg - 1.5, horizon_deg + 2.0, 0.01), np.arange(horizon_deg + 2.0, 90.0, 0.1)
    suns = [(e, solved.direct(float(e), altitude_km)) for e in (*steps[0], *steps[1], 90.0)]
    seen = [(e, one) for e, one in suns if one.irradiance.any()]
    true = np.array([e for e, _ in seen])
    apparent = true + np.array([one.bending_deg for _, one in seen])
    factor = np.stack([one.irradiance for _, one in seen])
    refraction_deg = np.interp(nodes_deg, apparent, apparent - true)
    logs = np.log(np.maximum(channels.of(factor), 1e-30))
    light = np.stack([np.interp(nodes_deg, apparent, column) for column in logs.T], axis=-1)
    return refraction_deg, np.exp(light)


def night(medium: Medium, altitude_km: float, nodes_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The parts of the night's light at usual brightness, as `night.night_radiance` has it.

    By elevation (N,) [deg] and for the ground, (5, N, W) and (3, W) [W m^-2 nm^-1 sr^-1]: airglow; starlight of 1 S10
    that comes through, and what is scattered of a mean of 1 S10; the same of zodiacal light that is
    1 W m^-2 nm^-1 sr^-1 at 500 nm.  The ground sends back what falls on it (airglow; of mean starlight; of mean
    zodiacal light).
    """
    wavelength_nm, nodes = medium.wavelength_nm, nodes_deg
    zenith = light.airglow_zenith(wavelength_bounds(wavelength_nm))

    def glow(elevation: np.ndarray) -> np.ndarray:
        rows = zip(light.airglow_layers(), zenith, strict=True)
        return sum(light.van_rhijn(elevation, layer, altitude_km)[:, None] * radiance for layer, radiance in rows)

    air = veil(medium, nodes, altitude_km)
    t, scattered = air.transmittance, (1.0 - air.transmittance) * air.source
    weight = np.sin(2 * np.radians(MEAN_ROWS_DEG))
    mean = (weight / weight.sum()) @ glow(MEAN_ROWS_DEG)
    stars = light.S10_550NM * light.solar_shape(wavelength_nm, 550.0)
    zodiac = light.solar_shape(wavelength_nm, 500.0) * light.zodiacal_colour(wavelength_nm)
    rows = np.stack([glow(nodes) * t + mean * scattered, t * stars, scattered * stars, t * zodiac, scattered * zodiac])
    # what falls on the ground: the mean over the hemisphere of the light that arrives there
    below = veil(medium, MEAN_ROWS_DEG, medium.bottom_km)
    fraction = (weight / weight.sum()) @ (below.transmittance + (1.0 - below.transmittance) * below.source)
    ground = medium.ground_albedo * fraction * np.stack([mean, stars, zodiac])
    return rows, ground


def zodiacal_table() -> np.ndarray:
    """Zodiacal light at 500 nm [W m^-2 nm^-1 sr^-1], (73, 37): by ecliptic longitude from the sun, 0 to 180 deg, and
    latitude, 0 to 90 deg, every 2.5 deg."""
    grid = np.meshgrid(np.linspace(0.0, 180.0, 73), np.linspace(0.0, 90.0, 37), indexing="ij")
    return light.zodiacal_500nm(*grid)
