"""`twilight validate stars` from the command line."""

from __future__ import annotations

import sys
from datetime import UTC, datetime

import numpy as np
import pytest
from PIL import Image
from star_pictures import render_stars
from typer.testing import CliRunner

from twilight.cli.app import app
from twilight.io.stored_image import write_exr
from twilight.studies.camera import CameraModel, read_camera
from twilight.studies.validate.stars.coordinates import StarSite, horizontal

TRUTH = {
    "projection": "perspective",
    "image": {"width_px": 700, "height_px": 500},
    "lens": {"focal_length_px": 520.0},
    "orientation": {"azimuth_deg": 300.0, "elevation_deg": 50.0, "roll_deg": 4.0},
}
GUESS = """
projection: perspective
image: {width_px: 700, height_px: 500}
lens: {field_of_view_deg: 69}
response: linear
"""
WHERE = ["--latitude", "48.2", "--longitude", "16.4", "--at", "2021-08-11T01:30", "--time-zone", "Europe/Vienna"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A night exposure as EXR, and a guess of its camera."""
    folder = tmp_path_factory.mktemp("stars")
    truth = CameraModel.model_validate(TRUTH)
    stars = horizontal(StarSite(48.2, 16.4), datetime(2021, 8, 10, 23, 30, tzinfo=UTC), 1013.25, 10.0)
    stars = stars.take(stars.magnitude < 5.0)
    picture = render_stars(truth.project(stars.directions), stars.magnitude, truth, seed=1)
    write_exr(folder / "night.exr", np.repeat(picture[..., None], 3, axis=-1).astype(np.float32))
    (folder / "guess.yaml").write_text(GUESS)
    return folder


def run(*arguments):
    return CliRunner().invoke(app, ["validate", "stars", *map(str, arguments)])


def test_writes_the_camera_and_the_picture(folder, tmp_path):
    """`validate stars` would not write the camera that took the picture."""
    camera, picture = tmp_path / "new" / "camera.yaml", tmp_path / "new" / "stars.png"
    made = run(
        folder / "night.exr", "--camera", folder / "guess.yaml", *WHERE, "--output", camera, "--picture", picture
    )
    assert made.exit_code == 0, made.output
    solved = read_camera(camera)
    o = solved.orientation
    assert (o.azimuth_deg, o.elevation_deg, o.roll_deg) == pytest.approx((300.0, 50.0, 4.0), abs=0.1)
    assert solved.focal_length_px == pytest.approx(520.0, rel=1e-3)
    assert solved.calibration["matched"] > 50 and solved.calibration["residual_rms_arcmin"] < 1.5
    assert f"stars matched\t{solved.calibration['matched']} " in made.output
    assert f"wrote {camera}, {picture}" in made.output
    drawn = np.asarray(Image.open(picture))
    assert drawn.shape == (round(500 * 2000 / 700), 2000, 3)
    green = (drawn == (70, 255, 90)).all(axis=-1).sum()
    assert green > 30 * solved.calibration["matched"] * 0.5  # circles of radius 7


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ([*WHERE, "--latitude", "98"], "--latitude: 98 is not allowed; it must be from -90 to 90"),
        ([*WHERE[:4], "--at", "2021-08-11T01:30"], "needs time_zone"),
        ([*WHERE[:4], "--at", "noon", "--time-zone", "UTC"], "twilight: --at: 'noon' is not a time such as"),
        ([*WHERE, "--time-zone", "Europe/Wien"], "--time-zone: time_zone must be a time zone"),
        ([*WHERE, "--planets"], "--planets: finds the date of a picture without --at"),
    ],
)
def test_wrong_options_are_one_sentence(folder, more, expected):
    """A wrong place or time would be a traceback."""
    made = run(folder / "night.exr", "--camera", folder / "guess.yaml", *more)
    assert made.exit_code == 2
    assert expected in made.stderr and made.stderr.count("\n") == 1


def test_failures_leave_no_files(folder, tmp_path, monkeypatch):
    """A failed calibration would leave folders or half a camera."""
    wide = tmp_path / "wide.yaml"
    wide.write_text(GUESS.replace("700", "800"))
    output = tmp_path / "out" / "camera.yaml"
    made = run(folder / "night.exr", "--camera", wide, *WHERE, "--output", output)
    assert made.exit_code == 2
    assert f"{folder / 'night.exr'}: the picture has 700 x 500 pixels, but the camera says 800 x 500" in made.stderr
    monkeypatch.setitem(sys.modules, "astropy", None)
    made = run(folder / "night.exr", "--camera", folder / "guess.yaml", *WHERE, "--output", output)
    assert made.exit_code == 2 and "install 'astropy>=6.1,<9'" in made.stderr
    assert not output.parent.exists()
