"""What lies beyond the horizon: its factor on the sunbeam, in closed form, in space, in every solver and on files."""

import math
from dataclasses import replace

import numpy as np
import pytest
from airs import pure_air
from hazy_zones import SCALAR
from montecarlo_media import assert_all_agree, hazy_earth
from typer.testing import CliRunner

from twilight.atmosphere.screen import Screen
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.config import load
from twilight.engine.block import field_key
from twilight.engine.sunbeam import make_disc
from twilight.scene import resolve
from twilight.scene.usual import described
from twilight.sky.lights import Sun
from twilight.solvers import montecarlo, tables, zones
from twilight.solvers.zones.storage import field_hash
from twilight.transport.beam import beam_at_one, prepare_beam
from twilight.transport.ground_sun import GroundSun

RADIUS = 6371.0
LEVELS = np.linspace(0.0, 100.0, 51)
RAMP = Screen((5.0, 15.0), (0.2, 0.9))
CLOUDS = Screen.of_clouds(0.7, 9.0, 1.5, 0.0)
SINGLE = montecarlo.MonteCarloSettings(target_stderr=None, samples=4, max_orders=1, importance_sweeps=0)


def factor(screen, altitude_km, sun_deg, refractivity=0.0):
    """T that the beam's tables give: screened over bare."""
    air = pure_air(LEVELS, refractivity=refractivity)
    beams = [prepare_beam(replace(air, screen=s)) for s in (screen, None)]
    found = [beam_at_one(beam, altitude_km, math.sin(math.radians(sun_deg)), 0)[0] for beam in beams]
    return found[0] / found[1]


def least_altitude(altitude_km, sun_deg, from_km, to_km):
    """Least altitude of a straight ray between two distances from a point, by brute force."""
    r, e = RADIUS + altitude_km, math.radians(sun_deg)
    s = np.linspace(from_km, min(to_km, 3000.0), 200001)
    return float(np.min(np.hypot(r * math.cos(e), r * math.sin(e) + s)) - RADIUS)


@pytest.mark.parametrize(
    "place", [(20.0, -3.0, 0.0, math.inf), (8.0, -1.0, 0.0, math.inf), (8.0, 2.0, 0.0, math.inf),
              (20.0, -3.0, 150.0, math.inf), (8.0, -1.0, 150.0, math.inf), (0.0, 0.5, 300.0, math.inf),
              (0.0, 1.0, 250.0, 250.0), (20.0, -3.5, 100.0, 100.0)]
)  # fmt: skip
def test_straight_beam_against_its_least_altitude(place):
    """Fails if T were taken at a tangent point that a beam has not reached, or nearer than the screen begins."""
    altitude_km, sun_deg, from_km, to_km = place
    screen = replace(RAMP, from_km=from_km, to_km=to_km)
    expected = np.interp(least_altitude(altitude_km, sun_deg, from_km, to_km), RAMP.altitude_km, RAMP.transmission)
    assert factor(screen, altitude_km, sun_deg) == pytest.approx(expected, abs=1e-4)


def test_refracted_beam_against_its_tangent_altitude():
    """Bouguer's n r sin i gives the tangent altitude of a limb ray: fails if the screen were met by straight rays."""
    nu, altitude_km, sun_deg = 2.8e-4, 20.0, -3.8

    def x(z):
        return (RADIUS + z) * (1.0 + nu * math.exp(-z / 8.0))

    air = pure_air(LEVELS, refractivity=nu)
    _, bending = beam_at_one(prepare_beam(air), altitude_km, math.sin(math.radians(sun_deg)), 0)
    p = x(altitude_km) * math.cos(math.radians(sun_deg) + bending)
    low, high = 0.0, altitude_km
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if x(middle) < p else (low, middle)
    assert 5.0 < low < 15.0 and bending > math.radians(0.1)
    expected = np.interp(low, RAMP.altitude_km, RAMP.transmission)
    assert factor(RAMP, altitude_km, sun_deg, nu) == pytest.approx(expected, abs=2e-3)


def test_a_skyline_puts_the_sun_out():
    """A wall is all or nothing: fails if its edge were smeared or at a wrong elevation."""
    wall = Screen.of_skyline(3.0, 100.0)
    edge = math.degrees(math.atan2(3.0 - 100.0**2 / (2.0 * RADIUS), 100.0))
    assert factor(wall, 0.0, edge - 0.05) == 0.0
    assert factor(wall, 0.0, edge + 0.05) == 1.0


def sun_and_disc(screened, bare):
    """Sunlight on the ground, and the disc's transmittances, under a sun at 3 deg: screened over bare."""
    ground = [GroundSun(medium).at(3.0)[0] for medium in (screened, bare)]
    disc = [make_disc(medium, Sun(3.0), 0.0).transmittance for medium in (screened, bare)]
    return ground[0] / ground[1], disc[0] / disc[1]


def test_screens_that_pass_all_change_nothing_and_half_halves():
    """The field is linear in the beam: fails if some light (ground, disc, later orders) went past the screen."""
    air = hazy_earth()
    everything, half = Screen((0.0,), (1.0,)), Screen((0.0,), (0.5,))
    suns, e, a = (3.0, -4.0), [3.0, 40.0, 90.0, -20.0], [0.0, 60.0, 0.0, 30.0]
    small = tables.TablesSettings(scattering_r=8, scattering_mu=32, scattering_nu=4, max_orders=2, polar_directions=4)
    for solver, settings in ((zones, SCALAR), (tables, small)):
        fields = [solver.prepare(replace(air, screen=s), settings) for s in (None, everything, half)]
        for sun in suns:
            bare, same, halved = (field.radiance(sun, e, a) for field in fields)
            assert np.allclose(same, bare, rtol=2e-6)
            assert np.allclose(halved, 0.5 * bare, rtol=2e-4)
    assert all(np.allclose(ratio, 0.5) for ratio in sun_and_disc(replace(air, screen=half), air))


def test_ground_sun_and_disc_see_the_same_screen():
    """The sun's own light by quadrature and by tables would differ where clouds lie on its way."""
    air = replace(pure_air(LEVELS), screen=Screen.of_clouds(0.7, 6.0, 2.0, 150.0))
    beam, ground = prepare_beam(air), GroundSun(air)
    for sun in (0.0, 0.7, 1.5, 3.0):
        assert ground.at(sun)[0][0] == pytest.approx(
            beam_at_one(beam, 0.0, math.sin(math.radians(sun)), 0)[0], rel=2e-3
        )


def test_zones_against_rays_followed_in_space():
    """`montecarlo` follows every beam to the sun, `zones` knows its tangent altitude: light scattered once."""
    air = replace(hazy_earth(), screen=CLOUDS)
    suns, e, a = (2.0, -4.0), np.array([10.0, 30.0, 90.0, 30.0]), np.array([0.0, 0.0, 0.0, 180.0])
    bare = replace(air, screen=None)
    field = montecarlo.prepare(air, SINGLE)
    screened, clear = (
        zones.prepare(m, replace(zones.QUALITIES["draft"], max_orders=1, polarisation=False)) for m in (air, bare)
    )
    unscreened = montecarlo.prepare(bare, SINGLE)
    for sun in suns:
        # what delta scaling moves of light scattered once is the same in both
        ratio = screened.radiance(sun, e, a) / clear.radiance(sun, e, a)
        expected = field.radiance(sun, e, a) / unscreened.radiance(sun, e, a)
        assert np.min(expected) < 0.9
        assert np.allclose(ratio, expected, rtol=4e-3)


@pytest.mark.slow
def test_zones_against_rays_followed_in_space_at_every_order():
    """As above, with all orders of scattering and their noise."""
    air = replace(hazy_earth(), screen=CLOUDS)
    e, a = np.array([10.0, 30.0, 90.0, 30.0]), np.array([0.0, 0.0, 0.0, 180.0])
    settings = replace(montecarlo.QUALITIES["standard"], target_stderr=0.01)
    reference, field = montecarlo.prepare(air, settings), zones.prepare(air, zones.QUALITIES["standard"])
    for sun in (2.0, -4.0, -8.0):
        found = reference.radiance_with_error(sun, e, a)
        noise = np.hypot(found.standard_error, 0.006 * found.radiance)  # that of `standard` in clear air
        assert_all_agree(found.radiance, noise, field.radiance(sun, e, a))


def test_a_screen_is_never_confused_with_another():
    """Cached fields and stored files would be read for the wrong evening."""
    air = pure_air(LEVELS)
    settings = SCALAR
    media = [air, replace(air, screen=CLOUDS), replace(air, screen=replace(CLOUDS, from_km=150.0))]
    assert len({field_key("twilight.solvers.zones", settings, m, None, 0.0) for m in media}) == 3
    assert len({field_hash(m, settings, (0.0, 110.0)) for m in media}) == 3


def test_a_field_with_a_screen_survives_its_file(tmp_path):
    """Fails if a stored field lost what it was solved for."""
    path = tmp_path / "field.h5"
    air = replace(pure_air(LEVELS), screen=CLOUDS)
    settings = replace(SCALAR, max_orders=1)
    field = zones.prepare(air, settings)
    field.save(path)
    again = zones.load(path)
    assert again.medium.screen == CLOUDS
    assert np.array_equal(again.radiance(-4.0, [20.0], [0.0]), field.radiance(-4.0, [20.0], [0.0]))


def scene(screen, **more):
    return {"version": 1, "climate": "pure-air", "sun": {"elevation_deg": -4}, "horizon": {"screen": screen}, **more}


def test_sections_become_screens():
    """Each form of the section, and what the plan says of it."""
    table = load(scene({"heights_km": [4, 9], "transmission": [0.3, 1], "from_km": 50}))
    assert resolve(table).medium.screen == Screen((4.0, 9.0), (0.3, 1.0), 50.0)
    clouds = load(scene({"clouds": {"top_km": 8}}))
    assert resolve(clouds).medium.screen == Screen.of_clouds(0.7, 8.0, 1.5, 150.0)
    assert described(clouds.horizon) == "clouds from 150 km on stop 70% of the beams below 8 +- 1.5 km"
    skyline = load(scene({"skyline": {"height_km": 3, "distance_km": 60}}))
    assert resolve(skyline).medium.screen == Screen.of_skyline(3.0, 60.0)
    assert described(skyline.horizon) == "a skyline of 3 km at 60 km"
    typical = {"version": 1, "climate": "pure-air"}
    assert resolve(load(typical)).medium.screen == Screen((8.0, 9.5), (0.15, 1.0), 300.0)
    assert resolve(load(typical | {"horizon": "clean"})).medium.screen is None
    assert resolve(load(typical | {"solver": {"name": "cells"}})).medium.screen is None  # it takes none
    assert resolve(load(typical | {"climate": "bruneton2008"})).medium.screen is None  # a table


def test_haze_takes_more_blue():
    """T^((wavelength/550 nm)^-alpha) on every way to the beam: fails if one of them forgot the colour."""
    air = pure_air(LEVELS)
    haze = Screen((0.0,), (0.4,), angstrom_exponent=1.5)
    expected = 0.4 ** ((air.wavelength_nm / 550.0) ** -1.5)
    media = replace(air, screen=haze), air
    screened, bare = map(prepare_beam, media)
    for altitude_km, sun in ((0.0, 3.0), (20.0, -3.0)):
        place = altitude_km, math.sin(math.radians(sun))
        passed = [beam_at_one(screened, *place, w)[0] / beam_at_one(bare, *place, w)[0] for w in range(3)]
        assert passed == pytest.approx(expected, rel=1e-9)
    sun, disc = sun_and_disc(*media)
    assert sun == pytest.approx(expected) and np.allclose(disc, expected)
    small = tables.TablesSettings(scattering_r=8, scattering_mu=32, scattering_nu=4, max_orders=1, polar_directions=4)
    once = replace(SCALAR, max_orders=1)
    for solver, settings in ((zones, once), (tables, small), (montecarlo, SINGLE)):
        one, other = (solver.prepare(medium, settings).radiance(-4.0, [40.0], [0.0]) for medium in media)
        assert np.allclose(one / other, expected, rtol=2e-4)


def test_an_export_knows_the_horizon_of_its_configuration(tmp_path, monkeypatch):
    """Tables for renderers would be of another evening than the configuration that they were made from."""

    def prepare(medium, settings, **more):
        raise TwilightError(f"prepared with {medium.screen}")

    monkeypatch.setattr(zones, "prepare", prepare)
    (tmp_path / "evening.yaml").write_text("version: 1\nclimate: pure-air\nhorizon: {screen: {clouds: {top_km: 8}}}\n")
    for target, screen in (
        (str(tmp_path / "evening.yaml"), Screen.of_clouds(0.7, 8.0, 1.5, 150.0)),
        ("pure-air", Screen((8.0, 9.5), (0.15, 1.0), 300.0)),
    ):
        done = CliRunner().invoke(app, ["export", "shader", target, "--output", str(tmp_path / "out")])
        assert done.exit_code == 2 and f"prepared with {screen}" in done.output + done.stderr
