"""The page for every hand: axe-core's rules, sizes for fingers, a sheet on a phone, keys, one name for each control."""

import re

import numpy as np
import pytest
from browser import open_page

PHONE = (390, 844)
"""Width and height of the window on a phone [px]."""
DESK = (1280, 800)
"""Width and height of the window on a desk [px]."""
COARSE_PIXELS = {"device_scale_factor": 1 / 8}
"""An eighth of the pixels each way, drawn by the processor: layout, names and keys are the same."""
FINGER_PX = 44
"""Least height of what is pressed (WCAG 2.2, criterion 2.5.5)."""
RULES = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}
SIZES = [pytest.param(PHONE, id="phone"), pytest.param(DESK, id="desk", marks=pytest.mark.slow)]
STATES = {"elevation": {}, "clock": {"mode": "clock"}, "by hand": {"exposure": "manual"}, "eye": {"tone": "eye"}}


def open_all(page, wanted=True):
    if page.is_visible("#more") != wanted:
        page.click("#toggle")


@pytest.mark.parametrize("size", SIZES)
def test_axe_finds_nothing(page_of_two, size):
    """Names, roles, contrast, focus order and target sizes, by axe-core, in every state of the panel."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="needs axe-playwright-python").Axe()
    with open_page(page_of_two, *size, **COARSE_PIXELS) as (page, errors):
        open_all(page)
        for name, state in STATES.items():
            page.evaluate("s => { twilight.set(s); twilight.draw(); }", state)
            found = axe.run(page, options=RULES)
            assert found.violations_count == 0, (name, found.generate_report())
        page.focus("#sky")
        page.keyboard.press("Enter")
        open_all(page, False)
        found = axe.run(page, options=RULES)
        assert found.violations_count == 0 and page.is_visible("#probe"), found.generate_report()
        assert errors == []


@pytest.mark.parametrize("size", SIZES)
def test_whatever_is_pressed_has_44_px_and_lies_within(page_of_two, size):
    """Buttons, sliders, selects, inputs, labels of ticks; nothing is cut off, nothing overlaps."""
    with open_page(page_of_two, *size, **COARSE_PIXELS) as (page, errors):
        open_all(page)
        for name, state in STATES.items():
            page.evaluate("s => { twilight.set(s); twilight.draw(); }", state)
            boxes = page.evaluate(
                """[..."button|select|input:not([type=checkbox])|.chip".split("|")]
                .flatMap((kind) => [...document.querySelectorAll(`#panel ${kind}`)])
                .filter((e) => e.offsetParent).map((e) => {
                  const b = e.getBoundingClientRect(), p = e.closest("#panel").getBoundingClientRect();
                  return [e.id || e.textContent, b.width, b.height, b.left, b.right, b.top, b.bottom, p.left, p.right];
                })"""
            )
            assert len(boxes) > 15
            for who, width, height, left, right, _, _, inner, outer in boxes:
                assert height >= FINGER_PX - 0.01 and width >= FINGER_PX - 0.01, (name, who, width, height)
                assert left >= inner and right <= outer, (name, who)
            places = np.array([box[3:7] for box in boxes])
            for i, (left, right, top, bottom) in enumerate(places):
                others = np.delete(places, i, axis=0)
                overlap = (others[:, 0] < right - 1) & (others[:, 1] > left + 1)
                overlap &= (others[:, 2] < bottom - 1) & (others[:, 3] > top + 1)
                assert not overlap.any(), (name, boxes[i][0])
        assert errors == []


def test_a_phone_shows_the_sky(page_of_two):
    """Closed the sheet covers less than a quarter, open less than half; the sun's slider is as wide as the sheet."""
    with open_page(page_of_two, *PHONE, has_touch=True, is_mobile=True, **COARSE_PIXELS) as (page, errors):

        def covered():
            return page.evaluate("document.getElementById('panel').getBoundingClientRect().height / innerHeight")

        assert page.is_hidden("#more") and covered() < 0.24
        slider = page.locator("#sun").bounding_box()
        assert slider["width"] > 340.0
        # where twilight is, a pixel is less than a tenth of a degree
        degrees = []
        for x in (100.0, 101.0):
            page.touchscreen.tap(slider["x"] + x, slider["y"] + slider["height"] / 2)
            degrees.append(page.evaluate("twilight.state.sun"))
        assert -8.0 < degrees[0] < degrees[1] < degrees[0] + 0.15 < 0.0
        page.tap("#toggle")
        assert page.is_visible("#more") and covered() < 0.5
        # the horizon stands above the closed sheet
        page.tap("#toggle")
        low = page.evaluate("document.getElementById('panel').getBoundingClientRect().top / innerHeight")
        assert page.evaluate("twilight.horizon()") < low
        assert errors == []


def test_keys_step_finely_and_coarsely(page_of_two):
    """On a slider: arrows 0.1 deg, Page keys 1 deg, Home and End; on the sky: comma, full stop and the Page keys."""
    with open_page(page_of_two, *DESK, **COARSE_PIXELS) as (page, errors):

        def after(key, where="#sun", name="sun"):
            page.focus(where)
            page.keyboard.press(key)
            return page.evaluate(f"twilight.state.{name}")

        page.evaluate("twilight.set({ sun: -4 })")
        assert after("ArrowRight") == pytest.approx(-3.9) and after("ArrowDown") == pytest.approx(-4.0)
        assert after("PageDown") == pytest.approx(-5.0) and after("PageUp") == pytest.approx(-4.0)
        assert after("End") == pytest.approx(90.0) and after("Home") == pytest.approx(-18.0)
        assert after("ArrowLeft") == pytest.approx(-18.0)  # the end holds
        assert page.get_attribute("#sun", "aria-valuetext") == "\u221218.00\u00b0"
        assert after(".", "#sky") == pytest.approx(-17.9) and after("PageUp", "#sky") == pytest.approx(-16.9)
        page.click("[data-step='sun -0.1']")
        assert page.evaluate("twilight.state.sun") == pytest.approx(-17.0)
        page.evaluate("twilight.set({ mode: 'clock', hours: 18.5 })")
        assert after("ArrowRight", "#hours", "hours") == pytest.approx(18.5 + 1 / 60, abs=1e-3)
        assert after("PageUp", "#hours", "hours") == pytest.approx(19.0 + 1 / 60, abs=1e-3)
        for name in ("fov", "altitude", "split", "bias"):
            before = page.evaluate(f"twilight.state.{name}")
            fine = after("ArrowRight", f"#{name}", name) - before
            coarse = after("PageUp", f"#{name}", name) - before - fine
            assert 0.0 < fine < coarse, name
        # keys act where the focus is, and the focus is seen; who clicks on the sky sees no frame
        page.mouse.click(300, 300)
        style = "getComputedStyle(document.activeElement)"
        assert page.evaluate("document.activeElement.id") == "sky" and page.evaluate(f"{style}.outlineStyle") == "none"
        page.focus("#fov")
        azimuth = page.evaluate("twilight.state.azimuth")
        page.keyboard.press("g")
        assert page.evaluate("twilight.state.azimuth") == azimuth
        page.keyboard.press("Tab")
        assert page.evaluate(f"{style}.outlineStyle") == "solid" and page.evaluate(f"{style}.outlineWidth") == "3px"
        assert errors == []


def test_every_control_has_a_name_of_its_own(page_of_two):
    """A screen reader would not tell two controls apart."""
    with open_page(page_of_two, *DESK, **COARSE_PIXELS) as (page, errors):
        for state in STATES.values():
            page.evaluate("s => twilight.set(s)", state)
            names = page.evaluate(
                """[...document.querySelectorAll("#panel select, #panel input, #panel button")]
                .filter((e) => e.offsetParent)
                .map((e) => e.ariaLabel ?? (e.labels?.[0]?.querySelector("span") ?? e).textContent.trim())"""
            )
            assert all(names) and len(set(names)) == len(names), sorted(names)
        assert errors == []


def test_azimuths_count_as_in_the_picture(page_of_two):
    """To both sides of the sun where the picture's directions do, from north where there is a place."""
    with open_page(page_of_two, *DESK, **COARSE_PIXELS) as (page, errors):
        page.evaluate("twilight.set({ azimuth: -54, elevation: 20 }); twilight.draw()")
        page.focus("#sky")
        page.keyboard.press("Enter")
        page.evaluate("twilight.draw()")
        assert "azimuth \u221254.00\u00b0 from the sun's" in page.inner_text("#probe-text")
        page.evaluate("twilight.set({ mode: 'clock', azimuth: 306, elevation: 20 }); twilight.draw()")
        page.focus("#sky")
        page.keyboard.press("Enter")
        page.evaluate("twilight.draw()")
        assert "azimuth 306.00\u00b0 (NW)" in page.inner_text("#probe-text")
        assert errors == []


def test_the_command_is_the_picture(page_of_two):
    """Both skies, their options, projection, field of view, direction, size and tone; and `render` understands it."""
    import shlex

    from typer.testing import CliRunner

    from twilight.cli.app import app

    with open_page(page_of_two, 300, 200) as (page, errors):
        page.evaluate("twilight.set({ sun: -4.5, azimuth: -54, elevation: 20, fov: 70, exposure: 'manual', ev: 5.25 })")
        photograph = page.evaluate("twilight.draw() ?? twilight.command()")
        page.evaluate("twilight.set({ projection: 'fisheye', fov: 180, elevation: 90, tone: 'eye' })")
        eye = page.evaluate("twilight.draw() ?? twilight.command()")
        page.evaluate("twilight.set({ projection: 'latlong', mode: 'clock' })")
        latlong = page.evaluate("twilight.draw() ?? twilight.command()")
        assert errors == []
    first, second = photograph.split("\n")
    assert first.startswith("twilight render continental-average --quality draft --sun-elevation -4.5 ")
    assert shlex.split(second)[2:5] == ["my air.yaml", "--set", "aerosol.load=2"]
    assert "--projection perspective --size 300x200 --set observer.view.azimuth_deg=-54" in first
    assert "elevation_deg=20 --set observer.view.field_of_view_deg=70" in first
    assert first.endswith("--tone photographic --exposure 5.25")
    assert "--projection fisheye --size 200 " in eye and eye.endswith("--tone eye") and "--exposure" not in eye
    for text in (photograph, eye, latlong):
        words = shlex.split(text.split("\n")[0])
        result = CliRunner().invoke(app, [*words[1:], "--plan"])
        assert result.exit_code == 0, (text, result.output)
        assert re.search(r"picture of the view", result.output)
