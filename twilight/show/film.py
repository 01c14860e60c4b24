"""From a configuration to a film: one field, its tables, exposures of all pictures, the pictures, the encoder."""

import shutil
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from twilight import solvers
from twilight.base.digest import code_digest, content_digest
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.base.reading import stored_arrays
from twilight.base.whole_files import check_file, check_folder, whole_file
from twilight.config.pictures import View
from twilight.config.scene import Config
from twilight.engine import solve
from twilight.engine.sun_tables import COLUMN_COUNT, ROW_COUNT, SunTables, suns_between
from twilight.engine.table import shared_columns, shared_rows
from twilight.io.journal import locked
from twilight.io.picture import to_bytes
from twilight.io.provenance import configuration_hash
from twilight.numerics.directions import azimuth_elevation
from twilight.numerics.projections import PROJECTIONS
from twilight.scene import Scene, resolve
from twilight.scene.lights import check_stars
from twilight.show.draw import Painter, horizon_of
from twilight.show.encode import check_output, encode, write_exr
from twilight.show.lights import (
    DiscPainter,
    FilmGlows,
    GlowPainter,
    MoonColours,
    glows_of_film,
    moons_of,
    sky_elevations,
    sunbeam,
)
from twilight.show.skies import check_altitudes
from twilight.show.timeline import FilmTimeline, Pace, meter, smoothed, timeline
from twilight.show.tones import Channels
from twilight.sky.lights import Sun
from twilight.sky.moon import Moon
from twilight.sky.table import SkyTable
from twilight.sky.tone import Shot, Tone, adapt, tone_of

METERED_PIXELS = 96
"""Width at which pictures are metered before any is drawn."""
USUAL_VIEW: dict[str, Any] = {"kind": "perspective", "width": 640, "elevation_deg": 12.0}
"""Where the configuration has no observer.view."""


@dataclass(frozen=True)
class FrameExposure:
    """How one picture is developed: exposure value at ISO 100; what an eye is adapted to [cd m^-2], None: no eye."""

    ev100: float
    adapted: float | None


@dataclass(frozen=True)
class FilmResult:
    """How many pictures were drawn, without those of an interrupted run, and the processor time of drawing [s]."""

    drawn: int
    processor_s: float


@dataclass(frozen=True)
class FilmParts:
    """What pictures are made of; None where a film has no such part."""

    table: SkyTable
    glows: FilmGlows | None
    moon: MoonColours | None
    disc: DiscPainter | None


class SkyPainter:
    """Draws directions (elevation, azimuth) (H, W) [deg]: sunlight, moonlight and the night's light."""

    def __init__(self, parts: FilmParts, directions: tuple[np.ndarray, np.ndarray]):
        self.directions, self._moon = directions, parts.moon
        self._air = Painter(parts.table, *directions)
        self._glows = None if parts.glows is None else GlowPainter(parts.glows, *directions)
        self.outside = self._air.outside

    def light(self, time_s: float, sun: tuple[float, float, float], moon: Moon | None) -> np.ndarray:
        """Channels of the film's tone [cd m^-2], (H, W, 4), without discs; sun: as `Painter.light`."""
        light = self._air.light(*sun)
        if moon is not None and self._moon is not None and moon.shines:
            light += self._moon.moonlit(self._air.light(moon.elevation_deg, sun[1] + moon.azimuth_deg), moon)
        return light if self._glows is None else light + self._glows.light(time_s)


class Animation:
    """A film that can be made: all its suns are known and everything is checked, nothing is computed.

    output: .mp4, .webp, .gif, or without a suffix a folder of numbered EXR.  exposure: `constant`, `metered`, or
    an exposure value at ISO 100; None: output.exposure_ev100, else `metered`.  output.tone_mapping is the tone.
    nodes: rows of the sky and columns of the table.
    Errors: TwilightError for whatever cannot be shown.
    """

    def __init__(
        self,
        config: Config,
        output: Path,
        pace: Pace,
        *,
        exposure: str | float | None = None,
        nodes: tuple[int, int] = (ROW_COUNT, COLUMN_COUNT),
        scene: Scene | None = None,
    ):
        self.config, self.output, self.frames_per_second = config, output, pace.frames_per_second
        self.view = config.observer.view or View(**USUAL_VIEW)
        self.exposure = _exposure(config, exposure)
        _check_layers(config)
        check_stars(config)
        if exposure is not None and not output.suffix:
            raise TwilightError("--exposure: EXR hold luminances, which have no exposure; leave it out")
        check_output(output, self.view.shape, pace.frames_per_second)
        self.line: FilmTimeline = timeline(config, pace)
        self.moons = moons_of(config, self.line)
        lit_from = [*self.line.elevation_deg, *(moon.elevation_deg for moon in self.moons or () if moon.shines)]
        self._lit_deg = min(lit_from), max(lit_from)
        self.suns_deg = suns_between(*self._lit_deg)
        self._cached = scene is None
        self.scene = scene = resolve(config) if scene is None else scene
        check_altitudes(scene, None, config.title)
        self._rows_deg = shared_rows(scene, scene.altitude_km, nodes[0], ground=True)
        self._columns_deg = shared_columns(nodes[1])
        if output.suffix:
            check_file(output)
        else:
            check_folder(output.parent)
        self.folder = output.with_name(f"{output.name}.frames")

    def make(self, progress: Progress | None = None) -> FilmResult:
        """Make the film; pictures of an interrupted run are taken as they are.

        What is done stays in the folder OUTPUT.frames until the film is whole.
        """
        tell = progress or silent
        self.folder.mkdir(parents=True, exist_ok=True)
        with locked(self.folder / "lock", "another film"):
            try:
                drawn, processor_s = self._make(tell)
            except BaseException:
                if [path.name for path in self.folder.iterdir()] == ["lock"]:
                    shutil.rmtree(self.folder)
                raise
        shutil.rmtree(self.folder)
        return FilmResult(drawn, processor_s)

    def _make(self, tell: Progress) -> tuple[int, float]:
        """How many pictures were drawn, and the processor time [s] of it."""
        drawn, processor_s = 0, 0.0
        parts = self._parts(part_of(tell, 0.0, 0.4))
        painter = SkyPainter(parts, self._directions(self.view))
        exposures_of_frames = self._exposures(parts, part_of(tell, 0.4, 0.1))
        paths, fraction = [], part_of(tell, 0.5, 0.4)
        for i, exposure_of_frame in enumerate(exposures_of_frames):
            facts = self._facts(i, exposure_of_frame)
            path = self.folder / f"{configuration_hash(facts)[:32]}{'.png' if self.output.suffix else '.exr'}"
            if not path.is_file():
                begin = time.process_time()
                self._draw(painter, parts, i, exposure_of_frame, path, facts)
                processor_s += time.process_time() - begin
                drawn += 1
            paths.append(path)
            fraction(f"picture {i + 1} of {len(exposures_of_frames)}", (i + 1) / len(exposures_of_frames))
        encode(paths, self.output, self.frames_per_second, part_of(tell, 0.9, 0.1))
        return drawn, processor_s

    def _parts(self, progress: Progress) -> FilmParts:
        """The field's tables, discs, moon and nights where they are asked for; from the folder where it has them."""
        path = self.folder / f"tables-{self._scene[:32]}.npz"
        arrays = stored_arrays(path)
        channels = Channels(self.scene.medium.wavelength_nm, self.config.solar_spectrum, self._measures)
        if arrays is None:
            tell = part_of(progress, 0.0, 0.5, "field")
            solved = solve(self.scene, self.suns_deg.tolist(), tell, cached=self._cached)
            altitude = self.scene.altitude_km
            tables = SunTables(solved, altitude, rows_deg=self._rows_deg, columns_deg=self._columns_deg)
            spectra = tables.between(*self._lit_deg, part_of(progress, 0.5, 0.5, "tables"))
            table = spectra.seen(channels.of)
            arrays = {f"table_{name}": value for name, value in table.arrays().items()}
            if self.moons is not None:
                arrays["moon"] = MoonColours.of(spectra.light_at_nodes()[::2, ::2, ::2], channels).matrices
            if self.config.sun.disc or self.moons is not None:
                nodes = sky_elevations(horizon_of(table))
                arrays["refraction_deg"], arrays["beam"] = sunbeam(solved, channels, altitude, nodes)
            with whole_file(path) as temporary:
                np.savez(temporary, allow_pickle=False, **arrays)
        held = {name.removeprefix("table_"): value for name, value in arrays.items() if name.startswith("table_")}
        table = SkyTable.of_arrays(held)
        glows = glows_of_film(self.config, self.scene.medium, channels, self.line)
        moon = MoonColours(arrays["moon"]) if "moon" in arrays else None
        disc = None
        if "beam" in arrays:
            disc = DiscPainter(arrays["refraction_deg"], arrays["beam"], horizon_of(table), moon)
        return FilmParts(table, glows, moon, disc)

    @cached_property
    def _scene(self) -> str:
        """A hash of all that the tables depend on."""
        name, _, settings = self.config.chosen_solver
        return configuration_hash(
            {
                "code": code_digest("twilight.show.film", solvers.SOLVERS[name]),
                "medium": content_digest(self.scene.medium),
                "settings": repr(settings),
                "altitude_km": self.scene.altitude_km,
                "suns_deg": self.suns_deg.tolist(),
                "nodes": [self._rows_deg.tolist(), self._columns_deg.tolist()],
                "solar_spectrum": self.config.solar_spectrum,
                "disc": self.config.sun.disc,
                "moon": self.moons is not None,
                "night": self._night_depends_on,
                "channels": repr(self._measures),
            }
        )

    @property
    def _night_depends_on(self) -> list[Any] | None:
        config, line = self.config, self.line
        if config.night is None:
            return None
        ends = [[float(v[0]), float(v[-1])] for v in (line.time_s, line.elevation_deg, line.azimuth_deg)]
        return [config.night.model_dump(mode="json"), config.sun.model_dump(mode="json"), ends]

    def _directions(self, view: View) -> tuple[np.ndarray, np.ndarray]:
        """Elevation and azimuth [deg] of the pixels; a view's azimuth is from the sun's halfway through the film."""
        turned = view.model_copy(update={"azimuth_deg": view.azimuth_deg + self._middle_deg})
        azimuth, elevation = azimuth_elevation(turned.rays())
        return elevation, azimuth

    @property
    def _middle_deg(self) -> float:
        return float(self.line.azimuth_deg[0] + self.line.azimuth_deg[-1]) / 2.0

    def _exposures(self, parts: FilmParts, progress: Progress) -> list[FrameExposure]:
        """The exposure of every picture, from small ones of all."""
        n, output = len(self.line), self.config.output
        if not self.output.suffix:
            return [FrameExposure(0.0, None)] * n
        if isinstance(self.exposure, float) and output.tone_mapping != "eye":
            return [FrameExposure(self.exposure, None)] * n
        painter = SkyPainter(parts, self._directions(_smaller(self.view)))
        exposures = np.empty((n, 2))
        for i in range(n):
            light = painter.light(float(self.line.time_s[i]), self._sun(i), self._moon(i))
            exposures[i] = meter(light, self._measures.highlights_over_mean)
            progress(f"metering {i + 1} of {n}", (i + 1) / n)
        metered, mean = exposures.T
        if self.exposure == "constant":
            return [FrameExposure(float(np.median(metered)), None)] * n
        ev = smoothed(metered, self.frames_per_second)
        if output.tone_mapping != "eye":
            return [FrameExposure(float(v), None) for v in ev]
        fixed = output.eye.adapted_cd_per_m2
        adapted = adapt(self.line.time_s, mean) if fixed is None else np.full(n, fixed)
        return [FrameExposure(float(v), float(a)) for v, a in zip(ev, adapted, strict=True)]

    def _sun(self, i: int) -> tuple[float, float, float]:
        line = self.line
        return float(line.elevation_deg[i]), float(line.azimuth_deg[i]), float(line.distance_au[i])

    def _moon(self, i: int) -> Moon | None:
        return None if self.moons is None else self.moons[i]

    def _facts(self, i: int, exposure_of_frame: FrameExposure) -> dict[str, Any]:
        """What a picture depends on."""
        elevation, azimuth, distance = self._sun(i)
        return {
            "scene": self._scene,
            "view": self.view.model_dump(mode="json"),
            "middle_azimuth_deg": self._middle_deg,
            "sun_elevation_deg": elevation,
            "sun_azimuth_deg": azimuth,
            "distance_au": distance,
            "moon": repr(self._moon(i)),
            "time_s": float(self.line.time_s[i]),
            "tone": repr(self._tone(exposure_of_frame)),
            "exposure_ev100": exposure_of_frame.ev100,
            "number": i,
        }

    def _draw(
        self,
        painter: SkyPainter,
        parts: FilmParts,
        i: int,
        exposure_of_frame: FrameExposure,
        path: Path,
        facts: dict[str, Any],
    ) -> None:
        pixel_deg = (self.view.field_of_view_deg or PROJECTIONS[self.view.kind].field_deg) / self.view.width
        sun, moon = self._sun(i), self._moon(i)
        light = painter.light(float(self.line.time_s[i]), sun, moon)
        bodies = [Sun(sun[0], 0.0, sun[2])] if self.config.sun.disc else []
        for body in (*bodies, *([] if moon is None else [moon])):
            assert parts.disc is not None
            elevation, azimuth = painter.directions
            light += parts.disc.light(elevation, azimuth - sun[1], pixel_deg, body, sun[0])
        if path.suffix == ".exr":
            header = {"twilightSunElevationDeg": facts["sun_elevation_deg"], "twilightScene": facts["scene"]}
            write_exr(light, ~painter.outside, path, header)
            return
        from PIL import Image  # start-up

        picture, _ = self._tone(exposure_of_frame).develop(light, Shot(exposure_of_frame.ev100, pixel_deg, i))
        pixels = to_bytes(picture)
        pixels[painter.outside] = 0
        with whole_file(path) as temporary:
            Image.fromarray(pixels).save(temporary, format="PNG", compress_level=1)

    @cached_property
    def _measures(self) -> Tone:
        """The tone whose channels the tables hold: X, Y, Z and scotopic luminance for all but a camera's pictures."""
        output = self.config.output
        if output.tone_mapping == "camera" and self.output.suffix:
            return tone_of("camera", output.colour_observer, {"camera": output.camera.model_dump()})
        return tone_of("eye", output.colour_observer)

    def _tone(self, exposure_of_frame: FrameExposure) -> Tone:
        """The tone of one picture."""
        output = self.config.output
        settings = {"eye": output.eye.model_dump(), "camera": output.camera.model_dump()}
        if exposure_of_frame.adapted is not None:
            settings["eye"]["adapted_cd_per_m2"] = exposure_of_frame.adapted
        return tone_of(output.tone_mapping, output.colour_observer, settings)


def _smaller(view: View) -> View:
    """The same view in few pixels."""
    height, width = view.shape
    if width <= METERED_PIXELS:
        return view
    size = {"width": METERED_PIXELS, "height": max(1, round(METERED_PIXELS * height / width))}
    return view.model_copy(update=size if PROJECTIONS[view.kind].free else {"width": METERED_PIXELS, "height": None})


def _exposure(config: Config, exposure: str | float | None) -> str | float:
    output = config.output
    if exposure is None:
        return "metered" if output.exposure_ev100 is None else float(output.exposure_ev100)
    given = exposure if isinstance(exposure, str) else f"{exposure:g}"
    if output.tone_mapping == "eye":
        raise TwilightError(f"--exposure: {given} is not allowed with the tone eye, which sees by itself")
    if output.tone_mapping == "camera" and output.camera.seconds is not None:
        raise TwilightError(f"--exposure: {given} is not allowed with output.camera.seconds, which says it already")
    return exposure


def _check_layers(config: Config) -> None:
    """Raise TwilightError for what a configuration asks for and a film cannot show."""
    for name, value in (("terrain", config.terrain), ("output.polariser_deg", config.output.polariser_deg)):
        if value is not None:
            raise TwilightError(f"{config.title}: {name} is not drawn in films; leave it out")
