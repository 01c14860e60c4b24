"""What a phone's picture says of itself, and pictures that say nothing of the air."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from photographs import latlong, perspective, picture, preetham, take
from PIL import ExifTags, Image

import twilight
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.numerics.spectrum import xyz_to_rgb_matrix
from twilight.sky import colour
from twilight.studies.camera.exif import read_stated
from twilight.studies.validate.photographs.comparison import Curve, tone_shapes
from twilight.studies.validate.photographs.fit import Errors, Freedom
from twilight.studies.validate.photographs.options import EstimateOptions
from twilight.studies.validate.photographs.picture import Photograph, check_sky, check_upright, read_photograph
from twilight.studies.validate.photographs.picture_sky import OBSERVER, Frame
from twilight.studies.validate.photographs.series import of_one_camera

BASE, GPS = ExifTags.Base, ExifTags.GPS
TAKEN = {
    BASE.FocalLengthIn35mmFilm: 26,
    BASE.ExposureTime: 1 / 100,
    BASE.FNumber: 1.8,
    BASE.ISOSpeedRatings: 50,
    BASE.DateTimeOriginal: "2024:06:21 20:30:00",
}
WHERE = {
    GPS.GPSLatitudeRef: "S",
    GPS.GPSLatitude: (48.0, 12.0, 0.0),
    GPS.GPSLongitudeRef: "E",
    GPS.GPSLongitude: (16.0, 24.0, 0.0),
    GPS.GPSImgDirection: 301.5,
}
CLOCK = {GPS.GPSDateStamp: "2024:06:21", GPS.GPSTimeStamp: (18.0, 30.0, 5.0)}


def jpeg(path, rgb=None, taken=TAKEN, where=WHERE, **more):
    """A JPEG of linear light with Exif."""
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif).update(taken)
    exif.get_ifd(ExifTags.IFD.GPSInfo).update(where)
    rgb = np.full((60, 80, 3), 0.3) if rgb is None else rgb
    Image.fromarray(np.round(255 * colour.srgb_encode(rgb)).astype(np.uint8)).save(path, exif=exif, quality=95, **more)
    return path


def test_exif_is_read(tmp_path):
    """Time, place, heading or exposure of a telephone's picture would be read wrong."""
    stated = read_stated(jpeg(tmp_path / "a.jpg", where=WHERE | CLOCK))
    assert stated.sun == {"at": "2024-06-21T18:30:05+00:00", "latitude_deg": -48.2, "longitude_deg": 16.4}
    assert stated.heading_deg == 301.5 and stated.focal_35mm == 26.0
    # ISO 12232: 18 % is 10 lx s N^2 / (0.65 t S)
    assert 0.18 * stated.cd_per_m2 == pytest.approx(10 * 1.8**2 / (0.65 * 0.01 * 50))


def test_a_clock_without_an_offset_is_no_time(tmp_path):
    """A local time would be taken for UTC, and the sun be hours off."""
    assert read_stated(jpeg(tmp_path / "a.jpg")).sun is None
    zoned = read_stated(jpeg(tmp_path / "b.jpg", taken=TAKEN | {BASE.OffsetTimeOriginal: "+02:00"}))
    assert zoned.sun["at"] == "2024-06-21T20:30:00+02:00"


ZONE = TAKEN | {BASE.OffsetTimeOriginal: "+02:00"}
OLD = {GPS.GPSDateStamp: "2024:06:21", GPS.GPSTimeStamp: (12.0, 3.0, 0.0)}


@pytest.mark.parametrize(
    ("taken", "where", "at", "place", "doubt"),
    [
        (ZONE, CLOCK, "2024-06-21T18:30:05+00:00", -48.2, None),
        (ZONE, CLOCK | {GPS.GPSDateStamp: "2004:11:05"}, "2024-06-21T20:30:00+02:00", -48.2, "1024 weeks"),
        (TAKEN, CLOCK | {GPS.GPSDateStamp: "2004:11:05"}, "2024-06-21T18:30:05+00:00", -48.2, "1024 weeks"),
        (ZONE, OLD, "2024-06-21T20:30:00+02:00", -48.2, "6.5 hours before the camera's"),
        (TAKEN, OLD, "2024-06-21T20:30:00", -48.2, "8.4 hours before the camera's"),
        (TAKEN, CLOCK, "2024-06-21T18:30:05+00:00", -48.2, None),
        (ZONE, OLD | {GPS.GPSDateStamp: "2024:06:12"}, "2024-06-21T20:30:00+02:00", None, "its place is not"),
        (TAKEN, OLD | {GPS.GPSDateStamp: "2024:06:12"}, "2024-06-21T20:30:00", None, "its place is not"),
        (ZONE, CLOCK | {GPS.GPSStatus: "V"}, "2024-06-21T20:30:00+02:00", None, "no fix"),
        (ZONE, {GPS.GPSLatitude: (0, 0, 0), GPS.GPSLongitude: (0, 0, 0)}, "2024-06-21T20:30:00+02:00", None, "0 N 0 E"),
        (ZONE, {GPS.GPSLatitudeRef: ""}, "2024-06-21T20:30:00+02:00", None, "without N or S"),
        (ZONE, {GPS.GPSLongitude: (190, 0, 0)}, "2024-06-21T20:30:00+02:00", None, "0 to 180 deg E or W is not"),
        (TAKEN | {BASE.DateTimeOriginal: "2024-06-21T20:30:00"}, {}, "2024-06-21T20:30:00", -48.2, None),
        (TAKEN | {BASE.DateTimeOriginal: "2024:06:21 20:30:00.25"}, {}, "2024-06-21T20:30:00", -48.2, None),
        (TAKEN | {BASE.DateTimeOriginal: "2024:06:21 20:30:00-03:00"}, {}, "2024-06-21T20:30:00-03:00", -48.2, None),
        (ZONE | {BASE.DateTimeOriginal: "2024:06:21 20:30:00Z"}, {}, "2024-06-21T20:30:00+00:00", -48.2, "two offsets"),
        (TAKEN | {BASE.DateTimeOriginal: "21.6.2024 20:30"}, {}, "None", -48.2, "is not read"),
        (TAKEN | {BASE.DateTimeOriginal: "0000:00:00 00:00:00"}, {}, "None", -48.2, None),
    ],
)
def test_what_contradicts_itself_is_said_and_not_taken(tmp_path, taken, where, at, place, doubt):
    """A sun of twenty years ago, of another place or of no time at all would be taken for the picture's."""
    stated = read_stated(jpeg(tmp_path / "a.jpg", taken=taken, where=WHERE | where))
    moment = "None" if stated.moment is None else stated.moment.isoformat()
    assert (moment, stated.latitude_deg if stated.longitude_deg is not None else None) == (at, place)
    assert len(stated.doubts) == (0 if doubt is None else 1)
    if doubt is not None:
        assert doubt in stated.doubts[0]
        with pytest.warns(TwilightWarning, match=doubt):
            read_photograph(tmp_path / "a.jpg")


def test_a_pitch_from_the_nadir_is_said(tmp_path):
    """A camera that looked 12 deg down would be taken to look 78 deg up."""
    xmp = b'<x:xmpmeta><rdf:Description Camera:Pitch="77.7" Camera:Roll="0.2"/></x:xmpmeta>'
    stated = read_stated(jpeg(tmp_path / "a.jpg", xmp=xmp))
    assert stated.pitch_deg == pytest.approx(-12.3) and "from the nadir" in stated.doubts[0]
    both = b'<x:xmpmeta><rdf:Description Camera:Pitch="20" drone-dji:GimbalPitchDegree="8"/></x:xmpmeta>'
    stated = read_stated(jpeg(tmp_path / "b.jpg", xmp=both))
    assert stated.pitch_deg is None and "two pitches" in stated.doubts[0]


def test_the_files_as_met():
    """The files of people whose reports are known."""
    as_met = Path("../shared/data/files_as_met")
    if not as_met.exists():
        pytest.skip("the files are not here")
    plain = read_stated(as_met / "plain.jpg")
    for name in ("date-iso", "date-with-offset", "date-subsec", "week-rollover"):
        stated = read_stated(as_met / f"{name}.jpg")
        assert stated.moment == plain.moment and stated.latitude_deg == plain.latitude_deg
        assert bool(stated.doubts) == (name == "week-rollover")
    for name in ("gps-void", "gps-void-null-island"):
        stated = read_stated(as_met / f"{name}.jpg")
        assert stated.sun is None and stated.moment == plain.moment and stated.doubts


def test_pitch_is_read_from_xmp(tmp_path):
    """The horizon would be searched though the picture says its pitch."""
    xmp = b'<x:xmpmeta><rdf:Description Camera:Pitch="7.5" Camera:Roll="-2"/></x:xmpmeta>'
    stated = read_stated(jpeg(tmp_path / "a.jpg", xmp=xmp))
    assert (stated.pitch_deg, stated.roll_deg) == (7.5, -2.0)
    shot = read_photograph(jpeg(tmp_path / "a.jpg", xmp=xmp))
    assert shot.camera.orientation.elevation_deg == 7.5 and shot.errors_deg[1] > 0.0


def test_the_field_of_view_follows_from_the_focal_length(tmp_path):
    """26 mm on the diagonal of 43.27 mm, also of a picture that stands upright by its orientation tag."""
    shot = read_photograph(jpeg(tmp_path / "a.jpg"))
    assert shot.camera.projection == "perspective"
    half = 0.5 * np.hypot(80, 60) / shot.camera.focal_length_px
    assert np.degrees(np.arctan(half)) == pytest.approx(np.degrees(np.arctan(0.5 * 43.267 / 26)), abs=0.01)
    assert shot.developed and shot.log_exposure[0] == pytest.approx(np.log(shot.stated.cd_per_m2))
    exif = Image.open(tmp_path / "a.jpg").getexif()
    exif[BASE.Orientation] = 6
    Image.open(tmp_path / "a.jpg").save(tmp_path / "b.jpg", exif=exif)
    tall = read_photograph(tmp_path / "b.jpg").camera
    assert (tall.image.width_px, tall.image.height_px) == (60, 80)
    assert tall.focal_length_px == pytest.approx(shot.camera.focal_length_px)


@pytest.mark.parametrize(
    ("taken", "said"),
    [
        ({}, "nothing else of how it was taken"),
        ({BASE.FNumber: 1.8}, "does not say the focal length"),
        (TAKEN | {BASE.ExifImageWidth: 4000, BASE.ExifImageHeight: 2250}, "has been cut"),
    ],
)
def test_what_lacks_is_asked_for(tmp_path, taken, said):
    """A picture without focal length would be read with a guessed one."""
    with pytest.raises(TwilightError, match=said):
        twilight.estimate(jpeg(tmp_path / "a.jpg", taken=taken, where={}))
    wide = read_photograph(jpeg(tmp_path / "a.jpg", taken=taken, where={}), EstimateOptions(field_of_view_deg=60.0))
    assert wide.camera.lens.field_of_view_deg == 60.0


def shot(rgb, camera=None, **more):
    return Photograph(picture(rgb), camera or latlong(rgb.shape[1]), 3.0, min_elevation_deg=3.0, **more)


def test_a_picture_on_its_head_is_refused():
    """The ground would be fitted as sky."""
    rgb = take(preetham(12.0), latlong(180), 40.0, sun=False)
    check_upright(shot(rgb))
    with pytest.raises(TwilightError, match="stands on its head"):
        check_upright(shot(rgb[::-1]))


def test_over_exposed_skies_and_lamps():
    """Burnt sky or lamps would be fitted as light of the sun."""
    camera = latlong(180)
    rgb = take(preetham(12.0), camera, 40.0, sun=False)
    azimuth, elevation = camera.azimuth_elevation(camera.pixel_centres())

    def told(burnt):
        one = shot(rgb)
        burning = type(one.picture)(**{**vars(one.picture), "saturated": burnt})
        return check_sky(shot(rgb), Photograph(burning, camera, 3.0, min_elevation_deg=3.0).seen(40.0, None))

    assert told(np.zeros(elevation.shape, bool)) == []
    with pytest.raises(TwilightError, match="is over-exposed"):
        told((elevation > 0) & (azimuth < 290))
    assert "over-exposed and left out" in told((elevation > 0) & (azimuth < 110))[0]
    lamps = (elevation > 10) & (elevation < 16) & ((np.abs(azimuth - 40) < 4) | (np.abs(azimuth - 120) < 4))
    assert any("2 lights" in line for line in told(lamps))


@pytest.mark.parametrize(("radius", "method", "axis"), [(0.5, "disc", 80), (3.0, "aureole", 80), (13.0, "aureole", 30)])
def test_an_aureole_at_the_end_of_the_scale_is_no_disc(radius, method, axis):
    """The middle of what is burnt lies lower than the sun: it would turn the camera, or be the sun's height."""
    camera = perspective(300, 200, azimuth_deg=axis, elevation_deg=12.0)
    rgb = take(preetham(6.0), camera, 75.0, sun=False)
    azimuth, elevation = camera.azimuth_elevation(camera.pixel_centres())
    # further down than up, as the sky is brighter there
    away = np.hypot(azimuth - 75.0, (elevation - 6.0) / np.where(elevation < 6.0, 1.6, 1.0))
    burning = type(picture(rgb))(**{**vars(picture(rgb)), "saturated": away < radius})
    found = Photograph(burning, camera, 3.0, min_elevation_deg=3.0).sun
    assert found.method == method and abs(found.azimuth_deg - 75.0) < (0.3 if axis == 80 else 2 * found.uncertainty_deg)
    assert (found.disc_elevation_deg is None) == (method == "aureole")
    assert abs(found.elevation_deg - 6.0) < 2.0 * found.elevation_error_deg
    if radius == 3.0:
        assert found.elevation_deg < 5.5


def test_a_night_s_exposure_is_refused(tmp_path):
    """The same picture by 1/100 s and by 30 s: the second is of moonlight, whatever it looks like."""
    rgb = take(preetham(12.0), perspective(160, 120), 75.0, sun=False)
    for seconds in (0.01, 30.0):
        path = jpeg(tmp_path / "a.jpg", rgb, taken=TAKEN | {BASE.ExposureTime: seconds, BASE.ISOSpeedRatings: 6400})
        found = read_photograph(path)
        seen = found.seen(75.0, None)
        if seconds == 30.0:
            with pytest.raises(TwilightError, match="a night, or moonlight"):
                check_sky(found, seen)
        else:
            assert not any("night" in line for line in check_sky(found, seen))


def test_a_camera_that_was_used_turns():
    """Fails if what was derived of the camera as it was held before stayed with it."""
    before = shot(np.full((60, 80, 3), 0.3), perspective(80, 60, elevation_deg=10.0))
    middle = before.camera.principal_point_px
    assert before.camera.azimuth_elevation(middle)[1] == pytest.approx(10.0)
    after = before.turned(5.0, 0.0, (0.0, 0.0, 0.0), 2.0)
    assert after.camera.azimuth_elevation(middle)[1] == pytest.approx(15.0)
    assert after.camera.focal_length_px == pytest.approx(before.camera.focal_length_px / 1.02)


def test_whole_steps_are_an_error_of_dark_colours():
    """A step of chroma is 2 % of red and blue in a dark sky, less in a bright one, and none of floats."""
    xyz = np.linalg.inv(xyz_to_rgb_matrix("cie1931_2deg")) @ np.array([[0.05, 0.06, 0.1], [0.4, 0.45, 0.5]]).T
    frame = Frame(np.array([30.0, 10.0]), np.zeros(2), xyz.T, np.ones(2), sun_deg=5.0)
    luma, blue, red = (step for step, _ in replace(frame, eight_bits=True).rounded())
    assert 0.01 < abs(red[1, 0]) < 0.12 and abs(blue[2, 0]) > 0.02
    assert (np.abs(luma[0]) > 0.005).all() and abs(red[1, 1]) < 0.5 * abs(red[1, 0])
    free = Freedom(curve=True, white_balance=True)
    wide, narrow = (Errors([replace(frame, eight_bits=e)], free, 0.02, [5.0]) for e in (True, False))
    assert np.diag(wide.covariance(1.0))[2] > np.diag(narrow.covariance(1.0))[2]


def no_sky(y, x):
    """Leaves, or a page of text."""
    return np.random.default_rng(1).uniform(0.02, 0.6, (*y.shape, 3))


def moon(y, x):
    """A disc in a black sky."""
    return np.repeat(np.where(np.hypot(y - 40, x - 80) < 5, 0.9, 2e-5)[..., None], 3, axis=-1)


def burnt(y, x):
    """White above black ground."""
    return np.repeat(np.where(y < 90, 1.0, 0.01)[..., None], 3, axis=-1)


@pytest.mark.parametrize(
    ("made", "taken", "said"),
    [
        (no_sky, {}, "hold clear sky"),
        (moon, {BASE.ISOSpeedRatings: 1600}, "a night, or moonlight|hold clear sky"),
        (burnt, {}, "over-exposed|hold clear sky"),
        (lambda y, x: no_sky(y, x)[::-1] * (y < 90)[..., None] + burnt(90 - y, x), {}, "stands on its head|hold clear"),
        (lambda y, x: np.full((1, 1, 3), 0.3), {}, "from 2 to 100000 pixels"),
    ],
    ids=["no sky", "moon", "burnt", "screenshot with a bright half", "one pixel"],
)
def test_pictures_that_say_nothing_are_refused_in_a_sentence(tmp_path, made, taken, said):
    """A wall, a moon or a screenshot would be given an air."""
    y, x = np.indices((120, 160))
    path = jpeg(tmp_path / "a.jpg", made(y, x), taken=TAKEN | taken)
    with pytest.raises(TwilightError, match=said) as refused:
        twilight.estimate(path, sun_elevation_deg=5.0, sun_azimuth_deg=301.5)
    assert len(str(refused.value).splitlines()) == 1


def phone_curve(light, contrast, shoulder):
    toned = 0.18 * (light / 0.18) ** contrast
    return toned / (1.0 + (toned / 1.05) ** shoulder) ** (1.0 / shoulder)


def filmic(light):
    """J. Hable's curve."""
    return (light * (0.15 * light + 0.05) + 0.004) / (light * (0.15 * light + 0.5) + 0.06) - 0.02 / 0.3


@pytest.mark.parametrize(
    "curve",
    [
        lambda light: phone_curve(light, 0.85, 1.2),
        lambda light: phone_curve(light, 1.35, 2.0),
        lambda light: 1.4 * 1.3 * light / (1.0 + 1.3 * light),
        lambda light: filmic(4.0 * light) / filmic(11.2),
    ],
)
def test_the_shapes_of_a_tone_curve_hold_those_of_phones(curve):
    """A curve that three numbers cannot undo to 1.5 % makes the haze thicker and the ozone less than they are."""
    light = np.exp(np.linspace(np.log(0.02), np.log(0.8), 60))
    stored = np.log(curve(light))
    middle = float(stored.mean())
    shapes = np.vstack([np.ones(60), tone_shapes(stored - middle, middle)])
    left = stored - np.log(light)
    numbers = np.linalg.lstsq(shapes.T, left, rcond=None)[0]
    assert np.abs(left - numbers @ shapes).max() < 0.015
    grey = np.linalg.inv(xyz_to_rgb_matrix(OBSERVER)).sum(axis=1)
    undone = Curve(middle, tuple(numbers[1:])).undo(np.exp(stored)[:, None] * grey)
    spread = np.log(colour.xyz_to_linear_rgb(undone, OBSERVER)[:, 1] / light)
    assert np.ptp(spread) < 0.03


def test_a_series_has_one_camera():
    """Pictures of a camera that was not moved keep angles of their own: the dusk is compared with a sky 1 deg off."""
    flat = picture(np.full((200, 300, 3), 0.3))
    placed = []
    for elevation, error, sun, by_time, of_heading in ((16.0, 0.5, 283.0, 280.0, 0.2), (15.2, 1.5, 285.0, 285.0, 10.0)):
        camera = perspective(azimuth_deg=280.0, elevation_deg=elevation)
        shot = Photograph(flat, camera, 2.0, errors_deg=(10.0, error, 1.0), sun_elevation_deg=2.0, sun_azimuth_deg=sun)
        placed.append(replace(shot, between_deg=(2.0, 2.0), heading_error_deg=of_heading, by_time_deg=by_time))
    made = of_one_camera(placed)
    assert [one.camera.orientation.elevation_deg for one in made] == [16.0, 16.0]
    assert [one.errors_deg[1] for one in made] == [0.5, 0.5]
    assert [one.sun_azimuth_deg for one in made] == [283.0, 288.0]
    assert [one.heading_error_deg for one in made] == [0.2, 0.2]
