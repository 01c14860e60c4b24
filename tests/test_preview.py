"""Previews: of every shipped climate, as wrong as they say, gone when the sky is there."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from twilight.cli import preview, terminal
from twilight.cli.app import app
from twilight.config.library import shipped
from twilight.config.load import load
from twilight.engine import frames
from twilight.scene import resolve
from twilight.solvers.compact.compact_sky import CompactSky
from twilight.studies.fit.compact.preview import FITTED_BY

CLIMATES = sorted(shipped("climates"))
SUNS_DEG = (20.0, 2.0, -4.0, -12.0)
LARGEST_BYTES = 250e3
LARGEST_ERROR = 0.13
"""Of haber2005, whose air ends at 35 km, in deep twilight; others are within 8 %."""


def scene(climate="continental-average", sun=-4.0, **settings):
    return load({"version": 1, "climate": climate, "sun": {"elevation_deg": sun}}, settings)


def preview_of(config):
    (sun,) = resolve(config).suns
    return preview.preview_of(config, sun.name)


@pytest.mark.parametrize("name", CLIMATES)
def test_every_shipped_climate_has_a_small_model_that_says_how_wrong_it_is(name):
    path = preview.MODELS / f"{name}.npz"
    assert path.stat().st_size < LARGEST_BYTES
    model = CompactSky.load(path)
    errors = [error["p95"] for error in model.provenance["errors"]]
    assert len(errors) >= 4 and 0.0 < min(errors) and max(errors) < LARGEST_ERROR
    config = scene(name, 2.0)
    made = preview_of(config)
    assert made is not None and not made.shipped_air, "the climate is another than when its model was fitted"
    assert made.error in errors and f"{100 * made.error:.2g} %" in made.sentence


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n == "continental-average" else pytest.mark.slow) for n in CLIMATES]
)
def test_a_preview_is_as_near_to_the_sky_as_it_says(name):
    """Beside `zones` as the model was fitted, at other directions than it was."""
    lowest = CompactSky.load(preview.MODELS / f"{name}.npz").sun_elevation_deg[0]
    suns = [sun for sun in SUNS_DEG if sun >= lowest]
    like = {"solver": FITTED_BY, "texture": {"azimuth_count": 24, "elevation_count": 15}}
    config = load({"version": 1, "climate": name, "sun": {"elevations_deg": suns}, **like})
    for frame in frames(resolve(config), keep=False):
        made = preview.preview_of(config, frame.name)
        assert made is not None
        exact = frame.sky.normalised_radiance
        error = np.abs(made.sky.normalised_radiance / exact - 1.0)
        assert np.percentile(error, 95) < made.error + 0.01, frame.name


def test_other_air_is_shown_as_shipped_and_says_so_other_ground_is_shown():
    plain = preview_of(scene())
    hazy = preview_of(scene(**{"aerosol.optical_depth_550nm": 0.4}))
    assert hazy.shipped_air and "as it is shipped, without what is changed here" in hazy.sentence
    assert "shipped" not in plain.sentence
    np.testing.assert_array_equal(hazy.sky.normalised_radiance, plain.sky.normalised_radiance)
    bright = preview_of(scene(**{"ground.albedo": 0.8}))
    assert not bright.shipped_air
    assert bright.sky.normalised_radiance.mean() > 1.05 * plain.sky.normalised_radiance.mean()


@pytest.mark.parametrize(
    "settings",
    [
        {"observer.altitude_km": 5.0},
        {"output.polariser_deg": 30.0},
        {"output.files": ["h5"]},
        {"observer.view": {"kind": "fisheye", "width": 64}},
        {"solver": {"name": "zones", "max_orders": 1}},
        {"solver": {"name": "compact"}},
        {"sun.elevation_deg": -20.0},
        {"climate": {"version": 1, "name": "my-air", "aerosol": {"type": "urban"}}},
    ],
)
def test_there_is_no_preview_of_what_the_models_do_not_show(settings):
    assert preview_of(scene(**settings)) is None


@pytest.mark.parametrize("solver", ["zones", "cells", "montecarlo", "tables"])
def test_every_solver_of_several_orders_has_one(solver):
    """Also those whose number of orders is not limited (None)."""
    assert preview_of(scene(**{"solver": {"name": solver}})) is not None


def test_a_preview_is_written_said_and_taken_away(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(terminal, "compiling", True)
    config = scene("pure-air")
    (sun,) = resolve(config).suns
    path = tmp_path / "of-a-series" / preview.PREVIEW
    with preview.shown(config, sun.name, path.parent):
        said = capsys.readouterr().err
        assert str(path) in said and "is a preview" in said and "% of what zones gives" in said
        with Image.open(path) as picture:
            assert "a fitted model of pure-air" in picture.text["preview"]
    assert not path.exists()
    with pytest.raises(KeyboardInterrupt), preview.shown(config, sun.name, path.parent):
        assert path.is_file()
        raise KeyboardInterrupt
    assert not path.exists()
    monkeypatch.setattr(terminal, "compiling", False)
    monkeypatch.setattr(preview, "LONG_S", 1e9)
    with preview.shown(config, sun.name, path.parent):
        assert not path.exists()


@pytest.mark.parametrize("off", [False, True])
def test_a_render_has_one_until_its_sky_is_there(tmp_path, monkeypatch, off):
    """Also where the render before was killed and left its own."""
    from twilight.cli import render_files

    monkeypatch.setattr(preview, "LONG_S", 0.0)
    seen = []

    def spy(frame, config, folder, *arguments, **named):
        seen.append((folder / preview.PREVIEW).is_file())
        return write(frame, config, folder, *arguments, **named)

    write = render_files._write
    monkeypatch.setattr(render_files, "_write", spy)
    command = ["render", "pure-air", "--quality", "draft", "--only", "png", "--output", str(tmp_path / "sky")]
    options = ["--set", "wavelengths={list_nm: [550]}", "--set", "sun.elevation_deg=-4"]
    result = CliRunner().invoke(app, [*command, *options, *(["--no-preview"] if off else [])])
    assert result.exit_code == 0, result.output
    assert seen == [not off]
    assert {path.name for path in (tmp_path / "sky").iterdir()} == {"sky.png", "skies.jsonl"}
    assert ("is a preview" in result.stderr) is not off
