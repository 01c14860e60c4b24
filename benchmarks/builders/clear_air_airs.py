"""Airs for the fit of the model of clear air: drawn, and solved by `zones` for every sun and two observers.

    python benchmarks/builders/clear_air_airs.py FOLDER               in two processes: --step 2, and --first 1 --step 2

One file for each number, FOLDER/<number>.npz, until --last is reached or it is stopped; what is there stays.  What it
holds is drawn from its number alone: one air at eight wavelengths, from SIDE_BY_SIDE on eight airs at one wavelength
each.  5 to 100 processor seconds a file.  With --first UNSOLVED --last N it writes what the shipped model says of airs
that are not solved, a processor second each: what it knew is not lost to the next one.  `--apart` solves, of each
PICKED_OF numbers from APART on, the one on which the networks of the model shipped that day disagree most; those that
are there stay.  `--better` solves airs of the folder once more, in an order drawn, by `BETTER_SETTINGS`: numbers from
BETTER on, minutes each.  `--approximate FOLDER2` computes in place of it what the model itself computes of the airs
that are there (FOLDER may be a file of `clear_air_kept.py`), to be done again when code changes: three processor
seconds each; `clear_air_fit.py` fits all.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from clear_air_kept import degrees
from clear_air_learners import TOLERATED

from twilight.atmosphere.medium import ON_LEVELS, Medium
from twilight.atmosphere.opac import opac_type
from twilight.atmosphere.profiles import PROFILES
from twilight.base.errors import TwilightError
from twilight.base.whole_files import whole_file
from twilight.clear_air import Air, Skies
from twilight.clear_air.entry import shipped_model
from twilight.clear_air.model import AZIMUTH_DEG, ELEVATION_DEG, SUN_DEG
from twilight.clear_air.of_medium import air_of, limited, two_phase_functions
from twilight.clear_air.of_medium import side_by_side as joined_airs
from twilight.config.aerosol import AerosolType
from twilight.config.load import load_climate
from twilight.numerics.phase import TABLE, PhaseFunction
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.zones.air_needs import degree_needed
from twilight.solvers.zones.settings import QUALITIES

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
VOLCANOES = ("moderate_volcanic", "high_volcanic", "extreme_volcanic", *(s for s in STRATOSPHERES if "extreme" in s))
"""Loaded stratospheres."""
VOLCANIC = 0.3
"""Part of the airs whose stratosphere is one of `VOLCANOES`; others have any."""
EXTREME_DUST = 0.25
"""Part of LOWTRAN's stratospheres with much meteoric dust above 30 km."""
LOW_HAZE = 0.35
"""Part of the airs whose boundary layer and scale height are drawn in place of the type's own."""
CARRIED_DUST = 0.08
"""Part of the airs with a layer of transported desert dust."""
RAISED = 0.15
"""Part of the airs over raised ground."""
HIGHEST_GROUND_KM = 4.5
"""Highest ground."""
RED_NM, RED_CHANCE = 600.0, 2.5
"""Wavelengths from which on one is as many times likelier to be drawn: light carried along the horizon is red."""
PURE = 0.05
"""Part of the airs without any particles."""
ODD = 0.3
"""Part of the airs with absorption that no climate's gases have, or with other ozone absorption."""
MOST_OZONE_DEPTH = 0.5
"""Vertical optical depth up to which absorption by ozone is drawn larger than it is."""
HIGHEST_KM = 15.0
"""Highest of the second observers."""
SETTINGS = QUALITIES["draft"]
BETTER_SETTINGS = replace(QUALITIES["standard"], polar_directions=24, late_polar_directions=10)
"""`SETTINGS` are off by 5 to 20 % below volcanoes of the largest depth in deep twilight, and by up to 5 % beside coarse
particles, differently in each air.  Of the kept airs 39 have 44 directions a side and half as
many points again along rays: beside those, 24 differ by 0.2 to 0.4 % below a volcano."""
SIDE_BY_SIDE = 1000
"""Number from which on each wavelength has an air of its own, over one ground and profile; before, all have one air."""
ONE_SHAPE = 4000
"""Number from which on these have their haze at the same altitudes: half the nodes that eight shapes need."""
LOADED = 5000
"""Number from which on these all have one of `VOLCANOES`."""
APART = 6000
"""Number from which on these are as from ONE_SHAPE on, but only those of `picked` are solved."""
PICKED_OF = 5
"""Numbers of which `picked` takes one."""
UNSOLVED = 10000
"""Number from which on airs are as the first ones, but not solved: their light is what the shipped model says."""
BETTER = 20000
"""What is added to the number of an air that is solved once more, by `BETTER_SETTINGS`."""
OF_WAVELENGTHS = (
    *("wavelength_nm", "aerosol_phase_fraction", "depolarisation", "ground_albedo"),
    "overhead_absorption_optical_depth",
)
"""Other arrays of a medium whose last axis are its wavelengths."""
CANDIDATES = 24
"""Airs that are drawn for these: eight alike in their haze, so that none makes the others dear."""


def drawn_climate(rng: np.random.Generator, number: int) -> dict[str, Any]:
    """A climate's document: the aerosol's type in turn, the rest drawn."""
    volcanic = rng.random() < VOLCANIC or LOADED <= number < APART
    stratosphere: dict[str, Any] = {"kind": str(rng.choice(VOLCANOES if volcanic else STRATOSPHERES))}
    if stratosphere["kind"].endswith(("background", "volcanic")):
        stratosphere["season"] = str(rng.choice(["spring_summer", "fall_winter"]))
        stratosphere["upper_atmosphere"] = "extreme" if rng.random() < EXTREME_DUST else "normal"
    aerosol: dict[str, Any] = {"optical_depth_550nm": _log_uniform(rng, 0.01, 1.0)}
    kinds = (*get_args(AerosolType), "angstrom", "angstrom")
    kind = kinds[number % len(kinds)]
    if kind == "angstrom":
        law = {"exponent": (0.0, 2.2), "single_scattering_albedo": (0.8, 1.0), "asymmetry": (0.55, 0.78)}
        aerosol["angstrom"] = {key: float(rng.uniform(*limits)) for key, limits in law.items()}
    else:
        aerosol["type"] = kind
        aerosol["relative_humidity_percent"] = int(rng.choice(HUMIDITIES))
    if rng.random() < LOW_HAZE:
        aerosol["boundary_layer_top_km"] = _log_uniform(rng, 0.25, 3.0)
        aerosol["scale_height_km"] = _log_uniform(rng, 0.2, 8.0)
    if rng.random() < CARRIED_DUST:
        bottom = float(rng.uniform(1.0, 4.0))
        layer = {"bottom_km": bottom, "top_km": bottom + float(rng.uniform(1.0, 3.0))}
        aerosol["mineral_transported"] = layer | {"optical_depth_550nm": _log_uniform(rng, 0.01, 0.4)}
        aerosol["optical_depth_550nm"] = 0.4 + 0.6 * aerosol["optical_depth_550nm"]
    particles = {} if rng.random() < PURE else {"aerosol": aerosol, "stratosphere": stratosphere}
    ground = {"altitude_km": float(rng.uniform(0.0, HIGHEST_GROUND_KM))} if rng.random() < RAISED else {}
    return {
        "version": 1,
        "name": "drawn",
        "description": "drawn",
        "atmosphere": {"profile": str(rng.choice(PROFILES))},
        "ground": ground,
        "gases": {
            "oxygen": False,
            "water_vapour": {"column_mm": 0},
            "ozone": {"column_du": float(rng.uniform(190.0, 460.0))},
        },
    } | particles


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def drawn_medium(rng: np.random.Generator, number: int) -> Medium:
    """The medium of a drawn climate, with each wavelength's own ground, air and absorption beside what the climate
    says, so that few wavelengths teach all."""
    wavelength = np.sort(rng.choice(WAVELENGTH_NM, WAVELENGTHS, replace=False, p=chances()))
    while True:
        try:
            medium = climate_medium(load_climate_document(drawn_climate(rng, number)), wavelength)
            break
        except TwilightError:  # less aerosol in all than in the stratosphere alone: another one
            continue
    return changed(rng, medium)


def chances() -> np.ndarray:
    """How likely each of WAVELENGTH_NM is drawn first."""
    chance = np.where(np.array(WAVELENGTH_NM) >= RED_NM, RED_CHANCE, 1.0)
    return chance / chance.sum()


def changed(rng: np.random.Generator, medium: Medium) -> Medium:
    """The medium with a ground, air and absorption of each wavelength's own."""
    n = medium.n_wavelengths
    albedo = np.where(rng.random(n) < 0.15, 0.0, rng.uniform(0.0, 0.9, n))
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


def side_by_side(rng: np.random.Generator, number: int) -> Medium:
    """The medium of several drawn climates over one ground, each at one wavelength: each with two aerosols, the means
    of its own below and above 12 km."""
    over = drawn_climate(rng, number)
    while number >= ONE_SHAPE and "aerosol" not in over:
        over = drawn_climate(rng, number)
    shared = {"ground": over["ground"], "atmosphere": over["atmosphere"]}
    media = []
    while len(media) < CANDIDATES:
        nm = float(rng.choice(WAVELENGTH_NM, p=chances()))
        one = drawn_climate(rng, int(rng.integers(1000))) | shared
        if number >= ONE_SHAPE:
            shaped(one, over)
        try:
            climate = load_climate_document(one)
            media.append(two_phase_functions(changed(rng, climate_medium(climate, np.array([nm])))))
        except TwilightError:  # less aerosol in all than in the stratosphere alone
            continue
    scattering = [float((m.optical_depth("aerosol") * m.aerosol_single_scattering_albedo.mean())[0]) for m in media]
    first = number % (CANDIDATES // WAVELENGTHS) * WAVELENGTHS
    chosen = [media[i] for i in np.argsort(scattering)[first : first + WAVELENGTHS]]
    levels = np.unique(np.concatenate([m.altitude_km for m in chosen]))
    twice = {float(z) for m in chosen for z in m.altitude_km[1:][np.diff(m.altitude_km) == 0.0]}
    levels = np.sort(np.concatenate([levels, np.array(sorted(twice))]))
    chosen = [on_levels(m, levels) for m in chosen]
    joined = {key: np.concatenate([getattr(m, key) for m in chosen], axis=-1) for key in (*ON_LEVELS, *OF_WAVELENGTHS)}
    phases = [
        PhaseFunction(
            TABLE,
            np.concatenate([p.asymmetry for p in kinds]),
            np.concatenate([p.log_table for p in kinds]),
            kinds[0].name,
            np.concatenate([p.ratios for p in kinds], axis=1),
        )
        for kinds in zip(*(m.phase_functions for m in chosen), strict=True)
    ]
    return replace(chosen[0], phase_functions=tuple(phases), **joined)


def shaped(document: dict[str, Any], like: dict[str, Any]) -> None:
    """Give the haze of a drawn climate the altitudes of another's, so that both need the same nodes."""
    if "aerosol" not in document:
        return
    document["stratosphere"] = like["stratosphere"]
    aerosol, other = document["aerosol"], like["aerosol"]
    own = opac_type(other.get("type", "continental_average"))
    for key in ("boundary_layer_top_km", "scale_height_km"):
        aerosol[key] = other.get(key, getattr(own, key))
    dust, layer = aerosol.pop("mineral_transported", None), other.get("mineral_transported")
    if dust is None and layer is not None:
        aerosol["optical_depth_550nm"] = 0.4 + 0.6 * aerosol["optical_depth_550nm"]
    if layer is not None:
        aerosol["mineral_transported"] = layer | {"optical_depth_550nm": (dust or layer)["optical_depth_550nm"]}


def on_levels(medium: Medium, levels: np.ndarray) -> Medium:
    """The same medium on levels that hold all of its own."""
    z = medium.altitude_km
    doubled = np.append(np.diff(z) == 0.0, False)
    pieces = [levels[(levels == z[0])][: 1 if doubled[0] else None]]
    for i in range(1, z.size):
        piece = levels[(levels > z[i - 1]) & (levels <= z[i])]
        if z[i] == z[i - 1]:
            piece = z[i : i + 1]
        elif doubled[i] and piece.size > 1 and piece[-2] == z[i]:
            piece = piece[:-1]
        pieces.append(piece)
    return medium.on_levels(pieces)


def drawn(number: int) -> tuple[Medium, tuple[float, ...]]:
    """The air of a number, and its observers' altitudes above the ground [km]."""
    rng = np.random.default_rng([49, number])
    medium = (side_by_side if SIDE_BY_SIDE <= number < UNSOLVED else drawn_medium)(rng, number)
    return medium, (0.0, float(HIGHEST_KM * rng.random() ** 2))


def airs_of(medium: Medium, number: int) -> Air:
    """What the model takes of the air of a number: where each wavelength has its own, each by itself."""
    if not SIDE_BY_SIDE <= number < UNSOLVED:
        return air_of(medium)
    return joined_airs([air_of(medium.select(np.array([w]))) for w in range(medium.n_wavelengths)])


def sample(path: Path, number: int, settings: zones.ZonesSettings) -> None:
    """Draw an air, solve it, and write its light."""
    medium, observers = drawn(number % BETTER)
    if UNSOLVED <= number < BETTER:
        air = air_of(medium)
        write(path, light=told(air, observers), degree=air.degree[0])
    else:
        write(path, light=several(medium, settings, observers), degree=degree_needed(settings, medium))


def picked(numbers: Sequence[int]) -> int:
    """That of some numbers whose airs the networks of the shipped model disagree on most: in 95 % of the sky, as parts
    of what is tolerated, in the mean of suns, wavelengths and observers."""
    return max(numbers, key=disagreement)


def disagreement(number: int) -> float:
    """How much the networks of the shipped model disagree on the airs of a number."""
    medium, observers = drawn(number)
    air = airs_of(medium, number)
    spread = np.array([Skies(shipped_model(), air, above).at_nodes[3] for above in observers])
    return float((np.percentile(spread, 95, axis=(-2, -1)) / TOLERATED).mean())


def told(air: Air, observers_km: tuple[float, ...]) -> np.ndarray:
    """`several` as the shipped model says it."""
    light = []
    for above in observers_km:
        skies = Skies(shipped_model(), air, above)
        base = np.moveaxis(skies.base(SUN_DEG), -1, 0)
        log_ratio, *polarised, _ = skies.at_nodes
        light.append(np.stack([np.ones_like(log_ratio), *polarised]) * base * np.exp(log_ratio))
    return np.moveaxis(np.array(light), (1, 2), (-2, -1)).astype(np.float32)


def approximate(path: Path, number: int, degree: float) -> None:
    """Write what the model computes of a drawn air: inputs of the network, M_0, and of a solved one light scattered
    once, what limits airs, and `moved`; of one that is solved once more `moved` alone."""
    medium, observers = drawn(number % BETTER)
    air = airs_of(medium, number % BETTER)
    skies = [Skies(None, air, above) for above in observers]
    if number >= BETTER:
        write(path, degree=degree, moved=moved(skies, _singles(skies), degree))
        return
    arrays = {
        "base": np.array([s.base(SUN_DEG) for s in skies], np.float32),
        "inputs": np.array([one.inputs for one in skies], np.float32),
        "log_base": np.array([one.log_base for one in skies], np.float32),
    }
    if number < UNSOLVED:
        single = _singles(skies)
        arrays |= {"single": single[:, :, :, :, 0], "moved": moved(skies, single, degree)}
        arrays["limits"] = limited(air)
    write(path, degree=degree, **arrays)


def _of_degree(path: Path) -> float:
    """Degree of the solution that a file of `approximate` is of."""
    with np.load(path) as file:
        return float(file["degree"])


def moved(skies: Sequence[Skies], single: np.ndarray, degree: float) -> np.ndarray:
    """What is added to light scattered once, (observers, suns, E, A, 3, W), if phase functions are followed to another
    degree, that of a solution: less light stands in peaks then, which count as not scattered, and more in that
    solution's M."""
    air = skies[0].air
    if (air.degree == degree).all():
        return 0.0 * single
    air = air._replace(degree=np.full_like(air.degree, degree))
    return _singles([Skies(None, air, one.observer_km) for one in skies]) - single


def _singles(skies: Sequence[Skies]) -> np.ndarray:
    """Light scattered once at the nodes under all suns, (observers, suns, E, A, 3, W)."""
    return np.array([[one.single_scattering(float(sun)) for sun in SUN_DEG] for one in skies], np.float32)


def write(path: Path, **arrays: np.ndarray) -> None:
    """Write arrays into a file, whole or not at all."""
    with whole_file(path) as unfinished, open(unfinished, "wb") as file:
        np.savez(file, **arrays)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--step", type=int, default=1)
    parser.add_argument("--last", type=int, default=UNSOLVED)
    parser.add_argument("--approximate", type=Path)
    parser.add_argument("--apart", action="store_true")
    parser.add_argument("--better", action="store_true")
    options = parser.parse_args()
    if options.approximate:
        for number, degree in sorted(degrees(options.folder).items())[options.first :: options.step]:
            path = options.approximate / f"{number:05d}.npz"
            path.parent.mkdir(parents=True, exist_ok=True)
            if not (path.exists() and np.isclose(_of_degree(path), degree)):
                approximate(path, number, degree)
        return
    options.folder.mkdir(parents=True, exist_ok=True)
    if options.apart:
        for first in range(APART, UNSOLVED, PICKED_OF)[options.first :: options.step]:
            some = range(first, first + PICKED_OF)
            if not any((options.folder / f"{number:05d}.npz").exists() for number in some):
                number = picked(some)
                sample(options.folder / f"{number:05d}.npz", number, SETTINGS)
        return
    numbers, settings = np.arange(options.last), SETTINGS
    if options.better:
        numbers, settings = np.random.default_rng(49).permutation(UNSOLVED), BETTER_SETTINGS
        numbers = BETTER + np.array([n for n in numbers if (options.folder / f"{n:05d}.npz").exists()])
    for number in numbers[options.first :: options.step].tolist():
        path = options.folder / f"{number:05d}.npz"
        if not path.exists() and not APART <= number < UNSOLVED:
            sample(path, number, settings)


if __name__ == "__main__":
    main()
