"""A picture at once where the sky itself takes longer: from a small fitted model of the shipped climate.

It is the file `sky.preview.png` beside those of the sky, says in its corner and in its text chunks what it is, and goes
when `sky.png` is written, or when the render ends without it.
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
MODELS = Path(__file__).resolve().parents[1] / "data" / "preview"
"""Folder of the models, by name of their climate (benchmarks/ship_previews.py)."""
COMPILING_S = 30.0
"""Processor seconds that compiling takes, about (benchmarks/cold_start.csv)."""
LONG_S = 8.0
"""Processor seconds of a sky from which on it has a preview though nothing is compiled."""


@dataclass(frozen=True)
class Preview:
    """The sky of a model; error: of 95 % of its directions against `quality` of the solver zones; shipped_air: whether
    it is that of the climate as it comes with the program, and the configuration's is another."""

    sky: Sky
    climate: str
    quality: str
    error: float
    shipped_air: bool

    @property
    def sentence(self) -> str:
        """What it is, and how wrong."""
        air = " as it is shipped, without what is changed here" if self.shipped_air else ""
        return (
            f"a fitted model of {self.climate}{air}, in 95 % of the directions within {100 * self.error:.2g} % of "
            f"what zones gives at quality {self.quality}"
        )


def preview_of(config: Config, sun: str) -> Preview | None:
    """The preview of one sun of a configuration; None where there is no model of its climate or for its observer."""
    path = MODELS / f"{config.climate.name}.npz"
    if not path.is_file() or not _has_one(config):
        return None
    from twilight.config.load import load_climate  # start-up
    from twilight.solvers.compact.compact_sky import CompactSky  # start-up

    facts = CompactSky.load(path).provenance
    solver = {"name": "compact", "quality": "standard", "model": str(path)}
    observer = config.observer.model_copy(update={"view": None})
    like = config.model_copy(update={"solver": solver, "observer": observer, "wavelengths": None})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what the sky itself will say
        for climate in (config.climate, load_climate(config.climate.name)):
            try:
                sky = _sky(like.model_copy(update={"climate": climate}), sun)
            except TwilightError:
                continue
            error = error_of(facts["errors"], sky.sun_elevation_deg)
            return Preview(sky, config.climate.name, facts["quality"], error, climate is not config.climate)
    return None


def error_of(errors: list[dict[str, Any]], sun_elevation_deg: float) -> float:
    """The 95 % figure of the narrowest range of suns that holds this one, as the model's file has them."""
    inside = [e for e in errors if e["sun_elevation_deg"][0] <= sun_elevation_deg <= e["sun_elevation_deg"][1]]
    around = min(inside, key=lambda e: e["sun_elevation_deg"][1] - e["sun_elevation_deg"][0])
    return float(around["p95"])


def _has_one(config: Config) -> bool:
    """Whether a model shows what the configuration asks for: its sky of light scattered several times, as a picture."""
    from twilight import solvers  # start-up

    o, (name, _, settings) = config.output, config.chosen_solver
    able = solvers.load(name).CAPABILITIES
    pictures = "png" in (o.files or (() if config.observer.view is not None else ("png",)))
    if config.horizon.screen is not None:
        return False
    exact = able.below_horizon and not able.formula and not able.numpy_only
    return exact and getattr(settings, "max_orders", None) != 1 and pictures and o.polariser_deg is None


def _sky(config: Config, sun: str) -> Sky:
    from twilight.engine.frames import frames  # start-up
    from twilight.scene import resolve  # start-up

    return next(iter(frames(resolve(config, mixed=True), wanted={sun}, keep=False, numpy_only_sun=True))).sky


def wait_s(config: Config, compiles: bool) -> float | None:
    """Processor seconds until the sky of a configuration is there, about, where they are worth a preview; else None."""
    from twilight.engine.memory import full_cost  # start-up
    from twilight.scene import resolve  # start-up

    seconds = full_cost(resolve(config, for_plan=True, mixed=True)).cpu_s
    if compiles:
        return COMPILING_S + (seconds or 0.0)
    return seconds if seconds is not None and seconds > LONG_S else None


@contextmanager
def shown(config: Config, sun: str, folder: Path) -> Iterator[None]:
    """Write the preview of a sky into its folder where it has one, say so, and take it away at the end."""
    path = folder / PREVIEW
    seconds = wait_s(config, terminal.compiling)
    made = None if seconds is None else preview_of(config, sun)
    try:
        if made is not None:
            folder.mkdir(parents=True, exist_ok=True)
            draw(made, config.output, path)
            print(
                f"twilight: {path} is a preview: {made.sentence}; the sky itself follows in about {seconds:.0f} s of "
                "processor time",
                file=sys.stderr,
                flush=True,
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
    facts = {"preview": preview.sentence, "view": output.views[0], "exposure_ev100": f"{ev100:.6g}"}
    label = f"PREVIEW, within {100 * preview.error:.2g} %   {label_of(preview.sky)}"
    save_png(picture, path, preview.sky, facts, label)
