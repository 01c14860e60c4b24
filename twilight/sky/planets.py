"""Magnitudes of the planets by distance and phase: Mallama and Hilton 2018 (Astronomy and Computing 25, 10)."""

from __future__ import annotations

import numpy as np

from twilight.base.errors import TwilightError

SATURN_POLE = (40.589, 83.537)
"""Right ascension and declination of Saturn's pole, ICRS [deg] (IAU working group 2015)."""
_POLYNOMIALS: dict[str, tuple[tuple[float, tuple[float, ...]], ...]] = {
    # (up to this phase angle [deg], coefficients of its powers [mag])
    "mercury": ((180.0, (-0.613, 6.3280e-2, -1.6336e-3, 3.3644e-5, -3.4265e-7, 1.6893e-9, -3.0334e-12)),),
    "venus": (
        (163.7, (-4.384, -1.044e-3, 3.687e-4, -2.814e-6, 8.938e-9)),
        (180.0, (236.05828, -2.81914, 8.39034e-3)),
    ),
    "mars": ((50.0, (-1.601, 2.267e-2, -1.302e-4)), (180.0, (-0.367, -0.02573, 3.445e-4))),
    "jupiter": ((180.0, (-9.395, -3.7e-4, 6.16e-4)),),
    "uranus": ((180.0, (-7.110, 6.587e-3, 1.045e-4)),),
    "neptune": ((180.0, (-7.00,)),),
}


def planet_magnitude(
    name: str, sun_distance_au: float, distance_au: float, phase_angle_deg: float, towards: np.ndarray | None = None
) -> float:
    """Apparent V magnitude of a planet above the air.

    Equations 2 to 17 of Mallama and Hilton 2018 without Mars's rotation and season (0.06 mag), the latitude of sun and
    Earth over Uranus (0.06 mag), and Neptune's change before 2000.  towards (3,): direction of Saturn in the axes of
    the ICRS, by which its rings open; phase angles as seen from the Earth.
    Errors: TwilightError for an unknown planet.
    """
    distance = 5.0 * np.log10(sun_distance_au * distance_au)
    if name == "saturn":
        if towards is None:
            raise TwilightError("saturn: its rings need the direction in which it stands")
        a, d = np.radians(SATURN_POLE)
        pole = np.array([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.sin(d)])
        ring = abs(float(pole @ np.asarray(towards)))
        open_mag = -1.825 * ring + 0.026 * phase_angle_deg - 0.378 * ring * np.exp(-2.25 * phase_angle_deg)
        return float(-8.914 + distance + open_mag)
    if name not in _POLYNOMIALS:
        raise TwilightError(f"planet: '{name}' is not known; {', '.join([*_POLYNOMIALS, 'saturn'])} are")
    powers = next(powers for most, powers in _POLYNOMIALS[name] if phase_angle_deg <= most)
    return float(distance + np.polynomial.polynomial.polyval(phase_angle_deg, powers))
