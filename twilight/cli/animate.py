"""`twilight animate`: a film of the sky."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import Sets, SolverSettings, Within, flag, option
from twilight.cli.terminal import progress_bar


@dataclass(frozen=True)
class PaceOptions:
    """Which suns a film shows, and how fast."""

    from_deg: Annotated[
        float | None,
        option("DEG", "Elevation of the sun at the beginning, in place of the scene's.", "--from"),
        Within(-90.0, 90.0),
    ] = None
    to_deg: Annotated[
        float | None,
        option("DEG", "Elevation of the sun at the end, in place of the scene's.", "--to"),
        Within(-90.0, 90.0),
    ] = None
    speed: Annotated[
        float | None,
        option("X", "Seconds of the sky in a second of the film; 1: real time. Without it 300."),
        Within(0.001, 1e6),
    ] = None
    frames: Annotated[int | None, option("N", "Number of pictures, in place of --speed."), Within(2, 100_000)] = None
    frames_per_second: Annotated[float, option("N", "Pictures in a second of the film."), Within(0.1, 240.0)] = 25.0


@dataclass(frozen=True, kw_only=True)
class FilmSettings(SolverSettings):
    """How the pictures of a film look, and any key."""

    tone: Annotated[
        str | None,
        option("NAME", "How light becomes a picture: photographic, filmic, gamma, eye or camera."),
        Sets(["output.tone_mapping"]),
    ] = None
    projection: Annotated[
        str | None, option("NAME", "Projection, as observer.view.kind."), Sets(["observer.view.kind"])
    ] = None
    width: Annotated[int | None, option("PIXELS", "Width of the pictures."), Sets(["observer.view.width"])] = None
    height: Annotated[int | None, option("PIXELS", "Height of the pictures."), Sets(["observer.view.height"])] = None
    disc: Annotated[bool, flag("--disc", "Draw the sun's disc, as sun.disc."), Sets(["sun.disc"])] = False


def animate(
    scene: Annotated[str, options.SCENE],
    output: Annotated[
        Path, option("FILE", "Ends in .mp4, .webp or .gif; without a suffix a folder of numbered EXR.", "--output")
    ],
    pace: PaceOptions,
    keys: FilmSettings,
    exposure: Annotated[
        str | None, option("constant|metered|EV", "One for all, a meter smoothed over 1 s of film, or a number.")
    ] = None,
) -> None:
    """Make a film of the sky under a moving sun, all from one field; an interrupted one continues."""
    if pace.speed is not None and pace.frames is not None:
        raise TwilightError("--frames: is not allowed with --speed, which says how many pictures there are")
    chosen, names = keys.chosen()
    how = exposure if exposure in (None, "constant", "metered") else _exposure_value(exposure)
    chosen |= _usual_view(scene, chosen)
    config = options.load_one_scene(scene, chosen, names, "animate")

    from twilight.show.film import Animation
    from twilight.show.timeline import Pace

    speed = Pace.speed if pace.speed is None else pace.speed
    frames = Pace(speed, pace.frames_per_second, pace.from_deg, pace.to_deg, pace.frames)
    film = Animation(config, output, frames, exposure=how)
    rows, columns = film.view.shape
    n = len(film.line)
    print(
        f"{n} pictures of {columns} x {rows}, {n / pace.frames_per_second:.1f} s of film, sun "
        f"{film.line.elevation_deg[0]:+.1f} to {film.line.elevation_deg[-1]:+.1f} deg",
        flush=True,
    )
    begin = time.perf_counter()
    with progress_bar() as bar:
        film_result = film.make(bar)
    there = f", {n - film_result.drawn} were there" if film_result.drawn < n else ""
    rate = (
        f", {film_result.drawn / film_result.processor_s:.1f} in a second of processor time"
        if film_result.drawn
        else ""
    )
    print(
        f"wrote {output}: {film_result.drawn} pictures drawn{rate}{there}; {time.perf_counter() - begin:.0f} s in all"
    )


def _usual_view(scene: str, chosen: dict[str, Any]) -> dict[str, Any]:
    """What completes a view of which only some keys are chosen, where the configuration has none."""
    from twilight.config import load_series
    from twilight.show.film import USUAL_VIEW

    some = {key for key in chosen if key.startswith("observer.view.")}
    rest = {key: value for key, value in chosen.items() if key not in some}
    if not some or load_series(scene, rest)[0].config.observer.view is not None:
        return {}
    kind = chosen.get("observer.view.kind", USUAL_VIEW["kind"])
    usual = USUAL_VIEW if kind == USUAL_VIEW["kind"] else {"width": USUAL_VIEW["width"]}
    return {key: value for name, value in usual.items() if (key := f"observer.view.{name}") not in chosen}


def _exposure_value(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise TwilightError(
            f"--exposure: {text} is not known, choose constant, metered or an exposure value such as 8"
        ) from None
    options.check_range(value, "--exposure", -60.0, 60.0)
    return value
