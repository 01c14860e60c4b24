"""Light that the air adds before terrain, and its transmittance, on nodes of elevation, azimuth and distance.

Between nodes logarithms per length of the line are linear.  Light scattered once is separate, by species and without
its phase function, whose peak at the sun is narrower than the distance of the nodes.
"""

from typing import Any

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.conventions import DARK
from twilight.base.threads import in_slices
from twilight.terrain.march import Lines, ShadowGrid, SunlightSums, TerrainAir, sunlight_on_lines
from twilight.transport.beam import Beam
from twilight.transport.scaling import delta_scaled, species_phase

DEGREE = 24
"""Legendre moments beyond which the forward peak of aerosol counts as passed, for fields that do not say their own."""
ELEVATIONS = 25
"""Nodes of elevation, evenly spread; there are more about the horizon, below it and about the sun."""
DISTANCES = 12
"""Nodes of distance, in a geometric series."""
NEAREST = 1e-3
"""The nearest node of distance, over the length of the line."""
STEPS = 96
"""Parts of a line in which sunlight is summed at the nodes."""
ABOUT_HORIZON_DEG = (-1.0, -0.3, 0.0, 0.3, 1.0)
"""Elevations of nodes about the horizontal [deg]."""
BELOW_HORIZON = (1e-5, 1e-3, 4e-3, 0.01, 0.02, 0.04, 0.07, 0.11, 0.17, 0.25, 0.4, 0.6, 0.85, 1.2, 1.7, 2.4, 3.4, 4.8)
"""Elevations of nodes below the horizon, over its dip: lines there are 1.00, 0.96, 0.91 ... times as long as to it,
and from each node to the next at most 1.4 times as short."""
BESIDE_SUN_DEG = 5.0
"""Angle from the sun [deg] within which light scattered more than once is taken from outside of it."""
AZIMUTHS_DEG = (0, 0.5, 1, 2, 3.5, 5, 7.5, 10, 15, 20, 30, 45, 60, 80, 100, 120, 150, 180)
"""Azimuths of nodes from the sun [deg]."""


def sunlit_air(field: Any, medium: Medium) -> tuple[TerrainAir, np.ndarray]:
    """(coefficients of the air with forward peaks as the field counts them, fraction (K, W) of each aerosol's peak)."""
    scaled = getattr(field, "scaled", None) or delta_scaled(medium, DEGREE)
    step = 0.1
    altitude = np.arange(medium.bottom_km, medium.top_km + step, step)
    at = scaled.medium.at(np.minimum(altitude, medium.top_km))
    species = np.concatenate([at.air_scattering[None], at.aerosol_scattering[None] * at.aerosol_phase_fraction])
    air = TerrainAir(medium.bottom_km, step, np.ascontiguousarray(at.extinction), np.ascontiguousarray(species))
    return air, scaled.forward_fraction


class AerialPerspective:
    """Distances are counted in the length of the line, which ends on the medium's ground or at the farthest terrain.

    elevation_deg, azimuth_deg, far_km (D,): of all lines that will be asked for; inf where there is no ground"""

    def __init__(
        self, lit: Any, air: TerrainAir, forward_fraction: np.ndarray,
        elevation_deg: np.ndarray, azimuth_deg: np.ndarray, far_km: np.ndarray,
    ):  # fmt: skip
        field, medium, beam, place = lit
        sun = place.sun_rad
        self.radius_km = medium.earth_radius_km + place.altitude_km
        self.height_km = place.altitude_km - medium.bottom_km
        folded = np.minimum(azimuth_deg, 360.0 - azimuth_deg)
        self.e = self._elevations(float(elevation_deg.min()), float(elevation_deg.max()))
        first, last = float(folded.min()), max(float(folded.max()), 1.5 * BESIDE_SUN_DEG)
        around = np.array(AZIMUTHS_DEG, dtype=float)
        self.a = np.unique(np.concatenate([[first, last], around[(around > first) & (around < last)]]))
        self.farthest_km = max(1.0, float(far_km[np.isfinite(far_km)].max(initial=100.0)))
        self.fraction = np.geomspace(NEAREST, 1.0, DISTANCES)
        e, a, fraction = np.meshgrid(self.e, self.a, self.fraction, indexing="ij")
        d = fraction * self._length_km(e)
        light, passed = field.inscatter(
            place.sun_elevation_deg, e, a, d, observer_altitude_km=place.altitude_km, peak_passes=True
        )
        once = self._sunlight(medium, beam, air, place, e, a, d)
        cosine = np.sin(np.radians(e)) * np.sin(sun) + np.cos(np.radians(e)) * np.cos(sun) * np.cos(np.radians(a))
        phase = species_phase(medium, forward_fraction, np.clip(cosine.ravel(), -1.0, 1.0)).reshape(once.shape)
        single = (phase * once).sum(axis=-2)
        multiple = _beside_the_sun(np.maximum(light - single, 0.0), np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
        # at the nodes the sum is the field's, which smooths narrow peaks and bends the rays
        once *= np.divide(np.maximum(light - multiple, 0.0), single, out=np.ones_like(light), where=single > 0.0)[
            ..., None, :
        ]
        # per length: almost even close to the eye
        self.log_multiple = np.log(np.maximum(multiple, DARK) / d[..., None])
        self.log_once = np.log(np.maximum(once, DARK) / d[..., None, None])
        self.depth = -np.log(np.maximum(passed, DARK)) / d[..., None]

    def _elevations(self, low: float, high: float) -> np.ndarray:
        # the length of a line changes ever faster towards the horizon of the medium's ground
        dip = np.degrees(np.arccos(min(1.0, (self.radius_km - self.height_km) / self.radius_km)))
        near = np.concatenate([ABOUT_HORIZON_DEG, -dip - dip * np.array(BELOW_HORIZON), [-dip + 1e-4]])
        return np.unique(np.concatenate([np.linspace(low, high, ELEVATIONS), np.clip(near, low, high)]))

    def _sunlight(self, medium: Medium, beam: Beam, air: TerrainAir, place: Any, e, a, d) -> np.ndarray:
        """Sunlight on each species along the nodes' lines, without phase functions, (E, A, D, S, W)."""
        nowhere = ShadowGrid(np.full((2, 2), -1e9), -1.0, -1.0, 2.0, -1e9)
        shape = (e.size, air.scattering.shape[0], medium.n_wavelengths)
        sums = SunlightSums(np.zeros(shape), np.zeros(shape), np.zeros(e.size), STEPS, True)
        true_sun = np.radians(place.sun_elevation_deg)
        to_sun = np.array([np.sin(true_sun), np.cos(true_sun)])
        angles = np.radians(e.ravel()), np.radians(a.ravel())
        lines = Lines(medium.earth_radius_km, place.altitude_km, *angles, d.ravel())
        in_slices(lambda i, j: sunlight_on_lines(nowhere, air, beam, lines, to_sun, sums, i, j), e.size)
        return sums.whole.reshape(*e.shape, *shape[1:])

    def _length_km(self, elevation_deg: np.ndarray) -> np.ndarray:
        down = -self.radius_km * np.sin(np.radians(elevation_deg))
        below = self.height_km * (2.0 * self.radius_km - self.height_km)
        root = np.sqrt(np.maximum(down**2 - below, 0.0))
        ground = np.where((down > 0.0) & (down**2 > below), below / np.maximum(down + root, 1e-9), np.inf)
        return np.clip(ground, 1e-3, self.farthest_km)

    def at(
        self, e: np.ndarray, a: np.ndarray, distance_km: np.ndarray, phase: np.ndarray, lit: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """(light scattered in, transmittance), (D, W) each, of lines [rad] up to distances.

        phase (D, S, W) [sr^-1]: of each species; lit (D, S, W): fraction of the sunlight on it that no shadow takes;
        None: all.
        """
        elevation_deg, azimuth_deg = np.degrees(e), np.degrees(a)
        folded = np.minimum(azimuth_deg, 360.0 - azimuth_deg)
        length = self._length_km(elevation_deg)
        s = np.clip(distance_km, 1e-6, length)
        spots = [
            _between(self.e, elevation_deg),
            _between(self.a, folded),
            _between(np.log(self.fraction), np.log(np.maximum(s / length, self.fraction[0]))),
        ]
        shape = self.log_multiple.shape
        multiple, depth = np.zeros((2, s.size, shape[-1]))
        once = np.zeros((s.size, *self.log_once.shape[-2:]))
        for corner in range(8):
            index, weight = [], np.ones(s.size)
            for axis, (low, fraction) in enumerate(spots):
                up = corner >> axis & 1
                index.append(np.minimum(low + up, shape[axis] - 1))
                weight = weight * (fraction if up else 1.0 - fraction)
            place = tuple(index)
            multiple += weight[:, None] * self.log_multiple[place]
            depth += weight[:, None] * self.depth[place]
            once += weight[:, None, None] * self.log_once[place]
        sunlight = np.exp(once) if lit is None else np.exp(once) * lit
        light = np.exp(multiple) + (phase * sunlight).sum(axis=1)
        return light * s[:, None], np.exp(-depth * s[:, None])


def _beside_the_sun(multiple: np.ndarray, angle_deg: np.ndarray) -> np.ndarray:
    """Light (E, A, D, W) scattered more than once, taken from the next azimuth at BESIDE_SUN_DEG from the sun or more.

    Nearer the sun it would be the small difference of two peaks.  angle_deg (E, A, D): from the sun.
    """
    out = multiple.copy()
    outside = angle_deg[:, :, 0] >= BESIDE_SUN_DEG
    first = np.argmax(outside, axis=1)
    for row in np.flatnonzero(~outside[:, 0] & outside.any(axis=1)):
        out[row, : first[row]] = multiple[row, first[row]]
    return out


def _between(nodes: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the node below and the fraction of the way to the next."""
    if nodes.size == 1:
        return np.zeros(values.size, int), np.zeros(values.size)
    low = np.clip(np.searchsorted(nodes, values, side="right") - 1, 0, nodes.size - 2)
    return low, np.clip((values - nodes[low]) / (nodes[low + 1] - nodes[low]), 0.0, 1.0)
