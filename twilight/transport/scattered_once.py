"""Light that aerosol scattered once, about, by closed forms and numpy alone: what a `SkyTable` holds apart.

It stands for no solver's light: a table's two layers always add up to that.  The nearer this is to what the solver has
of light scattered once by aerosol, the smoother both layers are.  Close to the sun several scatterings in the forward
peak widen the glow: by how much is measured in the solver's light (:meth:`ScatteredOnce.widening`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from twilight.base.conventions import DARK, TINY
from twilight.clear_air.shells import (
    DARK_LOG,
    Line,
    Shells,
    _parts,
    lit_fraction,
    log_mean,
    sublayers,
    summed,
)
from twilight.numerics.directions import PHASE_ANGLE_RAD, scattering_angle_rad
from twilight.numerics.spectrum import hermite_matrix

if TYPE_CHECKING:
    from twilight.atmosphere.bands import GasBands
    from twilight.atmosphere.medium import Medium

BOUNDARY_KM = np.concatenate(
    [
        *([0, 0.02, 0.06, 0.12, 0.25, 0.45, 0.7, 1, 1.35, 1.7], np.arange(2, 6, 0.5), np.arange(6.0, 16.0)),
        *([16, 17.5, 19, 20.5, 22, 24, 26, 28, 30, 33], np.arange(36.0, 81.0, 3.0), [82, 86, 90, 95, 100]),
    ]
)
"""Boundaries of layers above the ground [km]: the price of a view from space goes by their square."""

PEAK_DEGREE = 17
"""Legendre degree whose moment is the fraction of scattering in the forward peak, which counts as not scattered."""

LOWEST_OBSERVER_KM = 1e-4
"""Distance of an observer from a boundary of the shells within which it is taken as on it [km]."""


EDGE_WITHIN_KM = 0.02
"""Distance of an edge of a layer from a boundary of the shells within which it is taken as there [km]."""

BELOW_EDGE = 1.0 - np.array([0.35, 0.18, 0.08, 0.03, 0.008, 0.001, 0.0])
"""Where lines through the limb are lowest below an edge, under which their path rises as the root of the depth: parts
of the layer's thickness."""

SUDDEN_FALL = 0.2
"""Part of the extinction that is lost within a hundredth of a kilometre where a layer has an edge."""

FAINT_CHANGE = 0.05
"""Part of the extinction that is lost or gained there, at any wavelength, where lines of sight show an edge."""

ON_GROUND_KM = 0.1
"""Height up to which an observer sees no air between himself and the ground [km]."""

WIDENED_DEG = 8.0
"""Angle from the sun within which scattering in forward peaks changes the aureole on scales below those of nodes."""

WIDENING_COUNT = 24
"""Angles at which the widening is measured."""

LEAST_OF_LIMB = 1e-5
"""Light along lines through the limb, of the brightest at an azimuth and a wavelength, that stands for none."""

FULL_WIDENING_SUN_DEG = 3.0
"""Apparent elevation from which a sun's aureole is widened as measured [deg]; it fades to nothing at the horizon, so
that tables of suns on either side of it may be read between them."""

MOST_WIDENING = 1.5
"""Largest change of the logarithm of the aureole by widening."""


def sudden_edges(medium: Medium) -> tuple[np.ndarray, np.ndarray]:
    """Altitudes [km] at which extinction falls suddenly upwards, and by how much [km^-1]."""
    z, extinction = medium.altitude_km, medium.extinction_per_km.max(axis=1)
    fall = extinction[:-1] - extinction[1:]
    sudden = (np.diff(z) <= 0.01) & (fall > SUDDEN_FALL * extinction[:-1])
    return 0.5 * (z[1:] + z[:-1])[sudden], fall[sudden]


def faint_edges(medium: Medium) -> np.ndarray:
    """Altitudes [km] at which extinction changes suddenly, however little, at any wavelength: lines of sight from far
    away that graze one show a cusp."""
    z, extinction = medium.altitude_km, medium.extinction_per_km
    least = np.maximum(np.minimum(extinction[1:], extinction[:-1]), DARK)
    change = (np.abs(np.diff(extinction, axis=0)) / least).max(axis=1)
    return 0.5 * (z[1:] + z[:-1])[(np.diff(z) <= 0.01) & (change > FAINT_CHANGE)]


class ShellsBelow(Shells):
    """Shells in which lines may go down from the observer too, to the ground or through the limb."""

    @property
    def _boundary_x(self) -> np.ndarray:
        """n r at the boundaries of layers [km]."""
        parts = _parts(*self._geometry)
        return parts.x[:: parts.per_layer]

    @property
    def middles_km(self) -> np.ndarray:
        """n r in the middle of each layer below the observer, and at him [km]."""
        middle = 0.5 * (self._boundary_x[1:] + self._boundary_x[:-1])
        return np.append(middle[: self.first], self._boundary_x[self.first])

    def below_edges_km(self, edges: list[int]) -> np.ndarray:
        """n r of lines that are lowest close below some boundaries under the observer [km]."""
        x = self._boundary_x
        each = [x[k - 1] + (x[k] - x[k - 1]) * BELOW_EDGE for k in edges if 0 < k < self.first]
        return np.concatenate(each) if each else np.empty(0)

    def invariant_km(self, elevation_deg: np.ndarray, above_km: float) -> tuple[np.ndarray, np.ndarray]:
        """n r sin(zenith angle) of lines of sight by their elevations at an observer so far above the boundary that is
        his, and the angle at the Earth's centre from him to where they enter the layers [rad], (E,) each; nan where
        they do not."""
        e, entry = np.radians(elevation_deg), self._boundary_x[self.first]
        if above_km <= 0.0:
            return entry * np.cos(e), np.zeros(e.size)
        b = (entry + above_km) * np.cos(e)
        b = np.where((b < entry) & (e < 0.0), b, np.nan)
        return b, np.arccos(b / (entry + above_km)) - np.arccos(b / entry)

    def scattered_once_below(
        self, sun_deg: float, invariant_km: np.ndarray, before_rad: np.ndarray, azimuth_deg: np.ndarray
    ) -> np.ndarray:
        """`scattered_once` of lines that go down, (S, E, A, W), by their invariants (E,) and angles at the Earth's
        centre before they enter the layers (E,)."""
        edges, first = self._boundary_x, self.first
        path, angle = _parts(*self._geometry).through(invariant_km)
        # layers in the order of the line: down to the ground or the lowest point, and up again through all of them
        order = np.concatenate([np.arange(first)[::-1], np.arange(edges.size - 1)])
        falling = np.arange(order.size) < first
        passed = falling | (invariant_km > edges[0])[:, None]
        path, angle = path[:, order] * passed, angle[:, order] * passed
        depth = summed(path[:, :, None] * self.extinction[order])
        before = before_rad[:, None]
        line = Line(path, np.concatenate([before, before + np.cumsum(angle, axis=1)], axis=1), depth)
        boundary = np.concatenate([np.arange(first + 1)[::-1], np.arange(1, edges.size)])
        light, edge = self.log_sunbeam(boundary, line.zenith(np.array([sun_deg]), azimuth_deg)[0])
        light = np.maximum(light - depth[:, None], DARK_LOG)
        out = np.zeros((len(self.scattering), invariant_km.size, azimuth_deg.size, self.extinction.shape[1]))
        for j, k in enumerate(order):
            low, high = (j + 1, j) if falling[j] else (j, j + 1)
            # of the layer with the lowest point, the part above that
            part = np.clip((invariant_km - edges[k]) / (edges[k + 1] - edges[k]), 0.0, 1.0)[:, None, None]
            lowest = light[:, :, low] + part * (light[:, :, high] - light[:, :, low])
            lit = lit_fraction(edge[:, :, low], edge[:, :, high])[..., None]
            mean = log_mean(light[:, :, high], lowest) * lit
            out += self.scattering[:, k][:, None, None] * path[None, :, j, None, None] * mean
        return out


class ScatteredOnce:
    """Light scattered once by the aerosol of a medium, for one observer.

    medium, bands: as of the engine's block of wavelengths; altitude_km: of the observer above sea level
    aerosol: whether its light is wanted, else the sun's apparent place alone
    log_phase (PHASE_COUNT, W): ln of the phase function of the aerosol above the observer, of all where none is above;
        None without aerosol
    """

    def __init__(self, medium: Medium, bands: GasBands | None, altitude_km: float, *, aerosol: bool = True):
        self.altitude_km = altitude_km
        height = max(altitude_km - medium.bottom_km, 0.0)
        self._bands = bands
        terms = medium if bands is None else bands.expand(medium)
        self._phases = terms.phase_functions
        dip = np.degrees(np.sqrt(2.0 * height / terms.earth_radius_km))
        self._ground_deg = -float(dip) if height <= ON_GROUND_KM else -90.0
        self._looks_down = height > ON_GROUND_KM
        boundary = BOUNDARY_KM
        self._above_km = max(height - float(BOUNDARY_KM[-1]), 0.0)
        if self._above_km == 0.0 and np.abs(boundary - height).min() > LOWEST_OBSERVER_KM:
            boundary = np.sort(np.append(boundary, height))
        edges = sudden_edges(medium)[0] - medium.bottom_km
        for edge in edges[(edges > 0.0) & (edges < BOUNDARY_KM[-1])]:
            nearest = int(np.abs(boundary - edge).argmin())
            if abs(boundary[nearest] - edge) > EDGE_WITHIN_KM:
                boundary = np.insert(boundary, int(np.searchsorted(boundary, edge)), edge)
        self._edges = [int(np.abs(boundary - edge).argmin()) for edge in edges if edge < BOUNDARY_KM[-1]]
        wavelengths = terms.n_wavelengths if aerosol else 1
        shape = (len(self._phases), boundary.size - 1, wavelengths)
        scatters, rest, peak = np.zeros(shape), np.zeros(shape[1:]), np.zeros(shape[1:])
        if aerosol:
            fine = terms.refined()
            z = fine.altitude_km - fine.bottom_km
            scattering = fine.aerosol_extinction_per_km * fine.aerosol_single_scattering_albedo
            kinds = [_in_layers(z, scattering * f, boundary) for f in fine.aerosol_phase_fraction]
            scatters = np.reshape(kinds, shape)
            per_km = fine.air_scattering_per_km + fine.absorption_per_km + fine.aerosol_extinction_per_km
            rest = _in_layers(z, per_km, boundary)
        if aerosol and self._phases:
            forward = np.array([p.legendre_moments(PEAK_DEGREE)[:, PEAK_DEGREE] for p in self._phases])
            peak = np.einsum("kw,klw->lw", np.clip(forward, 0.0, 0.999), scatters)
        middle = terms.n_wavelengths // 2
        self._shells = ShellsBelow(
            boundary,
            rest - peak,
            scatters,
            peak,
            terms.at(sublayers(boundary) + terms.bottom_km).refractivity[:, middle],
            min(height, BOUNDARY_KM[-1]),
            terms.earth_radius_km + terms.bottom_km,
        )
        each_km = np.einsum("klw,l->lkw", scatters, np.diff(boundary))
        column, above = each_km.sum(axis=0), each_km[self._shells.first :].sum(axis=0)
        # the aureole is that of the air between the observer and the sun
        column = np.where(above.sum(axis=0) > 0.0, above, column)
        self.log_phase = None
        if aerosol and self._phases and column.any():
            each = np.stack([p(np.cos(PHASE_ANGLE_RAD)).T for p in self._phases])
            total = column.sum(axis=0)
            weight = np.where(total > 0.0, column / np.where(total > 0.0, total, 1.0), 1.0 / len(column))
            phase = np.einsum("kaw,kw->aw", each, weight)
            if bands is not None:  # all terms of a wavelength have its phase function
                phase = phase[:, np.unique(bands.wavelength_index, return_index=True)[1]]
            self.log_phase = np.log(np.maximum(phase, DARK)).astype(np.float32)

    def apparent_sun_deg(self, sun_elevation_deg: float) -> float:
        """Apparent elevation of a sun [deg]; of one below the horizon, as far above it as at the horizon."""
        return self._shells.apparent_elevation_deg(sun_elevation_deg)

    def widening(self, light: Callable[[np.ndarray, np.ndarray], np.ndarray], sun_elevation_deg: float) -> np.ndarray:
        """By what the logarithm of the aureole of a sun differs from that of light scattered once, (PHASE_COUNT, W).

        light: the solver's, of directions (D,), (D, W).  Within `WIDENED_DEG` of the sun, level with it, what is not in
        the aureole is taken as linear in the angle; beyond, and for a sun whose apparent place is below the horizon,
        the difference is 0 (`FULL_WIDENING_SUN_DEG`).
        """
        assert self.log_phase is not None
        sun = self.apparent_sun_deg(sun_elevation_deg)
        if sun <= 0.0:
            return np.zeros_like(self.log_phase)
        angle = 1.5 * WIDENED_DEG * np.linspace(0.0, 1.0, WIDENING_COUNT) ** 2
        h, t = np.radians(sun), np.radians(angle)
        elevation = np.degrees(np.arcsin(np.sin(h) * np.cos(t)))
        azimuth = np.degrees(np.arctan2(np.sin(t), np.cos(h) * np.cos(t)))
        found = light(elevation, azimuth).astype(float)
        pairs = zip(elevation, azimuth, strict=True)
        once = np.stack([self.light(sun_elevation_deg, e[None], a[None])[0, 0] for e, a in pairs])  # type: ignore[index]
        edge = int(np.searchsorted(angle, WIDENED_DEG))
        rest = found - once
        rest = rest[edge] + (angle[:, None] - angle[edge]) * (rest[-1] - rest[edge]) / (angle[-1] - angle[edge])
        change = np.log(np.maximum(found - rest, DARK) / np.maximum(once, DARK))
        change[edge:] = 0.0
        change[:, change.min(axis=0) < -MOST_WIDENING] = 0.0  # a sky without an aureole
        low = min(1.0, sun / FULL_WIDENING_SUN_DEG)
        change = low**2 * (3.0 - 2.0 * low) * np.minimum(change, MOST_WIDENING)
        between = hermite_matrix(np.sqrt(np.radians(angle)), np.sqrt(PHASE_ANGLE_RAD))
        return (between @ change).astype(np.float32)

    def _below(
        self, sun_elevation_deg: float, invariant_km: np.ndarray, before_rad: np.ndarray, azimuth_deg: np.ndarray
    ) -> np.ndarray:
        """`ShellsBelow.scattered_once_below`, through the limb between lines that are lowest in the middle of a
        layer: at its edges the path has a root of the height, which neither of a table's layers can hold.  Logarithms
        between them stay between those of both neighbours: cubics swing where the shadow of the ground begins."""
        from scipy.interpolate import PchipInterpolator  # start-up

        middle = self._shells.middles_km
        limb = invariant_km > middle[0]
        middle = np.sort(np.append(middle, self._shells.below_edges_km(self._edges)))
        out = np.empty((len(self._phases), invariant_km.size, azimuth_deg.size, self._shells.extinction.shape[1]))
        if not limb.all():
            straight = invariant_km[~limb], before_rad[~limb]
            out[:, ~limb] = self._shells.scattered_once_below(sun_elevation_deg, *straight, azimuth_deg)
        if limb.any():
            order = np.argsort(invariant_km)
            before = np.interp(middle, invariant_km[order], before_rad[order])
            found = self._shells.scattered_once_below(sun_elevation_deg, middle, before, azimuth_deg)
            least = LEAST_OF_LIMB * found.max(axis=1, keepdims=True) + TINY
            rising = np.diff(np.maximum.accumulate(middle), prepend=-np.inf) > 0.0
            between = PchipInterpolator(middle[rising], np.log(found + least)[:, rising], axis=1)
            out[:, limb] = np.exp(between(np.minimum(invariant_km[limb], middle[rising][-1])))
        return out

    def light(self, sun_elevation_deg: float, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
        """Light / F0 on rows (E,) and columns (A,), (E, A, W).

        The ground in front of an observer who stands on it has none, and lines between it and the horizontal that of
        the horizontal.
        """
        if self.log_phase is None:
            return None
        in_air = self._shells.first < self._shells.boundary_km.size - 1
        up = np.full(elevation_deg.shape, in_air) & ((elevation_deg >= 0.0) | (not self._looks_down))
        shape = (len(self._phases), elevation_deg.size, azimuth_deg.size, self._shells.extinction.shape[1])
        factors = np.zeros(shape)
        if up.any():
            unique, back = np.unique(np.maximum(elevation_deg[up], 0.0), return_inverse=True)
            factors[:, up] = self._shells.scattered_once(sun_elevation_deg, unique, azimuth_deg)[:, back]
        factors[:, elevation_deg < self._ground_deg] = 0.0
        if not up.all():
            invariant, before = self._shells.invariant_km(elevation_deg, self._above_km)
            down = ~up & np.isfinite(invariant)
            if down.any():
                factors[:, down] = self._below(sun_elevation_deg, invariant[down], before[down], azimuth_deg)
        apparent = self.apparent_sun_deg(sun_elevation_deg)
        cosine = np.cos(scattering_angle_rad(apparent, elevation_deg[:, None], azimuth_deg))
        out = sum(np.moveaxis(p(cosine), 0, -1) * part for p, part in zip(self._phases, factors, strict=True))
        return np.asarray(out) if self._bands is None else self._bands.sum_terms(np.asarray(out))


def _in_layers(height_km: np.ndarray, per_km: np.ndarray, boundary_km: np.ndarray) -> np.ndarray:
    """Mean coefficient of layers (L, W), of one (Z, W) at heights above the ground."""
    step = np.diff(height_km)[:, None]
    below = np.concatenate([np.zeros_like(per_km[:1]), np.cumsum(0.5 * step * (per_km[1:] + per_km[:-1]), axis=0)])
    depth = np.stack([np.interp(boundary_km, height_km, column) for column in below.T], axis=1)
    return np.diff(depth, axis=0) / np.diff(boundary_km)[:, None]
