"""The page of `twilight view` as people meet it: opened from disk, under fingers, inside a notebook, in time."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from airs import as_sky, scene_of_field, turbid
from browser import open_page, until

from twilight.engine import solve
from twilight.show.page import PageNodes
from twilight.show.skies import view_fields, view_sky
from twilight.solvers.base import BareField

NM = np.array([420.0, 500.0, 580.0, 660.0])
COARSE = PageNodes(ground=5, haze=5, sky=9, columns=7)


@dataclass
class Even(BareField):
    """Light that depends on the sun's elevation and a little on the direction's."""

    medium: object

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg, *, observer_altitude_km=0.0):
        e, _ = np.broadcast_arrays(np.radians(elevation_deg), azimuth_deg)
        return 0.01 * math.exp(0.3 * min(sun_elevation_deg, 0.0)) * (1.2 + 0.2 * np.cos(2 * e))[..., None] * np.ones(4)


def even(medium):
    return solve(scene_of_field(Even(medium)), cached=False)


@pytest.fixture(scope="module")
def view():
    return view_fields([even(turbid(wavelength_nm=NM))], scenes=["pure-air"], nodes=COARSE)


@pytest.fixture(scope="module")
def page_file(view, tmp_path_factory):
    return view.save(tmp_path_factory.mktemp("page") / "even.html")


def test_it_opens_from_disk_and_says_how_long_that_took(page_file):
    """A page sent by mail would stay empty."""
    with open_page(page_file, 400, 500, from_disk=True) as (page, errors):
        assert page.url.startswith("file:")
        assert page.evaluate("twilight.at(40, 10)?.luminance ?? 0") > 0.0
        page.click("#toggle")
        page.click("#copy")  # the clipboard of pages from disk may be closed: the text is then selected
        spent = page.evaluate("twilight.loaded")
        assert 0.0 < spent["tables_ms"] < spent["drawn_ms"] < 60_000.0
        assert errors == []


@pytest.mark.slow
def test_fingers_turn_and_zoom(page_file):
    """One finger drags the sky, two change the field of view, a tap asks for the light."""
    with open_page(page_file, 400, 300, has_touch=True, is_mobile=True) as (page, errors):
        page.evaluate("document.getElementById('panel').hidden = true")
        touch = page.context.new_cdp_session(page)

        def fingers(kind, *places):
            points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        page.evaluate("twilight.set({ fov: 60, azimuth: 100, elevation: 20 })")
        fingers("touchStart", (200, 150))
        for x in (190, 170, 150):
            fingers("touchMove", (x, 150))
        fingers("touchEnd")
        azimuth = page.evaluate("twilight.state.azimuth")
        assert azimuth == pytest.approx(100.0 + 50.0 * 60.0 / 400.0, abs=2.5)
        fingers("touchStart", (180, 150), (220, 150))
        for spread in (30, 40, 60):
            fingers("touchMove", (200 - spread, 150), (200 + spread, 150))
        fingers("touchEnd")
        assert page.evaluate("twilight.state.fov") < 45.0
        page.touchscreen.tap(200, 100)
        page.wait_for_selector("#probe-text:not(:empty)")
        assert "cd m" in page.inner_text("#probe-text")
        assert errors == []


@pytest.mark.slow
def test_a_notebook_shows_it(view, tmp_path):
    """The HTML that Jupyter is given, in a page of its own: the sky is drawn inside its frame."""
    sky = view_sky(as_sky(Even(turbid(wavelength_nm=NM)), -4.0, 30.0))
    notebook = tmp_path / "notebook.html"
    notebook.write_text(
        f"<!doctype html><meta charset='utf-8'>{view._repr_html_()}{sky._repr_html_()}"
        "<script>window.twilight = 1</script>",
        encoding="utf-8",
    )
    with open_page(notebook, 500, 300) as (page, errors):
        inner = page.frames[1:]
        assert len(inner) == 2
        for frame in inner:
            until(frame, "!!window.twilight && typeof twilight === 'object'")
            assert frame.evaluate("twilight.at(twilight.state.elevation, twilight.state.azimuth).luminance") > 0.0
        assert errors == []
