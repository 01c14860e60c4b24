"""How the innermost kernels are compiled, and the arguments that they share.

air: `air.MonteCarloAir`; at: `air.MonochromaticAir`; sun: `sunlight.SolarBeam`; beam: `transport.beam.Beam`;
importance: `importance.ImportanceTables`; walk: `paths.WalkOptions`; options: `pieces.LegOptions`; leg: `pieces.Leg`;
totals: `pieces.LegTotals`; memory: `paths.PathMemory`; work: `directions.DirectionWorkspace`; w: index of the
wavelength; stream (1,): state of a stream of random numbers, moved on by every draw; to_sun (3,): unit vector to the
true sun, in the Cartesian frame of the point or ray; ray (9,), chord (9,): columns named in `rays`; event
(EVENT_COLUMNS,): columns named in `events`; pieces (M, PIECE_COLUMNS), piece (PIECE_COLUMNS,): columns named in
`pieces`; polarised: whether Q and U count; z [km]: altitude; (i, f): a place among the levels of the air, the fraction
f of the way from level i to the next one; cos_sun, mu_sun: cosine of the true sun's zenith angle at the point.  A
kernel's own text has the rest.
"""

from __future__ import annotations

from typing import Any

INNER: dict[str, Any] = {"cache": True, "makes_arrays": False}
"""Options of kernels that only read and write arrays they are given.

Numba counts references whenever an array is taken out of a named tuple, 40 % of the time of a path; a kernel that makes
no arrays needs none of that.  A constant that is handed to a kernel is written np.int64(1) or np.bool_(False): of plain
1 and False numba makes types of their own, and compiles the kernel once more for them.
"""
