"""The light of directions and surfaces at places and times, term by term."""

import time
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import twilight
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.engine.light import LightField
from twilight.numerics.directions import whole_hemisphere
from twilight.sky.lights import TIMES_BRIGHTER, Sun
from twilight.sky.moments import moments_at
from twilight.sky.night import NightLevels, night_radiance
from twilight.sky.night.glows import Glow
from twilight.sky.surfaces import Direction, Surface, towards

pytestmark = pytest.mark.usefixtures("coarse_draft")

PLACE = (28.3, -16.5)
AIR = {
    "version": 1,
    "climate": "continental-clean",
    "wavelengths": {"list_nm": [400, 450, 500, 550, 600, 650, 710]},
    "solver": {"quality": "draft"},
}
DUSK = datetime(2026, 3, 20, 19, 43, tzinfo=UTC)  # the sun at -6.5 deg


@pytest.mark.parametrize("sun_deg", [-9.0, 30.0, 88.0])
def test_surfaces_under_a_uniform_sky_have_their_closed_forms(sun_deg):
    """A surface would be lit by another part of the sky."""
    elevation, azimuth, solid = (x[None, :] for x in whole_hemisphere(sun_deg))
    assert solid.sum() == pytest.approx(2 * np.pi, rel=1e-12)
    zero = np.zeros(1)
    for surface, expected, tolerance in (
        (Surface(), np.pi, 1e-9),
        (Surface("plane", 35.0, 70.0), 0.5 * np.pi * (1 + np.cos(np.radians(35.0))), 5e-3),
        (Surface("plane", 90.0, 200.0), 0.5 * np.pi, 5e-3),
        (Surface("plane", 180.0), 0.0, 1e-9),
        (Surface("sphere"), 2 * np.pi, 1e-9),
        (Surface("cylinder"), 0.5 * np.pi, 1e-3),
    ):
        seen = float((surface.view(elevation, azimuth, zero) * solid).sum())
        assert seen == pytest.approx(expected, rel=tolerance, abs=1e-9), surface
    # ground of radiance 1 fills what the sky does not
    assert Surface("plane", 35.0).ground_view + 0.5 * np.pi * (1 + np.cos(np.radians(35.0))) == pytest.approx(np.pi)
    assert Surface("sphere").ground_view == pytest.approx(2 * np.pi)


def test_what_is_asked_for_is_read_from_text():
    """`--towards` would mean another direction."""
    assert towards("zenith") == Direction(90.0) and towards("30/180") == Direction(30.0, 180.0)
    assert towards("5/sun+90") == Direction(5.0, 90.0, True) and towards("5/sun") == Direction(5.0, 0.0, True)
    assert towards("plane:90/270") == Surface("plane", 90.0, 270.0) and towards("sphere") == Surface("sphere")
    for text in ("up", "30", "plane:200/0", "-3/10", "95/0"):
        with pytest.raises(TwilightError, match=r"allowed is|is none of"):
            towards(text)


@pytest.fixture(scope="module")
def light():
    return LightField(twilight.solve({**AIR, "solver": {"name": "compact", "polarisation": False}}), NightLevels())


def at(*hours: float):
    """Moments of a day, hours from its beginning in UTC."""
    times = [datetime(2026, 3, 20, tzinfo=UTC) + timedelta(hours=h) for h in hours]
    return moments_at([PLACE[0]] * len(times), [PLACE[1]] * len(times), times)


def test_the_night_is_exact_in_every_direction_at_every_moment(light):
    """Interpolated nights would be off the formulas by more than 0.3 %."""
    moments = at(21.3, 23.123, 28.61)
    elevation, azimuth = np.array([[17.0, 52.3, 90.0]] * 3), np.array([[283.0, 7.7, 0.0]] * 3)
    found = light.directions(moments, elevation, azimuth, ["airglow", "stars", "zodiacal_light"])
    for n, place in enumerate(moments.places):
        sun = float(moments.sun.elevation_deg[n]), float(moments.sun.azimuth_deg[n])
        for d in range(3):
            exact = night_radiance(
                light.solved.medium, elevation[n, d : d + 1], azimuth[n, d : d + 1] - sun[1], NightLevels(),
                sun_elevation_deg=sun[0], sun_azimuth_deg=sun[1], place=place,
            )[0, 0]  # fmt: skip
            assert found[n, d] == pytest.approx(exact, rel=3e-3)


def test_the_night_of_surfaces_is_the_integral_of_its_directions(light):
    """Surfaces would be lit by another night."""
    moments, names = at(22.0, 27.5), ["airglow", "stars", "zodiacal_light"]
    rows, columns = np.meshgrid(np.arange(1.0, 90.0, 2.0), np.arange(0.0, 360.0, 6.0), indexing="ij")
    e, a = (np.broadcast_to(x.ravel(), (2, x.size)) for x in (rows, columns))
    radiance = light.directions(moments, e, a, names)
    solid = np.cos(np.radians(e)) * np.radians(2.0) * np.radians(6.0)
    for surface in (Surface(), Surface("plane", 60.0, 75.0), Surface("plane", 90.0, 30.0, True), Surface("cylinder")):
        expected = np.einsum("nd,ndw->nw", surface.view(e, a, moments.sun.azimuth_deg) * solid, radiance)
        assert light.surfaces(moments, [surface], names)[:, 0] == pytest.approx(expected, rel=0.01)


def test_surfaces_have_the_integral_of_the_sky_at_any_sun(light):
    """Between nodes of suns and azimuths surfaces would be lit wrongly."""
    moments = at(12.9, 18.7, 19.31, 20.03)
    surfaces = [Surface(), Surface("plane", 90.0, 37.0), Surface("plane", 40.0, 205.0), Surface("sphere")]
    found = light.surfaces(moments, surfaces, ["sky"])
    for n, sun in enumerate(moments.sun.elevation_deg):
        elevation, azimuth, solid = whole_hemisphere(float(sun))
        radiance = light.solved.radiance(float(sun), elevation, azimuth) * light.solar_irradiance
        radiance = radiance / moments.sun.distance_au[n] ** 2
        around = azimuth[None] + moments.sun.azimuth_deg[n]
        for s, surface in enumerate(surfaces):
            weight = surface.view(elevation[None], around, moments.sun.azimuth_deg[n : n + 1])[0] * solid
            assert found[n, s] == pytest.approx(weight @ radiance, rel=5e-3), (sun, surface)


def test_the_disc_of_the_sun_is_that_of_its_strips(light):
    """A setting sun would light a plane too long."""
    for sun in (-0.7, -0.2, 0.3, 4.0, 61.0):
        elevation, beams = light.tables.strips(Sun(np.array([sun])))
        level = np.maximum(np.sin(np.radians(elevation[0])), 0.0) @ beams[0]
        exact = light.solved.disc_irradiance(sun)
        rel = 0.01 if sun > -0.5 else 0.07  # the disc, behind its screen, is all but gone
        assert level == pytest.approx(exact, rel=rel, abs=1e-3 * exact.max() + 1e-9), sun
    assert not light.tables.strips(Sun(np.array([-3.0])))[1].any()


def test_zenith_and_directions_are_those_of_the_field(light):
    """Tables would differ from the field's lines of sight."""
    suns = np.array([-16.3, -5.2, 1.4, 33.0, 71.0])
    elevation = np.array([[90.0, 12.0, 50.0]] * 5)
    azimuth = np.array([[0.0, 20.0, 200.0]] * 5)
    for _ in range(2):  # line by line while tables are missing, then from the tables
        found = light.tables.sky(suns, elevation, azimuth)
        for n, sun in enumerate(suns):
            exact = light.solved.radiance(float(sun), elevation[n], azimuth[n])
            assert found[n] == pytest.approx(exact, rel=1.5e-2), sun
        light.tables.fill(suns)
        light.tables.light(suns, elevation[:, 1], azimuth[:, 1])
        assert light.tables.missing(suns) == 0 and light.tables.missing(suns, lines=True) == 0


def test_below_the_lowest_sun_logarithms_go_on_straight(light):
    """compact ends at -18 deg: a whole night would have a gap or a rise."""
    suns = np.arange(-17.0, -30.0, -0.5)
    zenith = light.tables.zenith(suns)
    level = light.tables.surface(Surface(), suns, np.zeros(suns.size))
    for values in (np.log(zenith), np.log(level)):
        steps = np.diff(values, axis=0)
        assert (steps < 0.0).all() and np.ptp(steps[3:], axis=0) == pytest.approx(0.0, abs=1e-6)


def test_the_night_is_left_out_by_day_and_only_where_it_cannot_matter(light, monkeypatch):
    """A night would cost time by day, or be missing at dusk."""
    moments, up = at(13.0, 19.75, 22.0), np.array([[90.0]] * 3)
    asked: list[int] = []
    true = Glow.radiance
    monkeypatch.setattr(Glow, "radiance", lambda glow, m, e, a: asked.append(len(m)) or true(glow, m, e, a))
    whole = light.directions(moments, up, 0.0 * up)
    assert asked == [2, 2, 2]  # of three moments two are dark enough
    night = sum(light.directions(moments, up, 0.0 * up, [name]) for name in ("airglow", "stars", "zodiacal_light"))
    sunlit = light.directions(moments, up, 0.0 * up, ["sky", "moon"])
    assert whole[1:] == pytest.approx((sunlit + night)[1:]) and (whole[0] == sunlit[0]).all()
    assert (night[0] < 3.0 / TIMES_BRIGHTER * sunlit[0]).all()
    # a source that is asked for alone is there by day too
    assert (light.directions(moments, up, 0.0 * up, ["stars"]) > 0.0).all()


def test_without_a_solver_it_is_compact_where_that_serves_and_says_so():
    """Another solver would be taken without a word."""
    air = {key: value for key, value in AIR.items() if key != "solver"}
    made = twilight.light(PLACE, DUSK, "zenith", ["V"], air)
    assert made.attrs["solver"].startswith("solver: compact")
    assert twilight.light(PLACE, DUSK, "zenith", ["V"], AIR).attrs["solver"] == "zones"


def test_terms_add_up_and_the_ground_is_lit_by_them():
    """A source would count twice, or not light the ground."""
    names = ("sky", "moon", "airglow", "stars", "zodiacal_light")
    late = datetime(2026, 3, 20, 20, 35, tzinfo=UTC)
    whole = float(twilight.light(PLACE, late, "40/120", "luminance", AIR))
    parts = [float(twilight.light(PLACE, late, "40/120", "luminance", AIR, sources=[name])) for name in names]
    # spectra are interpolated in the logarithm, a sum of them not as their parts where one has airglow's lines
    assert sum(parts) == pytest.approx(whole, rel=0.02) and all(part > 0 for part in parts)
    targets = ["horizontal", "plane:180/0", "sphere"]
    up, down, sphere = twilight.light(PLACE, DUSK, targets, "illuminance", AIR).values
    albedo = down / up
    assert 0.05 < albedo < 0.3  # of the climate's ground
    dark = twilight.light(PLACE, DUSK, targets, "illuminance", AIR, sources=["sun", "sky"]).values
    assert dark[1] == 0.0 and sphere - dark[2] == pytest.approx(2 * down, rel=0.02)


def test_civil_dusk_has_the_illuminance_that_was_measured():
    """3.4 lx at -6 deg (Janiczek & DeYoung 1987), between sites by a factor of 1.5."""
    made = float(twilight.light(PLACE, "2026-03-20 civil dusk", "horizontal", "illuminance", AIR))
    assert 3.4 / 1.5 < made < 3.4 * 1.5


def test_places_times_and_directions_have_their_dimensions():
    """Places, times and directions would be exchanged."""
    times = [DUSK, datetime(2026, 3, 20, 19, 46, tzinfo=UTC)]
    made = twilight.light([PLACE, (28.3, -16.0)], times, ["zenith", "20/sun"], "V", AIR)
    assert made.dims == ("place", "time", "direction") and made.shape == (2, 2, 2)
    # a second place half a degree to the east is two minutes later
    assert float(made[1, 0, 0]) > float(made[0, 0, 0]) and (np.diff(made.values, axis=1) > 0).all()
    one = twilight.light(PLACE, DUSK, "20/sun", "V", AIR)
    assert one.shape == () and float(one) == pytest.approx(float(made[0, 0, 1]), abs=1e-6)
    tracked = (xr.DataArray([30.0, 40.0], dims="time"), xr.DataArray([100.0, 110.0], dims="time"))
    found = twilight.light(PLACE, times, tracked, "V", AIR)
    assert found.dims == ("time",)
    assert float(found[1]) == pytest.approx(float(twilight.light(PLACE, times[1], (40.0, 110.0), "V", AIR)), abs=1e-3)


def test_times_units_and_series_of_other_libraries():
    """pandas or astropy would get another unit or index."""
    pandas = pytest.importorskip("pandas")
    index = pandas.DatetimeIndex([DUSK, "2026-03-20T19:46Z"]).tz_convert("Atlantic/Canary")
    series = twilight.light(PLACE, index, "horizontal", "illuminance", AIR, returns="pandas")
    assert series.index.equals(index) and series.name == "illuminance_lux" and series.iloc[0] > series.iloc[1]
    pytest.importorskip("astropy")
    from astropy import units
    from astropy.coordinates import EarthLocation
    from astropy.time import Time

    place = EarthLocation.from_geodetic(PLACE[1] * units.deg, PLACE[0] * units.deg)
    arguments = (Time(DUSK), (np.radians(90.0) * units.rad, 0.0 * units.deg))
    found = twilight.light(place, *arguments, "V", AIR, returns="astropy")
    assert found.unit == units.mag / units.arcsec**2
    lux = twilight.light(place, Time(index.tz_convert("UTC").to_pydatetime()), "horizontal", "illuminance", AIR,
                         returns="astropy")  # fmt: skip
    assert lux.unit == units.lx and lux[0].to_value("lx") == pytest.approx(series.iloc[0], rel=1e-4)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"quantity": "illuminance"}, "illuminance is of a surface"),
        ({"quantity": "U"}, r"U: .* beyond the wavelengths of the field, 400 to 710 nm"),
        ({"towards": "horizontal", "quantity": "V"}, "V is of a direction"),
        ({"towards": ["zenith", "horizontal"]}, "directions or surfaces, not both"),
        ({"towards": (95.0, 0.0)}, "elevations must be from 0 to 90"),
        ({"sources": ["lamp"]}, "sources: 'lamp' is not known"),
        ({"returns": "list"}, "allowed is xarray, pandas, astropy"),
        ({"place": (99.0, 0.0)}, "is not a latitude from -90 to 90"),
        ({"climate": {**AIR, "solver": {"name": "analytic"}}}, "field serves every sun|solver"),
    ],
)
def test_bad_input_is_one_sentence(change, sentence):
    """A wrong question would be a traceback."""
    asked = {"place": PLACE, "time": DUSK, "towards": "zenith", "quantity": "V", "climate": AIR} | change
    with pytest.raises(TwilightError, match=sentence) as error:
        twilight.light(**asked)
    assert "\n" not in str(error.value)


def test_the_command_prints_what_the_call_returns(tmp_path):
    """Command and call would differ."""
    import yaml

    path = tmp_path / "air.yaml"
    path.write_text(yaml.safe_dump(AIR))
    arguments = ["light", str(path), "--at", DUSK.isoformat(), "--latitude", "28.3", "--longitude", "-16.5"]
    done = CliRunner().invoke(app, [*arguments, "--towards", "zenith", "--towards", "horizontal"])
    assert done.exit_code == 0, done.output
    value = float(twilight.light(PLACE, DUSK, "horizontal", "illuminance", AIR))
    assert f"{value:.5g}" in done.output and "mag arcsec-2" in done.output


@pytest.mark.slow
def test_the_moon_lights_the_night_as_in_a_render():
    """A full moon 57 deg up lights less than 0.32 lx (Kyba, Mohar & Posch 2017); as in a render."""
    night = datetime(2026, 4, 2, 0, 30, tzinfo=UTC)
    lux = twilight.light(PLACE, night, "horizontal", "illuminance", AIR, sources=["moon"])
    assert 0.1 < float(lux) < 0.32
    sky = twilight.render(AIR, at=night, place=PLACE, settings={"moon": {}, "night": {}})
    whole = float(twilight.light(PLACE, night, "40/100", "luminance", AIR))
    from_sun = (100.0 - float(sky.sun_azimuth_deg or 0.0)) % 360.0
    assert whole == pytest.approx(float(sky.luminance_at(40.0, from_sun)), rel=0.03)
    dark = datetime(2026, 3, 19, 0, 30, tzinfo=UTC)
    assert float(twilight.light(PLACE, dark, "horizontal", "illuminance", AIR, sources=["moon"])) < 1e-6
    put = {**AIR, "moon": {"elevation_deg": 30.0}}
    with pytest.raises(TwilightError, match="light takes the moon from place and time"):
        twilight.light(PLACE, night, "zenith", "luminance", put)


@pytest.mark.slow
def test_ten_thousand_moments_take_seconds():
    """A year of moments would take minutes: 1.6 processor s of skies that are there."""
    start = datetime(2026, 1, 1, tzinfo=UTC)
    times = [start + timedelta(minutes=52.56 * i) for i in range(10_000)]
    asked = ("horizontal", ["illuminance", "cct"], {key: v for key, v in AIR.items() if key != "solver"})
    twilight.light(PLACE, times[::10], *asked)
    told: list[float] = []
    begin = time.process_time()
    made = twilight.light(PLACE, times, *asked, progress=lambda doing, fraction: told.append(fraction))
    assert time.process_time() - begin < 10.0
    assert told == sorted(told) and len(told) > 4
    assert np.isfinite(made.illuminance_lux).all() and (made.illuminance_lux > 0.0).all()
