"""`twilight export shader`: GLSL and WGSL in a headless browser, read back, beside numpy and beside the field."""

import base64
import io
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from browser import OPTIONS, open_page
from closed_sky import field_luminance, solved
from PIL import Image

from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.engine import solve
from twilight.engine.sun_tables import COLUMN_COUNT, ROW_COUNT, SunTables
from twilight.engine.table import first_columns, first_rows
from twilight.numerics import spectrum
from twilight.numerics.directions import PHASE_COUNT, direction
from twilight.scene import resolve
from twilight.show.shader import shader_sky
from twilight.sky.colour import REC709_LUMINANCE
from twilight.studies.export.prague import write_folder

MOST_LINES = 200
"""Of a shader: what its page in the manual promises."""
MOST_BYTES = 8e6
"""Of the shader's two files of numbers [bytes]: what its page in the manual promises."""
SMALL = {"rows_deg": first_rows(-90.0, [0.0], 17), "columns_deg": first_columns(13)}
"""Nodes of tables."""
SUNSET = Path(__file__).parents[2] / "docs" / "examples" / "sunset.html"
"""The example of three.js."""
PAGES = Path(__file__).parents[1] / "data"
"""Pages that read the shaders' answers back: `twilight.read(views, suns)`."""


@pytest.fixture(scope="module")
def field():
    """A factor of 10 darker for 4 deg."""
    return solved(lambda sun_deg: 10.0 ** (min(sun_deg, 0.0) / 4.0))


@pytest.fixture(scope="module")
def made(field):
    return shader_sky(field, "closed", tables=SunTables(field, **SMALL))


@pytest.fixture(scope="module")
def folder(made, tmp_path_factory):
    folder = tmp_path_factory.mktemp("shader") / "sky"
    write_folder(folder, made.files())
    for language in ("glsl", "wgsl"):
        shutil.copy(PAGES / f"shader_{language}.html", folder / f"{language}.html")
    return folder


def questions(count=600):
    """Sun, elevation, azimuth (N,) [deg], some next to the horizon, at the zenith and at the sun."""
    random = np.random.default_rng(4)
    sun, elevation = random.uniform(-18.0, 90.0, count), random.uniform(-89.0, 89.9, count)
    azimuth = random.uniform(-180.0, 180.0, count)
    elevation[:100] = random.uniform(-2.0, 2.0, 100)
    sun[count // 2 :] = random.uniform(-18.0, 3.0, count - count // 2)
    elevation[100:110], azimuth[100:110], sun[100:110] = 20.0, 0.0, np.linspace(19.0, 21.0, 10)
    return sun, elevation, azimuth


def test_what_is_exported_is_small(made):
    """Lines of the shaders and bytes of the textures at the usual sizes."""
    for name, content in made.files().items():
        if name.endswith(("glsl", "wgsl")):
            text = content.decode()
            assert text.count("\n") <= MOST_LINES and "{{" not in text and "#include" not in text
    rows, suns = first_rows(-90.0, [0.0], ROW_COUNT), made.table.sun_elevation_deg
    assert max(rows.size, suns.size) <= 256
    assert 16 * (2 * suns.size * rows.size * (COLUMN_COUNT + 2) + 2 * PHASE_COUNT) <= MOST_BYTES


def read_by_python(made, sun, elevation, azimuth):
    """`SkyTable.light` of questions (N, 4)."""
    return np.stack([made.table.under(s).light(e, a) for s, e, a in zip(sun, elevation, azimuth, strict=True)])


def asked(page, sun, elevation, azimuth):
    """What a page answers (N, 4): red, green, blue, scotopic."""
    four = [np.column_stack([v, np.zeros(len(v))]) for v in (direction(azimuth, elevation), direction(0.0 * sun, sun))]
    words = "([views, suns]) => twilight.read(views, suns)"
    return np.array(page.evaluate(words, [v.ravel().tolist() for v in four])).reshape(-1, 4)


@pytest.fixture
def webgpu(monkeypatch):
    monkeypatch.setattr("browser.OPTIONS", (*OPTIONS, "--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"))


@pytest.mark.parametrize("language", ["glsl", "wgsl"])
def test_shaders_read_what_python_reads(made, folder, language, webgpu):
    """Pixels read back from a browser: linear Rec. 709 and scotopic luminance, to 1e-3."""
    sun, elevation, azimuth = (q.astype(np.float32).astype(float) for q in questions())
    light = read_by_python(made, sun, elevation, azimuth)
    rgb = light[:, :3] @ spectrum.xyz_to_rgb_matrix("cie1931_2deg").T
    with open_page(folder / f"{language}.html") as (page, errors):
        found = asked(page, sun, elevation, azimuth)
        assert errors == []
    np.testing.assert_allclose(found[:, 3], light[:, 3], rtol=1e-3)
    assert (np.abs(found[:, :3] - rgb).max(axis=1) < 1e-3 * np.abs(rgb).max(axis=1)).all()


@pytest.mark.slow
@pytest.mark.parametrize("air", ["continental-average", "pure-air"])
def test_what_a_card_draws_is_the_field(air, tmp_path, webgpu):
    """The figures of docs/tables.md: luminance in both shaders beside lines of sight that the field is asked for."""
    solved = solve(resolve(load(air, {"solver.quality": "draft"})))
    write_folder(tmp_path / "sky", shader_sky(solved, air).files())
    cases = {sun: field_luminance(solved, sun) for sun in (30.0, 2.0, -4.0, -10.0)}
    for language in ("glsl", "wgsl"):
        shutil.copy(PAGES / f"shader_{language}.html", tmp_path / "sky" / f"{language}.html")
        with open_page(tmp_path / "sky" / f"{language}.html") as (page, errors):
            for sun, (elevation, azimuth, exact) in cases.items():
                luminance = asked(page, np.full(exact.size, sun), elevation, azimuth)[:, :3] @ REC709_LUMINANCE
                off = 100.0 * np.abs(luminance / exact - 1.0)
                print(f"{air} {language} sun {sun:+g}: 95 % {np.percentile(off, 95):.2f} %, worst {off.max():.2f} %")
                assert np.percentile(off, 95) < 0.5 and off.max() < 2.0, (language, sun)
            assert errors == []


def test_its_page_shows_it(folder):
    """The page beside the files draws the sky: brighter towards the sun, not black, no errors."""
    with open_page(folder / "index.html", 160, 90, from_disk=True) as (page, errors):
        text = page.evaluate("twilight.draw() ?? document.querySelector('canvas').toDataURL()")
        assert errors == [] and page.inner_text("#message") == ""
    shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(text.split(",")[1]))).convert("RGB"), float)
    assert shown.shape == (90, 160, 3) and 40.0 < shown.mean() < 220.0
    assert shown[40, 80].sum() > shown[40, 2].sum()


def test_a_folder_that_cannot_be_written_leaves_nothing(tmp_path):
    """A failed export would leave half a folder."""
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(TwilightError):
        write_folder(tmp_path / "file" / "sky", {"a": b"1"})
    with pytest.raises(TwilightError):
        write_folder(tmp_path / "sky", {"a": b"1", "a/b": b"2"})
    assert [f.name for f in tmp_path.iterdir()] == ["file"]


def test_the_page_of_three_js_is_short():
    """The example of the manual: 25 lines that read the files by their names and turn the axes."""
    text = SUNSET.read_text()
    assert text.count("\n") <= 25
    for word in ("sky.bin", "lines.bin", "sky.json", "sky.glsl", "skyTable", "skyLines", "skyRgb", "zUp"):
        assert word in text, word


@pytest.mark.slow
def test_the_page_of_three_js_draws_sunsets(tmp_path, webgpu):
    """Axes or textures would be turned: the sun's side is to be the brightest and reddest, low in the picture."""
    three = os.environ.get("THREE_JS_BUILD")
    if not three:
        pytest.skip("needs three.js: `npm pack three`, and THREE_JS_BUILD=folder of its three.module.js")
    field = solve(resolve(load("continental-average", {"solver.quality": "draft"})))
    write_folder(tmp_path / "sky", shader_sky(field, "continental").files())
    for file in (Path(three) / "three.module.js", Path(three) / "three.core.js", SUNSET):
        shutil.copy(file, tmp_path / "sky")
    with open_page(tmp_path / "sky" / SUNSET.name, 160, 120) as (page, errors):
        for sun in (3.0, -2.0, -6.0):
            drawn = page.evaluate(
                "sun => { twilight.draw(sun); return document.querySelector('canvas').toDataURL(); }", sun
            )
            shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(drawn.split(",")[1]))).convert("RGB"), float)
            brightness = shown.sum(axis=2)
            horizon = int(np.argmax(brightness[:, 80]))
            # the camera looks 14 deg up, 55 deg from the top to the bottom
            assert 75 < horizon < 95, sun
            assert np.abs(brightness[:85] - brightness[:85, ::-1]).mean() < 3.0, sun
            assert brightness[horizon, 80] > brightness[horizon, 2] > 0.0, sun
            low, high = shown[horizon - 2, 80], shown[5, 80]
            assert low[0] / low[2] > 1.2 * high[0] / high[2], sun
        assert errors == []
