"""Airs for the fit of the model of clear air: drawn, and solved by `zones` for every sun and two observers.

    python benchmarks/clear_air_airs.py FOLDER --first 6000 --step 2    the odd ones beside it: --first 6001 --step 2

One file for each air, FOLDER/<number>.npz, until --last is reached or it is stopped; what is there stays.  An air is
drawn from its number alone.  3 to 25 processor seconds an air.  `--approximate FOLDER2` computes in place of it what
the model itself computes of the airs that are there, to be done again when its code changes: a processor second each.
`benchmarks/clear_air.py` fits both.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from twilight.atmosphere.medium import Medium
from twilight.atmosphere.profiles import PROFILES
from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_file
from twilight.config.aerosol import AerosolType
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.compact.air_columns import AirColumns, two_phase_functions
from twilight.solvers.compact.clear_air import AZIMUTH_DEG, ELEVATION_DEG, SUN_DEG
from twilight.solvers.compact.clear_air_sky import ApproximateSkies, ClearAirSky

HUMIDITIES = (0, 50, 70, 80, 90, 95)
"""Classes of OPAC [%]."""
LOADS = ("low", "typical", "elevated", "extreme")
STRATOSPHERES = (
    *(f"{region}_{load}" for region in ("nh_midlat", "sh_midlat", "tropical") for load in LOADS),
    *("background", "moderate_volcanic", "high_volcanic", "extreme_volcanic"),
)
WAVELENGTH_NM = (320.0, 340.0, 380.0, 440.0, 500.0, 550.0, 600.0, 650.0, 720.0, 850.0, 1000.0)
"""Of which each air has `WAVELENGTHS`."""
WAVELENGTHS = 8
POWER_LAW = 0.2
"""Part of the airs with an aerosol by the power law of Angstrom."""
MERGED = 6000
"""Airs of numbers below have one phase function below 12 km and one above in place of those of their aerosols."""
PURE = 0.06
"""Part of the airs without any particles."""
ODD = 0.3
"""Part of the airs with absorption that no climate's gases have, or with other ozone absorption."""
MOST_OZONE_DEPTH = 0.5
"""Vertical optical depth up to which absorption by ozone is drawn larger than it is."""
HIGHEST_KM = 15.0
"""Highest of the second observers."""
SETTINGS = zones.ZonesSettings(
    degree=12,
    max_degree=16,
    polar_directions=13,
    azimuth_directions=7,
    late_degree=5,
    late_polar_directions=6,
    late_azimuth_directions=5,
    altitude_density=0.4,
    zenith_density=0.6,
    tolerance=0.02,
    step_density=0.3,
    polarisation_degree=3,
    late_polarisation_degree=2,
)


def drawn_climate(rng: np.random.Generator) -> dict[str, Any]:
    """A climate's document."""
    stratosphere: dict[str, Any] = {"kind": str(rng.choice(STRATOSPHERES))}
    if stratosphere["kind"].endswith(("background", "volcanic")):
        stratosphere["season"] = str(rng.choice(["spring_summer", "fall_winter"]))
    aerosol: dict[str, Any] = {"optical_depth_550nm": float(np.exp(rng.uniform(np.log(0.01), np.log(1.0))))}
    if rng.random() < POWER_LAW:
        law = {"exponent": (0.0, 2.2), "single_scattering_albedo": (0.8, 1.0), "asymmetry": (0.55, 0.78)}
        aerosol["angstrom"] = {key: float(rng.uniform(*limits)) for key, limits in law.items()}
    else:
        aerosol["type"] = str(rng.choice(get_args(AerosolType)))
        aerosol["relative_humidity_percent"] = int(rng.choice(HUMIDITIES))
    particles = {} if rng.random() < PURE else {"aerosol": aerosol, "stratosphere": stratosphere}
    return {
        "version": 1,
        "name": "drawn",
        "description": "drawn",
        "atmosphere": {"profile": str(rng.choice(PROFILES))},
        "gases": {
            "oxygen": False,
            "water_vapour": {"column_mm": 0},
            "ozone": {"column_du": float(rng.uniform(190.0, 460.0))},
        },
    } | particles


def drawn_medium(rng: np.random.Generator, vary: bool = True) -> Medium:
    """The medium of a drawn climate.  vary: with each wavelength's own ground, air and absorption beside what the
    climate says, so that few wavelengths teach all."""
    wavelength = np.sort(rng.choice(WAVELENGTH_NM, WAVELENGTHS, replace=False))
    while True:
        try:
            medium = climate_medium(load_climate_document(drawn_climate(rng)), wavelength)
            break
        except TwilightError:  # less aerosol in all than in the stratosphere alone: another one
            continue
    n = medium.n_wavelengths
    albedo = np.where(rng.random(n) < 0.15, 0.0, rng.uniform(0.0, 0.9, n))
    if not vary:
        return replace(medium, ground_albedo=np.full(n, albedo[0]))
    absorption = medium.absorption_per_km
    if rng.random() < ODD:
        depth = medium.optical_depth("absorption")
        factor = np.exp(rng.uniform(-1.5, 1.5, n))
        absorption = absorption * np.minimum(factor, np.maximum(1.0, MOST_OZONE_DEPTH / np.maximum(depth, 1e-9)))
    if rng.random() < ODD:
        height_km = rng.choice([2.0, 8.0])
        depth = np.exp(rng.uniform(np.log(0.005), np.log(2.0), n)) * (rng.random(n) < 0.5)
        above = (medium.altitude_km - medium.bottom_km)[:, None]
        absorption = absorption + depth / height_km * np.exp(-above / height_km)
    air = medium.air_scattering_per_km * np.exp(rng.uniform(-0.3, 0.3, n))
    return replace(medium, absorption_per_km=absorption, air_scattering_per_km=air, ground_albedo=albedo)


def load_climate_document(document: dict[str, Any]):
    """The climate of a document."""
    import tempfile

    import yaml

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drawn.yaml"
        path.write_text(yaml.safe_dump(document))
        return load_climate(path)


def several(medium: Medium, settings: zones.ZonesSettings, observers_km: tuple[float, ...]) -> np.ndarray:
    """Stokes parameters over F0 of light scattered more than once, at the nodes of the model under all suns,
    (observers, suns, E, A, 3, W); observers above the ground."""
    field = zones.prepare(medium, settings, observer_altitude_km=medium.bottom_km)
    field._add_single = lambda *arguments: None
    elevation, azimuth = np.meshgrid(ELEVATION_DEG, AZIMUTH_DEG, indexing="ij")
    return np.array(
        [
            [field.stokes(sun, elevation, azimuth, observer_altitude_km=medium.bottom_km + above) for sun in SUN_DEG]
            for above in observers_km
        ],
        np.float32,
    )


def drawn(number: int) -> tuple[Medium, AirColumns, tuple[float, ...]]:
    """The air of a number, the same in columns, and its observers' altitudes above the ground [km]."""
    rng = np.random.default_rng([32, number])
    medium = drawn_medium(rng)
    observers = (0.0, float(HIGHEST_KM * rng.random() ** 2))
    if number < MERGED:
        medium = two_phase_functions(medium)
    return medium, AirColumns.of(medium), observers


def sample(path: Path, number: int) -> None:
    """Draw an air, solve it, and write its light."""
    medium, _, observers = drawn(number)
    write(path, light=several(medium, SETTINGS, observers))


def approximate(path: Path, number: int) -> None:
    """Write what the model computes of a drawn air: inputs of the network, M_0, light scattered once."""
    _, columns, observers = drawn(number)
    skies = [ApproximateSkies(columns, above) for above in observers]
    bases = [[one.base_at(float(sun), ELEVATION_DEG, AZIMUTH_DEG) for sun in SUN_DEG] for one in skies]
    write(
        path,
        base=np.array(bases, np.float32),
        single=np.array([[_single_scattering(one, float(sun)) for sun in SUN_DEG] for one in skies], np.float32),
        inputs=np.array([one.inputs for one in skies], np.float32),
        log_base=np.array([one.log_base() for one in skies], np.float32),
    )


def _single_scattering(skies: ApproximateSkies, sun_deg: float) -> np.ndarray:
    """Light scattered once at the nodes, (E, A, W)."""
    logarithms = np.log(skies.single_at_nodes(sun_deg))
    nothing = np.full((1, *logarithms.shape[1:]), -np.inf)
    apparent = skies.shells.apparent_elevation_deg(sun_deg)
    columns, parts = skies.columns, np.concatenate([nothing, logarithms])
    sky = ClearAirSky(apparent, columns.medium.depolarisation, columns.phase_functions, parts, nothing[:0])
    return sky.at_nodes()


def write(path: Path, **arrays: np.ndarray) -> None:
    """Write arrays into a file, whole or not at all."""
    with whole_file(path) as unfinished, open(unfinished, "wb") as file:
        np.savez(file, **arrays)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=MERGED)
    parser.add_argument("--step", type=int, default=1)
    parser.add_argument("--last", type=int, default=2 * MERGED)
    parser.add_argument("--approximate", type=Path)
    options = parser.parse_args()
    for number in range(options.first, options.last, options.step):
        light = options.folder / f"{number:05d}.npz"
        path = options.approximate / light.name if options.approximate else light
        path.parent.mkdir(parents=True, exist_ok=True)
        if options.approximate and light.exists() and not path.exists():
            approximate(path, number)
        elif not options.approximate and not path.exists():
            sample(path, number)


if __name__ == "__main__":
    main()
