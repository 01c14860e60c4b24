"""Training sets: airs drawn, parts by air, one store with the sweep's journal, and what the loader hands out."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
import xarray as xr
from sweeping import BASE, swept
from typer.testing import CliRunner

from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.studies.dataset import SkyDataset
from twilight.studies.dataset.draw import SUNS, VALIDATION, split_of, training_series, write_split
from twilight.studies.sweep.sweep import Sweep

RANGES = {"ground.albedo": {"from": 0.0, "to": 0.8}, "atmosphere.profile": ["tropical", "midlatitude_winter"]}


@pytest.fixture(scope="module")
def written(toy, client, tmp_path_factory):
    """Six airs under two suns, one of which the toy solver refuses for its depth."""
    folder = tmp_path_factory.mktemp("training")
    config = folder / "skies.json"
    vary = {"latin_hypercube": {"ranges": RANGES}, "sun.elevation_deg": [5.0, -4.0, -12.0]}
    config.write_text(json.dumps({**BASE, "vary": vary}))
    made = Sweep(training_series(str(config), 6, 1, {}, {}))
    path = folder / "skies.zarr"
    swept(made, client, path)
    write_split(path, split_of(6, 0.3, 1), {"airs": 6, "validation": 0.3, "seed": 1})
    return path, toy


def test_a_third_of_the_airs_is_held_back():
    split = split_of(30, 1 / 3, 4)
    assert (split == VALIDATION).sum() == 10 and (split_of(30, 1 / 3, 4) == split).all()
    assert (split_of(30, 1 / 3, 5) != split).any()
    assert list(np.sort(split_of(2, 0.01, 0))) == [0, 1] and (split_of(2, 0.99, 0) == 0).sum() == 1


def test_a_climate_is_drawn_from_ranges_of_clear_air():
    series = training_series("continental-average", 7, 3, {}, {})
    assert [len(axis.points) for axis in series.axes] == [7, SUNS["count"]]
    drawn = [point["aerosol.optical_depth_550nm"] for point in series.axes[0].points]
    assert len(set(drawn)) == 7 and 0.02 <= min(drawn) < 0.04 and 0.5 < max(drawn) <= 1.0
    own = training_series("continental-average", 7, 3, {"sun.elevation_deg": -3.0}, {})
    assert [axis.name for axis in own.axes] == ["latin_hypercube"]


def test_skies_are_those_of_their_inputs(written):
    path, toy = written
    for part in ("train", "validation"):
        skies = SkyDataset(path, part)
        albedo, sun = skies.names.index("ground_albedo"), skies.names.index("solar_elevation_angle")
        e, a = np.meshgrid(skies.elevation_deg, skies.azimuth_deg, indexing="ij")
        for i in range(len(skies)):
            numbers, target = skies[i]
            exact = toy.truth(1.0, numbers[albedo], numbers[sun], 0.0, e, a, skies.wavelength_nm)
            np.testing.assert_allclose(target, exact, rtol=1e-5)
            np.testing.assert_array_equal(numbers, skies.inputs[i])
        assert np.log(target) == pytest.approx(SkyDataset(path, part, logarithm=True)[len(skies) - 1][1])


def test_no_air_is_in_both_parts_and_refused_skies_in_none(written):
    path, _ = written
    train, held, every = (SkyDataset(path, part) for part in ("train", "validation", "all"))
    assert not set(train.airs) & set(held.airs) and set(train.airs) | set(held.airs) == set(range(6))
    assert len(set(held.airs)) == 2 and len(train) == 4 * 2 and len(train) + len(held) == len(every) == 12
    assert every.inputs[:, every.names.index("solar_elevation_angle")].min() == -4.0  # -12 was refused
    assert len(every.texts["atmosphere_profile"]) == 2


def test_a_loader_s_processes_get_the_same_and_batches_hold_every_sky_once(written):
    skies = SkyDataset(written[0])
    again = pickle.loads(pickle.dumps(skies))
    np.testing.assert_array_equal(again[3][1], skies[3][1])
    batches = list(skies.batches(3, seed=2))
    assert [len(inputs) for inputs, _ in batches] == [3, 3, 2]
    found = np.concatenate([inputs for inputs, _ in batches])
    assert sorted(map(tuple, found)) == sorted(map(tuple, skies.inputs))
    with pytest.raises(IndexError, match="8 skies"):
        skies[8]
    np.testing.assert_array_equal(skies[-1][1], skies[7][1])


def test_xarray_sees_the_split(written):
    with xr.open_zarr(written[0]) as data:
        assert data.split.dims == ("sample",) and int((data.split == VALIDATION).sum()) == 2
        assert data.split.attrs["flag_meanings"] == "train validation"


def test_another_split_is_refused_and_the_same_is_kept(written):
    path, _ = written
    write_split(path, split_of(6, 0.3, 1), {"airs": 6, "validation": 0.3, "seed": 1})
    with pytest.raises(TwilightError, match="is split with"):
        write_split(path, split_of(6, 0.5, 1), {"airs": 6, "validation": 0.5, "seed": 1})


@pytest.mark.parametrize(
    "options, said",
    [
        (["continental-average", "--airs", "1", "--output", "a.zarr"], "--airs: 1 is not allowed"),
        (["continental-average", "--airs", "5", "--output", "a.nc"], "must end in .zarr"),
        (["continental-average", "--airs", "5", "--output", "a.zarr", "--validation", "1"], "--validation: 1 is not"),
        (["sweep-haze", "--airs", "5", "--output", "a.zarr"], "airs of a training set are drawn"),
        (["continental-average", "--airs", "5", "--output", "a.zarr", "--solver", "zone"], "--solver"),
    ],
)
def test_the_command_refuses_in_a_sentence(options, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = CliRunner().invoke(app, ["dataset", *options])
    assert found.exit_code == 2 and said in found.output and not list(tmp_path.iterdir())


def test_a_plan_computes_nothing(tmp_path):
    options = ["--airs", "20", "--output", str(tmp_path / "a.zarr"), "--plan", "--set", "texture.resolution_deg=15"]
    found = CliRunner().invoke(app, ["dataset", "continental-average", *options])
    assert found.exit_code == 0 and "800 skies of 20 fields" in found.output and not list(tmp_path.iterdir())
    assert "18 airs to train with, 2 for validation" in found.output


def test_a_folder_that_is_no_training_set_is_refused(tmp_path):
    with pytest.raises(TwilightError, match="is not a training set"):
        SkyDataset(tmp_path / "none.zarr")
    with pytest.raises(TwilightError, match="part: test is not known"):
        SkyDataset(tmp_path, "test")
