"""Sweeps: axes, grouping, the dataset, failed tasks and full disks."""

import json
import re

import numpy as np
import pytest
import xarray as xr
from rendering import call
from sweeping import BASE, SUNS, planned, swept

import twilight.api.accessor  # noqa: F401 - registers .sky
from twilight import solvers
from twilight.config.climate import Climate
from twilight.config.load import load_axes, load_series
from twilight.config.scene import Config
from twilight.engine import run
from twilight.scene import resolve
from twilight.studies.sweep.dimensions import IDLE_KEYS, SEVERAL_SUNS, SHAPE_KEYS, key_attributes
from twilight.studies.sweep.store import JOURNAL
from twilight.studies.sweep.work import BENDING, DIRECT, RADIANCE, compute, forget


def test_ranges_hold_their_ends_and_even_steps(toy):
    """An axis would miss its end, or a list of scenes become a product."""
    axes = {
        a.name: [p[a.name] for p in a.points]
        for a in load_axes(
            {
                **BASE,
                "vary": {
                    "sun.elevation_deg": {"from": 10, "to": -18, "count": 29},
                    "aerosol.optical_depth_550nm": {"from": 0.01, "to": 1, "count": 5, "scale": "log"},
                },
            }
        ).axes
    }
    assert axes["sun.elevation_deg"] == list(range(10, -19, -1))
    assert np.allclose(axes["aerosol.optical_depth_550nm"], 10.0 ** np.array([-2, -1.5, -1, -0.5, 0]))
    listed = [{"climate": "urban", "ground.albedo": 0.1}, {"ground.albedo": 0.3, "climate": "desert"}]
    cases = load_series({**BASE, "vary": {"list": listed}})
    assert [(c.config.climate.name, c.config.climate.ground.albedo) for c in cases] == [("urban", 0.1), ("desert", 0.3)]


def test_scenes_that_share_a_field_share_its_computation(toy):
    """A sweep would cost a field for every sun."""
    vary = {"sun.elevation_deg": SUNS, "ground.albedo": [0, 0.5], "observer.altitude_km": [0, 2]}
    made = planned(vary)
    assert [d.name for d in made.dimensions] == ["ground_albedo", "sun_elevation_deg", "observer_altitude_km"]
    assert (made.scenes, made.fields, len(made.tasks)) == (12, 2, 2) and made.chunk == (1, 3, 2)
    able = {name: solvers.load(name).CAPABILITIES.every_observer for name in ("zones", "toy", "cells")}
    assert able == {"zones": True, "toy": True, "cells": False}
    cells = planned(vary, solver={"name": "cells"})
    assert (cells.scenes, cells.fields, cells.chunk) == (12, 4, (1, 1, 3))
    assert [cells.payload(task)["skies"][0] for task in cells.tasks] == [(-4.0, 0.0), (-4.0, 2.0)] * 2
    listed = [{"ground.albedo": a, "sun.elevation_deg": s} for s in SUNS for a in (0, 0.5)]
    together = planned({"list": listed})
    assert (together.scenes, together.fields, len(together.tasks)) == (6, 2, 2)
    assert planned({"solver.name": ["toy", "cells"], "observer.altitude_km": [0, 2]}).fields == 4


def test_a_long_day_is_divided_so_that_workers_have_something_to_do(toy):
    """One worker would do all, or a chunk be too large."""
    made = planned({"sun.elevation_deg": {"from": 0, "to": -9, "count": 1000}})
    assert made.fields == 1 and len(made.tasks) == 16 and sum(t.skies for t in made.tasks) == 1000
    assert len({t.key for t in made.tasks}) == 16
    large = planned(
        {"ground.albedo": {"from": 0, "to": 1, "count": 20}, "sun.elevation_deg": {"from": 0, "to": -9, "count": 500}},
        texture={"resolution_deg": 1},
    )
    assert large.chunk[1] * 90 * 181 * 2 * 4 <= 16 * 2**20 < (large.chunk[1] + 1) * 90 * 181 * 2 * 4
    assert len(large.tasks) == 20 * -(-500 // large.chunk[1])


def test_keys_of_tasks_follow_all_that_matters_and_nothing_else(toy):
    """A sweep would be redone for a name, or not for another gas."""
    keys = {}
    for name, changes in {
        "base": {}, "name": {"name": "x"}, "output": {"output": {"width": 8}},
        "texture": {"texture": {"azimuth_count": 6}},
        "solver": {"solver": {"name": "toy", "factor": 2}}, "gas": {"climate": {"version": 1, "gases": {"no2": False}}},
        "wavelength": {"wavelengths": {"list_nm": [450]}},
        "distance": {"sun": {"elevation_deg": 1, "distance_au": 1.01}},
    }.items():  # fmt: skip
        keys[name] = planned({"ground.albedo": [0, 1]}, **changes).tasks[0].key
    assert keys["base"] == keys["name"] == keys["output"]
    assert len(set(keys.values())) == len(keys) - 2


def test_a_task_gives_what_run_gives(toy):
    """A sweep's skies would differ from renders."""
    forget()
    made = planned({"observer.altitude_km": [0, 1], "ground.albedo": [0.3]}, sun={"elevations_deg": [5, -4]})
    (task,) = made.tasks
    arrays = compute(made.payload(task), threads=1).arrays
    for scene, radiance, direct, bending in zip(
        task.scenes(), arrays[RADIANCE], arrays[DIRECT], arrays[BENDING], strict=True
    ):
        altitude, sun = made.dimensions[1].points[scene[1]]["observer.altitude_km"], (5, -4)[scene[2]]
        config = load_series({**BASE, "sun": {"elevation_deg": sun}}, {"ground.albedo": 0.3})[0].config
        sky = run(
            resolve(
                config.model_copy(update={"observer": config.observer.model_copy(update={"altitude_km": altitude})})
            )
        )
        above = sky.sun_normalised_radiance[sky.elevation_deg > 0.0, :5]  # a render from high up looks down too
        assert np.allclose(radiance, above, rtol=1e-6)
        assert np.allclose(direct, sky.direct_irradiance, rtol=1e-6)
        assert bending == pytest.approx(sky.apparent_sun_elevation_deg - sun, rel=1e-5)


def test_many_wavelengths_are_done_in_blocks(toy):
    """A refused sun would take the others with it."""
    nm = np.linspace(400, 700, 40)
    made = planned({"sun.elevation_deg": [-4, -20]}, wavelengths={"list_nm": nm.tolist()})
    done = compute(made.payload(made.tasks[0]), threads=1)
    e, a = np.meshgrid(made.elevation_deg, made.azimuth_deg, indexing="ij")
    assert np.allclose(done.arrays[RADIANCE][0], toy.truth(1, 0, -4, 0, e, a, nm), rtol=1e-6)
    assert list(done.refused) == [1] and all(np.isnan(values[1]).all() for values in done.arrays.values())


def test_times_and_places_become_coordinates(toy, client, tmp_path):
    """Skies would lie under other times or places."""
    sun = {"start": "2026-12-21T16:30", "stop": "2026-12-21T17:00", "step_minutes": 15, "time_zone": "Europe/Berlin"}
    sun |= {"latitude_deg": 52.5, "longitude_deg": 13.4}
    made = planned({"sun.latitude_deg": [50, 54]}, sun=sun)
    swept(made, client, tmp_path / "a.zarr")
    with xr.open_zarr(tmp_path / "a.zarr") as data:
        assert data.time.values.astype("datetime64[m]").tolist() == [
            np.datetime64(t).item() for t in ("2026-12-21T15:30", "2026-12-21T15:45", "2026-12-21T16:00")
        ]
        assert data.solar_elevation_angle.dims == data.solar_azimuth_angle.dims == ("sun_latitude_deg", "time")
        sky = data.sky.scene(sun_latitude_deg=54, time="2026-12-21T15:45")
    config = load_series({**BASE, "sun": sun | {"start": "2026-12-21T16:45", "stop": "2026-12-21T16:45"}})[0].config
    config = config.model_copy(update={"sun": config.sun.model_copy(update={"latitude_deg": 54.0})})
    again = run(resolve(config))
    for name in ("sun_elevation_deg", "sun_azimuth_deg", "distance_au", "apparent_sun_elevation_deg"):
        assert getattr(sky, name) == pytest.approx(getattr(again, name), rel=1e-6), name
    assert np.allclose(sky.radiance, again.radiance, rtol=1e-6)


def varied_keys():
    """Every key of a configuration and of a climate that is not a section."""

    def walk(model, prefix):
        for name, info in model.model_fields.items():
            inner = models(info.annotation)
            if not inner or name == "albedo":  # a number or a section
                yield f"{prefix}{name}"
            for one in inner:
                yield from walk(one, f"{prefix}{name}.")

    found = dict.fromkeys([*walk(Config, ""), *walk(Climate, "")])
    heads = {*SHAPE_KEYS, *IDLE_KEYS, "climate", "solver"}
    return [key for key in found if key.split(".")[0] not in heads and key not in SEVERAL_SUNS]


def models(annotation):
    if hasattr(annotation, "model_fields"):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in models(inner)]


def test_every_key_that_may_vary_has_a_label_for_an_axis():
    """An axis would have no name or unit."""
    keys = varied_keys()
    assert {"aerosol.optical_depth_550nm", "sun.elevation_deg", "terrain.height_km"} <= {*keys} and len(keys) > 60
    for key in keys:
        made = key_attributes(key)
        assert 1 < len(made["long_name"]) <= 43 and not set(made["long_name"]) & set(";:_."), (key, made)
        assert made["comment"] != made["long_name"] and made["key"] == key
        assert "units" not in made or made["units"] not in ("deg", "au", "cm^-3", "m/s"), (key, made)
    made = key_attributes("aerosol.optical_depth_550nm")
    assert (made["long_name"], made["units"]) == ("aerosol optical depth at 550 nm", "1")
    assert key_attributes("sun.elevation_deg")["units"] == "degree"
    assert key_attributes("solver.expert.degree") == {"long_name": "degree", "key": "solver.expert.degree"}


def test_axes_and_legends_of_a_sweep_are_a_few_words(toy, client, tmp_path):
    """A legend would be a paragraph."""
    swept(planned({"ground.albedo": [0.1, 0.3], "sun.elevation_deg": SUNS}), client, tmp_path / "a.zarr")
    with xr.open_zarr(tmp_path / "a.zarr") as data:
        said = {str(name): data[name].attrs.get("long_name", "") for name in data.variables}
    assert said.pop("status") == ""
    assert all(1 < len(text) <= 36 for text in said.values()), said
    assert (said["ground_albedo"], said["sun_elevation_deg"]) == ("ground albedo", "sun elevation")


def test_a_plan_says_what_is_there_already(toy, client, tmp_path, log):
    """A plan would touch the journal, or forget what is done."""
    path, out = tmp_path / "scenes.yaml", tmp_path / "a.zarr"
    vary = {"solver.factor": [1, 2, 3], "sun.elevation_deg": SUNS}

    def plan(wanted):
        path.write_text(json.dumps({**BASE, "vary": wanted}))
        return call("sweep", str(path), "--output", str(out), "--plan")

    assert "already" not in plan(vary).output and "not known before a task is finished" in plan(vary).output
    assert not out.exists()
    swept(planned(vary), client, out)
    assert "3 of 3 tasks are there already" in plan(vary).output
    lines = (out / JOURNAL).read_text().splitlines(keepends=True)
    (out / JOURNAL).write_text("".join(lines[:2]))
    assert "2 of 3 tasks are there already" in plan(vary).output
    assert re.search(r"the rest takes some \S+ (s|min|h) of processor time", plan(vary).output)
    assert (out / JOURNAL).read_text() == "".join(lines[:2])
    other = plan(vary | {"solver.factor": [1, 4]})
    assert other.exit_code == 2 and "holds another sweep" in other.output
