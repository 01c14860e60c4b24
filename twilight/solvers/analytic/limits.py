"""What formulae for the sky above the ground refuse, in one sentence."""

from __future__ import annotations

import warnings

from twilight.atmosphere.medium import Medium
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.solvers.analytic.turbidity import turbidity_of

HIGHEST_OBSERVER_KM = 1.0
"""The formulae are those of the sky seen from the ground; up to here above it they are taken for it."""

ROUNDING_DEG = 1e-6
"""Elevation of the sun outside the limits that counts as rounding [deg]."""

OUTSIDE = ("nearest", "refuse")
"""What may be done with a turbidity that a formula does not cover."""


def check_observer(medium: Medium, altitude_km: float, solver: str) -> None:
    """Raise TwilightError for an observer who does not stand on the ground, or nearly."""
    low, high = medium.bottom_km, medium.bottom_km + HIGHEST_OBSERVER_KM
    if not low <= altitude_km <= high:
        raise TwilightError(
            f"the {solver} solver knows the sky seen from the ground only: observer.altitude_km is {altitude_km:g}, "
            f"allowed is {low:g} to {high:g}"
        )


def check_sun(sun_elevation_deg: float, solver: str, lowest_deg: float = 0.0, highest_deg: float = 90.0) -> None:
    """Raise TwilightError for a sun below the horizon or outside a fit."""
    if not lowest_deg - ROUNDING_DEG <= sun_elevation_deg <= highest_deg + ROUNDING_DEG:
        raise TwilightError(
            f"the {solver} solver has no sky for this sun: sun.elevation_deg is {sun_elevation_deg:g}, allowed is "
            f"{lowest_deg:g} to {highest_deg:g}; `twilight show solvers` lists those that compute twilight"
        )


def chosen_turbidity(
    turbidity: float | None, outside: str, allowed: tuple[float, float], medium: Medium, solver: str
) -> tuple[float, float | None]:
    """(turbidity to use, the turbidity of the medium or None where it was not needed).

    A turbidity that the user sets must be within ``allowed``.  That of the medium is moved to the nearest allowed one
    with a warning, or refused where ``outside`` is "refuse".
    """
    low, high = allowed
    if turbidity is not None:
        if not low <= turbidity <= high:
            raise TwilightError(f"solver.turbidity is {turbidity:g}; the {solver} solver allows {low:g} to {high:g}")
        return turbidity, None
    found = turbidity_of(medium)
    if low <= found <= high:
        return found, found
    name = medium.name or "the medium"
    if outside == "refuse":
        raise TwilightError(
            f"the turbidity of {name} is {found:.3g}; the {solver} solver allows {low:g} to {high:g}: set "
            "solver.turbidity, or solver.outside to nearest"
        )
    taken = low if found < low else high
    warnings.warn(
        f"the turbidity of {name} is {found:.3g}; the {solver} solver takes {taken:g}, the nearest it has",
        TwilightWarning,
        stacklevel=4,
    )
    return taken, found
