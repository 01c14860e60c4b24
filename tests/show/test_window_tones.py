"""The tones of the page against those of files and films: one definition of each, whoever draws it."""

import base64
import io
import math

import numpy as np
import pytest
from browser import light_of, open_page
from closed_sky import COARSE, closed
from PIL import Image

from twilight.io.view import view_exposure_ev100
from twilight.show.skies import view_fields
from twilight.sky.tone import Shot, Tone, tone_of

SUNS_DEG = (-18.0, -9.0, 0.0, 20.0)
WIDTH = 120
"""Of the window [px]."""
HEIGHT = 80
"""Of the window [px]."""
FIELD_DEG = 20.0
"""Across the window [deg]."""
STEP = 1.0 / 255.0


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    return view_fields([closed(level=0.1)], nodes=COARSE).save(tmp_path_factory.mktemp("tones") / "sky.html")


def screen_of(page, state):
    """What the screen shows in a state, 0..1 (height, width, 3)."""
    page.evaluate("s => twilight.set(s)", state)
    url = page.evaluate("twilight.draw() ?? document.getElementById('sky').toDataURL()")
    with Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))) as image:
        return np.asarray(image.convert("RGB")) / 255.0


def blocks(picture):
    """Means of 8 x 8 pixels, in which dither is gone."""
    return picture.reshape(HEIGHT // 8, 8, WIDTH // 8, 8, 3).mean(axis=(1, 3))


@pytest.mark.parametrize("tone", ("photographic", "eye"))
def test_the_page_shows_what_files_and_films_show(page_file, tone):
    """The light that the page has drawn, developed by `sky.tone`, is what its shader put on the screen.

    The lens is narrow, so that an eye's acuity blurs by 2 pixels at night; the sun's disc is in the highest picture.
    """
    developer: Tone = tone_of(tone, "cie1964_10deg")
    pixel_deg = math.degrees(2.0 * math.tan(math.radians(FIELD_DEG) / 2.0)) / WIDTH
    brightness = []
    with open_page(page_file, WIDTH, HEIGHT) as (page, errors):
        for sun in SUNS_DEG:
            state = {"tone": tone, "sun": sun, "projection": "perspective", "fov": FIELD_DEG, "azimuth": 8.0}
            state |= {"elevation": sun if sun > 0.0 else 4.0, "night": True, "stars": False, "disc": False}
            light = light_of(page, state)[::-1].astype(float)
            if sun > 0.0:
                state["disc"] = True
                light_with_disc = light_of(page, state)[::-1].astype(float)
                assert light_with_disc.max() > 100.0 * light.max()
                ev100 = view_exposure_ev100(light[..., 1])
                light = light_with_disc if tone == "photographic" else light
                state["disc"] = tone == "photographic"
            else:
                ev100 = view_exposure_ev100(light[..., 1])
            shown = screen_of(page, state)
            expected, _ = developer.develop(light, Shot(ev100, pixel_deg))
            assert np.abs(shown - expected).max() < 3.0 * STEP, sun
            assert np.abs(blocks(shown) - blocks(expected)).max() < 0.7 * STEP, sun
            brightness.append(float(shown.mean()))
        assert errors == []
    if tone == "eye":  # a night looks dark, and every darker sky darker
        assert brightness[0] < 0.15 < brightness[1] < brightness[2] and brightness[2] > 0.5


def test_wide_blurs_are_gaussians(page_file):
    """An eye at night through a lens of half a degree: the blur of 22 pixels, made of several, is that of scipy."""
    state = {"tone": "eye", "sun": -18.0, "projection": "perspective", "fov": 0.5, "azimuth": 8.0, "elevation": 3.0}
    with open_page(page_file, WIDTH, HEIGHT) as (page, errors):
        light = light_of(page, state | {"night": True, "stars": False, "disc": False})[::-1].astype(float)
        shown = screen_of(page, state)
        assert errors == []
    expected, found = tone_of("eye", "cie1964_10deg").develop(light, Shot(0.0, 0.5 / WIDTH))
    assert 0.19 / found["acuity_cycles_per_deg"] * WIDTH / 0.5 > 16.0
    assert np.abs(blocks(shown) - blocks(expected)).max() < 0.7 * STEP
