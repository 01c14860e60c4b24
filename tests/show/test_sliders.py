"""The model of all clear air in a browser: its port to JavaScript beside Python, and the page whose sliders it moves."""

from importlib import resources
from shutil import copy

import numpy as np
import pytest
from browser import open_page

from twilight.config import load
from twilight.scene import resolve
from twilight.solvers.compact.air import air_of
from twilight.solvers.compact.field import SHIPPED, shipped_model
from twilight.transport.clear_air import Skies

SAME = 1e-3
"""Relative difference of light between the port and Python, whose single precision ends at 1e-7."""
SUNS_DEG = (40.0, 1.5, -9.3)
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
    chosen = {"solver.name": "compact", "wavelengths": {"list_nm": [440.0, 560.0, 680.0]}, **settings}
    return air_of(resolve(load(name, chosen)).medium)


def test_the_port_has_the_light_of_python(tmp_path):
    """Another program could not read the file by its description: aerosol seen from within it, a volcano's from above."""
    port = resources.files("twilight").joinpath("show/web/clear_air.js").read_text(encoding="utf-8")
    (tmp_path / "reader.html").write_text(READER.format(port=port), encoding="utf-8")
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
