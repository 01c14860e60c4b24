"""Box air-mass factors by random paths: unbiased, with standard errors.

With x the light of a sample, y_j its light times its path length in layer j and h_j the layer's thickness, the factor
of layer j is

    A_j = -d ln I / d tau_j = <y_j> / (<x> h_j).

v being the control variate of the walk, whose mean is 0, the estimate is (<y_j> - c_j <v>) / <x> with c_j the
regression of y_j - A_j h_j x on v, and its standard error that of what is left, y_j - A_j h_j x - c_j v (ratio estimate
with regression: Cochran 1977, Sampling Techniques, 3rd ed., secs. 6.4 and 7.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from twilight.atmosphere.layer_changes import layer_edges
from twilight.atmosphere.medium import with_joined_refractivity
from twilight.base.errors import TwilightError
from twilight.base.threads import in_slices
from twilight.solvers.montecarlo.chunks import ChunkJobs, Pixels
from twilight.solvers.montecarlo.length_walk import (
    N_PATHS,
    N_SCALARS,
    LengthSums,
    run_length_chunks,
    single_scattering,
)
from twilight.solvers.montecarlo.path_lengths import BoxLayers
from twilight.transport.ray_profile import ray_profile

if TYPE_CHECKING:
    from twilight.solvers.montecarlo.field import Field

PILOT_SAMPLES = 64
"""Samples of a pixel from which the number of samples for a target follows; none of them counts in the answer."""
CHUNK_SAMPLES = 64
"""Samples of one stream of random numbers."""


@dataclass(frozen=True)
class BoxAirMass:
    """Box air-mass factors of P pixels in J layers at W wavelengths.

    factor, standard_error (P, J, W); radiance (P, W) [sr^-1]: sun-normalised; samples (P, W): how many of them.
    """

    factor: np.ndarray
    standard_error: np.ndarray
    radiance: np.ndarray
    samples: np.ndarray


@dataclass(frozen=True)
class Derivatives:
    """d ln I / d tau of the layers between edges_km (J + 1,) [km]: minus the box air-mass factors."""

    field: Field
    edges_km: np.ndarray

    def log_slopes(self, sun_elevation_deg, elevation_deg, azimuth_deg) -> tuple[np.ndarray, np.ndarray]:
        """d ln I / d tau and its standard error, shape of the directions plus (J, W) each; nan where all is dark."""
        pixels, shape = self.field.question(sun_elevation_deg, elevation_deg, azimuth_deg)
        found = box_air_mass(self.field, pixels, self.edges_km)
        full = (*shape, *found.factor.shape[1:])
        return -found.factor.reshape(full), found.standard_error.reshape(full)


def differentiate(field: Field, quantity: str, edges_km: np.ndarray, shifted: object = None) -> Derivatives:
    """Derivatives by absorption in the layers between edges_km (J + 1,) [km]; shifted: not needed.

    Errors: TwilightError for any other quantity, and edges that are none.
    """
    if quantity != "absorption":
        raise TwilightError(f"derivatives: montecarlo cannot differentiate by {quantity}; it can by absorption")
    return Derivatives(field, layer_edges(field.medium, edges_km))


def box_air_mass(field: Field, pixels: Pixels, edges_km: np.ndarray) -> BoxAirMass:
    """Factors of the layers between edges_km (J + 1,) [km] for every pixel and wavelength of a field.

    Samples are those of the field's settings: `target_stderr` is here the standard error of the least certain layer
    over the factor of the largest layer.

    Errors: TwilightError for "isotropic_after_first", in whose air events and lines of sight differ.
    """
    settings = field.settings
    if settings.approximation != "none":
        raise TwilightError(
            f"air-mass factors: montecarlo cannot differentiate its approximation {settings.approximation}; allowed is "
            "none"
        )
    run = _LengthRun(field, pixels, np.ascontiguousarray(edges_km, dtype=float))
    shape = (pixels.key.size, field.medium.n_wavelengths)
    target = settings.target_stderr
    if target is None:
        return run.answer(run.sums(np.full(shape, settings.samples, dtype=np.int64), 0))
    pilot = run.answer(run.sums(np.full(shape, PILOT_SAMPLES, dtype=np.int64), 0))
    largest = np.maximum(np.abs(pilot.factor).max(axis=1), 1e-300)
    wanted = PILOT_SAMPLES * (pilot.standard_error.max(axis=1) / (target * largest)) ** 2
    count = np.clip(np.ceil(np.nan_to_num(wanted)), PILOT_SAMPLES, settings.max_samples).astype(np.int64)
    return run.answer(run.sums(count, 1))


class _LengthRun:
    """Samples of one question, with path lengths."""

    def __init__(self, field: Field, pixels: Pixels, edges_km: np.ndarray):
        self.field, self.pixels = field, pixels
        settings, medium = field.settings, field.medium
        bent = settings.refraction and medium.has_refraction
        profile = ray_profile(with_joined_refractivity(medium) if bent else medium, refraction=bent)
        self.layers = BoxLayers(edges_km, profile)
        self.walk = settings.walk(medium.has_refraction)
        n_pixels, n_layers = pixels.key.size, edges_km.size - 1
        self.single = np.zeros((n_pixels, medium.n_wavelengths))
        self.single_lengths = np.zeros((n_pixels, medium.n_wavelengths, n_layers))
        in_slices(
            lambda begin, end: single_scattering(
                field.air, self.layers, field.sun, field.importance, self.walk, pixels, begin, end,
                self.single, self.single_lengths,
            ),
            n_pixels,
        )  # fmt: skip

    def sums(self, samples: np.ndarray, stage: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(count (P, W), scalars (P, W, N_SCALARS), paths (P, W, N_PATHS, J)) of so many samples (P, W).

        stage: 0 or 1, with random numbers of its own.
        """
        field = self.field
        chunks = -(-samples // CHUNK_SAMPLES)
        pixel, wavelength = (np.repeat(a.ravel(), chunks.ravel()) for a in np.indices(samples.shape))
        first = np.repeat(np.cumsum(chunks.ravel()) - chunks.ravel(), chunks.ravel())
        number = np.arange(first.size) - first
        size = np.minimum(CHUNK_SAMPLES, samples[pixel, wavelength] - number * CHUNK_SAMPLES)
        # streams of their own: those of radiances are even or odd numbers of chunks below 2^32
        chunk = number + (1 + stage) * 2**40
        jobs = ChunkJobs(pixel, wavelength, np.zeros_like(pixel), chunk, size)
        n_layers = self.layers.edges_km.size - 1
        found = LengthSums(
            np.zeros((size.size, N_SCALARS)),
            np.zeros((size.size, N_PATHS, n_layers)),
            np.zeros(size.size, dtype=np.int64),
        )
        in_slices(
            lambda begin, end: run_length_chunks(
                field.air, self.layers, field.sun, field.importance, self.walk, np.uint64(field.settings.seed),
                self.pixels, jobs, begin, end, self.single, self.single_lengths, found,
            ),
            size.size,
        )  # fmt: skip
        if found.limits.any():
            raise TwilightError(
                "air-mass factors: montecarlo met a safety limit of its paths in this air; allowed is thinner air"
            )
        where: Any = (pixel, wavelength)
        scalars = np.zeros((*samples.shape, N_SCALARS))
        paths = np.zeros((*samples.shape, N_PATHS, n_layers))
        np.add.at(scalars, where, found.scalars)
        np.add.at(paths, where, found.paths)
        return samples, scalars, paths

    def answer(self, sums: tuple[np.ndarray, np.ndarray, np.ndarray]) -> BoxAirMass:
        """Factors from the sums of `sums`."""
        count, scalars, paths = sums
        n = count[..., None].astype(float)
        x, xx, v, vv, xv = (scalars[..., k][..., None] / n for k in range(N_SCALARS))
        y, yy, xy, vy = (paths[..., k, :] / n for k in range(N_PATHS))
        safe = np.where(x > 0.0, x, 1.0)
        ratio = y / safe
        # (co)variances of the residual z = y - ratio x, whose mean is 0, and of the control variate
        of_control = np.maximum(vv - v * v, 0.0)
        with_control = (vy - v * y) - ratio * (xv - x * v)
        slope = np.where(of_control > 0.0, with_control / np.where(of_control > 0.0, of_control, 1.0), 0.0)
        variance = (yy - y * y) - 2.0 * ratio * (xy - x * y) + ratio**2 * (xx - x * x) - slope * with_control
        thickness = np.diff(self.layers.edges_km)
        factor = (ratio - slope * v / safe) / thickness
        error = np.sqrt(np.maximum(variance, 0.0) / (n - 1.0)) / safe / thickness
        lit = x > 0.0
        factor, error = np.where(lit, factor, np.nan), np.where(lit, error, np.nan)
        return BoxAirMass(factor.swapaxes(1, 2), error.swapaxes(1, 2), x[..., 0], count)
