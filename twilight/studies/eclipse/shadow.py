"""Sunlight in the shadow of the Earth, by looking back at the sun through the ring of its air.

An observer at the distance D from the Earth's centre sees the sun through the air around the Earth's limb.  A line of
sight that leaves at the angle psi from the Earth's centre comes from psi' = psi - bending, dimmed to T, and refraction
does not change radiance.  With the sun's centre at the angle delta from the Earth's,

    E(delta) / F0 = int T(psi) sin(psi) dpsi int I(d) da / int I dOmega,  d^2 = psi'^2 + delta^2 - 2 psi' delta cos a

I: radiance of the sun's disc at the angle d from its centre, with its limb darkening.  That refraction spreads the
light, hundreds of times at the moon, follows: the ring that shows the sun is that thin.  Light from the far limb is
there too: psi' below 0.  Beyond the air T is 1 and psi' is psi; behind the Earth T is 0.

Angles are below 2 deg at the moon, where a plane is as good as a sphere to 1e-4; near the Earth psi is large, and delta
and d are taken on the sphere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.sky.disc import limb_coefficients
from twilight.transport.apparent_rays import ApparentRays

SUN_RADIUS_DEG = 0.26656
"""Angular radius of the sun at 1 au: 695,700 km (IAU 2015)."""
LINES = 800
"""Lines of sight through the air, closer near the ground."""
BEYOND = 120
"""Lines of sight to the part of the sun that stands beyond the air, Gauss-Legendre."""
AROUND = 12
"""Gauss-Legendre points over the azimuths at which a ring crosses the sun's disc."""


@dataclass(frozen=True)
class Ring:
    """The lines of sight from one distance: apparent_rad, width_rad (P,), true_rad, transmittance (P, W)."""

    apparent_rad: np.ndarray
    width_rad: np.ndarray
    true_rad: np.ndarray
    transmittance: np.ndarray


class Shadow:
    """Sunlight behind the Earth of a medium.

    medium: the air; its ground stops the light.  top_km: of clouds over all the limb, which let nothing through; None:
    clear air down to the ground.
    """

    def __init__(self, medium: Medium, top_km: float | None = None):
        if top_km is not None and not medium.bottom_km <= top_km < medium.top_km:
            raise TwilightError(
                f"cloud top is {top_km:g} km; allowed is {medium.bottom_km:g} km (the ground) to {medium.top_km:g} km"
            )
        self.medium = medium
        self.lowest_km = medium.bottom_km if top_km is None else top_km
        self._rays = ApparentRays(medium)

    def _ring(self, distance_km: float) -> Ring:
        """The lines of sight through the air at the distance from the Earth's centre."""
        m = self.medium
        height = np.linspace(0.0, 1.0, LINES + 1) ** 2 * (m.top_km - self.lowest_km) + self.lowest_km
        index = 1.0 + m.at(height).refractivity[:, m.n_wavelengths // 2]
        invariant = index * (m.earth_radius_km + height)
        edge = np.unique(np.arcsin(np.minimum(1.0, invariant / distance_km)))
        middle = 0.5 * (edge[1:] + edge[:-1])
        elevation_deg = np.degrees(middle) - 90.0
        all_wavelengths = np.arange(m.n_wavelengths)
        true_deg, transmittance = self._rays.follow(distance_km - m.earth_radius_km, elevation_deg, all_wavelengths)
        return Ring(middle, np.diff(edge), np.radians(true_deg + 90.0), transmittance)

    def irradiance(
        self, offset_rad: np.ndarray, distance_km: float, sun_radius_rad: float = float(np.radians(SUN_RADIUS_DEG))
    ) -> np.ndarray:
        """Irradiance at normal incidence over that without the Earth, (N, W).

        Parameters
        ----------
        offset_rad : (N,)
            Angles between the sun's centre and the Earth's, as seen from there [rad], 0 to pi: distance from the
            shadow's axis over distance from the Earth.
        distance_km
            From the Earth's centre [km]: beyond the air.
        sun_radius_rad
            Angular radius of the sun's disc [rad].

        Raises
        ------
        TwilightError
            For a distance within the air.
        """
        m = self.medium
        if not distance_km > m.earth_radius_km + m.top_km:
            raise TwilightError(
                f"distance_km is {distance_km:g}; allowed is more than {m.earth_radius_km + m.top_km:g}, beyond the air"
            )
        offsets = np.atleast_1d(np.asarray(offset_rad, dtype=float))
        ring = self._ring(distance_km)
        edge = float(ring.apparent_rad[-1] + 0.5 * ring.width_rad[-1])
        coefficients = limb_coefficients(m.wavelength_nm)
        powers = np.arange(coefficients.shape[0])
        # int I dOmega = 2 pi (1 - cos s) int 2 I mu dmu, the disc's own measure, over I(1)
        whole = np.pi * sun_radius_rad**2 * (2.0 * coefficients / (powers + 2.0)[:, None]).sum(axis=0)
        out = np.empty((offsets.size, m.n_wavelengths))
        for n, delta in enumerate(offsets):
            for w in range(m.n_wavelengths):
                seen = _around(ring.true_rad[:, w], delta, sun_radius_rad, coefficients[:, w])
                light = (ring.transmittance[:, w] * np.sin(ring.apparent_rad) * ring.width_rad) @ seen
                first, last = max(edge, delta - sun_radius_rad), delta + sun_radius_rad
                if last > first:
                    node, weight = np.polynomial.legendre.leggauss(BEYOND)
                    x, weight = 0.5 * (first + last + (last - first) * node), 0.5 * (last - first) * weight
                    light += (weight * np.sin(x)) @ _around(x, delta, sun_radius_rad, coefficients[:, w])
                out[n, w] = light / whole[w]
        return out


def without_air(medium: Medium) -> Medium:
    """The same Earth with air that neither bends nor dims: its shadow is that of geometry."""
    zero = {
        name: np.zeros_like(getattr(medium, name))
        for name in ("air_scattering_per_km", "absorption_per_km", "aerosol_extinction_per_km", "refractivity")
    }
    return replace(medium, grid_medium=None, **zero)


_NODE, _WEIGHT = np.polynomial.legendre.leggauss(AROUND)


def _around(true_rad: np.ndarray, delta: float, radius: float, coefficients: np.ndarray) -> np.ndarray:
    """Integral of the disc's radiance over its central one, around circles of the angles |true_rad| (P,) about the
    Earth's centre, (P,) [rad]; delta: of the sun's centre."""
    out = np.zeros(true_rad.size)
    circle = np.abs(true_rad)
    inside = np.abs(circle - delta) < radius
    circle = circle[inside]
    product = np.sin(circle) * np.sin(delta)
    # cos of the azimuth at which the circle leaves the disc; about the disc's own centre it never does
    least = np.divide(np.cos(radius) - np.cos(circle) * np.cos(delta), product, where=product > 0.0,
                      out=np.full(circle.size, -1.0))  # fmt: skip
    span = np.arccos(np.clip(least, -1.0, 1.0))
    azimuth = 0.5 * span[:, None] * (_NODE + 1.0)
    # 1 - cos d without losing digits: haversines
    half = np.sin(0.5 * (circle - delta))[:, None] ** 2 + product[:, None] * np.sin(0.5 * azimuth) ** 2
    mu = np.sqrt(np.clip(1.0 - half / np.sin(0.5 * radius) ** 2, 0.0, 1.0))
    out[inside] = span * (np.polynomial.polynomial.polyval(mu, coefficients) @ _WEIGHT)
    return out
