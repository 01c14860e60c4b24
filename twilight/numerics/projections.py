"""Views: the direction of every pixel of a picture, by the name of its projection.

A view has its own axes, right, forward and up, turned by where it points (`twilight.numerics.directions.camera_axes`);
azimuths count clockwise from whatever the caller means by 0, for pictures of the sky from the sun.  A new projection
is one function that gives directions in its own axes for an `ImagePlane`, and its line in `PROJECTIONS`, which the
configuration, the command line and the pictures ask.

kind          shows                                             its middle          height
perspective   a pinhole camera, field of view across            where it points     any
fisheye       equidistant circle, field of view across          where it points     = width
latlong       the whole sphere, latitude-longitude              where it points     width / 2
panorama      all round, from the horizontal to the zenith      the azimuth         width / 4
octahedral    the whole sphere on a square (Meyer et al. 2010)  where it points     = width
cube          six faces as a cross: up over front over down,    where it points     3/4 width
              left, front, right and back in its middle row
cylinder      upright lines upright, field of view across       where it points     any
limb          a strip: azimuth across, elevation upwards        the azimuth         any
              between the edges of its band

`fisheye` and `octahedral` point to the zenith by default; azimuth_deg is then at the lower edge, as for
somebody who faces it and looks up.  `cylinder` is not tilted but shifted to the elevation in its middle, as a lens that
shifts does it; by default the horizon is at 0.86 of its height, and above it is the sky.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twilight.base.conventions import ROUNDING, TINY
from twilight.base.errors import TwilightError, check_known
from twilight.numerics.directions import azimuth_elevation, camera_axes

WHOLE = (-90.0, 90.0)
"""The band from the nadir to the zenith [deg]."""
CYLINDER_ELEVATION_DEG = 17.3
"""Of a cylinder's middle: the horizon is then at 0.86 of the height of 20 : 9, where `wide` has it."""
PERSPECTIVE_UP_DEG = 15.0
"""Elevation [deg] to which a pinhole camera that shows the sky looks by default: the horizon is in the lower part."""
LARGEST_SHIFT_DEG = 80.0
"""Elevations in the middle of a cylinder lie within this: it never holds the zenith."""


@dataclass(frozen=True)
class ImagePlane:
    """A picture's size in pixels, its field of view across [deg], the elevations of its lower and upper edge [deg].

    rows: the first that is wanted and the one after the last; None: all.  rise: tangent of the elevation in the middle
    of a picture that shifts.
    """

    width: int
    height: int
    field_deg: float
    band_deg: tuple[float, float]
    rows: tuple[int, int] | None = None
    rise: float = 0.0

    @property
    def span(self) -> tuple[int, int]:
        """The first row and the one after the last."""
        return self.rows or (0, self.height)

    @property
    def centres(self) -> tuple[np.ndarray, np.ndarray]:
        """(x, y) (rows, width) of pixel centres, -1 to 1 from left to right and from below to above."""
        x = 2.0 * (np.arange(self.width) + 0.5) / self.width - 1.0
        y = 1.0 - 2.0 * (np.arange(*self.span) + 0.5) / self.height
        shape = (y.size, self.width)
        return np.broadcast_to(x, shape), np.broadcast_to(y[:, None], shape)


PlaneDirections = Callable[[ImagePlane], np.ndarray]
"""Directions (rows, width, 3) right, forward, up in the view's own axes; NaN outside the view."""


@dataclass(frozen=True)
class Projection:
    """A projection.

    directions: in the view's own axes; aspect: width over height; free: whether other aspects are allowed;
    field_deg: usual field of view across the width [deg], at most largest_deg; elevation_deg: where it usually points;
    turns: whether it can be raised and rolled; shifts: whether it is raised by a shift, which leaves upright lines
    upright; banded: whether it is a strip between two elevations
    """

    directions: PlaneDirections
    aspect: float
    free: bool = False
    field_deg: float = 360.0
    largest_deg: float = 360.0
    elevation_deg: float = 0.0
    turns: bool = True
    shifts: bool = False
    banded: bool = False


def _perspective(frame: ImagePlane) -> np.ndarray:
    x, y = frame.centres
    half = np.tan(np.radians(0.5 * frame.field_deg))
    ray = np.stack([x * half, np.ones_like(x), y * half * frame.height / frame.width], axis=-1)
    return ray / np.linalg.norm(ray, axis=-1, keepdims=True)


def off_axis(x: np.ndarray, y: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Directions (..., 3) at the angle theta [rad] off forward, towards x (right) and y (up); NaN where theta is."""
    scale = np.sin(theta) / np.maximum(np.hypot(x, y), TINY)
    return np.stack([scale * x, np.cos(theta), scale * y], axis=-1)


def around(longitude: np.ndarray, latitude: np.ndarray) -> np.ndarray:
    """Directions (..., 3) at a longitude to the right of forward and a latitude above it [rad]."""
    flat = np.cos(latitude)
    return np.stack([flat * np.sin(longitude), flat * np.cos(longitude), np.sin(latitude)], axis=-1)


def _fisheye(frame: ImagePlane) -> np.ndarray:
    x, y = frame.centres
    radius = np.hypot(x, y)
    theta = np.where(radius <= 1.0, radius, np.nan) * np.radians(0.5 * frame.field_deg)
    return off_axis(x, y, theta)


def _latlong(frame: ImagePlane) -> np.ndarray:
    x, y = frame.centres
    return around(np.pi * x, 0.5 * np.pi * y)


def _panorama(frame: ImagePlane) -> np.ndarray:
    x, y = frame.centres
    return around(np.pi * x, 0.25 * np.pi * (y + 1.0))


def _cylinder(frame: ImagePlane) -> np.ndarray:
    x, y = frame.centres
    half = np.radians(0.5 * frame.field_deg)
    return around(half * x, np.arctan(frame.rise + half * y * frame.height / frame.width))


def _octahedral(frame: ImagePlane) -> np.ndarray:
    x, y = frame.centres
    forward = 1.0 - np.abs(x) - np.abs(y)
    fold = np.maximum(-forward, 0.0)  # the half behind is folded outwards over the square's edges
    right, up = x - np.copysign(fold, x), y - np.copysign(fold, y)
    ray = np.stack([right, forward, up], axis=-1)
    return ray / np.linalg.norm(ray, axis=-1, keepdims=True)


def _limb(frame: ImagePlane) -> np.ndarray:
    x, y = frame.centres
    low, high = frame.band_deg
    return around(np.radians(0.5 * frame.field_deg) * x, np.radians(low + 0.5 * (y + 1.0) * (high - low)))


_FACES = {(1, 0): "up", (0, 1): "left", (1, 1): "front", (2, 1): "right", (3, 1): "back", (1, 2): "down"}
"""Place (column, row) of each face in the cross."""


def cube_face(face: str, size: int, rows: tuple[int, int] | None = None) -> np.ndarray:
    """Directions (size, size, 3) right, forward, up of one face of a cube seen from inside: up, left, front, right,
    back or down; the lower edge of `up` and the upper edge of `down` join `front`.  rows: as of
    `ImagePlane`."""
    x, y = ImagePlane(size, size, 90.0, WHOLE, rows).centres
    unity = np.ones_like(x)
    ray = {
        "front": (x, unity, y),
        "right": (unity, -x, y),
        "back": (-x, -unity, y),
        "left": (-unity, x, y),
        "up": (x, -y, unity),
        "down": (x, y, -unity),
    }[face]
    own = np.stack(ray, axis=-1)
    return own / np.linalg.norm(own, axis=-1, keepdims=True)


def _cube(frame: ImagePlane) -> np.ndarray:
    size = frame.width // 4
    first, stop = frame.span
    out = np.full((stop - first, 4 * size, 3), np.nan)
    for (column, row), face in _FACES.items():
        low, high = max(first, row * size), min(stop, (row + 1) * size)
        if low < high:
            part = cube_face(face, size, (low - row * size, high - row * size))
            out[low - first : high - first, column * size : (column + 1) * size] = part
    return out


PROJECTIONS: dict[str, Projection] = {
    "perspective": Projection(_perspective, 16 / 9, free=True, field_deg=60.0, largest_deg=170.0),
    "cylinder": Projection(
        _cylinder, 20 / 9, free=True, field_deg=110.0, elevation_deg=CYLINDER_ELEVATION_DEG, shifts=True
    ),
    "fisheye": Projection(_fisheye, 1.0, field_deg=180.0, elevation_deg=90.0),
    "latlong": Projection(_latlong, 2.0),
    "panorama": Projection(_panorama, 4.0, turns=False),
    "octahedral": Projection(_octahedral, 1.0, elevation_deg=90.0),
    "cube": Projection(_cube, 4 / 3),
    "limb": Projection(_limb, 8.0, free=True, turns=False, banded=True),
}
"""Every projection by its name."""


def usual_width(name: str) -> int:
    """Width of a picture of the sky [pixels]: 1600 where it is wider than high, else 1024."""
    return 1600 if projection_of(name).aspect > 1.0 else 1024


def projection_of(name: str) -> Projection:
    """The projection of this name; TwilightError for another one."""
    check_known("view", name, PROJECTIONS)
    return PROJECTIONS[name]


def shape_of(name: str, width: int, height: int | None = None) -> tuple[int, int]:
    """(height, width) [pixels] of a view; TwilightError for a size that it cannot have."""
    kind = projection_of(name)
    usual = round(width / kind.aspect)
    if not kind.free and (width < 4 or abs(usual * kind.aspect - width) > ROUNDING or (height or usual) != usual):
        got = f"{width}" if height is None else f"{width} x {height}"
        raise TwilightError(
            f"width: a view {name} is {kind.aspect:.4g} times as wide as high, 4 pixels or more; got {got}"
        )
    if width < 2 or (height or usual) < 1:
        raise TwilightError(f"width: a view {name} needs 2 pixels at least, got {width} x {height or usual}")
    return height or usual, width


def view_rays(
    name: str,
    width: int,
    height: int | None = None,
    *,
    field_of_view_deg: float | None = None,
    azimuth_deg: float = 0.0,
    elevation_deg: float | None = None,
    roll_deg: float = 0.0,
    band_deg: tuple[float, float] | None = None,
    rows: tuple[int, int] | None = None,
) -> np.ndarray:
    """Unit vectors (height, width, 3) of the pixel centres: to azimuth 90 deg, to azimuth 0, up; NaN outside the view.

    width, height: in pixels, height unset: as the projection has it.  field_of_view_deg: across the width.
    azimuth_deg, elevation_deg, roll_deg: where it points, as `camera_axes`; unset: as the projection has it.
    band_deg: elevations of the lower and upper edge of a strip; unset: -90 and 90.
    rows: the first that is wanted and the one after the last, unset: all; a large picture is made of parts.
    Raises TwilightError for an unknown projection, a size or a field of view that it cannot have.
    """
    kind = projection_of(name)
    high, wide = shape_of(name, width, height)
    field = kind.field_deg if field_of_view_deg is None else float(field_of_view_deg)
    if not 0.0 < field <= kind.largest_deg:
        raise TwilightError(
            f"field_of_view_deg: {field:g} is not allowed for a view {name}, above 0 to {kind.largest_deg:g} is"
        )
    if not kind.turns and (elevation_deg or roll_deg):
        raise TwilightError(f"elevation_deg: a view {name} is level; elevation_deg and roll_deg have no meaning there")
    if not kind.banded and band_deg is not None:
        raise TwilightError(f"band_deg: a view {name} has no band")
    band = WHOLE if band_deg is None else band_deg
    if not -90.0 <= band[0] < band[1] <= 90.0:
        raise TwilightError(f"band_deg: {band[0]:g} to {band[1]:g} must rise within -90 to 90")
    up = kind.elevation_deg if elevation_deg is None else float(elevation_deg)
    rise = 0.0
    if kind.shifts:
        if abs(up) > LARGEST_SHIFT_DEG:
            raise TwilightError(
                f"elevation_deg: {up:g} is not allowed for a view {name}, -{LARGEST_SHIFT_DEG:g} to "
                f"{LARGEST_SHIFT_DEG:g} is"
            )
        rise, up = float(np.tan(np.radians(up))), 0.0
    return kind.directions(ImagePlane(wide, high, field, band, rows, rise)) @ camera_axes(azimuth_deg, up, roll_deg)


def view_directions(name: str, width: int, height: int | None = None, **pointing) -> tuple[np.ndarray, np.ndarray]:
    """(elevation_deg, azimuth_deg in [0, 360)) (height, width) of the pixel centres; arguments as `view_rays`."""
    azimuth, elevation = azimuth_elevation(view_rays(name, width, height, **pointing))
    return elevation, azimuth
