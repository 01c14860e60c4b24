"""Air with one layer of aerosol that has sharp edges, or steep ones."""

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.numerics.phase import PhaseFunction


def layered(base: float, thickness: float, depth: float, ramp_km: float = 0.0, g: float = 0.7) -> Medium:
    """Air of scale height 8 km, vertical optical depth 0.1, and a layer of HG aerosol; `ramp_km` 0: it jumps."""
    top = base + thickness
    smooth = np.array([0.0, 2.0, 5.0, 10.0, 20.0, 40.0, 70.0, 100.0])
    if ramp_km > 0.0:
        own = [base, base + ramp_km, top - ramp_km, top]
        aerosol_at = {base + ramp_km: 1.0, top - ramp_km: 1.0}
        z = np.array(sorted({*smooth, *own}))
        inside = np.array([aerosol_at.get(x, 1.0 if base + ramp_km < x < top - ramp_km else 0.0) for x in z])
        k = depth / (thickness - ramp_km)
    else:
        inner = [x for x in smooth if base < x < top]
        z = np.array(sorted([*(x for x in smooth if not base <= x <= top), base, base, *inner, top, top]))
        inside = np.zeros(z.size)
        first, last = np.flatnonzero(z == base)[-1], np.flatnonzero(z == top)[0]
        inside[first : last + 1] = 1.0
        if base == 0.0:
            z, inside = z[1:], inside[1:]
        k = depth / thickness
    one = np.ones((z.size, 1))
    return Medium(
        wavelength_nm=np.array([550.0]), altitude_km=z, air_scattering_per_km=(0.1 / 8.0 * np.exp(-z / 8.0))[:, None],
        absorption_per_km=0 * one, aerosol_extinction_per_km=(k * inside)[:, None],
        aerosol_single_scattering_albedo=one, aerosol_phase_fraction=one[None],
        phase_functions=(PhaseFunction.henyey_greenstein(np.full(1, g)),), refractivity=0 * one,
        depolarisation=np.zeros(1), ground_albedo=np.zeros(1), overhead_absorption_optical_depth=np.zeros(1),
    )  # fmt: skip
