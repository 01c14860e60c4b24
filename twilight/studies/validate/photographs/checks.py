"""What makes a photograph useless for its air, or less useful, told before anything is fitted."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from twilight.base.errors import TwilightError
from twilight.sky.colour import REC709_LUMINANCE
from twilight.studies.validate.photographs.mask import separation_deg
from twilight.studies.validate.photographs.panorama import Panorama
from twilight.studies.validate.photographs.photograph import MaskedSky, Photograph

UPSIDE_DOWN = 2.0
"""Light of the lower half of a picture over that of the upper beyond which it may stand on its head."""
NIGHT_CD_PER_M2 = 2e-3
"""Luminance of the sky below which a picture is one of the night: a zenith with the sun at -15 deg."""
MOST_SATURATED, MUCH_SATURATED = 0.6, 0.2
"""Part of the sky that is shown, saturated: refused, and worth a warning."""
LAMP_SQUARE_DEG = 2.0
"""Area of saturated light in the sky from which it counts as a sun [deg^2]."""
APART_DEG = 15.0
"""Distance of two such lights that are not one [deg]."""


def check_upright(name: str, photograph: Photograph) -> None:
    """TwilightError for a picture that stands on its head: below brighter, and smoother, than above."""
    light = photograph.picture.samples @ REC709_LUMINANCE.astype(np.float32)
    step = max(1, light.shape[1] // 200)
    small = light[::step, ::step]
    upper, lower = np.array_split(small, 2)
    logarithms = [np.log(np.maximum(half, 1e-6 + 1e-4 * float(small.max()))) for half in (upper, lower)]
    level = [float(np.median(half)) for half in logarithms]
    rough = [float(np.median(np.abs(np.diff(half, axis=1)))) for half in logarithms]
    if level[1] - level[0] > np.log(UPSIDE_DOWN) and rough[1] < rough[0]:
        raise TwilightError(
            f"{name}: its lower half is brighter and smoother than its upper: it stands on its head, or shows no sky; "
            "turn it"
        )


def check_sky(name: str, photograph: Photograph, seen: MaskedSky) -> list[str]:
    """Sentences of warning about the sky of a photograph.  Errors: TwilightError for one that is of no use."""
    shown = seen.panorama.covered & (seen.panorama.elevation_deg > 0.0)[:, None]
    weight = np.cos(np.radians(seen.panorama.elevation_deg))[:, None] * shown
    sky = weight * ~seen.mask.foreground
    saturated = float((sky * seen.panorama.saturated).sum() / max(float(sky.sum()), 1e-12))
    if saturated > MOST_SATURATED:
        raise TwilightError(f"{name}: is over-exposed: {saturated:.0%} of its sky is at the end of its scale")
    lines = []
    if saturated > MUCH_SATURATED:
        lines.append(f"{saturated:.0%} of the sky is over-exposed and left out: intervals are wider")
    exposure = photograph.log_exposure
    if exposure is not None:
        luminance = float(np.nanmedian(seen.sky.xyz[..., 1][seen.sky.counts])) * float(np.exp(exposure[0]))
        if luminance < NIGHT_CD_PER_M2:
            raise TwilightError(
                f"{name}: by exposure time, aperture and sensitivity its sky has {luminance:.1g} cd/m^2: a night, or "
                "moonlight; the air is estimated by the sun's light down to -15 deg"
            )
    count = _lights(seen.panorama, seen.panorama.saturated & shown & ~seen.mask.foreground)
    if count > 1:
        lines.append(
            f"{count} lights in the sky are at the end of the scale, more than {APART_DEG:g} deg apart: reflections or "
            "lamps; give --sun-azimuth, and a --mask without their glare"
        )
    return lines


def _lights(panorama: Panorama, saturated: np.ndarray) -> int:
    """How many large saturated lights stand far from each other."""
    labels, count = ndimage.label(saturated, np.ones((3, 3)))
    if count < 2:
        return count
    rows, columns = np.indices(saturated.shape)
    elevation, azimuth = panorama.elevation_deg[rows], panorama.azimuth_deg[columns]
    area = ndimage.sum_labels(np.cos(np.radians(elevation)) * panorama.step_deg**2, labels, np.arange(1, count + 1))
    kept: list[tuple[float, float]] = []
    for label in 1 + np.argsort(-area):
        if area[label - 1] < LAMP_SQUARE_DEG:
            break
        here = labels == label
        east, north = np.sin(np.radians(azimuth[here])).mean(), np.cos(np.radians(azimuth[here])).mean()
        middle = float(elevation[here].mean()), float(np.degrees(np.arctan2(east, north)))
        if all(float(separation_deg(*middle, *other)) > APART_DEG for other in kept):
            kept.append(middle)
    return len(kept)
