"""The numbers behind the page's tones, taken from their definitions in `twilight.sky.tone` and `twilight.sky.colour`.

The curve of a photograph and the gamut are formulas in `web/tone.glsl` with constants from here.  What an eye does is
tables over the logarithm of photopic luminance and of scotopic over photopic luminance.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from twilight.io.view import DARKEST_FRACTION
from twilight.numerics import spectrum
from twilight.sky import colour, tone
from twilight.sky.quantities.measure import MESOPIC_RATIO, adaptation_coefficient

LOG10_PHOTOPIC = np.linspace(-6.0, 6.0, 241)
"""Nodes of the eye's tables: logarithms of luminance [cd m^-2]."""
LOG10_RATIO = np.linspace(-1.0, 1.0, 21)
"""Nodes of the eye's tables: logarithms of scotopic over photopic luminance."""


def eye_tables() -> dict[str, np.ndarray]:
    """On the nodes: adaptation_coefficient and ln of display_gain (241, 21), finest grating [cycles/deg] (241,)."""
    photopic = 10.0 ** LOG10_PHOTOPIC[:, None]
    scotopic = photopic * 10.0**LOG10_RATIO
    return {
        "adaptation_coefficient": adaptation_coefficient(photopic, scotopic)[0],
        "display_gain": np.log(tone.display_gain(photopic, scotopic)),
        "acuity": tone.acuity_cycles_per_deg(photopic[:, 0]),
    }


def header() -> dict[str, Any]:
    """What the page's scripts need: of the meter, and of an eye that adapts."""
    return {
        "middle_grey": colour.MIDDLE_GREY,
        "grey_luminance": colour.GREY_LUMINANCE_AT_EV100_0,
        "metered_greys": colour.METERED_GREYS,
        "highlight_quantile": colour.HIGHLIGHT_QUANTILE,
        "highlights_over_mean": colour.HIGHLIGHTS_OVER_MEAN,
        "darkest_fraction": DARKEST_FRACTION,
        "display_white": tone.DISPLAY_WHITE_CD_PER_M2,
        "sigma_cycles": tone.SIGMA_CYCLES,
        "cones_s": tone.CONES_S,
        "rods_s": tone.RODS_S,
        "day": tone.DAY_CD_PER_M2,
        "night": tone.NIGHT_CD_PER_M2,
        "log10_photopic": [float(LOG10_PHOTOPIC[0]), float(LOG10_PHOTOPIC[-1])],
        "log10_ratio": [float(LOG10_RATIO[0]), float(LOG10_RATIO[-1])],
    }


def shader_constants() -> str:
    """The constants of `web/tone.glsl` as GLSL."""
    low, high = colour.BURNT_OUT_STOPS
    floats = {
        "MIDDLE_GREY": colour.MIDDLE_GREY,
        "CONTRAST": colour.PHOTOGRAPHIC_CONTRAST,
        "SATURATION": colour.PHOTOGRAPHIC_SATURATION,
        "EACH_CHANNEL": colour.PHOTOGRAPHIC_EACH_CHANNEL,
        "BURNT_FROM": low,
        "BURNT_TO": high,
        "BURNT_LEAK": colour.BURNT_OUT_LEAK,
        "MESOPIC_RATIO": MESOPIC_RATIO,
        "LOG10_PHOTOPIC_FROM": LOG10_PHOTOPIC[0],
        "LOG10_PHOTOPIC_TO": LOG10_PHOTOPIC[-1],
        "LOG10_RATIO_FROM": LOG10_RATIO[0],
        "LOG10_RATIO_TO": LOG10_RATIO[-1],
    }
    lines = [f"const float {name} = {float(value)!r};" for name, value in floats.items()]
    lines.append(f"const vec3 Y709 = {_vector(colour.REC709_LUMINANCE)};")
    lines.append(f"const vec3 NIGHT_BLUE = {_vector(tone.night_blue())};")
    columns = spectrum.xyz_to_rgb_matrix("cie1931_2deg").T
    lines.append(f"const mat3 RGB_OF_XYZ = mat3({', '.join(_vector(column) for column in columns)});")
    return "\n".join(lines) + "\n"


def _vector(values: np.ndarray) -> str:
    return f"vec3({', '.join(repr(float(v)) for v in values)})"
