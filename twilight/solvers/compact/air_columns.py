"""What the model of clear air reads from a medium: optical depths of layers, phase functions, inputs of the network."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import TABLE, PhaseFunction, table_angles_rad
from twilight.solvers.compact.diffuse_light import BOUNDARY_KM, ORDERS, DiffuseCoefficients
from twilight.transport.shells import ALTITUDE_KM, RefractedShells, sublayers

SPLIT_KM = 12.0
"""Altitude above the ground up to which the aerosol has the lower one of two phase functions [km]."""

LEAST_DEGREE = 12
"""Degree of the Legendre series that phase functions are followed to; the peak beyond counts as not scattered."""

MOST_DEGREE = 16
"""Degree to which LEAST_DEGREE grows beside coarse particles, as that of `zones` does (`directions.degree_needed`)."""

MOST_PEAK = 0.055
"""Fraction of the scattering in the peak up to which the degree does not grow."""

HAZE_DEPTHS = (3.0, 5.0)
"""Vertical optical depths of scattering between which the growth of the degree ends."""

LAYER_DEPTH = 0.02
"""Optical depth of scattering above 10 km from which the degree is the largest: below a volcano's layer."""

NEGLIGIBLE = 0.01
"""Fraction of the largest scattering coefficient below which air does not count."""

FEW_PARTICLES = 1e-3
"""Optical depth of aerosol below which its albedo and asymmetry mean nothing."""

SLAB_KM = np.array([0, 0.25, 0.7, 1.35, 2, 3, 4.5, 6, 8, 10, 12, 15, 19, 24, 30, 39, 60, 100])
"""Boundaries of the slabs whose optical depths are inputs of the network [km above the ground]."""

COARSE_SLABS = (0, 4, 8, 11, 13, 15, 17)
"""Indices into SLAB_KM of the slabs of the air's own scattering."""

ABSORPTION_SLABS = (*range(0, 18, 2), 17)
"""Indices into SLAB_KM of the slabs of absorption by aerosol."""

MOMENTS = (1, 2, 3, 4, 6, 8, 12)
"""Legendre moments of each phase function that are inputs of the network."""

ANGLES_DEG = (60.0, 90.0, 120.0, 150.0, 180.0)
"""Scattering angles at which the logarithm of each phase function is an input of the network [deg]."""

LIMITED = (
    "the optical depth of scattering by air",
    "the part of scattering by air above 39 km",
    "the optical depth of aerosol",
    "the optical depth of aerosol above 12 km",
    "the optical depth of aerosol above 60 km",
    "the single scattering albedo of the aerosol",
    "the asymmetry parameter of the aerosol below 12 km",
    "the asymmetry parameter of the aerosol above 12 km",
    "the refractivity of air at the ground, in 1e-4",
)
"""What must lie between the least and the largest value that the fit saw; in the words of messages."""

HIGH_KM = 39.0
"""Altitude above the ground [km] above which the fraction of scattering by air tells real from invented profiles."""

HIGHEST_KM = 60.0
"""Altitude above the ground [km] above which no air of the fit has particles."""

AIR, ABSORPTION, EXTINCTION, LOW, HIGH = range(5)
"""Rows of optical depths: scattering by air, absorption by gases, extinction by aerosol, its scattering below and above
SPLIT_KM."""


def two_phase_functions(medium: Medium) -> Medium:
    """The medium with one phase function below SPLIT_KM above its ground and one above: means over what scatters."""
    angle = table_angles_rad()
    cosine, z = np.cos(angle), medium.altitude_km
    high = z - medium.bottom_km > SPLIT_KM
    scattering = medium.aerosol_extinction_per_km * medium.aerosol_single_scattering_albedo
    matrices = np.array([phase.matrix(cosine) for phase in medium.phase_functions])
    matrices = matrices.reshape(len(medium.phase_functions), 4, medium.n_wavelengths, angle.size)
    thickness = np.maximum(_thickness(z), 1e-6)
    phases = []
    for name, part in (("low", ~high), ("high", high)):
        weight = np.einsum("klw,lw,l->kw", medium.aerosol_phase_fraction[:, part], scattering[part], thickness[part])
        total = weight.sum(axis=0)
        mixed = np.einsum("kw,kiwn->iwn", weight / np.maximum(total, 1e-30), matrices)
        mixed[0, total <= 0.0] = 1.0 / (4.0 * np.pi)
        sine = np.sin(angle)
        norm = 2.0 * np.pi * np.trapezoid(mixed[0] * sine, angle, axis=1)
        asymmetry = 2.0 * np.pi * np.trapezoid(mixed[0] * sine * cosine, angle, axis=1) / norm
        ratios = np.zeros((4, *mixed[0].shape))
        ratios[:3] = mixed[1:] / mixed[0]
        phases.append(PhaseFunction(TABLE, asymmetry, np.log(mixed[0] / norm[:, None]), name, ratios))
    fraction = np.zeros((2, z.size, medium.n_wavelengths))
    fraction[0, ~high], fraction[1, high] = 1.0, 1.0
    return replace(medium, phase_functions=tuple(phases), aerosol_phase_fraction=fraction)


def _thickness(altitude_km: np.ndarray) -> np.ndarray:
    """Thickness of air that each level stands for: half the distance between the levels beside it [km]."""
    step = np.diff(altitude_km)
    return 0.5 * (np.append(step, step[-1:]) + np.append(step[:1], step))


@dataclass(frozen=True)
class AirColumns:
    """A medium in the layers of the model, W wavelengths.

    depth (5, L, W): vertical optical depths of the layers, rows AIR to HIGH
    forward (2, W): fraction of each phase function in its forward peak, which counts as not scattered
    degree: up to which both phase functions are followed
    moments (2, W, N): Legendre moments of both phase functions
    medium: with its two phase functions
    aerosol_depth (K, L, W): optical depths of scattering by each aerosol that the medium came with
    aerosol_forward (K, W): fraction of phase_functions in their forward peaks
    aerosol_moments (K, W, N): Legendre moments of phase_functions
    phase_functions: of the aerosols that the medium came with
    """

    depth: np.ndarray
    forward: np.ndarray
    degree: int
    moments: np.ndarray
    medium: Medium
    aerosol_depth: np.ndarray
    aerosol_forward: np.ndarray
    aerosol_moments: np.ndarray
    phase_functions: tuple[PhaseFunction, ...]

    @staticmethod
    def of(medium: Medium) -> AirColumns:
        merged = two_phase_functions(medium)
        fine = merged.refined()
        height = fine.altitude_km - fine.bottom_km
        scattering = fine.aerosol_extinction_per_km * fine.aerosol_single_scattering_albedo
        parts = [fine.air_scattering_per_km, fine.absorption_per_km, fine.aerosol_extinction_per_km]
        parts += [scattering * fraction for fraction in fine.aerosol_phase_fraction]
        depth = [_in_layers(height, part) for part in parts]
        moments = np.array([phase.legendre_moments(MOST_DEGREE + 1) for phase in merged.phase_functions])
        degree = _degree(np.array(depth), moments)
        exact = medium.refined()
        scattering = exact.aerosol_extinction_per_km * exact.aerosol_single_scattering_albedo
        aerosol_depth = [_in_layers(height, scattering * fraction) for fraction in exact.aerosol_phase_fraction]
        shape = (len(medium.phase_functions), *np.shape(depth)[1:])
        of_aerosols = [phase.legendre_moments(MOST_DEGREE + 1) for phase in medium.phase_functions]
        aerosol_moments = np.reshape(of_aerosols, (shape[0], shape[2], MOST_DEGREE + 2))
        return AirColumns(
            np.array(depth),
            _peak_fraction(moments, degree),
            int(np.ceil(degree)),
            moments,
            merged,
            np.reshape(aerosol_depth, shape),
            _peak_fraction(aerosol_moments, degree),
            aerosol_moments,
            medium.phase_functions,
        )

    def limited(self) -> np.ndarray:
        """What `LIMITED` names, (L, W); nan where there are no particles to have it."""
        d = self.depth
        scattered = d[LOW] + d[HIGH]
        above, high, highest = (ALTITUDE_KM[:-1] >= z for z in (SPLIT_KM, HIGH_KM, HIGHEST_KM))
        of_aerosol = d[EXTINCTION].sum(axis=0)
        few = of_aerosol < FEW_PARTICLES
        albedo = np.where(few, np.nan, scattered.sum(axis=0) / np.maximum(of_aerosol, FEW_PARTICLES))
        asymmetry = [
            np.where(d[row].sum(axis=0) < FEW_PARTICLES, np.nan, self.moments[k, :, 1])
            for k, row in ((0, LOW), (1, HIGH))
        ]
        return np.stack(
            [
                d[AIR].sum(axis=0),
                d[AIR][high].sum(axis=0) / d[AIR].sum(axis=0),
                of_aerosol,
                d[EXTINCTION][above].sum(axis=0),
                d[EXTINCTION][highest].sum(axis=0),
                albedo,
                *asymmetry,
                np.full(self.medium.n_wavelengths, 1e4 * self.medium.refractivity[0].mean()),
            ]
        )

    def shells(self, observer_km: float) -> tuple[RefractedShells, tuple[np.ndarray, np.ndarray]]:
        """The shells around an observer above the ground, and in their layers the coefficient of scattering without
        peaks, and that times three times its asymmetry [km^-1]."""
        boundary = ALTITUDE_KM
        if np.abs(boundary - observer_km).min() > 1e-4:
            boundary = np.sort(np.append(boundary, observer_km))
        layer = np.searchsorted(ALTITUDE_KM, 0.5 * (boundary[1:] + boundary[:-1])) - 1
        per_km = 1.0 / np.diff(ALTITUDE_KM)[:, None]
        d, medium = self.depth, self.medium
        peak = np.einsum("kw,klw->lw", self.aerosol_forward, self.aerosol_depth)
        forward = 3.0 * np.einsum(
            "kw,klw->lw", self.aerosol_moments[:, :, 1] - self.aerosol_forward, self.aerosol_depth
        )
        shells = RefractedShells(
            boundary,
            ((d[AIR] + d[ABSORPTION] + d[EXTINCTION] - peak) * per_km)[layer],
            (np.concatenate([d[AIR][None], self.aerosol_depth]) * per_km)[:, layer],
            (peak * per_km)[layer],
            medium.at(sublayers(boundary) + medium.bottom_km).refractivity[:, medium.n_wavelengths // 2],
            observer_km,
            medium.earth_radius_km + medium.bottom_km,
        )
        scattering = d[AIR] + self.aerosol_depth.sum(axis=0) - peak
        return shells, ((scattering * per_km)[layer], (forward * per_km)[layer])

    def diffuse_coefficients(self) -> DiffuseCoefficients:
        """For `diffuse_light`: later orders by the similarity rule, the first with its phase functions."""
        place = np.searchsorted(ALTITUDE_KM, BOUNDARY_KM - 1e-9)
        every = np.concatenate([self.depth, self.aerosol_depth])
        d = np.diff(_summed(every)[:, place], axis=1)
        of_aerosols = d[self.depth.shape[0] :]
        per_km = 1.0 / np.diff(BOUNDARY_KM)[:, None]
        chi = self.aerosol_moments
        forwards = np.einsum("kw,klw->lw", chi[:, :, 1], of_aerosols)
        scattering = d[AIR] + of_aerosols.sum(axis=0) - forwards
        extinction = d[AIR] + d[ABSORPTION] + d[EXTINCTION] - forwards
        rho = self.medium.depolarisation
        of_air = [np.ones_like(rho), np.zeros_like(rho), (1.0 - rho) / (5.0 * (2.0 + rho)), np.zeros_like(rho)]
        first = []
        for order in range(ORDERS):
            # of what is scattered without the peak: (1 - f) x (chi - f)/(1 - f)
            of_aerosol = np.einsum("kw,klw->lw", chi[:, :, order] - self.aerosol_forward, of_aerosols)
            first.append((2 * order + 1) * (of_air[order] * d[AIR] + of_aerosol) / scattering)
        return DiffuseCoefficients(extinction * per_km, scattering * per_km, np.array(first))

    def inputs(self, observer_km: float) -> np.ndarray:
        """Inputs of the network that name the air, (W, F)."""
        d, f = self.depth, self.forward
        absorbed = np.maximum(d[EXTINCTION] - d[LOW] - d[HIGH], 0.0)
        particles = (1.0 - f[0]) * d[LOW] + (1.0 - f[1]) * d[HIGH]
        total = d[AIR] + d[ABSORPTION] + d[EXTINCTION] - f[0] * d[LOW] - f[1] * d[HIGH]  # extinction without peaks
        every = tuple(range(SLAB_KM.size))
        rows = [
            np.sqrt(np.maximum(_slabs(particles, every), 0.0)),
            np.sqrt(np.maximum(_slabs(absorbed, ABSORPTION_SLABS), 0.0)),
            np.sqrt(np.maximum(_slabs(d[ABSORPTION], every), 0.0)),
            np.log(_slabs(d[AIR], COARSE_SLABS)),
            np.log(
                [
                    d[AIR].sum(axis=0),
                    total.sum(axis=0),
                    d[ABSORPTION].sum(axis=0) + 1e-4,
                    particles.sum(axis=0) + 1e-4,
                    absorbed.sum(axis=0) + 1e-4,
                    ((1.0 - f[1]) * d[HIGH]).sum(axis=0) + 1e-5,
                ]
            ),
        ]
        angle = table_angles_rad()
        sine = np.sin(angle)
        for k, phase in enumerate(self.medium.phase_functions):
            scaled = (self.moments[k] - f[k][:, None]) / (1.0 - f[k][:, None])
            polarising = phase.matrix(np.cos(angle))[1]
            rows += [
                scaled[:, MOMENTS].T,
                (2.0 * np.pi * np.trapezoid(polarising * sine**3, angle, axis=-1))[None],
                f[k][None],
                np.log(phase(np.cos(np.radians(ANGLES_DEG))).T),
            ]
        n = self.medium.n_wavelengths
        rows += [self.medium.ground_albedo[None], np.full((1, n), 1e4 * self.medium.refractivity[0].mean())]
        rows += [np.full((1, n), observer_km), np.full((1, n), np.sqrt(observer_km))]
        rows += [
            _below(total, observer_km),
            np.sqrt(_below(d[AIR], observer_km)),
            np.sqrt(_below(particles, observer_km)),
        ]
        return np.concatenate(rows).T


def _in_layers(height_km: np.ndarray, per_km: np.ndarray) -> np.ndarray:
    """Optical depths of the layers (L, W) of a coefficient (Z, W) at heights above the ground."""
    step = np.diff(height_km)[:, None]
    below = _summed(0.5 * step * (per_km[1:] + per_km[:-1]))
    return np.diff([[np.interp(z, height_km, column) for column in below.T] for z in ALTITUDE_KM], axis=0)


def _summed(depth: np.ndarray) -> np.ndarray:
    """Optical depths (..., L + 1, W) below the boundaries of layers, from those of the layers (..., L, W)."""
    return np.concatenate([np.zeros_like(depth[..., :1, :]), np.cumsum(depth, axis=-2)], axis=-2)


def _slabs(depth: np.ndarray, slabs: tuple[int, ...]) -> np.ndarray:
    """Optical depths between some of the boundaries SLAB_KM, of those of the layers (L, W)."""
    place = np.abs(ALTITUDE_KM[None] - SLAB_KM[list(slabs), None]).argmin(axis=1)
    return np.diff(_summed(depth)[place], axis=0)


def _below(depth: np.ndarray, altitude_km: float) -> np.ndarray:
    """Optical depth below an altitude above the ground, (1, W)."""
    return np.array([[np.interp(altitude_km, ALTITUDE_KM, column) for column in _summed(depth).T]])


def _degree(depth: np.ndarray, moments: np.ndarray) -> float:
    """The degree to which phase functions are followed, from depths (5, L, W) and moments (2, W, N); a fraction stands
    between two."""
    scattered = depth[LOW] + depth[HIGH]
    everything = depth[AIR] + scattered
    per_km = everything / np.diff(ALTITUDE_KM)[:, None]
    counts = (everything > 0.0) & (per_km >= NEGLIGIBLE * per_km.max(axis=0))
    part = [np.where(counts, depth[row] / np.where(counts, everything, 1.0), 0.0) for row in (LOW, HIGH)]
    degree = float(LEAST_DEGREE)
    peak = np.array(
        [sum(part[k] * moments[k, :, n + 1] for k in (0, 1)).max() for n in range(LEAST_DEGREE, MOST_DEGREE + 1)]  # type: ignore[union-attr]
    )
    large = np.flatnonzero(peak > MOST_PEAK)
    thin, thick = HAZE_DEPTHS
    grows = float(np.clip((thick - everything.sum(axis=0).max()) / (thick - thin), 0.0, 1.0))
    if large.size:
        last = int(large[-1])
        enough = float(last)
        if last + 1 < peak.size:
            enough += float((peak[last] - MOST_PEAK) / (peak[last] - peak[last + 1]))
        degree += grows * enough
    aloft = ALTITUDE_KM[:-1] >= 10.0
    if scattered[aloft].sum(axis=0).max() > LAYER_DEPTH:
        degree = float(MOST_DEGREE)
    return degree


def _peak_fraction(moments: np.ndarray, degree: float) -> np.ndarray:
    """Fraction of each phase function in its forward peak, (K, W): its moment after the last that is followed."""
    whole = int(degree)
    rest = degree - whole
    after = moments[:, :, min(whole + 2, MOST_DEGREE + 1)]
    return np.clip((1.0 - rest) * moments[:, :, whole + 1] + rest * after, 0.0, 0.999)
