"""Photographs against computed skies: directions, masks, the sun's azimuth, and the figures of a comparison."""

import re
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from photographs import eight_bit, fisheye, latlong, perspective, picture, preetham, take

from twilight.base.errors import TwilightError
from twilight.io.stored_image import read_image
from twilight.sky import colour
from twilight.studies.validate.photographs import comparison as comparing
from twilight.studies.validate.photographs import mask as masks
from twilight.studies.validate.photographs.picture import Photograph, place_sun
from twilight.studies.validate.photographs.picture_sky import fine_sky, mask_image_on
from twilight.studies.validate.photographs.sun_azimuth import find_sun_azimuth

PANORAMAS = Path(__file__).parents[1] / "data" / "photos"


@lru_cache(maxsize=4)
def sky(sun_elevation_deg=12.0):
    return preetham(sun_elevation_deg)


def photograph(camera, sun_azimuth_deg, through=picture, **more):
    return Photograph(through(take(sky(), camera, sun_azimuth_deg, **more)), camera, 3.0)


# Directions -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("camera", [latlong(), fisheye(), perspective()], ids=["latlong", "fisheye", "perspective"])
def test_a_panorama_holds_what_was_rendered(camera):
    """Projection, distortion and vignetting are undone: the panorama is the sky up to one factor."""
    fine = fine_sky(picture(take(sky(), camera, 100.0, sun=False)), camera, 3.0, 6, 100.0)
    rows = fine.rows_deg > 3
    xyz = colour.sky_to_xyz(sky(), observer="cie1931_2deg")
    truth = colour.xyz_to_linear_rgb(sky().smooth(xyz, fine.rows_deg[rows, None], fine.columns_deg[None]))
    with np.errstate(invalid="ignore"):
        ratio = np.log(fine.rgb[rows] / truth)
    away = masks.separation_deg(fine.rows_deg[rows, None], fine.columns_deg[None], 12.0, 0.0) > 8.0
    if camera.projection != "latlong":  # the outermost pixels of a lens are half dark
        away &= fine.rows_deg[rows, None] > 5
    ratio = ratio[np.isfinite(ratio[..., 0]) & away]
    assert ratio.size > 1000
    assert np.abs(ratio - np.median(ratio)).max() < 0.03


def test_a_large_picture_is_averaged_not_picked_from():
    """Fine structure would alias into the sky's radiance."""
    camera = latlong(2048)
    rgb = np.ones((1024, 2048, 3))
    rgb[:, ::2] = 3.0  # stripes of one pixel
    fine = fine_sky(picture(rgb), camera, 5.0, 2)
    assert np.abs(fine.rgb - 2.0).max() < 0.1


def test_the_size_must_be_the_cameras():
    """A scaled picture would be read with the wrong directions."""
    with pytest.raises(TwilightError, match="256 x 128 pixels"):
        fine_sky(picture(np.ones((100, 200, 3))), latlong())
    with pytest.raises(TwilightError, match="nothing above the horizon"):
        down = perspective(elevation_deg=-70.0)
        fine_sky(picture(np.ones((200, 300, 3))), down)


# Masks ----------------------------------------------------------------------------------------------------------


def hills(azimuth_deg):
    return 6.0 + 4.0 * np.sin(np.radians(3 * azimuth_deg))


def test_hills_and_a_cloud_are_masked_and_the_sky_is_not():
    """Hills and clouds would be compared with clear sky."""
    camera = latlong(720)
    rgb = take(sky(), camera, 0.0, sun=False)
    azimuth, elevation = camera.azimuth_elevation(camera.pixel_centres())
    ground = elevation < hills(azimuth)
    random = np.random.default_rng(2)
    level = np.median(rgb)
    rgb[ground] = level * np.array([0.5, 0.4, 0.2]) * random.uniform(0.7, 1.3, (ground.sum(), 1))
    cloud = np.exp(-(((azimuth - 200) / 5) ** 2) - ((elevation - 35) / 3) ** 2)
    rgb += 0.5 * cloud[..., None] * level
    fine = fine_sky(picture(rgb), camera, 2.0, 4)
    mask = masks.masked(fine, sun=(0.0, 12.0))
    rows, columns = fine.rows_deg[:, None], fine.columns_deg[None, :]
    clear = (rows > hills(columns) + 2) & (np.hypot((columns - 200) / 15, (rows - 35) / 9) > 1)
    clear &= masks.separation_deg(rows, columns, 12.0, 0.0) > 8
    assert not mask.valid[np.broadcast_to(rows < hills(columns), mask.valid.shape)].any()
    assert not mask.valid[(np.abs(columns - 200) < 4) & (np.abs(rows - 35) < 2)].any()
    assert mask.valid[clear].mean() > 0.97
    assert set(mask.taken) == {"glare of the sun", "ground, trees, buildings", "clouds"}


def test_mask_image_and_saturation():
    """A mask of the user's would lie turned, or burnt pixels count as light."""
    camera = latlong(360)
    rgb = take(sky(), camera, 0.0, sun=False)
    fine = fine_sky(picture(rgb), camera, 2.0, 4, 30.0)
    shown = np.ones((180, 360))
    shown[:, 100:150] = 0.0  # azimuths 280 to 330 of the camera
    image = mask_image_on(fine, shown, camera)
    world = np.mod(fine.columns_deg + 30.0, 360.0)
    above = fine.rows_deg > 0
    assert not image[above][:, (world > 280) & (world < 330)].any()
    assert image[above][:, (world < 278) | (world > 332)].all()
    burnt = picture(rgb)
    burnt.saturated[40:42, 180:182] = True
    mask = masks.masked(fine_sky(burnt, camera, 2.0, 4), automatic=False)
    assert set(mask.taken) == {"saturated or black"}


def test_growing_a_mask_is_round_on_the_sphere():
    """Masks near the zenith would grow far too little in azimuth."""
    fine = fine_sky(picture(np.ones((90, 180, 3))), latlong(180), 2.0, 4)
    one = np.zeros(fine.covered.shape, bool)
    row = np.abs(fine.rows_deg - 60.25).argmin()
    one[row, 3] = True
    grown = masks.dilate(one, fine, 3.0)
    centre = fine.rows_deg[row], fine.columns_deg[3]
    away = masks.separation_deg(fine.rows_deg[:, None], fine.columns_deg[None], *centre)
    assert grown[away < 2.5].all() and not grown[away > 3.8].any()


# The sun's azimuth ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("azimuth", [3.0, 147.3, 301.6])
def test_the_azimuth_is_found_by_symmetry(azimuth):
    """A panorama without north would be compared under a turned sun, or claim to know better than it does."""
    found = photograph(latlong(), azimuth, sun=False, noise=0.01).sun
    assert found.method == "symmetry"
    assert abs((found.azimuth_deg - azimuth + 180) % 360 - 180) < max(1.0, 3 * found.uncertainty_deg)
    assert found.uncertainty_deg < 3.0


def test_the_disc_is_taken_where_it_is_seen():
    """A sun in the picture would be guessed by symmetry."""
    found = photograph(fisheye(), 222.2, noise=0.01).sun
    assert found.method == "disc"
    assert found.azimuth_deg == pytest.approx(222.2, abs=0.5)
    assert found.elevation_deg == pytest.approx(12.0, abs=0.5)


def test_a_light_beside_a_sun_that_is_given_is_no_disc():
    """A glow at 12 deg under a sun said to stand at -4 deg: the sky's symmetry tells where that is, and a sentence."""
    shot = photograph(latlong(), 147.3, noise=0.01)
    azimuth, _, note, disc = place_sun(shot, None, None, (-4.0, -4.0))
    assert re.search(r"by the symmetry of the sky; the light at 11\.\d deg is not taken for its disc", note)
    assert azimuth == pytest.approx(147.3, abs=3.0) and disc is None
    assert "by the sun's disc (" in place_sun(shot, None, None, (12.5, 12.5))[2]


def test_a_sky_without_a_meridian_has_no_azimuth():
    """An overcast picture would get an azimuth made of its noise."""
    camera = latlong()
    _, elevation = camera.azimuth_elevation(camera.pixel_centres())
    flat = np.where(elevation > 0, 1.0 + 0.001 * elevation, 0.1)[..., None] * np.ones(3)
    flat *= 1 + 0.02 * np.random.default_rng(0).standard_normal(flat.shape)
    fine = fine_sky(picture(flat), camera, 3.0, 6)
    with pytest.raises(TwilightError, match="--sun-azimuth"):
        find_sun_azimuth(fine, np.broadcast_to(fine.rows_deg[:, None] > 1, fine.covered.shape))


@pytest.mark.parametrize("away", [60.0, 90.0, 120.0])
def test_a_sun_far_beside_a_narrow_picture_has_no_azimuth(away):
    """The edge of the picture would be the sun's azimuth, 95 deg off and said to be within 8."""
    with pytest.raises(TwilightError, match="--sun-azimuth"):
        print(photograph(perspective(azimuth_deg=70.0), 70.0 + away, sun=False, noise=0.01).sun)


def test_the_sun_of_the_panoramas():
    """The disc stands at 36.0 deg in the one; the symmetry finds it within 2 deg, and 47.8 in the other, at dawn."""
    files = (PANORAMAS / f"{name}_256.hdr" for name in ("rooitou_park", "kiara_1_dawn"))
    day, dawn = (Photograph(read_image(file), latlong(), 3.0).sun for file in files)
    assert day.method == "disc" and day.azimuth_deg == pytest.approx(36.0, abs=1.0)
    assert dawn.method == "symmetry" and dawn.azimuth_deg == pytest.approx(47.8, abs=2.5)


# Comparison -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "camera, through",
    [(latlong(720), picture), (fisheye(500), picture), (latlong(720), eight_bit)],
    ids=["latlong", "fisheye", "8 bit"],
)
def test_a_rendered_sky_agrees_with_itself(camera, through):
    """A photograph of the very sky would be called different from it."""
    shot = photograph(camera, 130.0, through, noise=0.01)
    found = comparing.compare(shot.seen(130.0, 12.0), sky()).figures
    assert found["luminance_median_percent"] < 0.5 and found["luminance_rms_percent"] < 2.0
    assert found["solar_meridian_rms_percent"] < 4.0
    assert found["uv_distance_p95"] < 0.002
    assert found["correlation_of_log_luminance"] > 0.999
    assert found["fraction_of_hemisphere"] > 0.7


def test_exposure_and_white_balance_are_recovered():
    """A camera's white balance would count as a colour of the sky."""
    camera = latlong(360)
    gains = np.array([1.3, 1.0, 0.6])
    rgb = take(sky(), camera, 0.0, exposure=1e-3) * gains
    seen = Photograph(picture(rgb), camera, 3.0).seen(0.0, 12.0)
    without = comparing.compare(seen, sky())
    assert without.figures["uv_distance_median"] > 0.02
    found = comparing.compare(seen, sky(), white_balance=True)
    assert found.figures["uv_distance_median"] < 0.001
    ratio = found.balance.gains * gains
    assert np.abs(ratio / ratio.mean() - 1).max() < 0.01
    assert found.balance.exposure * ratio.mean() == pytest.approx(1e3, rel=0.01)


@pytest.mark.slow
def test_another_sun_is_seen_as_another_sky():
    """A sun 8 deg too high would fit as well."""
    seen = photograph(latlong(360), 0.0).seen(0.0, 12.0)
    same, other = (comparing.compare(seen, preetham(e)).figures for e in (12.0, 20.0))
    assert other["luminance_rms_percent"] > 5 * same["luminance_rms_percent"]
    residuals = [comparing.residual_vector(seen, comparing.simulated_sky(preetham(e), seen)) for e in (12.0, 20.0)]
    assert residuals[1] @ residuals[1] > 20 * (residuals[0] @ residuals[0])


def test_figures_follow_their_definitions():
    """A photograph 10 % brighter towards the sun and darker away: rms, median and ratio map say so."""
    seen = photograph(latlong(360), 0.0, sun=False).seen(0.0, None)
    simulated = comparing.simulated_sky(sky(), seen)
    half = np.abs(np.mod(seen.azimuth_deg + 180, 360) - 180) < 90
    factor = np.where(half, 1.1, 1 / 1.1)[None, :, None]
    changed = replace(seen, xyz=simulated.xyz * factor, fine_xyz=simulated.fine_xyz)
    found = comparing.compare(changed, sky())
    there = np.isfinite(found.log_ratio)
    spread = found.log_ratio[there] - np.log(np.broadcast_to(factor[..., 0], there.shape)[there])
    assert np.ptp(spread) < 1e-9
    assert found.figures["luminance_median_percent"] == pytest.approx(100 * np.log(1.1), rel=0.05)
    assert found.figures["uv_distance_p95"] < 1e-9


def test_a_grey_photograph_has_no_colour():
    """A grey picture would be judged by its colours."""
    camera = latlong(360)
    grey = take(sky(), camera, 0.0, sun=False).mean(axis=-1, keepdims=True) * np.ones(3)
    seen = Photograph(replace(picture(grey), grey=True), camera, 3.0).seen(0.0, None)
    found = comparing.compare(seen, sky())
    assert "uv_distance_median" not in found.figures and found.figures["luminance_rms_percent"] < 20
    with pytest.raises(TwilightError, match="white balance"):
        comparing.compare(seen, sky(), white_balance=True)
    assert comparing.residual_vector(seen, found.simulated).size == found.figures["cells"]


def test_a_photograph_of_no_sky_is_refused():
    """Figures would come from a picture with its sky masked."""
    camera = latlong(360)
    shot = Photograph(picture(take(sky(), camera, 0.0)), camera, 3.0, mask_image=np.zeros((180, 360)))
    with pytest.raises(TwilightError, match="clear sky"):
        shot.seen(0.0, 12.0)
