"""From a configuration to a film: one field, its tables, exposures of all pictures, the pictures, the encoder."""

from __future__ import annotations

import hashlib
import math
import shutil
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from twilight import colour, solvers
from twilight.animation.disc import Disc
from twilight.animation.draw import Painter, suns_between
from twilight.animation.encode import check_output, encode, write_exr
from twilight.animation.exposure import meter, smoothed
from twilight.animation.night import NightPainter, Nights, nights_of
from twilight.animation.timeline import Timeline, timeline
from twilight.config.scene import Config
from twilight.config.solver import resolve_solver
from twilight.config.view import View
from twilight.digest import code_digest
from twilight.engine import Problem, problem_of
from twilight.engine.kept import kept_fields
from twilight.engine.night import check_stars
from twilight.errors import TwilightError
from twilight.export.values import Source
from twilight.io.eight_bit import to_bytes
from twilight.io.journal import open_journal
from twilight.io.provenance import configuration_hash
from twilight.io.view import burnt_out
from twilight.io.whole import check_file, check_folder, whole_file
from twilight.orientation import azimuth_elevation
from twilight.progress import Progress, part_of, silent
from twilight.reading import stored_arrays
from twilight.tone import Shot
from twilight.tone.eye import Eye, adapt
from twilight.views import KINDS
from twilight.window import check_altitudes, lines
from twilight.window.colours import Channels
from twilight.window.tables import Sizes, Tables, fill

METERED_PIXELS = 96
"""Width at which pictures are metered before any is drawn."""
USUAL_VIEW: dict[str, Any] = {"kind": "perspective", "width": 640, "elevation_deg": 12.0}
"""Where the configuration has no observer.view."""
SPEED, FRAMES_PER_SECOND = 300.0, 25.0


@dataclass(frozen=True)
class Look:
    """How one picture is developed: exposure value at ISO 100, what an eye is adapted to [cd m^-2] (None: no eye)."""

    ev100: float
    adapted: float | None


@dataclass(frozen=True)
class Made:
    """How many pictures were drawn, those that were there left out, and the processor time of that [s]."""

    drawn: int
    processor_s: float


class Lights:
    """Draws directions (elevation, azimuth) (H, W) [deg]: sunlight, and the night's light where there is one."""

    def __init__(
        self,
        tables: Tables,
        nights: Nights | None,
        sizes: Sizes,
        suns_deg: np.ndarray,
        directions: tuple[np.ndarray, np.ndarray],
    ):
        self.directions = directions
        self._sunlight = Painter(tables, sizes, suns_deg, *directions)
        self._night = None if nights is None else NightPainter(nights, *directions)
        self.outside = self._sunlight.outside

    def light(self, time_s: float, *sun: float) -> np.ndarray:
        """X, Y, Z and scotopic luminance [cd m^-2], (H, W, 4), without the disc; sun: as `Painter.light`."""
        light = self._sunlight.light(*sun)
        return light if self._night is None else light + self._night.light(time_s)


class Film:
    """A film that can be made: all its suns are known and everything is checked, nothing is computed.

    output: .mp4, .webp, .gif, or without a suffix a folder of numbered EXR.  exposure: `constant`, `camera`, `eye`, or
    an exposure value at ISO 100; None: as output.tone_mapping and output.exposure_ev100 have it, else `camera`.
    speed, from_deg, to_deg: as `timeline`.  Errors: TwilightError for whatever cannot be shown.
    """

    def __init__(
        self,
        config: Config,
        output: Path,
        *,
        speed: float = SPEED,
        frames_per_second: float = FRAMES_PER_SECOND,
        exposure: str | float | None = None,
        from_deg: float | None = None,
        to_deg: float | None = None,
        sizes: Sizes | None = None,
        problem: Problem | None = None,
    ):
        self.config, self.output, self.frames_per_second = config, output, frames_per_second
        self.sizes = sizes or Sizes()
        self.view = config.observer.view or View(**USUAL_VIEW)
        self.exposure = _exposure(config, exposure)
        _check_layers(config)
        check_stars(config)
        if exposure is not None and not output.suffix:
            raise TwilightError("--exposure: EXR hold luminances, which have no exposure; leave it out")
        check_output(output, self.view.shape, frames_per_second)
        self.line: Timeline = timeline(
            config, speed=speed, frames_per_second=frames_per_second, from_deg=from_deg, to_deg=to_deg
        )
        self.suns_deg = suns_between(self.line.elevation_deg.min(), self.line.elevation_deg.max(), self.sizes)
        if problem is None:
            problem = problem_of(config, tuple(float(s) for s in self.suns_deg), kept=kept_fields())
        self.problem = problem
        check_altitudes(self.problem, None, config.title)
        if output.suffix:
            check_file(output)
        else:
            check_folder(output.parent)
        self.folder = output.with_name(f"{output.name}.frames")

    def make(self, progress: Progress | None = None) -> Made:
        """Make the film; pictures of an interrupted run are taken as they are.

        What is done is kept in the folder OUTPUT.frames until the film is whole.
        """
        tell = progress or silent
        self.folder.mkdir(parents=True, exist_ok=True)
        drawn, processor_s = 0, 0.0
        with open_journal(self.folder / "film.jsonl", "another film") as journal:
            tables, disc, nights = self._tables(part_of(tell, 0.0, 0.4))
            painter = Lights(tables, nights, self.sizes, self.suns_deg, self._directions(self.view))
            looks = self._looks(tables, nights, part_of(tell, 0.4, 0.1))
            paths, share = [], part_of(tell, 0.5, 0.4)
            for i, look in enumerate(looks):
                facts = self._facts(i, look)
                path = self.folder / f"{configuration_hash(facts)[:32]}{'.png' if self.output.suffix else '.exr'}"
                if not path.is_file():
                    begin = time.process_time()
                    self._draw(painter, disc, i, look, path, facts)
                    processor_s += time.process_time() - begin
                    journal.write({"picture": i, "file": path.name, **facts})
                    drawn += 1
                paths.append(path)
                share(f"picture {i + 1} of {len(looks)}", (i + 1) / len(looks))
            encode(paths, self.output, self.frames_per_second, part_of(tell, 0.9, 0.1))
        shutil.rmtree(self.folder)
        return Made(drawn, processor_s)

    def _tables(self, progress: Progress) -> tuple[Tables, Disc | None, Nights | None]:
        """The field's tables, the disc and the nights where they are asked for; from the folder where it has them."""
        path = self.folder / f"tables-{self._scene[:32]}.npz"
        kept = stored_arrays(path)
        if kept is None:
            solved = self.problem.solve(part_of(progress, 0.0, 0.5, "field"))
            channels = Channels(solved.medium.wavelength_nm, self.config.solar_spectrum)
            source = Source(solved, solved.medium, bool(getattr(self.problem.settings, "refraction", False)))
            altitude, share = self.problem.altitude_km, part_of(progress, 0.5, 0.5, "tables")
            made = fill(source, channels, (altitude,), self.sizes, share, self.suns_deg)
            kept = {"sky": made.sky, "horizon": made.horizon_deg, "haze": made.haze_deg}
            if made.aureole is not None and made.phase is not None:
                kept |= {"aureole": made.aureole, "phase": made.phase}
            if self.config.sun.disc:
                nodes = lines.sky_elevations(float(made.horizon_deg[0]))
                kept["lifted"], kept["beam"] = lines.sunbeam(solved, channels, altitude, nodes)
            nights = nights_of(self.config, solved.medium, channels, self.line)
            if nights is not None:
                kept |= nights.arrays()
            with whole_file(path) as temporary:
                np.savez(temporary, allow_pickle=False, **kept)
        tables = Tables(kept["sky"], kept.get("aureole"), np.empty(0), kept.get("phase"), kept["horizon"], kept["haze"])
        disc = Disc(kept["lifted"], kept["beam"], float(kept["horizon"][0])) if "beam" in kept else None
        return tables, disc, Nights.from_arrays(kept) if "night_time_s" in kept else None

    @cached_property
    def _scene(self) -> str:
        """A hash of all that the tables depend on."""
        name, _, settings = resolve_solver(self.config.solver)
        medium = self.problem.medium
        content = hashlib.sha256()
        for value in (v for k, v in sorted(vars(medium).items()) if isinstance(v, np.ndarray)):
            content.update(np.ascontiguousarray(value).tobytes())
        cosine = np.cos(np.linspace(0.0, math.pi, 181))
        for phase in medium.phase_functions:
            content.update(np.ascontiguousarray(phase(cosine)).tobytes())
        return configuration_hash(
            {
                "code": code_digest("twilight.animation.film", solvers.SOLVERS[name]),
                "medium": content.hexdigest(),
                "settings": repr(settings),
                "altitude_km": self.problem.altitude_km,
                "suns_deg": self.suns_deg.tolist(),
                "sizes": vars(self.sizes),
                "solar_spectrum": self.config.solar_spectrum,
                "disc": self.config.sun.disc,
                "night": self._night_depends_on,
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

    def _looks(self, tables: Tables, nights: Nights | None, progress: Progress) -> list[Look]:
        """The exposure of every picture, from small ones of all."""
        n, output = len(self.line), self.config.output
        if not self.output.suffix or isinstance(self.exposure, float):
            return [Look(self.exposure if isinstance(self.exposure, float) else 0.0, None)] * n
        small = _smaller(self.view)
        painter = Lights(tables, nights, self.sizes, self.suns_deg, self._directions(small))
        found = np.empty((n, 2))
        for i in range(n):
            found[i] = meter(painter.light(float(self.line.time_s[i]), *self._sun(i)))
            progress(f"metering {i + 1} of {n}", (i + 1) / n)
        metered, mean = found.T
        if self.exposure == "constant":
            return [Look(float(np.median(metered)), None)] * n
        ev = smoothed(metered, self.frames_per_second)
        if self.exposure == "camera":
            return [Look(float(v), None) for v in ev]
        fixed = output.eye.adapted_cd_per_m2
        adapted = adapt(self.line.time_s, mean) if fixed is None else np.full(n, fixed)
        return [Look(float(v), float(a)) for v, a in zip(ev, adapted, strict=True)]

    def _sun(self, i: int) -> tuple[float, float, float]:
        line = self.line
        return float(line.elevation_deg[i]), float(line.azimuth_deg[i]), float(line.distance_au[i])

    def _facts(self, i: int, look: Look) -> dict[str, Any]:
        """What a picture depends on."""
        elevation, azimuth, distance = self._sun(i)
        return {
            "scene": self._scene,
            "view": self.view.model_dump(mode="json"),
            "middle_azimuth_deg": self._middle_deg,
            "sun_elevation_deg": elevation,
            "sun_azimuth_deg": azimuth,
            "distance_au": distance,
            "time_s": float(self.line.time_s[i]),
            "tone_mapping": self.config.output.tone_mapping,
            "exposure_ev100": look.ev100,
            "adapted_cd_per_m2": look.adapted,
            "acuity": self.config.output.eye.acuity,
        }

    def _draw(self, painter: Lights, disc: Disc | None, i: int, look: Look, path: Path, facts: dict[str, Any]) -> None:
        pixel_deg = _pixel_deg(self.view)
        light, share = painter.light(float(self.line.time_s[i]), *self._sun(i)), None
        if disc is not None:
            more, share = disc.light(*painter.directions, pixel_deg, *self._sun(i))
            light += more
        if path.suffix == ".exr":
            header = {"twilightSunElevationDeg": facts["sun_elevation_deg"], "twilightScene": facts["scene"]}
            write_exr(light, ~painter.outside, path, header)
            return
        from PIL import Image

        pixels = to_bytes(self._developed(light, share, look, pixel_deg))
        pixels[painter.outside] = 0
        with whole_file(path) as temporary:
            Image.fromarray(pixels).save(temporary, format="PNG", compress_level=1)

    def _developed(self, light: np.ndarray, share: np.ndarray | None, look: Look, pixel_deg: float) -> np.ndarray:
        if look.adapted is not None:
            eye = Eye(adapted_cd_per_m2=look.adapted, acuity=self.config.output.eye.acuity)
            picture, _ = eye.develop(light, Shot(look.ev100, pixel_deg))
        else:
            linear = colour.xyz_to_linear_rgb(light[..., :3])
            picture = colour.tone_map(linear, look.ev100, self.config.output.tone_mapping)
        return picture if share is None else burnt_out(picture, share, light[..., 1], look.ev100)


def _pixel_deg(view: View) -> float:
    return (view.field_of_view_deg or KINDS[view.kind].field_deg) / view.width


def _smaller(view: View) -> View:
    """The same view in few pixels."""
    height, width = view.shape
    if width <= METERED_PIXELS:
        return view
    size = {"width": METERED_PIXELS, "height": max(1, round(METERED_PIXELS * height / width))}
    return view.model_copy(update=size if KINDS[view.kind].free else {"width": METERED_PIXELS, "height": None})


def _exposure(config: Config, exposure: str | float | None) -> str | float:
    eye = config.output.tone_mapping == "eye"
    if exposure is None:
        fixed = config.output.exposure_ev100
        return "eye" if eye else "camera" if fixed is None else float(fixed)
    if eye and exposure != "eye":
        raise TwilightError(f"--exposure: {exposure} is not allowed with output.tone_mapping eye, which sees by itself")
    return exposure


def _check_layers(config: Config) -> None:
    """Raise TwilightError for what a configuration asks for and a film cannot show."""
    output = config.output
    for name, there in (
        ("terrain", config.terrain is not None),
        ("output.polariser_deg", output.polariser_deg is not None),
        ("output.tone_mapping: camera", output.tone_mapping == "camera"),
        ("output.colour_observer: cie1931_2deg", output.colour_observer != colour.DEFAULT_OBSERVER),
    ):
        if there:
            raise TwilightError(f"{config.title}: {name} is not drawn in films; leave it out")
