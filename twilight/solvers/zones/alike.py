"""Which wavelengths may be solved together without one of them moving another."""

from __future__ import annotations

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.solvers.zones.directions import needed
from twilight.solvers.zones.grid import altitude_nodes, resolve_layers
from twilight.solvers.zones.settings import ZonesSettings
from twilight.transport.profile import Profile, expected_factors, prepare_profile
from twilight.transport.scaling import delta_scaled


def field_altitudes(medium: Medium, profile: Profile, density: float) -> np.ndarray:
    """Altitudes [km] of the nodes of a field; profile: of the scaled medium."""
    nodes = altitude_nodes(medium.bottom_km, medium.top_km, profile.break_km, density)
    return resolve_layers(nodes, profile, density)


def alike(medium: Medium, settings: ZonesSettings) -> list[bytes]:
    """A key for each wavelength: those with equal keys share nodes, directions and points of lines as if alone.

    All the wavelengths of a field share its grids, which follow the one that needs the finest.  At a low quality the
    finer grid moves the others by per cents.  Air that is thicker than any that steps are made for shortens them by its
    own extinction: it is like no other wavelength's.
    """
    keys = []
    for w in range(medium.n_wavelengths):
        scaled = delta_scaled(medium.select(slice(w, w + 1)), settings.degree)
        profile = prepare_profile(scaled.medium)
        nodes = field_altitudes(medium, profile, settings.altitude_density)
        factors = expected_factors(profile.altitude_km, profile.extinction[:, 0])
        steps = f"as expected times {factors}" if factors else f"of wavelength {w}"
        directions = str(needed(settings, scaled, profile))
        keys.append(steps.encode() + directions.encode() + nodes.tobytes() + profile.stop_km.tobytes())
    return keys
