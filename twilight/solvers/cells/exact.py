"""What the exact mode prepares for one medium and observer, and its solution for one sun."""

from __future__ import annotations

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.progress import Progress
from twilight.base.threads import in_slices
from twilight.solvers.base import Convergence
from twilight.solvers.cells.exact_grid import make_directions, make_nodes, real_harmonics
from twilight.solvers.cells.exact_view import multiple_scattering, unit_vectors
from twilight.solvers.cells.ordinates import TINY, Ordinates, ScatteredLight, mirror, once_scattered
from twilight.solvers.cells.settings import CellsSettings
from twilight.solvers.cells.stencils import make_mesh, make_stencils
from twilight.transport.beam import Beam
from twilight.transport.lines import species_fraction
from twilight.transport.profile import Profile
from twilight.transport.scaling import ScaledMedium

SOURCE_VALUES = 25_000_000
"""Values of the source function that are computed at once for lines of sight."""


class ExactCells:
    """Nodes, directions and ray stencils; phase functions are followed at every order of scattering."""

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
        self.settings, self.observer_altitude_km = settings, observer_altitude_km
        nodes = make_nodes(settings, observer_altitude_km, medium.bottom_km, medium.top_km, medium.earth_radius_km)
        directions = make_directions(settings)
        mesh = make_mesh(nodes, medium.earth_radius_km + observer_altitude_km)
        stencils = make_stencils(profile, nodes, mesh, directions, settings.azimuth_nodes)
        chi = np.einsum("spw,slw->lpw", species_fraction(scaled.medium, nodes.altitude_km), scaled.moments)
        self.ordinates = Ordinates(stencils, mesh, nodes, directions, chi, medium.ground_albedo, settings.azimuth_nodes)

    def solve(self, sun_elevation_deg: float, progress: Progress) -> tuple[ScatteredLight, Convergence]:
        """All orders of scattering at the nodes for one sun, and how well they converged."""
        o, s = self.ordinates, self.settings
        h = np.radians(sun_elevation_deg)
        d = o.directions
        vectors = unit_vectors(
            np.degrees(np.arcsin(np.repeat(d.cosine, d.azimuth.size))), np.degrees(np.tile(d.azimuth, d.cosine.size))
        )
        cosine = vectors @ np.array([np.cos(h), 0.0, np.sin(h)])
        legendre = np.polynomial.legendre.legvander(cosine, s.degree) * (2 * np.arange(s.degree + 1) + 1)
        phase = np.einsum("dl,slw->dsw", legendre, self.scaled.moments) / (4.0 * np.pi)
        first = np.zeros(
            (vectors.shape[0], o.nodes.altitude_km.size, o.n_azimuth, self.medium.n_wavelengths), np.float32
        )
        progress("light scattered once", 0.1)
        phase = np.ascontiguousarray(phase)
        sun = np.array([np.sin(h), np.cos(h)])
        places = np.stack([o.nodes.x_km, o.nodes.z_km, o.nodes.altitude_km], axis=1)
        in_slices(
            lambda begin, end: once_scattered(
                self.profile, self.beam, phase, self.medium.ground_albedo, places, d.cosine, o.n_azimuth,
                o.n_azimuth // d.azimuth.size, sun, first, begin, end,
            ),
            places.shape[0],
        )  # fmt: skip
        mirror(first, d.cosine.size, d.azimuth.size)
        scattered = o.solve(
            first,
            s.max_orders,
            s.tolerance,
            lambda n, residual: progress(f"order of scattering {n + 1}", min(0.9, 0.3 + 0.1 * n)),
        )
        return scattered, Convergence(scattered.orders, scattered.residual)

    def view(self, scattered: ScatteredLight, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Multiple scattering (E, A, W) on a grid of directions."""
        e, a = np.meshgrid(elevation_deg, azimuth_deg, indexing="ij")
        directions = unit_vectors(e.ravel(), a.ravel())
        harmonics, _ = real_harmonics(directions[:, 2], np.radians(a.ravel()), self.settings.degree)
        moments = scattered.moments * self.ordinates.chi[:, :, None, :].astype(np.float32)
        log_ground = np.log(np.maximum(scattered.ground, TINY))
        observer = (self.profile, self.ordinates.mesh, self.observer_altitude_km)
        at_once = max(1, SOURCE_VALUES // moments[0].size)
        radiance = []
        for start in range(0, directions.shape[0], at_once):
            part = slice(start, start + at_once)
            j = harmonics[part].astype(np.float32) @ moments.reshape(moments.shape[0], -1)
            log_source = np.log(np.maximum(j, TINY, out=j), out=j).reshape(-1, *moments.shape[1:])
            radiance.append(multiple_scattering(*observer, directions[part], log_source, log_ground))
        return np.concatenate(radiance).reshape(*e.shape, -1)
