"""How the innermost kernels are compiled, and the arguments that they share.

air: `air.Air`; at: `air.AirAt`, the air at one wavelength; sun: `sunlight.Sun`; beam: `transport.beam.Beam`; steering:
`steering.Steering`; walk: `paths.Walk`; cuts: `pieces.Cuts`; leg: `pieces.Leg`; found: `pieces.Found`; work:
`directions.Work`; w: index of the wavelength; stream (1,): state of a stream of random numbers, moved on by every draw;
to_sun (3,): unit vector to the true sun, in the Cartesian frame of the point or ray; ray (9,), chord (9,): columns
named in `lines`; event (EVENT_COLUMNS,): columns named in `events`; pieces (M, PIECE_COLUMNS), piece (PIECE_COLUMNS,):
columns named in `pieces`; polarised: whether Q and U count; z [km]: altitude; (i, f): a place among the levels of the
air, between level i and the next one, the fraction f of the way up; cos_sun, mu_sun: cosine of the true sun's zenith
angle at the point.  A kernel's own text has the rest.
"""

from __future__ import annotations

from typing import Any

# Kernels that only read and write arrays they are given need no reference counting.  Numba counts all the same whenever
# an array is taken out of a named tuple, which took 40 % of the time of a path.  `_nrt=False` leaves the counting out;
# such a kernel may not create arrays (it would not compile).
# A constant that is handed to a kernel is written np.int64(1) or np.bool_(False): of plain 1 and False numba makes
# types of their own, and compiles the kernel once more for them.
INNER: dict[str, Any] = {"cache": True, "_nrt": False}
