"""Response curves: undone, read, recovered from a bracketed series, and the series merged."""

import numpy as np
import pytest

from twilight.base.errors import TwilightError
from twilight.io.stored_image import StoredImage
from twilight.sky.colour import srgb_encode
from twilight.studies.camera.response import (
    ResponseCurve,
    load_response,
    merge_bracket,
    read_response,
    recover_response,
    srgb_to_linear,
    write_response,
)

POWER = np.array([0.42, 0.5, 0.6])


def film(light):
    """A made-up S-shaped film curve, 0..1 to 0..1, with another contrast in every channel."""
    x = np.asarray(light) ** POWER
    return 1.35 * x / (0.35 + x)


def film_inverse(z):
    return (0.35 * z / (1.35 - z)) ** (1.0 / POWER)


def scene(n=96):
    y, x = np.indices((n, n)) / n
    light = np.exp(12.0 * (x - 0.5) + np.sin(5 * y))[..., None] * np.array([1.0, 0.8, 0.6])
    return light / light.max()


def bracket(curve, times, light, bits=8, noise=0.0, seed=3):
    random = np.random.default_rng(seed)
    pictures = []
    for t in times:
        z = curve(np.minimum(light * t, 1.0)) + noise * random.standard_normal(light.shape)
        z = np.round(np.clip(z, 0, 1) * (2**bits - 1)) / (2**bits - 1)
        pictures.append(StoredImage(z.astype(np.float32), (z > 0.98).any(axis=-1), bits, False))
    return pictures


TIMES = (0.5, 2.0, 8.0, 32.0, 128.0)


@pytest.mark.parametrize("bits, noise, allowed", [(16, 0.0, 0.08), (8, 0.004, 0.08)])
def test_a_known_curve_is_recovered(bits, noise, allowed):
    """A film's response would be recovered wrong, or not be monotonic."""
    pytest.importorskip("colour_hdri")
    pictures = bracket(film, TIMES, scene(), bits, noise)
    curve = recover_response(pictures, TIMES)
    z = np.linspace(0.05, 0.95, 60)
    found = curve(np.repeat(z[:, None], 3, axis=1))
    ratio = np.log(found / film_inverse(np.repeat(z[:, None], 3, axis=1)))
    ratio -= ratio.mean(axis=0)  # one free scale in each channel
    assert np.abs(ratio).max() < allowed
    assert curve.residual < 0.08
    assert (np.diff(curve.exposure, axis=0) >= 0).all()


def test_the_recovered_curve_of_srgb_is_srgb():
    """A bracket of sRGB pictures would give another curve than sRGB's."""
    pytest.importorskip("colour_hdri")
    pictures = bracket(srgb_encode, TIMES, scene(), 8)
    curve = recover_response(pictures, TIMES)
    z = np.repeat(np.linspace(0.1, 0.95, 50)[:, None], 3, axis=1)
    ratio = np.log(curve(z) / srgb_to_linear(z))
    assert np.abs(ratio - ratio.mean(axis=0)).max() < 0.03


def test_a_bracket_merges_into_the_light_of_the_scene():
    """Merged light would depend on which exposure saw it."""
    light = scene()
    merged, saturated = merge_bracket(bracket(film, TIMES, light, 8), TIMES, film_inverse)
    bright = (light.min(axis=-1) > 1e-4) & ~saturated
    assert bright.mean() > 0.5
    assert np.abs(np.log(merged[bright] / light[bright])).max() < 0.05
    assert saturated.sum() == 0
    all_bright, burnt = merge_bracket(bracket(film, (2.0, 4.0), light, 8), (2.0, 4.0), film_inverse)
    assert burnt.any() and np.isfinite(all_bright).all()


def test_linear_pictures_merge_without_a_curve():
    """Linear pictures would be bent by a curve that they do not have."""
    light = scene()
    merged, _ = merge_bracket(bracket(lambda x: x, TIMES, light, 16), TIMES, None)
    bright = light.min(axis=-1) > 1e-4
    assert np.abs(merged[bright] / light[bright] - 1).max() < 0.02


def test_srgb_is_undone():
    """Pictures in sRGB would not be the light that they were made of."""
    light = np.linspace(0, 1, 300)
    assert np.abs(srgb_to_linear(srgb_encode(light)) - light).max() < 1e-7


def test_named_responses(tmp_path):
    """`response: 2.2` or a file of one column would be another curve."""
    z = np.array([[0.0, 0.5, 1.0]])
    assert load_response("linear") is None
    assert np.allclose(load_response("srgb")(z), srgb_to_linear(z))
    assert np.allclose(load_response(2.2)(z), z**2.2)
    path = tmp_path / "curve.csv"
    path.write_text("# mine\nsample,exposure\n0,0\n0.5,0.1\n1,1\n")
    assert np.allclose(load_response(str(path))(np.array([[0.0, 0.25, 0.75]])), [[0.0, 0.05, 0.55]])


def test_a_curve_survives_its_file(tmp_path):
    """A written curve would be read back as another."""
    sample = np.linspace(0, 1, 20)
    curve = ResponseCurve(sample, sample[:, None] ** np.array([1.5, 2.0, 2.5]), residual=0.01)
    write_response(tmp_path / "curve.csv", curve)
    back = read_response(tmp_path / "curve.csv")
    assert np.allclose(back.exposure, curve.exposure, rtol=1e-6)
    assert np.allclose(back.sample, sample, rtol=1e-8)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "sample,light\n0,0\n1,1\n",
        "sample,exposure\n0,0\n",
        "sample,exposure\n0,0\n0.5,x\n1,1\n",
        "sample,exposure\n0,0\n0.5,0.7\n1,0.6\n",
        "sample,exposure\n0.1,0\n1,1\n",
        "sample,exposure\n0,0\n0.5,nan\n1,1\n",
        "sample,exposure\n0,1\n1,1\n",
        "sample,red,green,blue\n0,0,0,0\n1,1,1\n",
    ],
)
def test_bad_curves_are_one_sentence(tmp_path, text):
    """A curve that falls, lacks its ends or holds text would be a traceback."""
    path = tmp_path / "curve.csv"
    path.write_text(text)
    with pytest.raises(TwilightError, match=r"curve\.csv"):
        read_response(path)


def test_bad_series_are_one_sentence():
    """A response would be made of pictures that cannot tell it."""
    pytest.importorskip("colour_hdri")
    light = scene(16)
    good = bracket(film, TIMES, light)
    for pictures, times, words in (
        (good, TIMES[:3], "a time for each"),
        (good, (1.0,) * 5, "differ"),
        ([*good[:4], bracket(film, (1.0,), scene(20))[0]], TIMES, "same size"),
        (bracket(film, TIMES, np.zeros_like(light)), TIMES, "well exposed"),
        ([StoredImage(p.samples, p.saturated, None, True) for p in good], TIMES, "linear light"),
    ):
        with pytest.raises(TwilightError, match=words):
            recover_response(pictures, times)
