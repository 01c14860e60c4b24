"""The small models behind the previews of shipped climates: one aerosol load, one ozone column, eight wavelengths."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from twilight import __version__, solvers
from twilight.base.progress import Progress, part_of, silent
from twilight.config.load import load
from twilight.config.scene import Config
from twilight.io.provenance import configuration_hash
from twilight.scene.medium import climate_medium, wavelengths_of
from twilight.solvers.compact.compact_sky import CompactSky, SkySplines, TuckerTerm, spline_matrix
from twilight.solvers.compact.recognise import air_of
from twilight.studies.fit.compact import training
from twilight.studies.fit.compact.build import Errors, errors_of
from twilight.studies.fit.compact.decompose import decompose
from twilight.studies.fit.compact.terms import GROUND_ALBEDOS, added_light, ground_light, splines_of
from twilight.studies.fit.compact.training import Skies, TrainingAir, skies_in

GRID = SkySplines(
    elevation_intervals=14, azimuth_intervals=10, angle_intervals=20, elevation_power=2.0, angle_scale_deg=0.5
)
RANKS = {"dark": (50, 24, 8, 1), "ground": (16, 10, 4, 1)}
"""Of direction, sun, wavelength and amount."""
FITTED_BY = {"name": "zones", "quality": "draft"}
"""The solver of the skies that a model is fitted to."""
GROUND_SUNS = 2
"""The light of the ground is computed for one sun in this many."""
HELD_OUT_SUNS = 12
"""Suns of the skies that a model is judged by."""


def preview_config(name: str, solver: dict[str, Any], **settings: Any) -> Config:
    """A shipped climate by a solver, seen from the ground."""
    return load({"version": 1, "climate": name, "solver": solver}, settings)


def fit_preview(name: str, progress: Progress | None = None) -> CompactSky:
    """The model of a shipped climate, with its errors against `zones` at its usual quality in its provenance.

    Suns so low that some direction is black are left out of it.
    """
    tell = progress or silent
    config = preview_config(name, FITTED_BY)
    solver_name, _, settings = config.chosen_solver
    solver = solvers.load(solver_name)
    own = climate_medium(config.climate, wavelengths_of(config))
    wavelength = own.wavelength_nm
    depth = float(np.interp(550.0, wavelength, own.optical_depth("aerosol")))
    air = TrainingAir(depth)

    def skies(albedo: float, suns: Any, directions: training.Directions, doing: Progress) -> Skies:
        medium = replace(own, ground_albedo=np.full(wavelength.size, albedo))
        return skies_in(medium, air, solver, settings, suns, directions, doing)

    dark = _lit(skies(0.0, training.SUNS_DEG, training.fine_directions, part_of(tell, 0.0, 0.4, "black ground:")))
    suns = np.array(dark.sun_elevation_deg)
    some = suns[np.unique(np.append(np.arange(0, suns.size, GROUND_SUNS), suns.size - 1))]
    black = skies(0.0, some, training.coarse_directions, part_of(tell, 0.4, 0.1, "black ground:"))
    bright = [
        added_light(black, skies(albedo, some, training.coarse_directions, part_of(tell, 0.5, 0.2, "ground:")), albedo)
        for albedo in GROUND_ALBEDOS
    ]
    fraction, light = ground_light(bright)
    ground = np.einsum("kswt,Ss->kSwt", splines_of(GRID, black, [light]), spline_matrix(some, suns))
    ozone_du = float(own.notes.get("ozone_column_du", 0.0))
    absorbed = own.optical_depth("absorption")
    of_ozone = _ozone_depth(config, absorbed, wavelength)
    model = CompactSky(
        grid=GRID,
        sun_elevation_deg=suns,
        wavelength_nm=wavelength,
        optical_depth_550nm=np.array([depth]),
        load_offset=training.LOAD_OFFSET,
        ozone_column_du=np.array([ozone_du]),
        ozone_reference_du=ozone_du,
        dark=decompose(splines_of(GRID, dark, [dark.radiance]), RANKS["dark"]),
        ground=decompose(ground, RANKS["ground"]),
        ozone=_nothing(suns.size, wavelength.size),
        returned=fraction[:, None].astype(np.float32),
        air=air_of([own], wavelength, absorbed - of_ozone, of_ozone),
    )
    usual = preview_config(name, {"name": "zones"})
    errors = errors_of(model, [_judge(usual, model, depth, part_of(tell, 0.7, 0.3, "usual quality:"))])
    return replace(model, provenance=_facts(config, usual.chosen_solver.quality, errors))


def _lit(skies: Skies) -> Skies:
    """The skies from the lowest sun on under which every direction is lit."""
    black = [i for i, light in enumerate(skies.radiance) if not (light > 0.0).all()]
    first = black[-1] + 1 if black else 0
    return replace(
        skies,
        sun_elevation_deg=np.array(skies.sun_elevation_deg[first:]),
        elevation_deg=skies.elevation_deg[first:],
        azimuth_deg=skies.azimuth_deg[first:],
        radiance=skies.radiance[first:],
    )


def _ozone_depth(config: Config, absorbed: np.ndarray, wavelength: np.ndarray) -> np.ndarray:
    """What of the gases' optical depth (W,) is ozone's."""
    climate = config.climate
    if climate.medium is not None:
        return np.zeros_like(absorbed)
    gases = climate.gases
    none = gases.model_copy(update={"ozone": gases.ozone.model_copy(update={"treatment": "none"})})
    return absorbed - climate_medium(climate.model_copy(update={"gases": none}), wavelength).optical_depth("absorption")


def _nothing(suns: int, wavelengths: int) -> TuckerTerm:
    """A sum of no terms."""
    return TuckerTerm(
        *(np.zeros(shape, np.float32) for shape in ((0,) * 4, (0, GRID.size), (0, suns), (0, wavelengths), (0, 1)))
    )


def _judge(config: Config, model: CompactSky, depth: float, tell: Progress) -> Skies:
    """Skies of a configuration over its climate's own ground, of random suns and directions."""
    solver_name, _, settings = config.chosen_solver
    medium = climate_medium(config.climate, wavelengths_of(config))
    rng = np.random.default_rng(training.HELD_OUT_SEED)
    low, high = np.sin(np.radians([0.0, 90.0]))
    first = float(model.sun_elevation_deg[0])
    day = np.degrees(np.arcsin(rng.uniform(low, high, HELD_OUT_SUNS // 3)))
    suns = np.sort(np.concatenate([rng.uniform(first, 0.0, HELD_OUT_SUNS - day.size), day]))
    chosen = {float(sun): training.random_directions(rng, float(sun)) for sun in suns}
    air = TrainingAir(depth, medium.ground_albedo)  # type: ignore[arg-type]
    return skies_in(medium, air, solvers.load(solver_name), settings, suns, chosen.__getitem__, tell)


def _facts(config: Config, judge: str, errors: tuple[Errors, ...]) -> dict[str, Any]:
    asked = {"climate": config.climate.model_dump(mode="json", exclude_none=True), "solver": FITTED_BY}
    return {
        "version": __version__,
        "hash": configuration_hash(asked),
        "climate": config.climate.name,
        "solver": "zones",
        "quality": judge,
        "errors": [
            {"sun_elevation_deg": list(e.sun_elevation_deg), "median": round(e.median, 5), "p95": round(e.p95, 5)}
            for e in errors
            if e.part == "all"
        ],
    }
