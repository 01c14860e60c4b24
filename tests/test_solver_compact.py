"""Models of one climate as solvers: they know their air, and say what they were not fitted for; nothing is compiled."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twilight import solvers
from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.engine import solve
from twilight.scene import resolve
from twilight.solvers import compact
from twilight.solvers.compact.compact_sky import CompactSky
from twilight.solvers.compact.field import SHIPPED
from twilight.studies.fit.compact.build import air_of_climate, write_model

WAVELENGTHS = {"list_nm": [440.0, 550.0, 620.0]}
E = np.array([0.5, 10.0, 45.0, 89.0])
"""Elevations of the lines of sight [deg]."""
A = np.array([0.0, 35.0, 180.0])
"""Azimuths of the lines of sight, from the sun [deg]."""


def scene(**keys):
    """continental-average by its model, with dotted keys of the configuration changed."""
    solver = {"name": "compact", "model": "continental-average"}
    base = {"version": 1, "climate": "continental-average", "wavelengths": WAVELENGTHS, "solver": solver}
    return load(base, {key.replace("__", "."): value for key, value in keys.items()})


@pytest.fixture(scope="module")
def model():
    return CompactSky.load(SHIPPED / "continental-average.npz")


@pytest.mark.parametrize("load_550", [0.03, 0.154, 0.6])
@pytest.mark.parametrize(("albedo", "ozone"), [(0.0, 250.0), (0.3, 334.0)])
def test_load_ozone_and_albedo_are_read_from_the_medium(model, load_550, albedo, ozone):
    """A model would give the sky of another load, ozone column or ground."""
    keys = {"aerosol__optical_depth_550nm": load_550, "ground__albedo": albedo, "gases__ozone__column_du": ozone}
    solved = solve(resolve(scene(**{f"climate__{key}": value for key, value in keys.items()})))
    facts = solved.blocks[0].field.facts
    assert facts["aerosol_optical_depth_550nm"] == pytest.approx(load_550, rel=0.005)
    assert facts["ozone_column_du"] == pytest.approx(ozone, rel=0.01)
    e, a = np.meshgrid(E, A, indexing="ij")
    for sun in (40.0, -5.0):
        truth = model.sky(sun, WAVELENGTHS["list_nm"], load_550, albedo, ozone).radiance(e, a)
        assert solved.radiance(sun, e, a) == pytest.approx(truth, rel=0.01)


def test_a_grid_gives_what_its_directions_give(model):
    """The fast path for grids would give another sky."""
    for sun, albedo in ((40.0, 0.3), (2.0, 0.0), (-12.0, 0.8)):
        sky = model.sky(sun, [400.0, 555.5, 700.0], 0.2, albedo, 300.0)
        e, a = np.meshgrid(E, A, indexing="ij")
        assert sky.on_grid(E, A) == pytest.approx(sky.radiance(e, a), rel=1e-12)


def test_the_disc_is_lit_and_lifted_as_in_its_air():
    """A compact sky would have a sun that its air neither dims nor lifts."""
    solved = solve(resolve(scene()))
    noon, set_ = solved.direct(90.0), solved.direct(-1.0)
    depth = solved.medium.optical_depth()
    assert noon.irradiance == pytest.approx(np.exp(-depth), rel=1e-3)
    assert not set_.irradiance.any()
    assert 0.4 < solved.direct(0.0).bending_deg < 0.7


REFUSED = [
    ({"climate": "urban"}, "other air: the aerosol's"),
    ({"climate": "pure-air"}, "aerosol optical depths at 550 nm from 0.01 to 0.8"),
    ({"climate__aerosol__optical_depth_550nm": 1.5}, r"from 0.01 to 0.8, and that of .* at 550 nm is 1.5"),
    ({"climate__aerosol__relative_humidity_percent": 95}, "other air: the aerosol's"),
    ({"climate__aerosol__phase_function": "henyey_greenstein"}, "the aerosol's phase function"),
    ({"climate__aerosol__boundary_layer_top_km": 5.0}, "mean altitude of the aerosol"),
    ({"climate__gases__ozone__column_du": 900.0}, "ozone columns from 201 to 468 DU, and .* has 900 DU"),
    ({"climate__gases__no2": False}, "the optical depth of its gases"),
    ({"climate__atmosphere__profile": "subarctic_winter"}, "other air"),
    ({"climate__ground__altitude_km": 2.0, "observer__altitude_km": 2.0}, "other air"),
    ({"observer__altitude_km": 3.0}, r"observer\.altitude_km is 3, allowed is 0 to 0.1"),
    ({"wavelengths__list_nm": [550.0, 800.0]}, "wavelengths from 380 to 740 nm, and 800 nm is asked for"),
    ({"solver__model": "nowhere"}, "no compact model nowhere; allowed is clear-air, continental-average"),
    ({"solver__model_sha256": "0"}, "is not the file that solver.model_sha256 names"),
]


@pytest.mark.parametrize(("keys", "words"), REFUSED, ids=[next(iter(keys)) for keys, _ in REFUSED])
def test_what_it_was_not_fitted_for_is_one_sentence(keys, words):
    """A model would answer for air that it was not fitted to."""
    with pytest.raises(TwilightError, match=words) as caught:
        solve(resolve(scene(**keys)))
    assert "\n" not in str(caught.value)


def test_suns_and_directions_that_it_has_not():
    """A model would extrapolate below its suns or below the horizon."""
    solved = solve(resolve(scene()))
    with pytest.raises(TwilightError, match=r"sun\.elevation_deg is -19; the compact solver allows -18 to 90"):
        solved.radiance(-19.0, [10.0], [0.0])
    with pytest.raises(TwilightError, match="above the horizon only"):
        solved.radiance(5.0, [-1.0], [0.0])


def test_a_model_of_another_climate_is_a_file(tmp_path, model):
    """Its air is that of the climate; its light, here, is still that of the shipped model."""
    path = tmp_path / "urban.npz"
    depths = [float(depth) for depth in model.optical_depth_550nm]
    write_model(replace(model, air=air_of_climate(load("urban"), depths)), path)
    solved = solve(resolve(scene(climate="urban", solver__model=str(path))))
    assert solved.radiance(5.0, [10.0], [0.0]).min() > 0.0
    settings = compact.recorded(compact.CompactSettings(model=str(path)))
    assert settings.model == "urban.npz" and len(settings.model_sha256) == 64
    with pytest.raises(TwilightError, match="the compact model urban is of other air"):
        solve(resolve(scene(solver__model=str(path))))
    cut = model.air | {"particles": model.air["particles"][1:]}
    for air, words in (({}, "does not say of which air it is"), (cut, r"the arrays air_. do not fit together")):
        write_model(replace(model, air=air), path)
        with pytest.raises(TwilightError, match=words):
            solve(resolve(scene(solver__model=str(path))))


def test_nothing_is_compiled_for_a_picture(tmp_path):
    """The command, in a process whose folder of machine code is empty."""
    cache = tmp_path / "machine-code"
    done = subprocess.run(
        [sys.executable, "-m", "twilight", "render", "continental-average", "--sun-elevation", "3",
         "--solver", "compact", "--output", str(tmp_path / "sky")],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(Path(solvers.__file__).parents[2])},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "compiles" not in done.stderr
    assert (tmp_path / "sky" / "sky.png").stat().st_size > 10_000
    assert not list(cache.rglob("*.nb[ci]"))
