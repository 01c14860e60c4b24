"""The skies of a configuration, one for each of its suns, each with the record of what made it."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from twilight import __version__
from twilight.base.errors import TwilightError
from twilight.base.progress import PhasedProgress, Progress, silent
from twilight.config.sun import SunAt
from twilight.engine import night as nights
from twilight.engine.field import Field, parts
from twilight.engine.mapped_ground import land_of
from twilight.engine.one_sun import SunLight, equal_grid, is_above_air, merged_grids, warn_of_black, warn_of_error
from twilight.engine.problem import check_size, plan
from twilight.engine.sunbeam import Direct, join_direct, make_disc
from twilight.engine.view import (
    ViewRadiance,
    check_terrain,
    check_view,
    join_views,
    landscape,
    view_radiance,
    with_night,
    with_sun,
)
from twilight.io.provenance import configuration_hash
from twilight.io.rendered import ViewPixels, ViewSource
from twilight.scene.scene import Scene, SceneSun, moon_of, resolved_configuration
from twilight.sky.moon import Moon
from twilight.sky.sky import Sky
from twilight.sky.table import plain_grid
from twilight.terrain.heights import Standpoint


@dataclass(frozen=True)
class Frame:
    """One sky of a sequence: a name for its folder, the sky, and its view where asked for."""

    name: str
    sky: Sky
    view: ViewSource | None = None


def run(scene: Scene, progress: Progress | None = None, *, numpy_only_sun: bool = False) -> Sky:
    """The sky of a scene with one sun; arguments as of `frames`.

    Errors: TwilightError for a scene with several suns, and for whatever in it cannot be computed.
    """
    count = len(scene.suns)
    if count > 1:
        raise TwilightError(f"sun: the configuration has {count} suns; frames gives them one by one")
    return next(iter(frames(scene, progress, numpy_only_sun=numpy_only_sun))).sky


def frames(
    scene: Scene,
    progress: Progress | None = None,
    *,
    wanted: Collection[str] | None = None,
    cached: bool = True,
    numpy_only_sun: bool = False,
) -> Iterator[Frame]:
    """The skies of a scene, one for each sun; what does not depend on the sun is computed once for all.

    As long as the solver takes all wavelengths at once a frame is given as soon as it is done.

    progress: called as progress(doing, fraction) now and then; wanted: names of the suns whose skies are computed,
    None: all; cached, numpy_only_sun: as of `Problem`.  Warns of a black sky.
    """
    tell, config = progress or silent, scene.configuration
    tell("setting up", 0.0)
    check_size(config)
    nights.check_stars(config)
    suns = [sun for sun in scene.suns if wanted is None or sun.name in wanted]
    if not suns:
        return
    # ground far away has another sun than the observer
    moons = [moon_of(config, sun) for sun in suns]
    if len(moons) == 1 and moons[0] is not None:
        nights.warn_of_the_moon(config, moons[0])
    mapped = scene.observer.view is not None and config.climate.ground.albedo_map is not None
    known = None if config.terrain is not None or mapped else tuple(sun.elevation_deg for sun in suns)
    if known is not None:
        known += tuple(moon.elevation_deg for moon in moons if moon is not None and moon.shines)
    if scene.observer.view is not None:
        check_view(scene.observer.view, scene.capabilities, scene.title, mapped)
        if config.terrain is not None:
            check_terrain(scene.capabilities, config.terrain, scene.altitude_km, _standpoint(suns[0]))
    todo = parts(plan(scene, known, cached=cached, numpy_only_sun=numpy_only_sun))
    set_up_s = 0.0
    frame_results = [_SunResult(moon) for moon in moons]
    meter, steps, several = PhasedProgress(tell), 1 + len(suns), len(suns) > 1
    fraction = 1.0 / (len(todo) * steps)
    for b, part in enumerate(todo):
        begin = time.perf_counter()
        meter.phase("all suns" if several else "", b * steps * fraction, fraction)
        solved = part.solve(meter)
        set_up_s += time.perf_counter() - begin
        for s, sun in enumerate(suns):
            meter.phase(sun.name if several else "", (b * steps + 1 + s) * fraction, fraction)
            frame_results[s].take(solved, sun)
            if b == len(todo) - 1:
                frame = _frame(scene, sun, frame_results[s], set_up_s)
                if scene.observer.view is None or not is_above_air(scene, scene.altitude_km):
                    without_night = "" if config.night else "add the night sky with night.airglow=1"
                    warn_of_black(scene, frame.sky, without_night, stacklevel=2)
                yield frame
                frame_results[s] = _SunResult(None)
        del solved
    tell("done", 1.0)


def _standpoint(sun: SceneSun) -> Standpoint | None:
    """Where the observer of a sun with a time and a place stands; None for a sun of an elevation alone."""
    if sun.azimuth_deg is None or not isinstance(sun.section, SunAt):
        return None
    return Standpoint(sun.section.latitude_deg, sun.section.longitude_deg, sun.azimuth_deg)


@dataclass
class _SunResult:
    """What all wavelengths give for one sun: its sky, what a view shows, and the sun itself.

    by_moon: the same under the moon of that moment, where the moon stands high enough to light the air.
    """

    moon: Moon | None
    by_moon: _SunResult | None = None
    light: SunLight | None = None
    view: list[ViewRadiance] = field(default_factory=list)
    landscape: list[ViewPixels] = field(default_factory=list)
    direct: list[Direct] = field(default_factory=list)
    seconds: float = 0.0
    convergence: dict[str, Any] = field(default_factory=dict)
    facts: dict[str, float] = field(default_factory=dict)
    from_disk: bool = True

    def take(self, solved: Field, sun: SceneSun) -> None:
        """Evaluate some wavelengths under the sun."""
        begin = time.perf_counter()
        self._evaluate(solved, sun)
        if self.moon is not None and self.moon.shines:
            self.by_moon = self.by_moon or _SunResult(None)
            azimuth = None if sun.azimuth_deg is None else (sun.azimuth_deg + self.moon.azimuth_deg) % 360.0
            moon = replace(sun, elevation_deg=self.moon.elevation_deg, azimuth_deg=azimuth)
            self.by_moon._evaluate(solved, moon, self.moon.azimuth_deg, _standpoint(sun))
        for block in solved.blocks:
            self.from_disk &= block.from_disk
            self.facts.update(block.field.facts)
            converged = block.field.convergence
            if converged is not None:  # the worst block of wavelengths
                for key, here in vars(converged).items():
                    if here is not None:
                        self.convergence[key] = max(self.convergence.get(key, here), here)
        self.seconds += time.perf_counter() - begin

    def _evaluate(
        self, solved: Field, sun: SceneSun, away_deg: float = 0.0, standpoint: Standpoint | None = None
    ) -> None:
        """Evaluate some wavelengths under a light, away_deg from the azimuth from which directions and standpoint
        count."""
        scene, config = solved.scene, solved.scene.configuration
        grid = equal_grid(scene)
        if grid is not None:
            grid = grid[0], np.mod(grid[1] - away_deg, 360.0)
        self.light = solved.gather(sun.elevation_deg, grid=grid, before=self.light)
        if scene.observer.view is not None:
            like = self.view[-1] if self.view else None
            land = land_of(scene, _standpoint(sun))
            pixels = view_radiance(solved, scene.observer.view, sun.elevation_deg, away_deg, like, land)
            if config.terrain is None:
                self.view.append(pixels)
            else:
                where = config.terrain, sun.elevation_deg, standpoint or _standpoint(sun), away_deg
                self.landscape.append(landscape(solved, pixels.whole(), *where, land))
        self.direct.append(solved.direct(sun.elevation_deg))


def _frame(scene: Scene, sun: SceneSun, result: _SunResult, set_up_s: float) -> Frame:
    config, light = scene.configuration, result.light
    assert light is not None
    direct = join_direct(result.direct)
    disc = None
    if config.sun.disc:
        disc = make_disc(scene.medium, sun.elevation_deg, scene.altitude_km, sun.distance_au, scene.bands)
    place = sun.section if isinstance(sun.section, SunAt) else None
    by_moon = result.by_moon
    moon = None
    if result.moon is not None:
        seen_by_moon = None if by_moon is None else by_moon.direct
        moon = nights.moon_light(scene, result.moon, seen_by_moon, sun.elevation_deg, sun.distance_au)
    grid = equal_grid(scene)
    if grid is None:
        grid = plain_grid(light.table)
        if by_moon is not None and by_moon.light is not None and result.moon is not None:
            grid = merged_grids(grid, plain_grid(by_moon.light.table), result.moon.azimuth_deg)
    night = nights.night_on_grid(scene, sun, *grid)
    if moon is not None and by_moon is not None and by_moon.light is not None and result.moon is not None:
        moonlight = by_moon.light.on(grid, result.moon.azimuth_deg).radiance * moon.irradiance
        night = moonlight if night is None else night + moonlight
    sky = light.sky(
        scene.medium,
        grid,
        direct,
        sun.elevation_deg,
        scene.altitude_km,
        night_radiance=night,
        sun_azimuth_deg=sun.azimuth_deg,
        distance_au=sun.distance_au,
        latitude_deg=place.latitude_deg if place else None,
        longitude_deg=place.longitude_deg if place else None,
        time=sun.time,
        solar_spectrum=config.solar_spectrum,
        disc=disc,
        moon=None if moon is None else moon.seen,
        provenance=_provenance(scene, sun, result, set_up_s),
    )
    warn_of_error(light, sky, stacklevel=3)
    night_in_view = nights.night_of_view(scene, sun)
    moonlit = None
    if moon is not None and by_moon is not None and by_moon.view:
        moonlit = (join_views(by_moon.view, None), moon)
    view: ViewSource | None = None
    if result.view:
        view = replace(join_views(result.view, direct), night=night_in_view, moon=moonlit)
    if result.landscape:
        pixels = _whole(result.landscape)
        pixels = pixels if night_in_view is None else with_night(pixels, night_in_view)
        if moon is not None and by_moon is not None and by_moon.landscape:
            pixels = nights.with_moon(pixels, _whole(by_moon.landscape).radiance, moon)
        view = with_sun(pixels, direct, sun.elevation_deg)
    return Frame(sun.name, sky, view)


def _whole(parts: list[ViewPixels]) -> ViewPixels:
    """A picture at the wavelengths of all blocks."""
    return replace(parts[0], radiance=np.concatenate([one.radiance for one in parts], axis=-1))


def _provenance(scene: Scene, sun: SceneSun, result: _SunResult, set_up_s: float) -> dict[str, Any]:
    """What made a sky, as JSON values."""
    configuration = resolved_configuration(scene.configuration, sun.section)
    solver, quality, _ = scene.configuration.chosen_solver
    record: dict[str, Any] = {
        "version": __version__,
        "configuration": configuration,
        "hash": configuration_hash(configuration),
        "run_time_s": set_up_s + result.seconds,
        "set_up_time_s": set_up_s,
        "solver": solver,
        "quality": quality,
        "left_out": [item.part for item in scene.omissions],
    }
    if result.from_disk:
        record["field_from_disk"] = True  # its run time leaves out solving it
    if result.convergence:
        record["convergence"] = result.convergence
    if result.light is not None and result.light.tables:
        record["interpolation_error"] = max(table.error for table in result.light.tables)
        record["largest_interpolation_error"] = max(table.worst for table in result.light.tables)
    if result.facts:
        record["model"] = result.facts
    return record
