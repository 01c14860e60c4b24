"""The tables of a sunbeam by name, and how they are laid out in the two arrays of `beam_lookup.Beam`.

:mod:`twilight.transport.beam` says what they mean.  J nodes of altitude, C + 1 of the apparent cosine, G + 1 of the
sun's distance from the shadow's edge, Y of the lowest point of a ray, D + 1 of the distance u from it, W wavelengths.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from twilight.transport import beam_lookup as lookup
from twilight.transport.beam_edges import Edges
from twilight.transport.beam_lookup import Beam

_HASH = 1024
"""Equal bins of a coordinate, each of which knows the segment that its start lies in."""


class Segments(NamedTuple):
    """A coordinate cut into S segments: edges (S + 1,) [km]; size (S,): intervals of each; start (S,): first node."""

    edges: np.ndarray
    size: np.ndarray
    start: np.ndarray

    @property
    def bins_per_km(self) -> float:
        """0 where no ray from space turns inside the air, so that all edges are one."""
        span = self.edges[-1] - self.edges[0]
        return _HASH / span if span > 0.0 else 0.0

    def hashed(self) -> np.ndarray:
        """(_HASH + 1,): the segment at the start of every bin, and at the end of the last."""
        return np.searchsorted(self.edges[1:-1], np.linspace(self.edges[0], self.edges[-1], _HASH + 1), side="right")

    def records(self) -> np.ndarray:
        """(S, N_SEGMENT_RECORD): lower edge, upper edge, 1 / length, intervals, first node."""
        edges = self.edges
        return np.stack([edges[:-1], edges[1:], 1.0 / np.diff(edges), self.size, self.start], axis=1)


class Tables(NamedTuple):
    """What `prepare_beam` computes; everything but log_up, log_down and overhead at the reference wavelength.

    radius_km of the Earth; ground_km, top_km: altitudes; far_km: unit of the distance u behind the limb.
    edge_rad: true zenith angle of the shadow's edge at the ground; refracting, dispersing: flags.
    altitude_segments: of the altitude [km]; limb_segments: of the invariant p of limb rays [km].
    refractivity (J,): n - 1; edge_dip (J,): signed square of the edge's sinking since the ground [rad^2].
    guess (J, G + 1, 2): bending [rad] and its derivative by the apparent zenith angle.
    up_bending (J, C + 1): bending of rays from above [rad]; limb_bending (Y,): of whole limb rays [rad].
    shift_km (Y, D + 1): of the lowest point, per dispersion; dispersion (W,): 1 - (n - 1)/(n - 1 at the reference).
    overhead (W,): optical depth above the top; log_up (J, C + 1, W): log of the irradiance over F0 of rays from above;
    log_down (W, Y, D + 1): log of the irradiance of a limb ray and of its mirror image, with log(1 + u/far_km).
    edges: what is sharp at edges of layers, and missing in log_up and log_down.
    screen: of `beam_screen.screen_table`, and in none of the tables.
    """

    radius_km: float
    ground_km: float
    top_km: float
    far_km: float
    edge_rad: float
    refracting: bool
    dispersing: bool
    altitude_segments: Segments
    limb_segments: Segments
    refractivity: np.ndarray
    edge_dip: np.ndarray
    guess: np.ndarray
    up_bending: np.ndarray
    limb_bending: np.ndarray
    shift_km: np.ndarray
    overhead: np.ndarray
    dispersion: np.ndarray
    log_up: np.ndarray
    log_down: np.ndarray
    edges: Edges
    screen: np.ndarray


def pack(t: Tables) -> Beam:
    """All tables in one array, their sizes and places in another."""
    sizes = {
        lookup.N_W: t.dispersion.size,
        lookup.REFRACTING: t.refracting,
        lookup.DISPERSING: t.dispersing,
        lookup.N_SEGMENT: t.altitude_segments.size.size,
        lookup.N_LIMB: t.limb_segments.size.size,
        lookup.N_COSINE: t.up_bending.shape[1] - 1,
        lookup.N_DISTANCE: t.shift_km.shape[1] - 1,
        lookup.N_GUESS: t.guess.shape[1] - 1,
        lookup.N_LIMB_NODE: t.limb_bending.size,
        lookup.N_HASH: _HASH,
        lookup.N_EDGE: t.edges.record.shape[0],
        lookup.SCREENED: t.screen.size > 0,
        # the hashes stand behind the index itself
        lookup.AT_SEGMENT_HASH: lookup.N_INDEX,
        lookup.AT_LIMB_HASH: lookup.N_INDEX + _HASH + 1,
    }
    scalars = {
        lookup.RADIUS: t.radius_km,
        lookup.GROUND: t.ground_km,
        lookup.TOP: t.top_km,
        lookup.FAR: t.far_km,
        lookup.P_GROUND: t.limb_segments.edges[0],
        lookup.P_TOP: t.limb_segments.edges[-1],
        lookup.EDGE: t.edge_rad,
        lookup.SEGMENT_BINS: t.altitude_segments.bins_per_km,
        lookup.LIMB_BINS: t.limb_segments.bins_per_km,
    }
    tables = {
        lookup.AT_SEGMENT: t.altitude_segments.records(),
        lookup.AT_LIMB: t.limb_segments.records(),
        lookup.AT_ALTITUDE: np.stack([t.refractivity, t.edge_dip], axis=1),
        lookup.AT_GUESS: t.guess,
        lookup.AT_UP_BENDING: t.up_bending,
        lookup.AT_LIMB_BENDING: t.limb_bending,
        lookup.AT_SHIFT: t.shift_km,
        lookup.AT_OVERHEAD: t.overhead,
        lookup.AT_DISPERSION: t.dispersion,
        lookup.AT_UP: t.log_up,
        lookup.AT_DOWN: t.log_down,
        lookup.AT_EDGE: t.edges.record,
        lookup.AT_EDGE_COEFFICIENT: t.edges.coefficient,
        lookup.AT_SCREEN: t.screen,
    }
    index = np.zeros(lookup.N_INDEX, dtype=np.int64)
    for place, size in sizes.items():
        index[place] = size
    pieces = [np.array([scalars[place] for place in range(lookup.N_SCALAR)], dtype=float)]
    at = lookup.N_SCALAR
    for place, table in tables.items():
        index[place] = at
        pieces.append(np.asarray(table, dtype=float).ravel())
        at += pieces[-1].size
    layout = np.concatenate([index, t.altitude_segments.hashed(), t.limb_segments.hashed()])
    return Beam(pool=np.concatenate(pieces), layout=layout.astype(np.int64))
