"""Cameras solved from drawn skies whose truth is known, and from a photograph."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from star_pictures import render_stars

from twilight.base.errors import TwilightError
from twilight.io.stored_image import read_image
from twilight.numerics.directions import camera_axes
from twilight.sky.night.points import blended
from twilight.studies.camera import CameraModel
from twilight.studies.validate.stars.calibrate import calibrate
from twilight.studies.validate.stars.coordinates import StarSite, equatorial, horizontal
from twilight.studies.validate.stars.picture import date_by_planets
from twilight.studies.validate.stars.search import chance_matches, find_attitude, match, spread

PLACE = StarSite(48.2, 16.4, 0.2)
"""Vienna: latitude and longitude [deg], altitude [km]."""
MOMENT = datetime(2021, 8, 10, 23, 30, tzinfo=UTC)
"""Of the drawn photographs."""
LOCAL_SIDEREAL_TIME_H = 21.9037
"""Mean sidereal time of Greenwich (Meeus 1998, eq. 12.4) plus the longitude."""
ARCMINUTE = 1.0
PHOTOGRAPH = Path(__file__).parents[1] / "data" / "stars" / "dikhololo_night_sky.hdr"
TRUTHS = {
    "fisheye": {
        "projection": "equisolid",
        "image": {"width_px": 1000, "height_px": 800},
        "lens": {"focal_length_px": 350.0, "distortion": [-0.012, 0.003], "principal_point_px": [507.3, 391.8]},
        "orientation": {"azimuth_deg": 37.0, "elevation_deg": 78.0, "roll_deg": 12.0},
    },
    "perspective": {
        "projection": "perspective",
        "image": {"width_px": 900, "height_px": 600},
        "lens": {"focal_length_px": 620.0, "distortion": [-0.06, 0.02], "principal_point_px": [446.2, 306.9]},
        "orientation": {"azimuth_deg": 127.0, "elevation_deg": 44.0, "roll_deg": -7.0},
    },
}
GUESSED_FOCAL_LENGTH_PX = {"fisheye": 333.0, "perspective": 640.0}
FALSE_FRACTION = 0.2
"""Of the sources: points that are no star."""
HOT_PIXELS = 200
"""Bright single pixels of the sensor."""


@cache
def draw(kind, false_fraction=FALSE_FRACTION):
    """(true camera, guess, picture): a fifth of the sources false, hot pixels, noise of photons and reading out."""
    truth = CameraModel.model_validate(TRUTHS[kind])
    stars = horizontal(PLACE, MOMENT, 1013.25, 10.0)
    stars = stars.take(stars.magnitude < 5.0)
    xy = truth.project(stars.directions)
    n = int(truth.inside(xy).sum())
    picture = render_stars(
        xy,
        stars.magnitude,
        truth,
        seed=3,
        hot_pixels=HOT_PIXELS,
        false_stars=int(false_fraction / (1 - false_fraction) * n),
    )
    guess = CameraModel.model_validate(
        {
            "projection": truth.projection,
            "image": truth.image.model_dump(),
            "lens": {"focal_length_px": GUESSED_FOCAL_LENGTH_PX[kind]},
        }
    )
    return truth, guess, picture


@cache
def solved(kind):
    """(true camera, calibration with place and time)."""
    truth, guess, picture = draw(kind)
    return truth, calibrate(picture, guess, PLACE, MOMENT)


def errors_arcmin(truth, camera):
    """Angles between the true and the solved direction of pixels all over the picture, above the horizon."""
    xy = truth.pixel_centres()[10::40, 10::40].reshape(-1, 2)
    a, b = truth.directions(xy), camera.directions(xy)
    seen = a[:, 2] > 0.05
    return np.degrees(2.0 * np.arcsin(0.5 * np.linalg.norm(a - b, axis=1)[seen])) * 60.0


@pytest.mark.parametrize("kind", TRUTHS)
def test_place_and_time_known(kind):
    """Camera angles from stars would be off by more than an arc minute."""
    truth, made = solved(kind)
    errors = errors_arcmin(truth, made.camera)
    assert np.sqrt(np.mean(errors**2)) < 0.25 * ARCMINUTE and errors.max() < ARCMINUTE
    assert made.camera.focal_length_px == pytest.approx(truth.focal_length_px, rel=5e-4)
    assert made.fit.free == ("focal_length", "principal_point", "k1", "k2")
    assert len(made.fit.match) > 10 * made.fit.chance_matches + 50
    assert made.orientation is None
    # right matches: the star matched to a source is one that was drawn there
    xy = truth.project(made.stars.directions[made.fit.match.star])
    assert np.hypot(*(xy - made.sources.xy[made.fit.match.source]).T).max() < 2.0
    # a fifth of the sources are no stars and are left alone
    assert len(made.fit.match) < 0.9 * len(made.sources)


def test_place_and_time_unknown():
    """A night picture alone would not give its place and sidereal time."""
    truth, guess, picture = draw("fisheye")
    level = {**TRUTHS["fisheye"]["orientation"], "azimuth_deg": None}
    guess = CameraModel.model_validate({**guess.model_dump(), "orientation": level})
    made = calibrate(picture, guess, year=2021.6)
    assert made.orientation.latitude_deg == pytest.approx(PLACE.latitude_deg, abs=1.5 / 60)
    assert made.orientation.local_sidereal_time_h == pytest.approx(LOCAL_SIDEREAL_TIME_H, abs=0.003)
    assert errors_arcmin(truth, made.camera).max() < 2.0 * ARCMINUTE  # aberration and nutation are unknown, too


def test_standard_errors_are_of_the_size_of_the_errors():
    """A calibration would claim errors that it does not keep."""
    truth, guess, picture = draw("perspective", false_fraction=0.0)
    made = calibrate(picture, guess, PLACE, MOMENT)
    off = Rotation.from_matrix(made.fit.state.matrix @ truth.axes.T).as_rotvec()
    assert np.all(np.abs(off) < 5.0 * made.fit.standard_errors[:3])
    assert made.pointing_error_arcmin < ARCMINUTE
    assert abs(np.log(made.camera.focal_length_px / truth.focal_length_px)) < 5.0 * made.fit.standard_errors[3]


@pytest.mark.slow
def test_what_cannot_be_solved_says_so():
    """Noise or lamps would be given an orientation."""
    _, guess, picture = draw("perspective")
    random = np.random.default_rng(1)
    noise = random.poisson(100.0, size=picture.shape).astype(float)
    with pytest.raises(TwilightError, match=r"no orientation of the sky fits the \d star-like sources"):
        calibrate(noise, guess, PLACE, MOMENT)
    places = random.uniform(0.0, [900, 600], size=(150, 2))
    lamps = render_stars(places, random.uniform(0.0, 4.0, 150), guess, seed=1)
    with pytest.raises(TwilightError, match="orientation of the sky"):
        calibrate(lamps, guess, PLACE, MOMENT)
    with pytest.raises(TwilightError, match="the picture has 900 x 600 pixels, but the camera says 1000 x 800"):
        calibrate(picture, CameraModel.model_validate(TRUTHS["fisheye"]), PLACE, MOMENT)
    with pytest.raises(TwilightError, match="given together"):
        calibrate(picture, guess, PLACE, None)


def test_attitude_survives_half_of_the_sources_being_false():
    """Lamps and aeroplanes would hide the pattern of the stars, or make one."""
    random = np.random.default_rng(11)
    stars = blended(equatorial(2020.0), np.radians(0.1))
    matrix = camera_axes(200.0, -35.0, 77.0)
    own = stars.directions[:700] @ matrix.T
    own = own[own[:, 1] > np.cos(np.radians(40.0))]
    own = own + random.normal(scale=np.radians(0.05), size=own.shape)
    false = random.normal(size=(20000, 3))
    false /= np.linalg.norm(false, axis=1, keepdims=True)
    false = false[false[:, 1] > np.cos(np.radians(40.0))][: len(own)]
    mixed = np.stack([own, false], axis=1).reshape(-1, 3)
    solid_angle = 2.0 * np.pi * (1.0 - np.cos(np.radians(40.0)))
    found = find_attitude(mixed, stars, solid_angle, 4.0 * np.pi, np.radians(0.1))
    assert found is not None and found.significance > 3.0
    off = np.degrees(Rotation.from_matrix(found.matrix @ matrix.T).magnitude())
    assert off < 1.0
    nothing = find_attitude(false, stars, solid_angle, 4.0 * np.pi, np.radians(0.1))
    assert nothing is None or nothing.significance < 3.0


def test_spread_takes_few_from_one_place():
    """A street's lamps would be all that is matched."""
    crowd = np.array([[0.0, 1.0, 0.0]] * 50 + [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert list(spread(crowd, 10, 0.2, 3)) == [0, 1, 2, 50, 51]


def test_matches_by_chance_are_counted():
    """A wrong orientation would pass for a match."""
    made = solved("fisheye")[1]
    right = match(made.fit.state, made.sources, made.stars, np.radians(0.2), np.zeros(3), np.pi)
    away = replace(made.fit.state, matrix=camera_axes(0.0, 20.0, 0.0) @ made.fit.state.matrix)
    wrong = match(away, made.sources, made.stars, np.radians(0.2), np.zeros(3), np.pi)
    expected = chance_matches(made.fit.state, made.sources, made.stars, np.radians(0.2))
    assert len(right) > 20 * len(wrong)
    assert abs(len(wrong) - expected) < 5.0 * np.sqrt(expected + 1.0)


@pytest.fixture(scope="module")
def photograph():
    guess = CameraModel.model_validate({"projection": "latlong", "image": {"width_px": 1024, "height_px": 512}})
    return calibrate(read_image(PHOTOGRAPH).samples, guess, year=2020.7, pressure_hpa=890.0)


def test_photograph_of_unknown_time(photograph):
    """Dikhololo, South Africa: the latitude is the independent check, with the level of a stitched panorama."""
    fit = photograph.fit
    assert len(fit.match) > 150 > 5 * fit.chance_matches
    assert np.degrees(fit.rms_rad) * 60 < 20.0  # a pixel is 21'
    assert photograph.orientation.latitude_deg == pytest.approx(-25.4, abs=1.5)
    assert photograph.orientation.local_sidereal_time_h == pytest.approx(21.44, abs=0.05)
    names = {photograph.stars.label(i) for i in fit.match.star}
    assert {"Altair", "Achernar", "Fomalhaut", "Peacock", "Nunki", "Deneb"} <= names


def test_planets_date_the_photograph(photograph):
    """Three planets, which no star catalogue knows, stand where they stood together on one date in 25 years."""
    dating = date_by_planets(photograph, 2000.0, 2025.0)
    assert set(dating.planets) == {"Mars", "Jupiter", "Saturn"}
    assert max(dating.planets.values()) < 0.6
    assert dating.others == 0
    assert (dating.last - dating.first).days < 8
    assert dating.best.strftime("%Y-%m") == "2020-10"
