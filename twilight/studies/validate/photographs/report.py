"""What `twilight.estimate` returns: the air of photographs, what they tell of it, and the comparison."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import yaml

from twilight.config.scene import Config
from twilight.engine import run
from twilight.scene import resolve
from twilight.scene.usual import described, usual_horizon
from twilight.sky.sky import Sky
from twilight.studies.validate.photographs.air import (
    OTHERS,
    SUN,
    Design,
    aerosol_above,
    climate_settings,
    with_settings,
)
from twilight.studies.validate.photographs.comparison import CHROMATICITY_SCALE, LOG_SCALE, Comparison
from twilight.studies.validate.photographs.comparison import compare as compare_photo
from twilight.studies.validate.photographs.estimate import EQUIVALENT
from twilight.studies.validate.photographs.fit import ANGLES, CONTRAST, OF_CAMERA, SATURATION, Freedom
from twilight.studies.validate.photographs.intervals import DARKEST_DEG, UNCONSTRAINED, AirEstimate, Estimated
from twilight.studies.validate.photographs.picture import Photograph

LEAST_ABOVE_KM = 0.02
"""Height of a camera above the ground from which on what is above it is said [km]."""
LOW_SUN_DEG = 3.0
"""Sun below which the sentences say what lies beyond the horizon."""

WORDS = {
    "aerosol": "haze (aerosol optical depth at 550 nm)",
    "ozone": "ozone",
    "albedo": "how bright the ground is (albedo)",
    SUN: "the sun's height",
    "heading": "the sun's azimuth in the picture, beyond what was told",
    "pitch": "the camera's angle above the horizontal, beyond what was told",
    "roll": "its tilt, beyond what was told",
    "zoom": "the width of its view, beyond what was told",
}
"""Parameters in words."""

AT_BOUND = {
    "aerosol": ("air that is clearer than any that was tried", "air that is hazier than any that was tried"),
    "albedo": (
        "a low sky that is darker beside the zenith than above any ground, or a picture with more contrast than light",
        "a low sky that is brighter beside the zenith than above any ground: thin haze, a picture with less contrast",
    ),
    SUN: ("a lower sun than those searched", "a higher sun than those searched"),
}
"""What a best value at the lower and the upper end of what was tried stands for."""
STRAINED = 3.0
"""Standard errors of an angle beyond which what was told of it is doubted."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """The air that makes the sky of one photograph, or of a series.

    shown: the photographs, their sun and camera as they were found
    given: the scene as it was given
    types: the best air of every aerosol type, the best first; best: the one that is taken, of the scene's own type
        where that cannot be told from the best
    remarks: sentences on where sun and camera are from
    """

    shown: tuple[Photograph, ...]
    given: Config
    types: list[AirEstimate]
    best: AirEstimate
    freedom: Freedom
    remarks: tuple[str, ...] = ()

    @property
    def picture(self) -> str:
        """Name of the photograph, or of the first and the last."""
        names = [one.name for one in self.shown]
        return names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"

    @property
    def photograph(self) -> Photograph:
        """The first photograph."""
        return self.shown[0]

    @property
    def sun_elevation_deg(self) -> float:
        """True, of the first photograph."""
        return self.shown[0].sun_elevation_deg

    @property
    def sun_azimuth_deg(self) -> float:
        """In the camera's azimuths, of the first photograph."""
        return self.shown[0].sun_azimuth_deg

    @property
    def fits(self) -> bool:
        """Whether the sky of the best air is about as the photograph shows it."""
        return self.best.fits

    @property
    def parameters(self) -> dict[str, Estimated]:
        """What was estimated, by name."""
        return {p.name: p for p in self.best.parameters}

    @property
    def settings(self) -> dict[str, Any]:
        """Dotted keys of what was told of the climate, or is haze at an end; empty where the fit does not fit."""
        ends = ("aerosol",) if self.fits and self.parameters["aerosol"].relative_width <= UNCONSTRAINED else ()
        told = [p for p in self.best.parameters if p.constrained or p.name in ends]
        values = {p.name: p.value for p in told if p.name not in (SUN, *OF_CAMERA)}
        return climate_settings(Design(OTHERS), values, self.best.aerosol_type) if "aerosol" in values else {}

    @property
    def scene(self) -> Config:
        """The scene with what was told, and the sun."""
        chosen = {"sun": {"elevation_deg": self.sun_elevation_deg}, "solver": {"name": "compact"}}
        return with_settings(self.given, self.settings | chosen)

    @property
    def climate(self) -> dict[str, Any]:
        """The climate as a mapping, to be rendered or saved: what was told, and the rest as it was given."""
        data = self.scene.climate.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
        name = re.sub(r"\.[^.]*$", "", self.shown[0].name)
        told = ", ".join(key for key in self.settings) or "nothing"
        about = f"From the photograph {self.picture}: {told}; all else as in {self.given.climate.name}"
        about = "; ".join([about, *self.beyond])
        return {"version": 1, **data, "name": f"{self.given.climate.name}-{name}"[:100], "description": about}

    @property
    def beyond(self) -> list[str]:
        """The sentence on what was taken to lie beyond the horizon, where a sun stands so low that it matters."""
        if min(one.sun_elevation_deg for one in self.shown) >= LOW_SUN_DEG:
            return []
        return [f"beyond the horizon: {described(usual_horizon(self.given))}"]

    def compared(self, shown: Photograph) -> tuple[Sky, Comparison]:
        """The computed sky of one of the photographs, and the photograph beside it."""
        return self._first if shown is self.shown[0] else self._beside(shown)

    def _beside(self, shown: Photograph, numpy_only_sun: bool = False) -> tuple[Sky, Comparison]:
        scene = with_settings(self.scene, {"sun": {"elevation_deg": shown.sun_elevation_deg}})
        sky = run(resolve(scene), numpy_only_sun=numpy_only_sun)
        seen = shown.seen(shown.sun_azimuth_deg, sky.apparent_sun_elevation_deg)
        white_balance = self.freedom.white_balance and seen.colour_known
        return sky, compare_photo(seen, sky, white_balance=white_balance, curve=self.best.curve)

    @cached_property
    def _first(self) -> tuple[Sky, Comparison]:
        return self._beside(self.shown[0], numpy_only_sun=True)

    @property
    def sky(self) -> Sky:
        """The computed sky of `scene`."""
        return self._first[0]

    @property
    def comparison(self) -> Comparison:
        """The first photograph beside `sky`."""
        return self._first[1]

    def __repr__(self) -> str:
        return "\n".join([f"<Estimate of {self.picture}: {self.best.aerosol_type}", *self.sentences()]) + ">"

    @property
    def about(self) -> list[str]:
        """Whether the fit does not fit, where sun and camera are from, and what lies beyond the horizon."""
        return [*([] if self.fits else [_misfit(self.best)]), *self.remarks, *self.beyond]

    def sentences(self) -> list[str]:
        """What the photograph tells and what it does not, in words; where a fit does not fit, that comes first."""
        if not self.fits:
            return self.about
        told = [sentence_of(p) for p in self.best.parameters if p.name not in OF_CAMERA]
        told[0] += self._above()
        return [*self.about, *told, *self._types(), *self._camera(), self._bands()]

    def _above(self) -> str:
        """Of the aerosol's depth, what of it is above a camera that stood above the ground."""
        altitude_km, ground_km = self.scene.observer.altitude_km, self.given.climate.ground.altitude_km
        if altitude_km - ground_km < LEAST_ABOVE_KM:
            return ""
        above = float(aerosol_above(self.scene, altitude_km)) * self.parameters["aerosol"].value
        level = "the sea's level" if ground_km == 0.0 else "the ground"
        return f"; from {level} up, {above:.3g} of it above the camera"

    def _camera(self) -> list[str]:
        """How the camera was held, what it did to the picture, and what not knowing it costs."""
        lines, held = [], self.parameters
        if "pitch" in held:
            here, p = self.photograph.camera.orientation, held["pitch"]
            half = 0.5 * (p.high - p.low)
            tilt = f", tilted {here.roll_deg:.1f} +- {0.5 * (held['roll'].high - held['roll'].low):.1f} deg"
            lines.append(f"camera: looked {here.elevation_deg:.1f} +- {half:.1f} deg above the horizontal{tilt}")
        for name, p in held.items():
            error = float(getattr(self.freedom, name)) if name in ANGLES else 0.0
            if error > 0.0 and abs(p.value) > STRAINED * error:
                lines.append(
                    f"{WORDS[name].partition(',')[0]}: {p.value:+.1f} {p.unit} from what was told to {error:.1f}, "
                    "which the sky contradicts: one of the two is wrong"
                )
        if self.freedom.curve and self.best.curve is not None:
            lines.append(f"tone curve: {self.best.curve.contrast:.2f} times the contrast of sRGB")
        said = [
            f"{1.0 + held[name].value:.2f} +- {0.5 * (held[name].high - held[name].low):.2f} of {what}"
            for name, what in (("contrast", "brightness"), ("saturation", "colour"))
            if name in held
        ]
        if said:
            lines.append(f"contrast: over the sky the picture has {', '.join(said)} times that of light")
        names = {
            "white balance": "the white balance",
            "curve": "the tone curve",
            "orientation": "its angles and contrasts",
        }
        dear = [f"{names[k]} {c:.1f}" for k, c in self.best.costs.items() if k in names and c >= 1.05]
        if dear:
            lines.append(f"the haze's interval is so many times wider for not knowing: {', '.join(dear)}")
        levels = self.best.camera.get("exposure")
        if levels is not None and self.photograph.log_exposure is not None:
            lines.append(
                f"brightness: by exposure, aperture and ISO the sky is {np.exp(float(levels[0])):.2f} times as bright "
                f"as computed (known to a factor of {np.exp(self.photograph.log_exposure[1]):.1f})"
            )
        return lines

    def _types(self) -> list[str]:
        alike = [e.aerosol_type for e in self.types if e is not self.best and e.chi2_above_best < EQUIVALENT]
        if len(self.types) == 1:
            return []
        if alike:
            return [f"kind of haze: {self.best.aerosol_type}; as well may it be {', '.join(alike)}"]
        return [f"kind of haze: {self.best.aerosol_type}"]

    def _bands(self) -> str:
        if not self.freedom.with_colour:
            return "colours: were left out; of wavelengths other than 500 to 620 nm the photograph tells nothing"
        if self.freedom.white_balance:
            return (
                "colours: with a free white balance the photograph tells how colour changes over the sky, not which "
                "colour the whole sky has"
            )
        return (
            "colours: as the camera balanced them; below 430 and above 650 nm the photograph tells nothing, and a "
            "camera's white balance may hide ozone and haze"
        )

    def climate_yaml(self) -> str:
        """`climate` as YAML, each value with where it is from."""
        told = {p.key.split(".")[-1]: self.parameters.get(p.name) for p in Design(OTHERS).parameters}
        lines = []
        for line in yaml.safe_dump(self.climate, sort_keys=False, allow_unicode=True, width=1000).splitlines():
            name, _, value = line.strip().partition(":")
            found = told.get(name)
            if not value.strip() or name in ("version", "name", "description"):
                lines.append(line)
            elif found is not None and any(key.endswith(name) for key in self.settings):
                lines.append(
                    f"{line}  # from the photograph: {found.low:.3g} to {found.high:.3g} (68 %), {found.low_95:.3g} to "
                    f"{found.high_95:.3g} (95 %){self._above() if found.name == 'aerosol' else ''}"
                )
            elif found is not None and found.source:
                lines.append(f"{line}  # usual, not told by the photograph: {found.source}")
            elif name == "type" and self.settings:
                lines.append(f"{line}  # fits the photograph best of those that were tried, or as well as the best")
            else:
                lines.append(f"{line}  # as it was given")
        return "\n".join(lines) + "\n"

    def facts(self) -> dict[str, Any]:
        """Everything as JSON values."""
        return {
            "photograph": self.picture,
            "scene": self.given.title,
            "horizon": usual_horizon(self.given).model_dump(mode="json", exclude_none=True, exclude_unset=True),
            "fits": self.fits,
            "sun_elevation_deg": self.sun_elevation_deg,
            "sun_azimuth_deg": self.sun_azimuth_deg,
            "photographs": [
                {
                    "name": one.name,
                    "sun_elevation_deg": one.sun_elevation_deg,
                    "sun_azimuth_deg": one.sun_azimuth_deg,
                    "orientation": one.camera.orientation.model_dump(),
                }
                for one in self.shown
            ],
            "camera": {kind: found.tolist() for kind, found in self.best.camera.items()},
            "times_wider_for_not_knowing": self.best.costs,
            "aerosol_type": self.best.aerosol_type,
            "climate_settings": self.settings,
            "estimates": [
                {
                    "aerosol_type": e.aerosol_type,
                    "misfit": e.misfit,
                    "chi2_above_best": e.chi2_above_best,
                    "values": e.values,
                    "parameters": {p.name: {k: v for k, v in vars(p).items() if k != "name"} for p in e.parameters},
                    "correlation": e.correlation.tolist(),
                }
                for e in self.types
            ],
            "sentences": self.sentences(),
        }


def _misfit(best: AirEstimate) -> str:
    """The sentence of a fit that does not fit."""
    if best.strained:
        return (
            "THE FIT DOES NOT FIT: the sky that has the photograph's colours and shape is several times brighter or "
            "darker than exposure, aperture and ISO say; its values are no estimate (a wrong sun, clouds, a curve that "
            "is not known)"
        )
    if best.overdrawn:
        brightness, colours = (1.0 + best.values.get(name, 0.0) for name in ("contrast", "saturation"))
        return (
            f"THE FIT DOES NOT FIT: nearest comes a sky of which the picture has {brightness:.1f} times the contrast, "
            f"in colours {colours:.1f} times (pictures keep it to {CONTRAST:g} and {SATURATION:g}); its values are no "
            "estimate (clouds, an overcast sky, a picture that was painted over)"
        )
    if best.values.get(SUN, 0.0) < DARKEST_DEG:
        return (
            f"THE FIT DOES NOT FIT: nearest comes the sun at {best.values[SUN]:.1f} deg, whose light is no more than "
            "that of a night; its values are no estimate (an overcast or cloudy sky, a picture that was painted over)"
        )
    return (
        f"THE FIT DOES NOT FIT: its misfit is {best.misfit:.2g}, and 1 is a sky off by {100 * LOG_SCALE:.0f} % in "
        f"luminance or by {CHROMATICITY_SCALE:g} in u', v'; its values are no estimate (clouds that were not masked, a "
        "wrong response, white balance or sun, a sky that is not clear)"
    )


def sentence_of(p: Estimated) -> str:
    """What a photograph tells of one parameter."""
    words = WORDS.get(p.name, p.name)
    unit = "" if p.unit in ("", "1") else f" {p.unit}"
    if p.constrained:
        return (
            f"{words}: {p.value:.3g}{unit}, {p.low:.3g} to {p.high:.3g} in 68 and {p.low_95:.3g} to {p.high_95:.3g} in "
            "95 of 100 such pictures"
        )
    low, high = p.bounds
    told = "does not tell it"
    if p.usual is not None:
        told += f"; {p.usual[0]:.3g} +- {p.usual[1]:g}{unit} is usual: {p.source}"
    elif p.low_95 > low and p.high_95 >= high:
        told = f"tells only that it is more than {p.low_95:.3g}{unit}"
    elif p.high_95 < high and p.low_95 <= low:
        told = f"tells only that it is less than {p.high_95:.3g}{unit}"
    end = next((k for k, met in enumerate((p.value <= low, p.value >= high)) if met), None)
    means = ""
    if end is not None and p.name in AT_BOUND:
        stands = AT_BOUND[p.name][end]
        means = f"; the best is the end of what was tried, {p.bounds[end]:g}, and may stand for {stands}"
    return f"{words}: the picture {told}{means}"
