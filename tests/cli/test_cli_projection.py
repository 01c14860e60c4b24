"""`twilight render --projection`: a picture of any shape, and one sentence for what cannot be."""

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from twilight.cli.app import app
from twilight.numerics.projections import PROJECTIONS

USUAL = "render pure-air --sun-elevation 2 --quality draft --set wavelengths.list_nm=[450,550,650]".split()


@pytest.fixture(scope="module")
def fields(tmp_path_factory):
    return tmp_path_factory.mktemp("fields")


@pytest.fixture(autouse=True)
def one_field_for_all(fields, monkeypatch, coarse_draft):
    """Kept on disk, as a user's is."""
    monkeypatch.setenv("TWILIGHT_CACHE_GB", "1")
    monkeypatch.setenv("TWILIGHT_CACHE_DIR", str(fields))


def call(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.mark.parametrize("kind", [kind for kind in PROJECTIONS if kind != "limb"])
def test_a_picture_of_every_shape_has_sky_above_ground(kind, tmp_path):
    """A projection would be upside down, or empty."""
    done = call(*USUAL, "--projection", kind, "--size", 96, "--only", "view", "--output", tmp_path)
    assert done.exit_code == 0, done.stderr
    with Image.open(tmp_path / "sky.view.png") as picture:
        assert picture.width == 96
        pixels = np.asarray(picture.convert("RGB"), float).sum(axis=-1)
    assert np.ptp(pixels) > 60.0
    if kind == "perspective":
        assert pixels[: len(pixels) // 4].mean() > 2.0 * pixels[-3:].mean()


def test_size_fits_the_view_of_a_configuration(tmp_path):
    """A configuration with a view could not be tried small."""
    view = "observer.view={kind: perspective, width: 1024, height: 700, elevation_deg: 15}"
    done = call(*USUAL, "--set", view, "--size", "96x40", "--output", tmp_path / "both")
    assert done.exit_code == 0, done.stderr
    with Image.open(tmp_path / "both" / "sky.view.png") as picture:
        assert picture.size == (96, 40)
    refused = call(*USUAL, "--set", view, "--size", "2", "--output", tmp_path / "small")
    assert refused.exit_code == 2 and "--size: observer.view.width must be" in refused.stderr
