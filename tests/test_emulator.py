"""Emulated skies: splines of a few directions against the skies themselves, and the error that they state."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from twilight.config import load
from twilight.engine import run
from twilight.numerics.grids import texture_grid
from twilight.scene import resolve
from twilight.sky import colour
from twilight.studies.validate.photographs import emulator
from twilight.studies.validate.photographs.library import HELD_OUT, OTHERS, Design, _error, make_library
from twilight.studies.validate.photographs.mask import separation_deg
from twilight.studies.validate.photographs.photo import OBSERVER

DAY = {"sun.elevation_deg": 20.0, "solver.name": "preetham", "texture.resolution_deg": 6}
"""The formula of daylight: a sky in milliseconds."""


def test_a_window_reaches_beyond_the_suns_that_it_serves():
    config = load("continental-average", {"solver.name": "zones"})
    for suns in ([3.0], [-6.0, -2.0], [-18.0], [90.0], [7.0], [-6.5], [-8.0, 12.0]):
        nodes = emulator.sun_nodes(config, suns)
        low, high = min(suns), max(suns)
        assert nodes[0] <= low and high <= nodes[-1] and list(nodes) == sorted(set(nodes))
        assert sum(node < low for node in nodes) >= 1 or low == -18.0
        assert sum(node > high for node in nodes) >= 1 or high == 90.0
    near = [emulator.sun_nodes(config, [sun]) for sun in (1.5, 3.0, 6.9)]
    assert near[0] == near[1] == near[2]  # the next photograph under another sun of the window computes nothing
    assert len(emulator.sun_nodes(config, [3.0])) < 8
    # a solver of the day alone is looked at for just the suns that are asked for
    assert emulator.sun_nodes(load("continental-average", DAY), [3.0, 9.0]) == (3.0, 9.0)


def test_between_suns_a_cubic_is_met():
    suns, rng = emulator.WINDOWS[2][1], np.random.default_rng(3)
    powers = rng.normal(size=(4, 5, 3))

    def at(sun):
        return sum(p * (sun / 5.0) ** k for k, p in enumerate(powers))

    found = emulator.at_sun(suns, np.array([at(sun) for sun in suns]), -4.3)
    assert found == pytest.approx(at(-4.3), abs=1e-12)


def test_a_photograph_takes_eight_wavelengths_and_draft():
    many = emulator.quick(load("continental-average", {"solver.quality": "standard", "wavelengths": {"count": 40}}))
    assert many.solver["quality"] == "draft" and many.wavelengths is None
    few = emulator.quick(load("continental-average", {**DAY, "wavelengths": {"list_nm": [450.0, 550.0, 650.0]}}))
    assert few.wavelengths.wavelength_nm == (450.0, 550.0, 650.0) and "quality" not in few.solver


def test_an_emulated_sky_is_the_sky():
    config = load("continental-average", DAY)
    nodes = emulator.sun_nodes(config, [20.0])
    rows, columns = texture_grid(6.0)
    made = emulator.coefficients(config, nodes)
    found = np.exp(emulator.evaluate(emulator.at_sun(nodes, made, 20.0), 20.0, rows, columns))
    right = colour.sky_to_xyz(run(resolve(config)), observer=OBSERVER)
    away = separation_deg(rows[:, None], columns[None, :], 20.0, 0.0) > 10.0
    assert np.abs(found / right - 1.0)[away].max() < 0.02
    assert np.abs(found / right - 1.0)[away].mean() < 0.004
    assert np.abs(colour.uv_of_xyz(found) - colour.uv_of_xyz(right))[away].max() < 0.001


def test_the_stated_error_is_that_of_held_out_skies():
    """Of a library that is right and of the same with its skies bent: the error says by how much."""
    config, design = load("continental-average", DAY), Design(tuple(p for p in OTHERS if p.name == "ozone"))
    library = make_library(config, design, "continental_average", [20.0], 6.0)
    assert 0.0 < library.luminance_error < 0.05 and 0.0 < library.chromaticity_error < 0.006
    nodes = emulator.sun_nodes(config, [20.0])
    made = []
    for node in design.nodes:
        settings = {"aerosol.optical_depth_550nm": node["aerosol"], "gases.ozone.column_du": node["ozone"]}
        made.append(emulator.coefficients(load("continental-average", {**DAY, **settings}), nodes))

    def stated(coefficients):
        about = (config, design, "continental_average", nodes, coefficients)
        return np.mean([_error(*about, i, lambda *_: None) for i in range(HELD_OUT)], axis=0)

    luminance, chromaticity = stated(made)
    assert luminance == pytest.approx(library.luminance_error, rel=0.02)
    # 10 % more light at the horizon than in the zenith, alike in X, Y and Z: the splines go by rows of elevation
    columns = emulator.GRID.azimuth_intervals + 1
    bend = np.zeros(emulator.GRID.size)
    split = (emulator.GRID.elevation_intervals + 3) * columns
    bend[:split] = np.repeat(np.linspace(0.1, 0.0, split // columns), columns)
    bent = stated([one + bend[:, None] for one in made])
    assert bent[0] > np.hypot(luminance, 0.015) and bent[1] == pytest.approx(chromaticity, rel=1e-3)
    tinted = stated([one + np.array([0.01, 0.0, 0.0]) for one in made])
    assert tinted[0] == pytest.approx(luminance, rel=1e-6) and tinted[1] > chromaticity


def test_splines_over_the_sky_are_those_of_scipy():
    rng = np.random.default_rng(1)
    e, a = rng.uniform(0.0, 90.0, 50), rng.uniform(-180.0, 540.0, 50)
    index, value = emulator.GRID.splines(20.0, e, a)
    assert index.min() >= 0 and index.max() < emulator.GRID.size
    assert value.sum(axis=0) == pytest.approx(2.0)  # both sets sum to 1
    coefficients = rng.normal(size=emulator.GRID.size)
    got = np.sum(value * coefficients[index], axis=0)
    n_e, n_a, n_t = emulator.GRID.elevation_intervals, emulator.GRID.azimuth_intervals, emulator.GRID.angle_intervals
    table = coefficients[: (n_e + 3) * (n_a + 1)].reshape(n_e + 3, n_a + 1)
    mirrored = np.concatenate([table[:, 1:2], table, table[:, -2:-1]], axis=1)
    folded = np.abs(np.mod(a + 180.0, 360.0) - 180.0)
    by_row = BSpline(np.arange(-3, n_e + 4), mirrored, 3)(np.sqrt(e / 90.0) * n_e)
    expected = [
        float(BSpline(np.arange(-3, n_a + 4), row, 3)(x / 180.0 * n_a)) for row, x in zip(by_row, folded, strict=True)
    ]
    cosine = np.sin(np.radians(e)) * np.sin(np.radians(20.0))
    cosine += np.cos(np.radians(e)) * np.cos(np.radians(20.0)) * np.cos(np.radians(a))
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    ring = np.log1p(angle / 2.0) / np.log1p(90.0) * n_t
    expected += BSpline(np.arange(-3, n_t + 4), coefficients[-(n_t + 3) :], 3)(ring)
    assert got == pytest.approx(expected, abs=1e-9)
