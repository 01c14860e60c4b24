"""Haber's mode: the first order of scattering with its phase function, later ones isotropic in air whose aerosol is
reduced by similarity."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.base.threads import in_slices
from twilight.jit.kernels import njit
from twilight.solvers.base import Convergence
from twilight.solvers.cells.grid import make_grid
from twilight.solvers.cells.line_integrals import multiple_scattering
from twilight.solvers.cells.nodes import gauss_directions, graded_altitudes
from twilight.solvers.cells.ordinates import TINY
from twilight.solvers.cells.pairs import make_rings, pair_pass
from twilight.solvers.cells.rings import RingOperator, active_rings, make_operator, spread_matrix
from twilight.solvers.cells.settings import CellsSettings
from twilight.solvers.cells.single import make_straight_lines, single_scattering, unit_vectors
from twilight.solvers.cells.stencils import Mesh
from twilight.transport.beam import Beam, beam_at
from twilight.transport.profile import Profile, locate
from twilight.transport.scaling import ScaledMedium, rayleigh_phase_array, species_phase


class MeanRadianceTable(NamedTuple):
    """Logarithm (Z, S, W) of the mean radiance over F0 [sr^-1] of light scattered once, over altitudes (Z,) and local
    elevations of the sun (S,), both ascending."""

    altitude_km: np.ndarray
    sun_elevation_deg: np.ndarray
    log_radiance: np.ndarray


@njit(cache=True, nogil=True)
def average_over_cells(profile, table, shells, ring_shell, elevations, observer_radius, sun, n, out, begin, end):
    """Mean of a table over n x n points of each cell, weighted with scattering; out (R, A, W), filled for begin..end.

    profile: `Profile`; table: `MeanRadianceTable`; shells (N + 1,) [km from the observer] of rings whose shell is
    ring_shell (R,) and elevation elevations (R,) [rad]; observer_radius [km] from the centre of the Earth; sun [rad]:
    elevation at the observer; n: points along each side of a cell; begin, end: the first ring and the one after the
    last.
    """
    altitudes, suns, log_table = table
    n_azimuth = out.shape[1]
    n_wavelengths = out.shape[2]
    angle = 2.0 * math.pi / n_azimuth
    for ring in range(begin, end):
        low = shells[ring_shell[ring]]
        high = shells[ring_shell[ring] + 1]
        for j in range(n_azimuth // 2 + 1):
            total = np.zeros(n_wavelengths)
            for point in range(n * n):
                r = low + (high - low) * ((point // n) + 0.5) / n
                e = elevations[ring] + angle * ((point % n + 0.5) / n - 0.5)
                x = r * math.cos(e) * math.cos(angle * j)
                z = r * math.sin(e) + observer_radius
                rho = math.sqrt((r * math.cos(e)) ** 2 + z * z)
                altitude = rho - profile.earth_radius_km
                if altitude < profile.altitude_km[0] and n > 1:
                    continue
                if altitude > profile.altitude_km[profile.altitude_km.size - 1]:
                    continue
                local = math.degrees(math.asin(min(1.0, max(-1.0, (x * math.cos(sun) + z * math.sin(sun)) / rho))))
                a = min(max(np.searchsorted(altitudes, altitude, side="right") - 1, 0), altitudes.size - 2)
                f = min(max((altitude - altitudes[a]) / (altitudes[a + 1] - altitudes[a]), 0.0), 1.0)
                b = min(max(np.searchsorted(suns, local, side="right") - 1, 0), suns.size - 2)
                g = min(max((local - suns[b]) / (suns[b + 1] - suns[b]), 0.0), 1.0)
                i, k = locate(profile, altitude)
                for w in range(n_wavelengths):
                    value = (1.0 - f) * ((1.0 - g) * log_table[a, b, w] + g * log_table[a, b + 1, w])
                    value += f * ((1.0 - g) * log_table[a + 1, b, w] + g * log_table[a + 1, b + 1, w])
                    weight = r * r * math.cos(e)
                    weight *= profile.scattering[i, w] * (1.0 - k) + profile.scattering[i + 1, w] * k
                    out[ring, j, w] += weight * math.exp(value)
                    total[w] += weight
            for w in range(n_wavelengths):
                out[ring, j, w] /= max(total[w], 1e-300)


class IsotropicCells:
    """Cells, their operator and everything else that does not depend on the sun."""

    def __init__(
        self,
        medium: Medium,
        scaled: ScaledMedium,
        profile: Profile,
        beam: Beam,
        settings: CellsSettings,
        observer_altitude_km: float,
    ):
        self.medium, self.scaled, self.profile, self.beam = medium, scaled, profile, beam
        self.settings = settings
        self.grid = make_grid(
            settings.azimuth_cells,
            settings.inner_radius_km,
            observer_altitude_km,
            medium.bottom_km,
            medium.top_km,
            medium.earth_radius_km,
        )
        self.all_rings = make_rings(self.grid, profile, settings.subcells, np.arange(self.grid.n_rings))
        self.operator: RingOperator | None = None
        if settings.operator == "fourier":
            all_modes = settings.azimuth_cells // 2 + 1
            self.n_modes = min(settings.azimuth_modes or all_modes, all_modes)
            self.operator, self.spread = make_operator(self.grid, profile, settings, self.n_modes, medium.ground_albedo)
            self.active, self.rings = self.operator.ring, self.operator.rings
        else:
            if settings.close_energy or np.any(medium.ground_albedo > 0):
                raise TwilightError(
                    "solver.operator 'pairs' is a bare loop: it needs solver.expert.close_energy false and "
                    "ground.albedo 0"
                )
            self.active = active_rings(self.grid, settings.active_shell_step)
            self.rings = make_rings(self.grid, profile, settings.subcells, self.active)
            self.spread = spread_matrix(self.grid, self.active)
        self.paths_traced = 0
        self._make_mesh()

    def _make_mesh(self):
        """Rings in the order that the line of sight looks them up: by shell, then rising."""
        g = self.grid
        order = np.lexsort((g.ring_altitude_km, g.ring_shell))
        shells, count = np.unique(g.ring_shell[order], return_counts=True)
        keep = shells[count >= 2]
        if keep.size < 2:
            raise TwilightError(
                f"solver.azimuth_cells = {g.azimuth_cells} leaves no two shells with cells; use more azimuth_cells"
            )
        self.order = order[np.isin(g.ring_shell[order], keep)]
        start = np.concatenate([[0], np.cumsum(count[count >= 2])])
        middle = np.sqrt(g.shell_radius_km[keep] * g.shell_radius_km[keep + 1])
        observer = g.earth_radius_km + g.observer_altitude_km
        self.mesh = Mesh(
            np.log(middle),
            start.astype(np.int64),
            g.ring_altitude_km[self.order],
            float(g.shell_radius_km[keep[-1] + 1]),
            observer,
        )

    def _second_from_table(self, sun_elevation_deg: float) -> np.ndarray:
        """Mean radiance of light scattered once, at every cell (rings, S, W), weighted with the cell's scattering.

        It comes from a table over altitude and local solar zenith angle: seen from its own vertical every point of the
        air has the same sky at the same sun.
        """
        g, medium, profile = self.grid, self.medium, self.profile
        range_deg = np.degrees(np.arctan(g.shell_radius_km[-1] / (g.earth_radius_km + g.observer_altitude_km))) + 0.5
        low, high = max(sun_elevation_deg - range_deg, -90.0), min(sun_elevation_deg + range_deg, 90.0)
        suns = np.linspace(low, high, int((high - low) / 0.5) + 2)
        altitudes = graded_altitudes(medium.bottom_km, medium.top_km, 1.2)
        mu, phi, weight = gauss_directions(6, 12)
        # one side of the sun's meridian, whose directions stand for their mirror images too
        one_side = phi <= np.pi + 1e-9
        e, a = np.degrees(np.arcsin(mu))[one_side], np.degrees(phi)[one_side]
        weight = (weight * np.where(np.minimum(phi, np.abs(phi - np.pi)) < 1e-9, 1.0, 2.0))[one_side]
        mean = np.empty((altitudes.size, suns.size, medium.n_wavelengths))
        lines = [make_straight_lines(profile, self.scaled, float(altitude), e, a, 0.8) for altitude in altitudes]
        for j, sun in enumerate(suns):
            h = np.radians(sun)
            phase = self._smooth_phase(unit_vectors(e, a) @ np.array([np.cos(h), 0.0, np.sin(h)]))
            for i, line in enumerate(lines):
                once = single_scattering(line, self.beam, medium, self.scaled.forward_fraction, float(sun), phase)
                mean[i, j] = (once * weight[:, None]).sum(axis=0) / (4.0 * np.pi)
        table = MeanRadianceTable(altitudes, suns, np.log(np.maximum(mean, TINY)))
        out = np.zeros((g.n_rings, g.azimuth_cells, medium.n_wavelengths))
        in_slices(lambda begin, end: average_over_cells(
            profile, table, g.shell_radius_km, g.ring_shell, g.ring_elevation,
            g.earth_radius_km + g.observer_altitude_km, np.radians(sun_elevation_deg), self.settings.subcells, out,
            begin, end,
        ), g.n_rings)  # fmt: skip
        half = g.azimuth_cells // 2
        out[:, half + 1 :] = out[:, half - 1 : 0 : -1]
        return out

    def _smooth_phase(self, cosine: np.ndarray) -> np.ndarray:
        """Phase functions cut after degree 10, exact for the mean over the 12 x 12 directions; (D, 1 + K, W)."""
        legendre = np.polynomial.legendre.legvander(cosine, 10) * (2 * np.arange(11) + 1) / (4.0 * np.pi)
        rows = [rayleigh_phase_array(cosine, self.medium.depolarisation)]
        for phase, f in zip(self.medium.phase_functions, self.scaled.forward_fraction, strict=True):
            rows.append(legendre @ phase.legendre_moments(10).T / (1.0 - f))
        return np.ascontiguousarray(np.stack(rows, axis=1))

    def _second_from_pairs(self, sun_elevation_deg: float) -> np.ndarray:
        """Extinguished power of light scattered once, cell to cell with its phase function (active rings, S, W)."""
        rings, n = self.rings, self.settings.azimuth_cells
        h = np.radians(sun_elevation_deg)
        azimuth = 2.0 * np.pi * np.arange(n) / n
        x, z = rings.radius * rings.cos_elevation, rings.radius * rings.sin_elevation + rings.observer_radius
        cos_sun = (x[:, None] * np.cos(azimuth) * np.cos(h) + z[:, None] * np.sin(h)) / np.hypot(x, z)[:, None]
        light = np.zeros((*cos_sun.shape, self.medium.n_wavelengths))
        for i in range(cos_sun.shape[0]):
            for j in range(n):
                beam_at(self.beam, rings.altitude[i], cos_sun[i, j], light[i, j])
        at = self.scaled.medium.at(rings.altitude)
        species = np.concatenate([at.air_scattering[None], at.aerosol_scattering[None] * at.aerosol_phase_fraction])
        fraction = species / np.maximum(species.sum(axis=0), 1e-300)
        power = (fraction * rings.scattering * rings.volume[:, None])[:, :, None, :] * light[None]
        nodes = np.linspace(-1.0, 1.0, 2001)
        phase = 4.0 * np.pi * species_phase(self.medium, self.scaled.forward_fraction, nodes).transpose(1, 0, 2)
        return self._pairs(power, np.ascontiguousarray(phase), np.array([np.cos(h), 0.0, np.sin(h)]))

    def _pairs(self, power, phase, sun) -> np.ndarray:
        s = self.settings
        out = np.empty(power.shape[1:])
        self.paths_traced += pair_pass(
            self.profile, self.rings, s.azimuth_cells, np.ascontiguousarray(power), phase, sun,
            s.left_right_symmetry, s.mirrored_pairs, s.ring_reuse, out,
        )  # fmt: skip
        return out

    def solve(self, sun_elevation_deg: float, progress: Progress) -> tuple[np.ndarray, Convergence]:
        """Mean radiance of light scattered 1, 2, ... times, summed, at every cell (rings, S, W); its convergence is the
        fraction that the last order added (largest over cells and wavelengths)."""
        s, rings = self.settings, self.rings
        own = np.maximum(4.0 * np.pi * rings.scattering * rings.volume[:, None], 1e-300)[:, None]
        albedo = (rings.scattering / np.maximum(rings.extinction, 1e-300))[:, None]
        if s.second_order == "table":
            total = self._second_from_table(sun_elevation_deg)
            power = total[self.active] * own
        else:
            power = self._second_from_pairs(sun_elevation_deg) * albedo
            total = self._spread(power / own)
        orders, fraction = 2, 1.0
        for order in range(3, s.max_orders + 1):
            if s.operator == "fourier":
                power = self._fourier_order(power)
            else:
                isotropic = np.ones((1, 1, self.medium.n_wavelengths))
                power = self._pairs(power[None] * self._energy_ratio(power, own), isotropic, np.zeros(3)) * albedo
            added = self._spread(power / own)
            total = total + added
            orders, fraction = order, float((added / np.maximum(total, TINY))[total > 1e-20].max(initial=0.0))
            progress(f"order of scattering {order}", min(0.9, 0.3 + 0.1 * order))
            if fraction < s.tolerance:
                break
        return total, Convergence(orders, fraction)

    def _energy_ratio(self, power: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Haber's rescale: energy of all cells over energy of the active cells, per wavelength."""
        every = self.all_rings
        energy = self._spread(power / own) * (4.0 * np.pi * every.scattering * every.volume[:, None])[:, None]
        return energy.sum(axis=(0, 1)) / np.maximum(power.sum(axis=(0, 1)), 1e-300)

    def _spread(self, values: np.ndarray) -> np.ndarray:
        """From the active rings to all by linear interpolation along radius."""
        return np.tensordot(self.spread, values, axes=(1, 0))

    def _fourier_order(self, power: np.ndarray) -> np.ndarray:
        assert self.operator is not None
        n = self.settings.azimuth_cells
        modes = np.fft.rfft(power, axis=1).real[:, : self.n_modes].transpose(1, 0, 2)
        after = self.operator.next_order(modes).transpose(1, 0, 2)
        full = np.zeros((power.shape[0], n // 2 + 1, power.shape[2]))
        full[:, : self.n_modes] = after
        # the cut-off series may ring below zero where the field is darkest
        return np.maximum(np.fft.irfft(full, n=n, axis=1), 0.0)

    def view(self, total: np.ndarray, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Multiple scattering (E, A, W) on a grid of directions."""
        e, a = np.meshgrid(elevation_deg, azimuth_deg, indexing="ij")
        log_source = np.log(np.maximum(total[self.order], TINY)).astype(np.float32)[None]
        no_ground = np.full(log_source.shape[1:], math.log(TINY), np.float32)
        directions, altitude_km = unit_vectors(e.ravel(), a.ravel()), self.grid.observer_altitude_km
        found = multiple_scattering(self.profile, self.mesh, altitude_km, directions, log_source, no_ground)
        return found.reshape(*e.shape, -1)
