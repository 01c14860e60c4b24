"""What `twilight.estimate` returns: the air of photographs, what they tell of it, and the comparison."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import yaml

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.base.threads import one_blas_thread
from twilight.config.scene import Config
from twilight.config.sun import SunAt, SunElevation, SunElevations
from twilight.engine import run
from twilight.numerics.directions import azimuth_elevation, camera_axes, direction
from twilight.scene import resolve
from twilight.sky import colour
from twilight.sky.ephemeris import SunPosition, sun_position
from twilight.sky.sky import Sky
from twilight.studies.validate.photographs.airs import (
    OTHERS,
    SUN,
    SUN_DEG,
    Airs,
    Design,
    climate_settings,
    with_settings,
)
from twilight.studies.validate.photographs.estimate import (
    EQUIVALENT,
    AirEstimate,
    Estimated,
    Options,
    Refine,
    find_air,
    first_look,
)
from twilight.studies.validate.photographs.fit import ANGLES, Frame, Freedom
from twilight.studies.validate.photographs.photo import (
    CHROMATICITY_SCALE,
    LOG_SCALE,
    OBSERVER,
    Cells,
    Comparison,
)
from twilight.studies.validate.photographs.photo import compare as compare_photo
from twilight.studies.validate.photographs.photograph import MaskedSky, Photograph, check_sky, check_upright, place_sun

MOST_CELLS = 240
"""Directions that a fit takes, of one photograph or of all."""

LEAST_CELLS = 40
"""Of each of several photographs."""

RETURNED_DEG = 1.0
"""Turn of a camera beyond which a photograph is cut into cells again [deg]."""

DISC_PITCH_DEG = 0.5
"""Standard error of a camera's elevation by the disc of a sun that is known [deg]."""

LIT_ABOVE_DEG = -0.5
"""A sun that is found above this has glare, which is masked before the fit is made again [deg]."""

OTHER_SUNS = {"the same air at noon (sun at 60 deg)": 60.0, "the same air with the sun at -6 deg": -6.0}
"""Other skies of the air of a photograph."""

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


@dataclass(frozen=True, eq=False)
class Shown:
    """One photograph of an estimate, its camera as it was found; the sun's true elevation, and its azimuth in the
    camera's azimuths [deg]."""

    name: str
    photograph: Photograph
    sun_elevation_deg: float
    sun_azimuth_deg: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """The air that makes the sky of one photograph, or of a series.

    shown: the photographs
    given: the scene as it was given
    types: the best air of every aerosol type, the best first; best: the one that is taken, of the scene's own type
        where that cannot be told from the best
    remarks: sentences on where sun and camera are from
    """

    shown: tuple[Shown, ...]
    given: Config
    types: list[AirEstimate]
    best: AirEstimate
    freedom: Freedom
    solver: str | None
    remarks: tuple[str, ...] = ()

    @property
    def picture(self) -> str:
        """Name of the photograph, or of the first and the last."""
        names = [one.name for one in self.shown]
        return names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"

    @property
    def photograph(self) -> Photograph:
        """The first photograph."""
        return self.shown[0].photograph

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
        """Dotted keys of what the photograph told of the climate; empty where the fit does not fit."""
        design = Design(OTHERS)
        told = {p.name: p.value for p in self.best.parameters if p.constrained and p.name not in (SUN, *ANGLES)}
        return climate_settings(design, told, self.best.aerosol_type) if "aerosol" in told else {}

    @property
    def scene(self) -> Config:
        """The scene with what was told, and the sun."""
        sun = {"sun": {"elevation_deg": self.sun_elevation_deg}}
        solver = {} if self.solver is None else {"solver": {"name": self.solver}}
        return with_settings(self.given, self.settings | sun | solver)

    @property
    def climate(self) -> dict[str, Any]:
        """The climate as a mapping, to be rendered or saved: what was told, and the rest as it was given."""
        data = self.scene.climate.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
        name = re.sub(r"\.[^.]*$", "", self.shown[0].name)
        told = ", ".join(key for key in self.settings) or "nothing"
        about = f"From the photograph {self.picture}: {told}; all else as in {self.given.climate.name}"
        return {"version": 1, **data, "name": f"{self.given.climate.name}-{name}"[:100], "description": about}

    def sky_of(self, shown: Shown) -> Sky:
        """The computed sky of one of the photographs."""
        return run(resolve(with_settings(self.scene, {"sun": {"elevation_deg": shown.sun_elevation_deg}})))

    def compared(self, shown: Shown, sky: Sky) -> tuple[MaskedSky, Comparison]:
        """One of the photographs on the grid of the comparison, and beside its computed sky."""
        seen = shown.photograph.seen(shown.sun_azimuth_deg, sky.apparent_sun_elevation_deg)
        white_balance = self.freedom.white_balance and seen.sky.colour_known
        return seen, compare_photo(seen.sky, sky, white_balance=white_balance, curve=self.best.curve)

    def other_suns(self) -> list[tuple[str, Sky]]:
        """Names and skies of the same air at noon and at dusk, by `compact`."""
        made = []
        for name, sun in OTHER_SUNS.items():
            settings = {"sun": {"elevation_deg": sun}, "solver": {"name": "compact"}}
            made.append((name, run(resolve(with_settings(self.scene, settings)))))
        return made

    @cached_property
    def sky(self) -> Sky:
        """The computed sky of `scene`."""
        return run(resolve(self.scene), numpy_only_sun=True)

    @cached_property
    def _compared(self) -> tuple[MaskedSky, Comparison]:
        return self.compared(self.shown[0], self.sky)

    @property
    def seen(self) -> MaskedSky:
        """The first photograph on the grid of the comparison."""
        return self._compared[0]

    @property
    def comparison(self) -> Comparison:
        """The first photograph beside `sky`."""
        return self._compared[1]

    def __repr__(self) -> str:
        return "\n".join([f"<Estimate of {self.picture}: {self.best.aerosol_type}", *self.sentences()]) + ">"

    def sentences(self) -> list[str]:
        """What the photograph tells and what it does not, in words; where a fit does not fit, that comes first."""
        if not self.fits:
            return [_misfit(self.best), *self.remarks]
        told = [_sentence(p) for p in self.best.parameters if p.name not in ANGLES]
        return [*self.remarks, *told, *self._types(), *self._camera(), self._bands()]

    def _camera(self) -> list[str]:
        """How the camera was held, what it did to the picture, and what not knowing it costs."""
        lines, held = [], self.parameters
        if "pitch" in held:
            here, p = self.photograph.camera.orientation, held["pitch"]
            half = 0.5 * (p.high - p.low)
            tilt = f", tilted {here.roll_deg:.1f} +- {0.5 * (held['roll'].high - held['roll'].low):.1f} deg"
            lines.append(f"camera: looked {here.elevation_deg:.1f} +- {half:.1f} deg above the horizontal{tilt}")
        curve = self.best.curve
        if curve is not None:
            lines.append(f"tone curve: {curve.contrast:.2f} times the contrast of sRGB")
        names = {"white balance": "the white balance", "curve": "the tone curve", "orientation": "the camera's angles"}
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
            elif found is not None and found.constrained:
                lines.append(
                    f"{line}  # from the photograph: {found.low:.3g} to {found.high:.3g} (68 %), {found.low_95:.3g} to "
                    f"{found.high_95:.3g} (95 %)"
                )
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
            "fits": self.fits,
            "sun_elevation_deg": self.sun_elevation_deg,
            "sun_azimuth_deg": self.sun_azimuth_deg,
            "photographs": [
                {
                    "name": one.name,
                    "sun_elevation_deg": one.sun_elevation_deg,
                    "sun_azimuth_deg": one.sun_azimuth_deg,
                    "orientation": one.photograph.camera.orientation.model_dump(),
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
    return (
        f"THE FIT DOES NOT FIT: its misfit is {best.misfit:.2g}, and 1 is a sky off by {100 * LOG_SCALE:.0f} % in "
        f"luminance or by {CHROMATICITY_SCALE:g} in u', v'; its values are no estimate (clouds that were not masked, a "
        "wrong response, white balance or sun, a sky that is not clear)"
    )


def _sentence(p: Estimated) -> str:
    """What a photograph tells of one parameter."""
    words = WORDS.get(p.name, p.name)
    unit = "" if p.unit in ("", "1") else f" {p.unit}"
    if p.constrained:
        return (
            f"{words}: {p.value:.3g}{unit}, {p.low:.3g} to {p.high:.3g} in 68 and {p.low_95:.3g} to {p.high_95:.3g} in "
            "95 of 100 such pictures"
        )
    low, high = p.bounds
    if p.low_95 > low and p.high_95 >= high:
        return f"{words}: the picture tells only that it is more than {p.low_95:.3g}{unit}"
    if p.high_95 < high and p.low_95 <= low:
        return f"{words}: the picture tells only that it is less than {p.high_95:.3g}{unit}"
    return f"{words}: the picture does not tell it"


def sun_range(config: Config) -> tuple[float, float, SunPosition | None]:
    """Lowest and highest sun [deg] of the search, equal where it is known, and its position at a place and time."""
    sun = config.sun
    if isinstance(sun, SunAt):
        at = sun_position(sun.aware(sun.at), sun.latitude_deg, sun.longitude_deg, config.observer.altitude_km)
        return (*_known(float(at.elevation_deg)), at)
    if "sun" not in config.model_fields_set:
        return (*SUN_DEG, None)
    if isinstance(sun, SunElevation):
        return (*_known(sun.elevation_deg), None)
    if not isinstance(sun, SunElevations):
        raise TwilightError(
            "sun: a photograph has one time; give sun.at, an elevation, or elevations to search between"
        )
    low, high = (float(np.clip(f(sun.elevations_deg), *SUN_DEG)) for f in (min, max))
    return low, high, None


def _known(elevation_deg: float) -> tuple[float, float]:
    low, high = SUN_DEG
    if not low <= elevation_deg <= high:
        raise TwilightError(
            f"sun: at {elevation_deg:.2f} deg; photographs are fitted with suns from {low:g} to {high:g}"
        )
    return elevation_deg, elevation_deg


@dataclass(frozen=True)
class Given:
    """What the caller of an estimate says of it; see `twilight.estimate`."""

    types: Sequence[str]
    parameters: Sequence[str]
    sun_azimuth_deg: float | None = None
    suns_deg: Sequence[float] | None = None
    white_balance: bool | None = None
    tone_curve: bool | None = None
    brightness: bool = True
    with_colour: bool = True
    refine: bool = False


@one_blas_thread()
def estimate_air(
    names: Sequence[str],
    photographs: Sequence[Photograph],
    given: Config,
    says: Given,
    progress: Progress = silent,
) -> Estimate:
    """Fit photographs of one camera, held the same, and one air.  Errors: TwilightError for whatever cannot be done."""
    placed = [_placed(*one, given, says) for one in zip(names, photographs, _suns(photographs, says), strict=True)]
    shown, remarks = [one[0] for one in placed], list(dict.fromkeys(note for one in placed for note in one[3]))
    low, high = placed[0][1]
    if len(placed) > 1 and any(a != b for _, (a, b), _, _ in placed):
        raise TwilightError(
            "series: the sun of every picture must be known: by Exif time and place, by sun elevations that are given, "
            "or by its disc"
        )
    design = Design(tuple(p for p in OTHERS if p.name in says.parameters))
    own = None if given.climate.aerosol is None else given.climate.aerosol.type
    order = [name for name in says.types if name == own] + [name for name in says.types if name != own]
    airs = Airs(given, design, part_of(progress, 0.05, 0.75))
    developed = any(one.photograph.developed for one in shown)
    unknown = not all(one.photograph.balanced for one in shown)
    heading = max(one[2] for one in placed)
    free = Freedom(
        white_balance=developed or unknown if says.white_balance is None else says.white_balance,
        curve=developed if says.tone_curve is None else says.tone_curve,
        brightness=says.brightness,
        with_colour=says.with_colour,
        heading=np.hypot(heading, LEAST_HEADING_DEG) if heading > 0.0 else 0.0,
        pitch=shown[0].photograph.errors_deg[1],
        roll=shown[0].photograph.errors_deg[2],
        zoom=shown[0].photograph.zoom_error,
    )
    refined: Refine | None = None
    if says.refine:

        def refined(
            aerosol_type: str, values: Mapping[str, float], frame: Frame, elevation: np.ndarray, azimuth: np.ndarray
        ) -> np.ndarray:
            sun = values.get(SUN, frame.sun_deg)
            return _by_the_scene(given, design, aerosol_type, values, sun, elevation, azimuth)

    most = max(MOST_CELLS // len(shown), LEAST_CELLS)
    options, known = Options(order, own, low, high, free), low == high
    frames = [_frame(one, most, known) for one in shown]
    if not known or max(free.pitch, free.roll) > 0.0:
        # a sun and a camera that were not known: cut the pictures into cells again
        look = first_look(airs, frames, options).values()
        lit = not known and look.get(SUN, 0.0) >= LIT_ABOVE_DEG
        if lit or np.hypot(look.get("pitch", 0.0), look.get("roll", 0.0)) > RETURNED_DEG:
            turned = {name: value for name, value in look.items() if name != "zoom"}
            cut = [_found(one, turned) for one in shown]
            frames = [_frame(one, most, known, told) for one, told in zip(cut, frames, strict=True)]
    made = find_air(airs, frames, options, refined, progress)
    best = next(one for one in made if one.parameters)
    shown = [_found(one, best.values) for one in shown]
    return Estimate(tuple(shown), given, made, best, free, None if says.refine else "compact", tuple(remarks))


LEAST_HEADING_DEG = 0.3
"""Least standard error of a sun's azimuth that was found in the picture [deg]."""


def _suns(photographs: Sequence[Photograph], says: Given) -> list[float | None]:
    if says.suns_deg is None:
        return [None] * len(photographs)
    if len(says.suns_deg) != len(photographs):
        raise TwilightError(f"sun elevations: gives {len(says.suns_deg)} for {len(photographs)} pictures")
    return [_known(sun)[0] for sun in says.suns_deg]


def _placed(
    name: str, photograph: Photograph, told_deg: float | None, given: Config, says: Given
) -> tuple[Shown, tuple[float, float], float, list[str]]:
    """A photograph with its sun (NaN where it is sought), between which suns, the error of its azimuth, and remarks."""
    check_upright(name, photograph)
    low, high, at = sun_range(given)
    remarks = list(photograph.remarks)
    if told_deg is not None:
        low = high = told_deg
    elif "sun" not in given.model_fields_set and photograph.stated.sun is not None:
        scene = with_settings(given, {"sun": photograph.stated.sun})
        low, high, at = sun_range(scene)
        remarks.append(f"the sun's height: {low:.2f} deg by Exif time and place")
    known_azimuth = None if at is None else float(at.azimuth_deg)
    azimuth, error, note = place_sun(photograph, known_azimuth, says.sun_azimuth_deg)
    remarks.append(note)
    disc = None if says.sun_azimuth_deg is not None else photograph.sun if "disc" in note else None
    if disc is not None and disc.true_elevation_deg is not None:
        tilt = photograph.errors_deg[1]
        if low == high and tilt > DISC_PITCH_DEG:
            turn = low - float(disc.true_elevation_deg)
            photograph = photograph.turned(
                turn, 0.0, (*photograph.errors_deg[:1], DISC_PITCH_DEG, photograph.errors_deg[2])
            )
            remarks.append(f"camera: turned by {turn:+.1f} deg so that the sun's disc stands where the sun does")
        elif low < high:
            found = round(float(disc.true_elevation_deg), 2)
            if low <= found <= high:
                low, high = (found, found) if tilt == 0.0 else (max(low, found - 3 * tilt), min(high, found + 3 * tilt))
                remarks.append(f"the sun's height: {found:.2f} deg by its disc in the photograph")
            else:
                remarks.append(
                    f"the sun's disc stands at {found:.2f} deg, not within the {low:g} to {high:g} deg searched"
                )
    remarks += check_sky(name, photograph, photograph.seen(azimuth, low if low == high else None))
    return Shown(name, photograph, low if low == high else np.nan, azimuth), (low, high), error, remarks


def _frame(shown: Shown, most: int, known: bool, told: Frame | None = None) -> Frame:
    """A photograph cut into the cells of a fit; told: the same with the camera that its angles count from."""
    photograph, sun = shown.photograph, shown.sun_elevation_deg
    cells = Cells.of(photograph.seen(shown.sun_azimuth_deg, sun if np.isfinite(sun) else None).sky, most)
    held = photograph.camera.orientation
    camera = ((held.azimuth_deg or 0.0) - shown.sun_azimuth_deg, held.elevation_deg, held.roll_deg)
    if told is not None:
        own = direction(cells.azimuth_deg, cells.elevation_deg) @ camera_axes(*camera).T
        azimuth, elevation = azimuth_elevation(own @ camera_axes(*told.camera_deg))
        cells, camera = replace(cells, elevation_deg=elevation, azimuth_deg=azimuth), told.camera_deg
    eight = photograph.developed and photograph.picture.bits == 8
    frame = Frame(cells, camera, sun if known else None, None, photograph.log_exposure, eight)
    if photograph.camera.projection == "latlong":
        return frame
    corner = float(photograph.camera.angle_off_axis(np.array([0.0, 0.0])))
    corner = corner if np.isfinite(corner) else np.radians(90.0)
    off = np.arccos(np.clip(frame.own[:, 1], -1.0, 1.0))
    return replace(frame, lens=(off / corner) ** 2)


def _found(shown: Shown, values: Mapping[str, float]) -> Shown:
    """A photograph with its camera and sun as they were found."""
    heading, pitch, roll, zoom = (values.get(name, 0.0) for name in ANGLES)
    photograph = shown.photograph
    if pitch or roll or zoom:
        photograph = photograph.turned(pitch, roll, photograph.errors_deg, zoom)
    sun = values.get(SUN, shown.sun_elevation_deg)
    return Shown(shown.name, photograph, float(sun), float((shown.sun_azimuth_deg - heading) % 360.0))


def _by_the_scene(
    given: Config,
    design: Design,
    aerosol_type: str,
    values: Mapping[str, float],
    sun: float | None,
    elevation: np.ndarray,
    azimuth: np.ndarray,
) -> np.ndarray:
    """ln(XYZ) (n, 3) in directions, by the scene's own solver and with all that the scene has."""
    settings = climate_settings(design, values, aerosol_type) | {"sun": {"elevation_deg": sun}}
    sky = run(resolve(with_settings(given, settings)), numpy_only_sun=True)
    factor = sky.sample(elevation, azimuth)
    xyz = colour.factor_to_xyz(factor, sky.wavelength_nm, sky.solar_spectrum, observer=OBSERVER)
    if not (xyz > 0.0).all():
        raise TwilightError("estimate: the computed sky is black where the photograph shows clear sky")
    return np.log(xyz)
