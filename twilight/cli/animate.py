"""`twilight animate`: a film of the sky."""

import time
from pathlib import Path
from typing import Annotated, Any

from twilight.base.errors import TwilightError
from twilight.cli import options
from twilight.cli.options import flag, option
from twilight.cli.terminal import progress_bar


def animate(
    scene: Annotated[str, options.SCENE],
    output: Annotated[
        Path, option("FILE", "Ends in .mp4, .webp or .gif; without a suffix a folder of numbered EXR.", "--output")
    ],
    from_deg: Annotated[
        float | None, option("DEG", "Elevation of the sun at the beginning, in place of the scene's.", "--from")
    ] = None,
    to_deg: Annotated[
        float | None, option("DEG", "Elevation of the sun at the end, in place of the scene's.", "--to")
    ] = None,
    speed: Annotated[
        float | None, option("X", "Seconds of the sky in a second of the film; 1: real time. Without it 300.")
    ] = None,
    frames: Annotated[int | None, option("N", "Number of pictures, in place of --speed.")] = None,
    frames_per_second: Annotated[float, option("N", "Pictures in a second of the film.")] = 25.0,
    exposure: Annotated[
        str | None, option("constant|metered|EV", "One for all, a meter smoothed over 1 s of film, or a number.")
    ] = None,
    tone: Annotated[
        str | None, option("NAME", "How light becomes a picture: photographic, filmic, gamma, eye or camera.")
    ] = None,
    projection: Annotated[str | None, option("NAME", "Projection, as observer.view.kind.")] = None,
    width: Annotated[int | None, option("PIXELS", "Width of the pictures.")] = None,
    height: Annotated[int | None, option("PIXELS", "Height of the pictures.")] = None,
    disc: Annotated[bool, flag("--disc", "Draw the sun's disc, as sun.disc.")] = False,
    quality: Annotated[str | None, options.QUALITY] = None,
    settings: Annotated[list[str] | None, options.SETTINGS] = None,
) -> None:
    """Make a film of the sky under a moving sun, all from one field; an interrupted one continues."""
    options.check_range(speed, "--speed", 0.001, 1e6)
    options.check_range(frames, "--frames", 2, 100_000)
    if speed is not None and frames is not None:
        raise TwilightError("--frames: is not allowed with --speed, which says how many pictures there are")
    options.check_range(frames_per_second, "--frames-per-second", 0.1, 240.0)
    options.check_range(from_deg, "--from", -90.0, 90.0)
    options.check_range(to_deg, "--to", -90.0, 90.0)
    chosen, names = options.settings_of(settings)
    given: options.Given = {
        "observer.view.kind": (projection, "--projection"),
        "observer.view.width": (width, "--width"),
        "observer.view.height": (height, "--height"),
        "solver.quality": (quality, "--quality"),
        "sun.disc": (disc or None, "--disc"),
        "output.tone_mapping": (tone, "--tone"),
    }
    options.put_options(chosen, names, given)
    how = exposure if exposure in (None, "constant", "metered") else _exposure_value(exposure)
    chosen |= _usual_view(scene, chosen)
    config = options.load_one_scene(scene, chosen, names, "animate")

    from twilight.show.film import Animation
    from twilight.show.timeline import Pace

    pace = Pace(Pace.speed if speed is None else speed, frames_per_second, from_deg, to_deg, frames)
    film = Animation(config, output, pace, exposure=how)
    rows, columns = film.view.shape
    n = len(film.line)
    print(
        f"{n} pictures of {columns} x {rows}, {n / frames_per_second:.1f} s of film, sun "
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
