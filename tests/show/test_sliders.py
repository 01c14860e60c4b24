"""The model of all clear air in a browser: its port to JavaScript beside Python, and the page with sliders."""

from dataclasses import replace
from shutil import copy

import numpy as np
import pytest
from browser import light_of, open_page, until
from closed_sky import ALL_SKY, ELEVEN_SUNS_DEG
from typer.testing import CliRunner

from twilight.clear_air import Skies
from twilight.clear_air.entry import SHIPPED, shipped_model
from twilight.clear_air.of_medium import air_of
from twilight.cli.app import app
from twilight.config import load
from twilight.numerics.projections import view_directions
from twilight.scene import resolve
from twilight.show.sliders import model_text, view_air
from twilight.show.tones import Channels

SAME = 1e-5
"""Relative difference of light between the port and Python, whose single precision ends at 1e-7."""
LIST_NM = [440.0, 560.0, 680.0]
SUNS_DEG = (40.0, 1.5, -9.3)
TROPOPAUSE_KM = 16.5
"""Of continental-average: where its stratosphere begins."""
E, A = np.array([0.0, 2.0, 12.0, 60.0]), np.array([0.0, 4.0, 100.0])
READER = """<!doctype html><p id="message"></p><script>{port}
window.twilight = {{
  async light(name, observer, suns, elevations, azimuths) {{
    const read = async (file) => readNpz(new Uint8Array(await (await fetch(file)).arrayBuffer()));
    const skies = new Skies(new Model(await read("clear-air.npz")), airOf(await read(name)), observer);
    return suns.map((sun) => {{
      const sky = skies.sky(sun);
      return {{ error: sky.relativeError, light: sky.light(elevations, azimuths).map((one) => Array.from(one.light)) }};
    }});
  }},
}};
</script>"""


def air(name, **settings):
    chosen = {"solver.name": "compact", "wavelengths": {"list_nm": LIST_NM}, **settings}
    return air_of(resolve(load(name, chosen)).medium)


def test_the_port_has_the_light_of_python(tmp_path):
    """Another program could not read the file by its description."""
    (tmp_path / "reader.html").write_text(READER.format(port=model_text()), encoding="utf-8")
    copy(SHIPPED, tmp_path / "clear-air.npz")
    airs = {"continental-average": 0.0, "volcanic-stratosphere": 2.6}
    for name in airs:
        np.savez_compressed(tmp_path / f"{name}.npz", **air(name)._asdict())
    with open_page(tmp_path / "reader.html") as (page, errors):
        for name, observer_km in airs.items():
            question = [f"{name}.npz", observer_km, SUNS_DEG, E.tolist(), A.tolist()]
            found = page.evaluate("question => twilight.light(...question)", question)
            skies = Skies(shipped_model(), air(name), observer_km)
            for sun, answer in zip(SUNS_DEG, found, strict=True):
                sky = skies.sky(sun)
                exact = np.moveaxis(sky.light(E, A)[..., 0, :], -1, 0)
                np.testing.assert_allclose(np.reshape(answer["light"], exact.shape), exact, rtol=SAME)
                # its spread is that of one sun, Python's is between those of two
                assert answer["error"] == pytest.approx(sky.relative_error, rel=0.05)
        assert errors == []


@pytest.mark.parametrize("name", ["continental-average", pytest.param("pure-air", marks=pytest.mark.slow)])
def test_sliders_show_the_air_of_their_amounts_under_every_sun(tmp_path, name):
    """The page would show another sky than Python has of a climate with these amounts: in twilight, where some
    wavelengths of what aerosol scattered once are 0, it was up to 112 % off."""
    chosen = {"solver.name": "compact", "wavelengths": {"list_nm": [440.0, 490.0, 550.0, 600.0, 660.0]}}
    view = view_air(resolve(load(name, chosen)), name="air")
    amounts = {"aerosol": 2.5 * view.pack.header["start"]["aerosol"], "ozone": 150.0, "albedo": 0.6, "altitude": 2.2}
    changed = resolve(
        load(name, chosen | {"climate.gases.ozone.column_du": 150.0, "climate.ground.albedo": 0.6})
    ).medium
    times = np.where(changed.altitude_km <= TROPOPAUSE_KM, 2.5, 1.0)[:, None]
    changed = replace(changed, aerosol_extinction_per_km=times * changed.aerosol_extinction_per_km)
    elevation, azimuth = view_directions("fisheye", 60)
    keep = np.isfinite(elevation) & (elevation > 3.0)  # whole pixels
    skies, screen = Skies(shipped_model(), air_of(changed), 2.2), changed.screen
    behind = skies.behind(screen, screen.powers(changed.wavelength_nm))
    with open_page(view.save(tmp_path / "air.html"), 60, 60) as (page, errors):
        for sun in ELEVEN_SUNS_DEG:
            page.evaluate("state => twilight.set(state)", {**ALL_SKY, **amounts, "sun": sun})
            until(page, f"!twilight.sliders.busy && twilight.sliders.asked.sun === {sun}")
            found = light_of(page, {})[::-1][keep]
            sky = (behind if sun < skies.lowest_spared_deg(screen) else skies).sky(sun)
            light = sky.light(elevation[keep], azimuth[keep], on_grid=False)[:, 0]
            off = np.abs(found / Channels(changed.wavelength_nm).of(light) - 1.0)
            assert np.percentile(off, 95) < 0.003 and off.max() < 0.08, (sun, np.percentile(off, 95), off.max())
            assert page.evaluate("twilight.sliders.error") == pytest.approx(sky.relative_error, rel=0.05)
        assert errors == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--sliders", "--beside", "urban"], "--beside: a page with --sliders shows one sky"),
        (["--sliders", "--altitudes-km", "0,2"], "--altitudes-km: a page with --sliders shows one sky"),
        (["--sliders", "--set", "solver.name=zones"], "sliders move the sky of the solver compact"),
        (["--sliders", "--set", "climate.gases.ozone.treatment=overhead_filter"], "sliders have ozone in its layer"),
    ],
)
def test_what_sliders_cannot_show_is_refused(words, said):
    """A page would be written that leaves out what was asked for."""
    result = CliRunner().invoke(app, ["view", "continental-average", *words])
    assert result.exit_code == 2 and said in result.output
