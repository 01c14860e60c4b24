"""Where things stand in pictures and environment maps, and what else is in the files."""

import json
import re
from dataclasses import replace
from datetime import datetime, timedelta, timezone

import numpy as np
import OpenEXR
import pytest
from toy_sky import GLOW_ELEVATION, SUN_AZIMUTH, brightest_uv, glow_sky, spot, unit_vector

from twilight.base.errors import TwilightError
from twilight.io import exr, read_latlong_exr, read_spectral_exr, write_hdr, write_rgb_exr, write_spectral_exr
from twilight.io.environment import RENDERERS, environment_directions
from twilight.io.environment_files import to_rgbe
from twilight.io.folder import write_outputs
from twilight.sky import colour
from twilight.sky.sky import Sky

# What each renderer does with a direction (its own axes), from its documentation or source.


def openexr_uv(east, north, up):
    x, y, z = -east, up, north  # +Y up, +Z north, so +X is west
    return 0.5 - np.arctan2(x, z) / (2 * np.pi), 0.5 - np.arcsin(y) / np.pi  # ImfEnvmap: LatLongMap::pixelPosition


def blender_uv(east, north, up):
    x, y, z = east, north, up
    # Cycles: direction_to_equirectangular, v from below.
    return 0.5 - np.arctan2(y, x) / (2 * np.pi), 1 - (np.arctan2(z, np.hypot(x, y)) / np.pi + 0.5)


def radiance_uv(east, north, up):
    dx, dy, dz = east, north, up
    # genssky: u = Atan2(Dy,Dx)/PI+1 over a picture of width 2, v = 1-Acos(Dz)/PI from below.
    return (np.arctan2(dy, dx) / np.pi + 1) / 2, np.arccos(dz) / np.pi


def pbrt_uv(east, north, up):
    # Clarberg's equal-area map from the sphere to the square.
    x, y, z = abs(east), abs(north), abs(up)
    r = np.sqrt(1 - z)
    phi = np.arctan2(min(x, y), max(x, y)) * 2 / np.pi
    if x < y:
        phi = 1 - phi
    v = phi * r
    u = r - v
    if up < 0:
        u, v = 1 - v, 1 - u
    return (np.copysign(u, east) + 1) / 2, (np.copysign(v, north) + 1) / 2


UV_OF = {"openexr": openexr_uv, "mitsuba": openexr_uv, "blender": blender_uv, "radiance": radiance_uv, "pbrt": pbrt_uv}


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("azimuth", [10.0, 100.0, 190.0, 300.0])
def test_a_spot_is_where_the_renderer_looks_for_it(tmp_path, renderer, azimuth):
    """A renderer would be lit from another side."""
    sky = replace(spot(), sun_azimuth_deg=azimuth)
    found = brightest_uv(read_latlong_exr(write_rgb_exr(sky, tmp_path / "a.exr", renderer=renderer, width=256)).rgb)
    expected = UV_OF[renderer](*unit_vector(GLOW_ELEVATION, azimuth))
    np.testing.assert_allclose(found, expected, atol=1.0 / 128)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_every_pixel_centre_goes_back_to_itself(renderer):
    """A map would be shifted by half a pixel."""
    elevation, azimuth = np.broadcast_arrays(*environment_directions(renderer, 32))
    height, width = elevation.shape
    for row in range(height):
        for column in range(width):
            direction = unit_vector(elevation[row, column], azimuth[row, column])
            u, v = UV_OF[renderer](*direction)
            np.testing.assert_allclose([u * width, v * height], [column + 0.5, row + 0.5], atol=1e-6)


def test_rgb_exr_is_upright_in_mitsuba(tmp_path):
    """A mirror ball would show the sky turned or upside down."""
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    sky = glow_sky(glow_elevation_deg=GLOW_ELEVATION, sun_azimuth_deg=SUN_AZIMUTH, ground_albedo=np.full(7, 0.0))
    path = write_rgb_exr(sky, tmp_path / "sky.rgb.exr", renderer="mitsuba")
    sun = unit_vector(GLOW_ELEVATION, SUN_AZIMUTH)
    sun = np.array([-sun[0], sun[2], sun[1]])  # +X west, +Y up, +Z north
    for origin in ([0, 0, 4], [0, 0, -4], [4, 0, 0]):
        scene = mitsuba.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "aov", "aovs": "n:sh_normal", "image": {"type": "path", "max_depth": 3}},
                "sky": {"type": "envmap", "filename": str(path)},
                "ball": {"type": "sphere", "bsdf": {"type": "conductor", "material": "none"}},
                "sensor": {
                    "type": "orthographic",
                    "to_world": mitsuba.ScalarTransform4f().look_at(origin, [0, 0, 0], [0, 1, 0]),
                    "film": {"type": "hdrfilm", "width": 96, "height": 96, "rfilter": {"type": "box"}},
                    "sampler": {"type": "independent", "sample_count": 2},
                },
            }
        )
        image = np.array(mitsuba.render(scene))
        light, normal = image[..., :3].sum(axis=-1), image[..., 3:6]
        ball = np.linalg.norm(normal, axis=-1) > 0.9
        normal = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
        forward = -np.array(origin) / 4.0
        mirrored = forward - 2 * (normal @ forward)[..., None] * normal
        # Where the ball turns away one pixel covers much sky; look at the rest.
        ball &= normal @ forward < -0.3
        seen = mirrored[ball][light[ball].argmax()]
        assert np.degrees(np.arccos(np.clip(seen @ sun, -1, 1))) < 3.0
        away = mirrored @ sun < 0.5
        assert light[ball & away & (mirrored[..., 1] > 0.1)].min() > 0
        assert light[ball & (mirrored[..., 1] < -0.1)].max() == 0


def test_rgb_exr_has_three_channels_and_says_what_it_is(tmp_path):
    """A file would not say what its numbers are."""
    sky = spot(
        latitude_deg=49.25,
        longitude_deg=7.0,
        observer_altitude_km=0.25,
        time=datetime(2003, 12, 8, 16, 30, tzinfo=timezone(timedelta(hours=1))),
        provenance={"configuration": {"name": "T1"}, "hash": "cd" * 32, "run_time_s": 2.5, "version": "9.9"},
    )
    path = write_rgb_exr(sky, tmp_path / "sky.rgb.exr", width=64)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header, channels = file.header(), file.channels()
        assert sorted(channels) == ["B", "G", "R"]
        assert channels["R"].pixels.dtype == np.float32 and channels["R"].pixels.shape == (32, 64)
        assert header["compression"] == OpenEXR.ZIP_COMPRESSION and header["envmap"] == OpenEXR.ENVMAP_LATLONG
        assert header["whiteLuminance"] == pytest.approx(683.002)
        np.testing.assert_allclose(header["chromaticities"][:2], [0.64, 0.33], rtol=1e-6)
        assert (header["latitude"], header["longitude"], header["altitude"]) == (49.25, 7.0, 250.0)
        assert header["capDate"] == "2003:12:08 16:30:00" and header["utcOffset"] == -3600.0
        assert json.loads(header["twilightConfiguration"]) == {"name": "T1"}
        assert header["twilightConfigurationHash"] == "cd" * 32 and header["twilightVersion"] == "9.9"
        assert header["twilightRunTimeS"] == 2.5


def test_rgb_exr_holds_the_luminance_and_a_latlong_sky_pixel_by_pixel(tmp_path):
    """Pixels would not be the sky's luminance."""
    sky = glow_sky().resample((np.arange(16) + 0.5) * 5.625, (np.arange(64) + 0.5) * 5.625)
    found = read_latlong_exr(write_rgb_exr(sky, tmp_path / "a.exr", width=64))
    rgb = colour.sky_to_linear_rgb(sky) / 683.002
    # Azimuth 0 is in the middle; Sky's rows go up.
    np.testing.assert_allclose(found.rgb[:16], np.roll(rgb[::-1], 32, axis=1), rtol=1e-5, atol=1e-9)
    luminance = found.rgb[:16] @ colour.REC709_LUMINANCE * found.attributes["whiteLuminance"]
    np.testing.assert_allclose(luminance, np.roll(sky.luminance()[::-1], 32, axis=1), rtol=1e-5)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_colours_outside_the_gamut_stay_negative_except_for_renderers(tmp_path, renderer):
    """A renderer would get negative light, or the colour move in brightness."""
    sky = glow_sky(floor=1e-3, glow_elevation_deg=60)
    deep_blue = replace(sky, sun_normalised_radiance=sky.sun_normalised_radiance * (sky.wavelength_nm / 450) ** -16)
    found = read_latlong_exr(write_rgb_exr(deep_blue, tmp_path / "a.exr", renderer=renderer, width=64)).rgb
    assert (found.min() < -1e-6) == (renderer == "openexr")
    if renderer == "mitsuba":  # the same orientation: only the colour has moved, not the luminance
        kept = read_latlong_exr(write_rgb_exr(deep_blue, tmp_path / "b.exr", width=64)).rgb
        np.testing.assert_allclose(found @ colour.REC709_LUMINANCE, kept @ colour.REC709_LUMINANCE, rtol=1e-4)


def test_ground_is_lambertian_and_black_without_albedo(tmp_path):
    """The ground of a map would be too bright."""
    sky = replace(glow_sky(), ground_albedo=np.full(7, 0.4), direct_irradiance=np.full(7, 0.5))
    found = read_latlong_exr(write_rgb_exr(sky, tmp_path / "a.exr", width=64))
    expected = 0.4 / np.pi * sky.illuminance_lux(direct=True)
    np.testing.assert_allclose(found.rgb[16:] @ colour.REC709_LUMINANCE * 683.002, expected, rtol=1e-5)
    dark = read_latlong_exr(write_rgb_exr(replace(sky, ground_albedo=None), tmp_path / "b.exr", width=64))
    assert (dark.rgb[16:] == 0).all() and (dark.rgb[:16].sum(axis=-1) > 0).all()


def test_an_observer_high_up_sees_sky_below_the_horizon(tmp_path):
    """Sky below the horizontal would be cut off; a sky without azimuth be turned by chance."""
    elevation, azimuth = np.linspace(-10.0, 88.0, 50), np.arange(40) * 9.0
    sky = Sky([450.0, 550.0, 650.0], elevation, azimuth, np.full((50, 40, 3), 0.01), 5.0)
    rows = read_latlong_exr(write_rgb_exr(sky, tmp_path / "a.exr", width=360)).rgb[:, 0, 1]
    assert (rows[:101] > 0).all() and (rows[101:] == 0).all()  # the lowest row reaches down to -11 deg
    sky = replace(spot(), sun_azimuth_deg=None)
    found = read_latlong_exr(write_rgb_exr(sky, tmp_path / "a.exr", width=128))
    assert brightest_uv(found.rgb)[0] == pytest.approx(0.5, abs=0.01)
    assert "not known" in found.attributes["twilightSunAzimuth"]


def test_spectral_exr_follows_the_layout_and_reads_elsewhere(tmp_path):
    """Other readers of spectral EXR would find other wavelengths."""
    sky = glow_sky(wavelength_nm=(400.0, 455.25, 550.0, 700.0), sun_azimuth_deg=SUN_AZIMUTH)
    path = write_spectral_exr(sky, tmp_path / "sky.spectral.exr", width=64)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        assert set(file.channels()) == {
            *"RGB", "S0.400,000000nm", "S0.455,250000nm", "S0.550,000000nm", "S0.700,000000nm",
        }  # fmt: skip
        header = file.header()
        assert header["spectralLayoutVersion"] == "1.0" and header["emissiveUnits"] == "W.m^-2.sr^-1"
        assert header["twilightRadianceUnits"] == "W.m^-2.sr^-1.nm^-1"
        assert "polarisationHandedness" not in header
        assert header["twilightWavelengthBoundsNm"].split(";")[0] == "372.375:427.625"
    wavelength, values, _ = read_spectral_exr(path)
    np.testing.assert_array_equal(wavelength, sky.wavelength_nm)
    elevation, azimuth = environment_directions("openexr", 64)
    expected = sky.smooth(sky.radiance, elevation[:16], azimuth - SUN_AZIMUTH)
    np.testing.assert_allclose(values[:16], expected, rtol=1e-5)
    pytest.importorskip("OpenImageIO")
    import colour as science

    components, specification = science.read_spectral_image_Fichet2021(path, additional_data=True)
    assert specification.is_emissive and not specification.is_polarised
    np.testing.assert_array_equal(components["S0"][0], sky.wavelength_nm)
    np.testing.assert_array_equal(components["S0"][1], values)


def test_spectral_exr_keeps_the_night_and_holds_a_thousand_wavelengths(tmp_path):
    """A night would be lost in half floats, or many wavelengths in names."""
    wavelength = np.linspace(301.0, 999.0, 1000)
    elevation, azimuth = np.array([15.0, 45.0, 75.0]), np.arange(4) * 90.0
    sky = Sky(wavelength, elevation, azimuth, np.full((3, 4, 1000), 1e-14), -18.0)
    found, values, _ = read_spectral_exr(write_spectral_exr(sky, tmp_path / "a.exr", width=8))
    np.testing.assert_allclose(found, wavelength, atol=1e-6)
    np.testing.assert_allclose(values[:2], np.broadcast_to(sky.radiance[0, 0], (2, 8, 1000)), rtol=1e-5)


@pytest.mark.parametrize("reader", [read_latlong_exr, read_spectral_exr])
def test_a_bad_exr_is_refused_in_one_sentence(tmp_path, reader):
    """A file cut off would be a traceback of OpenEXR."""
    path = write_spectral_exr(glow_sky(), tmp_path / "a.exr", width=64)
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(TwilightError, match=r"a\.exr: is not a complete OpenEXR file") as caught:
        reader(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(TwilightError, match="no such file"):
        reader(tmp_path / "none.exr")


@pytest.mark.parametrize("width", [16, 128, 300])
def test_radiance_picture_is_the_same_map_to_the_precision_of_the_format(tmp_path, width):
    """The HDR picture would be another map."""
    reader = pytest.importorskip("OpenImageIO")
    sky = spot(provenance={"configuration": {"name": "T1"}})
    image = reader.ImageBuf(str(write_hdr(sky, tmp_path / "sky.rgb.hdr", width=width)))
    found = image.get_pixels(reader.FLOAT)
    exact = read_latlong_exr(write_rgb_exr(sky, tmp_path / "a.exr", renderer="radiance", width=width)).rgb
    exact = colour.into_gamut(exact) * (683.002 / 179.0)
    assert found.shape == exact.shape
    assert (np.abs(found - exact) <= exact.max(axis=-1, keepdims=True) / 127).all()
    assert b'TWILIGHT_CONFIGURATION= {"name": "T1"}' in (tmp_path / "sky.rgb.hdr").read_bytes()


def test_rgbe_keeps_night_and_day_and_black():
    """Light would be off by more than the format's step."""
    values = np.array([[1e-12, 5e-13, 0.0], [1.0, 0.5, 0.25], [3e4, 1.0, 0.0], [0.0, 0.0, 0.0], [255.9, 255.9, 255.9]])
    bytes_ = to_rgbe(values).astype(float)
    back = np.where(bytes_[:, 3:] > 0, (bytes_[:, :3] + 0.5) * 2.0 ** (bytes_[:, 3:] - 136), 0.0)
    assert (np.abs(back - values) <= values.max(axis=1, keepdims=True) / 250).all()
    assert (bytes_[3] == 0).all()


def test_rgb_file_is_not_taken_for_a_spectral_one(tmp_path):
    """RGB would be read as a spectrum."""
    with pytest.raises(TwilightError, match="Fichet"):
        read_spectral_exr(write_rgb_exr(glow_sky(), tmp_path / "a.exr", width=64))


@pytest.mark.parametrize("primaries", ["acescg", "rec2020"])
@pytest.mark.parametrize("renderer", ["openexr", "mitsuba"])
def test_other_primaries_are_the_same_light(tmp_path, primaries, renderer):
    """A map of other primaries would have other colours, and white would not be neutral."""
    sky = glow_sky(step_deg=10.0)
    plain = read_latlong_exr(write_rgb_exr(sky, tmp_path / "a.exr", renderer=renderer, width=64))
    path = write_rgb_exr(sky, tmp_path / "b.exr", renderer=renderer, width=64, primaries=primaries)
    other = read_latlong_exr(path)
    if renderer == "openexr":
        np.testing.assert_allclose(other.rgb, plain.rgb, rtol=1e-4, atol=1e-6)
    assert other.attributes["chromaticities"] == pytest.approx(exr.PRIMARIES[primaries])
    np.testing.assert_allclose(exr.from_rec709(primaries) @ np.ones(3), 1.0, atol=2e-3)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        raw = np.stack([file.channels()[name].pixels for name in "RGB"], axis=-1)
    assert renderer == "openexr" or raw.min() >= 0.0
    # OCIO's matrix of ACES from linear Rec. 709
    known = [[0.6131, 0.3395, 0.0474], [0.0702, 0.9164, 0.0135], [0.0206, 0.1096, 0.8698]]
    assert primaries != "acescg" or np.abs(exr.from_rec709("acescg") - known).max() < 5e-4


def test_half_floats_hold_the_light_or_are_not_taken(tmp_path, monkeypatch):
    """A large map would be four bytes a sample, or deep twilight lose its last bits without a word."""
    monkeypatch.setattr(exr, "HALF_FROM_WIDTH", 64)
    day = replace(glow_sky(step_deg=10.0), ground_albedo=np.full(7, 0.2))
    dark = replace(day, sun_normalised_radiance=1e-7 * day.sun_normalised_radiance)
    exact = read_latlong_exr(write_rgb_exr(day, tmp_path / "a.exr", width=64, exr="float")).rgb
    for asked in ("half", None):
        found = read_latlong_exr(write_rgb_exr(day, tmp_path / "b.exr", width=64, exr=asked)).rgb
        assert found.dtype == np.float16 and exact.dtype == np.float32
        assert np.abs(found - exact).max() <= 1e-3 * exact.max()
    assert read_latlong_exr(write_rgb_exr(dark, tmp_path / "c.exr", width=64)).rgb.dtype == np.float32
    assert read_latlong_exr(write_rgb_exr(day, tmp_path / "c.exr", width=32)).rgb.dtype == np.float32
    with pytest.raises(TwilightError, match="half floats hold light from"):
        write_rgb_exr(dark, tmp_path / "d.exr", width=64, exr="half")
    assert not (tmp_path / "d.exr").exists()


def test_the_usd_file_has_the_map_and_the_sun_where_they_are(tmp_path):
    """Light of the scene would come from elsewhere than in the map."""
    sky = replace(glow_sky(step_deg=10.0, sun_azimuth_deg=235.0), direct_irradiance=np.full(7, 0.3))
    write_outputs(sky, tmp_path, files=("sun", "rgb"), width=64)
    text, facts = (tmp_path / "sky.usda").read_text(), json.loads((tmp_path / "sun.json").read_text())
    x, y = map(float, re.search(r"rotateXYZ = \((\S+), (\S+), 0\)", text).groups())
    a, b = np.radians([x, y])
    towards = [np.sin(b) * np.cos(a), -np.sin(a), np.cos(b) * np.cos(a)]  # +Z turned about X, then Y
    np.testing.assert_allclose(towards, -np.array(facts["mitsuba"]["direction"]), atol=1e-6)
    assert "@./sky.rgb.exr@" in text and text.count("{") == text.count("}") and 20 <= text.count("\n") <= 32
    assert f"EV100 {facts['exposure_ev100']:.2f}" in text
    write_outputs(sky, tmp_path / "alone", files=("sun",), width=64)
    assert "DomeLight" not in (tmp_path / "alone" / "sky.usda").read_text()


def test_the_views_of_a_series_are_numbered_too(tmp_path):
    """A series of views, which a film cannot show, would be no image sequence."""
    from twilight.io.series import number_files

    for sun in ("a", "b"):
        (tmp_path / sun).mkdir()
        (tmp_path / sun / "sky.view.png").write_bytes(sun.encode())
    assert number_files([tmp_path / "a", tmp_path / "b"], tmp_path / "frames") == 2
    assert (tmp_path / "frames" / "sky.view.0002.png").read_bytes() == b"b"
