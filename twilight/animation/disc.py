"""The sun's disc in a film: lifted, flattened and coloured by the refracted sunbeam, darkened to its limb."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twilight.sky.disc import SOLAR_RADIUS_DEG, limb_darkening, mean_limb_darkening
from twilight.viewer.lines import sky_elevations

DARKENED_AT_NM = np.array([550.0])
"""Wavelength of the limb darkening of all wavelengths, as on the page of `twilight view` [nm]."""


@dataclass(frozen=True)
class RefractedBeam:
    """refraction_deg (N,), beam (N, 4): of the sun's disc at 1 au, as `viewer.lines.sunbeam`; horizon_deg: apparent."""

    refraction_deg: np.ndarray
    beam: np.ndarray
    horizon_deg: float

    def near(self, elevation_deg: np.ndarray, body_elevation_deg: float, pixel_deg: float) -> np.ndarray:
        """Whether apparent elevations [deg] may show a body at a true elevation."""
        with np.errstate(invalid="ignore"):
            near = np.abs(elevation_deg - body_elevation_deg) < 2.0 + pixel_deg
            return near & (elevation_deg >= self.horizon_deg)

    def at(self, elevation_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """True elevations [rad] (M,), and what the whole disc would give (M, 4), at apparent elevations (M,) [deg]."""
        nodes = sky_elevations(self.horizon_deg)
        true = np.radians(elevation_deg - np.interp(elevation_deg, nodes, self.refraction_deg))
        logs = [np.interp(elevation_deg, nodes, column) for column in np.log(self.beam).T]
        return true, np.stack([np.exp(log) for log in logs], axis=-1)


@dataclass(frozen=True)
class DiscPainter(RefractedBeam):
    """Draws the sun's disc."""

    def light(
        self,
        elevation_deg: np.ndarray,
        azimuth_deg: np.ndarray,
        pixel_deg: float,
        sun_elevation_deg: float,
        sun_azimuth_deg: float,
        distance_au: float,
    ) -> np.ndarray:
        """Channels of the film's tone [cd m^-2], (H, W, 4).

        sun_elevation_deg: true.  Edges are smoothed over pixel_deg; a disc of less than a pixel keeps its light.
        """
        light = np.zeros((*elevation_deg.shape, 4))
        near = self.near(elevation_deg, sun_elevation_deg, pixel_deg)
        if not near.any():
            return light
        true, beam = self.at(elevation_deg[near])
        sun, across = np.radians(sun_elevation_deg), np.radians(azimuth_deg[near] - sun_azimuth_deg)
        cosine = np.sin(true) * np.sin(sun) + np.cos(true) * np.cos(sun) * np.cos(across)
        away = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        radius = SOLAR_RADIUS_DEG / distance_au
        filled = np.clip((radius - away) / pixel_deg + 0.5, 0.0, min(1.0, np.pi * (radius / pixel_deg) ** 2))
        mu = np.sqrt(np.clip(1.0 - (away / radius) ** 2, 0.0, 1.0))
        dark = limb_darkening(mu[..., None], DARKENED_AT_NM)[..., 0] / mean_limb_darkening(DARKENED_AT_NM)[0]
        # what the disc gives at 1 au over the solid angle that it has there
        solid = np.pi * np.sin(np.radians(SOLAR_RADIUS_DEG)) ** 2
        light[near] = (filled * dark / solid)[:, None] * beam
        return light
