"""What the exact mode prepares for one medium and observer, and its solution for one sun."""

from __future__ import annotations

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.base.threads import in_slices
from twilight.solvers.cells.line_integrals import exact_view
from twilight.solvers.cells.nodes import make_directions, make_nodes
from twilight.solvers.cells.ordinates import Ordinates, ScatteredLight, mirror, once_scattered
from twilight.solvers.cells.settings import CellsSettings
from twilight.solvers.cells.single import unit_vectors
from twilight.solvers.cells.stencils import make_mesh, make_stencils
from twilight.transport.beam import Beam
from twilight.transport.profile import Profile
from twilight.transport.scaling import ScaledMedium


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
        stencils = make_stencils(profile, nodes, mesh, directions, settings.azimuth_nodes, 1.0)
        at = scaled.medium.at(nodes.altitude_km)
        species = np.concatenate([at.air_scattering[None], at.aerosol_scattering[None] * at.aerosol_phase_fraction])
        total = species.sum(axis=0)
        fraction = np.where(total > 0, species / np.where(total > 0, total, 1.0), 0.0)
        fraction[0] = np.where(total > 0, fraction[0], 1.0)
        chi = np.einsum("spw,slw->lpw", fraction, scaled.moments)
        self.ordinates = Ordinates(stencils, mesh, nodes, directions, chi, medium.ground_albedo, settings.azimuth_nodes)

    def solve(self, sun_elevation_deg: float, progress) -> ScatteredLight:
        """All orders of scattering at the nodes for one sun."""
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
                self.profile, self.beam, phase, self.medium.ground_albedo, places, d.cosine, o.n_azimuth, o.q, sun,
                first, begin, end,
            ),
            places.shape[0],
        )  # fmt: skip
        mirror(first, d.cosine.size, d.azimuth.size)
        return o.solve(
            first,
            s.max_orders,
            s.tolerance,
            lambda n, residual: progress(f"order of scattering {n + 1}", min(0.9, 0.3 + 0.1 * n)),
        )

    def view(self, scattered: ScatteredLight, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray:
        """Multiple scattering (E, A, W) on a grid of directions."""
        return exact_view(
            self.profile,
            self.ordinates.mesh,
            self.observer_altitude_km,
            elevation_deg,
            azimuth_deg,
            scattered.moments,
            self.ordinates.chi,
            scattered.ground,
            self.settings.degree,
        )
