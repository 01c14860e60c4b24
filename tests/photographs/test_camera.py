"""The camera model: closed forms, exact inverses, orientation, documents."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from twilight.base.errors import TwilightError
from twilight.numerics.directions import azimuth_elevation, camera_axes, direction, orientation_angles
from twilight.studies.camera import CameraModel, read_camera, write_camera
from twilight.studies.camera.model import Projection

RADIAL = get_args(Projection)[:-1]

CLOSED_FORMS = {
    "equidistant": lambda t: t,
    "equisolid": lambda t: 2 * np.sin(t / 2),
    "stereographic": lambda t: 2 * np.tan(t / 2),
    "orthographic": np.sin,
    "perspective": np.tan,
}
TURNED = {"azimuth_deg": 217.0, "elevation_deg": 34.0, "roll_deg": -23.0}


def make(projection, lens=None, orientation=None, width=1200, height=900, **more):
    if projection == "latlong":
        width, height, lens = 1024, 512, lens or {}
    return CameraModel.model_validate(
        {
            "projection": projection,
            "image": {"width_px": width, "height_px": height},
            "lens": {"focal_length_px": 400.0} if lens is None else lens,
            "orientation": orientation or {},
            **more,
        }
    )


def random_directions(n=4000, seed=1):
    vectors = np.random.default_rng(seed).normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.parametrize("projection", RADIAL)
def test_radius_is_the_closed_form(projection):
    """Stars would lie off by what one projection differs from another."""
    camera = make(projection)  # looks north, level
    theta = np.radians([0.0, 1e-7, 1.0, 20.0, 45.0, 70.0, 89.0])
    xy = camera.project(direction(np.degrees(theta), 0.0))
    np.testing.assert_allclose(xy[:, 0] - 600.0, 400.0 * CLOSED_FORMS[projection](theta), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(xy[:, 1], 450.0, atol=1e-9)


@pytest.mark.parametrize("projection", [*RADIAL, "latlong"])
@pytest.mark.parametrize("distortion", [(), (-0.02, 0.001), (0.05, -0.01, 0.002, 0.0001)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_round_trips_are_exact(projection, distortion, mirrored):
    """A pixel's direction would not be where that direction is drawn."""
    radial = projection != "latlong"
    lens = {"mirrored": mirrored, **({"focal_length_px": 300.0, "distortion": distortion} if radial else {})}
    if radial:
        lens["principal_point_px"] = [585.2, 460.9]
    camera = make(projection, lens, TURNED)
    directions = random_directions()
    xy = camera.project(directions)
    seen = np.isfinite(xy).all(axis=1) & (np.hypot(*(xy - camera.principal_point_px).T) < 2000.0)
    # a grazing ray of the orthographic lens moves its pixel by nothing; there the inverse cannot be exact
    if projection == "orthographic":
        seen &= (directions @ camera.axes[1]) > 0.02
    assert seen.sum() > 500
    np.testing.assert_allclose(camera.directions(xy[seen]), directions[seen], atol=1e-9)
    inside = camera.pixel_centres()[::37, ::41].reshape(-1, 2)
    back = camera.project(camera.directions(inside))
    known = np.isfinite(back).all(axis=1)
    assert known.mean() > 0.2
    np.testing.assert_allclose(back[known], inside[known], atol=1e-9)


def test_far_side_of_a_lens_is_not_a_number():
    """Sky behind the camera would appear in the picture."""
    behind = direction(179.9, 0.0)
    for projection in ("perspective", "orthographic"):
        assert np.isnan(make(projection).project(behind)).all()
        assert np.isfinite(make(projection).project(direction(40.0, 5.0))).all()
    assert np.isnan(make("orthographic").directions([[1100.0, 450.0]])).all()
    circle = make("equidistant", {"field_of_view_deg": 180.0, "image_circle_px": 800.0})
    assert circle.focal_length_px == pytest.approx(400.0 / (np.pi / 2))
    assert np.isnan(circle.project(direction(91.0, 0.0))).all()
    assert circle.project(direction(90.0, 0.0)) == pytest.approx([1000.0, 450.0])
    assert np.isnan(circle.directions([1001.0, 450.0])).all()


def test_a_distortion_that_turns_back_ends_the_picture():
    """Pixels past a lens polynomial's turning point would show two directions."""
    camera = make("equidistant", {"focal_length_px": 400.0, "distortion": [-0.3]})  # turns back at u = 1.054
    assert np.isfinite(camera.project(direction(60.0, 0.0))).all()
    assert np.isnan(camera.project(direction(61.0, 0.0))).all()
    assert np.isnan(camera.directions([600.0 + 400.0 * 0.71, 450.0])).all()


def test_sky_is_seen_from_inside():
    """Pictures would be mirrored: looking south, east is on the left."""
    south = make("perspective", orientation={"azimuth_deg": 180.0, "elevation_deg": 20.0})
    east, west = south.project(direction(170.0, 20.0)), south.project(direction(190.0, 20.0))
    assert east[0] < 600.0 < west[0]
    assert south.project(direction(180.0, 30.0))[1] < 450.0
    mirrored = make("perspective", {"focal_length_px": 400.0, "mirrored": True}, {"azimuth_deg": 180.0})
    assert mirrored.project(direction(170.0, 0.0))[0] > 600.0


def test_roll_turns_the_horizon_anticlockwise():
    """A tilted camera would be levelled the wrong way."""
    camera = make("perspective", orientation={"roll_deg": 10.0})
    left, right = camera.project(direction(-10.0, 0.0)), camera.project(direction(10.0, 0.0))
    assert np.degrees(np.arctan2(left[1] - right[1], right[0] - left[0])) == pytest.approx(10.0)


def test_towards_the_zenith_the_bottom_is_the_azimuth():
    """All-sky pictures would lie turned."""
    camera = make("equidistant", orientation={"azimuth_deg": 130.0, "elevation_deg": 90.0})
    assert camera.project(direction(130.0, 60.0)) == pytest.approx([600.0, 450.0 + 400.0 * np.radians(30.0)])
    assert camera.project(direction(40.0, 60.0))[0] < 600.0  # as facing the south: east is on the left


def test_latitude_longitude_grows_to_the_right():
    """Panoramas would be turned, mirrored or off by half a pixel."""
    camera = make("latlong", orientation={"azimuth_deg": 30.0})
    np.testing.assert_allclose(camera.project(direction(30.0, 0.0)), [512.0, 256.0], atol=1e-9)
    np.testing.assert_allclose(camera.project(direction(120.0, 45.0)), [768.0, 128.0], atol=1e-9)
    azimuth, elevation = camera.azimuth_elevation([[0.5, 0.5]])
    assert azimuth == pytest.approx(30.0 - 180.0 + 360.0 + 0.5 * 360 / 1024)
    assert elevation == pytest.approx(90.0 - 0.5 * 180 / 512)


@pytest.mark.parametrize("angles", [(10.0, -35.0, 100.0), (359.0, 80.0, -179.0), (0.0, 0.0, 0.0), (77.0, 90.0, 0.0)])
def test_orientation_angles_undo_camera_axes(angles):
    """A fitted orientation would be written as other angles."""
    axes = camera_axes(*angles)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert orientation_angles(axes) == pytest.approx(angles, abs=1e-9)


def test_azimuth_elevation_undoes_direction():
    """Directions would change each time that they pass through angles."""
    azimuth, elevation = azimuth_elevation(direction([0.0, 90.0, 359.0], [10.0, -20.0, 89.0]))
    np.testing.assert_allclose(azimuth, [0.0, 90.0, 359.0], atol=1e-12)
    np.testing.assert_allclose(elevation, [10.0, -20.0, 89.0], atol=1e-12)


def test_focal_lengths():
    """A lens given in mm, by its angle or with distortion would have another field of view."""
    by_mm = make("perspective", {"focal_length_mm": 24.0, "sensor_width_mm": 36.0})
    by_angle = make("perspective", {"field_of_view_deg": float(np.degrees(2 * np.arctan(18 / 24)))})
    assert by_mm.focal_length_px == pytest.approx(800.0) == by_angle.focal_length_px
    bent = make("equidistant", {"field_of_view_deg": 100.0, "distortion": [0.1]})
    assert bent.project(direction(50.0, 0.0))[0] == pytest.approx(1200.0)


def test_vignetting():
    """Corners would stay dark, or a polynomial below zero be divided by."""
    camera = make("perspective", {"focal_length_px": 400.0, "natural_vignetting": True, "vignetting": [-0.1]})
    theta = np.arctan(300.0 / 400.0)
    expected = np.cos(theta) ** 4 * (1 - 0.1 * theta**2)
    assert camera.relative_illumination([900.0, 450.0]) == pytest.approx(expected)
    assert camera.relative_illumination([600.0, 450.0]) == 1.0
    dark = make("equidistant", {"focal_length_px": 400.0, "vignetting": [-1.0]})
    assert np.isnan(dark.relative_illumination([600.0 + 450.0, 450.0]))


def test_document_round_trip(tmp_path):
    """A camera file that is written again would lose its curve or its free azimuth."""
    (tmp_path / "curve.csv").write_text("0,0\n1,1\n")
    text = """
version: 1
projection: equisolid
image: {width_px: 3000, height_px: 2000}
lens: {focal_length_mm: 10.5, sensor_width_mm: 23.6, distortion: [0.01, -0.002], mirrored: true}
orientation: {elevation_deg: 90, roll_deg: 3}
response: curve.csv
"""
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    camera = read_camera(path)
    assert camera.orientation.azimuth_deg is None
    assert camera.response == str(tmp_path / "curve.csv")
    (tmp_path / "elsewhere").mkdir()
    write_camera(tmp_path / "elsewhere" / "again.yaml", camera)
    assert read_camera(tmp_path / "elsewhere" / "again.yaml") == camera
    assert [p.name for p in (tmp_path / "elsewhere").iterdir()] == ["again.yaml"]


@pytest.mark.parametrize(
    ("projection", "height", "more", "expected"),
    [
        ("fisheye", 500, "", "projection must be one of equidistant, equisolid"),
        ("equisolid", 500, "", "lens needs focal_length_px, focal_length_mm or field_of_view_deg"),
        ("latlong", 400, "", "image.width_px must be twice image.height_px"),
        ("latlong", 500, "lens: {focal_length_px: 3}", "lens.focal_length_px has no"),
        ("perspective", 500, "lens: {field_of_view_deg: 180}", "lens.field_of_view_deg 180 is more"),
        ("equisolid", 500, "lens: {focal_length_mm: 8}", "focal_length_mm and sensor_width_mm"),
        ("equisolid", 500, "lens: {focal_length_px: 8, field_of_view_deg: 90}",
         "lens takes only one of focal_length_px, field_of_view_deg"),
        ("equisolid", 500, "lens: {focal_lenght_px: 8}", "did you mean focal_length_px"),
        ("equisolid", 500, "lens: {focal_length_px: -8}", "lens.focal_length_px must be"),
        ("equisolid", 500, "lens: {focal_length_px: 8, principal_point_px: [3]}",
         "lens.principal_point_px must hold at least 2 values"),
        ("latlong", 500, "response: no.csv", "response must be linear, srgb"),
        ("latlong", 500, "response: 0", "response must be an exponent from 0.1 to 10"),
        (None, 500, "", "projection is missing"),
    ],
)  # fmt: skip
def test_errors_name_file_and_key(tmp_path, projection, height, more, expected):
    """A slip in a camera file would be a traceback, or not say where it is."""
    head = "" if projection is None else f"projection: {projection}\n"
    text = f"{head}image: {{width_px: 1000, height_px: {height}}}\n{more}\n"
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(TwilightError) as raised:
        read_camera(path)
    assert str(raised.value).startswith(str(path))
    assert expected in str(raised.value)
