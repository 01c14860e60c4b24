"""Thick clouds for the tests of stiff media, with what plane-parallel theory says of them."""

from dataclasses import replace

import numpy as np
from plane_parallel import RAYLEIGH, Slabs, henyey_greenstein
from stability_media import Air, medium_of

from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import PhaseFunction

FLAT_KM = 2e5
"""Radius of a planet that is flat at the scale of a cloud."""


def cloud(
    *depths, base_km=1.0, top_km=2.0, asymmetry=0.85, albedo=1.0, ground=1.0, air=0.05, radius_km=FLAT_KM
) -> Medium:
    """A uniform cloud between two altitudes, of one optical depth for each wavelength, in uniform air up to 4 km."""
    edges = [0.0, *([base_km, base_km] if base_km > 0.0 else []), top_km, top_km, 4.0]
    n = len(depths)
    medium = medium_of(*[Air(air=0.0, aerosol=0.0, ground=ground)] * n, levels_km=edges)
    extinction = np.zeros_like(medium.aerosol_extinction_per_km)
    first = 2 if base_km > 0.0 else 0
    extinction[first : first + 2] = np.array(depths) / (top_km - base_km)
    return replace(
        medium,
        aerosol_extinction_per_km=extinction,
        aerosol_single_scattering_albedo=np.full_like(extinction, albedo),
        air_scattering_per_km=np.full_like(extinction, air / 4.0),
        phase_functions=(PhaseFunction.henyey_greenstein([asymmetry] * n),),
        refractivity=np.zeros_like(extinction),
        earth_radius_km=radius_km,
    )


def slabs(depth, sun_cosine, base_km=1.0, top_km=2.0, asymmetry=0.85, albedo=1.0, ground=1.0, air=0.05) -> Slabs:
    """The same air between planes: levels are the top, the cloud's top and base, and the ground."""
    air_depth = air * (top_km - base_km) / 4.0
    scattering = albedo * depth + air_depth
    chi = albedo * depth * henyey_greenstein(asymmetry)
    chi[:3] += air_depth * RAYLEIGH
    layers = [
        (air * (4.0 - top_km) / 4.0, 1.0, RAYLEIGH),
        (depth + air_depth, scattering / (depth + air_depth), chi / scattering),
    ]
    if base_km > 0.0:
        layers.append((air * base_km / 4.0, 1.0, RAYLEIGH))
    return Slabs(layers, ground, sun_cosine)
