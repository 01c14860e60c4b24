"""The numbers behind the page's tones, taken from their definitions in `twilight.sky.tone` and `twilight.sky.colour`.

The curve of a photograph and the gamut are formulas in `web/tone.glsl` with constants from here.  What an eye does is
tables over the logarithm of photopic luminance and of scotopic over photopic luminance.

What pages and films draw with: the channels of a tone, for light that is the sun's and light that is not.

A `SkyTable` of four channels as the two textures that `web/table.glsl` and `web/export/sky.wgsl` read.
"""

from typing import Any

import numpy as np

from twilight.io.view import DARKEST_FRACTION
from twilight.numerics import spectrum
from twilight.numerics.directions import PHASE_COUNT
from twilight.sky import colour, tone
from twilight.sky.quantities.measure import MESOPIC_RATIO, adaptation_coefficient
from twilight.sky.table import SkyTable
from twilight.sky.tone import Eye, Light, Tone

CHANNELS = 4
"""X, Y, Z and scotopic luminance."""


class Channels:
    """Channels of a tone for one set of wavelengths (W,) [nm] under one solar spectrum at 1 au.

    tone: `Eye`, whose channels X, Y, Z and scotopic luminance serve all tones of the eye's colours, or a `Camera`.
    """

    def __init__(
        self, wavelength_nm: np.ndarray, solar_spectrum: str = spectrum.DEFAULT_SOLAR_SPECTRUM, tone: Tone | None = None
    ):
        self.wavelength_nm = np.asarray(wavelength_nm, float)
        self.solar_irradiance = spectrum.solar_irradiance(self.wavelength_nm, solar_spectrum)
        self._tone = tone or Eye()
        self._light = Light(solar_spectrum, 1.0)

    def of(self, factor: np.ndarray) -> np.ndarray:
        """Channels (..., 4) [cd m^-2], the second of them luminance, of a radiance over F0 (..., W)."""
        return self._tone.see(factor, self.wavelength_nm, self._light)


NO_LIGHT = -200.0
"""Logarithm that stands for no light."""


def padded_columns(azimuth_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns with a mirrored one beyond either end [deg], and which column of the table each of them is."""
    n = azimuth_deg.size
    places = np.concatenate([-azimuth_deg[1:2], azimuth_deg, 360.0 - azimuth_deg[-2:-1]])
    return places, np.concatenate([[1], np.arange(n), [n - 2]])


def layers(table: SkyTable) -> np.ndarray:
    """S of every sun, then A of every sun, (2 S, R, C, 4) float32."""
    _, column = padded_columns(table.azimuth_deg)
    aureole = np.full_like(table.smooth, NO_LIGHT) if table.aureole is None else table.aureole
    return np.concatenate([table.smooth, aureole])[:, :, column].astype(np.float32)


def node_lines(table: SkyTable) -> np.ndarray:
    """Nodes of sun, row and column, and what refraction lifts the sun [deg]; then ln P: (2, PHASE_COUNT, 4) float32."""
    columns, _ = padded_columns(table.azimuth_deg)
    out = np.zeros((2, PHASE_COUNT, CHANNELS), np.float32)
    lift = table.apparent_sun_deg - table.sun_elevation_deg
    for axis, nodes in enumerate((table.sun_elevation_deg, table.elevation_deg, columns, lift)):
        out[0, : nodes.size, axis] = nodes
    if table.log_phase is not None:
        out[1] = table.log_phase
    return out


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
