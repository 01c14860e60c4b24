"""The skies of a configuration, one for each of its suns, each with the record of what made it."""

from __future__ import annotations

import time
import warnings
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from twilight import __version__
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.progress import PhasedProgress, Progress, silent
from twilight.config.sun import SunAt
from twilight.engine.answer import Answer, join, make_sky
from twilight.engine.block import Block
from twilight.engine.columns import disc_of, mean_of
from twilight.engine.directions import texture_rows
from twilight.engine.memory import check_size
from twilight.engine.moon import moon_light, warn_of_the_moon, with_moon
from twilight.engine.night import NightLight, check_stars, levels_of, night_light, place_of, star_sky, without_points
from twilight.engine.solve import Problem
from twilight.engine.sunbeam import Direct
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
from twilight.numerics.grids import latlong_grid, texture_centres
from twilight.numerics.spectrum import solar_irradiance
from twilight.scene.moons import moon_of
from twilight.scene.record import resolved_configuration
from twilight.scene.scene import Scene
from twilight.scene.suns import SceneSun
from twilight.sky.moon import Moon
from twilight.sky.night import night_radiance
from twilight.sky.sky import Sky
from twilight.terrain.heights import Standpoint
from twilight.transport.apparent_rays import horizon_dip_deg


@dataclass(frozen=True)
class Frame:
    """One sky of a sequence: a name for its folder, the sky, its latitude-longitude picture and its view where asked
    for."""

    name: str
    sky: Sky
    panorama: Sky | None = None
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
    check_stars(config)
    suns = [sun for sun in scene.suns if wanted is None or sun.name in wanted]
    if not suns:
        return
    # ground far away has another sun than the observer
    moons = [moon_of(config, sun) for sun in suns]
    if len(moons) == 1 and moons[0] is not None:
        warn_of_the_moon(config, moons[0])
    known = None if config.terrain is not None else tuple(sun.elevation_deg for sun in suns)
    if known is not None:
        known += tuple(moon.elevation_deg for moon in moons if moon is not None and moon.shines)
    if scene.observer.view is not None:
        check_view(scene.observer.view, scene.capabilities, scene.title)
        if config.terrain is not None:
            check_terrain(scene.capabilities, config.terrain, scene.altitude_km, _standpoint(suns[0]))
    problem = Problem(scene, known, cached, numpy_only_sun)
    set_up_s = 0.0
    found = [_SunResult(moon) for moon in moons]
    meter, steps, several = PhasedProgress(tell), 1 + len(suns), len(suns) > 1
    fraction = 1.0 / (len(problem.slices) * steps)
    for b in range(len(problem.slices)):
        begin = time.perf_counter()
        meter.phase("all suns" if several else "", b * steps * fraction, fraction)
        block = problem.block(b, meter)
        set_up_s += time.perf_counter() - begin
        for s, sun in enumerate(suns):
            meter.phase(sun.name if several else "", (b * steps + 1 + s) * fraction, fraction)
            found[s].take(block, sun)
            if b == len(problem.slices) - 1:
                frame = _frame(scene, sun, found[s], set_up_s)
                _warn_of_black(scene, frame.sky)
                yield frame
                found[s] = _SunResult(None)
        del block
    tell("done", 1.0)


def _warn_of_black(scene: Scene, sky: Sky) -> None:
    if sky.normalised_radiance.any() or scene.observer.view is not None:
        return
    config = scene.configuration
    top_km = config.climate.atmosphere.top_km
    if config.climate.medium is None and scene.altitude_km >= top_km:
        why = f"an observer at {scene.altitude_km:g} km is above the air, which ends at {top_km:g} km, and looks up"
        ask = "take a lower observer.altitude_km"
    elif config.night is None:
        why = f"no sunlight reaches it with the sun at {sky.sun_elevation_deg:g} deg"
        ask = "add the night sky with night.airglow=1"
    else:
        why, ask = "there is no light in this air", "see the climate"
    warnings.warn(f"the sky is black in every direction: {why}; {ask}", TwilightWarning, stacklevel=3)


def _standpoint(sun: SceneSun) -> Standpoint | None:
    """Where the observer of a sun with a time and a place stands; None for a sun of an elevation alone."""
    if sun.azimuth_deg is None or not isinstance(sun.section, SunAt):
        return None
    return Standpoint(sun.section.latitude_deg, sun.section.longitude_deg, sun.azimuth_deg)


@dataclass
class _SunResult:
    """What the blocks give for one sun: on the texture, in the panorama's own directions, of the sun itself.

    by_moon: the same under the moon of that moment, where the moon stands high enough to light the air.
    """

    moon: Moon | None
    by_moon: _SunResult | None = None
    texture: list[Answer] = field(default_factory=list)
    panorama: list[Answer] = field(default_factory=list)
    view: list[ViewRadiance] = field(default_factory=list)
    landscape: list[ViewPixels] = field(default_factory=list)
    direct: list[Direct] = field(default_factory=list)
    seconds: float = 0.0
    convergence: dict[str, Any] = field(default_factory=dict)
    facts: dict[str, float] = field(default_factory=dict)
    from_disk: bool = True

    def take(self, block: Block, sun: SceneSun) -> None:
        """Evaluate a block under the sun."""
        begin = time.perf_counter()
        self._evaluate(block, sun)
        if self.moon is not None and self.moon.shines:
            self.by_moon = self.by_moon or _SunResult(None)
            azimuth = None if sun.azimuth_deg is None else (sun.azimuth_deg + self.moon.azimuth_deg) % 360.0
            moon = replace(sun, elevation_deg=self.moon.elevation_deg, azimuth_deg=azimuth)
            self.by_moon._evaluate(block, moon, self.moon.azimuth_deg, _standpoint(sun))
        self.from_disk &= block.from_disk
        for _, column in block.columns:
            self.facts.update(column.field.facts)
            converged = column.field.convergence
            if converged is not None:  # the worst block of wavelengths
                for key, here in vars(converged).items():
                    if here is not None:
                        self.convergence[key] = max(self.convergence.get(key, here), here)
        self.seconds += time.perf_counter() - begin

    def _evaluate(
        self, block: Block, sun: SceneSun, away_deg: float = 0.0, standpoint: Standpoint | None = None
    ) -> None:
        """Evaluate a block under a light, away_deg from the azimuth from which directions and standpoint count."""
        config = block.scene.configuration
        elevation, azimuth = _grid(block.scene)
        self.texture.append(block.texture(sun.elevation_deg, elevation, np.mod(azimuth - away_deg, 360.0)))
        if block.scene.observer.view is not None:
            seen = view_radiance(block, block.scene.observer.view, sun.elevation_deg, away_deg)
            if config.terrain is None:
                self.view.append(seen)
            else:
                where = config.terrain, sun.elevation_deg, standpoint or _standpoint(sun), away_deg
                self.landscape.append(landscape(block, seen.whole(), *where))
        if config.texture.latlong_width is not None:
            own = None if sun.azimuth_deg is None else sun.azimuth_deg - away_deg
            rows, columns = latlong_grid(config.texture.latlong_width, own)
            self.panorama.append(block.texture(sun.elevation_deg, rows, np.mod(columns - away_deg, 360.0)))
        self.direct.append(block.direct(sun.elevation_deg))


def _frame(scene: Scene, sun: SceneSun, found: _SunResult, set_up_s: float) -> Frame:
    config = scene.configuration
    direct = Direct(np.concatenate([one.irradiance for one in found.direct]), found.direct[-1].bending_deg)
    place = sun.section if isinstance(sun.section, SunAt) else None
    moon = None
    if found.moon is not None:
        seen_by_moon = None if found.by_moon is None else found.by_moon.direct
        moon = moon_light(scene, found.moon, seen_by_moon, sun.elevation_deg, sun.distance_au)
    about: dict[str, Any] = {
        "sun_azimuth_deg": sun.azimuth_deg,
        "distance_au": sun.distance_au,
        "latitude_deg": place.latitude_deg if place else None,
        "longitude_deg": place.longitude_deg if place else None,
        "time": sun.time,
        "solar_spectrum": config.solar_spectrum,
        "disc": disc_of(scene, sun.elevation_deg, sun.distance_au) if config.sun.disc else None,
        "moon": None if moon is None else moon.seen,
        "provenance": _provenance(scene, sun, found, set_up_s),
    }

    def sky(answers: list[Answer], by_moon: list[Answer], grid: tuple[np.ndarray, np.ndarray]) -> Sky:
        night = _night(scene, sun, *grid)
        if moon is not None and by_moon:
            moonlight = join(by_moon).radiance * moon.irradiance
            night = moonlight if night is None else night + moonlight
        return make_sky(
            scene.medium,
            grid,
            join(answers),
            direct,
            sun.elevation_deg,
            scene.altitude_km,
            night_radiance=night,
            **about,
        )

    width = config.texture.latlong_width
    by_moon = found.by_moon or _SunResult(None)
    panorama = None if width is None else sky(found.panorama, by_moon.panorama, latlong_grid(width, sun.azimuth_deg))
    night = _night_of_view(scene, sun)
    moonlit = None if moon is None or not by_moon.view else (join_views(by_moon.view, None), moon)
    view: ViewSource | None = replace(join_views(found.view, direct), night=night, moon=moonlit) if found.view else None
    if found.landscape:
        seen = _whole(found.landscape)
        seen = seen if night is None else with_night(seen, night)
        if moon is not None and by_moon.landscape:
            seen = with_moon(seen, _whole(by_moon.landscape).radiance, moon)
        view = with_sun(seen, direct, sun.elevation_deg)
    return Frame(sun.name, sky(found.texture, by_moon.texture, _grid(scene)), panorama, view)


def _whole(parts: list[ViewPixels]) -> ViewPixels:
    """A picture at the wavelengths of all blocks."""
    return replace(parts[0], radiance=np.concatenate([one.radiance for one in parts], axis=-1))


def _grid(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    return texture_rows(scene), texture_centres(scene.configuration.texture.shape)[1]


def _provenance(scene: Scene, sun: SceneSun, found: _SunResult, set_up_s: float) -> dict[str, Any]:
    """What made a sky, as JSON values."""
    configuration = resolved_configuration(scene.configuration, sun.section)
    solver, quality, _ = scene.configuration.chosen_solver
    record: dict[str, Any] = {
        "version": __version__,
        "configuration": configuration,
        "hash": configuration_hash(configuration),
        "run_time_s": set_up_s + found.seconds,
        "set_up_time_s": set_up_s,
        "solver": solver,
        "quality": quality,
        "left_out": [item.part for item in scene.omissions],
    }
    if found.from_disk:
        record["field_from_disk"] = True  # its run time leaves out solving it
    if found.convergence:
        record["convergence"] = found.convergence
    if found.facts:
        record["model"] = found.facts
    return record


def _night(scene: Scene, sun: SceneSun, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> np.ndarray | None:
    """Radiance of the night sky (E, A, W) where the configuration asks for it.

    Rows below the horizontal are as at 0 deg down to the horizon, and dark below it.
    """
    night = scene.configuration.night
    if night is None:
        return None
    rows = np.maximum(elevation_deg, 0.0)
    where: dict[str, Any] = {
        "sun_elevation_deg": sun.elevation_deg,
        "sun_azimuth_deg": sun.azimuth_deg,
        "place": place_of(sun),
        "observer_altitude_km": scene.altitude_km,
    }
    found = mean_of(scene.columns, lambda one: night_radiance(one.medium, rows, azimuth_deg, levels_of(night), **where))
    if elevation_deg[0] < 0.0:
        found[elevation_deg < -horizon_dip_deg(scene.medium, scene.altitude_km)] = 0.0
    return found


def _night_of_view(scene: Scene, sun: SceneSun) -> NightLight | None:
    """The night in a view, over the sun's irradiance above the air [sr^-1]."""
    config = scene.configuration
    if config.night is None or scene.observer.view is None:
        return None
    if scene.between is not None:
        return _mean_night([(fraction, _night_of_view(one, sun)) for fraction, one in scene.columns])
    place, altitude = place_of(sun), scene.altitude_km
    points = None if place is None else star_sky(config.night, scene.medium, altitude)
    levels = levels_of(config.night)
    made = night_light(
        scene.medium,
        levels if points is None else without_points(levels),
        altitude,
        sun_elevation_deg=sun.elevation_deg,
        sun_azimuth_deg=sun.azimuth_deg,
        place=place,
    )
    if points is not None and place is not None:
        made = replace(made, stars=points.over(place), sun_azimuth_deg=sun.azimuth_deg or 0.0)
    return made.over(solar_irradiance(scene.medium.wavelength_nm, config.solar_spectrum, sun.distance_au))


def _mean_night(columns: list[tuple[float, NightLight | None]]) -> NightLight | None:
    """The night of a sky from those of its columns, whose stars are the same."""
    found = [(fraction, night) for fraction, night in columns if night is not None]
    if not found:
        return None
    first = found[0][1]
    stars = first.stars
    if stars is not None:
        stars = replace(stars, irradiance=mean_of(found, lambda one: one.stars.irradiance))
    radiance, ground = mean_of(found, lambda one: one.radiance), mean_of(found, lambda one: one.ground)
    return replace(first, radiance=radiance, ground=ground, stars=stars)
