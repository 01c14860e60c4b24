"""A rendered sky with its views and facts, as the writers of files take it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np

from twilight.sky import colour
from twilight.sky.sky import Sky


@dataclass(frozen=True)
class Options:
    """How files look.

    views: of the pictures (``io.picture``); renderer, width, spectral_width: of the environment maps
    (``io.environment``); exposure, tone_mapping, observer: of the pictures and colours; polariser_deg: axis of a
    polariser before the pictures and the RGB environment map (``Sky.through_polariser``), None: there is none; disc:
    whether the sun's disc is in the environment maps; primaries, exr: of ``sky.rgb.exr`` (``io.exr``); tone_settings:
    of the tones `eye` and `camera` (`twilight.sky.tone`).
    """

    views: tuple[str, ...]
    renderer: str = "openexr"
    width: int = 1024
    spectral_width: int = 256
    exposure: float | Literal["auto"] = "auto"
    tone_mapping: str = colour.DEFAULT_TONE_MAPPING
    observer: str = colour.DEFAULT_OBSERVER
    polariser_deg: float | None = None
    disc: bool = False
    primaries: str = "rec709"
    exr: str | None = None
    tone_settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class ViewPixels:
    """A picture in a projection of `twilight.numerics.projections`.

    kind: of the projection; rays (H, W, 3): directions of the pixels, to the right of the sun, to the sun's azimuth,
    up; radiance (H, W, K): sun-normalised [sr^-1], NaN outside the view; pitch_deg: angle between pixels;
    sun (H, W): fraction of the pixel that the disc of sun or moon covers, None where neither is in the picture;
    hidden (H, W): whether terrain stands before the sky, None where there is none.
    """

    kind: str
    rays: np.ndarray
    radiance: np.ndarray
    pitch_deg: float
    sun: np.ndarray | None = None
    hidden: np.ndarray | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W) [pixels]."""
        return self.rays.shape[0], self.rays.shape[1]

    def rows(self, first: int, stop: int) -> ViewPixels:
        """Some rows of the picture."""
        return self._at(np.s_[first:stop])

    def columns(self, step: int) -> ViewPixels:
        """Every step-th column."""
        return self._at(np.s_[:, ::step])

    def _at(self, here: Any) -> ViewPixels:
        return replace(
            self,
            rays=self.rays[here],
            radiance=self.radiance[here],
            sun=None if self.sun is None else self.sun[here],
            hidden=None if self.hidden is None else self.hidden[here],
        )


class ViewSource(Protocol):
    """A picture that gives its rows when it is asked for them, so that a large one need not be held: a `Seen` or what
    `engine.view` looked at."""

    @property
    def kind(self) -> str: ...

    @property
    def pitch_deg(self) -> float: ...

    @property
    def shape(self) -> tuple[int, int]: ...

    def rows(self, first: int, stop: int) -> ViewPixels: ...


@dataclass(frozen=True)
class Rendered:
    """A sky, and a view of it where there is one."""

    sky: Sky
    polariser_deg: float | None = None
    view: ViewSource | None = None

    @cached_property
    def seen(self) -> Sky:
        """The sky as the pictures see it: behind the polariser where there is one."""
        return self.sky if self.polariser_deg is None else self.sky.through_polariser(self.polariser_deg)
