"""What `twilight.estimate` returns: the air of a photograph, what the photograph tells of it, and the comparison."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import yaml

from twilight.base.errors import TwilightError
from twilight.base.progress import Progress, part_of, silent
from twilight.config.scene import Config
from twilight.config.sun import SunAt, SunElevation, SunElevations
from twilight.engine import run
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
from twilight.studies.validate.photographs.estimate import AirEstimate, Estimated
from twilight.studies.validate.photographs.find_air import EQUIVALENT, Options, Refine, find_air
from twilight.studies.validate.photographs.photo import CHROMATICITY_SCALE, LOG_SCALE, OBSERVER, Cells, Comparison
from twilight.studies.validate.photographs.photo import compare as compare_photo
from twilight.studies.validate.photographs.photograph import MaskedSky, Photograph, place_sun

MOST_CELLS = 400
"""Directions of a photograph that a fit takes."""

LIT_ABOVE_DEG = -0.5
"""A sun that is found above this has glare, which is masked before the fit is made again [deg]."""

WORDS = {
    "aerosol": "haze (aerosol optical depth at 550 nm)",
    "ozone": "ozone",
    "albedo": "how bright the ground is (albedo)",
    SUN: "the sun's height",
}
"""Parameters in words."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """The air that makes the sky of a photograph.

    given: the scene as it was given
    types: the best air of every aerosol type, the best first; best: the one that is taken, of the scene's own type
        where that cannot be told from the best
    sun_elevation_deg, sun_azimuth_deg: true elevation, and azimuth in the camera's azimuths
    remarks: sentences on where the sun is from
    """

    picture: str
    photograph: Photograph
    given: Config
    types: list[AirEstimate]
    best: AirEstimate
    sun_elevation_deg: float
    sun_azimuth_deg: float
    white_balance: bool
    with_colour: bool
    solver: str | None
    remarks: tuple[str, ...] = ()

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
        told = {p.name: p.value for p in self.best.parameters if p.constrained and p.name != SUN}
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
        name = re.sub(r"\.[^.]*$", "", self.picture)
        told = ", ".join(key for key in self.settings) or "nothing"
        about = f"From the photograph {self.picture}: {told}; all else as in {self.given.climate.name}"
        return {"version": 1, **data, "name": f"{self.given.climate.name}-{name}"[:100], "description": about}

    @cached_property
    def sky(self) -> Sky:
        """The computed sky of `scene`."""
        return run(resolve(self.scene), numpy_only_sun=True)

    @cached_property
    def seen(self) -> MaskedSky:
        """The photograph on the grid of the comparison."""
        return self.photograph.seen(self.sun_azimuth_deg, self.sky.apparent_sun_elevation_deg)

    @cached_property
    def comparison(self) -> Comparison:
        """The photograph beside `sky`."""
        return compare_photo(self.seen.sky, self.sky, white_balance=self.white_balance)

    def __repr__(self) -> str:
        return "\n".join([f"<Estimate of {self.picture}: {self.best.aerosol_type}", *self.sentences()]) + ">"

    def sentences(self) -> list[str]:
        """What the photograph tells and what it does not, in words; where a fit does not fit, that comes first."""
        if not self.fits:
            return [_misfit(self.best), *self.remarks]
        told = map(_sentence, self.best.parameters)
        return [*self.remarks, *told, *self._types(), self._bands()]

    def _types(self) -> list[str]:
        alike = [e.aerosol_type for e in self.types if e is not self.best and e.chi2_above_best < EQUIVALENT]
        if len(self.types) == 1:
            return []
        if alike:
            return [f"kind of haze: {self.best.aerosol_type}; as well may it be {', '.join(alike)}"]
        return [f"kind of haze: {self.best.aerosol_type}"]

    def _bands(self) -> str:
        if not self.with_colour:
            return "colours: were left out; of wavelengths other than 500 to 620 nm the photograph tells nothing"
        if self.white_balance:
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


def estimate_air(
    picture: str,
    photograph: Photograph,
    given: Config,
    types: Sequence[str],
    parameters: Sequence[str],
    *,
    sun_azimuth_deg: float | None = None,
    white_balance: bool = False,
    with_colour: bool = True,
    refine: bool = False,
    progress: Progress = silent,
) -> Estimate:
    """Fit a photograph; arguments as of `twilight.estimate`.  Errors: TwilightError for whatever cannot be done."""
    low, high, at = sun_range(given)
    remarks = []
    known_azimuth = None if at is None else float(at.azimuth_deg)
    azimuth, note = place_sun(photograph, known_azimuth, sun_azimuth_deg)
    remarks.append(note)
    if low < high and sun_azimuth_deg is None and (disc := photograph.sun.true_elevation_deg) is not None:
        if low <= disc <= high:
            low = high = round(float(disc), 2)
            remarks.append(f"the sun's height: {low:.2f} deg by its disc in the photograph")
        else:
            remarks.append(
                f"the sun's disc stands at {disc:.2f} deg, outside of the {low:g} to {high:g} deg that are searched"
            )
    design = Design(tuple(p for p in OTHERS if p.name in parameters))
    climate = given.climate
    own = None if climate.aerosol is None else climate.aerosol.type
    order = [name for name in types if name == own] + [name for name in types if name != own]
    airs = Airs(given, design, part_of(progress, 0.05, 0.75))
    refined: Refine | None = None
    if refine:
        known_sun = low

        def refined(aerosol_type: str, values: Mapping[str, float], cells: Cells) -> np.ndarray:
            return _by_the_scene(given, design, aerosol_type, values, cells, known_sun)

    apparent = low if low == high else None
    for _ in range(2):
        cells = Cells.of(photograph.seen(azimuth, apparent).sky, MOST_CELLS)
        options = Options(order, own, low, high, white_balance, with_colour)
        made = find_air(airs, cells, options, refined, progress)
        best = next(one for one in made if one.parameters)
        sun = best.values.get(SUN, low)
        if apparent is not None or sun < LIT_ABOVE_DEG:
            break
        apparent = sun
    return Estimate(
        picture,
        photograph,
        given,
        made,
        best,
        float(best.values.get(SUN, low)),
        azimuth,
        white_balance,
        with_colour,
        None if refine else "compact",
        tuple(remarks),
    )


def _by_the_scene(
    given: Config, design: Design, aerosol_type: str, values: Mapping[str, float], cells: Cells, sun: float
) -> np.ndarray:
    """ln(XYZ) (n, 3) in cells, by the scene's own solver and with all that the scene has."""
    settings = climate_settings(design, values, aerosol_type) | {"sun": {"elevation_deg": values.get(SUN, sun)}}
    sky = run(resolve(with_settings(given, settings)), numpy_only_sun=True)
    factor = sky.sample(cells.elevation_deg, cells.azimuth_deg)
    xyz = colour.factor_to_xyz(factor, sky.wavelength_nm, sky.solar_spectrum, observer=OBSERVER)
    if not (xyz > 0.0).all():
        raise TwilightError("estimate: the computed sky is black where the photograph shows clear sky")
    return np.log(xyz)
