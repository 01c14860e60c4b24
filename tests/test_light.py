"""The light of directions and surfaces at places and times, term by term."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import twilight
from twilight.base.errors import TwilightError
from twilight.cli.app import app
from twilight.engine.hemisphere import whole_hemisphere
from twilight.engine.light import _bilinear
from twilight.engine.sky_table import SUNS_DEG, SkyTable
from twilight.engine.surfaces import Surface
from twilight.engine.towards import Direction, towards
from twilight.numerics.spectrum import hermite_weights

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
    assert towards("zenith") == Direction(90.0) and towards("30/180") == Direction(30.0, 180.0)
    assert towards("5/sun+90") == Direction(5.0, 90.0, True) and towards("5/sun") == Direction(5.0, 0.0, True)
    assert towards("plane:90/270") == Surface("plane", 90.0, 270.0) and towards("sphere") == Surface("sphere")
    for text in ("up", "30", "plane:200/0", "-3/10", "95/0"):
        with pytest.raises(TwilightError, match=r"allowed is|is none of"):
            towards(text)


def test_a_grid_of_the_night_is_read_between_its_nodes():
    grid = np.zeros((13, 24, 1))
    grid[:, :, 0] = 3.0 + np.arange(13)[:, None]
    assert _bilinear(grid, np.array([2.5, 90.0, 35.0]), np.array([7.0, 355.0, -20.0]))[:, 0] == pytest.approx(
        [3.5, 15.0, 9.5]
    )


@pytest.fixture(scope="module")
def field():
    return twilight.solve(AIR)


def test_tables_are_the_field_within_their_stated_error(field):
    table, random = SkyTable(field), np.random.default_rng(2)
    for sun in (-5.2, 31.3):
        elevation = np.degrees(np.arcsin(random.uniform(0.1, 1.0, 24)))
        azimuth = random.uniform(0.0, 360.0, 24)
        exact = field.radiance(sun, elevation, azimuth)
        nodes, weights = hermite_weights(SUNS_DEG, np.array([sun]))
        held = sum(w * table._table(int(k)) for k, w in zip(nodes[0], weights[0], strict=True) if w)
        found = table._interpolate(held, sun, elevation, azimuth)
        assert np.sqrt(((found / exact - 1) ** 2).mean()) < 0.003, sun
    # enough lines of sight and the tables answer
    many = table.radiance(np.full(4, -5.2), np.tile(elevation, (4, 1)), np.tile(azimuth, (4, 1)))
    assert np.allclose(many[0], field.radiance(-5.2, elevation, azimuth), rtol=0.01)
    assert not table.radiance(np.array([-60.0]), np.array([[45.0]]), np.array([[0.0]])).any()


@pytest.mark.slow
def test_the_zenith_is_that_of_a_rendered_sky():
    made = twilight.light(PLACE, DUSK, "zenith", ["V", "luminance"], AIR)
    sky = twilight.render({**AIR, "night": {}}, at=DUSK, place=PLACE)
    assert float(made.luminance_cd_per_m2) == pytest.approx(sky.luminance_at(), rel=0.01)
    assert float(made.magnitude_V_per_arcsec2) == pytest.approx(sky.magnitude(), abs=0.01)
    assert float(made.solar_elevation_angle) == pytest.approx(sky.sun_elevation_deg, abs=1e-6)


def test_terms_add_up_and_the_ground_is_lit_by_them():
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
    asked = {"place": PLACE, "time": DUSK, "towards": "zenith", "quantity": "V", "climate": AIR} | change
    with pytest.raises(TwilightError, match=sentence) as error:
        twilight.light(**asked)
    assert "\n" not in str(error.value)


def test_the_command_prints_what_the_call_returns(tmp_path):
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
    """A full moon 57 deg up: less than the 0.32 lx that it never exceeds (Kyba, Mohar & Posch 2017); its sky is a
    render's; a new moon adds nothing."""
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
