"""Previews: of the air that was asked for, as wrong as they say, gone when the sky is there."""

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from twilight.clear_air.model import NUMBER
from twilight.cli import preview, terminal
from twilight.cli.app import app
from twilight.config.load import load
from twilight.engine import frames
from twilight.scene import resolve

CLIMATES = ("antarctic", "continental-average", "desert", "maritime-tropical", "pure-air", "urban")
SUNS_DEG = (20.0, 2.0, -4.0, -12.0)
DRAFT_ERROR = 0.03
"""Of the skies that previews are compared with."""


def scene(climate="continental-average", sun=-4.0, **settings):
    return load({"version": 1, "climate": climate, "sun": {"elevation_deg": sun}}, settings)


def preview_of(config):
    (sun,) = resolve(config).suns
    return preview.preview_of(config, sun.name)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n == "continental-average" else pytest.mark.slow) for n in CLIMATES]
)
def test_a_preview_is_as_near_to_the_sky_as_it_says(name):
    """Beside `zones` at draft quality, whose own errors count too."""
    like = {"solver": {"name": "zones", "quality": "draft"}, "texture": {"azimuth_count": 24, "elevation_count": 15}}
    config = load({"version": 1, "climate": name, "sun": {"elevations_deg": list(SUNS_DEG)}, **like})
    for frame in frames(resolve(config), cached=False):
        made = preview.preview_of(config, frame.name)
        assert made is not None and f"{100 * made.error:.2g} %" in made.sentence
        error = np.abs(made.sky.normalised_radiance / frame.sky.normalised_radiance - 1.0)
        assert np.percentile(error, 95) < 1.5 * made.error + DRAFT_ERROR, frame.name


def test_a_preview_is_of_the_very_air():
    """A preview would show the climate as it is shipped."""
    plain = preview_of(scene(sun=20.0))
    for key, value, brighter in (("aerosol.optical_depth_550nm", 0.5, 1.02), ("ground.albedo", 0.8, 1.05)):
        other = preview_of(scene(sun=20.0, **{key: value}))
        assert other.climate == plain.climate
        assert other.sky.normalised_radiance.mean() > brighter * plain.sky.normalised_radiance.mean()


@pytest.mark.parametrize(
    "settings",
    [
        {"observer.altitude_km": 20.0}, {"output.polariser_deg": 30.0}, {"output.files": ["h5"]},
        {"observer.view": {"kind": "fisheye", "width": 64}}, {"solver": {"name": "zones", "max_orders": 1}},
        {"solver": {"name": "compact"}}, {"sun.elevation_deg": -20.0}, {"climate": "overcast-stratus"},
    ],
)  # fmt: skip
def test_there_is_no_preview_of_what_the_models_do_not_show(settings):
    """A preview would show another air or view."""
    assert preview_of(scene(**settings)) is None


@pytest.mark.parametrize("solver", ["zones", "cells", "montecarlo", "tables"])
def test_every_solver_of_several_orders_has_one(solver):
    """Also those whose number of orders is not limited (None)."""
    assert preview_of(scene(**{"solver": {"name": solver}})) is not None


def test_a_preview_is_written_said_and_taken_away(tmp_path, monkeypatch, capsys):
    """A preview would stay beside the sky, or not be told."""
    monkeypatch.setattr(terminal, "compiling", True)
    config = scene("pure-air")
    (sun,) = resolve(config).suns
    path = tmp_path / "of-a-series" / preview.PREVIEW
    with preview.show_preview(config, sun.name, path.parent):
        said = capsys.readouterr().err
        assert str(path) in said and "is a preview" in said and "by its own estimate within" in said
        with Image.open(path) as picture:
            assert f"model {NUMBER} of clear air in place of pure-air" in picture.text["preview"]
    assert not path.exists()
    with pytest.raises(KeyboardInterrupt), preview.show_preview(config, sun.name, path.parent):
        assert path.is_file()
        raise KeyboardInterrupt
    assert not path.exists()
    monkeypatch.setattr(terminal, "compiling", False)
    monkeypatch.setattr(preview, "LONG_S", 1e9)
    with preview.show_preview(config, sun.name, path.parent):
        assert not path.exists()


@pytest.mark.parametrize("off", [False, True])
def test_a_render_has_one_until_its_sky_is_there(coarse_draft, tmp_path, monkeypatch, off):
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


@pytest.mark.parametrize("hidden", [False, True], ids=["preview", "no preview"])
def test_a_long_sky_says_before_it_begins_how_long_it_takes_and_why(coarse_draft, hidden, tmp_path, monkeypatch):
    """Thick or finely layered air began without a word, and --no-preview never had one."""
    monkeypatch.setattr(preview, "PATIENCE_S", 0.1)
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(tmp_path / "cache"))
    words = ["--set", "climate.aerosol.optical_depth_550nm=1.5", "--quality", "draft", "--output", str(tmp_path / "o")]
    words += ["--set", "wavelengths.list_nm=[550]", "--set", "output.files=[h5]", *(["--no-preview"] if hidden else [])]
    done = CliRunner().invoke(app, ["render", "continental-average", "--sun-elevation", "15", *words])
    assert done.exit_code == 0, done.output
    (said,) = [line for line in done.output.splitlines() if "of processor time: zones at draft" in line]
    assert "this takes about" in said and "air of optical depth 1.6" in said
    assert done.output.index(said) < done.output.index("wrote ")
