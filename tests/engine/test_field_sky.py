"""A solved field as a person meets it: a sky of any sun at once, what it says of itself, and wrong questions."""

import warnings

import numpy as np
import pytest
from closed_sky import closed

import twilight
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.engine.sun_tables import SunTables
from twilight.engine.table import first_rows, shared_columns


@pytest.fixture
def field():
    return closed("closed air")


def asked(field, monkeypatch) -> list[float]:
    """The suns that the solver is asked for from now on."""
    inner, suns = field.blocks[0].field, []
    real = type(inner).radiance

    def radiance(self, sun_elevation_deg, *more, **options):
        suns.append(sun_elevation_deg)
        return real(self, sun_elevation_deg, *more, **options)

    monkeypatch.setattr(type(inner), "radiance", radiance)
    return suns


def test_the_sky_of_another_sun_asks_the_solver_for_nothing(field, monkeypatch):
    """A film would solve every frame, or its frames be off the field."""
    suns = asked(field, monkeypatch)
    first = field.sky(-4.0)
    assert suns and not any(sun == -4.0 for sun in suns)
    suns.clear()
    second = field.sky(-4.05)
    assert not suns
    for sky in (first, second):
        e, a = np.meshgrid(sky.elevation_deg, sky.azimuth_deg, indexing="ij")
        exact = field.radiance(sky.sun_elevation_deg, e, a)
        off = np.abs(sky.sun_normalised_radiance / exact - 1.0)
        assert np.percentile(off, 95) < 0.003 and off.max() < 0.01
    assert np.array_equal(first.direct_irradiance, field.direct(-4.0).irradiance)


@pytest.mark.parametrize(
    ("air", "suns", "most"),
    [("pure-air", (-2.9, -1.02), 0.04), ("desert", (0.9, 1.44), 0.02)],
    ids=["the edge of the Earth's shadow", "beside a low sun"],
)
def test_suns_between_those_of_a_table_have_the_light_of_the_field(air, suns, most):
    """Films and pages were off by a factor of 2 opposite to the sun in pure air, and by 10 % beside a low one."""
    field = twilight.solve(air, solver="compact", wavelength_nm=[700.0])
    tables, random = SunTables(field), np.random.default_rng(3)
    for sun in suns:
        table = tables.under(sun)
        if air == "desert":
            away, about = random.uniform(0.57, 2.5, 300), random.uniform(0.0, np.pi, 300)
            e, a = table.apparent_sun_deg[0] + away * np.sin(about), away * np.cos(about)
        else:
            e, a = random.uniform(0.5, 4.5, 300), random.normal(180.0, 25.0, 300)
        error = np.abs(table.light(e, a) / field.radiance(sun, e, a) - 1.0)
        assert error.max() < most, (sun, error.max())


def test_above_the_haze_the_aureole_is_that_of_the_air_above():
    """Its shape was that of the haze below: from 2.2 km light within 6 deg of the sun was 14 to 19 % off."""
    field = twilight.solve("continental-average", solver="compact", wavelength_nm=[550.0])
    random = np.random.default_rng(2)
    table = field.table(20.0, 2.2, rows_deg=first_rows(0.0, [], 45), columns_deg=shared_columns(31), refine=False)
    away, about = random.uniform(0.6, 6.0, 300), random.uniform(0.0, 2.0 * np.pi, 300)
    e, a = table.apparent_sun_deg[0] + away * np.sin(about), away * np.cos(about)
    np.testing.assert_allclose(table.light(e, a), field.radiance(20.0, e, a, 2.2), rtol=0.01)


def test_another_observer_is_asked_for(field, monkeypatch):
    """Another observer would get the first one's table."""
    suns = asked(field, monkeypatch)
    field.sky(-4.0, observer_altitude_km=0.05)
    assert set(suns) == {-4.0}


def test_a_field_and_a_page_say_what_they_are_in_five_lines(field):
    """`repr` would flood a console."""
    lines = repr(field).splitlines()
    assert len(lines) == 5 and max(map(len, lines)) <= 110
    assert "closed air, by " in lines[0] and "8 wavelengths 380 to 756 nm" in lines[1] and "any sun" in lines[3]
    sky = field.sky(-2.0)
    assert isinstance(sky, twilight.Sky)
    page = repr(sky.view())
    assert len(page.splitlines()) <= 5 and len(page) < 300 and "MB" in page


@pytest.mark.parametrize(
    ("question", "message"),
    [
        (lambda f: f.sky("low"), "sun_elevation_deg: must be a number or an array of numbers, got 'low'"),
        (lambda f: f.sky([-4.0, -5.0]), r"sun_elevation_deg: must be one number, got \[-4.0, -5.0\]"),
        (lambda f: f.sky(-4.0, sun_azimuth=3.0), "sky: sun_azimuth is no argument; allowed are sun_azimuth_deg"),
        (lambda f: f.radiance(95.0, 10.0, 0.0), "sun_elevation_deg: must be a number between -90 and 90, got 95"),
        (lambda f: f.radiance(-4.0, 95.0, 0.0), "elevation_deg: must be numbers between -90 and 90"),
        (lambda f: f.radiance(-4.0, np.nan, 0.0), "elevation_deg: must be finite, got nan"),
        (
            lambda f: f.radiance(-4.0, 10.0, "north"),
            "azimuth_deg: must be a number or an array of numbers, got 'north'",
        ),
    ],
)
def test_wrong_questions_are_one_sentence(field, question, message):
    """A wrong question would be NaN, or a traceback."""
    with pytest.raises(TwilightError, match=message):
        question(field)


def test_suns_beyond_a_model_are_refused_with_its_range():
    """A model would be extrapolated below its last sun."""
    field = twilight.solve("continental-average", solver="compact", wavelength_nm=[450, 550, 650])
    assert field.sky(-17.9).sun_normalised_radiance.min() > 0.0  # the last table is that of the model's last sun
    with pytest.raises(TwilightError, match=r"sun.elevation_deg is -25; the compact solver allows -18 to 90"):
        field.sky(-25.0)


def test_a_sky_without_light_says_why(field):
    """A black picture would look like a fault of the program."""
    said = (
        "no sunlight reaches it with the sun at -40 deg; a field has no light of the night: render with night.airglow=1"
    )
    with pytest.warns(TwilightWarning, match=said):
        field.sky(-40.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error", TwilightWarning)
        assert field.sky(-4.0).sun_normalised_radiance.all()
        rows, columns = np.array([10.0, 50.0]), np.arange(6) * 60.0
        field.sky(-40.0, rows, columns, night_radiance=np.full((2, 6, 8), 1e-7))
    above = closed("thin air", level=0.0)
    with pytest.warns(TwilightWarning, match="an observer at 80 km is above the air, which ends at 60 km"):
        above.sky(30.0, rows, columns, observer_altitude_km=80.0)


@pytest.mark.parametrize("elevation_deg", [-1.0, -90.0])
def test_a_sky_from_the_ground_ends_at_the_horizon(field, elevation_deg):
    """Light of the lowest row would stand for the ground."""
    for ask in (field.sky(-4.0).sample, field.sky(-4.0).luminance_at):
        with pytest.raises(TwilightError, match=rf"elevation_deg is {elevation_deg:g}; allowed in this sky is 0 to 90; "
                                                "below is the ground"):  # fmt: skip
            ask(elevation_deg, 20.0)


@pytest.mark.parametrize("name", ["preetham", "cie"])
def test_a_formula_of_the_day_has_no_twilight(name):
    """It would be black, or negative."""
    field = twilight.solve("continental-average", solver=name)
    for ask in (field.sky, field.illuminance_lux, lambda sun: field.radiance(sun, 10.0, 0.0)):
        with pytest.raises(TwilightError, match=rf"the {name} solver has no sky for this sun: .* is -2, allowed"):
            ask(-2.0)
