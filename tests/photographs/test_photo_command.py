"""The command `twilight validate photo`: its files, its options, and what it says of bad ones."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from photographs import latlong, preetham, take
from PIL import ExifTags, Image
from typer.testing import CliRunner

from twilight import engine
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.io.stored_image import read_image, write_exr
from twilight.sky import colour
from twilight.sky.ephemeris import sun_position
from twilight.studies.camera import write_camera
from twilight.studies.validate.photographs import comparison as comparing
from twilight.studies.validate.photographs.options import EstimateOptions
from twilight.studies.validate.photographs.picture import read_photograph

PANORAMAS = Path(__file__).parents[1] / "data" / "photos"


def command(*words):
    return CliRunner().invoke(app, ["validate", *map(str, words)])


def photo(*words):
    return command("photo", PANORAMAS / "rooitou_park_256.hdr", "--resolution", 3, *words)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    write_camera(folder / "camera.yaml", latlong())
    (folder / "scene.yaml").write_text(
        "version: 1\nclimate: continental-average\nsun: {elevation_deg: 10.43}\nsolver: {name: preetham}\n"
    )
    return folder


def test_the_command_writes_its_files(scene, tmp_path):
    """`validate photo` would leave a file out, or not go by the sun's disc in azimuth."""
    out = tmp_path / "out"
    given = ("--camera", scene / "camera.yaml", "--config", scene / "scene.yaml")
    done = photo(*given, "--white-balance", "--output", out)
    assert done.exit_code == 0, done.output
    assert sorted(p.name for p in out.iterdir()) == ["comparison.h5", "comparison.png", "figures.json"]
    facts = json.loads((out / "figures.json").read_text())
    assert facts["sun_elevation_deg"] == 10.43
    assert facts["sun_azimuth_deg"] == pytest.approx(36.0, abs=1.0)
    assert facts["figures"]["correlation_of_log_luminance"] > 0.9
    assert Image.open(out / "comparison.png").size[0] > 800
    import xarray

    with xarray.open_dataset(out / "comparison.h5") as data:
        ratio = data.log_ratio.values
        assert data.photograph_xyz.dims == ("elevation", "azimuth", "tristimulus")
        weight = data.solid_angle.values
    assert abs(np.nansum(ratio * weight)) / weight.sum() < 1e-5


def test_a_panorama_needs_no_camera(scene, tmp_path):
    """A panorama without a camera file would be read with other directions than with one."""
    words = ("--config", scene / "scene.yaml")
    done = photo(*words, "--output", tmp_path / "without")
    assert done.exit_code == 0, done.output
    assert "taken for a panorama of the whole sphere, 256 x 128, north unknown, linear" in done.stderr
    with_camera = photo(*words, "--camera", scene / "camera.yaml", "--output", tmp_path / "with")
    assert with_camera.exit_code == 0 and "--camera" not in with_camera.stderr
    figures = [json.loads((tmp_path / d / "figures.json").read_text())["figures"] for d in ("without", "with")]
    assert figures[0] == figures[1]


def test_the_file_s_place_and_time_count(tmp_path):
    """`validate photo` would compare with a sun at 10 deg though the file says where and when it was taken."""
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.DateTimeOriginal] = "2024:06:21 18:30:00"
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.OffsetTimeOriginal] = "+02:00"
    gps = {"LatitudeRef": "N", "Latitude": (48.0, 0.0, 0.0), "LongitudeRef": "E", "Longitude": (11.5, 0.0, 0.0)}
    exif.get_ifd(ExifTags.IFD.GPSInfo).update({ExifTags.GPS[f"GPS{k}"]: v for k, v in gps.items()})
    sky = take(preetham(24.0), latlong(128), 40.0, sun=False)
    Image.fromarray(np.round(255 * colour.srgb_encode(sky)).astype(np.uint8)).save(tmp_path / "a.jpg", exif=exif)
    words = ["photo", tmp_path / "a.jpg", "--config", "continental-average", "--resolution", 6]
    words += ["--set", "solver.name=preetham", "--sun-azimuth", 40, "--output", tmp_path / "out"]
    done = command(*words)
    assert done.exit_code == 0, done.output
    sun = sun_position(datetime(2024, 6, 21, 16, 30, tzinfo=UTC), 48.0, 11.5).elevation_deg
    assert f"{sun:.2f} deg by Exif time and place" in done.output
    assert json.loads((tmp_path / "out" / "figures.json").read_text())["sun_elevation_deg"] == pytest.approx(sun)


def test_whole_numbers_of_a_panorama_without_camera_are_srgb(tmp_path):
    """An 8-bit panorama would be taken for linear light, or a cropped one for the whole sphere."""
    values = np.full((64, 128, 3), 188, np.uint8)
    Image.fromarray(values).save(tmp_path / "grey.png")
    shot = read_photograph(tmp_path / "grey.png")
    assert shot.camera.response == "srgb" and shot.picture.samples.mean() == pytest.approx(0.503, abs=0.002)
    Image.fromarray(values[:60]).save(tmp_path / "cut.png")
    with pytest.raises(TwilightError, match=r"cut.png: is 128 x 60, no panorama .* \(--camera\)"):
        read_photograph(tmp_path / "cut.png")


def test_a_photograph_behind_a_polariser_is_compared_with_the_sky_behind_it(scene, tmp_path, monkeypatch):
    """The filter's angle would be ignored or doubled."""
    whole = preetham(12.0)
    polarised = replace(whole, polarisation=0.5 * np.stack([whole.sun_normalised_radiance] * 2, axis=2))
    compare = Mock(wraps=comparing.compare)
    monkeypatch.setattr(comparing, "compare", compare)
    monkeypatch.setattr(engine, "run", lambda scene, progress, **_: polarised)
    given = ("--camera", scene / "camera.yaml", "--config", "pure-air")
    done = photo(*given, "--set", "output.polariser_deg=22.5", "--output", tmp_path / "out")
    assert done.exit_code == 0, done.output
    ratio = compare.call_args_list[0].args[1].sun_normalised_radiance / whole.sun_normalised_radiance
    assert ratio == pytest.approx(0.5 * (1.0 + np.sqrt(0.5)))


@pytest.mark.parametrize(
    "more, words",
    [
        (["--resolution", "0.1"], "resolution"),
        (["--resolution", "7"], "divide 90"),
        (["--sun-azimuth", "999"], "--sun-azimuth"),
        (["--glare", "-1"], "glare"),
        (["--mask", "none.png"], "none.png"),
        (["--set", "aerosol.tpye=urban"], "tpye"),
        (
            ["--set", "output.polariser_deg=30"],
            "output.polariser_deg needs polarised light, and preetham",
        ),
    ],
)
def test_wrong_options_are_one_sentence(scene, tmp_path, more, words):
    """A wrong option would be a traceback, or be found after the sky was computed."""
    given = ("--camera", scene / "camera.yaml", "--config", scene / "scene.yaml")
    done = photo(*given, "--output", tmp_path / "out", *more)
    assert done.exit_code == 2 and words in done.stderr and len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_eight_bits_as_linear_light_are_remarked(tmp_path):
    """A forgotten response would pass in silence, with shadows ten times too bright."""
    Image.fromarray(np.full((20, 40, 3), 99, np.uint8)).save(tmp_path / "a.png")
    with pytest.warns(UserWarning, match="srgb"):
        read_photograph(tmp_path / "a.png", EstimateOptions(camera=latlong(40)))
    developed = read_photograph(tmp_path / "a.png", EstimateOptions(camera=latlong(40, response="srgb")))
    assert developed.picture.samples[0, 0, 0] < 0.2


def test_the_response_command(tmp_path):
    """A bracket would not merge to its light, or need exposure times that nobody gave."""
    random = np.random.default_rng(0)
    light = np.exp(random.uniform(-6, 0, (40, 60, 1))) * np.array([1.0, 0.9, 0.7])
    names = []
    for i, t in enumerate((0.25, 1.0, 4.0)):
        names.append(tmp_path / f"{i}.png")
        z = colour.srgb_encode(light * t)
        Image.fromarray(np.round(255 * z).astype(np.uint8)).save(names[-1])
    merged, curve = tmp_path / "merged.exr", tmp_path / "curve.csv"
    done = command("response", *names, "--times", "1/4,1,4", "--output", curve, "--merge", merged)
    assert done.exit_code == 0, done.output
    ratio = read_image(merged).samples / light
    good = light.max(axis=-1) > 0.02
    assert np.std(np.log(ratio[good])) < 0.05
    assert command("response", *names, "--times", "1,2").exit_code == 2
    assert command("response", *names).exit_code == 2  # PNG knows no exposure time
    write_exr(tmp_path / "a.exr", light)
    write_exr(tmp_path / "b.exr", light * 2)
    done = command("response", tmp_path / "a.exr", tmp_path / "b.exr", "--times", "1,2", "--merge", merged)
    assert done.exit_code == 0, done.output
    assert np.allclose(read_image(merged).samples, light, rtol=1e-5)
