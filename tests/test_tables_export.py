"""Tables for real-time renderers: read back, and what they refuse."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from twilight.base.errors import TwilightError
from twilight.base.progress import silent
from twilight.cli.app import app
from twilight.config import load_climate
from twilight.scene.medium import climate_medium
from twilight.studies.export import sky_tables
from twilight.studies.export.field_values import FieldSource
from twilight.studies.export.folder import write_folder

SIZES = sky_tables.SkyTableSizes(suns=12, sky=6, ground=3, azimuths=5, altitude_km=(0.0, 5.0, 60.0))


class Smooth:
    """A sky that falls with the sun and rises towards the horizon; brighter than what aerosol scatters once."""

    sun_range_deg = (-90.0, 90.0)

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg, *, observer_altitude_km=0.0):
        e, a = np.broadcast_arrays(np.radians(elevation_deg), np.radians(azimuth_deg))
        shape = 1.0 + 0.4 * np.cos(e) * np.cos(a) + 0.3 * np.cos(2 * e) + 0.01 * observer_altitude_km
        return math.exp(0.4 * min(sun_elevation_deg, 0.0)) * shape[..., None] * np.array([3.0, 2.0, 1.0])


@pytest.fixture(scope="module")
def source():
    return FieldSource(Smooth(), climate_medium(load_climate("bruneton2008"), None), False)


@pytest.fixture(scope="module")
def made(source):
    return sky_tables.fill(source, SIZES, {"climate": "bruneton2008"}, silent)


def test_texels_of_the_tables_are_the_field(source, made):
    """An exported texel would not be the field's radiance there."""
    suns, azimuths = sky_tables.sun_nodes(SIZES.suns), sky_tables.azimuth_nodes(SIZES.azimuths)
    assert suns[0] == pytest.approx(sky_tables.LOWEST_SUN_DEG) and suns[-1] == pytest.approx(90.0)
    for altitude in SIZES.altitude_km:
        horizon = source.horizon_deg(altitude)
        assert horizon == pytest.approx(-math.degrees(math.acos(6360.0 / (6360.0 + altitude))), abs=1e-9)
        elevation = sky_tables.elevation_nodes(horizon, SIZES.ground, SIZES.sky)
        assert np.all(np.diff(elevation) > 0.0)
        for sun in (suns[2], suns[7]):
            grid_ = np.meshgrid(elevation, azimuths, indexing="ij")
            found = made.radiance(float(sun), *grid_, observer_altitude_km=altitude)
            exact = source.radiance(altitude, float(sun), *grid_)[..., ::-1]
            np.testing.assert_allclose(found, exact, rtol=0.02)  # 1e-3 deg off the horizon are 0.017 texels


def test_between_texels_the_tables_follow_the_field(source, made):
    """The logarithm of this sky is linear in the sun; between texels 4 deg apart its values would be 25 % off."""
    a, b = (made.radiance(sun, 40.0, 60.0)[1] for sun in (-8.0, -14.0))
    exact = [source.radiance(0.0, sun, 40.0, 60.0)[1] for sun in (-8.0, -14.0)]
    np.testing.assert_allclose([a, b], exact, rtol=0.1)


def test_tables_are_read_as_they_were_written(made, tmp_path):
    """A folder would not be read back as written, or be overwritten."""
    write_folder(tmp_path / "sky", made.files())
    again = sky_tables.load(tmp_path / "sky")
    np.testing.assert_array_equal(again.sky, made.sky)
    np.testing.assert_array_equal(again.aureole, made.aureole)
    assert sum(f.stat().st_size for f in (tmp_path / "sky").glob("*.bin")) == made.n_bytes
    with pytest.raises(TwilightError, match="is there already"):
        write_folder(tmp_path / "sky", made.files())
    (tmp_path / "sky" / "sky.bin").write_bytes(b"half")
    with pytest.raises(TwilightError, match="whole tables"):
        sky_tables.load(tmp_path / "sky")


def test_the_tables_say_what_they_do_not_hold(made):
    """A reader would extrapolate below the lowest sun or above the highest altitude."""
    with pytest.raises(TwilightError, match="hold -20 to 90"):
        made.radiance(-25.0, 10.0, 0.0)
    with pytest.raises(TwilightError, match="hold 0 to 60"):
        made.radiance(5.0, 10.0, 0.0, observer_altitude_km=400.0)


def test_between_altitudes_the_root_of_the_height_above_the_ground_counts():
    """Also where the tables begin above the ground, on a plain above sea level."""
    header = {
        "texels": {"sun": 2, "ground": 2, "sky": 2, "azimuth": 2},
        "altitude_km": [2.0, 10.0, 60.0],
        "ground_km": 0.5,
        "horizon_deg": [-1.2, -3.1, -7.8],
        "lowest_sun_deg": sky_tables.LOWEST_SUN_DEG,
    }
    sky = np.broadcast_to(np.array([-1.0, -3.0, -9.0])[:, None, None, None, None], (3, 2, 4, 2, 3))
    made = sky_tables.SkyTables(header, sky, None, None)
    fraction = (math.sqrt(4.5) - math.sqrt(1.5)) / (math.sqrt(9.5) - math.sqrt(1.5))
    np.testing.assert_allclose(
        made.radiance(5.0, 30.0, 20.0, observer_altitude_km=5.0), math.exp(-1.0 - 2.0 * fraction), rtol=1e-12
    )


def test_the_ground_is_in_the_header(made, tmp_path):
    """A reader would take heights from sea level for heights above the ground."""
    assert made.header["ground_km"] == 0.0
    write_folder(tmp_path / "sky", {**made.files(), "sky.json": json.dumps(made.header | {"ground_km": 3.0}).encode()})
    with pytest.raises(TwilightError, match="begins below ground_km, 3"):
        sky_tables.load(tmp_path / "sky")


def test_a_folder_that_cannot_be_written_leaves_nothing(tmp_path):
    """A failed export would leave half a folder."""
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(TwilightError):
        write_folder(tmp_path / "file" / "sky", {"a": b"1"})
    with pytest.raises(TwilightError):
        write_folder(tmp_path / "sky", {"a": b"1", "a/b": b"2"})
    assert [f.name for f in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["pure-air", "--quality", "best"], "quality"),
        (["nowhere"], "nowhere"),
    ],
)
def test_the_command_refuses_in_one_sentence(arguments, words, tmp_path):
    """A wrong option of the command would end in a traceback or leave files."""
    result = CliRunner().invoke(app, ["export", "tables", *arguments, "--output", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert words in result.stderr and result.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
