"""Drawn airs: the same seed draws the same, parts by draw, turbidity beside them, and what the loader hands out."""

import numpy as np
import pytest
import xarray as xr
from sweeping import BASE, planned, swept
from typer.testing import CliRunner

from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config.load import load, load_axes
from twilight.scene.medium import climate_medium
from twilight.solvers.analytic.daylight import turbidity_of
from twilight.studies.sweep.loader import load_skies

DRAWN = {"ground.albedo": {"uniform": [0.0, 0.8]}, "atmosphere.profile": {"choice": ["tropical", "us_standard"]}}
SUNS = {"sun.elevation_deg": [5.0, -4.0, -12.0]}


@pytest.fixture(scope="module")
def written(toy, client, tmp_path_factory):
    """Six draws under three suns, one of which the toy solver refuses for its depth."""
    path = tmp_path_factory.mktemp("drawn") / "skies.zarr"
    swept(planned(DRAWN | SUNS, draws=6, seed=1, validation=0.3), client, path)
    return path, toy


def axis_of(vary, **drawing):
    return load_axes({**BASE, "vary": vary, **drawing}).axes[0]


def test_every_part_of_a_distribution_is_drawn_from_once_and_the_same_seed_draws_the_same(toy):
    """Draws would leave gaps, depend on each other, or change when a key is added."""
    vary = {
        "gases.ozone.column_du": {"uniform": [200, 400]},
        "climate": {"choice": ["urban", "desert", "arctic", "antarctic"]},
        "ground.albedo": {"log_uniform": [0.01, 1]},
    }
    axis = axis_of(vary, draws=40, seed=3)
    columns = {key: [p[key] for p in axis.points] for key in vary}
    assert sorted(int((v - 200) / 5) for v in columns["gases.ozone.column_du"]) == list(range(40))
    assert sorted(int((np.log10(v) + 2) * 20) for v in columns["ground.albedo"]) == list(range(40))
    assert {c: columns["climate"].count(c) for c in vary["climate"]["choice"]} == dict.fromkeys(columns["climate"], 10)
    # independent of each other: no rank correlation beyond four standard errors
    assert abs(np.corrcoef(columns["gases.ozone.column_du"], np.log(columns["ground.albedo"]))[0, 1]) < 4 / np.sqrt(39)
    assert axis_of(vary, draws=40, seed=3) == axis != axis_of(vary, draws=40, seed=4)
    alone = axis_of({"ground.albedo": vary["ground.albedo"]}, draws=40, seed=3)
    assert [p["ground.albedo"] for p in alone.points] == columns["ground.albedo"]


@pytest.mark.parametrize(
    "draws, validation, held", [(30, 1 / 3, 10), (20, None, 2), (2, 0.01, 1), (2, 0.99, 1), (1, 0.5, 0), (9, 0, 0)]
)
def test_so_many_draws_are_held_out(toy, draws, validation, held):
    """A part would be empty, or hold all."""
    drawing = {"draws": draws, "seed": 4} | ({} if validation is None else {"validation": validation})
    axis = axis_of(DRAWN, **drawing)
    assert len(axis.held_out) == held and axis.held_out <= set(range(draws))
    assert axis_of(DRAWN, **drawing).held_out == axis.held_out


def test_the_record_of_a_sweep_is_a_configuration_of_its_first_scene():
    """A reader who renders it would be refused, or told of another seed."""
    scene = {"climate": "pure-air", "solver": {"name": "compact"}}
    document = planned(DRAWN | SUNS, draws=6, seed=1, validation=0.5, **scene)._document()
    record = document["configuration"]
    assert load(record).climate.ground.albedo == record["climate"]["ground"]["albedo"]
    assert not {"draws", "seed", "validation"} & record.keys()


def test_a_plan_says_how_many_draws_are_held_out(tmp_path):
    """A plan would compute, or not say the parts."""
    more = ["--output", str(tmp_path / "a.zarr"), "--plan", "--set", "texture.resolution_deg=15"]
    found = CliRunner().invoke(app, ["sweep", "sweep-drawn", *more])
    assert found.exit_code == 0 and "240 skies of 20 fields" in found.stdout and not list(tmp_path.iterdir())
    assert "18 draws to train with, 2 for validation" in found.stderr


def test_xarray_sees_parts_and_turbidity(written, client):
    """A column would be missing, or held-out skies be trained with."""
    with xr.open_zarr(written[0]) as data:
        assert data.split.dims == ("draw",) and int(data.split.sum()) == 2
        assert data.split.attrs["flag_meanings"] == "train validation"
        assert data.turbidity.dims == ("draw",) and bool((data.turbidity == 1.0).all())  # this air has no aerosol
    with pytest.raises(TwilightError, match=r"holds another sweep \(held_out"):
        swept(planned(DRAWN | SUNS, draws=6, seed=1, validation=0.5), client, written[0])


@pytest.mark.slow
def test_the_turbidity_is_that_of_the_air(client, tmp_path):
    """Airs of one load would get each other's column."""
    vary = {"aerosol.optical_depth_550nm": {"uniform": [0.05, 0.5]}, "sun.elevation_deg": [20.0, 5.0]}
    scene = {"climate": "continental-average", "solver": {"name": "compact"}}
    sweep = planned(vary, draws=3, **scene)
    swept(sweep, client, tmp_path / "a.zarr")
    with xr.open_zarr(tmp_path / "a.zarr") as data:
        for i, found in enumerate(data.turbidity.values):
            config = sweep.series.config(sweep.drawn.points[i])
            assert found == pytest.approx(turbidity_of(climate_medium(config.climate, sweep.wavelength_nm)), rel=1e-4)
        assert np.all(np.diff(data.turbidity.values[np.argsort(data.aerosol_optical_depth_550nm.values)]) > 0.0)


def test_skies_are_those_of_their_inputs_and_no_draw_is_in_both_parts(written):
    """A model would be trained with another air's sky, or tested on an air that it knows."""
    path, toy = written
    parts = {part: load_skies(path, part) for part in ("train", "validation", "all")}
    for skies in parts.values():
        assert "turbidity" in skies.input and "sun_elevation_deg" not in skies.input
        e, a = np.meshgrid(skies.elevation, skies.azimuth, indexing="ij")
        for i, numbers in enumerate(skies.inputs):
            albedo, sun = (float(numbers.sel(input=name)) for name in ("ground_albedo", "solar_elevation_angle"))
            exact = toy.truth(1.0, albedo, sun, 0.0, e, a, skies.wavelength.values)
            np.testing.assert_allclose(skies.sun_normalised_radiance[i].values, exact, rtol=1e-5)
    draws = {part: {*skies.draw.values.tolist()} for part, skies in parts.items()}
    assert not draws["train"] & draws["validation"] and draws["train"] | draws["validation"] == {*range(6)}
    assert {part: skies.sizes["sky"] for part, skies in parts.items()} == {"train": 8, "validation": 4, "all": 12}
    assert parts["all"].inputs.sel(input="solar_elevation_angle").min() == -4.0  # -12 was refused
    assert {*parts["all"].inputs.sel(input="atmosphere_profile").values} == {0.0, 1.0}


def test_what_the_loader_cannot_read_is_one_sentence(toy, client, tmp_path):
    """Another dataset would be trained with."""
    swept(planned({"ground.albedo": [0.1]}), client, tmp_path / "plain.zarr")
    for path, part, says in (
        (tmp_path / "none.zarr", "all", "is not the dataset of a sweep"),
        (tmp_path / "plain.zarr", "all", "is no sweep with draws"),
        (tmp_path / "plain.zarr", "test", "part: 'test' is not known"),
    ):
        with pytest.raises(TwilightError, match=says):
            load_skies(path, part)
