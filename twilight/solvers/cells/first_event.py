"""Haber section 4.6.2, first scattering event: the sunlight that every cell scatters, of air and of aerosol apart.

Eq. (5) with the sun as the source, A instead of omega / 4 pi:
    I_air = E (tau_front - tau_back) sigma_air / sigma_e A,   I_aerosol likewise,
tau by eq. (4) along the refracted path (section 4.4), times the ozone filter exp(-alpha d) of section 4.3, which is
crossed vertically.  A cell whose path meets the ground lies in the Earth's shadow.
"""

from __future__ import annotations

import math

import numpy as np

from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.cells.exchange import Rings, chord_of
from twilight.solvers.cells.grid import Layers
from twilight.solvers.cells.refraction import find_sun


@njit(cache=True, nogil=True)
def _sunlit(layers, rings, sun, tolerance, air, aerosol, begin, end):
    """Power over F0 [km^2] that the rings begin..end scatter: air, aerosol (G, W, H), filled.

    layers, rings, sun, tolerance: as in `sunlit`.
    """
    n_wavelengths, n_half = air.shape[1], air.shape[2]
    for ring in range(begin, end):
        k = rings.layer[ring]
        x = rings.radius[ring] * rings.cos_elevation[ring]
        z = rings.radius[ring] * rings.sin_elevation[ring] + rings.observer_radius
        rho = math.sqrt(x * x + z * z)
        for j in range(n_half):
            azimuth = math.pi * j / (n_half - 1)
            cosine = (x * math.cos(azimuth) * sun[0] + z * sun[2]) / rho
            elevation = math.asin(max(-1.0, min(1.0, cosine)))
            chord = chord_of(rings, ring, azimuth, sun[0], 0.0, sun[2])
            area = rings.volume[ring] / chord
            for w in range(n_wavelengths):
                lift, depth, _ = find_sun(layers, w, rings.altitude[ring], k, elevation, tolerance)
                extinction = layers.extinction[k, w]
                if math.isnan(lift) or extinction == 0.0:
                    air[ring, w, j] = aerosol[ring, w, j] = 0.0
                    continue
                inside = chord * extinction
                taken = area * math.exp(-max(depth - 0.5 * inside, 0.0)) * -math.expm1(-inside)
                air[ring, w, j] = taken * layers.air[k, w] / extinction
                aerosol[ring, w, j] = taken * layers.aerosol[k, w] / extinction


def sunlit(
    layers: Layers, rings: Rings, sun: np.ndarray, tolerance: float, filtered: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """I_air and I_aerosol (G, W, H) over F0 [km^2] of the cells at the H azimuths of one side.

    sun (3,): unit vector to it; tolerance [rad]: of `find_sun`; filtered (W,): transmittance of the ozone filter.
    """
    shape = (rings.radius.size, layers.air.shape[1], rings.azimuth_cells // 2 + 1)
    air, aerosol = np.empty(shape), np.empty(shape)
    in_slices(lambda begin, end: _sunlit(layers, rings, sun, tolerance, air, aerosol, begin, end), rings.radius.size)
    for light in (air, aerosol):
        light *= filtered[:, None]
    return air, aerosol
