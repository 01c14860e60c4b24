"""Fits of Perez's sky: what is put in comes out, and the command writes what the solver takes."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from airs import as_sky
from typer.testing import CliRunner

from twilight.base.errors import TwilightError
from twilight.cli import fit as command
from twilight.cli.app import app
from twilight.config import load
from twilight.io.netcdf import write_sky
from twilight.solvers.analytic import preetham
from twilight.solvers.analytic.coefficients import QUANTITIES, load_coefficients
from twilight.solvers.analytic.daylight import turbidity_of
from twilight.studies.fit.perez import fit_set, fit_sky, single_set
from twilight.studies.fit.truth import ColourSky, air_of_turbidity, colour_sky, compute_truth, error_of, spiral


def paper_sky(turbidity: float, sun: float, directions: int = 150) -> ColourSky:
    elevation, azimuth = spiral(directions)
    values = load_coefficients("preetham1999").sky(turbidity, sun, elevation, azimuth)
    weight = np.full(directions, 1.0 / directions)
    return ColourSky(sun, turbidity, elevation, azimuth, weight, *values)


def test_directions_divide_the_sky_evenly():
    """A fit would weigh parts of the sky by chance."""
    elevation, azimuth = spiral(343)
    assert elevation.size == 343 and (elevation > 0).all() and ((azimuth >= 0) & (azimuth <= 180)).all()
    sine = np.sin(np.radians(elevation))
    assert sine.mean() == pytest.approx(0.5, abs=1e-3) and (sine**2).mean() == pytest.approx(1 / 3, abs=1e-3)
    east = np.cos(np.radians(elevation)) * np.cos(np.radians(azimuth))
    assert east.mean() == pytest.approx(0.0, abs=0.005) and (east**2).mean() == pytest.approx(1 / 3, abs=0.005)


@pytest.mark.parametrize("sun", [60.0, 25.0, 5.0])
def test_five_parameters_of_one_sky_come_back(sun):
    """A fit to a Perez sky would not find its parameters."""
    own = load_coefficients("preetham1999")
    for fit in fit_sky(paper_sky(3.0, sun)):
        assert fit.p95_error < 1e-3
        assert fit.median_error <= fit.p95_error
        if fit.quantity == "luminance":
            np.testing.assert_allclose(fit.parameters, own.parameters("luminance", 3.0), rtol=0.02, atol=0.01)
            assert fit.zenith == pytest.approx(own.zenith_luminance_cd_per_m2(90.0 - sun, 3.0), rel=1e-3)


def test_a_fit_to_one_sky_serves_the_solver():
    """The solver would not give the sky that a set was fitted to."""
    sky = paper_sky(3.0, 25.0)
    made = single_set(sky, fit_sky(sky), "one", "test")
    made.check("one")
    error = error_of(made, [sky])
    assert error.luminance_p95 < 2e-3 and abs(error.luminance_bias) < 1e-3 and error.chromaticity_p95 < 1e-3


def test_the_papers_procedure_gives_the_papers_skies_back():
    """The procedure of the paper, on the paper's skies, would give other coefficients."""
    skies = [paper_sky(t, s) for t in (2.0, 4.0, 6.0) for s in (10.0, 25.0, 40.0, 55.0, 70.0)]
    made = fit_set(skies, "again", "test")
    error = error_of(made, skies)
    assert error.luminance_p95 < 0.03 and error.distribution_p95 < 0.01 and error.chromaticity_p95 < 2e-3
    own = load_coefficients("preetham1999")
    for t in (2.0, 4.0, 6.0):
        found, exact = (one.parameters("luminance", t) for one in (made, own))
        np.testing.assert_allclose(found, exact, rtol=0.02, atol=0.02)
    # and the paper's own set is exact on them, which is what errors are measured from
    assert error_of(own, skies).luminance_p95 < 1e-12
    doubled = [ColourSky(**{**vars(s), "luminance": s.luminance / 2}) for s in skies]
    worse = error_of(own, doubled)
    assert worse.luminance_bias == pytest.approx(np.log(2)) and worse.luminance_median == pytest.approx(1.0)
    assert worse.distribution_p95 < 1e-12


def test_too_few_skies_are_refused():
    """A fit would be made of fewer skies than it has unknowns."""
    with pytest.raises(TwilightError, match="at least 3 turbidities and 4 suns; got 2 and 1"):
        fit_set([paper_sky(2.0, 30.0), paper_sky(3.0, 30.0)], "few", "test")
    with pytest.raises(TwilightError, match=r"sun.elevation_deg is -3"):
        fit_sky(ColourSky(**{**vars(paper_sky(3.0, 5.0)), "sun_elevation_deg": -3.0}))


def test_colour_of_a_sky_leaves_the_aureole_out():
    """The glare about the sun would decide a fit."""
    elevation, azimuth = np.array([30.0, 31.0, 60.0]), np.array([0.0, 1.0, 90.0])
    wavelength = np.array([450.0, 550.0, 650.0])
    sky = colour_sky(np.ones((3, 3)), wavelength, elevation, azimuth, np.ones(3) / 3, 30.0)
    assert sky.elevation_deg.tolist() == [60.0] and sky.weight.tolist() == [1.0]
    # sunlight itself: the chromaticity and luminous efficacy of the solar spectrum
    assert (sky.x[0], sky.y[0]) == pytest.approx((0.323, 0.333), abs=0.006)
    assert sky.luminance[0] == pytest.approx(133_000.0, rel=0.03)
    with pytest.raises(TwilightError, match="480 to 600 nm"):
        colour_sky(np.ones((3, 1)), wavelength[:1], elevation, azimuth, np.ones(3) / 3, 30.0)


@pytest.mark.parametrize("haze", ["climate", "preetham1999"])
def test_air_of_a_turbidity_has_it(haze):
    """Air made for a turbidity would have another."""
    config = load("continental-average", {"wavelengths": {"list_nm": [450.0, 550.0, 650.0]}})
    for turbidity in (2.0, 5.0):
        medium = air_of_turbidity(config, turbidity, haze)
        # the column of exponential levels is not quite that of an exponential
        assert turbidity_of(medium) == pytest.approx(turbidity, rel=0.01)


@pytest.mark.slow
def test_a_refit_is_nearer_to_computed_skies_than_the_paper():
    """On the paper's own haze: what is left is the form, and skies between the fitted ones are no worse."""
    settings = {"solver.name": "zones", "solver.quality": "draft", "wavelengths.list_nm": [420.0, 500.0, 580.0, 660.0]}
    config = load("pure-air", settings)
    zenith = [0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 80.0]
    truth = compute_truth(config, [2.0, 4.0, 6.0], zenith, 120, "preetham1999")
    held_out = compute_truth(config, [3.0, 5.0], [20.0, 50.0, 75.0], 120, "preetham1999")
    assert truth.cpu_s > 0 and len(truth.skies) == 21
    made = fit_set(truth.skies, "again", "test")
    for skies in (truth.skies, held_out.skies):
        own, again = error_of(load_coefficients("preetham1999"), skies), error_of(made, skies)
        assert again.luminance_median < 0.1 < 0.3 < own.luminance_median
        assert again.distribution_median < 0.06 < own.distribution_median
        assert again.chromaticity_median < 0.004 < own.chromaticity_median


@pytest.fixture
def small(monkeypatch, tmp_path):
    """Fewer skies; the sky that is fitted is the paper's own, so that its coefficients must come out as exact."""
    monkeypatch.setattr(command, "TURBIDITIES", (2.2, 4.0, 5.8))
    monkeypatch.setattr(command, "HELD_OUT_TURBIDITIES", (3.0,))
    monkeypatch.setattr(command, "SUNS", 5)
    monkeypatch.setattr(command, "DIRECTIONS", 90)
    return SimpleNamespace(
        path=tmp_path / "set.yaml", run=lambda *words: CliRunner().invoke(app, ["fit", "perez", *words])
    )


def test_the_command_writes_a_set_that_the_solver_takes(small):
    """`twilight fit perez` would write a file that the solver refuses."""
    scene = ["pure-air", "--haze", "preetham1999", "--solver", "preetham", "--set", "wavelengths.count=16"]
    result = small.run(*scene, "--output", str(small.path))
    assert result.exit_code == 0, result.output
    data = yaml.safe_load(small.path.read_text(encoding="utf-8"))
    assert data["fit"]["solver"] == "preetham" and data["fit"]["directions"] == 90
    # what is left is the sampling in wavelength
    assert data["fit"]["errors"]["preetham1999, fitted skies"]["luminance_p95"] < 0.03
    assert data["fit"]["errors"]["this fit, held-out skies"]["luminance_p95"] < 0.2
    assert "CPU hours (Preetham 1999: 600)" in result.output and f"wrote {small.path}" in result.output
    made = load_coefficients(str(small.path))
    assert set(made.distribution) == set(QUANTITIES)
    config = load("pure-air", {"solver": {"name": "preetham", "coefficients": str(small.path), "turbidity": 3.0}})
    assert config.solver["coefficients"] == str(small.path)


@pytest.mark.slow
def test_the_command_fits_one_sky_and_reads_one(small, tmp_path):
    """A fit to one rendered sky would not be readable."""
    scene = ["pure-air", "--set", "solver.turbidity=3.0", "--solver", "preetham", "--sun-elevation", "30"]
    coarse = ["--set", "texture.resolution_deg=7.5", "--set", "wavelengths.count=5", "--set", "refraction.model=none"]
    result = small.run(*scene, *coarse, "--per-sky", "--output", str(small.path))
    assert result.exit_code == 0, result.output
    assert [line.split("\t")[1] for line in result.output.splitlines() if "\t" in line] == ["quantity", *QUANTITIES]
    made = load_coefficients(str(small.path))
    own = load_coefficients("preetham1999")
    np.testing.assert_allclose(made.parameters("luminance", 9.0), own.parameters("luminance", 3.0), rtol=0.1, atol=0.05)
    with pytest.warns(UserWarning):
        medium = preetham.prepare(air_of_turbidity(load("pure-air"), 1.0, "preetham1999")).medium
    field = preetham.prepare(medium, preetham.PreethamSettings(coefficients=str(small.path)))
    assert (field.radiance(30.0, 45.0, 90.0) > 0).all()
    write_sky(as_sky(field, 30.0, 5.0), tmp_path / "sky.h5")
    again = small.run(str(tmp_path / "sky.h5"), "--per-sky", "--output", str(tmp_path / "b.yaml"))
    assert again.exit_code == 0, again.output
    reread = load_coefficients(str(tmp_path / "b.yaml")).parameters("x", 1.0)
    np.testing.assert_allclose(reread, made.parameters("x", 1.0), rtol=0.1, atol=0.02)


def test_each_sky_of_a_scene_and_of_a_data_set(small, monkeypatch, tmp_path):
    """Suns below the horizon are left out with a word, before anything is computed; a sweep's Zarr is read."""
    import yaml
    from typer.testing import CliRunner

    from twilight.cli.app import app

    monkeypatch.chdir(tmp_path)
    scene = {
        "version": 1, "name": "two", "climate": "pure-air", "sun": {"elevations_deg": [40, -2, 20]},
        "solver": {"name": "cie", "sky_type": 12}, "texture": {"resolution_deg": 10.0}, "wavelengths": {"count": 4},
    }  # fmt: skip
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(scene))
    result = CliRunner().invoke(app, ["fit", "perez", "two.yaml", "--per-sky"])
    assert result.exit_code == 0, result.output
    assert "1 of 3 suns are left out, at -2 deg" in result.stderr
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["perez_two.csv"]
    swept = CliRunner().invoke(
        app, ["sweep", "two.yaml", "--set", "sun.elevations_deg=[40, 20]", "--workers", "1", "--output", "two.zarr"]
    )
    assert swept.exit_code == 0, swept.output
    again = CliRunner().invoke(app, ["fit", "perez", "two.zarr", "--per-sky", "--output", "set.yaml"])
    assert again.exit_code == 0, again.output
    tables = []
    for file in ("out/perez_two.csv", "set.csv"):
        rows = list(csv.DictReader((tmp_path / file).read_text().splitlines()[1:]))
        assert [row["quantity"] for row in rows] == ["luminance", "x", "y"] * 2
        tables.append([[float(row[name]) for name in "ABCDE"] for row in rows])
    np.testing.assert_allclose(*tables, rtol=0.02, atol=0.01)
