"""From high up the horizon dips: the sky's rows go below the horizontal, and the picture shows the true horizon."""

import numpy as np
import pytest

from twilight.config import load, load_climate
from twilight.engine import run
from twilight.engine.one_sun import texture_rows
from twilight.io.picture import render_view, view_directions
from twilight.scene import resolve
from twilight.scene.medium import climate_medium
from twilight.sky import colour
from twilight.transport.rays import ApparentRays, horizon_dip_deg

pytestmark = pytest.mark.usefixtures("coarse_draft")

SCENE = {
    "solver.quality": "draft", "solver.polarisation": False, "texture.resolution_deg": 10,
    "wavelengths": {"list_nm": [450.0, 550.0, 650.0]}, "sun": {"elevation_deg": -4.0},
}  # fmt: skip


@pytest.mark.parametrize("altitude_km", (0.5, 10.0, 400.0))
def test_the_dip_is_that_of_the_ray_that_touches_the_ground(altitude_km):
    """The horizon would be drawn elsewhere."""
    medium = climate_medium(load_climate("pure-air"), [550.0])
    dip = horizon_dip_deg(medium, altitude_km)
    without_air = np.degrees(np.arccos(6371.0 / (6371.0 + altitude_km)))
    assert 0.85 * without_air < dip < without_air
    _, passed = ApparentRays(medium).follow(altitude_km, np.array([-dip - 1e-3, -dip + 1e-3]), np.array([0]))
    assert passed[0, 0] == 0.0 < passed[1, 0]


def test_rows_bracket_the_horizon_from_high_up_and_are_those_of_the_texture_else():
    """The limb would be smeared, or the ground's sky change."""

    def rows(altitude_km, **more):
        config = load("pure-air", {**SCENE, "observer.altitude_km": altitude_km, **more})
        return texture_rows(resolve(config))

    ground = rows(0.0)
    assert ground[0] > 0.0 and (rows(0.05) == ground).all() and (rows(10.0, solver={"name": "cie"}) == ground).all()
    high = rows(10.0)
    assert (high[-ground.size :] == ground).all() and high[0] == -90.0 and (np.diff(high) > 0).all()
    dip = horizon_dip_deg(climate_medium(load_climate("pure-air"), [550.0]), 10.0)
    around = high - -dip
    assert around[around > 0].min() < 0.05 and around[around < 0].max() > -0.05


def test_the_picture_from_ten_kilometres_shows_the_horizon_below_zero():
    """From an airliner the horizon would be level."""
    config = load("pure-air", {**SCENE, "observer.altitude_km": 10.0})
    sky = run(resolve(config))
    picture, _ = render_view(sky, width=400)
    elevation = view_directions("wide", 400)[0][:, 0]
    assert picture.shape[0] == elevation.size
    light = picture @ colour.REC709_LUMINANCE
    edge = elevation[np.argmax(np.abs(np.diff(light[:, 200])))]
    assert edge == pytest.approx(-3.0, abs=0.5)
    # the half below does not count as sky
    assert sky.illuminance_lux() == pytest.approx(
        sky.resample(np.arange(5.0, 90.0, 10.0), sky.azimuth_deg).illuminance_lux(), rel=0.05
    )
    assert sky.solid_angle_sr().sum() == pytest.approx(4 * np.pi)
