"""Radiance between plane-parallel layers by doubling and adding: what thick media are judged against.

Azimuthal mean only (m = 0), which is all of the flux and of the radiance in the zenith.  With d and u the radiances
down and up at N cosines, d/dtau (d, u) = A (d, u); the exponential of a thin layer's A gives its reflection R and
transmission T, which are doubled up to the layer (de Haan, Bosma & Hovenier 1987), and layers are added to the ground.
The sun is a direction of weight 1e-12, so that its beam is a radiance like any other.
"""

import numpy as np
from scipy.linalg import expm

SUN_WEIGHT = 1e-12


def henyey_greenstein(asymmetry: float, degree: int = 63) -> np.ndarray:
    """Legendre moments chi_l."""
    return asymmetry ** np.arange(degree + 1.0)


RAYLEIGH = np.array([1.0, 0.0, 0.1])


class Slabs:
    """Layers from the top down, each (optical depth, single scattering albedo, chi), over a Lambertian ground.

    down, up: azimuthal means of the radiance over F0 at the levels (layers + 1) and at `cosine`, without the beam.
    flux_down (with the beam), flux_up: over F0 at the levels.
    """

    def __init__(self, layers, ground_albedo: float, sun_cosine: float, streams: int = 32):
        x, w = np.polynomial.legendre.leggauss(streams)
        mu = np.concatenate([0.5 * (x + 1.0), [1.0, sun_cosine]])
        weight = np.concatenate([0.5 * w, [0.0, SUN_WEIGHT]])
        one = np.eye(mu.size)
        # reflection of everything below each level, from the ground up
        below = [2.0 * ground_albedo * np.ones((mu.size, 1)) * (mu * weight)]
        found = [_layer(mu, weight, *layer) for layer in layers]
        for reflect, transmit in reversed(found):
            below.append(reflect + transmit @ below[-1] @ np.linalg.solve(one - reflect @ below[-1], transmit))
        below = below[::-1]
        light = np.zeros(mu.size)
        light[-1] = 1.0 / (2.0 * np.pi * SUN_WEIGHT)
        down = [light]
        for k, (reflect, transmit) in enumerate(found):
            down.append(np.linalg.solve(one - reflect @ below[k + 1], transmit @ down[-1]))
        up = [b @ d for b, d in zip(below, down, strict=True)]
        self.cosine = mu[:-1]
        self.flux_down, self.flux_up = (2.0 * np.pi * np.array(v) @ (mu * weight) for v in (down, up))
        self.down, self.up = (np.array(v)[:, :-1] for v in (down, up))


def _layer(mu: np.ndarray, weight: np.ndarray, depth: float, albedo: float, chi: np.ndarray):
    """Reflection and transmission (N, N) of a layer, beam included."""
    degree = np.arange(len(chi))
    series = np.polynomial.legendre.legvander(mu, degree[-1])
    forward = (series * ((2 * degree + 1) * chi)) @ series.T
    backward = (series * ((2 * degree + 1) * chi * (-1.0) ** degree)) @ series.T
    halvings = max(0, int(np.ceil(np.log2(depth / (0.5 * mu.min())))))
    thin = depth / 2.0**halvings
    a = (0.5 * albedo * forward * weight - np.eye(mu.size)) / mu[:, None]
    b = 0.5 * albedo * backward * weight / mu[:, None]
    through = expm(thin * np.block([[a, b], [-b, -a]]))
    n = mu.size
    reflect = -np.linalg.solve(through[n:, n:], through[n:, :n])
    transmit = through[:n, :n] + through[:n, n:] @ reflect
    for _ in range(halvings):
        bounced = np.linalg.solve(np.eye(n) - reflect @ reflect, transmit)
        reflect, transmit = reflect + transmit @ reflect @ bounced, transmit @ bounced
    return reflect, transmit
