"""The engine: blocks, observers, mirror images, what solvers declare, and what its callers may no longer decide."""

import inspect
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from twilight import solvers
from twilight.base.digest import DISPLAY, code_digest, files_of
from twilight.base.errors import TwilightError
from twilight.config import load
from twilight.config.load import load_axes
from twilight.engine import parts, plan, run, solve
from twilight.scene import resolve
from twilight.solvers.base import BareField, Capabilities
from twilight.studies.sweep.sweep import Sweep
from twilight.studies.sweep.work import compute, forget

AIR = {"version": 1, "climate": {"version": 1, "name": "air"}, "texture": {"azimuth_count": 6, "elevation_count": 2}}


class ToyField(BareField):
    def __init__(self, medium, altitude_km):
        self.medium, self.altitude_km = medium, altitude_km

    def radiance(self, sun_elevation_deg, elevation_deg, azimuth_deg):
        elevation, azimuth = np.broadcast_arrays(np.asarray(elevation_deg, float), np.asarray(azimuth_deg, float))
        if (azimuth > 180.0).any():
            raise TwilightError("toy: asked for both halves")
        level = (100.0 + sun_elevation_deg + elevation) * np.exp(-self.altitude_km) + np.cos(np.radians(azimuth))
        return level[..., None] * self.medium.wavelength_nm


@dataclass(frozen=True)
class ToySettings:
    field_file: str = ""


def toy_solver(**capabilities):
    """A solver as a namespace, with the list of what it was asked to prepare."""
    made = SimpleNamespace(QUALITIES={"standard": ToySettings()}, CAPABILITIES=Capabilities(**capabilities), calls=[])

    def prepare(medium, settings=None, *, observer_altitude_km=0.0, progress=None, **more):
        made.calls.append((medium.wavelength_nm.tolist(), observer_altitude_km, more))
        return ToyField(medium, observer_altitude_km)

    made.prepare = prepare
    return made


def toy_scene(solver, wavelength_nm=(400.0, 500.0, 600.0)):
    config = load({**AIR, "horizon": "clean", "wavelengths": {"list_nm": list(wavelength_nm)}})
    return replace(resolve(config), solver=solver, settings=ToySettings())


def solved_toy(solver, **more):
    return solve(toy_scene(solver), cached=False, **more)


def test_wavelengths_go_in_blocks_of_what_the_solver_declares_and_come_back_in_order():
    """Wavelengths would be exchanged between blocks."""
    solver = toy_solver(wavelengths_at_once=2)
    solved = solved_toy(solver)
    assert [call[0] for call in solver.calls] == [[400.0, 500.0], [600.0]]
    found = solved.radiance(10.0, [20.0, 30.0], [0.0, 90.0])
    np.testing.assert_allclose(found, np.outer([131.0, 140.0], [400.0, 500.0, 600.0]))
    assert solved.direct(10.0).irradiance.shape == (3,)


def test_one_block_is_held_at_a_time_where_they_are_taken_one_by_one():
    """All blocks would be in memory at once."""
    import gc
    import weakref

    held, found = [], []
    for part in parts(plan(toy_scene(toy_solver(wavelengths_at_once=1)))):
        solved = part.solve()
        gc.collect()
        assert sum(ref() is not None for ref in held) == 0
        held.append(weakref.ref(solved.blocks[0].field))
        found += solved.medium.wavelength_nm.tolist()
        del solved
    assert found == [400.0, 500.0, 600.0]


def test_a_model_without_grids_takes_bands_and_others_in_one_block():
    """A night's light would be computed three times over."""
    keys = {"wavelengths.list_nm": [545.0, 590.0, 620.0]}
    count = {}
    for name, more in (("compact", {}), ("zones", {"solver.expert.spectrum": "solved"})):
        made = plan(resolve(load("pure-air", keys | {"solver.name": name} | more)))
        assert made.term_counts[1] > 1 and made.term_counts[0] == made.term_counts[2] == 1
        count[name] = len(parts(made))
    assert count == {"compact": 1, "zones": 3}


def test_a_field_of_one_observer_is_solved_anew_for_another_and_serves_until_then():
    """Another observer would get the first one's sky."""
    solver = toy_solver()
    solved = solved_toy(solver)
    there = [solved.radiance(0.0, [10.0], [0.0], observer_altitude_km=2.0)[0, 0] for _ in range(2)]
    assert there == pytest.approx([400.0 * (110.0 * np.exp(-2.0) + 1.0)] * 2)
    assert solved.radiance(0.0, [10.0], [0.0])[0, 0] == pytest.approx(400.0 * 111.0)
    assert [call[1] for call in solver.calls] == [0.0, 2.0, 0.0]


def test_the_suns_are_given_to_solvers_that_take_them_only():
    """A solver would be asked with an argument that it has not."""
    for takes in (True, False):
        solver = toy_solver(takes_suns=takes)
        solved_toy(solver, sun_elevations_deg=(3.0, -4.0))
        assert solver.calls[0][2] == ({"sun_elevations_deg": [3.0, -4.0]} if takes else {})


def test_half_a_texture_is_asked_for_and_mirrored():
    """The other half of the sky would be computed, or not be its mirror image."""
    sky = solved_toy(toy_solver()).sky(5.0, np.array([10.0, 50.0]), np.arange(6) * 60.0)
    assert sky.sun_normalised_radiance[0, :, 0] == pytest.approx(
        400.0 * (115.0 + np.cos(np.radians([0.0, 60.0, 120.0, 180.0, 120.0, 60.0])))
    )
    assert sky.apparent_sun_elevation_deg > 5.0 and (sky.direct_irradiance > 0).all()


def test_radiance_that_cannot_be_is_an_error_for_every_caller(monkeypatch):
    """A wrong solver would make black or shining pixels; a field file would hold the last block alone."""
    solved = solved_toy(toy_solver())
    monkeypatch.setattr(type(solved.blocks[0].field), "radiance", lambda *_, **__: np.full((1, 3), -1.0))
    with pytest.raises(TwilightError, match="negative or not a number"):
        solved.radiance(-2.0, [0.0], [90.0])
    with pytest.raises(TwilightError, match=r"field_file: holds the field of up to 2 wavelengths, and air has 3"):
        scene = toy_scene(toy_solver(wavelengths_at_once=2))
        solver = toy_solver(wavelengths_at_once=2)
        plan(replace(scene, solver=solver, settings=ToySettings("x.h5")))


@pytest.mark.parametrize("name", solvers.SOLVERS)
def test_solvers_can_do_what_they_declare_and_no_more(name):
    """The engine would ask a solver for what it cannot do."""
    solver = solvers.load(name)
    able = solver.CAPABILITIES
    given = inspect.signature(solver.prepare).return_annotation
    field = vars(inspect.getmodule(solver.prepare))[given] if isinstance(given, str) else given
    takes = inspect.signature(solver.prepare).parameters
    assert ("sun_elevations_deg" in takes) == able.takes_suns
    assert ("observer_altitude_km" in inspect.signature(field.radiance).parameters) == able.every_observer
    assert hasattr(field, "radiance_with_error") == able.standard_error
    assert hasattr(field, "inscatter") == able.finite_segments
    standard = solver.QUALITIES["standard"]
    assert hasattr(standard, "polarisation") == hasattr(field, "stokes")
    for known in (field.convergence, field.facts) if name != "preetham" else ():
        assert known is None or known == {}


def test_a_sweep_gives_a_formula_all_wavelengths_at_once():
    """preetham reads its turbidity at 550 nm: each block of 40 wavelengths would find another."""
    forget()
    keys = {**AIR, "climate": "continental-average", "solver": {"name": "preetham"}, "wavelengths": {"count": 40}}
    made = Sweep(load_axes({**keys, "vary": {"sun.elevation_deg": [30.0, 50.0]}}))
    radiance = compute(made.payload(made.tasks[0]), threads=1).arrays["sun_normalised_radiance"]
    scene = load(keys, {"sun.elevation_deg": made.sun((0,))[0].elevation_deg})
    half = run(resolve(scene)).sun_normalised_radiance[:, : made.azimuth_deg.size]
    np.testing.assert_array_equal(radiance[0], half.astype(np.float32))
    forget()


def test_the_code_of_a_sweep_is_what_computes_it():
    """A sweep would go on with results of other code, or be redone for a page of the docs."""
    work = "twilight.studies.sweep.work"
    files = files_of(work, solvers.SOLVERS["zones"], without=DISPLAY)
    names = {file.as_posix().rsplit("twilight/", 1)[-1] for file in files}
    code = {"studies/sweep/work", "engine/field", "scene/plan", "solvers/zones/field", "transport/beam"}
    assert {f"{name}.py" for name in code} <= names
    assert {"data/opac/mie_ten_types.npz", "data/gases/no2_vandaele1998.csv"} <= names
    others = ("studies/validate/", "studies/camera/", "cli/", "solvers/cells/", "solvers/montecarlo/", "data/stars",
              "data/references")  # fmt: skip
    assert [name for name in names if name.startswith(others)] == []
    read = ("io/air/", "io/albedo_map", "io/stored_")  # the air's and the ground's
    assert [name for name in names if name.startswith("io/") and not name.startswith(read)] == []
    assert code_digest(work, "twilight.solvers.zones") != code_digest(work, "twilight.solvers.cells")


def test_both_sides_of_a_comparison_see_what_the_plan_leaves():
    """The two sides of a comparison would see different air."""
    from twilight.studies.compare.job import Job, SampleDirections
    from twilight.studies.compare.worker import _Execution

    thin = load({**AIR, "wavelengths": {"list_nm": [550.0, 600.0]}}, {"gases.ozone.column_du": 1e-2})
    job = Job(thin, (5.0,), {5.0: SampleDirections((10.0,), (0.0,))})
    planned = resolve(thin)
    assert "ozone" in [item.part for item in planned.omissions]
    side = _Execution(job.message((5.0,), ()), lambda answer: None)._scene(None)
    np.testing.assert_array_equal(side.medium.absorption_per_km, planned.medium.absorption_per_km)
    whole = resolve(thin.model_copy(update={"omit_negligible": False}))
    assert (whole.medium.absorption_per_km > planned.medium.absorption_per_km).any()
