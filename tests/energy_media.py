"""Odd air for the tests of energy: each case is a wavelength of its own, so that one solve serves all."""

from dataclasses import dataclass, replace

import numpy as np
from stability_media import Air, medium_of

from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import PhaseFunction

LEVELS_KM = np.array(
    [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.0, 3.25, 3.5, 3.5, 5.0, 7.0, 9.0, 12.0, 16.0, 20.0, 24.0, 30.0, 40.0, 60.0]
)
LAYER = slice(7, 10)
"""The levels between the jumps at 3 and 3.5 km."""


@dataclass(frozen=True)
class Odd:
    """Exponential air and aerosol, with a layer between 3 and 3.5 km that has edges."""

    air: Air
    layer_depth: float = 0.0
    layer_albedo: float = 1.0


ODD: dict[str, Odd] = {
    "conservative air over a white ground": Odd(Air(air=0.2, aerosol=0.3, albedo=1.0, ground=1.0)),
    "a conservative layer over a white ground": Odd(Air(air=0.1, aerosol=0.1, albedo=1.0, ground=1.0), 1.0),
    "a conservative layer over a black ground": Odd(Air(air=0.1, aerosol=0.1, albedo=1.0, ground=0.0), 1.0),
    "a grey layer over a bright ground": Odd(Air(air=0.1, aerosol=0.1, albedo=1.0, ground=0.8), 1.0, 0.6),
    "strong absorption above": Odd(Air(air=1.0, aerosol=0.1, ozone=3.0, ground=0.8)),
    "soot below": Odd(Air(air=0.1, aerosol=1.0, albedo=0.3, ground=0.5)),
}


def odd_medium(*cases: Odd, refractivity: float = 2.8e-4) -> Medium:
    """One wavelength for each case."""
    medium = medium_of(*(c.air for c in cases), levels_km=LEVELS_KM, refractivity=refractivity)
    extinction = medium.aerosol_extinction_per_km.copy()
    albedo = medium.aerosol_single_scattering_albedo.copy()
    for w, case in enumerate(cases):
        if case.layer_depth > 0.0:
            thickness = LEVELS_KM[LAYER.stop - 1] - LEVELS_KM[LAYER.start]
            extinction[LAYER, w] = case.layer_depth / thickness
            albedo[LAYER, w] = case.layer_albedo
    phase = PhaseFunction.henyey_greenstein([c.air.asymmetry for c in cases])
    return replace(
        medium, aerosol_extinction_per_km=extinction, aerosol_single_scattering_albedo=albedo, phase_functions=(phase,)
    )
