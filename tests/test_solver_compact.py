"""The shipped compact model as a solver: it knows its air, says what it was not fitted for, and compiles nothing."""

from __future__ import annotations

import os
import subprocess
import sys
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
    """continental-average by the compact solver, with dotted keys of the configuration changed."""
    base = {"version": 1, "climate": "continental-average", "wavelengths": WAVELENGTHS, "solver": {"name": "compact"}}
    return load(base, {key.replace("__", "."): value for key, value in keys.items()})


@pytest.fixture(scope="module")
def model():
    return CompactSky.load(SHIPPED / "continental-average.npz")


@pytest.mark.parametrize("load_550", [0.03, 0.154, 0.6])
@pytest.mark.parametrize(("albedo", "ozone"), [(0.0, 250.0), (0.3, 334.0)])
def test_load_ozone_and_albedo_are_read_from_the_medium(model, load_550, albedo, ozone):
    """A model would give the sky of another load, ozone column or ground."""
    solved = solve(
        resolve(
            scene(
                climate__aerosol__optical_depth_550nm=load_550,
                climate__ground__albedo=albedo,
                climate__gases__ozone__column_du=ozone,
            )
        )
    )
    facts = solved.blocks[0].field.facts
    assert facts["aerosol_optical_depth_550nm"] == pytest.approx(load_550, rel=0.005)
    assert facts["ozone_column_du"] == pytest.approx(ozone, rel=0.01)
    e, a = np.meshgrid(E, A, indexing="ij")
    for sun in (40.0, -5.0):
        mine = solved.radiance(sun, e, a)
        assert mine == pytest.approx(
            model.sky(sun, WAVELENGTHS["list_nm"], load_550, albedo, ozone).radiance(e, a), rel=0.01
        )


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
    ({"climate__ground__kind": "water"}, "water"),
    ({"observer__altitude_km": 3.0}, r"observer\.altitude_km is 3, allowed is 0 to 0.1"),
    ({"wavelengths__list_nm": [550.0, 800.0]}, "wavelengths from 380 to 740 nm, and 800 nm is asked for"),
    ({"solver__model": "nowhere"}, "no compact model nowhere; allowed is continental-average"),
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
    """Its air is that of the climate; what it says of the light here is still the shipped model's."""
    from dataclasses import replace

    path = tmp_path / "urban.npz"
    depths = [float(depth) for depth in model.optical_depth_550nm]
    write_model(replace(model, air=air_of_climate(load("urban"), depths)), path)
    solved = solve(resolve(scene(climate="urban", solver__model=str(path))))
    assert solved.radiance(5.0, [10.0], [0.0]).min() > 0.0
    settings = compact.recorded(compact.CompactSettings(str(path)))
    assert settings.model == "urban.npz" and len(settings.model_sha256) == 64
    with pytest.raises(TwilightError, match="the compact model urban is of other air"):
        solve(resolve(scene(solver__model=str(path))))
    write_model(replace(model, air={}), path)
    with pytest.raises(TwilightError, match="does not say of which air it is"):
        solve(resolve(scene(solver__model=str(path))))
    write_model(replace(model, air=model.air | {"particles": model.air["particles"][1:]}), path)
    with pytest.raises(TwilightError, match=r"the arrays air_. do not fit together"):
        solve(resolve(scene(solver__model=str(path))))


@pytest.mark.slow
def test_a_model_is_fitted_on_first_use_and_kept(tmp_path, model, monkeypatch):
    """What the fit itself gives is tested in test_compact.py; here it is the shipped model with the air of urban."""
    from dataclasses import replace

    from typer.testing import CliRunner

    import twilight
    from twilight.cli.app import app
    from twilight.studies.fit.compact import own
    from twilight.studies.fit.compact.build import CompactFit, Errors

    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path / "cache"))
    fitted = []

    def fit(config, progress=None):
        fitted.append(config)
        depths = [float(depth) for depth in model.optical_depth_550nm]
        made = replace(model, air=air_of_climate(config, depths))
        return CompactFit(made, (Errors((-18.0, 90.0), "all", 1, 0.004, 0.021, 0.1),), 432.0, 500.0)

    monkeypatch.setattr(own, "fit_compact", fit)
    words = [
        "render",
        "urban",
        "--sun-elevation",
        "5",
        "--solver",
        "compact",
        "--overwrite",
        "--output",
        str(tmp_path / "sky"),
    ]
    none_kept = CliRunner().invoke(app, words)  # the tests keep nothing on disk unless they say so
    assert none_kept.exit_code == 2 and "TWILIGHT_CACHE_GB is 0" in none_kept.stderr
    monkeypatch.setenv("TWILIGHT_CACHE_GB", "1")
    plan = CliRunner().invoke(app, [*words, "--plan"])
    assert "there is no compact model of urban yet" in plan.stdout and "minutes of processor time" in plan.stdout
    assert not fitted
    first = CliRunner().invoke(app, words)
    assert first.exit_code == 0, first.output
    assert "off by 0.4 % (median), 2.1 % (95 %)" in first.stderr and len(fitted) == 1
    assert fitted[0].climate.aerosol.type == "urban" and fitted[0].solver["polarisation"] is True
    keys = {"aerosol.optical_depth_550nm": 0.3, "ground.albedo": 0.5, "gases.ozone.column_du": 300.0}
    assert (
        CliRunner().invoke(app, [*words, *(w for k, v in keys.items() for w in ("--set", f"{k}={v}"))]).exit_code == 0
    )
    sky = twilight.render("urban", sun_elevation_deg=5.0, solver="compact", settings=keys)
    assert sky.provenance["configuration"]["solver"]["model"].endswith(".npz") and len(fitted) == 1
    assert "compact models\t1\t" in CliRunner().invoke(app, ["cache"]).output
    assert "no compact model" not in CliRunner().invoke(app, [*words, "--plan"]).stdout
    refused = CliRunner().invoke(app, [*words, "--set", "aerosol.optical_depth_550nm=1.5"])
    assert refused.exit_code == 2 and len(fitted) == 1  # no model holds such a load
    assert CliRunner().invoke(app, [*words, "--set", "solver.model=continental-average"]).exit_code == 2
    assert CliRunner().invoke(app, ["cache", "--clear"]).exit_code == 0
    assert own.needs_fit(scene(climate="urban")) and not own.needs_fit(scene())


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
