"""Climates and configurations: what is accepted, and that every error names the file, the key and what is allowed."""

import dataclasses
import itertools
import re
import shutil
import warnings
from pathlib import Path
from types import UnionType
from typing import Annotated, Union, get_args, get_origin

import pytest
from pydantic import BaseModel

from twilight import solvers
from twilight.base.document import parse_yaml
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.sections import Origins, validate
from twilight.config import Climate, Config, load, load_climate, load_series
from twilight.config.load import parse_setting, shipped

OPAC_TYPES = (
    "continental-clean continental-average continental-polluted urban desert "
    "maritime-clean maritime-polluted maritime-tropical arctic antarctic"
).split()


def models(annotation, seen=None):
    """All models that a model is made of."""
    seen = {} if seen is None else seen
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        if annotation not in seen:
            seen[annotation] = annotation
            for field in annotation.model_fields.values():
                models(field.annotation, seen)
    elif get_origin(annotation) in (Union, UnionType, Annotated, tuple, dict):
        for part in get_args(annotation):
            models(part, seen)
    return list(seen)


def refused(tmp_path: Path, text: str, *, settings=None) -> str:
    """The sentence with which a document is refused; it must be one sentence that names the file or setting."""
    path = tmp_path / "document.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(TwilightError) as error:
        load(path, settings)
    sentence = str(error.value)
    assert "\n" not in sentence
    assert "pydantic" not in sentence and "[type=" not in sentence
    assert str(path) in sentence or any(f"setting {key}" in sentence for key in settings or ())
    return sentence


CLIMATE = "version: 1\nname: x\n"


def test_a_table_lies_beside_the_climate_also_when_a_configuration_elsewhere_names_it(tmp_path):
    """A table would be sought beside the wrong file."""
    (tmp_path / "air").mkdir()
    (tmp_path / "air" / "t.csv").touch()
    (tmp_path / "air" / "t.yaml").write_text("version: 1\nmedium: {table: t.csv}\n")
    (tmp_path / "config.yaml").write_text("version: 1\nclimate: air/t.yaml\nsolver: {name: cells}\n")
    config = load(tmp_path / "config.yaml")
    assert config.climate.medium is not None
    assert Path(config.climate.medium.table) == tmp_path / "air" / "t.csv"


def test_a_name_is_a_climate_or_a_configuration_and_not_both():
    """A name would mean two things, `no` be false, 16:00 the number 960, or `--set` read otherwise."""
    assert not shipped("climates").keys() & shipped("configs").keys()
    assert load("haber2005").solver == {"name": "cells", "quality": "haber2005"}
    text = "a: 1e-3\nb: 16:00\nc: 2003-12-08\nd: no\ne: -4\nf: .5\ng: ~\nh: true\n"
    assert parse_yaml(text, "x") == {
        "a": 1e-3, "b": "16:00", "c": "2003-12-08", "d": "no", "e": -4, "f": 0.5, "g": None, "h": True,
    }  # fmt: skip
    assert parse_setting("sun={elevation_deg: -4}") == ("sun", {"elevation_deg": -4})
    assert parse_setting("a.b=c=d") == ("a.b", "c=d")
    for text in ("albedo", "=3", "a=[1"):
        with pytest.raises(TwilightError, match="--set"):
            parse_setting(text)


def test_all_shipped_documents_load_and_are_named_like_their_files():
    """A document that ships would be refused, or have another name than its file."""
    climates, configs = shipped("climates"), shipped("configs")
    assert set(OPAC_TYPES) | {"pure-air", "volcanic-stratosphere", "haber2005-air"} <= set(climates)
    for name, path in climates.items():
        climate = load_climate(path)
        assert climate.name == name and climate.description
    for name, path in configs.items():
        cases = load_series(path)
        assert cases and all(case.config.title == name for case in cases)
    for name in OPAC_TYPES:
        aerosol = load_climate(name).aerosol
        assert aerosol is not None and aerosol.type == name.replace("-", "_")
        assert aerosol.stratosphere == "measured"


SECTIONS = [pytest.param(model, id=model.__name__) for model in models(Config)]


@pytest.mark.parametrize("model", SECTIONS)
def test_at_every_level_a_slip_in_a_key_names_its_neighbour(model):
    """A misspelt key would be ignored, or not say which one was meant."""
    for name in model.model_fields:
        if len(name) < 4:
            continue
        slip = name[:-2] + name[-1]
        if slip in model.model_fields:
            continue
        with pytest.raises(TwilightError) as error:
            validate(model, {slip: 1}, Origins({(): "a.yaml"}))
        assert f"a.yaml: {slip} is not a key; did you mean" in str(error.value)
        assert name in str(error.value)


@pytest.mark.parametrize("model", SECTIONS)
def test_every_key_has_a_line_of_help_and_every_number_a_unit(model):
    """A key would stand in the reference without meaning or unit."""

    def has_number(annotation):
        bare = get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation
        if get_origin(bare) in (Union, UnionType, tuple):
            return any(has_number(a) for a in get_args(bare))
        return bare in (int, float)

    assert model.model_config["extra"] == "forbid" and model.model_config["frozen"]
    for name, field in model.model_fields.items():
        assert field.description, name
        if has_number(field.annotation):
            assert isinstance(field.json_schema_extra, dict) and field.json_schema_extra.get("unit"), name


def test_the_json_schema_describes_every_key():
    """An editor would take a misspelt key."""
    for model in (Climate, Config):
        schema = model.model_json_schema()
        for part in (schema, *schema["$defs"].values()):
            assert part["additionalProperties"] is False
            assert all("description" in key or "$ref" in key for key in part["properties"].values())


def test_the_json_schema_has_the_options_of_every_solver():
    """An editor would neither complete solver.max_orders nor mark solver.max_ordres."""
    parts = {
        part["properties"]["name"]["const"]: part
        for part in Config.model_json_schema()["properties"]["solver"]["oneOf"]
    }
    assert parts.keys() == set(solvers.SOLVERS)
    assert "required" not in parts[solvers.DEFAULT] and parts["cells"]["required"] == ["name"]
    for name, part in parts.items():
        preset = solvers.load(name).QUALITIES["standard"]
        options = {**part["properties"], **part["properties"].get("expert", {"properties": {}})["properties"]}
        assert set(options) - {"name", "quality", "expert"} == {f.name for f in dataclasses.fields(preset)}
        assert all(option["description"] for key, option in options.items() if key not in ("name", "quality", "expert"))
    orders = parts["zones"]["properties"]["max_orders"]
    assert orders["type"] == "integer" and orders["default"] == solvers.load("zones").QUALITIES["standard"].max_orders


def test_settings_reach_climate_and_configuration_and_are_named_in_errors(tmp_path):
    """A setting would not arrive, or a refusal not name it."""
    config = load(
        "urban", {"aerosol.relative_humidity_percent": 95, "observer.altitude_km": 2, "sun": {"elevation_deg": -4}}
    )
    assert config.climate.aerosol is not None
    assert config.climate.aerosol.relative_humidity_percent == 95
    assert config.observer.altitude_km == 2 and config.sun.elevation_deg == -4
    assert load("urban").climate.aerosol.relative_humidity_percent == 80
    sentence = refused(tmp_path, CLIMATE, settings={"ground.albedo": 7})
    assert "setting ground.albedo: ground.albedo must be" in sentence
    assert refused(tmp_path, CLIMATE, settings={"grund.albedo": 0.7}).endswith("wavelengths")


def test_series_are_products_and_each_member_has_its_own_name(tmp_path):
    """A series would miss a member, or two share a folder."""
    path = tmp_path / "series.yaml"
    path.write_text(
        "version: 1\nclimate: urban\n"
        "vary:\n  climate: [urban, desert]\n  aerosol.relative_humidity_percent: [50, 80, 95]\n"
    )
    cases = load_series(path)
    found = [(c.config.climate.name, c.config.climate.aerosol.relative_humidity_percent) for c in cases]
    assert found == list(itertools.product(["urban", "desert"], [50, 80, 95]))
    assert len({case.name for case in cases}) == 6
    assert cases[1].name == "urban_relative_humidity_percent=80"
    with pytest.raises(TwilightError, match="6 cases"):
        load(path)
    path.write_text("version: 1\nclimate: urban\nvary: {observer.altitude_km: [1, 1]}\n")
    with pytest.raises(TwilightError, match="twice"):
        load_series(path)


@pytest.mark.parametrize(
    "key, value, says",
    (
        ("aerosol.relative_humidity_percent", 0.8, "is 0.8 %, drier than any desert; 80 is 80 %"),
        ("gases.ozone.column_du", 3, "is 3 DU, less than has ever been measured; 3 mm of ozone are 300 DU"),
        ("observer.altitude_km", 2600, "is 2600 km, above the air; 2600 m are 2.6 km"),
        ("aerosol.optical_depth_550nm", 12, "more than all but the densest smoke"),
        ("refraction.co2_ppm", 0.042, "is 0.042 ppm; the air has 420"),
    ),
)
def test_a_value_that_is_almost_surely_a_slip_is_said_and_taken(key, value, says):
    """Metres would be taken for kilometres without a word."""
    with pytest.warns(TwilightWarning, match=re.escape(says)) as caught:
        load_series("urban", {key: value})
    assert len(caught) == 1 and key in str(caught[0].message)


def test_what_ships_and_usual_values_hold_no_slip():
    """Usual values would be warned of."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", TwilightWarning)
        for kind in ("climates", "configs"):
            for path in shipped(kind).values():
                load_series(path)
        load_series("urban", {"gases.ozone.column_du": 0, "aerosol.relative_humidity_percent": 0})
        load_series("urban", {"observer.altitude_km": 12, "gases.ozone.column_du": 110})


def test_the_command_line_says_a_slip_once(monkeypatch):
    """A warning would be printed for every frame."""
    from typer.testing import CliRunner

    from twilight.cli.app import app

    words = ["render", "urban", "--set", "gases.ozone.column_du=3", "--plan", "--target-error", "0.01"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0
    assert result.stderr.splitlines() == [
        "twilight: gases.ozone.column_du is 3 DU, less than has ever been measured; 3 mm of ozone are 300 DU"
    ]


def test_folders_of_a_series_are_told_apart_and_not_too_long(tmp_path):
    """Two climates of one name in two folders would be one, a list of wavelengths a name that no disk takes."""
    from twilight.config.load import load_series

    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        shutil.copy(Path(__file__).parents[2] / "climates" / "pure-air.yaml", tmp_path / name / "x.yaml")
    files = [str(tmp_path / name / "x.yaml") for name in ("a", "b")]
    many = [list(range(400, 700)), list(range(400, 702, 2))]
    config = {"version": 1, "vary": {"climate": files, "wavelengths.list_nm": many}}
    for case in load_series(config), load_series({"version": 1, "vary": {"list": [{"climate": f} for f in files]}}):
        names = [one.name for one in case]
        assert len(set(names)) == len(names) and all("x" in name for name in names)
        assert max(len(part) for name in names for part in name.split("/")) <= 130
    with pytest.raises(TwilightError, match="lists the same value twice"):
        load_series({"version": 1, "vary": {"climate": [files[0]] * 2}})
