"""The optical medium: what every solver gets, and all that it gets.

A medium is a list of levels.  The logarithms of the scattering and the refractivity of air go through them as monotone
cubics with continuous slopes (:mod:`twilight.atmosphere.smooth`): a bend of the index at a level would focus the
sunbeam below it.  Other coefficients go exponentially between two levels.  Where one end is 0 all go linearly; single
scattering albedo and the shares of the phase functions always do.  Two levels at the same altitude are a jump, at which
a new curve begins unless both hold the same value.  Outside the levels is vacuum above and the ground below.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from twilight.atmosphere.reference import Reference
from twilight.atmosphere.smooth import interpolate_smooth, log_cubics, monotone_cubic
from twilight.conventions import EARTH_RADIUS_KM
from twilight.errors import TwilightError
from twilight.kernels import njit
from twilight.phase import PhaseFunction

ON_LEVELS = (
    "air_scattering_per_km",
    "absorption_per_km",
    "aerosol_extinction_per_km",
    "aerosol_single_scattering_albedo",
    "refractivity",
)
"""What a medium has on levels and at wavelengths, (L, W)."""
SMALL_JUMP = 1e-3
"""Relative jump of the refractivity that is taken as a rounding of the table."""


@dataclass(frozen=True)
class Medium:
    """Spherically symmetric air, L levels, W wavelengths, K aerosol phase functions.

    altitude_km (L,) not decreasing, first level = ground; an altitude that appears twice is a jump.
    wavelength_nm (W,)
    air_scattering_per_km, absorption_per_km (gases), aerosol_extinction_per_km, refractivity (n - 1): (L, W)
    aerosol_single_scattering_albedo (L, W)
    aerosol_share (K, L, W): share of the aerosol's scattering that follows phase function k, sums to 1 over k
    phase_functions: K of them, each at the W wavelengths
    depolarisation (W,): of the Rayleigh phase function, 0 = 3/(16 pi)(1 + cos^2)
    ground_albedo (W,): Lambertian; of a water surface that of the light from below it
    overhead_absorption_optical_depth (W,): a filter on the unscattered sunlight above the top, crossed vertically
        whatever the sun's direction (Haber 2005 sec. 4.3); 0 unless a preset asks for it
    water_mean_square_slope: of a ground that is a water surface (:mod:`twilight.water`); 0: the ground is land
    """

    wavelength_nm: np.ndarray
    altitude_km: np.ndarray
    air_scattering_per_km: np.ndarray
    absorption_per_km: np.ndarray
    aerosol_extinction_per_km: np.ndarray
    aerosol_single_scattering_albedo: np.ndarray
    aerosol_share: np.ndarray
    phase_functions: tuple[PhaseFunction, ...]
    refractivity: np.ndarray
    depolarisation: np.ndarray
    ground_albedo: np.ndarray
    overhead_absorption_optical_depth: np.ndarray
    earth_radius_km: float = EARTH_RADIUS_KM
    water_mean_square_slope: float = 0.0
    name: str = ""
    notes: dict = field(default_factory=dict)

    def __post_init__(self):
        z, w = self.altitude_km, self.wavelength_nm
        shape = (z.size, w.size)
        if z.size < 2 or not np.all(np.isfinite(z)) or np.any(np.diff(z) < 0) or z[-1] <= z[0]:
            raise TwilightError(f"medium {self.name}: altitude_km must hold at least two levels that do not decrease")
        for key in ON_LEVELS:
            a = getattr(self, key)
            if a.shape != shape:
                raise TwilightError(f"medium {self.name}: {key} has shape {a.shape}, expected {shape}")
            if not np.all(np.isfinite(a)) or np.any(a < 0):
                raise TwilightError(f"medium {self.name}: {key} must be finite and not negative")
        if np.any(self.aerosol_single_scattering_albedo > 1):
            raise TwilightError(f"medium {self.name}: aerosol_single_scattering_albedo must be between 0 and 1")
        if self.aerosol_share.shape != (len(self.phase_functions), *shape):
            raise TwilightError(f"medium {self.name}: aerosol_share has shape {self.aerosol_share.shape}")

    @property
    def n_wavelengths(self) -> int:
        return self.wavelength_nm.size

    @property
    def bottom_km(self) -> float:
        return float(self.altitude_km[0])

    @property
    def top_km(self) -> float:
        return float(self.altitude_km[-1])

    @property
    def has_water(self) -> bool:
        """Whether the ground is a water surface."""
        return self.water_mean_square_slope > 0.0

    @property
    def has_refraction(self) -> bool:
        return bool(np.any(self.refractivity > 0))

    @property
    def has_aerosol(self) -> bool:
        return bool(np.any(self.aerosol_extinction_per_km > 0))

    @property
    def extinction_per_km(self) -> np.ndarray:
        """Total extinction at the levels, (L, W); between levels each of its three parts is interpolated by itself."""
        return self.air_scattering_per_km + self.absorption_per_km + self.aerosol_extinction_per_km

    @property
    def reference(self) -> Medium | None:
        """The same air at fixed wavelengths, by which grids are laid out (:mod:`twilight.atmosphere.reference`).

        None where it is not known.  `dataclasses.replace` drops it, for what it makes is other air.
        """
        made: Reference | None = getattr(self, "_reference", None)
        return None if made is None else made.medium()

    def with_reference(self, reference: Reference | None) -> Medium:
        """The same medium with that reference; None: with none."""
        out = replace(self)
        object.__setattr__(out, "_reference", reference)
        return out

    def select(self, wavelengths: slice | np.ndarray) -> Medium:
        """The same medium at some of its wavelengths, with its reference."""
        s = wavelengths
        phases = tuple(p.select(s) for p in self.phase_functions)
        cut = {key: getattr(self, key)[:, s] for key in ON_LEVELS}
        selected = replace(
            self,
            wavelength_nm=self.wavelength_nm[s],
            aerosol_share=self.aerosol_share[:, :, s],
            phase_functions=phases,
            depolarisation=self.depolarisation[s],
            ground_albedo=self.ground_albedo[s],
            overhead_absorption_optical_depth=self.overhead_absorption_optical_depth[s],
            **cut,
        )
        return selected.with_reference(getattr(self, "_reference", None))

    def at(self, altitude_km) -> Coefficients:
        """Coefficients at altitudes of any shape; an altitude on a jump takes the value above it, outside is 0."""
        z = np.asarray(altitude_km, dtype=float)
        levels = self.altitude_km
        i = np.clip(np.searchsorted(levels, z, side="right") - 1, 0, levels.size - 2)
        dz = levels[i + 1] - levels[i]
        f = np.clip((z - levels[i]) / np.where(dz > 0, dz, 1.0), 0.0, 1.0)[..., None]
        inside = ((z >= levels[0]) & (z <= levels[-1]))[..., None]

        def exponential(a):
            return np.where(inside, interpolate_coefficient(a[i], a[i + 1], f), 0.0)

        def smooth(a):
            pieces = log_cubics(levels, a)[:, i]
            return np.where(inside, interpolate_smooth(a[i], a[i + 1], pieces, f), 0.0)

        def linear(a):
            return a[i] * (1 - f) + a[i + 1] * f

        return Coefficients(
            air_scattering=smooth(self.air_scattering_per_km),
            absorption=exponential(self.absorption_per_km),
            aerosol_extinction=exponential(self.aerosol_extinction_per_km),
            aerosol_albedo=linear(self.aerosol_single_scattering_albedo),
            aerosol_share=np.stack([linear(s) for s in self.aerosol_share])
            if len(self.aerosol_share)
            else np.zeros((0, *f.shape[:-1], self.n_wavelengths)),
            refractivity=smooth(self.refractivity),
        )

    def refined(self, max_thickness_km: float = 0.25, tolerance: float = 1e-4, like: Medium | None = None) -> Medium:
        """The same medium with levels inserted until linear interpolation of every coefficient is good to `tolerance`.

        Kernels interpolate linearly on the refined levels, which costs no exponential per step.  For a coefficient that
        falls by q = ln(a/b) over a level, linear interpolation is off by q^2/8 at most.

        like: the same levels at other wavelengths, whose coefficients say how many are inserted.
        """
        z = self.altitude_km
        whose = like or self
        new = [z[:1]]
        with np.errstate(divide="ignore", invalid="ignore"):
            steps = np.zeros(z.size - 1)
            for a in (
                whose.air_scattering_per_km,
                whose.absorption_per_km,
                whose.aerosol_extinction_per_km,
                whose.refractivity,
            ):
                lo, hi = a[:-1], a[1:]
                q = np.where((lo > 0) & (hi > 0), np.abs(np.log(hi / np.where(lo > 0, lo, 1))), 0.0)
                q = np.where(np.maximum(lo, hi) > 1e-12, q, 0.0)
                steps = np.maximum(steps, np.nanmax(q, axis=1))
        for i, (a, b) in enumerate(pairwise(z)):
            if b <= a:
                new.append(np.array([b]))
                continue
            n = int(np.ceil(max(steps[i] / np.sqrt(8 * tolerance), (b - a) / max(max_thickness_km, 0.02 * (a - z[0])))))
            new.append(np.linspace(a, b, max(1, min(n, 400)) + 1)[1:])
        return self._on_levels(new)

    def _on_levels(self, pieces: list[np.ndarray]) -> Medium:
        z = self.altitude_km
        smooth = {key: log_cubics(z, getattr(self, key)) for key in ("air_scattering_per_km", "refractivity")}
        rows: dict[str, list[np.ndarray]] = {}
        for i, piece in enumerate(pieces):
            lo = max(i - 1, 0)
            hi = i if i else 1
            dz = z[hi] - z[lo]
            if i == 0:
                f = np.zeros((1, 1))
            else:
                f = ((piece - z[lo]) / dz if dz > 0 else np.ones(piece.size))[:, None]
            for key in ("absorption_per_km", "aerosol_extinction_per_km"):
                a = getattr(self, key)
                rows.setdefault(key, []).append(interpolate_coefficient(a[lo], a[hi], f))
            for key, cubics in smooth.items():
                a = getattr(self, key)
                rows.setdefault(key, []).append(interpolate_smooth(a[lo], a[hi], cubics[:, lo], f))
            a = self.aerosol_single_scattering_albedo
            rows.setdefault("aerosol_single_scattering_albedo", []).append(a[lo] * (1 - f) + a[hi] * f)
            for k, s in enumerate(self.aerosol_share):
                rows.setdefault(f"share{k}", []).append(s[lo] * (1 - f) + s[hi] * f)
        made: dict[str, Any] = {key: np.concatenate(value) for key, value in rows.items()}
        levels = np.concatenate(pieces)
        n_phase = len(self.phase_functions)
        share = (
            np.stack([made.pop(f"share{k}") for k in range(n_phase)])
            if n_phase
            else np.zeros((0, levels.size, self.n_wavelengths))
        )
        return replace(self, altitude_km=levels, aerosol_share=share, **made)

    def optical_depth(self, part: str = "total") -> np.ndarray:
        """Vertical optical depth (W,) of `air`, `absorption`, `aerosol` or `total`; exact for the levels' rule.

        For that of air to 1e-9 by Gauss-Legendre quadrature.
        """
        parts: dict[str, tuple[np.ndarray, ...]] = {
            "air": (self.air_scattering_per_km,),
            "absorption": (self.absorption_per_km,),
            "aerosol": (self.aerosol_extinction_per_km,),
        }
        parts["total"] = parts["air"] + parts["absorption"] + parts["aerosol"]
        dz = np.diff(self.altitude_km)[:, None]
        total = np.zeros(self.n_wavelengths)
        for a in parts[part]:
            mean = layer_mean(a[:-1], a[1:])
            if a is self.air_scattering_per_km:
                mean = smooth_mean(self.altitude_km, a, mean)
            total = total + (mean * dz).sum(axis=0)
        return total

    def arrays(self) -> MediumArrays:
        """The same as plain contiguous arrays for kernels."""
        c = np.ascontiguousarray
        n_phase = len(self.phase_functions)
        width = max((p.log_table.shape[1] for p in self.phase_functions), default=1)
        tables = np.zeros((n_phase, self.n_wavelengths, width))
        ratios = np.zeros((n_phase, 4, self.n_wavelengths, width))
        for k, p in enumerate(self.phase_functions):
            if p.log_table.shape[1] not in (1, width):
                raise ValueError("phase tables of one medium must have the same number of nodes")
            tables[k, :, : p.log_table.shape[1]] = p.log_table
            ratios[k, :, :, : p.log_table.shape[1]] = p.ratios
        kinds = np.array([p.kind for p in self.phase_functions], dtype=np.int64)
        g = np.array([p.asymmetry for p in self.phase_functions]).reshape(n_phase, self.n_wavelengths)
        return MediumArrays(
            c(self.altitude_km, dtype=float),
            c(self.air_scattering_per_km, dtype=float),
            c(self.absorption_per_km, dtype=float),
            c(self.aerosol_extinction_per_km, dtype=float),
            c(self.aerosol_single_scattering_albedo, dtype=float),
            c(self.aerosol_share, dtype=float),
            c(self.refractivity, dtype=float),
            kinds,
            g,
            tables,
            ratios,
            c(self.depolarisation, dtype=float),
            c(self.ground_albedo, dtype=float),
            float(self.earth_radius_km),
        )


class Coefficients(NamedTuple):
    """Local coefficients, each with the shape of the altitudes plus (W,); aerosol_share has K in front."""

    air_scattering: np.ndarray
    absorption: np.ndarray
    aerosol_extinction: np.ndarray
    aerosol_albedo: np.ndarray
    aerosol_share: np.ndarray
    refractivity: np.ndarray

    @property
    def aerosol_scattering(self) -> np.ndarray:
        return self.aerosol_extinction * self.aerosol_albedo

    @property
    def extinction(self) -> np.ndarray:
        return self.air_scattering + self.absorption + self.aerosol_extinction


class MediumArrays(NamedTuple):
    """A medium as arrays for njit kernels; same meaning and shapes as in :class:`Medium`.

    phase_kind (K,), phase_asymmetry (K, W), phase_log_table (K, W, N), phase_ratios (K, 4, W, N): of the K phase
    functions, as in :class:`PhaseFunction`.
    """

    altitude_km: np.ndarray
    air_scattering: np.ndarray
    absorption: np.ndarray
    aerosol_extinction: np.ndarray
    aerosol_albedo: np.ndarray
    aerosol_share: np.ndarray
    refractivity: np.ndarray
    phase_kind: np.ndarray
    phase_asymmetry: np.ndarray
    phase_log_table: np.ndarray
    phase_ratios: np.ndarray
    depolarisation: np.ndarray
    ground_albedo: np.ndarray
    earth_radius_km: float


def interpolate_coefficient(lower, upper, fraction):
    """lower^(1-f) upper^f, or linear where one end is 0 (the rule of what is not air)."""
    positive = (lower > 0) & (upper > 0)
    lo = np.where(positive, lower, 1.0)
    hi = np.where(positive, upper, 1.0)
    return np.where(positive, lo * (hi / lo) ** fraction, lower * (1 - fraction) + upper * fraction)


def smooth_mean(altitude_km: np.ndarray, coefficient: np.ndarray, exponential_mean: np.ndarray) -> np.ndarray:
    """Mean (L - 1, W) over each layer under the rule of `log_cubics`, from that under the exponential one.

    What quadrature adds is the small difference of the two, so that exponential air is exact.
    """
    lower, upper = coefficient[:-1], coefficient[1:]
    piece = log_cubics(altitude_km, coefficient)
    x, weight = np.polynomial.legendre.leggauss(8)
    mean = np.array(exponential_mean)
    for f, g in zip(0.5 * (x + 1.0), 0.5 * weight, strict=True):
        mean += g * (interpolate_smooth(lower, upper, piece, f) - interpolate_coefficient(lower, upper, f))
    return mean


def with_joined_refractivity(medium: Medium) -> Medium:
    """The medium with an index without jumps, by which light is bent.

    At a jump all rays close to the horizontal would be reflected or focused, which is a property of layers and not of
    air. An index that jumps is replaced by the smooth curve through its means at the middles of the layers; below the
    lowest of them it falls as between the lowest two.
    """
    z, n = medium.altitude_km, medium.refractivity
    thick = np.diff(z) > 0
    jumps = ~thick[:, None] & (np.abs(np.diff(n, axis=0)) > SMALL_JUMP * n[:-1])
    levels, place = np.unique(z, return_inverse=True)
    if not np.any(jumps) or np.count_nonzero(thick) < 2:
        count = np.bincount(place)
        joined = [(np.bincount(place, column) / count)[place] for column in n.T]
        return replace(medium, refractivity=np.stack(joined, axis=1))
    middle = 0.5 * (z[1:] + z[:-1])[thick]
    value = 0.5 * (n[1:] + n[:-1])[thick]
    value = np.log(np.maximum(value, np.maximum(1e-9 * value.max(axis=0), 1e-300)))
    fall = (value[1] - value[0]) / (middle[1] - middle[0])
    lowest = value[0] - fall * (middle[0] - z[0])
    top = np.minimum(value[-1], np.log(np.maximum(n[-1], 1e-9 * n.max(axis=0) + 1e-300)))
    x, y = np.concatenate([z[:1], middle, z[-1:]]), np.concatenate([[lowest], value, [top]])
    smooth = [np.exp(monotone_cubic(levels, x, column)) * (column.max() > np.log(1e-200)) for column in y.T]
    return replace(medium, refractivity=np.stack(smooth, axis=1)[place])


def layer_mean(lower, upper):
    """Mean of a coefficient over a layer under the same rule: (a - b)/ln(a/b), careful when a is close to b."""
    positive = (lower > 0) & (upper > 0)
    lo = np.where(positive, lower, 1.0)
    q = np.log(np.where(positive, upper, 1.0) / lo)
    small = np.abs(q) < 1e-6
    mean = lo * np.where(small, 1.0 + 0.5 * q, np.expm1(q) / np.where(small, 1.0, q))
    return np.where(positive, mean, 0.5 * (lower + upper))


@njit(inner=True, cache=True)
def level_below(altitude_km, z):
    """Index i with altitude_km[i] <= z < altitude_km[i+1], clipped to [0, L-2]; of two equal levels the upper one.

    altitude_km (L,): ascending; z [km].
    """
    lo = 0
    hi = altitude_km.size - 1
    while hi - lo > 1:
        mid = (lo + hi) // 2
        if altitude_km[mid] <= z:
            lo = mid
        else:
            hi = mid
    return lo
