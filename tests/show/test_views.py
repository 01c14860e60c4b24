"""Directions of pictures: closed forms, solid angles, and agreement with the camera model."""

import numpy as np
import pytest

from twilight.base.errors import TwilightError
from twilight.io import picture
from twilight.numerics.directions import direction
from twilight.numerics.projections import PROJECTIONS, cube_face, view_directions, view_rays
from twilight.studies.camera import CameraModel

POINTING = {"azimuth_deg": 73.0, "elevation_deg": -21.0, "roll_deg": 14.0}


@pytest.mark.parametrize("name", PROJECTIONS)
def test_rays_are_unit_vectors_and_give_back_their_angles(name):
    """A projection's pixels would not point where their angles say."""
    rays = view_rays(name, 32)
    elevation, azimuth = view_directions(name, 32)
    inside = np.isfinite(rays[..., 0])
    assert inside.mean() > 0.4
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1)[inside], 1.0, atol=1e-12)
    np.testing.assert_allclose(direction(azimuth, elevation)[inside], rays[inside], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "projection", "height"),
    [("perspective", "perspective", 24), ("fisheye", "equidistant", 24), ("latlong", "latlong", 12)],
)
def test_as_the_camera_model(name, projection, height):
    """A view and a camera of one projection would disagree."""
    lens = {} if name == "latlong" else {"field_of_view_deg": 80.0}
    image = {"width_px": 24, "height_px": height}
    camera = CameraModel.model_validate(
        {"projection": projection, "image": image, "orientation": POINTING, **({"lens": lens} if lens else {})}
    )
    expected = camera.directions(camera.pixel_centres())
    found = view_rays(name, 24, height, **lens, **POINTING)
    inside = np.isfinite(found[..., 0])
    np.testing.assert_allclose(found[inside], expected[inside], atol=1e-12)
    assert inside.all() == (name != "fisheye")


@pytest.mark.parametrize("name", ["latlong", "octahedral", "cube"])
def test_whole_spheres_hold_every_direction_once(name):
    """A projection of the whole sphere would leave a gap or repeat a part."""
    # neighbours span the solid angle of a pixel; all of them together are the sphere
    rays = view_rays(name, 96)
    a, b, c, d = rays[:-1, :-1], rays[:-1, 1:], rays[1:, :-1], rays[1:, 1:]
    area = 0.5 * np.linalg.norm(np.cross(d - a, c - b), axis=-1)
    total = np.nansum(area) * 96 * (96 / PROJECTIONS[name].aspect) / area.size
    if name == "cube":
        total = 6 * 96 / 4 * 96 / 4 * np.nanmean(area)
    assert total == pytest.approx(4 * np.pi, rel=0.03)
    seen = rays[np.isfinite(rays[..., 0])]
    for target in direction(np.array([0.0, 90.0, 200.0, 10.0, 300.0]), np.array([0.0, 30.0, -40.0, 89.0, -89.0])):
        assert (seen @ target).max() > np.cos(np.radians(4.5))


def test_the_fisheye_has_azimuth_0_below_and_90_to_the_right():
    """The fisheye would be mirrored or turned."""
    elevation, azimuth = view_directions("fisheye", 100)
    assert azimuth[95, 50] == pytest.approx(0.0, abs=1.5) or azimuth[95, 50] > 358.5
    assert azimuth[50, 95] == pytest.approx(90.0, abs=1.5)
    assert elevation[50, 50] > 88.0 and np.isnan(elevation[0, 0])


def test_faces_of_the_cube_join():
    """A face of the cube would be turned against its neighbours."""
    front, up, right, down = (cube_face(face, 64) for face in ("front", "up", "right", "down"))
    step = 2.0 / 64
    assert np.abs(front[0] - up[-1]).max() < 1.5 * step
    assert np.abs(front[:, -1] - right[:, 0]).max() < 1.5 * step
    assert np.abs(front[-1] - down[0]).max() < 1.5 * step


def test_wrong_views_are_one_sentence():
    """An impossible view would be drawn."""
    for name, size, more, says in (
        ("mercator", (10,), {}, "choose one of perspective"),
        ("latlong", (20, 20), {}, "2 times as wide as high"),
        ("perspective", (20,), {"field_of_view_deg": 180.0}, "above 0 to 170 is"),
        ("panorama", (40,), {"elevation_deg": 5.0}, "is level"),
        ("limb", (36, 5), {"band_deg": (5.0, 5.0)}, "must rise"),
        ("cylinder", (64,), {"elevation_deg": 85.0}, "elevation_deg: 85 is not allowed for a view cylinder, -80 to 80"),
    ):
        with pytest.raises(TwilightError, match=says):
            view_rays(name, *size, **more)


def test_a_strip_along_the_limb_has_rows_of_one_elevation():
    """The strip along the limb would curve."""
    elevation, azimuth = view_directions("limb", 36, 5, azimuth_deg=10.0, band_deg=(-25.0, -15.0))
    np.testing.assert_allclose(elevation, np.broadcast_to([[-16.0], [-18.0], [-20.0], [-22.0], [-24.0]], (5, 36)))
    np.testing.assert_allclose(azimuth[0], np.mod(10.0 - 175.0 + 10.0 * np.arange(36), 360.0))


def test_a_cylinder_shows_the_sky_and_its_vertical_lines_are_vertical():
    """Towers would lean."""
    e, a = view_directions("cylinder", 400)
    wide = picture.view_directions("wide", 400)
    assert np.allclose(e, wide[0], atol=0.05) and np.allclose((a + 180.0) % 360.0 - 180.0, wide[1])
    assert (e > 0.0).mean() == pytest.approx(picture.WIDE_HORIZON, abs=0.006)
    for up in (-40.0, 0.0, 60.0):
        e, a = view_directions("cylinder", 64, 33, elevation_deg=up)
        assert np.ptp(a, axis=0).max() < 1e-9 and e[16] == pytest.approx(up)
