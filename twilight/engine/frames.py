"""The skies of a configuration, one for each of its suns, each with the record of what made it."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from twilight import __version__
from twilight.base.errors import TwilightError
from twilight.base.progress import PhasedProgress, Progress, silent
from twilight.config.sun import SunAt
from twilight.engine.field import Field, parts
from twilight.engine.mapped_ground import land_of
from twilight.engine.one_sun import (
    SunLight,
    equal_grid,
    interpolation_error,
    is_above_air,
    shared_grid,
    warn_of_black,
    warn_of_error,
)
from twilight.engine.problem import check_size, plan
from twilight.engine.sunbeam import Direct, join_direct, make_disc
from twilight.engine.view import (
    ViewOfLights,
    ViewRadiance,
    check_terrain,
    check_view,
    join_views,
    landscape,
    view_radiance,
    with_disc,
)
from twilight.io.provenance import configuration_hash
from twilight.io.rendered import ViewPixels, ViewSource
from twilight.numerics.spectrum import solar_irradiance
from twilight.scene.lights import SceneLights, check_stars, warn_of_the_moon
from twilight.scene.plan import Omission
from twilight.scene.scene import Scene, resolved_configuration
from twilight.scene.suns import SceneSun
from twilight.scene.usual import described, usual_horizon
from twilight.sky.lights import TIMES_BRIGHTER, Luminary, outshone
from twilight.sky.moon import MoonDisc, MoonSeen
from twilight.sky.night.glows import Glow, glow_table
from twilight.sky.night.points import StarPoints, with_points
from twilight.sky.sky import Sky
from twilight.terrain.heights import Standpoint
from twilight.transport.rays import horizon_dip_deg


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
    check_stars(config)
    suns = [sun for sun in scene.suns if wanted is None or sun.name in wanted]
    if not suns:
        return
    # ground far away has another sun than the observer
    lights = [scene.lights(sun) for sun in suns]
    if len(suns) == 1:
        warn_of_the_moon(config, lights[0])
    mapped = scene.observer.view is not None and config.climate.ground.albedo_map is not None
    known = None
    if config.terrain is None and not mapped:
        known = tuple(body.elevation_deg for one in lights for body in one.luminaries)
    if scene.observer.view is not None:
        check_view(scene.observer.view, scene.capabilities, scene.title, mapped)
        if config.terrain is not None:
            check_terrain(scene.capabilities, config.terrain, scene.altitude_km, _standpoint(suns[0]))
    todo = parts(plan(scene, known, cached=cached, numpy_only_sun=numpy_only_sun))
    set_up_s = 0.0
    results = [_Result.of(one) for one in lights]
    meter, steps, several = PhasedProgress(tell), 1 + len(suns), len(suns) > 1
    fraction = 1.0 / (len(todo) * steps)
    for b, part in enumerate(todo):
        begin = time.perf_counter()
        meter.phase("all suns" if several else "", b * steps * fraction, fraction)
        solved = part.solve(meter)
        set_up_s += time.perf_counter() - begin
        for s, sun in enumerate(suns):
            meter.phase(sun.name if several else "", (b * steps + 1 + s) * fraction, fraction)
            results[s].add(solved, sun)
            if b == len(todo) - 1:
                frame = results[s].frame(scene, sun, set_up_s)
                if scene.observer.view is None or not is_above_air(scene, scene.altitude_km):
                    without_night = "" if config.night else "add the night sky with night.airglow=1"
                    warn_of_black(scene, frame.sky, without_night, stacklevel=2)
                yield frame
                results[s] = _Result.of(lights[s])
        del solved
    tell("done", 1.0)


def _standpoint(sun: SceneSun) -> Standpoint | None:
    """Where the observer of a sun with a time and a place stands; None for a sun of an elevation alone."""
    if sun.azimuth_deg is None or not isinstance(sun.section, SunAt):
        return None
    return Standpoint(sun.section.latitude_deg, sun.section.longitude_deg, sun.azimuth_deg)


@dataclass
class _Lit:
    """What a field gives under one luminary: its sky, what a view shows, and its beam, block by block."""

    body: Luminary
    sky: SunLight | None = None
    view: list[ViewRadiance] = field(default_factory=list)
    landscape: list[ViewPixels] = field(default_factory=list)
    direct: list[Direct] = field(default_factory=list)

    def add(self, solved: Field, sun: SceneSun) -> None:
        """Add some wavelengths; sun: from whose azimuth directions count."""
        scene, config, body = solved.scene, solved.scene.configuration, self.body
        grid = equal_grid(scene)
        if grid is not None:
            grid = grid[0], np.mod(grid[1] - body.azimuth_deg, 360.0)
        self.sky = solved.gather(body.elevation_deg, grid=grid, before=self.sky)
        if scene.observer.view is not None:
            place = _standpoint(sun)
            land = None
            if place is not None:
                land = land_of(
                    scene, place._replace(sun_azimuth_deg=(place.sun_azimuth_deg + body.azimuth_deg) % 360.0)
                )
            like = self.view[-1] if self.view else None
            pixels = view_radiance(solved, scene.observer.view, body, like, land)
            if config.terrain is None:
                self.view.append(pixels)
            else:
                self.landscape.append(landscape(solved, pixels.whole(), config.terrain, body, place, land))
        self.direct.append(solved.direct(body.elevation_deg))

    @property
    def beam(self) -> Direct:
        """At all wavelengths."""
        return join_direct(self.direct)

    @property
    def seen(self) -> ViewSource:
        """What a view shows at all wavelengths."""
        return _whole(self.landscape) if self.landscape else join_views(self.view)


@dataclass
class _Result:
    """What all wavelengths give for the lights of one moment."""

    lights: SceneLights
    lit: list[_Lit]
    seconds: float = 0.0
    convergence: dict[str, Any] = field(default_factory=dict)
    facts: dict[str, float] = field(default_factory=dict)
    from_disk: bool = True

    @classmethod
    def of(cls, lights: SceneLights) -> _Result:
        """Before any wavelength."""
        return cls(lights, [_Lit(body) for body in lights.luminaries])

    def add(self, solved: Field, sun: SceneSun) -> None:
        """Evaluate some wavelengths."""
        begin = time.perf_counter()
        for one in self.lit:
            one.add(solved, sun)
        for block in solved.blocks:
            self.from_disk &= block.from_disk
            self.facts.update(block.field.facts)
            converged = block.field.convergence
            if converged is not None:  # the worst block of wavelengths
                for key, here in vars(converged).items():
                    if here is not None:
                        self.convergence[key] = max(self.convergence.get(key, here), here)
        self.seconds += time.perf_counter() - begin

    def frame(self, scene: Scene, sun: SceneSun, set_up_s: float) -> Frame:
        """The sum of the lights."""
        config, sunlit = scene.configuration, self.lit[0]
        assert sunlit.sky is not None
        grid = equal_grid(scene) or shared_grid(
            [(one.sky.table, one.body.azimuth_deg) for one in self.lit if one.sky is not None]
        )
        solar = solar_irradiance(scene.medium.wavelength_nm, config.solar_spectrum)
        disc = None
        if config.sun.disc:
            disc = make_disc(scene.medium, self.lit[0].body, scene.altitude_km, scene.bands)
        place = sun.section if isinstance(sun.section, SunAt) else None
        sky = sunlit.sky.sky(
            scene.medium,
            grid,
            sunlit.beam,
            sun.elevation_deg,
            scene.altitude_km,
            sun_azimuth_deg=sun.azimuth_deg,
            distance_au=sun.distance_au,
            latitude_deg=place.latitude_deg if place else None,
            longitude_deg=place.longitude_deg if place else None,
            time=sun.time,
            solar_spectrum=config.solar_spectrum,
            disc=disc,
            moon=self._moon(scene, solar),
        )
        glows, faint = self._glows(scene, sky)
        parts = {glow.name: _on_grid(glow, scene, self.lights, sky) for glow in glows}
        for one in self.lit[1:]:
            assert one.sky is not None
            by_body = one.sky.on_grid(grid, one.body.azimuth_deg)[0][..., 0, :]
            parts[one.body.name] = by_body * (one.body.irradiance_factor(sky.wavelength_nm) * solar)
        left_out = (*scene.omissions, *self.lights.left_out, *faint)
        record = self._provenance(scene, sun, left_out, set_up_s)
        error = interpolation_error(sunlit.sky, sky)
        if error is not None:
            record["interpolation_error"], record["largest_interpolation_error"] = error
        sky = replace(sky, lights=parts, provenance=record)
        warn_of_error(error, sky, stacklevel=3)
        return Frame(sun.name, sky, None if scene.observer.view is None else self._view(scene, sky, glows))

    def _glows(self, scene: Scene, sky: Sky) -> tuple[list[Glow], list[Omission]]:
        """The glows, and those that are left out, beside sunlight on a grid."""
        shown, faint = [], []
        for glow in self.lights.glows:
            if scene.configuration.omit_negligible and outshone(glow.brightest, sky.radiance).all():
                faint.append(
                    Omission(glow.name, "sunlight is far brighter in every direction", f"{1 / TIMES_BRIGHTER:g}")
                )
            else:
                shown.append(glow)
        return shown, faint

    def _moon(self, scene: Scene, solar: np.ndarray) -> MoonSeen | None:
        """The moon with its beam and its disc."""
        moon = self.lights.moon
        if moon is None:
            return None
        beam, apparent, disc = np.zeros_like(solar), moon.elevation_deg, None
        if moon.shines:
            apparent += self.lit[1].beam.bending_deg
            path = make_disc(scene.medium, moon, scene.altitude_km, scene.bands)
            if path.is_seen:
                disc = MoonDisc.of(path, moon, self.lit[0].body.elevation_deg)
                beam = disc.irradiance_factor() * solar
        return MoonSeen(moon, apparent, beam, disc)

    def _view(self, scene: Scene, sky: Sky, glows: list[Glow]) -> ViewSource:
        view, solar, lights = scene.observer.view, sky.solar_irradiance, self.lights
        assert view is not None
        over_sun = [one.body.irradiance_factor(sky.wavelength_nm) * sky.distance_au**2 for one in self.lit]
        lit = [(one.seen, factor) for one, factor in zip(self.lit, over_sun, strict=True)]
        glow, stars, config = None, None, scene.configuration
        if config.night is not None:
            shown = {one.name for one in glows}
            every, points = lights.glows, None
            if lights.place is not None and config.night.stars is not False:
                every, points = with_points(every)
            seen = [one for one in every if one.name in shown]
            table = glow_table(seen, lights.moment, scene.medium, scene.altitude_km)
            glow = ViewRadiance(view, replace(table, smooth=table.smooth / solar), lit[0][0].pitch_deg)
            if points is not None and lights.place is not None:
                up = points.over(lights.place)
                azimuth = up.azimuth_deg - lights.moment.zero_deg
                stars = StarPoints(azimuth, up.elevation_deg, up.irradiance / solar)
        discs: list[Callable[[ViewPixels], ViewPixels]] = []
        if sky.moon is not None and sky.moon.disc is not None:
            azimuth_deg = sky.moon.moon.azimuth_deg
            discs.append(partial(with_disc, disc=sky.moon.disc, azimuth_deg=azimuth_deg, scale=sky.distance_au**2))
        sun = self.lit[0]
        disc = sky.disc or make_disc(scene.medium, sun.body, scene.altitude_km, scene.bands)
        if disc.is_seen:
            discs.append(partial(with_disc, disc=disc, azimuth_deg=0.0, scale=1.0))
        picture = ViewOfLights(tuple(lit), glow, stars, tuple(discs))
        return picture.whole() if sun.landscape else picture

    def _provenance(self, scene: Scene, sun: SceneSun, left_out: Sequence[Omission], set_up_s: float) -> dict[str, Any]:
        """What made a sky, as JSON values."""
        configuration = resolved_configuration(scene.configuration, sun.section)
        solver, quality, _ = scene.configuration.chosen_solver
        record: dict[str, Any] = {
            "version": __version__,
            "configuration": configuration,
            "hash": configuration_hash(configuration),
            "run_time_s": set_up_s + self.seconds,
            "set_up_time_s": set_up_s,
            "solver": solver,
            "quality": quality,
            "left_out": [f"{item.part}: {item.effect}" for item in left_out],
            "horizon": described(usual_horizon(scene.configuration)),
        }
        if "ozone_source" in scene.medium.notes:
            record["ozone"] = "{ozone_column_du:.0f} DU, {ozone_source}".format(**scene.medium.notes)
        if self.from_disk:
            record["field_from_disk"] = True  # its run time leaves out solving it
        if self.convergence:
            record["convergence"] = self.convergence
        if self.facts:
            record["model"] = self.facts
        return record


def _on_grid(glow: Glow, scene: Scene, lights: SceneLights, sky: Sky) -> np.ndarray:
    """A glow on the grid of a sky: rows below the horizontal as at 0 deg down to the horizon, dark below it."""
    rows = sky.elevation_deg
    radiance = glow.on_grid(lights.moment, np.maximum(rows, 0.0), sky.azimuth_deg)
    if rows[0] < 0.0:
        radiance[rows < -horizon_dip_deg(scene.medium, scene.altitude_km)] = 0.0
    return radiance


def _whole(parts: list[ViewPixels]) -> ViewPixels:
    """A picture at the wavelengths of all blocks."""
    return replace(parts[0], radiance=np.concatenate([one.radiance for one in parts], axis=-1))
