"""The geometric model of a camera: from directions to pixels and back.

Pixel positions are (x, y): x to the right, y down, in pixels from the upper left *corner* of the picture, so that the
centre of the pixel in column c and row r is (c + 0.5, r + 0.5) and the picture spans 0..width_px, 0..height_px.
Directions are unit vectors east, north, up; where the camera's azimuth is unknown, "north" is where it points.

A picture shows the sky as seen from inside: facing south, east is on the left; ``mirrored`` swaps left and right.
A latitude-longitude picture is a whole sphere, twice as wide as high: its rows are parallels, its upper edge is 90 deg
"above" the centre, and its centre is the "optical axis": with elevation and roll 0 the middle row is the horizontal,
and azimuth_deg is the azimuth of its centre; azimuths grow to the right.

`camera.yaml`: read, and written whole or not at all.

Radial projections of lenses: ``u`` is the radius that the named projection gives for the focal length 1 at the angle
theta off the optical axis, ``v`` the same after distortion; the radius in the image is the focal length in pixels times
``v``::

    equidistant     u = theta              0 <= theta <= pi
    equisolid       u = 2 sin(theta / 2)   0 <= theta <= pi
    stereographic   u = 2 tan(theta / 2)   0 <= theta < pi
    orthographic    u = sin(theta)         0 <= theta <= pi/2
    perspective     u = tan(theta)         0 <= theta < pi/2

    v = u (1 + k1 u^2 + k2 u^4 + ...)

For ``perspective`` the polynomial is Brown's radial distortion (Brown 1966, Photogrammetric Engineering 32), for
``equidistant`` that of Kannala and Brandt (2006, IEEE PAMI 28); both as OpenCV's models of the same names have it.
It is used up to its first maximum only, beyond which one radius would stand for two angles.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import Field, model_validator

from twilight.base.conventions import ROUNDING
from twilight.base.document import read_yaml
from twilight.base.errors import TwilightError
from twilight.base.sections import Flag, Integer, Number, Origins, Section, key, validate
from twilight.base.whole_files import whole_file
from twilight.numerics.directions import azimuth_elevation, camera_axes
from twilight.numerics.projections import around, off_axis

Projection = Literal["equidistant", "equisolid", "stereographic", "orthographic", "perspective", "latlong"]
LARGEST_PIXELS = 100_000
"""Largest width and height of a picture."""
LARGEST_FIELD = 1e3
"""Largest radius of a picture in focal lengths: for `perspective` 0.1 deg less than a half space."""


class ImageSize(Section):
    """Size of the picture."""

    width_px: Integer = Field(description="width", ge=2, le=LARGEST_PIXELS, json_schema_extra={"unit": "px"})
    height_px: Integer = Field(description="height", ge=2, le=LARGEST_PIXELS, json_schema_extra={"unit": "px"})


class Lens(Section):
    """What a lens does besides its projection; nothing of it for a latitude-longitude picture, except `mirrored`."""

    focal_length_px: Number | None = key(None, "focal length", unit="px", gt=0.0, le=1e7)
    focal_length_mm: Number | None = key(None, "focal length; needs sensor_width_mm", unit="mm", gt=0.0, le=1e5)
    sensor_width_mm: Number | None = key(None, "width of the sensor behind the picture", unit="mm", gt=0.0, le=1e4)
    field_of_view_deg: Number | None = key(
        None, "full angle across the picture's width, or across image_circle_px", unit="deg", gt=0.0, le=360.0
    )
    image_circle_px: Number | None = key(
        None, "diameter of the circle about the principal point outside which the lens shows nothing", unit="px", gt=0.0
    )
    principal_point_px: tuple[Number, ...] | None = key(
        None, "x and y of the optical axis from the upper left corner; unset: the middle of the picture",
        unit="px", min_length=2, max_length=2,
    )  # fmt: skip
    distortion: tuple[Number, ...] = key(
        (), "k1, k2, ... of v = u (1 + k1 u^2 + k2 u^4 + ...), u = radius / focal length", unit="1", max_length=4
    )
    vignetting: tuple[Number, ...] = key(
        (), "a1, a2, ... of the relative illumination 1 + a1 t^2 + a2 t^4 + ..., t = angle off the axis in rad",
        unit="1", max_length=6,
    )  # fmt: skip
    natural_vignetting: Flag = key(False, "multiply the illumination by cos^4 of the angle off the axis (perspective)")
    mirrored: Flag = key(
        False, "left and right are swapped, as in a picture of a mirror or a sky chart seen from outside"
    )

    @model_validator(mode="after")
    def _one_focal_length(self) -> Lens:
        given = [n for n in ("focal_length_px", "focal_length_mm", "field_of_view_deg") if getattr(self, n) is not None]
        if len(given) > 1:
            raise ValueError(f"takes only one of {', '.join(given)}")
        if (self.focal_length_mm is None) != (self.sensor_width_mm is None):
            raise ValueError("takes focal_length_mm and sensor_width_mm together")
        return self


class Orientation(Section):
    """Where the optical axis, or the centre of a latitude-longitude picture, points."""

    azimuth_deg: Annotated[Number, Field(ge=-360.0, le=360.0)] | None = key(
        None, "clockwise from north; null: unknown", unit="deg"
    )
    elevation_deg: Number = key(0.0, "above the horizontal", unit="deg", ge=-90.0, le=90.0)
    roll_deg: Number = key(
        0.0, "the camera is turned clockwise about its axis, seen from behind it", unit="deg", ge=-180.0, le=180.0
    )


class CameraModel(Section):
    """A camera as `camera.yaml` describes it; see the module for conventions."""

    version: Literal[1] = key(1, "version of this format")
    projection: Projection = Field(description="projection of the lens or of the picture")
    image: ImageSize = Field(description="size of the picture")
    lens: Lens = key(Lens, "focal length, distortion, vignetting")
    orientation: Orientation = key(Orientation, "where the camera points")
    response: Number | str = key(
        "linear", "linear, srgb, the exponent of a gamma curve, or the path of a CSV file with the response curve"
    )
    calibration: dict[str, Any] | None = key(None, "how the camera was calibrated; written by the program, not read")

    @model_validator(mode="after")
    def _consistent(self) -> CameraModel:
        lens, image = self.lens, self.image
        if isinstance(self.response, str) and not self.response:
            raise ValueError("response must not be empty")
        if not isinstance(self.response, str) and not 0.1 <= self.response <= 10.0:
            raise ValueError(f"response must be an exponent from 0.1 to 10, got {self.response:g}")
        if self.projection == "latlong":
            set_keys = [n for n in Lens.model_fields if n != "mirrored" and getattr(lens, n) not in (None, (), False)]
            if set_keys:
                raise ValueError(f"lens.{set_keys[0]} has no meaning for the projection latlong")
            if image.width_px != 2 * image.height_px:
                raise ValueError(
                    "image.width_px must be twice image.height_px for latlong, "
                    f"got {image.width_px} and {image.height_px}"
                )
            return self
        if lens.focal_length_px is None and lens.focal_length_mm is None and lens.field_of_view_deg is None:
            raise ValueError(
                f"lens needs focal_length_px, focal_length_mm or field_of_view_deg for the projection {self.projection}"
            )
        if lens.natural_vignetting and self.projection != "perspective":
            raise ValueError("lens.natural_vignetting is for the projection perspective; use lens.vignetting")
        if lens.field_of_view_deg is not None:
            half = np.radians(0.5 * lens.field_of_view_deg)
            u = float(ideal_radius(self.projection, np.sin(half), np.cos(half)))
            if not 0.0 < u <= min(largest_radius(self.projection, lens.distortion), LARGEST_FIELD):
                raise ValueError(
                    f"lens.field_of_view_deg {lens.field_of_view_deg:g} is more than the projection {self.projection}"
                    f"{' with this distortion' if any(lens.distortion) else ''} can show"
                )
        return self

    def changed(self, **parts: Any) -> CameraModel:
        """The same camera but for these sections; nothing that was derived of the old ones stays."""
        return CameraModel(**{name: getattr(self, name) for name in self.model_fields_set} | parts)

    # -- derived quantities -------------------------------------------------------------------------------------------

    @cached_property
    def focal_length_px(self) -> float:
        """Focal length [px]; for latlong the pixels per radian of longitude."""
        lens, width = self.lens, self.image.width_px
        if self.projection == "latlong":
            return width / (2.0 * np.pi)
        if lens.focal_length_px is not None:
            return float(lens.focal_length_px)
        if lens.focal_length_mm is not None and lens.sensor_width_mm is not None:
            return lens.focal_length_mm / lens.sensor_width_mm * width
        half = np.radians(0.5 * (lens.field_of_view_deg or 0.0))
        u = ideal_radius(self.projection, np.sin(half), np.cos(half))
        return float(0.5 * (lens.image_circle_px or width) / distorted(u, lens.distortion))

    @cached_property
    def principal_point_px(self) -> np.ndarray:
        """(x, y) [px] of the optical axis."""
        point = self.lens.principal_point_px
        return np.array(point if point is not None else (0.5 * self.image.width_px, 0.5 * self.image.height_px))

    @cached_property
    def axes(self) -> np.ndarray:
        """Rotation (3, 3) from the world to right, forward, up of the camera (`mirrored` not applied)."""
        o = self.orientation
        return camera_axes(o.azimuth_deg or 0.0, o.elevation_deg, o.roll_deg)

    @cached_property
    def _largest_u(self) -> float:
        return largest_radius(self.projection, self.lens.distortion)

    # -- directions and pixels ----------------------------------------------------------------------------------------

    def project(self, directions: np.ndarray) -> np.ndarray:
        """Pixel positions (..., 2) of directions (..., 3) east, north, up, of any length above 0.

        NaN where the projection, its distortion or the image circle ends; positions outside the picture's edges are
        given as they are (see `inside`).  Longitudes of a latitude-longitude picture come with x in [0, width).
        """
        return self.project_own(np.asarray(directions, dtype=float) @ self.axes.T)

    def directions(self, xy: np.ndarray) -> np.ndarray:
        """Unit vectors (..., 3) east, north, up of pixel positions (..., 2), the inverse of `project`; NaN outside."""
        return self.directions_own(xy) @ self.axes

    def project_own(self, own: np.ndarray) -> np.ndarray:
        """As `project`, from directions in the camera's own axes: right, forward, up."""
        right, forward, up = np.moveaxis(np.asarray(own, dtype=float), -1, 0)
        if self.lens.mirrored:
            right = -right
        across = np.hypot(right, up)
        image = self.image
        if self.projection == "latlong":
            x = image.width_px * np.mod(0.5 + np.arctan2(right, forward) / (2.0 * np.pi), 1.0)
            y = image.height_px * (0.5 - np.arctan2(up, np.hypot(right, forward)) / np.pi)
            return np.stack([x, y], axis=-1)
        length = np.hypot(across, forward)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = ideal_radius(self.projection, across / length, forward / length)
            v = np.where(u <= self._largest_u, distorted(u, self.lens.distortion), np.nan)
            radius = self._in_circle(self.focal_length_px * v)
            scale = np.where(across > 0, radius / across, np.where(np.isnan(radius), np.nan, 0.0))
        return self.principal_point_px + np.stack([scale * right, -scale * up], axis=-1)

    def directions_own(self, xy: np.ndarray) -> np.ndarray:
        """As `directions`, in the camera's own axes: right, forward, up."""
        xy = np.asarray(xy, dtype=float)
        if self.projection == "latlong":
            longitude = (xy[..., 0] / self.image.width_px - 0.5) * (2.0 * np.pi)
            latitude = (0.5 - xy[..., 1] / self.image.height_px) * np.pi
            own = around(longitude, np.where(np.abs(latitude) <= np.pi / 2, latitude, np.nan))
        else:
            x, y = np.moveaxis(xy - self.principal_point_px, -1, 0)
            own = off_axis(x, -y, self.angle_off_axis(xy))
        return own * (-1.0, 1.0, 1.0) if self.lens.mirrored else own

    def angle_off_axis(self, xy: np.ndarray) -> np.ndarray:
        """Angle [rad] between the optical axis and the directions of pixel positions (..., 2); NaN outside."""
        if self.projection == "latlong":
            own = self.directions_own(xy)
            return np.arctan2(np.hypot(own[..., 0], own[..., 2]), own[..., 1])
        x, y = np.moveaxis(np.asarray(xy, dtype=float) - self.principal_point_px, -1, 0)
        v = self._in_circle(np.hypot(x, y)) / self.focal_length_px
        return ideal_angle(self.projection, undistorted(v, self.lens.distortion, self._largest_u))

    def _in_circle(self, radius: np.ndarray) -> np.ndarray:
        """Radii [px], NaN outside the image circle (widened by rounding)."""
        circle = self.lens.image_circle_px
        return radius if circle is None else np.where(radius <= 0.5 * circle * (1.0 + 1e-12), radius, np.nan)

    def inside(self, xy: np.ndarray) -> np.ndarray:
        """Whether pixel positions (..., 2) are within the picture's edges; False for NaN."""
        xy = np.asarray(xy, dtype=float)
        x, y = xy[..., 0], xy[..., 1]
        return (x >= 0) & (x <= self.image.width_px) & (y >= 0) & (y <= self.image.height_px)

    def pixel_centres(self) -> np.ndarray:
        """Positions (height, width, 2) of all pixel centres."""
        x, y = np.arange(self.image.width_px) + 0.5, np.arange(self.image.height_px) + 0.5
        return np.stack(np.meshgrid(x, y), axis=-1)

    def azimuth_elevation(self, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(azimuth_deg in [0, 360), elevation_deg) of pixel positions (..., 2); NaN outside.

        Azimuths count from the camera's own where `orientation.azimuth_deg` is unknown.
        """
        return azimuth_elevation(self.directions(xy))

    def relative_illumination(self, xy: np.ndarray) -> np.ndarray:
        """What vignetting leaves of the light at pixel positions (..., 2): 1 on the axis; NaN outside or where not > 0.

        The radiance of a scene is the linear pixel value divided by this, up to one constant.
        """
        if self.projection == "latlong":
            return np.ones(np.shape(xy)[:-1])
        theta = self.angle_off_axis(xy)
        illumination = 1.0 + np.zeros_like(theta)
        for power, a in enumerate(self.lens.vignetting, start=1):
            illumination = illumination + a * theta ** (2 * power)
        if self.lens.natural_vignetting:
            illumination = illumination * np.cos(theta) ** 4
        return np.where(illumination > 0, illumination, np.nan)


KNOWN_RESPONSES = ("linear", "srgb")
HEAD = """\
# A camera for `twilight validate`.  Pixel positions count from the picture's upper left corner, azimuths clockwise from
# north; off the axis by the angle t, the radius in pixels is focal_length_px * v with v = u (1 + k1 u^2 + ...) and
# u = t (equidistant), 2 sin(t/2) (equisolid), 2 tan(t/2) (stereographic), sin t (orthographic), tan t (perspective).
"""


def read_camera(path: str | Path) -> CameraModel:
    """The camera in a YAML file; a response curve's path counts from the folder of that file.

    Errors: TwilightError that names the file, the key and what is allowed, also where the response curve is missing.
    """
    path = Path(path)
    data = read_yaml(path)
    camera = validate(CameraModel, data, Origins({(): str(path)}))
    response = camera.response
    if isinstance(response, str) and response not in KNOWN_RESPONSES:
        curve = path.parent / response
        if not isfile(curve):
            raise TwilightError(
                f"{path}: response must be linear, srgb, an exponent or the path of a CSV file; there is no {curve}"
            )
        camera = camera.changed(response=str(curve))
    return camera


def write_camera(path: str | Path, camera: CameraModel) -> None:
    """Write a camera as YAML that `read_camera` reads, whole or not at all; keys without a value are left out.

    The path of a response curve is written as an absolute one, because the file may go to another folder.
    Raises TwilightError where it cannot be written.
    """
    data = camera.model_dump(mode="json", exclude_none=True)
    data["lens"] = {k: v for k, v in data["lens"].items() if v not in ([], False)}
    if camera.orientation.azimuth_deg is None:
        data["orientation"] = {"azimuth_deg": None, **data["orientation"]}
    if isinstance(camera.response, str) and camera.response not in KNOWN_RESPONSES:
        data["response"] = str(Path(camera.response).absolute())
    if not data["lens"]:
        del data["lens"]
    text = HEAD + yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None)
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


_LARGEST_RADIUS = {
    "equidistant": np.pi,
    "equisolid": 2.0,
    "stereographic": np.inf,
    "orthographic": 1.0,
    "perspective": np.inf,
}
_MOST_STEPS = 80
"""Steps of the safeguarded Newton iteration; bisection alone needs some 60 for a double."""


def ideal_radius(projection: str, sine: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """u for the sine and cosine of the angle off the axis, NaN outside the projection's range."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if projection == "equidistant":
            return np.arctan2(sine, cosine)
        if projection == "equisolid":
            return 2.0 * np.sin(0.5 * np.arctan2(sine, cosine))
        if projection == "stereographic":
            return np.where((sine > 0) | (cosine > 0), 2.0 * np.tan(0.5 * np.arctan2(sine, cosine)), np.nan)
        if projection == "orthographic":
            return np.where(cosine >= 0, sine, np.nan)
        return np.where(cosine > 0, sine / cosine, np.nan)


def ideal_angle(projection: str, u: np.ndarray) -> np.ndarray:
    """The angle off the axis [rad] at the radius u, NaN outside the projection's range."""
    with np.errstate(invalid="ignore"):
        if projection == "equidistant":
            return np.where(u <= np.pi, u, np.nan)
        if projection == "equisolid":
            return 2.0 * np.arcsin(0.5 * u)
        if projection == "stereographic":
            return 2.0 * np.arctan(0.5 * u)
        if projection == "orthographic":
            return np.arcsin(u)
        return np.arctan(u)


def _even_series(u: np.ndarray | float, coefficients: Sequence[float]) -> np.ndarray:
    """1 + k1 u^2 + k2 u^4 + ..."""
    square = np.square(u)
    series = np.zeros_like(square)
    for k in reversed(coefficients):
        series = (series + k) * square
    return 1.0 + series


def distorted(u: np.ndarray | float, coefficients: Sequence[float]) -> np.ndarray:
    """v = u (1 + k1 u^2 + k2 u^4 + ...), whatever u."""
    return u * _even_series(u, coefficients)


def _slope_coefficients(coefficients: Sequence[float]) -> list[float]:
    """Coefficients of dv/du = 1 + 3 k1 u^2 + 5 k2 u^4 + ..."""
    return [(2 * n + 1) * k for n, k in enumerate(coefficients, start=1)]


def largest_radius(projection: str, coefficients: Sequence[float]) -> float:
    """The largest u at which the projection with its distortion can still be inverted; inf where there is no limit."""
    roots = np.roots([*reversed(_slope_coefficients(coefficients)), 1.0])
    extrema = [float(np.sqrt(r.real)) for r in roots if abs(r.imag) <= ROUNDING * abs(r) and r.real > 0]
    return min([_LARGEST_RADIUS[projection], *extrema])


def undistorted(v: np.ndarray, coefficients: Sequence[float], largest: float) -> np.ndarray:
    """u of `distorted(u) == v` with 0 <= u <= largest, NaN where there is none; v >= 0.

    Newton's method inside a bracket that shrinks with every step, so that it cannot leave it.
    """
    v = np.asarray(v, dtype=float)
    if not any(coefficients):
        return np.where(v <= largest, v, np.nan)
    high_end = largest
    if not np.isfinite(largest):
        most = np.max(v, initial=1.0, where=np.isfinite(v))
        high_end = 1.0
        while distorted(high_end, coefficients) < most:
            high_end *= 2.0
    top = float(distorted(high_end, coefficients))
    outside = ~(v <= top * (1.0 + 1e-12))
    goal = np.where(outside, 0.0, np.minimum(v, top))
    low, high = np.zeros_like(goal), np.full_like(goal, high_end)
    u = np.minimum(goal, high_end)
    for _ in range(_MOST_STEPS):
        error = distorted(u, coefficients) - goal
        low, high = np.where(error <= 0, u, low), np.where(error >= 0, u, high)
        slope = _even_series(u, _slope_coefficients(coefficients))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = u - error / slope
        following = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        settled = np.abs(following - u) <= 1e-15 * np.maximum(1.0, u)
        u = following
        if settled.all():
            break
    return np.where(outside, np.nan, u)
