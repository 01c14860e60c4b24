"""The polarised benchmark cases of IPRT phase A on a planet so large that it is flat, and a reader of their results.

Emde et al. 2015, J. Quant. Spectrosc. Radiat. Transfer 164, 8.  `tests/data/iprt` holds every fourth zenith angle and
every sixth or twelfth azimuth of the published results of MYSTIC, values unchanged (radiances over the irradiance of
the sun [1/sr]), and the published optical depths of 1 km thick layers.  vza and vaa are where the sensor looks.
"""

from pathlib import Path

import numpy as np

from twilight.atmosphere.medium import Medium

FOLDER = Path(__file__).parent / "data" / "iprt"
RADIUS_KM = 2e6


def results(case: str) -> np.ndarray:
    """Rows of a case (`a1`, ...), as published."""
    return np.genfromtxt(FOLDER / f"{case}_mystic.csv", delimiter=",", names=True)


def layered(z_km, air_per_km, absorption_per_km, depolarisation: float, ground: float = 0.0) -> Medium:
    """Air of constant coefficients inside every layer; z_km (L + 1,), coefficients (L,)."""
    levels = np.repeat(np.asarray(z_km, dtype=float), 2)[1:-1]
    air, absorption = (np.repeat(np.asarray(a, dtype=float), 2)[:, None] for a in (air_per_km, absorption_per_km))
    zero = np.zeros_like(air)
    return Medium(
        wavelength_nm=np.array([500.0]), altitude_km=levels, air_scattering_per_km=air, absorption_per_km=absorption,
        aerosol_extinction_per_km=zero, aerosol_single_scattering_albedo=zero,
        aerosol_phase_fraction=np.zeros((0, levels.size, 1)), phase_functions=(), refractivity=zero,
        depolarisation=np.array([depolarisation]), ground_albedo=np.array([ground]),
        overhead_absorption_optical_depth=np.zeros(1), earth_radius_km=RADIUS_KM,
    )  # fmt: skip


def medium(case: str, depolarisation: float = 0.03) -> Medium:
    """The medium of a case."""
    if case == "a1":
        return layered([0.0, 1.0], [0.5], [0.0], depolarisation)
    if case == "a2":
        return layered([0.0, 1.0], [0.1], [0.0], depolarisation, ground=0.3)
    file = {"b1": "b1_layers_450nm.csv", "b2": "b2_layers_325nm.csv"}[case]
    rows = np.sort(np.genfromtxt(FOLDER / file, delimiter=",", names=True), order="z_bottom_km")
    absorption = rows["tau_absorption"] if case == "b2" else np.zeros(rows.size)
    return layered(np.append(rows["z_bottom_km"], rows["z_top_km"][-1]), rows["tau_rayleigh"], absorption, 0.03)


def azimuth_from_sun_deg(row) -> np.ndarray:
    return row["vaa_deg"] - row["saa_deg"]
