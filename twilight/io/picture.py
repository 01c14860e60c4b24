"""``sky.png``: the sky over the horizon, the sun's azimuth in the middle; its polarisation; 8-bit display values."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from twilight.base.errors import TwilightError, check_known
from twilight.base.whole_files import whole_file, write_json
from twilight.io.disc import add_to_picture, dip_deg, light_of
from twilight.io.environment import ground_factor
from twilight.io.provenance import provenance_fields
from twilight.io.rendered import Options, Rendered
from twilight.numerics import projections
from twilight.numerics.projections import PERSPECTIVE_UP_DEG, PROJECTIONS, usual_width
from twilight.sky import colour
from twilight.sky.quantities.measure import adaptation_coefficient
from twilight.sky.sky import Sky
from twilight.sky.tone import NAMES, Shot, Tone, tone_of

VIEWS: tuple[str, ...] = ("wide", "panorama", "fisheye")
DEFAULT_VIEW = "wide"
DEFAULT_WIDTH = {"wide": 1600, "panorama": 1440, "fisheye": 720}
"""Width of each view [pixels]."""
SHAPES = (*VIEWS, *(name for name in PROJECTIONS if name not in VIEWS))
"""All shapes that a sky's own grid is drawn in."""
FACING = ("wide", "perspective", "cylinder")
"""Those that show a part of the sky about the sun's azimuth: they are exposed for what they show."""
WIDE_FIELD_DEG = 110.0
"""Horizontal field of view of the wide picture: that of the eyes' common field."""
WIDE_HORIZON = 0.86
"""Where the horizon lies, as a fraction of the height from above."""
WIDE_EXPOSURE_STEPS = -0.3
"""Stops that the wide picture is given less (or more, negative) light than the meter says."""
WIDE_DIP_DEG = 3.0
"""A horizon that dips by more [deg] is drawn at this height of the wide picture, which then looks down."""
GROUND_SEEN_UP_TO_KM = 0.1
"""Observers no higher above the sphere see its ground from 0 deg down: the dip of the horizon is 0.3 deg at most."""


def view_directions(view: str, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Elevation and azimuth relative to the sun [deg] of the pixel centres of a picture.

    ``wide``: a cylinder, width x 9/20 width, 110 deg from side to side, the sun's azimuth in the middle, vertical lines
    straight, the horizon at 0.86 of the height; (height, 1) and (1, width).
    ``panorama``: width x width / 4, horizon below, zenith above, the sun's azimuth in the middle, clockwise to the
    right; (height, 1) and (1, width).  ``fisheye``: width x width, equidistant, the zenith in the middle, the sun's
    azimuth at the bottom, clockwise to the right (what one sees who faces the sun and looks up); outside the circle
    the elevation is negative.  Others: of ``twilight.numerics.projections``, (height, width), NaN outside; a
    ``perspective`` looks 15 deg up and a ``limb`` strip begins at the horizon.  Raises TwilightError for another view
    or size.
    """
    check_known("view", view, SHAPES)
    if view not in VIEWS:
        pointing: dict[str, Any] = {"perspective": {"elevation_deg": PERSPECTIVE_UP_DEG}}
        pointing["limb"] = {"band_deg": (0.0, 90.0)}
        return projections.view_directions(view, width, **pointing.get(view, {}))
    if width < 4 or width % 4:
        raise TwilightError(f"width: {width} must be a positive multiple of 4")
    if view == "wide":
        height = 9 * width // 20
        pixels_per_radian = width / np.radians(WIDE_FIELD_DEG)
        elevation = np.degrees(np.arctan((WIDE_HORIZON * height - np.arange(height) - 0.5) / pixels_per_radian))
        azimuth = WIDE_FIELD_DEG * ((np.arange(width) + 0.5) / width - 0.5)
        return elevation[:, None], azimuth[None, :]
    if view == "panorama":
        elevation = 90.0 - 360.0 * (np.arange(width // 4) + 0.5) / width
        azimuth = 360.0 * (np.arange(width) + 0.5) / width - 180.0
        return elevation[:, None], azimuth[None, :]
    centre = 2 * (np.arange(width) + 0.5) / width - 1
    down, right = np.meshgrid(centre, centre, indexing="ij")
    return 90.0 * (1.0 - np.hypot(right, down)), np.degrees(np.arctan2(right, down))


def width_of(view: str) -> int:
    """Width of a view's picture [pixels], where none is given."""
    if view in DEFAULT_WIDTH or view not in PROJECTIONS:
        return DEFAULT_WIDTH.get(view, 4)
    return usual_width(view) // 2


def check_options(exposure: float | Literal["auto"], tone_mapping: str, observer: str) -> None:
    """Raise TwilightError for an exposure, a tone mapping or an observer that cannot be."""
    if exposure != "auto" and not (isinstance(exposure, int | float | np.number) and np.isfinite(exposure)):
        raise TwilightError(f"exposure: {exposure} must be 'auto' or a finite exposure value at ISO 100")
    check_known("tone_mapping", tone_mapping, NAMES)
    colour.check_observer(observer)


def render_view(
    sky: Sky,
    *,
    view: str = DEFAULT_VIEW,
    width: int | None = None,
    exposure: float | Literal["auto"] = "auto",
    tone_mapping: str = colour.DEFAULT_TONE_MAPPING,
    observer: str = colour.DEFAULT_OBSERVER,
    azimuth_deg: float = 0.0,
) -> tuple[np.ndarray, float]:
    """A picture of a sky, sRGB values 0 to 1 (height, width, 3), NaN outside the circle of a fisheye, and its EV100.

    azimuth_deg: from the sun, of the middle of the picture (of a fisheye: of its lower edge); other arguments and
    errors: as of `write_png`.
    """
    check_options(exposure, tone_mapping, observer)
    tone = tone_of(tone_mapping, observer)
    display, ev100, _ = develop_view(sky, tone, view=view, width=width, exposure=exposure, azimuth_deg=azimuth_deg)
    return display, ev100


def develop_view(
    sky: Sky,
    tone: Tone,
    *,
    view: str = DEFAULT_VIEW,
    width: int | None = None,
    exposure: float | Literal["auto"] = "auto",
    azimuth_deg: float = 0.0,
) -> tuple[np.ndarray, float, dict[str, float | str]]:
    """Display values 0..1 (height, width, 3), the EV100 of the meter, and what the tone set or found.

    What the tone sees of the sky's grid is interpolated smoothly (``Sky.smooth``), then developed.  ``auto`` exposes
    the pictures of ``FACING`` for the part of the sky that they show, the others for the whole sky
    (``colour.auto_exposure_ev100``).  Below the horizon, where a picture has one, is the lit Lambertian ground without
    the air before it.  The wide picture, seen from high up, where the sky's rows go below the horizontal, shows the
    horizon that dips and the ground through the air, and looks down by what the horizon dips beyond 3 deg; a sky that
    ends at 0 deg ends the picture there.
    """
    elevation, azimuth = view_directions(view, width_of(view) if width is None else width)
    azimuth = azimuth + azimuth_deg
    lower = float(sky.elevation_edges_deg[0])
    outside = np.isnan(elevation)
    elevation, azimuth = np.where(outside, -90.0, elevation), np.nan_to_num(azimuth)
    if view == "wide" and lower < 0.0:
        elevation = np.maximum(elevation - max(0.0, dip_deg(sky) - WIDE_DIP_DEG), -90.0)
    elif view == "wide" and sky.observer_altitude_km > GROUND_SEEN_UP_TO_KM:
        elevation = elevation[elevation[:, 0] > 0.0]
    responses = tone.see(sky.normalised_radiance, sky.wavelength_nm, light_of(sky))
    picture = sky.smooth(responses, np.maximum(elevation, lower), azimuth)
    if exposure != "auto":
        ev100 = float(exposure)
    elif view in FACING:
        shown = picture[np.broadcast_to(elevation > min(lower, 0.0), picture.shape[:2])][:, 1]
        ev100 = colour.auto_exposure_ev100(shown, None, tone.highlights_over_mean) + WIDE_EXPOSURE_STEPS
    else:
        weight = sky.solid_angle_sr()
        ev100 = colour.auto_exposure_ev100(responses[..., 1], weight, tone.highlights_over_mean)
    if view not in ("panorama", "fisheye"):
        ground = tone.see(ground_factor(sky), sky.wavelength_nm, light_of(sky))
        picture[np.broadcast_to(elevation <= lower, picture.shape[:2])] = ground
    steps_deg = np.abs(np.diff(elevation[:, elevation.shape[1] // 2]))
    add_to_picture(sky, picture, elevation, azimuth, tone)
    pixel_deg = float(steps_deg.max(initial=0.0) if view in VIEWS else np.median(steps_deg))
    if view == "fisheye":
        outside = elevation < 0
    if outside.any():
        picture[outside] = 0.0
    display, facts = tone.develop(picture, Shot(ev100, pixel_deg))
    if outside.any():
        display[outside] = np.nan
    return display, ev100, facts


def label_of(sky: Sky) -> str:
    """One line under a picture: the sun, the climate, the luminance of the zenith."""
    climate = (sky.provenance.get("configuration") or {}).get("climate") or {}
    zenith = float(sky.luminance()[-1].mean())
    parts = [f"sun {sky.sun_elevation_deg:+.1f}°", climate.get("name"), f"zenith {zenith:.3g} cd/m^2"]
    return "   ".join(str(part) for part in parts if part)


def _write_label(pixels: np.ndarray, text: str) -> np.ndarray:
    """The picture with a line of text in its lower left corner, light on dark or dark on light."""
    from PIL import Image, ImageDraw, ImageFont  # start-up

    size = max(10, pixels.shape[1] // 80)
    image = Image.fromarray(pixels)
    corner = pixels[-2 * size :, : 20 * size].mean()
    shade = 190 if corner < 110 else 40
    where = (size, pixels.shape[0] - 2 * size)
    ImageDraw.Draw(image).text(where, text, fill=(shade,) * 3, font=ImageFont.load_default(size))
    return np.asarray(image)


def write_png(
    sky: Sky,
    path: str | Path,
    *,
    view: str = DEFAULT_VIEW,
    width: int | None = None,
    exposure: float | Literal["auto"] = "auto",
    tone_mapping: str = colour.DEFAULT_TONE_MAPPING,
    observer: str = colour.DEFAULT_OBSERVER,
    label: bool = False,
    tone_settings: Mapping[str, Mapping[str, Any]] | None = None,
) -> Path:
    """Write a picture of the sky as 8 bit sRGB PNG, whole or not at all; the provenance is in its text chunks.

    view: what it shows, `wide`, `panorama` or `fisheye` (`view_directions`); width: of the picture [pixel], None: as
    `DEFAULT_WIDTH` says.
    exposure: value at ISO 100 as on a camera (15: sunlit scene, -3: deep twilight), one step a factor 2, or ``auto``;
    the value used is in the text chunk ``exposure_ev100``, for the other pictures of a sequence.
    tone_mapping, tone_settings: name of a tone of `twilight.sky.tone` and its settings; what the tone set or found is
    in the text chunks.  observer: colour matching functions, a name of `twilight.numerics.spectrum.OBSERVERS`.
    label: whether sun, climate and zenith luminance are written into the lower left corner (`label_of`).
    Errors: TwilightError for unknown options, and a file that cannot be written.
    """
    check_options(exposure, tone_mapping, observer)
    tone = tone_of(tone_mapping, observer, tone_settings)
    picture, ev100, tone_facts = develop_view(sky, tone, view=view, width=width, exposure=exposure)
    facts = {
        "view": view,
        "exposure_ev100": ev100,
        "tone_mapping": tone_mapping,
        "colour": colour.colour_note(sky, observer),
        **tone_facts,
    }
    return save_png(picture, path, sky, facts, label_of(sky) if label else "")


def save_png(
    picture: np.ndarray, path: str | Path, sky: Sky, facts: Mapping[str, str | float], label: str = ""
) -> Path:
    """Write display values 0..1 (height, width, 3), NaN transparent, as 8 bit sRGB PNG, whole or not at all.

    facts: text chunks, numbers with six digits, beside those of the sky's provenance; label: a line of text for the
    lower left corner.
    """
    outside = np.isnan(picture[..., 0])
    pixels = to_bytes(picture)
    if label:
        pixels = _write_label(pixels, label)
    if outside.any():
        pixels = np.dstack([pixels, np.where(outside, 0, 255).astype(np.uint8)])
    return save_pixels(pixels, path, sky, facts)


def save_pixels(pixels: np.ndarray, path: str | Path, sky: Sky, facts: Mapping[str, str | float]) -> Path:
    """Write 8 bit sRGB (height, width, 3), or 4 with alpha, as PNG, whole or not at all; facts as of `save_png`."""
    from PIL import Image  # start-up
    from PIL.PngImagePlugin import PngInfo  # start-up

    info = PngInfo()
    info.add(b"sRGB", b"\x00")
    texts = {
        "Software": "twilight",
        "sun_elevation_deg": f"{sky.sun_elevation_deg:g}",
        **{name: value if isinstance(value, str) else f"{value:.6g}" for name, value in facts.items()},
        **{name: str(value) for name, value in provenance_fields(sky.provenance).items()},
    }
    for name, value in texts.items():
        info.add_itxt(name, value, zip=len(value) > 1000)
    with whole_file(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", pnginfo=info, compress_level=4)
    return Path(path)


def write_pictures(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """The first of the views as ``sky.png``, others as ``sky.VIEW.png``; ``sky.luminance.json`` beside those that show
    no luminances (the tones ``eye`` and ``camera``)."""
    written = [
        write_png(
            rendered.seen,
            folder / (f"sky.{view}.png" if i else "sky.png"),
            view=view,
            exposure=options.exposure,
            tone_mapping=options.tone_mapping,
            observer=options.observer,
            label=view == "wide",
            tone_settings=options.tone_settings,
        )
        for i, view in enumerate(options.views)
    ]
    if options.tone_mapping not in colour.TONE_MAPPINGS:
        written.append(write_luminances(rendered.seen, folder / "sky.luminance.json", options))
    return written


def write_luminances(sky: Sky, path: Path, options: Options) -> Path:
    """The luminances behind a picture as JSON, whole or not at all: photopic, scotopic and mesopic (CIE 191:2010)
    [cd m^-2] at the zenith and at 10 deg towards the sun, across and opposite, and what the tone set or found."""
    tone = tone_of(options.tone_mapping, options.observer, options.tone_settings)
    _, ev100, tone_facts = develop_view(sky, tone, view=options.views[0], width=400, exposure=options.exposure)
    eye = tone_of("eye", options.observer)
    responses = eye.see(sky.normalised_radiance, sky.wavelength_nm, light_of(sky))
    where = {"zenith": (90.0, 0.0), "sun": (10.0, 0.0), "right": (10.0, 90.0), "opposite": (10.0, 180.0)}
    elevation, azimuth = np.array(list(where.values())).T
    photopic, scotopic = np.moveaxis(sky.smooth(responses, elevation, azimuth)[..., [1, 3]], -1, 0)
    _, mesopic = adaptation_coefficient(photopic, scotopic)
    facts: dict[str, Any] = {
        "tone": options.tone_mapping,
        "exposure_ev100": ev100,
        **tone_facts,
        "luminance_cd_per_m2": {
            name: {"photopic": float(photopic[i]), "scotopic": float(scotopic[i]), "mesopic": float(mesopic[i])}
            for i, name in enumerate(where)
        },
        "sky_illuminance_lux": sky.illuminance_lux(),
    }
    return write_json(path, facts)


MAX_CACHED_VALUES = 1 << 23
"""The noise of pictures with more values is not cached."""
ROWS_AT_ONCE = 64
"""Rows that are worked on at the same time: each step has copies of its own."""


def to_bytes(picture: np.ndarray, first_row: int = 0) -> np.ndarray:
    """Display values 0..1 (height, width, K) as 8 bits, dithered by one step so that a smooth sky shows no bands.

    The mean over a few pixels is the value itself.  The noise is interleaved gradient noise (Jimenez 2014, Next
    generation post processing in Call of Duty), another part of it for each channel, so that the noise is grey in the
    mean and not in every pixel; it is fixed: equal skies give equal files.  NaN is black.  first_row: of the
    whole picture, where this is a part of it.
    """
    make_noise = _cached_noise if picture.size <= MAX_CACHED_VALUES else _noise
    noise = make_noise(picture.shape, first_row)
    out = np.empty(picture.shape, np.uint8)
    for first in range(0, len(picture), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        out[rows] = np.clip(np.floor(np.nan_to_num(picture[rows]) * 255.0 + noise[rows]), 0, 255)
    return out


def _noise(shape: tuple[int, ...], first_row: int) -> np.ndarray:
    height, width, channels = shape
    x, shift = np.arange(float(width)), 5.588238 * np.arange(channels)
    out = np.empty(shape)
    for first in range(0, height, ROWS_AT_ONCE):
        y = np.arange(float(first), float(min(first + ROWS_AT_ONCE, height)))[:, None, None]
        phase = 0.06711056 * (x[:, None] + shift) + 0.00583715 * (y + first_row + shift)
        steps = 52.9829189 * (phase - np.floor(phase))
        out[first : first + ROWS_AT_ONCE] = steps - np.floor(steps)
    return out


@lru_cache(maxsize=1)
def _cached_noise(shape: tuple[int, ...], first_row: int) -> np.ndarray:
    """The pictures of a film have the same noise."""
    noise = _noise(shape, first_row)
    noise.flags.writeable = False
    return noise


WIDTH = 400
"""Width and height of a map of the whole sky [pixel]; beside it BAR_WIDTH of the scale, its numbers, and MARGIN."""
BAR_WIDTH = 14
"""Width of the colour bars [pixel]."""
NUMBERS_WIDTH = 40
"""Width of the numbers beside the bars [pixel]."""
MARGIN = 12
"""Between the parts of the picture [pixel]."""
TITLE_HEIGHT = 24
"""Height of the titles [pixel]."""
FONT_SIZE = 13
"""Height of titles and numbers [pixel]."""
WAVELENGTH_NM = 550.0
"""Wavelength that is drawn: the sky's nearest to it [nm]."""
VIRIDIS = (
    "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c "
    "1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725"
)
TWILIGHT = (
    "e2d9e2 c4ced4 95b5c7 7297c1 6276ba 5e51ad 592a8f 45135c 2f1436 "
    "4a1342 741e4f 983550 b25652 c27c63 cca389 d8c7be e2d9e2"
)
"""Matplotlib's colour maps of these names (public domain, CC0) at 17 places, between which straight lines are within 6
of 255 of them: one for quantities that grow, and one for angles, whose ends are one."""


def polarisation_maps(sky: Sky, width: int = WIDTH) -> tuple[np.ndarray, np.ndarray, float]:
    """Degree and angle [deg] of linear polarisation as fisheye pictures (``io.picture.view_directions``), (width,
    width) each, NaN outside the circle; and their wavelength [nm], the sky's nearest to 550.

    Errors: TwilightError for a sky without Stokes parameters.
    """
    elevation, azimuth = view_directions("fisheye", width)
    w = int(np.argmin(np.abs(sky.wavelength_nm - WAVELENGTH_NM)))
    above = elevation >= 0.0
    q, u = sky.sample_fractional_stokes(elevation[above], azimuth[above], slice(w, w + 1))[..., 0].T
    degree, angle = np.full(above.shape, np.nan), np.full(above.shape, np.nan)
    degree[above], angle[above] = np.hypot(q, u), 0.5 * np.degrees(np.arctan2(u, q))
    return degree, angle, float(sky.wavelength_nm[w])


def write_polarisation_png(sky: Sky, path: str | Path) -> Path:
    """Draw the whole sky, the zenith in the middle and the sun's azimuth at the bottom: degree, and angle of vibration.

    The file is written whole or not at all.  Errors: TwilightError for a sky without Stokes parameters.
    """
    from PIL import Image, ImageDraw, ImageFont  # start-up

    degree, angle, wavelength = polarisation_maps(sky)
    shown = (
        (degree, VIRIDIS, np.linspace(0.0, 1.0, 6), "degree of linear polarisation"),
        (angle, TWILIGHT, np.linspace(-90.0, 90.0, 7), "angle of vibration from the vertical, clockwise [deg]"),
    )
    panel = WIDTH + BAR_WIDTH + NUMBERS_WIDTH + 2 * MARGIN
    image = Image.new("RGB", (MARGIN + 2 * panel, 2 * TITLE_HEIGHT + WIDTH + 2 * MARGIN), "white")
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(FONT_SIZE)
    above = f"sun at {sky.sun_elevation_deg:g} deg (its azimuth below), {wavelength:g} nm"
    draw.text((0.5 * image.width, MARGIN), above, fill="black", font=font, anchor="ma")
    top = MARGIN + 2 * TITLE_HEIGHT
    for i, (values, colours, ticks, title) in enumerate(shown):
        left = MARGIN + i * panel
        draw.text((left + 0.5 * WIDTH, MARGIN + TITLE_HEIGHT), title, fill="black", font=font, anchor="ma")
        fraction = (values - ticks[0]) / (ticks[-1] - ticks[0])
        image.paste(Image.fromarray(_coloured(fraction, colours)), (left, top))
        bar = np.broadcast_to(1.0 - (np.arange(WIDTH)[:, None] + 0.5) / WIDTH, (WIDTH, BAR_WIDTH))
        right = left + WIDTH + MARGIN
        image.paste(Image.fromarray(_coloured(bar, colours)), (right, top))
        for k, tick in enumerate(ticks):
            y = top + round((WIDTH - 1) * (1.0 - k / (ticks.size - 1)))
            draw.line((right + BAR_WIDTH, y, right + BAR_WIDTH + 3, y), fill="black")
            draw.text((right + BAR_WIDTH + 6, y), f"{tick:g}", fill="black", font=font, anchor="lm")
    return save_pixels(np.asarray(image), path, sky, {"wavelength_nm": wavelength})


def _coloured(fraction: np.ndarray, colours: str) -> np.ndarray:
    """sRGB (H, W, 3), 8 bit, of fractions 0..1 (H, W) of a colour map; white where there is none."""
    knots = np.array([[int(colour[i : i + 2], 16) for i in (0, 2, 4)] for colour in colours.split()])
    places = np.linspace(0.0, 1.0, len(knots))
    rgb = np.stack([np.interp(np.nan_to_num(fraction), places, knots[:, c]) for c in range(3)], axis=-1)
    return np.where(np.isnan(fraction)[..., None], 255, np.round(rgb)).astype(np.uint8)


def write_polarisation(rendered: Rendered, folder: Path, options: Options) -> list[Path]:
    """``sky.polarisation.png``."""
    return [write_polarisation_png(rendered.sky, folder / "sky.polarisation.png")]
