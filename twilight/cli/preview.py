"""A preview by the model of all clear air, where the sky itself takes longer.

`sky.preview.png` says what it is in its corner and in its text chunks; it is removed when `sky.png` is written, or when
the render ends without it.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twilight.base.errors import TwilightError
from twilight.cli import terminal

if TYPE_CHECKING:
    from twilight.config.scene import Config
    from twilight.sky.sky import Sky

PREVIEW = "sky.preview.png"
COMPILING_S = 30.0
"""Processor seconds that compiling takes, about (benchmarks/results/cold_start.csv)."""
LONG_S = 8.0
"""Processor seconds of a sky from which on it has a preview though nothing is compiled."""
PATIENCE_S = 30.0
"""Processor seconds from which on it is said before how long a sky takes, and why."""
THICK_DEPTH = 1.0
"""Optical depth of scattering from which on thick air is a reason."""
MANY_LEVELS = 150
"""Levels of the air from which on they are a reason."""


@dataclass(frozen=True)
class Preview:
    """The sky of the model; error: of 95 % of its directions, as the model estimates it."""

    sky: Sky
    climate: str
    error: float

    @property
    def sentence(self) -> str:
        """What it is, and how wrong."""
        from twilight.clear_air.model import NUMBER  # start-up: numpy

        return (
            f"model {NUMBER} of clear air in place of {self.climate}, by its own estimate within "
            f"{100 * self.error:.2g} % in 95 % of the directions"
        )


def preview_of(config: Config, sun: str) -> Preview | None:
    """The preview of one sun of a configuration; None where the model lacks its air, sun or observer."""
    if not _has_one(config):
        return None
    from twilight.scene.usual import usual_horizon  # start-up

    observer = config.observer.model_copy(update={"view": None})
    solver = {"name": "compact", "quality": "standard", "polarisation": False}
    beyond = usual_horizon(config)
    like = config.model_copy(update={"solver": solver, "observer": observer, "wavelengths": None, "horizon": beyond})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what the sky itself will say
        try:
            sky = _sky(like, sun)
        except TwilightError:
            return None
    return Preview(sky, config.climate.name, float(sky.provenance["convergence"]["error"]))


def _has_one(config: Config) -> bool:
    """Whether a model shows what the configuration asks for: its sky of light scattered several times, as a picture."""
    from twilight import solvers  # start-up

    o, (name, _, settings) = config.output, config.chosen_solver
    able = solvers.load(name).CAPABILITIES
    pictures = "png" in (o.files or (() if config.observer.view is not None else ("png",)))
    return (
        able.kind == "transport" and getattr(settings, "max_orders", None) != 1 and pictures and o.polariser_deg is None
    )


def _sky(config: Config, sun: str) -> Sky:
    from twilight.engine.frames import frames  # start-up
    from twilight.scene import resolve  # start-up

    return next(iter(frames(resolve(config), wanted={sun}, cached=False, numpy_only_sun=True))).sky


def _cost(config: Config) -> tuple[float | None, str]:
    """Processor seconds of the skies of a configuration, about, and what makes them many; None: not known."""
    from twilight.engine.problem import full_cost  # start-up
    from twilight.scene import resolve  # start-up

    scene = resolve(config, for_plan=True)
    sizes, air = full_cost(scene), scene.medium
    depth = float(max(air.optical_depth("air") + air.optical_depth("aerosol")))
    why = [f"{scene.solver_name} at {config.chosen_solver.quality or 'settings of its own'}"]
    why += [f"{sizes.suns} suns"] if sizes.suns > 1 else []
    why += [f"{sizes.blocks} groups of wavelengths with grids of their own"] if sizes.blocks > 1 else []
    why += [f"air of optical depth {depth:.2g}"] if depth > THICK_DEPTH else []
    why += [f"air of {air.altitude_km.size} levels"] if air.altitude_km.size > MANY_LEVELS else []
    return sizes.cpu_s, ", ".join(why)


def _why_long(seconds: float | None, why: str) -> str | None:
    """How long skies take, and why; None: no longer than anybody waits for."""
    if seconds is None or seconds <= PATIENCE_S:
        return None
    return f"this takes about {terminal.time_of(seconds)} of processor time: {why}"


@contextmanager
def say_if_long(config: Config, *_: object) -> Iterator[None]:
    """Say how long the skies of a configuration take and why, where that is long, before they are computed."""
    _tell(_why_long(*_cost(config)))
    yield


def _tell(sentence: str | None) -> None:
    if sentence is not None:
        print(f"twilight: {sentence}", file=sys.stderr, flush=True)


@contextmanager
def show_preview(config: Config, sun: str, folder: Path) -> Iterator[None]:
    """Write the preview of a sky into its folder where it has one, say so, and take it away at the end."""
    path = folder / PREVIEW
    seconds, why = _cost(config)
    _tell(_why_long(seconds, why))
    wait_s = (seconds or 0.0) + (COMPILING_S if terminal.compiling else 0.0)
    preview = preview_of(config, sun) if wait_s > LONG_S else None
    try:
        if preview is not None:
            folder.mkdir(parents=True, exist_ok=True)
            draw(preview, config.output, path)
            _tell(
                f"{path} is a preview: {preview.sentence}; the sky itself follows in about {wait_s:.0f} s of "
                "processor time"
            )
        yield
    finally:
        path.unlink(missing_ok=True)


def draw(preview: Preview, output: Any, path: Path) -> None:
    """Write the picture of a preview, with the settings of `output`."""
    from twilight.io.picture import develop_view, label_of, save_png  # start-up
    from twilight.sky.tone import tone_of  # start-up

    tone = tone_of(
        output.tone_mapping,
        output.colour_observer,
        {name: getattr(output, name).model_dump() for name in ("eye", "camera")},
    )
    exposure: Any = "auto" if output.exposure_ev100 is None else output.exposure_ev100
    picture, ev100, _ = develop_view(preview.sky, tone, view=output.views[0], exposure=exposure)
    facts = {"preview": preview.sentence, "view": output.views[0], "exposure_ev100": ev100}
    label = f"PREVIEW, within {100 * preview.error:.2g} %   {label_of(preview.sky)}"
    save_png(picture, path, preview.sky, facts, label)
