"""``sun.png``: a close-up of the sun's disc."""

from pathlib import Path

import numpy as np

from twilight.base.errors import TwilightError
from twilight.io.disc import add_to_picture, dip_deg, light_of
from twilight.io.environment import ground_factor
from twilight.io.picture import save_png
from twilight.io.rendered import Options, Rendered
from twilight.sky import colour
from twilight.sky.sky import Sky
from twilight.sky.tone import Shot, Tone, tone_of

CLOSE_UP_DEG = 0.8
"""Field of ``sun.png``, from side to side."""
CLOSE_UP_PIXELS = 400
"""Width and height of ``sun.png`` [pixel]."""


def close_up(sky: Sky, tone: Tone) -> tuple[np.ndarray, float]:
    """A tone's channels of a square of 0.8 deg around the disc (pixels, pixels, K), and its middle's elevation [deg].

    The sky is that of the disc's surroundings, and below the horizon the ground; without a disc in sight the square
    stands on the horizon.
    """
    assert sky.disc is not None
    lower, upper = sky.disc.edges_deg()
    middle = 0.5 * (lower + upper) if np.isfinite(lower) else 0.5 * CLOSE_UP_DEG
    offset = ((np.arange(CLOSE_UP_PIXELS) + 0.5) / CLOSE_UP_PIXELS - 0.5) * CLOSE_UP_DEG
    elevation = (middle - offset)[:, None]
    azimuth = offset[None, :] / np.cos(np.radians(middle))
    responses = tone.see(sky.normalised_radiance, sky.wavelength_nm, light_of(sky))
    lowest = max(float(sky.elevation_edges_deg[0]), -dip_deg(sky))
    picture = sky.smooth(responses, np.clip(elevation, lowest, 90.0), azimuth).astype(float)
    picture[elevation[:, 0] < -dip_deg(sky)] = tone.see(ground_factor(sky), sky.wavelength_nm, light_of(sky))
    add_to_picture(sky, picture, elevation, azimuth, tone, points=2)
    return picture, float(middle)


def write_picture(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sun.png``: the disc alone fills the picture, exposed for itself."""
    sky = rendered.seen
    if sky.disc is None:
        raise TwilightError("output.files: disc needs sun.disc: true")
    tone = tone_of(options.tone_mapping, options.observer, options.tone_settings)
    picture, middle = close_up(sky, tone)
    luminance = picture[..., 1]
    bright = luminance[luminance > 0.02 * luminance.max()]
    key = float(np.exp(np.log(bright).mean())) if bright.size else 1e-6
    ev100 = float(np.log2(key / (3.0 * colour.GREY_LUMINANCE_AT_EV100_0)))
    display, _ = tone.develop(picture, Shot(ev100, CLOSE_UP_DEG / CLOSE_UP_PIXELS))
    facts = {"field_deg": CLOSE_UP_DEG, "middle_elevation_deg": middle, "exposure_ev100": ev100}
    return [save_png(display, folder / "sun.png", sky, facts)]
