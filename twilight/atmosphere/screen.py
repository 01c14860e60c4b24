"""What lies beyond the horizon: the probability that a sunbeam passes the clouds, haze or mountains on its way.

Light is linear in the direct beam.  Whatever takes a part of it far from the observer, and is not itself in view, is a
factor on it.  A beam arrives at a point after a way through the air of which s [km] is the distance from the point
towards the sun and h(s) the altitude.  A screen that begins at `from_km` and ends at `to_km` lets

    T(h_least),     h_least = min h(s) over from_km <= s <= to_km,

of it pass, T linear between the altitudes of a table and beyond them as at its ends.  Along a ray h falls to the
tangent altitude and rises again, so h_least is

- the tangent altitude, where that lies on this part of the way;
- the altitude at `from_km` for a beam whose tangent point is nearer than that, or that still falls when it arrives
  (with from_km = 0 that of the point itself: what has not yet come down to the clouds has not met them);
- the altitude at `to_km` for a tangent point farther than that.

Clouds with tops of normally distributed altitude have T(h) = 1 - cover Phi((top - h)/spread); a skyline is a wall at
one distance, from_km = to_km, T = 0 below its height and 1 above.  What is thin enough to be seen through takes more of
one colour: with the optical depth -ln T proportional to wavelength^-alpha (Angstrom),

    T(h, wavelength) = T(h, 550 nm)^((wavelength/550 nm)^-alpha),

alpha = 0 for clouds and mountains, 1 to 2 for haze and smoke.

Limits.  Nothing is scattered by the screen itself: its own light, and what is seen of it, are left out.  Distances
count from the lit point, so that the air remains symmetric about the axis from the Earth to the sun; what is seen from
the ground lies within some 300 km of the observer.  `montecarlo` counts them from the observer
(docs/configurations.md: how far the two differ).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from twilight.base.errors import TwilightError

EDGE_KM = 0.01
"""Altitude over which a skyline goes from dark to clear [km]."""
CLOUD_SPREADS = tuple(x / 4.0 for x in range(-12, 13))
"""Altitudes of the table of cloud tops, in spreads from their mean."""
REFERENCE_NM = 550.0
"""Wavelength [nm] of the transmission of a screen that is not grey."""
STEP_KM = 0.25
"""Largest distance of the altitudes between which n r is taken as linear [km]."""


@dataclass(frozen=True)
class Screen:
    """T by the least altitude of the beam between two distances from the point where it arrives.

    altitude_km, transmission: increasing altitudes above sea level [km], and T there, 0 to 1, at 550 nm; from_km,
    to_km: the part of the way that counts [km], as distances from the point; angstrom_exponent: alpha of the optical
    depth -ln T, -1 to 5.  Errors: TwilightError for a table or distances that mean nothing."""

    altitude_km: tuple[float, ...]
    transmission: tuple[float, ...]
    from_km: float = 0.0
    to_km: float = math.inf
    angstrom_exponent: float = 0.0

    def __post_init__(self) -> None:
        z, t = np.array(self.altitude_km), np.array(self.transmission)
        if z.ndim != 1 or z.size < 1 or z.shape != t.shape:
            raise TwilightError("a screen has as many transmissions as altitudes, one or more")
        if not np.all(np.isfinite(z)) or np.any(np.diff(z) <= 0.0):
            raise TwilightError("the altitudes of a screen must be finite and increase")
        if not np.all((t >= 0.0) & (t <= 1.0)):
            raise TwilightError("the transmission of a screen must be between 0 and 1")
        if not 0.0 <= self.from_km <= self.to_km:
            raise TwilightError("a screen must begin at 0 km or farther and end no nearer than it begins")
        if not -1.0 <= self.angstrom_exponent <= 5.0:
            raise TwilightError("the Angstrom exponent of a screen must be between -1 and 5")

    @staticmethod
    def of_clouds(
        cover: float, top_km: float, top_spread_km: float, from_km: float, angstrom_exponent: float = 0.0
    ) -> Screen:
        """Clouds that let 1 - cover of grazing beams pass; mean altitude and standard deviation of their tops [km]."""
        from statistics import NormalDist  # start-up

        spread = max(top_spread_km, EDGE_KM)
        normal = NormalDist(top_km, spread)
        z = tuple(top_km + spread * x for x in CLOUD_SPREADS)
        passed = tuple(1.0 - cover * (1.0 - normal.cdf(h)) for h in z)
        return Screen(z, passed, from_km, angstrom_exponent=angstrom_exponent)

    @staticmethod
    def of_skyline(height_km: float, distance_km: float) -> Screen:
        """A wall across the sun's azimuth, up to a height above sea level at a distance [km]."""
        return Screen((height_km - EDGE_KM, height_km), (0.0, 1.0), distance_km, distance_km)

    def at(self, altitude_km) -> np.ndarray:
        """T at 550 nm of beams by their least altitude [km], of any shape."""
        return np.interp(altitude_km, self.altitude_km, self.transmission)

    def powers(self, wavelength_nm) -> np.ndarray:
        """Powers of T at 550 nm that are T at wavelengths [nm], of any shape."""
        return (np.asarray(wavelength_nm, dtype=float) / REFERENCE_NM) ** -self.angstrom_exponent

    @property
    def refined_km(self) -> np.ndarray:
        """The altitudes [km], and more where they lie so far apart that n r is not linear in between."""
        more = [np.linspace(a, b, math.ceil((b - a) / STEP_KM), endpoint=False) for a, b in pairwise(self.altitude_km)]
        return np.concatenate([*more, self.altitude_km[-1:]])
