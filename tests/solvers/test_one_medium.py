"""One medium, the same for every solver: what moves the reference's sky moves each other's alike, or is refused."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from twilight import solvers
from twilight.atmosphere.medium import Medium
from twilight.atmosphere.screen import Screen
from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.config.climate import Climate
from twilight.engine import solve
from twilight.numerics.phase import PhaseFunction
from twilight.scene import resolve
from twilight.scene.plan import not_computed

E, A = (x.ravel() for x in np.meshgrid([2.0, 10.0, 35.0, 80.0], [0.0, 60.0, 180.0], indexing="ij"))
SUNS_DEG = (10.0, -1.0, -4.0, -9.0)
URBAN = {"aerosol": {"type": "urban", "optical_depth_550nm": 0.3}}
MODES = {"aerosol": {"modes": [{"number_density_per_cm3": 1500.0, "median_radius_um": 0.15, "sigma": 1.8}]}}
LAW = {"aerosol": {"angstrom": {}, "optical_depth_550nm": 0.3}}
DUST = {"aerosol": URBAN["aerosol"] | {"mineral_transported": {"optical_depth_550nm": 0.1}}}
VOLCANO = URBAN | {"stratosphere": {"kind": "moderate_volcanic"}}
MEASURED = URBAN | {
    "stratosphere": {
        "kind": "nh_midlat_typical",
        "levels": {"altitude_km": [15.0, 25.0], "wavelength_nm": [550.0], "extinction_per_km": [[2e-3], [1e-3]]},
    }
}
LEVELS = {
    "altitude_km": [0, 5, 10, 20, 30, 50, 80, 120],
    "pressure_hpa": [990, 530, 260, 55, 12, 0.8, 0.01, 2.5e-5],
    "temperature_k": [280, 250, 220, 215, 225, 270, 195, 360],
    "water_vapour_ppm": [8000, 1000, 60, 4, 5, 5, 4, 1],
    "ozone_ppm": [0.03, 0.05, 0.3, 3.0, 7.0, 3.0, 0.3, 0.1],
}
BOUNDARIES = {"atmosphere": {"layers": {"boundaries_km": [*range(0, 40, 2), *range(40, 101, 5)]}}}
DEPTHS = {"wavelength_nm": [440.0, 870.0], "optical_depth": [0.2, 0.08]}
KEYS: dict[str, tuple[Any, dict[str, Any]]] = {
    "atmosphere.profile": ("subarctic_winter", URBAN),
    "atmosphere.levels": (LEVELS, URBAN),
    "atmosphere.top_km": (120.0, URBAN),
    "atmosphere.layers.equal_air_mass": (50, URBAN),
    "atmosphere.layers.boundaries_km": (BOUNDARIES["atmosphere"]["layers"]["boundaries_km"], URBAN),
    "atmosphere.layers.coefficients": ("centre", URBAN | BOUNDARIES),
    "gases.ozone.column_du": (250.0, URBAN),
    "gases.ozone.climatology": (False, URBAN | {"atmosphere": {"profile": "midlatitude_winter"}}),
    "gases.ozone.day_of_year": (100, URBAN),
    "gases.ozone.treatment": ("overhead_filter", URBAN),
    "gases.water_vapour.column_mm": (5.0, URBAN),
    "gases.oxygen": (False, URBAN),
    "gases.no2": (False, URBAN),
    "gases.o4": (False, URBAN),
    "refraction.model": ("haber", URBAN),
    "refraction.relative_humidity_percent": (50.0, URBAN | {"refraction": {"model": "haber"}}),
    "refraction.co2_ppm": (2000.0, URBAN),
    "aerosol.type": ("continental_average", URBAN),
    "aerosol.components": ({"waso": 7000.0, "inso": 0.4}, {"aerosol": {"components": {"waso": 3000.0}}}),
    "aerosol.relative_humidity_percent": (50.0, {"aerosol": {"type": "urban"}}),
    "aerosol.optical_depth_550nm": (0.1, URBAN),
    "aerosol.optical_depths": (DEPTHS, {"aerosol": {"type": "urban"}}),
    "aerosol.optical_depths.wavelength_nm": ([500.0, 870.0], {"aerosol": {"type": "urban", "optical_depths": DEPTHS}}),
    "aerosol.optical_depths.optical_depth": ([0.1, 0.08], {"aerosol": {"type": "urban", "optical_depths": DEPTHS}}),
    "aerosol.turbidity": (3.0, {"aerosol": {"type": "urban"}}),
    "aerosol.visibility_km": (40.0, {"aerosol": {"type": "urban"}}),
    "aerosol.phase_function": ("henyey_greenstein", URBAN),
    "aerosol.boundary_layer_top_km": (1.0, URBAN),
    "aerosol.scale_height_km": (1.0, URBAN),
    "aerosol.boundary_layer_base": ("sea_level", URBAN | {"ground": {"altitude_km": 1.5}}),
    "aerosol.mineral_transported": (DUST["aerosol"]["mineral_transported"], URBAN),
    "aerosol.mineral_transported.bottom_km": (3.5, DUST),
    "aerosol.mineral_transported.top_km": (8.0, DUST),
    "aerosol.mineral_transported.optical_depth_550nm": (0.2, DUST),
    "aerosol.free_troposphere": (False, URBAN),
    "aerosol.stratosphere": ("none", URBAN),
    "aerosol.modes.number_density_per_cm3": (800.0, MODES),
    "aerosol.modes.median_radius_um": (0.1, MODES),
    "aerosol.modes.sigma": (1.6, MODES),
    "aerosol.modes.min_radius_um": (0.2, MODES),
    "aerosol.modes.max_radius_um": (0.6, MODES),
    "aerosol.modes.refractive_index.real": ([1.6], MODES),
    "aerosol.modes.refractive_index.imaginary": ([0.02], MODES),
    "aerosol.angstrom.exponent": (0.5, LAW),
    "aerosol.angstrom.single_scattering_albedo": (0.8, LAW),
    "aerosol.angstrom.asymmetry": (0.75, LAW),
    "stratosphere.kind": ("high_volcanic", VOLCANO),
    "stratosphere.season": ("fall_winter", VOLCANO),
    "stratosphere.upper_atmosphere": ("extreme", VOLCANO),
    "stratosphere.levels": (MEASURED["stratosphere"]["levels"], URBAN | {"stratosphere": {"kind": "tropical_typical"}}),
    "stratosphere.levels.altitude_km": ([18.0, 25.0], MEASURED),
    "stratosphere.levels.wavelength_nm": ([700.0], MEASURED),
    "stratosphere.levels.extinction_per_km": ([[4e-3], [1e-3]], MEASURED),
    "stratosphere.levels.median_radius_um": ([0.3, 0.1], MEASURED),
    "clouds": ([{"kind": "cirrus", "optical_depth": 0.05}], URBAN),
    "ground.albedo": (0.5, URBAN),
    "ground.albedo.wavelength_nm": ([400.0, 500.0], URBAN | {"ground": {"albedo": {"albedo": [0.1, 0.8]}}}),
    "ground.albedo.albedo": ([0.8, 0.1], URBAN | {"ground": {"albedo": {"albedo": [0.1, 0.8]}}}),
    "ground.altitude_km": (2.0, URBAN),
}
"""Of each key of a climate another value, and the climate that has it otherwise."""
IN_BANDS_NM = {"gases.water_vapour.column_mm": 720.0, "gases.oxygen": 762.0}
"""Keys that act in the bands of gases alone."""
ELSEWHERE = {
    "gases.own.",  # a file too
    *("version", "name", "description"),  # no light
    *("medium", "air", "aerosol.table", "ground.albedo_map", "atmosphere.levels.file"),  # files: they become the rest
    *("clouds.", "atmosphere.levels.", "aerosol.modes.refractive_index.wavelength_nm"),  # parts of what moves as one
    "aerosol.mineral_transported.number_density_per_cm3",  # in place of an optical depth
}
"""Beginnings of other keys."""
SOLVERS = ("zones", "montecarlo", "tables", "cells", "sasktran2", "compact")
FILTER = "overhead_absorption_optical_depth"
NO_LIGHT = {"wavelength_nm", "name", "notes", "grid_medium"}
"""What a medium has for records and grids."""


def leaves(section: type[BaseModel], path: str = "") -> Iterator[str]:
    """Dotted names of all keys of a section and of the sections in it."""

    def sections(annotation: Any) -> Iterator[type[BaseModel]]:
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            yield annotation
        for part in typing.get_args(annotation):
            yield from sections(part)

    for name, key in section.model_fields.items():
        inner = list(sections(key.annotation))
        if not inner or name in ("albedo", "clouds"):
            yield path + name
        for one in inner:
            yield from leaves(one, f"{path}{name}.")


def put(climate: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """The climate with a key set; of lists in the first item."""
    changed = deepcopy(climate)
    *sections, last = path.split(".")
    at: Any = changed
    for name in sections:
        at = at.setdefault(name, {}) if isinstance(at, dict) else at[0].setdefault(name, {})
    (at if isinstance(at, dict) else at[0])[last] = value
    return changed


SKIES: dict[str, np.ndarray] = {}
"""Of the climates that keys change, computed once."""


def configured(climate: dict[str, Any], solver: str, nm: list[float]) -> Any:
    document = {"version": 1, "climate": {"version": 1, "name": "air"} | climate, "omit_negligible": False}
    return load(document | {"wavelengths": {"list_nm": nm}, "solver": {"name": solver, "polarisation": False}})


def sky(climate: dict[str, Any], solver: str, nm: list[float], **quality: str) -> np.ndarray:
    key = repr((climate, solver, nm, quality))
    if key not in SKIES:
        field = solve(resolve(load(configured(climate, solver, nm).model_dump(exclude_unset=True), quality)))
        SKIES[key] = np.array([field.radiance(sun, E, A) for sun in SUNS_DEG])
    return SKIES[key]


def test_every_key_of_a_climate_is_asked_for():
    """A new key could be ignored by a solver, and nothing would look."""
    known = [name for name in leaves(Climate) if name not in KEYS]
    assert [name for name in known if not name.startswith(tuple(ELSEWHERE))] == []


@pytest.mark.parametrize("key", KEYS)
def test_each_key_of_a_climate_moves_the_fitted_model_or_is_refused(key, reference=False):
    """`compact` would show the sky of another air, as it did of ozone that filters the sunlight above the air."""
    value, base = KEYS[key]
    nm = [IN_BANDS_NM[key]] if key in IN_BANDS_NM else [450.0, 602.0]
    other = put(base, key, value)
    try:
        moved = np.log(sky(other, "compact", nm) / sky(base, "compact", nm))
    except TwilightError as refused:
        assert "the compact model of clear air is made of" in str(refused)
        return
    assert np.abs(moved).max() > 1e-4
    if reference:
        exact = np.log(np.divide(*(sky(air, "zones", nm, **{"solver.quality": "draft"}) for air in (other, base))))
        off, most = (np.percentile(np.abs(part), 95) for part in (moved - exact, exact))
        assert off < 0.035 + 0.1 * most, (off, most)


@pytest.mark.slow
@pytest.mark.parametrize("key", KEYS)
def test_each_key_of_a_climate_moves_the_fitted_model_as_it_moves_zones(key):
    test_each_key_of_a_climate_moves_the_fitted_model_or_is_refused(key, reference=True)


PARTS: dict[str, Any] = {
    "altitude_km": lambda m: 0.97 * m.altitude_km,
    "air_scattering_per_km": lambda m: 0.85 * m.air_scattering_per_km,
    "absorption_per_km": lambda m: 3.0 * m.absorption_per_km,
    "aerosol_extinction_per_km": lambda m: 2.0 * m.aerosol_extinction_per_km,
    "aerosol_single_scattering_albedo": lambda m: 0.8 * m.aerosol_single_scattering_albedo,
    "aerosol_phase_fraction": lambda m: m.aerosol_phase_fraction[::-1].copy(),
    "phase_functions": lambda m: tuple(
        PhaseFunction.henyey_greenstein(np.full(m.n_wavelengths, g))
        for g in np.linspace(0.4, 0.7, len(m.phase_functions))
    ),
    "refractivity": lambda m: 0.7 * m.refractivity,
    "depolarisation": lambda m: m.depolarisation + 0.06,
    "ground_albedo": lambda m: m.ground_albedo + 0.6,
    FILTER: lambda m: m.overhead_absorption_optical_depth + 0.4,
    "earth_radius_km": lambda m: m.earth_radius_km + 20.0,
    "screen": lambda m: Screen((0.0, 8.0), (0.0, 1.0), from_km=300.0, to_km=600.0),
}
"""Of each part of a medium another one."""
QUALITY = {"zones": "draft", "montecarlo": "draft", "tables": "bruneton2017", "cells": "draft", "sasktran2": "draft"}
FEW_E, FEW_A = np.array([8.0, 30.0, 60.0, 30.0]), np.array([0.0, 0.0, 90.0, 180.0])
CHEAPER: dict[str, dict[str, Any]] = {
    "montecarlo": {"target_stderr": 0.01},
    "tables": {"scattering_r": 24, "scattering_mu": 32, "scattering_mu_s": 16},
    "sasktran2": {"incoming": 50},
}
NEAR = {"montecarlo": 0.05, "tables": 0.2, "cells": 0.4, "sasktran2": 0.25}
"""How far ln of a change may be from that of zones, relative to it; 0.1 of others: some are coarse in twilight."""
NOISE = {"montecarlo": 0.06, "tables": 0.04, "cells": 0.06, "sasktran2": 0.08}
"""And in any case, 0.02 of others: of `montecarlo` by noise of 0.01 in each of two skies."""


@pytest.fixture(scope="module")
def urban() -> Medium:
    return resolve(configured(URBAN, "zones", [602.0])).medium


@pytest.fixture(scope="module")
def lights():
    return {}


def by_mean_cosine(medium: Medium) -> Medium:
    """The medium with Henyey and Greenstein's functions of the same mean cosines."""
    phases = (PhaseFunction.henyey_greenstein(p.legendre_moments(1)[:, 1]) for p in medium.phase_functions)
    return replace(medium, phase_functions=tuple(phases))


def light(solver: str, medium: Medium) -> np.ndarray:
    module = solvers.load(solver)
    quality = module.QUALITIES[QUALITY.get(solver, "standard")]
    if hasattr(quality, "polarisation"):
        quality = replace(quality, polarisation=False)
    quality = replace(quality, **CHEAPER.get(solver, {}))
    field = module.prepare(medium, quality, observer_altitude_km=medium.bottom_km)
    return np.array([field.radiance(sun, FEW_E, FEW_A) for sun in (20.0, -1.0)])


def test_every_part_of_a_medium_is_asked_for():
    assert {one.name for one in fields(Medium)} == set(PARTS) | NO_LIGHT


@pytest.mark.parametrize(
    ("solver", "part"),
    [
        pytest.param(solver, part, marks=() if solver == "compact" or part == FILTER else pytest.mark.slow)
        for solver in SOLVERS[1:]
        for part in PARTS
    ],
)
def test_each_part_of_a_medium_moves_a_sky_as_that_of_zones_or_is_refused(solver, part, urban, lights):
    """A solver would solve other air than was asked for, without a word."""
    can = solvers.load(solver).CAPABILITIES
    if not can.installed:
        pytest.skip("needs another program")
    if part == "screen" and not can.screen:
        return  # `Scene` refuses it
    said = {one.part for one in not_computed(load({"version": 1, "climate": "urban", "solver": {"name": solver}}))}
    if part == "refractivity" and can.straight_rays:
        assert "refraction" in said
        return
    assert ("phase functions" in said) == can.simple_phases
    medium = by_mean_cosine(urban) if can.simple_phases else urban
    other = replace(medium, **{part: PARTS[part](medium)})
    air = "by mean cosine" if can.simple_phases else ""
    for key, seen in (((solver, air), medium), (("zones", air), medium), (("zones", air + part), other)):
        if key not in lights:
            lights[key] = light(key[0], seen)
    try:
        moved = np.log(light(solver, other) / lights[solver, air])
    except TwilightError as refused:
        assert solver == "compact", refused
        return
    if part == "depolarisation" and can.simple_phases:
        assert np.abs(moved).max() == 0.0
        return
    exact = np.log(lights["zones", air + part] / lights["zones", air])
    assert np.abs(exact).max() > 1e-3
    most = NOISE.get(solver, 0.02) + NEAR.get(solver, 0.1) * np.abs(exact).max()
    assert np.abs(moved).max() > 1e-4
    assert np.abs(moved - exact).max() < most, (moved[..., 0], exact[..., 0])
