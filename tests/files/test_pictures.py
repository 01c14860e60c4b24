"""Pictures of a sky: where things stand in them, their exposure, and what else is in the files."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from toy_sky import DARK, GLOW_ELEVATION, brightest_uv, glow_sky, spot

from twilight.io import read_latlong_exr, read_spectral_exr, render_view, write_png, write_rgb_exr, write_spectral_exr
from twilight.io.picture import label_of, view_directions
from twilight.sky import colour


def metered(sky):
    """The exposure value of `exposure="auto"` for a picture of the whole sky."""
    weight = sky.solid_angle_sr()
    return colour.auto_exposure_ev100(colour.sky_to_xyz(sky)[..., 1], weight)


def test_panorama_has_the_sun_in_the_middle_and_the_horizon_below(tmp_path):
    """The panorama would be turned or upside down."""
    picture, _ = render_view(spot(), view="panorama", width=360)
    assert picture.shape == (90, 360, 3)
    u, v = brightest_uv(picture)
    assert u == pytest.approx(0.5, abs=0.005) and v == pytest.approx(1 - GLOW_ELEVATION / 90, abs=0.02)
    right = glow_sky(glow_elevation_deg=GLOW_ELEVATION, glow_azimuth_deg=60.0, floor=DARK)
    picture, _ = render_view(right, view="panorama", width=360)
    assert brightest_uv(picture)[0] == pytest.approx(0.5 + 60 / 360, abs=0.005)


def test_the_wide_picture_looks_at_the_sun_over_a_lit_ground(tmp_path):
    """The usual picture would look elsewhere, or its ground be lit wrongly."""
    sky = spot(ground_albedo=np.full(7, 0.25), direct_irradiance=np.zeros(7))
    picture, ev100 = render_view(sky, width=400)
    assert picture.shape == (180, 400, 3)
    elevation, azimuth = view_directions("wide", 400)
    u, v = brightest_uv(picture)
    assert azimuth[0, int(u * 400)] == pytest.approx(0.0, abs=0.5)
    assert elevation[int(v * 180), 0] == pytest.approx(GLOW_ELEVATION, abs=1.0)
    # the ground: albedo / pi times the illuminance, the same all over
    ground = picture[elevation[:, 0] < 0.0]
    assert ground.size and np.ptp(ground, axis=(0, 1)).max() == 0.0
    grey = colour.srgb_encode(colour.photographic(np.full(3, 0.25 / np.pi * sky.illuminance_lux()) * expose(ev100)))
    np.testing.assert_allclose(colour_luminance(ground[0, 0]), colour_luminance(grey), rtol=0.02)
    # who is high above the ground sees the horizon below 0 deg, which the sky does not hold
    high, _ = render_view(replace(sky, observer_altitude_km=10.0), width=400)
    assert high.shape[0] == int((elevation[:, 0] > 0.0).sum())
    label = label_of(replace(sky, provenance={"configuration": {"climate": {"name": "urban"}}}))
    assert label.startswith(f"sun {sky.sun_elevation_deg:+.1f}") and "urban" in label and "cd/m^2" in label
    plain = np.asarray(Image.open(write_png(sky, tmp_path / "a.png", width=400)))
    written = np.asarray(Image.open(write_png(sky, tmp_path / "b.png", width=400, label=True)))
    changed = (plain != written).any(axis=(1, 2))
    assert changed.any() and elevation[changed, 0].max() < 0.0


def expose(ev100):
    return float(colour.expose(1.0, ev100))


def colour_luminance(display):
    """Linear luminance of sRGB display values (3,)."""
    value = np.asarray(display)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4) @ colour.REC709_LUMINANCE


def test_the_photographic_curve_keeps_grey_and_hue_and_has_contrast():
    """Pictures would lose contrast, or turn hue where they are bright."""
    grey = np.full((1, 3), colour.MIDDLE_GREY)
    np.testing.assert_allclose(colour.photographic(grey), grey, rtol=1e-9)
    steps = colour.photographic(grey * np.array([[0.99], [1.01]]))[:, 0]
    slope = np.log(steps[1] / steps[0]) / np.log(1.01 / 0.99)
    assert slope == pytest.approx(colour.PHOTOGRAPHIC_CONTRAST * (1 - colour.MIDDLE_GREY), rel=1e-3)
    light = np.geomspace(1e-6, 1e6, 60)[:, None] * np.array([1.0, 0.5, 0.2])
    out = colour.photographic(light)
    # beyond 1, where a display clips, red may fall again while all three go to white
    assert np.all(np.diff(np.minimum(out[:, 0], 1.0)) >= -2e-3) and np.all(np.isfinite(out)) and out.max() < 1.2
    assert np.all(np.diff(out[:, 1:], axis=0) >= -2e-3)
    assert np.all(out[:, 0] >= out[:, 1] - 1e-12) and np.all(out[:, 1] >= out[:, 2] - 1e-12)
    assert np.all(colour.photographic(np.zeros((2, 3))) == 0.0)


def test_fisheye_has_the_sun_at_the_bottom_and_clockwise_to_the_right():
    """The fisheye would be mirrored."""
    picture, _ = render_view(spot(), view="fisheye", width=200)
    assert np.isnan(picture[0, 0]).all() and np.isfinite(picture[100, 100]).all()
    u, v = brightest_uv(np.nan_to_num(picture))
    assert u == pytest.approx(0.5, abs=0.01) and v == pytest.approx(0.5 + 0.5 * (90 - GLOW_ELEVATION) / 90, abs=0.02)
    right = glow_sky(glow_elevation_deg=GLOW_ELEVATION, glow_azimuth_deg=90.0, floor=DARK)
    assert brightest_uv(np.nan_to_num(render_view(right, view="fisheye", width=200)[0]))[0] > 0.8


def test_png_carries_the_provenance_and_the_exposure(tmp_path):
    """A picture would not say what made it."""
    sky = spot(provenance={"configuration": {"name": "ü" * 2000}, "run_time_s": 2.5})
    image = Image.open(write_png(sky, tmp_path / "sky.png", view="panorama", width=64))
    assert image.size == (64, 16) and image.mode == "RGB"
    assert json.loads(image.text["configuration"]) == {"name": "ü" * 2000}
    assert float(image.text["exposure_ev100"]) == pytest.approx(metered(sky), rel=1e-5)
    assert image.text["run_time_s"] == "2.5" and len(image.text["configuration_hash"]) == 64
    assert Image.open(write_png(sky, tmp_path / "eye.png", view="fisheye", width=64)).mode == "RGBA"


def test_given_exposure_holds_through_a_sequence(tmp_path):
    """A film would flicker."""
    sky = glow_sky()
    ev = metered(sky)
    same, used = render_view(sky, view="panorama", width=64, exposure=ev)
    assert used == ev
    np.testing.assert_array_equal(same, render_view(sky, view="panorama", width=64)[0])
    darker = replace(sky, sun_normalised_radiance=sky.sun_normalised_radiance / 16)
    assert render_view(darker, view="panorama", width=64, exposure=ev)[0].mean() < 0.5 * same.mean()
    np.testing.assert_allclose(render_view(darker, view="panorama", width=64)[0], same, atol=1e-9)


def test_dither_keeps_the_mean_within_a_fraction_of_a_step(tmp_path):
    """Dither would change the brightness."""
    flat = replace(glow_sky(), sun_normalised_radiance=np.full((30, 120, 7), 1e-4))
    picture, _ = render_view(flat, view="panorama", width=256)
    pixels = np.asarray(Image.open(write_png(flat, tmp_path / "a.png", view="panorama", width=256)), float)
    np.testing.assert_allclose(pixels.mean(axis=(0, 1)), picture.mean(axis=(0, 1)) * 255, atol=0.05)
    assert np.ptp(pixels[..., 0]) <= 1


@pytest.mark.parametrize(
    "value", [0.0, 1e-30, 1e30], ids=["black", "beyond half floats below", "beyond float32 when scaled"]
)
def test_extreme_skies_make_finite_files(tmp_path, value):
    """Black or blazing skies would be NaN in files."""
    sky = replace(glow_sky(), sun_normalised_radiance=np.full((30, 120, 7), value))
    picture, ev = render_view(sky, view="panorama", width=64)
    assert np.isfinite(picture).all() and np.isfinite(ev)
    # 1.5 times middle grey, through the curve
    grey = colour.srgb_encode(colour.photographic(np.full(3, 1.5 * colour.MIDDLE_GREY)))[0]
    assert (picture == 0).all() if value == 0 else picture.mean() == pytest.approx(grey, abs=0.03)
    rgb = read_latlong_exr(write_rgb_exr(sky, tmp_path / "a.exr", width=64)).rgb
    assert np.isfinite(rgb).all() and (rgb.max() > 0) == (value > 0)
    values = read_spectral_exr(write_spectral_exr(sky, tmp_path / "b.exr", width=64))[1]
    assert np.isfinite(values).all()


def test_partly_black_and_single_wavelength_skies_make_finite_grey_pictures(tmp_path):
    """One wavelength would be a coloured picture."""
    half = glow_sky(wavelength_nm=(550.0,))
    values = half.sun_normalised_radiance.copy()
    values[:, 40:80] = 0.0
    picture, _ = render_view(replace(half, sun_normalised_radiance=values), view="panorama", width=64)
    assert np.isfinite(picture).all()
    np.testing.assert_allclose(picture[..., 0], picture[..., 2], atol=1e-6)
    found = read_latlong_exr(write_rgb_exr(half, tmp_path / "a.exr", width=64))
    assert found.attributes["twilightColour"].startswith("grey")
    np.testing.assert_allclose(found.rgb[..., 0], found.rgb[..., 1], rtol=3e-5)
