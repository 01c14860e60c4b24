"""The named phenomena of twilight appear in computed skies, and go where their cause is taken away."""

import sys
from pathlib import Path

import numpy as np
import pytest

from twilight.config import load
from twilight.sky.colour import uv_of_xy

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import sky_phenomena as see

FEW = [400, 424, 490, 530, 560, 590, 605, 640, 670, 720]


def air(climate="pure-air", nm=FEW, **settings):
    more = {key.replace("__", "."): value for key, value in settings.items()}
    return see.Air(
        load(climate, {"wavelengths.list_nm": nm, "solver.quality": "draft", "solver.polarisation": False} | more)
    )


@pytest.fixture(scope="module")
def pure():
    return air()


def zenith(a, sun):
    x, y = see.chromaticity(a.xyz(sun, [90.0], [0.0]))
    return float(x[0]), float(y[0])


def test_chromaticities_of_known_light():
    """Colours of phenomena would be off D65 and the daylight locus."""
    x, y = see.chromaticity(np.array([[95.047, 100.0, 108.883]]))  # D65
    assert (float(x[0]), float(y[0])) == pytest.approx((0.3127, 0.3290), abs=1e-4)
    assert uv_of_xy(0.3127, 0.3290) == pytest.approx([0.1978, 0.4683], abs=1e-4)
    assert see.above_daylight(0.3127, 0.3290) == pytest.approx(0.0, abs=2e-3)
    assert see.above_daylight(0.33, 0.30) < -0.01 < 0.01 < see.above_daylight(0.30, 0.36)


def test_zenith_is_blue_at_minus_five_because_of_ozone(pure):
    """Hulburt 1953: without ozone the zenith of civil twilight would be grey to yellowish."""
    without = air(gases__ozone__treatment="none")
    x, y = zenith(pure, -5.0)
    assert x < 0.28 and y < 0.28
    x0, y0 = zenith(without, -5.0)
    assert x0 > 0.30 and y0 > 0.31
    assert see.red_over_blue(pure, -5.0, 90.0, 0.0) < 0.8 * see.red_over_blue(without, -5.0, 90.0, 0.0)
    # by day ozone hardly matters
    assert abs(zenith(pure, 40.0)[0] - zenith(without, 40.0)[0]) < 0.01


@pytest.mark.parametrize(("horizon", "redder"), [("clean", 0.02), ("typical", 0.008)])
def test_belt_of_venus_lies_over_the_shadow_and_rises(horizon, redder):
    """Lee 2015: a reddish band, the bluish shadow below it, bluer sky above it; fainter behind what takes red beams."""
    pure = air(horizon=horizon)
    belts = [see.belt_of_venus(pure, sun) for sun in (-1.0, -2.0, -3.0, -4.0)]
    assert all(belts)
    heights = [b.elevation_deg for b in belts]
    assert (np.diff(heights) > 0).all() and 4.0 < heights[2] < 14.0
    for belt in belts:
        assert belt.shadow_elevation_deg < belt.elevation_deg
        assert belt.x > belt.shadow_x + 0.02 and belt.x > belt.sky_x + redder
    edge = see.shadow_edge_deg(pure, -3.0)
    assert belts[2].shadow_elevation_deg < edge < belts[2].elevation_deg
    assert see.belt_of_venus(pure, 20.0) is None


def test_earths_shadow_rises_faster_than_the_sun_sinks(pure):
    """The Earth's shadow would rise too slowly."""
    suns = np.array([-1.5, -2.5, -3.5, -4.5])
    edges = np.array([see.shadow_edge_deg(pure, sun) for sun in suns])
    rate = np.diff(edges) / -np.diff(suns)
    assert (rate > 1.0).all() and rate[-1] > rate[0] and rate[-1] < 8.0


def test_afterglow_at_minus_six(pure):
    """Dusk would have no afterglow, or noon one."""
    glow = see.afterglow(pure, -6.0)
    assert glow.horizon_x > 0.36 and 2.0 <= glow.height_deg <= 30.0 and glow.over_zenith > 10.0
    assert see.afterglow(pure, 40.0).height_deg < glow.height_deg


@pytest.mark.slow
def test_purple_light_under_a_volcanic_stratosphere():
    """Lee and Hernandez-Andres 2003: background aerosol reddens little, volcanic aerosol makes the sky purple."""
    below, ratio = {}, {}
    for kind in ("background", "moderate_volcanic", "high_volcanic"):
        a = air("continental-clean", list(see.WAVELENGTHS_NM), stratosphere__kind=kind, horizon="clean")
        (x,), (y,) = see.chromaticity(a.xyz(-4.0, [20.0], [0.0]))
        below[kind], ratio[kind] = see.above_daylight(x, y), see.red_over_blue(a, -4.0, 20.0, 0.0)
    for kind in ("moderate_volcanic", "high_volcanic"):
        assert below[kind] < below["background"] - 0.01
        assert ratio[kind] > 1.2 * ratio["background"]


@pytest.mark.slow
def test_maritime_air_has_thin_bands_after_sunset():
    """Sea air would have no bands at sunset."""
    nm = list(see.WAVELENGTHS_NM)
    sea = see.horizon_bands(air("maritime-clean", nm), -0.5)
    land = see.horizon_bands(air("continental-average", nm), -0.5)
    assert sea.steps_per_degree_at_most > 1.5 * land.steps_per_degree_at_most
    assert sea.colour_steps > 15
