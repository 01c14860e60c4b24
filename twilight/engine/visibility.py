"""What the naked eye sees under the light of a field: the limit of stars, and by how much objects are above it.

The sky behind is that of `twilight.engine.light`, by V(lambda); refraction and extinction follow the refracted ray;
thresholds are those of `twilight.sky.eye_limit`.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twilight.engine.light import SOURCES, LightField, Moments, moments_at
from twilight.numerics import spectrum
from twilight.sky.eye_limit import MAGNITUDE_0_LUX, TYPICAL_FIELD_FACTOR, limiting_magnitude, magnitudes_above
from twilight.sky.moon.disc import lit_parts
from twilight.sky.objects import Track
from twilight.transport.apparent_rays import ApparentRays, horizon_dip_deg

HIGHEST_SUN_OF_NIGHT_DEG = -5.0
"""Elevation of the sun [deg] below which the night's own light counts: there the sky is 1000 times as luminous."""
ROWS = 120
"""Apparent elevations between which refraction and extinction are linear."""
GAZES = 13
"""Points on the moon's disc, from its middle to its limb, of which one is looked at."""


@dataclass(frozen=True, eq=False)
class NakedEye:
    """A naked eye in the light of a field.

    field: covers V(lambda); field_factor: as of `twilight.sky.eye_limit`.
    """

    field: LightField
    field_factor: float = TYPICAL_FIELD_FACTOR

    @property
    def altitude_km(self) -> float:
        """Of the observer."""
        return float(self.field.solved.scene.altitude_km)

    def moments(self, latitude_deg: float, longitude_deg: float, times: Sequence[dt.datetime]) -> Moments:
        """Moments of one place."""
        count = len(times)
        return moments_at([latitude_deg] * count, [longitude_deg] * count, times, self.altitude_km)

    @cached_property
    def _air(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Apparent and true elevations [deg] and extinction [mag] of rays to the observer, (ROWS,) each."""
        medium = self.field.solved.medium
        low = -horizon_dip_deg(medium, self.altitude_km) + 1e-3
        apparent = low + (90.0 - low) * np.linspace(0.0, 1.0, ROWS) ** 2
        true, passed = ApparentRays(medium).follow(self.altitude_km, apparent, np.arange(medium.n_wavelengths))
        weight = spectrum.solar_at_visible(self.field.solved.solar_spectrum)
        weight = weight * spectrum.colour_matching_functions("cie1931_2deg")[:, 1]
        transmittance = spectrum.integrate(passed, medium.wavelength_nm, weight) / weight.sum()
        with np.errstate(divide="ignore"):
            return apparent, np.maximum.accumulate(true[:, medium.n_wavelengths // 2]), -2.5 * np.log10(transmittance)

    def seen_at(self, true_elevation_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Apparent elevation [deg] and extinction along the refracted ray [mag]; NaN and infinite below the horizon."""
        apparent, true, lost = self._air
        e = np.asarray(true_elevation_deg, float)
        up = e >= true[0]
        shown = np.where(up, np.interp(e, true, apparent), np.nan)
        return shown, np.where(up, np.interp(np.where(up, shown, 90.0), apparent, lost), np.inf)

    def background(
        self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, *, moonlight: bool = True
    ) -> np.ndarray:
        """Luminance of the sky [cd m^-2] in apparent directions (N, D), azimuths from north."""
        e, a = np.maximum(np.asarray(elevation_deg, float), 0.0), np.asarray(azimuth_deg, float)
        out = np.zeros(e.shape)
        night = moments.sun_elevation_deg < HIGHEST_SUN_OF_NIGHT_DEG
        for which, names in ((night, tuple(SOURCES)), (~night, ("sky", "moon"))):
            if which.any():
                names = tuple(name for name in names if moonlight or name != "moon")
                light = self.field.directions(moments.part(np.flatnonzero(which)), e[which], a[which], names)
                out[which] = self.field.spectra(light).photopic()
        return out

    def limit(
        self, moments: Moments, elevation_deg: np.ndarray, azimuth_deg: np.ndarray, *, moonlight: bool = True
    ) -> np.ndarray:
        """V magnitude above the air of the faintest star seen in apparent directions (N, D), NaN below the horizon."""
        apparent, _, lost = self._air
        e = np.asarray(elevation_deg, float)
        behind = self.background(moments, e, azimuth_deg, moonlight=moonlight)
        found = limiting_magnitude(behind, self.field_factor) - np.interp(e, apparent, lost)
        return np.where(e < apparent[0], np.nan, found)

    def margins(self, found: Sequence[Track], moments: Moments) -> np.ndarray:
        """How many magnitudes objects are brighter than the limit, (objects, N); -inf below the horizon.

        The moon's own light is no background to it.
        """
        out = np.full((len(found), len(moments.places)), -np.inf)
        for moon in (False, True):
            some = [i for i, track in enumerate(found) if (track.moons is not None) is moon]
            if not some:
                continue
            shown, lost = self.seen_at(np.stack([found[i].elevation_deg for i in some]))
            up = np.flatnonzero(np.isfinite(shown).any(axis=0))
            if not up.size:
                continue
            azimuth = np.stack([found[i].azimuth_deg for i in some])[:, up]
            behind = self.background(moments.part(up), np.nan_to_num(shown[:, up]).T, azimuth.T, moonlight=not moon)
            for row, i in enumerate(some):
                for k in np.flatnonzero(np.isfinite(shown[row, up])):
                    here = up[k]
                    out[i, here] = self._margin(found[i], here, float(behind[k, row]), float(lost[row, here]))
        return out

    def _margin(self, track: Track, k: int, background: float, lost_mag: float) -> float:
        at_eye = float(track.magnitude[k]) + lost_mag
        if track.moons is None:
            return float(limiting_magnitude(background, self.field_factor)) - at_eye
        moon = track.moons[k]
        x, y, fraction = lit_parts(moon.phase_angle_deg)
        gaze = np.linspace(0.0, 1.0, GAZES)[:, None]
        lux = MAGNITUDE_0_LUX * 10.0 ** (-0.4 * at_eye) * fraction
        apart = np.radians(moon.radius_deg) * np.hypot(x - gaze, y)
        return magnitudes_above(lux, apart, background, self.field_factor)
