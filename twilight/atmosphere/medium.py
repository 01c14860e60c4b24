"""The optical medium: what every solver gets, and all that it gets.

A medium is a list of levels.  Between two levels

- ln of the air's scattering coefficient and of its refractivity are monotone cubics with continuous slopes
  (:mod:`twilight.atmosphere.levels`): a bend of the index at a level would focus the sunbeam below it;
- absorption and aerosol extinction go exponentially, linearly where one end is 0 (:mod:`twilight.atmosphere.levels`);
- the aerosol's single scattering albedo and phase fractions go linearly.

Two levels at the same altitude are a jump, at which a new cubic begins unless both hold the same value.  Above the
levels is vacuum, below them the ground.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from twilight.atmosphere.grid_medium import GridMedium
from twilight.atmosphere.levels import (
    interpolate_coefficient,
    interpolate_smooth,
    layer_mean,
    log_cubics,
    monotone_cubic,
    smooth_mean,
)
from twilight.atmosphere.screen import Screen
from twilight.base.conventions import EARTH_RADIUS_KM, TINY
from twilight.base.errors import TwilightError
from twilight.numerics.phase import PhaseFunction

ON_LEVELS = (
    "air_scattering_per_km",
    "absorption_per_km",
    "aerosol_extinction_per_km",
    "aerosol_single_scattering_albedo",
    "refractivity",
)
"""Fields of a medium that have a value at every level and wavelength, (L, W)."""

SMALL_JUMP = 1e-3
"""Relative jump of the refractivity at a doubled level up to which it counts as rounding of a table."""

NEGLIGIBLE_PER_KM = 1e-12
"""Coefficient [km^-1], or refractivity, below which its relative change asks for no finer levels."""

MOST_PARTS = 400
"""Most levels into which `Medium.refined` divides one layer."""


@dataclass(frozen=True)
class Medium:
    """Spherically symmetric air of L levels at W wavelengths, with K aerosol phase functions.

    Parameters
    ----------
    wavelength_nm : (W,)
        In vacuum [nm].
    altitude_km : (L,)
        Of the levels [km], not decreasing; the lowest is the ground; an altitude that appears twice is a jump.
    air_scattering_per_km, absorption_per_km, aerosol_extinction_per_km : (L, W)
        Coefficients [km^-1]; absorption is that of gases.
    aerosol_single_scattering_albedo : (L, W)
        Scattering over extinction of the aerosol.
    aerosol_phase_fraction : (K, L, W)
        Fraction of the aerosol's scattering that follows phase function k; sums to 1 over k.
    phase_functions : K of PhaseFunction
        Each at the W wavelengths.
    refractivity : (L, W)
        n - 1.
    depolarisation : (W,)
        Depolarisation factor rho of Rayleigh scattering; 0 gives 3/(16 pi) (1 + cos^2).
    ground_albedo : (W,)
        Of the Lambertian ground.
    overhead_absorption_optical_depth : (W,)
        Of a filter on the unscattered sunlight above the top, crossed vertically whatever the sun's direction (Haber
        2005 sec. 4.3); 0 unless a preset asks for it.
    earth_radius_km
        Radius of the sphere of altitude 0 [km].
    screen
        What lies beyond the horizon and takes a part of the direct beam; None: nothing.
    name, notes
        For records and messages.
    grid_medium
        The air at fixed wavelengths, by which grids are laid out; None: grids follow this medium's own wavelengths.
        `dataclasses.replace` keeps it where the optics stay the same and drops it where they change (`GridMedium`).
    """

    wavelength_nm: np.ndarray
    altitude_km: np.ndarray
    air_scattering_per_km: np.ndarray
    absorption_per_km: np.ndarray
    aerosol_extinction_per_km: np.ndarray
    aerosol_single_scattering_albedo: np.ndarray
    aerosol_phase_fraction: np.ndarray
    phase_functions: tuple[PhaseFunction, ...]
    refractivity: np.ndarray
    depolarisation: np.ndarray
    ground_albedo: np.ndarray
    overhead_absorption_optical_depth: np.ndarray
    earth_radius_km: float = EARTH_RADIUS_KM
    screen: Screen | None = None
    name: str = ""
    notes: dict = field(default_factory=dict)
    grid_medium: GridMedium[Medium] | None = field(default=None, repr=False, compare=False)

    def __post_init__(self):
        if self.grid_medium is not None:
            object.__setattr__(self, "grid_medium", self.grid_medium.for_optics(self._optics))
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
        if self.aerosol_phase_fraction.shape != (len(self.phase_functions), *shape):
            raise TwilightError(
                f"medium {self.name}: aerosol_phase_fraction has shape {self.aerosol_phase_fraction.shape}"
            )

    def __repr__(self) -> str:
        """Three lines: its size, and how thick it is at its middle wavelength."""
        nm, middle = self.wavelength_nm, self.wavelength_nm.size // 2
        parts = ("air", "absorption", "aerosol")
        thick = ", ".join(f"{part} {self.optical_depth(part)[middle]:.3g}" for part in parts)
        return (
            f"<Medium {self.name or 'without a name'}: {self.altitude_km.size} levels from {self.bottom_km:g} to "
            f"{self.top_km:g} km\n  {nm.size} wavelengths {nm[0]:g} to {nm[-1]:g} nm, {len(self.phase_functions)} "
            f"phase functions of aerosol\n  optical depth at {nm[middle]:g} nm: {thick}>"
        )

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
    def _optics(self) -> tuple[Any, ...]:
        """All that decides how light goes through the air: what `grid_medium` stands for."""
        arrays = (getattr(self, key) for key in ON_LEVELS)
        scale = (self.wavelength_nm, self.altitude_km, self.aerosol_phase_fraction, self.depolarisation)
        return (*arrays, *scale, self.earth_radius_km, *self.phase_functions)

    @property
    def at_grid_wavelengths(self) -> Medium | None:
        """The same air at fixed wavelengths, by which grids are laid out; None where it is not known."""
        return None if self.grid_medium is None else self.grid_medium.medium

    def select(self, wavelengths: slice | np.ndarray) -> Medium:
        """The same medium at some of its wavelengths, with the same grid medium."""
        s = wavelengths
        phases = tuple(p.select(s) for p in self.phase_functions)
        cut = {key: getattr(self, key)[:, s] for key in ON_LEVELS}
        return replace(
            self,
            wavelength_nm=self.wavelength_nm[s],
            aerosol_phase_fraction=self.aerosol_phase_fraction[:, :, s],
            phase_functions=phases,
            depolarisation=self.depolarisation[s],
            ground_albedo=self.ground_albedo[s],
            overhead_absorption_optical_depth=self.overhead_absorption_optical_depth[s],
            grid_medium=self.grid_medium and self.grid_medium.for_any_optics(),
            **cut,
        )

    def at(self, altitude_km) -> Coefficients:
        """Coefficients at altitudes [km] of any shape: on a jump those above it, outside the levels 0."""
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
            return np.take(a, i, axis=-2) * (1 - f) + np.take(a, i + 1, axis=-2) * f

        return Coefficients(
            air_scattering=smooth(self.air_scattering_per_km),
            absorption=exponential(self.absorption_per_km),
            aerosol_extinction=exponential(self.aerosol_extinction_per_km),
            aerosol_albedo=linear(self.aerosol_single_scattering_albedo),
            aerosol_phase_fraction=linear(self.aerosol_phase_fraction),
            refractivity=smooth(self.refractivity),
        )

    def refined(self, max_thickness_km: float = 0.25, tolerance: float = 1e-4, like: Medium | None = None) -> Medium:
        """The same medium with levels inserted, so that kernels may interpolate linearly between them.

        Of a coefficient that falls by q = ln(a/b) over a layer, linear interpolation is off by q^2/8 at most.
        max_thickness_km: largest distance of two levels [km] near the ground; higher up 2 % of the height above it.
        tolerance: largest relative error of a coefficient between two levels.  like: the same levels at other
        wavelengths, whose coefficients say how many are inserted; None: this medium's."""
        z = self.altitude_km
        whose = like or self
        new = [z[:1]]
        with np.errstate(divide="ignore", invalid="ignore"):
            steps = np.zeros(z.size - 1)
            for key in ("air_scattering_per_km", "absorption_per_km", "aerosol_extinction_per_km", "refractivity"):
                lo, hi = getattr(whose, key)[:-1], getattr(whose, key)[1:]
                q = np.where((lo > 0) & (hi > 0), np.abs(np.log(hi / np.where(lo > 0, lo, 1))), 0.0)
                q = np.where(np.maximum(lo, hi) > NEGLIGIBLE_PER_KM, q, 0.0)
                steps = np.maximum(steps, np.nanmax(q, axis=1))
        for i, (a, b) in enumerate(pairwise(z)):
            if b <= a:
                new.append(np.array([b]))
                continue
            n = int(np.ceil(max(steps[i] / np.sqrt(8 * tolerance), (b - a) / max(max_thickness_km, 0.02 * (a - z[0])))))
            new.append(np.linspace(a, b, max(1, min(n, MOST_PARTS)) + 1)[1:])
        return self.on_levels(new)

    def on_levels(self, pieces: list[np.ndarray]) -> Medium:
        """The same medium on other levels, by its own rules between levels.

        pieces: new altitudes [km] for each level of the medium: those from the level below, which it leaves out, up to
        the level itself; of the lowest level that level alone
        """
        z, new = self.altitude_km, np.concatenate(pieces)
        piece = np.repeat(np.arange(len(pieces)), [part.size for part in pieces])
        hi = np.maximum(piece, 1)
        lo = hi - 1
        dz = z[hi] - z[lo]
        f = np.where(dz > 0, (new - z[lo]) / np.where(dz > 0, dz, 1.0), 1.0)
        f = np.where(piece > 0, f, 0.0)[:, None]
        arrays: dict[str, Any] = {}
        for key in ("absorption_per_km", "aerosol_extinction_per_km"):
            a = getattr(self, key)
            arrays[key] = interpolate_coefficient(a[lo], a[hi], f)
        for key in ("air_scattering_per_km", "refractivity"):
            a = getattr(self, key)
            arrays[key] = interpolate_smooth(a[lo], a[hi], log_cubics(z, a)[:, lo], f)
        for key in ("aerosol_single_scattering_albedo", "aerosol_phase_fraction"):
            a = getattr(self, key)
            arrays[key] = a[..., lo, :] * (1 - f) + a[..., hi, :] * f
        return replace(self, altitude_km=new, **arrays)

    def optical_depth(self, part: str = "total") -> np.ndarray:
        """Vertical optical depth (W,) of one part of the air.

        Parameters
        ----------
        part
            `air`, `absorption`, `aerosol`, or `total`.

        Returns
        -------
        (W,)
            Exact for the rules between levels; of air to 1e-9, by Gauss-Legendre quadrature.
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


class Coefficients(NamedTuple):
    """Coefficients [km^-1], albedo, phase fractions and refractivity at altitudes.

    Each has the shape of the altitudes plus (W,); aerosol_phase_fraction has K in front.
    """

    air_scattering: np.ndarray
    absorption: np.ndarray
    aerosol_extinction: np.ndarray
    aerosol_albedo: np.ndarray
    aerosol_phase_fraction: np.ndarray
    refractivity: np.ndarray

    @property
    def aerosol_scattering(self) -> np.ndarray:
        return self.aerosol_extinction * self.aerosol_albedo

    @property
    def extinction(self) -> np.ndarray:
        return self.air_scattering + self.absorption + self.aerosol_extinction


def with_joined_refractivity(medium: Medium) -> Medium:
    """The medium with a refractive index without jumps, by which light is bent.

    At a jump all rays close to the horizontal would be reflected or focused, which is a property of layers and not of
    air.  An index that jumps is replaced by the smooth curve through its means at the middles of the layers; below the
    lowest middle ln(n - 1) goes on with the slope between the lowest two.
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
    value = np.log(np.maximum(value, np.maximum(1e-9 * value.max(axis=0), TINY)))
    fall = (value[1] - value[0]) / (middle[1] - middle[0])
    lowest = value[0] - fall * (middle[0] - z[0])
    top = np.minimum(value[-1], np.log(np.maximum(n[-1], 1e-9 * n.max(axis=0) + TINY)))
    x, y = np.concatenate([z[:1], middle, z[-1:]]), np.concatenate([[lowest], value, [top]])
    smooth = [np.exp(monotone_cubic(levels, x, column)) * (column.max() > np.log(1e-200)) for column in y.T]
    return replace(medium, refractivity=np.stack(smooth, axis=1)[place])


def observer_at(medium: Medium, altitude_km: float | None, otherwise: float = 0.0) -> float:
    """An observer's altitude [km], `otherwise` where it is None; TwilightError for one below the ground."""
    altitude = otherwise if altitude_km is None else float(altitude_km)
    if not medium.bottom_km <= altitude < np.inf:
        raise TwilightError(
            f"observer.altitude_km is {altitude:g}; allowed is {medium.bottom_km:g} (the ground) and more"
        )
    return altitude
