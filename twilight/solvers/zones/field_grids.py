"""Grids that solving and evaluating a field share: the scaled air, its nodes and the profiles that rays go through."""

from __future__ import annotations

from dataclasses import dataclass

from twilight.atmosphere.medium import Medium
from twilight.solvers.zones.grid import Truncation, zenith_nodes
from twilight.solvers.zones.layout import Layout, lay_out, settings_for
from twilight.solvers.zones.ray_points import SpeciesMoments
from twilight.solvers.zones.settings import ZonesSettings
from twilight.solvers.zones.solution import FieldNodes
from twilight.transport.beam import Beam, prepare_beam
from twilight.transport.lines import with_refraction
from twilight.transport.profile import Profile
from twilight.transport.scaling import ScaledMedium, delta_scaled

ALTITUDE_NODES_PER_SCALE = 8.0
"""Altitudes of the sunbeam's tables per factor e of the steepest coefficient, at beam_density 1."""
LIMB_NODES_PER_SCALE = 12.0
"""Tangent altitudes of the sunbeam's tables per factor e of the steepest coefficient, at beam_density 1."""
COSINE_NODES = 40
"""Intervals of the cosine of the zenith angle in the sunbeam's tables, at beam_density 1."""
DISTANCE_NODES = 12
"""Intervals of the distance from the limb in the sunbeam's tables, at beam_density 1."""
MIN_DISTANCE_NODES = 8
"""Least such intervals, at any beam_density."""
GUESS_NODES = 48
"""Intervals of the table from which the search for the refracted sun begins, at beam_density 1."""


def _spin2_degree(settings: ZonesSettings) -> int:
    return settings.polarisation_degree if settings.polarisation else 0


@dataclass(frozen=True)
class FieldGrids:
    """Grids of a field.

    medium: before scaling; settings: of the field; directions: the settings with the degree and as many directions and
    harmonics as this air needs; zenith_range_deg: of the sun
    scaled, scattering: the delta-scaled air and the moments of its phase matrices
    profile: of the scaled air, along straight rays; line_profile, path_profile: through which lines of sight and rays
    between two scatterings go, bent where the settings say so; nodes: of the field; layout: of `lay_out`
    """

    medium: Medium
    settings: ZonesSettings
    directions: ZonesSettings
    zenith_range_deg: tuple[float, float]
    scaled: ScaledMedium
    scattering: SpeciesMoments
    profile: Profile
    line_profile: Profile
    path_profile: Profile
    nodes: FieldNodes
    layout: Layout

    @staticmethod
    def of(
        medium: Medium, settings: ZonesSettings, zenith_range_deg: tuple[float, float], of_terms: bool = False
    ) -> FieldGrids:
        """Grids for a medium under settings; of_terms: as of `lay_out`."""
        of_air, degree = settings_for(medium, settings, of_terms)
        scaled = delta_scaled(medium, degree)
        layout = lay_out(medium, scaled, of_air, of_terms)
        bent = with_refraction(layout.profile, layout.bends)
        zenith = zenith_nodes(*zenith_range_deg, settings.zenith_density)
        return FieldGrids(
            medium,
            settings,
            layout.directions,
            zenith_range_deg,
            scaled,
            SpeciesMoments.of(medium, scaled, _spin2_degree(settings)),
            layout.profile,
            bent if settings.bent_lines_of_sight else layout.profile,
            bent if settings.bent_paths else layout.profile,
            FieldNodes.of(layout.altitude_km, zenith, layout.profile.sharp_km),
            layout,
        )

    @property
    def spin2_degree(self) -> int:
        """Degree of the spin-2 harmonics of Q and U, 0 without polarisation."""
        return _spin2_degree(self.settings)

    @property
    def line_series(self) -> Truncation:
        """Harmonics in which lines of sight see the light."""
        s = self.directions
        return Truncation.of(s.degree, self.spin2_degree, s.azimuth_directions)

    def sunbeam(self) -> Beam:
        """Tables of the sunbeam in the scaled air."""
        d = self.settings.beam_density
        return prepare_beam(
            self.scaled.medium,
            refraction=self.settings.refraction,
            altitude_nodes_per_scale=ALTITUDE_NODES_PER_SCALE * d,
            limb_nodes_per_scale=LIMB_NODES_PER_SCALE * d,
            cosine_nodes=round(COSINE_NODES * d),
            distance_nodes=max(MIN_DISTANCE_NODES, round(DISTANCE_NODES * d)),
            guess_nodes=round(GUESS_NODES * d),
            laid_out_for=self.layout.beam,
        )
