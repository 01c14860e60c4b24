"""Stiff air is solved as the air that it is: fewer nodes and steps, the same light."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hazy_zones import QUICK
from stability_media import Air, medium_of

from twilight.base.errors import TwilightWarning
from twilight.config.load import load_climate
from twilight.scene.medium import climate_medium
from twilight.solvers import zones
from twilight.solvers.zones import constants as tuned
from twilight.solvers.zones.air_needs import _graded, _volcanic_fraction
from twilight.solvers.zones.small_jumps import without_small_jumps
from twilight.solvers.zones.solver import PEAKED_ERRORS

WAVELENGTH_NM = np.array([450.0, 650.0])
ELEVATION_DEG = np.array([1.0, 6.0, 27.0, 90.0, 45.0, 10.0])
AZIMUTH_DEG = np.array([0.0, 0.0, 0.0, 0.0, 90.0, 180.0])
COARSE = replace(QUICK, altitude_density=0.4, zenith_density=0.4, polar_directions=6)


def in_layers(n: int):
    climate = load_climate("continental-average")
    layers = climate.atmosphere.layers.model_copy(update={"equal_air_mass": n})
    atmosphere = climate.atmosphere.model_copy(update={"layers": layers})
    return climate_medium(climate.model_copy(update={"atmosphere": atmosphere}), WAVELENGTH_NM)


def test_five_hundred_layers_are_the_air_that_they_are_cut_from():
    """A thousand levels with jumps took a thousand nodes, and no answer came; columns of the layers are kept."""
    medium = in_layers(500)
    smooth = without_small_jumps(medium)
    assert smooth.altitude_km.size < 0.55 * medium.altitude_km.size
    for part in ("air", "aerosol", "absorption"):
        np.testing.assert_allclose(smooth.optical_depth(part), medium.optical_depth(part), rtol=1e-4)
    assert without_small_jumps(smooth) is smooth
    coarse = in_layers(10)
    assert without_small_jumps(coarse) is coarse  # jumps of 10 % and more are seen


def test_small_jumps_taken_as_bends_move_no_sky(monkeypatch):
    """Layers would be merged that the sky shows: forty, of which the lower half differ by up to 5 %."""
    medium, skies, nodes = in_layers(40).select(slice(0, 1)), [], []
    for small in (tuned.SMALL_JUMP, 0.0):
        monkeypatch.setattr(tuned, "SMALL_JUMP", small)
        field = zones.prepare(medium, COARSE, sun_elevations_deg=[-3.0])
        nodes.append(field.grids.nodes.altitude_km.size)
        skies.append(field.radiance(-3.0, ELEVATION_DEG, AZIMUTH_DEG))
    assert nodes[0] < 0.8 * nodes[1]
    np.testing.assert_allclose(*skies, rtol=0.01)
    print([*nodes, np.abs(skies[0] / skies[1] - 1).max()])


def test_intervals_beside_a_layer_are_cut_without_cutting_all_others():
    """A layer near the ground would have every interval up to the top of the air cut in halves."""
    plain = np.cumsum(np.concatenate([[0.0], 0.1 * 1.35 ** np.arange(18)]))
    fine = np.sort(np.append(plain, np.linspace(plain[4], plain[5], 7)[1:-1]))
    graded = _graded(fine)
    step = np.diff(graded)
    assert np.abs(np.diff(np.log(step))).max() <= np.log(tuned.MAX_INTERVAL_RATIO) * 1.0001
    assert np.isin(fine, graded).all()
    np.testing.assert_array_equal(graded[-8:], plain[-8:])


def test_haze_that_reaches_up_is_no_volcano():
    """Dense haze whose tail lies above 10 km took the directions and nodes of a volcano's layer."""
    z = np.linspace(0.0, 60.0, 601)
    haze = 20.0 / 1.5 * np.exp(-z / 1.5)
    layer = 0.01 * np.exp(-(((z - 20.0) / 3.0) ** 2))
    of = [_volcanic_fraction(z, column[:, None]) for column in (haze, layer, haze + layer)]
    assert of[0] == 0.0 and of[1] == of[2] == 1.0


@pytest.mark.parametrize("air", [Air(aerosol=2.0), Air(aerosol=1.0, ground=1.0)], ids=["haze", "haze over snow"])
def test_slow_orders_solved_at_once_are_those_followed_one_by_one(air, monkeypatch):
    """Accelerated orders would be other light, or not fewer.  Logarithms of a sum of orders between coarse nodes are
    not those of each order: 0.2 % in the haze, 0.1 % over snow."""
    monkeypatch.setattr(tuned, "CONSERVED_DECAY", 2.0)
    fast = zones.prepare(medium_of(air), replace(COARSE, tolerance=1e-3), sun_elevations_deg=[15.0])
    monkeypatch.setattr(tuned, "FEW_ORDERS", 1000)
    slow = zones.prepare(medium_of(air), replace(COARSE, tolerance=2e-5), sun_elevations_deg=[15.0])
    assert fast.convergence.orders < 0.7 * slow.convergence.orders
    skies = [field.radiance(15.0, ELEVATION_DEG, AZIMUTH_DEG) for field in (fast, slow)]
    np.testing.assert_allclose(*skies, rtol=3e-3)


@pytest.mark.parametrize(
    ("quality", "said"), [("draft", "draft is up to 21 %"), ("standard", "standard is up to 17 %")]
)
def test_the_warning_of_a_sharp_peak_is_that_of_the_quality(quality, said):
    """`draft` promised what `standard` keeps."""
    few = replace(COARSE, max_orders=2, tolerance=0.0, max_degree=zones.QUALITIES[quality].max_degree)
    with pytest.warns(TwilightWarning, match=said):
        zones.prepare(medium_of(Air(aerosol=1.0, asymmetry=0.98)), few, sun_elevations_deg=[15.0])


def test_the_warning_of_a_sharp_peak_says_what_was_measured():
    """Its figures would come from nowhere."""
    path = Path(__file__).resolve().parents[2] / "benchmarks" / "results" / "sharp_peaks.csv"
    with open(path, encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    for quality, said in PEAKED_ERRORS.items():
        at_horizon, above = (
            max(abs(float(row[f"{quality}_percent"])) for row in rows if (float(row["elevation_deg"]) < 1.0) == low)
            for low in (True, False)
        )
        assert said == (round(at_horizon), round(above))


def test_light_beside_a_sharp_peak_does_not_depend_on_the_nodes_of_the_sun():
    """15 deg above and below a sun at 40 deg `standard` was 8 to 10 % too bright: nodes of its zenith angle too far
    apart for the degree."""
    air, standard = (
        medium_of(Air(aerosol=0.5, asymmetry=0.95)),
        replace(zones.QUALITIES["standard"], polarisation=False),
    )
    skies = []
    for settings in (standard, replace(standard, zenith_density=3.0)):
        with pytest.warns(TwilightWarning, match="asymmetry"):
            field = zones.prepare(air, settings, sun_elevations_deg=[40.0])
        skies.append(field.radiance(40.0, [55.0, 40.0, 25.0], [0.0, 19.6, 0.0]))
    np.testing.assert_allclose(*skies, rtol=0.02)
