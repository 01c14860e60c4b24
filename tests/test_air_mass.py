"""Air-mass factors and derivatives: against closed forms, finite differences, and one solver against the other."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from montecarlo_media import hazy_earth

import twilight
from twilight.atmosphere import layer_changes
from twilight.atmosphere.layer_changes import layer_depth, layer_edges, of_layer, with_doubled_levels
from twilight.base.errors import TwilightError
from twilight.base.progress import silent
from twilight.config import load
from twilight.config.load import load_axes
from twilight.config.scene import Config
from twilight.scene import shifted as shifted_air
from twilight.solvers import montecarlo, zones
from twilight.solvers.montecarlo.path_lengths import BoxLayers, add_sunbeam
from twilight.solvers.zones.adjoint import NodeLight, next_light
from twilight.solvers.zones.derivatives import differentiate, perturbed_grids
from twilight.solvers.zones.field import Field
from twilight.solvers.zones.solve import solve
from twilight.studies.airmass import report, table
from twilight.studies.airmass.factors import with_gas
from twilight.studies.airmass.gas_profile import GasProfile, of_atmosphere, read_profile
from twilight.transport.beam import prepare_beam
from twilight.transport.ray_profile import ray_profile

EDGES_KM = np.array([0.0, 2.0, 6.0, 12.0, 18.0, 24.0, 30.0, 40.0, 60.0, 100.0])
SUNS_AND_DIRECTIONS = ((30.0, 90.0, 0.0), (0.0, 90.0, 0.0), (-4.0, 10.0, 0.0), (-4.0, 20.0, 120.0))


@pytest.fixture(scope="module")
def medium():
    return hazy_earth(wavelength_nm=(450.0,))


@pytest.fixture(scope="module")
def solved(medium):
    return zones.prepare(medium, zones.QUALITIES["draft"])


@pytest.fixture(scope="module")
def differentiated(solved):
    return differentiate(solved, "absorption", EDGES_KM)


def absorbing(medium, low_km, high_km, depth):
    """The medium with more absorption of a vertical optical depth in a layer whose edges are doubled levels."""
    inside = of_layer(medium.altitude_km, low_km, high_km)[:, None]
    more = medium.absorption_per_km + inside * depth / (high_km - low_km)
    exact = (
        layer_depth(more - 0.0, medium.altitude_km, np.array([low_km, high_km]))
        - layer_depth(medium.absorption_per_km, medium.altitude_km, np.array([low_km, high_km]))
    )[0, 0]
    return replace(medium, absorption_per_km=medium.absorption_per_km + inside * depth**2 / exact / (high_km - low_km))


@pytest.mark.parametrize("sun_deg", [90.0, 30.0, 0.0, -3.0])
def test_the_straight_sunbeam_has_the_lengths_of_a_chord(medium, sun_deg):
    straight = replace(medium, refractivity=0.0 * medium.refractivity)
    beam, profile = prepare_beam(straight, refraction=False), ray_profile(straight, refraction=False)
    z, cosine = 50.0, np.sin(np.radians(sun_deg))
    found = np.zeros(EDGES_KM.size - 1)
    add_sunbeam(BoxLayers(EDGES_KM, profile), beam, 0, z, cosine, 1.0, found)
    s = np.linspace(0.0, 3000.0, 3_000_001)
    r = straight.earth_radius_km + z
    altitude = np.sqrt(r * r + s * s + 2.0 * r * s * cosine) - straight.earth_radius_km
    expected = np.histogram(altitude, EDGES_KM)[0] * (s[1] - s[0])
    np.testing.assert_allclose(found, expected, atol=0.01)


@pytest.mark.slow
def test_single_scattering_is_differentiated_as_finite_differences_do(medium):
    # without multiple scattering the radiance is deterministic
    settings = montecarlo.MonteCarloSettings(target_stderr=None, samples=2, max_orders=1, importance_sweeps=0)
    low, high, step = 20.0, 22.0, 6e-4
    layer = np.array([low, high])
    base = with_doubled_levels(medium, layer)
    walk = montecarlo.CAPABILITIES.differentiate(montecarlo.prepare(base, settings), "absorption", layer)
    more = [montecarlo.prepare(absorbing(base, low, high, k * step), settings) for k in (1, 2, 3)]
    for question in SUNS_AND_DIRECTIONS:
        slope, error = (a.item() for a in walk.log_slopes(*question))
        one, two, three = (np.log(field.radiance(*question).item()) for field in more)
        # at 0, from h, 2 h and 3 h: the sunbeam's tables hold the layer's edges where it absorbs more alone
        assert slope == pytest.approx((-5.0 * one + 8.0 * two - 3.0 * three) / (2.0 * step), rel=5e-3)
        assert error < 1e-9


@pytest.mark.slow
def test_random_paths_and_the_adjoint_agree(medium, differentiated):
    settings = montecarlo.MonteCarloSettings(target_stderr=None, samples=3000)
    walk = montecarlo.CAPABILITIES.differentiate(montecarlo.prepare(medium, settings), "absorption", EDGES_KM)
    for sun, elevation, azimuth in SUNS_AND_DIRECTIONS:
        slopes, error = (a[:, 0] for a in walk.log_slopes(sun, elevation, azimuth))
        adjoint = differentiated.log_slopes(sun, elevation, azimuth)[0][:, 0]
        assert np.all(np.abs(adjoint - slopes) < 4.0 * error + 0.01 * np.abs(slopes))
        assert np.all(error < 0.02 * np.abs(slopes))


@pytest.mark.slow
def test_standard_errors_of_random_paths_are_their_scatter(medium):
    field = montecarlo.prepare(medium, montecarlo.MonteCarloSettings(target_stderr=None, samples=64))
    found = []
    for seed in range(24):
        one = replace(field, settings=replace(field.settings, seed=seed))
        walk = montecarlo.CAPABILITIES.differentiate(one, "absorption", EDGES_KM)
        found.append([a[:, 0] for a in walk.log_slopes(0.0, 30.0, 60.0)])
    slopes, errors = np.array(found).swapaxes(0, 1)
    scatter, stated = slopes.std(axis=0, ddof=1), np.sqrt((errors**2).mean(axis=0))
    # of 24 the scatter itself is known to 15 %
    assert np.all((scatter < 1.6 * stated) & (scatter > 0.55 * stated))


def test_the_adjoint_is_the_difference_of_two_fields(medium, solved, differentiated):
    low, high = 18.0, 24.0
    settings = replace(zones.QUALITIES["draft"], tolerance=1e-6, max_orders=30)
    base = with_doubled_levels(medium, EDGES_KM)
    step = 0.004
    light = [
        zones.prepare(absorbing(base, low, high, k * step), settings, sun_elevations_deg=[-4.0]) for k in (1.0, -1.0)
    ]
    for sun, elevation, azimuth in SUNS_AND_DIRECTIONS[2:]:
        above, below = (f.radiance(sun, elevation, azimuth)[0] for f in light)
        slope = np.log(above / below) / (2.0 * step)
        # the two were solved with tables of the sunbeam of their own
        assert differentiated.log_slopes(sun, elevation, azimuth)[0][4, 0] == pytest.approx(slope, rel=0.01)


def test_a_high_layer_is_crossed_at_the_slant_of_the_sun(differentiated):
    # light reaches the zenith from some 5 km, straight through what is above
    sun, radius, scattered_km = 45.0, 6371.0, 5.0
    middle = 0.5 * (EDGES_KM[1:] + EDGES_KM[:-1])[-2:]
    slant = 1.0 / np.sqrt(1.0 - (np.cos(np.radians(sun)) * (radius + scattered_km) / (radius + middle)) ** 2)
    np.testing.assert_allclose(-differentiated.log_slopes(sun, 90.0, 0.0)[0][-2:, 0], slant, rtol=0.005)


def test_the_operator_backwards_is_its_transpose(differentiated):
    # y . K' x = K'^T y . x, K' x by differences in float32
    air = differentiated.perturbed_air(0)
    rng = np.random.default_rng(3)
    for adjoint, light in zip(air.adjoints, (air.first, air.rest), strict=True):
        operator, z = adjoint.operator, adjoint.after

        def noise(like, size):
            return NodeLight(
                (size * rng.normal(size=like.moments.shape) * like.moments[:, :, :1]).astype(np.float32),
                (size * rng.normal(size=like.ground.shape) * like.ground).astype(np.float32),
            )

        # of suns around the horizon, each node by what it holds
        zenith_deg = np.degrees(air.grids.nodes.zenith.nodes_rad)[:, None]
        some = (zenith_deg > 80.0) & (zenith_deg < 97.0)
        wanted = noise(z, 1.0)
        mean, ground = (np.where(some, x, np.inf) for x in (z.moments[:, :, 0], z.ground))
        wanted = NodeLight(
            (wanted.moments / mean[:, :, None] ** 2).astype(np.float32), (wanted.ground / ground**2).astype(np.float32)
        )
        change = noise(light, 0.02)
        slope = (next_light(operator, light + change) - next_light(operator, light - change)).times(np.full(8, 0.5))
        forwards = sum(part[..., 0].sum() for part in wanted.contributions(slope))
        backwards = sum(part[..., 0].sum() for part in adjoint(wanted, np.full(8, 1e-6)).contributions(change))
        assert forwards == pytest.approx(backwards, rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "quantity, edges",
    [
        ("absorption", [0.0, 6.0, 18.0, 30.0]), ("aerosol_extinction", [0.0, 2.0]), ("aerosol_albedo", [0.0, 2.0]),
        ("aerosol_asymmetry", [0.0, 2.0]), ("ground_albedo", [0.0, 2.0]),
    ],
)  # fmt: skip
def test_the_adjoint_is_the_difference_of_solutions(medium, quantity, edges, monkeypatch):
    questions = SUNS_AND_DIRECTIONS[1:]
    suns, elevations, azimuths = np.array(questions).T
    solved = zones.prepare(medium, zones.QUALITIES["draft"], sun_elevations_deg=[0.0, -4.0])
    found = differentiate(solved, quantity, np.array(edges)).log_slopes(suns, elevations, azimuths)[0][..., 0]
    steps = {"DEPTH_STEP": 1e-3, "ALBEDO_STEP": 0.02, "ASYMMETRY_STEP": 0.01}
    light, step = [], None
    for times in (1.0, 2.0):
        for name, value in steps.items():
            monkeypatch.setattr(layer_changes, name, times * value)
        changes = layer_changes.changes_of(medium, quantity, np.array(edges))
        step = changes.step[:, 0]
        grids = perturbed_grids(solved.grids, *changes.columns(0))
        beam = grids.sunbeam()
        exact = replace(grids, directions=replace(grids.directions, tolerance=1e-6, max_orders=30))
        columns = Field(grids, beam, *solve(exact, beam, silent))
        light.append(np.log([columns.radiance(*question) for question in questions]))
    one, two = (x[:, 1:] - x[:, :1] for x in light)
    np.testing.assert_allclose(found, (4.0 * one - two) / step, rtol=4e-3, atol=2e-3 * np.abs(found).max())


@pytest.mark.slow
def test_ozone_changes_light_as_two_airs_differ(monkeypatch):
    suns = [0.0, -4.0]
    field = twilight.solve("pure-air", wavelength_nm=[330.0], quality="draft", sun_elevation_deg=suns)
    found = field.jacobian(suns, 90.0, 0.0, by="ozone_column")["ozone_column"]
    settings = replace(zones.QUALITIES["draft"], tolerance=1e-4)
    light = []
    for way in (30.0, -30.0):
        monkeypatch.setattr(shifted_air, "DOBSON", way)
        air = shifted_air.shifted(field.scene, "ozone_column", field.medium.wavelength_nm)
        made = zones.prepare(air.medium, settings, sun_elevations_deg=suns)
        light.append(np.array([made.radiance(sun, 90.0, 0.0).item() for sun in suns]))
    np.testing.assert_allclose(found.values[:, 0], np.log(light[0] / light[1]) / 60.0, rtol=0.03)


def test_columns_of_a_gas_add_up():
    gas = GasProfile("gas", np.array([0.0, 10.0, 20.0, 60.0]), np.array([2e9, 1e9, 1e9, 0.0]))
    whole = gas.columns_per_cm2(np.array([0.0, 60.0])).sum()
    assert whole == pytest.approx((1e9 / np.log(2.0) + 1e9 + 2e9) * 1e6)
    assert gas.columns_per_cm2(np.array([0.0, 3.0, 15.0, 16.0, 60.0])).sum() == pytest.approx(whole)
    ozone = of_atmosphere("o3", "us_standard")
    assert ozone.columns_per_cm2(np.array([0.0, 120.0])).sum() / 2.68678e16 == pytest.approx(345.0, rel=0.02)


def test_levels_of_a_layer(medium):
    doubled = with_doubled_levels(medium, np.array([2.0, 10.0]))
    assert np.count_nonzero(doubled.altitude_km == 10.0) == 2 and np.count_nonzero(doubled.altitude_km == 2.0) == 2
    inside = of_layer(doubled.altitude_km, 2.0, 10.0)
    assert not (inside & of_layer(doubled.altitude_km, 10.0, 100.0)).any()
    np.testing.assert_allclose(doubled.optical_depth(), medium.optical_depth(), rtol=1e-4)


@pytest.mark.parametrize(
    "edges, why",
    [([0.0], "two or more"), ([0.0, 5.0, 4.0], "must grow"), ([0.0, 500.0], "within the air, from 0 to 100 km")],
)
def test_layers_that_are_none_are_refused(medium, edges, why):
    with pytest.raises(TwilightError, match=why):
        layer_edges(medium, edges)


def test_what_cannot_be_differentiated_is_refused(medium):
    field = montecarlo.prepare(medium, montecarlo.MonteCarloSettings(approximation="isotropic_after_first"))
    with pytest.raises(TwilightError, match="montecarlo cannot differentiate by ground_albedo; it can by absorption"):
        montecarlo.CAPABILITIES.differentiate(field, "ground_albedo", EDGES_KM)
    with pytest.raises(TwilightError, match="cannot differentiate its approximation isotropic_after_first"):
        montecarlo.CAPABILITIES.differentiate(field, "absorption", EDGES_KM).log_slopes(0.0, 90.0, 0.0)
    with pytest.raises(TwilightError, match="cie cannot differentiate its light; zones and montecarlo can"):
        twilight.solve("pure-air", solver="cie", wavelength_nm=[450.0]).airmass(30.0, 90.0, 0.0)


@pytest.mark.parametrize(
    "table, why",
    [
        ("altitude_km,ppb\n0,1\n", "density_per_cm3 is missing; needed are altitude_km, density_per_cm3"),
        ("altitude_km,density_per_cm3\n5,1\n3,1\n", "that increase"),
        ("altitude_km,density_per_cm3\n0,1\n3,-1\n", "line 3: density_per_cm3 is `-1`"),
    ],
)
def test_profiles_that_are_none_are_refused(tmp_path, table, why):
    path = tmp_path / "gas.csv"
    path.write_text(table)
    with pytest.raises(TwilightError, match=why):
        read_profile(path, "bro")


def of_one_air(factor, error):
    """A dataset as of `factors.box_factors`, of one sun, two layers and one wavelength."""
    xarray = pytest.importorskip("xarray")
    dims = ("sun_elevation", "altitude", "wavelength")
    return xarray.Dataset(
        {
            "box_air_mass_factor": (dims, np.full((1, 2, 1), factor), {"units": "1"}),
            "standard_error": (dims, np.full((1, 2, 1), error)),
            "altitude_bnds": (("altitude", "nv"), [[0.0, 10.0], [10.0, 60.0]]),
        },
        {"sun_elevation": [0.0], "altitude": [5.0, 35.0], "wavelength": [470.0]},
    )


def test_parts_of_random_paths_are_independent_and_their_mean_has_the_error_of_the_whole():
    config = load("pure-air", {"solver.name": "montecarlo", "solver.target_stderr": 0.02})
    parts = table.parts_of(config, 4)
    assert len({part["solver"]["seed"] for part in parts}) == 4
    settings = [Config.model_validate(part).chosen_solver[2] for part in parts]
    assert all(one.target_stderr == pytest.approx(0.04) for one in settings)
    assert {one.max_samples for one in settings} == {-(-config.chosen_solver[2].max_samples // 4)}
    rng = np.random.default_rng(5)
    found = table.merged([of_one_air(x, 0.1) for x in rng.normal(7.0, 0.1, 400)])
    assert float(found["standard_error"][0, 0, 0]) == pytest.approx(0.1 / 20.0)
    assert abs(float(found["box_air_mass_factor"][0, 0, 0]) - 7.0) < 4.0 * 0.1 / 20.0


def test_a_table_has_a_dimension_for_each_key(monkeypatch, tmp_path):
    def made(config, question, progress=None):
        climate = config["climate"]
        return of_one_air(climate["ground"]["albedo"] + climate["gases"]["ozone"]["column_du"], 0.0)

    monkeypatch.setattr(table, "compute", made)
    series = load_axes(
        "pure-air", {"vary": {"ground.albedo": [0.0, 0.8], "gases.ozone.column_du": [250.0, 300.0, 400.0]}}
    )
    found = table.box_table(series, table.Question((0.0,), 90.0, 0.0, None), lambda *_: None)
    assert found["box_air_mass_factor"].dims[:2] == ("ground_albedo", "gases_ozone_column_du")
    chosen = found.sel(ground_albedo=0.8, gases_ozone_column_du=300.0)
    np.testing.assert_allclose(chosen["box_air_mass_factor"], 300.8)
    assert found["altitude_bnds"].dims == ("altitude", "nv")
    whole = with_gas(found, GasProfile("gas", np.array([0.0, 60.0]), np.array([1e9, 1e9])))
    columns, lines = report.rows(whole)
    assert columns[:2] == ["ground_albedo", "gases_ozone_column_du"] and len(lines) == 6
    assert lines[4][:2] == ["0.8", "300"] and float(lines[4][4]) == pytest.approx(300.8, rel=1e-3)
    report.write_tables(whole, tmp_path)
    report.draw(whole, tmp_path / "airmass.png", "six airs")
    assert len((tmp_path / "boxes.csv").read_text().split()) == 13


def test_the_command_writes_tables_and_a_picture(tmp_path):
    xarray = pytest.importorskip("xarray")
    (tmp_path / "bro.csv").write_text("altitude_km,density_per_cm3\n10,0\n18,2e7\n25,1e7\n40,0\n")
    words = ["airmass", "pure-air", "--gas", "bro", "--profile", "bro.csv", "--sun", "80:90:10", "--wavelength", "360"]
    words += ["--layers", "0,10,18,25,40", "--solver", "montecarlo", "--set", "solver.target_stderr=0.2"]
    done = subprocess.run(
        [sys.executable, "-m", "twilight", *words, "--output", "made"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    found = xarray.open_dataset(tmp_path / "made" / "airmass.nc", engine="h5netcdf")
    assert found["box_air_mass_factor"].dims == ("sun_elevation", "altitude", "wavelength")
    column = float(found["layer_column"].sum())
    total = (found["box_air_mass_factor"] * found["layer_column"]).sum("altitude") / column
    np.testing.assert_allclose(found["air_mass_factor"], total)
    assert 4.0 < float(total[0, 0]) < 6.5 < 12.0 < float(total[1, 0]) < 22.0
    assert "standard_error" in found and (tmp_path / "made" / "airmass.png").stat().st_size > 10_000
    refused = subprocess.run(
        [sys.executable, "-m", "twilight", "airmass", "pure-air", "--gas", "bro"], cwd=tmp_path, capture_output=True,
        text=True,
    )  # fmt: skip
    assert refused.returncode == 2 and "bro is in no model atmosphere" in refused.stderr


@pytest.mark.slow
def test_parts_of_other_processes_are_merged_with_their_errors():
    """Parts with one seed would agree too well, errors that are not merged would be too large."""
    from distributed import Client, LocalCluster

    settings = {"solver.name": "montecarlo", "solver.target_stderr": 0.02, "wavelengths": {"list_nm": [450.0]}}
    series = load_axes("pure-air", settings)
    question = table.Question((-2.0,), 90.0, 0.0, (0.0, 12.0, 24.0, 40.0))
    alone = table.box_table(load_axes("pure-air", {**settings, "solver.seed": 50}), question, silent)
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        found = table.box_table(series, question, silent, client, 2)
    factor, error = (found[name].values.ravel() for name in ("box_air_mass_factor", "standard_error"))
    other, other_error = (alone[name].values.ravel() for name in ("box_air_mass_factor", "standard_error"))
    assert np.all(np.abs(factor - other) < 4.0 * np.hypot(error, other_error)) and np.all(factor != other)
    assert np.all(error < 1.6 * other_error) and np.all(error > 0.4 * other_error)
